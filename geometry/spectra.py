"""Moduli that depend on the frequency: rows of a table, and the fractional Zener law."""

from __future__ import annotations

from dataclasses import dataclass
from math import inf, pi, sqrt

import numpy as np


@dataclass(frozen=True)
class Rows:
    """Rows of frequency in Hz, Young's modulus in Pa and loss factor, in order of rising frequency.

    log E and the loss factor are linear in log f between them, and constant beyond their ends.
    """

    rows: tuple[tuple[float, float, float], ...]

    @property
    def middle_hz(self) -> float:
        """Geometric mean of the ends, Hz."""
        return sqrt(self.rows[0][0] * self.rows[-1][0])

    @property
    def ends_hz(self) -> tuple[float, float]:
        """Frequencies between which it is known, Hz."""
        return self.rows[0][0], self.rows[-1][0]

    def at(self, frequency_hz: float) -> tuple[float, float]:
        """Return Young's modulus in Pa and the loss factor at a frequency in Hz."""
        tones, young, loss = np.array(self.rows).T
        at = np.log(frequency_hz)
        return float(np.exp(np.interp(at, np.log(tones), np.log(young)))), float(np.interp(at, np.log(tones), loss))


@dataclass(frozen=True)
class Zener:
    """The fractional Zener law E (1 + i eta) = (E_0 + E_inf (i w tau)^a) / (1 + (i w tau)^a) [pritz1996].

    relaxed_pa, unrelaxed_pa: E_0 at rest and E_inf at once, Pa. time_s: tau. order: a, above 0 and at most 1, Zener's own.
    """

    relaxed_pa: float
    unrelaxed_pa: float
    time_s: float
    order: float

    @property
    def middle_hz(self) -> float:
        """Frequency 1/(2 pi tau) of the transition, Hz."""
        return 1.0 / (2.0 * pi * self.time_s)

    @property
    def ends_hz(self) -> tuple[float, float]:
        """Frequencies between which it is known, Hz."""
        return 0.0, inf

    def at(self, frequency_hz: float) -> tuple[float, float]:
        """Return Young's modulus in Pa and the loss factor at a frequency in Hz."""
        turned = (2j * pi * frequency_hz * self.time_s) ** self.order
        modulus = (self.relaxed_pa + self.unrelaxed_pa * turned) / (1.0 + turned)
        return modulus.real, modulus.imag / modulus.real


Spectrum = Rows | Zener
