"""Unit cells on the coarsest mesh and no cache, for tests of what does not depend on either."""

from __future__ import annotations

import pytest

from geometry.hex.boxes import HexSettings
from pipeline.models import unit_cell
from pipeline.planning import mesh_rules

COARSE = HexSettings(order=3, size_m=4e-3, layers=1, factor=0.15, pillar_size_m=6.3e-3)


class NoCache:
    """Nothing is kept between tests."""

    def get(self, key: str) -> None:
        return None

    def put(self, key: str, cell: object) -> None:
        return None


def put_in(patch: pytest.MonkeyPatch) -> None:
    """Every cell coarse and reduced anew."""
    patch.setattr(mesh_rules, "cell_settings", lambda design, accuracy: COARSE)
    patch.setattr(mesh_rules, "cell_mesh", lambda design, level: COARSE)
    patch.setattr(unit_cell, "CellCache", NoCache)
