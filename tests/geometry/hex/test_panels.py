"""Panels about feet that are no boxes: sound meshes of the right volume, nested, without cracks, refused without room."""

from __future__ import annotations

from collections import Counter
from dataclasses import replace
from math import pi

import numpy as np
import pytest

from geometry.errors import MeshError
from geometry.hex import panels
from geometry.hex.panels import panel_mesh, transfer
from geometry.hex.scenes import HexSettings
from geometry.layout import Pillar
from geometry.materials import MATERIALS, Stack
from geometry.mesh import cell_volumes, check_mesh
from geometry.tiling import Panel
from solvers.fem.surface import face_quadrature

THIN_STACK = Stack.of(1e-3, MATERIALS["aluminium"])

T, H, W = 1.6e-3, 5.2e-3, 1.9e-3
STACK = Stack.of(T, MATERIALS["aluminium"])
SQUARE = Pillar("square", W, W, H, MATERIALS["aluminium"])
PILLARS = {
    "round": replace(SQUARE, shape="round"),
    "hexagonal": replace(SQUARE, shape="hexagonal"),
    "narrowing": replace(SQUARE, shape="tapered", tip_m=0.6 * W),
    "widening": replace(SQUARE, shape="tapered", tip_m=1.3 * W),
}
SETTINGS = HexSettings(3, 2.0 * T, 1, 0.15, H / 4.0)
OFF_CENTRE = Panel((0.0, 0.0), (4.1e-3, 3.3e-3), (2.3e-3, 1.4e-3))
CENTRED = Panel((-2.0e-3, -1.8e-3), (2.0e-3, 1.8e-3), (0.0, 0.0))
WHERE = {
    "whole": OFF_CENTRE,
    "half": replace(OFF_CENTRE, foot=(2.05e-3, 1.4e-3), halved=(0,)),
    "quarter": replace(CENTRED, halved=(0, 1)),
    "tight": Panel((-1.13e-3, -0.98e-3), (3.0e-3, 1.05e-3), (0.0, 0.0)),
}


@pytest.fixture(params=PILLARS.values(), ids=PILLARS)
def pillar(request: pytest.FixtureRequest) -> Pillar:
    return request.param


@pytest.fixture(params=WHERE.values(), ids=WHERE)
def panel(request: pytest.FixtureRequest) -> Panel:
    return request.param


def volume_m3(panel: Panel, pillar: Pillar) -> float:
    area = {"round": pi / 4.0 * W**2, "hexagonal": np.sqrt(0.75) * W**2}.get(pillar.shape)
    share = 0.5 ** len(panel.halved)
    frustum = H / 3.0 * (W**2 + W * pillar.tip_m + pillar.tip_m**2)
    plate = (panel.high[0] - panel.low[0]) * (panel.high[1] - panel.low[1]) * T
    return share * (plate + (frustum if area is None else area * H))


def test_the_mesh_is_sound_and_fills_the_solid(panel: Panel, pillar: Pillar) -> None:
    mesh = panel_mesh(panel, STACK, pillar, SETTINGS).mesh
    # arcs of an eighth of a circle through four points: the area is off by less than (pi/8)^8 / 8! of itself
    assert check_mesh(mesh).volume_m3 == pytest.approx(volume_m3(panel, pillar), rel=1e-6)
    assert mesh.nodes[:, 2].max() == pytest.approx(T + H)
    plate = mesh.nodes[mesh.nodes[:, 2] <= T]  # a tip may overhang its panel
    low, high = plate.min(axis=0), plate.max(axis=0)
    for axis in (0, 1):
        half = (panel.high[axis] - panel.low[axis]) / 2.0
        foot = np.array(panel.foot) - panel.middle
        assert high[axis] == pytest.approx(half)
        assert low[axis] == pytest.approx(foot[axis] if axis in panel.halved else -half, abs=1e-12)


def test_every_inner_facet_belongs_to_two_elements(panel: Panel, pillar: Pillar) -> None:
    """Patches meet node for node: what one element alone has lies on the outside, plate and pillar together are closed."""
    mesh = panel_mesh(panel, STACK, pillar, SETTINGS).mesh
    (local,) = mesh.element.facets
    facets = np.concatenate([mesh.cells[:, face] for face in local])
    counts = Counter(tuple(sorted(facet)) for facet in facets.tolist())
    assert set(counts.values()) == {1, 2}
    single = np.array([facet for facet, count in counts.items() if count == 1])
    corners = mesh.nodes[single]
    half = (np.array(panel.high) - panel.low) / 2.0
    foot = np.append(np.array(panel.foot) - panel.middle, 0.0)
    sides = [(axis, sign * half[axis]) for axis in (0, 1) for sign in (-1.0, 1.0)]
    sides += [(axis, foot[axis]) for axis in panel.halved] + [(2, 0.0), (2, T), (2, T + H)]
    near = 1e-9 * H
    on_plane = np.any([(np.abs(corners[:, :, axis] - at) < near).all(axis=1) for axis, at in sides], axis=0)
    above = (corners[:, :, 2] >= T - near).all(axis=1)
    assert (on_plane | above).all(), "a crack within the plate"
    wall = corners[~on_plane]
    if pillar.shape == "round":
        reach = np.linalg.norm(wall[:, :, :2] - foot[:2], axis=2)
        assert np.abs(reach / (W / 2.0) - 1.0).max() < 1e-12, "a crack within the pillar"


@pytest.mark.slow
def test_coarser_meshes_are_nested(panel: Panel, pillar: Pillar) -> None:
    """A field that a coarser mesh can hold is prolonged exactly; without the innermost layer the geometry itself is one."""
    fine, layer = panel_mesh(panel, STACK, pillar, SETTINGS), panel_mesh(panel, STACK, pillar, SETTINGS.coarser)
    lower = panel_mesh(panel, STACK, pillar, replace(SETTINGS, order=2))
    assert len(layer.mesh.cells) < len(fine.mesh.cells) == len(lower.mesh.cells)
    for coarse in (layer, lower):
        prolonged = transfer(coarse, fine)
        assert prolonged @ np.ones(prolonged.shape[1]) == pytest.approx(np.ones(prolonged.shape[0]))
    assert np.abs(transfer(layer, fine) @ layer.mesh.nodes - fine.mesh.nodes).max() < 1e-12 * H
    # the arc of order 2 bends away from that of order 3 by (pi/16)^3 of the radius or less
    assert np.abs(transfer(lower, fine) @ lower.mesh.nodes - fine.mesh.nodes).max() < (pi / 16.0) ** 3 * W / 2.0


def test_what_hexahedra_cannot_follow_is_refused() -> None:
    flush = Panel((-2e-3, -W / 2.0), (2e-3, 2e-3), (0.0, 0.0))
    filleted = replace(SQUARE, fillet_m=0.2e-3)
    for pillar, panel in ((PILLARS["round"], flush), (filleted, CENTRED)):
        with pytest.raises(MeshError, match=r"hexahedra cannot follow|is not made of boxes"):
            panel_mesh(panel, STACK, pillar, SETTINGS)
    assert check_mesh(panel_mesh(flush, STACK, PILLARS["narrowing"], SETTINGS).mesh)


def test_pillars_on_both_faces_are_each_others_image(pillar: Pillar) -> None:
    mesh = panel_mesh(OFF_CENTRE, STACK, replace(pillar, faces=2), SETTINGS).mesh
    plate = (OFF_CENTRE.high[0] - OFF_CENTRE.low[0]) * (OFF_CENTRE.high[1] - OFF_CENTRE.low[1]) * T
    one = volume_m3(OFF_CENTRE, pillar) - plate
    assert check_mesh(mesh).volume_m3 == pytest.approx(plate + 2.0 * one, rel=1e-6)
    assert cell_volumes(mesh)[mesh.regions["pillar"]].sum() == pytest.approx(2.0 * one, rel=1e-5)
    turned = mesh.nodes * [1.0, 1.0, -1.0] + [0.0, 0.0, T]
    places = [{tuple(node) for node in np.round(1e10 * nodes).tolist()} for nodes in (mesh.nodes, turned)]
    assert places[0] == places[1]
    foot = {"round": pi / 4.0, "hexagonal": np.sqrt(0.75)}.get(pillar.shape, 1.0) * W**2
    assert face_quadrature(mesh, "touch").weights.sum() == pytest.approx(plate / T - foot, rel=1e-5)


def test_a_mirror_image_that_keeps_its_lines_is_turned_inside_out(monkeypatch: pytest.MonkeyPatch) -> None:
    """The check of the mesh sees a reflection that forgets the handedness of the elements."""

    def careless(patch: panels.Patch, signs: tuple[int, int], origin: np.ndarray) -> panels.Patch:
        return replace(patch, place=lambda u, v: patch.place(u, v) * np.array(signs) + origin)

    monkeypatch.setattr("geometry.hex.panels._reflected", careless)
    with pytest.raises(MeshError):
        check_mesh(panel_mesh(OFF_CENTRE, STACK, PILLARS["round"], SETTINGS).mesh)


@pytest.mark.parametrize("shape", ["round", "hexagonal"])
def test_quadrants_of_unlike_room_meet_node_for_node(shape: str) -> None:
    """A foot many thicknesses wide, tight on one side and free on others: every quadrant has the elements of the widest."""
    wide = replace(SQUARE, shape=shape, base_m=8e-3, tip_m=8e-3)
    panel = Panel((-5.0e-3, -4.2e-3), (9.0e-3, 7.0e-3), (0.0, 0.0))
    settings = HexSettings(3, 2e-3, 1, 0.15, H / 4.0)
    mesh = panel_mesh(panel, THIN_STACK, wide, settings).mesh
    area = {"round": pi / 4.0, "hexagonal": np.sqrt(0.75)}[shape] * 64e-6
    assert check_mesh(mesh).volume_m3 == pytest.approx(14.0e-3 * 11.2e-3 * 1e-3 + area * H, rel=1e-6)


def test_patches_that_do_not_meet_are_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    """Planted: one quadrant has another number of elements between rim and block than its neighbours."""
    counted = iter(range(100))

    def uneven(half: float, block: tuple[float, float], lines: panels.PlanLines):
        fill = np.linspace(0.0, 1.0, 2 + next(counted) % 2)
        return panels.disc(half, block, replace(lines, fill=fill))

    monkeypatch.setitem(panels.PLANS, "disc", (uneven, (1.0, 1.0)))
    with pytest.raises(MeshError, match="do not meet node for node"):
        panel_mesh(OFF_CENTRE, STACK, PILLARS["round"], SETTINGS)
