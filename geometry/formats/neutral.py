"""A mesh as other programs store it: blocks of one cell type each, named groups of cells and of nodes.

Local nodes stand in VTK's order here; `PLACES` says which corners each local node is the middle of.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field
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
    keys = np.sort(facets[:, : 3 if mesh.kind == "tet" else 4], axis=1)
    _, index, counts = np.unique(keys, axis=0, return_index=True, return_counts=True)
    outer = np.sort(index[counts == 1])
    return Facets(facets[outer], outer // len(local), outer % len(local))


def _outward_faces(mesh: Mesh) -> IntArray:
    """Local nodes of each face of an element in VTK's order, seen from outside anticlockwise."""
    own = TOPOLOGY[mesh.kind]
    rings = own.corners[np.array(own.triangles or own.squares)]
    places = PLACES[FACET[mesh.kind, mesh.order]]
    return mesh.element.nodes_at(np.stack([rings[:, list(place)].mean(axis=1) for place in places], axis=1))
