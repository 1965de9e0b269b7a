"""A mesh as other programs store it: blocks of one cell type each, named groups of cells and of nodes.

Local nodes stand in VTK's order here; `PLACES` says which corners each local node is the middle of.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from geometry.elements import TOPOLOGY, FloatArray, IntArray, Rings, element
from geometry.errors import MeshFileError
from geometry.mesh import Mesh

# -- cell types --------------------------------------------------------------------------------------------------------

# Cell types: their number in Gmsh and their name in MED; digits at the end of a name count its nodes.
PROGRAMS = {
    "vertex": (15, "PO1"), "line": (1, "SE2"), "line3": (8, "SE3"), "triangle": (2, "TR3"), "triangle6": (9, "TR6"),
    "quad": (3, "QU4"), "quad8": (16, "QU8"), "quad9": (10, "QU9"), "tetra": (4, "TE4"), "tetra10": (11, "T10"),
    "hexahedron": (5, "HE8"), "hexahedron20": (17, "H20"), "hexahedron27": (12, "H27"), "wedge": (6, "PE6"),
    "wedge15": (18, "P15"), "wedge18": (13, "P18"), "pyramid": (7, "PY5"), "pyramid13": (19, "P13"), "pyramid14": (14, ""),
}  # fmt: skip
KINDS = {"tetra": "tet", "hexahedron": "hex", "wedge": "wedge", "pyramid": "pyramid"}
VOLUME = {("tet", 1): "tetra", ("tet", 2): "tetra10", ("hex", 1): "hexahedron", ("hex", 2): "hexahedron27"}
VOLUME |= {("wedge", 1): "wedge", ("wedge", 2): "wedge18", ("pyramid", 1): "pyramid", ("pyramid", 2): "pyramid14"}
FACET = {("tet", 1): "triangle", ("tet", 2): "triangle6", ("hex", 1): "quad", ("hex", 2): "quad9"}
FULL = {"hexahedron20": "hexahedron27", "wedge15": "wedge18", "pyramid13": "pyramid14"}


def family(cell_type: str) -> str:
    """Return the straight cell type with the same corners, such as tetra for tetra10.

    Parameters
    ----------
    cell_type : str
        Cell type, a key of PROGRAMS.

    Returns
    -------
    str
        Cell type of order 1.
    """
    return cell_type.rstrip("0123456789")


def _all_places() -> dict[str, Rings]:
    """The corners behind every local node of each family: corners, edges, squares, inside."""
    flat: dict[str, tuple[int, Rings]] = {"vertex": (1, ()), "line": (2, ((0, 1),))}
    flat |= {"triangle": (3, ((0, 1), (1, 2), (2, 0))), "quad": (4, ((0, 1), (1, 2), (2, 3), (3, 0), (0, 1, 2, 3)))}
    for name, kind in KINDS.items():
        own = TOPOLOGY[kind]
        inside = (tuple(range(8)),) if kind == "hex" else ()
        flat[name] = (len(own.corners), (*own.edges, *own.squares, *inside))
    return {name: (*((corner,) for corner in range(corners)), *more) for name, (corners, more) in flat.items()}


_ALL = _all_places()
CORNER_COUNT = {name: sum(len(place) == 1 for place in _ALL[family(name)]) for name in PROGRAMS}
DIMENSION = {name: {"vertex": 0, "line": 1, "triangle": 2, "quad": 2}.get(family(name), 3) for name in PROGRAMS}
PLACES: dict[str, Rings] = {
    name: _ALL[family(name)][: int(name.removeprefix(family(name)) or CORNER_COUNT[name])] for name in PROGRAMS
}
# corners of an element turned inside out
MIRRORED = {
    "tetra": (0, 2, 1, 3),
    "hexahedron": (0, 3, 2, 1, 4, 7, 6, 5),
    "wedge": (0, 2, 1, 3, 5, 4),
    "pyramid": (0, 3, 2, 1, 4),
}


def order_of(cell_type: str, places: Iterable[Iterable[int]]) -> IntArray:
    """Return a program's local node at each of VTK's places.

    Parameters
    ----------
    cell_type : str
        Cell type, a key of PLACES.
    places : iterable of iterable of int
        For each of the program's local nodes, the corners in VTK's order that it is the middle of.

    Returns
    -------
    ndarray, shape (k,)
        Local nodes of the program, in VTK's order.
    """
    known = [frozenset(place) for place in places]
    return np.array([known.index(frozenset(place)) for place in PLACES[cell_type]])


def mirrored(cell_type: str, places: Rings) -> list[list[int]]:
    """Return the places of an element seen in a mirror.

    Parameters
    ----------
    cell_type : str
        Type of a volume cell.
    places : sequence of sequence of int
        Corners behind each local node.

    Returns
    -------
    list of list of int
        Corners behind each local node, exchanged as the mirror exchanges them.
    """
    return [[MIRRORED[family(cell_type)][corner] for corner in place] for place in places]


# -- meshes ------------------------------------------------------------------------------------------------------------


def require_file(file: Path) -> None:
    """Require a regular file: a device or a pipe may have no end.

    Parameters
    ----------
    file : Path
        Path to check.

    Raises
    ------
    MeshFileError
        For anything but a regular file.
    """
    if not file.is_file():
        what = "not a regular file" if file.exists() else "no such mesh file"
        raise MeshFileError(f"{file}: {what}")


@dataclass(frozen=True)
class RawMesh:
    """A mesh as other programs store it.

    Attributes
    ----------
    points : ndarray, shape (n, 3)
        Nodes in the unit of the file.
    blocks : list of tuple
        Cell type and nodes (m, k) of each block, in VTK's order.
    cell_groups : dict of dict
        Cells by name of the group and number of the block.
    node_groups : dict of ndarray, shape (n,)
        Nodes by name of the group.
    left_out : tuple of str
        Definitions in the file that would change the modes and are not read.
    """

    points: FloatArray
    blocks: list[tuple[str, IntArray]]
    cell_groups: dict[str, dict[int, IntArray]] = field(default_factory=dict)
    node_groups: dict[str, IntArray] = field(default_factory=dict)
    left_out: tuple[str, ...] = ()


def local_nodes(kind: str, order: int) -> IntArray:
    """Return our local node at each of VTK's places of a volume cell.

    Parameters
    ----------
    kind : {'hex', 'tet', 'wedge', 'pyramid'}
        Shape of the element.
    order : int
        Order of the element, 1 or 2.

    Returns
    -------
    ndarray, shape (k,)
        Our local nodes in VTK's order.
    """
    corners = TOPOLOGY[kind].corners
    return element(kind, order).nodes_at(np.array([corners[list(p)].mean(axis=0) for p in PLACES[VOLUME[kind, order]]]))


@dataclass(frozen=True)
class Facets:
    """Outward facets in VTK's order (m, k), the elements (m,) that they belong to and those elements' faces (m,)."""

    nodes: IntArray
    cells: IntArray
    local: IntArray


def outer_facets(mesh: Mesh) -> Facets:
    """Find the facets that belong to one element only.

    Parameters
    ----------
    mesh : Mesh
        Hexahedra or tetrahedra of order 1 or 2.

    Returns
    -------
    Facets
        Outward facets in VTK's order.
    """
    local = _outward_faces(mesh)
    facets = mesh.cells[:, local].reshape(-1, local.shape[1])
    keys = _corner_keys(facets, 3 if mesh.kind == "tet" else 4)
    _, index, counts = np.unique(keys, axis=0, return_index=True, return_counts=True)
    outer = np.sort(index[counts == 1])
    return Facets(facets[outer], outer // len(local), outer % len(local))


def _outward_faces(mesh: Mesh) -> IntArray:
    """Local nodes of each face of an element in VTK's order, seen from outside anticlockwise."""
    own = TOPOLOGY[mesh.kind]
    rings = own.corners[np.array(own.triangles or own.squares)]
    places = PLACES[FACET[mesh.kind, mesh.order]]
    return mesh.element.nodes_at(np.stack([rings[:, list(place)].mean(axis=1) for place in places], axis=1))


def _corner_keys(facets: IntArray, corners: int) -> IntArray:
    """Sorted corner nodes, the same for both sides of a face."""
    return np.sort(facets[:, :corners], axis=1)


def rows_in(rows: IntArray, table: IntArray) -> IntArray:
    """Find rows in a table.

    Parameters
    ----------
    rows : ndarray, shape (m, k)
        Rows to look up.
    table : ndarray, shape (n, k)
        Distinct rows.

    Returns
    -------
    ndarray, shape (m,)
        Place of each row in the table; -1 if absent.
    """
    both, inverse = np.unique(np.vstack([table, rows]), axis=0, return_inverse=True)
    place = np.full(len(both), -1, dtype=np.int64)
    place[inverse[: len(table)]] = np.arange(len(table))
    return np.asarray(place[inverse[len(table) :]])


# -- elements without middles of faces ---------------------------------------------------------------------------------
# Hexahedra of 20 nodes (C3D20, HE20), wedges of 15 (C3D15) and pyramids of 13 as those of 27, 18 and 14 nodes.
# Square faces and hexahedra get the middles that they lack. The full map through those points is the map without
# them, so that curved bodies stay as they are; its displacements are richer, its frequencies at most those of the
# element in the file.


OFF_MIDDLE = 0.3  # of an edge: a node farther from its place than this is not the node we think it is


def placed_middles(points: FloatArray, cells: IntArray, cell_type: str, file: str) -> IntArray:
    """Return the middle nodes of cells in VTK's order.

    The format defines their order, which curved elements need. Where a straight-edged mesh contradicts it, its writer
    followed another convention, and each node goes to the middle that it lies at.

    Parameters
    ----------
    points : ndarray, shape (n, 3)
        Nodes, in any unit.
    cells : ndarray, shape (m, k)
        Corner nodes, then middle nodes.
    cell_type : str
        Cell type, a key of PLACES.
    file : str
        Name of the file, for the message.

    Returns
    -------
    ndarray, shape (m, k - corners)
        Middle nodes in VTK's order.

    Raises
    ------
    MeshFileError
        If a middle node lies outside its element and the nodes fit no order.
    """
    count = CORNER_COUNT[cell_type]
    corners, middles, places = cells[:, :count], cells[:, count:], PLACES[cell_type][count:]
    middle = np.stack([points[corners[:, list(place)]].mean(axis=1) for place in places], axis=1)
    edges = [np.linalg.norm(points[corners[:, place[0]]] - points[corners[:, place[-1]]], axis=1) for place in places]
    size = np.ptp(points[corners], axis=1).max(axis=1)
    allowed = OFF_MIDDLE * np.minimum(np.stack(edges, axis=1), size[:, None])
    if not (np.linalg.norm(points[middles] - middle, axis=2) > allowed).any():
        return middles
    distance = np.linalg.norm(points[middles][:, :, None] - middle[:, None], axis=3)  # element, node, place
    nearest = distance.argmin(axis=1)
    fits = (distance.min(axis=1) <= allowed).all() and (np.sort(nearest, axis=1) == np.arange(len(places))).all()
    if fits:
        return np.take_along_axis(middles, nearest, axis=1)
    far = np.flatnonzero((np.linalg.norm(points[middles] - middle, axis=2) > size[:, None]).any(axis=1))
    if len(far):
        raise MeshFileError(f"{file}: element {far[0]}: a middle node lies outside the element: unknown node order")
    return middles  # curved: check_mesh looks at the map itself


def completed(raw: RawMesh, file: str) -> RawMesh:
    """Add the middles of square faces and hexahedra to cells without them.

    A face keeps the middle that a complete neighbouring element names for it.

    Parameters
    ----------
    raw : RawMesh
        Mesh as read.
    file : str
        Name of the file, for the message.

    Returns
    -------
    RawMesh
        The mesh with cells of 27, 18 and 14 nodes instead of 20, 15 and 13; others stay as they are.

    Raises
    ------
    MeshFileError
        As `placed_middles`.
    """
    if not any(kind in FULL and len(block) for kind, block in raw.blocks):
        return raw
    points, blocks = raw.points, list(raw.blocks)
    keys, nodes = _named_middles(raw, file)
    for index, (kind, block) in enumerate(raw.blocks):
        if kind not in FULL or not len(block):
            continue
        corners, edges = block[:, : CORNER_COUNT[kind]], placed_middles(points, block, kind, file)
        own = _corner_keys(corners[:, np.array(_squares(kind))].reshape(-1, 4), 4)
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
    added = nodes >= len(raw.points)  # they join a group that holds the corners of their face
    groups = {
        name: np.union1d(members, nodes[np.isin(keys, members).all(axis=1) & added])
        for name, members in raw.node_groups.items()
    }
    return replace(raw, points=points, blocks=blocks, node_groups=groups)


def _squares(kind: str) -> Rings:
    """Corners of the square faces that a cell without their middles has, in the order of their middles."""
    return tuple(place for place in PLACES[FULL[kind]][len(PLACES[kind]) :] if len(place) == 4)


def _named_middles(raw: RawMesh, file: str) -> tuple[IntArray, IntArray]:
    """Sorted corners (m, 4) and middles (m,) of the square faces that elements name, where others do not."""
    keys, nodes = [np.empty((0, 4), dtype=np.int64)], [np.empty(0, dtype=np.int64)]
    for kind, block in raw.blocks:
        if kind not in FULL.values() or not len(block):
            continue
        placed = placed_middles(raw.points, block, kind, file)
        for column, place in enumerate(PLACES[kind][CORNER_COUNT[kind] :]):
            if len(place) == 4:
                keys.append(_corner_keys(block[:, list(place)], 4))
                nodes.append(placed[:, column])
    distinct, first = np.unique(np.vstack(keys), axis=0, return_index=True)
    return distinct, np.concatenate(nodes)[first]


def _face_middle(
    points: FloatArray, corners: IntArray, edges: IntArray, kind: str, face: tuple[int, ...]
) -> FloatArray:
    """Middle of a square face by the map without it: half the sum of its edges' middles less a quarter of its corners."""
    around = [i for i, edge in enumerate(PLACES[kind][CORNER_COUNT[kind] :]) if set(edge) <= set(face)]
    return np.asarray(points[edges[:, around]].sum(axis=1) / 2.0 - points[corners[:, list(face)]].sum(axis=1) / 4.0)
