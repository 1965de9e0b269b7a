"""Which way imports go, and what a light command must not load."""

from __future__ import annotations

import json
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
FOLDERS = ("antinode", "geometry", "solvers", "pipeline", "studies", "firmware")
# `python -m importlinter.cli` defines its commands, runs none and ends with 0: call the function.
LINT = "import sys; from importlinter.cli import lint_imports; sys.exit(lint_imports(no_cache=True, no_logo=True))"
RUN = """
import json, sys
import pipeline.cli.main
try:
    code = pipeline.cli.main.main(json.loads(sys.argv[1]))
except SystemExit as end:
    code = end.code
print(json.dumps({"code": code, "loaded": sorted({name.partition(".")[0] for name in sys.modules})}), file=sys.stderr)
"""
DRAWING_AND_MESHING = {"cadquery", "OCP", "vtk", "vtkmodules", "pyvista", "pytetwild", "trimesh", "meshio"}


def lint(folder: Path) -> subprocess.CompletedProcess[str]:
    return subprocess.run([sys.executable, "-c", LINT], cwd=folder, capture_output=True, text=True)


def loaded_by(*arguments: str) -> set[str]:
    """Top-level modules in a fresh process after a command that ended well."""
    command = [sys.executable, "-c", RUN, json.dumps(arguments)]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    text = json.loads(done.stderr.splitlines()[-1])
    assert text["code"] == 0, done.stderr
    return set(text["loaded"])


def test_imports_go_one_way() -> None:
    done = lint(ROOT)
    assert done.returncode == 0, done.stdout + done.stderr
    assert re.search(r"\b[1-9]\d* kept, 0 broken", done.stdout), done.stdout


@pytest.mark.parametrize(
    ("importer", "imported"),
    [("geometry", "solvers"), ("solvers", "pipeline"), ("pipeline", "studies"), ("firmware", "geometry")],
)
def test_an_import_against_the_direction_is_seen(importer: str, imported: str, tmp_path: Path) -> None:
    for path in (
        path for folder in FOLDERS for path in (ROOT / folder).rglob("*.py")
    ):  # the same checkout, every folder empty
        (tmp_path / path.relative_to(ROOT)).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / path.relative_to(ROOT)).touch()
    shutil.copy(ROOT / "pyproject.toml", tmp_path)
    (tmp_path / importer / "wrong.py").write_text(f"def late():\n    import {imported}\n")
    done = lint(tmp_path)
    assert done.returncode != 0, done.stdout
    assert f"{importer}.wrong -> {imported}" in done.stdout, done.stdout + done.stderr


def test_help_loads_nothing_heavy() -> None:
    heavy = DRAWING_AND_MESHING | {"numpy", "scipy", "matplotlib", "pydantic", "rich"}
    assert loaded_by("--help") & heavy == set()


def test_predesign_loads_no_cad_mesher_or_renderer() -> None:
    loaded = loaded_by("predesign", "studies/three-rows.toml", "--json", "-")
    assert "numpy" in loaded  # it did compute in that process
    assert loaded & DRAWING_AND_MESHING == set()
