"""A finite plate assembled from reduced cells against the same plate meshed in one piece."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from geometry.hex.boxes import VOID, Boxes, hex_mesh, panel_boxes
from geometry.hex.scenes import HexSettings
from geometry.layout import Design, Pillar
from geometry.materials import MATERIALS, Stack
from solvers.fem.eigen import modes_in_band
from solvers.fem.solid import SolidModel
from solvers.measures.confinement import measure
from solvers.plates.assembled import PlateModel, Reductions
from solvers.superelement.interface import Interface, ReductionSettings

STACK = Stack.of(2e-3, MATERIALS["aluminium"])

ALUMINIUM = MATERIALS["aluminium"]
PILLAR = Pillar("square", 2e-3, 2e-3, 6.3e-3, ALUMINIUM)
DESIGN = Design(24e-3, 16e-3, 2e-3, 2, ALUMINIUM, PILLAR, 4e-3, 4e-3, 1, 0.0)
ORDER_3 = HexSettings(order=3, size_m=4e-3, layers=0, pillar_size_m=3.15e-3)


@cache
def joined(settings: HexSettings, through: int = 3, design: Design = DESIGN, along: int = 5) -> PlateModel:
    """The plate from reduced cells."""
    reduction = ReductionSettings(Interface(along, through), 600e3, settings, 4e-3)
    return PlateModel(design, Reductions(Stack.of(design.thickness_m, ALUMINIUM), design.pillar, reduction))


def lines_of_pieces(model: PlateModel, settings: HexSettings) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Every line along which some cell of the quarter x, y >= 0 was meshed."""
    tiling = model.tiling
    result: list[list[float]] = [[], [], []]
    for i in range(len(tiling.x) - 1):
        for j in range(len(tiling.y) - 1):
            panel = tiling.panel(i, j)
            boxes = panel_boxes(panel, STACK, PILLAR, settings)
            for axis, lines in enumerate((boxes.x, boxes.y)):
                both = np.concatenate([lines, -lines]) if axis in panel.halved else lines
                result[axis].extend(both + panel.middle[axis])
            result[2].extend(boxes.z)
    x, y, z = (np.unique(np.round(line, 10)) for line in result)
    return x[x >= 0.0], y[y >= 0.0], z


def in_one_piece(model: PlateModel, settings: HexSettings, design: Design = DESIGN) -> SolidModel:
    """The quarter plate on the union of the cells' lines."""
    x, y, z = lines_of_pieces(model, settings)
    middles = [(line[1:] + line[:-1]) / 2.0 for line in (x, y, z)]
    above = middles[2] > design.thickness_m
    region = np.where(above, VOID, 0)[None, None, :] * np.ones((len(x) - 1, len(y) - 1, 1), dtype=np.int64)
    for (cx, cy), pillar in standing(design):
        near = [np.abs(middles[axis] - centre) < pillar.base_m / 2.0 for axis, centre in ((0, cx), (1, cy))]
        below = above & (middles[2] < design.thickness_m + pillar.height_m)
        region[near[0][:, None, None] & near[1][None, :, None] & below] = 1
    mesh = hex_mesh(Boxes(x, y, z, region, ("plate", "pillar")), settings.order)
    return SolidModel(mesh, {"plate": ALUMINIUM, "pillar": ALUMINIUM}, (), True)


def standing(design: Design) -> list[tuple[tuple[float, float], Pillar]]:
    """Every pillar with its centre, row by row from the design's own figures."""
    rows = zip(design.row_centres().tolist(), design.graded or (design.pillar,) * design.rows, strict=True)
    return [((x, side * y), each) for y, each in rows for side in (-1, 1) for x in design.column_centres().tolist()]


def compare(settings: HexSettings, symmetries: tuple[str, ...], through: int, design: Design = DESIGN) -> None:
    """Equal counts, frequencies, kinetic energy in the pillars and confinement measures."""
    model = joined(settings, through, design)
    solid = in_one_piece(model, settings, design)
    for symmetry in symmetries:
        ours, truth = (modes_in_band(m.pencil(symmetry), 20e3, 45e3) for m in (model, solid))
        assert len(ours.frequency_hz) == len(truth.frequency_hz) > 0, symmetry
        assert np.abs(ours.frequency_hz / truth.frequency_hz - 1.0).max() < 0.003, symmetry
        share = [m.pillar_share(symmetry, f.vectors) for m, f in ((model, ours), (solid, truth))]
        assert np.abs(share[0] - share[1]).max() < 0.02, symmetry
        mac = [measure(m.touch(symmetry, f.vectors), design, symmetry).mac for m, f in ((model, ours), (solid, truth))]
        assert np.abs(mac[0] - mac[1]).max() < 0.02, symmetry


@pytest.mark.slow
def test_the_joined_plate_has_the_modes_of_the_whole_mesh() -> None:
    compare(ORDER_3, ("SS",), 3)


GRADED = replace(
    DESIGN,
    length_m=6e-3,
    width_m=8e-3,
    rows=2,
    extension_m=2e-3,
    graded=(PILLAR, replace(PILLAR, height_m=3.15e-3)),
    graded_pitches_m=(4e-3, 3e-3),
)


@pytest.mark.slow
def test_rows_that_differ_have_the_modes_of_the_whole_mesh() -> None:
    """Heights and pitches by row: two kinds of pillar cells and their strips, against one mesh of all of it."""
    compare(ORDER_3, ("SS",), 3, GRADED)


ONE_COLUMN = replace(DESIGN, length_m=4e-3, width_m=8e-3, extension_m=1e-3)


@pytest.mark.slow
def test_a_single_column_has_the_modes_of_the_whole_mesh() -> None:
    """Its panels are their own images with both ends free: a fixed-interface mode belongs to one class, not to two."""
    compare(ORDER_3, ("SS", "AA"), 3, ONE_COLUMN)


def test_equal_rows_given_one_by_one_are_equal_rows_to_the_last_bit() -> None:
    equal = replace(GRADED, graded=(), graded_pitches_m=())
    listed = replace(equal, graded=(PILLAR, PILLAR), graded_pitches_m=(4e-3, 4e-3))
    ours, theirs = (joined(ORDER_3, 2, each, 3).pencil("SS") for each in (listed, equal))
    assert ours.stiffness.shape == theirs.stiffness.shape
    assert (ours.stiffness != theirs.stiffness).nnz == 0 == (ours.mass != theirs.mass).nnz


def test_the_joined_plate_weighs_what_the_plate_weighs() -> None:
    model = joined(ORDER_3, 3, DESIGN)
    field = model.touch("SS", np.eye(model.assembled("SS").dof)[:, :1])
    area = 24e-3 * 2.0 * DESIGN.half_span_m
    assert field.weights.sum() == pytest.approx(area, rel=1e-12)


@pytest.mark.slow
def test_every_mirror_class_agrees() -> None:
    compare(ORDER_3, ("SS", "SA", "AS", "AA"), 3)
