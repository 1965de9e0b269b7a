"""Panels of plate meshed by hexahedra about feet that these can follow, and fields prolonged between two meshes of one."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from geometry.elements import FloatArray
from geometry.errors import MeshError
from geometry.hex.boxes import HexSettings, Panel, hex_mesh, panel_boxes
from geometry.hex.grading import Grading, grid_lines
from geometry.hex.nesting import interpolation
from geometry.hex.plan import CORE, CORNERS, Patch, PatchedMesh, PlanLines, disc, hexagon, joined, leaning, reflected
from geometry.layout import Pillar
from geometry.pillar_shapes.square import Square

if TYPE_CHECKING:
    from scipy.sparse import csr_array

ROOM = 0.6  # of half a foot's width: plate beyond the rim that the block fills where the panel has so much
SLIVER = 0.2  # of the same: a strip beyond the block that is narrower belongs to it
CLEAR = 0.02  # of the foot's reach: plate that must lie between rim and side for elements to fill it

Quadrant = Callable[[float, tuple[float, float], PlanLines], Iterator[Patch]]
PLANS: dict[str, tuple[Quadrant, tuple[float, float]]] = {
    "disc": (disc, (1.0, 1.0)),
    "hexagon": (hexagon, (CORNERS, 1.0)),
}


def panel_mesh(panel: Panel, thickness_m: float, pillar: Pillar | None, settings: HexSettings) -> PatchedMesh:
    """A rectangular panel, its own middle at the origin, with its pillar where it has one.

    MeshError for a pillar or a place that hexahedra cannot follow.
    """
    own = panel.pillar or pillar
    if panel.foot is None or own is None or own.is_made_of_boxes:
        return _of_boxes(panel, thickness_m, pillar, settings)
    if not (own.takes_hexahedra and has_room(panel, own)):
        raise MeshError(f"hexahedra cannot follow a {own.shape} pillar in a panel of this size")
    if own.form.plan == "rectangle":
        return _frustum(panel, thickness_m, own, settings)
    return _about_a_foot(panel, thickness_m, own, settings)


def transfer(coarse: PatchedMesh, fine: PatchedMesh) -> csr_array:
    """Matrix (fine nodes, coarse nodes) that carries a field from a panel's mesh to a finer one nested in the same lines."""
    shape = len(fine.mesh.nodes), len(coarse.mesh.nodes)
    rows, columns, weights, known = [], [], [], np.zeros(shape[0], dtype=bool)
    for one, other, own, theirs in zip(coarse.boxes, fine.boxes, fine.numbers, coarse.numbers, strict=True):
        part = interpolation(one, other, fine.mesh.order, coarse.mesh.order).tocoo()
        fresh = ~known[own[part.row]]
        rows.append(own[part.row][fresh])
        columns.append(theirs[part.col][fresh])
        weights.append(part.data[fresh])
        known[own] = True
    from scipy.sparse import csr_array  # slow to import, and of no use to a plan

    return csr_array((np.concatenate(weights), (np.concatenate(rows), np.concatenate(columns))), shape=shape)


def has_room(panel: Panel, pillar: Pillar) -> bool:
    """Whether the panel leaves elements about its foot some plate between rim and side."""
    if pillar.form.plan not in PLANS or panel.foot is None:
        return True
    _, rim = PLANS[pillar.form.plan]
    reach = [(1.0 + CLEAR) * wide * pillar.base_m / 2.0 for wide in rim]
    return all(end >= reach[axis] for axis, ends in enumerate(_ends(panel)) for end in ends.values())


def square_of(pillar: Pillar) -> Pillar:
    """A square prism as wide as a pillar's foot and as high; the pillar itself where it is made of boxes."""
    if pillar.is_made_of_boxes:
        return pillar
    return replace(pillar, shape=Square.name, tip_m=pillar.base_m, fillet_m=0.0, file=None, more_m=())


def _of_boxes(panel: Panel, thickness_m: float, pillar: Pillar | None, settings: HexSettings) -> PatchedMesh:
    boxes = panel_boxes(panel, thickness_m, pillar, settings)
    mesh = hex_mesh(boxes, settings.order)
    return PatchedMesh(mesh, (boxes,), (np.arange(len(mesh.nodes)),))


def _frustum(panel: Panel, thickness_m: float, pillar: Pillar, settings: HexSettings) -> PatchedMesh:
    """The panel of the square prism, whose nodes above the plate move towards the axis or away from it."""
    alike = replace(panel, pillar=square_of(pillar))
    prism = _of_boxes(alike, thickness_m, None, settings)
    mesh = leaning(prism.mesh, foot_from_middle(panel), thickness_m, pillar.height_m, pillar.form.taper)
    return replace(prism, mesh=mesh)


def _about_a_foot(panel: Panel, thickness_m: float, pillar: Pillar, settings: HexSettings) -> PatchedMesh:
    z = lines_along_z(thickness_m, pillar, settings)
    return joined(foot_patches(panel, pillar, settings), z, thickness_m, settings.order)


def foot_patches(
    panel: Panel, pillar: Pillar, settings: HexSettings, grown: float = 1.0, shift_m: tuple[float, float] = (0.0, 0.0)
) -> list[Patch]:
    """Quadrants about the foot, as many as the panel is not halved along.

    Of a pillar `grown` times as wide that stands off its place by `shift_m` the same patches, in the same block of the plate.
    """
    quadrant, rim = PLANS[pillar.form.plan]
    half, origin, grading, patches = pillar.base_m / 2.0, foot_from_middle(panel), settings.grading, []
    x_ends, y_ends = _ends(panel)
    places = [((x, y), (x_end, y_end)) for x, x_end in x_ends.items() for y, y_end in y_ends.items()]
    blocks = [_block(half, rim, ends) for _, ends in places]
    shared = _lines(half, rim, blocks, grading)  # quadrants meet along the axes
    for (signs, ends), block in zip(places, blocks, strict=True):
        less = signs[0] * shift_m[0], signs[1] * shift_m[1]
        beside = _beyond(block[0], ends[0], grading) - less[0], _beyond(block[1], ends[1], grading) - less[1]
        own = quadrant(grown * half, (block[0] - less[0], block[1] - less[1]), replace(shared, beside=beside))
        patches += [reflected(patch, signs, origin + np.array(shift_m)) for patch in own]
    return patches


def lines_along_z(thickness_m: float, pillar: Pillar, settings: HexSettings) -> FloatArray:
    """Lines through the plate and along its pillar, and along its mirror image below."""
    both, high = pillar.faces == 2, thickness_m + pillar.height_m
    z = grid_lines({0.0: both, thickness_m: True}, settings.through_grading(thickness_m))
    along = grid_lines({thickness_m: True, high: False}, settings.pillar_grading)
    below = thickness_m - along[:0:-1] if both else z[:0]
    return np.concatenate([below, z, along[1:]])


def foot_from_middle(panel: Panel) -> FloatArray:
    """The foot's centre from the panel's middle, (2,) m."""
    assert panel.foot is not None
    return np.array(panel.foot) - np.array(panel.middle)


def _ends(panel: Panel) -> tuple[dict[int, float], dict[int, float]]:
    """How far the panel's sides lie from the foot along x and y, m, by direction; those beyond a mirror are left out."""
    assert panel.foot is not None
    ends = []
    for axis in (0, 1):
        both = {1: panel.high[axis] - panel.foot[axis], -1: panel.foot[axis] - panel.low[axis]}
        ends.append({1: both[1]} if axis in panel.halved else both)
    return ends[0], ends[1]


def _block(half: float, rim: tuple[float, float], ends: tuple[float, float]) -> tuple[float, float]:
    """Half-widths of the block about a foot: as far as the panel goes where little lies beyond."""
    wanted = [wide * half + ROOM * half for wide in rim]
    x, y = (end if end <= want + SLIVER * half else want for want, end in zip(wanted, ends, strict=True))
    return x, y


def _lines(half: float, rim: tuple[float, float], blocks: list[tuple[float, float]], grading: Grading) -> PlanLines:
    """The lines that all quadrants share, graded towards the rim from both sides."""
    turns = max(grading.least, int(np.ceil(np.pi / 4.0 * half / grading.size_m)))  # around an eighth of a disc
    core = (1.0 - CORE) * half if rim[0] == rim[1] else half
    fill = max(edge - wide * half for block in blocks for edge, wide in zip(block, rim, strict=True))
    inner, outer = _unit(core, (False, True), grading), _unit(fill, (True, False), grading)
    return PlanLines(np.linspace(0.0, 1.0, turns + 1), inner, outer)


def _unit(length: float, ends: tuple[bool, bool], grading: Grading) -> FloatArray:
    """Lines from 0 to 1 over a length, graded towards the ends that are singular."""
    return grid_lines({0.0: ends[0], 1.0: ends[1]}, replace(grading, size_m=grading.size_m / length))


def _beyond(block: float, end: float, grading: Grading) -> FloatArray:
    return grid_lines({block: False, end: False}, grading) if end > block else np.array([block])
