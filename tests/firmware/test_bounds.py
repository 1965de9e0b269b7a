"""The longest paths through the interrupts' code, from the code itself, for each compiler that is here."""

from __future__ import annotations

import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from firmware import build as builder
from firmware import image
from firmware.mode_table import MAX_MODES, MAX_SHAPES, Mode, ModeTable, Pattern, Shape, to_bytes

ALLOWED = {"single": {"an_fast_tick": 90, "an_slow_step": 380}, "six": {"an_six_tick": 300}}
TABLE = to_bytes(ModeTable(250e3, bytes(16), (Mode.from_quality_factor(31404.5, 300.0),)))


@pytest.fixture(scope="module", params=["arm-none-eabi-gcc", "zig"])
def compiler(request, tmp_path_factory: pytest.TempPathFactory):
    """Builds both images with a given compiler, or skips."""
    which = shutil.which
    with pytest.MonkeyPatch.context() as patch:
        if request.param == "zig":
            patch.setattr(builder.shutil, "which", lambda name: None if "arm-none-eabi" in name else which(name))
        elif not which(request.param):
            pytest.skip(f"{request.param} is not installed: its code is what this test measures")
        try:
            builder.toolchain()
        except builder.BuildError as missing:
            pytest.skip(str(missing))
        folder = tmp_path_factory.mktemp(request.param)
        return {variant: builder.build(TABLE, folder, variant).elf for variant in builder.VARIANTS}


@pytest.mark.slow
@pytest.mark.parametrize(("variant", "routine"), [(v, name) for v, names in ALLOWED.items() for name in names])
def test_no_path_is_longer_than_allowed(compiler: dict[str, Path], variant: str, routine: str) -> None:
    assert image.bound(compiler[variant], routine) <= ALLOWED[variant][routine]


PAGE = Path(__file__).parents[2] / "docs" / "board" / "loop.md"
COLUMNS = {"zig": 1, "arm-none-eabi-gcc": 2}


def published(row: str, column: int) -> list[int]:
    """The numbers in a column of a row of the page's table."""
    (cells,) = (
        [cell.strip() for cell in line.split("|")[1:-1]] for line in PAGE.read_text().splitlines() if row in line
    )
    return [int(number.replace(" ", "")) for number in cells[column].split(",")]


@pytest.mark.slow
def test_the_page_has_these_figures(compiler, request) -> None:
    """Sizes within a percent and paths within two instructions, for the versions in the table's head."""
    name = request.node.callspec.params["compiler"]
    (head,) = [line for line in PAGE.read_text().splitlines() if line.startswith("| longest path, size |")]
    version = head.split("|")[1 + COLUMNS[name]].split()[1]
    if not version_of(name).startswith(version):
        pytest.skip(f"the page's figures are those of {name} {version}")
    paths = [image.bound(compiler[variant], routine) for variant, names in ALLOWED.items() for routine in names]
    shown = [*published("| fast tick, slow step", COLUMNS[name]), *published("| six-channel tick", COLUMNS[name])]
    assert paths == pytest.approx(shown, abs=2)
    sizes = [builder.sizes(image.Elf.read(compiler[variant])) for variant in builder.VARIANTS]
    for row, own in zip(("| flash, single", "| RAM, single"), zip(*sizes, strict=True), strict=True):
        assert published(row, COLUMNS[name]) == pytest.approx(own, rel=0.01)


def test_the_manual_is_short() -> None:
    assert len((PAGE.parent.parent / "bring-up.md").read_text().splitlines()) <= 150


def version_of(name: str) -> str:
    command = [sys.executable, "-m", "ziglang", "version"] if name == "zig" else [name, "-dumpfullversion"]
    return subprocess.run(command, capture_output=True, text=True, check=True).stdout.strip()


@pytest.mark.slow
def test_a_loop_has_no_bound(compiler: dict[str, Path]) -> None:
    with pytest.raises(image.Unbounded, match="loop"):
        image.bound(compiler["single"], "an_crc32")


@pytest.mark.slow
def test_both_images_fit_with_the_largest_table_of_their_kind(compiler: dict[str, Path]) -> None:
    """A table adds its own length."""
    modes = tuple(Mode.from_quality_factor(20e3 + 500.0 * index, 300.0) for index in range(MAX_MODES))
    shapes = (Shape(2400.0, 5e-3, (Pattern("all", (1.0,) * 6),)),) * MAX_SHAPES
    largest = {"single": {"modes": modes}, "six": {"modes": (), "shapes": shapes}}
    for variant, elf in compiler.items():
        flash, ram = builder.sizes(image.Elf.read(elf))
        more = len(to_bytes(ModeTable(250e3, bytes(16), **largest[variant]))) - len(TABLE)
        assert more > 0 and flash + more <= builder.FLASH_LIMIT and ram <= builder.RAM_LIMIT
