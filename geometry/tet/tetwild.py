"""Tetrahedra from a closed triangulation through pytetwild, in a process that can be interrupted at any time."""

from __future__ import annotations

import io
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np

from geometry.elements import FloatArray, IntArray
from geometry.errors import MeshError

ROOT = Path(__file__).resolve().parents[2]


def tetrahedralize(request: dict[str, Any], time_limit_s: float | None = None) -> tuple[FloatArray, IntArray]:
    """Vertices (n, 3) and positively oriented cells (m, 4) of the volume inside a triangulation.

    Request: vertices (n, 3), triangles (m, 3), edge (target edge length, same unit), epsilon (envelope relative to the
    bounding box diagonal), threads (0: all cores), keep_outside (the whole box instead of the inside), and for a
    sizing field bg_vertices, bg_tets, bg_values. Raises MeshError when the mesher fails or takes
    longer than time_limit_s. Source: hu2020.
    """
    buffer = io.BytesIO()
    np.savez(buffer, **request)
    try:
        tetrahedra = _run(buffer.getvalue(), time_limit_s)
    except subprocess.TimeoutExpired as fault:
        raise MeshError(f"pytetwild did not finish within {time_limit_s:g} s") from fault
    if tetrahedra.returncode != 0:
        last = (tetrahedra.stderr.decode(errors="replace").strip().splitlines() or ["no message"])[-1]
        raise MeshError(f"pytetwild failed with exit code {tetrahedra.returncode}: {last}")
    with np.load(io.BytesIO(tetrahedra.stdout)) as answer:
        vertices, cells = answer["vertices"], answer["cells"]
    if not len(cells):
        raise MeshError("pytetwild returned no tetrahedron")
    return vertices, oriented(vertices, cells)


def _run(request: bytes, time_limit_s: float | None) -> subprocess.CompletedProcess[bytes]:
    return subprocess.run(
        [sys.executable, "-m", "geometry.tet.tetwild_worker"],
        input=request,
        capture_output=True,
        timeout=time_limit_s,
        env=os.environ | {"PYTHONPATH": os.pathsep.join([str(ROOT), os.environ.get("PYTHONPATH", "")])},
    )


def oriented(vertices: FloatArray, cells: IntArray) -> IntArray:
    """The same tetrahedra with positive volume."""
    flipped = tet_volumes(vertices, cells) < 0.0
    cells = cells.copy()
    cells[flipped, :2] = cells[flipped, 1::-1]
    return cells


def tet_volumes(vertices: FloatArray, cells: IntArray) -> FloatArray:
    """Signed volumes of straight tetrahedra, shape (m,)."""
    corners = vertices[cells[:, :4]]
    return np.asarray(np.linalg.det(corners[:, 1:] - corners[:, :1]) / 6.0)


def tet_quality(vertices: FloatArray, cells: IntArray) -> FloatArray:
    """Mean ratio 12 (3 V)^(2/3) / sum of squared edges: 1 for a regular tetrahedron, 0 flat, negative inverted.

    Source: liu1994.
    """
    volumes = tet_volumes(vertices, cells)
    corners = vertices[cells[:, :4]]
    edges = corners[:, [0, 1, 0, 0, 1, 2]] - corners[:, [1, 2, 2, 3, 3, 3]]
    squares = np.maximum((edges**2).sum(axis=(1, 2)), np.finfo(float).tiny)
    return np.asarray(np.sign(volumes) * 12.0 * np.cbrt(3.0 * np.abs(volumes)) ** 2 / squares)
