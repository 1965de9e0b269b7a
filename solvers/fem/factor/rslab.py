"""rslab: supernodal LDL' with Bunch-Kaufman pivots."""

from __future__ import annotations

import os
from typing import Any

import numpy as np
import scipy.sparse as sp

from geometry.elements import FloatArray
from solvers.errors import SingularShift
from solvers.fem.factor.keeper import Kept
from solvers.fem.factor.memory import foresee
from solvers.threads import threads

FILLED = 10.0  # factor over matrix, bytes: beyond, the body is no plate, and nested dissection may fill less than minimum fill
ANALYSIS_BYTES = 60  # measured peak of the analysis an entry of the matrix
COPY_BYTES = 30  # what of it is still in memory, an entry, while the factor is made; rslab's own plan leaves it out
# How long rslab's allocator keeps free pages for the next factor, ms; it reads this when rslab is first imported.
os.environ.setdefault("MIMALLOC_PURGE_DELAY", "1000")


class Rslab:
    """L D L' with the inertia of D's blocks of one and two; a symbolic analysis of another pattern is made anew."""

    def __init__(self, matrix: sp.csc_array, symbolic: Kept[Any] | None = None) -> None:
        try:
            self.symbolic = symbolic or _analysed(matrix)
            self._factor = self._made(matrix)
        except ValueError:  # rslab finds another pattern than it analysed
            if symbolic is None:
                raise
            self.symbolic = _analysed(matrix)
            self._factor = self._made(matrix)
        _, self.negative, zero = self._factor.use(lambda own: tuple(own.inertia))
        if zero:
            raise SingularShift(f"the shifted matrix has {zero} zero pivot(s)")

    def _made(self, matrix: sp.csc_array) -> Kept[Any]:
        plan = self.symbolic.use(lambda own: dict(own.memory_plan()))
        self.foreseen_bytes = foresee(plan["peak_bytes"] + COPY_BYTES * matrix.nnz, matrix.shape[0])
        self.memory_bytes = int(plan["factor_bytes"])
        try:
            return self.symbolic.make(lambda own: own.factor(matrix))
        except RuntimeError as fault:
            raise SingularShift(f"the shifted matrix is singular ({fault})") from fault

    def solve(self, right: FloatArray) -> FloatArray:
        """Solution of A x = right, for (n,) or (n, k)."""
        right = np.ascontiguousarray(right)

        def solution(own: Any) -> FloatArray:
            return np.array(
                own.solve(right) if right.ndim == 1 else own.solve_many(right)
            )  # a copy in memory of numpy's own

        return self._factor.use(solution)

    def free(self) -> None:
        """Give the memory back; the factor cannot be used afterwards."""
        self._factor.free()
        del self._factor


def _analysed(matrix: sp.csc_array) -> Kept[Any]:
    """Ordered by minimum fill; by nested dissection, which takes three times as long, where that fills too much."""
    foresee(ANALYSIS_BYTES * matrix.nnz, matrix.shape[0])
    at_once = threads()  # the asking thread's, not the keeper's
    return Kept(lambda: _best(matrix, at_once))


def _best(matrix: sp.csc_array, at_once: int) -> Any:
    import rslab

    symbolic = rslab.analyze(matrix, path="ldlt", threads=at_once, ordering="amf")
    if symbolic.memory_plan()["factor_bytes"] <= FILLED * 8.0 * matrix.nnz / 2.0:
        return symbolic
    other = rslab.analyze(matrix, path="ldlt", threads=at_once, ordering="metis")
    return min(symbolic, other, key=lambda result: result.memory_plan()["factor_bytes"])
