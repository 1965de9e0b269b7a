"""The image: built, small, repeatable, and holding the table it was given."""

from __future__ import annotations

import shutil
import subprocess
import sys
from pathlib import Path
from xml.etree import ElementTree

import pytest

from firmware import build as builder
from firmware.host import PLACES
from firmware.image import Elf, svd_text
from firmware.image import main as analyse
from firmware.mode_table import MAX_SHAPES, Mode, ModeTable, Pattern, Shape, describe, from_bytes, header_text, to_bytes

TABLE = ModeTable(250e3, bytes(range(16)), (Mode.from_quality_factor(31404.5, 300.0, delay_s=2e-6),))
SECTOR = 0x0800C000


@pytest.fixture(scope="module")
def image(tmp_path_factory: pytest.TempPathFactory) -> builder.Image:
    try:
        builder.toolchain()
    except builder.BuildError as missing:
        pytest.skip(str(missing))
    return builder.build(to_bytes(TABLE), tmp_path_factory.mktemp("image"))


def test_image_fits(image: builder.Image) -> None:
    assert 4096 < image.flash_bytes <= 32 * 1024
    assert 1024 < image.ram_bytes <= 16 * 1024


def test_the_six_channel_image_fits_with_as_many_shapes_as_there_may_be(make_image) -> None:
    shapes = tuple(Shape(hz, 1e-2, (Pattern("all", (1.0,)),)) for hz in (2e3, 1e3))
    built = make_image(to_bytes(ModeTable(40e3, bytes(16), (Mode(2e3, 1e-2),), shapes=shapes)), "six")
    assert len(shapes) == MAX_SHAPES
    assert built.flash_bytes <= builder.FLASH_LIMIT and built.ram_bytes <= builder.RAM_LIMIT


def test_binary_starts_with_stack_and_reset_and_holds_the_table_in_its_sector(image: builder.Image) -> None:
    binary, elf = image.binary.read_bytes(), Elf.read(image.elf)
    assert int.from_bytes(binary[:4], "little") == elf.symbols["stack_top"].address
    assert int.from_bytes(binary[4:8], "little") == elf.symbols["Reset_Handler"].address | 1
    data = to_bytes(TABLE)
    at = SECTOR - builder.FLASH_START
    assert binary[at : at + len(data)] == data


@pytest.mark.slow
def test_image_is_repeatable_from_another_folder(image: builder.Image, tmp_path: Path) -> None:
    copy = tmp_path / "elsewhere"
    root = Path(builder.__file__).parent
    shutil.copytree(root, copy / "firmware", ignore=shutil.ignore_patterns("build", "generated", "__pycache__"))
    (copy / "table.bin").write_bytes(to_bytes(TABLE))
    command = [sys.executable, "-m", "firmware.build", "--table", "table.bin", "--out", "out"]
    done = subprocess.run(command, cwd=copy, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    assert "flash" in done.stdout and "RAM" in done.stdout
    for built in (image.binary, image.elf, image.map, image.svd):
        assert (copy / "out" / built.name).read_bytes() == built.read_bytes(), built.name


def test_the_debug_information_is_there_and_names_no_place_of_this_machine(image: builder.Image) -> None:
    content, elf = image.elf.read_bytes(), Elf.read(image.elf)
    assert b".debug_info\0" in content and b"worst_cycles\0" in content and b"./firmware/core" in content
    for place in (builder.ROOT, image.elf.parent.resolve(), Path(sys.prefix).resolve(), Path.home()):
        assert str(place).encode() not in content, place
    assert elf.file["e_entry"] == elf.symbols["Reset_Handler"].address | 1
    assert len(image.binary.read_bytes()) <= 64 * 1024


def test_the_map_tells_where_everything_lies(image: builder.Image) -> None:
    elf = Elf.read(image.elf)
    rows = [line.split() for line in image.map.read_text().splitlines()[1:]]
    listed = {name: (int(address, 16), int(size)) for address, size, name in rows}
    assert {".text", ".table", ".bss", ".stack"} <= listed.keys()
    assert listed["an_fast_tick"] == (elf.symbols["an_fast_tick"].address, elf.symbols["an_fast_tick"].size)
    assert sum(size for name, (_, size) in listed.items() if name in (".text", ".table", ".data")) == image.flash_bytes
    assert (
        sum(size for name, (_, size) in listed.items() if name in (".stack", ".noinit", ".data", ".bss"))
        <= image.ram_bytes
    )
    addresses = [int(address, 16) for address, _, _ in rows]
    assert addresses == sorted(addresses)


def test_the_register_description_has_the_manuals_addresses(image: builder.Image) -> None:
    """RM0390: of each peripheral a register, by base and offset."""
    result = {}
    for peripheral in ElementTree.parse(image.svd).getroot().iter("peripheral"):
        base = int(peripheral.findtext("baseAddress"), 16)
        for one in peripheral.iter("register"):
            result[f"{peripheral.findtext('name')}.{one.findtext('name')}"] = (
                base + int(one.findtext("addressOffset"), 16),
                one.findtext("size"),
            )
    assert result["RCC.AHB1ENR"] == (0x40023830, "32")
    assert result["TIM1.BDTR"] == (0x40010044, "32")
    assert result["GPIOB.IDR"] == (0x40020410, "32")
    assert result["DMA2.stream0_CR"] == (0x40026410, "32")
    assert result["DMA1.stream6_M0AR"] == (0x400260AC, "32")
    assert result["ADC1.DR"] == (0x4001204C, "32")
    assert result["SCB.SHPR10"] == (0xE000ED22, "8") and result["SCB.CPACR"] == (0xE000ED88, "32")
    assert not [name for name in result if "unused" in name]


def test_a_register_of_an_unknown_type_is_refused() -> None:
    with pytest.raises(ValueError, match="the unknown type 'double'"):
        svd_text("typedef struct {\n reg A; double B;\n} x_regs;")
    with pytest.raises(ValueError, match="X is of the unknown type 'y_regs'"):
        svd_text("#define X ((y_regs *)0x40000000u)")


def test_core_calls_nothing_but_itself(image: builder.Image, tmp_path: Path) -> None:
    _, command = builder.toolchain()
    for source in sorted(builder.CORE.rglob("*.c")):
        target = tmp_path / f"{source.stem}.o"
        options = [builder.optimised(source), *builder.LANGUAGE, *builder.SECTIONS, *PLACES]
        builder.run([*command, *options, "-c", str(source), "-o", str(target)])
        undefined = [one.name for one in Elf.read(target).all_symbols if one["st_shndx"] == "SHN_UNDEF"]
        assert [name for name in undefined if not name.startswith("an_")] == [], source.name


def test_a_header_is_taken_as_it_is(tmp_path: Path) -> None:
    header = tmp_path / "mode_table.h"
    header.write_text(header_text(to_bytes(TABLE)))
    assert builder.choose_table(None, header) == to_bytes(TABLE)


@pytest.mark.parametrize(
    ("variant", "frequency_hz", "words"),
    [
        ("six", 31e3, "no shape at 40000 samples"),
        ("single", 1500.0, "a mode at 1500 Hz, the single build requires at least 2000 Hz"),
    ],
)
def test_a_table_that_the_board_would_refuse_is_not_built_in(
    tmp_path: Path, capsys, variant: str, frequency_hz: float, words: str
) -> None:
    table = to_bytes(ModeTable(250e3, bytes(16), (Mode(frequency_hz, 3e-3),)))
    (tmp_path / "t.bin").write_bytes(table)
    assert builder.main(["--table", str(tmp_path / "t.bin"), "--out", str(tmp_path), "--variant", variant]) == 2
    assert words in capsys.readouterr().err
    assert ("not usable on any board" in describe(from_bytes(table))) == (frequency_hz < 2e3)


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (b"nonsense", "another kind of file"),
        (to_bytes(TABLE)[:-1], "truncated"),
        (to_bytes(TABLE)[:-1] + bytes([to_bytes(TABLE)[-1] ^ 1]), "damaged"),
    ],
)
def test_a_damaged_table_is_refused_in_one_line(tmp_path: Path, capsys, content: bytes, words: str) -> None:
    (tmp_path / "t.bin").write_bytes(content)
    assert builder.main(["--table", str(tmp_path / "t.bin"), "--out", str(tmp_path)]) == 2
    error = capsys.readouterr().err
    assert words in error and error.count("\n") == 1


@pytest.mark.parametrize("option", ["--table", "--header"])
def test_a_table_that_is_not_there_is_named_with_the_option(tmp_path: Path, capsys, option: str) -> None:
    assert builder.main([option, str(tmp_path / "none"), "--out", str(tmp_path)]) == 2
    error = capsys.readouterr().err
    assert f"{option} {tmp_path / 'none'}: " in error and "No such file or directory)" in error and "Errno" not in error
    assert error.count("\n") == 1


def test_a_folder_that_cannot_be_made_is_named(tmp_path: Path, capsys, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "t.bin").write_bytes(to_bytes(TABLE))
    (tmp_path / "file").write_text("no folder")
    monkeypatch.setattr(builder, "toolchain", lambda *_: ("cc", []))
    assert builder.main(["--table", str(tmp_path / "t.bin"), "--out", str(tmp_path / "file")]) == 2
    said = f"firmware: --out {tmp_path / 'file'}: Not a directory: must be a folder that can be written\n"
    assert capsys.readouterr().err == said


def test_a_file_that_is_no_image_is_refused_in_one_line(tmp_path: Path, capsys) -> None:
    pytest.importorskip("elftools")
    (tmp_path / "t.bin").write_bytes(to_bytes(TABLE))
    for name, words in (("t.bin", "not an ELF file"), ("none", "No such file or directory")):
        assert analyse([str(tmp_path / name), "an_fast_tick"]) == 2
        error = capsys.readouterr().err
        assert error.startswith(f"bounds: {tmp_path / name}: {words}") and error.count("\n") == 1


def test_no_table_is_said_with_the_way_to_get_one(tmp_path: Path, capsys) -> None:
    assert builder.main(["--header", str(tmp_path / "none.h"), "--out", str(tmp_path)]) == 2
    assert "antinode export table" in capsys.readouterr().err


def test_what_is_missing_is_said_with_the_way_to_get_it(
    tmp_path: Path, capsys, monkeypatch: pytest.MonkeyPatch
) -> None:
    table = tmp_path / "table.bin"
    table.write_bytes(to_bytes(ModeTable(250e3, bytes(16), (Mode.from_quality_factor(31404.5, 300.0),))))
    monkeypatch.setattr(builder, "find_spec", lambda name: None if name == "elftools" else True)
    assert builder.main(["--table", str(table), "--out", str(tmp_path)]) == 5
    assert "pip install pyelftools" in capsys.readouterr().err
