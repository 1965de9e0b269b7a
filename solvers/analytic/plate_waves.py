"""Waves of a free isotropic plate: exact frequencies (Rayleigh-Lamb), and how many modes they make of a body (Weyl)."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from math import cos, cosh, floor, hypot, pi, sin, sinh, sqrt

import numpy as np

from geometry.elements import FloatArray
from geometry.layout import Pillar
from geometry.materials import Material
from solvers.analytic.beams import roots_along
from solvers.errors import SolverError

# -- exact waves -------------------------------------------------------------------------------------------------------
# Exact waves of a free isotropic plate by the Rayleigh-Lamb equations, and the hard-supported plate they solve.
# An edge with u_z = 0 and no tangential displacement mirrors the waves of the infinite plate, so that each mode (m,
# n) of such a rectangle is an exact wave at k = pi sqrt((m/a)^2 + (n/b)^2).

THIN = 0.05  # k h / 2 below which the two terms of the flexural equation cancel too far for double precision
ROUNDS, TERMS = 30, 9  # to rounding below THIN


def lamb_hz(wavenumber_per_m: float, thickness_m: float, material: Material, symmetric: bool) -> float:
    """Lowest Lamb wave, S0 (symmetric) or A0, Hz.

    A0: 4 k^2 q^2 [sin(qb)/q] cos(pb) + (q^2 - k^2)^2 [sin(pb)/p] cos(qb) = 0 with p^2 = w^2/c_l^2 - k^2,
    q^2 = w^2/c_t^2 - k^2, b = h/2; S0 with sines and cosines exchanged. SolverError unless k and h are above 0,
    GeometryError for a law that is not isotropic.
    Source: lamb1917.
    """
    if not (wavenumber_per_m > 0.0 and thickness_m > 0.0):
        raise SolverError(f"wavenumber {wavenumber_per_m} 1/m, thickness {thickness_m} m: both must be above 0")
    material.as_isotropic  # noqa: B018  refuses any other law
    if not symmetric and wavenumber_per_m * thickness_m / 2.0 < THIN:
        return _thin_a0_hz(wavenumber_per_m, thickness_m, material)
    slow, fast = material.shear_m_s, material.pressure_m_s
    b, k2 = thickness_m / 2.0, wavenumber_per_m**2

    def characteristic(speed: float) -> float:
        p2, q2 = k2 * ((speed / fast) ** 2 - 1.0), k2 * ((speed / slow) ** 2 - 1.0)
        if symmetric:
            return 4.0 * k2 * p2 * _s(p2, b) * _c(q2, b) + (q2 - k2) ** 2 * _c(p2, b) * _s(q2, b)
        return 4.0 * k2 * q2 * _s(q2, b) * _c(p2, b) + (q2 - k2) ** 2 * _s(p2, b) * _c(q2, b)

    speed = next(roots_along(characteristic, slow * np.linspace(0.02, 2.0, 2000), 1e-10), None)
    if speed is None:
        raise SolverError("no wave found between the speeds searched")
    return speed * wavenumber_per_m / (2.0 * pi)


def supported_plate_hz(m: int, n: int, edges_m: tuple[float, float], thickness_m: float, material: Material) -> float:
    """Flexural mode (m, n) of a rectangle on hard supports (u_z = 0, tangential u = 0), exact in three dimensions, Hz."""
    return lamb_hz(pi * hypot(m / edges_m[0], n / edges_m[1]), thickness_m, material, False)


def _c(square: float, b: float) -> float:
    return cos(sqrt(square) * b) if square >= 0.0 else cosh(sqrt(-square) * b)


def _s(square: float, b: float) -> float:
    """sin(p b) / p, entire in p^2."""
    if abs(square) * b * b < 1e-12:
        return b
    return sin(sqrt(square) * b) / sqrt(square) if square > 0.0 else sinh(sqrt(-square) * b) / sqrt(-square)


def _thin_a0_hz(wavenumber_per_m: float, thickness_m: float, material: Material) -> float:
    """A0 of a thin plate, where the two terms of its equation all but cancel: what is left of them, by fixed point.

    Over b, with K = (kb)^2, W = (w b/c_t)^2, X = (pb)^2, Y = (qb)^2 and m = 1 - (c_t/c_l)^2 the equation is
    W sin(pb)/(pb) cos(qb) = 4 K (K - W) m h, h = [sin(qb)/(qb) cos(pb) - sin(pb)/(pb) cos(qb)]/(Y - X), 1/3 for thin plates.
    """
    k2, m = (wavenumber_per_m * thickness_m / 2.0) ** 2, 1.0 - (material.shear_m_s / material.pressure_m_s) ** 2
    w = 4.0 * k2**2 * m / 3.0
    for _ in range(ROUNDS):
        x, y = w * (1.0 - m) - k2, w - k2
        w = 4.0 * k2 * (k2 - w) * m * _cancelled(x, y) / (_s(x, 1.0) * _c(y, 1.0))
    return sqrt(w) * material.shear_m_s / (pi * thickness_m)


def _cancelled(x: float, y: float) -> float:
    """h of x and y: sum of -2 (-1)^n P_n/(2 n + 1)!, P_1 = 1, P_2 = 2 (x + y), P_n+1 = P_2 P_n - (x - y)^2 P_n-1."""
    before, last, total, factor = 0.0, 1.0, 0.0, 2.0
    for n in range(1, TERMS):
        factor /= -2.0 * n * (2.0 * n + 1.0)
        total -= factor * last
        before, last = last, 2.0 * (x + y) * last - (x - y) ** 2 * before
    return total


# -- counts of modes ---------------------------------------------------------------------------------------------------
# How many modes of a plate, its pillars or a piece of it lie below a frequency: Weyl's law branch by branch (weyl1912).
# Estimates of a count, not bounds: waves k of a branch fill an area with k^2 A/(4 pi) modes and a length with k L/pi.
# Branches through a free thickness h have k_n^2 = k^2 - (n pi/h)^2 for shear (twice) and longitudinal waves; the
# lowest of one shear family is bending. Thick bodies and high frequencies tend to V/(6 pi^2) (k_L^3 + 2 k_T^3) by
# themselves.

SOME = 0.5  # of a branch on a clamped plate: fewer are none
MAX_BRANCHES = 200  # across one side: beyond, the volume alone counts


def plate_modes(
    frequency_hz: float, length_m: float, width_m: float, thickness_m: float, material: Material, clamped_m: float = 0.0
) -> float:
    """Modes below a frequency of a rectangular plate, `clamped_m` of its rim clamped: (A k^2 - R k)/(4 pi) + 1/4 a branch."""
    area, waves = length_m * width_m, _branches(frequency_hz, thickness_m, material)
    if not clamped_m:
        return area * sum(k * k for k in waves) / (4.0 * pi)
    counts = [(area * k * k - clamped_m * k) / (4.0 * pi) + 0.25 for k in waves]
    return sum(count for count in counts if count >= SOME)


def pillar_modes(frequency_hz: float, pillar: Pillar) -> float:
    """Modes below a frequency of a pillar on a clamped foot, h (n - 1/2) half-waves along it on every branch of its section;
    with a heavy tip, of one as high as both whose own mass is that of both.
    """
    height, material = pillar.top_m, pillar.material
    side = sqrt(pillar.form.section.area_m2)
    if pillar.tip:
        material = replace(material, density_kg_m3=pillar.mass_kg / (side**2 * height))
    shear, longitudinal, bending = _waves(frequency_hz, side, material)
    if shear * side / pi > MAX_BRANCHES:
        return height * side**2 * (longitudinal**3 + 2.0 * shear**3) / (6.0 * pi**2)
    across = (np.arange(floor(shear * side / pi) + 1) * pi / side) ** 2
    section = across[:, None] + across
    lowest = 2 * _half_waves(bending, height) + _half_waves(shear, height) + _half_waves(longitudinal, height)
    section[0, 0] = np.inf
    return lowest + sum(
        many * float(np.floor(np.sqrt(np.maximum(k * k - section, 0.0)) * height / pi + 0.5).sum())
        for k, many in ((shear, 2), (longitudinal, 1))
    )


def highest_hz(count: float, modes_below: Callable[[float], float], start_hz: float = 1.0) -> float:
    """The frequency below which a body has `count` modes, Hz, by bisection."""
    high = start_hz
    while modes_below(high) < count:
        high *= 2.0
        if high > 1e15:
            return high
    low = high / 2.0
    for _ in range(40):
        middle = (low + high) / 2.0
        low, high = (middle, high) if modes_below(middle) < count else (low, middle)
    return high


def _half_waves(wavenumber: float, height_m: float) -> int:
    return floor(wavenumber * height_m / pi + 0.5)


def _waves(frequency_hz: float, thickness_m: float, material: Material) -> tuple[float, float, float]:
    """Wavenumbers of shear, longitudinal and bending waves, rad/m; a bending wave is no faster than a shear wave."""
    omega = 2.0 * pi * frequency_hz
    shear, own = omega / material.shear_m_s, material.average
    longitudinal = omega / material.pressure_m_s
    inertia = 12.0 * material.density_kg_m3 * (1.0 - own.poisson**2) / (own.young_pa * thickness_m**2)
    return shear, longitudinal, max((inertia * omega**2) ** 0.25, shear)


def _branches(frequency_hz: float, thickness_m: float, material: Material) -> list[float]:
    """Real wavenumbers of a plate's branches, rad/m."""
    shear, longitudinal, bending = _waves(frequency_hz, thickness_m, material)
    plane = shear * sqrt((1.0 - material.average.poisson) / 2.0)  # the plate's own longitudinal wave
    branches = [bending, shear, plane]
    for wave, many in ((shear, 2), (longitudinal, 1)):
        branches += many * _higher(wave, thickness_m)
    return branches


def _higher(wave: float, thickness_m: float) -> list[float]:
    last = floor(wave * thickness_m / pi)
    if last > MAX_BRANCHES:  # as many as before of the same sum of squares: the integral
        number = np.linspace(0.0, 1.0, MAX_BRANCHES + 1)[:-1] + 0.5 / MAX_BRANCHES
        return list(wave * np.sqrt((1.0 - number**2) * last / MAX_BRANCHES))
    number = np.arange(1.0, last + 1.0)
    squares: FloatArray = wave**2 - (number * pi / thickness_m) ** 2
    return list(np.sqrt(np.maximum(squares, 0.0)))
