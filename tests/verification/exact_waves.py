"""Exact waves of a free isotropic plate, by the Rayleigh-Lamb equations: the independent route of the verifications."""

from __future__ import annotations

from math import cos, cosh, pi, sin, sinh, sqrt

import numpy as np
from scipy.optimize import brentq

from geometry.materials import Material


def _c(square: float, b: float) -> float:
    return cos(sqrt(square) * b) if square >= 0.0 else cosh(sqrt(-square) * b)


def _s(square: float, b: float) -> float:
    """sin(p b) / p, entire in p^2."""
    if abs(square) * b * b < 1e-12:
        return b
    return sin(sqrt(square) * b) / sqrt(square) if square > 0.0 else sinh(sqrt(-square) * b) / sqrt(-square)


def lamb_hz(wavenumber: float, thickness: float, material: Material, symmetric: bool) -> float:
    """Lowest Lamb wave S0 or A0: 4 k^2 p q sin(qb) cos(pb) + (q^2 - k^2)^2 sin(pb) cos(qb) = 0 (A0), b = h/2."""
    slow = sqrt(material.shear_pa / material.density_kg_m3)
    fast = sqrt((material.lame_pa + 2.0 * material.shear_pa) / material.density_kg_m3)
    b, k2 = thickness / 2.0, wavenumber**2

    def characteristic(speed: float) -> float:
        p2, q2 = k2 * ((speed / fast) ** 2 - 1.0), k2 * ((speed / slow) ** 2 - 1.0)
        if symmetric:
            return 4.0 * k2 * p2 * _s(p2, b) * _c(q2, b) + (q2 - k2) ** 2 * _c(p2, b) * _s(q2, b)
        return 4.0 * k2 * q2 * _s(q2, b) * _c(p2, b) + (q2 - k2) ** 2 * _s(p2, b) * _c(q2, b)

    speeds = slow * np.linspace(0.02, 2.0, 2000)
    values = np.array([characteristic(c) for c in speeds])
    first = int(np.flatnonzero(np.sign(values[1:]) != np.sign(values[:-1]))[0])
    return float(brentq(characteristic, speeds[first], speeds[first + 1], xtol=1e-10)) * wavenumber / (2.0 * pi)


def shear_hz(wavenumber: float, material: Material) -> float:
    """Lowest horizontally polarised shear wave: f = k c_t / (2 pi)."""
    return wavenumber * sqrt(material.shear_pa / material.density_kg_m3) / (2.0 * pi)


def folded_hz(
    wavevector: np.ndarray, pitch: tuple[float, float], thickness: float, material: Material, count: int
) -> np.ndarray:
    """The `count` lowest waves of the plate seen as a lattice: A0, S0 and SH0 at k + G."""
    found: list[float] = []
    for m in range(-3, 4):
        for n in range(-3, 4):
            k = float(np.hypot(*(wavevector + 2.0 * pi * np.array([m, n]) / np.array(pitch))))
            if k < 1e-9:
                found += [0.0, 0.0, 0.0]
                continue
            found += [lamb_hz(k, thickness, material, s) for s in (False, True)] + [shear_hz(k, material)]
    lowest = np.sort(found)[:count]
    cutoff = sqrt(material.shear_pa / material.density_kg_m3) / (2.0 * thickness)
    assert lowest[-1] < 0.9 * cutoff, "above the cut-off higher waves would have to be counted"
    return lowest
