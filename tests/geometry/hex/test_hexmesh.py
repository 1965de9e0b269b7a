"""Structured hexahedra: exact volumes, no orphan, faces named and in place, pillars where the layout puts them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from geometry.hex.boxes import cell_boxes, hex_mesh, panel_boxes, pillar_boxes, plate_boxes, zone_boxes
from geometry.hex.scenes import HexSettings
from geometry.layout import Design, Pillar
from geometry.materials import MATERIALS, Stack
from geometry.mesh import Mesh, cell_volumes, check_mesh
from geometry.tiling import Panel

STACK = Stack.of(2e-3, MATERIALS["aluminium"])

ALUMINIUM = MATERIALS["aluminium"]
PILLAR = Pillar("square", 2e-3, 2e-3, 6.3e-3, ALUMINIUM)
DESIGN = Design(30e-3, 20e-3, 2e-3, 8, ALUMINIUM, PILLAR, 4e-3, 5e-3, 2, 3e-3)
COARSE = HexSettings(order=1, size_m=4e-3, layers=1, factor=0.25)
FOOT_M2, PILLAR_M3 = 4e-6, 4e-6 * 6.3e-3


def plate_volume(design: Design) -> float:
    """Box of the plate and its pillars, m3."""
    box = design.length_m * 2.0 * design.half_span_m * design.thickness_m
    return box + len(design.pillar_centres()) * PILLAR_M3


@pytest.mark.parametrize("order", [1, 2, 3, 4])
def test_cell_volume_is_exact_and_no_node_is_an_orphan(order: int) -> None:
    design = replace(DESIGN, pitch_y_m=4e-3)
    mesh = hex_mesh(cell_boxes(design, COARSE), order)
    report = check_mesh(mesh, 4e-3 * 4e-3 * 2e-3 + PILLAR_M3, tolerance=1e-12)
    assert report.nodes == len(np.unique(mesh.nodes.round(12), axis=0)), "two nodes at one place"


def test_volume_by_the_jacobian_equals_volume_by_the_spans() -> None:
    mesh = hex_mesh(cell_boxes(DESIGN, COARSE), 2)
    bare = Mesh(mesh.nodes, mesh.cells, "hex", 2)
    assert np.allclose(cell_volumes(bare), cell_volumes(mesh), rtol=1e-12)
    assert check_mesh(bare).worst_jacobian_ratio > 0.999


@pytest.mark.parametrize("make", [zone_boxes, plate_boxes, cell_boxes])
def test_the_quarter_has_a_quarter_of_the_volume(make: object) -> None:
    whole, quarter = (cell_volumes(hex_mesh(make(DESIGN, COARSE, q), 1)).sum() for q in (False, True))  # type: ignore
    assert quarter == pytest.approx(whole / 4.0, rel=1e-12)


def test_the_quarter_pillar_has_a_quarter_of_the_volume() -> None:
    whole, quarter = (cell_volumes(hex_mesh(pillar_boxes(PILLAR, COARSE, q), 1)).sum() for q in (False, True))
    assert (whole, quarter) == pytest.approx((PILLAR_M3, PILLAR_M3 / 4.0), rel=1e-12)


def test_plate_volume_counts_every_pillar() -> None:
    assert len(DESIGN.pillar_centres()) == 32
    check_mesh(hex_mesh(plate_boxes(DESIGN, COARSE, False), 1), plate_volume(DESIGN), tolerance=1e-12)


def test_pillars_stand_at_the_centres_of_the_layout() -> None:
    mesh = hex_mesh(plate_boxes(DESIGN, COARSE, False), 1)
    middles = mesh.nodes[mesh.cells[mesh.regions["pillar"]]].mean(axis=1)
    volumes = cell_volumes(mesh)[mesh.regions["pillar"]]
    assert (middles[:, 2] > DESIGN.thickness_m).all()
    for centre in DESIGN.pillar_centres():
        mine = (np.abs(middles[:, :2] - centre) < 1e-3).all(axis=1)
        assert volumes[mine].sum() == pytest.approx(PILLAR_M3, rel=1e-12)
        assert np.allclose(volumes[mine] @ middles[mine, :2] / PILLAR_M3, centre, atol=1e-12)
    assert volumes.sum() == pytest.approx(len(DESIGN.pillar_centres()) * PILLAR_M3, rel=1e-12)


def test_a_column_on_the_mirror_plane_is_halved() -> None:
    design = replace(DESIGN, length_m=27e-3)
    assert 0.0 in design.column_centres()
    quarter = hex_mesh(plate_boxes(design, COARSE, True), 1)
    share = cell_volumes(quarter)[quarter.regions["pillar"]].sum()
    assert share == pytest.approx(len(design.pillar_centres()) * PILLAR_M3 / 4.0, rel=1e-12)


@pytest.mark.parametrize("order", [1, 3])
def test_named_faces_hold_exactly_the_nodes_of_their_planes(order: int) -> None:
    mesh = hex_mesh(plate_boxes(DESIGN, COARSE, True), order)
    low, high = mesh.nodes.min(axis=0), mesh.nodes.max(axis=0)
    planes = {"x-": (0, low), "x+": (0, high), "y-": (1, low), "y+": (1, high), "touch": (2, low), "top": (2, high)}
    assert set(mesh.faces) == set(planes)
    for name, (axis, side) in planes.items():
        assert np.array_equal(mesh.nodes_of(name), np.flatnonzero(mesh.nodes[:, axis] == side[axis])), name


def test_touch_area_is_the_plates_underside_and_top_is_the_pillars_tips() -> None:
    mesh = hex_mesh(plate_boxes(DESIGN, COARSE, False), 1)

    def area(face: str) -> float:
        corners = mesh.nodes[mesh.faces[face]]
        return float(np.prod(np.ptp(corners, axis=1)[:, :2], axis=1).sum())

    assert area("touch") == pytest.approx(DESIGN.length_m * 2.0 * DESIGN.half_span_m, rel=1e-12)
    assert area("top") == pytest.approx(32 * FOOT_M2, rel=1e-12)


def test_a_line_runs_along_the_zones_border() -> None:
    boxes = plate_boxes(DESIGN, COARSE, False)
    for border in (-10e-3, 10e-3):
        assert np.abs(boxes.y - border).min() < 1e-15


def test_zone_is_graded_towards_its_clamped_sides_and_its_free_ends_and_not_at_the_mirrors() -> None:
    settings = HexSettings(order=3, size_m=5e-3, layers=2, factor=0.2)
    boxes = zone_boxes(DESIGN, settings)
    assert np.diff(boxes.y)[-1] == pytest.approx(0.04 * 5e-3)
    assert np.diff(boxes.x)[-1] == pytest.approx(0.04 * np.diff(boxes.x)[0])
    assert np.ptp(np.diff(boxes.x)[:-3]) < 1e-12
    assert np.allclose(np.diff(boxes.z), np.diff(boxes.z)[::-1])
    whole = zone_boxes(DESIGN, settings, False)
    assert np.allclose(whole.x, -whole.x[::-1]) and np.allclose(whole.x[whole.x >= -1e-12], boxes.x)


def test_so_many_elements_lie_through_a_plate_with_pillars_and_through_a_bare_one() -> None:
    settings = HexSettings(order=3, size_m=4e-3, layers=1, factor=0.1, pillar_size_m=3e-3, through=2)
    with_foot, bare = (
        panel_boxes(Panel((-2e-3, -2e-3), (2e-3, 2e-3), foot), STACK, PILLAR, settings) for foot in ((0.0, 0.0), None)
    )
    assert np.allclose(with_foot.z[with_foot.z <= 2.0001e-3], [0.0, 1e-3, 1.9e-3, 2e-3])
    assert np.allclose(bare.z, [0.0, 1e-3, 2e-3])
    once = panel_boxes(Panel((-2e-3, -2e-3), (2e-3, 2e-3), (0.0, 0.0)), STACK, PILLAR, replace(settings, through=1))
    assert np.array_equal(once.x, with_foot.x) and np.array_equal(once.y, with_foot.y)


def test_an_off_centre_foot_stands_where_the_piece_says() -> None:
    panel = Panel((1e-3, -2e-3), (5e-3, 4e-3), (2.5e-3, 1.5e-3))
    mesh = hex_mesh(panel_boxes(panel, STACK, PILLAR, COARSE), 1)
    foot = mesh.nodes[np.unique(mesh.cells[mesh.regions["pillar"]])]
    assert np.allclose([foot[:, 0].min(), foot[:, 0].max()], [-1.5e-3, 0.5e-3])
    assert np.allclose([foot[:, 1].min(), foot[:, 1].max()], [-0.5e-3, 1.5e-3])


def test_nodes_of_high_order_lie_at_lobatto_points() -> None:
    mesh = hex_mesh(zone_boxes(DESIGN, HexSettings(order=3, size_m=1.0, layers=0)), 3)
    x = np.unique(mesh.nodes[:, 0].round(12))
    assert np.allclose(x / 15e-3, [0.0, (1 - 5**-0.5) / 2, (1 + 5**-0.5) / 2, 1.0], atol=1e-9)
