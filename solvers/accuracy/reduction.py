"""Truncation and discretisation errors of reduced cells, of their bands and of plates assembled from them.

A coarser mesh lacks the innermost layer of elements at the foot's rim, where displacements go as r^a and the energy's error
therefore as h^(2a): the finer mesh still errs by a share r of the difference that follows from a, the order and the layers
(babuska1981). K = K_fine - r (K_coarse - K_fine), M likewise, over the same boundary functions; the fixed-interface modes of
the coarser mesh are turned onto those of the finer one, Q = U V' from (M_fine P Phi_coarse)' Phi_fine = U S V'
(schoenemann1966). A mesh of one order less shows the rest, away from the rim.

Tetrahedra have no coarser nested mesh: the energy lost by `StressRecovery` estimates the error of K_r.

Discarded fixed-interface modes take l^2 D from the boundary's dynamic stiffness, D their residual flexibility, which each
cell knows (`Cell.dropped`): an eigenvalue l falls by l^2 u'D u, to first order. Without a part d of the eigenvector u, its
last degree along the sides, Rayleigh's quotient rises by d'(K - l M)d / (u - d)'M(u - d): what that degree brought bounds the
next ones. Further degrees through the thickness e, which a thick plate's cells know (`Cell.further`), lower it by
r'(K_ee - l M_ee)^-1 r, r = (K_e - l M_e)u, to second order in what they couple.

The meshes coupled at their boundary functions have the boundary's dynamic stiffness S and the interiors' own eigenvalues,
N = N(S) + sum N(interior), both below lambda (wittrick1971). Every interior mode up to Lambda is kept, so the reduced pencil
counts the interiors' whole; what discarded modes take from S is bounded (`Cell.dropped`) and only lowers it. Hence
N_reduced <= N <= N of the pencil with that bound taken from its stiffness.

The discarded fixed-interface modes act through their residual flexibility, with bounds (`Waves.by_modes`). Without the
boundary functions D a wave u of the eigenvalue l rises by at most u_D^H S u_D, S the Schur complement of K + s M on D: the
other functions come to rest, s M holds rigid motion. By Cholesky's factor L of the functions in the order of their degree it
parts into |L^H u|^2, degree by degree. The degree's error falls exponentially: the change by the last degree along the sides
bounds that by the next ones. The ratio of every second degree's changes, since a wave may need even or odd ones alone,
estimates how far they stay below it.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, Protocol, TypeAlias

import numpy as np
import scipy.sparse as sp

from geometry.elements import BoolArray, ComplexArray, FloatArray, IntArray
from solvers.accuracy.mesh import (
    ErrorFractions,
    Nested,
    StressRecovery,
    prolonged_eigenvalues,
    shares_of,
    smooth_half_width,
)
from solvers.fem.assembly import on_components
from solvers.fem.eigen import PlainPencil, count_below
from solvers.fem.factor import Factoriser, parallel_map
from solvers.superelement.cell import MAX_SHARE, Cell, MeshError, ResidualModes, largest, metrics
from solvers.superelement.clamped import missed
from solvers.superelement.plate import AssembledPlate
from solvers.superelement.reduction import CellBuilder, SymmetryClass
from solvers.superelement.sparing import energy, rise, rise_without
from solvers.threads import one_thread

if TYPE_CHECKING:
    from solvers.superelement.lattice import BlochPlate, Periodic, ReducedLattice, Waves

WIDER = 1.15  # factor on the limit for modes of the coarser mesh, which lie above their partners
NestedBuilder = Nested[CellBuilder]
ALIKE = 0.5  # singular value of the modal overlap from which a direction has its partner on the coarser mesh

# of the half-width at rims, and of the last order's change away from them: a plate's modes move its cells more alike than
# ten bands of a lattice do, and bend its bare panels in shorter waves. Of ten plates of seed 7 of `python -m
# studies.error_bars` 99 of 100 modes lie within
AT_RIMS, AWAY = 0.5, 0.06

MARGIN = 2.0  # single modes may exceed the truncation estimate slightly, the worst of a class never did

# part of the rise without the last degree through the thickness that further ones cause in a plate thin for its waves: its free
# edges' boundary layers, sin(pi z / t) at their slowest, leave these up to 0.04
EDGE_LAYER = 0.03

Joined: TypeAlias = "AssembledPlate | BlochPlate"  # their degrees of freedom are those of their cells

# of the largest estimate of a band and those below it, and of all: one wave may hide an error that others show
HIDDEN, BEYOND = 0.3, 0.02

# times the geometric series, of which further degrees brought 0.06 to 2.8 to 12 cells of degrees 5 and 6; and of the last
# degree's part at least, of which they brought 0.48 where the series is shorter; the fewest degrees that show it
SERIES, MIN_SHARE, MIN_DEGREE = 3.0, 0.5, 5

LOWEST, TRIALS = 0.3, 40  # cut-offs tried, from this share of the lattice's own on
# times the eigenvalue that is rounding: what at least holds rigid motion where degrees are compared
TIMES_ROUNDING = 1e3

# of the change by the degree before the last: the next one of its parity brought a quarter to a third of it, and a wave that is
# even or odd along the sides hides one of both
OTHER_PARITY = 0.5

STILL = 1e-4  # of the highest requested frequency: slower waves are rigid-body modes but for rounding


@dataclass(frozen=True)
class ModeErrors:
    """Relative overestimates of frequencies, (k,) each, due to discarded fixed-interface modes, to degrees along the sides and
    to degrees through the thickness.

    Infinite from the lowest mode on that may have been left out: nothing is known there. taken: excess of the finest
    mesh's own frequency over the reported one; mesh: discretisation error bar (half-width), NaN without an estimate.
    """

    modes: FloatArray
    degrees: FloatArray
    through: FloatArray
    taken: FloatArray
    mesh: FloatArray

    @property
    def by_degrees(self) -> FloatArray:
        """Error due to the discarded degrees, in either direction."""
        return self.degrees + self.through

    @property
    def total(self) -> FloatArray:
        """Truncation error, all parts together."""
        return self.modes + self.by_degrees


class Assembly(Protocol):
    """Cells that were joined: each with its `cell` and how many `copies` of it there are, and their motion (cell dof, k)."""

    @property
    def placed_cells(self) -> Sequence[Any]: ...
    def cell_vectors(self, placed_cell: Any, vectors: Any) -> Any: ...


@dataclass(frozen=True)
class ReductionError:
    """Relative errors of frequencies: due to discarded modes, to either side, and to discarded degrees along the sides."""

    modes: float
    degrees: float

    @property
    def total(self) -> float:
        """Sum of both."""
        return self.modes + self.degrees


@dataclass(frozen=True)
class MeshErrors:
    """Relative excess of the finer mesh's own frequency over the reported one, and error bar (half-width), (n,) each.

    The error bar is NaN without an estimate.
    """

    taken: FloatArray
    half_width: FloatArray


def extrapolated(
    cell: Cell,
    fine: tuple[CellBuilder, list[SymmetryClass]],
    lower: NestedBuilder,
    layer: NestedBuilder | None,
    shares: ErrorFractions,
    top_hz: float,
) -> Cell:
    """Correct a reduced cell by fractions of the changes of K_r and M_r on coarser meshes.

    The correction is limited so that K and M stay positive definite; the rest counts as uncertain.

    Parameters
    ----------
    cell : Cell
        Reduced on the finer mesh.
    fine : tuple of CellBuilder and list of SymmetryClass
        The finer mesh.
    lower : NestedBuilder
        The mesh of one order less.
    layer : NestedBuilder or None
        The mesh without its innermost layer; None where nothing is singular.
    shares : ErrorFractions
        Fractions of the changes.
    top_hz : float
        Highest frequency of interest.

    Returns
    -------
    Cell
        With its mesh error.
    """
    builder, parts = fine
    meshes = [lower, layer] if layer else [lower]
    with one_thread():
        changes = parallel_map(lambda mesh: _change(builder, parts, mesh, WIDER * top_hz, cell), meshes)
    none = np.zeros_like(cell.stiffness), np.zeros_like(cell.mass)
    return _corrected(cell, builder, changes[1] if layer else none, changes[0], shares)


def recovered(cell: Cell, builder: CellBuilder, parts: list[SymmetryClass], recovery: StressRecovery) -> Cell:
    """Correct a cell of tetrahedra: subtract most of the energy loss that stress recovery estimates from K_r.

    Parameters
    ----------
    cell : Cell
        Reduced on the mesh of tetrahedra.
    builder : CellBuilder
        The mesh.
    parts : list of SymmetryClass
        Its symmetry classes.
    recovery : StressRecovery
        The estimate.

    Returns
    -------
    Cell
        With its mesh error.
    """
    none, loss = np.zeros_like(cell.mass), np.zeros_like(cell.stiffness)
    with one_thread():
        for part, place in zip(parts, builder.places(parts), strict=True):
            own = builder.projected(part)[0] - recovery.energy(part.shapes)
            loss += builder.copies * place @ own @ place.T
    return _corrected(cell, builder, ((loss + loss.T) / 2.0, none), (none, none), recovery.shares)


def mode_errors(
    plate: Joined, pencil: PlainPencil, vectors: FloatArray | ComplexArray, rims: float = AT_RIMS
) -> ModeErrors:
    """Estimate the errors of M-orthonormal modes of a symmetry class, or of Bloch waves, which are complex.

    Parameters
    ----------
    plate : AssembledPlate or BlochPlate
        The joined cells.
    pencil : PlainPencil
        Its scaled K and M.
    vectors : ndarray, shape (dof, k)
        The modes.
    rims : float, optional
        Factor on the half-width due to the rims' singularities.

    Returns
    -------
    ModeErrors
        Relative errors of the frequencies, (k,) each.
    """
    images = pencil.stiffness @ vectors, pencil.mass @ vectors
    value = energy(vectors, images[0])
    held = isinstance(plate, AssembledPlate) and bool(plate.holds)
    along = by_degrees(pencil, vectors, last_degree(plate), images, held)
    short = by_modes(plate, value, vectors)
    if isinstance(plate, AssembledPlate):
        along = along + rise(plate, value, np.real(vectors))
        short = short + plate.missed_beneath(np.real(vectors), value)
    if all(cell.further for cell in plate.cells):
        through = _by_further(plate, value, vectors)
    else:
        through = EDGE_LAYER * by_degrees(pencil, vectors, _dofs(plate, last_layer), images, held)
    return ModeErrors(short, along, through, *by_mesh(plate, value, vectors, rims))


def by_degrees(
    pencil: PlainPencil,
    vectors: FloatArray | ComplexArray,
    last: BoolArray,
    images: tuple[FloatArray, FloatArray] | None = None,
    held: bool = False,
) -> FloatArray:
    """Compute the relative rise of frequencies without the part d of each mode u that belongs to the last degree.

    By Rayleigh's quotient of u - d, from K and M on d alone. Where discs of the plate are held, u - d would move them: all
    other functions then find their modes without the last degree.

    Parameters
    ----------
    pencil : PlainPencil
        Scaled K and M.
    vectors : ndarray, shape (dof, k)
        M-orthonormal modes u.
    last : ndarray of bool, shape (dof,)
        Degrees of freedom of the last degree.
    images : tuple of ndarray, shape (dof, k), optional
        K u and M u, if known.
    held : bool, optional
        Whether discs are held.

    Returns
    -------
    ndarray, shape (k,)
        Relative, at least 0.
    """
    where = np.flatnonzero(last)
    stiff, heavy = images or (pencil.stiffness @ vectors, pencil.mass @ vectors)
    if held and len(where) and vectors.shape[1]:
        return _without(pencil, np.real(vectors), np.flatnonzero(~last), energy(vectors, stiff))
    return rise_without(pencil, vectors, where, (stiff, heavy), energy(vectors, stiff))


def _without(pencil: PlainPencil, vectors: FloatArray, left: IntArray, values: FloatArray) -> FloatArray:
    """Relative rise of frequencies, (k,), where only some of the degrees of freedom are left."""
    stiffness, mass = (matrix[left][:, left].tocsc() for matrix in (pencil.stiffness, pencil.mass))
    place = sp.csr_array((np.ones(len(left)), (left, np.arange(len(left)))), shape=(pencil.dof, len(left)))
    fewer = prolonged_eigenvalues(pencil, PlainPencil(stiffness, mass, pencil.scale), place, vectors, values)
    return np.asarray(np.sqrt(np.maximum(fewer / values, 1.0)) - 1.0)


def by_mesh(
    plate: Assembly, value: FloatArray, vectors: FloatArray | ComplexArray, rims: float = AT_RIMS
) -> tuple[FloatArray, FloatArray]:
    """Compute the relative correction of modes' frequencies for the mesh, by Rayleigh's quotient, and its uncertainty.

    Parameters
    ----------
    plate : Assembly
        The joined cells.
    value : ndarray, shape (k,)
        Scaled eigenvalues.
    vectors : ndarray, shape (dof, k)
        M-orthonormal modes.
    rims : float, optional
        Factor on the half-width due to the rims' singularities.

    Returns
    -------
    taken : ndarray, shape (k,)
        Relative corrections.
    half_width : ndarray, shape (k,)
        Relative error bars; NaN where a cell has no coarser mesh.
    """
    taken, rim, order, beyond, clamps = (np.zeros_like(value) for _ in range(5))
    for placed_cell in plate.placed_cells:
        error = placed_cell.cell.mesh_error
        if error is None:
            return taken, np.full_like(value, np.nan)
        changes = error.changes(plate.cell_vectors(placed_cell, vectors), value)
        by_layer, by_order = (placed_cell.copies * change for change in changes)
        taken += error.taken * by_layer
        shares = shares_of(error)
        rim += shares.rim * by_layer
        order += by_order - error.edge * by_layer
        if placed_cell.softened is not None:
            at_edge = by_order - error.edge * by_layer
            taken += placed_cell.softened * at_edge
            clamps += (2.0 * missed(error.order) - placed_cell.softened) * np.abs(at_edge)
        if shares.doubt:
            beyond += shares.doubt * error.taken * (by_layer - by_order / error.edge)
    known = [each.cell.mesh_error for each in plate.placed_cells]
    smooth = smooth_half_width(order, AWAY, min((error.order for error in known if error), default=0))
    others: FloatArray | float = 0.0
    if isinstance(plate, AssembledPlate):
        moved = np.real(vectors)
        others = plate.missed_at_discs(moved, value) + plate.missed_of_stress(moved, value)
    return taken, rims * np.abs(rim) + smooth + clamps + others + np.maximum(beyond, 0.0)


def by_modes(plate: Assembly, value: FloatArray, vectors: FloatArray | ComplexArray) -> FloatArray:
    """Compute half of l u' D u over the modes' l, D the residual flexibility of every cell, as large as it may be at l.

    Parameters
    ----------
    plate : Assembly
        The joined cells.
    value : ndarray, shape (k,)
        Scaled eigenvalues l.
    vectors : ndarray, shape (dof, k)
        M-orthonormal modes u.

    Returns
    -------
    ndarray, shape (k,)
        Relative errors of the frequencies.
    """
    total = np.zeros_like(value)
    for placed_cell in plate.placed_cells:
        cell = placed_cell.cell
        own = plate.cell_vectors(placed_cell, vectors)[: len(cell.dropped)]
        total += placed_cell.copies * cell.residual.growth(value) * energy(own, cell.dropped @ own)
    return np.asarray(0.5 * value * total)


def last_degree(plate: Joined, before: int = 0) -> BoolArray:
    """Mask the plate's bubbles of the highest degree.

    Parameters
    ----------
    plate : AssembledPlate or BlochPlate
        The joined cells.
    before : int, optional
        So many degrees lower.

    Returns
    -------
    ndarray of bool, shape (dof,)
        True for these bubbles.
    """
    return _dofs(plate, lambda cell: last_bubbles(cell, before))


def last_bubbles(cell: Cell, before: int = 0) -> IntArray:
    """List the bubbles of the highest degree on a cell's four sides.

    Parameters
    ----------
    cell : Cell
        The reduced cell.
    before : int, optional
        So many degrees lower.

    Returns
    -------
    ndarray of int, shape (n,)
        Degrees of freedom of the cell.
    """
    return np.flatnonzero(cell.interface.along_side == cell.interface.along - before)


def last_layer(cell: Cell) -> IntArray:
    """List the boundary functions of the highest degree through the thickness.

    Parameters
    ----------
    cell : Cell
        The reduced cell.

    Returns
    -------
    ndarray of int, shape (n,)
        Degrees of freedom of the cell.
    """
    face = cell.interface
    return np.flatnonzero(np.isin(face.across, face.highest))


def more_below(
    plate: AssembledPlate,
    pencil: PlainPencil,
    edge_hz: float,
    reduced: int | None = None,
    factorise: Factoriser | None = None,
    degrees: float = 0.0,
) -> int | None:
    """Bound the number of modes below a frequency that the reduced pencil lacks.

    Parameters
    ----------
    plate : AssembledPlate
        The joined cells.
    pencil : PlainPencil
        Its scaled K and M.
    edge_hz : float
        The frequency.
    reduced : int, optional
        The reduced pencil's own count there, rigid-body modes included, if known.
    factorise : Factoriser, optional
        Shares the symbolic analysis of the pencil's earlier solves.
    degrees : float, optional
        Relative amount by which discarded degrees may lower a mode of the meshes below the one that represents it.

    Returns
    -------
    int or None
        Upper bound; None without one.
    """
    beyond_hz = edge_hz * (1.0 + degrees)
    value = pencil.scale.eigenvalue(beyond_hz)
    if not all(np.isfinite(placed_cell.cell.residual.growth(value)) for placed_cell in plate.placed_cells):
        return None

    def lost(cell: Cell) -> FloatArray:
        return cell.on_boundary(value**2 * float(cell.residual.growth(value)) * cell.dropped)

    softer = PlainPencil(plate.stiffness(lost), pencil.mass, pencil.scale, pencil.rigid_count)
    own = count_below(pencil, edge_hz, factorise) if reduced is None else reduced
    return count_below(softer, beyond_hz, factorise) - own


def reduction_error(lattice: ReducedLattice, wavevectors: FloatArray, count: int) -> ReductionError:
    """Estimate the truncation error of the lowest bands at some wavevectors: the worst of them.

    Parameters
    ----------
    lattice : ReducedLattice
        The reduced cell.
    wavevectors : ndarray, shape (n, 2)
        In rad/m.
    count : int
        Number of bands.

    Returns
    -------
    ReductionError
        Relative, by discarded modes and by degrees.
    """
    return error_of_waves(lattice, [lattice.waves(k, count) for k in wavevectors])


def error_of_waves(lattice: ReducedLattice, waves: Sequence[Waves]) -> ReductionError:
    """Estimate the truncation error, as `reduction_error`, of waves that are already solved.

    Parameters
    ----------
    lattice : ReducedLattice
        The reduced cell.
    waves : sequence of Waves
        At the wavevectors.

    Returns
    -------
    ReductionError
        Relative, by discarded modes and by degrees.
    """
    estimates = [truncation(lattice, each) for each in waves]
    modes = max(float(each.max(initial=0.0)) for each, _ in estimates)
    parts = [each for _, each in estimates]
    return ReductionError(modes, further_degrees(parts) * max(float(each[-1].max(initial=0.0)) for each in parts))


def truncation(lattice: ReducedLattice, waves: Waves) -> tuple[FloatArray, FloatArray]:
    """Compute the truncation error of each wave, 0 for rigid-body waves.

    Parameters
    ----------
    lattice : ReducedLattice
        The reduced cell.
    waves : Waves
        n waves at one wavevector.

    Returns
    -------
    modes : ndarray, shape (n,)
        Relative error due to discarded modes.
    degrees : ndarray, shape (degrees, n)
        Relative change by each degree along the sides, from 0 upwards.
    """
    modes = np.where(_moving(waves), waves.by_modes, 0.0)
    return modes, _brought(lattice, waves, lattice.cell.interface.along_side)


def in_order(waves: Waves, rises: FloatArray) -> FloatArray:
    """Compute the rises of sorted bands: waves that rise by more than others change places.

    Parameters
    ----------
    waves : Waves
        n waves at one wavevector.
    rises : ndarray, shape (n,)
        Relative rises of the waves.

    Returns
    -------
    ndarray, shape (n,)
        Relative rises of the bands.
    """
    moving = _moving(waves)
    value = np.where(moving, waves.eigenvalue, 1.0)
    risen = np.sort(np.where(moving, value * (1.0 + 2.0 * rises), 0.0))
    return np.where(moving, np.maximum(risen / value - 1.0, 0.0) / 2.0, 0.0)


def further_degrees(parts: Sequence[FloatArray]) -> float:
    """Estimate the possible change by further degrees along the sides relative to that by the last degree: at most 1.

    Parts R_n of a degree n fall as q^(n/2) with the largest q = R_n / R_(n-2) seen: the next two bring (R_n + R_(n-1)) q.
    A degree below 5 shows no q of even and of odd ones.

    Parameters
    ----------
    parts : sequence of ndarray, shape (degrees, n)
        For each wavevector the changes of its waves by each degree.

    Returns
    -------
    float
        Dimensionless.
    """
    worst = np.max([part.max(axis=1, initial=0.0) for part in parts], axis=0)
    if len(worst) <= MIN_DEGREE or worst[-1] <= 0.0:
        return 1.0
    falls = [own / before for own, before in zip(worst[-2:], worst[-4:-2], strict=True) if before > 0.0]
    return float(min(1.0, max(SERIES * (1.0 + worst[-2] / worst[-1]) * max(falls, default=1.0), MIN_SHARE)))


def cutoff_hz(lattice: ReducedLattice, wavevectors: FloatArray, count: int, target: float) -> float:
    """Find the lowest cut-off of fixed-interface modes that keeps the error bars of the lowest bands within a target.

    A mode's part in a wave shows what it would add to the residual flexibility.

    Parameters
    ----------
    lattice : ReducedLattice
        The reduced cell.
    wavevectors : ndarray, shape (n, 2)
        In rad/m.
    count : int
        Number of bands.
    target : float
        Relative half-width.

    Returns
    -------
    float
        In Hz; the lattice's own cut-off if no lower one suffices.
    """
    cell, own = lattice.cell, lattice.cell.dropped_hz
    first = cell.interface.count
    stiff, heavy = (np.diag(matrix)[first:, None] for matrix in (cell.stiffness, cell.mass))
    trials = own * np.geomspace(LOWEST, 1.0, TRIALS)
    worst = np.zeros(TRIALS)
    for k in wavevectors:
        waves = lattice.waves(k, count)
        value = np.where(_moving(waves), waves.eigenvalue, np.inf)
        flexible = np.abs(waves.dofs[first:]) ** 2 * (stiff / value - heavy) ** 2 / stiff
        left = np.einsum("in,in->n", waves.dofs[:first].conj(), cell.dropped @ waves.dofs[:first]).real
        for index, top in enumerate(trials):
            lost = left + flexible[cell.fixed_hz > top].sum(axis=0)
            modes = ResidualModes(cell.scale.eigenvalue(top))
            eigenvalue = np.where(np.isinf(value), 0.0, value)
            bars = modes.bar(eigenvalue, eigenvalue + modes.softening(eigenvalue) * lost, lost)
            worst[index] = max(worst[index], float(bars.max()))
    enough = np.flatnonzero(worst <= target)
    return float(trials[enough[0]]) if len(enough) else own


def truncation_bars(rises: FloatArray, share: float = 1.0) -> FloatArray:
    """Compute truncation error bars from the estimates of waves.

    A wave may hide an error that others of its band or of one below show; no error exceeds the worst of all.

    Parameters
    ----------
    rises : ndarray, shape (wavevectors, bands)
        Relative estimates.
    share : float, optional
        Factor on them.

    Returns
    -------
    ndarray, shape (wavevectors, bands)
        Relative half-widths.
    """
    worst = rises.max(initial=0.0)
    below = np.maximum.accumulate(rises.max(axis=0, initial=0.0))
    return np.minimum(share * (rises + HIDDEN * below) + BEYOND * worst, share * worst)


def last_degree_through(lattice: ReducedLattice, wavevectors: FloatArray, count: int) -> float:
    """Compute the largest relative rise of the lowest bands without the highest functions through the thickness.

    Parameters
    ----------
    lattice : ReducedLattice
        The reduced cell.
    wavevectors : ndarray, shape (n, 2)
        In rad/m.
    count : int
        Number of bands.

    Returns
    -------
    float
        Relative; 0 for linear functions, which have no lower degree to compare with.
    """
    across = lattice.cell.interface.across
    if across.max() < 2:  # a plate of linear functions has no lower degree to compare with
        return 0.0
    rises = [_brought(lattice, lattice.waves(k, count), across)[-1] for k in wavevectors]
    return max(float(each.max(initial=0.0)) for each in rises)


def waves_of(row: Periodic, wavevector: FloatArray, count: int) -> tuple[FloatArray, ModeErrors]:
    """Compute the lowest waves of a row and their errors due to truncation and to the cells' meshes.

    Parameters
    ----------
    row : Periodic
        The row.
    wavevector : ndarray, shape (2,)
        In rad/m.
    count : int
        Number of waves.

    Returns
    -------
    frequency_hz : ndarray, shape (count,)
        Ascending.
    errors : ModeErrors
        Relative, (count,) each.
    """
    plate = row.at(wavevector)
    tones, waves = plate.waves(count)
    moving, errors_of = tones > STILL * tones[-1], np.zeros((5, len(tones)))
    pencil, dofs = plate.pencil(), waves[:, moving]
    errors = mode_errors(plate, pencil, dofs, rims=1.0)
    before = OTHER_PARITY * by_degrees(pencil, dofs, last_degree(plate, before=1))
    degrees = np.maximum(errors.degrees, before)
    errors_of[:, moving] = errors.modes, degrees, errors.through, errors.taken, errors.mesh
    return tones, ModeErrors(*errors_of)


def mesh_error(cell: Cell, waves: Waves) -> MeshErrors:
    """Compute the discretisation error of each wave's frequency; 0 for rigid-body waves.

    By Rayleigh's quotients with the cell's changes on coarser meshes (`MeshError.changes`). A wave that the last order does
    not change may hide an error that lower waves at the same wavevector show (`ErrorFractions.of_modes`).

    Parameters
    ----------
    cell : Cell
        The reduced cell.
    waves : Waves
        n waves at one wavevector.

    Returns
    -------
    MeshErrors
        Relative corrections and half-widths, (n,) each; NaN without an estimate.
    """
    error = cell.mesh_error
    if error is None:
        return MeshErrors(np.zeros(len(waves.eigenvalue)), np.full(len(waves.eigenvalue), np.nan))
    moving = _moving(waves)
    changes = error.changes(waves.dofs, np.where(moving, waves.eigenvalue, 1.0))
    layer, order = (np.where(moving, change, 0.0) for change in changes)
    return MeshErrors(error.taken * layer, shares_of(error).of_modes(waves.eigenvalue, layer, order))


def _corrected(
    cell: Cell,
    builder: CellBuilder,
    by_layer: tuple[FloatArray, FloatArray],
    by_order: tuple[FloatArray, FloatArray],
    shares: ErrorFractions,
) -> Cell:
    """The cell less a fraction of its change by the layer, limited so that K and M stay positive; the rest is uncertain."""
    limits = [
        MAX_SHARE / largest(change, whole)
        for change, whole in zip(by_layer, metrics(cell), strict=True)
        if change.any()
    ]
    taken = min([shares.correction, *limits])
    error = MeshError(
        *by_layer, *by_order, taken, shares.uncertainty + shares.correction - taken, shares.edge, shares.order
    )
    stiffness, mass = (
        whole - taken * change for whole, change in zip((cell.stiffness, cell.mass), by_layer, strict=True)
    )
    better = replace(cell, stiffness=stiffness, mass=mass, mesh_error=error)
    builder.check(better)
    return better


def _change(
    fine: CellBuilder, parts: list[SymmetryClass], nested: NestedBuilder, top_hz: float, cell: Cell
) -> tuple[FloatArray, FloatArray]:
    """Change of K_r and M_r on a coarser mesh, (dof, dof) each."""
    stiffness, mass = np.zeros_like(cell.stiffness), np.zeros_like(cell.mass)
    known: dict[int, list[FloatArray]] = {}
    others = nested.body.classes(top_hz, bounded=False)
    for part, other, place in zip(parts, others, fine.places(parts), strict=True):
        key = id(part.turned or part)
        if key not in known:
            known[key] = _class_change(fine, part, nested, other)
        for total, own in zip((stiffness, mass), known[key], strict=True):
            total += fine.copies * place @ own @ place.T
    return (stiffness + stiffness.T) / 2.0, (mass + mass.T) / 2.0


def _class_change(
    fine: CellBuilder, part: SymmetryClass, nested: NestedBuilder, other: SymmetryClass
) -> list[FloatArray]:
    """Change of K_r and M_r for one symmetry class; zero for modes without a counterpart."""
    theirs, ours = _alignment(part, other, fine, nested.transfer)
    pairs = zip(nested.body.projected(other)[:2], fine.projected(part)[:2], strict=True)
    return [ours @ (theirs.T @ coarser @ theirs - ours.T @ finer @ ours) @ ours.T for coarser, finer in pairs]


def _alignment(
    part: SymmetryClass, other: SymmetryClass, fine: CellBuilder, transfer: sp.csr_array
) -> tuple[FloatArray, FloatArray]:
    """Turns (their dof, k) and (own dof, k) of both bases to directions that belong together.

    Boundary functions keep their names, in whatever combinations each mesh takes them: one that is its own image under
    x <-> y splits them once more. What the coarser mesh's shapes differ by is given to its modes as far as they can clamp it,
    so that almost massless combinations stay so.
    """
    width = part.basis.shape[1]
    renamed = other.basis.T @ part.basis  # both are orthonormal and span the same
    prolonged = on_components(transfer, other.shapes)
    heavy = on_components(fine.system.mass, prolonged[:, width:])
    left, overlap, right = np.linalg.svd(heavy.T @ part.shapes[:, width:], full_matrices=False)
    alike = overlap > ALIKE
    lent = heavy.T @ (part.shapes[:, :width] - prolonged[:, :width] @ renamed)
    own = np.zeros((len(right.T), width))
    return _widened(renamed, lent, left[:, alike]), _widened(np.eye(width), own, right[alike].T)


def _widened(named: FloatArray, lent: FloatArray, turn: FloatArray) -> FloatArray:
    """The boundary's degrees of freedom with the modes' part in them, next to a rotation of the modes."""
    return np.block([[named, np.zeros((len(named), turn.shape[1]))], [lent, turn]])


def _by_further(plate: Joined, value: FloatArray, vectors: FloatArray | ComplexArray) -> FloatArray:
    """Half of r' (K_ee - l M_ee)^-1 r over the modes' l, e the further functions of the cells and l the largest, (k,).

    Infinite where those have modes of their own below.
    """
    if not len(value):
        return np.zeros(0)
    wide = plate.widened()
    pencil, place = wide.pencil(), _places(plate, wide)
    fresh = np.setdiff1d(np.arange(wide.dof), place)
    stiffness, mass = (sp.csr_array(matrix)[fresh] for matrix in (pencil.stiffness, pencil.mass))
    force = stiffness[:, place] @ vectors - (mass[:, place] @ vectors) * value
    own = sp.csc_array((stiffness - value.max() * mass)[:, fresh])
    if np.iscomplexobj(own):  # of one period alone, hence small
        values, turn = np.linalg.eigh(own.toarray())
        answer = turn @ ((turn.conj().T @ force) / values[:, None])
        return np.full_like(value, np.inf) if values[0] <= 0.0 else energy(force, answer) / (2.0 * value)
    factor = Factoriser()(own)
    if factor.negative:
        return np.full_like(value, np.inf)
    return energy(force, factor.solve(force)) / (2.0 * value)


def _places(plate: Joined, wide: Joined) -> IntArray:
    """Places of the plate's degrees of freedom among those with further functions, (dof,)."""
    out = np.empty(plate.dof, dtype=np.int64)
    for one, other in zip(plate.placed_cells, wide.placed_cells, strict=True):
        own = other.cell.interface.within(one.cell.interface)
        local = np.concatenate([own, np.arange(other.cell.interface.count, other.cell.dof)])
        live = one.coefficient != 0.0
        out[one.dofs[live]] = other.dofs[local][live]
    return out


def _dofs(plate: Joined, of_cell: Callable[[Cell], IntArray]) -> BoolArray:
    """Mask of the plate's degrees of freedom that belong to its cells, (dof,)."""
    chosen = np.zeros(plate.dof, dtype=bool)
    for placed_cell in plate.placed_cells:
        local = of_cell(placed_cell.cell)
        local = local[placed_cell.coefficient[local] != 0.0]
        chosen[placed_cell.dofs[local]] = True
    return chosen


def _brought(lattice: ReducedLattice, waves: Waves, degree: IntArray) -> FloatArray:
    """Largest relative lowering of each frequency by the boundary functions of each degree (boundary,), (degrees, n)."""
    free, moving = lattice.cell.interface.free, _moving(waves)
    parts = np.zeros((int(degree.max()) + 1, len(moving)))
    if not moving.any():
        return parts
    order = np.argsort(degree[free], kind="stable")
    still = max(float(waves.eigenvalue[moving].min()), TIMES_ROUNDING * lattice.rounding)
    lower = np.linalg.cholesky(lattice.boundary(waves.wavevector, still)[np.ix_(order, order)])
    np.add.at(parts, degree[free][order], np.abs(lower.conj().T @ waves.dofs[free][order]) ** 2)
    return np.where(moving, parts / (2.0 * np.where(moving, waves.eigenvalue, 1.0)), 0.0)


def _moving(waves: Waves) -> BoolArray:
    """Mask of the waves that are not rigid-body modes, (n,)."""
    return np.asarray(waves.frequency_hz > STILL * waves.frequency_hz[-1])
