"""No branch of the core without a test on this machine that takes it, and no condition that decides nothing alone."""

from __future__ import annotations

import pytest

from tests.firmware import core_coverage


@pytest.mark.slow
@pytest.mark.parametrize("arguments", [[], ["--conditions"]], ids=["branches", "conditions"])
def test_all_of_the_core_is_taken(core, capsys, arguments: list[str]) -> None:
    code = core_coverage.main(arguments)
    if code == 5:
        pytest.skip(capsys.readouterr().err)
    assert code == 0, capsys.readouterr()
