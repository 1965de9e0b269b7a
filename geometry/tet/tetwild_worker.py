"""Runs pytetwild in a process of its own: arrays in on standard input, arrays out on standard output (npz).

Its C++ cannot be interrupted, may print or crash, and writes files; here none of that reaches the caller.
"""

from __future__ import annotations

import ctypes
import importlib
import io
import os
import signal
import sys
import tempfile
from contextlib import suppress
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np

PR_SET_PDEATHSIG = 1


def main() -> None:
    """Read the request, mesh, write vertices and cells."""
    _die_with_parent()
    _leave_no_file()
    answer = os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)
    with np.load(io.BytesIO(sys.stdin.buffer.read())) as request:
        given = {name: request[name] for name in request.files}
    pytetwild = _mesher()
    background = {name: given[name] for name in ("bg_vertices", "bg_tets", "bg_values") if name in given}
    vertices, cells = pytetwild.tetrahedralize(
        given["vertices"],
        given["triangles"].astype(np.int32),
        edge_length_abs=float(given["edge"]),
        epsilon=float(given["epsilon"]),
        num_threads=int(given["threads"]),
        disable_filtering=bool(given["keep_outside"]),
        vtk_ordering=True,
        **background,
    )
    np.savez(answer, vertices=vertices, cells=np.asarray(cells, dtype=np.int64))
    answer.close()


def _mesher() -> Any:
    """pytetwild without pyvista, which takes most of its import and is there only to add a method to pyvista's meshes."""
    sys.modules["pyvista"] = ModuleType("pyvista")
    try:
        return importlib.import_module("pytetwild")
    except (AttributeError, ImportError):  # a version that does need it
        del sys.modules["pyvista"]
        return importlib.import_module("pytetwild")


def _leave_no_file() -> None:
    """The mesher writes its surface into the working directory: give it one that is gone at once."""
    folder = tempfile.mkdtemp(prefix="antinode-tetwild-")
    os.chdir(folder)
    with suppress(OSError):  # systems that keep a directory in use
        Path(folder).rmdir()


def _die_with_parent() -> None:
    """On Linux a killed parent takes this process along; elsewhere it ends at its broken pipe."""
    if sys.platform == "linux":
        ctypes.CDLL(None).prctl(PR_SET_PDEATHSIG, signal.SIGKILL)


if __name__ == "__main__":
    main()
