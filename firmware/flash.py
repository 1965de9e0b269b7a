"""Puts an image onto a board by the programmer that is here: `python -m firmware.flash single` (or `make flash`)."""

from __future__ import annotations

import argparse
import re
import shutil
import subprocess
import sys
from collections.abc import Callable
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path

from firmware.build import BUILD, FLASH_START, TABLE_START, VARIANTS, BuildError
from firmware.image.elf import Elf, flash_image

CHIP = "STM32F446RETx"
PLACE = f"0x{FLASH_START:08x}"
CODE_ONLY = "-code.bin"


class FlashError(BuildError):
    """The image did not get onto the board."""


@dataclass(frozen=True)
class Programmer:
    """A tool that writes flash memory: its name, how to get it, and its commands for (raw image, probe's serial number)."""

    name: str
    install: str
    commands: Callable[[Path, str | None], list[list[str]]]

    def call(self) -> list[str] | None:
        """How to call it here, or None."""
        if shutil.which(self.name):
            return [self.name]
        return [sys.executable, "-m", self.name] if self.name == "pyocd" and find_spec(self.name) else None


def _openocd(image: Path, probe: str | None) -> list[list[str]]:
    chosen = ["-c", f"adapter serial {probe}"] if probe else []
    write = f"program {{{image.as_posix()}}} {PLACE} verify reset exit"
    return [["-f", "interface/stlink.cfg", *chosen, "-f", "target/stm32f4x.cfg", "-c", write]]


def _pyocd(image: Path, probe: str | None) -> list[list[str]]:
    chosen = ["--uid", probe] if probe else []
    return [["flash", "--no-wait", "-t", CHIP.lower(), *chosen, "--base-address", PLACE, str(image)]]


def _probe_rs(image: Path, probe: str | None) -> list[list[str]]:
    to = ["--chip", CHIP, *(["--probe", probe] if probe else [])]
    place = ["--binary-format", "bin", "--base-address", PLACE, "--verify"]
    return [["download", *to, *place, str(image)], ["reset", *to]]


def _st_flash(image: Path, probe: str | None) -> list[list[str]]:
    return [[*(["--serial", probe] if probe else []), "--reset", "write", str(image), PLACE]]


PROGRAMMERS = (
    Programmer("openocd", "apt install openocd", _openocd),
    Programmer("pyocd", "pip install pyocd, then pyocd pack install stm32f446re", _pyocd),
    Programmer("probe-rs", "cargo install probe-rs-tools", _probe_rs),
    Programmer("st-flash", "apt install stlink-tools", _st_flash),
)


def chosen_programmer(name: str | None) -> tuple[Programmer, list[str]]:
    """The programmer named, or the first that is here, and how to call it. Raises FlashError when there is none."""
    matching = [one for one in PROGRAMMERS if name in (None, one.name)]
    for one in matching:
        call = one.call()
        if call is not None:
            return one, call
    offers = "; ".join(f"{one.name} ({one.install})" for one in matching)
    raise FlashError(f"no programmer is here: install {offers}; or copy the .bin onto the drive that a Nucleo shows", 5)


def image_to_write(variant: str, folder: Path, keep_table: bool) -> Path:
    """The raw image: the whole one, or code alone, so that the table on the board stays. Raises FlashError."""
    elf = folder / f"{VARIANTS[variant]}.elf"
    if not elf.is_file():
        raise FlashError(f"{elf} is not there: `make firmware` builds it", 2)
    if not keep_table:
        return elf.with_suffix(".bin")
    code = elf.with_name(elf.stem + CODE_ONLY)
    try:
        code.write_bytes(flash_image(Elf.read(elf), FLASH_START)[: TABLE_START - FLASH_START])
    except ImportError:
        raise FlashError("the code cannot be told from the table: `pip install pyelftools`", 5) from None
    return code


def flash(image: Path, tool: str | None = None, probe: str | None = None) -> str:
    """Writes and verifies a raw image; returns the programmer's name. Raises FlashError."""
    one, call = chosen_programmer(tool)
    for command in one.commands(image, probe):
        done = subprocess.run([*call, *command], capture_output=True, text=True)
        if done.returncode:
            raise FlashError(f"{one.name} ended with {done.returncode}: {_said(done)}", 3)
    return one.name


def _said(done: subprocess.CompletedProcess[str]) -> str:
    lines = [line.strip() for line in (done.stdout + done.stderr).splitlines() if line.strip()]
    telling = [line for line in lines if re.search("error|warn|fail|could|no probe|not found", line, re.I)]
    return " / ".join((telling or lines)[-3:]) or "it said nothing"


def main(arguments: list[str] | None = None) -> int:
    """The command line; returns the exit code."""
    parser = argparse.ArgumentParser(
        prog="python -m firmware.flash",
        description="Puts an image from `make firmware` onto a board, its mode table included.",
        epilog="example: python -m firmware.flash six --keep-table",
    )
    parser.add_argument("variant", choices=VARIANTS, help="one mode by DAC, or six channels by PWM")
    parser.add_argument(
        "--tool", choices=[one.name for one in PROGRAMMERS], help="else the first of these that is here"
    )
    parser.add_argument("--probe", metavar="SERIAL", help="which debugger, when several boards are plugged in")
    parser.add_argument("--keep-table", action="store_true", help="write the code alone: an uploaded table stays")
    parser.add_argument("--from", dest="folder", type=Path, default=BUILD, metavar="DIR", help="where the image is")
    text = parser.parse_args(arguments)
    try:
        image = image_to_write(text.variant, text.folder, text.keep_table)
        name = flash(image, text.tool, text.probe)
    except FlashError as error:
        print(f"flash: {error}", file=sys.stderr)
        return error.exit_code
    kept = "the table on the board stays" if text.keep_table else "the table that was on the board is replaced"
    print(f"{image.name} is on the board, written and verified by {name}; {kept}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
