"""Quadratic hexahedra cut into quadratic tetrahedra on the same nodes."""

from __future__ import annotations

from itertools import permutations

import numpy as np

from geometry.elements import TET_EDGES, IntArray
from geometry.mesh import Mesh

PER_HEXAHEDRON = 6
GRID = np.array([1, 3, 9])  # local index of a node of a hexahedron of order 2
FACE_GRID = np.array([1, 3])


def split_hexahedra(mesh: Mesh) -> Mesh:
    """Six tetrahedra a hexahedron of order 2, along its diagonal from the lowest to the highest corner.

    Neighbours cut their common face along the same diagonal, so the mesh conforms; no node is added or lost.
    Source: kuhn1960.
    """
    if mesh.kind != "hex" or mesh.order != 2:
        raise ValueError(f"only hexahedra of order 2 are split, not {mesh.kind} of order {mesh.order}")
    cells = mesh.cells[:, _tetrahedra()].reshape(-1, 10)
    parts = np.arange(PER_HEXAHEDRON)
    regions = {name: (PER_HEXAHEDRON * old[:, None] + parts).ravel() for name, old in mesh.regions.items()}
    faces = {name: nodes[:, _triangles()].reshape(-1, 6) for name, nodes in mesh.faces.items()}
    return Mesh(mesh.nodes, cells, "tet", 2, regions, faces)


def _tetrahedra() -> IntArray:
    """Local nodes of the six tetrahedra, (6, 10): one path along the axes for each order of taking them."""
    local = []
    for order in permutations(range(3)):
        steps = np.vstack([np.zeros(3, dtype=np.int64), np.cumsum(np.eye(3, dtype=np.int64)[list(order)], axis=0)])
        corners = 2 * steps
        if np.linalg.det(corners[1:] - corners[0]) < 0.0:
            corners = corners[[0, 2, 1, 3]]
        local.append(np.vstack([corners, corners[TET_EDGES].sum(axis=1) // 2]) @ GRID)
    return np.array(local)


def _triangles() -> IntArray:
    """Local nodes of a face's two triangles, (2, 6)."""
    local = []
    for corners in (np.array([[0, 0], [2, 0], [2, 2]]), np.array([[0, 0], [2, 2], [0, 2]])):
        middles = (corners + np.roll(corners, -1, axis=0)) // 2
        local.append(np.vstack([corners, middles]) @ FACE_GRID)
    return np.array(local)
