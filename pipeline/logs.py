"""Logs of a computation: to a case's run.mess, to the terminal, or to nobody."""

from __future__ import annotations

import sys
import threading
import time
from collections.abc import Iterator
from contextlib import AbstractContextManager, contextmanager
from typing import Protocol


@contextmanager
def memory_errors_named(doing: str = "") -> Iterator[None]:
    """Turn a MemoryError within the block into OutOfMemory, which says what was done, how much it asked, what to change."""
    try:
        yield
    except MemoryError as error:
        from solvers.errors import OutOfMemory
        from solvers.machine import memory_text

        raise OutOfMemory(memory_text(error, doing)) from error


class Log(Protocol):
    """Receiver of facts, warnings, simplifications and timed steps."""

    def info(self, text: str, id: str = "") -> None:
        """A fact."""

    def warning(self, id: str, text: str) -> None:
        """Something to know before believing the numbers."""

    def left_out(self, what: str, why: str) -> None:
        """Something that the scene does not need."""

    def step(self, name: str) -> AbstractContextManager[None]:
        """Time a step."""


class TerminalLog:
    """Lines on standard error with the time since the start; none when quiet. `seconds` keeps each step's time.

    verbose: of every log of a command; what a scene does not need is said, too.
    """

    verbose = False

    def __init__(self, quiet: bool = False) -> None:
        self.quiet = quiet
        self.seconds: dict[str, float] = {}
        self._start = time.perf_counter()
        self._spinning = threading.Lock()

    @property
    def elapsed(self) -> float:
        """Seconds since the start."""
        return time.perf_counter() - self._start

    def info(self, text: str, id: str = "") -> None:
        """A fact."""
        self._say(text)

    def warning(self, id: str, text: str) -> None:
        """Something to know before believing the numbers; said even when quiet."""
        print(f"warning {id}: {text}", file=sys.stderr)

    def left_out(self, what: str, why: str) -> None:
        """Something that the scene does not need."""
        if self.verbose:
            self._say(f"left out {what}: {why}")

    @contextmanager
    def step(self, name: str) -> Iterator[None]:
        """Say that a step begins and keep its time; a terminal shows that it is alive."""
        begin = time.perf_counter()
        with self._spinner(name), memory_errors_named(name):
            yield
        spent = time.perf_counter() - begin
        self.seconds[name] = self.seconds.get(name, 0.0) + spent
        self._say(f"{name}: {spent:.2f} s")

    @contextmanager
    def _spinner(self, name: str) -> Iterator[None]:
        if self.quiet or not sys.stderr.isatty() or not self._spinning.acquire(blocking=False):
            yield  # beside another step of this log, which shows already that the command is alive
            return
        from rich.console import Console

        try:
            with Console(stderr=True).status(f"{name} ..."):
                yield
        finally:
            self._spinning.release()

    def _say(self, text: str) -> None:
        if not self.quiet:
            print(f"[{self.elapsed:7.2f} s] {text}", file=sys.stderr)


class WarningLog(TerminalLog):
    """A log that keeps warnings and discards progress, where many solves stand behind one answer."""

    def __init__(self) -> None:
        super().__init__(quiet=True)
        self.warnings: list[tuple[str, str]] = []

    def warning(self, id: str, text: str) -> None:
        """Kept for who asks."""
        self.warnings.append((id, text))
