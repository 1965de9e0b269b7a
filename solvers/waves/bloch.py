"""Bloch-Floquet waves of a fully meshed unit cell: u(r + a) = u(r) exp(i k.a) on matching opposite faces.

The reduced pencil is a sum of real matrices times cosines and sines of the phases (the real embedding of twice the size
counts every wave twice), so no complex sparse matrix is ever formed.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp

from geometry.elements import FloatArray, IntArray
from geometry.errors import MeshError
from geometry.lattice import Lattice
from geometry.mesh import AnyMesh
from solvers.fem.assembly import System
from solvers.fem.eigen import PlainPencil, lowest_pairs

MATCH = 1e-6  # of the pitch: how far opposite nodes may lie apart
REAL_PHASE = 1e-12
PAIRS = 2_000_000  # of points and nodes whose distances are all computed, in the time that importing a tree takes


@dataclass(frozen=True)
class PeriodicNodes:
    """Master of every node, (n,), and the number of lattice vectors from it to the node, (n, 2)."""

    master: IntArray
    offset: IntArray


def periodic_nodes(mesh: AnyMesh, lattice: Lattice) -> PeriodicNodes:
    """Pair the nodes on x+ with x-, y+ with y- of the row below, shifted or not.

    Parameters
    ----------
    mesh : AnyMesh
        Mesh of one cell with faces x- to y+, coordinates in m.
    lattice : Lattice
        Lattice vectors of the cell.

    Returns
    -------
    PeriodicNodes
        Master of every node; a node that is not on x+ or y+ is its own.

    Raises
    ------
    MeshError
        If opposite faces do not match node for node.
    """
    low, allowed = mesh.nodes.min(axis=0), MATCH * min(lattice.cell_m)
    offset = np.zeros((len(mesh.nodes), 2), dtype=np.int64)
    for axis, face in enumerate(("x+", "y+")):
        offset[mesh.nodes_of(face), axis] = 1
    shifted = mesh.nodes[:, 0] - offset @ lattice.vectors_m[:, 0]
    offset[shifted < low[0] - allowed, 0] -= 1  # the row below begins half a pitch further on
    shift = np.column_stack([offset @ lattice.vectors_m, np.zeros(len(offset))])
    candidates = np.flatnonzero((offset == 0).all(axis=1))
    distance, nearest = _nearest(mesh.nodes[candidates], mesh.nodes - shift)
    if distance.max() > allowed:
        worst = 1e3 * (mesh.nodes[int(distance.argmax())] - np.array([low[0], low[1], 0.0]))
        raise MeshError(f"opposite faces do not match: the node at {worst.round(4)} mm has no partner one pitch away")
    return PeriodicNodes(candidates[nearest], offset)


def _nearest(nodes: FloatArray, points: FloatArray) -> tuple[FloatArray, IntArray]:
    """Distance from each point (n, 3) to the nearest of the nodes (m, 3), and which node that is, (n,) each."""
    if len(nodes) * len(points) <= PAIRS:
        squares = sum(np.subtract.outer(points[:, axis], nodes[:, axis]) ** 2 for axis in range(3))
        nearest = np.argmin(squares, axis=1)
        return np.linalg.norm(points - nodes[nearest], axis=1), nearest
    from scipy.spatial import cKDTree  # takes longer to import than small meshes take without it

    distance, nearest = cKDTree(nodes).query(points)
    return distance, nearest


class BlochCell:
    """The cell's K and M split by the phase they carry: K(k) = sum over d of K_d exp(i k.d), d a lattice vector."""

    def __init__(self, system: System, lattice: Lattice) -> None:
        self.scale, self.lattice = system.scale, lattice
        pairs = periodic_nodes(system.mesh, lattice)
        self.masters, self._follows = np.unique(pairs.master, return_inverse=True)
        self._offset, compact = pairs.offset, self._follows
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
        return self.scale.frequency(lowest_pairs(pencil, count, multiplicity)[0][::multiplicity])

    def prolonged(self, coarser: BlochCell, transfer: sp.csr_array, wavevector: FloatArray) -> sp.csr_array:
        """The matrix from a coarser cell's pencil at a wavevector to this one's, by that of the fields of their nodes."""
        own = self.lattice.phases(wavevector)
        phase = own @ coarser._offset.T
        nodes, shape = np.arange(len(phase)), (len(phase), len(coarser.masters))
        wave = (sp.csr_array((part(phase), (nodes, coarser._follows)), shape=shape) for part in (np.cos, np.sin))
        re, im = (sp.kron(transfer[self.masters] @ part, sp.eye_array(3), format="csr") for part in wave)
        if _is_real(own):
            return sp.csr_array(re)
        return sp.csr_array(sp.block_array([[re, -im], [im, re]], format="csr"))


def _is_real(phase: FloatArray) -> bool:
    """Whether waves of these phases across the cell are real."""
    return bool((np.abs(np.sin(phase)) < REAL_PHASE).all())


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
