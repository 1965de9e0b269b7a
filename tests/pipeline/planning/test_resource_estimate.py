"""Memory and work are told before anything is computed; what cannot fit is refused; running out is one line."""

from __future__ import annotations

import ast
import json
import re
import time
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import psutil
import pytest

from geometry.supports import Support
from pipeline.batch import case_study
from pipeline.case.model import Case, case_from_dict, load_case
from pipeline.case.schema import known_keys
from pipeline.cli.main import main
from pipeline.errors import InputError
from pipeline.logs import RunLog, TerminalLog
from pipeline.models.unit_cell import MARGIN, _coarse_pilot, _piloted
from pipeline.paths import ROOT
from pipeline.planning import plan
from pipeline.planning.model_choice import ModelChoice, Request, cell_model_choice
from pipeline.planning.resource_estimate import _cell_changes
from pipeline.planning.resources import GIB, MEMORY_RANGE, shortfall
from pipeline.questions.bands import Bands
from solvers import machine
from solvers.errors import OutOfMemory
from solvers.machine import GROUP_FILES, available_bytes
from studies.benchmarks.resource_estimate import CELLS, DRIVEN, SCENES, taken

SCREWED = str(ROOT / "examples" / "30-screwed-plate.toml")
SMALL, REFERENCE = str(ROOT / "examples" / "small.toml"), str(ROOT / "studies" / "three-rows.toml")
SOFT = "pillar.material={young_GPa=0.07,density_kg_m3=1000.0,poisson=0.4}"
TOO_LARGE = {
    "solid at 1e-4": ("modes", REFERENCE, "--set", "solve.model=solid", "--set", "solve.accuracy=1e-4", "--near", "38kHz",
                      "--count", "2"),
    "count": ("modes", SMALL, "--part", "zone", "--count", "10000"),
    "a million panels": ("modes", REFERENCE, "--set", "pillar.side_mm=0.01", "--set", "array.pitch_mm=0.12", "--set",
                           "array.rows=500"),
    "as many pillars in one mesh": ("modes", REFERENCE, "--set", "pillar.side_mm=0.01", "--set", "array.pitch_mm=0.12",
                                    "--set", "array.rows=500", "--set", "solve.model=solid"),
    "forty lines": ("modes", SMALL, "--part", "zone", "--set", "zone.nodal_lines=40"),
    "thin plate": ("modes", SMALL, "--set", "plate.thickness_mm=0.02"),
    "soft pillar": ("bands", SMALL, "--set", SOFT, "--set", "solve.accuracy=5e-4",
                    "--set", "bands.count=80"),
}  # fmt: skip


@pytest.fixture
def sixteen_gib(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(machine.STATED, "16")


def refuse_to_mesh(monkeypatch: pytest.MonkeyPatch) -> None:
    def forbidden(*_: Any) -> None:
        raise AssertionError("meshed before it was foreseen")

    for module in ("pipeline.models.parts", "pipeline.models.unit_cell"):
        monkeypatch.setattr(f"{module}.hex_mesh", forbidden)
    monkeypatch.setattr("solvers.plates.assembled.panel_mesh", forbidden)
    monkeypatch.setattr("solvers.plates.assembled.tile", forbidden)


@pytest.mark.parametrize("name", TOO_LARGE)
def test_what_cannot_fit_is_refused_before_anything_is_meshed(
    name: str, monkeypatch: pytest.MonkeyPatch, sixteen_gib: None, capsys: pytest.CaptureFixture[str]
) -> None:
    refuse_to_mesh(monkeypatch)
    begin = time.process_time()
    assert main([*TOO_LARGE[name], "--quiet"]) == 2
    # a tenth of it on an idle machine: nothing may grow with the scene but the coarse solve of a cell with its bands
    assert time.process_time() - begin < (15.0 if name == "soft pillar" else 3.0)
    (line,) = [line for line in capsys.readouterr().err.splitlines() if line.startswith("antinode: ")]
    assert "GiB of memory" in line and "only 16 GiB is available: " in line and "solve.accuracy" in line


RUBBER = {"young_GPa": 1.175e-4, "poisson": 0.46875, "density_kg_m3": 1300.0}
SQUAT = {
    "name": "squat stubs of silicone",
    "material": "aluminium",
    "plate": {"thickness_mm": 1.0},
    "pillar": {"shape": "round", "diameter_mm": 7.0, "height_mm": 5.0, "material": RUBBER},
    "array": {"pitch_mm": 10.0},
    "bands": {"points": 8, "count": 16},
}


@pytest.mark.slow
def test_stubs_wider_than_high_are_not_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    """A beam of their height would put the sixteenth band three times too high, and thirty times as many modes below it."""
    monkeypatch.setenv(machine.STATED, "4")
    (demand,) = Bands().plan(case_from_dict(SQUAT)).demands.values()
    assert shortfall(demand) is None and demand.functions and demand.functions < 600
    assert list(demand.finer_bytes) == sorted(demand.finer_bytes) and len(demand.finer_bytes) == 2


STOUT = {
    "name": "stubs on a plate as thick as the pitch",
    "material": "aluminium",
    "plate": {"thickness_mm": 10.0},
    "pillar": {"shape": "round", "diameter_mm": 7.0, "height_mm": 10.0},
    "array": {"pitch_mm": 10.0},
    "bands": {"points": 2, "count": 16},
    "solve": {"accuracy": 0.01},
}


@pytest.mark.slow
def test_the_functions_foreseen_are_those_that_coarse_cells_advise() -> None:
    """They raise cut-off and degree of a plan's first reduction, to three times the functions here."""
    case = case_from_dict(STOUT)
    (demand,) = Bands().plan(case).demands.values()
    reduction, corners = (
        cell_model_choice(case).reduction,
        np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0]]) * np.pi / 10e-3,
    )
    assert reduction and demand.functions
    pilot = _coarse_pilot(case.design, case.bands.count)
    advised = _piloted(
        pilot, reduction, corners, case.bands.count, MARGIN * case.solve.accuracy, TerminalLog(quiet=True), 0.0
    )
    functions = pilot.lattice(advised).dof
    assert pilot.lattice(reduction).dof < 0.5 * functions < demand.functions < 2.0 * functions


def test_the_changes_proposed_name_keys_that_there_are() -> None:
    case = case_from_dict(SQUAT)
    changes = [*_cell_changes(case, cell_model_choice(case)), *_cell_changes(case, solid(case))]
    keys = [key for change in changes for key in re.findall(r"[a-z]+\.[a-z_]+", change)]
    assert {"bands.count", "solve.accuracy", "solve.model"} <= {*keys} <= {*known_keys()}
    assert not any(change.startswith("or ") for change in changes)


def solid(case: Case) -> ModelChoice:
    """The choice of a cell solved as meshed."""
    return replace(cell_model_choice(case), model="solid")


def test_the_line_names_what_helps_most(sixteen_gib: None, capsys: pytest.CaptureFixture[str]) -> None:
    assert main([*TOO_LARGE["solid at 1e-4"]]) == main([*TOO_LARGE["count"]]) == 2
    solid, count = (line for line in capsys.readouterr().err.splitlines() if line.startswith("antinode: "))
    assert 'set solve.model = "superelement"' in solid
    assert "request fewer modes (a lower count)" in count


def test_explain_tells_memory_degrees_of_freedom_modes_and_time(
    sixteen_gib: None, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main([*TOO_LARGE["forty lines"], "--explain"]) == 0
    text = capsys.readouterr().out
    for words in (
        "estimate: ",
        "; largest system ",
        "modes; roughly ",
        "will not run: needs about",
    ):
        assert words in text
    assert main(["bands", SMALL, "--explain", "--json", "-"]) == 0
    (step,) = json.loads(capsys.readouterr().out)["steps"]
    low, high = step["foreseen"]["memory_range_bytes"]
    assert low < step["foreseen"]["memory_bytes"] < high
    assert step["foreseen"]["functions"] > 0 and step["foreseen"]["seconds"] > 0.0


def test_a_case_of_a_study_is_refused_before_its_first_step(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    refuse_to_mesh(monkeypatch)
    monkeypatch.setenv(machine.STATED, "0.1")
    payload = {"case": load_case(SMALL).to_dict(), "overrides": [], "measure": ["modes", "bands"]}
    with (
        RunLog(tmp_path / "run.mess") as log,
        pytest.raises(InputError, match=r"modes of the plate: needs about") as fault,
    ):
        case_study.compute(SMALL, payload, tmp_path, log)
    assert len(fault.value.lines) == 2  # the bands too, told at once


def test_only_what_lies_above_the_upper_end_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    demand = plan.modes_step(load_case(SMALL), Request("zone")).demand
    assert demand
    needed = MEMORY_RANGE[1] * demand.memory_bytes / 2**30
    monkeypatch.setenv(machine.STATED, f"{1.01 * needed}")
    assert shortfall(demand) is None
    monkeypatch.setenv(machine.STATED, f"{0.99 * needed}")
    assert shortfall(demand)


# -- what there is -----------------------------------------------------------------------------------------------------


def test_the_least_of_machine_group_and_limit_counts(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv(machine.STATED, raising=False)
    monkeypatch.setattr(machine, "_groups", lambda: [tmp_path])
    monkeypatch.setattr(machine, "_process_rooms", lambda: [])
    free = available_bytes()
    for limit, used in GROUP_FILES:
        (tmp_path / limit).write_text("300000000\n")
        (tmp_path / used).write_text("100000000\n")
        assert available_bytes() == 2e8 < free
        (tmp_path / limit).write_text("max\n")
    monkeypatch.setattr(machine, "_process_rooms", lambda: [1e8])
    assert available_bytes() == 1e8


def test_a_limit_of_addresses_counts_what_is_taken(monkeypatch: pytest.MonkeyPatch) -> None:
    resource = pytest.importorskip("resource", reason="a system without resource limits")
    taken = psutil.Process().memory_info().vms
    limits = {resource.RLIMIT_AS: taken + 10**9}
    unlimited = resource.RLIM_INFINITY
    monkeypatch.setattr(resource, "getrlimit", lambda kind: (limits.get(kind, unlimited), unlimited))
    (room,) = machine._process_rooms()
    assert 0.5e9 < room < 1.5e9


# -- running out -------------------------------------------------------------------------------------------------------


def test_memory_that_runs_out_is_one_line(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    monkeypatch.setattr("solvers.fem.solid.assemble", lambda *_: np.empty((1 << 30, 1 << 20)))
    assert main(["modes", SMALL, "--part", "zone", "--quiet"]) == 3
    (line,) = capsys.readouterr().err.splitlines()
    assert "memory ran out in the step 'solve class" in line
    assert "8.39e+06 GiB were requested at once" in line or "8388608 GiB were requested at once" in line
    assert "raise solve.accuracy" in line


def test_memory_that_runs_out_in_a_case_names_its_step(tmp_path: Path) -> None:
    for log in (TerminalLog(quiet=True), RunLog(tmp_path / "run.mess")):
        with pytest.raises(OutOfMemory, match="in the step 'a step'"), log.step("a step"):
            raise MemoryError


# -- warnings ----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("lines", "short"), [(14, False), (15, True)])
def test_waves_as_short_as_two_thicknesses_are_told(
    lines: int, short: bool, capsys: pytest.CaptureFixture[str]
) -> None:
    """56 mm over 14 half-waves are 4 mm, two thicknesses."""
    assert main(["predesign", SMALL, "--set", f"zone.nodal_lines={lines}", "--quiet"]) == 0
    assert ("warning SHORT_WAVE" in capsys.readouterr().err) is short


@pytest.mark.slow
def test_a_soft_pillar_s_many_functions_are_told(
    monkeypatch: pytest.MonkeyPatch, sixteen_gib: None, capsys: pytest.CaptureFixture[str]
) -> None:
    class Begun(Exception):
        pass

    def begin(*_: Any) -> None:
        raise Begun

    monkeypatch.setattr("pipeline.models.bands.lattice_model", begin)
    for more, text in (
        ([], 0),
        (["--set", SOFT], 0),
        (["--set", SOFT, "--set", "bands.count=80", "--set", "solve.accuracy=0.003"], 1),
    ):
        main(["bands", SMALL, *more, "--quiet"])
        assert capsys.readouterr().err.count("warning MANY_FUNCTIONS") == text


# -- the estimate ------------------------------------------------------------------------------------------------------


def peak_is_foreseen(name: str) -> bool:
    """Whether memory lies in the range that the program states; `python -m studies.benchmarks` compares the times."""
    (low, high), took = MEMORY_RANGE, taken(name)
    ratio = took.peak_bytes / took.foreseen_bytes
    print(f"{name}: {ratio:.2f} of the estimate")
    return low < ratio < high


@pytest.mark.slow
@pytest.mark.parametrize("name", ["zone small", pytest.param("plate small", marks=pytest.mark.slow)])
def test_peaks_lie_where_they_are_foreseen(name: str) -> None:
    assert peak_is_foreseen(name)


LIKE_ANOTHER = ("zone 3e-4", "zone steel", "plate thin", "plate pitch 10", "bands 1e-3")  # benchmarks have them, too


@pytest.mark.slow
@pytest.mark.parametrize("name", [name for name in SCENES if name not in ("zone small", "plate small", *LIKE_ANOTHER)])
def test_peaks_of_large_scenes_lie_where_they_are_foreseen(name: str) -> None:
    assert peak_is_foreseen(name)


@pytest.mark.slow
@pytest.mark.parametrize("name", DRIVEN)
def test_peaks_of_driven_plates_lie_where_they_are_foreseen(name: str) -> None:
    assert peak_is_foreseen(name)


def test_screws_take_memory_and_time_that_the_plan_knows() -> None:
    """Each that is no other's image: four in mirrored places are one, and a fifth elsewhere makes them five."""
    disc = "{kind='clamp', at_mm=[%g, %g], radius_mm=1.5}"
    four = [disc % (x, y) for x in (13.0, -13.0) for y in (11.5, -11.5)]
    free, one, many = (
        plan.modes_step(
            load_case(SCREWED, [f"support=[{', '.join(own)}]"]), Request("plate", band_hz=(3e4, 6e4))
        ).demand
        for own in ([], four, [*four, disc % (3.0, 11.5)])
    )
    assert free and one and many
    assert one.memory_bytes > 1.5 * free.memory_bytes and one.seconds > free.seconds + 2.0
    assert many.seconds - free.seconds > 4.0 * (one.seconds - free.seconds)


def test_a_driven_plate_holds_more_than_one_class_and_its_patches() -> None:
    """K and M of every class joined with the patches stay, and those of the last one's coarser mesh beside them."""
    case = load_case(REFERENCE, ["tolerance.height_mm=0.05"])
    modes = plan.modes_step(case, Request("plate", band_hz=case.solve.band_hz)).demand
    assert modes
    response, tolerance = plan.response_step(case, None, 11).demand, plan.tolerance_step(case, None).demand
    one = load_case(REFERENCE, ["patches.centres_mm=[[0.0, 0.0]]", "patches.sensors=[]"])
    own = plan.response_step(one, None, 11).demand
    assert own and response and tolerance
    assert modes.least_bytes < own.least_bytes < response.least_bytes < tolerance.least_bytes


@pytest.mark.slow
@pytest.mark.parametrize("name", CELLS)
def test_a_cell_takes_what_is_foreseen(name: str) -> None:
    assert peak_is_foreseen(name)


@pytest.mark.slow
def test_a_heavy_tip_on_a_soft_neck_is_not_taken_for_many_functions() -> None:
    """The cell's own modes are counted on a coarse mesh; a smeared mass had 6000 where 20 lie below the cut-off."""
    (demand,) = Bands().plan(load_case(SMALL, CELLS["neck and cap"].split()[3::2])).demands.values()
    assert demand.functions and demand.functions < 300 and max(demand.finer_bytes) < 8.0 * GIB


def test_a_plate_on_soft_foam_is_kept_once_and_one_on_stiff_foam_twice() -> None:
    """Without soft supports its modes follow; the estimate is then that of the plate without any."""
    case = load_case(ROOT / "studies" / "large-display.toml")
    (foam,) = case.design.supports

    def most(*supports: Support) -> float:
        own = replace(case, design=replace(case.design, supports=supports))
        return plan.modes_step(own, Request()).demand.cost.peak.bytes

    stiff = most(replace(foam, bedding_n_m2=1e7))
    assert most(foam) == pytest.approx(most(), rel=1e-6) and stiff > 1.05 * most(foam)
    assert most(replace(foam, kind="simple", bedding_n_m2=0.0)) == pytest.approx(stiff, rel=1e-6)


@pytest.mark.slow
def test_every_key_that_a_text_names_is_one_of_the_schema() -> None:
    """What looks like a key of a case in any string of the program, docstrings apart, is a key, a table or a file."""
    keys = {*known_keys()}
    tables, sections = {key.rpartition(".")[0] for key in keys}, sorted({key.partition(".")[0] for key in keys})
    pattern = re.compile(rf"(?<![\w./\[-])((?:{'|'.join(sections)})(?:\.\w+)+)(?![\w(.*/-])")
    unknown = {
        (path.name, named)
        for folder in ("geometry", "solvers", "pipeline")
        for path in (ROOT / folder).rglob("*.py")
        for text in _texts(ast.parse(path.read_text(encoding="utf-8")))
        for named in pattern.findall(text)
        if not (named in keys | tables or named.endswith(".toml"))
    }
    assert not unknown


def _texts(tree: ast.AST) -> list[str]:
    """The strings of a module with a space in them, without its docstrings."""
    bodies = (node.body for node in ast.walk(tree) if isinstance(node, ast.Module | ast.ClassDef | ast.FunctionDef))
    docs = {id(body[0].value) for body in bodies if body and isinstance(body[0], ast.Expr)}
    strings = (node for node in ast.walk(tree) if isinstance(node, ast.Constant) and id(node) not in docs)
    return [node.value for node in strings if isinstance(node.value, str) and " " in node.value]
