"""Bonds on an assembled plate: displacements at points of its bare faces, and the panels beneath."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import product

import numpy as np
import scipy.sparse as sp
from scipy.linalg import cho_factor, cho_solve, eigh

from geometry.elements import BoolArray, FloatArray, IntArray
from geometry.layout import Pillar, PillarGroup
from solvers.errors import SolverError
from solvers.fem.surface import SAME_M, grid_weights
from solvers.superelement.cell import Cell, PlacedCell
from solvers.superelement.interface import SIDES, VERTICES
from solvers.superelement.plate import WHOLE, AssembledPlate, Grid

# -- points ------------------------------------------------------------------------------------------------------------
# Displacements of an assembled plate at any point of its bare faces, where something may be bonded.


@dataclass(frozen=True)
class Contact:
    """Contact with a bare face of the plate: points (p, 2) in m on its back (z = thickness) or its touch face, and
    the means (b, p) of u at them that it feels.
    """

    points: FloatArray
    means: FloatArray
    back: bool


def displacement_at(plate: AssembledPlate, contact: Contact) -> sp.csr_array:
    """Build the rows that give the means of u over a contact.

    In a symmetry class, points on the negative sides follow from the mirrors.

    Parameters
    ----------
    plate : AssembledPlate
        One symmetry class.
    contact : Contact
        Points in m and the weights of b means.

    Returns
    -------
    sparse array, shape (3 b, dof)
        Rows.

    Raises
    ------
    SolverError
        For a point outside the plate or on a panel that carries a pillar.
    """
    return displacement_on(plate, list(panel_contacts(plate, contact)), len(contact.means))


def displacement_on(plate: AssembledPlate, panels: Sequence[PanelContact], count: int) -> sp.csr_array:
    """Build the rows of `displacement_at` for a contact on known panels of this or another class.

    Parameters
    ----------
    plate : AssembledPlate
        One symmetry class.
    panels : sequence of PanelContact
        From `panel_contacts`.
    count : int
        Number b of means.

    Returns
    -------
    sparse array, shape (3 b, dof)
        Rows.
    """
    values, rows, columns = [], [], []
    for panel in panels:
        placed_cell = plate.placed_cells[panel.number]
        signs = mirror_signs(plate.symmetry, panel.flip)[:, None]
        live = placed_cell.coefficient != 0.0
        field = signs * (panel.field[:, :, live] * placed_cell.coefficient[live])
        block = sp.coo_array(field.reshape(3 * len(panel.rows), -1))
        values.append(block.data)
        rows.append((3 * panel.rows[:, None] + np.arange(3)).ravel()[block.row])
        columns.append(placed_cell.dofs[live][block.col])
    places = (np.concatenate(rows), np.concatenate(columns))
    return sp.csr_array((np.concatenate(values), places), shape=(3 * count, plate.dof))


@dataclass(frozen=True)
class PanelContact:
    """Part of a contact on one panel of the whole plate: the number and place of the cell that stands for it, the mirrors
    (2,) that carry it there, and the contact's means of u that feel it (rows, (b,)) from that cell's degrees of freedom,
    (b, 3, dof).
    """

    number: int
    placed_cell: PlacedCell
    flip: FloatArray
    rows: IntArray
    field: FloatArray


def panel_contacts(plate: AssembledPlate, contact: Contact) -> Iterator[PanelContact]:
    """Split a contact by panels; a panel on a mirror line is its own image and holds its points as they are.

    Parameters
    ----------
    plate : AssembledPlate
        One symmetry class.
    contact : Contact
        Points in m and the weights of means.

    Yields
    ------
    PanelContact
        One per panel and mirror image.

    Raises
    ------
    SolverError
        For a point outside the plate.
    """
    left = np.ones(len(contact.points), dtype=bool)
    for number, placed_cell in enumerate(plate.placed_cells):
        middle, half = np.array(placed_cell.middle), np.array(placed_cell.cell.size_m[:2]) / 2.0
        alone = (plate.symmetry == WHOLE) | (middle < half / 2.0)
        for flip in map(np.array, product(*((1.0,) if own else (1.0, -1.0) for own in alone))):
            local = contact.points * flip - middle
            inside = left & (np.abs(local) <= half + SAME_M).all(axis=1)
            if inside.any():
                left &= ~inside
                rows = np.flatnonzero(contact.means[:, inside].any(axis=1))
                means = contact.means[np.ix_(rows, inside)]
                yield PanelContact(
                    number, placed_cell, flip, rows, _field(placed_cell.cell, local[inside], means, contact.back)
                )
    if left.any():
        raise SolverError(f"the point {1e3 * contact.points[left][0]} mm lies outside the plate")


def mirror_signs(symmetry: str, flip: FloatArray) -> FloatArray:
    """Compute the signs of u_x, u_y, u_z of a class's field relative to those at its image in x, y >= 0.

    Parameters
    ----------
    symmetry : str
        Symmetry class.
    flip : ndarray, shape (..., 2)
        -1 where x or y is negative, else 1.

    Returns
    -------
    ndarray, shape (..., 3)
        +1 or -1.
    """
    signs = np.ones((*flip.shape[:-1], 3))
    for axis, mark in enumerate(symmetry):
        turned = flip[..., axis] < 0.0
        signs *= np.where(turned & (mark != "S"), -1.0, 1.0)[..., None]
        signs[..., axis] *= np.where(turned, -1.0, 1.0)
    return signs


def _field(cell: Cell, local_m: FloatArray, means: FloatArray, back: bool) -> FloatArray:
    """Means (b, p) of u at places (p, 2) of a face from the cell's degrees of freedom, (b, 3, dof).

    Raises SolverError where the face carries a pillar or does not form a tensor grid.
    """
    level, bare = cell.size_m[2] if back else 0.0, cell.bare
    if bare is None or bare.order is None:
        what = "about a round or hexagonal pillar, or of tetrahedra,"
        raise SolverError(
            f"the faces of a panel {what} do not form a tensor grid: nothing can be bonded to it or touch it"
        )
    on = np.flatnonzero(np.abs(bare.points[:, 2] - level) < SAME_M)
    if not len(on):
        raise SolverError("a patch lies on a panel of plate that carries a pillar: move the patch or the rows")
    weights = means @ grid_weights(bare.points[on, :2], bare.order, local_m)
    return np.tensordot(weights, bare.matrix[on], axes=1)


# -- panels ------------------------------------------------------------------------------------------------------------
# The reduced panels beneath a patch: which ones, where they are clamped, and their own stiffness, mass and motion.


@dataclass(frozen=True)
class Panels:
    """A rectangle of the whole plate's panels: columns and rows (first, last), both included."""

    grid: Grid
    columns: tuple[int, int]
    rows: tuple[int, int]

    @classmethod
    def beneath(cls, grid: Grid, box_m: FloatArray, reach_m: float) -> Panels:
        """The panels that a box touches, and bare ones within a reach around it, where it is still felt."""

        def spans(reach: float) -> list[tuple[int, int]]:
            sides = zip((grid.tiling.x, grid.tiling.y), box_m.reshape(2, 2), strict=True)
            return [between(lines, ends, reach) for lines, ends in sides]

        def bare(columns: tuple[int, int], rows: tuple[int, int]) -> bool:
            return not any(place in grid.tiling.feet for place in cls(grid, columns, rows).places)

        ((left, right), (low, high)), ((first, last), (lowest, highest)) = spans(0.0), spans(reach_m)
        while left > first and bare((left - 1, left - 1), (low, high)):
            left -= 1
        while right < last and bare((right + 1, right + 1), (low, high)):
            right += 1
        while low > lowest and bare((left, right), (low - 1, low - 1)):
            low -= 1
        while high < highest and bare((left, right), (high + 1, high + 1)):
            high += 1
        return cls(grid, (left, right), (low, high))

    @property
    def places(self) -> list[tuple[int, int]]:
        """Their numbers along x and y."""
        columns, rows = (range(first, last + 1) for first, last in (self.columns, self.rows))
        return list(product(columns, rows))

    @property
    def _ends(self) -> FloatArray:
        tiling = self.grid.tiling
        pairs = zip((tiling.x, tiling.y), (self.columns, self.rows), strict=True)
        return np.array([end for lines, (first, last) in pairs for end in (lines[first], lines[last + 1])])

    @property
    def middle_m(self) -> FloatArray:
        """The middle of all of them, (2,)."""
        return np.asarray(self._ends.reshape(2, 2).mean(axis=1))

    @property
    def span_m(self) -> FloatArray:
        """x0, x1, y0, y1 from that middle."""
        return np.asarray(self._ends - np.repeat(self.middle_m, 2))

    @property
    def clamped(self) -> tuple[str, ...]:
        """Clamped sides: those where panels go on, and the plate's own clamped edges; all of them where nothing else would
        support the panels.
        """
        last = (self.grid.nx - 1, self.grid.ny - 1)
        held = {each.edge for each in self.grid.tiling.supports if each.kind == "clamp"}
        inner = [
            side
            for side, own, end in zip(SIDES, (*self.columns, *self.rows), (0, last[0], 0, last[1]), strict=True)
            if own != end or side in held
        ]
        return tuple(inner) or SIDES

    def stands(self, pillar: Pillar | None) -> tuple[PillarGroup, ...]:
        """The pillars on them, from their middle."""
        feet = self.grid.tiling.feet
        carrying = [place for place in self.places if place in feet]
        kinds: dict[Pillar | None, list[tuple[float, float]]] = {}
        for place in carrying:
            kinds.setdefault(self.grid.tiling.panel(*place).pillar or pillar, []).append(feet[place])
        return tuple(PillarGroup(kind, np.array(centres) - self.middle_m) for kind, centres in kinds.items() if kind)

    def clamped_dofs(self, i: int, j: int) -> IntArray:
        """Boundary degrees of freedom of panel (i, j), in its own order, on its clamped sides."""
        at = dict(
            zip(SIDES, (i == self.columns[0], i == self.columns[1], j == self.rows[0], j == self.rows[1]), strict=True)
        )
        sides = {side for side in self.clamped if at[side]}
        face = self.grid.interface
        dofs = [face.side(SIDES.index(side)) for side in sides]
        for index, (x, y) in enumerate(VERTICES):
            if sides & {"x+" if x > 0 else "x-", "y+" if y > 0 else "y-"}:
                dofs.append(face.vertex(index))
        return np.concatenate(dofs) if dofs else np.empty(0, dtype=np.int64)


class JoinedPanels:
    """Panels of a plate joined with one another alone: their boundary degrees of freedom and fixed-interface modes, numbered
    from 0, their `numbers` (n,) in the plate's grid, and K of all of them, (n, n), in the plate's scale.
    """

    def __init__(self, panels: Panels, plate: AssembledPlate) -> None:
        self.panels, self.plate = panels, plate
        dofs = [panels.grid.dofs(i, j) for i, j in panels.places]
        known, number = np.unique(np.concatenate(dofs), return_inverse=True)
        places = np.split(number, np.cumsum([len(each) for each in dofs])[:-1])
        self.count, self.numbers, self._own = len(known), known, dict(zip(panels.places, places, strict=True))
        self._turned = {place: _turned(panels.grid, *place) for place in panels.places}
        self.stiffness = self._summed()

    @property
    def free(self) -> BoolArray:
        """Mask of the degrees of freedom that the clamped sides leave free, (n,)."""
        free = np.ones(self.count, dtype=bool)
        for place, own in self._own.items():
            free[own[self.panels.clamped_dofs(*place)]] = False
        return free

    def motion(self, contact: Contact) -> FloatArray:
        """The means of u that a contact feels per degree of freedom, (3 b, n)."""
        moved = np.zeros((3 * len(contact.means), self.count))
        for panel in panel_contacts(self.plate, contact):
            place = _place(self.panels.grid, np.array(panel.placed_cell.middle) * panel.flip)
            motion = panel.field * np.array([*panel.flip, 1.0])[:, None]
            rows = (3 * panel.rows[:, None] + np.arange(3)).ravel()
            moved[np.ix_(rows, self._own[place])] += motion.reshape(len(rows), -1) @ self._turned[place]
        return moved

    def flexibility(self, contact: Contact, felt: slice = slice(None)) -> FloatArray:
        """E K^-1 E' of the 3 b motions of a contact, by default all, with the clamped sides held."""
        free = self.free & (np.diag(self.stiffness) > 0.0)  # functions of free sides carry nothing
        moved = self.motion(contact)[felt][:, free]
        return np.asarray(moved @ cho_solve(cho_factor(self.stiffness[np.ix_(free, free)]), moved.T))

    def _summed(self) -> FloatArray:
        total = np.zeros((self.count,) * 2)
        for place, turn in self._turned.items():
            own = self._own[place]
            total[np.ix_(own, own)] += turn.T @ self.panels.grid.cell(*place).stiffness @ turn
        return (total + total.T) / 2.0


def positive_part(matrix: FloatArray) -> FloatArray:
    """Compute the positive part of a symmetric matrix, that of its eigenvalues above 0.

    Parameters
    ----------
    matrix : ndarray, shape (n, n)
        The matrix.

    Returns
    -------
    ndarray, shape (n, n)
        Positive semidefinite.
    """
    values, vectors = eigh((matrix + matrix.T) / 2.0)
    kept = values > 0.0
    return np.asarray((vectors[:, kept] * values[kept]) @ vectors[:, kept].T)


def between(lines: FloatArray, ends: FloatArray, reach_m: float) -> tuple[int, int]:
    """Find the first and the last interval that a span widened by a reach overlaps.

    Parameters
    ----------
    lines : ndarray, shape (n,)
        Ends of the intervals, ascending, in m.
    ends : ndarray, shape (2,)
        The span, in m.
    reach_m : float
        Widening at either end.

    Returns
    -------
    tuple of int
        Numbers of the intervals.
    """
    first = int(np.searchsorted(lines, ends[0] - reach_m + SAME_M, side="right")) - 1
    last = int(np.searchsorted(lines, ends[1] + reach_m - SAME_M, side="left")) - 1
    return max(first, 0), min(last, len(lines) - 2)


def _place(grid: Grid, at_m: FloatArray) -> tuple[int, int]:
    """The panel that a point lies on."""
    i, j = (int(np.searchsorted(lines, at)) - 1 for lines, at in zip((grid.tiling.x, grid.tiling.y), at_m, strict=True))
    return i, j


def _turned(grid: Grid, i: int, j: int) -> FloatArray:
    """Map from the degrees of freedom of panel (i, j) to those of the reduced one, its image or itself, (dof, dof)."""
    cell, face = grid.cell(i, j), grid.interface
    turn = np.eye(cell.dof)
    for axis, (own, image) in enumerate(zip((i, j), grid.positive(i, j), strict=True)):
        if own != image:
            where, sign = face.mirror(axis)
            one = np.eye(cell.dof)
            one[: face.count, : face.count] = 0.0
            one[where, np.arange(face.count)] = sign
            turn = one @ turn
    return turn
