"""The reduced cell at any design of the box, from the reduced bases alone: a Craig-Bampton cell in milliseconds.

For staggered rows the cell is the pillar's panel; the bare panel next to it is reduced in the same way.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial
from itertools import product

import numpy as np
from numpy.polynomial import legendre
from scipy.linalg import cho_factor, cho_solve, eigh

from geometry.elements import FloatArray, IntArray
from geometry.mesh import Mesh
from solvers.fem.assembly import Scale
from solvers.fem.surface import COUNT, face_quadrature, gauss_points
from solvers.parametric.affine import PITCH, THICKNESS, AffineCell, DesignBox, Sizes, across, plan_lines, theta
from solvers.parametric.block import (
    ALIKE,
    BESIDE,
    KEPT,
    NOVEL,
    QUARTERS,
    Block,
    ReducedBlock,
    Sector,
    bare_block,
    block_alone,
    chosen,
    reduced_block,
    sectors,
)
from solvers.superelement.cell import Cell, Expansion, mirrored, places_of, rigid_polynomials
from solvers.superelement.interface import Interface
from solvers.threads import one_thread

APART = 20.0  # condition number of polynomials over a touch face: 11 where the rule is exact for their squares
RIGID = 1e-9  # of the pitch: smaller rigid-body modes of a class are rounding


@dataclass(frozen=True)
class Inner:
    """How many functions of the inside every class keeps: clamped modes, and what the other modes answer to inertia.

    The modes left out answer the boundary's inertia by K_II^-1 M Psi less the share of those kept; of that the directions
    with most energy are kept (craig1968; macneal1971, rubin1975 for the residual).
    """

    modes: int
    residual: int


@dataclass(frozen=True)
class ParametricCell:
    """K_r and M_r over a box of designs: the reduced classes, of staggered rows those of the bare panel last.

    touch_m (p, 2), touch_weights (p,): Gauss points and weights of the reference's touch face, rectangles at x, y >= 0.
    """

    box: DesignBox
    reference: Sizes
    scale: Scale
    interface: Interface
    blocks: tuple[ReducedBlock, ...]
    touch_m: FloatArray
    touch_weights: FloatArray
    mesh_dof: int

    def at(self, sizes: FloatArray | Sizes, inner: Inner, face: Interface | None = None) -> Cell:
        """The pillar's panel of one design, in units of its thickness; `face`: lower degrees of its boundary polynomials.

        SolverError for a design outside the box, by name.
        """
        face = face or self.interface
        return _joined(self, self.parts(sizes, inner, face, self.blocks[: self.pillars]), face, sizes)

    def parts(
        self, sizes: FloatArray | Sizes, inner: Inner, face: Interface, blocks: Sequence[ReducedBlock] | None = None
    ) -> list[ClassAtDesign]:
        """The symmetry classes of one design; where x and y may be exchanged, that of (-, +) last. Errors as at."""
        self.box.require(sizes)
        with one_thread():
            parts = [self._part(block, sizes, inner, face) for block in blocks or self.blocks]
        if not self.box.is_alike:
            return parts
        return parts + [part.swapped(face, self.turned) for part in parts if part.signs[2] == 0]

    @property
    def pillars(self) -> int:
        """How many of the classes are the pillar's panel's."""
        return len(self.blocks) // self.box.panels

    def sectors(self, fractions: Sequence[Sequence[float]] | FloatArray) -> tuple[Sector, ...]:
        """How the waves at wavevectors (k, 2) in units of pi / pitch are made of the classes. Errors as `sectors`."""
        return sectors(self.interface, fractions, self.box.lattice, self.box.is_alike)

    def _part(self, block: ReducedBlock, sizes: FloatArray | Sizes, inner: Inner, face: Interface) -> ClassAtDesign:
        exponents = block.stiffness_exponents, block.mass_exponents
        theta_k, theta_m = (theta(each, sizes, self.reference, self.box) for each in exponents)
        parity, kept = lower(block.parity, self.interface, face)
        boundary = block.boundary(self.box.share(sizes))[:, kept]
        f, width = block.functions, boundary.shape[1]
        stiffness, mass = np.tensordot(theta_k, block.stiffness, axes=1), np.tensordot(theta_m, block.mass, axes=1)
        factor = cho_factor(stiffness[f:, f:])
        shapes = np.vstack([boundary, -cho_solve(factor, stiffness[f:, :f] @ boundary)])
        pushed = mass[f:] @ shapes  # inertia of the constraint modes: each pushes the inside by l times this
        flexible = cho_solve(factor, pushed)
        values, modes = eigh(stiffness[f:, f:], mass[f:, f:], subset_by_index=(0, inner.modes - 1), driver="gvx")
        left = flexible - (modes / values) @ (modes.T @ pushed)  # what the modes left out answer, per eigenvalue
        # of all boundary motions, those of unit energy whose lost answer is largest give the further functions
        energy = shapes.T @ (stiffness @ shapes + BESIDE * (mass @ shapes))
        lost = pushed.T @ left
        _, along = eigh(lost, energy, subset_by_index=(max(width - inner.residual, 0), width - 1), driver="gvx")
        more = left @ along
        more_values, turn = eigh(more.T @ stiffness[f:, f:] @ more, more.T @ mass[f:, f:] @ more)
        inside = np.hstack([modes, more @ turn])
        shapes = np.hstack([shapes, np.vstack([np.zeros((f, inside.shape[1])), inside])])
        own = tuple(shapes.T @ matrix @ shapes for matrix in (stiffness, mass))
        own[0][:width, :width] = _flexible(own[0][:width, :width], rigid_span(parity, face, self.box, sizes))
        dropped_hz = float(self.scale.frequency(values[-1:])[0])
        coupling = own[1][:width, width:]
        values = np.concatenate([values, more_values])
        # residual flexibility (`Cell.dropped`) of what neither modes nor further functions hold
        lost = pushed.T @ flexible - (coupling / values) @ coupling.T
        hz, touch = self.scale.frequency(values), block.touch @ shapes
        return ClassAtDesign(block.signs, parity, own, hz, dropped_hz, lost, touch, shapes)

    @cached_property
    def turned(self) -> IntArray:
        """Which touch point each becomes when x and y are exchanged."""
        apart = np.linalg.norm(self.touch_m[:, None] - self.touch_m[None, :, ::-1], axis=2)
        return np.asarray(apart.argmin(axis=0))


@dataclass(frozen=True)
class ClassAtDesign:
    """A class of one design: K and M among its boundary polynomials and inner functions.

    lost (m, m): residual flexibility of the inner functions left out, as `Cell.dropped`; touch (p, m): u_z at the touch
    points; shapes: both in the block's basis.
    """

    signs: IntArray
    parity: FloatArray
    own: tuple[FloatArray, ...]
    fixed_hz: FloatArray
    dropped_hz: float
    lost: FloatArray
    touch: FloatArray
    shapes: FloatArray

    def swapped(self, face: Interface, turned: IntArray) -> ClassAtDesign:
        """(-, +) from (+, -): x and y exchanged, touch points too."""
        return replace(self, signs=self.signs[[1, 0, 2]], parity=self.parity[face.diagonal()], touch=self.touch[turned])


def rigid_span(parity: FloatArray, face: Interface, box: DesignBox, sizes: FloatArray | Sizes) -> FloatArray:
    """Build an orthonormal basis of a class's rigid-body modes among its boundary polynomials.

    Parameters
    ----------
    parity : ndarray, shape (boundary, m)
        The class's polynomials.
    face : Interface
        Degrees along the sides and through the thickness.
    box : DesignBox
        Its panel.
    sizes : ndarray, shape (4,), or tuple
        The design, in m.

    Returns
    -------
    ndarray, shape (m, r)
        The basis.
    """
    motions = parity.T @ rigid_polynomials(face, (*box.panel, float(sizes[THICKNESS] / sizes[PITCH])))
    left, size, _ = np.linalg.svd(motions, full_matrices=False)
    return np.asarray(left[:, size > RIGID])


def _flexible(stiffness: FloatArray, rigid: FloatArray) -> FloatArray:
    """The stiffness without what rounding of the stored matrices makes rigid-body modes meet."""
    other = np.eye(len(stiffness)) - rigid @ rigid.T
    return np.asarray(other @ stiffness @ other)


def lower(parity: FloatArray, full: Interface, face: Interface) -> tuple[FloatArray, IntArray]:
    """Select a class's polynomials without the bubbles that a lower interface lacks.

    Parameters
    ----------
    parity : ndarray, shape (boundary, m)
        The class's polynomials.
    full, face : Interface
        The cell's own interface and the lower one.

    Returns
    -------
    parity : ndarray, shape (fewer, n)
        Of the lower interface.
    kept : ndarray of int, shape (n,)
        Columns that remain.
    """
    here = np.arange(face.vertex_block)
    layer = np.arange(face.side_block) % face.vertex_block + full.vertex_block * (
        np.arange(face.side_block) // face.vertex_block
    )
    corners = [full.vertex(index)[here] for index in range(4)]
    rows = np.concatenate([*corners, *(full.side(index)[layer] for index in range(4))])
    other = np.setdiff1d(np.arange(full.count), rows)
    kept = np.flatnonzero(~parity[other].any(axis=0))
    return parity[rows][:, kept], kept


def _joined(cell: ParametricCell, parts: list[ClassAtDesign], face: Interface, sizes: FloatArray | Sizes) -> Cell:
    """The symmetry classes in the sides' own degrees of freedom, in units of the design's thickness."""
    places = places_of([part.parity for part in parts], [len(part.fixed_hz) for part in parts])
    matrices = [
        np.sum([4.0 * p @ part.own[i] @ p.T for p, part in zip(places, parts, strict=True)], axis=0) for i in (0, 1)
    ]
    lost = np.sum([4.0 * part.parity @ part.lost @ part.parity.T for part in parts], axis=0)
    ratio = cell.scale.length_m / sizes[THICKNESS]
    stiffness, mass = (unit * (m + m.T) / 2.0 for unit, m in zip((ratio, ratio**3), matrices, strict=True))
    fixed = np.concatenate([part.fixed_hz for part in parts])
    return Cell(
        stiffness, mass, np.zeros_like(mass), face, replace(cell.scale, length_m=float(sizes[THICKNESS])),
        cell.box.panel_m(sizes),
        fixed, np.array([part.signs[:2] for part in parts for _ in part.fixed_hz], dtype=np.int64).reshape(-1, 2),
        min(part.dropped_hz for part in parts), ratio**5 * lost,
        _touch(cell, parts, places, sizes), Expansion.nothing(len(stiffness)), cell.mesh_dof,
    )  # fmt: skip


def _touch(
    cell: ParametricCell, parts: list[ClassAtDesign], places: list[FloatArray], sizes: FloatArray | Sizes
) -> Expansion:
    """u_z on the touch face of the whole cell, from its quarter's points."""
    was, now = (np.array(plan_lines(each, cell.box)) for each in (cell.reference, sizes))
    block, beside = (np.diff(now) / np.diff(was)).T
    points = np.column_stack([across(cell.touch_m, cell.reference, sizes, cell.box), np.zeros(len(cell.touch_m))])
    stretch = np.where(cell.touch_m < was[:, 1], block, beside).prod(axis=1)
    fields = [(part.touch @ place.T)[:, None] for part, place in zip(parts, places, strict=True)]
    everywhere, matrix = mirrored(points, fields, [dict(enumerate(part.signs[:2])) for part in parts], (0, 1))
    return Expansion(everywhere, matrix, np.tile(cell.touch_weights * stretch, 4))


def parametric_cell(
    cell: AffineCell,
    interface: Interface,
    designs: Sequence[Sizes],
    unseen: Sequence[Sizes] = (),
    apply: Callable[..., Iterable[tuple[ReducedBlock, ...]]] = map,
    coarse: AffineCell | None = None,
) -> tuple[ParametricCell, ...]:
    """Reduce the cell over the box from given designs, and for each unseen design one made for it alone.

    With a coarser mesh of the same topology, a class uses only the designs that add something new on that mesh.

    Parameters
    ----------
    cell : AffineCell
        The quarter panel.
    interface : Interface
        Degrees along the sides and through the thickness.
    designs, unseen : sequence of tuple of float
        In m.
    apply : callable, optional
        Maps over the classes, several at once if it can; the largest comes first.
    coarse : AffineCell, optional
        The coarser mesh.

    Returns
    -------
    tuple of ParametricCell
        That of the box, then those of the unseen designs.
    """
    work = partial(_reduce, cell, coarse, interface, tuple(designs), tuple(unseen))
    classes = ALIKE.classes if cell.box.is_alike else QUARTERS
    reduced = list(apply(work, classes[::-1]))[::-1]
    touch_m, weights, from_mesh = fitted_touch(cell.mesh, plan_lines(cell.reference, cell.box))
    bare = tuple(bare_block(cell, interface, signs) for signs in classes) if cell.box.panels > 1 else ()
    return tuple(
        ParametricCell(
            cell.box, cell.reference, cell.scale, interface,
            (*(replace(block, touch=from_mesh @ block.touch) for block in blocks), *bare), touch_m, weights,
            4 * cell.mesh.dof,
        )
        for blocks in zip(*reduced, strict=True)
    )  # fmt: skip


def _reduce(
    cell: AffineCell,
    coarse: AffineCell | None,
    interface: Interface,
    designs: Sequence[Sizes],
    unseen: Sequence[Sizes],
    signs: tuple[int, int, int],
) -> tuple[ReducedBlock, ...]:
    with one_thread():
        block, taken = Block(cell, interface, signs), designs
        if coarse:
            taken = tuple(chosen(Block(coarse, interface, signs), designs, NOVEL * KEPT))
        return (reduced_block(block, taken, designs), *(block_alone(block, sizes) for sizes in unseen))


# -- touch face --------------------------------------------------------------------------------------------------------
# u_z on the touch face of a quarter cell: a polynomial on each rectangle that stretches as one.


def fitted_touch(mesh: Mesh, lines: Sequence[Sequence[float]]) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Build the Gauss points of the four rectangles between lines along x and y, and the fit of u_z there.

    The foot lies a plate's thickness away: degree COUNT - 1 each way follows the field, or as far as the points determine.

    Parameters
    ----------
    mesh : Mesh
        Nodes in m.
    lines : sequence of sequence of float
        Along x and y the middle, the end of the block and the side, in m.

    Returns
    -------
    points : ndarray, shape (p, 2)
        In m.
    weights : ndarray, shape (p,)
        In m^2.
    rows : ndarray, shape (p, q)
        u_z from that at the points of `face_quadrature`.
    """
    rule, (gauss, area) = face_quadrature(mesh, "touch"), gauss_points()
    at = rule.points[:, :2]
    points, weights, rows = [], [], []
    for corner in product((0, 1), repeat=2):
        low, high = (np.array([own[i + end] for own, i in zip(lines, corner, strict=True)]) for end in (0, 1))
        middle, half = (low + high) / 2.0, (high - low) / 2.0
        inside = np.flatnonzero(((at > low) & (at < high)).all(axis=1))
        row = np.zeros((len(gauss), len(at)))
        row[:, inside] = _fit((at[inside] - middle) / half, rule.weights[inside], gauss)
        rows.append(row)
        points.append(middle + half * gauss)
        weights.append(area * half.prod())
    return np.concatenate(points), np.concatenate(weights), np.concatenate(rows)


def _fit(known: FloatArray, weights: FloatArray, target: FloatArray) -> FloatArray:
    """Values at points (p, 2) of the projection on most products that a rule's points (q, 2) and weights tell apart, (p, q)."""
    root = np.sqrt(weights / weights.sum())
    degrees = [(i, j) for i in range(COUNT) for j in range(COUNT)]
    for each in sorted(degrees, key=lambda each: -(each[0] + 1) * (each[1] + 1)):
        table = root[:, None] * _products(known, each)
        if table.shape[1] <= len(known) and np.linalg.cond(table) < APART:
            return np.asarray(_products(target, each) @ np.linalg.pinv(table) * root)
    raise ValueError("no points of a rule lie in a part of the touch face")


def _products(points: FloatArray, degrees: tuple[int, int]) -> FloatArray:
    """Products of Legendre polynomials at points (n, 2), (n, (i + 1) (j + 1))."""
    x, y = (legendre.legvander(points[:, axis], degrees[axis]) for axis in (0, 1))
    return np.asarray((x[:, :, None] * y[:, None, :]).reshape(len(points), -1), dtype=float)
