"""Displacements between the nodes of a panel's faces: rigid-body motions told exactly, or nothing told at all."""

from __future__ import annotations

import numpy as np
import pytest

from geometry.hex.scenes import HexSettings
from geometry.layout import Pillar
from geometry.materials import MATERIALS, Stack
from geometry.tiling import Panel
from solvers.errors import SolverError
from solvers.plates.assembled import Reductions
from solvers.superelement.bond import _field, grid_weights
from solvers.superelement.interface import Interface, ReductionSettings

ALUMINIUM = MATERIALS["aluminium"]
PANEL = Panel((-2e-3, -2e-3), (2e-3, 2e-3), (0.0, 0.0), (0, 1))
SETTINGS = ReductionSettings(Interface(2, 2), 2e5, HexSettings(3, 4e-3, 1, 0.15, 1.5e-3))
PLACES = np.array([[0.3e-3, -1.1e-3], [1.9e-3, 0.2e-3], [-1.2e-3, 1.3e-3]])


@pytest.mark.slow
@pytest.mark.parametrize(
    "shape",
    [
        "square",
        "tapered",
        "round",
        "hexagonal",
    ],
)
def test_a_lift_is_told_exactly_or_refused(shape: str) -> None:
    """Planted: without the look at the grid a round pillar's panel told -0.08 to 1 of a lift by 1."""
    pillar = Pillar(shape, 2e-3, 1.4e-3 if shape == "tapered" else 2e-3, 6e-3, ALUMINIUM)
    cell = Reductions(Stack.of(2e-3, ALUMINIUM), pillar, SETTINGS).cell(PANEL)
    if shape in ("round", "hexagonal"):
        with pytest.raises(SolverError, match="do not form a tensor grid"):
            _field(cell, PLACES, np.eye(3), back=False)
        return
    assert cell.bare
    on = np.abs(cell.bare.points[:, 2]) < 1e-9
    weights = grid_weights(cell.bare.points[on, :2], SETTINGS.hexahedra.order, PLACES)
    assert weights.sum(axis=1) == pytest.approx(np.ones(3))
    assert weights @ cell.bare.points[on, :2] == pytest.approx(PLACES)
    interpolated = _field(cell, PLACES, np.eye(3), back=False)
    assert interpolated == pytest.approx(np.tensordot(weights, cell.bare.matrix[on], axes=1))


def test_weights_are_for_grids_alone() -> None:
    grid = np.array([[x, y] for y in (0.0, 1.0, 2.0) for x in (0.0, 1.0)])
    assert grid_weights(grid[:4], 1, np.array([[0.5, 0.5]])) == pytest.approx(np.full((1, 4), 0.25))
    with pytest.raises(SolverError, match="do not form a tensor grid"):
        grid_weights(grid[:5], 1, np.array([[0.5, 0.5]]))
