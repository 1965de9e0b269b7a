"""Gmsh's MSH files, versions 2.2 and 4.1, as text or binary; a physical group is a (dimension, number) pair."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal

import numpy as np

from geometry.elements import IntArray
from geometry.errors import MeshFileError
from geometry.formats.neutral import DIMENSION, PLACES, PROGRAMS, RawMesh, order_of

VERSIONS = ("2", "2.1", "2.2", "4.1")
DIMENSIONS = ("point", "curve", "surface", "volume")
TYPES = {number: name for name, (number, _) in PROGRAMS.items()}
NOT_READ = (b"PartitionedEntities", b"Parametrizations")
NAME = re.compile(rb"\s*(\d)\s+(-?\d+)\s+\"(.*)\"\s*$")
Groups = tuple[int, ...]  # numbers of the physical groups that an element is in


def _gmsh_places(cell_type: str) -> list[list[int]]:
    """Corners, in VTK's order, that each of Gmsh's local nodes is the middle of.

    They stand in ascending order, except for faces and the last two edges of a tetrahedron.
    """
    places = [list(place) for place in PLACES[cell_type]]
    if cell_type == "tetra10":
        return [*places[:8], places[9], places[8]]
    return sorted(map(sorted, places), key=lambda place: (len(place), place)) if DIMENSION[cell_type] == 3 else places


@dataclass
class _File:
    """The content of a file, read number by number as text or as bytes, and what was read so far."""

    data: bytes
    name: str
    at: int = 0
    binary: bool = False
    byte_order: Literal["<", ">"] = "<"
    words: list[bytes] = field(default_factory=list)  # of the open section of a text
    names: dict[tuple[int, int], str] = field(default_factory=dict)
    entities: dict[tuple[int, int], Groups] = field(default_factory=dict)
    tags: IntArray = field(default_factory=lambda: np.empty(0, dtype=np.int64))
    points: Any = field(default_factory=lambda: np.empty((0, 3)))
    cells: dict[str, list[IntArray]] = field(default_factory=dict)  # nodes by number, a part at a time
    groups: dict[str, list[Groups]] = field(default_factory=dict)  # of each row

    def line(self) -> bytes:
        """The next line that is not empty; b'' at the end."""
        while self.at < len(self.data):
            end = self.data.find(b"\n", self.at)
            end = len(self.data) if end < 0 else end
            found, self.at = self.data[self.at : end].strip(), end + 1
            if found:
                return found
        return b""

    def rest_of(self, section: bytes) -> bytes:
        """Return the rest of a section and move to the line after its `$End...`."""
        begin, end = self.at, self.data.find(b"$End" + section, self.at)
        if end < 0:
            raise MeshFileError(f"{self.name}: ${section.decode(errors='replace')} has no end: the file is truncated")
        self.at = end
        self.line()
        return self.data[begin:end]

    def raw(self, kind: str | list, count: int) -> np.ndarray:
        """Read `count` numbers, or rows of them, of a numpy type."""
        row = np.dtype(kind).newbyteorder(self.byte_order)
        if count < 0 or self.at + row.itemsize * count > len(self.data):
            raise MeshFileError(f"{self.name}: {count} numbers were announced, but the file is truncated")
        found = np.frombuffer(self.data, row, count, self.at)
        self.at += row.itemsize * count
        return found

    def take(self, kind: str, count: int) -> np.ndarray:
        """Integers ("i4"), sizes ("u8") or floats ("f8") of a section of version 4."""
        if self.binary:
            found = self.raw(kind, count)
        else:
            if count < 0 or len(self.words) < count:
                raise MeshFileError(f"{self.name}: {count} numbers were announced, {len(self.words)} were found")
            words = [self.words.pop() for _ in range(count)]
            found = np.array(words, dtype=float if kind == "f8" else np.int64)
        return found if kind == "f8" else found.astype(np.int64)

    def one(self, kind: str = "i4") -> int:
        """A single integer."""
        return int(self.take(kind, 1)[0])

    def type(self, number: int) -> tuple[str, int]:
        """Name and nodes of an element by its number."""
        if number not in TYPES:
            raise MeshFileError(f"{self.name}: elements of Gmsh's type {number} are not read; must be of order 1 or 2")
        return TYPES[number], len(PLACES[TYPES[number]])

    def add(self, name: str, cells: IntArray, groups: list[Groups]) -> None:
        """Keep elements and the groups of each."""
        self.cells.setdefault(name, []).append(cells)
        self.groups.setdefault(name, []).extend(groups)


def read_msh(file: Path) -> RawMesh:
    """Read a mesh and its physical groups.

    Groups of surfaces and volumes become groups of cells, those of curves and points groups of nodes. A group without a
    name is called by dimension and number, such as "surface 12". Nodes stand in VTK's order.

    Parameters
    ----------
    file : Path
        MSH file of version 2.2 or 4.1.

    Returns
    -------
    RawMesh
        The mesh in the unit of the file.

    Raises
    ------
    MeshFileError
        For a version, an element or a section that is not read, and for a truncated file.
    """
    read = _File(file.read_bytes(), str(file))
    if read.line() != b"$MeshFormat":
        raise MeshFileError(f"{file}: not a readable mesh: must begin with $MeshFormat")
    sections = SECTIONS_4 if _format(read) == "4.1" else SECTIONS_2
    while line := read.line():
        name = line.removeprefix(b"$")
        if name in NOT_READ:
            raise MeshFileError(f"{file}: ${name.decode()} is not read: save the mesh whole, without partitions")
        if name not in sections:
            read.rest_of(name)
            continue
        try:
            if sections is SECTIONS_4 and name != b"PhysicalNames" and not read.binary:
                read.words = read.rest_of(name).split()[::-1]
            sections[name](read)
            if read.binary:
                read.rest_of(name)
        except (ValueError, OverflowError, IndexError) as fault:
            if isinstance(fault, MeshFileError):
                raise
            raise MeshFileError(f"{file}: ${name.decode()} is not readable ({fault})") from fault
    return _raw_mesh(read)


def _format(read: _File) -> str:
    words = read.line().decode(errors="replace").split()
    if len(words) != 3 or words[0] not in VERSIONS:
        said = words[0] if words else "none"
        raise MeshFileError(f"{read.name}: MSH version {said} is not read; save it as version 4.1 or 2.2")
    read.binary = words[1] == "1"
    if read.binary:
        if words[2] != "8":
            raise MeshFileError(f"{read.name}: data of {words[2]} bytes are not read; must be 8")
        read.byte_order = "<" if read.data[read.at : read.at + 4] == b"\x01\0\0\0" else ">"
        read.at += 4
    read.rest_of(b"MeshFormat")
    return words[0]


def _names(read: _File) -> None:
    for _ in range(int(read.line())):
        found = NAME.match(read.line())
        if not found:
            raise MeshFileError(f"{read.name}: $PhysicalNames: must be lines of dimension, number and name in quotes")
        read.names[int(found[1]), int(found[2])] = found[3].decode("utf-8", errors="replace")
    if not read.binary:
        read.rest_of(b"PhysicalNames")


def _entities(read: _File) -> None:
    for dimension, count in enumerate(read.take("u8", 4).tolist()):
        for _ in range(count):
            tag = read.one()
            read.take("f8", 6 if dimension else 3)
            read.entities[dimension, tag] = tuple(np.abs(read.take("i4", read.one("u8"))).tolist())
            if dimension:
                read.take("i4", read.one("u8"))


def _nodes_4(read: _File) -> None:
    tags, points = [read.tags], [read.points]
    for _ in range(int(read.take("u8", 4)[0])):
        dimension, _, parametric = read.take("i4", 3).tolist()
        count, columns = read.one("u8"), 3 + (dimension if parametric else 0)
        tags.append(read.take("u8", count))
        points.append(read.take("f8", columns * count).reshape(count, columns)[:, :3])
    read.tags, read.points = np.concatenate(tags), np.vstack(points)


def _elements_4(read: _File) -> None:
    for _ in range(int(read.take("u8", 4)[0])):
        dimension, tag, kind = read.take("i4", 3).tolist()
        (name, size), rows = read.type(kind), read.one("u8")
        cells = read.take("u8", rows * (size + 1)).reshape(rows, size + 1)[:, 1:]
        read.add(name, cells, [read.entities.get((dimension, tag), ())] * rows)


def _nodes_2(read: _File) -> None:
    count = int(read.line())
    if read.binary:
        found = read.raw([("tag", "i4"), ("at", "f8", 3)], count)
        read.tags, read.points = found["tag"].astype(np.int64), np.array(found["at"], dtype=float)
        return
    words = read.rest_of(b"Nodes").split()
    if len(words) != 4 * count:
        raise MeshFileError(f"{read.name}: $Nodes: {count} nodes were announced, {len(words)} numbers were found")
    table = np.array(words).reshape(count, 4)
    read.tags, read.points = table[:, 0].astype(np.int64), table[:, 1:].astype(float)


def _elements_2(read: _File) -> None:
    """Version 2 repeats an element for each of its groups: once, in all of them."""
    count, found = int(read.line()), 0
    members: dict[str, dict[bytes, set[int]]] = {}
    kept: dict[str, list[tuple[IntArray, set[int]]]] = {}
    for kind, tags, nodes in (_binary_rows if read.binary else _text_rows)(read, count):
        name, inside, found = read.type(kind)[0], {abs(int(tag)) for tag in tags[:1] if tag}, found + 1
        known = members.setdefault(name, {})
        key = nodes.tobytes()
        if key in known and inside and not inside <= known[key]:
            known[key] |= inside
        else:
            kept.setdefault(name, []).append((nodes, known.setdefault(key, inside)))
    if found != count:
        raise MeshFileError(f"{read.name}: $Elements: {count} elements were announced, {found} were found")
    for name, rows in kept.items():
        read.add(name, np.array([nodes for nodes, _ in rows]), [tuple(sorted(inside)) for _, inside in rows])


def _text_rows(read: _File, count: int) -> Iterator[tuple[int, IntArray, IntArray]]:
    """Type, tags and nodes of each element; a line must have as many numbers as it says."""
    for line in read.rest_of(b"Elements").splitlines():
        words = np.array(line.split(), dtype=np.int64)
        if not len(words):
            continue
        size = read.type(int(words[1]))[1] if len(words) > 2 else 0
        if len(words) < 3 or len(words) != 3 + words[2] + size:
            raise MeshFileError(f"{read.name}: $Elements: line {line[:60].decode(errors='replace')!r} is truncated")
        yield int(words[1]), words[3 : 3 + words[2]], words[3 + words[2] :]


def _binary_rows(read: _File, count: int) -> Iterator[tuple[int, IntArray, IntArray]]:
    """Type, tags and nodes of each element, from binary blocks of elements of one type."""
    while count > 0:
        kind, rows, tags = read.raw("i4", 3).tolist()
        width = 1 + tags + read.type(kind)[1]
        if rows < 1 or tags < 0:
            raise MeshFileError(f"{read.name}: $Elements: a block of {rows} elements with {tags} tags")
        for row in read.raw("i4", rows * width).reshape(rows, width).astype(np.int64):
            yield kind, row[1 : 1 + tags], row[1 + tags :]
        count -= rows


SECTIONS_2 = {b"PhysicalNames": _names, b"Nodes": _nodes_2, b"Elements": _elements_2}
SECTIONS_4 = {b"PhysicalNames": _names, b"Entities": _entities, b"Nodes": _nodes_4, b"Elements": _elements_4}


def _raw_mesh(read: _File) -> RawMesh:
    order = np.argsort(read.tags, kind="stable")
    tags = read.tags[order]
    if len(tags) > 1 and (np.diff(tags) == 0).any():
        raise MeshFileError(f"{read.name}: node {tags[:-1][np.diff(tags) == 0][0]} is given twice")
    raw, named = RawMesh(read.points, []), _group_names(read)
    for name, parts in read.cells.items():
        cells, dimension = np.vstack(parts), DIMENSION[name]
        place = np.searchsorted(tags, cells).clip(max=max(len(tags) - 1, 0))
        unknown = np.argwhere(tags[place] != cells) if len(tags) else np.argwhere(cells == cells)
        if len(unknown):
            raise MeshFileError(f"{read.name}: {name}: node {cells[tuple(unknown[0])]} is not in the file")
        cells, groups = order[place], read.groups[name]
        for group in sorted({group for inside in groups for group in inside}):
            rows = np.flatnonzero([group in inside for inside in groups])
            called = named[dimension, group]
            if dimension > 1:
                raw.cell_groups.setdefault(called, {})[len(raw.blocks)] = rows
            else:
                raw.node_groups[called] = np.union1d(raw.node_groups.get(called, rows[:0]), cells[rows])
        if dimension > 1:
            raw.blocks.append((name, cells[:, order_of(name, _gmsh_places(name))]))
    return raw


def _group_names(read: _File) -> dict[tuple[int, int], str]:
    """The name of each group that has elements; a curve's or a point's says so where a larger group has it, too."""
    used = {(DIMENSION[name], group) for name, rows in read.groups.items() for inside in rows for group in inside}
    names = {key: read.names.get(key) or f"{DIMENSIONS[key[0]]} {key[1]}" for key in used}
    taken = {name for (dimension, _), name in names.items() if dimension > 1}
    return {
        key: f"{name} ({DIMENSIONS[key[0]]})" if key[0] < 2 and name in taken else name for key, name in names.items()
    }
