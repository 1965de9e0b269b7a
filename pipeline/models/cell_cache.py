"""Reduced cells, families of cells and the compliance of plates under patches, kept on disk."""

from __future__ import annotations

from dataclasses import fields
from functools import lru_cache
from math import isqrt
from pathlib import Path
from typing import Any

import numpy as np

from geometry.elements import FloatArray
from pipeline.paths import RESULTS
from pipeline.records import fingerprint
from pipeline.records.cache import Cache
from solvers.fem.assembly import Scale
from solvers.superelement.cell import Cell, Expansion, Further, MeshError
from solvers.superelement.interface import Interface
from solvers.variation.cells import CellFamily, nodes_of

MAX_BYTES = 1_000_000_000  # of all cells: a sweep of six pitches makes half of it, and would meet its own no more
PARTS = {"scale": Scale, "interface": Interface, "mesh_error": MeshError, "further": Further}
PARTS |= dict.fromkeys(("touch", "skin", "bare"), Expansion)
OWN = ("reach_m", "stiffness_changes", "mass_changes", "stiffness_missed", "mass_missed")


@lru_cache(maxsize=1)
def _salt() -> str:
    return fingerprint.code_hash()[:16]


class ArrayCache:
    """A folder of arrays under the hash of what they answer and of the computing sources."""

    def __init__(self, folder: Path = RESULTS / ".cells", max_bytes: int = MAX_BYTES) -> None:
        self.folder, self._files = folder, Cache(folder, max_bytes)

    def load(self, key: str) -> dict[str, Any] | None:
        """Return the arrays kept under this key by the same code, or None."""
        return self._files.read_arrays(self._name(key))

    def keep(self, key: str, flat: dict[str, Any]) -> None:
        """Keep arrays; where the disk is full they are computed again in the next run."""
        self._files.write_arrays(self._name(key), flat)

    def _name(self, key: str) -> str:
        return f"{type(self).__name__}-{key[:32]}-{_salt()}"


class CellCache(ArrayCache):
    """Reduced cells, a file each."""

    def get(self, key: str) -> Cell | None:
        """Return the cell kept under this key by the same code, or None."""
        flat = self.load(key)
        return None if flat is None else _unpacked(flat)

    def put(self, key: str, cell: Cell) -> None:
        """Keep a cell."""
        self.keep(key, _packed(cell))


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


class MatrixCache(ArrayCache):
    """Symmetric matrices, a file each."""

    def get(self, key: str) -> FloatArray | None:
        """Return the matrix kept under this key by the same code, or None."""
        flat = self.load(key)
        if flat is None:
            return None
        upper = flat["upper"]
        size = isqrt(2 * len(upper))
        matrix = np.zeros((size, size))
        matrix[np.triu_indices(size)] = upper
        return matrix + np.triu(matrix, 1).T

    def put(self, key: str, matrix: FloatArray) -> None:
        """Keep a matrix."""
        self.keep(key, {"upper": matrix[np.triu_indices(len(matrix))]})


class ParametricCellCache(ArrayCache):
    """Families of cells, a file each."""

    def get(self, key: str) -> CellFamily | None:
        """Return the family kept under this key by the same code, or None."""
        flat = self.load(key)
        if flat is None:
            return None
        reach, stiffness, mass, *missed = (flat.pop(name) for name in OWN)
        return CellFamily(_unpacked(flat), reach, nodes_of(reach), stiffness, mass, (missed[0], missed[1]))

    def put(self, key: str, family: CellFamily) -> None:
        """Keep a family."""
        own = dict(zip(OWN, (family.reach_m, family.stiffness, family.mass, *family.missed), strict=True))
        self.keep(key, _packed(family.cell) | own)
