"""Every mode of the exact three-dimensional plate below 315 Hz, with its multiplicity (lamb1917)."""

from __future__ import annotations

from math import pi, sqrt

import numpy as np

from geometry.materials import Material
from solvers.analytic import plates
from solvers.fem.eigen import modes_in_band
from tests.helpers import bodies
from tests.helpers.lattice_waves import shear_hz

STEEL = Material.isotropic("steel", 200e9, 8000.0, 0.3)
BENDING_HZ = {2: (45.9712, 1), 5: (109.8569, 2), 8: (168.8193, 1), 10: (205.8646, 2), 13: (258.5599, 2)}
SHEAR_HZ = {1: (155.043, 2), 2: (219.264, 1), 4: (310.087, 2)}  # by m^2 + n^2: frequency, multiplicity
TOP_HZ = 315.0


def exact_hz() -> np.ndarray:
    """Antisymmetric waves for m, n >= 1 and in-plane shear for m + n >= 1, at k = pi sqrt(m^2 + n^2) / a."""
    result = []
    for m in range(6):
        for n in range(6):
            k = pi * sqrt(m * m + n * n) / 10.0
            if m and n and m * m + n * n < 20:
                result.append(plates.lamb_hz(k, 1.0, STEEL, False))
            if m or n:
                result.append(shear_hz(k, STEEL))
    return np.sort([value for value in result if value < TOP_HZ])


def computed_hz(cuts: int, order: int) -> np.ndarray:
    """The plate between edges that stop u_z and the tangential motion."""
    mesh = bodies.bricks(bodies.even((10.0, 10.0, 1.0), (cuts, cuts, 1)), order)
    sides = [bodies.at(mesh, axis, 0.0) | bodies.at(mesh, axis, 10.0) for axis in (0, 1)]
    pencil = bodies.constrained(mesh, STEEL, [(sides[0], [1, 2]), (sides[1], [0, 2])])
    return modes_in_band(pencil, 1.0, TOP_HZ).frequency_hz


def check_families() -> None:
    """Every mode there is and no other, each within 1e-4 and none below its exact value."""
    result, exact = computed_hz(4, 4), exact_hz()
    assert len(result) == len(exact) == 13
    assert (result > exact * (1.0 - 1e-9)).all()
    assert np.abs(result / exact - 1.0).max() < 1e-4


def test_the_exact_frequencies_are_the_known_ones() -> None:
    known = [value for family in (BENDING_HZ, SHEAR_HZ) for value, times in family.values() for _ in range(times)]
    assert np.abs(exact_hz() / np.sort(known) - 1.0).max() < 3e-6


def test_every_mode_of_the_plate_is_found_with_its_multiplicity() -> None:
    check_families()
