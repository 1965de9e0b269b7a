"""The same free block by hexahedra of order 4 and by quadratic tetrahedra."""

from __future__ import annotations

import numpy as np
import pytest

from geometry.materials import Material
from geometry.mesh import Mesh
from solvers.fem.eigen import modes_in_band
from tests.helpers import bodies

SOFT = Material.isotropic("soft", 2.5e9, 1200.0, 0.31)
EDGES_M = (2.0e-3, 1.5e-3, 1.1e-3)
COUNT = 5


def elastic_hz(mesh: Mesh) -> np.ndarray:
    """The lowest modes of the free block."""
    pencil = bodies.constrained(mesh, SOFT, [])
    assert pencil.rigid_count == 6
    return modes_in_band(pencil, 0.0, 500e3).frequency_hz[:COUNT]


def check_block() -> None:
    """The hexahedra lie where the tetrahedra tend to.

    Two meshes of tetrahedra, errors from above falling with the third to fourth power of the element size (eigenvalues
    at 2p = 4, less before that is reached), enclose the limit without any other number.
    """
    hexahedra = elastic_hz(bodies.bricks(bodies.even(EDGES_M, (3, 2, 2)), 4))
    coarse, fine = (elastic_hz(bodies.tetrahedra(bodies.even(EDGES_M, (n,) * 3), 2)) for n in (5, 7))
    assert (hexahedra < fine).all() and (fine < coarse).all(), "conforming elements converge from above"
    lowest, highest = ((fine - (coarse - fine) / ((7.0 / 5.0) ** rate - 1.0)) for rate in (3.0, 4.0))
    assert (lowest < hexahedra).all() and (hexahedra < highest).all()
    assert ((highest - lowest) / fine).max() < 1e-3, "an enclosure worth having"


@pytest.mark.slow
def test_hexahedra_and_tetrahedra_agree_on_the_same_solid() -> None:
    check_block()
