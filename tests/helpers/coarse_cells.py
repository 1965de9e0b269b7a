"""Unit cells on the coarsest mesh, for tests that do not depend on it."""

from __future__ import annotations

from typing import ClassVar

import pytest

from geometry.hex.scenes import HexSettings
from pipeline.models import unit_cell
from pipeline.planning import mesh_rules
from solvers.piezo import patch as piezo_patch
from solvers.superelement.cell import Cell
from solvers.superelement.interface import Interface

COARSE = HexSettings(order=3, size_m=4e-3, layers=1, factor=0.15, pillar_size_m=6.3e-3)
COARSEST = HexSettings(order=3, size_m=4e-3, layers=0, factor=0.15, pillar_size_m=6.3e-3)  # has no error estimate
COARSEST_PATCH = HexSettings(order=2, size_m=4e-3, layers=1, factor=0.15)


class CellsOfTheProcess:
    """Cells kept in memory for all tests of this process."""

    kept: ClassVar[dict[str, Cell]] = {}

    def get(self, key: str) -> Cell | None:
        return self.kept.get(key)

    def put(self, key: str, cell: Cell) -> None:
        self.kept[key] = cell


def mesh_coarsest(patch: pytest.MonkeyPatch) -> None:
    """Mesh every panel and patch with the fewest elements; panels are cached as usual."""
    patch.setattr(mesh_rules, "cell_mesh", lambda design, level: COARSEST)
    patch.setattr(mesh_rules, "Interface", lambda along, through, joints=(): Interface(along, 2, joints))
    patch.setattr(piezo_patch, "MESH", COARSEST_PATCH)


def put_in(patch: pytest.MonkeyPatch, mesh: HexSettings = COARSE) -> None:
    """Make every cell coarse, and load none from the disk."""
    patch.setattr(mesh_rules, "cell_settings", lambda design, accuracy: mesh)
    patch.setattr(mesh_rules, "cell_mesh", lambda design, level: mesh)
    patch.setattr(unit_cell, "CellCache", CellsOfTheProcess)
