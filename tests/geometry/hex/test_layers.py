"""Meshes of plates of several layers: every layer is a region of its own thickness, under feet of every shape."""

from __future__ import annotations

import numpy as np
import pytest

from geometry.hex.boxes import hex_mesh, plate_boxes, zone_boxes
from geometry.hex.panels import panel_mesh
from geometry.hex.scenes import HexSettings, box_counts, panel_scene
from geometry.layout import Design, Pillar
from geometry.materials import MATERIALS, Layer, Stack
from geometry.mesh import Mesh, cell_volumes, check_mesh
from geometry.tiling import Panel

STACK = Stack(
    (Layer(MATERIALS["glass"], 0.7e-3), Layer(MATERIALS["epoxy"], 0.2e-3), Layer(MATERIALS["aluminium"], 1.1e-3))
)
THICK = {"plate": 0.7e-3, "layer2": 0.2e-3, "layer3": 1.1e-3}
SETTINGS = HexSettings(order=2, size_m=2e-3, layers=1, factor=0.2)
PILLARS = {
    "square": Pillar("square", 2e-3, 2e-3, 3e-3, MATERIALS["steel"]),
    "round": Pillar("round", 2e-3, 2e-3, 3e-3, MATERIALS["steel"]),
    "tapered": Pillar("tapered", 2e-3, 1e-3, 3e-3, MATERIALS["steel"]),
    "both faces": Pillar("square", 2e-3, 2e-3, 3e-3, MATERIALS["steel"], faces=2),
}


def volumes(mesh: Mesh) -> dict[str, float]:
    check_mesh(mesh)
    return {name: float(cell_volumes(mesh)[cells].sum()) for name, cells in mesh.regions.items()}


@pytest.mark.parametrize("shape", PILLARS)
def test_each_layer_of_a_panel_has_its_volume_and_its_height(shape: str) -> None:
    panel = Panel((-2.5e-3, -2e-3), (2.5e-3, 2e-3), (0.0, 0.0))
    mesh = panel_mesh(panel, STACK, PILLARS[shape], SETTINGS).mesh
    found = volumes(mesh)
    assert {name: found[name] for name in THICK} == pytest.approx({name: 20e-6 * each for name, each in THICK.items()})
    for name, low, high in zip(THICK, STACK.levels_m, STACK.levels_m[1:], strict=False):
        z = mesh.nodes[mesh.cells[mesh.regions[name]]][..., 2]
        assert (z.min(), z.max()) == pytest.approx((low, high))
    assert found["pillar"] > 0.0 and np.ptp(mesh.nodes[mesh.nodes_of("touch"), 2]) == pytest.approx(0.0, abs=1e-15)


def test_plates_and_zones_have_their_layers_and_the_count_of_their_boxes_is_exact() -> None:
    design = Design(20e-3, 8e-3, 2e-3, 3, MATERIALS["aluminium"], PILLARS["square"], 4e-3, 4e-3, 1, 1e-3)
    layered = Design(**{**vars(design), "layers": STACK.layers})
    for boxes in (plate_boxes(layered, SETTINGS), zone_boxes(layered, SETTINGS)):
        found = volumes(hex_mesh(boxes, 2))
        shares = {name: found[name] / sum(found[each] for each in THICK) for name in THICK}
        assert shares == pytest.approx({name: each / 2e-3 for name, each in THICK.items()})
    panel = Panel((-2.5e-3, -2e-3), (2.5e-3, 2e-3), (0.0, 0.0))
    mesh = panel_mesh(panel, STACK, PILLARS["square"], SETTINGS).mesh
    assert box_counts(panel_scene(panel, STACK, PILLARS["square"], SETTINGS), 2).nodes == len(mesh.nodes)


@pytest.mark.slow
def test_tetrahedra_keep_the_faces_between_layers() -> None:
    from geometry.tet.scenes import tet_part

    design = Design(12e-3, 6e-3, 2e-3, 2, MATERIALS["aluminium"], PILLARS["round"], 4e-3, 4e-3, 1, 1e-3)
    mesh = tet_part(Design(**{**vars(design), "layers": STACK.layers}), "plate", 1e-3)
    found = volumes(mesh)
    shares = {name: found[name] / sum(found[each] for each in THICK) for name in THICK}
    assert shares == pytest.approx({name: each / 2e-3 for name, each in THICK.items()}, rel=1e-3)
