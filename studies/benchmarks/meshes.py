"""Meshes of a cube whose size in unknowns can be asked for."""

from __future__ import annotations

import numpy as np

from geometry.elements import TET_EDGES
from geometry.hexmesh import Boxes, hex_mesh
from geometry.mesh import Mesh

SIX_TETS = np.array([[0, 1, 3, 7], [0, 3, 2, 7], [0, 2, 6, 7], [0, 6, 4, 7], [0, 4, 5, 7], [0, 5, 1, 7]])


def cube_hexahedra(cuts: int, order: int = 2, edge_m: float = 1e-2) -> Mesh:
    """The cube in cuts^3 equal boxes; 3 (order cuts + 1)^3 unknowns."""
    line = np.linspace(0.0, edge_m, cuts + 1)
    return hex_mesh(Boxes(line, line, line, np.zeros((cuts,) * 3, dtype=np.int64), ("body",)), order)


def cube_tetrahedra(cuts: int, edge_m: float = 1e-2) -> Mesh:
    """The cube in 6 cuts^3 quadratic tetrahedra; 3 (2 cuts + 1)^3 unknowns."""
    base = cube_hexahedra(cuts, 1, edge_m)
    corners = base.cells[:, SIX_TETS].reshape(-1, 4)
    ends = np.sort(corners[:, TET_EDGES].reshape(-1, 2), axis=1)
    pairs, number = np.unique(ends, axis=0, return_inverse=True)
    nodes = np.vstack([base.nodes, base.nodes[pairs].mean(axis=1)])
    return Mesh(nodes, np.hstack([corners, len(base.nodes) + number.reshape(-1, 6)]), "tet", 2)
