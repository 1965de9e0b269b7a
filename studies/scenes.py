"""Bodies that the scripted studies solve: boxes of hexahedra, their supports, and copies side by side."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from geometry.hex.boxes import Boxes, hex_mesh
from geometry.materials import Material
from geometry.mesh import Mesh, split_hexahedra
from solvers.fem.assembly import assemble
from solvers.fem.solid import Pencil, constrain, free_mask

SIDES = ("x-", "x+", "y-", "y+")


def box(edges_m: Sequence[float], cuts: Sequence[int], order: int) -> Mesh:
    """A box from the origin, cut evenly into hexahedra."""
    x, y, z = (np.linspace(0.0, edge, n + 1) for edge, n in zip(edges_m, cuts, strict=True))
    return hex_mesh(Boxes(x, y, z, np.zeros(tuple(cuts), dtype=np.int64), ("body",)), order)


def cube(cuts: int, kind: str = "tet", edge_m: float = 1e-2) -> Mesh:
    """A cube in cuts^3 hexahedra of order 2, or in six times as many tetrahedra: 3 (2 cuts + 1)^3 degrees of freedom."""
    hexahedra = box((edge_m,) * 3, (cuts,) * 3, 2)
    return split_hexahedra(hexahedra) if kind == "tet" else hexahedra


def supported(mesh: Mesh, material: Material) -> Pencil:
    """A rectangular plate on hard supports: no u_z and no tangential displacement on its four sides."""
    return constrain(assemble(mesh, {"body": material}), free_mask(mesh, (), dict.fromkeys(SIDES, "A")))


def copies(mesh: Mesh, count: int, step_m: float) -> Mesh:
    """The same body `count` times beside itself, not touching: every frequency `count` times over."""
    shift = np.arange(count)[:, None, None] * np.array([step_m, 0.0, 0.0])
    nodes = (mesh.nodes[None] + shift).reshape(-1, 3)
    number = np.arange(count)[:, None, None] * len(mesh.nodes)
    faces = {name: (face[None] + number).reshape(-1, face.shape[1]) for name, face in mesh.faces.items()}
    cells = (mesh.cells[None] + number).reshape(-1, mesh.cells.shape[1])
    spans = None if mesh.spans is None else np.tile(mesh.spans, (count, 1))
    return Mesh(nodes, cells, mesh.kind, mesh.order, {"body": np.arange(len(cells))}, faces, spans)
