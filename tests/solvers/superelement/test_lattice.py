"""Bloch waves of one reduced cell: the folded pencil, the waves' phases and energy, group velocity, what truncation tells."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from scipy.optimize import minimize_scalar

from geometry.hex.boxes import hex_mesh, panel_boxes
from geometry.hex.scenes import HexSettings
from geometry.lattice import Lattice
from geometry.layout import Pillar
from geometry.materials import MATERIALS, Stack
from geometry.tiling import Panel
from solvers.accuracy.reduction import (
    _brought,
    cutoff_hz,
    further_degrees,
    reduction_error,
    truncation,
    truncation_bars,
)
from solvers.analytic.plates import lamb_hz
from solvers.errors import SolverError
from solvers.fem.assembly import assemble
from solvers.plates.assembled import Reductions
from solvers.superelement.interface import Interface, ReductionSettings, Ties
from solvers.superelement.lattice import ReducedLattice, Waves
from solvers.waves.bloch import BlochCell
from solvers.waves.branches import one_sided

ALUMINIUM = MATERIALS["aluminium"]
PILLAR = Pillar("square", 2e-3, 2e-3, 6.3e-3, ALUMINIUM)
THICK_M, BARE = 2e-3, (3e-3, 4e-3)
STACK = Stack.of(THICK_M, MATERIALS["aluminium"])
COARSE = HexSettings(order=3, size_m=4e-3, layers=0, pillar_size_m=6.3e-3)
AMPLE = HexSettings(order=4, size_m=1e-3, layers=0, pillar_size_m=6.3e-3)
# long sides of fewer elements have kinks; one of order 3 through the plate has no degree that the functions lack
SMOOTHER = HexSettings(order=3, size_m=2e-3, layers=0, pillar_size_m=6.3e-3)
GENERIC = np.array([310.0, 520.0])


def panel(pitch: tuple[float, float], pillar: bool, halved: tuple[int, ...] = (0, 1)) -> Panel:
    """One cell about the origin."""
    low, high = (-pitch[0] / 2.0, -pitch[1] / 2.0), (pitch[0] / 2.0, pitch[1] / 2.0)
    return Panel(low, high, (0.0, 0.0) if pillar else None, halved)


@cache
def lattice(
    pitch: tuple[float, float] = (4e-3, 4e-3), pillar: bool = True, top_hz: float = 1.2e6, face: Interface | None = None,
    settings: HexSettings = COARSE,
) -> ReducedLattice:  # fmt: skip
    reduction = ReductionSettings(face or Interface(4, 3), top_hz, settings)
    return ReducedLattice(Reductions(Stack.of(THICK_M, ALUMINIUM), PILLAR, reduction).cell(panel(pitch, pillar)))


@cache
def full(pitch: tuple[float, float], pillar: bool, settings: HexSettings = COARSE) -> BlochCell:
    """The same mesh, whole and not reduced."""
    boxes = panel_boxes(panel(pitch, pillar), STACK, PILLAR, settings)

    def whole(lines: np.ndarray) -> np.ndarray:
        return np.concatenate([-lines[:0:-1], lines])

    region = np.concatenate([boxes.region[::-1], boxes.region])
    region = np.concatenate([region[:, ::-1], region], axis=1)
    mesh = hex_mesh(replace(boxes, x=whole(boxes.x), y=whole(boxes.y), region=region), settings.order)
    return BlochCell(assemble(mesh, {"plate": ALUMINIUM, "pillar": ALUMINIUM}), Lattice.of_rows(*pitch))


def corners(pitch: tuple[float, float]) -> np.ndarray:
    """G, X, M and Y."""
    return np.array([(0, 0), (1, 0), (1, 1), (0, 1)]) * np.pi / np.array(pitch)


def transformed(one: ReducedLattice, wavevector: np.ndarray) -> np.ndarray:
    """What the cell's degrees of freedom are of the lattice's free ones."""
    ties = Ties(one.cell.interface, [len(one.cell.fixed_hz)])
    return ties.closed(wavevector * np.array(one.cell.size_m[:2]))


def test_the_folded_pencil_is_that_of_the_transformed_cell() -> None:
    one = lattice()
    transform = transformed(one, GENERIC)
    for result, matrix in zip(one.pencil(GENERIC), (one.cell.stiffness, one.cell.mass), strict=True):
        truth = transform.conj().T @ matrix @ transform
        assert np.abs(result - truth).max() < 1e-13 * np.abs(truth).max()
        assert np.abs(result - result.conj().T).max() < 1e-13 * np.abs(truth).max()


def orthonormal(one: ReducedLattice, u: np.ndarray) -> bool:
    """Energy one each, and none together but what the modes left out make of it, the order of their rise."""
    energy = u.conj().T @ one.cell.mass @ u
    return bool(np.allclose(np.diag(energy), 1.0, atol=1e-10) and np.allclose(energy, np.eye(len(energy)), atol=1e-2))


def test_waves_carry_the_phase_of_each_side_and_their_own_energy() -> None:
    one = lattice()
    waves, face = one.waves(GENERIC, 8), one.cell.interface
    assert np.allclose(waves.frequency_hz, one.frequencies(GENERIC, 8), rtol=1e-10)
    u = waves.dofs
    assert orthonormal(one, u)
    flexible = one.cell.on_boundary(one.cell.dropped)
    stiff, lost = (np.einsum("in,in->n", u.conj(), matrix @ u).real for matrix in (one.cell.stiffness, flexible))
    softer = stiff - one.cell.residual.softening(waves.eigenvalue) * lost
    assert np.abs(stiff / waves.eigenvalue - 1.0).max() > 1e-3  # what is left out does count
    assert np.allclose(softer, waves.eigenvalue, rtol=1e-4)  # to the second order of a rise below 1 %
    turn = np.exp(1j * GENERIC * 4e-3)
    for axis, (near, far) in enumerate(((0, 1), (2, 3))):
        assert np.allclose(u[face.side(far)], turn[axis] * u[face.side(near)])
    assert np.allclose(u[face.vertex(3)], turn[0] * turn[1] * u[face.vertex(0)])


@pytest.mark.parametrize("side", [1, pytest.param(3, marks=pytest.mark.slow)])
def test_a_wrong_phase_on_one_side_is_seen(side: int) -> None:
    """What the comparison with the full cell would say of a fault: bands off by far more than the reduction's error."""
    pitch = (3e-3, 4e-3)
    truth = full(pitch, True).frequencies(GENERIC, 6)
    broken = ReducedLattice(lattice(pitch).cell)
    broken.offset[broken.cell.interface.side(side)] = 0.0
    assert np.abs(lattice(pitch).frequencies(GENERIC, 6) / truth - 1.0).max() < 2e-3
    assert np.abs(broken.frequencies(GENERIC, 6) / truth - 1.0).max() > 2e-2


@pytest.mark.parametrize("pitch", [(4e-3, 4e-3), (3e-3, 4e-3)])
def test_half_a_turn_makes_the_waves_real_and_changes_none(pitch: tuple[float, float]) -> None:
    one, hermitian = lattice(pitch), ReducedLattice(lattice(pitch).cell)
    assert one.c2_symmetry is not None
    hermitian.__dict__["half_turn"] = None
    for wavevector in (np.zeros(2), GENERIC, np.array([np.pi / pitch[0], 200.0])):
        real, truth = one.waves(wavevector, 8), hermitian.waves(wavevector, 8)
        moving = truth.frequency_hz > 1.0
        assert np.allclose(real.frequency_hz[moving], truth.frequency_hz[moving], rtol=1e-10)
        u, stiffness, mass = real.dofs, one.cell.stiffness, one.cell.mass
        assert orthonormal(one, u)
        transform = transformed(one, wavevector)
        values, free = one._solve(wavevector, 8)
        defect = transform.conj().T @ (stiffness @ (transform @ free) - (mass @ (transform @ free)) * values)
        assert np.abs(defect).max() < 1e-10 * np.abs(stiffness).max() * np.abs(free).max()


def test_a_cell_of_unknown_or_broken_symmetry_keeps_its_hermitian_pencil() -> None:
    """Reduced without mirrors nothing tells the modes' parity; with the wrong parities the turned pencil is not real."""
    cell = lattice().cell
    assert ReducedLattice(replace(cell, fixed_parity=np.zeros_like(cell.fixed_parity))).c2_symmetry is None
    swapped = cell.fixed_parity.copy()
    swapped[0, 0] *= -1
    assert ReducedLattice(replace(cell, fixed_parity=swapped)).c2_symmetry is None


def test_group_velocity_is_the_derivative_of_the_frequency() -> None:
    one, step = lattice((3e-3, 4e-3)), 1e-2
    velocity = one.group_velocity(one.waves(GENERIC, 8))
    for axis in (0, 1):
        shift = step * np.eye(2)[axis]
        change = one.frequencies(GENERIC + shift, 8) - one.frequencies(GENERIC - shift, 8)
        truth = 2.0 * np.pi * change / (2.0 * step)
        assert np.allclose(velocity[:4, axis], truth[:4], atol=1e-2, rtol=1e-4)
        assert np.allclose(
            velocity[4:, axis], truth[4:], atol=3e-3 * abs(truth).max()
        )  # raised by up to 0.7 %, by the waves above


def test_degenerate_waves_have_the_slopes_of_the_bands_that_leave_the_point() -> None:
    """Where the pillar's torsion crosses the flexural wave on the way to X; slopes of sorted bands against differences."""
    one, direction, step = lattice(), np.array([1.0, 0.0]), 1e-2

    def distance(k: float) -> float:
        return float(np.diff(one.waves(k * direction, 4).eigenvalue[2:])[0])

    cross = float(minimize_scalar(distance, bounds=(350.0, 700.0), method="bounded", options={"xatol": 1e-9}).x)
    here = one.waves(cross * direction, 4)
    assert distance(cross) < 1e-7 * here.eigenvalue[2]  # they do cross
    beyond = (one.waves((cross + step) * direction, 4).eigenvalue - here.eigenvalue) / step
    before = (here.eigenvalue - one.waves((cross - step) * direction, 4).eigenvalue) / step
    assert abs(beyond[3] - beyond[2]) > 0.1 * abs(beyond).max()
    for result, truth in zip(one_sided(one, here, direction), (beyond, before), strict=True):
        assert np.allclose(result, truth, rtol=1e-3, atol=1e-3 * abs(beyond).max())


def test_at_a_corner_no_wave_of_a_mirror_symmetric_cell_goes_anywhere() -> None:
    """w(k) = w(-k) and M = -M up to a reciprocal vector: sorted bands are flat there, the two bending pairs included."""
    one, corner = lattice(), np.full(2, np.pi / 4e-3)
    waves = one.waves(corner, 6)
    assert np.allclose(waves.eigenvalue[[0, 4]], waves.eigenvalue[[1, 5]], rtol=1e-8)
    scale = np.abs(one.slopes(one.waves(GENERIC, 6))).max()
    for slopes in one_sided(one, waves, np.array([0.6, -0.8])):
        assert np.abs(slopes).max() < 1e-6 * scale


def test_still_waves_have_no_group_velocity() -> None:
    velocity = lattice().group_velocity(lattice().waves(np.zeros(2), 5))
    assert np.isnan(velocity[:3]).all() and np.isfinite(velocity[3:]).all()


def test_group_velocity_of_the_bare_plate_is_that_of_the_exact_waves() -> None:
    """d(2 pi f)/dk of Rayleigh-Lamb and SH0, all along k; the frequencies themselves agree to 1e-4 here."""
    bare = lattice(BARE, False, 3e6, Interface(6, 3), HexSettings(order=4, size_m=2e-3, layers=0))
    k = 350.0
    direction = np.array([0.8, 0.6])

    def slope(symmetric: bool) -> float:
        return (
            2.0
            * np.pi
            * float(np.diff([lamb_hz(q, THICK_M, ALUMINIUM, symmetric) for q in (k - 0.1, k + 0.1)])[0])
            / 0.2
        )

    exact = np.array([slope(False), ALUMINIUM.shear_m_s, slope(True)])
    velocity = bare.group_velocity(bare.waves(k * direction, 3))
    assert np.allclose(velocity, exact[:, None] * direction, rtol=1e-3, atol=1e-3 * exact[0])


@pytest.mark.parametrize("face", [Interface(3, 3), Interface(2, 3), Interface(4, 2)])
def test_a_part_of_the_cell_lies_above_it_by_what_the_functions_left_out_tell(face: Interface) -> None:
    """Galerkin's subspace, solved again, against what the degrees brought."""
    one = lattice()
    waves, own = one.waves(GENERIC, 8), one.cell.interface
    risen = one.up_to(face, 1.2e6).frequencies(GENERIC, 8) / waves.frequency_hz - 1.0
    assert (risen > -1e-6).all() and risen.max() > 1e-4
    along, across = (_brought(one, waves, degree) for degree in (own.along_side, own.across))
    estimate = along[face.along + 1 :].sum(axis=0) + across[face.through + 1 :].sum(axis=0)
    assert (np.abs(estimate - risen) <= 0.3 * risen + 2.0 * risen.max() ** 2 + 1e-6).all()


@pytest.mark.slow
@pytest.mark.parametrize("top_hz", [0.5e6, 0.7e6, 0.9e6, 1.2e6])
@pytest.mark.parametrize("pitch", [(4e-3, 4e-3), (3e-3, 4e-3)])
def test_the_modes_left_out_are_told_by_their_residual_flexibility(pitch: tuple[float, float], top_hz: float) -> None:
    """The same cell with modes up to 3 MHz lies within both bars, and the pencil alone further off."""
    one, ample = lattice(pitch, True, top_hz), lattice(pitch, True, 3e6)
    for k in (*corners(pitch), GENERIC):
        waves, finer = one.waves(k, 8), ample.waves(k, 8)
        moving = finer.frequency_hz > 1e-4 * finer.frequency_hz[-1]
        error = np.abs(waves.frequency_hz[moving] / finer.frequency_hz[moving] - 1.0)
        assert (error <= (waves.by_modes + finer.by_modes)[moving] + 1e-9).all()
        alone = one.cell.scale.frequency(one._solve(k, 8)[0])[moving] / finer.frequency_hz[moving] - 1.0
        assert alone.max() > 2.0 * error.max()


@pytest.mark.parametrize("target", [2e-2, 5e-3, 1e-3])
def test_the_cutoff_that_is_enough_is_found_without_solving_again(target: float) -> None:
    """What the ample lattice foresees for a lower cut-off is what the lattice cut there tells."""
    one = lattice(face=Interface(5, 3))
    top_hz = cutoff_hz(one, corners((4e-3, 4e-3)), 8, target)
    assert top_hz < 1.2e6
    for share, meets in ((1.0, True), (0.75, False)):
        estimate = reduction_error(one.up_to(one.cell.interface, share * top_hz), corners((4e-3, 4e-3)), 8).modes
        assert (estimate <= 1.3 * target) == meets
    assert cutoff_hz(one, corners((4e-3, 4e-3)), 6, 0.0) == one.cell.dropped_hz


def test_the_bar_of_a_wave_knows_what_others_of_its_band_show() -> None:
    rises = np.array([[1e-3, 1e-6, 1e-5], [1e-6, 1e-6, 5e-3]])
    bars = truncation_bars(rises)
    assert (bars >= rises).all() and bars[1, 0] > 1e-4 and bars[0, 1] > 1e-4
    assert bars.max() == pytest.approx(5e-3) and bars[0, 0] < 2e-3


@pytest.mark.slow
@pytest.mark.parametrize("degree", [4, 5, 6])
@pytest.mark.parametrize("pitch", [(4e-3, 4e-3), (3e-3, 4e-3), (7e-3, 7e-3)])
def test_the_fall_of_the_degrees_tells_what_further_ones_bring(pitch: tuple[float, float], degree: int) -> None:
    """Against the same cell of degree 8, for which the last degree alone tells many times too much."""
    ample, count = lattice(pitch, top_hz=0.6e6, face=Interface(8, 3), settings=AMPLE), 8
    one, truth = ample.up_to(Interface(degree, 3), 0.6e6), 0.0
    waves = [one.waves(k, count) for k in corners(pitch)]
    for k, each in zip(corners(pitch), waves, strict=True):
        exact = ample.frequencies(k, count)
        moving = exact > 1e-4 * exact[-1]
        truth = max(truth, float(np.abs(each.frequency_hz[moving] / exact[moving] - 1.0).max()))
    parts = [truncation(one, each)[1] for each in waves]
    last, share = max(float(each[-1].max()) for each in parts), further_degrees(parts)
    assert truth <= share * last
    assert share == 1.0 if degree == 4 else share * last < 10.0 * truth


def test_degrees_are_told_by_what_a_lattice_of_one_less_lacks_on_coarse_elements_too() -> None:
    """Elements twice as long as the plate is thick, a tiny foot: high degrees are almost sums of lower ones, which move on
    without them. With all else held, degree 8 would bring 911 %.
    """
    tiny = Pillar("square", 0.25e-3, 0.25e-3, 0.6e-3, ALUMINIUM)
    settings = HexSettings(order=3, size_m=4e-3, layers=0, pillar_size_m=0.6e-3)
    reduction = ReductionSettings(Interface(9, 3), 0.8e6, settings)
    ample = ReducedLattice(Reductions(Stack.of(THICK_M, ALUMINIUM), tiny, reduction).cell(panel((8e-3, 8e-3), True)))
    ends = corners((8e-3, 8e-3))[:3]

    def largest(degree: int, of: ReducedLattice) -> float:
        less, rises = of.up_to(Interface(degree, 3), 0.8e6), []
        for k in ends:
            own = of.frequencies(k, 10)
            moving = own > 1e-4 * own[-1]
            rises.append(np.abs(less.frequencies(k, 10)[moving] / own[moving] - 1.0).max())
        return float(max(rises))

    for degree in (6, 7, 8):
        one = ample.up_to(Interface(degree, 3), 0.8e6)
        told = reduction_error(one, ends, 10).degrees
        assert told <= 1.2 * largest(degree - 1, one)


@pytest.mark.parametrize("pitch", [(4e-3, 4e-3), (3e-3, 4e-3)])
@pytest.mark.parametrize("top_hz", [0.9e6, 1e3])
def test_a_cell_reduced_for_more_holds_what_less_would_give(pitch: tuple[float, float], top_hz: float) -> None:
    """Matrices, modes and what they leave out, with fixed-interface modes and without any, beside a reduction of its own."""
    ample, less = lattice(pitch, face=Interface(5, 3)), lattice(pitch, top_hz=top_hz)
    trimmed = ample.up_to(less.cell.interface, top_hz)
    assert np.allclose(trimmed.cell.fixed_hz, less.cell.fixed_hz, rtol=1e-8)
    assert len(trimmed.cell.fixed_hz) < len(ample.cell.fixed_hz)
    alike = ReducedLattice(
        replace(trimmed.cell, dropped_hz=less.cell.dropped_hz)
    )  # the ample cell knows the next mode itself
    assert np.allclose(alike.frequencies(GENERIC, 8), less.frequencies(GENERIC, 8), rtol=1e-8)
    assert np.allclose(trimmed.cell.dropped, less.cell.dropped, atol=1e-7 * np.abs(less.cell.dropped).max())
    assert trimmed.cell.dropped_hz >= less.cell.dropped_hz * (1.0 - 1e-8)
    assert np.isclose(
        reduction_error(alike, corners(pitch), 6).total, reduction_error(less, corners(pitch), 6).total, rtol=1e-4
    )


@pytest.mark.slow
@pytest.mark.parametrize("count", [6, 10])
@pytest.mark.parametrize("top_hz", [1.17e6, 1.5e6])
@pytest.mark.parametrize(
    "pitch",
    [
        (4e-3, 4e-3),
        (3e-3, 4e-3),
        (8e-3, 8e-3),
    ],
)
def test_the_estimate_bounds_the_reductions_error(pitch: tuple[float, float], top_hz: float, count: int) -> None:
    """Against the same mesh, not reduced; and it is no more than some times the truth, or it would be of no use."""
    is_long = pitch[0] > 5e-3
    mesh, face = SMOOTHER if is_long else COARSE, Interface(6 if is_long else 4, 3)
    one = lattice(pitch, True, top_hz * 4e-3 / max(pitch), face, mesh)
    truth = 0.0
    for k in corners(pitch):
        ours, exact = one.frequencies(k, count), full(pitch, True, mesh).frequencies(k, count)
        moving = exact > 1e-4 * exact[-1]
        truth = max(truth, float(np.abs(ours[moving] / exact[moving] - 1.0).max()))
    result = reduction_error(one, corners(pitch), count)
    assert truth <= result.total <= 20.0 * truth
    assert result.total == result.modes + result.degrees


def test_more_boundary_functions_than_the_mesh_can_hold_are_refused_in_words() -> None:
    one = lattice()
    dead = one.cell.mass.copy()
    dead[0] = dead[:, 0] = 0.0
    with pytest.raises(SolverError, match="degree 4 along and 3 through the thickness"):
        ReducedLattice(replace(one.cell, mass=dead - 1e-3 * np.eye(len(dead)))).frequencies(GENERIC, 4)


def test_a_wavevector_costs_one_solve_and_asks_for_no_more_than_there_is() -> None:
    one = lattice()
    result = one.waves(GENERIC, 10_000)
    assert isinstance(result, Waves) and len(result.frequency_hz) == one.dof


@pytest.mark.slow
def test_slender_stiff_pillars_on_a_soft_plate_are_no_fault_of_the_cell() -> None:
    """Rounding leaves their motion right to some 1e-8, and no more of the mass is missing."""
    mesh = HexSettings(order=3, size_m=1e-3, layers=1, pillar_size_m=2.25e-3)
    pillar = Pillar("square", 1e-3, 1e-3, 9e-3, MATERIALS["steel"])
    reductions = Reductions(Stack.of(1e-3, MATERIALS["pmma"]), pillar, ReductionSettings(Interface(4, 3), 3e5, mesh))
    cell = reductions.cell(panel((3e-3, 3e-3), pillar=True))
    at_rest, *others = ReducedLattice(cell).frequencies(np.zeros(2), 4)[2:]
    assert at_rest < 1e-3 * others[0]
