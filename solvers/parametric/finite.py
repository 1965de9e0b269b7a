"""Finite plates of equal columns: one column's modes, row by row, and the waves of the infinite plate with free ends.

The mirror x -> -x followed by conjugation leaves waves of a real wavenumber alone: in the coordinates that it keeps, K and M of
a row are real. Of two panels in a pitch it exchanges the lines between them. Every step keeps the edge that the next row shares
and the modes of what lies behind it, that edge fixed, up to REACH times the window's top, so that no eigenvalue problem is
larger than some hundred degrees of freedom.

Modes beyond that respond as at one eigenvalue s. A mode of eigenvalue l_i and modal participation p_i then has the error
p_i (l - s) / l_i at an eigenvalue l, which raises l by sum_i p_i^2 (l - s)^2 / (l_i l) of itself at most, the p_i^2 together
by less than 1. At both ends of a window that is the same, and no more than 1 / REACH^2, where s is the geometric mean of the
ends; with the arithmetic mean it has no bound as the lower end falls.

Trial functions are the column's modes at wavenumbers k_j, multiples of pi over a length somewhat beyond the plate's, as
standing waves even or odd in x: cosines of a longer period span what no cosines of the plate's own do at its ends.
Ritz's method leaves the ends x = +-L/2 free of force by itself: the end correction of every wave, and how the ends couple
waves of different k, come out of one small pencil. A cell whose middle is at x_c moves by Re(exp(i k x_c) psi), or by the
imaginary part. The mirror x -> -x makes Re psi even and Im psi odd about the cell's middle, so with a = Re psi' K Re psi and
b = Im psi' K Im psi summed over the column

    K_ij = ((a_ij + b_ij) D(k_i - k_j) +- (a_ij - b_ij) D(k_i + k_j)) / 2,    D(k) = sum_c cos(k x_c).

Of two panels in a pitch, as staggered rows have them, the second ones stand between the first ones, one less in a row.
Columns of pillars make whole cells; what the plate has beyond them at its two ends, or lacks there, are strips of bare panels.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from math import ceil, pi, sqrt

import numpy as np
from scipy.linalg import cho_factor, cho_solve, eigh

from geometry.elements import BoolArray, ComplexArray, FloatArray, IntArray
from geometry.layout import Design
from solvers.fem.assembly import Scale
from solvers.measures.confinement import NEGLIGIBLE, Confinement, confined, target_shape
from solvers.parametric.bare import bare_cell, bare_strip
from solvers.plates.column import Column
from solvers.superelement.cell import Cell, Expansion, SurfaceRule
from solvers.superelement.lattice import Periodic
from solvers.threads import one_thread
from solvers.waves.complex_bands import Row

ROOT = float(np.sqrt(0.5))
REACH = 9.0  # of the top of the window
Pair = tuple[FloatArray, FloatArray]

BEYOND = 1.2  # half the longest period over the plate's length
MORE = 3.0  # half-wavelengths along the zone in addition to the target mode's
INDEPENDENT = 1e-8  # of the largest: waves that add less to the scaled mass are told apart by rounding
STILL = 1e-9  # of the largest diagonal of the mass: at k = 0 half of the waves have no even part


@dataclass(frozen=True)
class Step:
    """[kept, modes] -> dropped: u_dropped = static @ u_kept + modes @ q, with K and M of [kept, q]."""

    static: FloatArray
    modes: FloatArray
    stiffness: FloatArray
    mass: FloatArray

    def dropped(self, motion: FloatArray) -> FloatArray:
        """What was dropped, of a motion [kept, q] (..., k)."""
        kept = self.static.shape[1]
        return np.asarray(self.static @ motion[:kept] + self.modes @ motion[kept:])


@dataclass(frozen=True)
class CondensedRow:
    """A row of cells with a stiff inside, condensed to its two edges; shapes: the degrees of freedom of those cells as motions
    of the whole ones.
    """

    row: Row
    step: Step
    shapes: list[FloatArray]

    def motion(self, own: FloatArray) -> ComplexArray:
        """Degrees of freedom (row dof, k) of the whole cells' row from [lower edge, upper edge, modes] (n, k)."""
        row, edges = self.row, 2 * self.row.edge
        local = real_basis(row) @ np.vstack([own[:edges], self.step.dropped(own)])
        boundary = len(local) - sum(len(cell.fixed_hz) for cell in row.periodic.cells)
        parts = zip(row.periodic.parts(row.transform), self.shapes, strict=True)
        inside = [shapes[cell.interface.count :] @ (part @ local) for (cell, part), shapes in parts]
        return np.asarray(np.vstack([local[:boundary], *inside]))


class Condensed:
    """Cells with a stiff inside, and rows of them condensed, kept for the next column of the same cells."""

    def __init__(self) -> None:
        self.cells: dict[tuple[int, float, float], tuple[Cell, Cell, FloatArray]] = {}
        self.rows: dict[tuple[tuple[int, ...], float, float, float], CondensedRow] = {}

    def clear(self) -> None:
        """Forget all of them."""
        self.cells.clear()
        self.rows.clear()

    def row(self, cells: Sequence[Cell], kx: float, top: float, about: float) -> CondensedRow:
        """A row of cells at a wavenumber, condensed."""
        key = tuple(map(id, cells)), kx, top, about
        if key not in self.rows:
            parts = [self._stiff(cell, top, about) for cell in cells]
            row = Row(Periodic([stiff for _, stiff, _ in parts]), kx)
            step = _condense(real_row(row), 2 * row.edge, top, about)
            self.rows[key] = CondensedRow(row, step, [shapes for _, _, shapes in parts])
        return self.rows[key]

    def _stiff(self, cell: Cell, top: float, about: float) -> tuple[Cell, Cell, FloatArray]:
        at = id(cell), top, about
        if at not in self.cells:
            self.cells[at] = cell, *_stiff_inside(cell, top, about)  # the cell itself, lest another takes its id
        return self.cells[at]


class Chain:
    """A column's rows condensed, its modes right between two frequencies; `known` keeps what the next column may use."""

    def __init__(self, column: Column, low_hz: float, high_hz: float, known: Condensed | None = None) -> None:
        self.column, self.known = column, Condensed() if known is None else known
        self.top, self.about = (column.scale.eigenvalue(hz) for hz in (REACH * high_hz, sqrt(low_hz * high_hz)))
        self.edge = column.rows[0].edge
        rows = {id(row): row for row in column.rows}
        with one_thread():
            self.rows = {
                key: self.known.row(row.periodic.cells, row.kx, self.top, self.about) for key, row in rows.items()
            }
            self.places = [place for place in column.placed_cells if place.index == 0]
            self.steps: list[Step] = []
            for place in self.places:
                self._add(self.rows[id(place.row)].step)

    def _add(self, row: Step) -> None:
        """One row more: its upper edge stays, its lower edge and all behind it are condensed."""
        e, modes = self.edge, len(row.mass) - 2 * self.edge
        behind = self.steps[-1] if self.steps else None
        more = len(behind.mass) - e if behind else 0
        lower = np.arange(e) if behind else self._free
        order = np.concatenate([e + np.arange(e), lower, 2 * e + np.arange(modes + more)])
        whole = []
        for name in ("stiffness", "mass"):
            own = np.zeros((2 * e + modes + more,) * 2)
            own[: 2 * e + modes, : 2 * e + modes] = getattr(row, name)
            if behind:
                at = np.concatenate([np.arange(e), 2 * e + modes + np.arange(more)])
                own[np.ix_(at, at)] += getattr(behind, name)
            whole.append(own[np.ix_(order, order)])
        self.steps.append(_condense((whole[0], whole[1]), e, self.top, self.about))

    @property
    def _free(self) -> IntArray:
        """Unknowns of the lowest edge: u_y vanishes on the mirror."""
        own = np.arange(self.edge)
        return own[own % 3 != 1]

    def solve(self, low_hz: float, high_hz: float) -> tuple[FloatArray, ComplexArray]:
        """Frequencies (k,) in Hz within a window (from rigid-body motions on if it begins below 0) and the column's own vectors
        (dof, k), as Column.solve.
        """
        last, scale, live = self.steps[-1], self.column.scale, self._end
        with one_thread():
            values, waves = eigh(last.stiffness[np.ix_(live, live)], last.mass[np.ix_(live, live)], driver="gvd")
        least = -np.inf if low_hz < 0.0 else scale.eigenvalue(low_hz)
        inside = (values >= least) & (values <= scale.eigenvalue(high_hz))
        motion = np.zeros((len(last.mass), np.count_nonzero(inside)))
        motion[live] = waves[:, inside]
        return scale.frequency(values[inside]), self._unfolded(motion)

    @property
    def _end(self) -> IntArray:
        """Unknowns of the last step that move: nothing follows the side of a panel whose foot stands at the plate's edge."""
        upper = self.places[-1].dofs[self.edge : 2 * self.edge] >= 0
        modes = len(self.steps[-1].mass) - self.edge
        return np.flatnonzero(np.concatenate([upper, np.ones(modes, dtype=bool)]))

    def _unfolded(self, motion: FloatArray) -> ComplexArray:
        out = np.zeros((self.column.dof, motion.shape[1]), dtype=complex)
        for number in range(len(self.steps) - 1, -1, -1):
            place, step, e = self.places[number], self.steps[number], self.edge
            upper, behind = motion[:e], step.dropped(motion)
            lower = np.zeros((e, motion.shape[1]))
            free = np.arange(e) if number else self._free
            lower[free] = behind[: len(free)]
            row = self.rows[id(place.row)]
            modes = len(row.step.mass) - 2 * e
            whole = row.motion(np.vstack([lower, upper, behind[len(free) : len(free) + modes]]))
            live = np.flatnonzero(place.dofs >= 0)
            out[place.dofs[live]] = whole[live]
            motion = np.vstack([lower, behind[len(free) + modes :]])
        return out


@dataclass(frozen=True)
class Piece:
    """One cell of the column: y of its middle (m), even and odd part (dof, n) of every trial function; whether it is bare.

    index: which panel of its pitch it is; part: 1 in the zone, 2 in the rows, 0 beyond them; touch: a quadrature over its touch
    face, parted where the zone and the rows end, with u_z at its own points.
    """

    cell: Cell
    middle: float
    even: FloatArray
    odd: FloatArray
    bare: bool
    index: int
    part: int
    touch: SurfaceRule


@dataclass(frozen=True)
class Strip:
    """What a plate has beyond its whole cells at x > 0: motion (dof, n); weight 2 for both ends, -2 where it is lacking."""

    stiffness: FloatArray
    mass: FloatArray
    touch: SurfaceRule
    motion: FloatArray
    middle: tuple[float, float]
    weight: float
    part: int


class FinitePlate:
    """The plate of a design from modes (dof, k) of its column at some wavenumbers; what is condensed is exact at `about`."""

    def __init__(
        self, design: Design, columns: Sequence[Column], vectors: Sequence[ComplexArray], about: float
    ) -> None:
        self.design, self.scale, self.sign = design, columns[0].scale, 1.0 - 2.0 * (design.nodal_lines % 2)
        first = columns[0].strips[0][0]
        self.width_m, self.count = first.high[0] - first.low[0], len(columns[0].strips[0])
        first_m = _middles(design, self.count * self.width_m)
        self.x_m = [first_m, first_m[:-1] + self.width_m][: self.count]
        self.kx = np.concatenate([np.full(own.shape[1], one.kx) for one, own in zip(columns, vectors, strict=True)])
        self.pieces = [
            _piece(columns, vectors, number, design.touch_lines_m) for number in range(len(columns[0].placed_cells))
        ]
        ends = abs(self._beyond_m) > NEGLIGIBLE * self.width_m
        at_end = int(self._beyond_m > 0.0) % self.count  # after the last panel the other one follows
        self.strips = [self._strip(piece, about) for piece in self.pieces if ends and piece.index == at_end]

    @property
    def _beyond_m(self) -> float:
        """How far the plate reaches beyond its whole cells at each end, m; less than 0 where it cuts them."""
        return (self.design.length_m - sum(map(len, self.x_m)) * self.width_m) / 2.0

    def _strip(self, piece: Piece, about: float) -> Strip:
        """The strip of a piece's row: part of the cell that would follow, or of the last one."""
        beyond, cell = self._beyond_m, piece.cell
        width = 2.0 * abs(beyond) / self.width_m
        follows = beyond > 0.0
        span, x = (-1.0, -1.0 + width) if follows else (1.0 - width, 1.0), self.x_m[0][-1] + follows * self.width_m
        even, odd = self._along(self.kx * x)
        moved = even * piece.even + odd * piece.odd
        stiffness, mass, touch = bare_strip(cell.size_m, self.design.stack.material, cell.interface, span)
        if not piece.bare:
            moved = _without_pillar(
                bare_cell(cell.size_m, self.design.stack.material, cell.interface), moved[: cell.interface.count], about
            )
        rule = _at_quadrature(touch, [line - piece.middle for line in self.design.touch_lines_m])
        return Strip(stiffness, mass, rule, moved, (float(x), piece.middle), 2.0 if follows else -2.0, piece.part)

    @cached_property
    def _kernels(self) -> list[tuple[FloatArray, FloatArray]]:
        """D(k_i - k_j) and +-D(k_i + k_j), (n, n) each, of every panel in a pitch."""
        different, at = np.unique(self.kx, return_inverse=True)
        grids, out = (different[:, None] - different, different[:, None] + different), []
        for x_m in self.x_m:
            apart, together = (np.cos(np.multiply.outer(k, x_m)).sum(axis=2)[np.ix_(at, at)] for k in grids)
            out.append((apart, self.sign * together))
        return out

    def _whole(self, panels: FloatArray, ends: FloatArray) -> FloatArray:
        """A form of the whole plate from those of one column's panels, even and odd (count, 2, n, n), and of the strips."""
        out = ends
        for (even, odd), (apart, together) in zip(panels, self._kernels, strict=True):
            out = ((even + odd) * apart + (even - odd) * together) / 2.0 + out
        return np.asarray((out + out.T) / 2.0)

    def _forms(self, name: str) -> tuple[FloatArray, FloatArray, FloatArray]:
        """A matrix of all cells among the trial functions, that of the zone's and that of the rows' cells, (n, n) each."""
        panels, ends = self._forms_of(3), np.zeros((3, len(self.kx), len(self.kx)))
        for piece in self.pieces:
            matrix = getattr(piece.cell, name)
            panels[piece.part, piece.index] += [half.T @ (matrix @ half) for half in (piece.even, piece.odd)]
        for strip in self.strips:
            ends[strip.part] += strip.weight * (strip.motion.T @ (getattr(strip, name) @ strip.motion))
        beyond, zone, rows = (self._whole(*part) for part in zip(panels, ends, strict=True))
        return beyond + zone + rows, zone, rows

    def _forms_of(self, parts: int) -> FloatArray:
        """Zero forms for the panels of each part, (parts, count, 2, n, n)."""
        return np.zeros((parts, self.count, 2, len(self.kx), len(self.kx)))

    def modes(self, low_hz: float, high_hz: float) -> FiniteModes:
        """The modes between two frequencies, ascending; from rigid-body motions on if these begin below 0."""
        with one_thread():
            (stiffness, *own_parts), (mass, *_) = self._forms("stiffness"), self._forms("mass")
            diagonal = np.diag(mass)
            moving = diagonal > STILL * diagonal.max()
            size = np.where(moving, 1.0 / np.sqrt(np.where(moving, diagonal, 1.0)), 0.0)
            values, turn = np.linalg.eigh(size[:, None] * mass * size)
            kept = values > INDEPENDENT * values[-1]
            basis = size[:, None] * (turn[:, kept] / np.sqrt(values[kept]))
            own, waves = np.linalg.eigh(basis.T @ stiffness @ basis)
            least = -np.inf if low_hz < 0.0 else self.scale.eigenvalue(low_hz)
            inside = (own >= least) & (own <= self.scale.eigenvalue(high_hz))
            vectors = basis @ waves[:, inside]
            zone, rows = (vectors.T @ part @ vectors for part in own_parts)
            return FiniteModes(self.scale, own[inside], zone, rows, vectors, self.faces.among(vectors))

    def profile(self, vector: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """|y| (q,) in m, weights (q,) in m2 and the mean along x of u_z^2 of a mode (n,) at the touch face's points."""
        along_x = [self._along(np.multiply.outer(x_m, self.kx)) for x_m in self.x_m]
        places, weights, squares = [], [], []
        for piece in self.pieces:
            touch, (even_along, odd_along) = piece.touch, along_x[piece.index]
            halves = ((even_along, piece.even), (odd_along, piece.odd))
            moved = np.sum([along * vector @ (touch.normal @ motion).T for along, motion in halves], axis=0)
            places.append(np.abs(touch.points[:, 1] + piece.middle))
            weights.append(len(self.x_m[piece.index]) / len(self.x_m[0]) * touch.weights)
            squares.append((moved**2).mean(axis=0))
        return np.concatenate(places), np.concatenate(weights), np.concatenate(squares)

    def _along(self, phase: FloatArray) -> tuple[FloatArray, FloatArray]:
        """What the even and the odd part of a cell's motion are multiplied by, for phases k x_c."""
        return (np.cos(phase), -np.sin(phase)) if self.sign > 0.0 else (np.sin(phase), np.cos(phase))

    @cached_property
    def faces(self) -> Faces:
        """What is measured on the touch face, as forms of the trial functions."""
        half, end = self.design.width_m / 2.0, self.design.half_span_m - self.design.extension_m
        with one_thread():
            parts = [self._squares(own) for own in (lambda y: y < half, lambda y: y >= half, lambda y: y > end)]
            overlap, norm = self._overlap(half)
        factor = self.design.stack.mass_kg_m2 / self.scale.mass_kg
        return Faces([form for form, _ in parts], [area for _, area in parts], overlap, norm, factor)

    def _squares(self, own: Callable[[FloatArray], BoolArray]) -> tuple[FloatArray, float]:
        """The integral of u_z^2 over a part of the touch face as a form (n, n), and the part's area in m2."""
        (panels,), ends, area = self._forms_of(1), np.zeros((len(self.kx), len(self.kx))), 0.0
        for piece in self.pieces:
            _, weights, normal = _inside(piece.touch, piece.middle, own)
            for out, motion in zip(panels[piece.index], (piece.even, piece.odd), strict=True):
                root = np.sqrt(weights)[:, None] * (normal @ motion)
                out += root.T @ root
            area += len(self.x_m[piece.index]) * float(weights.sum())
        for strip in self.strips:
            _, weights, normal = _inside(strip.touch, strip.middle[1], own)
            root = np.sqrt(weights)[:, None] * (normal @ strip.motion)
            ends += strip.weight * (root.T @ root)
            area += strip.weight * float(weights.sum())
        return self._whole(panels, ends), area

    def _overlap(self, half: float) -> tuple[FloatArray, float]:
        """The integral of every trial function's u_z times the target shape over the zone, (n,), and of the shape's square."""
        overlap, norm = np.zeros(len(self.kx)), 0.0
        along_x = [self._along(np.multiply.outer(x_m, self.kx)) for x_m in self.x_m]
        for piece in self.pieces:
            at, weights, normal = _inside(piece.touch, piece.middle, lambda y: y < half)
            if not len(at):
                continue
            even_along, odd_along = along_x[piece.index]
            shape = self._shape(piece.touch.points[at], self.x_m[piece.index], piece.middle)
            norm += float((weights * shape**2).sum())
            for along, motion in ((even_along, piece.even), (odd_along, piece.odd)):
                overlap += np.einsum("cn,cn->n", along, (weights * shape) @ (normal @ motion))
        for strip in self.strips:
            at, weights, normal = _inside(strip.touch, strip.middle[1], lambda y: y < half)
            shape = self._shape(strip.touch.points[at], np.array([strip.middle[0]]), strip.middle[1])[0]
            norm += strip.weight * float((weights * shape**2).sum())
            overlap += strip.weight * ((weights * shape) @ (normal @ strip.motion))
        return overlap, norm

    def _shape(self, points: FloatArray, x_m: FloatArray, middle: float) -> FloatArray:
        """The target shape at points (q, 2 or 3) of cells about x_m (c,), (c, q)."""
        x, y = x_m[:, None] + points[:, 0], np.broadcast_to(points[:, 1] + middle, (len(x_m), len(points)))
        return target_shape(self.design, np.column_stack([x.ravel(), y.ravel()])).reshape(x.shape)


@dataclass(frozen=True)
class Faces:
    """Integrals of u_z^2 over zone, passive face and the plate beyond the last row as forms (n, n), and their areas in m2.

    overlap (n,): with the target shape, norm: the integral of its square; factor: rho h over the unit of mass.
    """

    forms: list[FloatArray]
    areas: list[float]
    overlap: FloatArray
    norm: float
    factor: float

    def among(self, vectors: FloatArray) -> Faces:
        """The same among modes (n, k)."""
        forms = [vectors.T @ form @ vectors for form in self.forms]
        return replace(self, forms=forms, overlap=self.overlap @ vectors)

    def measured(self, vectors: FloatArray) -> Confinement:
        """How well modes (n, k) hold the target shape, as `measure` has it of a whole plate."""
        squares = [np.einsum("ik,ik->k", vectors, form @ vectors) for form in self.forms]
        return confined(squares, self.areas, (self.overlap @ vectors) ** 2 / self.norm, self.factor)


@dataclass(frozen=True)
class FiniteModes:
    """Modes of a finite plate: eigenvalues (k,), M-orthonormal vectors (n, k) among the trial functions, the stiffness of the
    zone's panels and of the rows' cells (k, k) and the touch face's forms among the modes.
    """

    scale: Scale
    values: FloatArray
    zone: FloatArray
    rows: FloatArray
    vectors: FloatArray
    faces: Faces

    def detuned(self, zone: float = 0.0, rows: float = 0.0) -> tuple[FloatArray, FloatArray, Confinement]:
        """Frequencies (k,) in Hz, vectors (k, k) among the modes and their measures, where the zone and the rows, each
        alone, would ring higher by relative changes.
        """
        values, turn = self.values, np.eye(len(self.values))
        if zone or rows:
            values, turn = np.linalg.eigh(np.diag(self.values) + 2.0 * (zone * self.zone + rows * self.rows))
        return self.scale.frequency(values), turn, self.faces.measured(turn)


def _condense(pair: Pair, kept: int, top: float, about: float) -> Step:
    """Drop all but the first `kept` degrees of freedom; modes of the rest up to the eigenvalue `top` stay.

    What the other modes answer is exact at the eigenvalue `about` (leung1978): errors grow with the square of the distance.
    """
    stiffness, mass = (matrix[kept:, kept:] for matrix in pair)
    pull = pair[0][kept:, :kept] - about * pair[1][kept:, :kept]
    if _is_stiffer(stiffness, mass, top):
        modes = np.empty((len(mass), 0))
        static = -cho_solve(cho_factor(stiffness - about * mass), pull)
    else:
        values, modes = eigh(stiffness, mass, driver="gvd")
        low = values <= top
        static = -(modes[:, ~low] / (values[~low] - about)) @ (modes[:, ~low].T @ pull)
        modes = modes[:, low]
    shapes = np.block([[np.eye(kept), np.zeros((kept, modes.shape[1]))], [static, modes]])
    k, m = (shapes.T @ matrix @ shapes for matrix in pair)
    return Step(static, modes, (k + k.T) / 2.0, (m + m.T) / 2.0)


def real_basis(row: Row) -> ComplexArray:
    """Transform the degrees of freedom [lower edge, upper edge, inner] of a row to those that make its matrices real.

    What lies on a panel's middle is its own image, with or without a sign: a factor 1 or i. A line between two panels is
    the image of the other one: u = r + i t there, and its image sign (r - i t).

    Parameters
    ----------
    row : Row
        Cells of one pitch and the wavenumber along x.

    Returns
    -------
    ndarray, shape (row dof, row dof)
        Complex, unitary.
    """
    face, cells = row.cell.interface, row.periodic.cells
    count, edge, width = len(cells), row.edge, row.cell.size_m[0]
    step, sign = edge // count, face.mirror(0)[1]
    out = np.zeros((row.transform.shape[1],) * 2, dtype=complex)
    for first, each, own in (
        (0, step, face.vertex(0)), (edge, step, face.vertex(0)), (2 * edge, face.side_block, face.side(0))
    ):  # fmt: skip
        places = first + each * np.arange(count)[:, None] + np.arange(len(own))
        near, s = np.exp(-0.5j * row.kx * width), sign[own]
        if count == 1:
            out[places[0], places[0]] = near * np.where(s > 0, 1.0, 1.0j)
            continue
        (one, other), far = places, near.conj()
        out[one, one], out[one, other] = ROOT * near, 1j * ROOT * near
        out[other, one], out[other, other] = ROOT * far * s, -1j * ROOT * far * s
    start = 2 * edge + count * face.side_block
    for index, cell in enumerate(cells):
        turn, across = (
            np.exp(1j * row.kx * width * index),
            index * step + face.vertex_block + np.arange(face.side_block),
        )
        inner = start + np.arange(len(cell.fixed_hz))
        for places in (across, edge + across):
            out[places, places] = turn * np.where(sign[face.side(2)] > 0, 1.0, 1.0j)
        out[inner, inner] = turn * np.where(cell.fixed_parity[:, 0] >= 0, 1.0, 1.0j)
        start += len(inner)
    return out


def real_row(row: Row) -> Pair:
    """Build K and M of a row in the degrees of freedom of `real_basis`.

    Only modes of equal parity of a cell's inside are coupled: their factors are alike, and drop out.

    Parameters
    ----------
    row : Row
        Cells of one pitch and the wavenumber along x.

    Returns
    -------
    tuple of ndarray, shape (dof, dof)
        Real, scaled.
    """
    cells, count = row.periodic.cells, row.cell.interface.count
    dof = row.transform.shape[1]
    start = width = dof - sum(len(cell.fixed_hz) for cell in cells)
    basis, out = real_basis(row)[:width, :width], np.zeros((2, dof, dof))
    for index, (cell, own) in enumerate(row.periodic.parts(row.transform)):
        turned = np.exp(-1j * row.kx * cell.size_m[0] * index) * (own[:count, :width] @ basis)
        odd = cell.fixed_parity[:, 0] < 0
        inner = start + np.arange(len(odd))
        for whole, matrix in zip(out, (cell.stiffness, cell.mass), strict=True):
            whole[:width, :width] += sum(part.T @ matrix[:count, :count] @ part for part in (turned.real, turned.imag))
            for part, those in ((turned.real, ~odd), (turned.imag, odd)):
                across = part.T @ matrix[:count, count:][:, those]
                whole[:width, inner[those]], whole[inner[those], :width] = across, across.T
            whole[np.ix_(inner, inner)] = np.where(odd[:, None] == odd, matrix[count:, count:], 0.0)
        start += len(inner)
    return out[0], out[1]


def _stiff_inside(cell: Cell, top: float, about: float) -> tuple[Cell, FloatArray]:
    """The cell whose fixed-interface modes beyond the eigenvalue `top` answer as at `about`, and its degrees of freedom as
    motions of the cell, (dof, kept). It is the same at every wavenumber.
    """
    b = cell.interface.count
    stiffness, mass = (np.diag(matrix)[b:] for matrix in (cell.stiffness, cell.mass))
    low = stiffness <= top * mass
    kept = b + np.flatnonzero(low)
    shapes = np.zeros((cell.dof, b + len(kept)))
    shapes[:b, :b], shapes[kept, np.arange(b, shapes.shape[1])] = np.eye(b), 1.0
    shapes[b + np.flatnonzero(~low), :b] = (about / (stiffness - about * mass))[~low, None] * cell.mass[b:, :b][~low]
    k, m = (shapes.T @ matrix @ shapes for matrix in (cell.stiffness, cell.mass))
    k, m = ((matrix + matrix.T) / 2.0 for matrix in (k, m))
    return replace(cell, stiffness=k, mass=m, fixed_hz=cell.fixed_hz[low], fixed_parity=cell.fixed_parity[low]), shapes


def wavenumbers(design: Design) -> FloatArray:
    """List the wavenumbers along x of the trial functions of the target mode's class.

    Parameters
    ----------
    design : Design
        Length and nodal lines of the zone.

    Returns
    -------
    ndarray, shape (j,)
        In rad/m.
    """
    lines = design.nodal_lines
    last = ceil(BEYOND * (max(lines, 2) - 0.5 + MORE))
    return np.asarray(pi / (BEYOND * design.length_m) * np.arange(lines % 2, last + 1), dtype=float)


def _without_pillar(bare: Cell, boundary: FloatArray, about: float) -> FloatArray:
    """A bare cell's motion (dof, n) at the eigenvalue `about` where its boundary moves by (b, n)."""
    b = len(boundary)
    values = np.diag(bare.stiffness)[b:]
    return np.vstack([boundary, (about / (values - about))[:, None] * (bare.mass[b:, :b] @ boundary)])


def _is_stiffer(stiffness: FloatArray, mass: FloatArray, eigenvalue: float) -> bool:
    """Whether no eigenvalue lies at or below one."""
    try:
        np.linalg.cholesky(stiffness - eigenvalue * mass)
    except np.linalg.LinAlgError:
        return False
    return True


def _middles(design: Design, pitch_m: float) -> FloatArray:
    """x of the middles of a plate's whole cells, m: pillars stand there."""
    if design.rows:
        return design.column_centres()
    count = max(round(design.length_m / pitch_m), 1)
    return np.asarray((np.arange(count) - (count - 1) / 2.0) * pitch_m)


def _piece(columns: Sequence[Column], vectors: Sequence[ComplexArray], number: int, lines_m: Sequence[float]) -> Piece:
    """The column's cell of a number with its motion about its own middle in every trial function."""
    parts = []
    for column, own in zip(columns, vectors, strict=True):
        place = column.placed_cells[number]
        turn = np.exp(-1j * column.kx * place.row.periodic.middles_m[place.index])
        parts.append(turn * column.cell_vectors(place, own))
    motion, place = np.hstack(parts), columns[0].placed_cells[number]
    even, odd = (np.ascontiguousarray(part) for part in (motion.real, motion.imag))
    touch = _at_quadrature(place.cell.touch, [line - place.middle for line in lines_m])
    strip = columns[0].strips[number // len(columns[0].strips[0])]
    part = 2 if any(panel.foot for panel in strip) else int(abs(place.middle) < columns[0].design.width_m / 2.0)
    return Piece(place.cell, place.middle, even, odd, strip[place.index].foot is None, place.index, part, touch)


def _at_quadrature(touch: Expansion, lines_m: Sequence[float]) -> SurfaceRule:
    """A quadrature over a touch face that is parted at lines y = const of the cell, with u_z at its own points."""
    rule = touch.rule(lines_m)
    if rule.interpolation is None:
        return rule
    return replace(rule, normal=np.asarray(rule.interpolation @ rule.normal), interpolation=None)


def _inside(
    touch: SurfaceRule, middle: float, own: Callable[[FloatArray], BoolArray]
) -> tuple[IntArray, FloatArray, FloatArray]:
    """Which points of a touch face lie in a part of the plate by |y|; their weights, and u_z there by degrees of freedom."""
    at = np.flatnonzero(own(np.abs(touch.points[:, 1] + middle)))
    return np.asarray(at), touch.weights[at], touch.normal[at]
