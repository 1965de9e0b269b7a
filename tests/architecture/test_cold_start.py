"""What each command loads: nothing heavy before it is needed. Times are measured by studies.benchmarks.cold_start, not here."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

from pipeline import questions

ROOT = Path(__file__).resolve().parents[2]
CASE = "studies/three-rows.toml"
RUN = """
import json, sys
import pipeline.cli.main
codes = []
for arguments in json.loads(sys.argv[1]):
    try:
        codes.append(pipeline.cli.main.main(arguments))
    except SystemExit as end:
        codes.append(end.code)
print(json.dumps({"codes": codes, "loaded": sorted(sys.modules)}), file=sys.stderr)
"""
CAD = {"cadquery", "OCP"}
MESHERS = {"pytetwild", "meshio", "trimesh", "gmsh"}
RENDERERS = {"vtk", "vtkmodules", "pyvista", "matplotlib", "PIL"}
BOARDS = {"unicorn", "cffi", "ziglang"}
CLUSTER = {"distributed", "dask"}
NUMBERS = {"numpy", "scipy"}
ALWAYS_LATE = CAD | MESHERS | RENDERERS | BOARDS | CLUSTER
OURS = {"geometry", "solvers"}
LATE_HERE = ("solvers.piezo", "solvers.control", "solvers.thesis", "solvers.shaping", "pipeline.plots")


def loaded_by(*commands: tuple[str, ...], code: int = 0, results: Path | None = None) -> set[str]:
    """Modules in a fresh process after commands that each ended with a code."""
    environment = os.environ | ({"ANTINODE_RESULTS": str(results)} if results else {})
    command = [sys.executable, "-c", RUN, json.dumps(commands)]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, env=environment)
    text = json.loads(done.stderr.splitlines()[-1])
    assert text["codes"] == [code] * len(commands), done.stderr
    return set(text["loaded"])


def packages(modules: set[str]) -> set[str]:
    return {name.partition(".")[0] for name in modules}


def test_help_loads_the_standard_library_alone() -> None:
    result = packages(loaded_by(("--help",), ("modes", "--help"), ("search", "--help"), ("run", "--help")))
    assert not result & (ALWAYS_LATE | NUMBERS | OURS | {"pydantic", "rich", "jinja2", "psutil"})


def test_help_loads_the_question_alone_that_it_is_about() -> None:
    listing, own = loaded_by(("--help",)), loaded_by(("bands", "--help"))
    assert not {"dataclasses", "pipeline.questions.question"} & listing
    assert "pipeline.questions.bands" in own and "pipeline.questions.modes" not in own


def test_the_index_of_questions_is_what_they_declare() -> None:
    held = json.loads(questions.INDEX.read_text(encoding="utf-8"))
    assert held == json.loads(json.dumps(questions.index())), "run python -m pipeline.questions"


def test_a_question_that_the_index_lacks_is_listed(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    held = json.loads(questions.INDEX.read_text(encoding="utf-8"))
    shorter = tmp_path / "index.json"
    shorter.write_text(json.dumps({name: words for name, words in held.items() if not name.endswith("touch")}))
    before = {each.name: each for each in questions.listed()}
    monkeypatch.setattr(questions, "INDEX", shorter)
    assert {each.name: each for each in questions.listed()} == before


def test_predesign_loads_numpy_and_no_scipy() -> None:
    result = packages(loaded_by(("predesign", CASE, "--json", "-")))
    assert "numpy" in result
    assert not result & (ALWAYS_LATE | {"scipy", "rich", "jinja2", "psutil"})


def test_a_tapered_pillar_asks_for_what_it_needs() -> None:
    """The exact shapes of a uniform pillar need no scipy; the series of a tapered one does, and then gets it."""
    tapered = ("--set", "pillar.shape=tapered", "--set", "pillar.base_mm=2", "--set", "pillar.tip_mm=1")
    assert "scipy" in packages(loaded_by(("predesign", CASE, *tapered, "--json", "-")))


def test_faults_of_the_input_are_told_before_anything_heavy_is_loaded() -> None:
    wrong = (("modes", "nothing.toml"), ("search", CASE, "--vary", "pillar.height_mm=8:5"), ("run", "nothing"))
    assert not packages(loaded_by(*wrong, code=2)) & (ALWAYS_LATE | {"scipy"})


@pytest.mark.slow
def test_plans_and_a_look_at_the_machine_load_no_cad_mesher_or_renderer() -> None:
    """Versions are asked for without importing."""
    plans = [(command, CASE, "--explain") for command in ("modes", "bands", "response")]
    assert not packages(loaded_by(*plans, ("run", "rows", "--dry-run"), ("doctor",))) & ALWAYS_LATE


def test_a_plan_of_modes_loads_no_scipy() -> None:
    assert not packages(loaded_by(("modes", CASE, "--explain"))) & (ALWAYS_LATE | {"scipy"})


def test_a_solve_of_boxes_loads_no_cad_mesher_or_renderer(tmp_path: Path) -> None:
    coarse = ("--set", "solve.accuracy=0.1", "--count", "1", "--quiet", "--json", str(tmp_path / "m.json"))
    result = loaded_by(("modes", CASE, "--part", "pillar", *coarse))
    assert "scipy" in packages(result) and not packages(result) & ALWAYS_LATE
    assert not {name for name in result if name.startswith(LATE_HERE)}


@pytest.mark.slow
def test_a_report_whose_pictures_stand_draws_nothing(tmp_path: Path) -> None:
    """The second time: tables and page from records, no renderer, no mesher, no solver."""
    code = (
        "import sys; from tests.helpers import synthetic; from pathlib import Path; "
        "from pipeline.report import page; "
        "folder = synthetic.put_study(Path(sys.argv[1]) / 'rows', pitches=(0.004,), rows=(1,)); "
        "page.build(folder)"
    )
    done = subprocess.run([sys.executable, "-c", code, str(tmp_path)], cwd=ROOT, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    result = packages(loaded_by(("report", "rows"), results=tmp_path))
    assert not result & (CAD | MESHERS | {"vtk", "vtkmodules", "pyvista"})
