"""Symmetric factorisations of K - sigma M behind one small protocol: solve, inertia, memory, free.

scipy's SuperLU is always there; rslab is taken when it is installed.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable
from typing import Any

import numpy as np
import scipy.sparse as sp

from solvers.errors import SingularShift, SolverError
from solvers.fem.factor import choice
from solvers.fem.factor.rslab import Rslab
from solvers.fem.factor.superlu import SuperLU
from solvers.machine import room_bytes
from solvers.threads import Item, Result, go_on
from solvers.threads import side_by_side as in_threads

BACKWARD_ERROR = 1e-10  # of one solve; rounding times growth stays far below, garbage far above
Factor = Rslab | SuperLU


def side_by_side(function: Callable[[Item], Result], items: Iterable[Item], bytes_each: float = 0.0) -> list[Result]:
    """The function of every item, each of which factorises: in threads, as memory holds."""
    return in_threads(function, items, bytes_each, room_bytes())


class Factoriser:
    """Factorises matrices of one sparsity pattern, sharing the symbolic analysis, and checks each factor by a solve.

    `backend`, or else the variable ANTINODE_FACTOR, names one of available(), whose first is taken without either.
    Raises SolverError for a name that is not available.
    """

    def __init__(self, backend: str | None = None) -> None:
        self.backend = backend or os.environ.get("ANTINODE_FACTOR") or choice.available()[0]
        if self.backend not in choice.available():
            raise SolverError(
                f"factorisation '{self.backend}' is not installed; there is {', '.join(choice.available())}"
            )
        self._symbolic: Any = None  # of the pattern seen last

    def __call__(self, matrix: sp.csc_array) -> Factor:
        """Factor of a symmetric matrix. Raises SingularShift when it is singular to working precision, TooLarge."""
        go_on()
        factor = (Rslab if self.backend == "rslab" else SuperLU)(matrix, self._symbolic)
        self._symbolic = factor.symbolic
        _probe(matrix, factor)
        return factor


def _probe(matrix: sp.csc_array, factor: Factor) -> None:
    """One solve with a fixed right-hand side: backward error ||Ax - b|| / (max |a_ij| ||x||), which bounds the normwise."""
    right = np.cos(np.arange(matrix.shape[0], dtype=float) * 1.618)
    solution = factor.solve(right)
    largest = max(float(matrix.data.max(initial=0.0)), -float(matrix.data.min(initial=0.0)))
    norm = largest * float(np.linalg.norm(solution))
    error = float(np.linalg.norm(matrix @ solution - right)) / max(norm, 1e-300)
    if not error < BACKWARD_ERROR:
        raise SingularShift(f"the factorisation's backward error is {error:.1e}, allowed is {BACKWARD_ERROR:.0e}")
