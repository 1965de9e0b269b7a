"""How a plate of reduced panels gives way beneath a patch more than its own degrees of freedom tell.

F = N K^-1 N' - E K_r^-1 E': static displacements per force of the bonded face on a fine mesh of all panels beneath the patch,
graded towards its edges, less the same of those panels' reduced matrices, both with the border around these panels clamped
(macneal1971). What the patch does to them beyond that border the reduced plate itself tells.
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import product
from typing import Protocol

import numpy as np
import scipy.sparse as sp
from scipy.linalg import cho_factor, cho_solve, eigh

from geometry.elements import FloatArray, IntArray
from geometry.hex.boxes import HexSettings, bonded_boxes, hex_mesh
from geometry.layout import Design, Pillar, Stand
from geometry.materials import Material
from solvers.errors import TooLarge
from solvers.fem.coarser import OUTER, Shares, rim_shares
from solvers.fem.constraints import constrain, free_mask
from solvers.fem.factor.factoriser import Factoriser, side_by_side
from solvers.piezo import patch as piezo_patch
from solvers.piezo.bond import SAME_M, Contact, grid_weights, held_panels
from solvers.piezo.patch import BondedPatch
from solvers.superelement.build import Reductions
from solvers.superelement.interface import SIDES, VERTICES
from solvers.superelement.plate import AssembledPlate, Grid
from solvers.superelement.tiling import Tiling, signature

FOOT = 0.5  # of foot and thickness, the longest element of a patch over pillars: its plate bends between their feet
COLUMNS = 240  # of forces solved for at once
ROUGH = 0.35  # of the share: one radial function stands for both bodies at all edges and corners of a patch


class Cache(Protocol):
    """Where flexibilities are kept between runs."""

    def get(self, key: str) -> FloatArray | None:
        """A symmetric matrix kept under this key, or None."""
        ...

    def put(self, key: str, matrix: FloatArray) -> None:
        """Keep a symmetric matrix."""
        ...


@dataclass
class Beneath:
    """Flexibility beneath the patches of one plate; places alike are computed once, and none that the cache has."""

    reductions: Reductions
    cache: Cache | None = None
    _known: dict[str, FloatArray] = field(default_factory=dict)

    def flexibility(self, plate: AssembledPlate, patch: BondedPatch, back: bool) -> FloatArray:
        """F at the nodes of a patch's bonded face, (3 b, 3 b), in the plate's scale. Raises SolverError for a panel that
        carries a pillar there.
        """
        return self._lacking(plate, _Place.of(plate, patch, self.reductions, back))

    def shares(self, patch: BondedPatch) -> Shares:
        """What of the mesh's error beneath a patch the mesh without its innermost layer tells."""
        ceramic = patch.material
        alike = Material(ceramic.name, 1.0 / ceramic.s11, ceramic.density_kg_m3, -ceramic.s12 / ceramic.s11)
        shares = rim_shares(self.reductions.material, alike, patch.mesh, outer_share=OUTER)
        return replace(shares, spread=shares.spread + ROUGH * shares.taken)

    def prepare(self, plate: AssembledPlate, patches: Iterable[BondedPatch], back: bool) -> None:
        """Compute what `flexibility` will ask for, distinct places side by side."""
        places = {place.key: place for place in (_Place.of(plate, each, self.reductions, back) for each in patches)}
        side_by_side(lambda place: self._lacking(plate, place), places.values())

    def _lacking(self, plate: AssembledPlate, place: _Place) -> FloatArray:
        """What the reduced panels lack of the fine mesh's flexibility; the positive part of it is kept."""
        if place.key not in self._known:
            own, tiling = self.reductions, place.panels.grid.tiling
            panels = [signature(tiling.panel(*each)) for each in place.panels.places]
            name = ("lacking", type(own).__name__, own.reduction, own.mesher_name, panels)
            self._known[place.key] = self._kept(place, name, lambda: self._more(plate, place))
        return self._known[place.key]

    def _more(self, plate: AssembledPlate, place: _Place) -> FloatArray:
        fine = self._kept(place, ("beneath",), lambda: self._static(place))
        lacking = fine - _reduced(place.panels, plate, place.patch, place.back)
        values, vectors = eigh((lacking + lacking.T) / 2.0)
        more = values > 0.0  # panels meshed finer than their patch lack nothing of it
        return np.asarray((vectors[:, more] * values[more]) @ vectors[:, more].T)

    def _kept(self, place: _Place, what: tuple[object, ...], computed: Callable[[], FloatArray]) -> FloatArray:
        """A symmetric matrix of a place from the cache, or computed and kept there."""
        own = self.reductions
        name = repr((what, place.key, own.thickness_m, own.material, own.pillar))
        key = hashlib.sha256(name.encode()).hexdigest()
        kept = self.cache.get(key) if self.cache is not None else None
        if kept is not None:
            return kept
        matrix = computed()
        if self.cache is not None:
            self.cache.put(key, matrix)
        return matrix

    def _static(self, place: _Place) -> FloatArray:
        mesh_of, box, thickness = place.patch.mesh, place.box_m, self.reductions.thickness_m
        boxes = bonded_boxes(place.panels.span_m, thickness, place.stands, box, place.back, mesh_of)
        mesh = hex_mesh(boxes, mesh_of.order)
        system = self.reductions.system(mesh)
        pencil = constrain(system, free_mask(mesh, place.panels.clamped))
        on = np.flatnonzero(np.abs(mesh.nodes[:, 2] - (thickness if place.back else 0.0)) < SAME_M)
        points = place.patch.points - place.panels.middle_m
        felt = sp.coo_array(place.patch.projection @ grid_weights(mesh.nodes[on, :2], mesh_of.order, points))
        means = sp.csr_array((felt.data, (felt.row, on[felt.col])), shape=(felt.shape[0], len(mesh.nodes)))
        loads = sp.csc_array(sp.kron(means, sp.eye_array(3)))[:, np.flatnonzero(pencil.free)].T
        try:
            factor = Factoriser()(sp.csc_array(pencil.stiffness))
        except TooLarge as fault:
            size = " x ".join(f"{1e3 * each:g}" for each in np.diff(place.box_m)[::2])
            pillars = sum(len(each.centres) for each in place.stands)
            raise TooLarge(f"a patch of {size} mm over {pillars} pillars: {fault}; take shorter patches") from fault
        parts = np.array_split(np.arange(loads.shape[1]), -(-loads.shape[1] // COLUMNS))
        given = np.hstack([loads.T @ factor.solve(loads[:, part].toarray()) for part in parts])
        return np.asarray((given + given.T) / 2.0)


def patch_mesh(design: Design, tiling: Tiling, box_m: FloatArray) -> HexSettings:
    """Elements of a patch on the rectangle box_m: over pillars as short as their feet and the plate between them ask for."""
    if not pillars_beneath(tiling, box_m):
        return piezo_patch.MESH
    finest = min([design.thickness_m, *(pillar.footprint_m for pillar in design.kinds)])
    return replace(piezo_patch.MESH, size_m=min(piezo_patch.MESH.size_m, FOOT * finest))


def pillars_beneath(tiling: Tiling, box_m: FloatArray) -> list[tuple[int, int]]:
    """Panels (i, j) with a pillar, on either side of the plate, that a rectangle x0, x1, y0, y1 in m overlaps."""
    x, y = (_between(lines, ends, 0.0) for lines, ends in zip((tiling.x, tiling.y), box_m.reshape(2, 2), strict=True))
    return [(i, j) for i, j in tiling.feet if x[0] <= i <= x[1] and y[0] <= j <= y[1]]


@dataclass(frozen=True)
class _Panels:
    """A rectangle of the whole plate's panels: columns and rows (first, last), both included."""

    grid: Grid
    columns: tuple[int, int]
    rows: tuple[int, int]

    @classmethod
    def beneath(cls, grid: Grid, box_m: FloatArray, reach_m: float) -> _Panels:
        """The panels that a box touches, and bare ones within a reach around it, where it is still felt."""

        def spans(reach: float) -> list[tuple[int, int]]:
            sides = zip((grid.tiling.x, grid.tiling.y), box_m.reshape(2, 2), strict=True)
            return [_between(lines, ends, reach) for lines, ends in sides]

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
        """Sides held: those where panels go on; all of them where the whole plate is meant, which nothing would hold."""
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

    def held(self, i: int, j: int) -> IntArray:
        """Boundary degrees of freedom of panel (i, j), in its own order, on the sides that are held."""
        at = dict(
            zip(SIDES, (i == self.columns[0], i == self.columns[1], j == self.rows[0], j == self.rows[1]), strict=True)
        )
        sides = {side for side in self.clamped if at[side]}
        face = self.grid.interface
        found = [face.side(SIDES.index(side)) for side in sides]
        for index, (x, y) in enumerate(VERTICES):
            if sides & {"x+" if x > 0 else "x-", "y+" if y > 0 else "y-"}:
                found.append(face.vertex(index))
        return np.concatenate(found) if found else np.empty(0, dtype=np.int64)


@dataclass(frozen=True)
class _Place:
    """A patch on the panels beneath it, with their pillars."""

    panels: _Panels
    stands: tuple[Stand, ...]
    patch: BondedPatch
    back: bool

    @classmethod
    def of(cls, plate: AssembledPlate, patch: BondedPatch, reductions: Reductions, back: bool) -> _Place:
        """Where a patch is bonded to a plate of such panels."""
        panels = _Panels.beneath(plate.grid, patch.box_m, reductions.thickness_m)
        return cls(panels, panels.stands(reductions.pillar), patch, back)

    @property
    def box_m(self) -> FloatArray:
        """The patch from the middle of the panels."""
        return np.asarray(self.patch.box_m - np.repeat(self.panels.middle_m, 2))

    @cached_property
    def key(self) -> str:
        """Alike for places alike."""
        place = [np.round(each, 9).tolist() for each in (self.panels.span_m, self.box_m)]
        feet = [(each.pillar, each.centres.round(9).tolist()) for each in self.stands]
        return repr((place, feet, self.panels.clamped, self.back, self.patch.mesh))


def _between(lines: FloatArray, ends: FloatArray, reach_m: float) -> tuple[int, int]:
    """First and last interval that a span widened by a reach overlaps."""
    first = int(np.searchsorted(lines, ends[0] - reach_m + SAME_M, side="right")) - 1
    last = int(np.searchsorted(lines, ends[1] + reach_m - SAME_M, side="left")) - 1
    return max(first, 0), min(last, len(lines) - 2)


def _reduced(panels: _Panels, plate: AssembledPlate, patch: BondedPatch, back: bool) -> FloatArray:
    """E K_r^-1 E' of the panels' reduced matrices, (3 b, 3 b)."""
    grid = panels.grid
    dofs = [grid.dofs(i, j) for i, j in panels.places]
    known, number = np.unique(np.concatenate(dofs), return_inverse=True)
    places = np.split(number, np.cumsum([len(each) for each in dofs])[:-1])
    turned = {place: _turned(grid, *place) for place in panels.places}
    stiffness, moved = np.zeros((len(known),) * 2), np.zeros((3 * len(patch.projection), len(known)))
    free, own = np.ones(len(known), dtype=bool), dict(zip(panels.places, places, strict=True))
    for place, turn in turned.items():
        stiffness[np.ix_(own[place], own[place])] += turn.T @ grid.cell(*place).stiffness @ turn
        free[own[place][panels.held(*place)]] = False
    for held in held_panels(plate, Contact(patch.points, patch.projection, back)):
        place = _place(grid, np.array(held.placed_cell.middle) * held.flip)
        motion = held.field * np.array([*held.flip, 1.0])[:, None]
        rows = (3 * held.rows[:, None] + np.arange(3)).ravel()
        moved[np.ix_(rows, own[place])] += motion.reshape(len(rows), -1) @ turned[place]
    free &= np.diag(stiffness) > 0.0  # functions of free sides carry nothing
    own_k, own_e = stiffness[np.ix_(free, free)], moved[:, free]
    return np.asarray(own_e @ cho_solve(cho_factor((own_k + own_k.T) / 2.0), own_e.T))


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
