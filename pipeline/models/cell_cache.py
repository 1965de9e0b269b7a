"""Reduced cells, families of cells and what plates give way beneath patches, kept on disk."""

from __future__ import annotations

import contextlib
import os
import tempfile
import zipfile
from dataclasses import fields
from functools import lru_cache
from math import isqrt
from pathlib import Path
from typing import Any

import numpy as np

from geometry.elements import FloatArray
from pipeline.paths import RESULTS
from pipeline.records import fingerprint
from solvers.fem.assembly import Scale
from solvers.superelement.cell import Cell, Expansion, Further, MeshError
from solvers.superelement.interface import Interface
from solvers.variation.parametric_cell import CellFamily, nodes_of

MAX_BYTES = 1_000_000_000  # of all cells: a sweep of six pitches makes half of it, and would meet its own no more
PARTS = {"scale": Scale, "interface": Interface, "mesh_error": MeshError, "further": Further}
PARTS |= dict.fromkeys(("touch", "skin", "bare"), Expansion)
OWN = ("reach_m", "stiffness_changes", "mass_changes", "stiffness_missed", "mass_missed")


@lru_cache(maxsize=1)
def _salt() -> str:
    return fingerprint.code_hash()[:16]


class CellCache:
    """A folder of .npz files, one per cell, the longest unused ones removed; a torn or foreign file counts as absent."""

    def __init__(self, folder: Path = RESULTS / ".cells", max_bytes: int = MAX_BYTES) -> None:
        self.folder, self.max_bytes = folder, max_bytes

    def get(self, key: str) -> Cell | None:
        """Return the entry kept under this key by the same code, or None."""
        with contextlib.suppress(OSError, ValueError, KeyError, EOFError, zipfile.BadZipFile):
            return _unpacked(self.load(key))
        return None

    def put(self, key: str, cell: Cell) -> None:
        """Keep an entry; where the disk is full it is recomputed in the next run, and this run keeps its result."""
        self.keep(key, _packed(cell))

    def load(self, key: str) -> dict[str, Any]:
        """The arrays kept under a key. OSError, ValueError, EOFError or BadZipFile where there are none or a torn file."""
        with np.load(self._path(key)) as file:
            flat = {name: file[name] for name in file.files}
        os.utime(self._path(key))  # used now: the last to go
        return flat

    def keep(self, key: str, flat: dict[str, Any]) -> None:
        """Keep arrays under a key, or none of them where the disk is full."""
        with contextlib.suppress(OSError):
            self.folder.mkdir(parents=True, exist_ok=True)
            handle, name = tempfile.mkstemp(dir=self.folder, suffix=".part")
            try:
                with os.fdopen(handle, "wb") as file:
                    np.savez(file, **flat)
                Path(name).replace(self._path(key))
            finally:
                Path(name).unlink(missing_ok=True)
            self._make_room(self._path(key))

    def _make_room(self, newest: Path) -> None:
        """Remove the entries longest unused until the rest fits, never the one just kept."""
        cells = sorted(((path.stat(), path) for path in self.folder.glob("*.npz")), key=lambda pair: pair[0].st_mtime)
        total = sum(stat.st_size for stat, _ in cells)
        for stat, path in cells:
            if total <= self.max_bytes:
                return
            if path != newest:
                path.unlink(missing_ok=True)
                total -= stat.st_size

    def _path(self, key: str) -> Path:
        return self.folder / f"{key[:32]}-{_salt()}.npz"


def _packed(cell: Cell) -> dict[str, Any]:
    flat: dict[str, Any] = {}
    for field in fields(cell):
        value = getattr(cell, field.name)
        if value is None:
            continue
        if field.name in PARTS:
            inner = {f.name: getattr(value, f.name) for f in fields(value)}
            flat |= {f"{field.name}.{name}": v for name, v in inner.items() if v is not None}
        else:
            flat[field.name] = value
    return flat


def _unpacked(flat: dict[str, Any]) -> Cell:
    plain = {name: value for name, value in flat.items() if "." not in name}
    for name, kind in PARTS.items():
        inner = {key.split(".")[1]: value for key, value in flat.items() if key.startswith(f"{name}.")}
        if inner:  # a cell of tetrahedra has no coarser mesh
            plain[name] = kind(**{key: value.item() if value.ndim == 0 else value for key, value in inner.items()})
    plain["size_m"] = tuple(float(v) for v in plain["size_m"])
    plain["mesh_dof"] = int(plain["mesh_dof"])
    plain["dropped_hz"] = float(plain["dropped_hz"])
    return Cell(**plain)


class MatrixCache(CellCache):
    """A folder of .npz files, one a symmetric matrix, beside those of cells; a torn or foreign file counts as absent."""

    def get(self, key: str) -> FloatArray | None:  # type: ignore[override]
        """Return the matrix kept under this key by the same code, or None."""
        with contextlib.suppress(OSError, ValueError, KeyError, EOFError, zipfile.BadZipFile):
            upper = self.load(key)["upper"]
            size = isqrt(2 * len(upper))
            matrix = np.zeros((size, size))
            matrix[np.triu_indices(size)] = upper
            return matrix + np.triu(matrix, 1).T
        return None

    def put(self, key: str, matrix: FloatArray) -> None:  # type: ignore[override]
        """Keep a matrix; where the disk is full it is recomputed in the next run, and this run keeps its result."""
        self.keep(key, {"upper": matrix[np.triu_indices(len(matrix))]})


class ParametricCellCache(CellCache):
    """A folder of .npz files, one per family, beside those of cells; a torn or foreign file counts as absent."""

    def get(self, key: str) -> CellFamily | None:  # type: ignore[override]
        """Return the entry kept under this key by the same code, or None."""
        with contextlib.suppress(OSError, ValueError, KeyError, EOFError, TypeError, zipfile.BadZipFile):
            flat = self.load(key)
            reach, stiffness, mass, *missed = (flat.pop(name) for name in OWN)
            return CellFamily(_unpacked(flat), reach, nodes_of(reach), stiffness, mass, (missed[0], missed[1]))
        return None

    def put(self, key: str, family: CellFamily) -> None:  # type: ignore[override]
        """Keep an entry; where the disk is full it is recomputed in the next run, and this run keeps its result."""
        own = dict(zip(OWN, (family.reach_m, family.stiffness, family.mass, *family.missed), strict=True))
        self.keep(key, _packed(family.cell) | own)
