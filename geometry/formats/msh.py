"""Gmsh's MSH files, versions 2.2 and 4.1, as text or binary; a physical group is a (dimension, number) pair."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from geometry.elements import FloatArray, IntArray
from geometry.errors import MeshFileError
from geometry.formats.neutral import PLACES, Places, RawMesh, family

VERSIONS = ("2", "2.1", "2.2", "4.1")
DIMENSIONS = ("point", "curve", "surface", "volume")
EDGES_OF_HEX = ((0, 1), (0, 3), (0, 4), (1, 2), (1, 5), (2, 3), (2, 6), (3, 7), (4, 5), (4, 7), (5, 6), (6, 7))
FACES_OF_HEX = ((0, 3, 2, 1), (0, 1, 5, 4), (0, 4, 7, 3), (1, 2, 6, 5), (2, 3, 7, 6), (4, 5, 6, 7))
EDGES_OF_WEDGE = ((0, 1), (0, 2), (0, 3), (1, 2), (1, 4), (2, 5), (3, 4), (3, 5), (4, 5))
EDGES_OF_PYRAMID = ((0, 1), (0, 3), (0, 4), (1, 2), (1, 4), (2, 3), (2, 4), (3, 4))
# Gmsh's number of an element -> its cell type, its dimension and its number of nodes
TYPES = {
    15: ("vertex", 0, 1), 1: ("line", 1, 2), 8: ("line3", 1, 3), 2: ("triangle", 2, 3), 9: ("triangle6", 2, 6),
    3: ("quad", 2, 4), 10: ("quad9", 2, 9), 16: ("quad8", 2, 8), 4: ("tetra", 3, 4), 11: ("tetra10", 3, 10),
    5: ("hexahedron", 3, 8), 17: ("hexahedron20", 3, 20), 12: ("hexahedron27", 3, 27), 6: ("wedge", 3, 6),
    18: ("wedge15", 3, 15), 13: ("wedge18", 3, 18), 7: ("pyramid", 3, 5), 19: ("pyramid13", 3, 13),
    14: ("pyramid14", 3, 14),
}  # fmt: skip
# corners between which Gmsh puts each further node, where VTK's order is another one
MIDDLES: dict[str, Places] = {
    "tetra10": ((0, 1), (1, 2), (2, 0), (0, 3), (2, 3), (1, 3)),
    "hexahedron20": EDGES_OF_HEX,
    "hexahedron27": (*EDGES_OF_HEX, *FACES_OF_HEX, tuple(range(8))),
    "wedge15": EDGES_OF_WEDGE,
    "wedge18": (*EDGES_OF_WEDGE, (0, 1, 4, 3), (0, 3, 5, 2), (1, 2, 5, 4)),
    "pyramid13": EDGES_OF_PYRAMID,
    "pyramid14": (*EDGES_OF_PYRAMID, (0, 1, 2, 3)),
}
LIST = re.compile(rb"\s*(\d)\s+(-?\d+)\s+\"(.*)\"\s*$")


@dataclass
class _File:
    """What was read so far: nodes by number, elements by type with the groups of each, names of groups."""

    names: dict[tuple[int, int], str] = field(default_factory=dict)
    entities: dict[tuple[int, int], list[int]] = field(default_factory=dict)  # entity -> its physical groups
    tags: IntArray = field(default_factory=lambda: np.empty(0, dtype=np.int64))
    points: FloatArray = field(default_factory=lambda: np.empty((0, 3)))
    cells: dict[str, list[IntArray]] = field(default_factory=dict)  # nodes by number, a part at a time
    groups: dict[str, list[list[tuple[int, ...]]]] = field(default_factory=dict)  # of each row, part by part


class _Cursor:
    """The content of a file, read number by number as text or as bytes."""

    def __init__(self, data: bytes, name: str) -> None:
        self.data, self.at, self.name = data, 0, name
        self.binary, self.order, self.tokens = False, "<", iter(())

    def line(self) -> bytes:
        """The next line that is not empty; b'' at the end."""
        while self.at < len(self.data):
            end = self.data.find(b"\n", self.at)
            end = len(self.data) if end < 0 else end
            found, self.at = self.data[self.at : end].strip(), end + 1
            if found:
                return found
        return b""

    def skip_to_end_of(self, section: bytes) -> None:
        """Go on behind `$End...` of a section."""
        end = self.data.find(b"$End" + section, self.at)
        if end < 0:
            raise MeshFileError(f"{self.name}: ${section.decode(errors='replace')} has no end: the file is truncated")
        self.at = end
        self.line()

    def text(self, section: bytes) -> list[bytes]:
        """The words of a section up to its end."""
        begin = self.at
        self.skip_to_end_of(section)
        return self.data[begin : self.data.rfind(b"$End" + section, begin, self.at)].split()

    def raw(self, kind: str, count: int) -> np.ndarray:
        """So many numbers of a numpy type."""
        size = np.dtype(kind).itemsize * count
        if count < 0 or self.at + size > len(self.data):
            raise MeshFileError(f"{self.name}: {count} numbers were announced, the file is truncated")
        found = np.frombuffer(self.data, self.order + kind, count, self.at)
        self.at += size
        return found


class _Numbers:
    """Numbers of one section: the words of a text, or bytes."""

    def __init__(self, cursor: _Cursor, section: bytes) -> None:
        self.cursor = cursor
        self.words = [] if cursor.binary else cursor.text(section)
        self.place = 0

    def _words(self, count: int) -> list[bytes]:
        found = self.words[self.place : self.place + count]
        if count < 0 or len(found) < count:
            raise MeshFileError(f"{self.cursor.name}: {count} numbers were announced, {len(found)} are there")
        self.place += count
        return found

    def take(self, kind: str, count: int) -> np.ndarray:
        """Integers ("i4"), sizes ("u8") or floats ("f8")."""
        if self.cursor.binary:
            found = self.cursor.raw(kind, count)
        else:
            found = np.array(self._words(count), dtype=float if kind == "f8" else np.int64)
        return found if kind == "f8" else found.astype(np.int64)

    def one(self, kind: str = "i4") -> int:
        """A single integer."""
        return int(self.take(kind, 1)[0])


def read_msh(file: Path) -> RawMesh:
    """Read a mesh and its physical groups.

    Groups of surfaces and volumes become groups of cells, those of curves and points groups of nodes. A group without a name is
    called by dimension and number, such as "surface 12". Nodes stand in VTK's order.

    Raises
    ------
    MeshFileError
        For a version, an element or a section that is not read, and for a file that is torn.
    """
    cursor, read = _Cursor(file.read_bytes(), str(file)), _File()
    if cursor.line() != b"$MeshFormat":
        raise MeshFileError(f"{file}: not a readable mesh: must begin with $MeshFormat")
    version = _format(cursor)
    sections = _sections(version)
    while line := cursor.line():
        name = line.removeprefix(b"$")
        if name in (b"PartitionedEntities", b"Parametrizations"):
            raise MeshFileError(f"{file}: ${name.decode()} is not read: save the mesh whole, without partitions")
        if name not in sections:
            cursor.skip_to_end_of(name)
            continue
        try:
            sections[name](cursor, read)
        except (ValueError, OverflowError, IndexError) as fault:
            if isinstance(fault, MeshFileError):
                raise
            raise MeshFileError(f"{file}: ${name.decode()} is not readable ({fault})") from fault
    return _raw_mesh(read, str(file))


def _format(cursor: _Cursor) -> str:
    words = cursor.line().decode(errors="replace").split()
    if len(words) != 3 or words[0] not in VERSIONS:
        said = words[0] if words else "none"
        raise MeshFileError(f"{cursor.name}: MSH version {said} is not read; save it as version 4.1 or 2.2")
    cursor.binary = words[1] == "1"
    if cursor.binary:
        if words[2] != "8":
            raise MeshFileError(f"{cursor.name}: data of {words[2]} bytes are not read; must be 8")
        cursor.order = "<" if cursor.data[cursor.at : cursor.at + 4] == b"\x01\0\0\0" else ">"
        cursor.at += 4
    cursor.skip_to_end_of(b"MeshFormat")
    return words[0]


def _sections(version: str) -> dict[bytes, Callable[[_Cursor, _File], None]]:
    if version == "4.1":
        return {b"PhysicalNames": _names, b"Entities": _entities, b"Nodes": _nodes_4, b"Elements": _elements_4}
    return {b"PhysicalNames": _names, b"Nodes": _nodes_2, b"Elements": _elements_2}


def _names(cursor: _Cursor, read: _File) -> None:
    for _ in range(int(cursor.line())):
        found = LIST.match(cursor.line())
        if not found:
            raise MeshFileError(f"{cursor.name}: $PhysicalNames: must be lines of dimension, number and name in quotes")
        dimension, number, name = int(found[1]), int(found[2]), found[3].decode("utf-8", errors="replace")
        read.names[dimension, number] = name
    cursor.skip_to_end_of(b"PhysicalNames")


def _entities(cursor: _Cursor, read: _File) -> None:
    numbers = _Numbers(cursor, b"Entities")
    for dimension, count in enumerate(numbers.take("u8", 4).tolist()):
        for _ in range(count):
            tag = numbers.one()
            numbers.take("f8", 6 if dimension else 3)
            read.entities[dimension, tag] = numbers.take("i4", numbers.one("u8")).tolist()
            if dimension:
                numbers.take("i4", numbers.one("u8"))
    _end(cursor, b"Entities")


def _nodes_4(cursor: _Cursor, read: _File) -> None:
    numbers = _Numbers(cursor, b"Nodes")
    tags, points = [read.tags], [read.points]
    for _ in range(int(numbers.take("u8", 4)[0])):
        dimension, _, parametric = numbers.take("i4", 3).tolist()
        count, columns = numbers.one("u8"), 3 + (dimension if parametric else 0)
        tags.append(numbers.take("u8", count))
        points.append(numbers.take("f8", columns * count).reshape(count, columns)[:, :3])
    read.tags, read.points = np.concatenate(tags), np.vstack(points)
    _end(cursor, b"Nodes")


def _elements_4(cursor: _Cursor, read: _File) -> None:
    numbers = _Numbers(cursor, b"Elements")
    for _ in range(int(numbers.take("u8", 4)[0])):
        dimension, tag, kind = numbers.take("i4", 3).tolist()
        name, _, size = _type(kind, cursor.name)
        rows = numbers.one("u8")
        cells = numbers.take("u8", rows * (size + 1)).reshape(rows, size + 1)[:, 1:]
        inside = tuple(abs(group) for group in read.entities.get((dimension, tag), ()))
        _add(read, name, cells, [inside] * rows)
    _end(cursor, b"Elements")


def _nodes_2(cursor: _Cursor, read: _File) -> None:
    count = int(cursor.line())
    if cursor.binary:
        row = np.dtype([("tag", cursor.order + "i4"), ("at", cursor.order + "f8", 3)])
        found = _rows(cursor, row, count)
        read.tags, read.points = found["tag"].astype(np.int64), np.array(found["at"], dtype=float)
        return _end(cursor, b"Nodes")
    words = cursor.text(b"Nodes")
    if len(words) != 4 * count:
        raise MeshFileError(f"{cursor.name}: $Nodes: {count} nodes were announced, {len(words)} numbers are there")
    table = np.array(words).reshape(count, 4)
    read.tags, read.points = table[:, 0].astype(np.int64), table[:, 1:].astype(float)
    return None


def _elements_2(cursor: _Cursor, read: _File) -> None:
    count = int(cursor.line())
    by_type: dict[str, tuple[list[IntArray], list[tuple[int, ...]]]] = {}
    found = 0
    for kind, tags, nodes in _rows_2(cursor, count):
        name = _type(kind, cursor.name)[0]
        cells, groups = by_type.setdefault(name, ([], []))
        cells.append(nodes)
        groups.append((abs(int(tags[0])),) if len(tags) and tags[0] else ())
        found += 1
    if found != count:
        raise MeshFileError(f"{cursor.name}: $Elements: {count} elements were announced, {found} are there")
    for name, (cells, groups) in by_type.items():
        _add(read, name, *_once(np.array(cells, dtype=np.int64), groups))


def _rows_2(cursor: _Cursor, count: int) -> Iterator[tuple[int, IntArray, IntArray]]:
    """Type, tags and nodes of each element; a text's line must have as many numbers as it says."""
    if cursor.binary:
        yield from _binary_rows_2(cursor, count)
        return
    begin = cursor.at
    cursor.skip_to_end_of(b"Elements")
    for line in cursor.data[begin : cursor.data.rfind(b"$EndElements", begin, cursor.at)].splitlines():
        words = np.array(line.split(), dtype=np.int64)
        if not len(words):
            continue
        size = _type(int(words[1]), cursor.name)[2] if len(words) > 2 else 0
        if len(words) < 3 or len(words) != 3 + words[2] + size:
            raise MeshFileError(f"{cursor.name}: $Elements: line {line[:60].decode(errors='replace')!r} is torn")
        yield int(words[1]), words[3 : 3 + words[2]], words[3 + words[2] :]


def _binary_rows_2(cursor: _Cursor, count: int) -> Iterator[tuple[int, IntArray, IntArray]]:
    left = count
    while left > 0:
        kind, rows, tags = cursor.raw("i4", 3).tolist()
        width = 1 + tags + _type(kind, cursor.name)[2]
        if rows < 1 or tags < 0:
            raise MeshFileError(f"{cursor.name}: $Elements: a block of {rows} elements with {tags} tags")
        for row in cursor.raw("i4", rows * width).reshape(rows, width).astype(np.int64):
            yield kind, row[1 : 1 + tags], row[1 + tags :]
        left -= rows
    _end(cursor, b"Elements")


def _rows(cursor: _Cursor, row: np.dtype, count: int) -> np.ndarray:
    if count < 0 or cursor.at + count * row.itemsize > len(cursor.data):
        raise MeshFileError(f"{cursor.name}: {count} nodes were announced, the file is truncated")
    found = np.frombuffer(cursor.data, row, count, cursor.at)
    cursor.at += count * row.itemsize
    return found


def _once(cells: IntArray, groups: list[tuple[int, ...]]) -> tuple[IntArray, list[tuple[int, ...]]]:
    """Version 2 repeats an element for each of its groups: once, in all of them."""
    members: dict[bytes, set[int]] = {}
    kept: list[int] = []
    for row, (cell, inside) in enumerate(zip(cells, groups, strict=True)):
        key = cell.tobytes()
        if key in members and inside and not set(inside) <= members[key]:
            members[key] |= set(inside)
        else:
            members.setdefault(key, set(inside))
            kept.append(row)
    return cells[kept], [tuple(sorted(members[cells[row].tobytes()])) for row in kept]


def _end(cursor: _Cursor, section: bytes) -> None:
    if cursor.binary:
        cursor.skip_to_end_of(section)


def _type(kind: int, file: str) -> tuple[str, int, int]:
    if kind not in TYPES:
        raise MeshFileError(f"{file}: elements of Gmsh's type {kind} are not read; must be of order 1 or 2")
    return TYPES[kind]


def _add(read: _File, name: str, cells: IntArray, groups: list[tuple[int, ...]]) -> None:
    read.cells.setdefault(name, []).append(cells)
    read.groups.setdefault(name, []).append(groups)


def _raw_mesh(read: _File, file: str) -> RawMesh:
    order = np.argsort(read.tags, kind="stable")
    tags = read.tags[order]
    if len(tags) > 1 and (np.diff(tags) == 0).any():
        raise MeshFileError(f"{file}: node {tags[:-1][np.diff(tags) == 0][0]} is given twice")
    blocks: list[tuple[str, IntArray]] = []
    cell_groups: dict[str, dict[int, IntArray]] = {}
    node_groups: dict[str, IntArray] = {}
    dimensions = {name: dimension for name, dimension, _ in TYPES.values()}
    named = _group_names(read, dimensions)
    for name, parts in read.cells.items():
        cells = _numbered(np.vstack(parts), tags, order, name, file)
        inside = [groups for part in read.groups[name] for groups in part]
        for group in sorted({group for groups in inside for group in groups}):
            rows = np.flatnonzero([group in groups for groups in inside])
            called = named[dimensions[name], group]
            if dimensions[name] > 1:
                cell_groups.setdefault(called, {})[len(blocks)] = rows
            else:
                nodes = np.unique(cells[rows])
                node_groups[called] = np.union1d(node_groups.get(called, nodes[:0]), nodes)
        if dimensions[name] > 1:
            blocks.append((name, cells[:, _vtk_order(name)]))
    return RawMesh(read.points, blocks, cell_groups, node_groups)


def _group_names(read: _File, dimensions: dict[str, int]) -> dict[tuple[int, int], str]:
    """The name of each group that has elements; a curve's or a point's says so where a larger group has it, too."""
    used = {
        (dimensions[name], group)
        for name, parts in read.groups.items()
        for groups in parts
        for inside in groups
        for group in inside
    }
    names = {key: read.names.get(key) or f"{DIMENSIONS[key[0]]} {key[1]}" for key in used}
    taken = {name for (dimension, _), name in names.items() if dimension > 1}
    return {
        key: f"{name} ({DIMENSIONS[key[0]]})" if key[0] < 2 and name in taken else name for key, name in names.items()
    }


def _numbered(cells: IntArray, tags: IntArray, order: IntArray, name: str, file: str) -> IntArray:
    """Places of nodes by their numbers in the file."""
    place = np.searchsorted(tags, cells).clip(max=max(len(tags) - 1, 0))
    unknown = np.argwhere(tags[place] != cells) if len(tags) else np.argwhere(cells == cells)
    if len(unknown):
        raise MeshFileError(f"{file}: {name}: node {cells[tuple(unknown[0])]} is not in the file")
    return order[place]


def _vtk_order(name: str) -> list[int]:
    """Gmsh's local node at each of VTK's places."""
    if name not in MIDDLES:
        return list(range(next(size for kind, _, size in TYPES.values() if kind == name)))
    corners = len(PLACES[family(name)])
    ours = [frozenset(place) for place in MIDDLES[name]]
    return [*range(corners), *(corners + ours.index(frozenset(place)) for place in PLACES[name][corners:])]
