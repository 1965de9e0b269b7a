"""Bands, shapes, responses and impedances in the formats of others, read back by others' readers."""

from __future__ import annotations

import csv
import json
from functools import partial
from pathlib import Path

import numpy as np
import pytest
import pyuff
import pyvista
import yaml
from meshio.xdmf import TimeSeriesReader
from scipy.spatial import cKDTree
from vtkmodules.vtkIOHDF import vtkHDFReader

from geometry.lattice import Lattice
from pipeline.case.model import Case, load_case
from pipeline.cli.main import main
from pipeline.exchange import exports
from pipeline.measured import files
from pipeline.measured.synthetic import grid
from pipeline.models.forced import forced_plate
from pipeline.questions.question import ask
from pipeline.questions.response import Response
from solvers.piezo.forced import ForcedPlate
from solvers.piezo.responses import admittance, circuit_shift, face_motion, point_response
from tests.helpers.recording_log import RecordingLog

pytestmark = pytest.mark.usefixtures("coarsest_cells")
ROOT = Path(__file__).resolve().parents[3]
SMALL = str(ROOT / "examples" / "small.toml")
COARSE = ["solve.accuracy=0.1", "bands.points=3", "bands.count=7"]
BAND = "solve.band_kHz=[25, 29]"
PATCH = "patches={material='pz26', size_mm=[8.0, 3.0, 0.3], centres_mm=[[0.0, 0.0]]}"


def written(form: str, place: Path, *more: str) -> Path:
    """The file that `antinode export` wrote."""
    settings = [word for text in (*COARSE, *more) for word in ("--set", text)]
    assert main(["export", form, SMALL, *settings, "-o", str(place), "--quiet"]) == 0
    return place


@pytest.fixture(scope="module")
def driven() -> tuple[Case, ForcedPlate]:
    case = load_case(SMALL, [*COARSE, PATCH])
    return case, forced_plate(case, RecordingLog(), None, [])


@pytest.fixture(scope="module")
def responses(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The response of the plate with one patch as a universal file."""
    return written("uff", tmp_path_factory.mktemp("uff") / "plate.uff", PATCH)


@pytest.fixture(scope="module")
def shapes(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Some modes for ParaView."""
    return written("paraview", tmp_path_factory.mktemp("vtk") / "modes.vtkhdf", BAND)


@pytest.mark.slow
@pytest.mark.parametrize("form", exports.ONE_FILE)
def test_one_file_goes_to_standard_output_alone(
    form: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfdbinary: pytest.CaptureFixture[bytes]
) -> None:
    monkeypatch.chdir(tmp_path)
    more = (PATCH, BAND) if form in ("driven", "uff", "impedance") else (BAND,)
    place = written(form, tmp_path / f"x{'.csv' if form == 'impedance' else exports.ENDINGS[form][0]}", *more)
    capfdbinary.readouterr()
    written(form, Path("-"), *more)
    assert len(capfdbinary.readouterr().out) == place.stat().st_size and list(tmp_path.iterdir()) == [place]


@pytest.mark.slow
def test_phonopys_file_has_the_bands_of_the_command(tmp_path: Path) -> None:
    data = yaml.safe_load(written("phonopy", tmp_path / "band.yaml").read_text())
    settings = [word for text in COARSE for word in ("--set", text)]
    assert main(["bands", SMALL, *settings, "--quiet", "--json", str(tmp_path / "b.json")]) == 0
    points = json.loads((tmp_path / "b.json").read_text())["points"]
    assert (
        (data["npath"], data["nqpoint"], data["segment_nqpoint"])
        == (3, 12, [4, 4, 4])
        == (3, len(data["phonon"]), [4] * 3)
    )
    assert data["labels"] == [["G", "X"], ["X", "M"], ["M", "G"]]
    ours = [points[i] for start in (0, 3, 6) for i in range(start, start + 4)]
    for theirs, point in zip(data["phonon"], ours, strict=True):
        tones = [1e12 * band["frequency"] for band in theirs["band"]]
        assert tones == pytest.approx(point["frequencies_hz"], rel=1e-9)
    corners = [data["phonon"][i]["q-position"] for i in (0, 3, 7)]
    assert np.allclose(corners, [[0, 0, 0], [0.5, 0, 0], [0.5, 0.5, 0]])
    length = (1.0 + np.sqrt(0.5)) / 4e7  # of Γ-X-M-Γ at a pitch of 4 mm, in reciprocal Angstrom
    assert data["phonon"][11]["distance"] == pytest.approx(length)
    assert 3 * data["natom"] <= len(data["phonon"][0]["band"]) == 7


def test_phonopys_file_of_shifted_rows_has_their_lattice() -> None:
    lattice = Lattice.of_rows(5e-3, 4e-3, staggered=True)
    path = lattice.path("GSX", 1)
    points = [
        {"label": label, "kx_per_m": k[0], "ky_per_m": k[1], "frequencies_hz": [1e3]}
        for label, k in zip(path.labels, path.wavevectors.tolist(), strict=True)
    ]
    design = {"pitch_x_m": 5e-3, "pitch_y_m": 4e-3, "thickness_m": 2e-3, "stagger": True}
    data = yaml.safe_load(exports.band_yaml({"with_defaults": {"design": design}, "points": points}))
    assert np.allclose(data["lattice"], 1e10 * np.array([[5e-3, 0, 0], [2.5e-3, 4e-3, 0], [0, 0, 2e-3]]))
    assert np.allclose(np.array(data["lattice"]) @ np.array(data["reciprocal_lattice"]).T, np.eye(3))
    assert np.allclose(data["phonon"][1]["q-position"], [0.5, 0.5, 0.0])
    wave = data["phonon"][3]["q-position"] @ np.array(data["reciprocal_lattice"])
    assert np.allclose(wave[:2], 1e-10 * path.wavevectors[2] / (2.0 * np.pi))


@pytest.mark.slow
def test_paraviews_file_has_a_step_a_mode_on_the_whole_plate(shapes: Path, tmp_path: Path) -> None:
    options = ["--set", COARSE[0], "--set", BAND, "--quiet", "--json", str(tmp_path / "m")]
    assert main(["modes", SMALL, *options]) == 0
    modes = json.loads((tmp_path / "m").read_text())["modes"]
    reader = vtkHDFReader()
    reader.SetFileName(str(shapes))
    reader.UpdateInformation()
    assert reader.GetNumberOfSteps() == len(modes) > 2
    design = load_case(SMALL).design
    for step, mode in enumerate(modes):
        reader.SetStep(step)
        reader.Update()
        grid = pyvista.wrap(reader.GetOutputDataObject(0))
        assert reader.GetTimeValue() == pytest.approx(mode["frequency_hz"], rel=1e-6)
        shape, places = np.array(grid.point_data["displacement"])[:, 2], cKDTree(grid.points)
        for axis, letter in enumerate(mode["symmetry"]):  # u_z beyond a mirror is that of its class
            _, image = places.query(grid.points * np.where(np.arange(3) == axis, -1.0, 1.0))
            assert np.abs(shape[image] - (1.0 if letter == "S" else -1.0) * shape).max() < 1e-4 * np.abs(shape).max()
    low, high = np.array(grid.bounds[::2]), np.array(grid.bounds[1::2])
    assert low == pytest.approx([-design.length_m / 2, -design.half_span_m, 0.0], abs=1e-9)
    assert high == pytest.approx([design.length_m / 2, design.half_span_m, 8.3e-3], abs=1e-9)


@pytest.mark.slow
def test_an_xdmf_file_holds_the_same_shapes_at_the_same_steps(shapes: Path, tmp_path: Path) -> None:
    reader = vtkHDFReader()
    reader.SetFileName(str(shapes))
    with TimeSeriesReader(written("xdmf", tmp_path / "modes.xdmf", BAND)) as series:
        points, (block,) = series.read_points_cells()
        reader.UpdateInformation()
        assert series.num_steps == reader.GetNumberOfSteps() > 2
        for step in range(series.num_steps):
            tone, data, _ = series.read_data(step)
            reader.SetStep(step)
            reader.Update()
            grid = pyvista.wrap(reader.GetOutputDataObject(0))
            assert tone == pytest.approx(reader.GetTimeValue(), rel=1e-12)
            assert points == pytest.approx(np.array(grid.points), abs=1e-9) and len(block.data) == grid.n_cells
            expected = np.array(grid.point_data["displacement"])
            assert np.abs(data["displacement"] - expected).max() < 1e-6 * np.abs(expected).max()
    made = [*shapes.parent.iterdir(), *tmp_path.iterdir()]
    assert sorted(path.name for path in made) == ["modes.vtkhdf", "modes.xdmf"]  # one file each, nothing beside


@pytest.mark.slow
def test_a_file_of_the_driven_plate_plays_one_period_at_its_voltage(tmp_path: Path) -> None:
    """The field's first harmonic against the response at points of the touch face; step 0 has the largest u_z."""
    reader, moved, turns = vtkHDFReader(), [], np.arange(24) / 24
    reader.SetFileName(str(written("driven", tmp_path / "plate.vtkhdf", PATCH, "patches.drive_V=10")))
    reader.UpdateInformation()
    assert reader.GetNumberOfSteps() == len(turns)
    for step, turn in enumerate(turns):
        reader.SetStep(step)
        reader.Update()
        grid = pyvista.wrap(reader.GetOutputDataObject(0))
        assert reader.GetTimeValue() == pytest.approx(360.0 * turn)
        moved.append(np.array(grid.point_data["displacement"])[:, 2])
    amplitude = 2.0 / len(turns) * np.exp(-2j * np.pi * turns) @ np.array(moved)
    largest = amplitude[np.abs(amplitude).argmax()]
    assert largest.real > 0.0 and abs(largest.imag) < 1e-5 * largest.real
    response = ask(load_case(SMALL, [*COARSE, PATCH]), Response(), RecordingLog())
    on = np.flatnonzero(np.abs(grid.points[:, 2]) < 1e-9)[::97]
    rows = partial(face_motion, points_m=np.array(grid.points)[on, :2])
    direct = 10.0 * response.forced.motion_by(rows, response.peak.frequency_hz)
    phase = np.vdot(direct, amplitude[on]) / np.vdot(direct, direct)
    assert abs(phase) == pytest.approx(1.0, rel=1e-4)
    assert np.abs(amplitude[on] - phase * direct).max() < 1e-4 * np.abs(direct).max()


@pytest.mark.slow
def test_a_universal_file_holds_the_response_and_is_read_back(
    responses: Path, driven: tuple[Case, ForcedPlate]
) -> None:
    case, forced = driven
    sets = pyuff.UFF(str(responses)).read_sets()
    nodes, curves = (
        next(each for each in sets if each["type"] == 15),
        [each for each in sets if each["type"] == 58],
    )
    assert len(curves) == len(nodes["node_nums"]) > 100
    chosen = curves[137]
    at = int(chosen["rsp_node"]) - 1
    place_m = grid(case.design)[at]
    assert (nodes["x"][at], nodes["y"][at]) == pytest.approx(place_m, rel=1e-5)  # six digits in the format's 13 columns
    direct = point_response(forced, (place_m[0], place_m[1]), np.array(chosen["x"]))
    # the first frequency and the step have six digits, 5e-6 of a frequency at most: times 2 Q on a resonance's flank
    assert np.abs(chosen["data"] - direct).max() < 2 * 300 * 5e-6 * np.abs(direct).max()
    sweep, field = files.read_sweep(responses), files.read_field(responses, case.design)
    assert sweep.quantity == field.quantity == "displacement" and len(field.points_m) == len(curves)
    largest = max(np.abs(each["data"]).max() for each in curves)
    assert np.abs(sweep.sweep.response).max() == pytest.approx(largest)
    assert np.abs(field.values).max() == pytest.approx(
        largest, rel=0.05
    )  # all nodes peak together, within the line's width


@pytest.mark.slow
def test_a_sweep_is_compared_with_the_peak_that_it_covers(responses: Path, tmp_path: Path) -> None:
    """The highest peak of this plate's response, at 26 kHz, is another mode's."""
    options = [*(word for text in (COARSE[0], PATCH) for word in ("--set", text)), "--points", "51", "--quiet"]
    seen_by = ["--measured", str(responses), "--map", str(responses)]
    assert main(["response", SMALL, *options, *seen_by, "--json", str(tmp_path / "r")]) == 0
    record = json.loads((tmp_path / "r").read_text())
    assert record["highest_peak"]["frequency_hz"] < 0.8 * record["target_peak"]["frequency_hz"]
    seen = record["measured"]
    assert abs(seen["sweep"]["frequency_shift"]) < 1e-4 and seen["map"]["mac_operating"] > 0.99


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"func_type": 1}, "no frequency response"),
        (
            {"ordinate_spec_data_type": 9},
            "type 9: must be 8 (displacement), 11 (velocity), 12 (acceleration) or 0 (read as a velocity)",
        ),
        ({"x": np.linspace(-5.0, 0.0, 9)}, "0 frequencies above 0"),
    ],
)
def test_a_universal_file_that_does_not_serve_is_refused_in_words(change: dict, said: str, tmp_path: Path) -> None:
    data = {
        "type": 58,
        "func_type": 4,
        "rsp_node": 1,
        "rsp_dir": 3,
        "ref_node": 1,
        "ref_dir": 3,
        "binary": 0,
        "orddenom_spec_data_type": 0,
    }
    data |= {"ordinate_spec_data_type": 8, "x": np.linspace(1e3, 2e3, 9), "data": np.ones(9, dtype=complex)} | change
    pyuff.UFF(str(tmp_path / "m.uff")).write_sets([data], "overwrite")
    with pytest.raises(files.InputError, match=said.replace("(", r"\(").replace(")", r"\)")):
        files.read_sweep(tmp_path / "m.uff")


def test_what_is_no_universal_file_and_nodes_without_a_place_are_refused(tmp_path: Path) -> None:
    with pytest.raises(files.InputError, match="no such file"):
        files.read_sweep(tmp_path / "none.unv")
    (tmp_path / "text.uff").write_text("frequency_Hz,real,imag\n1,2,3\n")
    with pytest.raises(files.InputError, match=r"no frequency response|can be read"):
        files.read_sweep(tmp_path / "text.uff")
    data = {
        "type": 58,
        "func_type": 4,
        "rsp_node": 7,
        "rsp_dir": 3,
        "ref_node": 1,
        "ref_dir": 3,
        "binary": 0,
        "orddenom_spec_data_type": 0,
    }
    data |= {"ordinate_spec_data_type": 8, "x": np.linspace(1e3, 2e3, 9), "data": np.ones(9, dtype=complex)}
    pyuff.UFF(str(tmp_path / "m.uff")).write_sets([data], "overwrite")
    with pytest.raises(files.InputError, match="node 7 has a response but no coordinates"):
        files.read_field(tmp_path / "m.uff", load_case(SMALL).design)


def test_the_impedance_resonates_short_and_resonates_against_open(driven: tuple[Case, ForcedPlate]) -> None:
    """One driven patch: Re Y is largest at the short-circuit resonance, Re Z at the open-circuit one, both to second order
    in the loss factor; away from every resonance only the capacitor is seen."""
    _, forced = driven
    shift = circuit_shift(forced)
    assert shift is not None and shift.open_hz - shift.short_hz > 1.0
    line = shift.short_hz / 300.0
    tones = np.arange(shift.short_hz - line, shift.open_hz + line, 0.5)
    seen = admittance(forced, tones)
    assert tones[np.argmax(seen.real)] == pytest.approx(shift.short_hz, abs=0.02 * line)
    assert tones[np.argmax((1.0 / seen).real)] == pytest.approx(shift.open_hz, abs=0.02 * line)
    assert np.all(seen.real > 0.0)  # a passive plate takes power


def test_touchstone_and_csv_are_the_same_impedance(tmp_path: Path, driven: tuple[Case, ForcedPlate]) -> None:
    _, forced = driven
    rows = list(csv.DictReader(written("impedance", tmp_path / "z.csv", PATCH).open()))
    tones = np.array([float(row["frequency_Hz"]) for row in rows])
    ohm = np.array([float(row["resistance_ohm"]) + 1j * float(row["reactance_ohm"]) for row in rows])
    assert ohm[::100] == pytest.approx(1.0 / admittance(forced, tones[::100]), rel=1e-6)
    lines = exports.touchstone(tones, ohm).splitlines()
    assert lines[1] == "# Hz S RI R 50"
    f, re, im = (float(word) for word in lines[102].split())
    s = re + 1j * im
    assert f == tones[100] and 50.0 * (1.0 + s) / (1.0 - s) == pytest.approx(ohm[100], rel=1e-9)


def test_an_impedance_without_patches_or_format_is_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["export", "impedance", SMALL, "-o", str(tmp_path / "z.s1p"), "--quiet"]) == 2
    assert "[patches]" in capsys.readouterr().err
    assert main(["export", "impedance", SMALL, "--set", PATCH, "-o", str(tmp_path / "z.txt"), "--quiet"]) == 2
    assert ".s1p (Touchstone) or .csv" in capsys.readouterr().err and not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    ("form", "name", "allowed"),
    [
        ("stl", "x.txt", ".stl"),
        ("step", "x", ".step or .stp"),
        ("phonopy", "x.csv", ".yaml or .yml"),
        ("aster", "x.inp", ".med, .comm or .export, or have no ending"),
        ("table", "x-1.5mm", ".bin or .h, or have no ending"),
    ],
)
def test_a_name_that_says_something_else_is_refused_before_anything_is_computed(
    form: str, name: str, allowed: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["export", form, SMALL, "-o", str(tmp_path / name), "--quiet"]) == 2
    lines = capsys.readouterr().err.splitlines()
    assert lines == [f"antinode: -o = {tmp_path / name}: must end in {allowed}"] and not list(tmp_path.iterdir())


def test_every_format_has_its_endings() -> None:
    from pipeline.cli.main import _parser
    from pipeline.exchange.exports import ENDINGS

    (commands,) = (each.choices for each in _parser()._actions if each.dest == "command")
    (forms,) = (each.choices for each in commands["export"]._actions if each.dest == "format")
    assert sorted(forms) == sorted(ENDINGS)
