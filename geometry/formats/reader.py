"""Meshes of other programs in our node order: regions and faces named as the file's groups, one line per fault."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from geometry.elements import FloatArray, IntArray, Rings, corner_ring
from geometry.errors import MeshError, MeshFileError
from geometry.formats.inp import read_inp
from geometry.formats.med import read_med
from geometry.formats.msh import read_msh
from geometry.formats.neutral import (
    CORNER_COUNT,
    DIMENSION,
    FULL,
    PLACES,
    VOLUME,
    RawMesh,
    local_nodes,
    mirrored,
    order_of,
    require_file,
)
from geometry.layout import MAX_SECTIONS, section_names
from geometry.mesh import AnyMesh, Mesh, MixedMesh, check_mesh

UNITS = {"m": 1.0, "mm": 1e-3}
SUFFIXES = (".med", ".msh", ".inp")
SURFACES = (".stl", ".obj", ".ply")
OWN = ("plate", *section_names(MAX_SECTIONS))  # groups with a material of their own; all other cells are plate
KINDS = {cell_type: key for key, cell_type in VOLUME.items()}
READABLE = (*KINDS, *FULL)
# the four corners whose edges from the first span an element
SPANNING = {"tet": (0, 1, 2, 3), "hex": (0, 1, 3, 4), "wedge": (0, 1, 2, 3), "pyramid": (0, 1, 3, 4)}
FARTHEST = 1e6  # of a coordinate in the file's unit: a kilometre in millimetres
COINCIDENT = 1e-6  # of the mesh's length: nodes of two bodies this close were meant to be one


@dataclass(frozen=True)
class MeshFile:
    """A mesh in our node order, with findings about its file.

    Attributes
    ----------
    mesh : Mesh or MixedMesh
        Mesh in m, with regions and faces named as the groups of the file.
    parts : int
        Number of bodies that share no node.
    coincident : int
        Number of nodes within COINCIDENT of the mesh's length from a node of another body.
    unused : int
        Number of nodes that belong to no element.
    left_out : tuple of str
        Definitions that would change the modes and are not read, as the file names them.
    bodies : tuple of str
        Names of the groups of volume elements.
    """

    mesh: AnyMesh
    parts: int
    coincident: int
    unused: int
    left_out: tuple[str, ...]
    bodies: tuple[str, ...] = ()


def read_mesh(file: str, unit: str = "m", merge: float = 0.0, groups: Sequence[str] = ()) -> MeshFile:
    """Read a mesh file.

    Parameters
    ----------
    file : str
        Path of a .med, .msh or .inp file.
    unit : {'m', 'mm'}, optional
        Unit of its lengths.
    merge : float, optional
        Distance in the file's unit below which nodes become one; 0 leaves all as they are.
    groups : sequence of str, optional
        Names of groups of elements, in any case, that become regions of their own.

    Returns
    -------
    MeshFile
        The mesh in m, and findings about the file.

    Raises
    ------
    MeshFileError
        For a file that cannot be read, and for a mesh that cannot be used.
    """
    raw = _read(Path(file))
    _check_raw(raw, file)
    raw = _merged(raw, merge) if merge > 0.0 else raw
    unused = len(raw.points) - len(np.unique(np.concatenate([np.empty(0, int), *(b.ravel() for _, b in raw.blocks)])))
    mesh = _mesh(raw, file, unit, groups)
    parts, coincident = _bodies(mesh)
    solid = {i for i, (kind, block) in enumerate(raw.blocks) if len(block) and DIMENSION.get(kind, 3) == 3}
    bodies = tuple(name for name, members in raw.cell_groups.items() if {*members} & solid)
    return MeshFile(mesh, parts, coincident, unused, raw.left_out, bodies)


def _merged(raw: RawMesh, tolerance: float) -> RawMesh:
    """Nodes within a tolerance of each other become the first of them."""
    _, label = _components(_near(raw.points, tolerance), len(raw.points))
    first = np.unique(label, return_index=True)[1][label]
    groups = {name: np.unique(first[nodes]) for name, nodes in raw.node_groups.items()}
    return replace(raw, blocks=[(kind, first[block]) for kind, block in raw.blocks], node_groups=groups)


def _bodies(mesh: AnyMesh) -> tuple[int, int]:
    """Number of bodies that share no node, and number of nodes that coincide with one of another body."""
    pairs = [np.stack(np.broadcast_arrays(block.cells[:, :1], block.cells), -1).reshape(-1, 2) for block in mesh.blocks]
    parts, label = _components(np.vstack(pairs), len(mesh.nodes))
    if parts == 1:
        return 1, 0
    near = _near(mesh.nodes, COINCIDENT * float(np.ptp(mesh.nodes, axis=0).max()))
    return parts, len(np.unique(near[label[near[:, 0]] != label[near[:, 1]]]))


def _near(points: FloatArray, tolerance: float) -> IntArray:
    """Pairs (k, 2) of points within a tolerance of each other."""
    from scipy.spatial import cKDTree

    return np.asarray(cKDTree(points).query_pairs(tolerance, output_type="ndarray"))


def _components(pairs: IntArray, count: int) -> tuple[int, IntArray]:
    """Number of groups of `count` nodes connected by pairs (k, 2), and the group of each."""
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    graph = coo_array((np.ones(len(pairs)), (pairs[:, 0], pairs[:, 1])), shape=(count, count))
    parts, label = connected_components(graph, directed=False)
    return int(parts), label


def _mesh(raw: RawMesh, file: str, unit: str, groups: Sequence[str]) -> AnyMesh:
    given = _volume_types(raw, file)
    raw = _completed(raw, file)
    types = sorted({FULL.get(cell_type, cell_type) for cell_type in given})
    if len({KINDS[cell_type][1] for cell_type in types}) > 1:
        named = " and ".join(given)
        raise MeshFileError(f"{file}: holds {named}: elements with and without middle nodes cannot be combined")
    chosen = {name: [i for i, (cell_type, _) in enumerate(raw.blocks) if cell_type == name] for name in types}
    cells = {name: np.vstack([raw.blocks[i][1] for i in chosen[name] if len(raw.blocks[i][1])]) for name in types}
    for name, block in cells.items():
        _refuse_twins(block[:, : CORNER_COUNT[name]], file)
    used = np.unique(np.concatenate([block.ravel() for block in cells.values()]))
    points = UNITS[unit] * raw.points[used]
    number = np.full(len(raw.points), -1)
    number[used] = np.arange(len(used))
    blocks = tuple(_block(points, number[block], name, file) for name, block in cells.items())
    regions = _regions(raw, [i for name in types for i in chosen[name]], groups, file)
    mesh = replace(blocks[0], regions=regions) if len(blocks) == 1 else MixedMesh(points, blocks, regions)
    try:
        check_mesh(mesh)
    except MeshError as fault:
        raise MeshFileError(f"{file}: {fault}") from fault
    faces = _faces(raw, blocks, number, file)
    if isinstance(mesh, MixedMesh) or any(len(parts) > 1 for parts in faces.values()):
        return MixedMesh(points, blocks, regions, faces)
    return replace(mesh, faces={name: parts[0] for name, parts in faces.items()})


def _volume_types(raw: RawMesh, file: str) -> list[str]:
    """The cell types of the volume elements. Raises MeshFileError if there are none, or some that are not read."""
    given = list(dict.fromkeys(kind for kind, block in raw.blocks if len(block) and DIMENSION.get(kind, 3) == 3))
    for cell_type in given:
        if cell_type not in READABLE:
            allowed = ", ".join(READABLE)
            raise MeshFileError(f"{file}: element type {cell_type} is not supported; must be one of {allowed}")
    if not given:
        raise MeshFileError(f"{file}: holds no volume elements; must hold some of {', '.join(READABLE)}")
    return given


def _check_raw(raw: RawMesh, file: str) -> None:
    """Raise MeshFileError for a coordinate that is not a number, and for an index of nodes or groups out of range."""
    wrong = np.flatnonzero(~(np.abs(raw.points) <= FARTHEST).all(axis=1))
    if len(wrong):
        text = ", ".join(f"{value:g}" for value in raw.points[wrong[0]])
        raise MeshFileError(f"{file}: node {wrong[0] + 1} at ({text}): must be finite numbers within {FARTHEST:g}")
    nodes, sizes = len(raw.points), [len(block) for _, block in raw.blocks]
    for cell_type, block in raw.blocks:
        if len(block) and cell_type in PLACES and block.shape[1] != len(PLACES[cell_type]):
            raise MeshFileError(f"{file}: {cell_type} of {block.shape[1]} nodes: must have {len(PLACES[cell_type])}")
        _check_range(block, nodes, f"{file}: {cell_type}", "a node of the file")
    for name, members in raw.node_groups.items():
        _check_range(members, nodes, f"{file}: group {name}", "a node of the file")
    for name, parts in raw.cell_groups.items():
        for block_number, cells in parts.items():
            _check_range(cells, sizes[block_number], f"{file}: group {name}", "an element of its block")


def _check_range(indices: IntArray, count: int, where: str, what: str) -> None:
    rows = np.atleast_2d(indices.T).T
    wrong = np.argwhere((rows < 0) | (rows >= count))
    if len(wrong):
        number, place = int(rows[tuple(wrong[0])]) + 1, int(wrong[0][0]) + 1
        raise MeshFileError(f"{where}: number {number} in line {place} of it is not {what}: must be from 1 to {count}")


def _refuse_twins(corners: IntArray, file: str) -> None:
    """Raise MeshFileError if two elements have the same corners: their stiffness and mass would count twice."""
    _, first, count = np.unique(np.sort(corners, axis=1), axis=0, return_index=True, return_counts=True)
    twins = np.flatnonzero(count > 1)
    if len(twins):
        text = ", ".join(str(node + 1) for node in corners[first[twins[0]]])
        raise MeshFileError(f"{file}: {int((count - 1).sum())} element(s) given twice, the first on the nodes {text}")


def _read(file: Path) -> RawMesh:
    require_file(file)
    suffix = file.suffix.lower()
    if suffix in SURFACES:
        raise MeshFileError(f"{file}: {_surface(file)}; must be a mesh of volume elements ({', '.join(SUFFIXES)})")
    if suffix not in SUFFIXES:
        raise MeshFileError(f"{file}: must be a mesh file of type {', '.join(SUFFIXES)}")
    return {".med": read_med, ".msh": read_msh, ".inp": read_inp}[suffix](file)


def _surface(file: Path) -> str:
    """Description of a surface file: unreadable, open or closed."""
    import trimesh

    try:
        surface: Any = trimesh.load(file, force="mesh")
        edges = np.unique(surface.edges_sorted, axis=0, return_counts=True)[1]
    except Exception:  # trimesh passes on whatever its many readers raise
        return "not a readable surface"
    open_edges = int((edges == 1).sum())
    return (
        f"an open surface ({open_edges} edges with one triangle)" if open_edges else "a closed surface, not yet meshed"
    )


def _block(points: FloatArray, cells: IntArray, cell_type: str, file: str) -> Mesh:
    """Elements of one type with local nodes in our order: inside-out elements turned, middle nodes placed."""
    (kind, order), count = KINDS[cell_type], CORNER_COUNT[cell_type]
    a, b, c, d = (points[cells[:, i]] for i in SPANNING[kind])
    inside_out = np.einsum("ei,ei->e", np.cross(b - a, c - a), d - a) < 0.0
    vtk = cells if order == 1 else np.hstack([cells[:, :count], _placed_middles(points, cells, cell_type, file)])
    turned = vtk[:, order_of(cell_type, mirrored(cell_type, PLACES[cell_type]))]
    ours = np.empty_like(vtk)
    ours[:, local_nodes(kind, order)] = np.where(inside_out[:, None], turned, vtk)
    return Mesh(points, ours, kind, order)


def _regions(raw: RawMesh, volumes: list[int], groups: Sequence[str], file: str) -> dict[str, IntArray]:
    """Cells of the groups `pillar`, `section2` and so on and of the named ones, each in one; all others are `plate`."""
    names = [*OWN, *(name.casefold() for name in groups if name.casefold() not in OWN)]
    named = {name.casefold() for name in groups}
    starts = np.concatenate([[0], np.cumsum([len(raw.blocks[i][1]) for i in volumes])])
    region = np.zeros(int(starts[-1]), dtype=np.int64)
    held = np.full(len(region), -1)
    for name, parts in sorted(raw.cell_groups.items(), key=lambda group: group[0].casefold() in named):
        own = name.casefold()
        for block in {*parts} & {*volumes} if own in names else ():
            cells = starts[volumes.index(block)] + parts[block]
            if own in named and (other := held[cells].max(initial=-1)) >= 0 and names[other] != own:
                raise MeshFileError(
                    f"{file}: groups {names[other]} and {own} share elements: must have one material each"
                )
            region[cells] = names.index(own)
            held[cells] = names.index(own) if own in named else -1
    return {name: np.flatnonzero(region == i) for i, name in enumerate(names) if (region == i).any()}


def _faces(raw: RawMesh, blocks: Sequence[Mesh], number: IntArray, file: str) -> dict[str, tuple[IntArray, ...]]:
    """Face groups as facets of our elements, by shape; node groups as single nodes."""
    shapes = _facets_by_corners(blocks)
    _check_fit(shapes, blocks[0].nodes, file)
    faces: dict[str, tuple[IntArray, ...]] = {}
    for name, nodes in raw.node_groups.items():
        kept = number[nodes]
        if (kept >= 0).any():
            faces[name] = (kept[kept >= 0][:, None],)
    for name, members in raw.cell_groups.items():
        parts = []
        for corners, (keys, full) in shapes.items():
            given = [
                raw.blocks[i][1][cells][:, :corners] for i, cells in members.items() if _corners_of(raw, i) == corners
            ]
            if given:
                place = _rows_in(np.sort(number[np.vstack(given)], axis=1), keys)
                parts.append((place, full))
        lost = sum(int((place < 0).sum()) for place, _ in parts)
        lost += sum(len(cells) for i, cells in members.items() if _corners_of(raw, i) not in (0, *shapes))
        if lost:
            raise MeshFileError(f"{file}: group {name}: {lost} facet(s) do not belong to a volume element")
        if parts:
            faces[name] = tuple(full[place] for place, full in parts)
    return faces


def _corners_of(raw: RawMesh, block: int) -> int:
    """Corners of a block's facets, 0 where its cells are none."""
    name = raw.blocks[block][0]
    return CORNER_COUNT[name] if DIMENSION.get(name) == 2 else 0


def _facets_by_corners(blocks: Sequence[Mesh]) -> dict[int, tuple[IntArray, IntArray]]:
    """Every facet of the elements by its number of corners: corners as unique sorted rows, and all its nodes."""
    by_corners: dict[int, list[tuple[IntArray, IntArray]]] = {}
    for block in blocks:
        for local in block.element.facets:
            ring = corner_ring(local, block.order)
            keys = np.sort(block.cells[:, ring].reshape(-1, ring.shape[1]), axis=1)
            by_corners.setdefault(ring.shape[1], []).append((keys, block.cells[:, local].reshape(-1, local.shape[1])))
    shapes = {}
    for corners, each in sorted(by_corners.items()):
        keys, first = np.unique(np.vstack([keys for keys, _ in each]), axis=0, return_index=True)
        shapes[corners] = (keys, np.vstack([full for _, full in each])[first])
    return shapes


def _check_fit(shapes: dict[int, tuple[IntArray, IntArray]], nodes: FloatArray, file: str) -> None:
    """Raise MeshFileError if triangles lean against a square: displacements would gape there."""
    if len(shapes) < 2:
        return
    squares = shapes[4][0]
    halves = np.vstack([np.delete(squares, corner, axis=1) for corner in range(4)])
    leaning = np.flatnonzero(_rows_in(shapes[3][0], np.unique(halves, axis=0)) >= 0)
    if len(leaning):
        place = ", ".join(f"{value:.3f}" for value in 1e3 * nodes[shapes[3][0][leaning[0]]].mean(axis=0))
        raise MeshFileError(
            f"{file}: {len(leaning)} triangular face(s) lean against a square one, the first at ({place}) mm: "
            "a pyramid must stand between"
        )


# -- elements without middles of faces ---------------------------------------------------------------------------------
# Hexahedra of 20 nodes (C3D20, HE20), wedges of 15 (C3D15) and pyramids of 13 as those of 27, 18 and 14 nodes.
# Square faces and hexahedra get the middles that they lack. The full map through those points is the map without
# them, so that curved bodies stay as they are; its displacements are richer, its frequencies at most those of the
# element in the file.

OFF_MIDDLE = 0.3  # of an edge: a node farther from its place than this is not the node we think it is


def _placed_middles(points: FloatArray, cells: IntArray, cell_type: str, file: str) -> IntArray:
    """Middle nodes (m, k - corners) of cells (m, k) in VTK's order; MeshFileError where they fit none.

    The format defines their order, which curved elements need. Where a straight-edged mesh contradicts it, its writer
    followed another convention, and each node goes to the middle that it lies at.
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


def _completed(raw: RawMesh, file: str) -> RawMesh:
    """The mesh with cells of 27, 18 and 14 nodes instead of 20, 15 and 13; others stay as they are.

    A face keeps the middle that a complete neighbouring element names for it. Raises MeshFileError as `_placed_middles`.
    """
    if not any(kind in FULL and len(block) for kind, block in raw.blocks):
        return raw
    points, blocks = raw.points, list(raw.blocks)
    keys, nodes = _named_middles(raw, file)
    for index, (kind, block) in enumerate(raw.blocks):
        if kind not in FULL or not len(block):
            continue
        corners, edges = block[:, : CORNER_COUNT[kind]], _placed_middles(points, block, kind, file)
        own = np.sort(corners[:, np.array(_squares(kind))].reshape(-1, 4), axis=1)
        places = np.stack([_face_middle(points, corners, edges, kind, face) for face in _squares(kind)], axis=1)
        keys, first = np.unique(np.vstack([keys, own]), axis=0, return_index=True)
        number = np.concatenate([nodes, np.full(len(own), -1)])[first]
        fresh = number < 0
        number[fresh] = len(points) + np.arange(fresh.sum())
        points = np.vstack([points, places.reshape(-1, 3)[first[fresh] - len(nodes)]])
        nodes = number
        full = [corners, edges, nodes[_rows_in(own, keys)].reshape(len(block), -1)]
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
        placed = _placed_middles(raw.points, block, kind, file)
        for column, place in enumerate(PLACES[kind][CORNER_COUNT[kind] :]):
            if len(place) == 4:
                keys.append(np.sort(block[:, list(place)], axis=1))
                nodes.append(placed[:, column])
    distinct, first = np.unique(np.vstack(keys), axis=0, return_index=True)
    return distinct, np.concatenate(nodes)[first]


def _face_middle(
    points: FloatArray, corners: IntArray, edges: IntArray, kind: str, face: tuple[int, ...]
) -> FloatArray:
    """Middle of a square face by the map without it: half the sum of its edges' middles less a quarter of its corners."""
    around = [i for i, edge in enumerate(PLACES[kind][CORNER_COUNT[kind] :]) if set(edge) <= set(face)]
    return np.asarray(points[edges[:, around]].sum(axis=1) / 2.0 - points[corners[:, list(face)]].sum(axis=1) / 4.0)


def _rows_in(rows: IntArray, table: IntArray) -> IntArray:
    """Place of each of the rows (m, k) in a table (n, k) of distinct ones, (m,); -1 if absent."""
    both, inverse = np.unique(np.vstack([table, rows]), axis=0, return_inverse=True)
    place = np.full(len(both), -1, dtype=np.int64)
    place[inverse[: len(table)]] = np.arange(len(table))
    return np.asarray(place[inverse[len(table) :]])
