"""Logs of a computation: to the terminal, discarded, or to run.mess in the style of Code_Aster's message file."""

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
LONG_S = 10.0  # a step without a terminal says that it runs


class Log(Protocol):
    """Receiver of facts, warnings, simplifications and timed steps."""

    def info(self, text: str, id: str = "") -> None:
        """Log a fact."""

    def warning(self, id: str, text: str) -> None:
        """Log a warning about the results."""

    def left_out(self, what: str, why: str) -> None:
        """Log a simplification and its reason."""

    def step(self, name: str) -> AbstractContextManager[None]:
        """Time a step."""


class TerminalLog:
    """Lines on standard error with the time since the start; none if quiet. `seconds` stores the time of each step.

    verbose: for every log of a command; simplifications are also logged.
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
        """Log a fact."""
        self._say(text)

    def warning(self, id: str, text: str) -> None:
        """Log a warning about the results, even if quiet."""
        print(f"warning {id}: {text}", file=sys.stderr)

    def left_out(self, what: str, why: str) -> None:
        """Log a simplification and its reason."""
        if self.verbose:
            self._say(f"left out {what}: {why}")

    @contextmanager
    def step(self, name: str) -> Iterator[None]:
        """Log a step and store its time; a terminal shows that it runs, elsewhere a line does once it has run long."""
        begin = time.perf_counter()
        with self._spinner(name), memory_errors_named(name):
            yield
        spent = time.perf_counter() - begin
        self.seconds[name] = self.seconds.get(name, 0.0) + spent
        self._say(f"{name}: {spent:.2f} s")

    @contextmanager
    def _spinner(self, name: str) -> Iterator[None]:
        if not self.quiet and not sys.stderr.isatty():
            late = threading.Timer(LONG_S, self._say, (f"{name} ...",))
            late.daemon = True
            late.start()
            try:
                yield
            finally:
                late.cancel()
            return
        if self.quiet or not self._spinning.acquire(blocking=False):
            yield  # during another step of this log, which already shows progress
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
    """A log that keeps warnings and discards progress, for an answer from many solves."""

    def __init__(self) -> None:
        super().__init__(quiet=True)
        self.warnings: list[tuple[str, str]] = []

    def warning(self, id: str, text: str) -> None:
        """Store the warning."""
        self.warnings.append((id, text))


class RunLog:
    """Log of one case; every line is written to disk at once.

    `warnings`, `left_out_list` and `seconds` (by step, s) are copied to the record and timing.json.
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
        """Write the head of the log: program, case, machine, versions of computing packages."""
        self._say(f"{RULE}\n-- ANTINODE -- VERSION {program} -- {title}")
        self._say(f"   {datetime.now():%Y-%m-%d %H:%M:%S}, {platform.system()} {platform.machine()}")
        self._say("   " + ", ".join(f"{name} {version}" for name, version in versions.items()) + f"\n{RULE}")

    def echo(self, payload: dict[str, Any]) -> None:
        """Write the input with defaults, one key per line (SI)."""
        self._say("INPUT with defaults (SI)")
        for key, value in flat(payload):
            self._say(f"   {key} = {value}")
        self._say(RULE)

    def info(self, text: str, id: str = "") -> None:
        """Log a fact: a mesh, a count, a choice and its reason."""
        self._say(_coded("I", id, text))

    def warning(self, id: str, text: str) -> None:
        """Log a warning about the results, at most five times per id."""
        if text not in self.warnings:
            self.warnings.append(text)
        self._summary[id] += 1
        if self._summary[id] <= SAME_WARNING_LIMIT:
            self._say(_coded("A", id, text))
        if self._summary[id] == SAME_WARNING_LIMIT:
            self._say(f"   warning {id} occurred {SAME_WARNING_LIMIT} times: further ones are only counted")

    def error(self, id: str, text: str) -> None:
        """Log the error that ends the case."""
        self._say(_coded("F", id, text))

    def left_out(self, what: str, why: str) -> None:
        """Log a simplification and its reason."""
        self.left_out_list.append(f"{what}: {why}")
        self._say(_coded("I", "LEFT_OUT", f"{what}: left out, {why}"))

    @contextmanager
    def step(self, name: str) -> Iterator[None]:
        """Time a step; its seconds are added under its name."""
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
        """Write the last lines, once: times, warning counts, and the diagnostic (OK, WARNING, FAILED)."""
        if self._closed:
            return
        self._closed = True
        for id, count in self._summary.items():
            if count > SAME_WARNING_LIMIT:
                self._say(f"   warning {id} occurred {count} times in total")
        cpu = time.process_time() - self._cpu_start
        self._say(f"{RULE}\nTOTAL_JOB : cpu {cpu:.2f} s : elapsed {self.elapsed:.2f} s")
        self._say(diagnostic(status))
        self._file.close()

    def _say(self, text: str) -> None:
        with suppress(OSError):  # the store reports a full disk, since its files matter more
            self._file.write(text.rstrip("\n") + "\n")


@contextmanager
def memory_errors_named(doing: str = "") -> Iterator[None]:
    """Turn a MemoryError in the block into OutOfMemory, which names the step, the memory requested and a remedy."""
    try:
        yield
    except MemoryError as error:
        from solvers.errors import OutOfMemory
        from solvers.machine import memory_text

        raise OutOfMemory(memory_text(error, doing)) from error


def diagnostic(status: str) -> str:
    """Return the closing line of a log."""
    return f"{'-' * 60}\n--- DIAGNOSTIC JOB : {DIAGNOSES[status]}"


def close_abandoned(path: Path, status: str, text: str) -> None:
    """Close the log of a case whose process was lost, with the reason."""
    with suppress(OSError), path.open("a", encoding="utf-8") as file:
        file.write(f"\n{_coded('F' if status == 'LOST' else 'S', status, text)}\n{diagnostic(status)}\n")


def current_step(path: Path) -> str:
    """Return the current step of a case from its log, '' if none has begun."""
    with suppress(OSError), path.open("rb") as file:
        file.seek(max(0, path.stat().st_size - 4096))
        tail = file.read().decode("utf-8", errors="replace")
        steps = [line[len(STEP_MARK) :] for line in tail.splitlines() if line.startswith(STEP_MARK)]
        return steps[-1] if steps else ""
    return ""


def flat(value: dict[str, Any], prefix: str = "") -> Iterator[tuple[str, Any]]:
    """Flatten nested dictionaries into dotted keys."""
    for key, item in value.items():
        name = f"{prefix}{key}"
        if isinstance(item, dict):
            yield from flat(item, f"{name}.")
        else:
            yield name, item


def _coded(code: str, id: str, text: str) -> str:
    head = f"<{code}> <{id}>" if id else f"<{code}>"
    return f"{head} {text}"
