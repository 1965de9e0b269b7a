"""Estimated counts of modes against exact ones."""

from __future__ import annotations

from math import pi

import numpy as np
import pytest

from geometry.layout import Pillar
from geometry.materials import MATERIALS
from solvers.analytic.plates import highest_hz, pillar_modes, plate_modes

STEEL = MATERIALS["steel"]


def test_bending_of_a_thin_plate_is_counted_as_by_navier() -> None:
    """Simply supported, (m pi/a)^2 + (n pi/b)^2 < k_b^2; Weyl's next term, the rim's, is within P k/(4 pi) of it."""
    length, width, thick, hz = 0.5, 0.3, 1e-4, 2e4
    omega = 2.0 * pi * hz
    stiffness = STEEL.as_isotropic.young_pa * thick**3 / (12.0 * (1.0 - STEEL.as_isotropic.poisson**2))
    wave = (STEEL.density_kg_m3 * thick * omega**2 / stiffness) ** 0.25
    m, n = np.meshgrid(np.arange(1, 500), np.arange(1, 500))
    exact = int(((m * pi / length) ** 2 + (n * pi / width) ** 2 < wave**2).sum())
    result = plate_modes(hz, length, width, thick, STEEL)
    rim = 2.0 * (length + width) * wave / (4.0 * pi)
    assert exact < result < exact + 1.3 * rim
    assert plate_modes(hz, length, width, thick, STEEL, 2.0 * (length + width)) == pytest.approx(exact, rel=0.05)


def test_high_above_a_plate_s_first_cut_off_its_volume_counts() -> None:
    """Weyl's law for elastic bodies, V/(6 pi^2) (k_L^3 + 2 k_T^3), within the faces' share, of order 1/(k h)."""
    size, thick, hz = 0.1, 0.01, 2e7
    omega = 2.0 * pi * hz
    shear = omega * (STEEL.density_kg_m3 / STEEL.as_isotropic.shear_pa) ** 0.5
    longitudinal = (
        omega * (STEEL.density_kg_m3 / (STEEL.as_isotropic.lame_pa + 2.0 * STEEL.as_isotropic.shear_pa)) ** 0.5
    )
    volume = size * size * thick * (longitudinal**3 + 2.0 * shear**3) / (6.0 * pi**2)
    assert plate_modes(hz, size, size, thick, STEEL) == pytest.approx(volume, rel=0.02)


def test_a_slender_pillar_has_a_cantilever_s_modes() -> None:
    """First bending at (1.875/h)^2 sqrt(EI/(rho A)), in two directions; nothing below it."""
    pillar = Pillar("square", 1e-3, 1e-3, 20e-3, STEEL)
    first = (
        (1.875104 / 20e-3) ** 2
        * (STEEL.as_isotropic.young_pa * 1e-6 / (12.0 * STEEL.density_kg_m3)) ** 0.5
        / (2.0 * pi)
    )
    assert pillar_modes(0.6 * first, pillar) == 0
    assert pillar_modes(1.1 * first, pillar) == 2


def test_the_highest_frequency_is_where_the_count_is_reached() -> None:
    assert highest_hz(50.0, lambda hz: hz / 7.0) == pytest.approx(350.0)
