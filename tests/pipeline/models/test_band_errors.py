"""Bars of gap edges hold every band that lies within its own bars; the widest bar is named with its parts."""

from __future__ import annotations

import numpy as np
import pytest

from geometry.lattice import Path
from pipeline.models import bands
from solvers.waves.gaps import DirectionalGap, Gap, complete_gaps

RANDOM = np.random.default_rng(5)
BANDS = np.sort(RANDOM.uniform(1.0, 2.0, (9, 2)), axis=0)[RANDOM.permutation(9)] + np.array([0.0, 2.0])
BARS = RANDOM.uniform(1e-3, 3e-2, BANDS.shape)
PATH = Path(np.column_stack([np.arange(9.0), np.zeros(9)]), ("G", None, None, None, "X", None, None, None, "M"))


@pytest.mark.parametrize("seed", range(20))
def test_edges_of_bands_anywhere_within_their_bars_lie_within_theirs(seed: int) -> None:
    (gap,) = complete_gaps(BANDS)
    bars = bands.gap_errors(gap, BANDS, BARS)
    exact = BANDS * (1.0 + BARS * np.random.default_rng(seed).choice([-1.0, 1.0], BANDS.shape))
    assert bars["lower_error"] and bars["upper_error"]
    assert abs(exact[:, 0].max() - gap.lower_hz) <= bars["lower_error"] * gap.lower_hz * (1.0 + 1e-12)
    assert abs(exact[:, 1].min() - gap.upper_hz) <= bars["upper_error"] * gap.upper_hz * (1.0 + 1e-12)


def test_the_edge_of_a_band_with_one_bar_has_that_bar() -> None:
    gap = Gap(1, 2, float(BANDS[:, 0].max()), float(BANDS[:, 1].min()))
    same = bands.gap_errors(gap, BANDS, np.full(BANDS.shape, 0.01))
    assert same == pytest.approx({"lower_error": 0.01, "upper_error": 0.01})
    unknown = BARS.copy()
    unknown[3, 0] = np.nan
    assert bands.gap_errors(gap, BANDS, unknown)["lower_error"] is None


def test_a_gap_of_one_segment_has_the_bars_of_that_segment() -> None:
    own = BANDS[4:]
    gap = DirectionalGap(1, 2, float(own[:, 0].max()), float(own[:, 1].min()), "X", "M")
    (fields,) = bands.with_edges([gap], PATH, BANDS, BARS)
    assert fields["start"] == "X" and fields["lower_error"] == bands.edge_error(own[:, 0], BARS[4:, 0], gap.lower_hz, 1)


def test_the_widest_bar_is_named_with_its_largest_part() -> None:
    mesh, truncation = np.full((9, 2), 1e-3), np.full((9, 2), 2e-3)
    truncation[8, 1] = 1e-2
    widest = bands.widest(PATH, mesh, truncation)
    assert widest.text() == "error of any frequency: at most 1.1 % (band 2 at M: 1.0 % truncation, 0.10 % mesh)"
    assert widest.largest_part == "truncation" and widest.to_dict()["error"] == pytest.approx(0.011)
    mesh[0, 0] = np.nan
    assert bands.widest(PATH, mesh, truncation).error is None
