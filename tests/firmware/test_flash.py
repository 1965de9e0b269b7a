"""Putting an image onto a board: which programmer is called, how, and what is said when it cannot be."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest

from firmware import flash
from firmware.image import Elf
from firmware.mode_table import Mode, ModeTable, to_bytes

TABLE = to_bytes(ModeTable(250e3, bytes(16), (Mode(31250.0, 3e-3),)))
WRITES = {
    "openocd": "-f interface/stlink.cfg -f target/stm32f4x.cfg -c program {IMAGE} 0x08000000 verify reset exit",
    "pyocd": "flash --no-wait -t stm32f446retx --base-address 0x08000000 IMAGE",
    "probe-rs": "download --chip STM32F446RETx --binary-format bin --base-address 0x08000000 --verify IMAGE",
    "st-flash": "--reset write IMAGE 0x08000000",
}


@pytest.fixture
def built(tmp_path: Path) -> Path:
    """A folder with images, as far as flashing them looks."""
    folder = tmp_path / "a b"
    folder.mkdir()
    for name in ("antinode.elf", "antinode.bin", "antinode-six.elf", "antinode-six.bin"):
        (folder / name).write_bytes(b"image")
    return folder


@pytest.fixture
def put_tool(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    """Makes programs of which only these are found; they note how they were called."""
    place = tmp_path / "tools"
    place.mkdir()
    monkeypatch.setenv("PATH", str(place))
    monkeypatch.setattr(flash, "find_spec", lambda name: None)

    def put(name: str, code: int = 0, says: str = "") -> Path:
        calls = tmp_path / f"{name}.calls"
        program = place / name
        program.write_text(
            f"#!{sys.executable}\nimport sys\n"
            f"open({str(calls)!r}, 'a').write(' '.join(sys.argv[1:]) + '\\n')\n"
            f"print({says!r}, file=sys.stderr)\nsys.exit({code})\n"
        )
        program.chmod(0o755)
        return calls

    return put


@pytest.mark.parametrize("tool", WRITES)
def test_each_programmer_writes_verifies_and_resets(tool: str, built: Path, put_tool, capsys) -> None:
    calls = put_tool(tool)
    assert flash.main(["single", "--from", str(built)]) == 0
    first, *more = calls.read_text().splitlines()
    assert first == WRITES[tool].replace("IMAGE", str(built / "antinode.bin"))
    assert more == (["reset --chip STM32F446RETx"] if tool == "probe-rs" else [])
    assert f"antinode.bin is on the board, written and verified by {tool}" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("tool", "words"),
    [
        ("openocd", "-c adapter serial 0673"),
        ("pyocd", "--uid 0673"),
        ("probe-rs", "--probe 0673"),
        ("st-flash", "--serial 0673"),
    ],
)
def test_one_of_several_boards_is_chosen_by_its_debugger(tool: str, words: str, built: Path, put_tool) -> None:
    calls = put_tool(tool)
    assert flash.main(["six", "--from", str(built), "--probe", "0673"]) == 0
    assert all(words in call for call in calls.read_text().splitlines()) and "antinode-six.bin" in calls.read_text()


def test_the_first_one_found_is_taken_unless_named(built: Path, put_tool) -> None:
    later, sooner = put_tool("st-flash"), put_tool("pyocd")
    assert flash.main(["single", "--from", str(built)]) == 0
    assert sooner.exists() and not later.exists()
    assert flash.main(["single", "--from", str(built), "--tool", "st-flash"]) == 0
    assert later.exists()


def test_pyocd_of_this_environment_is_enough(put_tool, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(flash, "find_spec", lambda name: name == "pyocd")
    assert flash.chosen_programmer(None)[1] == [sys.executable, "-m", "pyocd"]


def test_what_is_missing_is_said_with_how_to_get_it(built: Path, put_tool, capsys) -> None:
    assert flash.main(["single", "--from", str(built)]) == 5
    error = capsys.readouterr().err
    assert error.count("\n") == 1 and all(one.install in error for one in flash.PROGRAMMERS)
    assert flash.main(["single", "--from", str(built), "--tool", "openocd"]) == 5
    error = capsys.readouterr().err
    assert "apt install openocd" in error and "pip install pyocd" not in error


def test_a_programmer_that_fails_is_heard(built: Path, put_tool, capsys) -> None:
    put_tool("openocd", 1, "Info : clock\nError: open failed\nshutdown command invoked")
    assert flash.main(["single", "--from", str(built)]) == 3
    assert capsys.readouterr().err == "flash: openocd failed with exit code 1: Error: open failed\n"


def test_a_failed_write_is_not_followed_by_a_reset(built: Path, put_tool) -> None:
    calls = put_tool("probe-rs", 1)
    assert flash.main(["single", "--from", str(built)]) == 3
    assert len(calls.read_text().splitlines()) == 1


def test_an_image_that_is_not_built_is_said(tmp_path: Path, capsys) -> None:
    assert flash.main(["six", "--from", str(tmp_path)]) == 2
    assert "build it with `make firmware`" in capsys.readouterr().err


def test_the_board_may_keep_its_table(make_image, put_tool, capsys) -> None:
    image = make_image(TABLE)
    put_tool("openocd")
    assert flash.main(["single", "--from", str(image.elf.parent), "--keep-table"]) == 0
    assert "the board's table is kept" in capsys.readouterr().out
    code = image.elf.with_name("antinode-code.bin").read_bytes()
    whole, elf = image.binary.read_bytes(), Elf.read(image.elf)
    end = max(
        segment.load_address + len(segment.data) for segment in elf.segments if segment.load_address < flash.TABLE_START
    )
    assert whole[: end - flash.FLASH_START] == code[: end - flash.FLASH_START] and len(code) <= 48 * 1024
    assert TABLE in whole and TABLE not in code
