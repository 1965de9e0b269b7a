"""How far a mode of an assembled plate lies above that of its meshes, and how many modes more the meshes have.

Fixed-interface modes left out take l^2 D from the boundary's dynamic stiffness, D their residual flexibility, which each
cell knows (`Cell.dropped`): an eigenvalue l falls by l^2 u'D u, to first order. Without a part d of the eigenvector u, its
last degree along the sides, Rayleigh's quotient rises by d'(K - l M)d / (u - d)'M(u - d): what that degree brought bounds the
next ones. Further degrees through the thickness e, which a thick plate's cells know (`Cell.further`), lower it by
r'(K_ee - l M_ee)^-1 r, r = (K_e - l M_e)u, to second order in what they couple.

The meshes coupled at their boundary functions have the boundary's dynamic stiffness S and the interiors' own eigenvalues,
N = N(S) + sum N(interior), both below lambda (wittrick1971). Every interior mode up to Lambda is kept, so the reduced pencil
counts the interiors' whole; what modes left out take from S is bounded (`Cell.dropped`) and only lowers it. Hence
N_reduced <= N <= N of the pencil with that bound taken from its stiffness.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Protocol, TypeAlias

import numpy as np
import scipy.sparse as sp

from geometry.elements import BoolArray, ComplexArray, FloatArray, IntArray
from solvers.accuracy.mesh import shares_of, smooth_half_width
from solvers.fem.eigen import PlainPencil, count_below
from solvers.fem.factor.factoriser import Factoriser
from solvers.superelement.cell import Cell
from solvers.superelement.plate import AssembledPlate

if TYPE_CHECKING:
    from solvers.superelement.periodic import BlochPlate

# of the half-width at rims, and of what the last order brought away from them: a plate's modes move its cells more alike than
# ten bands of a lattice do, and bend its bare panels in shorter waves. Of ten plates of seed 7 of `python -m
# studies.error_bars` 99 of 100 modes lie within
AT_RIMS, AWAY = 0.5, 0.06
MARGIN = 2.0  # single modes may lie somewhat above the estimate by truncation, the worst of a class never did
# of the rise without the last degree through the thickness what further ones bring to a plate thin for its waves: its free
# edges' boundary layers, sin(pi z / t) at their slowest, leave these up to 0.04
EDGE_LAYER = 0.03


@dataclass(frozen=True)
class ModeErrors:
    """Relative errors of frequencies, (k,) each, from above: by the fixed-interface modes, by the degrees along the sides and
    by those through the thickness that are left out.

    Infinite from the lowest mode on that may have been left out: nothing is known there. taken: how far the finest mesh's own
    frequency lies above the reported one; mesh: half-width of the bar by the mesh, NaN where no coarser mesh tells it.
    """

    modes: FloatArray
    degrees: FloatArray
    through: FloatArray
    taken: FloatArray
    mesh: FloatArray

    @property
    def by_degrees(self) -> FloatArray:
        """By the degrees left out, in either direction."""
        return self.degrees + self.through

    @property
    def total(self) -> FloatArray:
        """By all truncations."""
        return self.modes + self.by_degrees


class Assembly(Protocol):
    """Cells that were joined: each with its `cell` and how many `copies` of it there are, and their motion (cell dof, k)."""

    @property
    def placed_cells(self) -> Sequence[Any]: ...
    def cell_vectors(self, placed_cell: Any, vectors: Any) -> Any: ...


Joined: TypeAlias = "AssembledPlate | BlochPlate"  # their degrees of freedom are their cells' own


def mode_errors(
    plate: Joined, pencil: PlainPencil, vectors: FloatArray | ComplexArray, rims: float = AT_RIMS
) -> ModeErrors:
    """Estimate for M-orthonormal modes (dof, k) of a symmetry class and its pencil, or for Bloch waves, which are complex.

    rims: of the half-width that the rims' singularities have.
    """
    value = energy(vectors, pencil.stiffness @ vectors)
    along = by_degrees(pencil, vectors, last_degree(plate))
    if all(cell.further for cell in plate.cells):
        through = _by_further(plate, value, vectors)
    else:
        through = EDGE_LAYER * by_degrees(pencil, vectors, _dofs(plate, last_layer))
    return ModeErrors(by_modes(plate, value, vectors), along, through, *by_mesh(plate, value, vectors, rims))


def by_degrees(
    pencil: PlainPencil,
    vectors: FloatArray | ComplexArray,
    last: BoolArray,
    images: tuple[FloatArray, FloatArray] | None = None,
) -> FloatArray:
    """How far M-orthonormal modes u (dof, k) rise without what the last degree (dof,) brought to them, relative, (k,).

    By Rayleigh's quotient of u - d: K and M on the part alone tell what d itself holds. images: K u and M u, where known.
    """
    where = np.flatnonzero(last)
    stiff, heavy = images or (pencil.stiffness @ vectors, pencil.mass @ vectors)
    value, dropped = energy(vectors, stiff), vectors[where]
    left = [
        energy(vectors, image)
        - 2.0 * energy(dropped, image[where])
        + energy(dropped, matrix[where][:, where] @ dropped)
        for matrix, image in ((pencil.stiffness, stiff), (pencil.mass, heavy))
    ]
    return np.asarray(np.sqrt(np.maximum(left[0] / left[1] / value, 1.0)) - 1.0)


def energy(vectors: FloatArray | ComplexArray, images: FloatArray | ComplexArray) -> FloatArray:
    """u^H v of each pair of columns, (k,)."""
    return np.asarray(np.einsum("ik,ik->k", vectors.conj(), images).real)


def by_mesh(
    plate: Assembly, value: FloatArray, vectors: FloatArray | ComplexArray, rims: float = AT_RIMS
) -> tuple[FloatArray, FloatArray]:
    """What was taken from the frequencies of M-orthonormal modes (dof, k) and their bars' half-width, relative, (k,) each.

    By Rayleigh's quotient at scaled eigenvalues (k,); a half-width is NaN where a cell has no coarser mesh.
    """
    taken, rim, order, beyond = (np.zeros_like(value) for _ in range(4))
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
        if shares.doubt:
            beyond += shares.doubt * error.taken * (by_layer - by_order / error.edge)
    known = [each.cell.mesh_error for each in plate.placed_cells]
    smooth = smooth_half_width(order, AWAY, min((error.order for error in known if error), default=0))
    return taken, rims * np.abs(rim) + smooth + np.maximum(beyond, 0.0)


def by_modes(plate: Assembly, value: FloatArray, vectors: FloatArray | ComplexArray) -> FloatArray:
    """Half of l u' D u over the modes' l, D the residual flexibility of every cell, as large as it may be at l, (k,)."""
    total = np.zeros_like(value)
    for placed_cell in plate.placed_cells:
        cell = placed_cell.cell
        own = plate.cell_vectors(placed_cell, vectors)[: len(cell.dropped)]
        total += placed_cell.copies * cell.residual.growth(value) * energy(own, cell.dropped @ own)
    return np.asarray(0.5 * value * total)


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
    """Where the plate's degrees of freedom stand among those with further functions, (dof,)."""
    out = np.empty(plate.dof, dtype=np.int64)
    for one, other in zip(plate.placed_cells, wide.placed_cells, strict=True):
        own = other.cell.interface.within(one.cell.interface)
        local = np.concatenate([own, np.arange(other.cell.interface.count, other.cell.dof)])
        live = one.coefficient != 0.0
        out[one.dofs[live]] = other.dofs[local][live]
    return out


def _dofs(plate: Joined, of_cell: Callable[[Cell], IntArray]) -> BoolArray:
    """Which of the plate's degrees of freedom are those of its cells, (dof,)."""
    chosen = np.zeros(plate.dof, dtype=bool)
    for placed_cell in plate.placed_cells:
        local = of_cell(placed_cell.cell)
        local = local[placed_cell.coefficient[local] != 0.0]
        chosen[placed_cell.dofs[local]] = True
    return chosen


def last_degree(plate: Joined, before: int = 0) -> BoolArray:
    """Which of the plate's degrees of freedom are the bubbles of the highest degree, or of one so far before it, (dof,)."""
    return _dofs(plate, lambda cell: last_bubbles(cell, before))


def last_bubbles(cell: Cell, before: int = 0) -> IntArray:
    """The bubbles of the highest degree on the four sides, or of one so far before it."""
    return np.flatnonzero(cell.interface.along_side == cell.interface.along - before)


def last_layer(cell: Cell) -> IntArray:
    """The boundary functions of the highest degree through the thickness."""
    face = cell.interface
    return np.flatnonzero(np.arange(face.count) // 3 % face.layers == face.through)


def more_below(
    plate: AssembledPlate,
    pencil: PlainPencil,
    edge_hz: float,
    reduced: int | None = None,
    factorise: Factoriser | None = None,
    degrees: float = 0.0,
) -> int | None:
    """How many more modes the assembled meshes have at most below a frequency than the reduced pencil; None without a bound.

    `reduced`: the reduced pencil's own count there, rigid-body modes included, where it is known already; `factorise` shares
    the symbolic analysis of the pencil's earlier solves; degrees: how far, relative, the degrees left out may put a mode of
    the meshes below the one that stands for it.
    """
    beyond_hz = edge_hz * (1.0 + degrees)
    value = pencil.scale.eigenvalue(beyond_hz)
    if not all(np.isfinite(placed_cell.cell.residual.growth(value)) for placed_cell in plate.placed_cells):
        return None

    def lost(cell: Cell) -> FloatArray:
        return cell.on_boundary(value**2 * float(cell.residual.growth(value)) * cell.dropped)

    softer = PlainPencil(
        (pencil.stiffness - plate.of_cells(lost)).tocsc(), pencil.mass, pencil.scale, pencil.rigid_count
    )
    own = count_below(pencil, edge_hz, factorise) if reduced is None else reduced
    return count_below(softer, beyond_hz, factorise) - own
