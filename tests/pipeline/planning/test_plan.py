"""The plan: each rule taken where it should be and not where it would change the answer; what is planned is what happens."""

from __future__ import annotations

import gc
import json
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import pytest

from geometry.layout import Pillar
from pipeline.batch import case_study
from pipeline.batch.study_file import load_study
from pipeline.case.limits import MIN_GAP
from pipeline.case.model import Case, case_from_dict, load_case
from pipeline.case.reading import read_toml
from pipeline.case.schema import ToleranceTable
from pipeline.cli.main import main
from pipeline.cli.study_commands import MANY_CASES
from pipeline.models import modes
from pipeline.paths import STUDIES
from pipeline.planning import mesh_rules, plan, simplifications
from pipeline.planning.model_choice import (
    Request,
    cell_model_choice,
    coarse_cell,
    driven_band_hz,
    model_choice_of,
    model_high_hz,
    of_case,
    response_high_hz,
)
from pipeline.planning.resources import in_time
from pipeline.questions import study as asked
from pipeline.questions.attenuation import Attenuation
from pipeline.questions.bands import Bands
from pipeline.questions.question import Run, ask
from pipeline.questions.response import Response
from pipeline.records import store
from solvers.analytic.predesign import predesign
from solvers.fem.assembly import System
from solvers.piezo.patch import bonded_patch
from solvers.piezo.patched_plate import coupled_classes
from tests.helpers.asked import attenuation_of, solve_bands
from tests.helpers.recording_log import RecordingLog

pytestmark = pytest.mark.usefixtures("coarsest_cells")
ROOT = Path(__file__).resolve().parents[3]
CASE = str(STUDIES / "three-rows.toml")
SMALL = [
    "zone.length_mm=28", "zone.nodal_lines=2", "zone.width_mm=18", "array.rows=1", "array.extension_mm=5",
    "solve.accuracy=0.05", "patches.centres_mm=[[-6.0,0.0],[6.0,0.0]]", "patches.sensors=[1]",
    "patches.size_mm=[4.0,3.0,0.3]", "solve.band_kHz=[25.0,45.0]",
]  # fmt: skip


def case(*overrides: str) -> Case:
    return load_case(CASE, overrides)


def small(*overrides: str) -> Case:
    return case(*SMALL, *overrides)


def with_pillar(shape: str) -> Case:
    """The reference case with a pillar of another shape; a STEP file is not read for a plan."""
    result = case()
    known = (("volume_m3", 25.2e-9),) if shape == "step" else ()
    pillar = Pillar(shape, 2e-3, 2e-3, 6.3e-3, result.design.material, more_m=known)
    return replace(result, design=replace(result.design, pillar=pillar))


def rules(planned: plan.Plan) -> set[str]:
    return {each.rule for each in planned.left_out}


def omissions(heard: RecordingLog) -> set[str]:
    return {f"{what}: {why}" for what, why in heard.omitted.items()}


# -- rules: taken, and not taken ---------------------------------------------------------------------------------------


def test_no_pillars_no_cells() -> None:
    bare = case("array.rows=0")
    assert simplifications.no_pillars(bare.design, "plate") and not simplifications.no_pillars(case().design, "plate")
    assert simplifications.alike_cells(case().design) and not simplifications.alike_cells(bare.design)
    assert simplifications.no_pillars(replace(bare.design, pillar=None), "cell")
    assert not simplifications.no_pillars(bare.design, "cell")  # its unit cell still has the pillar


def test_hexahedra_need_no_cad_and_what_they_cannot_follow_does() -> None:
    for part in ("plate", "zone", "pillar", "cell"):
        assert simplifications.hexahedra(case(), part)
        assert not simplifications.hexahedra(case("solve.mesh='tet'"), part)
    for shape in ("step", "round", "tapered"):
        for part in ("plate", "cell"):
            assert bool(simplifications.hexahedra(with_pillar(shape), part)) == (shape != "step")
        assert not simplifications.hexahedra(with_pillar(shape), "pillar")
        assert simplifications.hexahedra(with_pillar(shape), "zone")
    assert not simplifications.hexahedra(case("pillar.fillet_mm=0.2"), "plate")
    unused = with_pillar("step")
    assert simplifications.hexahedra(replace(unused, design=replace(unused.design, rows=0)), "plate")


def test_curved_hexahedra_are_for_reduced_panels_with_room_about_the_foot() -> None:
    one_face = with_pillar("round")
    solid = replace(one_face, solve=one_face.solve.but(model="solid"))
    for part in ("plate", "cell"):
        assert not simplifications.hexahedra(solid, part)
    flush = replace(one_face, design=replace(one_face.design, extension_m=0.0))
    assert not simplifications.hexahedra(flush, "plate") and simplifications.hexahedra(flush, "cell")
    tight = replace(one_face, design=replace(one_face.design, pitch_x_m=1.01 * one_face.design.footprint_m))
    assert not simplifications.hexahedra(tight, "cell") and not simplifications.hexahedra(tight, "plate")
    tapered = with_pillar("tapered")
    flush = replace(tapered, design=replace(tapered.design, extension_m=0.0))
    assert simplifications.hexahedra(flush, "plate"), "a square foot may stand at the plate's edge"


def test_mirror_images_end_with_a_step_pillar_and_with_scatter() -> None:
    design, step = case().design, with_pillar("step").design
    assert simplifications.mirror_images(design, "plate") and not simplifications.mirror_images(step, "plate")
    assert simplifications.mirror_images(step, "zone") and not simplifications.mirror_images(step, "pillar")
    assert simplifications.mirror_images(replace(step, rows=0), "plate")
    assert not simplifications.mirror_images(design, "plate", scattered=True)
    assert not simplifications.mirror_images(design, "zone", scattered=True)
    assert simplifications.alike_cells(design) and not simplifications.alike_cells(design, scattered=True)


def test_a_tolerance_breaks_every_mirror_and_the_sharing_of_cells() -> None:
    assert not simplifications.is_scattered(case())
    assert not simplifications.is_scattered(replace(case(), tolerance=ToleranceTable(samples=5)))
    for key in ("height_mm", "side_mm", "position_mm"):
        assert simplifications.is_scattered(replace(case(), tolerance=ToleranceTable(**{key: 0.01})))
    planned = asked.plan_of(case("tolerance.height_mm=0.05"), ["modes", "tolerance"])
    nominal, scattered = planned.steps
    assert {"mirror_images", "alike_cells"} <= {each.rule for each in nominal.left_out}
    assert not {"mirror_images", "alike_cells"} & {each.rule for each in scattered.left_out}
    assert scattered.classes == ("whole",) and scattered.numbers["samples"] == 20


def test_a_patch_off_a_mirror_plane_couples_the_classes_there() -> None:
    def groups(*centres: str) -> set[frozenset[str]]:
        patches = case(f"patches.centres_mm=[{','.join(centres)}]", "patches.sensors=[]").patches
        assert patches
        solver = [bonded_patch(patches.material, box, patches.size_m[2], True) for box in patches.boxes_m()]
        assert [list(group) for group in simplifications.patch_groups(patches)] == coupled_classes(solver)
        return {frozenset(group) for group in simplifications.patch_groups(patches)}

    apart = {frozenset([p]) for p in simplifications.CLASSES}
    assert groups("[0.0,0.0]") == apart == groups("[-20.0,0.0]", "[20.0,0.0]")
    assert groups("[20.0,0.0]") == {frozenset(["SS", "AS"]), frozenset(["SA", "AA"])}
    assert groups("[0.0,5.0]") == {frozenset(["SS", "SA"]), frozenset(["AS", "AA"])}
    assert groups("[20.0,5.0]") == {frozenset(simplifications.CLASSES)}
    assert groups("[-20.0,5.0]", "[20.0,-5.0]") == {frozenset(simplifications.CLASSES)}


def test_classes_that_no_patch_drives_are_silent() -> None:
    def undriven(*centres: str) -> str:
        patches = case(f"patches.centres_mm=[{','.join(centres)}]", "patches.sensors=[]").patches
        assert patches
        result = simplifications.undriven_classes(patches)
        return result.what if result else ""

    assert undriven("[0.0,0.0]") == "symmetry classes SA, AS, AA"
    assert undriven("[-20.0,0.0]", "[20.0,0.0]") == "symmetry classes SA, AA"
    assert undriven("[-20.0,5.0]", "[20.0,5.0]") == ""


def test_wavevectors_off_the_path_only_where_it_bounds_the_zone() -> None:
    square, step = case().design, with_pillar("step").design
    oblong = case("array.pitch_x_mm=4", "array.pitch_y_mm=6").design
    assert simplifications.off_path(square, "GXMG") and simplifications.off_path(square, "MGXM")
    assert not simplifications.off_path(square, "GX") and not simplifications.off_path(square, "GXYG")  # X-Y is oblique
    assert not simplifications.off_path(square, "GXMG", grid=4)
    assert simplifications.off_path(oblong, "GXMYG") and not simplifications.off_path(oblong, "GXMG")  # a larger zone
    assert not simplifications.off_path(step, "GXMG") and not simplifications.off_path(step, "GXMYG")


def test_the_path_that_nobody_gave_bounds_the_zone_of_the_pitches() -> None:
    raw = read_toml(Path(CASE))
    del raw["bands"]
    for overrides, path in (((), "GXMG"), (("array.pitch_x_mm=4", "array.pitch_y_mm=6"), "GXMYG")):
        result = case_from_dict(raw, Path(CASE), overrides)
        assert result.bands.path == path and simplifications.off_path(result.design, path)


def test_the_mirrors_of_the_cell() -> None:
    oblong = case("array.pitch_x_mm=4", "array.pitch_y_mm=6").design
    assert case().design.cell_mirrors == ("x", "y", "d")
    assert oblong.cell_mirrors == ("x", "y")
    assert with_pillar("step").design.cell_mirrors == ()
    assert simplifications.waves_downwards(oblong) and not simplifications.waves_downwards(with_pillar("step").design)


def test_patches_damping_modes_and_pictures_only_where_asked() -> None:
    everything = asked.plan_of(case(), ["modes", "bands", "attenuation", "response"])
    assert not {"no_patches", "no_response", "no_plate_modes", "no_lattice"} & rules(everything)
    some = asked.plan_of(case(), ["bands"])
    assert {"no_patches", "no_response", "no_plate_modes", "no_figures"} <= rules(some)
    assert "the case has none" in simplifications.no_patches(None, driven=True).why  # type: ignore[union-attr]
    assert simplifications.no_figures() and not simplifications.no_figures(drawn=True)
    assert [step.measure for step in asked.plan_of(case(), ["confinement", "attenuation"]).steps] == [
        "modes", "attenuation",
    ]  # fmt: skip


def test_no_lattice_without_pitch_or_pillars() -> None:
    bare = replace(case("array.rows=0"), patches=None)
    no_pillar = replace(bare, design=replace(bare.design, pillar=None))
    planned = asked.plan_of(no_pillar, ["modes", "bands", "attenuation"])
    assert [step.measure for step in planned.steps] == ["modes", "bands"]
    assert "no_lattice" in rules(planned) and "no_lattice" not in rules(asked.plan_of(case(), ["attenuation"]))
    no_pitch = replace(no_pillar, design=replace(no_pillar.design, pitch_x_m=float("nan")))
    assert [step.measure for step in asked.plan_of(no_pitch, ["modes", "bands"]).steps] == ["modes"]


def test_other_classes_and_other_frequencies() -> None:
    assert simplifications.other_classes(simplifications.CLASSES, "SS") and not simplifications.other_classes(
        simplifications.CLASSES, None
    )
    assert not simplifications.other_classes((None,), None)
    assert "below 25 kHz and above 45 kHz" in simplifications.other_frequencies((25e3, 45e3), None, None).what
    assert "beyond the 20 nearest 32 kHz" in simplifications.other_frequencies(None, 32e3, 20).what


def test_a_response_is_assembled_from_the_panels_of_the_modes() -> None:
    """Their windows end at 45 and 45.87 kHz: each its own cut-off once reduced every panel twice."""
    scene = case()
    modes = model_choice_of(scene, "plate", model_high_hz(scene, of_case(scene)))
    response = model_choice_of(scene, "plate", response_high_hz(scene, driven_band_hz(scene, None)))
    assert modes.reduction == response.reduction != model_choice_of(scene, "plate", 45e3).reduction


def test_models() -> None:
    assert model_choice_of(case(), "plate", 45e3).name == "superelement hex3"
    assert model_choice_of(case("solve.model='solid'"), "plate", 45e3).name == "solid hex3"
    step = model_choice_of(with_pillar("step"), "plate", 45e3)
    assert (step.name, step.classes) == ("superelement tet2", (None,))
    assert "mirror_images" not in {each.rule for each in step.left_out}
    assert cell_model_choice(case("solve.model='solid'")).name == "solid hex3"
    assert cell_model_choice(case("solve.model='solid'", "solve.mesh='tet'")).name == "superelement tet2"


def test_a_response_with_pillars_from_a_step_file_is_planned_whole() -> None:
    step = plan.response_step(with_pillar("step"), None, 11)
    assert step.classes == ("whole",)
    assert not {"mirror_images", "undriven_classes"} & {each.rule for each in step.left_out}


# -- what is planned is what happens -----------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("overrides", "request_"),
    [
        ((), Request("plate", symmetry="AS")),
        pytest.param(
            ("solve.model='solid'", "solve.accuracy=0.1"),
            Request("plate", near_hz=30e3, count=3, symmetry="SS"),
            marks=pytest.mark.slow,
        ),
        pytest.param((), Request("zone", count=2), marks=pytest.mark.slow),
        pytest.param((), Request("pillar"), marks=pytest.mark.slow),
        (("array.rows=0",), Request("plate", band_hz=(20e3, 30e3))),
    ],
)
def test_modes_are_solved_as_planned(overrides: tuple[str, ...], request_: Request) -> None:
    scene, heard = small(*overrides), RecordingLog()
    planned = plan.plan_of(scene, plan.modes_step(scene, request_), simplifications.no_patches(scene.patches))
    (step,) = planned.steps
    result = modes.solve_modes(scene, request_, heard)
    assert step.model.startswith(result.model.name)
    assert [name for name in heard.steps if name.startswith("solve class")] == [
        f"solve class {p}" for p in step.classes
    ]
    if "band_hz" in step.numbers:
        assert [result.count.low_hz, result.count.high_hz] == pytest.approx(step.numbers["band_hz"])
    else:
        assert len(result.rows) >= step.numbers["count"]
    promised = {f"{each.what}: {each.why}" for each in planned.left_out}
    assert omissions(heard) <= promised
    if step.numbers.get("order"):
        assert all(mesh.order == step.numbers["order"] for mesh in result.meshes)


@pytest.mark.slow
def test_bands_and_attenuation_are_solved_as_planned() -> None:
    scene, heard = small("bands.points=2", "bands.count=6"), RecordingLog()
    planned = Bands().plan(scene)
    result = solve_bands(scene, heard)
    numbers = planned.steps[0].numbers
    assert len(result.path.wavevectors) == numbers["wavevectors"] == 7
    assert f"{numbers['solved_wavevectors']} wavevectors" in heard.steps
    assert planned.steps[0].model.startswith(result.model)
    assert omissions(heard) <= {f"{each.what}: {each.why}" for each in planned.left_out}
    crossed = attenuation_of(scene, heard, points=3)
    step = Attenuation(points=3).plan(scene).steps[0]
    assert crossed.kx_per_m == step.numbers["kx_per_m"] and len(crossed.points) == step.numbers["frequencies"]
    assert [crossed.points[0].frequency_hz, crossed.points[-1].frequency_hz] == step.numbers["band_hz"]


@pytest.mark.slow
def test_a_response_couples_the_classes_that_were_planned() -> None:
    for centres in ("[[-6.0,0.0],[6.0,0.0]]", "[[-6.0,1.0],[6.0,0.0]]"):
        scene, heard = small(f"patches.centres_mm={centres}", "solve.band_kHz=[28.0,32.0]"), RecordingLog()
        question, run = Response(points=11), Run(heard)
        planned = question.plan(scene)
        ask(scene, question, run)
        solved = {" with ".join(group.symmetries) or "whole" for group in run.solved["forced"].plate.groups}
        assert solved == set(planned.steps[0].classes)
        assert omissions(heard) <= {f"{each.what}: {each.why}" for each in planned.left_out}


# -- told without computing --------------------------------------------------------------------------------------------


@pytest.mark.parametrize("command", ["modes", "bands", "attenuation", "response"])
def test_explain_computes_nothing(
    command: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def refuse(*_: object, **__: object) -> None:
        raise AssertionError("something was computed")

    for name in (
        "geometry.hex.boxes.hex_mesh",
        "pipeline.models.parts.hex_mesh",
        "pipeline.models.unit_cell.hex_mesh",
    ):
        monkeypatch.setattr(name, refuse)
    monkeypatch.setattr("solvers.plates.assembled.Reductions.cell", refuse)
    assert main([command, CASE, "--explain"]) == 0
    text = capsys.readouterr().out
    assert text.startswith("plan for three-rows") and "because" in text and "boxes: CAD and tetrahedra" in text
    assert main([command, CASE, "--explain", "--json", "-"]) == 0
    document = json.loads(capsys.readouterr().out)
    assert document["schema"] == 2 and document["steps"][0]["measure"] == command
    assert {"rule", "what", "why"} == set(document["left_out"][0])


@pytest.mark.parametrize(
    "arguments",
    [("bands", "--set", "solve.mesh=hex", "--set", "pillar.fillet_mm=0.2"), ("modes", "--mesh-file", "x.med")],
)
def test_explain_refuses_what_the_command_refuses(
    arguments: tuple[str, ...], capsys: pytest.CaptureFixture[str]
) -> None:
    command, *options = arguments
    assert main([command, CASE, *options, "--explain"]) == 2
    assert len(capsys.readouterr().err.strip().splitlines()) == 1


@pytest.mark.slow
def test_a_dry_run_tells_the_plan_of_each_case(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["run", "rows", "--dry-run", "--verbose"]) == 0
    text = capsys.readouterr().out
    cases = 1 + len(load_study("rows").cases())  # the unswept one too
    assert text.count("modes of the plate: superelement hex3") == text.count("left out: ") == cases
    assert "the plate and its cell with tetrahedra" in text
    assert text.count("interface polynomials of degree") >= cases <= text.count("fixed-interface modes to")


@pytest.mark.slow
def test_a_long_dry_run_is_cut_and_gives_the_time_of_all_cases(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    study = tmp_path / "many.toml"
    head = f'[study]\nname = "many"\ncase = "{CASE}"\nmeasure = ["modes"]\n[sweep]\n'
    study.write_text(f'{head}"pillar.height_mm" = [{", ".join(f"{6 + n / 100}" for n in range(30))}]\n')
    assert main(["run", str(study), "--dry-run"]) == 0
    *cases, last = capsys.readouterr().out.splitlines()
    assert sum(": would run" in line for line in cases) == MANY_CASES
    assert f"and {30 - MANY_CASES} more (--verbose lists every case with its plan)" in cases
    each = load_study(str(study)).cases()
    assert len(each) == 30 and "30 of 30 cases would run, roughly " in last
    jobs = case_study.jobs_of(load_study(str(study)), False)
    assert f"roughly {in_time(sum(job.forecast.seconds for job in jobs))} in all" in last
    assert min(job.forecast.seconds for job in jobs) > 0.0
    assert sum("roughly" in line for line in cases) == 1  # the plan of the most demanding case


@pytest.mark.slow
def test_a_dry_run_names_what_is_up_to_date(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(store, "why_recompute", lambda *about: None)
    assert main(["run", "rows", "--dry-run"]) == 0
    assert capsys.readouterr().out.count(": up to date\n") == 1 + len(load_study("rows").cases())


# -- a scene that has nothing does nothing -----------------------------------------------------------------------------

TRACE = """
import json, os, sys
from collections import Counter
from pathlib import Path
from pipeline.logs import RunLog
from pipeline.batch import case_study
from pipeline.case.model import load_case
calls = Counter()
def count(frame, event, argument):
    if event == "call":
        calls[frame.f_code.co_filename + ":" + frame.f_code.co_name] += 1
case, folder = sys.argv[1], Path(sys.argv[2])
payload = {"case": load_case(case).to_dict(), "overrides": [], "measure": sys.argv[3:]}
sys.setprofile(count)
with RunLog(folder / "run.mess") as log:
    record = case_study.compute(case, payload, folder, log)
sys.setprofile(None)
root = os.getcwd() + os.sep
ours = {name[len(root):]: n for name, n in calls.items() if name.startswith(root)}
print(json.dumps({"calls": ours, "modules": sorted(sys.modules), "record": record["plan"]}))
"""
WORK = {
    "pillars": (
        *(
            "geometry/hex/scenes.py:pillar_grading",
            "pipeline/planning/mesh_rules.py:_along",
            "geometry/pillar_shapes.py",
        ),
        *("solvers/thesis/scattering.py", "solvers/plates/strip.py"),
    ),
    "lattice": (
        "solvers/superelement/lattice.py",
        "solvers/waves/",
        "pipeline/models/bands.py",
        "pipeline/models/attenuation.py",
    ),
    "patches": ("solvers/piezo/", "pipeline/models/forced.py"),
    "response": ("pipeline/models/forced.py", "pipeline/board/export.py:modal_gains"),
    "CAD": ("geometry/cad/", "geometry/tet/", "pipeline/models/cross_check.py"),
    "drawing": ("pipeline/plots/", "pipeline/report/"),
}
HEAVY = {"cadquery", "OCP", "pytetwild", "vtk", "vtkmodules", "pyvista", "matplotlib", "trimesh", "meshio", "unicorn"}


def traced(folder: Path, text: str, *more: str) -> dict:
    """Calls by file and function, and the modules, of a case with modes and confinement, and with more measures."""
    (folder / "scene.toml").write_text(text)
    command = [sys.executable, "-c", TRACE, str(folder / "scene.toml"), str(folder), "modes", "confinement", *more]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout.splitlines()[-1])


BARE = (
    'name = "bare"\nmaterial = "aluminium"\n[plate]\nthickness_mm = 2.0\n[solve]\naccuracy = 0.05\n'
    "[zone]\nlength_mm = 40.0\nwidth_mm = 20.0\nnodal_lines = 3\n"
)


@pytest.mark.slow
def test_a_scene_without_pillars_patches_and_response_does_none_of_their_work(tmp_path: Path) -> None:
    result = traced(tmp_path, BARE)
    for what, places in WORK.items():
        done = {name: n for name, n in result["calls"].items() if name.startswith(places)}
        assert not done, f"{what}: {done}"
    assert not {name.partition(".")[0] for name in result["modules"]} & HEAVY
    assert not [
        name for name in result["modules"] if name.startswith(("solvers.piezo", "pipeline.plots", "solvers.waves"))
    ]
    assert {"no_pillars", "boxes", "mirror_images", "no_patches", "no_response", "no_figures"} <= {
        each["rule"] for each in result["record"]["left_out"]
    }
    assert any(name.startswith("solvers/superelement/plate.py") for name in result["calls"])  # the trace does count


FULL = (
    '[pillar]\nshape = "square"\nside_mm = 2.0\nheight_mm = 4.0\n[array]\npitch_mm = 8.0\nrows = 1\nextension_mm = 8.0\n'
    '[patches]\nmaterial = "pz26"\nsize_mm = [6.0, 3.0, 0.3]\nface = "back"\nat = "antinodes"\nsensors = [0]\n'
    "[bands]\npoints = 1\ncount = 4\n"
)


@pytest.mark.slow
def test_the_trace_sees_all_of_what_a_scene_does_ask_for(tmp_path: Path) -> None:
    """The same trace over a scene that has and asks for everything: so an empty count means something."""
    measures = ("bands", "attenuation", "response", "geometry")
    result = traced(tmp_path, BARE.replace("accuracy = 0.05", "accuracy = 0.1") + FULL, *measures)
    for what in WORK.keys() - {"drawing"}:  # a case never draws: its page does
        assert any(name.startswith(WORK[what]) for name in result["calls"]), what
    assert "cadquery" in result["modules"]


def test_the_target_window_reaches_to_the_zone_between_clamped_sides() -> None:
    """A zone narrower than half a wave: rows may hold its border so fast that 1.35 times the pinned zone lies too low."""
    for name in ("three-rows.toml", "glass-plate.toml"):
        design = load_case(STUDIES / name).design
        low, high = mesh_rules.target_window_hz(design)
        zone = predesign(design).zone
        assert zone and zone.clamped_hz and low < zone.frequency_hz < zone.clamped_hz <= high
    assert high > mesh_rules.WINDOW[1] * zone.frequency_hz


def test_the_window_of_a_rigid_shape_reaches_to_the_clamped_beam_across() -> None:
    """Cylindrical bending: (4.7300/pi)^2 = 2.2669 times the frequency between pinned sides."""
    for lines in (0, 1):
        design = load_case(STUDIES / "three-rows.toml", [f"zone.nodal_lines={lines}", "patches.sensors=[]"]).design
        low, high = mesh_rules.target_window_hz(design)
        assert high / low * mesh_rules.WINDOW[0] == pytest.approx(2.2669, rel=1e-4)


@pytest.mark.parametrize("shape", ["square", "tapered"])
def test_a_wall_beside_the_narrowest_gap_does_not_pass_for_the_cells_side(shape: str) -> None:
    side_mm = 4.0 / (1.0 + 1.001 * MIN_GAP)
    sizes = f"pillar.{'base' if shape == 'tapered' else 'side'}_mm={side_mm!r}"
    narrow = case("array.pitch_mm=4", f"pillar.shape={shape}", sizes, *(["pillar.tip_mm=1"] * (shape == "tapered")))
    assert coarse_cell(narrow.design, 6).bands_end_hz(0.9e6) > 0.0  # MeshError for sides that do not match


def test_many_coarse_cells_hold_the_matrices_of_one() -> None:
    """A search asks for the bands' end of many designs in one process: one cell's matrices may take 100 MB."""

    def held() -> int:
        gc.collect()
        return sum(isinstance(each, System) for each in gc.get_objects())

    before = held()
    cells = [coarse_cell(case(f"pillar.side_mm={side_mm}").design, 6) for side_mm in (2.0, 2.5, 3.0)]
    assert len({cell.bands_end_hz(0.9e6) for cell in cells}) == 3
    assert held() - before <= 1


@pytest.mark.slow
def test_the_end_of_bands_is_the_same_whatever_was_asked_before() -> None:
    """A coarse cell is kept for all cases of a design; within a factor of 1.2, another case's limit gives another end."""
    design, limits = case().design, (0.9e6, 1.2e6, 3.1e6)
    for limit in limits:
        coarse_cell.cache_clear()
        alone = coarse_cell(design, 6).bands_end_hz(limit)
        coarse_cell.cache_clear()
        assert [coarse_cell(design, 6).bands_end_hz(each) for each in (*limits, limit)][-1] == alone
