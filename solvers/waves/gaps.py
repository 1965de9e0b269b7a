"""Complete band gaps of sampled bands."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from geometry.elements import FloatArray

SMALLEST = 1e-3  # relative width: sampled bands that touch between two wavevectors leave narrower openings


@dataclass(frozen=True)
class Gap:
    """An interval without waves between bands `lower_band` and `upper_band` (from 1), Hz."""

    lower_band: int
    upper_band: int
    lower_hz: float
    upper_hz: float


def complete_gaps(frequencies_hz: FloatArray) -> list[Gap]:
    """Gaps of bands (wavevectors, bands), ascending at each wavevector: max of band n < min of band n + 1."""
    top, bottom = frequencies_hz.max(axis=0), frequencies_hz.min(axis=0)
    found = np.flatnonzero(bottom[1:] - top[:-1] > SMALLEST * bottom[1:])
    return [Gap(int(n) + 1, int(n) + 2, float(top[n]), float(bottom[n + 1])) for n in found]
