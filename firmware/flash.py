"""Write an image to a board with an installed programmer: `python -m firmware.flash single` (or `make flash`)."""

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
from firmware.image import Elf, flash_image

CHIP = "STM32F446RETx"
PLACE = f"0x{FLASH_START:08x}"
CODE_ONLY = "-code.bin"


class FlashError(BuildError):
    """The image could not be written to the board."""


@dataclass(frozen=True)
class Programmer:
    """Tool that writes flash memory: name, installation, and commands for a raw image and a probe's serial number."""

    name: str
    install: str
    commands: Callable[[Path, str | None], list[list[str]]]

    def call(self) -> list[str] | None:
        """Return the command that runs the tool, or None if it is not installed."""
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
    """Return the named programmer, or the first one installed, and its command. Raises FlashError if there is none."""
    matching = [one for one in PROGRAMMERS if name in (None, one.name)]
    for one in matching:
        call = one.call()
        if call is not None:
            return one, call
    offers = "; ".join(f"{one.name} ({one.install})" for one in matching)
    raise FlashError(f"no programmer found: install {offers}; or copy the .bin file to the drive of the Nucleo", 5)


def image_to_write(variant: str, folder: Path, keep_table: bool) -> Path:
    """Return the raw image, or only its code if the table on the board is to be kept. Raises FlashError."""
    elf = folder / f"{VARIANTS[variant]}.elf"
    if not elf.is_file():
        raise FlashError(f"{elf} not found: build it with `make firmware`", 2)
    if not keep_table:
        return elf.with_suffix(".bin")
    code = elf.with_name(elf.stem + CODE_ONLY)
    try:
        code.write_bytes(flash_image(Elf.read(elf), FLASH_START)[: TABLE_START - FLASH_START])
    except ImportError:
        raise FlashError("code and table cannot be separated: `pip install pyelftools`", 5) from None
    return code


def flash(image: Path, tool: str | None = None, probe: str | None = None) -> str:
    """Write and verify a raw image and return the programmer's name. Raises FlashError."""
    one, call = chosen_programmer(tool)
    for command in one.commands(image, probe):
        done = subprocess.run([*call, *command], capture_output=True, text=True)
        if done.returncode:
            raise FlashError(f"{one.name} failed with exit code {done.returncode}: {_said(done)}", 3)
    return one.name


def _said(done: subprocess.CompletedProcess[str]) -> str:
    lines = [line.strip() for line in (done.stdout + done.stderr).splitlines() if line.strip()]
    telling = [line for line in lines if re.search("error|warn|fail|could|no probe|not found", line, re.I)]
    return " / ".join((telling or lines)[-3:]) or "no output"


def main(arguments: list[str] | None = None) -> int:
    """Run the command line and return the exit code."""
    parser = argparse.ArgumentParser(
        prog="python -m firmware.flash",
        description="Write an image from `make firmware` to a board, including its mode table.",
        epilog="example: python -m firmware.flash six --keep-table",
    )
    parser.add_argument("variant", choices=VARIANTS, help="one mode by DAC, or six channels by PWM")
    parser.add_argument(
        "--tool", choices=[one.name for one in PROGRAMMERS], help="programmer (default: the first one installed)"
    )
    parser.add_argument("--probe", metavar="SERIAL", help="debugger, if several boards are plugged in")
    parser.add_argument("--keep-table", action="store_true", help="write only the code and keep the board's table")
    parser.add_argument("--from", dest="folder", type=Path, default=BUILD, metavar="DIR", help="folder of the image")
    text = parser.parse_args(arguments)
    try:
        image = image_to_write(text.variant, text.folder, text.keep_table)
        name = flash(image, text.tool, text.probe)
    except FlashError as error:
        print(f"flash: {error}", file=sys.stderr)
        return error.exit_code
    kept = "the board's table is kept" if text.keep_table else "the board's table is replaced"
    print(f"{image.name} is on the board, written and verified by {name}; {kept}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
