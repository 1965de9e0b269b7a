"""Wavevectors of a rectangular lattice: labelled paths and grids through the irreducible Brillouin zone."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from geometry.elements import FloatArray

CORNERS = {"G": (0.0, 0.0), "X": (1.0, 0.0), "M": (1.0, 1.0), "Y": (0.0, 1.0)}


@dataclass(frozen=True)
class PathSegment:
    """A straight part of a path between two labelled points: their letters and their indices in the path."""

    start: str
    end: str
    first: int
    last: int


@dataclass(frozen=True)
class Path:
    """Wavevectors (n, 2) in rad/m with a label at each high-symmetry point, and the arc length along the path."""

    wavevectors: FloatArray
    labels: tuple[str | None, ...]

    @property
    def arc(self) -> FloatArray:
        """Distance along the path, rad/m, shape (n,)."""
        steps = np.linalg.norm(np.diff(self.wavevectors, axis=0), axis=1)
        return np.concatenate([[0.0], np.cumsum(steps)])

    @property
    def segments(self) -> list[PathSegment]:
        """The straight parts, in their order."""
        marks = [(index, label) for index, label in enumerate(self.labels) if label]
        return [PathSegment(start, end, first, last) for (first, start), (last, end) in pairwise(marks)]

    def finer(self, factor: int) -> Path:
        """The same path with every interval cut into `factor`: its every factor-th wavevector is one of ours, unchanged."""
        k = self.wavevectors
        share = np.arange(1, factor)[:, None] / factor
        vectors, labels = [k[:1]], list(self.labels[:1])
        for start, end, label in zip(k[:-1], k[1:], self.labels[1:], strict=True):
            vectors += [start + share * (end - start), end[None]]
            labels += [None] * (factor - 1) + [label]
        return Path(np.concatenate(vectors), tuple(labels))


def path_through(corners: str, points: int, pitch_x_m: float, pitch_y_m: float) -> Path:
    """The path "GXMG": `points` intervals per segment, ends shared, corners at k = (pi/pitch_x, pi/pitch_y) times 0 or 1.

    Raises ValueError for a letter that is not G, X, M or Y, or fewer than two corners.
    """
    unknown = sorted(set(corners) - set(CORNERS))
    if unknown or len(corners) < 2:
        raise ValueError(f"path '{corners}': corners are {', '.join(CORNERS)}, at least two of them")
    edge = np.pi / np.array([pitch_x_m, pitch_y_m])
    return Path(np.array([CORNERS[letter] for letter in corners]) * edge, tuple(corners)).finer(points)


def zone_grid(intervals: int, pitch_x_m: float, pitch_y_m: float, mirrored: bool, diagonal: bool) -> FloatArray:
    """Wavevectors (n, 2) in rad/m on a grid over the irreducible zone, `intervals` along each axis, borders included.

    w(k) = w(-k) always. A mirror of the cell, x or y, leaves 0 <= k <= pi/pitch; a mirror on the diagonal of a square
    cell halves that to k_y <= k_x; without any, k_x runs from -pi/pitch_x.
    """
    share = np.linspace(0.0, 1.0, intervals + 1)
    across = share if mirrored else np.linspace(-1.0, 1.0, 2 * intervals + 1)
    x, y = (part.ravel() for part in np.meshgrid(across, share, indexing="ij"))
    kept = y <= x + 1e-9 if mirrored and diagonal else np.ones(len(x), dtype=bool)
    return np.column_stack([x, y])[kept] * np.pi / np.array([pitch_x_m, pitch_y_m])
