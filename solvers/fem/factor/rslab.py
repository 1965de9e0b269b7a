"""rslab: supernodal LDL' with Bunch-Kaufman pivots."""

from __future__ import annotations

from typing import Any

import numpy as np
import scipy.sparse as sp

from geometry.elements import FloatArray
from solvers.errors import SingularShift
from solvers.fem.factor.keeper import Kept
from solvers.fem.factor.memory import foresee
from solvers.threads import threads

FILLED = 10.0  # factor over matrix, bytes: beyond, the body is no plate, and nested dissection fills less than minimum degree
ANALYSIS_BYTES = 60  # measured peak of the analysis an entry of the matrix
COPY_BYTES = 30  # what of it is still in memory, an entry, while the factor is made; rslab's own plan leaves it out


class Rslab:
    """L D L' with the inertia of D's blocks of one and two."""

    def __init__(self, matrix: sp.csc_array, symbolic: Kept[Any] | None = None) -> None:
        dofs = matrix.shape[0]
        if symbolic is None:
            foresee(ANALYSIS_BYTES * matrix.nnz, dofs)
        self.symbolic = symbolic or _analysed(matrix)
        plan = self.symbolic.use(lambda own: dict(own.memory_plan()))
        self.foreseen_bytes = foresee(plan["peak_bytes"] + COPY_BYTES * matrix.nnz, dofs)
        self.memory_bytes = int(plan["factor_bytes"])
        try:
            self._factor = self.symbolic.make(lambda own: own.factor(matrix))
        except RuntimeError as fault:
            raise SingularShift(f"the shifted matrix is singular ({fault})") from fault
        _, self.negative, zero = self._factor.use(lambda own: tuple(own.inertia))
        if zero:
            raise SingularShift(f"the shifted matrix has {zero} zero pivot(s)")

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
    """Ordered by minimum degree, which takes a fifth of the time of others; by nested dissection where that fills too much."""
    at_once = threads()  # the asking thread's, not the keeper's
    return Kept(lambda: _best(matrix, at_once))


def _best(matrix: sp.csc_array, at_once: int) -> Any:
    import rslab

    symbolic = rslab.analyze(matrix, path="ldlt", threads=at_once, ordering="amd")
    if symbolic.memory_plan()["factor_bytes"] <= FILLED * 8.0 * matrix.nnz / 2.0:
        return symbolic
    other = rslab.analyze(matrix, path="ldlt", threads=at_once, ordering="metis")
    return min(symbolic, other, key=lambda result: result.memory_plan()["factor_bytes"])
