"""rslab: supernodal LDL' with Bunch-Kaufman pivots, made, used and freed by one thread alone."""

from __future__ import annotations

import atexit
import os
import threading
from collections import deque
from collections.abc import Callable
from concurrent.futures import Future
from queue import SimpleQueue
from typing import Any, Generic, TypeVar
from weakref import finalize

import numpy as np
import scipy.sparse as sp

from geometry.elements import FloatArray
from solvers.errors import SingularShift
from solvers.machine import foresee, workers
from solvers.threads import threads

# -- confinement to one thread -----------------------------------------------------------------------------------------
# Objects that one thread alone makes, uses and frees, because their library bears nothing else.
# rslab 1.0 to 1.7 carry mimalloc 3.3, which may end the process where a thread that has allocated by it ends and
# another one begins. A keeper is a thread that never ends; what it makes is touched by no other, not even by the
# garbage collector.

Thing = TypeVar("Thing")
Other = TypeVar("Other")


class Alone:
    """The asking thread itself, where the process may use no other: handing over would cost and protect nothing."""

    def run(self, call: Callable[[], Other]) -> Other:
        """The call's result or exception."""
        return call()

    def later(self, call: Callable[[], Any]) -> None:
        """Do the call now."""
        call()


class Keeper:
    """A thread that does one call after another and lives as long as the process."""

    def __init__(self) -> None:
        self._calls: SimpleQueue[tuple[Callable[[], Any], Future[Any]]] = SimpleQueue()
        threading.Thread(target=self._serve, name="antinode-keeper", daemon=True).start()
        # what finalizers handed over at the end of the process is freed by its own thread
        atexit.register(self.run, lambda: None)

    def run(self, call: Callable[[], Other]) -> Other:
        """The call's result or exception, neither of which may hold anything of the library."""
        return self.later(call).result()

    def later(self, call: Callable[[], Other]) -> Future[Other]:
        """Do the call when those before it are done; a finalizer may ask this at any moment."""
        answer: Future[Other] = Future()
        self._calls.put((call, answer))
        return answer

    def _serve(self) -> None:
        while True:
            _answered(*self._calls.get())


def _answered(call: Callable[[], Any], answer: Future[Any]) -> None:
    try:
        result = call()
    except BaseException as fault:  # its traceback would take the library's objects to the caller's thread
        fault.__context__ = None
        answer.set_exception(fault.with_traceback(None))
    else:
        answer.set_result(result)


class Kept(Generic[Thing]):
    """A handle to what `make` gives; the thing itself never leaves its keeper, which frees it when the handle goes."""

    def __init__(self, make: Callable[[], Thing], keeper: Alone | Keeper | None = None) -> None:
        box: list[Thing] = []
        self._box, self._keeper = box, keeper or (_ALONE if workers() == 1 else _own.lease.keeper)
        self._keeper.run(lambda: box.append(make()))
        finalize(self, self._keeper.later, box.clear)

    def use(self, function: Callable[[Thing], Other]) -> Other:
        """What the function tells of the thing."""
        box = self._box
        return self._keeper.run(lambda: function(box[0]))

    def make(self, function: Callable[[Thing], Other]) -> Kept[Other]:
        """What the function makes of the thing, kept beside it."""
        box = self._box
        return Kept(lambda: function(box[0]), self._keeper)

    def free(self) -> None:
        """Free the thing now; it cannot be used afterwards."""
        self._keeper.run(self._box.clear)


_ALONE = Alone()
_idle: deque[Keeper] = deque()


class _Lease:
    """A keeper as long as its thread lives; then another thread may have it."""

    def __init__(self) -> None:
        try:
            self.keeper = _idle.pop()
        except IndexError:
            self.keeper = Keeper()
        finalize(self, _idle.append, self.keeper).atexit = False


class _Own(threading.local):
    """The keeper of each thread that asks for one."""

    def __init__(self) -> None:
        self.lease = _Lease()


_own = _Own()


# -- factorisation -----------------------------------------------------------------------------------------------------
# rslab: supernodal LDL' with Bunch-Kaufman pivots.

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
            # a copy in memory of numpy's own
            return np.array(own.solve(right) if right.ndim == 1 else own.solve_many(right))

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
