"""Reductions of a plate whose pillars differ: a family for each kind of panel with a pillar, bare panels as ever."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass, field
from typing import Protocol

import numpy as np

from geometry.hex.boxes import Panel
from geometry.layout import PLAIN
from solvers.errors import SolverError
from solvers.superelement.build import Reductions
from solvers.superelement.cell import Cell
from solvers.superelement.tiling import Signature, signature
from solvers.variation.parametric_cell import CellFamily, Setting, cell_family


class ParametricCellCache(Protocol):
    """Where families are kept between runs."""

    def get(self, key: str) -> CellFamily | None:
        """A family kept under this key, or None."""
        ...

    def put(self, key: str, family: CellFamily) -> None:
        """Keep a family."""
        ...


@dataclass
class VariedReductions(Reductions):
    """reach_m: how far a pillar's height, side, x and y may go from nominal; `families` fills as panels are asked for."""

    reach_m: tuple[float, float, float, float] = (0.0, 0.0, 0.0, 0.0)
    parametric_cache: ParametricCellCache | None = None
    families: dict[Signature, CellFamily] = field(default_factory=dict)

    def cell(self, panel: Panel) -> Cell:
        """The nominal cell of a panel. SolverError for pillars that cannot grow as a whole."""
        if not panel.foot:
            return super().cell(panel)
        if signature(panel) not in self.families:
            self.families[signature(panel)] = self._family(panel)
        return self.families[signature(panel)].cell

    def _family(self, panel: Panel) -> CellFamily:
        pillar = self.pillar_of(panel)
        if pillar is None or self.mesher is not None:
            raise SolverError(f"only {PLAIN} meshed by hexahedra can be varied")
        key = hashlib.sha256(repr(("family", self._key(panel), self.reach_m)).encode()).hexdigest()
        kept = self.parametric_cache.get(key) if self.parametric_cache else None
        if kept is not None:
            self.reused += 1
            return kept
        setting = Setting(
            self.thickness_m,
            self.material,
            pillar,
            self.reduction.interface,
            self.reduction.top_hz,
            self.reduction.hexahedra,
        )
        family = cell_family(setting, panel, np.array(self.reach_m), self.coarser(panel))
        self.fresh += 1
        if self.parametric_cache:
            self.parametric_cache.put(key, family)
        return family
