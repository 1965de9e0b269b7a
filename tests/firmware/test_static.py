"""What compilers and checkers can tell without running the code."""

from __future__ import annotations

import shutil
import subprocess
import sys
from importlib.util import find_spec
from pathlib import Path

import pytest

from firmware import build as builder
from firmware.build import BOARD
from firmware.host import CORE, PLACES
from firmware.mode_table import header_text

ROOT = Path(builder.__file__).parent
TABLE = header_text(b"table")
STRICT = (
    "-Wpedantic -Wcast-qual -Wcast-align -Wundef -Wunused -Wvla -Wformat=2 -Wswitch-default -Wnull-dereference".split()  # noqa: SIM905
)

CPPCHECK = str(Path(sys.executable).with_name("cppcheck"))  # the pinned one: others report other things
TARGET = ["--target=thumbv7em-none-eabihf", "-mcpu=cortex-m4", "-ffreestanding", "-std=c11"]
CHECKERS = "core,deadcode,nullability,optin.core,optin.portability,security,unix"
REGISTERS = "core.FixedAddressDereference"  # they lie at fixed addresses
ANALYZER = ["--analyze", "-Xclang", "-analyzer-werror", "-Xclang", f"-analyzer-checker={CHECKERS}"]
ANALYZER += ["-Xclang", f"-analyzer-disable-checker={REGISTERS}"]
TIDY = ["-*", "bugprone-*", "cert-*", "clang-analyzer-*", "-bugprone-easily-swappable-parameters"]
TIDY += ["-bugprone-signed-bitwise", "-bugprone-integer-division", "-bugprone-branch-clone"]
TIDY += [f"-clang-analyzer-{REGISTERS}"]


def run(command: list[str]) -> None:
    done = subprocess.run(command, capture_output=True, text=True)
    assert done.returncode == 0, done.stdout[-3000:] + done.stderr[-3000:]


@pytest.mark.slow
@pytest.mark.parametrize("source", sorted(str(path.relative_to(CORE)) for path in CORE.rglob("*.c")))
def test_gcc_finds_nothing(source: str, tmp_path: Path) -> None:
    if not shutil.which("gcc"):
        pytest.skip("gcc is not installed: its analyzer is what this test runs")
    flags = [*builder.LANGUAGE, *builder.WARNINGS, *STRICT, "-fanalyzer", "-Wstack-usage=1024", "-O2", *PLACES]
    run(["gcc", *flags, "-c", str(CORE / source), "-o", str(tmp_path / "out.o")])


@pytest.mark.parametrize("source", sorted(str(path.relative_to(BOARD)) for path in BOARD.rglob("*.c")))
def test_gcc_finds_nothing_in_the_board_s_code(source: str, tmp_path: Path) -> None:
    """As 32-bit code of this machine, up to the assembler: registers are numbers, and nothing is run."""
    if not shutil.which("gcc"):
        pytest.skip("gcc is not installed: its analyzer is what this test runs")
    (tmp_path / "mode_table.h").write_text(TABLE)
    path = BOARD / source
    places = [*PLACES, *(f"-I{part}" for part in (BOARD, path.parent, tmp_path))]
    flags = [*builder.LANGUAGE, *builder.WARNINGS, *STRICT, "-Wno-pedantic", "-fanalyzer", "-O2", "-m32", *places]
    run(["gcc", *flags, "-S", str(path), "-o", str(tmp_path / "out.s")])


def test_cppcheck_finds_nothing() -> None:
    keep = [
        "--suppress=missingIncludeSystem",
        "--suppress=unusedFunction",
        "--suppress=CastAddressToIntegerAtReturn",
        "--inline-suppr",
        "--quiet",
    ]
    run(
        [
            CPPCHECK,
            "--enable=warning,performance,portability",
            "--error-exitcode=1",
            *keep,
            *PLACES,
            *(f"-I{part}" for part in (BOARD, BOARD / "single", BOARD / "six")),
            str(CORE),
            str(BOARD),
        ]
    )


def sources_and_places(variant: str, tmp_path: Path) -> tuple[list[str], list[str]]:
    """What a build compiles, core and board (what both share in the first alone), and where it looks for headers."""
    (tmp_path / "mode_table.h").write_text(TABLE)
    parts = (CORE / variant, BOARD / variant, CORE, BOARD)
    own = parts if variant == "single" else parts[:2]
    sources = [str(path) for part in own for path in sorted(part.glob("*.c"))]
    return sources, [f"-I{part}" for part in (*parts, tmp_path)]


@pytest.mark.slow
@pytest.mark.parametrize("variant", builder.VARIANTS)
def test_clang_s_analyzer_finds_nothing(variant: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Core and board as the Cortex-M4 gets them, by zig's own clang."""
    spec = find_spec("ziglang")
    if spec is None:
        pytest.skip("zig is not installed: its clang's analyzer is what this test runs")
    sources, places = sources_and_places(variant, tmp_path)
    headers = ["-isystem", str(Path(spec.origin or "").parent / "lib" / "include")]
    monkeypatch.chdir(tmp_path)
    run([sys.executable, "-m", "ziglang", "clang", *TARGET, *ANALYZER, *headers, *places, *sources])


@pytest.mark.slow
@pytest.mark.parametrize("variant", builder.VARIANTS)
def test_clang_tidy_finds_nothing(variant: str, tmp_path: Path) -> None:
    if not shutil.which("clang-tidy"):
        pytest.skip("clang-tidy is not installed")
    sources, places = sources_and_places(variant, tmp_path)
    run(
        [
            "clang-tidy",
            "--quiet",
            f"--checks={','.join(TIDY)}",
            "--warnings-as-errors=*",
            *sources,
            "--",
            *TARGET,
            *places,
        ]
    )


def test_the_core_keeps_to_single_precision_and_has_no_globals_that_change() -> None:
    for path in sorted(CORE.rglob("*.[ch]")):
        lines = path.read_text().splitlines()
        assert not any("double" in line.split() for line in lines), path.name
        state = [
            line
            for line in lines
            if line.startswith("static ") and line.endswith(";") and "(" not in line and "const" not in line
        ]
        assert state == [], path.name
