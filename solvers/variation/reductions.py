"""Reductions of a plate whose pillars differ: a family for each kind of piece with a pillar, bare pieces as ever."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass, field
from typing import Protocol

import numpy as np

from geometry.hex.boxes import Piece
from solvers.errors import SolverError
from solvers.superelement.build import Reductions
from solvers.superelement.cell import Cell
from solvers.superelement.tiling import Signature, signature
from solvers.variation.parametric_cell import CellFamily, Setting, cell_family


class FamilyShelf(Protocol):
    """Where families are kept between runs."""

    def get(self, key: str) -> CellFamily | None:
        """A family kept under this key, or None."""
        ...

    def put(self, key: str, family: CellFamily) -> None:
        """Keep a family."""
        ...


@dataclass
class VariedReductions(Reductions):
    """reach_m: how far a pillar's height, side, x and y may go from nominal; `families` fills as pieces are asked for."""

    reach_m: tuple[float, float, float, float] = (0.0, 0.0, 0.0, 0.0)
    family_shelf: FamilyShelf | None = None
    families: dict[Signature, CellFamily] = field(default_factory=dict)

    def cell(self, piece: Piece) -> Cell:
        """The nominal cell of a piece. SolverError for pillars that are not boxes."""
        if not piece.foot:
            return super().cell(piece)
        if signature(piece) not in self.families:
            self.families[signature(piece)] = self._family(piece)
        return self.families[signature(piece)].cell

    def _family(self, piece: Piece) -> CellFamily:
        if self.pillar is None or self.mesher is not None:
            raise SolverError("only square pillars without fillet, meshed by hexahedra, can be varied")
        key = hashlib.sha256(repr(("family", self._key(piece), self.reach_m)).encode()).hexdigest()
        kept = self.family_shelf.get(key) if self.family_shelf else None
        if kept is not None:
            self.reused += 1
            return kept
        setting = Setting(
            self.thickness_m,
            self.material,
            self.pillar,
            self.recipe.interface,
            self.recipe.top_hz,
            self.recipe.hexahedra,
        )
        family = cell_family(setting, piece, np.array(self.reach_m))
        self.fresh += 1
        if self.family_shelf:
            self.family_shelf.put(key, family)
        return family
