"""Empty-lattice bands: a bare plate seen as a lattice of oblong cells, in line or staggered, carries the exact waves."""

from __future__ import annotations

import numpy as np
import pytest

from geometry.lattice import Lattice
from geometry.materials import Material
from solvers.fem.assembly import assemble
from solvers.waves.bloch import BlochCell
from tests.helpers import bodies
from tests.helpers.lattice_waves import folded_hz

STEEL = Material.isotropic("steel", 200e9, 8000.0, 0.3)
PITCH_M, THICKNESS_M = (3e-3, 4e-3), 1e-3
SHARES = ((1.0, 0.0), (1.0, 1.0), (0.37, 0.81), (0.8, -0.3))
COUNT = 6


def cell(order: int, staggered: bool) -> BlochCell:
    """Two by two elements, one through the thickness."""
    mesh = bodies.bricks(bodies.even((*PITCH_M, THICKNESS_M), (2, 2, 1)), order)
    return BlochCell(assemble(mesh, {"body": STEEL}), Lattice.of_rows(*PITCH_M, staggered))


def errors(order: int, staggered: bool) -> np.ndarray:
    """Relative errors of the lowest bands at every wavevector, (wavevectors, bands)."""
    lattice, result = cell(order, staggered), []
    for share in SHARES:
        k = np.array(share) @ lattice.lattice.reciprocal_per_m / 2.0
        exact = folded_hz(k, lattice.lattice, THICKNESS_M, STEEL, COUNT)
        result.append(lattice.frequencies(k, COUNT) / exact - 1.0)
    return np.array(result)


def check_bands(staggered: bool = False) -> None:
    """Within 2e-4 by elements of order 4, from above, and ten times closer than by order 3."""
    fine = errors(4, staggered)
    assert fine.min() > -1e-9
    assert fine.max() < 2e-4
    assert fine.max() < errors(3, staggered).max() / 10.0


@pytest.mark.slow
@pytest.mark.parametrize("staggered", [False, True])
def test_a_bare_plate_carries_the_exact_waves(staggered: bool) -> None:
    check_bands(staggered)
