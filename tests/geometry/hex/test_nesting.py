"""Fields carried to a nested mesh: polynomials exactly, and nothing where the coarse mesh has no element."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from geometry.errors import MeshError
from geometry.hex.boxes import cell_boxes, hex_mesh, interpolation, pillar_boxes, zone_boxes
from geometry.hex.scenes import HexSettings
from pipeline.case.model import load_case

CASE = Path(__file__).resolve().parents[3] / "examples" / "small.toml"
FINE = HexSettings(3, 3e-3, 2, 0.15, 2e-3)


def polynomial(nodes: np.ndarray, degree: int) -> np.ndarray:
    x, y, z = (1e3 * nodes).T
    return x**degree * y**degree - 2.0 * z**degree * x + y


@pytest.mark.parametrize("part", ["cell", "zone", "pillar"])
@pytest.mark.parametrize("coarser", [FINE.coarser, replace(FINE, order=2), FINE.coarser.coarser])
def test_a_coarse_field_is_carried_exactly(part: str, coarser: HexSettings) -> None:
    design = load_case(CASE).design
    make = {"cell": cell_boxes, "zone": zone_boxes, "pillar": lambda d, mesh: pillar_boxes(d.pillar, mesh)}[part]
    boxes, own = make(design, FINE), make(design, coarser)
    fine, coarse = hex_mesh(boxes, FINE.order), hex_mesh(own, coarser.order)
    assert len(coarse.nodes) < len(fine.nodes)
    transfer = interpolation(own, boxes, FINE.order, coarser.order)
    expected = polynomial(fine.nodes, coarser.order)
    interpolated = transfer @ polynomial(coarse.nodes, coarser.order)
    assert np.abs(interpolated - expected).max() < 1e-12 * np.abs(expected).max()
    assert np.abs(transfer.sum(axis=1) - 1.0).max() < 1e-12


def test_a_mesh_beyond_the_coarse_one_is_refused() -> None:
    design = load_case(CASE).design
    assert design.pillar
    short = replace(design, pillar=replace(design.pillar, height_m=design.pillar.height_m / 2.0))
    bare = replace(design, pillar=None)
    with pytest.raises(MeshError, match="not nested"):
        interpolation(cell_boxes(bare, FINE), cell_boxes(design, FINE), 3)
    with pytest.raises(MeshError, match="not nested"):
        interpolation(cell_boxes(short, FINE), cell_boxes(design, FINE), 3)
