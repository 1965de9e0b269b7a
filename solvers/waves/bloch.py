"""Bloch-Floquet waves of a fully meshed unit cell: u(r + a) = u(r) exp(i k.a) on matching opposite faces.

The reduced pencil is a sum of real matrices times cosines and sines of the phases (the real embedding of twice the size
counts every wave twice), so no complex sparse matrix is ever formed.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from itertools import combinations, product
from math import gcd

import numpy as np
import scipy.sparse as sp

from geometry.elements import BoolArray, ComplexArray, FloatArray, IntArray
from geometry.errors import MeshError
from geometry.lattice import Lattice
from geometry.mesh import AnyMesh
from solvers.fem.assembly import System
from solvers.fem.eigen import PlainPencil, lowest_pairs
from solvers.fem.factor import Factoriser
from solvers.fem.surface import boundary_facets

REAL_PHASE = 1e-12
MATCH = 1e-6  # of the pitch: how far opposite nodes may lie apart
OUTMOST = 1e-4  # of the pitch: how far the facets of a side may lie from its plane
UPRIGHT = 1e-3  # largest share of z in the normal of a side, and difference in rad between normals of one side
NEAREST = 2  # multiples of each lattice vector that may lead from a side to its image
PAIRS = 2_000_000  # of points and nodes whose distances are all computed, in the time that importing a tree takes
INWARDS = 0.1  # of the way from a facet's corners to its middle: points that a facet which it meets contains
DIGITS = 9  # of a direction
DIRECTIONS = 64  # directions in which all nodes are projected at once
AXES = {(1.0, 0.0): "x+", (-1.0, 0.0): "x-", (0.0, 1.0): "y+", (0.0, -1.0): "y-"}


class BlochCell:
    """The cell's K and M split by the phase they carry: K(k) = sum over d of K_d exp(i k.d), d a lattice vector."""

    def __init__(self, system: System, lattice: Lattice) -> None:
        self.scale, self.lattice, self._factorise = system.scale, lattice, Factoriser()
        pairs = periodic_nodes(system.mesh, lattice)
        self.masters, self.follows = np.unique(pairs.master, return_inverse=True)
        self.offset, compact = pairs.offset, self.follows
        self.dof = 3 * len(self.masters)
        unknown = (3 * compact[:, None] + np.arange(3)).ravel()
        offset = np.repeat(pairs.offset, 3, axis=0)
        self.stiffness = _by_phase(system.stiffness, unknown, offset, self.dof)
        scalar = _by_phase(system.mass, compact, pairs.offset, len(self.masters))
        self.mass = {d: sp.csr_array(sp.kron(m, sp.eye_array(3), format="csr")) for d, m in scalar.items()}

    def pencil(self, wavevector: FloatArray) -> tuple[PlainPencil, int]:
        """The real pencil at a wavevector (rad/m) and how often it counts each wave: 1 where phases are real, else 2."""
        phase = self.lattice.phases(wavevector)
        parts = [_at_phase(matrices, phase) for matrices in (self.stiffness, self.mass)]
        if _is_real(phase):
            (k, _), (m, _) = parts
            return PlainPencil(sp.csc_array(k), sp.csc_array(m), self.scale), 1
        k, m = (sp.csc_array(sp.block_array([[re, -im], [im, re]], format="csc")) for re, im in parts)
        return PlainPencil(k, m, self.scale), 2

    def frequencies(self, wavevector: FloatArray, count: int) -> FloatArray:
        """The `count` lowest Bloch frequencies at a wavevector (2,) in rad/m, ascending, Hz, every one counted."""
        pencil, multiplicity = self.pencil(np.asarray(wavevector, dtype=float))
        values, _ = lowest_pairs(pencil, count, multiplicity, self._factorise)
        return self.scale.frequency(values[::multiplicity])

    def turns(self, wavevector: FloatArray) -> ComplexArray:
        """exp(i k.d) of every node, (n, 1, 1), d from the node that leads it."""
        return np.asarray(np.exp(1j * self.offset @ self.lattice.phases(wavevector)))[:, None, None]

    def led(self, motion: ComplexArray) -> ComplexArray:
        """Motions (dof, k) of the nodes that lead, from those of all, (3n, k)."""
        return motion.reshape(len(self.follows), 3, -1)[self.masters].reshape(self.dof, -1)

    def motion(self, wavevector: FloatArray, led: ComplexArray) -> ComplexArray:
        """Motions (3n, k) of all nodes, from those of the nodes that lead, (dof, k)."""
        parts = led.reshape(len(self.masters), 3, -1)[self.follows]
        return np.asarray(self.turns(wavevector) * parts).reshape(3 * len(self.follows), -1)

    def over(self, basis: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Lattice vectors d (m, 2) and basis' K_d basis and basis' M_d basis (m, n, n)."""
        stiff, heavy = (
            np.array([_projected(matrix, basis) for matrix in each.values()]) for each in (self.stiffness, self.mass)
        )
        return np.array(list(self.stiffness), dtype=float), stiff, heavy

    def prolonged(self, coarser: BlochCell, transfer: sp.csr_array, wavevector: FloatArray) -> sp.csr_array:
        """The matrix from a coarser cell's pencil at a wavevector to this one's, by that of the fields of their nodes."""
        own = self.lattice.phases(wavevector)
        phase = own @ coarser.offset.T
        nodes, shape = np.arange(len(phase)), (len(phase), len(coarser.masters))
        wave = (sp.csr_array((part(phase), (nodes, coarser.follows)), shape=shape) for part in (np.cos, np.sin))
        re, im = (sp.kron(transfer[self.masters] @ part, sp.eye_array(3), format="csr") for part in wave)
        if _is_real(own):
            return sp.csr_array(re)
        return sp.csr_array(sp.block_array([[re, -im], [im, re]], format="csr"))


def _is_real(phase: FloatArray) -> bool:
    """Whether waves of these phases across the cell are real."""
    return bool((np.abs(np.sin(phase)) < REAL_PHASE).all())


def _projected(matrix: sp.csr_array, basis: FloatArray) -> FloatArray:
    """basis' matrix basis, where many rows are empty."""
    rows = np.flatnonzero(np.diff(matrix.indptr))
    return np.asarray(basis[rows].T @ (matrix[rows] @ basis))


def _by_phase(
    matrix: sp.csr_array, unknown: IntArray, offset: IntArray, size: int
) -> dict[tuple[int, int], sp.csr_array]:
    """Fold slaves onto masters, keeping apart the entries by their difference of offsets (column minus row)."""
    entries = matrix.tocoo()
    step = offset[entries.col] - offset[entries.row]
    folded = {}
    kinds = {*map(tuple, offset.tolist())}
    for dx, dy in sorted({(x - other_x, y - other_y) for x, y in kinds for other_x, other_y in kinds}):
        pick = (step[:, 0] == dx) & (step[:, 1] == dy)
        place = (unknown[entries.row[pick]], unknown[entries.col[pick]])
        part = sp.csr_array(sp.coo_array((entries.data[pick], place), shape=(size, size)))
        part.sum_duplicates()
        folded[dx, dy] = part
    return folded


def _at_phase(matrices: dict[tuple[int, int], sp.csr_array], phase: FloatArray) -> tuple[sp.csr_array, sp.csr_array]:
    """Real and imaginary part of sum K_d exp(i d.phase)."""
    real = sum(np.cos(d @ phase) * m for d, m in ((np.array(k), m) for k, m in matrices.items()))
    imaginary = sum(np.sin(d @ phase) * m for d, m in ((np.array(k), m) for k, m in matrices.items()))
    return sp.csr_array(real), sp.csr_array(imaginary)


# -- sides of a cell and the pairs of their nodes -----------------------------------------------------------------------


@dataclass(frozen=True)
class PeriodicNodes:
    """Master of every node, (n,), and the number of lattice vectors from it to the node, (n, 2)."""

    master: IntArray
    offset: IntArray


@dataclass(frozen=True)
class Side:
    """A plane side of a cell: its name, outward normal (2,), nodes, and facets by shape: corners in a ring, all nodes."""

    name: str
    normal: FloatArray
    facets: tuple[tuple[IntArray, IntArray], ...]
    nodes: IntArray


def periodic_nodes(mesh: AnyMesh, lattice: Lattice) -> PeriodicNodes:
    """Pair the nodes on the sides of a cell with their images a lattice vector back.

    Parameters
    ----------
    mesh : AnyMesh
        Mesh of one cell, coordinates in m.
    lattice : Lattice
        Lattice vectors of the cell.

    Returns
    -------
    PeriodicNodes
        Master of every node; a node without an image further back is its own.

    Raises
    ------
    MeshError
        For sides that do not match node for node and edge for edge.
    """
    pairing = _Pairing(mesh, lattice)
    if faults := list(pairing.faults()):
        size = np.ptp(mesh.nodes[:, :2], axis=0)
        vectors = " and ".join(f"({1e3 * x:g}, {1e3 * y:g})" for x, y in lattice.vectors_m)
        about = f"the mesh is {1e3 * size[0]:.6g} x {1e3 * size[1]:.6g} mm, the lattice vectors are {vectors} mm"
        raise MeshError(f"sides of the cell do not match: {'; '.join(faults)}; {about}")
    return pairing.nodes


class _Pairing:
    """Sides of a mesh, and for each of their nodes the images on an opposite side."""

    def __init__(self, mesh: AnyMesh, lattice: Lattice) -> None:
        self.mesh, self.lattice = mesh, lattice
        self.pitch = float(np.linalg.norm(lattice.vectors_m, axis=1).min())
        self.sides = sides(mesh, self.pitch)
        self.allowed = MATCH * self.pitch
        steps = range(-NEAREST, NEAREST + 1)
        self.steps = np.array([(i, j) for i, j in product(steps, steps) if gcd(i, j) == 1])
        found = [self._images(side) for side in self.sides]
        self.lacking = [far for _, far in found]
        self.pairs = np.vstack([np.empty((0, 2), dtype=np.int64), *(pairs for pairs, _ in found)])

    def _images(self, side: Side) -> tuple[IntArray, FloatArray]:
        """Pairs (k, 2) of nodes of a side and of the opposite ones, and distances (n,) of its nodes to the nearest image."""
        opposite = [other.nodes for other in self.sides if other.normal @ side.normal < UPRIGHT - 1.0]
        far, pairs = np.full(len(side.nodes), np.inf), []
        if not opposite:
            return np.empty((0, 2), dtype=np.int64), far
        partners, points = np.unique(np.concatenate(opposite)), self.mesh.nodes
        for step in self.steps @ self.lattice.vectors_m:
            if step @ side.normal > self.allowed:
                away, nearest = _nearest(points[partners], points[side.nodes] - [*step, 0.0])
                far = np.minimum(far, away)
                here = away <= self.allowed
                pairs.append(np.column_stack([side.nodes[here], partners[nearest[here]]]))
        return np.vstack(pairs), far

    def faults(self) -> Iterator[str]:
        """Describe each side without partners, and each with facets that meet an opposite side but not its nodes or edges.

        A facet that meets none is a free wall, such as that of a pillar which ends at the cell's border.
        """
        if not self.sides:
            yield "it has no plane side faces"
        for side, far in zip(self.sides, self.lacking, strict=True):
            alone = [self._without(side, corners) for corners, _ in side.facets]
            if not all(each.all() for each in alone):
                alone = [each & self._meets(side, part) for each, (part, _) in zip(alone, side.facets, strict=True)]
            wrong = [full[each].ravel() for each, (_, full) in zip(alone, side.facets, strict=True)]
            nodes = np.isin(side.nodes, np.concatenate(wrong)) & (far > self.allowed)
            if nodes.any():
                furthest = far[nodes].max()
                worst = f", the worst {1e3 * furthest:.3g} mm from one" if np.isfinite(furthest) else ""
                yield (f"side {side.name}: {nodes.sum()} of its {len(far)} nodes have no partner one pitch away{worst}")
            elif count := sum(int(each.sum()) for each in alone):
                yield f"side {side.name}: its nodes have partners, but {count} of its facets have other edges there"
        tied = np.unique(self.nodes.offset, axis=0).tolist()
        count = gcd(*(one[0] * two[1] - one[1] * two[0] for one, two in combinations(tied, 2)))
        if count > 1:
            yield f"its sides lie {count} cells apart"

    def _opposite(self, side: Side, corners: int) -> list[IntArray]:
        """Corners (n, corners) of the facets of opposite sides with that many."""
        return [
            rows
            for other in self.sides
            if other.normal @ side.normal < UPRIGHT - 1.0
            for rows, _ in other.facets
            if rows.shape[1] == corners
        ]

    def _without(self, side: Side, facets: IntArray) -> BoolArray:
        """Which facets of a side, by their corners, have no image on an opposite one, (n,)."""
        masters = self.nodes.master
        known = {
            row.tobytes() for rows in self._opposite(side, facets.shape[1]) for row in np.sort(masters[rows], axis=1)
        }
        return np.array([row.tobytes() not in known for row in np.sort(masters[facets], axis=1)], dtype=bool)

    def _meets(self, side: Side, facets: IntArray) -> BoolArray:
        """Which facets of a side, by their corners, lie on facets of an opposite one after a lattice vector, (n,)."""
        points = self.mesh.nodes
        corners, along = points[facets], np.array([-side.normal[1], side.normal[0]])
        middles = corners.mean(axis=1)[:, None]
        probes = np.concatenate([middles, INWARDS * middles + (1.0 - INWARDS) * corners], axis=1)
        met = np.zeros(len(facets), dtype=bool)
        for rows in (*self._opposite(side, 3), *self._opposite(side, 4)):
            ring = np.stack([points[rows][..., :2] @ along, points[rows][..., 2]], axis=-1)
            depth = points[rows][:, 0, :2] @ side.normal
            for step in self.steps @ self.lattice.vectors_m:
                image = probes - [*step, 0.0]
                if abs((image[..., :2] @ side.normal).mean() - depth.mean()) > OUTMOST * self.pitch:
                    continue
                places = np.stack([image[..., :2] @ along, image[..., 2]], axis=-1)
                met |= np.array([_is_inside(place, ring) for place in places], dtype=bool)
        return met

    @cached_property
    def nodes(self) -> PeriodicNodes:
        """Masters, those furthest back along a2, then along a1, and offsets."""
        from scipy.sparse import coo_array
        from scipy.sparse.csgraph import connected_components

        points, count = self.mesh.nodes[:, :2], len(self.mesh.nodes)
        graph = coo_array((np.ones(len(self.pairs)), tuple(self.pairs.T)), shape=(count, count))
        _, label = connected_components(graph, directed=False)
        first = np.unique(label, return_index=True)[1][label]
        offset = np.rint((points - points[first]) @ np.linalg.inv(self.lattice.vectors_m)).astype(np.int64)
        order = np.lexsort((offset[:, 0], offset[:, 1], label))
        master = order[np.searchsorted(label[order], label)]
        return PeriodicNodes(master, offset - offset[master])


def sides(mesh: AnyMesh, pitch_m: float) -> list[Side]:
    """Find the plane sides of a cell: upright outer facets beyond which nothing of it lies.

    Parameters
    ----------
    mesh : AnyMesh
        Mesh of one cell, coordinates in m.
    pitch_m : float
        Length relative to which facets lie on one plane, m.

    Returns
    -------
    list of Side
        Sides in the order of their directions.
    """
    turns, found = [], []
    for corners, full in boundary_facets(mesh):
        points = mesh.nodes[corners]
        normal = np.cross(points[:, 1] - points[:, 0], points[:, 2] - points[:, 0])
        upright = np.flatnonzero(np.abs(normal[:, 2]) < UPRIGHT * np.linalg.norm(normal, axis=1))
        flat = normal[upright, :2] / np.linalg.norm(normal[upright, :2], axis=1)[:, None]
        for sign in (-1.0, 1.0):
            own = np.einsum("fcj,fj->fc", points[upright, :, :2], sign * flat).min(axis=1)
            outmost = own >= _extent(mesh.nodes, sign * flat) - OUTMOST * pitch_m
            turns += np.arctan2(sign * flat[outmost, 1], sign * flat[outmost, 0]).round(DIGITS).tolist()
            found += list(zip(corners[upright[outmost]], full[upright[outmost]], strict=True))
    return [_side([found[place] for place in group], turns[group[0]]) for group in _alike(turns)]


def _extent(nodes: FloatArray, directions: FloatArray) -> FloatArray:
    """How far nodes (n, 3) reach along directions (m, 2), (m,)."""
    distinct, place = np.unique(directions.round(DIGITS), axis=0, return_inverse=True)
    points = nodes[:, :2].T
    parts = [(distinct[i : i + DIRECTIONS] @ points).max(axis=1) for i in range(0, len(distinct), DIRECTIONS)]
    return np.concatenate([np.empty(0), *parts])[place.ravel()]


def _alike(turns: list[float]) -> list[list[int]]:
    """Places of directions in rad, those within UPRIGHT of their neighbours as one group."""
    groups: list[list[int]] = []
    for place in np.argsort(turns, kind="stable").tolist():
        if groups and turns[place] - turns[groups[-1][-1]] < UPRIGHT:
            groups[-1].append(place)
        else:
            groups.append([place])
    if len(groups) > 1 and turns[groups[0][0]] + 2.0 * np.pi - turns[groups[-1][-1]] < UPRIGHT:
        groups[0] += groups.pop()
    return groups


def _side(facets: list[tuple[IntArray, IntArray]], turn: float) -> Side:
    normal = np.array([np.cos(turn), np.sin(turn)])
    shapes = sorted({len(corners) for corners, _ in facets})
    alike = ([each for each in facets if len(each[0]) == corners] for corners in shapes)
    rows = tuple((np.array([own for own, _ in each]), np.array([full for _, full in each])) for each in alike)
    nodes = np.unique(np.concatenate([full for _, full in facets]))
    x, y = normal.round()
    along = np.abs(normal - [x, y]).max() < UPRIGHT
    return Side(AXES[x, y] if along else f"towards ({normal[0]:.3g}, {normal[1]:.3g})", normal, rows, nodes)


def _is_inside(points: FloatArray, polygons: FloatArray) -> bool:
    """Whether any of some points (p, 2) lies in any of convex polygons (n, corners, 2), whichever way round."""
    edges = np.roll(polygons, -1, axis=1) - polygons
    away = points[:, None, None] - polygons
    turns = edges[..., 0] * away[..., 1] - edges[..., 1] * away[..., 0]
    return bool(((turns > 0.0).all(axis=2) | (turns < 0.0).all(axis=2)).any())


def _nearest(nodes: FloatArray, points: FloatArray) -> tuple[FloatArray, IntArray]:
    """Distance from each point (n, 3) to the nearest of the nodes (m, 3), and which node that is, (n,) each."""
    if len(nodes) * len(points) <= PAIRS:
        squares = sum(np.subtract.outer(points[:, axis], nodes[:, axis]) ** 2 for axis in range(3))
        nearest = np.argmin(squares, axis=1)
        return np.linalg.norm(points - nodes[nearest], axis=1), nearest
    from scipy.spatial import cKDTree  # takes longer to import than small meshes take without it

    distance, nearest = cKDTree(nodes).query(points)
    return distance, nearest
