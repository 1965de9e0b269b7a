"""As much of ELF32 as building and emulating the image needs: what is loaded where, and what it is called."""

from __future__ import annotations

import struct
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

LOADED = 1  # a program header to be loaded
SYMBOLS = 2  # a section of symbols
FUNCTION = 2  # a symbol
ALLOCATED = 2  # a section that takes memory


@dataclass(frozen=True)
class Segment:
    """Bytes and where they go: address is where they run, load_address where they are stored."""

    address: int
    load_address: int
    data: bytes
    memory_bytes: int


@dataclass(frozen=True)
class Section:
    """A named part of the image: where it runs, and how many bytes it takes."""

    name: str
    address: int
    size: int


@dataclass(frozen=True)
class Symbol:
    """A name, its address (Thumb bit cleared) and its size in bytes."""

    name: str
    address: int
    size: int


class Elf:
    """A little-endian 32-bit executable."""

    def __init__(self, data: bytes) -> None:
        if data[:6] != b"\x7fELF\x01\x01":
            raise ValueError("not a little-endian 32-bit ELF file")
        self.data = data
        (self.entry, self._segments_at, self._sections_at) = struct.unpack_from("<III", data, 24)
        (self._segment_count, _, self._section_count) = struct.unpack_from("<HHH", data, 44)

    @classmethod
    def read(cls, path: Path) -> Elf:
        """The file at a path."""
        return cls(path.read_bytes())

    @cached_property
    def segments(self) -> list[Segment]:
        """What is loaded, in the file's order, empty ones included when they take memory."""
        result = []
        for index in range(self._segment_count):
            kind, at, address, load, stored, memory, _, _ = struct.unpack_from(
                "<8I", self.data, self._segments_at + 32 * index
            )
            if kind == LOADED and memory:
                result.append(Segment(address, load, self.data[at : at + stored], memory))
        return result

    @cached_property
    def symbols(self) -> dict[str, Symbol]:
        """Objects and functions that have a home, by name."""
        result = {}
        for name, value, size, info, home in self._symbol_rows:
            is_function = info & 0xF == FUNCTION
            if home:
                result[name] = Symbol(name, value & ~1 if is_function else value, size)
        return result

    @cached_property
    def sections(self) -> list[Section]:
        """The parts that take memory, by address."""
        rows = self._section_rows
        names_at = rows[struct.unpack_from("<H", self.data, 50)[0]][4]
        result = [
            Section(self._text(names_at + row[0]), row[3], row[5]) for row in rows if row[2] & ALLOCATED and row[5]
        ]
        return sorted(result, key=lambda section: section.address)

    @property
    def functions(self) -> set[str]:
        """Names of the functions that are defined here, static ones included."""
        return {name for name, _, _, info, home in self._symbol_rows if home and info & 0xF == FUNCTION}

    @property
    def undefined(self) -> list[str]:
        """Names that are used and live elsewhere."""
        return [name for name, _, _, _, home in self._symbol_rows if not home]

    @cached_property
    def _symbol_rows(self) -> list[tuple[str, int, int, int, int]]:
        sections, rows = self._section_rows, []
        for _, kind, _, _, offset, length, link, *_ in sections:
            if kind != SYMBOLS:
                continue
            names_at = sections[link][4]
            for at in range(offset, offset + length, 16):
                name_at, value, size, info, _, home = struct.unpack_from("<IIIBBH", self.data, at)
                if name_at:
                    rows.append((self._text(names_at + name_at), value, size, info, home))
        return rows

    @cached_property
    def _section_rows(self) -> list[tuple[int, ...]]:
        return [
            struct.unpack_from("<10I", self.data, self._sections_at + 40 * index)
            for index in range(self._section_count)
        ]

    def _text(self, at: int) -> str:
        return self.data[at : self.data.index(b"\0", at)].decode()


def map_text(elf: Elf) -> str:
    """What lies where: each section that takes memory, and below it its functions and objects by address and size."""
    lines = ["address     bytes  what"]
    for section in elf.sections:
        lines.append(f"0x{section.address:08x} {section.size:6d}  {section.name}")
        end = section.address + section.size
        inside = [one for one in elf.symbols.values() if one.size and section.address <= one.address < end]
        lines += [
            f"0x{one.address:08x} {one.size:6d}    {one.name}"
            for one in sorted(inside, key=lambda one: (one.address, one.name))
        ]
    return "\n".join(lines) + "\n"


def flash_image(elf: Elf, start: int, fill: int = 0xFF) -> bytes:
    """The stored bytes from start on, gaps filled with what erased flash reads as."""
    stored = [segment for segment in elf.segments if segment.data and segment.load_address >= start]
    end = max(segment.load_address + len(segment.data) for segment in stored)
    image = bytearray([fill]) * (end - start)
    for segment in stored:
        at = segment.load_address - start
        image[at : at + len(segment.data)] = segment.data
    return bytes(image)
