"""Gap edges between the samples, over the whole zone, and of one polarisation; on made-up bands and on a cell."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache, partial
from typing import Any

import numpy as np
import pytest

from geometry.hex.scenes import HexSettings
from geometry.lattice import Lattice
from geometry.layout import Pillar
from geometry.materials import MATERIALS, Stack
from geometry.tiling import Panel
from solvers.fem.assembly import Scale
from solvers.plates.assembled import Reductions
from solvers.superelement.interface import Interface, ReductionSettings
from solvers.superelement.lattice import ReducedLattice, Waves
from solvers.waves.branches import Solved, follow
from solvers.waves.gaps import (
    Line,
    cubic_top,
    directional_gaps,
    labels_along,
    path_gaps,
    path_lines,
    polarisation_gaps,
    sampled_extreme,
    sampled_lines,
    searched_extreme,
    tent_top,
    zone_extreme,
    zone_gaps,
)

ALUMINIUM = MATERIALS["aluminium"]
PILLAR = Pillar("square", 2e-3, 2e-3, 6.3e-3, ALUMINIUM)
PITCH = (3e-3, 4e-3)
ONE = Scale(1.0, 1.0, 1.0)


@dataclass(frozen=True)
class MadeUp:
    """Bands lambda_n(k) given as functions on a cell of 1 x 1 m, in the place of a lattice."""

    bands: tuple[Any, ...]
    rounding: float = 1e-14

    @property
    def cell(self) -> Any:
        return type("C", (), {"size_m": (1.0, 1.0, 0.1), "edges_m": None, "scale": ONE})

    @property
    def dof(self) -> int:
        return len(self.bands)

    def eigenvalues(self, k: np.ndarray, count: int) -> np.ndarray:
        return np.sort([band(*k) for band in self.bands])[:count]

    def waves(self, k: np.ndarray, count: int) -> Waves:
        value = self.eigenvalues(k, count)
        return Waves(k, value, ONE.frequency(value), np.eye(len(value), dtype=complex), np.zeros(len(value)))

    def slopes(self, waves: Waves) -> np.ndarray:
        k, h = waves.wavevector, 1e-6
        order = np.argsort([band(*k) for band in self.bands])
        rows = []
        for shift in h * np.eye(2):
            rise = [(self.bands[i](*(k + shift)) - self.bands[i](*(k - shift))) / (2 * h) for i in order]
            rows.append(np.diag(rise).astype(complex)[: len(waves.eigenvalue), : len(waves.eigenvalue)])
        return np.array(rows)


def made_up(*bands: Any) -> Solved:
    return Solved(MadeUp(bands), len(bands))  # type: ignore[arg-type]


def hump(x: float, y: float) -> float:
    """Largest, 2, at kx = 1.1 on the way to X, off every sample."""
    return 2.0 - 0.3 * (x - 1.1) ** 2 + 0.03 * (x - 1.1) ** 3 - 0.2 * y


@pytest.mark.parametrize("points", [3, 5, 25])
def test_an_edge_between_the_samples_is_found(points: int) -> None:
    solved = made_up(hump, lambda x, y: 4.0 + 0.1 * np.cos(x))
    line = Line.of_waves(solved, Lattice.of_rows(1.0, 1.0).path("GX", points).wavevectors)
    result = line.extreme(0, 1)
    assert result.hz == pytest.approx(float(ONE.frequency(np.array(2.0))), rel=1e-8)
    assert result.wavevector == pytest.approx([1.1, 0.0], abs=1e-4)
    assert line.value[:, 0].max() < 2.0 - 1e-4  # the samples alone would not do


@pytest.mark.parametrize("points", [3, 4, 7, 25])
def test_bands_that_cross_between_the_samples_leave_no_gap(points: int) -> None:
    solved = made_up(lambda x, y: 1.0 + 0.9 * x, lambda x, y: 4.0 - 1.2 * x)
    line = Line.of_waves(solved, Lattice.of_rows(1.0, 1.0).path("GX", points).wavevectors)
    assert line.value[:, 0].max() < line.value[:, 1].min()  # sampled, a gap
    assert path_gaps([line]) == []


def test_cubics_and_tents_stand_where_they_should() -> None:
    at, value = np.array([0.0, 1.0, 3.0]), np.array([0.0, 0.0, 0.0])
    slope = np.array([1.0, 1.0, 1.0])
    assert cubic_top(at, value, slope, -slope) == pytest.approx([0.25, 0.5], rel=0.02)
    assert tent_top(at, value, slope, -slope) == pytest.approx([0.5, 1.0])
    assert tent_top(at, value, slope, slope).tolist() == [-np.inf, -np.inf]


def test_an_edge_off_the_path_is_found_over_the_zone() -> None:
    """The lower band peaks inside the zone, the upper has its least value at M: along G-X-M-G the gap looks wider."""

    def inner(x: float, y: float) -> float:
        return 1.0 + np.exp(-((x - 2.1) ** 2 + (y - 1.03) ** 2) / 0.08)

    solved = made_up(inner, lambda x, y: 3.5 + 0.2 * np.cos(x) + 0.2 * np.cos(y))
    path = Lattice.of_rows(1.0, 1.0).path("GXMG", 25)
    along = path_gaps(path_lines(solved, path))
    grid = Lattice.of_rows(1.0, 1.0).grid(12, ("x", "y", "d"))
    values = np.array([solved.lattice.waves(k, 2).eigenvalue for k in grid])
    (result,) = zone_gaps(along, partial(zone_extreme, solved, grid, values))
    assert result.lower_hz == pytest.approx(float(ONE.frequency(np.array(2.0))), rel=1e-6)
    assert result.lower_at == pytest.approx((2.1, 1.03), abs=1e-3)
    assert result.upper_at == pytest.approx((np.pi, np.pi), abs=1e-3)
    assert result.upper_hz == pytest.approx(along[0].upper_hz, rel=1e-9)
    assert along[0].lower_hz < 0.9 * result.lower_hz
    (sampled,) = zone_gaps(along, partial(sampled_extreme, grid, ONE.frequency(values)))
    assert along[0].lower_hz < sampled.lower_hz < result.lower_hz


def test_a_gap_that_the_zone_fills_is_no_gap_of_the_zone() -> None:
    solved = made_up(
        lambda x, y: 1.0 + 2.0 * np.exp(-((x - 2.1) ** 2 + (y - 1.03) ** 2) / 0.05), lambda x, y: 2.0 + 0.1 * y
    )
    along = path_gaps(path_lines(solved, Lattice.of_rows(1.0, 1.0).path("GXMG", 25)))
    grid = Lattice.of_rows(1.0, 1.0).grid(16, ("x", "y", "d"))
    assert len(along) == 1
    values = np.array([solved.lattice.waves(k, 2).eigenvalue for k in grid])
    assert zone_gaps(along, partial(zone_extreme, solved, grid, values)) == []


@cache
def lattice() -> ReducedLattice:
    half = np.array(PITCH) / 2.0
    reduction = ReductionSettings(Interface(4, 3), 1.2e6, HexSettings(3, 4e-3, 0, 0.2, 6.3e-3))
    panel = Panel(tuple(-half), tuple(half), (0.0, 0.0), (0, 1))
    return ReducedLattice(Reductions(Stack.of(2e-3, ALUMINIUM), PILLAR, reduction).cell(panel))


@pytest.mark.slow
def test_three_points_a_leg_give_the_edges_of_twenty_five_and_of_a_brute_search() -> None:
    """An oblong cell: edges inside segments, not only at their ends."""
    result = []
    for points, factor in ((3, 8), (25, 1)):
        path = Lattice.of_rows(*PITCH).path("GXMYG", points).finer(factor)
        lines = path_lines(Solved(lattice(), 10), path)
        result.append((path_gaps(lines), directional_gaps(path, lines)))
    for coarse, fine in zip(*result, strict=True):
        assert len(coarse) == len(fine) > 0
        for one, two in zip(coarse, fine, strict=True):
            assert one.lower_band == two.lower_band
            assert one.lower_hz == pytest.approx(two.lower_hz, rel=1e-6)
            assert one.upper_hz == pytest.approx(two.upper_hz, rel=1e-6)
    first = next(gap for gap in result[0][1] if (gap.start, gap.end) == ("G", "X"))
    k = np.column_stack([np.linspace(0.5, 1.0, 120) * np.pi / PITCH[0], np.zeros(120)])
    brute = max(float(lattice().frequencies(each, first.lower_band)[-1]) for each in k)
    assert first.lower_hz == pytest.approx(brute, rel=2e-5) and first.lower_hz >= brute * (1.0 - 1e-9)
    assert first.lower_hz > float(lattice().frequencies(k[-1], first.lower_band)[-1]) * (1.0 + 1e-4)  # not at X


@pytest.mark.slow
@pytest.mark.parametrize("points", [9, 24])
def test_frequencies_alone_give_the_same_edges(points: int) -> None:
    """Without group velocities: the chords of the neighbouring intervals say where to search."""
    path, solve = Lattice.of_rows(*PITCH).path("GXMYG", points), partial(lattice().frequencies, count=10)
    sampled = sampled_lines(solve, path, np.array([solve(k) for k in path.wavevectors]))
    known = path_lines(Solved(lattice(), 10), path)
    for one, two in zip(directional_gaps(path, sampled), directional_gaps(path, known), strict=True):
        assert (one.lower_band, one.start, one.end) == (two.lower_band, two.start, two.end)
        assert (one.lower_hz, one.upper_hz) == pytest.approx((two.lower_hz, two.upper_hz), rel=2e-5)


def test_a_crossing_between_samples_without_slopes_leaves_no_gap() -> None:
    def solve(k: np.ndarray) -> np.ndarray:
        return np.sort([1.0 + 0.9 * k[0], 4.0 - 1.2 * k[0]])

    path = Lattice.of_rows(1.0, 1.0).path("GX", 8)
    lines = sampled_lines(solve, path, np.array([solve(k) for k in path.wavevectors]))
    assert lines[0].value[:, 0].max() < lines[0].value[:, 1].min() and path_gaps(lines) == []


def test_an_edge_inside_the_zone_is_searched_without_a_gradient() -> None:
    def solve(k: np.ndarray) -> np.ndarray:
        return np.array([2.0 - (k[0] - 1.1) ** 2 - (k[1] - 0.7) ** 2])

    grid = Lattice.of_rows(1.0, 1.0).grid(6, ("x", "y"))
    values = np.array([solve(k) for k in grid])
    assert sampled_extreme(grid, values, 0, 1).hz < 1.99
    result = searched_extreme(solve, grid, values, 0, 1)
    assert result.hz == pytest.approx(2.0, rel=1e-4) and result.wavevector == pytest.approx([1.1, 0.7], abs=0.02)


def test_directional_gaps_contain_the_complete_ones() -> None:
    path = Lattice.of_rows(*PITCH).path("GXMYG", 12)
    lines = path_lines(Solved(lattice(), 10), path)
    complete, directional = path_gaps(lines), directional_gaps(path, lines)
    for gap in complete:
        segments = [segment for segment in directional if segment.lower_band == gap.lower_band]
        assert [(segment.start, segment.end) for segment in segments] == [
            ("G", "X"),
            ("X", "M"),
            ("M", "Y"),
            ("Y", "G"),
        ]
        assert max(segment.lower_hz for segment in segments) == gap.lower_hz
        assert min(segment.upper_hz for segment in segments) == gap.upper_hz


@pytest.mark.slow
def test_no_wave_of_a_polarisation_lies_in_its_gaps_and_some_lie_at_their_edges() -> None:
    solved, path = Solved(lattice(), 10), Lattice.of_rows(*PITCH).path("GXMYG", 24)
    branches = follow(solved, path.wavevectors)
    gaps = polarisation_gaps(solved, branches, labels_along(solved, branches))
    assert {gap.polarisation for gap in gaps} >= {"flexural", "shear"}
    other = follow(
        solved, Lattice.of_rows(*PITCH).path("GXMYG", 37).wavevectors
    )  # other wavevectors than the search began with
    labels = labels_along(solved, other)
    for gap in gaps:
        tones = np.array([
            hz
            for waves, row in zip(other.waves, labels, strict=True)
            for hz, label in zip(waves.frequency_hz, row, strict=True)
            if label.plate == gap.polarisation
        ])  # fmt: skip
        inside = tones[(tones > gap.lower_hz * 1.001) & (tones < gap.upper_hz * 0.999)]
        assert len(inside) == 0, gap
        for edge in (gap.lower_hz, gap.upper_hz):
            assert np.abs(tones / edge - 1.0).min() < 0.1  # a step of a steep band away at most
