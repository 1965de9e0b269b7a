"""A finite plate of equal columns of cells in the waves of the infinite one, both its ends free.

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
from math import ceil, pi

import numpy as np

from geometry.elements import BoolArray, ComplexArray, FloatArray, IntArray
from geometry.layout import Design
from solvers.fem.assembly import Scale
from solvers.measures.confinement import NEGLIGIBLE, Confinement, confined, target_shape
from solvers.parametric.bare import bare_cell, bare_strip
from solvers.plates.column import Column
from solvers.superelement.cell import Cell, Expansion, SurfaceRule
from solvers.threads import one_thread

BEYOND = 1.2  # half the longest period over the plate's length
MORE = 3.0  # half waves along the zone beyond the target mode's
INDEPENDENT = 1e-8  # of the largest: waves that add less to the scaled mass are told apart by rounding
STILL = 1e-9  # of the largest diagonal of the mass: at k = 0 half of the waves have no even part


def wavenumbers(design: Design) -> FloatArray:
    """Wavenumbers along x of the trial functions of the target mode's class, (j,) rad/m."""
    lines = design.nodal_lines
    last = ceil(BEYOND * (max(lines, 2) - 0.5 + MORE))
    return np.asarray(pi / (BEYOND * design.length_m) * np.arange(lines % 2, last + 1), dtype=float)


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
            moved = without_pillar(
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
        """Nothing yet of so many parts' panels, (parts, count, 2, n, n)."""
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


def without_pillar(bare: Cell, boundary: FloatArray, about: float) -> FloatArray:
    """A bare cell's motion (dof, n) at the eigenvalue `about` where its boundary moves by (b, n)."""
    b = len(boundary)
    values = np.diag(bare.stiffness)[b:]
    return np.vstack([boundary, (about / (values - about))[:, None] * (bare.mass[b:, :b] @ boundary)])


def _inside(
    touch: SurfaceRule, middle: float, own: Callable[[FloatArray], BoolArray]
) -> tuple[IntArray, FloatArray, FloatArray]:
    """Which points of a touch face lie in a part of the plate by |y|; their weights, and u_z there by degrees of freedom."""
    at = np.flatnonzero(own(np.abs(touch.points[:, 1] + middle)))
    return np.asarray(at), touch.weights[at], touch.normal[at]
