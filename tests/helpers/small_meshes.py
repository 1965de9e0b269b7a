"""Small meshes of every element kind, made without a mesher."""

from __future__ import annotations

import numpy as np

from geometry.hex.boxes import Boxes, hex_mesh
from geometry.materials import Material
from geometry.mesh import Mesh, split_hexahedra

SOFT = Material.isotropic("soft", 2.5e9, 1200.0, 0.31)
EDGES_M = (2.0e-3, 1.5e-3, 1.1e-3)


def hexes(order: int, cuts: tuple[int, int, int] = (2, 2, 2), edges: tuple[float, ...] = EDGES_M) -> Mesh:
    """A box divided unevenly into hexahedra that are boxes along the axes."""
    lines = [edge * np.linspace(0.0, 1.0, n + 1) ** 1.2 for edge, n in zip(edges, cuts, strict=True)]
    return hex_mesh(Boxes(*lines, np.zeros(cuts, dtype=np.int64), ("body",)), order)


def plain(mesh: Mesh, nodes: np.ndarray | None = None) -> Mesh:
    """The mesh without the flag that its elements are boxes."""
    return Mesh(mesh.nodes if nodes is None else nodes, mesh.cells, mesh.kind, mesh.order, mesh.regions, mesh.faces)


def on_boundary(mesh: Mesh) -> np.ndarray:
    """Nodes on the sides of the bounding box, shape (n,) bool."""
    low, high = mesh.nodes.min(axis=0), mesh.nodes.max(axis=0)
    tolerance = 1e-9 * (high - low)
    return ((mesh.nodes - low < tolerance) | (high - mesh.nodes < tolerance)).any(axis=1)


def distorted(order: int = 2, amount: float = 0.04) -> Mesh:
    """Hexahedra whose inner nodes were moved, so that no element is affine."""
    mesh = hexes(order)
    nodes = mesh.nodes.copy()
    inner = ~on_boundary(mesh)
    nodes[inner] += amount * 1e-3 * np.random.default_rng(3).uniform(-1.0, 1.0, (inner.sum(), 3))
    return plain(mesh, nodes)


def skewed(order: int) -> Mesh:
    """Distorted hexahedra of order 1 with the nodes of a higher order, which p + 1 Gauss points integrate exactly."""
    corners, mesh = distorted(1), hexes(order)
    value, _ = corners.element.shape(mesh.element.points)
    nodes = mesh.nodes.copy()
    nodes[mesh.cells] = np.einsum("qk,ekj->eqj", value, corners.nodes[corners.cells])
    return plain(mesh, nodes)


def tets(order: int, cuts: tuple[int, int, int] = (2, 2, 2), edges: tuple[float, ...] = EDGES_M) -> Mesh:
    """A box of hexahedra, each cut into six tetrahedra about its diagonal."""
    return split_hexahedra(hexes(order, cuts, edges))


def wavy_tets(amount: float = 0.03) -> Mesh:
    """Ten-node tetrahedra with inner edges bent."""
    mesh = tets(2)
    nodes = mesh.nodes.copy()
    inner = ~on_boundary(mesh)
    nodes[inner] += amount * 1e-3 * np.random.default_rng(5).uniform(-1.0, 1.0, (inner.sum(), 3))
    return plain(mesh, nodes)


ALL = {
    "hex1": lambda: hexes(1, (3, 3, 2)),
    "hex2": lambda: hexes(2),
    "hex3": lambda: hexes(3),
    "hex4": lambda: hexes(4),
    "hex1 distorted": lambda: distorted(1),
    "hex2 distorted": lambda: distorted(2),
    "hex3 skewed": lambda: skewed(3),
    "tet1": lambda: tets(1, (3, 3, 2)),
    "tet2": lambda: tets(2),
    "tet2 bent": wavy_tets,
}
