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
from solvers.fem.assembly import System, on_components
from solvers.fem.factor import Factoriser
from solvers.waves.bloch import BlochCell

APART = 1e-2  # relative distance of the eigenvalue above the bounded ones from them, at least
ALIKE = 1e-14  # of the largest mass: what is rounding
BELOW = 1e-4  # relative: how far it may at most lie below its approximation


class Enclosure:
    """The factor of A = K + s M, s the shift, of a cell whose sides move freely, and the ties of its nodes."""

    def __init__(self, system: System, cell: BlochCell, shift: float) -> None:
        self.system, self.cell, self.shift = system, cell, shift
        self.alike = np.bincount(cell.follows)[:, None, None]
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
        left, answer = self._answered(wavevector, motion, values)
        coupling = left.conj().T @ answer
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

    def nearer(self, wavevector: FloatArray, motion: ComplexArray, values: FloatArray) -> ComplexArray:
        """Combine approximate waves with A^-1 R', averaged over tied nodes, to ones that lie nearer to those of the mesh.

        Parameters as for `rises`. Returns as many motions (3n, k), M-orthonormal.
        """
        _, answer = self._answered(wavevector, motion, values)
        space = np.hstack([motion, self._shared(wavevector, answer)])
        space = space / np.linalg.norm(space, axis=0)
        stiff, heavy = (space.conj().T @ image for image in self._images(space))
        size, turn = eigh(heavy)
        kept = size > ALIKE * size[-1]
        turn = turn[:, kept] / np.sqrt(size[kept])
        _, mix = eigh(turn.conj().T @ stiff @ turn)
        return np.asarray(space @ (turn @ mix[:, : len(values)]))

    def _images(self, motion: ComplexArray) -> tuple[ComplexArray, ComplexArray]:
        """K and M times motions, (3n, k) each."""
        parts, system = np.ascontiguousarray(motion).view(float), self.system
        stiff, heavy = np.asarray(system.stiffness @ parts), on_components(system.mass, parts)
        return stiff.view(complex), heavy.view(complex)

    def _answered(
        self, wavevector: FloatArray, motion: ComplexArray, values: FloatArray
    ) -> tuple[ComplexArray, ComplexArray]:
        """R' and A^-1 R', (3n, k): what the waves leave, shared out over tied nodes, and the cell's answer to it."""
        stiff, heavy = self._images(motion)
        left = self._shared(wavevector, stiff - heavy * values)
        return left, np.ascontiguousarray(self.factor.solve(left.view(float))).view(complex)

    def _shared(self, wavevector: FloatArray, field: ComplexArray) -> ComplexArray:
        """A field (3n, k) whose tied nodes have equal parts of their sum, but for their phases."""
        cell, turn = self.cell, self.cell.turns(wavevector)
        own = np.asarray(turn.conj() * field.reshape(len(turn), 3, -1))
        total = np.zeros((len(cell.masters), *own.shape[1:]), dtype=complex)
        np.add.at(total, cell.follows, own)
        return np.asarray(turn * (total / self.alike)[cell.follows]).reshape(field.shape)


def _shifted(system: System, shift: float) -> sp.csc_array:
    """K + s M, (3n, 3n), whose rows are its columns."""
    whole = sp.csr_array(system.stiffness + sp.kron(shift * system.mass, sp.eye_array(3), format="csr"))
    return sp.csc_array((whole.data, whole.indices, whole.indptr), shape=whole.shape)
