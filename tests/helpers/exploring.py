"""A small explorer: a coarse mesh, few designs, a short path; and its server in a thread."""

from __future__ import annotations

import atexit
import shutil
import tempfile
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from functools import lru_cache
from pathlib import Path

import numpy as np
import pytest

from pipeline.case.model import case_from_dict
from pipeline.case.reading import read_toml
from pipeline.explore.answer import Explorer, Scene
from pipeline.explore.server import Server, serve
from pipeline.logs import WarningLog
from pipeline.models import parametric as cell_model
from pipeline.models.parametric import CellModelCache, MeshTable, Offline
from pipeline.paths import ROOT
from solvers.parametric.affine import DesignBox, FixedMesh
from solvers.superelement.interface import Interface

SMALL = ROOT / "examples" / "small.toml"
BOX = DesignBox((1.8e-3, 6e-3, 1.8e-3, 3.5e-3), (2.2e-3, 7e-3, 2.2e-3, 4.5e-3))
OFFLINE = Offline(
    BOX,
    FixedMesh(2, beside=1, along=3, layers=0),
    Interface(3, 2),
    None,
    designs=2,
    waves=2,
    intervals=4,
    workers=1,
    measures_mesh=False,
)
MEASURED = np.linspace(1e-3, 4e-3, 160).reshape(16, 10)
MESH = MeshTable(BOX, MEASURED, 1.25, 0.5 * MEASURED[::-1])  # as if it had been measured


@lru_cache
def _made(what: str) -> Path:
    """Folder in which the bases of a case, settings and box of sizes are computed once for all tests."""
    folder = tempfile.mkdtemp(prefix="antinode-bases-")
    atexit.register(shutil.rmtree, folder, ignore_errors=True)
    return Path(folder)


def small_explorer(folder: Path, *settings: str, path: Path = SMALL, offline: Offline = OFFLINE) -> Explorer:
    """The explorer of examples/small.toml or another case with --set words, its bases kept in a folder."""
    raw = read_toml(path)
    case, made = case_from_dict(raw, path, list(settings)), _made(repr((path, settings, offline)))
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(cell_model, "CellModelCache", lambda: CellModelCache(made))
        model = cell_model.cell_model(case, WarningLog(), cell_model.laid_about(case, offline))
    shutil.copytree(made, folder, dirs_exist_ok=True)
    return Explorer(Scene(case, raw, settings), replace(model, mesh=replace(MESH, box=model.cell.box)))


@contextmanager
def served(explorer: Explorer) -> Iterator[Server]:
    """Its server on a free port, ended with the test's process."""
    server, ready = Server(explorer), threading.Event()
    thread = threading.Thread(target=serve, args=(server, 0, lambda _: ready.set()), daemon=True)
    thread.start()
    assert ready.wait(20.0)
    try:
        yield server
    finally:
        server.close()  # its process would otherwise keep the interpreter from ending
