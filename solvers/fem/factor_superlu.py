"""scipy's SuperLU kept symmetric: everywhere there, ordered and measured here before it starts."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp
from scipy.sparse.linalg import spilu, splu

from geometry.elements import FloatArray, IntArray
from solvers.errors import SingularShift, TooLarge
from solvers.fem.factor_memory import foresee
from solvers.fem.factor_symbolic import alike, postordered, quotient
from solvers.one_thread import one_thread

DENSE = 3000  # unknowns up to which even a full triangle is small: SuperLU orders by itself
WORTH = 0.5  # classes of alike unknowns are ordered instead of unknowns when they are this few
SOLVE_BYTES = 26  # measured peak a factor entry: 8 in L, 12 in U, and the buffers that grow
INERTIA_BYTES = 24  # scipy copies L and U to show U's diagonal
COPY_BYTES = 16  # an entry of the matrix, reordered
INDEX_LIMIT = 2**31 - 1  # SuperLU counts in 32 bits: first 30 times the matrix's entries, then half as many again
FIRST_GUESS, GROWTH = 30, 1.5
SYMMETRIC = {"SymmetricMode": True}


@dataclass(frozen=True)
class Ordering:
    """Order of elimination (n,), and the entries of L that it leads to; the order is None where SuperLU finds it."""

    order: IntArray | None
    entries: int


def analyse(matrix: sp.csc_array) -> Ordering:
    """Minimum degree on the graph of alike unknowns, and the exact count of L's entries. Source: davis2006."""
    count = matrix.shape[0]
    if count <= DENSE:
        return Ordering(None, count * (count + 1) // 2)
    label, size = alike(matrix)
    graph = matrix
    if len(size) > WORTH * count:
        label, size = np.arange(count), np.ones(count, dtype=np.int64)
    else:
        graph = quotient(matrix, label, len(size))
    place, entries = postordered(graph, _minimum_degree(graph), size)
    return Ordering(np.argsort(place[label], kind="stable"), entries)


def _minimum_degree(graph: sp.csc_array) -> IntArray:
    """Turn of every vertex in SuperLU's own minimum-degree order.

    An incomplete factorisation that drops everything costs little more than the ordering it begins with.
    """
    ones = sp.csc_array((np.full(graph.nnz, -1.0), graph.indices, graph.indptr), shape=graph.shape)
    dominant = sp.csc_array(ones + sp.diags_array(np.diff(graph.indptr) + 2.0))
    with one_thread():
        trial = spilu(dominant, 1.0, 1.0, permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options=SYMMETRIC)
    return np.asarray(trial.perm_c, dtype=np.int64)


def _reordered(matrix: sp.csc_array, order: IntArray) -> sp.csc_array:
    """Rows and columns in a new order."""
    place = np.empty_like(order)
    place[order] = np.arange(len(order))
    moved = matrix[:, order]
    moved.indices = place[moved.indices].astype(moved.indices.dtype)
    moved.has_sorted_indices = False
    moved.sort_indices()
    return moved


class SuperLU:
    """Sparse LU on the diagonal: the signs of U's diagonal count the negative eigenvalues. Source: li2005."""

    def __init__(self, matrix: sp.csc_array, symbolic: Ordering | None = None) -> None:
        self.symbolic = symbolic or analyse(matrix)
        self._unknowns = matrix.shape[0]
        self._negative: int | None = None
        self.foreseen_bytes = self._foreseen(matrix.nnz)
        order = self.symbolic.order
        column = "NATURAL" if order is not None else "MMD_AT_PLUS_A"
        kept = matrix if order is None else _reordered(matrix, order)
        with one_thread():
            try:
                self._lu = splu(kept, permc_spec=column, diag_pivot_thresh=0.0, options=SYMMETRIC)
            except RuntimeError as fault:
                raise SingularShift(f"the shifted matrix is singular ({fault})") from fault
            except MemoryError as fault:
                raise TooLarge(f"factorising {self._unknowns} unknowns took more memory than there is") from fault
        if not np.array_equal(self._lu.perm_r, self._lu.perm_c):
            raise SingularShift("SuperLU left the diagonal while pivoting, so that the inertia cannot be read")

    def _foreseen(self, stored: int) -> int:
        if max(FIRST_GUESS * stored, GROWTH * self.symbolic.entries) > INDEX_LIMIT:
            raise TooLarge(
                f"{self._unknowns} unknowns with {stored:.2g} entries, {self.symbolic.entries:.2g} in the factor, are more "
                "than SuperLU can count: install rslab, or ask for a coarser mesh, a lower order, or model = superelement"
            )
        factorise = SOLVE_BYTES * self.symbolic.entries + COPY_BYTES * stored
        count = (SOLVE_BYTES + INERTIA_BYTES) * self.symbolic.entries
        return foresee(max(factorise, count), self._unknowns)

    @property
    def negative(self) -> int:
        """Eigenvalues below zero."""
        if self._negative is None:
            self._negative = int((self._lu.U.diagonal() < 0.0).sum())
        return self._negative

    @property
    def memory_bytes(self) -> int:
        """Bytes held: L in supernodes, U with indices, and scipy's copies of both once the inertia was read."""
        held = 20 if self._negative is None else 20 + INERTIA_BYTES
        return int(self._lu.nnz // 2 * held)

    def solve(self, right: FloatArray) -> FloatArray:
        """Solution of A x = right, for (n,) or (n, k)."""
        order = self.symbolic.order
        if order is None:
            return np.asarray(self._lu.solve(right))
        solution = np.empty(right.shape)
        solution[order] = self._lu.solve(right[order])
        return solution

    def free(self) -> None:
        """Give the memory back; the factor cannot be used afterwards."""
        del self._lu
