"""Thin plates on hard supports against the exact three-dimensional solution: right within rounding, or refused."""

from __future__ import annotations

import numpy as np
import pytest

from geometry.hex.boxes import Boxes, hex_mesh
from geometry.materials import Material
from solvers.analytic.plates import supported_plate_hz
from solvers.errors import SolverError
from solvers.fem.assembly import assemble
from solvers.fem.eigen import modes_in_band, modes_near
from solvers.fem.solid import Pencil, constrain, free_mask
from solvers.machine import factorisations

EDGE_M = 0.1
PLATE = Material.isotropic("plate", 70e9, 2700.0, 0.34)
SIDES = ("x-", "x+", "y-", "y+")


def plate(thickness_m: float, order: int, cuts: int, supported: bool = True) -> Pencil:
    line = np.linspace(0.0, EDGE_M, cuts + 1)
    boxes = Boxes(line, line, np.array([0.0, thickness_m]), np.zeros((cuts, cuts, 1), dtype=np.int64), ("plate",))
    mesh = hex_mesh(boxes, order)
    mirrors = dict.fromkeys(SIDES, "A") if supported else {}
    return constrain(assemble(mesh, {"plate": PLATE}), free_mask(mesh, (), mirrors))


@pytest.mark.parametrize("backend", factorisations())
@pytest.mark.parametrize("ratio", [10, 100, 1000])
def test_the_lowest_mode_is_exact_within_rounding_and_discretisation(ratio: int, backend: str) -> None:
    """Order 4 on 3 x 3 elements: 1e-5 of discretisation (the thick plate's own error is 5e-7), the rest is rounding."""
    exact = supported_plate_hz(1, 1, (EDGE_M, EDGE_M), EDGE_M / ratio, PLATE)
    modes = modes_near(plate(EDGE_M / ratio, 4, 3), exact, 1, backend)
    error = abs(modes.frequency_hz[0] / exact - 1.0)
    assert error < 1e-5 + modes.rounding[0]
    assert modes.rounding[0] < 1e-3


@pytest.mark.parametrize("ratio", [1e4, 1e5, 1e6])
@pytest.mark.parametrize("order", [2, 4])
def test_what_rounding_hides_is_refused(ratio: float, order: int) -> None:
    exact = supported_plate_hz(1, 1, (EDGE_M, EDGE_M), EDGE_M / ratio, PLATE)
    with pytest.raises(SolverError):
        modes_near(plate(EDGE_M / ratio, order, 3), exact, 1)


@pytest.mark.parametrize("ratio", [10, 300])
def test_a_free_plate_has_six_rigid_motions_however_thin(ratio: int) -> None:
    pencil = plate(EDGE_M / ratio, 3, 3, supported=False)
    first = supported_plate_hz(1, 1, (EDGE_M, EDGE_M), EDGE_M / ratio, PLATE)
    modes = modes_in_band(pencil, 0.0, 2.0 * first)  # the twisting mode lies at 0.7 of the supported plate's first
    assert modes.rigid_count == 6 and len(modes.frequency_hz) == modes.count.expected >= 1
    assert modes.frequency_hz[0] > 0.5 * first


def test_a_free_plate_too_thin_for_its_rigid_motions_is_refused() -> None:
    with pytest.raises(SolverError):
        modes_in_band(plate(EDGE_M / 1e6, 3, 3, supported=False), 0.0, 10.0)
