"""A finger that leaves the plate is not answered by full drive."""

from __future__ import annotations

import pytest

from firmware import closed_loop

NEAR_LEAST = 1.15  # times the least possible peak, where that exceeds closed_loop.PEAK_MOST
BETWEEN = 1.26  # stated in docs/board/loop.md for fingers that hold the plate just below the reference


@pytest.mark.slow
@pytest.mark.parametrize("lift", closed_loop.LIFTS)
@pytest.mark.parametrize("lift_s", [2e-3, 10e-3, 50e-3])
@pytest.mark.parametrize("quality_factor", [30, 100, 300, 1000, 2000])
def test_no_lift_overshoots_by_more_than_a_fifth(core, quality_factor: float, lift_s: float, lift: str) -> None:
    """From a sixth of the plate's own quality factor, the drive at its limit or not, at any moment of a window."""
    for share in closed_loop.SHARES:
        least = closed_loop.least(quality_factor, share, lift_s, lift)
        most = NEAR_LEAST * least if least > closed_loop.PEAK_MOST else closed_loop.PEAK_MOST
        assert max(closed_loop.peaks(quality_factor, share, lift_s, lift=lift)) < most, (share, least)


@pytest.mark.slow
@pytest.mark.parametrize("lift_s", [2e-3, 2.5e-3, 3e-3, 4e-3])
@pytest.mark.parametrize("quality_factor", [30, 40, 50, 70])
def test_no_lift_between_the_lines_of_the_table_exceeds_what_is_stated(
    core, quality_factor: float, lift_s: float
) -> None:
    for share in (0.18, 0.19, 0.2, 0.21, 0.22, 0.25, 0.3):
        for lift in closed_loop.LIFTS:
            least = closed_loop.least(quality_factor, share, lift_s, lift)
            most = max(BETWEEN, NEAR_LEAST * least)
            assert max(closed_loop.peaks(quality_factor, share, lift_s, lift=lift)) < most, (share, lift, least)


def test_the_least_peak_is_the_motion_with_a_drive_that_stays(core) -> None:
    """One time constant after a lift too sudden to be answered, 1 + 5 (1 - 1/e); a slow one is answered in time."""
    tau_s = 46.0 / closed_loop.RATE_HZ  # one window
    quality_factor = tau_s * 3.14159265 * closed_loop.TRUE_HZ
    sudden = closed_loop.least(quality_factor, 0.1, 1e-9, "damping")
    assert 1.0 + 5.0 * (1.0 - 0.3679) < sudden < 6.0
    assert closed_loop.least(quality_factor, 0.1, 1.0, "damping") < 1.05
