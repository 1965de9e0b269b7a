"""Lines of a tensor-product grid: breakpoints, element sizes, and geometric grading towards singular edges."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from math import ceil

import numpy as np

from geometry.elements import FloatArray

SAME = 1e-9  # relative to the whole span: breakpoints closer than this are one


@dataclass(frozen=True)
class Grading:
    """Element size away from singular edges (m), layers towards each one, and the shrink factor of a layer.

    The `skipped` innermost layers are left out: such a grid is nested in the one that has them. Between two breakpoints lie
    `least` elements or more.
    """

    size_m: float
    layers: int = 0
    factor: float = 0.3
    skipped: int = 0
    least: int = 1

    @property
    def cuts(self) -> FloatArray:
        """Where the element next to a singular edge is cut, as fractions of its length from the edge, in ascending order."""
        return np.asarray(self.factor ** np.arange(self.layers - self.skipped, 0, -1), dtype=float)


def grid_lines(breaks: dict[float, bool], grading: Grading) -> FloatArray:
    """Increasing grid coordinates through all breakpoints; True marks those to grade towards.

    Between two breakpoints the interval is cut evenly, then the end element next to a singular edge is cut
    `layers` times into the fractions factor and 1 - factor. Units: m. Source of the idea: babuska1981.
    """
    points = _merged(breaks)
    panels = [_interval(a, b, grading) for a, b in pairwise(points)]
    return np.concatenate([[points[0][0]], *panels])


def interval_count(breaks: dict[float, bool], grading: Grading) -> int:
    """Intervals of `grid_lines`, counted without making them."""
    return sum(_even_count(a, b, grading) + len(grading.cuts) * (a[1] + b[1]) for a, b in pairwise(_merged(breaks)))


def _merged(breaks: dict[float, bool]) -> list[tuple[float, bool]]:
    ordered = sorted(breaks.items())
    span = ordered[-1][0] - ordered[0][0]
    merged = [ordered[0]]
    for value, singular in ordered[1:]:
        if value - merged[-1][0] > SAME * span:
            merged.append((value, singular))
        else:
            merged[-1] = (merged[-1][0], merged[-1][1] or singular)
    return merged


def _interval(start: tuple[float, bool], end: tuple[float, bool], grading: Grading) -> FloatArray:
    """Coordinates after `start` up to and with `end`."""
    (a, grade_a), (b, grade_b) = start, end
    lines = np.linspace(a, b, _even_count(start, end, grading) + 1)
    shrink = grading.cuts
    if grade_a:
        lines = np.concatenate([[a], a + shrink * (lines[1] - a), lines[1:]])
    if grade_b:
        lines = np.concatenate([lines[:-1], b - shrink[::-1] * (b - lines[-2]), [b]])
    return lines[1:]


def _even_count(start: tuple[float, bool], end: tuple[float, bool], grading: Grading) -> int:
    """Even intervals between two breakpoints, before those at singular edges are cut."""
    count = max(grading.least, ceil((end[0] - start[0]) / grading.size_m - 1e-6))
    return max(2, count) if start[1] and end[1] and grading.layers else count
