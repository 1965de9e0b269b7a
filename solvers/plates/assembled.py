"""Reduced cells of a design and the plates assembled from them: their meshes, the distinct ones, and the cached ones."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Sequence
from copy import copy
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import starmap
from math import ceil
from typing import Protocol, TypeVar

import numpy as np

from geometry.elements import BoolArray, FloatArray
from geometry.hex.oblique import oblique_mesh
from geometry.hex.panels import PatchedMesh, panel_mesh, transfer, with_nodes_along
from geometry.hex.scenes import HexSettings
from geometry.layout import Design, Pillar, region_materials
from geometry.materials import Material, Stack
from geometry.mesh import Mesh, check_mesh
from geometry.tiling import Panel, Signature, signature, tile
from solvers.accuracy.mesh import ErrorFractions, Nested, StressRecovery, rim_shares
from solvers.accuracy.reduction import extrapolated, recovered
from solvers.fem.assembly import Scale, System, assemble
from solvers.fem.eigen import PlainPencil
from solvers.fem.factor import parallel_map
from solvers.fem.prestress import stress_fields, with_free_stress
from solvers.fem.solid import CLASSES
from solvers.fem.surface import Skin
from solvers.measures.confinement import TouchField
from solvers.plates.held import holds_of
from solvers.plates.prestress import RestStress, buckling_factor, rest_stress
from solvers.superelement.attached import carried, with_attached
from solvers.superelement.cell import Cell, restricted
from solvers.superelement.interface import ReductionSettings
from solvers.superelement.plate import WHOLE, AssembledPlate, Grid
from solvers.superelement.reduction import CellBuilder, Coarser, SymmetryClass, reduce_cell
from solvers.superelement.sparing import needed
from solvers.superelement.supports import full_panels

HIGHEST = 4  # order of hexahedra
TETRAHEDRA = "tet"


Kept = TypeVar("Kept")


class Cache(Protocol[Kept]):
    """Store of reduced cells, or matrices, between runs."""

    def get(self, key: str) -> Kept | None:
        """Return the value stored under this key, or None."""
        ...

    def put(self, key: str, kept: Kept, /) -> None:
        """Store a value under a key."""
        ...


Meshes = Callable[[Panel], Mesh]


@dataclass
class Reductions:
    """Reduction of a plate's panels: equal panels once, cached ones not at all. `fresh` counts those computed here.

    `pillar` stands on panels with a foot that name none of their own. `mesher` meshes the panels with a pillar; without it,
    and for bare panels, structured hexahedra do. lossy: cells have their materials' loss, too; parted: the part of each of
    `materials` in their stiffness; stressed: fields of the thermal stress that supports cause, instead of that of free layers.
    """

    stack: Stack
    pillar: Pillar | None
    reduction: ReductionSettings
    cache: Cache[Cell] | None = None
    mesher: Meshes | None = None
    mesher_name: str = ""  # distinguishes one mesher's cells from another's in the cache
    lossy: bool = False
    parted: bool = False
    stressed: bool = False
    fresh: int = 0
    reused: int = 0
    matrices: Cache[FloatArray] | None = None  # of symmetric ones, by their key

    def kept(self, key: str, computed: Callable[[], FloatArray]) -> FloatArray:
        """A symmetric matrix from the cache, or computed and kept there."""
        matrix = self.matrices.get(key) if self.matrices else None
        if matrix is None:
            matrix = computed()
            if self.matrices:
                self.matrices.put(key, matrix)
        return matrix

    def cell(self, panel: Panel) -> Cell:
        """The reduced cell of a panel."""
        key = self._key(panel)
        kept = self.cache.get(key) if self.cache else None
        if kept is not None:
            self.reused += 1
            return kept
        cell = self._reduce(panel)
        self.fresh += 1
        if self.cache:
            self.cache.put(key, cell)
        return cell

    def _reduce(self, panel: Panel) -> Cell:
        reduction = self.reduction
        better: Coarser | None
        if self.mesher and panel.foot:
            mesh = self.mesher(panel)
            better = self._recovered if mesh.kind == TETRAHEDRA else None
        else:
            mesh, better = self._mesh(panel, self.settings(panel)).mesh, self.coarser(panel)
        system = self.system(mesh, self.lossy, self.materials if self.parted else ())
        if panel.attached:
            system = with_attached(system, panel.attached, self.stack.thickness_m)
        edges, fields = None if panel.edges_m is None else np.array(panel.edges_m), None
        if self.stressed:
            half_m = (np.array(panel.high) - np.array(panel.low)) / 2.0
            fields = stress_fields(mesh, region_materials(self.stack, self.pillar), self.stack, half_m, system.scale)
        return self._finished(
            reduce_cell(system, reduction.ample, reduction.top_hz, panel.halved, panel.free, better, edges, fields),
            system,
        )

    def _finished(self, cell: Cell, system: System) -> Cell:
        """The cell with the loss of a single material, restricted to the functions that are used."""
        if isinstance(system.loss, float):
            cell = replace(cell, loss=system.loss * cell.stiffness)
        return restricted(cell, self.reduction.interface) if self.reduction.further else cell

    @property
    def materials(self) -> tuple[Material, ...]:
        """The materials of plate and pillar, each once."""
        return tuple(dict.fromkeys(region_materials(self.stack, self.pillar).values()))

    def _recovered(self, cell: Cell, builder: CellBuilder, parts: list[SymmetryClass]) -> Cell:
        """The cell corrected by stress recovery on its tetrahedra."""
        system = builder.system
        recovery = StressRecovery(system.mesh, region_materials(self.stack, self.pillar), system.scale)
        return recovered(cell, builder, parts, recovery)

    def settings(self, panel: Panel) -> HexSettings:
        """The hexahedra of a panel."""
        if not panel.foot:
            return self._bare(panel)
        along = self.reduction.interface.along
        return with_nodes_along(panel, along, self.reduction.hexahedra, lambda other: self._mesh(panel, other).mesh)

    def pillar_of(self, panel: Panel) -> Pillar | None:
        """The pillar that stands on a panel with a foot."""
        return panel.pillar or self.pillar

    def _mesh(self, panel: Panel, settings: HexSettings) -> PatchedMesh:
        mesh = panel_mesh if panel.edges_m is None else oblique_mesh
        return mesh(panel, self.stack, self.pillar, settings)

    def system(self, mesh: Mesh, lossy: bool = False, parted: Sequence[Material] = ()) -> System:
        """The assembled matrices of a mesh. MeshError for one that is not sound."""
        return self._assembled(mesh, region_materials(self.stack, self.pillar), lossy, parted)

    def _assembled(self, mesh: Mesh, materials: dict[str, Material], lossy: bool, parted: Sequence[Material]) -> System:
        check_mesh(mesh)
        scale = Scale.of(self.stack.thickness_m, self.stack.mean)
        system = assemble(mesh, materials, scale, lossy, parted)
        return with_free_stress(system, self.stack) if self.stack.is_stressed and not self.stressed else system

    def coarser(self, panel: Panel) -> Coarser | None:
        """Correction of a reduced panel by coarser meshes nested in its own; None for a mesh that has none.

        Nothing is singular in a bare panel: elements of one order less estimate its error, without a correction.
        """
        settings, reduction = self.settings(panel), self.reduction
        at_rim = panel.foot is not None and self.pillar is not None and settings.layers > 0
        if panel.foot and not at_rim:
            return None

        def nested(fine: PatchedMesh, other: HexSettings) -> Nested[CellBuilder]:
            coarse = self._mesh(panel, other)
            system, field = self.system(coarse.mesh), transfer(coarse, fine)
            if panel.attached:
                system = with_attached(system, panel.attached, self.stack.thickness_m)
                field = carried(field, panel.attached)
            edges = None if panel.edges_m is None else np.array(panel.edges_m)
            return Nested(CellBuilder(system, reduction.ample, panel.halved, panel.free, edges), field)

        def extrapolate(cell: Cell, fine: CellBuilder, parts: list[SymmetryClass]) -> Cell:
            mesh = self._mesh(panel, settings)
            meshes = [replace(settings, order=settings.order - 1), *([settings.coarser] if at_rim else [])]
            lower, *layer = parallel_map(lambda other: nested(mesh, other), meshes)
            if not at_rim or self.pillar is None:
                return extrapolated(
                    cell, (fine, parts), lower, None, ErrorFractions(order=settings.order), reduction.top_hz
                )
            own = self.pillar_of(panel) or self.pillar
            shares = rim_shares(
                self.stack.back, own.material, settings, *own.joints, wall=own.wall_angle, step_m=own.step_m
            )
            return extrapolated(cell, (fine, parts), lower, layer[0], shares, reduction.top_hz)

        return extrapolate

    def _bare(self, panel: Panel) -> HexSettings:
        """Elements of a bare panel: as many along its sides as its boundary functions need, where the waves need no more.

        A polynomial of a degree needs as many nodes and one more along the side: with fewer, functions are one, and the mass
        is singular. Elements of one order less have enough nodes, too, along the sides and through the plate. Of a panel that
        is halved along both axes half as many are meshed.
        """
        settings, face = self.reduction.hexahedra, self.reduction.ample
        order = min(max(settings.order, face.through + 1), HIGHEST)
        along, through = ceil(face.along / (order - 1)), ceil(face.through / (order - 1))
        least = ceil(along / 2) if panel.halved == (0, 1) else along
        size = self.reduction.bare_size_m or settings.size_m
        return replace(settings, order=order, size_m=size, least=least, through=max(least, through))

    def _key(self, panel: Panel) -> str:
        pillar = self.pillar_of(panel) if panel.foot else None
        mesher = self.mesher_name if panel.foot else ""
        place = signature(replace(panel, pillar=None))
        more = [name for name in ("lossy", "parted", "stressed") if getattr(self, name)]
        # whose parts a cell has, and in which order, depends on the pillar that stands elsewhere, too
        others = self.materials if self.parted else ()
        text = repr((place, panel.halved, self.stack, pillar, self.reduction, mesher, *more, *others))
        return hashlib.sha256(text.encode()).hexdigest()


class PlateModel:
    """A finite plate assembled from reduced cells, symmetry class by symmetry class; whole if it is not its own
    mirror image. bytes_each: estimated memory to reduce one panel; as many are reduced at once as memory allows.
    """

    def __init__(self, design: Design, reductions: Reductions, bytes_each: float = 0.0) -> None:
        self.tiling = tile(design, reductions.reduction.max_edge_m)
        self.reductions = reductions
        self._bytes_each, mirrored = bytes_each, self.tiling.mirrored
        self.cells: dict[Signature, Cell] = {}
        self._reduce(not mirrored)
        order = reductions.reduction.hexahedra.order
        self.name = "superelement tet2" if reductions.mesher else f"superelement hex{order}"
        self.symmetries: tuple[str | None, ...] = CLASSES if mirrored else (None,)
        self._assembled_plates: dict[str, AssembledPlate] = {}
        self._stress: FloatArray | None = None

    def _reduce(self, whole: bool) -> None:
        """Reduce the panels that a whole plate, or a symmetry class, has and that are not reduced yet."""
        fresh: dict[Signature, Panel] = {}
        for panel in starmap(self.tiling.panel, self.tiling.representatives(whole)):
            if (name := signature(panel)) not in self.cells:
                fresh.setdefault(name, panel)
        cells = parallel_map(self.reductions.cell, fresh.values(), self._bytes_each)
        self.cells |= dict(zip(fresh, cells, strict=True))

    @cached_property
    def _grid(self) -> Grid:
        """Numbering shared by the symmetry classes; a whole plate has every panel's own numbers."""
        return Grid(self.tiling, self.cells, False, self._kept(False))

    def _kept(self, whole: bool) -> BoolArray | None:
        """Mask of the boundary functions that bare panels away from feet and supports need; None for all."""
        sparing = self.reductions.reduction.sparing
        if sparing is None:
            return None
        places = set(self.tiling.representatives(whole)) - full_panels(self.tiling)
        bare = {signature(self.tiling.panel(*place)) for place in places}
        return needed([self.cells[name] for name in bare], *sparing) if bare else None

    def assembled(self, symmetry: str | None) -> AssembledPlate:
        """The assembled cells of one symmetry class, of the whole plate for None."""
        name = symmetry or WHOLE
        if name not in self._assembled_plates:
            if name == WHOLE:  # a panel at a mirrored plate's lower end may belong to none of its classes
                self._reduce(True)
            grid = Grid(self.tiling, self.cells, True, self._kept(True)) if name == WHOLE else self._grid
            plate = AssembledPlate(self.tiling, self.cells, name, grid)
            others = [each for each in self._assembled_plates.values() if each.grid is plate.grid]
            plate.holds = others[0].holds if others else holds_of(plate, self.reductions)  # of one numbering
            plate.stress, plate.stack = self._stress, self.reductions.stack
            self._assembled_plates[name] = plate
        return self._assembled_plates[name]

    def released(self, symmetry: str | None) -> PlateModel | None:
        """The plate without its supports, in the degrees of freedom of a class; None where supports hold some at rest."""
        plate = self.assembled(symmetry).released()
        if plate is None:
            return None
        other = copy(self)
        other.tiling, other._assembled_plates = plate.tiling, {symmetry or WHOLE: plate}
        return other

    def prestress(self) -> tuple[RestStress, float]:
        """Load the plate with the thermal stress that its supports cause, and return it with the factor to buckling."""
        plates = [self.assembled(symmetry) for symmetry in self.symmetries]
        rest = rest_stress(plates[0])
        factor = buckling_factor(plates, rest.fields)
        self._stress = rest.fields
        for plate in plates:
            plate.stress = rest.fields
        return rest, factor

    @property
    def scale(self) -> Scale:
        """Units of the pencils."""
        return next(iter(self.cells.values())).scale

    def pencil(self, symmetry: str | None) -> PlainPencil:
        """K and M of one symmetry class."""
        return self.assembled(symmetry).pencil()

    def touch(self, symmetry: str | None, vectors: FloatArray) -> TouchField:
        """u_z on the touch face."""
        return self.assembled(symmetry).touch(vectors)

    def pillar_share(self, symmetry: str | None, vectors: FloatArray) -> FloatArray:
        """Share of the pillars in the kinetic energy, (k,)."""
        return self.assembled(symmetry).pillar_share(vectors)

    def lost(self, symmetry: str | None, vectors: FloatArray) -> FloatArray:
        """Loss between motions, (k, k)."""
        return self.assembled(symmetry).lost(vectors)

    def skin(self, symmetry: str | None, vectors: FloatArray) -> Skin:
        """Outer skin of the quarter x, y >= 0, or of the whole plate."""
        return self.assembled(symmetry).skin(vectors)
