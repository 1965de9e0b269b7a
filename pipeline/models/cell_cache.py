"""Reduced cells, families of cells and the compliance of plates under patches, kept on disk."""

from __future__ import annotations

from dataclasses import fields, is_dataclass
from functools import lru_cache
from math import isqrt
from pathlib import Path
from typing import Any, get_args, get_origin, get_type_hints

import numpy as np

from geometry.elements import FloatArray
from pipeline.paths import RESULTS
from pipeline.records import fingerprint
from pipeline.records.cache import Cache
from solvers.superelement.cell import Cell
from solvers.variation.cells import CellFamily, nodes_of

MAX_BYTES = 1_000_000_000  # of all cells: a sweep of six pitches makes half of it, and would meet its own no more
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
        return None if flat is None else unpacked(Cell, flat)

    def put(self, key: str, cell: Cell) -> None:
        """Keep a cell."""
        self.keep(key, packed(cell))


def packed(value: Any, name: str = "") -> dict[str, Any]:
    """What a dataclass holds, its own dataclasses and tuples of them included, by dotted names; nothing for None."""
    if is_dataclass(value):
        parts = {field.name: getattr(value, field.name) for field in fields(value)}
    elif isinstance(value, tuple) and value and is_dataclass(value[0]):
        parts = {str(number): part for number, part in enumerate(value)}
    else:
        return {} if value is None else {name: value}
    return {key: own for part in parts for key, own in packed(parts[part], f"{name}.{part}".lstrip(".")).items()}


def unpacked(kind: Any, flat: dict[str, Any]) -> Any:
    """What `packed` made of a dataclass of this kind; parts that are not there keep their defaults."""
    if "" in flat:
        value = flat[""]
        return tuple(value.tolist()) if get_origin(kind) is tuple else value.item() if value.ndim == 0 else value
    kind = next((each for each in get_args(kind) if is_dataclass(each)), kind)  # X of X | None and of tuple[X, ...]
    parts: dict[str, dict[str, Any]] = {}
    for key, own in flat.items():
        part, _, rest = key.partition(".")
        parts.setdefault(part, {})[rest] = own
    if "0" in parts:
        return tuple(unpacked(kind, parts[str(number)]) for number in range(len(parts)))
    hints = get_type_hints(kind)
    return kind(**{part: unpacked(hints[part], own) for part, own in parts.items()})


def triangles(matrices: FloatArray) -> FloatArray:
    """The upper triangles (..., n (n + 1) / 2) of symmetric matrices (..., n, n)."""
    return matrices[..., *np.triu_indices(matrices.shape[-1])]


def symmetric(upper: FloatArray) -> FloatArray:
    """The symmetric matrices (..., n, n) of upper triangles, in double precision."""
    size = isqrt(2 * upper.shape[-1])
    rows, columns = np.triu_indices(size)
    matrices = np.empty((*upper.shape[:-1], size, size))
    matrices[..., rows, columns] = matrices[..., columns, rows] = upper
    return matrices


class MatrixCache(ArrayCache):
    """Symmetric matrices, a file each."""

    def get(self, key: str) -> FloatArray | None:
        """Return the matrix kept under this key by the same code, or None."""
        flat = self.load(key)
        return None if flat is None else symmetric(flat["upper"])

    def put(self, key: str, matrix: FloatArray) -> None:
        """Keep a matrix."""
        self.keep(key, {"upper": triangles(matrix)})


class ParametricCellCache(ArrayCache):
    """Families of cells, a file each."""

    def get(self, key: str) -> CellFamily | None:
        """Return the family kept under this key by the same code, or None."""
        flat = self.load(key)
        if flat is None:
            return None
        reach, stiffness, mass, *missed = (flat.pop(name) for name in OWN)
        return CellFamily(unpacked(Cell, flat), reach, nodes_of(reach), stiffness, mass, (missed[0], missed[1]))

    def put(self, key: str, family: CellFamily) -> None:
        """Keep a family."""
        own = dict(zip(OWN, (family.reach_m, family.stiffness, family.mass, *family.missed), strict=True))
        self.keep(key, packed(family.cell) | own)
