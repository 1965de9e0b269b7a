"""Analysis of a built image: its ELF contents, a register description for debuggers, and its longest paths.

The CMSIS-SVD description is made from firmware/board/f446/registers.h: the manufacturer's complete one has a licence that does
not permit redistribution here.

`python -m firmware.image FILE.elf an_fast_tick ...` derives the control flow from the Thumb-2 code: branches, calls (whose own
longest paths are added) and returns. Every instruction counts as one. A routine with a loop has no bound.
"""

from __future__ import annotations

import re
import sys
from collections.abc import Iterator
from functools import cache, cached_property
from io import BytesIO
from pathlib import Path
from typing import Any, NamedTuple
from xml.etree import ElementTree

ALLOCATED = 2  # section flag: occupies memory
SYMBOLS = "SHT_SYMTAB"

STRUCT = re.compile(r"typedef struct \{(.*?)\}\s*(\w+);", re.S)
INSTANCE = re.compile(r"#define (\w+) \(\((\w+) \*\)(0x[0-9a-fA-F]+)u\)")
BYTES = {"reg": 4, "volatile uint32_t": 4, "uint32_t": 4, "volatile uint8_t": 1}
Register = tuple[str, int, int]  # name, offset, bytes


class Segment(NamedTuple):
    """Loadable segment: address at run time, load_address in flash memory."""

    address: int
    load_address: int
    data: bytes
    memory_bytes: int


class Named(NamedTuple):
    """Section or symbol (without the Thumb bit): name, address at run time and size in bytes."""

    name: str
    address: int
    size: int


class Elf:
    """Little-endian 32-bit ELF file.

    Raises
    ------
    ValueError
        If the data is no such file.
    ImportError
        If pyelftools is missing.
    """

    def __init__(self, data: bytes) -> None:
        from elftools.common.exceptions import ELFError
        from elftools.elf.elffile import ELFFile

        try:
            self.file = ELFFile(BytesIO(data))
        except ELFError as error:
            raise ValueError(f"not an ELF file: {error}") from None
        if self.file.elfclass != 32 or not self.file.little_endian:
            raise ValueError("not a little-endian 32-bit ELF file")

    @classmethod
    def read(cls, path: Path) -> Elf:
        """Read the file at a path."""
        return cls(path.read_bytes())

    @cached_property
    def segments(self) -> list[Segment]:
        """Segments that occupy memory, in the order of the file, including those without data."""
        loaded = [one for one in self.file.iter_segments("PT_LOAD") if one["p_memsz"]]
        return [Segment(one["p_vaddr"], one["p_paddr"], one.data(), one["p_memsz"]) for one in loaded]

    @cached_property
    def symbols(self) -> dict[str, Named]:
        """Defined objects and functions by name."""
        homes = [one for one in self.all_symbols if one["st_shndx"] != "SHN_UNDEF"]
        thumb = [int(one["st_info"]["type"] == "STT_FUNC") for one in homes]
        return {
            one.name: Named(one.name, one["st_value"] & ~bit, one["st_size"])
            for one, bit in zip(homes, thumb, strict=True)
        }

    @cached_property
    def sections(self) -> list[Named]:
        """Sections that occupy memory, by address."""
        parts = [one for one in self.file.iter_sections() if one["sh_flags"] & ALLOCATED and one["sh_size"]]
        return sorted((Named(one.name, one["sh_addr"], one["sh_size"]) for one in parts), key=lambda one: one.address)

    @cached_property
    def all_symbols(self) -> list[Any]:
        """All named symbols of the file, including undefined ones, as pyelftools objects."""
        tables: list[Any] = list(self.file.iter_sections(SYMBOLS))
        return [symbol for table in tables for symbol in table.iter_symbols() if symbol.name]


class Step(NamedTuple):
    """Instruction: size in bytes, branch targets, whether it can fall through, and the routine it calls."""

    size: int
    targets: tuple[int, ...] = ()
    falls_through: bool = True
    call: int | None = None


class Unbounded(ValueError):
    """The routine has a loop, or a jump whose target depends on data."""


class Code:
    """Instructions of an image."""

    def __init__(self, elf: Elf) -> None:
        self.elf = elf
        self.text = elf.segments[0]
        self.longest = cache(self._longest)

    def _half(self, at: int) -> int:
        offset = at - self.text.address
        return int.from_bytes(self.text.data[offset : offset + 2], "little")

    def step(self, at: int, in_block: bool) -> Step:
        """Decode the instruction at an address; in_block means that an IT block makes it conditional."""
        high = self._half(at)
        if high >> 11 in (0b11101, 0b11110, 0b11111):
            return _wide(high, self._half(at + 2), at, in_block)
        return _narrow(high, at, in_block)

    def block_left(self, at: int, left: int) -> int:
        """Return how many of the following instructions are conditional, given the number before this one."""
        high = self._half(at)
        if high & 0xFF00 == 0xBF00 and high & 0xF:
            return 4 - (high & -high).bit_length() + 1
        return max(left - 1, 0)

    def _longest(self, entry: int) -> int:
        result: dict[tuple[int, int], int] = {}
        under_way: set[tuple[int, int]] = set()

        def walk(at: int, left: int) -> int:
            place = at, left
            if place in result:
                return result[place]
            if place in under_way:
                raise Unbounded(f"{at:#x}: a loop")
            under_way.add(place)
            step = self.step(at, left > 0)
            after = self.block_left(at, left)
            paths = [walk(target, 0) for target in step.targets]
            if step.falls_through:
                paths.append(walk(at + step.size, after))
            called = self.longest(step.call) if step.call is not None else 0
            under_way.discard(place)
            result[place] = 1 + called + max(paths, default=0)
            return result[place]

        sys.setrecursionlimit(20000)
        return walk(entry, 0)


def map_text(elf: Elf) -> str:
    """List the sections that occupy memory, each with its functions and objects by address and size."""
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
    """Return the contents of the flash memory from start onwards, with gaps filled like erased flash."""
    stored = [segment for segment in elf.segments if segment.data and segment.load_address >= start]
    end = max(segment.load_address + len(segment.data) for segment in stored)
    image = bytearray([fill]) * (end - start)
    for segment in stored:
        at = segment.load_address - start
        image[at : at + len(segment.data)] = segment.data
    return bytes(image)


def structs(header: str) -> dict[str, list[Register]]:
    """Return the registers of each struct type in a C header, with nested arrays and structs expanded.

    Raises
    ------
    ValueError
        If a member has an unknown type.
    """
    result: dict[str, list[Register]] = {}
    for body, name in STRUCT.findall(re.sub(r"/\*.*?\*/", "", header, flags=re.S)):
        result[name] = list(_members(body, result))
    return result


def svd_text(header: str) -> str:
    """Return the description as XML, without unused registers. Raises ValueError for an unknown type."""
    types = structs(header)
    device = ElementTree.Element("device", schemaVersion="1.3")
    about = {"name": "STM32F446", "version": "1.0", "description": "Registers that Antinode's firmware touches"}
    _texts(device, about | {"addressUnitBits": "8", "width": "32", "size": "32", "access": "read-write"})
    peripherals = ElementTree.SubElement(device, "peripherals")
    for name, kind, address in INSTANCE.findall(header):
        if kind not in types:
            raise ValueError(f"{name} is of the unknown type {kind!r}")
        _peripheral(peripherals, name, int(address, 16), types[kind])
    ElementTree.indent(device)
    return '<?xml version="1.0" encoding="utf-8"?>\n' + ElementTree.tostring(device, encoding="unicode") + "\n"


def bound(image: Path, routine: str) -> int:
    """Count the instructions on the longest path from a routine's entry to its return, including calls.

    Parameters
    ----------
    image : Path
        ELF file.
    routine : str
        Name of the routine.

    Returns
    -------
    int

    Raises
    ------
    Unbounded
        If the routine has a loop or a computed jump.
    KeyError
        If the image has no such routine.
    """
    elf = Elf.read(image)
    return Code(elf).longest(elf.symbols[routine].address)


def main(arguments: list[str]) -> int:
    """Run the command line and return the exit code."""
    if len(arguments) < 2:
        print("usage: python -m firmware.image FILE.elf ROUTINE ...", file=sys.stderr)
        return 2
    for name in arguments[1:]:
        try:
            print(f"{name}: {bound(Path(arguments[0]), name)}")
        except (Unbounded, KeyError) as error:
            print(f"bounds: {name}: {error}", file=sys.stderr)
            return 3
        except (OSError, ValueError) as error:
            print(f"bounds: {arguments[0]}: {getattr(error, 'strerror', None) or error}", file=sys.stderr)
            return 2
    return 0


def _members(body: str, known: dict[str, list[Register]]) -> Iterator[Register]:
    at = 0
    for line in filter(None, (part.strip() for part in body.split(";"))):
        kind, _, names = re.sub(r"\s*,\s*", ",", " ".join(line.split())).rpartition(" ")
        for name, count in re.findall(r"(\w+)(?:\[(\d+)\])?", names):
            for index in range(int(count or 1)):
                inside = _inside(kind, known)
                label = f"{name}{index}" if count else name
                yield from ((label + ("_" + own if own else ""), at + offset, size) for own, offset, size in inside)
                at += max(offset + size for _, offset, size in inside)


def _inside(kind: str, known: dict[str, list[Register]]) -> list[Register]:
    if kind in BYTES:
        return [("", 0, BYTES[kind])]
    if kind in known:
        return known[kind]
    raise ValueError(f"a register of the unknown type {kind!r}")


def _peripheral(parent: ElementTree.Element, name: str, address: int, registers: list[Register]) -> None:
    own = ElementTree.SubElement(parent, "peripheral")
    _texts(own, {"name": name, "baseAddress": f"0x{address:08X}"})
    size = max(offset + size for _, offset, size in registers)
    _texts(ElementTree.SubElement(own, "addressBlock"), {"offset": "0", "size": f"0x{size:X}", "usage": "registers"})
    listed = ElementTree.SubElement(own, "registers")
    for label, offset, width in registers:
        if not label.startswith(("unused", "reserved")):
            one = ElementTree.SubElement(listed, "register")
            _texts(one, {"name": label, "addressOffset": f"0x{offset:X}", "size": str(8 * width)})


def _texts(parent: ElementTree.Element, values: dict[str, str]) -> None:
    for name, value in values.items():
        ElementTree.SubElement(parent, name).text = value


def _signed(value: int, bits: int) -> int:
    return value - (1 << bits) if value >> (bits - 1) else value


def _narrow(word: int, at: int, in_block: bool) -> Step:
    if word >> 12 == 0b1101 and word >> 8 & 0xF < 14:
        return Step(2, (at + 4 + 2 * _signed(word & 0xFF, 8),))
    if word >> 11 == 0b11100:
        return Step(2, (at + 4 + 2 * _signed(word & 0x7FF, 11),), in_block)
    if word & 0xF500 == 0xB100:  # cbz, cbnz
        return Step(2, (at + 4 + 2 * ((word >> 3 & 0x1F) | (word >> 4 & 0x20)),))
    if word & 0xFF87 == 0x4700 or word & 0xFF00 == 0xBD00:  # bx, pop {..., pc}
        return Step(2, (), in_block)
    if word & 0xFF87 == 0x4780 or word & 0xFF87 == 0x4687:  # blx, mov pc
        raise Unbounded(f"{at:#x}: a call or jump through a register")
    return Step(2)


def _wide(high: int, low: int, at: int, in_block: bool) -> Step:
    if high >> 11 == 0b11110 and low >> 15:
        sign, j1, j2 = high >> 10 & 1, low >> 13 & 1, low >> 11 & 1
        if low >> 12 & 1 or low >> 14 & 1:  # bl, b.w
            i1, i2 = 1 - (j1 ^ sign), 1 - (j2 ^ sign)
            offset = _signed(sign << 24 | i1 << 23 | i2 << 22 | (high & 0x3FF) << 12 | (low & 0x7FF) << 1, 25)
            if low >> 14 & 1:
                return Step(4, call=at + 4 + offset)
            return Step(4, (at + 4 + offset,), in_block)
        if high >> 7 & 7 != 7:  # b<c>.w
            offset = _signed(sign << 20 | j2 << 19 | j1 << 18 | (high & 0x3F) << 12 | (low & 0x7FF) << 1, 21)
            return Step(4, (at + 4 + offset,))
    if high == 0xE8BD and low >> 15:  # pop {..., pc}
        return Step(4, (), in_block)
    if high & 0xFFF0 == 0xF850 and low >> 12 == 15:  # ldr pc
        return Step(4, (), in_block)
    if high == 0xE8DF and low & 0xFFE0 == 0xF000:  # tbb, tbh
        raise Unbounded(f"{at:#x}: a jump through a table")
    return Step(4)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
