"""The zone by plate theory: the exact Levy solution against Rayleigh-Ritz, limits and converged solids."""

from __future__ import annotations

from dataclasses import replace
from math import pi, sqrt

import pytest

from geometry.materials import MATERIALS, Material, Stack
from solvers.analytic.beams import free_free_mode
from solvers.analytic.plates import (
    Strip,
    beam_function_hz,
    kirchhoff_mode,
    levy_hz,
    levy_wavenumber_per_m,
    mindlin_mode,
    mindlin_wave_hz,
    thin_plate_hz,
)
from solvers.errors import SolverError
from tests.helpers.laws import orthotropic

THIN = Stack.of(2e-5, MATERIALS["aluminium"])
ZONE = Strip(0.1155, 0.020, Stack.of(0.002, MATERIALS["aluminium"]))
# the same zone as a solid, long side faces clamped, 0 to 9 nodal lines: converged three-dimensional values, Hz
SOLID = [25_935, 26_024, 26_561, 27_447, 28_773, 30_613, 33_033, 36_087, 39_807, 44_204]


def test_formula_and_exact_solution_of_the_zone():
    assert beam_function_hz(ZONE, 8) == pytest.approx(32_980.0, abs=5.0)
    assert levy_hz(ZONE, 8) == pytest.approx(33_980.0, abs=5.0)


@pytest.mark.parametrize("nodal_lines", range(11))
def test_levy_against_ritz(nodal_lines):
    mode = kirchhoff_mode(ZONE, nodal_lines, "pinned")
    assert mode.frequency_hz == pytest.approx(levy_hz(ZONE, nodal_lines), rel=1e-7)
    assert mode.mac > 0.95


@pytest.mark.parametrize("poisson", [-0.5, 0.0, 0.49])
@pytest.mark.parametrize("nodal_lines", [0, 1, 5])
def test_levy_against_ritz_for_other_poisson_ratios(poisson, nodal_lines):
    strip = replace(ZONE, stack=Stack.of(2e-3, Material.isotropic("given", 70e9, 2700.0, poisson)))
    assert kirchhoff_mode(strip, nodal_lines, "pinned").frequency_hz == pytest.approx(
        levy_hz(strip, nodal_lines), rel=1e-6
    )


@pytest.mark.parametrize("turned", [False, True])
@pytest.mark.parametrize("nodal_lines", [0, 1, 5])
def test_levy_against_ritz_for_an_orthotropic_plate(nodal_lines, turned):
    young, shear = (2e9, 40e9, 5e9) if turned else (40e9, 2e9, 5e9), (1.5e9, 2e9, 3e9)
    strip = replace(ZONE, stack=Stack.of(2e-3, orthotropic(young, (0.015 if turned else 0.3, 0.1, 0.2), shear)))
    assert kirchhoff_mode(strip, nodal_lines, "pinned").frequency_hz == pytest.approx(
        levy_hz(strip, nodal_lines), rel=1e-6
    )


def test_mindlin_of_a_thin_orthotropic_plate_is_kirchhoff():
    thin = replace(ZONE, stack=Stack.of(2e-5, orthotropic((40e9, 2e9, 5e9), (0.3, 0.1, 0.2), (1.5e9, 2e9, 3e9))))
    assert mindlin_mode(thin, 8, "pinned").frequency_hz == pytest.approx(levy_hz(thin, 8), rel=5e-4)


@pytest.mark.parametrize("nodal_lines", [2, 3, 8])
def test_infinitely_wide_zone_is_a_free_beam(nodal_lines):
    wide = replace(ZONE, width_m=1e3 * ZONE.length_m)
    assert levy_wavenumber_per_m(wide, nodal_lines) * wide.length_m == pytest.approx(
        free_free_mode(nodal_lines).kappa, rel=1e-5
    )


def test_short_zone_is_a_beam_across():
    """L much smaller than W: anticlastic bending frees the plate of its 1 - nu^2, kappa^4 = (1 - nu^2) q^4."""
    short = replace(ZONE, length_m=1e-3 * ZONE.width_m)
    expected = (1.0 - 0.34**2) ** 0.25 * short.across_per_m
    assert levy_wavenumber_per_m(short, 0) == pytest.approx(expected, rel=1e-5)


def test_edge_waves_of_a_long_zone():
    """Both ends of a long zone carry the same edge wave: kappa^4/q^4 from Konenkov's equation, below the cut-off."""
    long = replace(ZONE, length_m=5.0)
    nu = long.stack.material.as_isotropic.poisson
    konenkov = (1.0 - nu) * (3.0 * nu - 1.0 + 2.0 * sqrt((1.0 - nu) ** 2 + nu**2))
    for lines in (0, 1):
        assert (levy_wavenumber_per_m(long, lines) / long.across_per_m) ** 4 == pytest.approx(konenkov, rel=1e-9)


def test_shear_vanishes_in_thin_plates():
    thin = replace(ZONE, stack=THIN)
    assert mindlin_mode(thin, 8, "pinned").frequency_hz == pytest.approx(levy_hz(thin, 8), rel=5e-4)
    assert mindlin_mode(ZONE, 8, "pinned").frequency_hz < 0.96 * levy_hz(ZONE, 8)


def test_mindlin_wave_limits():
    slow = 2.0 * pi * mindlin_wave_hz(ZONE, 1.0) / thin_plate_hz(ZONE, 1.0) / (2.0 * pi)
    assert slow == pytest.approx(1.0, abs=2e-6)
    k = 1e6
    shear_speed = sqrt(5.0 / 6.0 * 70e9 / (2 * 1.34) / 2700.0)
    assert 2.0 * pi * mindlin_wave_hz(ZONE, k) / k == pytest.approx(shear_speed, rel=1e-3)


def test_mindlin_ritz_against_its_own_wave():
    """Far from the ends a pinned strip carries the plate wave: long zones with many lines approach it from below."""
    long = replace(ZONE, length_m=0.3, width_m=0.02)
    lines = 8
    k = levy_wavenumber_per_m(long, lines)
    assert mindlin_mode(long, lines, "pinned").frequency_hz == pytest.approx(mindlin_wave_hz(long, k), rel=2e-3)


@pytest.mark.parametrize("nodal_lines", range(10))
def test_clamped_mindlin_plate_against_the_clamped_solid(nodal_lines):
    result = mindlin_mode(ZONE, nodal_lines, "clamped").frequency_hz
    assert result == pytest.approx(SOLID[nodal_lines], rel=0.01)
    assert kirchhoff_mode(ZONE, nodal_lines, "clamped").frequency_hz > 1.06 * SOLID[nodal_lines]


def test_clamped_narrow_strip_is_a_clamped_beam_across():
    """Thin plate, W much smaller than L, N = 1: cylindrical bending between clamped sides, kappa W = 4.7300."""
    long = replace(ZONE, length_m=2.0, stack=THIN)
    expected = thin_plate_hz(long, 4.730040745 / long.width_m)
    assert kirchhoff_mode(long, 3, "clamped").frequency_hz == pytest.approx(expected, rel=2e-3)


def test_refused():
    with pytest.raises(SolverError, match="nodal lines = -1"):
        levy_hz(ZONE, -1)
    with pytest.raises(SolverError, match="must be from 0 to"):
        mindlin_mode(ZONE, 500, "pinned")
    with pytest.raises(SolverError, match="must be pinned or clamped"):
        kirchhoff_mode(ZONE, 8, "free")
    with pytest.raises(SolverError, match="must be above 0"):
        replace(ZONE, width_m=0.0)
