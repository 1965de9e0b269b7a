"""Wavevectors of a rectangular lattice: labelled paths through the irreducible Brillouin zone."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from geometry.elements import FloatArray

CORNERS = {"G": (0.0, 0.0), "X": (1.0, 0.0), "M": (1.0, 1.0), "Y": (0.0, 1.0)}


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


def path_through(corners: str, points: int, pitch_x_m: float, pitch_y_m: float) -> Path:
    """The path "GXMG": `points` intervals per segment, ends shared, corners at k = (pi/pitch_x, pi/pitch_y) times 0 or 1.

    Raises ValueError for a letter that is not G, X, M or Y, or fewer than two corners.
    """
    unknown = sorted(set(corners) - set(CORNERS))
    if unknown or len(corners) < 2:
        raise ValueError(f"path '{corners}': corners are {', '.join(CORNERS)}, at least two of them")
    edge = np.pi / np.array([pitch_x_m, pitch_y_m])
    stops = [np.array(CORNERS[letter]) * edge for letter in corners]
    vectors: list[FloatArray] = [stops[0]]
    labels: list[str | None] = [corners[0]]
    for (start, end), letter in zip(pairwise(stops), corners[1:], strict=True):
        share = np.arange(1, points + 1)[:, None] / points
        vectors.extend(start + share * (end - start))
        labels.extend([None] * (points - 1) + [letter])
    return Path(np.array(vectors), tuple(labels))
