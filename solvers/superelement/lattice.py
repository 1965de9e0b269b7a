"""Bloch waves of the infinite lattice of one reduced cell: a phase per side, one dense Hermitian pencil a wavevector."""

from __future__ import annotations

import numpy as np
from scipy.linalg import eigh
from threadpoolctl import threadpool_limits

from geometry.elements import FloatArray, IntArray
from solvers.superelement.cell import Cell

ROUNDING = 1e-12  # of the pencil's norms: smaller eigenvalues are rigid motions


class Lattice:
    """The reduced cell with one vertex line, one side along each axis and the fixed-interface modes left free."""

    def __init__(self, cell: Cell) -> None:
        self.cell = cell
        face = cell.interface
        width = face.vertex_block + 2 * face.side_block
        self.dof = width + len(cell.fixed_hz)
        vertex = np.arange(face.vertex_block, dtype=np.int64)
        side = np.arange(face.side_block, dtype=np.int64)
        self._place: list[tuple[IntArray, IntArray, tuple[int, int]]] = []
        for index, offset in enumerate(((0, 0), (1, 0), (0, 1), (1, 1))):
            self._place.append((face.vertex(index), vertex, offset))
        for index, offset in enumerate(((0, 0), (1, 0), (0, 0), (0, 1))):
            start = face.vertex_block + (index // 2) * face.side_block
            self._place.append((face.side(index), start + side, offset))
        modes = np.arange(len(cell.fixed_hz), dtype=np.int64)
        self._place.append((face.count + modes, width + modes, (0, 0)))

    def frequencies(self, wavevector: FloatArray, count: int) -> FloatArray:
        """The `count` lowest Bloch frequencies at a wavevector (2,) in rad/m, ascending, Hz (a dense solve misses none)."""
        transform = self.transform(np.asarray(wavevector, dtype=float))
        stiffness, mass = (
            transform.conj().T @ (matrix @ transform) for matrix in (self.cell.stiffness, self.cell.mass)
        )
        with threadpool_limits(1):
            values = eigh(
                stiffness, mass, eigvals_only=True, subset_by_index=[0, min(count, self.dof) - 1], driver="gvx"
            )
        rounding = ROUNDING * np.abs(self.cell.stiffness).max() / np.abs(self.cell.mass).max()
        return self.cell.scale.frequency(np.where(np.abs(values) < rounding, 0.0, values))

    def transform(self, wavevector: FloatArray) -> FloatArray:
        """T(k) with u_cell = T u_free: u(r + a) = u(r) exp(i k.a), shape (cell dof, dof)."""
        phase = wavevector * np.array(self.cell.size_m[:2])
        transform = np.zeros((self.cell.dof, self.dof), dtype=complex)
        for rows, columns, offset in self._place:
            transform[rows, columns] = np.exp(1j * (offset[0] * phase[0] + offset[1] * phase[1]))
        return transform
