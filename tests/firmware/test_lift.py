"""A finger that leaves the plate is not answered by full drive."""

from __future__ import annotations

import pytest

from firmware import lifts

MOST = 1.2  # of the reference; where the windows' delay forbids that, so many times the least possible:
BEYOND_LEAST = 1.15


@pytest.mark.parametrize("lift_s", [2e-3, 10e-3, 50e-3])
@pytest.mark.parametrize("quality_factor", [30, 100, 300, 1000, 2000])
def test_no_lift_overshoots_by_more_than_a_fifth(core, quality_factor: float, lift_s: float) -> None:
    """From a sixth of the plate's own quality factor, the drive at its limit or not, at any moment of a window."""
    for share in lifts.SHARES:
        for peak, least in lifts.peaks(quality_factor, share, lift_s):
            assert peak < max(MOST, BEYOND_LEAST * least), (share, peak, least)


def test_the_least_possible_is_the_motion_before_the_first_answer() -> None:
    """A plate far faster than the windows follows its drive: U = V / d; a slow one, and a slow finger, leave time."""
    fast = lifts.least(1.0, 0.1, 150e-6, 0)  # free again when the answer comes, six times the drive still acting
    assert fast == pytest.approx(6.0, rel=0.02)
    assert lifts.least(2000.0, 0.1, 2e-3, 0) < 1.01 and lifts.least(100.0, 0.1, 1.0, 0) < 1.01
    assert lifts.least(30.0, 0.1, 2e-3, 0) > lifts.least(30.0, 0.1, 2e-3, 40)
