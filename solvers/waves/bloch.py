"""Bloch-Floquet waves of a fully meshed unit cell: u(r + a) = u(r) exp(i k.a) on matching opposite faces.

The reduced pencil is a sum of real matrices times cosines and sines of the phases (the real embedding of twice the size
counts every wave twice), so no complex sparse matrix is ever formed.
"""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp

from geometry.elements import FloatArray, IntArray
from geometry.lattice import Lattice
from geometry.periodic import periodic_nodes
from solvers.fem.assembly import System
from solvers.fem.eigen import PlainPencil, lowest_pairs

REAL_PHASE = 1e-12


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
