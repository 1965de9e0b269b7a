"""Build the STM32F446 image: `python -m firmware.build [--table FILE | --header FILE]`."""

from __future__ import annotations

import argparse
import os
import shutil
import subprocess
import sys
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path

from firmware import mode_table
from firmware.image import Elf, flash_image, map_text, svd_text

HERE = Path(__file__).resolve().parent
ROOT = HERE.parent
CORE = HERE / "core"
BOARD = HERE / "board" / "f446"
GENERATED = HERE / "generated"
BUILD = HERE / "build"

VARIANTS = {"single": "antinode", "six": "antinode-six"}  # one mode by DAC; six channels by PWM

FLASH_START, RAM_START = 0x08000000, 0x20000000
TABLE_START = 0x0800C000  # flash sector 3
FLASH_LIMIT, RAM_LIMIT = 32 * 1024, 16 * 1024

LANGUAGE = (
    "-std=c11",
    "-ffreestanding",
    "-ffp-contract=off",
    "-fno-math-errno",
    "-fomit-frame-pointer",
    "-fno-short-enums",  # enumerations have the same size as on the host
    "-g",
)
# Interrupt code is compiled for speed, the rest for size; otherwise the six-channel image would not fit.
FAST = (
    "an_fast",
    "an_slow",
    "an_pi",
    "an_watch",
    "an_demod",
    "an_texture",
    "an_six_fast",
    "an_six_watch",
    "an_capture",
)
SPEED, SIZE = "-O2", "-Os"
TABLE = BOARD / "table.c"  # compiled separately: another table or folder leaves the rest in zig's cache
SECTIONS = ("-ffunction-sections", "-fdata-sections", "-fno-unwind-tables", "-fno-asynchronous-unwind-tables")
WARNINGS = (
    "-Wall",
    "-Wextra",
    "-Wconversion",
    "-Wsign-conversion",
    "-Wdouble-promotion",
    "-Wfloat-conversion",
    "-Wshadow",
    "-Wstrict-prototypes",
    "-Wmissing-prototypes",
    "-Werror",
)
LINK = ("-nostdlib", "-Wl,--gc-sections", "-Wl,--build-id=none", "-Wl,--entry=Reset_Handler")


class BuildError(RuntimeError):
    """The image cannot be built; exit_code is the exit code of the program."""

    def __init__(self, message: str, exit_code: int) -> None:
        super().__init__(message)
        self.exit_code = exit_code


@dataclass(frozen=True)
class Image:
    """Built image: its files, sizes and compiler.

    Attributes
    ----------
    elf, binary, map, svd : Path
        ELF file with debug information, contents of the flash memory from its start, list of symbols by address, and
        description of the registers.
    flash_bytes, ram_bytes : int
        Sizes without gaps; the RAM includes the stack.
    compiler : str
    """

    elf: Path
    binary: Path
    map: Path
    svd: Path
    flash_bytes: int
    ram_bytes: int
    compiler: str


def toolchain() -> tuple[str, list[str]]:
    """Find a compiler for the Cortex-M4F: arm-none-eabi-gcc if on PATH, otherwise zig from pip.

    Returns
    -------
    tuple of str and list of str
        Name and command.

    Raises
    ------
    BuildError
        If there is no compiler, or pyelftools, which reads its output, is missing.
    """
    if not find_spec("elftools"):
        raise BuildError("the image cannot be read: install pyelftools with `pip install pyelftools`", 5)
    if shutil.which("arm-none-eabi-gcc"):
        machine = ["-mcpu=cortex-m4", "-mthumb", "-mfloat-abi=hard", "-mfpu=fpv4-sp-d16"]
        own = ["-fno-tree-loop-distribute-patterns", "-nostartfiles", "-gno-record-gcc-switches"]
        return "arm-none-eabi-gcc", ["arm-none-eabi-gcc", *machine, *own]
    if find_spec("ziglang"):
        machine = ["-target", "thumb-freestanding-eabihf", "-mcpu=cortex_m4+vfp4d16sp"]
        return "zig cc", [sys.executable, "-m", "ziglang", "cc", *machine]
    raise BuildError("no compiler for the Cortex-M4: install arm-none-eabi-gcc, or zig with `pip install ziglang`", 5)


def build(table: bytes, folder: Path = BUILD, variant: str = "single") -> Image:
    """Compile core and board with a mode table and link them.

    Parameters
    ----------
    table : bytes
        Mode table to embed.
    folder : Path, optional
        Where to write the image.
    variant : {"single", "six"}, optional

    Returns
    -------
    Image

    Raises
    ------
    BuildError
        If there is no compiler, or it fails.
    """
    name, command = toolchain()
    own = folder.resolve() / variant
    own.mkdir(parents=True, exist_ok=True)
    (own / "mode_table.h").write_text(mode_table.header_text(table))
    elf = folder / f"{VARIANTS[variant]}.elf"
    parts = (CORE, CORE / variant, BOARD, BOARD / variant)
    places = [*(f"-I{part}" for part in parts), *mapped()]
    code = [path for part in parts for path in sorted(part.glob("*.c")) if path != TABLE]
    pieces = [[level, *places, *(str(path) for path in code if optimised(path) == level)] for level in (SPEED, SIZE)]
    pieces.append([SIZE, *places, f"-I{own}", f"-ffile-prefix-map={folder.resolve()}=build", str(TABLE)])
    objects = [str(own / f"{index}.o") for index in range(len(pieces))]
    for piece, target in zip(pieces, objects, strict=True):
        run([*command, *LANGUAGE, *SECTIONS, *WARNINGS, *piece, "-nostdlib", "-r", "-o", target])
    run([*command, *LINK, f"-Wl,-T,{BOARD / 'memory.ld'}", *objects, "-o", str(elf.resolve())])
    return _with_its_files(elf, name)


def _with_its_files(elf: Path, compiler: str) -> Image:
    linked = Elf.read(elf)
    binary, listing, registers = (elf.with_suffix(suffix) for suffix in (".bin", ".map", ".svd"))
    binary.write_bytes(flash_image(linked, FLASH_START))
    listing.write_text(map_text(linked))
    registers.write_text(svd_text((BOARD / "registers.h").read_text()))
    return Image(elf, binary, listing, registers, *sizes(linked), compiler)


def mapped() -> list[str]:
    """Compiler options that keep this machine's paths out of the debug information; the compiler must run in the root.

    A compiler installed below the root refers to its headers relative to the root.
    """
    headers = _own_headers()
    places = {ROOT: ".", headers: "compiler"}
    if headers.is_relative_to(ROOT):
        places[headers.relative_to(ROOT)] = "compiler"
    return [f"-ffile-prefix-map={place}={name}" for place, name in places.items()]


def _own_headers() -> Path:
    """Folder of the compiler's own headers."""
    gcc = shutil.which("arm-none-eabi-gcc")
    if gcc:
        text = subprocess.run([gcc, "-print-file-name=include"], capture_output=True, text=True).stdout
        return Path(text.strip()).resolve()
    spec = find_spec("ziglang")
    return Path(spec.origin or "").resolve().parent if spec else Path()


def optimised(source: Path) -> str:
    """Optimisation level of a source file."""
    return SPEED if source.stem in FAST else SIZE


def run(command: list[str]) -> None:
    """Run a compiler in the root; raise BuildError with its output if it fails."""
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True)
    if done.returncode:
        raise BuildError(f"the compiler refused:\n{done.stderr.strip()}", 3)


def sizes(elf: Elf) -> tuple[int, int]:
    """Return the flash memory and RAM used by the image, in bytes."""
    flash = sum(len(segment.data) for segment in elf.segments)
    ram = sum(segment.memory_bytes for segment in elf.segments if segment.address >= RAM_START)
    return flash, ram


def choose_table(table: Path | None, header: Path | None, variant: str = "single") -> bytes:
    """Read the mode table to build with: from a file, from a C header, or the last one exported.

    Raises
    ------
    BuildError
        If there is no table, or the build cannot use it.
    """
    place = header or GENERATED / "mode_table.h"
    named = f"--table {table}" if table else f"--header {header}" if header else f"{os.path.relpath(place)}"
    try:
        data = table.read_bytes() if table else mode_table.header_bytes(place.read_text(errors="replace"))
        refusal = mode_table.refusal(mode_table.from_bytes(data), variant)
        if refusal:
            raise ValueError(refusal)
        return data
    except (OSError, ValueError) as error:
        why = getattr(error, "strerror", None) or str(error)
        hint = "`antinode export table CASE -o plate.bin` writes a table, --table plate.bin builds with it"
        raise BuildError(f"{named}: no mode table to build with ({why}): {hint}", 2) from None


def main(arguments: list[str] | None = None) -> int:
    """Run the command line and return the exit code."""
    parser = argparse.ArgumentParser(prog="python -m firmware.build", description=__doc__)
    source = parser.add_mutually_exclusive_group()
    source.add_argument("--table", type=Path, metavar="FILE", help="mode table as a binary file")
    source.add_argument("--header", type=Path, metavar="FILE", help="mode table as a C header")
    parser.add_argument("--out", type=Path, default=BUILD, metavar="DIR", help="where to build")
    parser.add_argument("--variant", choices=VARIANTS, default="single", help="one mode by DAC, or six channels by PWM")
    chosen = parser.parse_args(arguments)
    try:
        image = build(choose_table(chosen.table, chosen.header, chosen.variant), chosen.out, chosen.variant)
    except BuildError as error:
        print(f"firmware: {error}", file=sys.stderr)
        return error.exit_code
    except OSError as error:
        print(f"firmware: --out {chosen.out}: {error.strerror}: must be a folder that can be written", file=sys.stderr)
        return 2
    print(f"{os.path.relpath(image.elf)}, .bin, .map and .svd, by {image.compiler}")
    print(f"flash {image.flash_bytes} bytes of {FLASH_LIMIT}, RAM {image.ram_bytes} bytes of {RAM_LIMIT} allowed")
    if image.flash_bytes > FLASH_LIMIT or image.ram_bytes > RAM_LIMIT:
        print("firmware: the image is larger than allowed", file=sys.stderr)
        return 4
    return 0


if __name__ == "__main__":
    sys.exit(main())
