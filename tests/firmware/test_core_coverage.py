"""No branch of the core without a test on this machine that takes it."""

from __future__ import annotations

import pytest

from tests.firmware import core_coverage


@pytest.mark.slow
def test_most_branches_of_the_core_are_taken(core, capsys) -> None:
    code = core_coverage.main()
    if code == 5:
        pytest.skip("gcc and gcov are not installed: they count")
    assert code == 0, capsys.readouterr()
