"""Stress fields of a cell: a quarter stands for the whole, and layers share a stress by their stiffness."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from geometry.hex.panels import panel_mesh
from geometry.hex.scenes import HexSettings
from geometry.layout import Pillar
from geometry.materials import MATERIALS, Layer, Stack
from geometry.tiling import Panel
from solvers.errors import SolverError
from solvers.fem.assembly import Scale
from solvers.fem.prestress import FIELDS, _expansion, stress_fields
from solvers.plates.assembled import Reductions
from solvers.superelement.interface import Interface, ReductionSettings
from solvers.superelement.plate import prestress_of

WARM = {name: MATERIALS[name].at(60.0) for name in ("aluminium", "steel")}
STACK = Stack((Layer(WARM["steel"], 0.5e-3), Layer(WARM["aluminium"], 1e-3)))
PILLAR = Pillar("square", 1.5e-3, 1.5e-3, 2e-3, WARM["aluminium"])

SETTINGS = HexSettings(2, 0.75e-3, 0)  # with which a quarter has the elements of the whole
REDUCTIONS = Reductions(
    STACK, PILLAR, ReductionSettings(Interface(3, 2, STACK.joints), 1e5, SETTINGS, 6e-3, None, 0), stressed=True
)
PANEL = Panel((-2e-3, -1.5e-3), (2e-3, 1.5e-3), (0.0, 0.0), (0, 1))


@pytest.mark.slow
def test_a_quarter_of_a_panel_has_the_stress_fields_of_the_whole() -> None:
    quarter, half, whole = (prestress_of(REDUCTIONS.cell(replace(PANEL, halved=axes))) for axes in ((0, 1), (1,), ()))
    count = REDUCTIONS.reduction.interface.count
    for part in (quarter, half):
        for name in ("stiffness", "pull", "load", "rest", "gram"):
            own, other = getattr(part, name), getattr(whole, name)
            if name in ("stiffness", "pull", "load"):
                own, other = (each[..., :count] for each in (own, other))
            if name == "stiffness":
                own, other = own[:, :count], other[:, :count]
            assert np.abs(other).max() > 0.0
            np.testing.assert_allclose(own, other, rtol=0.0, atol=1e-9 * np.abs(other).max(), err_msg=name)


def test_layers_share_a_stress_in_the_ratio_of_their_stiffnesses() -> None:
    """G of xx alone between u_x = x z: the mean over the layers of share times z^2, on the plate's volume."""
    bare = Panel(PANEL.low, PANEL.high)
    mesh = panel_mesh(bare, STACK, None, SETTINGS).mesh
    fields = stress_fields(mesh, STACK.regions, STACK, np.array([2e-3, 1.5e-3]), Scale.of(1e-3, WARM["steel"]))
    moved = np.prod(1e3 * mesh.nodes[:, [0, 2]], axis=1)
    stiff = np.array([material.plane_stress_pa[:2, :2].trace() for material, _ in STACK.layers])
    thick = np.array([thickness for _, thickness in STACK.layers])
    shares = stiff * thick.sum() / (stiff @ thick)
    squares = np.diff((1e3 * STACK.levels_m) ** 3) / 3.0
    assert moved @ fields.stiffness[0] @ moved == pytest.approx(4.0 * 3.0 * (shares @ squares), rel=1e-9)
    assert FIELDS[0] == (0, 0)


def test_expansion_counts_from_20_degrees_and_cells_without_fields_say_so() -> None:
    assert _expansion(WARM["aluminium"]) == pytest.approx(40.0 * 23e-6)
    with pytest.raises(SolverError, match="reduced without the thermal stress"):
        prestress_of(replace(REDUCTIONS, stressed=False).cell(replace(PANEL, foot=None)))
