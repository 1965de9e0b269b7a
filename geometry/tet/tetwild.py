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
from collections.abc import Callable
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
    flipped = _tet_volumes(vertices, cells) < 0.0  # cells of positive volume are returned
    cells[flipped, :2] = cells[flipped, 1::-1]
    return vertices, cells


def _tet_volumes(vertices: FloatArray, cells: IntArray) -> FloatArray:
    """Signed volumes of straight tetrahedra, shape (m,)."""
    corners = vertices[cells[:, :4]]
    return np.asarray(np.linalg.det(corners[:, 1:] - corners[:, :1]) / 6.0)


def tet_quality(vertices: FloatArray, cells: IntArray) -> FloatArray:
    """Compute the mean ratio 12 (3 V)^(2/3) / sum of squared edges of straight tetrahedra.

    Parameters
    ----------
    vertices : ndarray, shape (n, 3)
        Vertices, in any unit.
    cells : ndarray, shape (m, k)
        Nodes, of which the first four are the corners.

    Returns
    -------
    ndarray, shape (m,)
        Quality: 1 for a regular tetrahedron, 0 for a flat one, negative for an inverted one.

    References
    ----------
    .. [1] liu1994 (docs/references.bib)
    """
    volumes = _tet_volumes(vertices, cells)
    corners = vertices[cells[:, :4]]
    edges = corners[:, [0, 1, 0, 0, 1, 2]] - corners[:, [1, 2, 2, 3, 3, 3]]
    squares = np.maximum((edges**2).sum(axis=(1, 2)), np.finfo(float).tiny)
    return np.asarray(np.sign(volumes) * 12.0 * np.cbrt(3.0 * np.abs(volumes)) ** 2 / squares)


# -- edge lengths ------------------------------------------------------------------------------------------------------
# Edge length as a function of place: finer near singular edges, growing linearly away from them.

GRID_NODES = 400_000  # a finer background grid costs the mesher more than it brings
BOX_TETS = np.array([[0, 1, 3, 7], [0, 3, 2, 7], [0, 2, 6, 7], [0, 6, 4, 7], [0, 4, 5, 7], [0, 5, 1, 7]])


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


def background(
    size: Callable[[FloatArray], FloatArray], low: FloatArray, high: FloatArray, spacing: float
) -> tuple[FloatArray, IntArray, FloatArray]:
    """Make a grid of tetrahedra around a box that carries edge lengths at its nodes.

    The spacing grows until the grid has about GRID_NODES nodes at most.

    Parameters
    ----------
    size : callable
        Edge length at points (n, 3), in the same unit.
    low, high : ndarray, shape (3,)
        Corners of the box.
    spacing : float
        Largest distance between grid nodes before it grows, in the same unit.

    Returns
    -------
    points : ndarray, shape (n, 3)
        Nodes of the grid.
    cells : ndarray, shape (m, 4)
        Tetrahedra.
    values : ndarray, shape (n,)
        Edge lengths at the nodes.

    Raises
    ------
    MeshError
        For an edge length that is not positive.
    """
    room = high - low
    spacing = max(spacing, float((np.maximum(room, spacing).prod() / GRID_NODES) ** (1.0 / 3.0)))
    counts = np.maximum(np.ceil(room / spacing).astype(int), 1) + 2
    lines = [
        np.linspace(a - s / (n - 2), b + s / (n - 2), n + 1) for a, b, s, n in zip(low, high, room, counts, strict=True)
    ]
    z, y, x = np.meshgrid(*lines[::-1], indexing="ij")
    points = np.column_stack([x.ravel(), y.ravel(), z.ravel()])
    values = np.asarray(size(points), dtype=float)
    if values.shape != (len(points),) or not (values > 0.0).all():
        raise MeshError("the sizing field must give one positive edge length for each point")
    nx, ny, nz = counts
    i, j, k = np.indices((nx, ny, nz))
    corner = (i + (nx + 1) * (j + (ny + 1) * k)).ravel()
    step = np.array([a + (nx + 1) * (b + (ny + 1) * c) for c in (0, 1) for b in (0, 1) for a in (0, 1)])
    cells = (corner[:, None] + step)[:, BOX_TETS].reshape(-1, 4)
    return points, cells, values


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
