"""A second process that computes designs of the cloud beside the page's own."""

from __future__ import annotations

import pickle
import tempfile
from concurrent.futures import CancelledError
from functools import lru_cache
from pathlib import Path

from pipeline.explore.answer import Document, Explorer
from pipeline.workers import LocalWorkers, WorkerLost


class Beside:
    """The same explorer in a process of its own, started when it is first asked."""

    def __init__(self, explorer: Explorer) -> None:
        self.explorer = explorer
        self._workers: LocalWorkers | None = None
        self._folder: tempfile.TemporaryDirectory[str] | None = None

    def cloud(self, first: int, count: int) -> list[Document]:
        """As `Explorer.cloud`; by this process where the other one is lost."""
        if self._workers is None or self._folder is None:
            self._workers, self._folder = LocalWorkers(1, 1), tempfile.TemporaryDirectory(prefix="antinode-explore-")
            self._file.write_bytes(pickle.dumps(Explorer(self.explorer.scene, self.explorer.model)))
        try:
            designs: list[Document] = self._workers.submit(_cloud, self._file, first, count).result()
        except (WorkerLost, CancelledError):
            return Explorer(self.explorer.scene, self.explorer.model).cloud(first, count)  # the page's own is at work
        return designs

    def close(self) -> None:
        """End the process and take its file away."""
        if self._workers and self._folder:
            self._workers.kill()
            self._folder.cleanup()

    @property
    def _file(self) -> Path:
        assert self._folder is not None
        return Path(self._folder.name) / "explorer.pickle"


def _cloud(file: Path, first: int, count: int) -> list[Document]:
    return _explorer(file).cloud(first, count)


@lru_cache(maxsize=1)
def _explorer(file: Path) -> Explorer:
    explorer: Explorer = pickle.loads(file.read_bytes())  # written by the process that started this one
    return explorer
