"""Exact waves of a free isotropic plate by the Rayleigh-Lamb equations, and the hard-supported plate they solve.

An edge with u_z = 0 and no tangential displacement mirrors the waves of the infinite plate, so that each mode (m, n) of
such a rectangle is an exact wave at k = pi sqrt((m/a)^2 + (n/b)^2).
"""

from __future__ import annotations

from collections.abc import Callable
from decimal import Decimal, localcontext
from math import cos, cosh, hypot, pi, sin, sinh, sqrt

import numpy as np
from scipy.optimize import brentq

from geometry.elements import FloatArray
from geometry.materials import Material
from solvers.errors import SolverError

THIN = 0.05  # k h / 2 below which the two terms of the flexural equation cancel too far for double precision
DIGITS = 60


def lamb_hz(wavenumber_per_m: float, thickness_m: float, material: Material, symmetric: bool) -> float:
    """Lowest Lamb wave, S0 (symmetric) or A0, Hz.

    A0: 4 k^2 q^2 [sin(qb)/q] cos(pb) + (q^2 - k^2)^2 [sin(pb)/p] cos(qb) = 0 with p^2 = w^2/c_l^2 - k^2,
    q^2 = w^2/c_t^2 - k^2, b = h/2; S0 with sines and cosines exchanged. SolverError unless k and h are above 0.
    Source: lamb1917.
    """
    if not (wavenumber_per_m > 0.0 and thickness_m > 0.0):
        raise SolverError(f"wavenumber {wavenumber_per_m} 1/m, thickness {thickness_m} m: both must be above 0")
    if not symmetric and wavenumber_per_m * thickness_m / 2.0 < THIN:
        return _thin_a0_hz(wavenumber_per_m, thickness_m, material)
    slow, fast = shear_speed(material), pressure_speed(material)
    b, k2 = thickness_m / 2.0, wavenumber_per_m**2

    def characteristic(speed: float) -> float:
        p2, q2 = k2 * ((speed / fast) ** 2 - 1.0), k2 * ((speed / slow) ** 2 - 1.0)
        if symmetric:
            return 4.0 * k2 * p2 * _s(p2, b) * _c(q2, b) + (q2 - k2) ** 2 * _c(p2, b) * _s(q2, b)
        return 4.0 * k2 * q2 * _s(q2, b) * _c(p2, b) + (q2 - k2) ** 2 * _s(p2, b) * _c(q2, b)

    return _first_root(characteristic, slow * np.linspace(0.02, 2.0, 2000)) * wavenumber_per_m / (2.0 * pi)


def shear_speed(material: Material) -> float:
    """c_t = sqrt(G / rho), m/s."""
    return sqrt(material.shear_pa / material.density_kg_m3)


def pressure_speed(material: Material) -> float:
    """c_l = sqrt((lambda + 2 G) / rho), m/s."""
    return sqrt((material.lame_pa + 2.0 * material.shear_pa) / material.density_kg_m3)


def supported_plate_hz(m: int, n: int, edges_m: tuple[float, float], thickness_m: float, material: Material) -> float:
    """Flexural mode (m, n) of a rectangle on hard supports (u_z = 0, tangential u = 0), exact in three dimensions, Hz."""
    return lamb_hz(pi * hypot(m / edges_m[0], n / edges_m[1]), thickness_m, material, False)


def _first_root(characteristic: Callable[[float], float], speeds: FloatArray) -> float:
    values = np.array([characteristic(float(c)) for c in speeds])
    changes = np.flatnonzero(np.sign(values[1:]) != np.sign(values[:-1]))
    if not len(changes):
        raise SolverError("no wave found between the speeds searched")
    first = int(changes[0])
    return float(brentq(characteristic, speeds[first], speeds[first + 1], xtol=1e-10))


def _c(square: float, b: float) -> float:
    return cos(sqrt(square) * b) if square >= 0.0 else cosh(sqrt(-square) * b)


def _s(square: float, b: float) -> float:
    """sin(p b) / p, entire in p^2."""
    if abs(square) * b * b < 1e-12:
        return b
    return sin(sqrt(square) * b) / sqrt(square) if square > 0.0 else sinh(sqrt(-square) * b) / sqrt(-square)


def _thin_a0_hz(wavenumber_per_m: float, thickness_m: float, material: Material) -> float:
    """A0 of a thin plate in long decimals; the thin-plate speed bounds it from above."""
    with localcontext() as context:
        context.prec = DIGITS
        kb = Decimal(wavenumber_per_m) * Decimal(thickness_m) / 2
        slow, fast = Decimal(shear_speed(material)), Decimal(pressure_speed(material))
        high = Decimal(thickness_m) * Decimal(wavenumber_per_m) * _thin_speed(material)
        low = high * Decimal("0.9")

        def characteristic(speed: Decimal) -> Decimal:
            p2, q2 = kb * kb * ((speed / fast) ** 2 - 1), kb * kb * ((speed / slow) ** 2 - 1)
            k2 = kb * kb
            return 4 * k2 * q2 * _series(q2, 1) * _series(p2, 0) + (q2 - k2) ** 2 * _series(p2, 1) * _series(q2, 0)

        below = characteristic(low) > 0
        if below == (characteristic(high) > 0):
            raise SolverError("the flexural wave is not between 0.9 and 1 of the thin-plate speed")
        for _ in range(60):
            middle = (low + high) / 2
            low, high = (middle, high) if (characteristic(middle) > 0) == below else (low, middle)
        return float(low * Decimal(wavenumber_per_m)) / (2.0 * pi)


def _thin_speed(material: Material) -> Decimal:
    """Phase speed of the thin plate over k h: sqrt(E / (12 rho (1 - nu^2)))."""
    nu = Decimal(material.poisson)
    return (Decimal(material.young_pa) / (12 * Decimal(material.density_kg_m3) * (1 - nu * nu))).sqrt()


def _series(square: Decimal, odd: int) -> Decimal:
    """cos(p) (odd = 0) or sin(p)/p (odd = 1) as a power series in p^2."""
    term, total, n = Decimal(1), Decimal(1), odd
    while abs(term) > Decimal(10) ** -DIGITS:
        term *= -square / ((n + 1) * (n + 2))
        total += term
        n += 2
    return total
