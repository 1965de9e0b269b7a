"""The bare zone strip and the lone pillar against an independent finer computation."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from geometry.hex.boxes import Boxes, hex_mesh, pillar_boxes, zone_boxes
from geometry.hex.scenes import grid_lines
from geometry.layout import Design, Pillar
from geometry.materials import MATERIALS
from pipeline.planning import mesh_rules
from solvers.fem.eigen import modes_in_band, modes_near
from solvers.fem.solid import SolidModel

ALUMINIUM = MATERIALS["aluminium"]
ZONE_HZ = np.array(
    [25935, 26024, 26561, 27447, 28773, 30613, 33033, 36087, 39807, 44204, 49269, 54977, 61298, 66057], dtype=float
)  # stated to 0.1 %
PILLAR_HZ = {6.3e-3: 39115.0, 6.5e-3: 36882.0}


def design(height_m: float = 6.3e-3) -> Design:
    """The strip 115.5 x 20 x 2 mm and a pillar 2 x 2 mm."""
    pillar = Pillar("square", 2e-3, 2e-3, height_m, ALUMINIUM)
    return Design(115.5e-3, 20e-3, 2e-3, 8, ALUMINIUM, pillar, 4e-3, 4e-3, 1, 0.0)


def every_class(model: SolidModel, low_hz: float, high_hz: float) -> np.ndarray:
    """Frequencies of the four symmetry classes, ascending."""
    result = [modes_in_band(model.pencil(symmetry), low_hz, high_hz).frequency_hz for symmetry in model.symmetries]
    return np.sort(np.concatenate(result))


def zone(accuracy: float) -> np.ndarray:
    """Frequencies of the strip between 15 and 67 kHz."""
    settings = mesh_rules.zone_mesh(design(), mesh_rules.mesh_level("zone", accuracy))
    mesh = hex_mesh(zone_boxes(design(), settings), settings.order)
    return every_class(SolidModel(mesh, {"plate": ALUMINIUM}, ("y+",), True), 15e3, 67e3)


def test_zone_coarse_settings_meet_the_accuracy_they_promise() -> None:
    error = zone(0.01)[:14] / ZONE_HZ - 1.0
    assert np.abs(error).max() < 0.01
    assert np.abs(error[:10]).max() < 0.005  # up to and past the target mode, 39.8 kHz


@pytest.mark.slow
def test_zone_fine_settings_meet_all_fourteen_frequencies() -> None:
    assert np.abs(zone(0.002)[:14] / ZONE_HZ - 1.0).max() < 0.005


@pytest.mark.slow
def test_elements_graded_towards_the_free_ends_take_half_of_the_zones_error_away() -> None:
    """The field is singular where a free end meets a clamped side, and even elements along the zone do not follow it."""
    coarse, fine = mesh_rules.mesh_levels("zone")[0], mesh_rules.mesh_levels("zone")[-2]
    half = replace(design(), length_m=57.75e-3, nodal_lines=4)

    def even(boxes: Boxes, row: mesh_rules.MeshLevel) -> Boxes:
        lines = grid_lines({0.0: False, float(boxes.x[-1]): False}, mesh_rules.zone_mesh(half, row).grading)
        return replace(boxes, x=lines, region=boxes.region[: len(lines) - 1])

    def mode_hz(row: mesh_rules.MeshLevel, graded: bool = True) -> float:
        boxes = zone_boxes(half, mesh_rules.zone_mesh(half, row))
        mesh = hex_mesh(boxes if graded else even(boxes, row), row.order)
        model = SolidModel(mesh, {"plate": ALUMINIUM}, ("y+",), True)
        return float(modes_in_band(model.pencil("SS"), 30e3, 40e3).frequency_hz[0])

    right = mode_hz(fine)
    assert 0.0 < mode_hz(coarse) / right - 1.0 < 0.5 * (mode_hz(coarse, graded=False) / right - 1.0)


@pytest.mark.parametrize(("height_m", "symmetry"), [(6.3e-3, "SA"), (6.3e-3, "AS"), (6.5e-3, "SA")])
def test_pillar_bends_once_below_80_khz_at_the_known_frequency(height_m: float, symmetry: str) -> None:
    settings = mesh_rules.pillar_mesh(design(height_m), mesh_rules.mesh_level("pillar", 0.01))
    pillar = design(height_m).pillar
    assert pillar
    mesh = hex_mesh(pillar_boxes(pillar, settings), settings.order)
    model = SolidModel(mesh, {"pillar": ALUMINIUM}, ("touch",), True)
    bending = modes_in_band(model.pencil(symmetry), 1e3, 80e3).frequency_hz
    assert len(bending) == 1
    assert abs(bending[0] / PILLAR_HZ[height_m] - 1.0) < 0.003


def test_three_bendings_of_the_pillar_lie_within_their_bar() -> None:
    """Elements too long for the third would keep the first one right and the bar small."""

    def bending(row: mesh_rules.MeshLevel) -> np.ndarray:
        settings = mesh_rules.pillar_mesh(design(6.3e-3), row)
        mesh = hex_mesh(pillar_boxes(design(6.3e-3).pillar, settings), settings.order)
        return modes_near(SolidModel(mesh, {"pillar": ALUMINIUM}, ("touch",), True).pencil("AS"), 0.0, 3).frequency_hz[
            :3
        ]

    coarse, fine = mesh_rules.mesh_level("pillar", 0.01), mesh_rules.mesh_levels("pillar")[-2]
    error = np.abs(bending(coarse) / bending(fine) - 1.0)
    bar = mesh_rules.expected_error("pillar", coarse)
    assert bar is not None and (error <= bar).all(), (error, bar)
