"""A round rod between sliding ends, whose modes are exact waves of the infinite rod at k = n pi / L (graff1975).

Torsion: u_theta ~ r cos(kz), omega = k c_s. Longitudinal: the lowest root of Pochhammer's equation.
"""

from __future__ import annotations

from math import factorial, pi, sqrt

import numpy as np
import pytest
from scipy.optimize import brentq
from scipy.special import i0, i1, j0, j1

from geometry.materials import Material
from geometry.mesh import check_mesh
from solvers.fem.eigen import modes_in_band
from tests.helpers import bodies

STEEL = Material.isotropic("steel", 200e9, 8000.0, 0.3)
RADIUS_M, LENGTH_M = 0.01, 0.06
SHEAR = sqrt(STEEL.as_isotropic.young_pa / (2.0 * (1.0 + STEEL.as_isotropic.poisson)) / STEEL.density_kg_m3)
PRESSURE = SHEAR * sqrt((2.0 - 2.0 * STEEL.as_isotropic.poisson) / (1.0 - 2.0 * STEEL.as_isotropic.poisson))
BAR = sqrt(STEEL.as_isotropic.young_pa / STEEL.density_kg_m3)
ORDER, SLICES = 4, 3


def wavenumber(number: int) -> float:
    """k = n pi / L, 1/m."""
    return number * pi / LENGTH_M


def torsional_hz(number: int) -> float:
    """Exact."""
    return SHEAR * wavenumber(number) / (2.0 * pi)


def longitudinal_hz(number: int) -> float:
    """Lowest root of 2 p (q^2 + k^2) J1(pa) J1(qa) / a - (q^2 - k^2)^2 J0(pa) J1(qa) - 4 k^2 p q J1(pa) J0(qa) = 0.

    p^2 = (omega / c_p)^2 - k^2 is negative here, q^2 = (omega / c_s)^2 - k^2 changes its sign at c_s.
    """
    k, a = wavenumber(number), RADIUS_M

    def characteristic(speed: float) -> float:
        decay = k * sqrt(1.0 - (speed / PRESSURE) ** 2)
        square = k * k * ((speed / SHEAR) ** 2 - 1.0)
        q = sqrt(abs(square))
        zeroth, first = (j0(q * a), j1(q * a) / q) if square > 0.0 else (i0(q * a), i1(q * a) / q)
        pressure = -decay * i1(decay * a)
        squares = (square - k * k) ** 2 * i0(decay * a) * first
        return float(2.0 / a * (square + k * k) * pressure * first - squares - 4.0 * k * k * pressure * zeroth)

    speeds = np.linspace(0.5 * SHEAR, 1.001 * BAR, 2000)
    values = np.array([characteristic(speed) for speed in speeds])
    place = int(np.flatnonzero(np.sign(values[1:]) != np.sign(values[:-1]))[0])
    return brentq(characteristic, speeds[place], speeds[place + 1], xtol=1e-10) * k / (2.0 * pi)


def dispersion(number: int) -> float:
    """Relative error of a frequency by elements of order p and length h along a wave (ainsworth2004).

    (p! / (2p)!)^2 (kh)^(2p) / (2 (2p + 1)).
    """
    step = wavenumber(number) * LENGTH_M / SLICES
    share = factorial(ORDER) / factorial(2 * ORDER)
    return share**2 * step ** (2 * ORDER) / (2.0 * (2 * ORDER + 1))


def computed_hz(torsion: bool) -> np.ndarray:
    """The two lowest modes of the class, from a quarter of the rod."""
    mesh = bodies.quarter_rod(RADIUS_M, LENGTH_M, 1, SLICES, ORDER)
    check_mesh(mesh, pi * RADIUS_M**2 * LENGTH_M / 4.0, 1e-7)
    ends = bodies.at(mesh, 2, 0.0) | bodies.at(mesh, 2, LENGTH_M)
    # a torsional motion is odd in both mirrors: nothing moves along them; a longitudinal one is even
    stops = [(bodies.at(mesh, axis, 0.0), [1 - axis, 2] if torsion else [axis]) for axis in (0, 1)]
    pencil = bodies.constrained(mesh, STEEL, [(ends, [2]), *stops])
    return modes_in_band(pencil, 1e3, 60e3 if torsion else 95e3).frequency_hz


def check_rod(torsion: bool) -> None:
    """Two modes, above the exact ones by no more than twice what these elements' dispersion along the rod explains."""
    result = computed_hz(torsion)
    assert len(result) == 2
    for number, value in enumerate(result, start=1):
        error = value / (torsional_hz if torsion else longitudinal_hz)(number) - 1.0
        assert 0.0 < error < 2.0 * dispersion(number), (number, error)


@pytest.mark.parametrize("torsion", [True, False], ids=["torsional", "longitudinal"])
def test_a_round_rods_modes_are_exact_waves(torsion: bool) -> None:
    check_rod(torsion)


def test_the_longitudinal_wave_is_the_slender_rods_with_lateral_inertia() -> None:
    for number in (1, 2):
        spread = (STEEL.as_isotropic.poisson * wavenumber(number) * RADIUS_M) ** 2 / 2.0  # nu^2 k^2 I_p / A
        slender = BAR * wavenumber(number) / (2.0 * pi)
        love = slender / sqrt(1.0 + spread)
        exact = longitudinal_hz(number)
        assert exact < love < slender
        assert abs(exact / love - 1.0) < abs(love / slender - 1.0) / 4.0, (
            "what Love's correction leaves is of next order"
        )
