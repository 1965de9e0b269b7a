"""Factorisations with inertia.

scipy's SuperLU is always available; rslab is used if it is installed.
"""

from __future__ import annotations

import atexit
import hashlib
import os
import threading
from collections import deque
from collections.abc import Callable, Iterable
from concurrent.futures import Future
from dataclasses import dataclass
from queue import SimpleQueue
from typing import Any, Generic, TypeVar
from weakref import finalize

import numpy as np
import scipy.sparse as sp
from scipy.sparse.csgraph import minimum_spanning_tree
from scipy.sparse.linalg import spilu, splu

from geometry.elements import FloatArray, IntArray
from solvers import machine
from solvers.errors import SingularShift, SolverError, TooLarge
from solvers.machine import foresee, room_bytes, workers
from solvers.threads import Item, Result, one_thread, raise_if_cancelled, threads
from solvers.threads import parallel_map as in_threads

BACKWARD_ERROR = 1e-10  # of one solve; rounding times growth stays far below, garbage far above

DENSE = 3000  # degrees of freedom up to which even a full triangle is small: SuperLU orders by itself
WORTH = 0.5  # classes of equivalent degrees of freedom are ordered instead, if their number is at most this fraction
SOLVE_BYTES = 26  # measured peak per factor entry: 8 in L, 12 in U, and the buffers that grow
INERTIA_BYTES = 24  # scipy copies L and U to show U's diagonal
REORDERED_BYTES = 16  # per entry of the matrix, reordered
MATRIX_BYTES = 12  # per entry of the matrix, kept for refinement
INDEX_LIMIT = 2**31 - 1  # SuperLU counts in 32 bits: first 30 times the matrix's entries, then half as many again
FIRST_GUESS, GROWTH = 30, 1.5
SYMMETRIC = {"SymmetricMode": True}
EPSILON = float(np.finfo(float).eps)  # normwise backward error at which a solution cannot be improved

# Backward error of a substitution that lost nothing. Refined, it would gain nothing and no longer be one linear map: near an
# eigenvalue the rounding of each sweep, another one each time, is what Lanczos would find.
LOSSLESS = 4.0 * EPSILON

# backward error at which refinement may end: EPSILON times the rounding of a sum of some thousand products
REFINED = 1e-14
SWEEPS = 8  # of refinement at most: at CONTRACTION per sweep they would gain eight digits
# largest factor on the defect per sweep: below a half it proves the inertia, below this it is accepted
CONTRACTION = 0.1
PROBES = 3  # sweeps that measure the contraction: a power iteration from a random vector

Thing = TypeVar("Thing")
Other = TypeVar("Other")
_free_owners: deque[OwnerThread] = deque()
# factor over matrix, bytes: beyond, it is not a plate, and nested dissection may fill less than minimum fill
FILLED = 8.0
PATTERNS = 2  # whose analyses a factoriser keeps
ANALYSIS_BYTES = 60  # measured peak of the analysis per entry of the matrix
COPY_BYTES = 30  # bytes of it still in memory, per entry, while the factor is made; rslab's own plan leaves it out

AT_ONCE = 24  # columns that rslab solves at once: more of them take longer each, and twelve times their own memory


class SuperLU:
    """Sparse LU on the diagonal: the signs of U's diagonal count the negative eigenvalues. Source: li2005."""

    def __init__(self, matrix: sp.csc_array, symbolic: Ordering | None = None) -> None:
        known = symbolic if symbolic and symbolic.pattern == _pattern_of(matrix) else None
        self.symbolic = known or _analyse(matrix)
        self._matrix = matrix
        self._negative: int | None = None
        self.foreseen_bytes = self._foreseen()
        self._lu = self._factorised()
        self._norm = float(abs(matrix).sum(axis=0).max())
        self._exact = self._proven() <= LOSSLESS

    def _factorised(self) -> Any:
        """SuperLU's L and U. Raises SingularShift where they are not those of a symmetric elimination, TooLarge."""
        order, dofs = self.symbolic.order, self._matrix.shape[0]
        column = "NATURAL" if order is not None else "MMD_AT_PLUS_A"
        kept = self._matrix if order is None else _reordered(self._matrix, order)
        with one_thread():
            try:
                factors = splu(kept, permc_spec=column, diag_pivot_thresh=0.0, options=SYMMETRIC)
            except RuntimeError as fault:
                raise SingularShift(f"the shifted matrix is singular ({fault})") from fault
            except MemoryError as fault:
                raise TooLarge(f"factorising {dofs} degrees of freedom exceeded the available memory") from fault
        if not np.array_equal(factors.perm_r, factors.perm_c):
            raise SingularShift("SuperLU left the diagonal while pivoting, so that the inertia cannot be read")
        return factors

    def _proven(self) -> float:
        """Backward error of a solve without refinement; SingularShift where the inertia of the factors is not the matrix's.

        The factors are those of A + E, and a sweep turns a defect d into E (A + E)^-1 d. While the spectral radius of
        that map is below a half, no A + tE with 0 <= t <= 1 is singular: A + E has as many negative eigenvalues as A,
        and sweeps converge.
        """
        worst = 0.0
        defect = np.random.default_rng(0).standard_normal((self._matrix.shape[0], 1))
        for _ in range(PROBES):
            right = defect / np.linalg.norm(defect)
            solution = self._substituted(right)
            defect = right - self._matrix @ solution
            contraction = float(np.linalg.norm(defect))
            if not contraction < CONTRACTION:
                raise SingularShift(
                    f"a sweep of refinement leaves {contraction:.1e} of the defect (allowed {CONTRACTION:.0e}): "
                    "the matrix, or a leading block of it, is singular to working precision"
                )
            worst = max(worst, self._backward_error(solution, right, defect))
            if not contraction:
                break
        return worst

    def _foreseen(self) -> int:
        dofs, stored = self._matrix.shape[0], self._matrix.nnz
        if max(FIRST_GUESS * stored, GROWTH * self.symbolic.entries) > INDEX_LIMIT:
            raise TooLarge(
                f"{dofs} degrees of freedom with {stored:.2g} entries, {self.symbolic.entries:.2g} in the factor, are more "
                "than SuperLU can count: install rslab, or use a coarser mesh, a lower order, or model = superelement"
            )
        factorise = SOLVE_BYTES * self.symbolic.entries + REORDERED_BYTES * stored
        count = (SOLVE_BYTES + INERTIA_BYTES) * self.symbolic.entries
        return foresee(max(factorise, count), dofs)

    @property
    def negative(self) -> int:
        """Eigenvalues below zero."""
        if self._negative is None:
            self._negative = int((self._lu.U.diagonal() < 0.0).sum())
        return self._negative

    @property
    def memory_bytes(self) -> int:
        """Bytes kept: L in supernodes, U with indices, scipy's copies of both once the inertia was read, and the matrix."""
        bytes_per_entry = 20 if self._negative is None else 20 + INERTIA_BYTES
        return int(self._lu.nnz // 2 * bytes_per_entry + MATRIX_BYTES * self._matrix.nnz)

    def solve(self, right: FloatArray) -> FloatArray:
        """Solution of A x = right, for (n,) or (n, k), refined to a backward error of rounding. Raises SingularShift."""
        columns = right.reshape(len(right), -1)
        solution = self._substituted(columns)
        if not self._exact:
            solution = self._refined(solution, columns)
        return solution.reshape(right.shape)

    def _refined(self, solution: FloatArray, right: FloatArray) -> FloatArray:
        """Sweeps x += (LU)^-1 (b - A x) until the worst column is at rounding, or a sweep no longer halves its error."""
        before = np.inf
        for _ in range(SWEEPS + 1):
            defect = right - self._matrix @ solution
            error = self._backward_error(solution, right, defect)
            if error <= EPSILON or not error < 0.5 * before:
                break
            before = error
            solution = solution + self._substituted(defect)
        if not error <= REFINED:
            raise SingularShift(f"refinement ends at a backward error of {error:.1e}, allowed is {REFINED:.0e}")
        return solution

    def _backward_error(self, solution: FloatArray, right: FloatArray, defect: FloatArray) -> float:
        """Largest ||b - A x|| / (||A|| ||x|| + ||b||) of the columns, in the maximum norm. Source: rigal1967."""
        size = [np.abs(part).max(axis=0) for part in (solution, right, defect)]
        return float((size[2] / np.maximum(self._norm * size[0] + size[1], 1e-300)).max(initial=0.0))

    def _substituted(self, right: FloatArray) -> FloatArray:
        """(LU)^-1 right for (n, k), in the degrees of freedom's own order."""
        order = self.symbolic.order
        if order is None:
            return np.asarray(self._lu.solve(right))
        solution = np.empty(right.shape)
        solution[order] = self._lu.solve(right[order])
        return solution

    def free(self) -> None:
        """Give the memory back; the factor cannot be used afterwards."""
        del self._lu, self._matrix


class Rslab:
    """L D L' with the inertia of D's blocks of one and two; another pattern is analysed again."""

    def __init__(self, matrix: sp.csc_array, symbolic: ThreadBound[Any] | None = None) -> None:
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

    def _made(self, matrix: sp.csc_array) -> ThreadBound[Any]:
        plan = self.symbolic.use(lambda own: dict(own.memory_plan()))
        self.foreseen_bytes = foresee(plan["peak_bytes"] + COPY_BYTES * matrix.nnz, matrix.shape[0])
        self.memory_bytes = int(plan["factor_bytes"])
        try:
            return self.symbolic.make(lambda own: own.factor(matrix))
        except RuntimeError as fault:
            raise SingularShift(f"the shifted matrix is singular ({fault})") from fault

    def solve(self, right: FloatArray) -> FloatArray:
        """Solution of A x = right, for (n,) or (n, k)."""

        def solution(own: Any) -> FloatArray:
            # a copy in memory of numpy's own
            if right.ndim == 1:
                return np.array(own.solve(np.ascontiguousarray(right)))
            out = np.empty(right.shape)
            for first in range(0, right.shape[1], AT_ONCE):
                columns = slice(first, first + AT_ONCE)
                out[:, columns] = own.solve_many(np.ascontiguousarray(right[:, columns]))
            return out

        return self._factor.use(solution)

    def free(self) -> None:
        """Give the memory back; the factor cannot be used afterwards."""
        self._factor.free()
        del self._factor


Factor = Rslab | SuperLU


class Factoriser:
    """Factorises matrices of a sparsity pattern or two, sharing the symbolic analysis, and checks each factor by a solve.

    `backend`, or else the variable ANTINODE_FACTOR, names one of machine.factorisations(), whose first is taken without either.
    Raises SolverError for a name that is not available.
    """

    def __init__(self, backend: str | None = None) -> None:
        self.backend = backend or os.environ.get(machine.FACTOR) or machine.factorisations()[0]
        if self.backend not in machine.factorisations():
            raise SolverError(
                f"factorisation '{self.backend}' is not installed; use {', '.join(machine.factorisations())}"
            )
        self._symbolic: dict[int, Any] = {}  # of the patterns seen last, by their number of entries

    def __call__(self, matrix: sp.csc_array) -> Factor:
        """Factor of a symmetric matrix. Raises SingularShift when it is singular to working precision, TooLarge."""
        raise_if_cancelled()
        factor = (Rslab if self.backend == "rslab" else SuperLU)(matrix, self._symbolic.get(matrix.nnz))
        others = {entries: each for entries, each in self._symbolic.items() if entries != matrix.nnz}
        self._symbolic = dict([*others.items(), (matrix.nnz, factor.symbolic)][-PATTERNS:])
        _probe(matrix, factor)
        return factor


@dataclass(frozen=True)
class Ordering:
    """Order of elimination (n,), and the entries of L that it leads to; the order is None where SuperLU finds it.

    pattern: digest of the sparsity pattern that was analysed.
    """

    order: IntArray | None
    entries: int
    pattern: bytes


class CallingThread:
    """The calling thread itself, for a process limited to one thread."""

    def run(self, call: Callable[[], Other]) -> Other:
        """Return the call's result, or raise its exception."""
        return call()

    def submit(self, call: Callable[[], Any]) -> None:
        """Run the call now."""
        call()


class OwnerThread:
    """A thread that runs one call after another and lives as long as the process."""

    def __init__(self) -> None:
        self._calls: SimpleQueue[tuple[Callable[[], Any], Future[Any]]] = SimpleQueue()
        threading.Thread(target=self._serve, name="antinode-owner", daemon=True).start()
        # what finalizers handed over at the end of the process is freed by its own thread
        atexit.register(self.run, lambda: None)

    def run(self, call: Callable[[], Other]) -> Other:
        """Return the call's result or raise its exception; neither may hold objects of the library."""
        return self.submit(call).result()

    def submit(self, call: Callable[[], Other]) -> Future[Other]:
        """Queue the call; a finalizer may do so at any moment."""
        answer: Future[Other] = Future()
        self._calls.put((call, answer))
        return answer

    def _serve(self) -> None:
        while True:
            _answered(*self._calls.get())


class ThreadBound(Generic[Thing]):
    """Handle to an object made and used in its owner thread only, which frees it when the handle is deleted."""

    def __init__(self, make: Callable[[], Thing], owner: CallingThread | OwnerThread | None = None) -> None:
        box: list[Thing] = []
        self._box, self._owner = box, owner or (_CALLING_THREAD if workers() == 1 else _own.lease.owner)
        self._owner.run(lambda: box.append(make()))
        finalize(self, self._owner.submit, box.clear)

    def use(self, function: Callable[[Thing], Other]) -> Other:
        """Call the function on the object in its owner thread and return the result."""
        box = self._box
        return self._owner.run(lambda: function(box[0]))

    def make(self, function: Callable[[Thing], Other]) -> ThreadBound[Other]:
        """Make another object from this one, in the same owner thread."""
        box = self._box
        return ThreadBound(lambda: function(box[0]), self._owner)

    def free(self) -> None:
        """Free the object now; it cannot be used afterwards."""
        self._owner.run(self._box.clear)


_CALLING_THREAD = CallingThread()


class _Lease:
    """Owner thread of a calling thread; free for another one when that thread ends."""

    def __init__(self) -> None:
        try:
            self.owner = _free_owners.pop()
        except IndexError:
            self.owner = OwnerThread()
        finalize(self, _free_owners.append, self.owner).atexit = False


class _Own(threading.local):
    """Owner thread of each calling thread."""

    def __init__(self) -> None:
        self.lease = _Lease()


def _answered(call: Callable[[], Any], answer: Future[Any]) -> None:
    try:
        result = call()
    except BaseException as fault:  # its traceback would carry the library's objects to the caller's thread
        fault.__context__ = None
        answer.set_exception(fault.with_traceback(None))
    else:
        answer.set_result(result)


_own = _Own()


def parallel_map(function: Callable[[Item], Result], items: Iterable[Item], bytes_each: float = 0.0) -> list[Result]:
    """Call a function that factorises on every item, in as many threads as the memory allows.

    Parameters
    ----------
    function : callable
        Called with an item.
    items : iterable
        The arguments.
    bytes_each : float, optional
        Memory that one call takes, in bytes.

    Returns
    -------
    list
        The results in the order of the items.
    """
    return in_threads(function, items, bytes_each, room_bytes())


def _alike(graph: sp.csc_array) -> tuple[IntArray, IntArray]:
    """Class (n,) of each degree of freedom and sizes (m,) of the classes: of one are those coupled to the same ones.

    Columns are compared by sums of random 62-bit keys of their rows.
    """
    key = np.random.default_rng(0).integers(0, 2**62, graph.shape[0], dtype=np.uint64)
    filled = np.flatnonzero(np.diff(graph.indptr))
    sums = np.zeros(graph.shape[0], dtype=np.uint64)
    sums[filled] = np.add.reduceat(key[graph.indices], graph.indptr[filled])
    _, first, label, size = np.unique(sums, return_index=True, return_inverse=True, return_counts=True)
    by_place = np.argsort(first)  # keep the degrees of freedom's own order
    rank = np.empty_like(by_place)
    rank[by_place] = np.arange(len(by_place))
    return rank[label], size[by_place]


def _quotient(graph: sp.csc_array, label: IntArray, count: int) -> sp.csc_array:
    """Pattern (count, count), all ones, between classes (n,) of alike degrees of freedom."""
    first = np.full(count, graph.shape[0])
    np.minimum.at(first, label, np.arange(len(label)))
    part = graph[:, first]
    column = np.repeat(np.arange(count), np.diff(part.indptr))
    ones = np.ones(len(column), dtype=np.int32)
    small = sp.csc_array(sp.coo_array((ones, (label[part.indices], column)), shape=(count, count)))
    small.data[:] = 1
    return small


def _postordered(graph: sp.csc_array, place: IntArray, size: IntArray) -> tuple[IntArray, int]:
    """Turns (m,) of an elimination, reordered so that supernodes are contiguous, and the entries of L, diagonal included.

    Exact but for cancellation. Row subtrees as in davis2006, section 4.5: each adds its size at its leaves and takes it off
    where two leaves meet and above its root, so that sums over the tree's subtrees are the column counts.
    """
    column = np.repeat(np.arange(graph.shape[1]), np.diff(graph.indptr))
    row, column = place[graph.indices], place[column]
    below = row > column
    row, column = row[below], column[below]
    weight = np.empty(len(size))
    weight[place] = size
    parent = _elimination_tree(row, column, len(size))
    turn, first = _postorder(parent)
    new_parent = np.full(len(parent), -1)
    has = parent >= 0
    new_parent[turn[has]] = turn[parent[has]]
    old = np.argsort(turn)
    weight = weight[old]
    counts = _column_counts(turn[row], turn[column], new_parent, first[old], weight)
    entries = float((weight * counts - weight * (weight - 1.0) / 2.0).sum())
    return turn[place], round(entries)


def _analyse(matrix: sp.csc_array) -> Ordering:
    """Minimum degree on the graph of alike degrees of freedom, and the entries of L exactly (davis2006)."""
    count = matrix.shape[0]
    if count <= DENSE:
        return Ordering(None, count * (count + 1) // 2, _pattern_of(matrix))
    label, size = _alike(matrix)
    graph = matrix
    if len(size) > WORTH * count:
        label, size = np.arange(count), np.ones(count, dtype=np.int64)
    else:
        graph = _quotient(matrix, label, len(size))
    place, entries = _postordered(graph, _minimum_degree(graph), size)
    return Ordering(np.argsort(place[label], kind="stable"), entries, _pattern_of(matrix))


def _pattern_of(matrix: sp.csc_array) -> bytes:
    """SHA-256 of the whole sparsity pattern."""
    digest = hashlib.sha256(np.ascontiguousarray(matrix.indptr).data)
    digest.update(np.ascontiguousarray(matrix.indices).data)
    return digest.digest()


def _probe(matrix: sp.csc_array, factor: Factor) -> None:
    """One solve with a fixed right-hand side: backward error ||Ax - b|| / (max |a_ij| ||x||), which bounds the normwise."""
    right = np.cos(np.arange(matrix.shape[0], dtype=float) * 1.618)
    solution = factor.solve(right)
    largest = max(float(matrix.data.max(initial=0.0)), -float(matrix.data.min(initial=0.0)))
    norm = largest * float(np.linalg.norm(solution))
    error = float(np.linalg.norm(matrix @ solution - right)) / max(norm, 1e-300)
    if not error < BACKWARD_ERROR:
        raise SingularShift(f"the factorisation's backward error is {error:.1e}, allowed is {BACKWARD_ERROR:.0e}")


def _elimination_tree(row: IntArray, column: IntArray, count: int) -> IntArray:
    """Parent of every degree of freedom, -1 at roots.

    Vertices up to k are joined alike by the graph and by its minimum spanning tree under the weight max(i, j), and
    that is all the elimination tree asks: count - 1 edges instead of all.
    """
    weights = sp.csr_array((row + 1.0, (row, column)), shape=(count, count))
    tree = minimum_spanning_tree(weights).tocoo()
    order = np.argsort(tree.row, kind="stable")
    parent, ancestor = [-1] * count, [-1] * count
    for high, low in zip(tree.row[order].tolist(), tree.col[order].tolist(), strict=True):
        here = low
        while ancestor[here] not in (-1, high):
            ancestor[here], here = high, ancestor[here]
        if ancestor[here] == -1:
            ancestor[here] = parent[here] = high
    return np.array(parent, dtype=np.int64)


def _postorder(parent: IntArray) -> tuple[IntArray, IntArray]:
    """Turn of every vertex in a postorder, and the turn of the first vertex of its subtree."""
    count = len(parent)
    size = [1] * count
    above = parent.tolist()
    for vertex, up in enumerate(above):  # parents come after their children
        if up >= 0:
            size[up] += size[vertex]
    first, used = [0] * count, [0] * (count + 1)
    for vertex in range(count - 1, -1, -1):
        up = above[vertex]  # -1 is the slot of the roots
        start = first[up] if up >= 0 else 0
        first[vertex] = start + used[up]
        used[up] += size[vertex]
    begins = np.array(first, dtype=np.int64)
    return begins + np.array(size, dtype=np.int64) - 1, begins


def _column_counts(
    row: IntArray, column: IntArray, parent: IntArray, first: IntArray, weight: FloatArray
) -> FloatArray:
    """Weighted entries of each column of L, diagonal included, everything in postorder."""
    order = np.lexsort((column, row))
    row, column = row[order], column[order]
    before = np.where(np.diff(row, prepend=-1) == 0, np.concatenate([[-1], column[:-1]]), -1)
    leaf = first[column] > before  # nothing of the row lies in the subtree below it
    row, column, before = row[leaf], column[leaf], before[leaf]
    change = weight.copy()
    has_leaf = np.zeros(len(parent), dtype=bool)
    has_leaf[row] = True
    change[has_leaf] = 0.0  # the row's own vertex is the root of its subtree, and a leaf only when alone
    np.add.at(change, column, weight[row])
    pair = before >= 0
    np.subtract.at(change, _meeting(before[pair], column[pair], parent), weight[row[pair]])
    below_root = parent >= 0
    np.subtract.at(change, parent[below_root], weight[below_root])
    total = np.concatenate([[0.0], np.cumsum(change)])
    return np.asarray(total[1:] - total[first])


def _meeting(low: IntArray, high: IntArray, parent: IntArray) -> IntArray:
    """Lowest common ancestors of low < high in postorder: above the shallowest vertex of low ... high - 1."""
    count = len(parent)
    depth = np.zeros(count, dtype=np.int64)
    for vertex, up in zip(range(count - 1, -1, -1), parent[::-1].tolist(), strict=True):
        depth[vertex] = depth[up] + 1 if up >= 0 else 0
    level = depth * (count + 1) + parent + 1  # the smallest one carries the parent
    answer = np.empty(len(low), dtype=np.int64)
    power = np.floor(np.log2(np.maximum(high - low, 1))).astype(np.int64)
    for k in range(int(power.max(initial=0)) + 1):
        here = power == k
        span = np.minimum(level[low[here]], level[high[here] - 2**k])
        answer[here] = span % (count + 1) - 1
        level = np.minimum(level[: -(2**k)], level[2**k :]) if len(level) > 2**k else level
    return answer


def _minimum_degree(graph: sp.csc_array) -> IntArray:
    """Turn of every vertex in SuperLU's minimum-degree order, by an incomplete factorisation that drops everything."""
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


def _analysed(matrix: sp.csc_array) -> ThreadBound[Any]:
    """Ordered by minimum fill; by nested dissection, which takes three times as long, where that fills too much."""
    foresee(ANALYSIS_BYTES * matrix.nnz, matrix.shape[0])
    at_once = threads()  # of the calling thread, not of the owner
    return ThreadBound(lambda: _best(matrix, at_once))


def _best(matrix: sp.csc_array, at_once: int) -> Any:
    import rslab

    symbolic = rslab.analyze(matrix, path="ldlt", threads=at_once, ordering="amf")
    if symbolic.memory_plan()["factor_bytes"] <= FILLED * 8.0 * matrix.nnz / 2.0:
        return symbolic
    other = rslab.analyze(matrix, path="ldlt", threads=at_once, ordering="metis")
    return min(symbolic, other, key=lambda result: result.memory_plan()["factor_bytes"])
