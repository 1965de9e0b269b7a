"""Logs of a computation: to the terminal, to nobody, or to run.mess, in the manner of Code_Aster's message file."""

from __future__ import annotations

import platform
import sys
import threading
import time
from collections import Counter
from collections.abc import Iterator
from contextlib import AbstractContextManager, contextmanager, suppress
from datetime import datetime
from pathlib import Path
from typing import Any, Protocol, TextIO

RULE = "-" * 100

DIAGNOSES = {
    "OK": "OK",
    "WARNING": "<A>_ALARM",
    "FAILED": "<F>_ERROR",
    "INTERRUPTED": "<S>_INTERRUPTED",
    "LOST": "<F>_ABNORMAL_ABORT",
}

STEP_MARK = "-- STEP : "
SAME_WARNING_LIMIT = 5


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


class RunLog:
    """The log of one case; every line is on the disk as soon as it is said.

    `warnings`, `left_out_list` and `seconds` (by step, s) keep what the record and timing.json repeat.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self.warnings: list[str] = []
        self.left_out_list: list[str] = []
        self.seconds: dict[str, float] = {}
        self._summary: Counter[str] = Counter()
        self._start = time.perf_counter()
        self._cpu_start = time.process_time()
        self._closed = False
        self._file: TextIO = path.open("w", encoding="utf-8", buffering=1)

    def __enter__(self) -> RunLog:
        return self

    def __exit__(self, *_: object) -> None:
        self._file.close()

    def banner(self, title: str, program: str, versions: dict[str, str]) -> None:
        """Head of the log: program, case, machine, versions of what computes."""
        self._say(f"{RULE}\n-- ANTINODE -- VERSION {program} -- {title}")
        self._say(f"   {datetime.now():%Y-%m-%d %H:%M:%S}, {platform.system()} {platform.machine()}")
        self._say("   " + ", ".join(f"{name} {version}" for name, version in versions.items()) + f"\n{RULE}")

    def echo(self, payload: dict[str, Any]) -> None:
        """The input with defaults, one key a line (SI)."""
        self._say("INPUT with defaults (SI)")
        for key, value in flat(payload):
            self._say(f"   {key} = {value}")
        self._say(RULE)

    def info(self, text: str, id: str = "") -> None:
        """A fact: a mesh, a count, a choice taken and why."""
        self._say(_coded("I", id, text))

    def warning(self, id: str, text: str) -> None:
        """Something that the reader must know before believing the numbers; said at most five times per id."""
        if text not in self.warnings:
            self.warnings.append(text)
        self._summary[id] += 1
        if self._summary[id] <= SAME_WARNING_LIMIT:
            self._say(_coded("A", id, text))
        if self._summary[id] == SAME_WARNING_LIMIT:
            self._say(f"   warning {id} came {SAME_WARNING_LIMIT} times: further ones are counted only")

    def error(self, id: str, text: str) -> None:
        """What ends the case."""
        self._say(_coded("F", id, text))

    def left_out(self, what: str, why: str) -> None:
        """Something that this scene does not need, and why."""
        self.left_out_list.append(f"{what}: {why}")
        self._say(_coded("I", "LEFT_OUT", f"{what}: left out, {why}"))

    @contextmanager
    def step(self, name: str) -> Iterator[None]:
        """Time a step; its seconds are added up under its name."""
        self._say(f"{STEP_MARK}{name}")
        begin = time.perf_counter()
        try:
            with memory_errors_named(name):
                yield
        finally:
            elapsed = time.perf_counter() - begin
            self.seconds[name] = self.seconds.get(name, 0.0) + elapsed
            self._say(f"   end of {name}: {elapsed:.2f} s")

    @property
    def elapsed(self) -> float:
        """Seconds since the log was opened."""
        return time.perf_counter() - self._start

    def close(self, status: str) -> None:
        """Last lines: times, warnings counted, and the diagnostic (OK, WARNING, FAILED). Once only."""
        if self._closed:
            return
        self._closed = True
        for id, count in self._summary.items():
            if count > SAME_WARNING_LIMIT:
                self._say(f"   warning {id} came {count} times in all")
        cpu = time.process_time() - self._cpu_start
        self._say(f"{RULE}\nTOTAL_JOB : cpu {cpu:.2f} s : elapsed {self.elapsed:.2f} s")
        self._say(diagnostic(status))
        self._file.close()

    def _say(self, text: str) -> None:
        with suppress(OSError):  # a full disk is reported by the store, whose files matter more
            self._file.write(text.rstrip("\n") + "\n")


@contextmanager
def memory_errors_named(doing: str = "") -> Iterator[None]:
    """Turn a MemoryError within the block into OutOfMemory, which says what was done, how much it asked, what to change."""
    try:
        yield
    except MemoryError as error:
        from solvers.errors import OutOfMemory
        from solvers.machine import memory_text

        raise OutOfMemory(memory_text(error, doing)) from error


def diagnostic(status: str) -> str:
    """The closing line of a log."""
    return f"{'-' * 60}\n--- DIAGNOSTIC JOB : {DIAGNOSES[status]}"


def close_abandoned(path: Path, status: str, text: str) -> None:
    """Close the log of a case whose process is gone; says why."""
    with suppress(OSError), path.open("a", encoding="utf-8") as file:
        file.write(f"\n{_coded('F' if status == 'LOST' else 'S', status, text)}\n{diagnostic(status)}\n")


def current_step(path: Path) -> str:
    """The step that a case is in by its log, '' when none began."""
    with suppress(OSError), path.open("rb") as file:
        file.seek(max(0, path.stat().st_size - 4096))
        tail = file.read().decode("utf-8", errors="replace")
        steps = [line[len(STEP_MARK) :] for line in tail.splitlines() if line.startswith(STEP_MARK)]
        return steps[-1] if steps else ""
    return ""


def flat(value: dict[str, Any], prefix: str = "") -> Iterator[tuple[str, Any]]:
    """What is no dictionary inside of dictionaries, by dotted keys."""
    for key, item in value.items():
        name = f"{prefix}{key}"
        if isinstance(item, dict):
            yield from flat(item, f"{name}.")
        else:
            yield name, item


def _coded(code: str, id: str, text: str) -> str:
    head = f"<{code}> <{id}>" if id else f"<{code}>"
    return f"{head} {text}"
