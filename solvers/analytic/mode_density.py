"""How many modes of a plate, its pillars or a piece of it lie below a frequency: Weyl's law branch by branch (weyl1912).

Estimates of a count, not bounds: waves k of a branch fill an area with k^2 A/(4 pi) modes and a length with k L/pi. Branches
through a free thickness h have k_n^2 = k^2 - (n pi/h)^2 for shear (twice) and longitudinal waves; the lowest of one shear
family is bending. Thick bodies and high frequencies tend to V/(6 pi^2) (k_L^3 + 2 k_T^3) by themselves.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from math import floor, pi, sqrt

import numpy as np

from geometry.elements import FloatArray
from geometry.layout import Pillar
from geometry.materials import Material

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
    shear = omega * sqrt(material.density_kg_m3 / material.shear_pa)
    longitudinal = omega * sqrt(material.density_kg_m3 / (material.lame_pa + 2.0 * material.shear_pa))
    inertia = 12.0 * material.density_kg_m3 * (1.0 - material.poisson**2) / (material.young_pa * thickness_m**2)
    return shear, longitudinal, max((inertia * omega**2) ** 0.25, shear)


def _branches(frequency_hz: float, thickness_m: float, material: Material) -> list[float]:
    """Real wavenumbers of a plate's branches, rad/m."""
    shear, longitudinal, bending = _waves(frequency_hz, thickness_m, material)
    plane = shear * sqrt((1.0 - material.poisson) / 2.0)  # the plate's own longitudinal wave
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
