"""The image: built, small, repeatable, and holding the table it was given."""

from __future__ import annotations

import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from firmware import build as builder
from firmware.elf import Elf
from pipeline.mode_table import Mode, ModeTable, to_bytes, to_header

TABLE = ModeTable(250e3, bytes(range(16)), (Mode.from_quality(31404.5, 300.0, delay_s=2e-6),))
SECTOR = 0x0800C000


@pytest.fixture(scope="module")
def image(tmp_path_factory: pytest.TempPathFactory) -> builder.Image:
    try:
        builder.toolchain()
    except builder.BuildError as missing:
        pytest.skip(str(missing))
    return builder.build(to_header(TABLE), tmp_path_factory.mktemp("image"))


def test_image_fits(image: builder.Image) -> None:
    assert 4096 < image.flash_bytes <= 32 * 1024
    assert 1024 < image.ram_bytes <= 16 * 1024


def test_binary_starts_with_stack_and_reset_and_holds_the_table_in_its_sector(image: builder.Image) -> None:
    binary, elf = image.binary.read_bytes(), Elf.read(image.elf)
    assert int.from_bytes(binary[:4], "little") == elf.symbols["stack_top"].address
    assert int.from_bytes(binary[4:8], "little") == elf.symbols["Reset_Handler"].address | 1
    data = to_bytes(TABLE)
    at = SECTOR - builder.FLASH_START
    assert binary[at : at + len(data)] == data


def test_image_is_repeatable_from_another_folder(image: builder.Image, tmp_path: Path) -> None:
    copy = tmp_path / "elsewhere"
    root = Path(builder.__file__).parent
    shutil.copytree(root, copy / "firmware", ignore=shutil.ignore_patterns("build", "generated", "__pycache__"))
    (copy / "table.bin").write_bytes(to_bytes(TABLE))
    command = [sys.executable, "-m", "firmware.build", "--table", "table.bin", "--out", "out"]
    done = subprocess.run(command, cwd=copy, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    assert "flash" in done.stdout and "RAM" in done.stdout
    assert (copy / "out" / "antinode.bin").read_bytes() == image.binary.read_bytes()


def test_core_calls_nothing_but_itself(image: builder.Image, tmp_path: Path) -> None:
    _, command = builder.toolchain()
    for source in sorted(builder.CORE.glob("*.c")):
        target = tmp_path / f"{source.stem}.o"
        builder.run([*command, *builder.LANGUAGE, *builder.SECTIONS, "-c", str(source), "-o", str(target)])
        assert [name for name in Elf.read(target).undefined if not name.startswith("an_")] == [], source.name


def test_a_header_is_taken_as_it_is(tmp_path: Path) -> None:
    header = tmp_path / "mode_table.h"
    header.write_text(to_header(TABLE))
    assert builder.choose_header(None, header) == to_header(TABLE)


@pytest.mark.parametrize(
    ("content", "words"),
    [(b"nonsense", "not a mode table"), (to_bytes(TABLE)[:-1], "truncated"), (to_bytes(TABLE)[:-1] + b"x", "damaged")],
)
def test_a_damaged_table_is_refused_in_one_line(tmp_path: Path, capsys, content: bytes, words: str) -> None:
    (tmp_path / "t.bin").write_bytes(content)
    assert builder.main(["--table", str(tmp_path / "t.bin"), "--out", str(tmp_path)]) == 2
    error = capsys.readouterr().err
    assert words in error and error.count("\n") == 1


def test_no_table_is_said_with_the_way_to_get_one(tmp_path: Path, capsys) -> None:
    assert builder.main(["--header", str(tmp_path / "none.h"), "--out", str(tmp_path)]) == 2
    assert "antinode export table" in capsys.readouterr().err
