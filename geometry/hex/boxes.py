"""Structured hexahedra of order 1 to 4 for scenes made of boxes along the axes.

A scene is a tensor grid and a mask: which boxes are solid, and to which region each belongs.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import wraps
from typing import TYPE_CHECKING, ParamSpec

import numpy as np

from geometry.elements import BoolArray, FloatArray, IntArray, gauss_lobatto, lagrange
from geometry.errors import MeshError
from geometry.hex.scenes import (
    Scene,
    bonded_scene,
    cell_scene,
    grid_lines,
    panel_scene,
    part_scene,
    pillar_scene,
    plate_scene,
    zone_scene,
)
from geometry.materials import layer_names
from geometry.mesh import Mesh

if TYPE_CHECKING:
    from scipy.sparse import csr_array

VOID = -1


@dataclass(frozen=True)
class Boxes:
    """A tensor grid (lines in m along x, y, z) with a region number per box, shape (nx, ny, nz), -1 where void."""

    x: FloatArray
    y: FloatArray
    z: FloatArray
    region: IntArray
    names: tuple[str, ...]


def hex_mesh(boxes: Boxes, order: int) -> Mesh:
    """Mesh every solid box of a grid by one hexahedron.

    Faces are x-, x+, y-, y+ and top on the sides of the grid, and touch, the underside of the lowest body where nothing
    hangs.

    Parameters
    ----------
    boxes : Boxes
        Grid with the solid boxes marked.
    order : int
        Order of the elements, 1 to 4.

    Returns
    -------
    Mesh
        Hexahedra in m, with a region per body.
    """
    solid, full = _solid_elements(boxes, order)
    lines = [_nodal_line(axis, order) for axis in (boxes.x, boxes.y, boxes.z)]
    counts = [len(line) for line in lines]
    used, cells = np.unique(full, return_inverse=True)
    cells = cells.reshape(len(solid), -1).astype(np.int64)
    nodes = np.column_stack(
        [lines[0][used % counts[0]], lines[1][used // counts[0] % counts[1]], lines[2][used // (counts[0] * counts[1])]]
    )
    spans = np.column_stack([np.diff(axis)[solid[:, i]] for i, axis in enumerate((boxes.x, boxes.y, boxes.z))])
    numbers = boxes.region[tuple(solid.T)]
    regions = {name: np.flatnonzero(numbers == i) for i, name in enumerate(boxes.names) if (numbers == i).any()}
    mesh = Mesh(nodes, cells, "hex", order, regions, {}, spans)
    return Mesh(nodes, cells, "hex", order, regions, _outer_faces(mesh, boxes, solid), spans)


def _solid_elements(boxes: Boxes, order: int) -> tuple[IntArray, IntArray]:
    """Places (n, 3) of the solid boxes, x fastest, and their nodes' numbers (n, nodes) in the full grid."""
    solid = np.argwhere(boxes.region.transpose(2, 1, 0) >= 0)[:, ::-1]
    counts = [order * (len(axis) - 1) + 1 for axis in (boxes.x, boxes.y)]
    local = np.arange(order + 1)
    ix, iy, iz = (order * solid[:, axis, None] + local for axis in range(3))
    full = ix[:, None, None, :] + counts[0] * (iy[:, None, :, None] + counts[1] * iz[:, :, None, None])
    return solid, full.reshape(len(solid), -1)


def _used_nodes(boxes: Boxes, order: int) -> IntArray:
    """Numbers in the full grid of the nodes of `hex_mesh`, in its order, x fastest."""
    return np.unique(_solid_elements(boxes, order)[1])


def _nodal_line(lines: FloatArray, order: int) -> FloatArray:
    """Coordinates of the nodes of elements of an order along one axis."""
    inner = (gauss_lobatto(order) + 1.0) / 2.0
    steps = lines[:-1, None] + np.diff(lines)[:, None] * inner[None, :-1]
    return np.append(steps.ravel(), lines[-1])


def _outer_faces(mesh: Mesh, boxes: Boxes, solid: IntArray) -> dict[str, IntArray]:
    """The faces on the sides of the grid's bounding box, and below the lowest body where nothing hangs."""
    (local,) = mesh.element.facets
    floor = int(np.flatnonzero((boxes.region == 0).any(axis=(0, 1)))[0])
    hung = boxes.region[solid[:, 0], solid[:, 1], floor - 1] != VOID if floor else np.zeros(len(solid), dtype=bool)
    last = [len(boxes.x) - 2, len(boxes.y) - 2, len(boxes.z) - 2]
    sides = {
        "x-": (0, solid[:, 0] == 0),
        "x+": (1, solid[:, 0] == last[0]),
        "y-": (2, solid[:, 1] == 0),
        "y+": (3, solid[:, 1] == last[1]),
        "touch": (4, (solid[:, 2] == floor) & ~hung),
        "top": (5, solid[:, 2] == last[2]),
    }
    return {name: mesh.cells[on][:, local[face]] for name, (face, on) in sides.items() if on.any()}


# -- boxes of scenes ---------------------------------------------------------------------------------------------------


def boxes_of(scene: Scene) -> Boxes:
    """Make the tensor grid of a scene, with its solid boxes marked.

    Parameters
    ----------
    scene : Scene
        Breakpoints in m, gradings and feet.

    Returns
    -------
    Boxes
        Grid in m.
    """
    lines_x, lines_y = grid_lines(scene.x, scene.across), grid_lines(scene.y, scene.across)
    z = grid_lines(scene.z, scene.through)
    layers = len(z) - 1
    if scene.above is not None and scene.along is not None:
        z = np.append(z, grid_lines(scene.above, scene.along)[1:])
    names = (scene.name, *dict.fromkeys(foot.region for foot in scene.feet), *layer_names(len(scene.joints) + 1)[1:])
    region = np.full(_cuts(lines_x, lines_y, z), VOID, dtype=np.int64)
    region[_inside(lines_x, lines_y, scene.body), :layers] = 0
    middles = (z[1:] + z[:-1]) / 2.0
    for number, joint in enumerate(scene.joints):
        beyond = slice(int(np.searchsorted(middles, joint)), layers)
        region[:, :, beyond][region[:, :, beyond] >= 0] = len(names) - len(scene.joints) + number
    for foot in scene.feet:
        first, last = np.searchsorted(middles, (foot.bottom_m, foot.top_m))
        for centre in foot.centres:
            region[_inside(lines_x, lines_y, foot.rectangles, centre), first:last] = names.index(foot.region)
    if scene.faces == 2:
        z = np.concatenate([max(scene.z) - z[:layers:-1], z])
        region = np.concatenate([region[:, :, : layers - 1 : -1], region], axis=2)
    return Boxes(lines_x, lines_y, z, region, names)


P = ParamSpec("P")


def _boxes(scene: Callable[P, Scene]) -> Callable[P, Boxes]:
    """Turn a function that makes a scene into one that makes its boxes."""

    @wraps(scene)
    def boxes(*args: P.args, **kwargs: P.kwargs) -> Boxes:
        return boxes_of(scene(*args, **kwargs))

    return boxes


zone_boxes, pillar_boxes, plate_boxes = _boxes(zone_scene), _boxes(pillar_scene), _boxes(plate_scene)
part_boxes, cell_boxes = _boxes(part_scene), _boxes(cell_scene)
panel_boxes, bonded_boxes = _boxes(panel_scene), _boxes(bonded_scene)


def _inside(
    x: FloatArray, y: FloatArray, rectangles: FloatArray | None, centre: FloatArray | tuple[float, float] = (0.0, 0.0)
) -> BoolArray:
    """Mask of the x and y intervals inside the union of rectangles about a centre, (nx, ny); all without rectangles."""
    if rectangles is None:
        return np.ones(_cuts(x, y), dtype=bool)
    along, across = ((line[1:] + line[:-1]) / 2.0 - c for line, c in zip((x, y), centre, strict=True))
    result = np.zeros(_cuts(x, y), dtype=bool)
    for x0, x1, y0, y1 in rectangles:
        result |= ((along > x0) & (along < x1))[:, None] & ((across > y0) & (across < y1))[None, :]
    return result


def _cuts(*lines: FloatArray) -> tuple[int, ...]:
    return tuple(len(line) - 1 for line in lines)


# -- nested meshes -----------------------------------------------------------------------------------------------------
# Fields prolonged from a mesh of boxes to a finer one that is nested in the same lines.

SAME = 1e-9  # a weight below is zero: the point lies on a node or on a line of the coarse grid


def interpolation(coarse: Boxes, fine: Boxes, order: int, coarse_order: int | None = None) -> csr_array:
    """Build the matrix that carries a field exactly from a mesh of boxes to one nested in it.

    Parameters
    ----------
    coarse, fine : Boxes
        Grids; every line of the coarse one is a line of the fine one.
    order : int
        Order of the fine mesh.
    coarse_order : int, optional
        Order of the coarse mesh, at most `order`; `order` by default.

    Returns
    -------
    csr_array, shape (fine nodes, coarse nodes)
        Values of the coarse shape functions at the fine nodes.

    Raises
    ------
    MeshError
        If the coarse mesh does not cover a node of the fine one.
    """
    lower = coarse_order or order
    lines = [
        _along_a_line(one, other, lower, order)
        for one, other in zip((coarse.x, coarse.y, coarse.z), (fine.x, fine.y, fine.z), strict=True)
    ]
    own, theirs = _used_nodes(fine, order), _used_nodes(coarse, lower)
    counts = [len(line[0]) for line in lines]
    columns, weights = np.zeros((len(own), 1), dtype=np.int64), np.ones((len(own), 1))
    stride = 1
    for axis, place in enumerate((own % counts[0], own // counts[0] % counts[1], own // (counts[0] * counts[1]))):
        index, weight, size = lines[axis]
        columns = (columns[:, :, None] + stride * index[place][:, None, :]).reshape(len(own), -1)
        weights = (weights[:, :, None] * weight[place][:, None, :]).reshape(len(own), -1)
        stride *= size
    row, entry = np.nonzero(np.abs(weights) > SAME)
    known = np.minimum(np.searchsorted(theirs, columns[row, entry]), len(theirs) - 1)
    if (theirs[known] != columns[row, entry]).any():
        raise MeshError("a mesh is not nested in the coarser one: a node lies outside the coarser elements")
    from scipy.sparse import csr_array  # slow to import, and of no use to a plan

    return csr_array((weights[row, entry], (row, known)), shape=(len(own), len(theirs)))


def _along_a_line(
    coarse: FloatArray, fine: FloatArray, order: int, fine_order: int
) -> tuple[IntArray, FloatArray, int]:
    """Coarse nodes and weights (fine nodes, order + 1) along one axis, and the number of coarse nodes."""
    inner, points = (gauss_lobatto(order) + 1.0) / 2.0, _nodal_line(fine, fine_order)
    element = np.clip(np.searchsorted(coarse, points, side="right") - 1, 0, len(coarse) - 2)
    local = (points - coarse[element]) / np.diff(coarse)[element]
    if local.min() < -SAME or local.max() > 1.0 + SAME:
        raise MeshError("a mesh is not nested in the coarser one: it extends beyond it")
    weights, _ = lagrange(inner, local)
    return order * element[:, None] + np.arange(order + 1), weights, order * (len(coarse) - 1) + 1
