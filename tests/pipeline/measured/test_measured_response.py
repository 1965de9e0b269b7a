"""The response command with measurements: shipped files reproduced, a known shift found, faults in one line."""

from __future__ import annotations

import json
import shlex
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast
from xml.etree import ElementTree

import numpy as np
import pytest

from pipeline.case.model import MeasuredFiles, load_case
from pipeline.cli.main import main
from pipeline.errors import InputError
from pipeline.measured import comparison
from pipeline.measured.comparison import read
from pipeline.measured.files import MeasuredSweep, read_field, read_sweep
from pipeline.measured.parts import ComputedResonance, MeasuredSweepRecord
from solvers.control.identification import Sweep
from tests.helpers.coarse_cells import mesh_coarsest
from tests.helpers.recording_log import RecordingLog

ROOT = Path(__file__).resolve().parents[3]
FOLDER = ROOT / "examples" / "measured"
CASE = FOLDER.parent / "33-measured.toml"
NOISE = 0.01  # what the shipped files' command adds


def made_by(path: Path) -> list[str]:
    """The command in a shipped file's first line."""
    first = path.read_text().splitlines()[0]
    assert first.startswith("# SYNTHETIC, not measured: made by antinode response ")
    return shlex.split(first.partition("made by antinode ")[2])


def compare(out: Path) -> Path:
    files = ["--measured", str(FOLDER / "sweep.csv"), "--map", str(FOLDER / "field.csv")]
    assert main(["response", str(CASE), "--quiet", *files, "--out", str(out)]) == 0
    return out


@pytest.fixture(scope="module")
def compared(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return compare(tmp_path_factory.mktemp("compared"))


@pytest.fixture(scope="module")
def compared_coarsely(tmp_path_factory: pytest.TempPathFactory) -> Path:
    with pytest.MonkeyPatch.context() as patch:
        mesh_coarsest(patch)
        return compare(tmp_path_factory.mktemp("coarsely"))


@pytest.fixture(scope="module")
def specimen(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The shipped files made again, and the JSON of the plate that stood for the specimen."""
    out = tmp_path_factory.mktemp("specimen")
    words = made_by(FOLDER / "sweep.csv")
    words[1] = str(ROOT / words[1])
    words[words.index("--synthetic-data") + 1] = str(out)
    assert main([*words, "--quiet", "--json", str(out / "response.json")]) == 0
    return out


def document(folder: Path) -> dict:
    return json.loads((folder / "response.json").read_text())


@pytest.mark.slow
def test_the_shipped_files_are_what_their_command_makes(specimen: Path) -> None:
    """Same seed, same noise: what differs is the linear algebra's rounding, far below the noise."""
    theirs, ours = read_sweep(FOLDER / "sweep.csv"), read_sweep(specimen / "sweep.csv")
    assert theirs.synthetic and ours.synthetic
    assert np.allclose(theirs.sweep.frequencies_hz, ours.sweep.frequencies_hz, rtol=1e-6)
    close(theirs.sweep.response, ours.sweep.response)
    design = load_case(CASE).design
    first, second = read_field(FOLDER / "field.csv", design), read_field(specimen / "field.csv", design)
    assert first.synthetic and np.array_equal(first.points_m, second.points_m)
    close(first.values, second.values)
    assert made_by(FOLDER / "field.csv") == made_by(FOLDER / "sweep.csv")


def close(first: np.ndarray, second: np.ndarray) -> None:
    assert np.abs(first - second).max() < 0.1 * NOISE * np.abs(first).max()


@pytest.mark.slow
def test_the_shift_and_the_losses_of_the_specimen_are_found(compared: Path, specimen: Path) -> None:
    """Five standard deviations of noise/sqrt(points) about the specimen's own peak and its given losses."""
    result, given = document(compared)["measured"]["sweep"], document(specimen)
    width = given["target_peak"]["frequency_hz"] / given["quality_factor_given"]
    assert result["synthetic"] and result["quantity"] == "velocity"
    assert result["quality_factor"] == pytest.approx(given["quality_factor_given"], rel=0.05)
    assert result["frequency_hz"] == pytest.approx(given["target_peak"]["frequency_hz"], abs=0.05 * width)
    ours = document(compared)["target_peak"]["frequency_hz"]
    assert result["computed"]["frequency_hz"] == pytest.approx(ours, abs=0.1 * width)
    assert result["frequency_shift_hz"] == pytest.approx(given["target_peak"]["frequency_hz"] - ours, abs=0.15 * width)
    assert result["frequency_shift_hz"] < -width  # the shipped specimen is softer than the case
    assert result["computed"]["quality_factor"] == pytest.approx(document(compared)["quality_factor_given"], rel=0.05)


@pytest.mark.slow
def test_the_map_is_held_as_the_specimen_was(compared: Path, specimen: Path) -> None:
    """Noise of 1 % of the peak fills the passive face with its own power; the expected confinement counts it in."""
    result, peak = document(compared)["measured"]["map"], document(specimen)["target_peak"]
    values = read_field(FOLDER / "field.csv", load_case(CASE).design).values
    floor = (NOISE * np.abs(values).max()) ** 2
    tone = 2.0 * np.pi * peak["frequency_hz"]
    levels = [(tone * peak[key]) ** 2 + floor for key in ("zone_rms_m_per_V", "passive_rms_m_per_V")]
    assert result["confinement_db"] == pytest.approx(10.0 * np.log10(levels[0] / levels[1]), abs=0.3)
    assert result["confined"] == (result["confinement_db"] >= 10.0)
    assert result["covered_active"] == pytest.approx(1.0, rel=1e-6)
    assert result["covered_passive"] == pytest.approx(1.0, rel=1e-6)
    assert result["computed"]["confinement_at_points_db"] == pytest.approx(
        result["computed"]["confinement_db"], abs=0.3
    )
    assert 0.9 < result["mac_operating"] <= 1.0
    assert abs(result["mac"] - result["computed"]["mac"]) < 0.05


@pytest.mark.slow
def test_a_case_may_name_its_measurements(
    compared_coarsely: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """As the command line does; a study's record then holds them, and a file's hash is part of what was understood."""
    mesh_coarsest(monkeypatch)
    named = ["--set", 'measured.sweep="measured/sweep.csv"', "--set", "measured.at_mm=[19.86, 0.16]"]
    out = tmp_path / "named.json"
    assert main(["response", str(CASE), "--quiet", *named, "--json", str(out)]) == 0
    result = json.loads(out.read_text())["measured"]
    assert result["map"] is None
    given = document(compared_coarsely)["measured"]["sweep"]
    assert result["sweep"]["frequency_hz"] == given["frequency_hz"]
    assert result["sweep"]["computed"]["point_mm"] == pytest.approx([19.86, 0.16])
    with_defaults = load_case(CASE, [named[1], named[3]]).to_dict()["measured"]
    assert len(with_defaults["sweep_sha256"]) == 64 and "map" not in with_defaults


@pytest.mark.parametrize(
    ("error", "words"),
    [
        (8e-4, ("computed 30.000 kHz, shift +0 ± 24 Hz (+0.00 %) (error of the model: 0.080 %)",)),
        (None, ("computed 30.0 kHz, shift -0.0100 Hz (-3.34e-05 %) ", "error of the model: unknown")),
    ],
)
def test_beside_the_shift_stands_what_the_model_may_be_off_by(error: float | None, words: tuple[str, ...]) -> None:
    half = None if error is None else 3e4 * error
    ours = ComputedResonance(frequency_hz=3e4, quality_factor=300.0, circle=None, frequency_error=error)
    theirs = MeasuredSweepRecord(
        **{
            "frequency_hz": 3e4 - 0.01001,
            "quality_factor": 287.3,
            "quality_error": 4.0,
            "circle": None,
            "computed": ours,
        },
        **{"file": "sweep.csv", "synthetic": False, "frequency_shift_hz": -0.01001, "frequency_error": 2e-5},
        **{"frequency_shift": -0.01001 / 3e4, "frequency_shift_error_hz": half},
    )
    said = theirs.line()
    assert all(each in said for each in words)
    assert "resonance at 30.0000 ± 0.0006 kHz" in said and "quality factor 287 ± 4 against 300 computed" in said


@pytest.mark.slow
def test_the_figure_is_written_in_both_forms_and_not_empty(compared_coarsely: Path) -> None:
    """Ink of more than one colour in the raster; the axes' titles and the peak's colour-independent labels in the vector."""
    from matplotlib.image import imread

    pixels = imread(compared_coarsely / "measured.png")[..., :3].reshape(-1, 3)
    inked = pixels[(pixels < 0.98).any(axis=1)]
    assert 0.01 < len(inked) / len(pixels) < 0.9 and len(np.unique(inked.round(1), axis=0)) > 10
    assert ElementTree.parse(compared_coarsely / "measured.svg").getroot().tag.endswith("svg")


@pytest.mark.parametrize(
    ("more", "words"),
    [
        (["--measured", "nowhere.csv"], ["nowhere.csv", "no such file"]),
        (["--map", str(FOLDER / "sweep.csv")], ["line 3", "x_mm or x_m"]),
        (["--measured", str(FOLDER / "field.csv")], ["line 3", "frequency_kHz"]),
        (["--at", "3,4"], ["--at", "--measured"]),
        (["--measured", str(FOLDER / "sweep.csv"), "--at", "300,4"], ["--at", "mm"]),
        (["--measured", str(FOLDER / "sweep.csv"), "--at", "here"], ["--at", "X,Y"]),
        (["--measured", str(FOLDER / "sweep.csv"), "--at", "-300,4"], ["--at", "-300,4", "mm"]),
        (["--synthetic-data", "made", "--noise", "2"], ["--noise", "at most 1"]),
        (["--set", 'measured.sweep="none.csv"'], ["measured.sweep", "no such file"]),
        (["--set", 'measured.sweep="measured/field.csv"'], ["field.csv", "frequency_kHz"]),
        (
            ["--set", 'measured.map="measured/field.csv"', "--set", "measured.at_mm=[1, 2]"],
            ["measured.at_mm", "measured.sweep"],
        ),
    ],
)
def test_wrong_input_is_one_line(more: list[str], words: list[str], capsys: pytest.CaptureFixture[str]) -> None:
    try:
        code = main(["response", str(CASE), "--quiet", *more])
    except SystemExit as end:
        code = int(end.code or 0)
    assert code == 2
    lines = capsys.readouterr().err.strip().splitlines()
    assert len(lines) == 1
    for word in words:
        assert word in lines[0]


def test_a_sweep_elsewhere_is_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    far = tmp_path / "far.csv"
    far.write_text("frequency_kHz,real,imag\n" + "".join(f"{10 + i},1,0.{i}\n" for i in range(9)))
    assert main(["response", str(CASE), "--quiet", "--points", "5", "--measured", str(far)]) == 2
    assert "must overlap the response" in capsys.readouterr().err


def test_a_sweep_of_the_case_s_own_is_told_by_its_keys(tmp_path: Path) -> None:
    """A study has no --band, and no --at."""
    far = tmp_path / "far.csv"
    far.write_text("frequency_kHz,real,imag\n" + "".join(f"{10 + i},1,0.{i}\n" for i in range(9)))
    case = replace(load_case(CASE), measured=MeasuredFiles(far, None, None))
    with pytest.raises(
        InputError, match=r"33-measured.toml: measured.sweep = .*far.csv: .* 29000 to 36000 Hz \(solve.band_kHz\)"
    ):
        read(case, None, None, None)
    aside = replace(case, measured=MeasuredFiles(FOLDER / "sweep.csv", None, (0.3, 0.0)))
    with pytest.raises(InputError, match=r"33-measured.toml: measured.at_mm = '300.0,0.0': must be"):
        read(aside, None, None, None)


@pytest.mark.parametrize(
    ("model", "coarse", "half_hz"), [(0.002, True, 62.0 + 400.0), (0.002, False, 62.0), (None, True, None)]
)
def test_the_bar_of_a_shift_holds_the_step_between_the_points(
    monkeypatch: pytest.MonkeyPatch, model: float | None, coarse: bool, half_hz: float | None
) -> None:
    """Of a peak at 31.2 kHz, computed at 31 kHz, whose few points fit no circle; many points without noise do."""
    fine = np.linspace(30e3, 32e3, 401)
    given = 31.2e3 + 400.0 * np.arange(-5.0, 6.0) if coarse else fine
    pairs = (given, 31.2e3), (fine, 31e3)
    values = [1.0 / (1.0 + 2j * 300.0 * (tone / peak_hz - 1.0)) for tone, peak_hz in pairs]
    if coarse:
        values[0] = np.abs(values[0]).astype(complex)  # without phases there is no circle
    response = SimpleNamespace(curve=SimpleNamespace(frequency_hz=fine), expected_error=model)
    monkeypatch.setattr(comparison, "_computed", lambda *_: (None, values[1]))
    measured = MeasuredSweep("sweep.csv", False, "velocity", Sweep(given, values[0]))
    record, _ = comparison._sweep(load_case(CASE), cast(Any, response), measured, None, RecordingLog())
    assert (record.no_circle is not None) == coarse
    assert record.frequency_shift_error_hz == (half_hz and pytest.approx(half_hz, rel=0.01))
    assert record.frequency_shift_hz == pytest.approx(200.0, abs=0.1)
    assert record.frequency_shift == pytest.approx(200.0 / 31e3, rel=1e-3)


def test_a_sweep_that_shares_its_first_frequency_with_the_response_is_compared() -> None:
    measured = MeasuredSweep("s.csv", False, "velocity", Sweep(35.9e3 + 200.0 * np.arange(8), np.ones(8, complex)))
    comparison._refuse_elsewhere(measured, (29e3, 36e3), "s.csv", "--band")
    with pytest.raises(InputError, match="must overlap"):
        comparison._refuse_elsewhere(measured, (29e3, 35.9e3), "s.csv", "--band")
