"""Meshed bodies of the verification cases, made without a mesher."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from geometry.hex.boxes import Boxes, hex_mesh
from geometry.materials import Material
from geometry.mesh import Mesh, split_hexahedra
from solvers.fem.assembly import assemble
from solvers.fem.solid import Pencil, constrain

Lines = tuple[np.ndarray, np.ndarray, np.ndarray]


def even(edges: tuple[float, float, float], cuts: tuple[int, int, int]) -> Lines:
    """Equal spacing from 0 along each edge."""
    x, y, z = (np.linspace(0.0, edge, n + 1) for edge, n in zip(edges, cuts, strict=True))
    return x, y, z


def bricks(lines: Lines, order: int) -> Mesh:
    """A box cut into hexahedra along the given lines."""
    counts = tuple(len(line) - 1 for line in lines)
    return hex_mesh(Boxes(*lines, np.zeros(counts, dtype=np.int64), ("body",)), order)


def mapped(mesh: Mesh, move: Callable[[np.ndarray], np.ndarray]) -> Mesh:
    """Elements with every node (n, 3) moved."""
    return Mesh(move(mesh.nodes), mesh.cells, mesh.kind, mesh.order, mesh.regions, mesh.faces)


def tetrahedra(lines: Lines, order: int) -> Mesh:
    """The box with each hexahedron cut into six tetrahedra."""
    return split_hexahedra(bricks(lines, order))


def joined(parts: list[Mesh]) -> Mesh:
    """Join several meshes whose common nodes coincide."""
    nodes = np.concatenate([part.nodes for part in parts])
    size = np.ptp(nodes, axis=0).max()
    first, label = np.unique(np.round(nodes / size, 9), axis=0, return_index=True, return_inverse=True)[1:]
    starts = np.cumsum([0] + [len(part.nodes) for part in parts])
    cells = np.concatenate([label[part.cells + start] for part, start in zip(parts, starts, strict=False)])
    return Mesh(nodes[first], cells, parts[0].kind, parts[0].order)


def quarter_rod(radius: float, length: float, cuts: int, slices: int, order: int) -> Mesh:
    """The quarter x, y >= 0 of a round rod: a rounded core and two sectors, `cuts` elements along each block's sides."""
    block = bricks(even((1.0, 1.0, length), (cuts, cuts, slices)), order)
    core = 0.55 * radius

    def inner(nodes: np.ndarray) -> np.ndarray:
        s, t = nodes[:, 0], nodes[:, 1]
        pull = 1.0 - 0.12 * s * t  # the core's corner lies nearer to the axis than a square's
        return np.column_stack([core * s * pull, core * t * pull, nodes[:, 2]])

    def outer(nodes: np.ndarray) -> np.ndarray:
        depth, along = nodes[:, :1], nodes[:, 1]
        angle = along * np.pi / 4.0
        rim = radius * np.column_stack([np.cos(angle), np.sin(angle)])
        edge = inner(np.column_stack([np.ones(len(along)), along, nodes[:, 2]]))[:, :2]
        return np.column_stack([edge + depth * (rim - edge), nodes[:, 2]])

    def turned(nodes: np.ndarray) -> np.ndarray:  # mirrored on x = y; two axes swapped twice keep the orientation
        moved = outer(nodes[:, [1, 0, 2]])
        return moved[:, [1, 0, 2]]

    return joined([mapped(block, shape) for shape in (inner, outer, turned)])


def at(mesh: Mesh, axis: int, value: float) -> np.ndarray:
    """Nodes on a plane, (n,) bool."""
    return np.abs(mesh.nodes[:, axis] - value) < 1e-9 * np.ptp(mesh.nodes, axis=0).max()


def constrained(mesh: Mesh, material: Material, stops: list[tuple[np.ndarray, list[int]]]) -> Pencil:
    """Pencil of a body whose nodes (masks) are fixed along some axes."""
    free = np.ones((len(mesh.nodes), 3), dtype=bool)
    for nodes, axes in stops:
        free[np.ix_(np.flatnonzero(nodes), axes)] = False
    regions = mesh.regions or {"body": None}
    return constrain(assemble(mesh, dict.fromkeys(regions, material)), free)
