"""ELF file of an image, as needed for building and emulating it: segments, sections and symbols."""

from __future__ import annotations

from functools import cached_property
from io import BytesIO
from pathlib import Path
from typing import Any, NamedTuple

ALLOCATED = 2  # section flag: occupies memory
SYMBOLS = "SHT_SYMTAB"


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
