"""Unit cells on the coarsest mesh and no cache, for tests of what does not depend on either."""

from __future__ import annotations

import pytest

from geometry.hex.boxes import HexSettings
from pipeline.models import unit_cell
from pipeline.planning import mesh_rules
from solvers.piezo import patch as piezo_patch
from solvers.superelement.interface import Interface

COARSE = HexSettings(order=3, size_m=4e-3, layers=1, factor=0.15, pillar_size_m=6.3e-3)
COARSEST = HexSettings(order=3, size_m=4e-3, layers=0, factor=0.15, pillar_size_m=6.3e-3)  # tells no error of its own
COARSEST_PATCH = HexSettings(order=2, size_m=4e-3, layers=1, factor=0.15)


class NoCache:
    """Nothing is kept between tests."""

    def get(self, key: str) -> None:
        return None

    def put(self, key: str, cell: object) -> None:
        return None


def mesh_coarsest(patch: pytest.MonkeyPatch) -> None:
    """Every panel and patch of every plate on the fewest elements, and panels kept like any other."""
    patch.setattr(mesh_rules, "cell_mesh", lambda design, level: COARSEST)
    patch.setattr(mesh_rules, "Interface", lambda along, through: Interface(along, 2))
    patch.setattr(piezo_patch, "MESH", COARSEST_PATCH)


def put_in(patch: pytest.MonkeyPatch, mesh: HexSettings = COARSE) -> None:
    """Every cell coarse and reduced anew."""
    patch.setattr(mesh_rules, "cell_settings", lambda design, accuracy: mesh)
    patch.setattr(mesh_rules, "cell_mesh", lambda design, level: mesh)
    patch.setattr(unit_cell, "CellCache", NoCache)
