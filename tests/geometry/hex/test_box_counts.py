"""Sizes told from breakpoints are those of the mesh."""

from __future__ import annotations

from dataclasses import replace

import pytest

from geometry.hex.boxes import boxes_of, hex_mesh
from geometry.hex.scenes import HexSettings, Scene, box_counts, cell_scene, pillar_scene, plate_scene, zone_scene
from geometry.layout import Design, Pillar, Section, region_materials
from geometry.materials import MATERIALS, Stack
from geometry.mesh import cell_volumes, check_mesh
from solvers.fem.assembly import assemble

ALUMINIUM = MATERIALS["aluminium"]
PILLAR = Pillar("square", 2e-3, 2e-3, 4e-3, ALUMINIUM)
DESIGN = Design(13e-3, 8e-3, 2e-3, 3, ALUMINIUM, PILLAR, 4e-3, 5e-3, 1, 0.0)  # a column stands on the mirror
UNLIKE = replace(
    DESIGN,
    rows=2,
    graded=(PILLAR, replace(PILLAR, base_m=1.5e-3, tip_m=1.5e-3, height_m=3e-3)),
    graded_pitches_m=(5e-3, 4e-3),
)
WIDE = replace(PILLAR, upper=(Section.square(3e-3, 1e-3, ALUMINIUM),))
CROSS = replace(WIDE, shape="cross", more_m=(("arm_m", 1e-3),), upper=(Section.square(1.5e-3, 1e-3, ALUMINIUM),))
HEAVY = replace(UNLIKE, graded=(WIDE, replace(CROSS, height_m=3e-3)))
BOTH = replace(HEAVY, pillar=replace(PILLAR, faces=2), graded=tuple(replace(each, faces=2) for each in HEAVY.graded))
COARSE, GRADED = HexSettings(2, 4e-3, 0), HexSettings(2, 2.5e-3, 1, 0.2, 2e-3, 2)
SCENES = {
    "zone": zone_scene(DESIGN, GRADED),
    "pillar": pillar_scene(PILLAR, GRADED),
    "plate quarter": plate_scene(DESIGN, COARSE),
    "plate whole": plate_scene(DESIGN, COARSE, quarter=False),
    "plate graded": plate_scene(DESIGN, GRADED),
    "plate bare": plate_scene(replace(DESIGN, rows=0), GRADED),
    "cell": cell_scene(DESIGN, GRADED),
    "rows that differ": plate_scene(UNLIKE, GRADED),
    "heavy tip": pillar_scene(WIDE, GRADED),
    "heavy tip of one side": cell_scene(
        replace(DESIGN, pillar=replace(WIDE, upper=(Section.square(2e-3, 1e-3, ALUMINIUM),))), GRADED
    ),
    "tip within a cross": pillar_scene(CROSS, GRADED),
    "heavy tips that differ": plate_scene(HEAVY, GRADED),
    "heavy tips on both faces": plate_scene(BOTH, GRADED),
}


def test_rows_that_differ_fill_their_closed_form_volume() -> None:
    """Boxes of order 1 hold their volume exactly: half the length 13 mm, half the span 4 + 2/2 + 4.5 + 1.5/2, columns 1.5."""
    mesh = hex_mesh(boxes_of(plate_scene(UNLIKE, COARSE)), 1)
    exact = 6.5 * UNLIKE.half_span_m * 1e3 * 2.0 + 1.5 * (2.0 * 2.0 * 4.0 + 1.5 * 1.5 * 3.0)
    assert UNLIKE.half_span_m == pytest.approx(10.25e-3)
    assert check_mesh(mesh).volume_m3 == pytest.approx(1e-9 * exact, rel=1e-12)


def test_heavy_tips_fill_their_closed_form_volume() -> None:
    """Half the span is 4 + 2/2 + 4.5 + 2/2: a tip of 3 mm on the first row does not reach beyond, the cross's is narrower."""
    mesh = hex_mesh(boxes_of(plate_scene(HEAVY, COARSE)), 1)
    exact = 6.5 * 10.5 * 2.0 + 1.5 * (2.0 * 2.0 * 4.0 + 3.0 * 3.0 * 1.0 + 3.0 * 3.0 + 1.5 * 1.5 * 1.0)
    assert HEAVY.half_span_m == pytest.approx(10.5e-3)
    assert check_mesh(mesh).volume_m3 == pytest.approx(1e-9 * exact, rel=1e-12)
    of_tips = cell_volumes(mesh)[mesh.regions["section2"]].sum()
    assert of_tips == pytest.approx(1e-9 * 1.5 * (9.0 + 2.25), rel=1e-12)
    outer = replace(DESIGN, pillar=WIDE)
    assert outer.half_span_m == pytest.approx(4e-3 + 1e-3 + 1.5e-3), "the plate ends below the last tip"
    assert (
        replace(outer, length_m=10.5e-3).column_centres().size
        == 2
        < replace(DESIGN, length_m=10.5e-3).column_centres().size
    )


@pytest.mark.parametrize("name", SCENES)
def test_elements_nodes_and_pairs_are_those_of_the_mesh(name: str) -> None:
    scene: Scene = SCENES[name]
    order = 1 if "tips" in name else 2  # large ones
    counts, mesh = box_counts(scene, order), hex_mesh(boxes_of(scene), order)
    assert (counts.elements, counts.nodes) == (len(mesh.cells), len(mesh.nodes))
    assert counts.pairs == assemble(mesh, region_materials(Stack.of(1.0, ALUMINIUM), WIDE)).mass.nnz
