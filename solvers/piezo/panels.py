"""The reduced panels beneath a patch: which ones, where they are clamped, and their own stiffness, mass and motion."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import product

import numpy as np

from geometry.elements import BoolArray, FloatArray, IntArray
from geometry.layout import Pillar, Stand
from solvers.piezo.bond import SAME_M, Contact, panel_contacts
from solvers.superelement.interface import SIDES, VERTICES
from solvers.superelement.plate import AssembledPlate, Grid


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
        """Clamped sides: those where panels go on; all of them where the whole plate is meant, which nothing would support."""
        last = (self.grid.nx - 1, self.grid.ny - 1)
        inner = [
            side
            for side, own, end in zip(SIDES, (*self.columns, *self.rows), (0, last[0], 0, last[1]), strict=True)
            if own != end
        ]
        return tuple(inner) or SIDES

    def stands(self, pillar: Pillar | None) -> tuple[Stand, ...]:
        """The pillars on them, from their middle."""
        feet = self.grid.tiling.feet
        carrying = [place for place in self.places if place in feet]
        kinds: dict[Pillar | None, list[tuple[float, float]]] = {}
        for place in carrying:
            kinds.setdefault(self.grid.tiling.panel(*place).pillar or pillar, []).append(feet[place])
        return tuple(Stand(kind, np.array(centres) - self.middle_m) for kind, centres in kinds.items() if kind)

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
    from 0, and K of all of them, (n, n), in the plate's scale.
    """

    def __init__(self, panels: Panels, plate: AssembledPlate) -> None:
        self.panels, self.plate = panels, plate
        dofs = [panels.grid.dofs(i, j) for i, j in panels.places]
        known, number = np.unique(np.concatenate(dofs), return_inverse=True)
        places = np.split(number, np.cumsum([len(each) for each in dofs])[:-1])
        self.count, self._own = len(known), dict(zip(panels.places, places, strict=True))
        self._turned = {place: _turned(panels.grid, *place) for place in panels.places}
        self.stiffness = self._summed()

    @property
    def free(self) -> BoolArray:
        """Which of the degrees of freedom the clamped sides leave free, (n,)."""
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

    def _summed(self) -> FloatArray:
        total = np.zeros((self.count,) * 2)
        for place, turn in self._turned.items():
            own = self._own[place]
            total[np.ix_(own, own)] += turn.T @ self.panels.grid.cell(*place).stiffness @ turn
        return (total + total.T) / 2.0


def between(lines: FloatArray, ends: FloatArray, reach_m: float) -> tuple[int, int]:
    """First and last interval that a span widened by a reach overlaps."""
    first = int(np.searchsorted(lines, ends[0] - reach_m + SAME_M, side="right")) - 1
    last = int(np.searchsorted(lines, ends[1] + reach_m - SAME_M, side="left")) - 1
    return max(first, 0), min(last, len(lines) - 2)


def _place(grid: Grid, at_m: FloatArray) -> tuple[int, int]:
    """The panel that a point lies on."""
    i, j = (int(np.searchsorted(lines, at)) - 1 for lines, at in zip((grid.tiling.x, grid.tiling.y), at_m, strict=True))
    return i, j


def _turned(grid: Grid, i: int, j: int) -> FloatArray:
    """From the degrees of freedom of panel (i, j) to those of the one that was reduced, its image or itself, (dof, dof)."""
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
