"""The attenuation command: waves, the decay that counts, what rows let through, and faults in one line."""

from __future__ import annotations

import json
from dataclasses import replace
from math import pi
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from pipeline.case.model import load_case
from pipeline.cli.main import main
from pipeline.logs import TerminalLog
from pipeline.models import attenuation
from pipeline.models.answer_parts import AttenuationPoint, Transmission
from pipeline.paths import STUDIES
from pipeline.questions.attenuation import prediction
from solvers.analytic.plates import levy_hz
from solvers.analytic.predesign import strip_of
from solvers.waves import complex_bands
from tests.helpers import synthetic
from tests.helpers.asked import attenuation_of
from tests.helpers.recording_log import RecordingLog

pytestmark = pytest.mark.usefixtures("coarsest_cells")
CASE = str(STUDIES / "three-rows.toml")
COARSE = ["--set", "solve.accuracy=0.03", "--quiet"]


@pytest.fixture(scope="module")
def document(tmp_path_factory: pytest.TempPathFactory) -> dict:
    folder = tmp_path_factory.mktemp("attenuation")
    arguments = [
        "attenuation",
        CASE,
        *COARSE,
        "--points",
        "41",
        "--json",
        str(folder / "a.json"),
        "--out",
        str(folder / "out"),
    ]
    assert main(arguments) == 0
    assert {path.suffix for path in (folder / "out").iterdir()} >= {".csv", ".svg", ".png", ".json"}
    return json.loads((folder / "a.json").read_text())


@pytest.mark.slow
def test_the_fields_of_the_document(document: dict) -> None:
    assert document["schema"] == 2 and document["kx_per_m"] == pytest.approx(7.5 * pi / 0.1155)
    assert len(document["points"]) == 41
    point = document["points"][0]
    assert set(point) >= {"frequency_hz", "waves", "db_per_row"}
    assert set(point["waves"][0]) >= {"polarisation", "ky_re_per_m", "ky_im_per_m", "db_per_row"}
    assert {w["polarisation"] for p in document["points"] for w in p["waves"]} <= {"flexural", "shear", "longitudinal"}


def test_the_last_field_is_the_least_attenuated_flexural_wave(document: dict) -> None:
    for point in document["points"]:
        flexural = [wave["db_per_row"] for wave in point["waves"] if wave["polarisation"] == "flexural"]
        assert point["db_per_row"] == min(flexural)
        for wave in point["waves"]:
            decay = 20.0 / 2.302585092994046 * wave["ky_im_per_m"] * 4e-3
            assert wave["db_per_row"] == pytest.approx(decay, rel=1e-6, abs=1e-5)


def test_flexural_waves_are_stopped_above_the_pillars_resonance_and_pass_beyond(document: dict) -> None:
    """The stop band that holds the target mode: no wave passes at 36 kHz, one does at 27 and at 42 kHz."""
    at = {round(p["frequency_hz"] / 1e3): p for p in document["points"]}
    assert at[36]["db_per_row"] > 2.0 and at[27]["db_per_row"] == 0.0 and at[42]["db_per_row"] == 0.0
    assert at[36]["transmission"]["flexural"] < 0.2 < 0.5 < at[42]["transmission"]["flexural"]


def test_power_is_shared_out_whole_and_none_is_turned_in_plane(document: dict) -> None:
    """In-plane waves decay at this wavenumber (k_x above that of shear waves), so they carry nothing away."""
    for point in document["points"]:
        shares = point["transmission"]
        assert shares["reflected"] + shares["flexural"] == pytest.approx(1.0, abs=1e-8)
        assert shares["shear"] == shares["longitudinal"] == 0.0


def test_straight_across_in_plane_waves_take_their_share() -> None:
    case = load_case(CASE, ["solve.accuracy=0.03"])
    result = attenuation_of(case, TerminalLog(True), (34e3, 36e3), 0.0, 3)
    for point in result.points:
        shares = point.transmission
        assert shares is not None and shares.longitudinal > 0.0
        assert shares.reflected + shares.flexural + shares.shear + shares.longitudinal == pytest.approx(1.0, abs=1e-8)


def test_the_prediction_is_rows_times_the_decay() -> None:
    transmission = Transmission(reflected=0.99, flexural=0.01, shear=0.0, longitudinal=0.0)
    points = [
        AttenuationPoint(frequency_hz=f, waves=[], db_per_row=5.0, transmission=transmission) for f in (30e3, 40e3)
    ]
    text = prediction(replace(synthetic.attenuation(3), points=points), 35e3, 12.0, 0.4)
    assert text.rows_db == 15.0 and text.transmission_db == pytest.approx(20.0) and text.rows_needed == 2
    assert (text.zone_to_extension_db, text.zone_to_extension_error_db) == (12.0, 0.4)


def test_what_is_converted_has_the_digits_of_its_bar() -> None:
    """What the share is where frequencies may lie; few digits where that is not known, and none of what decays."""

    def shares(tone: float) -> Transmission:
        share = 0.1234 + 1e-6 * (tone - 40e3)
        return Transmission(reflected=0.1, flexural=0.9 - share, shear=share, longitudinal=0.0)

    points = [AttenuationPoint(frequency_hz=f, waves=[], db_per_row=5.0, transmission=shares(f)) for f in (30e3, 40e3)]
    log = RecordingLog()
    for error in (0.01, None):
        attenuation._log_converted(points, 0.0, shares, error, log)
    still = Transmission(reflected=0.1, flexural=0.9, shear=0.0, longitudinal=0.0)
    attenuation._log_converted([replace(points[0], transmission=still)], 237.35, shares, 0.01, log)
    assert "at most 12.34 ± 0.04 % of" in log.facts[0] and "at most 12.3 % of" in log.facts[1]
    assert "at kx = 237.35 rad/m" in log.facts[2] and "in-plane conversion: none" in log.facts[2]


def test_a_sentence_says_what_the_rows_do_where_the_zone_is_to_vibrate() -> None:
    """The zone by the exact thin plate (levy); nothing is said of a band that ends below."""
    case = load_case(CASE)
    zone_khz = levy_hz(strip_of(case.design), 8) / 1e3
    transmission = Transmission(reflected=0.99, flexural=0.01, shear=0.0, longitudinal=0.0)
    for decay, said in (
        (5.0, "5.00 dB per row (15.0 dB after 3 rows, 10 dB after 2 rows)"),
        (0.0, "without attenuation"),
    ):
        points = [
            AttenuationPoint(frequency_hz=f, waves=[], db_per_row=decay, transmission=transmission)
            for f in (30e3, 40e3)
        ]
        solved = replace(synthetic.attenuation(3), points=points, zone_hz=1e3 * zone_khz)
        *_, line = solved.lines()
        assert line.startswith(f"at {zone_khz:.1f} kHz") and said in line and "flexural wave by 20.0 dB" in line
    low = replace(solved, points=[replace(points[0], frequency_hz=f) for f in (1e3, 2e3)])
    assert len([*low.lines()]) == 2


@pytest.mark.parametrize(("bar", "needed"), [(None, 2), (1.0, 2), (5.0, None), (6.0, None)])
def test_rows_are_counted_only_where_the_bar_leaves_a_decay(bar: float | None, needed: int | None) -> None:
    points = [
        AttenuationPoint(frequency_hz=f, waves=[], db_per_row=5.0, transmission=None, db_error=bar)
        for f in (30e3, 40e3)
    ]
    solved = replace(synthetic.attenuation(3), points=points, zone_hz=35e3)
    assert prediction(solved, 35e3).rows_needed == needed
    *_, line = solved.lines()
    assert ("its bar does not say" in line) == (needed is None)


def test_a_wave_is_listed_up_to_the_edge_where_its_wavenumber_ends() -> None:
    """k of a row with one degree less differs by as much as k itself where k^2 passes 0; steep ones stay seen."""
    pitch, edge = 4e-3, 0.05 + 0.0j
    known = np.array([1j * np.sqrt(edge), 5.0 + 6.0j]) / pitch

    def moved(share: float) -> np.ndarray:
        return np.array([1j * np.sqrt(edge * (1.0 - share)), (5.0 + 6.0j) * (1.0 + share)]) / pitch

    waves, fewer, further = (
        SimpleNamespace(wavenumber_per_m=k, pitch_m=pitch, db_per_row=8.69 * pitch * k.imag)
        for k in (known, moved(0.005), moved(0.05))
    )
    near = SimpleNamespace(wavenumber_per_m=moved(0.15)[:1], pitch_m=pitch)  # k by 8 %, k^2 by 0.0075 of 1/pitch^2
    assert attenuation.carried(waves, fewer).tolist() == [True, True]  # type: ignore[arg-type]
    assert attenuation.carried(waves, further).tolist() == [True, False]  # type: ignore[arg-type]
    assert attenuation.carried(waves, near).tolist() == [True, False]  # type: ignore[arg-type]


def test_a_decay_between_samples_has_their_weighted_bars_and_what_the_chord_may_miss() -> None:
    def point(tone: float, decay: float, bar: float) -> AttenuationPoint:
        return AttenuationPoint(frequency_hz=tone, waves=[], db_per_row=decay, transmission=None, db_error=bar)

    straight = [point(30e3, 1.0, 0.1), point(31e3, 2.0, 0.3), point(32e3, 3.0, 0.2)]
    bent = [*straight, point(33e3, 9.0, 0.4)]
    record = synthetic.attenuation(3)
    one, other = (replace(record, points=points) for points in (straight, bent))
    assert one.error_at(31e3) == 0.3 and one.error_at(31.5e3) == pytest.approx(0.25)
    assert other.error_at(32.5e3) == pytest.approx(0.3 + 2.5)  # the line from below ends at 3.5 where the chord has 6
    edge = replace(record, points=[*straight, point(33e3, 0.0, 0.4)])  # a wave that propagates at 33 kHz
    assert edge.error_at(32.25e3) == pytest.approx(0.25 + 3.0)  # anywhere from there on: the whole difference


@pytest.mark.parametrize(
    ("more", "words"),
    [
        (["--kx", "900"], "must lie between"),
        (["--kx", "2e6"], "must lie between"),
        (["--set", 'solve.model="solid"'], "must be auto or superelement"),
        (["--band", "45kHz:25kHz"], "--band"),
    ],
)
def test_wrong_input_is_one_line(more: list[str], words: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["attenuation", CASE, *COARSE, *more]) == 2
    lines = capsys.readouterr().err.strip().splitlines()
    assert len(lines) == 1 and words in lines[0]


def test_a_case_without_pillars_is_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    bare = tmp_path / "bare.toml"
    bare.write_text(
        'name="b"\nmaterial="aluminium"\n[plate]\nthickness_mm=2.0\n[zone]\nlength_mm=115.5\nwidth_mm=20.0\nnodal_lines=8\n'
    )
    assert main(["attenuation", str(bare), "--quiet"]) == 2
    assert "pillar" in capsys.readouterr().err


def test_plates_of_one_pitch_share_the_waves_of_the_plate_beside_their_rows(monkeypatch: pytest.MonkeyPatch) -> None:
    plain, solved = complex_bands.Row.waves, []
    monkeypatch.setattr(complex_bands.Row, "waves", lambda row, tone: solved.append(type(row)) or plain(row, tone))
    attenuation._last.clear()
    case = load_case(CASE, ["solve.accuracy=0.03"])
    other = load_case(CASE, ["solve.accuracy=0.03", "array.rows=1"])
    through = [attenuation_of(each, TerminalLog(True), points=5).points[2].transmission for each in (case, other)]
    assert solved.count(complex_bands.KeptRow) == 5, "of the plate, for both"
    assert solved.count(complex_bands.Row) == 2 * 2 * 5, "of each case's row, with one degree less, too"
    assert through[0] and through[1] and through[0].flexural < through[1].flexural
