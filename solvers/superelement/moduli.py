"""Moduli that depend on the frequency, of a plate that is reduced with those at one of them.

Stiffness is linear in the factor of each material: K(f) = sum_m s_m(f) K_m, with K_m projected once into the reduced
basis. That basis is the static one for moduli that change alike. For others, within a factor 1 +- d of one another about
their middle, it stores too much energy by at most d^2 / (1 - d): the interior's missed motion e has K e = -(K_1 u), with
|K_1| <= d K.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from geometry.elements import ComplexArray, FloatArray
from geometry.materials import Material


@dataclass(frozen=True)
class Moduli:
    """Materials with the moduli with which a plate is reduced, in the order of its stiffnesses by material.

    is_lossy: their loss factors count, too.
    """

    materials: tuple[Material, ...]
    is_lossy: bool = False

    def stiffening(self, frequency_hz: float) -> FloatArray:
        """Return the moduli at a frequency in Hz over those of the reduction, (materials,)."""
        return np.array([material.stiffening(frequency_hz) for material in self.materials])

    def factors(self, frequency_hz: float) -> ComplexArray:
        """Return s (1 + i eta) of each material at a frequency in Hz, (materials,); real where no loss counts."""
        own = self.stiffening(frequency_hz)
        if not self.is_lossy:
            return own.astype(complex)
        return np.asarray(own * [1.0 + 1j * material.at_hz(frequency_hz).lost for material in self.materials])

    @property
    def taken(self) -> ComplexArray:
        """The factors of the reduction itself, 1 + i eta of each material, (materials,)."""
        return np.array([1.0 + 1j * (material.lost if self.is_lossy else 0.0) for material in self.materials])

    def steps(self, frequency_hz: float) -> ComplexArray:
        """Return what the factors at a frequency in Hz are more than those of the reduction, and the mean, (materials + 1,)."""
        step = self.factors(frequency_hz) - self.taken
        return np.append(step, step.mean())

    def middle(self, frequency_hz: float) -> float:
        """Return the middle between the smallest and the largest of `stiffening`."""
        own = self.stiffening(frequency_hz)
        return float(own.min() + own.max()) / 2.0

    def missed(self, frequency_hz: float) -> float:
        """Bound what the basis of the reduction overestimates of an eigenvalue with the moduli at a frequency, relative."""
        apart = float(np.ptp(self.stiffening(frequency_hz))) / (2.0 * self.middle(frequency_hz))
        return apart**2 / (1.0 - apart)


def recombined(factors: ComplexArray, stiffness: ComplexArray, by_material: ComplexArray) -> ComplexArray:
    """Compute K with other moduli.

    Parameters
    ----------
    factors : ndarray, shape (materials,)
        Modulus of each material over that in K.
    stiffness : ndarray, shape (n, n)
        K; what it has more than its parts, by its correction for the mesh, takes the mean of the factors.
    by_material : ndarray, shape (materials, n, n)
        The part of each material in K.

    Returns
    -------
    ndarray, shape (n, n)
        In the units of K.
    """
    rest = stiffness - by_material.sum(axis=0)
    return np.asarray(np.tensordot(factors, by_material, 1) + factors.mean() * rest)
