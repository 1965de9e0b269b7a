"""Work of other processes done in the test's own, for tests of pages and tables, which do not depend on processes."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import Executor, Future
from typing import Any

import pytest

from pipeline.batch import runner


class AtOnce(Executor):
    """Executor that runs its work immediately; tests of the runner use real processes."""

    def submit(self, function: Callable[..., Any], /, *args: Any, **kwargs: Any) -> Future[Any]:
        future: Future[Any] = Future()
        try:
            future.set_result(function(*args, **kwargs))
        except Exception as error:
            future.set_exception(error)
        return future


def sweep_here(patch: pytest.MonkeyPatch) -> None:
    """Run sweeps of `import antinode` on this process' meshes instead of in workers."""
    patch.setattr(runner.workers, "LocalWorkers", lambda workers, threads: AtOnce())
