"""A finger that leaves the plate is not answered by full drive."""

from __future__ import annotations

import pytest

from firmware import closed_loop

MOST = 1.2  # of the reference


@pytest.mark.parametrize("lift_s", [2e-3, 10e-3, 50e-3])
@pytest.mark.parametrize("quality_factor", [30, 100, 300, 1000, 2000])
def test_no_lift_overshoots_by_more_than_a_fifth(core, quality_factor: float, lift_s: float) -> None:
    """From a sixth of the plate's own quality factor, the drive at its limit or not, at any moment of a window."""
    for share in closed_loop.SHARES:
        assert max(closed_loop.peaks(quality_factor, share, lift_s)) < MOST, share
