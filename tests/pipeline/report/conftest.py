"""Pages are built in the tests' own process, solids projected there: others would prove nothing of a page."""

from __future__ import annotations

from collections.abc import Iterator

import pytest

from tests.helpers.at_once import AtOnce


@pytest.fixture(autouse=True, scope="module")
def figures_in_process() -> Iterator[None]:
    def workers(count: int, threads: int) -> AtOnce:
        assert count >= 1 and threads == 1
        return AtOnce()

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("pipeline.workers.LocalWorkers", workers)
        patch.setattr("pipeline.plots.rendering._faults", ["not target in this test"])
        yield
