"""What building and emulating the image needs of its ELF file: what is loaded where, and what it is called."""

from __future__ import annotations

from functools import cached_property
from io import BytesIO
from pathlib import Path
from typing import Any, NamedTuple

ALLOCATED = 2  # of a section's flags: it takes memory
SYMBOLS = "SHT_SYMTAB"


class Segment(NamedTuple):
    """Bytes and where they go: address is where they run, load_address where they are stored."""

    address: int
    load_address: int
    data: bytes
    memory_bytes: int


class Named(NamedTuple):
    """A section of the image, or a symbol (Thumb bit cleared): where it runs, and how many bytes it takes."""

    name: str
    address: int
    size: int


class Elf:
    """A little-endian 32-bit file. Raises ValueError when it is none, ImportError where pyelftools is missing."""

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
        """The file at a path."""
        return cls(path.read_bytes())

    @cached_property
    def segments(self) -> list[Segment]:
        """What is loaded, in the file's order, empty ones included when they take memory."""
        loaded = [one for one in self.file.iter_segments("PT_LOAD") if one["p_memsz"]]
        return [Segment(one["p_vaddr"], one["p_paddr"], one.data(), one["p_memsz"]) for one in loaded]

    @cached_property
    def symbols(self) -> dict[str, Named]:
        """Objects and functions that have a home, by name."""
        homes = [one for one in self.all_symbols if one["st_shndx"] != "SHN_UNDEF"]
        thumb = [int(one["st_info"]["type"] == "STT_FUNC") for one in homes]
        return {
            one.name: Named(one.name, one["st_value"] & ~bit, one["st_size"])
            for one, bit in zip(homes, thumb, strict=True)
        }

    @cached_property
    def sections(self) -> list[Named]:
        """The parts that take memory, by address."""
        parts = [one for one in self.file.iter_sections() if one["sh_flags"] & ALLOCATED and one["sh_size"]]
        return sorted((Named(one.name, one["sh_addr"], one["sh_size"]) for one in parts), key=lambda one: one.address)

    @cached_property
    def all_symbols(self) -> list[Any]:
        """Of the file as pyelftools has them, undefined ones included."""
        tables: list[Any] = list(self.file.iter_sections(SYMBOLS))
        return [symbol for table in tables for symbol in table.iter_symbols() if symbol.name]


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
