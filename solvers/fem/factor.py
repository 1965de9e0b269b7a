"""Symmetric factorisations of K - sigma M behind one small protocol: solve, inertia, memory.

scipy's SuperLU is always enough; rslab (an LDL' with Bunch-Kaufman pivots) is taken when it is installed.
"""

from __future__ import annotations

import hashlib
import importlib.util
import os
from typing import Any, Protocol

import numpy as np
import scipy.sparse as sp
from scipy.sparse.linalg import splu
from threadpoolctl import threadpool_limits

from geometry.elements import FloatArray
from solvers.errors import SingularShift, SolverError, TooLarge

BACKWARD_ERROR = 1e-10  # of one solve; rounding times growth stays far below, garbage far above
MEMORY_SHARE = 0.8  # of what is available: the rest is vectors and the matrices themselves


class Factor(Protocol):
    """A factorised symmetric matrix."""

    negative: int  # eigenvalues below zero (Sylvester's law of inertia)

    def solve(self, right: FloatArray) -> FloatArray:
        """Solution of A x = right, for (n,) or (n, k)."""
        ...


class SuperLU:
    """scipy's sparse LU kept symmetric: the signs of U's diagonal count the negative eigenvalues (design by li2005)."""

    def __init__(self, matrix: sp.csc_array) -> None:
        with threadpool_limits(1):
            try:
                self._lu = splu(
                    matrix, permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options={"SymmetricMode": True}
                )
            except RuntimeError as fault:
                raise SingularShift(f"the shifted matrix is singular ({fault})") from fault
        if not np.array_equal(self._lu.perm_r, self._lu.perm_c):
            raise SingularShift("SuperLU left the diagonal while pivoting, so that the inertia cannot be read")
        self.negative = int((self._lu.U.diagonal() < 0.0).sum())

    def solve(self, right: FloatArray) -> FloatArray:
        """Solution of A x = right."""
        return np.asarray(self._lu.solve(right))


class Rslab:
    """Supernodal LDL' with Bunch-Kaufman pivots; it reports its inertia."""

    def __init__(self, matrix: sp.csc_array, symbolic: Any | None = None) -> None:
        import rslab

        self.symbolic = symbolic or rslab.analyze(matrix, path="ldlt", threads=_threads())
        _foresee(self.symbolic.estimate_memory(), matrix.shape[0])
        try:
            self._factor = self.symbolic.factor(matrix)
        except RuntimeError as fault:
            raise SingularShift(f"the shifted matrix is singular ({fault})") from fault
        _, self.negative, zero = self._factor.inertia
        if zero:
            raise SingularShift(f"the shifted matrix has {zero} zero pivot(s)")

    def solve(self, right: FloatArray) -> FloatArray:
        """Solution of A x = right."""
        right = np.ascontiguousarray(right)
        return np.asarray(self._factor.solve(right) if right.ndim == 1 else self._factor.solve_many(right))


def _threads() -> int:
    return int(os.environ.get("ANTINODE_THREADS", "0")) or (os.cpu_count() or 1)


def _foresee(estimate: dict[str, float], unknowns: int) -> None:
    """Refuse before it happens what would not fit into memory."""
    import psutil

    needed = estimate["factor_bytes"] + estimate["transient_peak_bytes"]
    room = psutil.virtual_memory().available * MEMORY_SHARE
    if needed > room:
        raise TooLarge(
            f"factorising {unknowns} unknowns needs about {needed / 2**30:.1f} GiB, {room / 2**30:.1f} GiB are free: "
            "ask for a coarser mesh, a lower order, or model = superelement"
        )


def available() -> list[str]:
    """Factorisations of this machine, the preferred one first."""
    return (["rslab"] if importlib.util.find_spec("rslab") else []) + ["superlu"]


class Factoriser:
    """Factorises matrices of one sparsity pattern, sharing the symbolic analysis, and checks each factor by a solve."""

    def __init__(self, backend: str | None = None) -> None:
        self.backend = backend or os.environ.get("ANTINODE_FACTOR") or available()[0]
        if self.backend not in available():
            raise SolverError(f"factorisation '{self.backend}' is not installed; there is {', '.join(available())}")
        self._symbolic: Any | None = None
        self._pattern = b""

    def __call__(self, matrix: sp.csc_array) -> Factor:
        """Factor of a symmetric matrix. Raises SingularShift when it is singular to working precision, TooLarge."""
        factor: Factor
        if self.backend == "rslab":
            pattern = hashlib.sha256(matrix.indptr.tobytes() + matrix.indices.tobytes()).digest()
            factor = Rslab(matrix, self._symbolic if pattern == self._pattern else None)
            self._symbolic, self._pattern = factor.symbolic, pattern
        else:
            factor = SuperLU(matrix)
        _probe(matrix, factor)
        return factor


def _probe(matrix: sp.csc_array, factor: Factor) -> None:
    """One solve with a fixed right-hand side: normwise backward error ||Ax - b|| / (||A|| ||x||)."""
    right = np.cos(np.arange(matrix.shape[0], dtype=float) * 1.618)
    solution = factor.solve(right)
    norm = float(abs(matrix).sum(axis=0).max()) * float(np.linalg.norm(solution))
    error = float(np.linalg.norm(matrix @ solution - right)) / max(norm, 1e-300)
    if not error < BACKWARD_ERROR:
        raise SingularShift(f"the factorisation's backward error is {error:.1e}, allowed is {BACKWARD_ERROR:.0e}")
