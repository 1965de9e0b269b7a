"""Disk cache of reduced cells, families of cells and the compliance of plates under patches.

Each file carries a digest of its name and its whole content, which is checked before the file is used.
"""

from __future__ import annotations

import contextlib
import hashlib
import io
import os
from collections.abc import Mapping
from dataclasses import fields, is_dataclass
from functools import lru_cache
from math import isqrt
from pathlib import Path
from typing import Any, get_args, get_origin, get_type_hints

import numpy as np

from geometry import files
from geometry.elements import FloatArray
from pipeline.paths import RESULTS
from pipeline.records import store
from solvers.superelement.cell import Cell
from solvers.variation.cells import CellFamily, nodes_of

MAX_BYTES = (
    1_000_000_000  # of all cells: a sweep of six pitches writes half of it; a smaller cache would drop cells it reuses
)
OWN = ("reach", "stiffness_changes", "mass_changes", "stiffness_missed", "mass_missed")
MARK = b"antinode cache 1\n"
SUFFIX = ".kept"
DIGEST_BYTES = hashlib.sha256().digest_size


class Cache:
    """A folder of files by name.

    A file that is incomplete, damaged, renamed or written by another program counts as absent. If the folder cannot be read
    or written, nothing is raised: absent content is computed.

    Parameters
    ----------
    folder : Path
        Folder of the files, created with the first one.
    max_bytes : int, optional
        Limit on the total size, B; beyond it the least recently used files are removed. None: no limit.
    """

    def __init__(self, folder: Path, max_bytes: int | None = None) -> None:
        self.folder, self.max_bytes = folder, max_bytes

    def read(self, name: str) -> bytes | None:
        """Return the content kept under a name, or None."""
        path = self._path(name)
        try:
            sealed = path.read_bytes()
        except OSError:
            return None
        content = memoryview(sealed)[len(MARK) + DIGEST_BYTES :]
        if sealed[: len(MARK) + DIGEST_BYTES] != _seal(name, content):
            return None
        with contextlib.suppress(OSError):
            os.utime(path)  # marks it as the most recently used
        return bytes(content)

    def write(self, name: str, content: bytes) -> None:
        """Keep a content under a name; if the folder cannot be written, it is computed again next time."""
        path = self._path(name)
        with contextlib.suppress(OSError):
            self.folder.mkdir(parents=True, exist_ok=True)
            with files.written_whole(path) as temporary:
                temporary.write_bytes(_seal(name, content) + content)
            self._make_room(path)

    def _make_room(self, newest: Path) -> None:
        """Remove the least recently used files until the rest fits, but never the newest."""
        if self.max_bytes is None:
            return
        kept = sorted(((path.stat(), path) for path in self._files()), key=lambda pair: pair[0].st_mtime)
        total = sum(stat.st_size for stat, _ in kept)
        for stat, path in kept:
            if total <= self.max_bytes:
                return
            if path != newest:
                path.unlink(missing_ok=True)
                total -= stat.st_size

    def _files(self) -> list[Path]:
        """Files of this cache, including those of earlier versions."""
        return [path for path in self.folder.iterdir() if path.suffix in (SUFFIX, ".npz")]

    def _path(self, name: str) -> Path:
        return self.folder / f"{name}{SUFFIX}"


def _seal(name: str, content: bytes | memoryview) -> bytes:
    digest = hashlib.sha256(f"{name}\n".encode())
    digest.update(content)
    return MARK + digest.digest()


@lru_cache(maxsize=1)
def _salt() -> str:
    return store.code_hash()[:16]


class ArrayCache(Cache):
    """A folder of arrays under the hash of their question and of the computing sources."""

    def __init__(self, folder: Path = RESULTS / ".cells", max_bytes: int | None = MAX_BYTES) -> None:
        super().__init__(folder, max_bytes)

    def load(self, key: str) -> dict[str, Any] | None:
        """Return the arrays kept under this key by the same code, or None."""
        content = self.read(self._name(key))
        if content is None:
            return None
        with np.load(io.BytesIO(content), allow_pickle=False) as file:
            return {name: file[name] for name in file.files}

    def keep(self, key: str, flat: Mapping[str, Any]) -> None:
        """Keep arrays; if the disk is full, they are computed again in the next run."""
        buffer = io.BytesIO()
        np.savez(buffer, allow_pickle=False, **flat)
        self.write(self._name(key), buffer.getvalue())

    def _name(self, key: str) -> str:
        return f"{type(self).__name__}-{key[:32]}-{_salt()}"


class CellCache(ArrayCache):
    """Reduced cells, one per file."""

    def get(self, key: str) -> Cell | None:
        """Return the cell kept under this key by the same code, or None."""
        flat = self.load(key)
        return None if flat is None else unpacked(Cell, flat)

    def put(self, key: str, cell: Cell) -> None:
        """Keep a cell."""
        self.keep(key, packed(cell))


def packed(value: Any, name: str = "") -> dict[str, Any]:
    """Flatten a dataclass with its nested dataclasses and tuples of them by dotted names; None gives nothing."""
    if is_dataclass(value):
        parts = {field.name: getattr(value, field.name) for field in fields(value)}
    elif isinstance(value, tuple) and value and is_dataclass(value[0]):
        parts = {str(number): part for number, part in enumerate(value)}
    else:
        return {} if value is None else {name: value}
    return {key: own for part in parts for key, own in packed(parts[part], f"{name}.{part}".lstrip(".")).items()}


def unpacked(kind: Any, flat: dict[str, Any]) -> Any:
    """Rebuild a dataclass of this kind from the result of `packed`; missing parts keep their defaults."""
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
    """Upper triangles (..., n (n + 1) / 2) of symmetric matrices (..., n, n)."""
    return matrices[..., *np.triu_indices(matrices.shape[-1])]


def symmetric(upper: FloatArray) -> FloatArray:
    """Symmetric matrices (..., n, n) of upper triangles, in double precision."""
    size = isqrt(2 * upper.shape[-1])
    rows, columns = np.triu_indices(size)
    matrices = np.empty((*upper.shape[:-1], size, size))
    matrices[..., rows, columns] = matrices[..., columns, rows] = upper
    return matrices


class MatrixCache(ArrayCache):
    """Symmetric matrices, one per file."""

    def get(self, key: str) -> FloatArray | None:
        """Return the matrix kept under this key by the same code, or None."""
        flat = self.load(key)
        return None if flat is None else symmetric(flat["upper"])

    def put(self, key: str, matrix: FloatArray) -> None:
        """Keep a matrix."""
        self.keep(key, {"upper": triangles(matrix)})


class ParametricCellCache(ArrayCache):
    """Families of cells, one per file."""

    def get(self, key: str) -> CellFamily | None:
        """Return the family kept under this key by the same code, or None."""
        flat = self.load(key)
        if flat is None:
            return None
        reach, stiffness, mass, *missed = (flat.pop(name) for name in OWN)
        return CellFamily(unpacked(Cell, flat), reach, nodes_of(reach), stiffness, mass, (missed[0], missed[1]))

    def put(self, key: str, family: CellFamily) -> None:
        """Keep a family."""
        own = dict(zip(OWN, (family.reach, family.stiffness, family.mass, *family.missed), strict=True))
        self.keep(key, packed(family.cell) | own)
