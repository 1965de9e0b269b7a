"""Sound of a plate in a rigid baffle: what its modes lose by it, and the pressure before it.

With the face's velocity v and its transform V(kx, ky), the Rayleigh integral's power is

    P = rho c k^2 / (8 pi^2) integral |V(k sin t cos p, k sin t sin p)|^2 sin t dt dp

over the half-space of directions t, p: waves shorter than those of the air radiate nothing (williams1999).
"""

from __future__ import annotations

from dataclasses import dataclass
from math import ceil, pi

import numpy as np
from numpy.polynomial.legendre import leggauss

from geometry.elements import ComplexArray, FloatArray
from solvers.measures.confinement import TouchField

AUDIBLE_PA = 20e-6  # reference of sound pressure levels
LEAST = 16  # directions along an angle, at least
PER_RADIAN = 0.6  # directions more for each radian of k times the face's half-length
AT_ONCE = 2_000_000  # entries of a block of directions and places
SAME = 1e-9  # of the face's half-length: one coordinate


@dataclass(frozen=True)
class Air:
    """The fluid before a plate, and how many of its faces it is on."""

    density_kg_m3: float
    sound_m_s: float
    faces: int = 1

    def wavenumber_per_m(self, frequency_hz: float) -> float:
        """k = 2 pi f / c, rad/m."""
        return 2.0 * pi * frequency_hz / self.sound_m_s


def air_loss_factors(field: TouchField, symmetry: str | None, frequency_hz: FloatArray, air: Air) -> FloatArray:
    """Compute the loss factor of each mode by radiation, P / (w E), E the energy of its vibration.

    Parameters
    ----------
    field : TouchField
        Modes (q, k) on the touch face, with their modal mass. Weights are those of the whole plate; of a symmetry class the
        points with x, y > 0.
    symmetry : str or None
        Symmetry class of u_z, x then y; None where the points are those of the whole plate.
    frequency_hz : ndarray, shape (k,)
        Frequencies of the modes.
    air : Air
        Air before each radiating face; the faces are taken for alike.

    Returns
    -------
    ndarray, shape (k,)
        1/Q by radiation.

    References
    ----------
    .. [1] williams1999 (docs/references.bib)
    """
    factors, face = np.zeros(len(frequency_hz)), _Face(field, symmetry)
    for place, tone in enumerate(frequency_hz):
        wavenumber, omega = air.wavenumber_per_m(float(tone)), 2.0 * pi * float(tone)
        beamed = face.beamed(field.values[:, place], wavenumber)
        factors[place] = air.density_kg_m3 * air.sound_m_s * wavenumber**2 * beamed
        factors[place] *= air.faces / (4.0 * pi**2 * field.modal_mass_kg * omega)
    return factors


def radiated_w(field: TouchField, symmetry: str | None, velocity_m_s: FloatArray, wavenumber: float, air: Air) -> float:
    """Compute the power that a face radiates.

    Parameters
    ----------
    field : TouchField
        Points and weights of the face, as in `air_loss_factors`.
    symmetry : str or None
        Symmetry class of the velocity.
    velocity_m_s : ndarray, shape (q,)
        Amplitude of the velocity normal to the face.
    wavenumber : float
        k of the air, rad/m.
    air : Air
        Its density and speed of sound.

    Returns
    -------
    float
        Power of one face in W.
    """
    impedance = air.density_kg_m3 * air.sound_m_s
    return impedance * wavenumber**2 / (8.0 * pi**2) * _Face(field, symmetry).beamed(velocity_m_s, wavenumber)


def pressure_pa(field: TouchField, motion_m: ComplexArray, frequency_hz: float, air: Air, distance_m: float) -> complex:
    """Compute the sound pressure before the middle of a face by the Rayleigh integral.

    Parameters
    ----------
    field : TouchField
        Points and weights of the face, even in x and y where it is a part of it.
    motion_m : ndarray, shape (q,)
        Complex amplitude of u_z.
    frequency_hz : float
        Frequency of the motion.
    air : Air
        Its density and speed of sound.
    distance_m : float
        Distance from the face's middle.

    Returns
    -------
    complex
        Amplitude in Pa, time convention exp(i w t).
    """
    away = np.sqrt((field.points**2).sum(axis=1) + distance_m**2)
    spread = np.exp(-1j * air.wavenumber_per_m(frequency_hz) * away) / away
    omega = 2.0 * pi * frequency_hz
    return complex(-(omega**2) * air.density_kg_m3 / (2.0 * pi) * (field.weights * motion_m) @ spread)


def level_db(pressure: complex) -> float:
    """Compute the sound pressure level of an amplitude.

    Parameters
    ----------
    pressure : complex
        Amplitude in Pa.

    Returns
    -------
    float
        20 log10 of its rms over 20 uPa, dB.
    """
    return float(20.0 * np.log10(max(abs(pressure), 1e-300) / np.sqrt(2.0) / AUDIBLE_PA))


class _Face:
    """Points of a face by their distinct x and y: many lie on the lines of a grid, and the transform is a product of both."""

    def __init__(self, field: TouchField, symmetry: str | None) -> None:
        step = SAME * max(np.abs(field.points).max(), 1e-300)
        (self.x, along), (self.y, across) = (
            np.unique(np.round(column / step) * step, return_inverse=True) for column in field.points.T
        )
        self.places, self.weights, self.symmetry = (along.ravel(), across.ravel()), field.weights, symmetry
        self.reach_m = float(np.abs(field.points).max())

    def beamed(self, values: FloatArray, wavenumber: float) -> float:
        """Integral of |V|^2 sin t over a half-space of directions."""
        from scipy.sparse import csr_array  # slow to import, and of no use to a plan

        nodes, weights = leggauss(LEAST + ceil(PER_RADIAN * wavenumber * self.reach_m))
        tilt, turns = pi / 4.0 * (nodes + 1.0), (1 if self.symmetry else 2) * pi / 4.0
        turn = turns * (nodes + 1.0)  # a quarter of the directions of a class, half of any real field's
        share = np.outer(pi / 4.0 * weights * np.sin(tilt), turns * weights).ravel() * (4.0 if self.symmetry else 2.0)
        along, across = (wavenumber * np.outer(np.sin(tilt), each(turn)).ravel() for each in (np.cos, np.sin))
        loads = csr_array((self.weights * values, self.places), shape=(len(self.x), len(self.y)))
        total = 0.0
        for some in np.array_split(np.arange(len(share)), len(share) * len(self.y) // AT_ONCE + 1):
            x, y = self._waves(0, along[some]), self._waves(1, across[some])
            total += float(share[some] @ np.abs((np.asarray(x @ loads) * y).sum(axis=1)) ** 2)
        return total

    def _waves(self, axis: int, wavenumbers: FloatArray) -> FloatArray | ComplexArray:
        """exp(-i k x) at the distinct coordinates, (directions, n); of a class the even or the odd part alone."""
        phase = np.outer(wavenumbers, (self.x, self.y)[axis])
        if not self.symmetry:
            return np.asarray(np.exp(-1j * phase))
        return np.asarray(np.cos(phase) if self.symmetry[axis] == "S" else np.sin(phase))
