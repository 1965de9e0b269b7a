"""Threads: independent tasks side by side with one thread each, and one BLAS thread for a while.

The factorisations release the interpreter's lock, so threads do for symmetry classes and panels what processes would. A task
that is one of several has one thread however many of them run at once: its digits do not depend on the number of workers.
"""

from __future__ import annotations

import ctypes
import os
import sys
import threading
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor, wait
from contextlib import contextmanager, suppress
from functools import lru_cache
from typing import TypeVar

import scipy.linalg  # noqa: F401  its thread pool must be loaded before the pools are looked up
from threadpoolctl import ThreadpoolController

from solvers.machine import workers

Item = TypeVar("Item")
Result = TypeVar("Result")
HEARD_S = 0.2  # longest wait before an interruption takes effect, whichever thread the signal reached
# How long a task in Python lets another wait that comes back from compiled code: the interpreter's own 5 ms, at each of
# hundreds of returns, cost two parallel symmetry classes a fifth of their gain.
WAIT_S = 5e-4
# Of glibc's malloc.h. All threads share one heap: arrays are few and large, and an arena of each thread's own keeps what it
# once held. A solve makes and drops arrays of some megabytes by the hundred: given back to the system each time, their pages
# cost a tenth of a solve when they come again. Arrays of up to 32 MiB, glibc's limit, lie on the heap, which keeps 256.
ARENA_MAX, TRIM_THRESHOLD, MMAP_THRESHOLD = -8, -1, -3
HEAP = {ARENA_MAX: 1, TRIM_THRESHOLD: 2**28, MMAP_THRESHOLD: 2**25}
# rslab has a heap of its own, mimalloc's, read when it is loaded: pages that it gave back after its own 10 ms and zeroed again
# for the next factor cost an eighth of a forced response; kept for ever, they add a fifth to the memory of a large cell. So
# they wait for that many ms: the next factor comes sooner, the next step of the work later.
OWN_HEAP = "MIMALLOC_PURGE_DELAY", "1000"


def _set_heap() -> None:
    """Set how the C library and rslab allocate memory for this process."""
    os.environ.setdefault(*OWN_HEAP)
    if sys.platform == "linux":
        with suppress(OSError, AttributeError):  # another C library than glibc
            library = ctypes.CDLL(None)
            for parameter, value in HEAP.items():
                library.mallopt(parameter, value)


_set_heap()


class Cancelled(Exception):
    """Raised in a task whose result is no longer needed."""


class _Task(threading.local):
    """Current task of a thread: one of several, or the whole computation."""

    abandoned: threading.Event | None = None


_task = _Task()


def threads() -> int:
    """Return the number of threads that a factorisation may use.

    Returns
    -------
    int
        1 within a task that is one of several, else ANTINODE_THREADS, or the number of cores.
    """
    return 1 if _task.abandoned else workers()


def raise_if_cancelled() -> None:
    """Stop a task whose command was interrupted; called before every factorisation.

    Raises
    ------
    Cancelled
        If the task is one of several that were interrupted.
    """
    if _task.abandoned and _task.abandoned.is_set():
        raise Cancelled


def parallel_map(
    function: Callable[[Item], Result], items: Iterable[Item], bytes_each: float = 0.0, room: float = float("inf")
) -> list[Result]:
    """Call the function on every item, several at once as far as threads and memory allow.

    A task within a task, or one alone, runs where it is. The first item's exception is raised, when all have ended.

    Parameters
    ----------
    function : callable
        Called once per item, with one BLAS thread if there are several items.
    items : iterable
        Independent tasks.
    bytes_each : float, optional
        Memory per item in bytes; 0 sets no bound.
    room : float, optional
        Free memory in bytes.

    Returns
    -------
    list
        Results in the order of the items.
    """
    chosen = list(items)
    if len(chosen) < 2 or _task.abandoned:
        return [function(item) for item in chosen]
    fitting = room / bytes_each if bytes_each > 0.0 else float("inf")
    count = int(min(len(chosen), workers(), fitting))
    abandoned = threading.Event()

    def alone(item: Item) -> Result:
        _task.abandoned = abandoned
        try:
            raise_if_cancelled()
            return function(item)
        finally:
            _task.abandoned = None

    if count < 2:
        with one_thread():
            return [alone(item) for item in chosen]
    with one_thread(), _short_switch_interval():
        try:
            futures = _submitted(alone, chosen, count)
            while wait(futures, timeout=HEARD_S).not_done:
                pass
        except BaseException:
            abandoned.set()
            raise
        return [future.result() for future in futures]


@contextmanager
def _short_switch_interval() -> Iterator[None]:
    """Make threads take turns more often within the block."""
    before = sys.getswitchinterval()
    sys.setswitchinterval(min(before, WAIT_S))
    try:
        yield
    finally:
        sys.setswitchinterval(before)


def _submitted(task: Callable[[Item], Result], items: list[Item], count: int) -> list[Future[Result]]:
    """Tasks for the process's one pool, at most `count` of them at work."""
    free = threading.Semaphore(count)

    def in_turn(item: Item) -> Result:
        with free:
            return task(item)

    return [_pool().submit(in_turn, item) for item in items]


@lru_cache(maxsize=1)
def _pool() -> ThreadPoolExecutor:
    return ThreadPoolExecutor(workers(), "antinode")


class _OneThread:
    """Limit on the pools of numpy and scipy while any thread needs it, since the limit is the process's."""

    def __init__(self) -> None:
        self._lock, self._holders, self._limiter = threading.Lock(), 0, None

    def hold(self) -> None:
        with self._lock:
            self._holders += 1
            if self._holders == 1:
                self._limiter = _pools().limit(limits=1)

    def release(self) -> None:
        with self._lock:
            self._holders -= 1
            if self._holders == 0 and self._limiter:
                self._limiter.restore_original_limits()


_one_thread = _OneThread()


@contextmanager
def one_thread() -> Iterator[None]:
    """Limit the linear algebra of numpy and scipy to one thread within the block: on small problems others only wait.

    Yields
    ------
    None
        The limit is the process's; it ends when no thread needs it any more.
    """
    _one_thread.hold()
    try:
        yield
    finally:
        _one_thread.release()


@lru_cache(maxsize=1)
def _pools() -> ThreadpoolController:
    """Thread pools, looked up once: that takes half as long as a wave's dense solve."""
    return ThreadpoolController()
