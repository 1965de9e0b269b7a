"""Meshes of a cube whose size in degrees of freedom can be asked for."""

from __future__ import annotations

import numpy as np

from geometry.hex.boxes import Boxes, hex_mesh
from geometry.hex.split import split_hexahedra
from geometry.mesh import Mesh


def cube_hexahedra(cuts: int, order: int = 2, edge_m: float = 1e-2) -> Mesh:
    """The cube in cuts^3 equal boxes; 3 (order cuts + 1)^3 degrees of freedom."""
    line = np.linspace(0.0, edge_m, cuts + 1)
    return hex_mesh(Boxes(line, line, line, np.zeros((cuts,) * 3, dtype=np.int64), ("body",)), order)


def cube_tetrahedra(cuts: int, edge_m: float = 1e-2) -> Mesh:
    """The cube in 6 cuts^3 quadratic tetrahedra; 3 (2 cuts + 1)^3 degrees of freedom."""
    return split_hexahedra(cube_hexahedra(cuts, 2, edge_m))
