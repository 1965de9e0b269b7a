"""Hexahedra of order 1 or 2 cut into tetrahedra of the same order on the same nodes."""

from __future__ import annotations

from itertools import permutations

import numpy as np

from geometry.elements import TET_EDGES, IntArray
from geometry.mesh import Mesh

PER_HEXAHEDRON = 6


def split_hexahedra(mesh: Mesh) -> Mesh:
    """Six tetrahedra a hexahedron, along its diagonal from the lowest to the highest corner.

    Neighbours cut their common face along the same diagonal, so the mesh conforms; no node is added or lost.
    ValueError for another element. Source: kuhn1960.
    """
    if mesh.kind != "hex" or mesh.order not in (1, 2):
        raise ValueError(f"only hexahedra of order 1 or order 2 are split, not {mesh.kind} of order {mesh.order}")
    local, triangles = _tetrahedra(mesh.order), _triangles(mesh.order)
    cells = mesh.cells[:, local].reshape(-1, local.shape[1])
    parts = np.arange(PER_HEXAHEDRON)
    regions = {name: (PER_HEXAHEDRON * old[:, None] + parts).ravel() for name, old in mesh.regions.items()}
    faces = {name: nodes[:, triangles].reshape(-1, triangles.shape[1]) for name, nodes in mesh.faces.items()}
    return Mesh(mesh.nodes, cells, "tet", mesh.order, regions, faces)


def _tetrahedra(order: int) -> IntArray:
    """Local nodes of the six tetrahedra, (6, 4 or 10): one path along the axes for each order of taking them."""
    local = []
    for axes in permutations(range(3)):
        steps = np.vstack([np.zeros(3, dtype=np.int64), np.cumsum(np.eye(3, dtype=np.int64)[list(axes)], axis=0)])
        corners = order * steps
        if np.linalg.det(corners[1:] - corners[0]) < 0.0:
            corners = corners[[0, 2, 1, 3]]
        local.append(_numbered(corners, corners[TET_EDGES].sum(axis=1) // 2, order))
    return np.array(local)


def _triangles(order: int) -> IntArray:
    """Local nodes of a face's two triangles, (2, 3 or 6)."""
    local = []
    for corners in (np.array([[0, 0], [1, 0], [1, 1]]), np.array([[0, 0], [1, 1], [0, 1]])):
        local.append(_numbered(order * corners, order * (corners + np.roll(corners, -1, axis=0)) // 2, order))
    return np.array(local)


def _numbered(corners: IntArray, middles: IntArray, order: int) -> IntArray:
    """Numbers of places on an element's own grid, the first axis fastest; the middles where the order has them."""
    places = np.vstack([corners, middles]) if order == 2 else corners
    return np.asarray(places @ (order + 1) ** np.arange(places.shape[1]))
