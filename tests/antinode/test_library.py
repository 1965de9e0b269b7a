"""`import antinode`: the public face, its names, its documents beside the command line's."""

from __future__ import annotations

import dataclasses
import inspect
import json
import os
import re
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import antinode
from antinode import sweeps
from pipeline.batch.study_file import load_study
from pipeline.case.model import load_case
from pipeline.cli import explore
from pipeline.cli.main import main
from pipeline.questions import bands
from pipeline.questions.search import Search
from tests.helpers import fake_study, synthetic
from tests.helpers.at_once import sweep_here

pytestmark = pytest.mark.usefixtures("coarsest_cells")
ROOT = Path(__file__).resolve().parents[2]
SMALL = ROOT / "examples" / "small.toml"
NAMES = [
    "Air", "AntinodeWarning", "Array", "Attenuation", "BandPath", "Bands", "Broadband", "Crosstalk",
    "Drift",
    "Damping", "Finger", "Hybrid", "InputError", "Mode",
    "Modes", "Patches", "Pillar", "Plate", "Predesign", "Response", "Scatter", "Search", "Section", "Solve", "SolverError",
    "SweepTable", "Tolerance", "Touch", "Travel", "Target", "Zone", "__version__", "load", "open", "sweep",
]  # fmt: skip


@pytest.fixture(scope="module")
def plate() -> antinode.Plate:
    return antinode.load(SMALL, accuracy=0.1)


def test_the_public_names_are_these() -> None:
    assert sorted(antinode.__all__) == sorted(NAMES) and dir(antinode) == sorted(NAMES)
    for name in NAMES:
        assert getattr(antinode, name) is not None
    with pytest.raises(AttributeError, match="no attribute 'platte'"):
        antinode.platte  # noqa: B018


def test_a_plate_is_saved_for_any_folder_and_never_over_another_file(tmp_path: Path) -> None:
    for name in ("31-housing.toml", "33-measured.toml"):
        plate = antinode.load(ROOT / "examples" / name)
        saved = antinode.load(plate.save(tmp_path / name))
        assert saved == plate and saved.case.design == plate.case.design
    for wrong, why in (("housing.step", "must end in .toml"), ("no/plate.toml", "no folder")):
        with pytest.raises(antinode.InputError, match=why):
            plate.save(tmp_path / wrong)
    with pytest.raises(antinode.InputError, match=r"path = plate.jpg: must end in .png or .gif"):
        plate.view("plate.jpg")


@pytest.mark.slow
def test_a_warning_points_at_the_line_of_the_caller(plate: antinode.Plate) -> None:
    with pytest.warns(antinode.AntinodeWarning, match="of the pillar lies between 20 and 21 kHz") as seen:
        plate.modes((20.0, 21.0), part="pillar")
    assert seen[0].filename == __file__


def test_importing_it_loads_nothing_heavy() -> None:
    """Nothing but the standard library, so that it takes the milliseconds of a few small files, far below 0.3 s."""
    code = (
        "import sys; old = {*sys.modules}; import antinode; print(*{m.partition('.')[0] for m in {*sys.modules} - old})"
    )
    done = subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, check=True)
    assert set(done.stdout.split()) - set(sys.stdlib_module_names) == {"antinode"}


def test_every_public_object_says_what_it_is() -> None:
    for name in set(NAMES) - {"__version__"}:
        thing = getattr(antinode, name)
        assert inspect.getdoc(thing), name
        if inspect.isclass(thing) and thing.__module__.startswith("antinode"):
            kinds = (property, staticmethod, classmethod)
            open_ = [key for key, value in vars(thing).items() if not key.startswith("_")
                     and (callable(value) or isinstance(value, kinds))]  # fmt: skip
            assert all(inspect.getdoc(getattr(thing, key)) for key in open_), name


def test_a_plate_of_keywords_is_the_plate_of_the_file(plate: antinode.Plate) -> None:
    tables = plate.to_dict()
    made = antinode.Plate(
        name=tables["name"],
        material="aluminium",
        thickness_mm=2.0,
        zone=antinode.Zone(length_mm=56.0, width_mm=20.0, nodal_lines=4),
        pillar=antinode.Pillar(shape="square", side_mm=2.0, height_mm=6.3),
        array=antinode.Array(**tables["array"]),
        solve=antinode.Solve(**tables["solve"]),
        bands=antinode.BandPath(**tables["bands"]),
        damping=tables.get("damping"),
        patches=tables.get("patches"),
    )
    assert made == plate and hash(made) == hash(plate) and made != plate.with_(rows=2)


def test_another_plate_leaves_the_first_as_it_was(plate: antinode.Plate) -> None:
    other = plate.with_(pitch_mm=5.0, array__rows=2, material="steel")
    assert other.to_dict()["array"]["pitch_mm"] == 5.0 and other.case.design.rows == 2
    assert other.case.design.material.name == "steel" and plate.case.design.rows == 1
    assert plate.with_(height_mm=7.0).case.design.pillar.height_m == 7e-3  # no [tolerance] here, which has one, too


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"pich_mm": 4.0}, "did you mean pitch_mm"),
        ({"count": 6}, "solve__count, bands__count"),
        ({"pitch_mm": -1.0}, "array.pitch_mm"),
        ({"rows": "three"}, "array.rows"),
    ],
)
def test_what_cannot_be_changed_is_refused_in_words(plate: antinode.Plate, change: dict, said: str) -> None:
    with pytest.raises(antinode.InputError, match=said):
        plate.with_(**change)


@pytest.mark.slow
def test_modes_are_those_of_the_command(plate: antinode.Plate, tmp_path: Path) -> None:
    modes = plate.modes(part="pillar", count=3)
    args = ["modes", str(SMALL), "--part", "pillar", "--count", "3", "--set", "solve.accuracy=0.1"]
    assert main([*args, "--quiet", "--json", str(tmp_path / "m.json")]) == 0
    document = json.loads((tmp_path / "m.json").read_text())
    assert [mode["frequency_hz"] for mode in document["modes"]] == pytest.approx(modes.frequency_hz.tolist(), rel=1e-9)
    assert len(modes) == 3 and modes[0].symmetry in ("SA", "AS") and modes.target is None
    assert modes.error.tolist() == [mode.error for mode in modes] and 0.0 < modes[0].error < 0.1
    again = antinode.open(tmp_path / "m.json")
    assert isinstance(again, antinode.Modes) and [m.frequency_hz for m in again] == pytest.approx(modes.frequency_hz)
    with pytest.raises(ValueError, match="holds no shapes"):
        again[0].to_pyvista()


@pytest.mark.slow
def test_results_are_xarray_datasets_over_their_dimensions(plate: antinode.Plate) -> None:
    bands = plate.with_(bands__points=2, bands__count=4).bands()
    data = bands.to_xarray()
    assert data["frequency_hz"].dims == ("point", "band") and data["frequency_hz"].attrs["units"] == "Hz"
    assert data["frequency_hz"].values == pytest.approx(bands.frequencies_hz)
    pillar = plate.modes(part="pillar", count=3)
    assert pillar.to_xarray()["frequency_hz"].values == pytest.approx(pillar.frequency_hz)
    assert float(plate.predesign().to_xarray()["value"].sel(part="zone", quantity="frequency_hz")) > 30e3
    rows = [{"case": f"{x}{y}", "a.x": x, "a.y": y, "level_db": 10.0 * x + y} for x in (1, 2) for y in (1, 2, 3)]
    grid = antinode.SweepTable(rows, Path(), ("a.x", "a.y")).to_xarray()["level_db"]
    assert grid.shape == (2, 3) and float(grid.sel({"a.x": 2, "a.y": 3})) == 23.0 and grid.attrs["units"] == "dB"
    paired = antinode.SweepTable([rows[0], rows[4]], Path(), ("a.x", "a.y")).to_xarray()["level_db"]
    assert paired.dims == ("case",) and paired.shape == (2,)


def test_without_pandas_the_extra_is_named(plate: antinode.Plate, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "pandas", None)
    for ask in (plate.predesign().to_dataframe, plate.predesign().to_xarray):
        with pytest.raises(ImportError, match=r"antinode\[tables\]"):
            ask()


@pytest.mark.slow
def test_a_search_is_that_of_the_command_and_its_best_is_a_plate(plate: antinode.Plate, tmp_path: Path) -> None:
    settings = {"evaluations": 2, "mac": 0.3, "min_frequency_kHz": 20.0}
    search = plate.search(height_mm=(6.0, 6.6), **settings)
    args = [
        "search",
        str(SMALL),
        "--set",
        "solve.accuracy=0.1",
        "--vary",
        "pillar.height_mm=6:6.6",
        "--evaluations",
        "2",
    ]
    args += ["--mac", "0.3", "--min-frequency", "20kHz", "--quiet", "--json", str(tmp_path / "s.json")]
    assert main(args) == 0
    stored = antinode.open(tmp_path / "s.json")
    assert isinstance(stored, antinode.Search) and stored.best_values == search.best_values
    best = plate.with_(**stored.changes)
    assert best == plate.with_(pillar__height_mm=search.best_values["pillar.height_mm"])
    assert search.plot().get_ylabel() and len(search.to_dataframe()) == len(search.evaluations)


def test_a_searchs_method_has_the_options_of_its_question() -> None:
    own = inspect.signature(antinode.Plate.search).parameters
    assert {name: each.default for name, each in own.items() if name in Search.options} == {
        each.name: each.default for each in dataclasses.fields(Search) if each.name in Search.options.keys() - {"vary"}
    }


@pytest.mark.parametrize(
    ("settings", "said"),
    [
        ({"goal": "loudness", "height_mm": (5.0, 8.0)}, "must be confinement, extension, worst"),
        ({"height_mm": (8.0, 5.0)}, "low end must lie below"),
        ({"height_mm": np.array([np.int64(8), 5])}, "pillar.height_mm=8:5: the low end must lie below"),
        ({"height_mm": 5.0}, "pillar.height_mm = 5.0: must be two ends"),
        ({}, "at least one KEY"),
        ({"height_mm": (5.0, 8.0), "mac": 2.0}, "must be 0 or more, at most 1"),
    ],
)
def test_a_search_that_cannot_be_is_refused_in_words(plate: antinode.Plate, settings: dict, said: str) -> None:
    with pytest.raises(antinode.InputError, match=said):
        plate.search(**settings)


NONE = antinode.Target(status="none", frequency_hz=None, mac=None, strength=None, confinement_db=None)


def test_what_was_made_never_changes(plate: antinode.Plate) -> None:
    sizes = plate.predesign()
    row = antinode.SweepTable([{"case": "a", "level_db": 1.0}], Path())
    driven = synthetic.response(12.0)
    for frozen, name in ((plate, "name"), (plate, "colour"), (sizes, "zone_hz"), (sizes, "kind"), (row, "swept"),
                         (driven, "frequency_hz"), (NONE, "mac")):  # fmt: skip
        with pytest.raises(AttributeError):
            setattr(frozen, name, 1.0)
    with pytest.raises(TypeError):
        row[0]["level_db"] = 2.0
    peak = driven.target_peak
    assert peak is not None and peak.quality_factor == 298.0
    with pytest.raises(AttributeError):
        peak.frequency_hz = 1.0
    sizes.to_dict()["zone"]["frequency_hz"] = 0.0
    assert sizes.zone_hz > 30e3


def test_a_notebook_sees_the_plate_its_modes_and_its_table(plate: antinode.Plate) -> None:
    assert "<svg" in plate._repr_html_() and "56 × " in plate._repr_html_()
    assert "<svg" not in antinode.Plate(pillar=antinode.Pillar(side_mm=2.0, height_mm=6.0))._repr_html_()
    both = [
        antinode.Mode(frequency_hz=hz, symmetry="SS", mac=0.9, confinement_db=level, strength=0.2, residual=1e-12)
        for hz, level in ((30e3, 2.0), (34e3, None))
    ]
    found = {"frequency_hz": 34e3, "mac": 0.9, "strength": 0.2, "confinement_db": 11.0}
    page = synthetic.modes(antinode.Target(status="single", **found), both)._repr_html_()
    assert "<td><b>34.0 *</b></td>" in page and "<td>30.0</td>" in page and "(kHz)" in page


def test_parts_are_printed_in_words() -> None:
    found = {"frequency_hz": 34e3, "frequency_error": 1e-3, "mac": 0.9, "strength": 0.2, "confinement_db": 11.0}
    target = antinode.Target(status="single", **found)
    assert str(target) == "target mode: 34.000 ± 0.034 kHz, MAC 0.900, strength 0.200, 11.0 dB"
    assert str(NONE) == "target mode: none of the modes has the target shape"
    edges = {"lower_hz": 30e3, "upper_hz": 31e3, "lower_error": 1e-3, "upper_error": 1e-3}
    gap = bands.Gap(**edges, lower_band=3, upper_band=4)
    assert str(gap) == "Gap from band 3 (30.000 ± 0.030 kHz) to band 4 (31.000 ± 0.031 kHz), 3.28 %"
    only = bands.DirectionalGap(**edges, lower_band=3, upper_band=4, start="G", end="X")
    assert str(only) == "gap from G to X only: 30.000 to 31.000 kHz"
    head, *table = str(antinode.SweepTable([{"case": "a", "target_hz": 34e3}], Path("f"))).splitlines()
    assert head == "<antinode.SweepTable: 1 cases, 2 columns, f>" and [line.split() for line in table] == [
        ["case", "target", "(kHz)"],
        ["a", "34.0"],
    ]
    with pytest.raises(
        antinode.InputError, match=r"keywords: pillar\.height_mm and array\.heights_mm exclude each other"
    ):
        antinode.load("examples/small.toml", height_mm=6.0, heights_mm=[6.0])
    round_ = antinode.load("examples/small.toml").with_(side_mm=None, shape="round", diameter_mm=2.0)
    assert round_.pillar.diameter_mm == 2.0


def test_a_sweeps_table_is_drawn_kept_and_read_again(tmp_path: Path) -> None:
    rows = [
        {"case": f"{r}{h}", "array.rows": r, "pillar.height_mm": h, "confinement_db": level, "confined": level == 11.0}
        for r, h, level in ((1, 6.0, 3.5), (1, 6.3, None), (2, 6.0, 8.0), (2, 6.3, 11.0))
    ]
    table = antinode.SweepTable(rows, tmp_path, ("array.rows", "pillar.height_mm"))
    axes = table.plot(over="pillar.height_mm")
    assert [line.get_label() for line in axes.lines] == ["rows 1", "rows 2"]
    assert axes.lines[1].get_ydata().tolist() == [8.0, 11.0] and np.isnan(axes.lines[0].get_ydata()[1])
    assert table.plot(axes, column="confinement_db") is axes
    with pytest.raises(antinode.InputError, match="loudness: no such column"):
        table.plot(column="loudness")
    assert "<td>11.0</td>" in table._repr_html_()
    assert table.save(tmp_path / "table.csv") == tmp_path / "table.csv"
    for place in (tmp_path, tmp_path / "table.csv"):
        again = antinode.open(place)
        assert isinstance(again, antinode.SweepTable) and again.swept == table.swept and list(again) == list(table)
    (tmp_path / "said.csv").write_text("case,target_error,confined,array.stagger\na,0.0021,yes,false\nb,,no,true\n")
    assert antinode.open(tmp_path / "said.csv").to_dict() == {
        "case": ["a", "b"], "target_error": [0.0021, None], "confined": [True, False], "array.stagger": [False, True]
    }  # fmt: skip
    (tmp_path / "other.csv").write_text("a,b\n1,2\n")
    with pytest.raises(antinode.InputError, match="holds no table of a study"):
        antinode.open(tmp_path / "other.csv")


def test_the_explorer_is_asked_for_from_python(plate: antinode.Plate, monkeypatch: pytest.MonkeyPatch) -> None:
    made: list[Any] = []
    monkeypatch.setattr(explore, "explorer_of", lambda case, raw, overrides, log: made.append((case, raw)) or "model")
    monkeypatch.setattr(explore, "export", lambda explorer, path, log: made.append((explorer, path)))
    plate.with_(rows=2).explore("page.html")
    (case, raw), written = made
    assert case.design.rows == 2 and raw["array"]["rows"] == 2 and written == ("model", Path("page.html"))


def test_a_whole_table_is_put_in_or_left_out(plate: antinode.Plate) -> None:
    with_patches = plate.with_(patches=antinode.Patches(material="pz26", size_mm=(8.0, 3.0, 0.3)), patches__drive_V=2.0)
    assert with_patches.case.patches is not None and with_patches.to_dict()["patches"]["drive_V"] == 2.0
    assert with_patches.with_(patches=None) == plate


def test_a_band_whose_ends_fall_is_refused(plate: antinode.Plate) -> None:
    with pytest.raises(antinode.InputError, match="two rising numbers"):
        plate.modes(band_kHz=(34.0, 30.0))


def test_slips_are_answered_with_what_was_meant(plate: antinode.Plate) -> None:
    for slip, meant in {
        "modes(band=(30, 34))": "modes: band = (30, 34): no such option (did you mean band_kHz?)",
        "modes(mesh_file='a.msh')": "modes: mesh_file = 'a.msh': an option of mesh_modes",
        "modes('30kHz:34kHz')": "band_kHz = '30kHz:34kHz': must be two rising numbers in kHz",
        "bands(points=5)": "bands: points = 5: a key of the case: plate.with_(points=...).bands()",
        "export('stp')": "(did you mean step?)",
        "export('stl', '/nowhere/x.stl')": "path = /nowhere/x.stl: cannot be written",
        "respons": "'Plate' object has no attribute 'respons' (did you mean response?)",
        "solve": "to_dict()['solve'] has it",
        "patches": "the case has no table [patches]",
        "thickness_mm": "to_dict()['plate']['thickness_mm'] has it",
        "zone.width": "no such key: width (did you mean width_mm?)",
    }.items():
        with pytest.raises((antinode.InputError, AttributeError), match=re.escape(meant)):
            eval(f"plate.{slip}")
    with pytest.raises(AttributeError, match=r"did you mean Plate\?"):
        _ = antinode.Plates
    with pytest.raises(antinode.InputError, match=re.escape("pitch_mm = 5: must be a list of values")):
        antinode.sweep(plate, pitch_mm=5)


def test_bands_have_wavevectors_labels_and_errors(plate: antinode.Plate, tmp_path: Path) -> None:
    bands = plate.with_(bands__points=2, bands__count=4).bands()
    assert bands.frequencies_hz.shape == bands.error.shape == (7, 4) and bands.wavevectors_per_m.shape == (7, 2)
    assert bands.labels[0] == "G" and bands.labels[-1] == "G" and np.all(np.diff(bands.frequencies_hz, axis=1) >= -1e-6)
    assert antinode.open(bands.save(tmp_path / "b.json")).frequencies_hz == pytest.approx(bands.frequencies_hz)
    axes = bands.plot()
    assert len(axes.lines) >= 4 and axes.get_ylabel() == "frequency (kHz)" and bands.plot(axes) is axes
    assert "<img" in bands._repr_html_()
    count = len(bands.gaps)
    assert repr(bands).endswith(f", {count} complete gap>" if count == 1 else f", {count} complete gaps>")


@pytest.mark.slow
def test_a_modes_surface_is_closed_and_has_the_bodys_volume(plate: antinode.Plate) -> None:
    """Volume of the plate with its pillars by the divergence theorem over the surface, against length x width x height."""
    design = plate.case.design
    modes = plate.modes(near_kHz=31.0, count=1, symmetry="SS")
    surface = modes[0].to_pyvista()
    pillars = len(design.pillar_centres()) * 2e-3 * 2e-3 * 6.3e-3
    plain = design.length_m * 2.0 * design.half_span_m * design.thickness_m
    assert surface.is_manifold and surface.n_open_edges == 0
    assert modes.to_pyvista(0) == surface == modes.to_pyvista(modes[0])
    assert surface.volume == pytest.approx(plain + pillars, rel=1e-6)
    assert np.abs(surface["displacement"]).max() > 0.0
    pillar = plate.modes(part="pillar", count=1)[0].to_pyvista()
    assert pillar.n_open_edges == 0 and pillar.volume == pytest.approx(2e-3 * 2e-3 * 6.3e-3, rel=1e-6)


@pytest.mark.slow
def test_a_sweep_is_a_table_and_stands_when_asked_again(
    plate: antinode.Plate, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    sweep_here(monkeypatch)
    coarse = plate.with_(accuracy=0.1, bands__points=2, bands__count=4)
    table = antinode.sweep(coarse, measure=["bands"], folder=tmp_path / "s", jobs=1, pillar__height_mm=[6.0, 6.3])
    assert len(table) == 2 and [row["pillar.height_mm"] for row in table] == [6, 6.3]
    assert {row["status"] for row in table} <= {"OK", "WARNING"} and "diagnosis" in table.columns
    stamp = (tmp_path / "s" / "height_mm=6" / "record.json").stat().st_mtime_ns
    again = antinode.sweep(coarse, measure=["bands"], folder=tmp_path / "s", jobs=1, pillar__height_mm=[6.0, 6.3])
    assert list(again) == list(table)
    assert (tmp_path / "s" / "height_mm=6" / "record.json").stat().st_mtime_ns == stamp
    with pytest.raises(antinode.InputError, match="at least one key"):
        antinode.sweep(coarse)


SCRIPT = """
import antinode
from pipeline.batch import case_study
from tests.helpers import dying
open("runs.txt", "a").write("x")
case_study.computer, before = dying.computer, case_study.computer
plate = antinode.load({case!r}, accuracy=0.1, pillar=None, array__rows=0, bands__points=1, bands__count=3)
asked = dict(measure=[antinode.Bands], folder="two words", jobs=2, pitch_mm=[4.0, 5.0, 6.0])
table = antinode.sweep(plate, **asked)
print([row["status"] for row in table], [bands and bands.dof > 0 for bands in table.of(antinode.Bands)])
case_study.computer = before
print([row["status"] for row in antinode.sweep(plate, **asked)])
"""


@pytest.mark.slow
def test_a_worker_that_dies_costs_a_script_without_a_guard_one_case(tmp_path: Path) -> None:
    """Workers are started anew and would run the caller's script again; the next sweep computes what is missing alone."""
    (tmp_path / "script.py").write_text(SCRIPT.format(case=str(SMALL)))
    words = [sys.executable, "-W", "always::antinode.AntinodeWarning", "script.py"]
    environment = os.environ | {"PYTHONPATH": str(ROOT)}
    done = subprocess.run(words, cwd=tmp_path, capture_output=True, text=True, env=environment)
    assert done.returncode == 0, done.stderr[-800:]
    assert done.stdout.splitlines() == ["['OK', 'FAILED', 'OK'] [True, None, True]", "['OK', 'OK', 'OK']"]
    assert "CASE_FAILED: case pitch_mm=5 failed: the worker process was lost: ended by SIGKILL" in done.stderr
    assert (tmp_path / "runs.txt").read_text() == "x"
    entries = fake_study.journal(tmp_path / "two words")
    assert [each["case"] for each in entries if each["event"] == "started"][3:] == ["pitch_mm=5"]


def test_numbers_of_numpy_are_numbers() -> None:
    plate = antinode.load(SMALL).with_(pitch_mm=np.float64(4.5), rows=np.int64(2), heights_mm=np.linspace(6.0, 6.5, 2))
    array = plate.to_dict()["array"]
    assert (array["pitch_mm"], array["rows"], array["heights_mm"]) == (4.5, 2, [6.0, 6.5])
    assert type(array["pitch_mm"]) is float and type(array["rows"]) is int


def test_a_sweep_over_an_array_is_written_as_a_file_reads_it(tmp_path: Path) -> None:
    plate = antinode.load(SMALL, rows=np.int64(2))
    study = sweeps._study(plate, tmp_path, ["bands"], False, {"pitch_mm": np.linspace(4, 5, 3)})
    assert study.sweep == {"array.pitch_mm": (4, 4.5, 5)} and load_study(study.source) == study
    assert load_case(study.case_path).to_dict() == plate.case.to_dict()


def test_tables_are_attributes_and_a_missing_or_repeated_one_is_one_line(tmp_path: Path) -> None:
    plate = antinode.load(SMALL)
    assert (plate.zone.width_mm, plate.pillar.height_mm, plate.with_(rows=2).array.rows) == (20.0, 6.3, 2)
    assert plate.zone.nodal_lines == plate.case.design.nodal_lines and plate.array.extension_mm == 5.0
    with pytest.raises(antinode.InputError, match=r"plate: \[zone\]: missing"):
        _ = antinode.Plate(material="steel").zone
    two = antinode.load(str(SMALL.parent / "37-two-zones.toml"))
    with pytest.raises(antinode.InputError, match=r"\[zone\]: one of several: to_dict\(\) has them"):
        _ = two.zone
    with pytest.raises(antinode.InputError, match=r"must end in"):
        plate.export("stl", tmp_path / "plate.step")
    assert not list(tmp_path.iterdir())
