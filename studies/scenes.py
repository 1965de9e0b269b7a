"""Bodies that the scripted studies solve: boxes of hexahedra, the same cut into tetrahedra, and exact answers beside."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from geometry.elements import TET_EDGES
from geometry.hexmesh import Boxes, hex_mesh
from geometry.materials import Material
from geometry.mesh import Mesh
from solvers.fem.assembly import assemble
from solvers.fem.constraints import Pencil, constrain, free_mask

SIX_TETRAHEDRA = np.array([[0, 1, 3, 7], [0, 3, 2, 7], [0, 2, 6, 7], [0, 6, 4, 7], [0, 4, 5, 7], [0, 5, 1, 7]])
SIDES = ("x-", "x+", "y-", "y+")


def box(edges_m: Sequence[float], cuts: Sequence[int], order: int) -> Mesh:
    """A box from the origin, cut evenly into hexahedra."""
    x, y, z = (np.linspace(0.0, edge, n + 1) for edge, n in zip(edges_m, cuts, strict=True))
    return hex_mesh(Boxes(x, y, z, np.zeros(tuple(cuts), dtype=np.int64), ("body",)), order)


def tetrahedra(mesh: Mesh, order: int) -> Mesh:
    """Hexahedra of order 1 cut into six tetrahedra each about a diagonal; faces kept."""
    corners = mesh.cells[:, SIX_TETRAHEDRA].reshape(-1, 4)
    faces = {name: _triangles(quads) for name, quads in mesh.faces.items()}
    linear = Mesh(mesh.nodes, corners, "tet", 1, {"body": np.arange(len(corners))}, faces)
    return linear if order == 1 else _quadratic(linear)


def _triangles(quads: np.ndarray) -> np.ndarray:
    """Corner triples that hold every node of each quadrilateral (only their nodes are used)."""
    return np.concatenate([quads[:, [0, 1, 3]], quads[:, [0, 2, 3]]])


def _quadratic(mesh: Mesh) -> Mesh:
    ends = np.sort(mesh.cells[:, TET_EDGES].reshape(-1, 2), axis=1)
    pairs, number = np.unique(ends, axis=0, return_inverse=True)
    middles = mesh.nodes[pairs].mean(axis=1)
    cells = np.hstack([mesh.cells, len(mesh.nodes) + number.reshape(len(mesh.cells), 6)])
    nodes = np.vstack([mesh.nodes, middles])
    faces = {}
    for name, triangles in mesh.faces.items():
        corner_on = np.zeros(len(mesh.nodes), dtype=bool)
        corner_on[np.unique(triangles)] = True
        on = len(mesh.nodes) + np.flatnonzero(corner_on[pairs].all(axis=1))
        faces[name] = np.concatenate([np.unique(triangles), on])[:, None]
    return Mesh(nodes, cells, "tet", 2, mesh.regions, faces)


def supported(mesh: Mesh, material: Material) -> Pencil:
    """A rectangular plate on hard supports: no u_z and no tangential displacement on its four sides."""
    return constrain(assemble(mesh, {"body": material}), free_mask(mesh, (), dict.fromkeys(SIDES, "-")))


def sliding(mesh: Mesh, material: Material) -> Pencil:
    """A box whose sides x-, x+, y-, y+ slide on their planes: pressure and shear waves between mirrors."""
    return constrain(assemble(mesh, {"body": material}), free_mask(mesh, (), dict.fromkeys(SIDES, "+")))


def copies(mesh: Mesh, count: int, step_m: float) -> Mesh:
    """The same body `count` times beside itself, not touching: every frequency `count` times over."""
    shift = np.arange(count)[:, None, None] * np.array([step_m, 0.0, 0.0])
    nodes = (mesh.nodes[None] + shift).reshape(-1, 3)
    number = np.arange(count)[:, None, None] * len(mesh.nodes)
    faces = {name: (face[None] + number).reshape(-1, face.shape[1]) for name, face in mesh.faces.items()}
    cells = (mesh.cells[None] + number).reshape(-1, mesh.cells.shape[1])
    spans = None if mesh.spans is None else np.tile(mesh.spans, (count, 1))
    return Mesh(nodes, cells, mesh.kind, mesh.order, {"body": np.arange(len(cells))}, faces, spans)
