"""Tetrahedra from a closed triangulation by pytetwild, in a process of its own that can be interrupted at any time."""

from __future__ import annotations

import ctypes
import importlib
import io
import os
import signal
import subprocess
import sys
import tempfile
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np

from geometry.elements import FloatArray, IntArray
from geometry.errors import MeshError

ROOT = Path(__file__).resolve().parents[2]


def tetrahedralize(request: dict[str, Any]) -> tuple[FloatArray, IntArray]:
    """Fill the volume inside a closed triangulation with tetrahedra, by pytetwild in a process of its own.

    Parameters
    ----------
    request : dict
        Arrays `vertices` (n, 3) and `triangles` (m, 3); `edge`, the target edge length in the unit of the vertices;
        `epsilon`, the envelope relative to the diagonal of the bounding box; `keep_outside`, whether to keep the whole
        box.
        A sizing field adds `bg_vertices`, `bg_tets` and `bg_values`, as from `background`.

    Returns
    -------
    vertices : ndarray, shape (n, 3)
        In the unit of the request.
    cells : ndarray, shape (m, 4)
        Tetrahedra of positive volume.

    Raises
    ------
    MeshError
        If the mesher fails.

    References
    ----------
    .. [1] hu2020 (docs/references.bib)
    """
    buffer = io.BytesIO()
    np.savez(buffer, **request)
    tetrahedra = subprocess.run(
        [sys.executable, "-m", "geometry.tet.tetwild"],
        input=buffer.getvalue(),
        capture_output=True,
        env=os.environ | {"PYTHONPATH": os.pathsep.join([str(ROOT), os.environ.get("PYTHONPATH", "")])},
    )
    if tetrahedra.returncode != 0:
        last = (tetrahedra.stderr.decode(errors="replace").strip().splitlines() or ["no message"])[-1]
        raise MeshError(f"pytetwild failed with exit code {tetrahedra.returncode}: {last}")
    with np.load(io.BytesIO(tetrahedra.stdout)) as answer:
        vertices, cells = answer["vertices"], answer["cells"]
    if not len(cells):
        raise MeshError("pytetwild returned no tetrahedra")
    flipped = tet_volumes(vertices, cells) < 0.0  # cells of positive volume are returned
    cells[flipped, :2] = cells[flipped, 1::-1]
    return vertices, cells


def tet_volumes(vertices: FloatArray, cells: IntArray) -> FloatArray:
    """Compute the signed volumes of straight tetrahedra.

    Parameters
    ----------
    vertices : ndarray, shape (n, 3)
        Vertices, in any unit.
    cells : ndarray, shape (m, k)
        Nodes, of which the first four are the corners.

    Returns
    -------
    ndarray, shape (m,)
        In the cube of that unit.
    """
    corners = vertices[cells[:, :4]]
    return np.asarray(np.linalg.det(corners[:, 1:] - corners[:, :1]) / 6.0)


# -- edge lengths ------------------------------------------------------------------------------------------------------
# Edge length as a function of place: finer near singular edges, growing linearly away from them.


@dataclass(frozen=True)
class NearSegments:
    """Edge length h(d) = min(fine_m + growth d, coarse_m), d the distance to the nearest of the segments (k, 2, 3), m."""

    segments: FloatArray
    fine_m: float
    coarse_m: float
    growth: float = 0.5

    def __call__(self, points: FloatArray) -> FloatArray:
        """Edge length at points (n, 3), m."""
        nearest = np.full(len(points), np.inf)
        for start, end in self.segments:
            along = end - start
            share = np.clip((points - start) @ along / (along @ along), 0.0, 1.0)
            nearest = np.minimum(nearest, np.linalg.norm(points - start - share[:, None] * along, axis=1))
        return np.minimum(self.fine_m + self.growth * nearest, self.coarse_m)


# -- the process -------------------------------------------------------------------------------------------------------
# Runs pytetwild in a process of its own: arrays in on standard input, arrays out on standard output (npz).
# Its C++ cannot be interrupted, may print or crash, and writes files; here none of that reaches the caller.

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
    sizes = {name: given[name] for name in ("bg_vertices", "bg_tets", "bg_values") if name in given}
    vertices, cells = pytetwild.tetrahedralize(
        given["vertices"],
        given["triangles"].astype(np.int32),
        edge_length_abs=float(given["edge"]),
        epsilon=float(given["epsilon"]),
        num_threads=0,
        disable_filtering=bool(given["keep_outside"]),
        vtk_ordering=True,
        **sizes,
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
    """End this process with its parent: by a signal on Linux, elsewhere at its broken pipe."""
    if sys.platform == "linux":
        ctypes.CDLL(None).prctl(PR_SET_PDEATHSIG, signal.SIGKILL)


if __name__ == "__main__":
    main()
