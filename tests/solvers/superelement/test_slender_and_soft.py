"""Cells of slender rods, of soft necks with heavy tips, of thick plates: rounding that scales with slenderness and contrast."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from geometry.hex.boxes import hex_mesh as mesh_of
from geometry.hex.boxes import panel_boxes
from geometry.hex.panels import _side_nodes
from geometry.hex.scenes import HexSettings
from geometry.layout import Pillar, Section, region_materials
from geometry.materials import MATERIALS, Material, Stack
from geometry.tiling import Panel
from solvers.fem.assembly import Scale, assemble
from solvers.fem.solid import rigid_body_modes
from solvers.plates.assembled import Reductions
from solvers.superelement.cell import KNOWN, ResidualModes, rigid_polynomials
from solvers.superelement.interface import Interface, ReductionSettings
from solvers.superelement.lattice import ReducedLattice
from solvers.superelement.reduction import CellBuilder

THIN_STACK = Stack.of(1e-3, MATERIALS["aluminium"])

ALUMINIUM = MATERIALS["aluminium"]
RUBBER = Material.isotropic("rubber", young_pa=1.175e5, density_kg_m3=1300.0, poisson=0.46875)
LEAD = Material.isotropic("lead", young_pa=40.8e9, density_kg_m3=11600.0, poisson=0.37)
WIDE_M, THICK_M, PITCH_M = 6.35e-3, 6e-3, 20e-3
PANEL = Panel((-PITCH_M / 2.0,) * 2, (PITCH_M / 2.0,) * 2, (0.0, 0.0), (0, 1))


def rods(height_m: float, top_hz: float, elements: int, face: Interface) -> ReducedLattice:
    settings = HexSettings(3, 2.0 * THICK_M, 0, height_m / elements)
    pillar = Pillar("square", WIDE_M, WIDE_M, height_m, ALUMINIUM)
    return ReducedLattice(
        Reductions(Stack.of(THICK_M, ALUMINIUM), pillar, ReductionSettings(face, top_hz, settings)).cell(PANEL)
    )


@pytest.mark.slow
def test_the_residual_flexibility_of_slender_rods_is_no_rounding() -> None:
    """Slenderness 63: that of the modes left out below 30 kHz is what the modes between 30 and 60 kHz and the rest add."""
    few, many = (rods(400e-3, top_hz, 8, Interface(2, 1)) for top_hz in (30e3, 60e3))
    truth = many.up_to(Interface(2, 1), 30e3).cell.dropped
    assert np.abs(few.cell.dropped - truth).max() < 1e-6 * np.abs(truth).max()
    edge = few.cell.residual.edge
    free = few._solve(np.zeros(2), 20)[1]
    largest = edge * np.linalg.eigvalsh(few._flexibility(np.zeros(2), free))[-1]
    assert 0.0 < largest <= 1.0  # the modes left out move no more mass than there is


def test_the_scalar_root_is_found_from_above() -> None:
    residual, own = ResidualModes(1.0), np.array([0.9, 0.9, 0.9, 0.0])
    alone = np.array([0.05, 0.3, 40.0, 0.2])
    root = residual._uncoupled(alone, own)
    assert (root + residual.softening(root) * own)[[0, 1, 3]] == pytest.approx(alone[[0, 1, 3]], rel=1e-9)
    assert root[2] == KNOWN


@pytest.mark.slow
def test_a_heavy_tip_on_a_soft_neck_follows_its_plate_exactly() -> None:
    """A contrast of 6e5: a solve alone leaves errors of 1e-7 and more in the rigid motion."""
    pillar = Pillar("square", 6e-3, 6e-3, 5e-3, RUBBER, upper=(Section.square(6e-3, 5e-3, LEAD),))
    panel = replace(PANEL, low=(-5e-3, -5e-3), high=(5e-3, 5e-3))
    mesh = mesh_of(panel_boxes(panel, THIN_STACK, pillar, HexSettings(3, 2e-3, 1, 0.15)), 3)
    scale = Scale.of(1e-3, ALUMINIUM)
    builder = CellBuilder(
        assemble(mesh, region_materials(Stack.of(1e-3, ALUMINIUM), pillar), scale), Interface(2, 1), (0, 1), ()
    )
    size_m = (10e-3, 10e-3, 1e-3)
    rigid, middle = rigid_polynomials(builder.interface, size_m), np.array([0.0, 0.0, size_m[2] / 2.0])
    field = rigid_body_modes(mesh.nodes, middle, max(size_m) / 2.0).reshape(-1, 6)
    part = builder.clamp({0: 1, 1: 1}, 0)  # of the rigid motions the vertical one alone
    moved = part.shapes @ (part.basis.T @ rigid[:, 2])
    assert np.abs(moved - field[:, 2]).max() < 1e-13


def test_a_cell_gets_the_nodes_that_its_degree_needs() -> None:
    """Degree 7 along a side needs eight nodes, a quarter of one element of order 3 mirrors to seven."""
    pillar = Pillar("round", 7e-3, 7e-3, 10e-3, ALUMINIUM)
    panel = replace(PANEL, low=(-5e-3, -5e-3), high=(5e-3, 5e-3))
    settings = HexSettings(3, 20e-3, 0, 10e-3, through=2)

    def reductions(along: int) -> Reductions:
        return Reductions(Stack.of(10e-3, ALUMINIUM), pillar, ReductionSettings(Interface(along, 2), 1e5, settings))

    assert reductions(6).settings(panel) == settings
    one = reductions(7)
    assert _side_nodes(one._mesh(panel, settings).mesh, panel) == 7
    assert _side_nodes(one._mesh(panel, one.settings(panel)).mesh, panel) >= 8
