"""MKL PARDISO through pypardiso's library: LDL' of the upper triangle with Bunch-Kaufman pivots."""

from __future__ import annotations

import ctypes
import weakref
from typing import Any

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from geometry.elements import FloatArray
from solvers.errors import SingularShift, SolverError, TooLarge
from solvers.machine import foresee
from solvers.threads import threads

SYMMETRIC_INDEFINITE = -2
ANALYSE, FACTORISE, SOLVE, RELEASE = 11, 22, 33, -1
# Numbered from 1 as in MKL's manual: own values; parallel nested dissection; no refinement; pivots below 1e-13 of the
# norm count as singular; no scaling, no matching, K - sigma M being scaled already; report the fill; pivots of two.
SETTINGS = {1: 1, 2: 3, 8: 0, 10: 13, 11: 0, 13: 0, 18: -1, 21: 1, 24: 0}
PERTURBED, PEAK_KB, KEPT_KB, NUMERIC_KB, NEGATIVE = 14, 15, 16, 17, 23  # outputs, numbered alike
NO_MEMORY, ZERO_PIVOT = -2, -4


def load() -> Any:
    """A solver of pypardiso with MKL loaded. Raises ImportError or OSError where there is none."""
    from pypardiso import PyPardisoSolver

    return PyPardisoSolver(mtype=SYMMETRIC_INDEFINITE)


def _upper(matrix: sp.csc_array) -> tuple[NDArray[np.int32], NDArray[np.int32], FloatArray]:
    """Starts, columns (both from 1) and values of the upper triangle by rows, which is the lower one by columns."""
    if not matrix.has_sorted_indices:
        matrix = matrix.sorted_indices()
    count = matrix.shape[0]
    column = np.repeat(np.arange(count, dtype=np.int32), np.diff(matrix.indptr))
    kept = matrix.indices >= column
    length = np.bincount(column[kept], minlength=count)
    starts = np.concatenate([[1], 1 + np.cumsum(length)]).astype(np.int32)
    columns = np.asarray(matrix.indices[kept].astype(np.int32) + np.int32(1))
    if (length == 0).any() or (columns[starts[:-1] - 1] != np.arange(1, count + 1)).any():
        raise SingularShift("the shifted matrix has a zero on its diagonal")
    return starts, columns, np.ascontiguousarray(matrix.data[kept])


class _Handle:
    """PARDISO's memory for one matrix."""

    def __init__(self, matrix: sp.csc_array) -> None:
        self.dofs = matrix.shape[0]
        self.starts, self.columns, self.values = _upper(matrix)
        self.solver = load()
        for number, value in SETTINGS.items():
            self.solver.iparm[number - 1] = value

    def statistic(self, number: int) -> int:
        """One of PARDISO's outputs."""
        return int(self.solver.iparm[number - 1])

    def call(self, phase: int, right: FloatArray | None = None) -> FloatArray:
        """Run a phase; `right` is column-major and is answered by the solution."""
        right = np.zeros(1) if right is None else right
        out, error = np.zeros_like(right), ctypes.c_int32(0)
        ints, doubles = ctypes.POINTER(ctypes.c_int32), ctypes.POINTER(ctypes.c_double)

        def number(value: int) -> Any:
            return ctypes.byref(ctypes.c_int32(value))

        self.solver.libmkl.MKL_Set_Num_Threads_Local(threads())
        self.solver._mkl_pardiso(
            self.solver.pt.ctypes.data_as(ctypes.POINTER(ctypes.c_int64)),
            number(1),
            number(1),
            number(SYMMETRIC_INDEFINITE),
            number(phase),
            number(self.dofs),
            self.values.ctypes.data_as(doubles),
            self.starts.ctypes.data_as(ints),
            self.columns.ctypes.data_as(ints),
            self.solver.perm.ctypes.data_as(ints),
            number(1 if right.ndim == 1 else right.shape[1]),
            self.solver.iparm.ctypes.data_as(ints),
            number(0),
            right.ctypes.data_as(doubles),
            out.ctypes.data_as(doubles),
            ctypes.byref(error),
        )
        _refuse_error(error.value, phase, self.dofs)
        return out


def _refuse_error(error: int, phase: int, dofs: int) -> None:
    if error == ZERO_PIVOT:
        raise SingularShift("the shifted matrix is singular (PARDISO found a zero pivot)")
    if error == NO_MEMORY:
        raise TooLarge(f"factorising {dofs} degrees of freedom took more memory than there is (PARDISO)")
    if error:
        raise SolverError(f"PARDISO failed in phase {phase} with error {error}")


class Pardiso:
    """L D L' whose inertia PARDISO reports; refused when a pivot had to be perturbed, since the count then fails."""

    def __init__(self, matrix: sp.csc_array) -> None:
        handle = _Handle(matrix)
        self._handle = handle
        self._release = weakref.finalize(self, handle.call, RELEASE)
        self._release.atexit = False  # the process ends, and its memory with it
        handle.call(ANALYSE)
        needed = 1024.0 * max(handle.statistic(PEAK_KB), handle.statistic(KEPT_KB) + handle.statistic(NUMERIC_KB))
        self.foreseen_bytes = foresee(needed, handle.dofs)
        handle.call(FACTORISE)
        if handle.statistic(PERTURBED):
            raise SingularShift(f"the shifted matrix has {handle.statistic(PERTURBED)} pivot(s) of rounding size")
        self.negative = handle.statistic(NEGATIVE)
        self.memory_bytes = 1024 * (handle.statistic(KEPT_KB) + handle.statistic(NUMERIC_KB))

    def solve(self, right: FloatArray) -> FloatArray:
        """Solution of A x = right, for (n,) or (n, k)."""
        return self._handle.call(SOLVE, np.array(right, dtype=float, order="F"))

    def free(self) -> None:
        """Give the memory back; the factor cannot be used afterwards."""
        self._release()
        del self._handle
