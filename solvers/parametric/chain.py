"""Modes of one column of cells, its rows condensed one after another from the plate's middle outwards.

The mirror x -> -x followed by conjugation leaves waves of a real wavenumber alone: in the coordinates that it keeps, K and M of
a row are real. Of two panels in a pitch it exchanges the lines between them. Every step keeps the edge that the next row shares
and the modes of what lies behind it, that edge fixed, up to REACH times the window's top, so that no eigenvalue problem is
larger than some hundred degrees of freedom.

Modes beyond that answer as at one eigenvalue s. One of eigenvalue l_i and modal participation p_i is then off by
p_i (l - s) / l_i at an eigenvalue l, which raises l by sum_i p_i^2 (l - s)^2 / (l_i l) of itself at most, the p_i^2 together
by less than 1. At both ends of a window that is the same, and no more than 1 / REACH^2, where s is the geometric mean of the
ends; with the arithmetic mean it has no bound as the lower end falls.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import sqrt

import numpy as np
from scipy.linalg import cho_factor, cho_solve, eigh

from geometry.elements import ComplexArray, FloatArray, IntArray
from solvers.plates.column import Column
from solvers.superelement.cell import Cell
from solvers.superelement.lattice import Periodic
from solvers.threads import one_thread
from solvers.waves.complex_bands import Row

ROOT = float(np.sqrt(0.5))
REACH = 9.0  # of the top of the window
Pair = tuple[FloatArray, FloatArray]


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


def condense(pair: Pair, kept: int, top: float, about: float) -> Step:
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


def _is_stiffer(stiffness: FloatArray, mass: FloatArray, eigenvalue: float) -> bool:
    """Whether no eigenvalue lies at or below one."""
    try:
        np.linalg.cholesky(stiffness - eigenvalue * mass)
    except np.linalg.LinAlgError:
        return False
    return True


def real_basis(row: Row) -> ComplexArray:
    """The degrees of freedom [lower edge, upper edge, inner] of a row, (row dof, n), in those that make its matrices real.

    What lies on a panel's middle is its own image, with or without a sign: a factor 1 or i. A line between two panels is
    the image of the other one: u = r + i t there, and its image sign (r - i t).
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
    """K and M of a row among the degrees of freedom that `real_basis` turns into its own.

    Of a cell's inside only modes of like parity meet: their factors are alike, and drop out.
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


def stiff_inside(cell: Cell, top: float, about: float) -> tuple[Cell, FloatArray]:
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
            step = condense(real_row(row), 2 * row.edge, top, about)
            self.rows[key] = CondensedRow(row, step, [shapes for _, _, shapes in parts])
        return self.rows[key]

    def _stiff(self, cell: Cell, top: float, about: float) -> tuple[Cell, Cell, FloatArray]:
        at = id(cell), top, about
        if at not in self.cells:
            self.cells[at] = cell, *stiff_inside(cell, top, about)  # the cell itself, lest another takes its id
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
        self.steps.append(condense((whole[0], whole[1]), e, self.top, self.about))

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
