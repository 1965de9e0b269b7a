"""How a plate of reduced panels gives way beneath a patch more than its own degrees of freedom tell.

F = N K^-1 N' - E K_r^-1 E': static displacements per force of the bonded face on a fine mesh of all panels beneath the patch,
graded towards its edges, less the same of those panels' reduced matrices, both with the border around these panels clamped
(macneal1971). What the patch does to them beyond that border the reduced plate itself tells.
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import product

import numpy as np
import scipy.sparse as sp

from geometry.elements import FloatArray, IntArray
from geometry.hex.boxes import Boxes, bonded_boxes, hex_mesh
from geometry.hex.scenes import HexSettings
from geometry.layout import Design, Stand, mirrored_axes
from geometry.materials import Material
from geometry.mesh import Mesh
from geometry.tiling import Tiling, signature
from solvers.accuracy.mesh import Shares, rim_shares
from solvers.errors import TooLarge
from solvers.fem.assembly import System
from solvers.fem.factor.factoriser import Factoriser, side_by_side
from solvers.fem.solid import constrain, free_mask
from solvers.piezo import patch as piezo_patch
from solvers.piezo.bond import SAME_M, Contact, JoinedPanels, Panels, between, grid_weights, mirror_signs, positive_part
from solvers.piezo.patch import BondedPatch
from solvers.plates.assembled import Cache, Reductions
from solvers.superelement.plate import AssembledPlate

WAVE = 3.75  # elements along a half-wavelength of the target shape, at least
FOOT = 0.5  # of foot and thickness, the longest element of a patch over pillars: its plate bends between their feet
COLUMNS = 240  # of forces solved for at once
ROUGH = 0.35  # of the share: one radial function stands for both bodies at all edges and corners of a patch


@dataclass
class Beneath:
    """Flexibility beneath the patches of one plate; places alike are computed once, and none that the cache has."""

    reductions: Reductions
    cache: Cache[FloatArray] | None = None
    _known: dict[str, FloatArray] = field(default_factory=dict)

    def flexibility(self, plate: AssembledPlate, patch: BondedPatch, back: bool) -> FloatArray:
        """F at the nodes of a patch's bonded face, (3 b, 3 b), in the plate's scale. Raises SolverError for a panel that
        carries a pillar there.
        """
        return self._lacking(plate, _Place.of(plate, patch, self.reductions, back))

    def shares(self, patch: BondedPatch) -> Shares:
        """What of the mesh's error beneath a patch the mesh without its innermost layer tells."""
        ceramic = patch.material
        alike = Material.isotropic(ceramic.name, 1.0 / ceramic.s11, ceramic.density_kg_m3, -ceramic.s12 / ceramic.s11)
        shares = rim_shares(self.reductions.stack.material, alike, patch.mesh)
        return replace(shares, spread=shares.spread + ROUGH * shares.taken)

    def prepare(self, plate: AssembledPlate, patches: Iterable[BondedPatch], back: bool) -> None:
        """Compute what `flexibility` will ask for, distinct places side by side."""
        places = {place.key: place for place in (_Place.of(plate, each, self.reductions, back) for each in patches)}
        side_by_side(lambda place: self._lacking(plate, place), places.values())

    def _lacking(self, plate: AssembledPlate, place: _Place) -> FloatArray:
        """What the reduced panels lack of the fine mesh's flexibility; the positive part of it is kept."""
        if place.key not in self._known:
            name = ("lacking", *self.made_of(place.panels))
            self._known[place.key] = self.kept(name, place.key, lambda: self._more(plate, place))
        return self._known[place.key]

    def made_of(self, panels: Panels) -> tuple[object, ...]:
        """What reduced panels depend on, beside their place."""
        own, tiling = self.reductions, panels.grid.tiling
        signatures = [signature(tiling.panel(*each)) for each in panels.places]
        return type(own).__name__, own.reduction, own.mesher_name, signatures

    def _more(self, plate: AssembledPlate, place: _Place) -> FloatArray:
        fine = self.kept(("beneath",), place.key, lambda: self._static(place))
        contact = Contact(place.patch.points, place.patch.projection, place.back)
        # panels meshed finer than their patch lack nothing of it
        return positive_part(fine - JoinedPanels(place.panels, plate).flexibility(contact))

    def kept(self, what: tuple[object, ...], place: str, computed: Callable[[], FloatArray]) -> FloatArray:
        """A symmetric matrix of a place from the cache, or computed and kept there."""
        own = self.reductions
        name = repr((what, place, own.stack, own.pillar))
        key = hashlib.sha256(name.encode()).hexdigest()
        kept = self.cache.get(key) if self.cache is not None else None
        if kept is not None:
            return kept
        matrix = computed()
        if self.cache is not None:
            self.cache.put(key, matrix)
        return matrix

    def _static(self, place: _Place) -> FloatArray:
        """N K^-1 N' on the fine mesh, one mirror class after the other where the place is its own mirror image."""
        system = self.reductions.system(place.fine_mesh)
        classes = product("SA", repeat=len(place.mirrors))
        given = sum(
            self._static_class(place, system, dict(zip(place.mirrors, marks, strict=True))) for marks in classes
        )
        return np.asarray((given + np.transpose(given)) / 2.0)

    def _static_class(self, place: _Place, system: System, marks: Mapping[int, str]) -> FloatArray:
        """The same of the fields of one class, S or A about each axis; loads that mirror each other are solved for once."""
        mesh = system.mesh
        planes = {("x-", "y-")[axis]: mark for axis, mark in marks.items()}
        pencil = constrain(system, free_mask(mesh, set(place.panels.clamped) - set(planes), planes))
        turned, means = place.distinct("".join(marks.get(axis, "S") for axis in (0, 1)))
        loads = sp.csc_array(means[:, np.flatnonzero(pencil.free)].T)
        try:
            factor = Factoriser()(sp.csc_array(pencil.stiffness))
        except TooLarge as fault:
            size = " x ".join(f"{1e3 * each:g}" for each in np.diff(place.box_m)[::2])
            pillars = sum(len(each.centres) for each in place.stands)
            raise TooLarge(f"a patch of {size} mm over {pillars} pillars: {fault}; take shorter patches") from fault
        parts = np.array_split(np.arange(loads.shape[1]), -(-loads.shape[1] // COLUMNS))
        given = np.hstack([loads.T @ factor.solve(loads[:, part].toarray()) for part in parts])
        return np.asarray(turned @ (turned @ given).T) / 2.0 ** len(marks)


def patch_mesh(design: Design, tiling: Tiling, box_m: FloatArray) -> HexSettings:
    """Elements of a patch on the rectangle box_m: as short as the target shape asks for, over pillars as their feet and the
    plate between them do.
    """
    size = design.line_spacing_m / WAVE
    if pillars_beneath(tiling, box_m):
        size = min(size, FOOT * min([design.thickness_m, *(pillar.footprint_m for pillar in design.kinds)]))
    return replace(piezo_patch.MESH, size_m=size)


def pillars_beneath(tiling: Tiling, box_m: FloatArray) -> list[tuple[int, int]]:
    """Panels (i, j) with a pillar, on either side of the plate, that a rectangle x0, x1, y0, y1 in m overlaps."""
    x, y = (between(lines, ends, 0.0) for lines, ends in zip((tiling.x, tiling.y), box_m.reshape(2, 2), strict=True))
    return [(i, j) for i, j in tiling.feet if x[0] <= i <= x[1] and y[0] <= j <= y[1]]


@dataclass(frozen=True)
class _Place:
    """A patch on the panels beneath it, with their pillars."""

    panels: Panels
    stands: tuple[Stand, ...]
    patch: BondedPatch
    back: bool
    thickness_m: float

    @classmethod
    def of(cls, plate: AssembledPlate, patch: BondedPatch, reductions: Reductions, back: bool) -> _Place:
        """Where a patch is bonded to a plate of such panels."""
        panels = Panels.beneath(plate.grid, patch.box_m, reductions.stack.thickness_m)
        return cls(panels, panels.stands(reductions.pillar), patch, back, reductions.stack.thickness_m)

    @cached_property
    def mirrors(self) -> tuple[int, ...]:
        """The axes about which panels, pillars, clamped sides, patch and the elements are their own mirror image."""
        clamped, boxes = self.panels.clamped, self._boxes(())
        bodies = [self.box_m[None], *(np.repeat(each.centres, 2, axis=1) for each in self.stands)]
        even = np.all([mirrored_axes(each) for each in bodies], axis=0)
        return tuple(
            axis
            for axis, (name, lines) in enumerate(zip("xy", (boxes.x, boxes.y), strict=True))
            if (f"{name}-" in clamped) == (f"{name}+" in clamped)
            and even[axis]
            and np.abs(lines).min() < SAME_M
            and (not self.stands or self.panels.grid.tiling.mirrored)
        )

    @cached_property
    def fine_mesh(self) -> Mesh:
        """Panels and pillars about their middle, graded towards the patch's edges; of a mirrored place what lies beyond 0."""
        return hex_mesh(self._boxes(self.mirrors), self.patch.mesh.order)

    def _boxes(self, mirrors: tuple[int, ...]) -> Boxes:
        span, axes = self.panels.span_m.copy(), list(mirrors)
        span.reshape(2, 2)[axes, 0] = 0.0
        stands = tuple(
            Stand(each.pillar, each.centres[(each.centres[:, axes] > -each.pillar.footprint_m / 2.0).all(axis=1)])
            for each in self.stands
        )
        return bonded_boxes(span, self.thickness_m, stands, self.box_m, self.back, self.patch.mesh)

    def distinct(self, symmetry: str) -> tuple[sp.csr_array, sp.csr_array]:
        """What makes the motion of all nodes of the bonded face, (3 b, 3 a), of that of those which are no other's image, in
        fields of one class; and that one as means of u at the fine mesh's nodes, (3 a, 3 n).
        """
        mesh, project, points = self.fine_mesh, self.patch.projection, self.patch.points - self.panels.middle_m
        folded, flips = self._folded(points)
        on = np.flatnonzero(np.abs(mesh.nodes[:, 2] - (self.thickness_m if self.back else 0.0)) < SAME_M)
        weights = grid_weights(mesh.nodes[on, :2], mesh.order, folded)
        own, turned = self._images(project @ points, symmetry)
        signs = mirror_signs(symmetry, flips)
        parts = [sp.coo_array(project[own] @ (signs[:, axis, None] * weights)) for axis in range(3)]
        rows = np.concatenate([3 * part.row + axis for axis, part in enumerate(parts)])
        columns = np.concatenate([3 * on[part.col] + axis for axis, part in enumerate(parts)])
        values = np.concatenate([part.data for part in parts])
        return turned, sp.csr_array((values, (rows, columns)), shape=(3 * len(own), 3 * len(mesh.nodes)))

    def _folded(self, places_m: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Places (p, 2) beyond the mirrors, and the axes (p, 2) along which they were turned round, -1."""
        flips = np.ones_like(places_m)
        for axis in self.mirrors:
            flips[places_m[:, axis] < -SAME_M, axis] = -1.0
        return places_m * flips, flips

    def _images(self, nodes_m: FloatArray, symmetry: str) -> tuple[IntArray, sp.csr_array]:
        """Which nodes (b, 2) are no other's image, (a,), and the motion of all of them by theirs, (3 b, 3 a)."""
        folded, flips = self._folded(nodes_m)
        places = np.round(folded / SAME_M) + 0.0  # no zero below zero
        _, own, which = np.unique(places, axis=0, return_index=True, return_inverse=True)
        signs = mirror_signs(symmetry, flips)
        columns = (3 * which.ravel()[:, None] + np.arange(3)).ravel()
        values = (signs * signs[own][which.ravel()]).ravel()
        shape = (3 * len(nodes_m), 3 * len(own))
        return own, sp.csr_array((values, (np.arange(shape[0]), columns)), shape=shape)

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
