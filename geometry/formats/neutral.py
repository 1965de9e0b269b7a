"""A mesh as other programs name it: blocks of one cell type each, named groups of cells and of nodes.

Local nodes stand in VTK's order here; `PLACES` says which corners each local node is the middle of.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from geometry.elements import (
    PYRAMID_EDGES,
    PYRAMID_SQUARES,
    TET_EDGES,
    WEDGE_EDGES,
    WEDGE_SQUARES,
    FloatArray,
    IntArray,
)
from geometry.errors import MeshFileError
from geometry.formats.vtk import CORNERS
from geometry.mesh import Mesh

Places = tuple[tuple[int, ...], ...]

HEX_EDGES = ((0, 1), (1, 2), (2, 3), (3, 0), (4, 5), (5, 6), (6, 7), (7, 4), (0, 4), (1, 5), (2, 6), (3, 7))
_HEX_FACES = ((0, 3, 7, 4), (1, 2, 6, 5), (0, 1, 5, 4), (3, 2, 6, 7), (0, 1, 2, 3), (4, 5, 6, 7))


def _corners(count: int) -> Places:
    return tuple((corner,) for corner in range(count))


PLACES: dict[str, Places] = {
    "triangle": _corners(3),
    "triangle6": (*_corners(3), (0, 1), (1, 2), (2, 0)),
    "quad": _corners(4),
    "quad9": (*_corners(4), (0, 1), (1, 2), (2, 3), (3, 0), (0, 1, 2, 3)),
    "tetra": _corners(4),
    "tetra10": (*_corners(4), *map(tuple, TET_EDGES.tolist())),
    "hexahedron": _corners(8),
    "hexahedron20": (*_corners(8), *HEX_EDGES),
    "hexahedron27": (*_corners(8), *HEX_EDGES, *_HEX_FACES, tuple(range(8))),
    "wedge": _corners(6),
    "wedge15": (*_corners(6), *WEDGE_EDGES),
    "wedge18": (*_corners(6), *WEDGE_EDGES, *WEDGE_SQUARES),
    "pyramid": _corners(5),
    "pyramid13": (*_corners(5), *PYRAMID_EDGES),
    "pyramid14": (*_corners(5), *PYRAMID_EDGES, *PYRAMID_SQUARES),
}
CORNER_COUNT = {"triangle": 3, "quad": 4, "tetra": 4, "hexahedron": 8, "wedge": 6, "pyramid": 5}
VOLUME = {("tet", 1): "tetra", ("tet", 2): "tetra10", ("hex", 1): "hexahedron", ("hex", 2): "hexahedron27"}
VOLUME |= {("wedge", 1): "wedge", ("wedge", 2): "wedge18", ("pyramid", 1): "pyramid", ("pyramid", 2): "pyramid14"}
FACET = {("tet", 1): "triangle", ("tet", 2): "triangle6", ("hex", 1): "quad", ("hex", 2): "quad9"}


def require_file(file: Path) -> None:
    """MeshFileError where no regular file stands: a device or a pipe may have no end."""
    if not file.is_file():
        what = "not a regular file" if file.exists() else "no such mesh file"
        raise MeshFileError(f"{file}: {what}")


def family(cell_type: str) -> str:
    """The straight cell type with the same corners: tetra for tetra10."""
    return cell_type.rstrip("0123456789")


@dataclass(frozen=True)
class RawMesh:
    """Points (n, 3), blocks (cell type, nodes (m, k)), groups of cells {name: {block: cells}} and of nodes {name: nodes}.

    left_out: what the file says that would change modes and is not read.
    """

    points: FloatArray
    blocks: list[tuple[str, IntArray]]
    cell_groups: dict[str, dict[int, IntArray]] = field(default_factory=dict)
    node_groups: dict[str, IntArray] = field(default_factory=dict)
    left_out: tuple[str, ...] = ()


def local_nodes(kind: str, order: int) -> IntArray:
    """Our local node at each of VTK's places of a volume cell of order 1 or 2."""
    places = PLACES[VOLUME[kind, order]]
    if kind != "hex":
        return np.arange(len(places))
    corners = order * np.array(CORNERS)
    grid = np.array([corners[list(place)].mean(axis=0) for place in places])
    return np.asarray(np.rint(grid @ (order + 1) ** np.arange(3)), dtype=np.int64)


def facet_nodes(kind: str, order: int) -> IntArray:
    """Our local node of a named face (hexahedra: u fastest) at each of VTK's places of its facet cell."""
    places = PLACES[FACET[kind, order]]
    if kind == "tet":
        return np.arange(len(places))
    corners = order * np.array([(0, 0), (1, 0), (1, 1), (0, 1)])
    grid = np.array([corners[list(place)].mean(axis=0) for place in places])
    return np.asarray(np.rint(grid @ [1, order + 1]), dtype=np.int64)


def outer_facets(mesh: Mesh) -> tuple[IntArray, IntArray, IntArray]:
    """Facets that belong to one element, outward, in VTK's order (m, k); their elements (m,) and local faces (m,)."""
    local = outward_faces(mesh)
    facets = mesh.cells[:, local].reshape(-1, local.shape[1])
    keys = corner_keys(facets, 3 if mesh.kind == "tet" else 4)
    _, index, counts = np.unique(keys, axis=0, return_index=True, return_counts=True)
    outer = np.sort(index[counts == 1])
    return facets[outer], outer // len(local), outer % len(local)


def outward_faces(mesh: Mesh) -> IntArray:
    """Local nodes of each face of an element in VTK's order, seen from outside anticlockwise."""
    local = mesh.element.facets[0][:, facet_nodes(mesh.kind, mesh.order)]
    at = mesh.element.points
    a, b, c = (at[local[:, i]] for i in (0, 1, 2))
    outward = np.einsum("fi,fi->f", np.cross(b - a, c - a), a - at.mean(axis=0)) > 0.0
    return np.where(outward[:, None], local, local[:, _reversed(FACET[mesh.kind, mesh.order])])


def _reversed(cell_type: str) -> IntArray:
    """A facet run the other way round from the same first corner."""
    places = PLACES[cell_type]
    count = CORNER_COUNT[family(cell_type)]
    image = [frozenset((-corner) % count for corner in place) for place in places]
    named = [frozenset(place) for place in places]
    return np.array([named.index(place) for place in image])


def corner_keys(facets: IntArray, corners: int) -> IntArray:
    """Sorted corner nodes, the same for both sides of a face."""
    return np.sort(facets[:, :corners], axis=1)


def rows_in(rows: IntArray, table: IntArray) -> IntArray:
    """For each row its place in `table` (unique rows), -1 where it has none."""
    both, inverse = np.unique(np.vstack([table, rows]), axis=0, return_inverse=True)
    place = np.full(len(both), -1, dtype=np.int64)
    place[inverse[: len(table)]] = np.arange(len(table))
    return np.asarray(place[inverse[len(table) :]])


# -- elements without middles of faces ---------------------------------------------------------------------------------
# Hexahedra of 20 nodes (C3D20, HE20), wedges of 15 (C3D15) and pyramids of 13 as those of 27, 18 and 14 nodes.
# Square faces and hexahedra get the middles that they lack. The full map through those points is the map without
# them, so that curved bodies stay as they are; its displacements are richer, its frequencies at most those of the
# element in the file.

FULL = {"hexahedron20": "hexahedron27", "wedge15": "wedge18", "pyramid13": "pyramid14"}
Middles = Callable[[FloatArray, IntArray, IntArray, Places, str], IntArray]


def completed(raw: RawMesh, middles: Middles, file: str) -> RawMesh:
    """The mesh with its square faces' and hexahedra's middles; `middles` puts the nodes on edges into our order.

    A face that a complete element beside it names a middle of keeps that one. Raises what `middles` raises.
    """
    points = raw.points
    keys, nodes = _named_middles(raw, middles, file)
    blocks = list(raw.blocks)
    for index, (kind, block) in enumerate(raw.blocks):
        if kind not in FULL or not len(block):
            continue
        count = CORNER_COUNT[family(kind)]
        corners = block[:, :count]
        edges = middles(points, corners, block[:, count:], PLACES[kind][count:], file)
        own = corner_keys(corners[:, np.array(_squares(kind))].reshape(-1, 4), 4)
        places = np.stack([_face_middle(points, corners, edges, kind, face) for face in _squares(kind)], axis=1)
        keys, first = np.unique(np.vstack([keys, own]), axis=0, return_index=True)
        number = np.concatenate([nodes, np.full(len(own), -1)])[first]
        fresh = number < 0
        number[fresh] = len(points) + np.arange(fresh.sum())
        points = np.vstack([points, places.reshape(-1, 3)[first[fresh] - len(nodes)]])
        nodes = number
        full = [corners, edges, nodes[rows_in(own, keys)].reshape(len(block), -1)]
        if kind == "hexahedron20":
            full.append(len(points) + np.arange(len(block))[:, None])
            points = np.vstack([points, (points[edges].sum(axis=1) - points[corners].sum(axis=1)) / 4.0])
        blocks[index] = (FULL[kind], np.hstack(full))
    groups = {name: _with_middles(members, keys, nodes, len(raw.points)) for name, members in raw.node_groups.items()}
    return replace(raw, points=points, blocks=blocks, node_groups=groups)


def _with_middles(members: IntArray, keys: IntArray, nodes: IntArray, given: int) -> IntArray:
    """A group of nodes with the added middles of the faces whose corners it holds."""
    inside = np.isin(keys, members).all(axis=1) & (nodes >= given) if len(keys) else np.zeros(0, dtype=bool)
    return np.union1d(members, nodes[inside])


def _squares(kind: str) -> Places:
    """Corners of the square faces that a cell without their middles has, in the order of their middles."""
    return tuple(place for place in PLACES[FULL[kind]][len(PLACES[kind]) :] if len(place) == 4)


def _named_middles(raw: RawMesh, middles: Middles, file: str) -> tuple[IntArray, IntArray]:
    """Sorted corners (m, 4) and middles (m,) of the square faces that elements name, where others do not."""
    if not any(kind in FULL and len(block) for kind, block in raw.blocks):
        return np.empty((0, 4), dtype=np.int64), np.empty(0, dtype=np.int64)
    keys, nodes = [np.empty((0, 4), dtype=np.int64)], [np.empty(0, dtype=np.int64)]
    for kind, block in raw.blocks:
        if kind not in FULL.values() or not len(block):
            continue
        count = CORNER_COUNT[family(kind)]
        placed = middles(raw.points, block[:, :count], block[:, count:], PLACES[kind][count:], file)
        for column, place in enumerate(PLACES[kind][count:]):
            if len(place) == 4:
                keys.append(corner_keys(block[:, list(place)], 4))
                nodes.append(placed[:, column])
    distinct, first = np.unique(np.vstack(keys), axis=0, return_index=True)
    return distinct, np.concatenate(nodes)[first]


def _face_middle(
    points: FloatArray, corners: IntArray, edges: IntArray, kind: str, face: tuple[int, ...]
) -> FloatArray:
    """Where the map without it puts the middle of a square face: half its edges' middles less a quarter of its corners."""
    around = [i for i, edge in enumerate(PLACES[kind][CORNER_COUNT[family(kind)] :]) if set(edge) <= set(face)]
    return np.asarray(points[edges[:, around]].sum(axis=1) / 2.0 - points[corners[:, list(face)]].sum(axis=1) / 4.0)
