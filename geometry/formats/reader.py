"""Meshes of others read into our order: regions and faces named as the file's groups, every fault one line."""

from __future__ import annotations

from contextlib import redirect_stderr, redirect_stdout
from dataclasses import replace
from io import StringIO
from pathlib import Path
from typing import Any

import numpy as np

from geometry.elements import FloatArray, IntArray
from geometry.errors import MeshError, MeshFileError
from geometry.formats.med import read_med
from geometry.formats.neutral import PLACES, VOLUME, RawMesh, corner_keys, family, local_nodes, outward_faces, rows_in
from geometry.formats.serendipity import SERENDIPITY, completed
from geometry.mesh import Mesh, check_mesh

UNITS = {"m": 1.0, "mm": 1e-3}
SUFFIXES = (".med", ".msh", ".inp")
SURFACES = (".stl", ".obj", ".ply")
IGNORED = ("vertex", "line")  # cells without a face or a volume: they only carry names
KINDS = {cell_type: key for key, cell_type in VOLUME.items()}
READABLE = (*KINDS, SERENDIPITY)
CORNERS = {"tet": 4, "hex": 8}
MIRRORED = {"tet": [0, 2, 1, 3], "hex": [0, 3, 2, 1, 4, 7, 6, 5]}  # corners of an element turned inside out
FARTHEST = 1e6  # of a coordinate in the file's unit: a kilometre in millimetres
OFF_MIDDLE = 0.3  # of an edge: a node farther from its place than this is not the node we think it is


def load(file: str, unit: str = "m") -> Mesh:
    """The mesh of a file in our order, m: regions and faces named as its groups. MeshFileError for what cannot serve."""
    raw = _read(Path(file))
    _check_raw(raw, file)
    raw = completed(raw, _middles, file)
    volumes = [i for i, (cell_type, block) in enumerate(raw.blocks) if len(block) and _dimension(cell_type, file) == 3]
    types = sorted({raw.blocks[i][0] for i in volumes})
    if len(types) != 1:
        what = "no volume elements" if not types else "a mix of " + " and ".join(types)
        raise MeshFileError(f"{file}: holds {what}; must be one kind of {', '.join(READABLE)}")
    kind, order = KINDS[types[0]]
    blocks = np.vstack([raw.blocks[i][1] for i in volumes])
    _refuse_twins(blocks[:, : CORNERS[kind]], file)
    used, cells = np.unique(blocks, return_inverse=True)
    points = UNITS[unit] * raw.points[used]
    ordered = _ordered(points, cells.reshape(blocks.shape), kind, order, file)
    mesh = Mesh(points, ordered, kind, order, _regions(raw, volumes))
    try:
        check_mesh(mesh)
    except MeshError as fault:
        raise MeshFileError(f"{file}: {fault}") from fault
    number = np.full(len(raw.points), -1)
    number[used] = np.arange(len(used))
    return replace(mesh, faces=_faces(raw, mesh, number, file))


def _check_raw(raw: RawMesh, file: str) -> None:
    """MeshFileError for a coordinate that is no number, and for every index, of nodes and of groups, that is out of range."""
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
    """MeshFileError when two elements have the same corners: their stiffness and mass would count twice."""
    _, first, count = np.unique(np.sort(corners, axis=1), axis=0, return_index=True, return_counts=True)
    twins = np.flatnonzero(count > 1)
    if len(twins):
        text = ", ".join(str(node + 1) for node in corners[first[twins[0]]])
        raise MeshFileError(f"{file}: {int((count - 1).sum())} element(s) given twice, the first on the nodes {text}")


def _dimension(cell_type: str, file: str) -> int:
    name = family(cell_type)
    if name in IGNORED:
        return 1
    if name in ("triangle", "quad"):
        return 2
    if cell_type not in KINDS:
        raise MeshFileError(f"{file}: element type {cell_type} is not supported; must be one of {', '.join(READABLE)}")
    return 3


def _read(file: Path) -> RawMesh:
    if not file.is_file():
        raise MeshFileError(f"{file}: no such mesh file")
    suffix = file.suffix.lower()
    if suffix in SURFACES:
        raise MeshFileError(f"{file}: {_surface(file)}; must be a mesh of volume elements ({', '.join(SUFFIXES)})")
    if suffix not in SUFFIXES:
        raise MeshFileError(f"{file}: must be a mesh file of type {', '.join(SUFFIXES)}")
    return read_med(file) if suffix == ".med" else _read_meshio(file)


def _surface(file: Path) -> str:
    """What is wrong with a surface file, beyond being one."""
    import trimesh

    try:
        surface: Any = trimesh.load(file, force="mesh")
        edges = np.unique(surface.edges_sorted, axis=0, return_counts=True)[1]
    except Exception:  # trimesh raises whatever its many readers do
        return "not a readable surface"
    open_edges = int((edges == 1).sum())
    return (
        f"an open surface ({open_edges} edges with one triangle)" if open_edges else "a closed surface, not yet meshed"
    )


def _read_meshio(file: Path) -> RawMesh:
    """What meshio reads: gmsh's physical groups and Abaqus sets become groups."""
    import meshio

    chatter = StringIO()
    try:
        with redirect_stdout(chatter), redirect_stderr(chatter):
            read = meshio.read(file)
    except (Exception, SystemExit) as fault:  # meshio leaves with SystemExit, and its parsers raise whatever they meet
        reason = " ".join(str(fault).split()) or type(fault).__name__
        raise MeshFileError(f"{file}: not a readable mesh ({reason[:120]})") from fault
    try:
        return _from_meshio(read)
    except Exception as fault:  # meshio hands on what the file says, whatever that is
        raise MeshFileError(f"{file}: not a readable mesh ({type(fault).__name__}: {str(fault)[:120]})") from fault


def _from_meshio(read: Any) -> RawMesh:
    if not len(read.points):
        return RawMesh(np.zeros((0, 3)), [])
    given = np.asarray(read.points, dtype=float).reshape(len(read.points), -1)
    points = np.zeros((len(given), 3))
    points[:, : given.shape[1]] = given
    blocks = [(block.type, np.asarray(block.data, dtype=np.int64)) for block in read.cells]
    groups: dict[str, dict[int, IntArray]] = {}
    for name, parts in read.cell_sets.items():
        if not name.startswith("gmsh:"):
            groups[name] = {i: np.asarray(p, dtype=np.int64) for i, p in enumerate(parts) if p is not None and len(p)}
    for i, numbers in enumerate(read.cell_data.get("gmsh:physical", [])):
        for name, (number, _) in read.field_data.items():
            inside = np.flatnonzero(np.asarray(numbers) == number)
            if len(inside):
                groups.setdefault(name, {})[i] = inside
    nodes = {name: np.asarray(members, dtype=np.int64) for name, members in read.point_sets.items()}
    return RawMesh(points, blocks, groups, nodes)


def _ordered(points: FloatArray, cells: IntArray, kind: str, order: int, file: str) -> IntArray:
    """Local nodes in our order: inside-out elements turned, every middle node found by where it lies."""
    corner_count = CORNERS[kind]
    corners = cells[:, :corner_count].copy()
    a, b, c, d = (points[corners[:, i]] for i in ((0, 1, 2, 3) if kind == "tet" else (0, 1, 3, 4)))
    inside_out = np.einsum("ei,ei->e", np.cross(b - a, c - a), d - a) < 0.0
    corners[inside_out] = corners[inside_out][:, MIRRORED[kind]]
    places = PLACES[VOLUME[kind, order]]
    vtk = corners
    if order == 2:
        vtk = np.hstack([corners, _middles(points, corners, cells[:, corner_count:], places[corner_count:], file)])
    ours = np.empty_like(vtk)
    ours[:, local_nodes(kind, order)] = vtk
    return ours


def _middles(
    points: FloatArray, corners: IntArray, middles: IntArray, places: tuple[tuple[int, ...], ...], file: str
) -> IntArray:
    """Middle nodes in the order of `places`, whatever convention the file follows.

    Raises MeshFileError where a node is not near the middle of the corners it should belong to.
    """
    size = np.ptp(points[corners], axis=1).max(axis=1)
    nodes = np.empty_like(middles)
    for column, place in enumerate(places):
        middle = points[corners[:, list(place)]].mean(axis=1)
        distance = np.linalg.norm(points[middles] - middle[:, None, :], axis=2)
        best = distance.argmin(axis=1)
        edge = np.linalg.norm(points[corners[:, place[0]]] - points[corners[:, place[-1]]], axis=1)
        wrong = np.flatnonzero(distance.min(axis=1) > OFF_MIDDLE * np.minimum(edge, size))
        if len(wrong):
            raise MeshFileError(
                f"{file}: element {wrong[0]}: no node near the middle of its corners {place}: order not understood"
            )
        nodes[:, column] = middles[np.arange(len(middles)), best]
    twice = np.flatnonzero((np.diff(np.sort(nodes, axis=1), axis=1) == 0).any(axis=1))
    if len(twice):
        raise MeshFileError(f"{file}: element {twice[0]}: two middles share a node: order not understood")
    return nodes


def _regions(raw: RawMesh, volumes: list[int]) -> dict[str, IntArray]:
    """The cells of a group `pillar`, which may have a material of its own, and all others as `plate`."""
    starts = np.concatenate([[0], np.cumsum([len(raw.blocks[i][1]) for i in volumes])])
    total = int(starts[-1])
    pillar = [
        starts[volumes.index(block)] + cells
        for name, parts in raw.cell_groups.items()
        if name.casefold() == "pillar"
        for block, cells in parts.items()
        if block in volumes
    ]
    inside = np.unique(np.concatenate(pillar)) if pillar else np.empty(0, dtype=np.int64)
    others = np.setdiff1d(np.arange(total), inside)
    return {name: cells for name, cells in (("plate", others), ("pillar", inside)) if len(cells)}


def _faces(raw: RawMesh, mesh: Mesh, number: IntArray, file: str) -> dict[str, IntArray]:
    """Face groups as facets of our elements, node groups as single nodes."""
    corners = 3 if mesh.kind == "tet" else 4
    local, vtk = mesh.element.faces, outward_faces(mesh)
    keys = corner_keys(mesh.cells[:, vtk].reshape(-1, vtk.shape[1]), corners)
    table, first = np.unique(keys, axis=0, return_index=True)
    full = mesh.cells[:, local].reshape(-1, local.shape[1])
    faces = {name: number[nodes][number[nodes] >= 0][:, None] for name, nodes in raw.node_groups.items()}
    faces = {name: nodes for name, nodes in faces.items() if len(nodes)}
    for name, parts in raw.cell_groups.items():
        facets = [raw.blocks[i][1][cells][:, :corners] for i, cells in parts.items() if _is_facet(raw.blocks[i][0])]
        if not facets:
            continue
        place = rows_in(np.sort(number[np.vstack(facets)], axis=1), table)
        if (place < 0).any():
            raise MeshFileError(
                f"{file}: group {name}: {int((place < 0).sum())} facet(s) are no face of a volume element"
            )
        faces[name] = full[first[place]]
    return faces


def _is_facet(cell_type: str) -> bool:
    return family(cell_type) in ("triangle", "quad")
