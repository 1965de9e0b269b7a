"""The response command on a small plate: fields, peak, faults in one line."""

from __future__ import annotations

import json
import tomllib
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from pipeline.case.model import case_from_dict
from pipeline.cli.main import main
from pipeline.models.forced import _widest_bar, forced_plate
from pipeline.planning import mesh_rules
from pipeline.planning.refinement import WidestBar
from solvers.control.identification import half_power_quality_factor
from solvers.piezo import responses
from solvers.piezo.responses import FrequencyErrors, driven_hz
from tests.helpers.recording_log import RecordingLog

pytestmark = pytest.mark.usefixtures("coarsest_cells")
CASE = """name = "small"
material = "aluminium"
[plate]
thickness_mm = 2.0
[zone]
length_mm = 22.0
width_mm = 10.0
nodal_lines = 2
[pillar]
shape = "square"
side_mm = 2.0
height_mm = 6.3
[array]
pitch_mm = 4.0
rows = 1
extension_mm = 3.0
[solve]
band_kHz = [60.0, 85.0]
accuracy = 0.03
[patches]
size_mm = [4.0, 2.0, 0.3]
sensors = [1]
"""


@pytest.fixture(scope="module")
def case(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("response") / "small.toml"
    path.write_text(CASE)
    return path


@pytest.fixture(scope="module")
def document(case: Path) -> dict:
    out = case.parent / "out"
    assert main(["response", str(case), "--quiet", "--points", "101", "--out", str(out)]) == 0
    assert (out / "response.csv").exists() and (out / "response.png").exists()
    return json.loads((out / "response.json").read_text())


@pytest.mark.slow
def test_the_fields_of_the_document(document: dict) -> None:
    assert document["schema"] == 2
    count = len(document["frequency_hz"])
    assert count >= 101
    for key in ("zone_rms_m_per_V", "passive_rms_m_per_V", "sensor_V_per_V"):
        assert len(document[key]) == count
    assert np.all(np.diff(document["frequency_hz"]) > 0.0)
    assert len(document["sensor_V_per_V"][0]) == 2


@pytest.mark.slow
def test_the_highest_peak_is_the_curves_highest_point(document: dict) -> None:
    top = int(np.argmax(document["zone_rms_m_per_V"]))
    assert document["highest_peak"]["frequency_hz"] == document["frequency_hz"][top]
    ratio = document["zone_rms_m_per_V"][top] / document["passive_rms_m_per_V"][top]
    assert document["highest_peak"]["confinement_db"] == pytest.approx(20.0 * np.log10(ratio))


@pytest.mark.slow
@pytest.mark.parametrize("given", [{}, {"band_kHz": [75.0, 85.0]}])
def test_a_default_band_is_extended_to_the_target_mode(given: dict, monkeypatch: pytest.MonkeyPatch) -> None:
    """Supports and narrow rims move the mode out of the band that theory gives; a band of the case stays as it is."""
    tables = tomllib.loads(CASE)
    tables["solve"] = {"accuracy": 0.1, **given}
    monkeypatch.setattr(mesh_rules, "target_window_hz", lambda design: (75e3, 85e3))
    meshes: list[Any] = []
    forced = forced_plate(case_from_dict(tables), log := RecordingLog(), None, meshes)
    tone = driven_hz(forced)
    assert tone and tone < 75e3
    assert forced.band_hz == (75e3 if given else pytest.approx(0.9 * tone), 85e3)
    assert any("outside the default band" in fact for fact in log.facts) == (not given)
    assert len({mesh.what for mesh in meshes}) == len(meshes)


def test_the_widest_bar_of_the_band_and_its_largest_part_are_named(monkeypatch: pytest.MonkeyPatch) -> None:
    """Of resonances in the band alone, whichever group they are of; unknown where one of them is."""
    bars = np.array([[1e-3, 2e-3, 0.5], [3e-3, 1e-3, 0.5], [1e-3, 4e-3, 0.5]])
    tones = SimpleNamespace(frequency_hz=np.array([61e3, 70e3, 90e3])), SimpleNamespace(frequency_hz=np.array([65e3]))
    known = [FrequencyErrors(*bars), FrequencyErrors(*bars[:, :1])]
    monkeypatch.setattr(responses, "frequency_errors", lambda basis: known[basis is tones[1]])
    forced: Any = SimpleNamespace(modes=tones)
    widest = _widest_bar(forced, 60e3, 80e3)
    assert widest.error == pytest.approx(7e-3) and widest.of == "the resonance at 70.0 kHz"
    assert widest.parts == {"mesh": 2e-3, "reduction": 1e-3, "bonding": 4e-3} and widest.largest_part == "bonding"
    bars[0, 0] = np.nan
    assert _widest_bar(forced, 60e3, 80e3).error is _widest_bar(forced, 1e3, 2e3).error is None
    assert _widest_bar(forced, 69e3, 80e3).error == widest.error


def test_a_band_without_estimates_says_so(document: dict) -> None:
    assert document["expected_error"] is document["widest_bar"]["error"] is None


def test_a_bar_beyond_the_accuracy_is_a_warning() -> None:
    log, case = RecordingLog(), case_from_dict(tomllib.loads(CASE))
    for error in (0.029, 0.031):
        assert "ACCURACY" not in log.warnings
        WidestBar(error, "the resonance at 70.1 kHz", {"mesh": 0.01, "bonding": 0.02}).warn(case, log)
    assert "70.1 kHz is 3.1 %, mostly bonding; solve.accuracy requests 3.0 %" in log.warnings["ACCURACY"]


def test_opening_the_patches_stiffens_the_target_mode(document: dict) -> None:
    circuit = document["circuit"]
    assert circuit["drivers"] == "short" and circuit["short_hz"] == document["target_hz"]
    assert circuit["open_hz"] > circuit["short_hz"]
    assert circuit["coupling"] == pytest.approx(1.0 - (circuit["short_hz"] / circuit["open_hz"]) ** 2)


@pytest.mark.slow
def test_a_charge_drives_where_the_case_says_so(case: Path, document: dict, tmp_path: Path) -> None:
    file = tmp_path / "r.json"
    fed = ["--points", "101", "--set", 'patches.circuit="open"', "--json", str(file)]
    assert main(["response", str(case), "--quiet", *fed]) == 0
    result = json.loads(file.read_text())
    assert result["circuit"]["drivers"] == "open"
    short, opened = (one["target_peak"] or one["highest_peak"] for one in (document, result))
    assert short["frequency_hz"] < opened["frequency_hz"] <= document["circuit"]["open_hz"] * 1.001


@pytest.mark.slow
def test_without_sensors_there_is_no_voltage(case: Path, tmp_path: Path) -> None:
    file = tmp_path / "r.json"
    assert (
        main(["response", str(case), "--quiet", "--points", "11", "--set", "patches.sensors=[]", "--json", str(file)])
        == 0
    )
    assert json.loads(file.read_text())["sensor_V_per_V"] is None


def test_the_quality_of_a_lorentzian_is_read_back() -> None:
    f = np.linspace(900.0, 1100.0, 4001)
    curve = np.abs(1.0 / (1000.0**2 * (1.0 + 1j / 50.0) - f**2))
    assert half_power_quality_factor(f, curve, int(curve.argmax())) == pytest.approx(50.0, rel=0.01)
    assert half_power_quality_factor(f[1900:2100], curve[1900:2100], int(curve[1900:2100].argmax())) is None


@pytest.mark.parametrize(
    ("text", "more", "words"),
    [
        (CASE.split("[patches]")[0], [], "patches"),
        (CASE, ["--set", 'solve.model="solid"'], "must be auto or superelement"),
        (CASE, ["--band", "30kHz"], "--band"),
        (CASE, ["--set", "patches.sensors=[9]"], "no such patch"),
        (
            CASE,
            ["--set", "patches.size_mm=[2, 2, 10]", "--set", "patches.centres_mm=[[-5, 0], [5, 0]]"],
            "has its own resonance",
        ),
        (
            CASE,
            [
                "--set",
                "patches.size_mm=[8, 9, 0.3]",
                "--set",
                "patches.centres_mm=[[0, 0]]",
                "--set",
                "patches.sensors=[]",
            ],
            "clear of the strip",
        ),
        (CASE, ["--set", 'patches.circuit="opened"'], "short (a voltage drives the patches) or open"),
    ],
)
def test_wrong_input_is_one_line(
    tmp_path: Path, text: str, more: list[str], words: str, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "case.toml"
    path.write_text(text)
    assert main(["response", str(path), "--quiet", *more]) == 2
    lines = capsys.readouterr().err.strip().splitlines()
    assert len(lines) == 1 and words in lines[0]
