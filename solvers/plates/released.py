"""Modes of a plate without its supports known to lie in an interval: how many, without another factorisation.

With E and F what soft supports add to K and M, and E <= t (K + x M), F <= f (M + K / x) (`AssembledPlate.softness`),
Sylvester's counts N of the plate with them and N0 without them meet N(x (1 - f) / (1 + f)) <= N0(x) <= N(x (1 + t) / (1 - t)):
where no mode with supports lies between, both are equal (parlett1998).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from geometry.elements import FloatArray
from geometry.supports import SOFT  # largest t and f: the interval loses as much of its ends
from solvers.fem.eigen import Count
from solvers.superelement.plate import AssembledPlate

ROUNDING = 1e-9  # of an end's eigenvalue


@dataclass(frozen=True)
class Released:
    """An interval in Hz within the one known with supports, and how many eigenvalues lie below an end, by scaled eigenvalue."""

    ends_hz: tuple[float, float]
    known_hz: tuple[float, float]
    counts: dict[float, int]

    def within(self, window_hz: tuple[float, float]) -> tuple[float, float]:
        """A window without the slivers at the ends of the known interval."""
        (low, high), (first, last), (start, end) = window_hz, self.ends_hz, self.known_hz
        return first if start <= low < first else low, last if last < high <= end else high


def released(plate: AssembledPlate, known: Count, frequency_hz: FloatArray) -> Released | None:
    """Count the modes of a plate without its supports in an interval a little narrower than that known with them.

    Parameters
    ----------
    plate : AssembledPlate
        The plate with its supports, which hold no degree of freedom at rest.
    known : Count
        Interval in Hz in which its modes are known, with the number below.
    frequency_hz : ndarray, shape (k,)
        These modes.

    Returns
    -------
    Released or None
        The narrower interval; None where the supports are not soft, or nothing is known below.
    """
    scale = plate.scale
    low, high = (scale.eigenvalue(end) for end in (known.low_hz, known.high_hz))
    if low <= 0.0 or known.below is None:
        return None
    t, f = plate.softness(low)
    f *= high / low  # F <= f (M + K / l) for the lowest l
    if not max(t, f) <= SOFT:
        return None
    up, down = (1.0 + t) / (1.0 - t) + ROUNDING, (1.0 - f) / (1.0 + f) - ROUNDING
    start, end = scale.frequency(np.array([low / down, high / up])).tolist()
    first, last = (scale.eigenvalue(end) for end in (start, end))
    modes = scale.eigenvalue(1.0) * np.square(frequency_hz)
    counts = {}
    if not ((modes >= low) & (modes <= first * up)).any():
        counts[first] = known.below
    if not ((modes >= last * down) & (modes <= high)).any():
        counts[last] = known.below + known.expected
    return Released((start, end), (known.low_hz, known.high_hz), counts)
