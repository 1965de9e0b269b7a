"""How alike two models' modes of one symmetry class are: angles between clusters' touch-face fields, and receptances.

Both fields are projected on cosines over the quarter plate, so that their points need not coincide.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.linalg import subspace_angles

from geometry.elements import FloatArray
from solvers.measures.confinement import TouchField

ALONG, ACROSS = 12, 8  # cosines along x and y: more would alias on the coarser quadrature
CLUSTER = 0.003  # relative distance of neighbours in a cluster
QUALITY = 300.0


@dataclass(frozen=True)
class Fields:
    """Frequencies (k,) in Hz and cosine coefficients (ALONG * ACROSS, k) of u_z on the touch face."""

    frequency_hz: FloatArray
    coefficients: FloatArray


def fields(
    frequency_hz: FloatArray, touch: TouchField, symmetry: str, half_m: tuple[float, float], mass_kg: float
) -> Fields:
    """Project u_z of a symmetry class on orthonormal cosines of |x| and |y|, for modes of 1 kg modal mass.

    half_m: half the plate's length and width; mass_kg: the whole plate's modal mass that the vectors were normalised to.
    """
    values = touch.values.copy()
    for axis, sign in enumerate(symmetry):
        if sign == "A":
            values[touch.points[:, axis] < 0.0] *= -1.0
    x, y = np.abs(touch.points).T
    functions = np.einsum("pm,pn->pmn", _cosines(x / half_m[0], ALONG), _cosines(y / half_m[1], ACROSS))
    weights = touch.weights / touch.weights.sum()
    return Fields(frequency_hz, functions.reshape(len(x), -1).T @ (weights[:, None] * values) / np.sqrt(mass_kg))


def _cosines(share: FloatArray, count: int) -> FloatArray:
    """1, sqrt(2) cos(n pi s) over s from 0 to 1, (points, count)."""
    n = np.arange(count)
    return np.where(n == 0, 1.0, np.sqrt(2.0)) * np.cos(np.pi * np.outer(share, n))


def cluster_angles(ours: Fields, theirs: Fields) -> list[tuple[float, int, float]]:
    """Clusters of equally many modes: (first frequency in Hz, modes, largest angle between the spans in degrees)."""
    measured, start = [], 0
    for end in range(1, len(ours.frequency_hz) + 1):
        last = end == len(ours.frequency_hz)
        if not last and ours.frequency_hz[end] / ours.frequency_hz[end - 1] - 1.0 < CLUSTER:
            continue
        spans = [each.coefficients[:, start:end] for each in (ours, theirs)]
        angle = float(np.degrees(subspace_angles(*spans).max()))
        measured.append((float(ours.frequency_hz[start]), end - start, angle))
        start = end
    return measured


def receptance(modes: Fields, tones_hz: FloatArray) -> FloatArray:
    """|u_z / F| at the plate's middle by the modes of the band, (f,) in m/N: |sum phi^2 / (w_i^2 (1 + i / Q) - w^2)|."""
    middle = np.einsum("m,n->mn", _cosines(np.zeros(1), ALONG)[0], _cosines(np.zeros(1), ACROSS)[0]).ravel()
    phi = middle @ modes.coefficients
    square = (2.0 * np.pi * modes.frequency_hz) ** 2 * (1.0 + 1j / QUALITY)
    return np.abs((phi**2 / (square - (2.0 * np.pi * tones_hz[:, None]) ** 2)).sum(axis=1))
