"""Objects that one thread alone makes, uses and frees, because their library bears nothing else.

rslab 1.0 to 1.7 carry mimalloc 3.3, which may end the process where a thread that has allocated by it ends and another one
begins. A keeper is a thread that never ends; what it makes is touched by no other, not even by the garbage collector.
"""

from __future__ import annotations

import atexit
import threading
from collections import deque
from collections.abc import Callable
from concurrent.futures import Future
from queue import SimpleQueue
from typing import Any, Generic, Protocol, TypeVar
from weakref import finalize

from solvers.cores import workers

Thing = TypeVar("Thing")
Other = TypeVar("Other")


class Hands(Protocol):
    """What does calls: another thread, or the asking one."""

    def run(self, call: Callable[[], Other]) -> Other:
        """The call's result or exception."""
        ...

    def later(self, call: Callable[[], Any]) -> Any:
        """Do the call, now or soon."""
        ...


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
        atexit.register(
            self.run, _nothing
        )  # what finalizers handed over at the end of the process is freed by its own thread

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


def _nothing() -> None:
    return None


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

    def __init__(self, make: Callable[[], Thing], keeper: Hands | None = None) -> None:
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
