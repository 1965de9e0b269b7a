"""The wheel: one name in site-packages, and everything works from there (docs/decisions/0006)."""

from __future__ import annotations

import ast
import os
import re
import runpy
import shutil
import subprocess
import sys
import sysconfig
import tomllib
import venv
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
FOLDERS = ("geometry", "solvers", "pipeline", "studies", "firmware")
GENERIC = re.compile(rf"({'|'.join(FOLDERS)})((\.[a-z_0-9]+)+(:\w+)?)?")
LEFT_BEHIND = shutil.ignore_patterns(".*", "__pycache__", "*.egg-info", "build", "dist", "tests", "generated")
EVERY_MODULE = """
import importlib, pkgutil, antinode, antinode._lib, sys
from pathlib import Path
for module in pkgutil.walk_packages(antinode.__path__, "antinode."):
    if not module.name.endswith(("__main__", "peers.tetrahedra")):  # a script for an interpreter that has NGSolve
        importlib.import_module(module.name)
names = [name for name in ("geometry", "solvers", "pipeline", "studies", "firmware") if name in sys.modules]
places = [str(getattr(module, "__file__", "")) for module in list(sys.modules.values())]
print(names, [place for place in places if CHECKOUT in place and "site-packages" not in place])
"""
SWEEP = """
import antinode
plate = antinode.load("small.toml", accuracy=0.05, bands__points=2, bands__count=4)
print([row["status"] for row in antinode.sweep(plate, measure=["bands"], folder="sweep", rows=[1, 2])])
"""


@pytest.fixture(scope="module")
def built(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("built")
    runpy.run_path(str(ROOT / "setup.py"))["build"](ROOT, folder)
    return folder


def generic_names(source: str) -> list[str]:
    """Imports of the folders by their short names, and strings that name a module of theirs."""
    names = []
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.Import):
            names += [alias.name for alias in node.names if GENERIC.fullmatch(alias.name)]
        elif isinstance(node, ast.ImportFrom) and node.module and not node.level:
            names += [node.module] if GENERIC.fullmatch(node.module) else []
        elif isinstance(node, ast.Constant) and isinstance(node.value, str) and "." in node.value:
            names += [node.value] if GENERIC.fullmatch(node.value) else []
        elif isinstance(node, ast.JoinedStr) and node.values and isinstance(node.values[0], ast.Constant):
            first = str(node.values[0].value)
            names += [first] if GENERIC.fullmatch(first.rstrip(".:")) and first[-1] in ".:" else []
    return names


def test_a_build_holds_one_package_with_data_and_marker_of_types(built: Path) -> None:
    assert [entry.name for entry in built.iterdir()] == ["antinode"]
    for place in ("py.typed", "__init__.py", "__main__.py", "_lib/solvers/accuracy/calibration.csv"):
        assert (built / "antinode" / place).is_file(), place
    for place in ("docs/glossary.md", "results/reference/band_gap.csv", "studies/rows.toml", "firmware/host/rig.c"):
        assert (built / "antinode" / "_lib" / place).is_file(), place


@pytest.mark.slow
def test_nothing_in_a_build_asks_for_a_generic_name(built: Path) -> None:
    files = list(built.rglob("*.py"))
    assert len(files) > 250  # the search itself works
    planted = 'import geometry\nx = f"studies.{x}"\ny = "pipeline.cli.main:main"'
    assert set(generic_names(planted)) == {"geometry", "studies.", "pipeline.cli.main:main"}
    left = {str(file.relative_to(built)): generic_names(file.read_text(encoding="utf-8")) for file in files}
    assert not {name: generic for name, generic in left.items() if generic}


@pytest.mark.slow
def test_every_command_of_a_build_is_found_and_one_answers(built: Path, tmp_path: Path) -> None:
    """From the build alone, as a wheel installs it: handlers are named in a TOML file."""
    commands = tomllib.loads((built / "antinode/_lib/pipeline/cli/commands.toml").read_text())["commands"]
    for about in commands.values():
        module, _, function = about["run"].partition(":")
        file = built / f"{module.replace('.', '/')}.py"
        assert f"\ndef {function}(" in file.read_text(), about["run"]
    shutil.copy(ROOT / "examples" / "small.toml", tmp_path)
    words = [sys.executable, "-m", "antinode", "predesign", "small.toml"]
    done = subprocess.run(
        words, cwd=tmp_path, capture_output=True, text=True, env=os.environ | {"PYTHONPATH": str(built)}
    )
    assert done.returncode == 0 and "33.5" in done.stdout, done.stderr


def run(*words: str, folder: Path) -> str:
    done = subprocess.run(words, cwd=folder, capture_output=True, text=True, env={"PATH": "/usr/bin:/bin"})
    assert done.returncode == 0, f"{words}\n{done.stdout[-800:]}\n{done.stderr[-1500:]}"
    return done.stdout


@pytest.mark.slow
def test_a_wheel_in_an_empty_environment_has_one_name_and_works(tmp_path: Path) -> None:
    source, place, work = tmp_path / "source", tmp_path / "venv", tmp_path / "work"
    shutil.copytree(ROOT, source, ignore=LEFT_BEHIND)
    pip = (sys.executable, "-m", "pip", "--disable-pip-version-check")
    run(sys.executable, "-m", "build", "--no-isolation", "--outdir", str(tmp_path), str(source), folder=tmp_path)
    venv.create(place, with_pip=False)
    python, command = str(place / "bin" / "python"), str(place / "bin" / "antinode")
    packages = Path(
        run(python, "-c", "import sysconfig; print(sysconfig.get_paths()['purelib'])", folder=tmp_path).strip()
    )
    wheel = str(next(tmp_path.glob("*.whl")))
    run(*pip, "--python", python, "install", "-q", "--no-deps", "--no-index", wheel, folder=tmp_path)
    assert sorted(entry.name.partition("-")[0] for entry in packages.iterdir()) == ["antinode", "antinode"]
    (packages / "dependencies.pth").write_text(sysconfig.get_paths()["purelib"])  # without the .pth files in there
    work.mkdir()
    shutil.copy(ROOT / "examples" / "small.toml", work)
    assert "antinode" in run(command, "--version", folder=work)
    assert "strength" in run(command, "glossary", "strength", folder=work)
    assert "pillar" in run(command, "predesign", "small.toml", folder=work)
    run(command, "run", "rows", "--dry-run", folder=work)
    assert "OK" in run(python, "-c", SWEEP, folder=work)
    assert (work / "results").is_dir() and not (packages / "antinode" / "_lib" / "results" / ".cells").exists()
    loaded = run(python, "-c", EVERY_MODULE.replace("CHECKOUT", repr(str(ROOT))), folder=work)
    assert loaded.splitlines()[-1] == "[] []"
