"""A simply supported plate whose three-dimensional modes are known exactly: hard supports u_z = 0, tangential u = 0.

Such edges mirror the plane waves of the infinite plate, so each mode is an exact wave at k = pi sqrt(m^2 + n^2) / a.
"""

from __future__ import annotations

from math import pi, sqrt

import numpy as np
import pytest

from geometry.hex.boxes import Boxes, hex_mesh
from geometry.materials import Material
from solvers.analytic import plates
from solvers.fem.assembly import assemble
from solvers.fem.eigen import modes_in_band
from solvers.fem.solid import Pencil, constrain
from tests.helpers.lattice_waves import shear_hz

PLATE = Material.isotropic("plate", 200e9, 8000.0, 0.3)
BENDING_HZ = {(1, 1): 45.9712, (1, 2): 109.8569, (2, 1): 109.8569, (2, 2): 168.8193}  # an independent computation


def supported(cuts: int, order: int) -> Pencil:
    """The 10 x 10 x 1 m plate, one element through its thickness."""
    x = np.linspace(0.0, 10.0, cuts + 1)
    region = np.zeros((cuts, cuts, 1), dtype=np.int64)
    mesh = hex_mesh(Boxes(x, x, np.array([0.0, 1.0]), region, ("plate",)), order)
    free = np.ones((len(mesh.nodes), 3), dtype=bool)
    for face, tangent in (("x-", 1), ("x+", 1), ("y-", 0), ("y+", 0)):
        free[np.ix_(mesh.nodes_of(face), [tangent, 2])] = False
    return constrain(assemble(mesh, {"plate": PLATE}), free)


def exact() -> np.ndarray:
    """Bending modes from A0 and the shear modes (1, 0), (0, 1), whose motion is in the plane."""
    bending = [plates.lamb_hz(pi * sqrt(m * m + n * n) / 10.0, 1.0, PLATE, False) for m, n in BENDING_HZ]
    return np.sort([*bending, *[shear_hz(pi / 10.0, PLATE)] * 2])


def test_two_exact_routes_agree() -> None:
    for (m, n), known in BENDING_HZ.items():
        wave = plates.lamb_hz(pi * sqrt(m * m + n * n) / 10.0, 1.0, PLATE, False)
        assert wave == pytest.approx(known, rel=2e-6)


def test_order_four_meets_the_exact_modes_to_a_ten_thousandth() -> None:
    modes = modes_in_band(supported(3, 4), 10.0, 180.0)
    assert len(modes.frequency_hz) == 6
    assert np.abs(modes.frequency_hz / exact() - 1.0).max() < 1e-4


def test_the_error_falls_with_the_order_and_from_above() -> None:
    errors = [modes_in_band(supported(2, order), 10.0, 180.0).frequency_hz[0] / exact()[0] - 1.0 for order in (2, 3, 4)]
    assert errors[2] > 0.0, "conforming elements are stiffer than the plate"
    assert errors[1] < errors[0] / 10.0 and errors[2] < errors[1] / 10.0
