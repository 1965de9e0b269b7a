"""Band gaps: complete along a path, on one of its segments, over the whole zone, and of one polarisation."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from geometry.elements import FloatArray
from solvers.waves.branches import Solved
from solvers.waves.brillouin import Path
from solvers.waves.refine import Extreme, Line, zone_extreme

SMALLEST = 1e-3  # relative width: sampled bands that touch between two wavevectors leave narrower openings


@dataclass(frozen=True)
class Gap:
    """An interval without waves between bands `lower_band` and `upper_band` (from 1), Hz."""

    lower_band: int
    upper_band: int
    lower_hz: float
    upper_hz: float


@dataclass(frozen=True)
class DirectionalGap(Gap):
    """A gap for wavevectors on one segment of the path, named by its letters."""

    start: str
    end: str


@dataclass(frozen=True)
class BrillouinZoneGap(Gap):
    """A gap over the whole zone, and the wavevectors (2,) in rad/m of its edges."""

    lower_at: tuple[float, float]
    upper_at: tuple[float, float]


def complete_gaps(frequencies_hz: FloatArray) -> list[Gap]:
    """Gaps of bands (wavevectors, bands), ascending at each wavevector: max of band n < min of band n + 1."""
    top, bottom = frequencies_hz.max(axis=0), frequencies_hz.min(axis=0)
    openings = np.flatnonzero(bottom[1:] - top[:-1] > SMALLEST * bottom[1:])
    return [Gap(int(n) + 1, int(n) + 2, float(top[n]), float(bottom[n + 1])) for n in openings]


def path_lines(solved: Solved, path: Path) -> list[Line]:
    """The path's segments with their bands."""
    return [Line(solved, path.wavevectors[segment.first : segment.last + 1]) for segment in path.segments]


def path_gaps(lines: list[Line]) -> list[Gap]:
    """Complete gaps along a path, their edges found between the samples too."""
    gaps = []
    for band in range(lines[0].value.shape[1] - 1):
        if not _may_open([line.value for line in lines], band):
            continue
        lower = max(line.extreme(band, 1).hz for line in lines)
        upper = min(line.extreme(band + 1, -1).hz for line in lines)
        if _is_open(lower, upper):
            gaps.append(Gap(band + 1, band + 2, lower, upper))
    return gaps


def directional_gaps(path: Path, lines: list[Line]) -> list[DirectionalGap]:
    """Directional gaps: those of each segment alone, the first segment's first."""
    gaps = []
    for segment, line in zip(path.segments, lines, strict=True):
        gaps += [DirectionalGap(**vars(gap), start=segment.start, end=segment.end) for gap in path_gaps([line])]
    return gaps


def zone_gaps(solved: Solved, grid: FloatArray, eigenvalue: FloatArray, along: list[Gap]) -> list[BrillouinZoneGap]:
    """Which of the path's gaps are gaps of the whole zone, from scaled eigenvalues (n, bands) on a grid (n, 2) in rad/m."""
    gaps = []
    for gap in along:
        lower = zone_extreme(solved, grid, eigenvalue[:, gap.lower_band - 1], gap.lower_band - 1, 1)
        upper = zone_extreme(solved, grid, eigenvalue[:, gap.upper_band - 1], gap.upper_band - 1, -1)
        if _is_open(lower.hz, upper.hz):
            gaps.append(BrillouinZoneGap(gap.lower_band, gap.upper_band, lower.hz, upper.hz, _at(lower), _at(upper)))
    return gaps


def sampled_zone_gaps(wavevectors: FloatArray, frequencies_hz: FloatArray, along: list[Gap]) -> list[BrillouinZoneGap]:
    """The same from frequencies (n, bands) at wavevectors (n, 2) alone, edges at samples."""
    gaps = []
    for gap in along:
        top, bottom = frequencies_hz[:, gap.lower_band - 1], frequencies_hz[:, gap.upper_band - 1]
        lower = Extreme(float(top.max()), wavevectors[top.argmax()])
        upper = Extreme(float(bottom.min()), wavevectors[bottom.argmin()])
        if _is_open(lower.hz, upper.hz):
            gaps.append(BrillouinZoneGap(gap.lower_band, gap.upper_band, lower.hz, upper.hz, _at(lower), _at(upper)))
    return gaps


def _may_open(values: list[FloatArray], band: int) -> bool:
    """Whether the samples leave an opening above a band."""
    return max(v[:, band].max() for v in values) < min(v[:, band + 1].min() for v in values)


def _is_open(lower_hz: float, upper_hz: float) -> bool:
    return upper_hz - lower_hz > SMALLEST * upper_hz


def _at(extreme: Extreme) -> tuple[float, float]:
    return float(extreme.wavevector[0]), float(extreme.wavevector[1])
