"""Sizes told from breakpoints are those of the mesh."""

from __future__ import annotations

from dataclasses import replace

import pytest

from geometry.hex.box_counts import box_counts
from geometry.hex.boxes import HexSettings, Scene, boxes_of, cell_scene, hex_mesh, pillar_scene, plate_scene, zone_scene
from geometry.layout import Design, Pillar
from geometry.materials import MATERIALS
from solvers.fem.assembly import assemble

ALUMINIUM = MATERIALS["aluminium"]
PILLAR = Pillar("square", 2e-3, 2e-3, 4e-3, ALUMINIUM)
DESIGN = Design(13e-3, 8e-3, 2e-3, 3, ALUMINIUM, PILLAR, 4e-3, 5e-3, 1, 0.0)  # a column stands on the mirror
COARSE, GRADED = HexSettings(2, 4e-3, 0), HexSettings(2, 2.5e-3, 1, 0.2, 2e-3, 2)
SCENES = {
    "zone": zone_scene(DESIGN, GRADED),
    "pillar": pillar_scene(PILLAR, GRADED),
    "plate quarter": plate_scene(DESIGN, COARSE),
    "plate whole": plate_scene(DESIGN, COARSE, quarter=False),
    "plate graded": plate_scene(DESIGN, GRADED),
    "plate bare": plate_scene(replace(DESIGN, rows=0), GRADED),
    "cell": cell_scene(DESIGN, GRADED),
}


@pytest.mark.parametrize("name", SCENES)
def test_elements_nodes_and_pairs_are_those_of_the_mesh(name: str) -> None:
    scene: Scene = SCENES[name]
    counts, mesh = box_counts(scene, 2), hex_mesh(boxes_of(scene), 2)
    assert (counts.elements, counts.nodes) == (len(mesh.cells), len(mesh.nodes))
    assert counts.pairs == assemble(mesh, {"plate": ALUMINIUM, "pillar": ALUMINIUM}).mass.nnz
