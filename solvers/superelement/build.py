"""From a design to reduced cells: how fine each is meshed, which are distinct, and which were computed before."""

from __future__ import annotations

import hashlib
from collections.abc import Callable
from dataclasses import dataclass, replace
from math import ceil
from typing import Protocol

from geometry.elements import FloatArray
from geometry.hex.boxes import HexSettings, Piece, hex_mesh, piece_boxes
from geometry.layout import Design, Pillar
from geometry.materials import Material
from geometry.mesh import Mesh, check_mesh
from solvers.fem.assembly import Scale, assemble
from solvers.fem.eigen import PlainPencil, SymmetricPencil
from solvers.fem.solid import CLASSES
from solvers.fem.surface import Skin
from solvers.measures.confinement import TouchField
from solvers.superelement.cell import Cell, reduce_cell
from solvers.superelement.interface import Interface
from solvers.superelement.plate import WHOLE, JoinedPlate
from solvers.superelement.plate_count import more_below
from solvers.superelement.plate_error import ModeErrors, mode_errors
from solvers.superelement.tiling import Signature, signature, tile


@dataclass(frozen=True)
class Recipe:
    """How a piece is reduced: boundary degrees, fixed-interface modes up to top_hz, mesh, longest bare piece (m).

    bare_size_m: elements of pieces without a pillar, where they may be longer than those about a foot.
    """

    interface: Interface
    top_hz: float
    hexahedra: HexSettings
    longest_m: float = 6e-3
    bare_size_m: float | None = None


class Shelf(Protocol):
    """Where reduced cells are kept between runs."""

    def get(self, key: str) -> Cell | None:
        """A cell kept under this key, or None."""
        ...

    def put(self, key: str, cell: Cell) -> None:
        """Keep a cell."""
        ...


Meshes = Callable[[Piece], Mesh]


@dataclass
class Reductions:
    """Reduces pieces of one plate; equal pieces once, and none that the shelf has. `fresh` counts those computed here.

    `mesher` meshes the pieces with a pillar; without it, and for bare pieces, structured hexahedra do.
    """

    thickness_m: float
    material: Material
    pillar: Pillar | None
    recipe: Recipe
    shelf: Shelf | None = None
    mesher: Meshes | None = None
    mesher_name: str = ""  # tells one mesher's cells from another's on the shelf
    fresh: int = 0
    reused: int = 0

    def cell(self, piece: Piece) -> Cell:
        """The reduced cell of a piece."""
        key = self._key(piece)
        kept = self.shelf.get(key) if self.shelf else None
        if kept is not None:
            self.reused += 1
            return kept
        cell = self._reduce(piece)
        self.fresh += 1
        if self.shelf:
            self.shelf.put(key, cell)
        return cell

    def _reduce(self, piece: Piece) -> Cell:
        settings = self.recipe.hexahedra
        if self.mesher and piece.foot:
            mesh = self.mesher(piece)
        else:
            settings = settings if piece.foot else self._bare(piece)
            mesh = hex_mesh(piece_boxes(piece, self.thickness_m, self.pillar, settings), settings.order)
        check_mesh(mesh)
        pillar_material = self.pillar.material if self.pillar else self.material
        scale = Scale(self.thickness_m, self.material.young_pa, self.material.density_kg_m3)
        system = assemble(mesh, {"plate": self.material, "pillar": pillar_material, "body": self.material}, scale)
        return reduce_cell(system, self.recipe.interface, self.recipe.top_hz, piece.halved, piece.free)

    def _bare(self, piece: Piece) -> HexSettings:
        """Elements of a bare piece, short enough for its sides to hold the boundary functions; a foot would cut them anyway.

        A polynomial of a degree needs one node more along the side: with fewer, functions are one, and the mass is singular.
        """
        settings, along = self.recipe.hexahedra, self.recipe.interface.along
        sides = [high - low for low, high in zip(piece.low, piece.high, strict=True)]
        size = self.recipe.bare_size_m or settings.size_m
        return replace(settings, size_m=min(size, min(sides) / ceil(along / settings.order)))

    def _key(self, piece: Piece) -> str:
        pillar = self.pillar if piece.foot else None
        mesher = self.mesher_name if piece.foot else ""
        text = repr((signature(piece), piece.halved, self.thickness_m, self.material, pillar, self.recipe, mesher))
        return hashlib.sha256(text.encode()).hexdigest()


def lattice_piece(design: Design) -> Piece:
    """The unit cell: pitch_x x pitch_y, its pillar in the middle (bare without one)."""
    half_x, half_y = design.pitch_x_m / 2.0, design.pitch_y_m / 2.0
    return Piece((-half_x, -half_y), (half_x, half_y), (0.0, 0.0) if design.pillar else None, (0, 1))


class PlateModel:
    """A finite plate joined from reduced cells, mirror class by mirror class; whole where it is not its own mirror image."""

    def __init__(self, design: Design, reductions: Reductions) -> None:
        self.tiling = tile(design, reductions.recipe.longest_m)
        self.cells: dict[Signature, Cell] = {}
        mirrored = self.tiling.mirrored
        for place in self.tiling.representatives(not mirrored):
            piece = self.tiling.piece(*place)
            if signature(piece) not in self.cells:
                self.cells[signature(piece)] = reductions.cell(piece)
        order = reductions.recipe.hexahedra.order
        self.name = "superelement tet2" if reductions.mesher else f"superelement hex{order}"
        self.parities: tuple[str | None, ...] = CLASSES if mirrored else (None,)
        self._joined: dict[str, JoinedPlate] = {}

    def joined(self, parity: str | None) -> JoinedPlate:
        """The joined cells of one mirror class, of the whole plate for None."""
        name = parity or WHOLE
        if name not in self._joined:
            self._joined[name] = JoinedPlate(self.tiling, self.cells, name)
        return self._joined[name]

    def pencil(self, parity: str | None) -> PlainPencil:
        """K and M of one mirror class."""
        return self.joined(parity).pencil()

    def mode_errors(self, parity: str | None, pencil: SymmetricPencil, vectors: FloatArray) -> ModeErrors:
        """How far the reduction may put each of these modes of the class's pencil too high."""
        return mode_errors(self.joined(parity), pencil, vectors)

    def more_below(
        self, parity: str | None, pencil: SymmetricPencil, edge_hz: float, reduced: int | None = None
    ) -> int | None:
        """How many more modes the meshes have at most below a frequency than the class's pencil; None without a bound."""
        return more_below(self.joined(parity), pencil, edge_hz, reduced)

    def touch(self, parity: str | None, vectors: FloatArray) -> TouchField:
        """u_z on the touch face."""
        return self.joined(parity).touch(vectors)

    def pillar_share(self, parity: str | None, vectors: FloatArray) -> FloatArray:
        """Share of the pillars in the kinetic energy, (k,)."""
        return self.joined(parity).pillar_share(vectors)

    def skin(self, parity: str | None, vectors: FloatArray) -> Skin:
        """Outer skin of the quarter x, y >= 0, or of the whole plate."""
        return self.joined(parity).skin(vectors)
