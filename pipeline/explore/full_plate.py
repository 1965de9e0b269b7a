"""The assembled plate of a design, solved in a process of its own that can be ended at any time."""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Iterator
from concurrent.futures import CancelledError, Future
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from pipeline.explore.answer import Document, Scene, compute
from pipeline.logs import TerminalLog
from pipeline.workers import LocalWorkers, WorkerLost
from solvers.machine import workers

SHOWN = 12  # lines of the log, the last ones
Solve = Callable[[Scene, dict[str, float], Any], Document]


class FileLog(TerminalLog):
    """A log whose lines another process reads from a file."""

    verbose = True

    def __init__(self, path: Path) -> None:
        super().__init__()
        self.path = path

    def warning(self, id: str, text: str) -> None:
        """Write a line like any other."""
        self._say(f"warning {id}: {text}")

    @contextmanager
    def step(self, name: str) -> Iterator[None]:
        """Write that a step begins."""
        self._say(f"{name} ...")
        yield

    def _say(self, text: str) -> None:
        with self.path.open("a", encoding="utf-8") as file:
            file.write(" ".join(text.split()) + "\n")


class FullPlate:
    """One assembled plate at a time; `solve` must be picklable, as `compute` is."""

    def __init__(self, scene: Scene, solve: Solve = compute) -> None:
        self.scene, self.solve = scene, solve
        self._workers: LocalWorkers | None = None
        self._solved: Future[Document] | None = None
        self._folder: tempfile.TemporaryDirectory[str] | None = None
        self._lines: list[str] = []

    @property
    def running(self) -> bool:
        """Whether a plate is being solved."""
        return self._solved is not None and not self._solved.done()

    def start(self, design: dict[str, float]) -> None:
        """Begin to solve a design."""
        self._clear()
        self._folder = tempfile.TemporaryDirectory(prefix="antinode-explore-")
        self._workers = self._workers or LocalWorkers(1, workers())
        self._solved = self._workers.submit(_solved, self.solve, self.scene, design, self._file)

    def report(self) -> Document | None:
        """Whether a plate is being solved, the last lines of its log and its result; None where none was asked for."""
        solved = self._solved
        if solved is None:
            return None
        running = not solved.done()
        lines = self._read() if self._folder else self._lines
        return {"running": running, "lines": lines[-SHOWN:], "result": None if running else _result(solved)}

    def stop(self) -> None:
        """End a process that is at work; what it was at has no result."""
        if self._workers:
            self._workers.kill()
            self._workers = None
        self._clear()

    def _clear(self) -> None:
        if self._folder:
            self._lines = self._read()
            self._folder.cleanup()
            self._folder = None

    def _read(self) -> list[str]:
        file = self._file
        return file.read_text(encoding="utf-8").splitlines() if file.exists() else []

    @property
    def _file(self) -> Path:
        assert self._folder is not None
        return Path(self._folder.name) / "log"


def _result(solved: Future[Document]) -> Document:
    """What a plate's process gave, or one line of why it gave nothing."""
    try:
        return solved.result()
    except (WorkerLost, CancelledError) as fault:
        return {"why_not": str(fault) or "stopped"}
    except Exception as fault:  # a worker's traceback is read by nobody
        return {"why_not": f"{type(fault).__name__}: {' '.join(str(fault).split())}"}


def _solved(solve: Solve, scene: Scene, design: dict[str, float], file: Path) -> Document:
    from geometry.errors import GeometryError, MeshError
    from pipeline.errors import InputError
    from solvers.errors import SolverError

    try:
        return solve(scene, design, FileLog(file))
    except (InputError, SolverError, MeshError, GeometryError, MemoryError) as fault:
        return {"why_not": " ".join(str(fault).split())}
