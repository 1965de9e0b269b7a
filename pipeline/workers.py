"""Worker processes whose loss affects a single case: one process computes one case at a time.

concurrent.futures.ProcessPoolExecutor ends every worker when one dies and does not say which; this executor fails one
future and starts a new process. Workers end with their parent. They never run the caller's script again, so that a
script without `if __name__ == "__main__"` may start them.
"""

from __future__ import annotations

import ctypes
import multiprocessing
import os
import queue
import signal
import sys
import threading
from collections.abc import Callable, Iterator
from concurrent.futures import Executor, Future
from contextlib import contextmanager, suppress
from multiprocessing import resource_tracker
from multiprocessing.connection import Connection, wait
from typing import Any

from solvers.machine import LIMIT

THREADED = ("OMP", "OPENBLAS", "MKL", "BLIS", "NUMEXPR", "RAYON")
PR_SET_PDEATHSIG = 1
# Sent to a whole process group by terminals, `timeout` and service managers; the main process ends its workers itself.
MAIN_ALONE = {signal.SIGINT, signal.SIGTERM, signal.SIGHUP}
STARTING = threading.Lock()  # one process at a time: starting one inspects the caller's script


class WorkerLost(Exception):
    """A worker process ended during a case; the message says how."""


class LocalWorkers(Executor):
    """Executor of `count` processes with `threads` BLAS threads each. A task that kills its process fails alone."""

    def __init__(self, count: int, threads: int) -> None:
        self._threads = threads
        self._tasks: queue.SimpleQueue[tuple[Future[Any], Any] | None] = queue.SimpleQueue()
        self._processes: dict[int, multiprocessing.process.BaseProcess] = {}
        self._stopping = False
        self._keepers = [threading.Thread(target=self._keep, args=(slot,), daemon=True) for slot in range(count)]
        for keeper in self._keepers:
            keeper.start()

    def submit(self, function: Callable[..., Any], /, *args: Any, **kwargs: Any) -> Future[Any]:
        """Queue a picklable call."""
        if self._stopping:
            raise RuntimeError("these workers have been shut down")
        future: Future[Any] = Future()
        self._tasks.put((future, (function, args, kwargs)))
        return future

    def shutdown(self, wait: bool = True, *, cancel_futures: bool = False) -> None:
        """Finish the queue and end the processes."""
        self._stopping = True
        for _ in self._keepers:
            self._tasks.put(None)
        if wait:
            for keeper in self._keepers:
                keeper.join()

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        """Finish the queue, or stop at once after an error or an interruption."""
        if kind is None:
            self.shutdown()
        else:
            self.kill()

    def kill(self) -> None:
        """End the processes now; running tasks fail with WorkerLost, waiting ones are cancelled."""
        self._stopping = True
        with suppress(queue.Empty):
            while True:
                item = self._tasks.get_nowait()
                if item:
                    item[0].cancel()
        for process in list(self._processes.values()):
            process.kill()
        self.shutdown(wait=True)

    def _keep(self, slot: int) -> None:
        """Run one slot: a process, restarted after its death, fed from the queue."""
        resource_tracker.ensure_running()  # starting it unblocks SIGINT in the starting thread
        signal.pthread_sigmask(
            signal.SIG_BLOCK, MAIN_ALONE
        )  # inherited by workers: the main process handles these signals
        connection: Connection | None = None
        while (item := self._tasks.get()) is not None:
            future, call = item
            if not future.set_running_or_notify_cancel():
                continue
            try:
                if connection is None or not self._processes[slot].is_alive():
                    connection = self._start(slot)
                future.set_result(_ask(connection, self._processes[slot], call))
            except BaseException as error:
                future.set_exception(error)
        if connection:
            connection.close()  # the worker reads the end of its input and exits
            self._processes[slot].join()

    def _start(self, slot: int) -> Connection:
        context = multiprocessing.get_context("spawn")  # no lock, thread or memory of ours is inherited
        ours, theirs = context.Pipe()
        process = context.Process(target=_serve, args=(theirs, self._threads), daemon=False)
        with STARTING, _caller_hidden():
            process.start()
        theirs.close()
        self._processes[slot] = process
        return ours


@contextmanager
def _caller_hidden() -> Iterator[None]:
    """Hide the running script from a starting process, which would otherwise run it as its main module."""
    main = sys.modules["__main__"]
    kept = {name: getattr(main, name) for name in ("__file__", "__spec__") if hasattr(main, name)}
    for name in kept:
        setattr(main, name, None)
    try:
        yield
    finally:
        vars(main).update(kept)


def _ask(connection: Connection, process: multiprocessing.process.BaseProcess, call: Any) -> Any:
    with suppress(BrokenPipeError, ConnectionResetError):
        connection.send(call)
    with suppress(EOFError, ConnectionResetError):
        wait([connection, process.sentinel])
        if connection.poll():
            error, value = connection.recv()
            if error is not None:
                raise error
            return value
    process.join()
    raise WorkerLost(f"the worker process was lost: {_how_it_ended(process.exitcode)}")


def _how_it_ended(code: int | None) -> str:
    if code is None or code >= 0:
        return f"it exited with code {code}"
    hints = {
        signal.SIGKILL: " (out of memory, or killed)",
        signal.SIGSEGV: " (a fault in a compiled library)",
    }
    name = next((known for known in signal.Signals if known == -code), None)
    return f"ended by {name.name}{hints.get(name, '')}" if name else f"ended by signal {-code}"


def _serve(connection: Connection, threads: int) -> None:
    """Run the main loop of a worker."""
    _die_with_parent()
    limit_threads(threads)
    while True:
        try:
            function, args, kwargs = connection.recv()
        except (EOFError, OSError):
            return
        except BaseException as error:  # the module of the function cannot be imported
            connection.send((RuntimeError(f"the worker cannot load the task: {error}"), None))
            continue
        answer: tuple[BaseException | None, Any]
        try:
            answer = (None, function(*args, **kwargs))
        except BaseException as error:
            answer = (error, None)
        _answer(connection, answer)


def _answer(connection: Connection, answer: tuple[BaseException | None, Any]) -> None:
    try:
        connection.send(answer)
    except (TypeError, ValueError, AttributeError) as error:  # unpicklable results
        connection.send((RuntimeError(f"the worker's answer cannot be sent: {error}"), None))


def _die_with_parent() -> None:
    parent = multiprocessing.parent_process()
    if sys.platform == "linux":  # the kernel's mechanism also works during a long compiled call
        with suppress(OSError, AttributeError):
            ctypes.CDLL(None).prctl(PR_SET_PDEATHSIG, signal.SIGKILL)
    if parent is None:
        return

    def watch() -> None:
        parent.join()
        os._exit(1)

    threading.Thread(target=watch, daemon=True).start()


def limit_threads(threads: int) -> None:
    """Limit the threads of BLAS and similar libraries in this process, already loaded or not."""
    for name in THREADED:
        os.environ[f"{name}_NUM_THREADS"] = str(threads)
    os.environ[LIMIT] = str(min(threads, int(os.environ.get(LIMIT) or threads)))
    from threadpoolctl import threadpool_limits

    threadpool_limits(threads)


def default_jobs(cases: int) -> int:
    """Return the default number of worker processes: one per core, at most one per case of the study."""
    cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    return max(1, min(cores, cases))
