"""A step of the reference is as fast as the board's windows and the drive's limit allow."""

from __future__ import annotations

import pytest

from firmware import closed_loop


def test_the_page_has_the_table_that_the_command_prints(core) -> None:
    assert closed_loop.table_of_steps() in closed_loop.PAGE.read_text()


@pytest.mark.slow
def test_the_page_has_the_lifts_that_the_command_prints(core) -> None:
    assert closed_loop.table_of_lifts() in closed_loop.PAGE.read_text()


@pytest.mark.parametrize("quality_factor", closed_loop.STEP_QUALITIES)
def test_steps_are_fast(core, quality_factor: float) -> None:
    """95 % within 2 ms at 0.2 of the drive up to Q 800, and within 1.15 times the least possible time beyond."""
    slowest = max(closed_loop.steps(quality_factor, 0.2))
    most = 2e-3 if quality_factor <= 800 else 1.15 * closed_loop.least_step(quality_factor, 0.2)
    assert slowest < most
    assert slowest > closed_loop.least_step(quality_factor, 0.2) - closed_loop.PERIOD / closed_loop.RATE_HZ
