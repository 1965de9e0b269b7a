"""Bare panels without a mesh, and the column's rows condensed one after another."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.linalg import eigh

from geometry.elements import FloatArray
from geometry.hex.scenes import HexSettings
from geometry.layout import Design, Pillar
from geometry.materials import Material, Stack
from geometry.tiling import Panel
from pipeline.models.live_column import CONDENSED
from pipeline.planning.mesh_rules import search_window_hz
from solvers.measures.confinement import measure_profile
from solvers.parametric import finite
from solvers.parametric.bare import bare_cell
from solvers.parametric.finite import Chain, real_basis, real_row
from solvers.plates.assembled import Reductions
from solvers.plates.column import Column
from solvers.superelement.cell import rigid_boundary
from solvers.superelement.interface import Interface, ReductionSettings
from solvers.superelement.lattice import Periodic
from solvers.waves.complex_bands import Row

ALUMINIUM = Material.isotropic("aluminium", 70e9, 2700.0, 0.34)
FACE = Interface(3, 2)
SIZE = (4e-3, 5.5e-3, 2e-3)
WINDOW = (24e3, 45e3)
PILLAR = Pillar("square", 2e-3, 2e-3, 6.3e-3, ALUMINIUM)
DESIGN = Design(115.5e-3, 20e-3, 2e-3, 8, ALUMINIUM, PILLAR, 4e-3, 4e-3, 2, 10e-3)


def reductions(
    size_m: float = 4e-3, order: int = 3, top_hz: float = 6.0 * WINDOW[1], design: Design = DESIGN
) -> Reductions:
    settings = ReductionSettings(FACE, top_hz, HexSettings(order, size_m, 0), 3.0 * design.thickness_m)
    made = Reductions(Stack.of(design.thickness_m, ALUMINIUM), design.pillar, settings)
    made.coarser = lambda panel: None  # type: ignore[method-assign]
    return made


def test_rigid_motions_of_a_bare_panel_meet_no_force_and_carry_its_mass() -> None:
    cell = bare_cell(SIZE, ALUMINIUM, FACE)
    motions = rigid_boundary(cell)
    assert np.abs(cell.stiffness @ motions).max() < 1e-12 * np.abs(cell.stiffness).max()
    mass = cell.scale.mass_kg * np.diag(motions[:, :3].T @ cell.mass @ motions[:, :3])
    assert mass == pytest.approx(2700.0 * np.prod(SIZE), rel=1e-12)
    assert cell.touch.weights is not None and cell.touch.weights.sum() == pytest.approx(SIZE[0] * SIZE[1], rel=1e-12)


@pytest.mark.slow
def test_a_bare_panel_is_that_of_a_fine_mesh() -> None:
    """Both are Ritz, and their boundaries alike: the few polynomials of the inside lie above a mesh of order 4, but closely."""
    half = SIZE[0] / 2.0, SIZE[1] / 2.0
    fine = reductions(2e-3, 4, 3e6).cell(Panel((-half[0], -half[1]), half, None, (0, 1)))
    rows = [Row(cell, 200.0) for cell in (bare_cell(SIZE, ALUMINIUM, FACE), fine)]
    ours, theirs = (eigh(row.stiffness, row.mass, eigvals_only=True, subset_by_index=(0, 6)) for row in rows)
    assert (ours >= theirs * (1.0 - 1e-3)).all()  # the mesh leaves out its fixed-interface modes above 3 MHz
    assert ours == pytest.approx(theirs, rel=1e-2)


@pytest.mark.slow
@pytest.mark.parametrize("pillars", [(), (True,), (True, False), (False, True)])
def test_a_rows_matrices_are_real_in_their_coordinates(pillars: tuple[bool, ...]) -> None:
    """Also of two panels in a pitch, a pillar in the first or in the second."""
    bare, half = bare_cell(SIZE, ALUMINIUM, FACE), (SIZE[0] / 2.0, SIZE[1] / 2.0)
    own = reductions().cell(Panel((-half[0], -half[1]), half, (0.0, 0.0), (0, 1)))
    row = Row(Periodic([own if each else bare for each in pillars or (False,)]), 200.0)
    basis = real_basis(row)
    assert basis.conj().T @ basis == pytest.approx(np.eye(len(basis)), abs=1e-12)
    for matrix, real in zip((row.stiffness, row.mass), real_row(row), strict=True):
        projected = basis.conj().T @ matrix @ basis
        assert np.abs(projected - real).max() < 1e-9 * np.abs(projected).max()


def test_the_condensed_column_has_the_columns_modes() -> None:
    """Against one dense solve of the whole column: same frequencies, same shapes, the target mode best."""
    column = Column(DESIGN, reductions(), 7.5 * np.pi / DESIGN.length_m)
    target_hz, target = column.solve(*WINDOW)
    condensed_hz, condensed = Chain(column, *WINDOW).solve(*WINDOW)
    assert len(condensed_hz) == len(target_hz)
    assert condensed_hz == pytest.approx(
        target_hz, rel=5e-3
    )  # at the window's ends; what is condensed is exact in its middle
    levels = [measure_profile(column.profile(vectors), DESIGN) for vectors in (target, condensed)]
    at = levels[0].target.index
    assert at is not None and levels[1].target.index == at
    assert condensed_hz[at] == pytest.approx(target_hz[at], rel=1e-5)
    assert levels[1].confinement_db[at] == pytest.approx(levels[0].confinement_db[at], abs=0.02)


STOUT = replace(PILLAR, base_m=1.25e-3, tip_m=1.25e-3, height_m=4.15e-3)
THICK = Design(90e-3, 18e-3, 2.65e-3, 6, ALUMINIUM, STOUT, 5.6e-3, 5.6e-3, 3, 15e-3)


def too_high(design: Design, half_waves: float, low_hz: float, high_hz: float) -> FloatArray:
    """How far the condensed column's modes between two frequencies lie above those of one dense solve, relative."""
    column = Column(design, reductions(5e-3, design=design), half_waves * np.pi / design.length_m)
    every = [solver.solve(-1.0, 1.5 * high_hz)[0] for solver in (column, Chain(column, low_hz, high_hz))]
    known = min(map(len, every))
    dense, condensed = (hz[:known] for hz in every)
    inside = (dense >= low_hz) & (dense <= high_hz)
    assert inside.any()
    return np.asarray(condensed / dense - 1.0)[inside]


@pytest.mark.slow
@pytest.mark.parametrize("half_waves", [3.5, 5.5])
def test_a_thick_plates_modes_are_right_wherever_the_target_one_is_searched(half_waves: float) -> None:
    """Modes far below the window's middle too, within what the live plate's bar holds for it."""
    off = too_high(THICK, half_waves, *search_window_hz(THICK))
    assert off.min() > -1e-9 and off.max() < CONDENSED


def test_condensed_modes_keep_their_bound_however_wide_the_window() -> None:
    """l rises by less than (1 - f1/f2)^2 / REACH^2 of itself at both ends, and f by half of it."""
    low_hz, high_hz = 3e3, 60e3
    off = too_high(THICK, 1.0, low_hz, high_hz)
    assert len(off) > 10 and off.max() < (1.0 - low_hz / high_hz) ** 2 / finite.REACH**2 / 2.0


@pytest.mark.slow
@pytest.mark.parametrize("rows", [1, 2, 3])
def test_the_condensed_column_of_staggered_rows_has_the_columns_modes(rows: int) -> None:
    design = replace(DESIGN, pitch_x_m=6e-3, rows=rows, stagger=True)
    column = Column(design, reductions(design=design), 7.5 * np.pi / design.length_m, panels=2)
    target_hz, target = column.solve(*WINDOW)
    condensed_hz, condensed = Chain(column, *WINDOW).solve(*WINDOW)
    assert len(target_hz) and condensed_hz == pytest.approx(target_hz, rel=5e-3)
    levels = [measure_profile(column.profile(vectors), design).confinement_db for vectors in (target, condensed)]
    assert levels[1] == pytest.approx(levels[0], abs=0.1)


@pytest.mark.slow
@pytest.mark.parametrize("extension_mm", [0.0, 0.5, 1.0])
def test_a_row_at_the_plates_edge_is_condensed_too(extension_mm: float) -> None:
    """The last cell is cut by the edge, and no polynomial follows its outer side: as the dense solve has it."""
    design = replace(DESIGN, rows=1, extension_m=1e-3 * extension_mm)
    column = Column(design, reductions(), 7.5 * np.pi / design.length_m)
    target_hz, target = column.solve(*WINDOW)
    condensed_hz, condensed = Chain(column, *WINDOW).solve(*WINDOW)
    assert len(target_hz) and condensed_hz == pytest.approx(target_hz, rel=5e-3)
    levels = [measure_profile(column.profile(vectors), design).confinement_db for vectors in (target, condensed)]
    assert levels[1] == pytest.approx(levels[0], abs=0.1)
