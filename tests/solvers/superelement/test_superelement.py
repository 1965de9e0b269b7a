"""The reduced cell: boundary functions, mirrors, mass, and fixed-interface modes that only help."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.linalg import eigh

from geometry.hex.scenes import HexSettings
from geometry.layout import Design, Pillar
from geometry.materials import MATERIALS, Stack
from geometry.tiling import Panel, lattice_panel, signature, tile
from solvers.errors import SolverError
from solvers.plates.assembled import PlateModel, Reductions
from solvers.superelement.cell import Cell, check_rigid, rigid_boundary
from solvers.superelement.interface import Interface, ReductionSettings, bubble_functions
from solvers.superelement.plate import AssembledPlate

ALUMINIUM = MATERIALS["aluminium"]
PILLAR = Pillar("square", 2e-3, 2e-3, 6.3e-3, ALUMINIUM)
DESIGN = Design(24e-3, 16e-3, 2e-3, 2, ALUMINIUM, PILLAR, 4e-3, 5e-3, 2, 3e-3)
SETTINGS = HexSettings(order=3, size_m=4e-3, layers=0, pillar_size_m=6.3e-3)
FACE = Interface(4, 3)


def cell(halved: tuple[int, ...] = (0, 1), top_hz: float = 400e3, face: Interface = FACE) -> Cell:
    """One unit cell with its pillar."""
    reductions = Reductions(Stack.of(2e-3, ALUMINIUM), PILLAR, ReductionSettings(face, top_hz, SETTINGS))
    return reductions.cell(replace(lattice_panel(DESIGN), halved=halved))


def free_hz(of: Cell) -> np.ndarray:
    """Frequencies of the free cell."""
    return of.scale.frequency(eigh(of.stiffness, of.mass, eigvals_only=True))


def test_bubbles_vanish_at_both_ends_and_are_even_or_odd() -> None:
    at = np.linspace(-1.0, 1.0, 9)
    values = bubble_functions(at, 5)
    assert values.shape == (9, 4)
    assert np.abs(values[[0, -1]]).max() < 1e-14
    assert np.allclose(values[::-1], values * (-1.0) ** np.arange(2, 6), atol=1e-14)


@pytest.mark.parametrize("axis", [0, 1])
def test_the_mirror_of_the_degrees_of_freedom_is_the_mirror_of_the_field(axis: int) -> None:
    points = np.random.default_rng(0).uniform(-1.0, 1.0, (30, 3))
    points[:10, 0], points[10:20, 0], points[20:25, 1], points[25:, 1] = 1.0, -1.0, 1.0, -1.0
    dofs = np.random.default_rng(1).normal(size=FACE.count)
    where, sign = FACE.mirror(axis)

    def field(u: np.ndarray, at: np.ndarray) -> np.ndarray:
        return FACE.evaluate(at) @ u.reshape(-1, 3)

    flip = np.ones(3)
    flip[axis] = -1.0
    assert np.allclose(field(sign * dofs[where], points), flip * field(dofs, points * flip), atol=1e-12)


def test_the_mirror_classes_span_every_degree_of_freedom_once() -> None:
    bases = [FACE.parity_basis({0: a, 1: b}) for a in (1, -1) for b in (1, -1)]
    whole = np.hstack(bases)
    assert whole.shape == (FACE.count, FACE.count)
    assert np.abs(whole.T @ whole - np.eye(FACE.count)).max() < 1e-12


def test_the_cell_carries_its_mass_and_that_of_its_pillar() -> None:
    reduced = cell()
    motions = rigid_boundary(reduced)[:, :3]
    pillar_m3, plate_m3 = 4e-6 * 6.3e-3, 4e-3 * 5e-3 * 2e-3
    for matrix, volume in ((reduced.mass, plate_m3 + pillar_m3), (reduced.pillar_mass, pillar_m3)):
        rigid_mass = motions.T @ matrix @ motions
        assert np.allclose(rigid_mass, np.eye(3) * volume / 2e-3**3, atol=1e-9 * volume / 2e-3**3)


def test_rigid_motions_meet_no_force_and_there_are_six() -> None:
    result = free_hz(cell())
    assert (result[:6] < 1e-4 * result[6]).all()


def test_frequencies_fall_as_degrees_of_freedom_are_added_and_converge() -> None:
    coarse, middle, fine = (
        free_hz(cell(top_hz=top, face=Interface(along, 3)))[6:12] for along, top in ((2, 3e5), (4, 3e5), (4, 2e6))
    )
    assert (middle <= coarse * (1.0 + 1e-9)).all() and (fine <= middle * (1.0 + 1e-9)).all()
    assert (coarse > middle * 1.0001).any()


@pytest.mark.parametrize("order", [pytest.param(2, marks=pytest.mark.slow), 3])
def test_a_narrow_piece_is_meshed_so_that_its_sides_hold_their_functions(order: int) -> None:
    size = {2: 1.8e-3, 3: 4e-3}[order]  # one element over the narrow side would make functions of degree 6 one
    reduction = ReductionSettings(Interface(6, 3), 1e5, HexSettings(order, size, 0))
    narrow = Panel((0.0, 0.0), (1.8e-3, 6e-3))
    mass = Reductions(Stack.of(2e-3, ALUMINIUM), None, reduction).cell(narrow).mass
    values = np.linalg.eigvalsh(mass)
    assert values[0] > 1e-9 * values[-1]


def test_a_cell_that_lost_mass_or_holds_rigid_motions_is_refused() -> None:
    reduced = cell()
    whole = float(np.diag(rigid_boundary(reduced)[:, :3].T @ reduced.mass @ rigid_boundary(reduced)[:, :3])[0])
    check_rigid(reduced, whole)
    with pytest.raises(SolverError, match="of its mass"):
        check_rigid(replace(reduced, mass=reduced.mass * 0.99), whole)
    with pytest.raises(SolverError, match="a rigid-body mode of the reduced cell meets a force"):
        check_rigid(replace(reduced, stiffness=reduced.stiffness + 1e-3 * np.eye(reduced.dof)), whole)


def test_tiling_gives_each_pillar_its_own_piece_and_covers_the_plate_symmetrically() -> None:
    tiling = tile(DESIGN, 4e-3)
    assert np.allclose(tiling.x, -tiling.x[::-1]) and np.allclose(tiling.y, -tiling.y[::-1])
    assert (tiling.x[-1], tiling.y[-1]) == pytest.approx((12e-3, DESIGN.half_span_m))
    assert (np.diff(tiling.x) > 0.0).all() and (np.diff(tiling.y) > 0.0).all()
    assert len(tiling.feet) == len(DESIGN.pillar_centres())
    result = np.array(sorted(tiling.feet.values()))
    assert np.allclose(result, np.array(sorted(map(tuple, DESIGN.pillar_centres()))))
    for (i, j), (cx, cy) in tiling.feet.items():
        assert tiling.x[i] <= cx - 1e-3 + 1e-12 and cx + 1e-3 <= tiling.x[i + 1] + 1e-12
        assert tiling.y[j] <= cy - 1e-3 + 1e-12 and cy + 1e-3 <= tiling.y[j + 1] + 1e-12


def test_equal_pieces_are_reduced_once() -> None:
    tiling = tile(DESIGN, 4e-3)
    kinds = {signature(tiling.panel(i, j)) for i in range(len(tiling.x) - 1) for j in range(len(tiling.y) - 1)}
    assert len(kinds) < (len(tiling.x) - 1) * (len(tiling.y) - 1) / 2


def test_cells_that_do_not_fit_together_are_refused() -> None:
    cut = tile(DESIGN, 6e-3)
    made = Reductions(Stack.of(2e-3, ALUMINIUM), PILLAR, ReductionSettings(FACE, 200e3, SETTINGS, 6e-3))
    cells = PlateModel(DESIGN, made).cells
    key = next(iter(cells))
    other = replace(cells[key], interface=Interface(3, 3))
    with pytest.raises(SolverError, match="do not fit together"):
        AssembledPlate(cut, {**cells, key: other}, "SS")
    with pytest.raises(SolverError, match="does not fill its panel"):
        AssembledPlate(cut, {**cells, key: replace(cells[key], size_m=(1e-3, 1e-3, 2e-3))}, "SS")


def test_a_mesh_too_coarse_for_the_boundary_functions_is_refused() -> None:
    coarse = HexSettings(order=1, size_m=4e-3, layers=0, pillar_size_m=6.3e-3)
    made = Reductions(Stack.of(2e-3, ALUMINIUM), PILLAR, ReductionSettings(Interface(4, 3), 200e3, coarse))
    with pytest.raises(SolverError, match="through the thickness"):
        made.cell(lattice_panel(DESIGN))


def test_panels_as_long_as_wide_are_square_to_the_last_digit() -> None:
    """A rounded edge hides the mirror x <-> y of a small panel, and with it half of the work."""
    base = DESIGN.pillar
    assert base
    side = 6.70396232277384e-4
    pitch = 1.7153805616369382e-3
    small = replace(DESIGN, pillar=replace(base, base_m=side, tip_m=side), pitch_x_m=pitch, pitch_y_m=pitch)
    small = replace(small, thickness_m=6.6e-4, rows=1, width_m=5.597930496e-3, length_m=3.4735e-2, extension_m=1.32e-3)
    tiling = tile(small, 2e-3)
    panels = [tiling.panel(i, j) for i, j in tiling.representatives(False) if (i, j) in tiling.feet]
    assert panels
    for panel in panels:
        wide, long = (high - low for low, high in zip(panel.low, panel.high, strict=True))
        assert abs(wide / long - 1.0) < 1e-11
