"""Lower bounds of a meshed cell's Bloch waves from approximate ones, by one factor for all wavevectors.

With A = K + s M and m = l + s, approximate waves u_i, M-orthonormal and A-orthogonal, leave R_i = A u_i - m_i M u_i on the
fields that fulfil Bloch's conditions. Shared out over the nodes that these tie, R' acts on every field of the cell, so that
w_i = (u_i - A^-1 R'_i) / m_i is admissible in Goerisch's theorem: the form A of w_i and w_j is d_ij / m_i + E_ij / (m_i m_j),
E = R'^H A^-1 R', with A of the cell whose sides move freely. Where the (n + 1)th wave is known not to lie below v, the
negative eigenvalues t of (diag(m) - v) x = t (diag((v - m)^2 / m) + v^2 E_ij / (m_i m_j)) x bound the n lowest waves from
below by v - v / (1 - t) (goerisch1985).
"""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp
from scipy.linalg import eigh

from geometry.elements import ComplexArray, FloatArray
from geometry.lattice import Lattice
from solvers.fem.assembly import System, on_components
from solvers.fem.factor import Factoriser
from solvers.waves.bloch import periodic_nodes

APART = 1e-2  # relative distance of the eigenvalue above the bounded ones from them, at least
BELOW = 1e-4  # relative: how far it may at most lie below its approximation


class Enclosure:
    """The factor of K + s M, s the shift, of a cell whose sides move freely, and the ties of its nodes."""

    def __init__(self, system: System, lattice: Lattice, shift: float) -> None:
        self.system, self.lattice, self.shift = system, lattice, shift
        self.nodes = periodic_nodes(system.mesh, lattice)
        self.alike = np.bincount(self.nodes.master)[self.nodes.master]
        self.factor = Factoriser()(_shifted(system, shift))

    def rises(self, wavevector: FloatArray, motion: ComplexArray, values: FloatArray, count: int) -> FloatArray:
        """Bound by how much eigenvalues of approximate waves exceed those of the mesh.

        Parameters
        ----------
        wavevector : ndarray, shape (2,)
            In rad/m.
        motion : ndarray, shape (3n, k)
            Ritz vectors: waves at every node that fulfil Bloch's conditions, M-orthonormal.
        values : ndarray, shape (k,)
            Their Ritz values, ascending: the k lowest, scaled.
        count : int
            How many of them are bounded, fewer than k.

        Returns
        -------
        ndarray, shape (count,)
            Scaled, at least 0; inf where no wave above those bounded lies apart from them.

        References
        ----------
        .. [1] goerisch1985 (docs/references.bib)
        """
        left = self._shared(wavevector, motion, values)
        parts = self.factor.solve(np.hstack([left.real, left.imag]))
        solved = parts[:, : len(values)] + 1j * parts[:, len(values) :]
        coupling = left.conj().T @ solved
        shifted, out = values + self.shift, np.full(count, np.inf)
        for top in range(count, len(values)):
            if values[top] < (1.0 + APART) * values[top - 1]:
                continue
            own, above = shifted[:top], (1.0 - BELOW) * shifted[top]
            weight = np.diag((above - own) ** 2 / own) + above**2 * coupling[:top, :top] / np.outer(own, own)
            turns = eigh(np.diag(own - above), (weight + weight.conj().T) / 2.0, eigvals_only=True)
            lower = np.sort(above - above / (1.0 - turns))
            out = np.minimum(out, (own - lower)[:count])
        return np.maximum(out, 0.0)

    def _shared(self, wavevector: FloatArray, motion: ComplexArray, values: FloatArray) -> ComplexArray:
        """R' (3n, k): what the waves leave on tied nodes, in equal parts."""
        master, system = self.nodes.master, self.system
        turn = np.exp(1j * self.nodes.offset @ (self.lattice.vectors_m @ wavevector))[:, None]
        parts = np.hstack([motion.real, motion.imag])
        left = system.stiffness @ parts - on_components(system.mass, parts) * np.tile(values, 2)
        left = (left[:, : len(values)] + 1j * left[:, len(values) :]).reshape(len(master), -1)
        tied = np.zeros_like(left)
        np.add.at(tied, master, turn.conj() * left)
        return np.asarray(turn / self.alike[:, None] * tied[master]).reshape(motion.shape)


def _shifted(system: System, shift: float) -> sp.csc_array:
    """K + s M, (3n, 3n), whose rows are its columns."""
    whole = sp.csr_array(system.stiffness + sp.kron(shift * system.mass, sp.eye_array(3), format="csr"))
    return sp.csc_array((whole.data, whole.indices, whole.indptr), shape=whole.shape)
