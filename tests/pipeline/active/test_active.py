"""`antinode active`: text, documents and figures; one line for what is wrong; the table carries what was measured."""

from __future__ import annotations

import csv
import json
from dataclasses import replace
from math import inf, nan, pi
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from firmware import mode_table as table_file
from pipeline.active import thesis
from pipeline.active.loop import plant_of
from pipeline.case.limits import parse_seconds
from pipeline.cli import main
from pipeline.errors import InputError
from solvers.control.identification import noisy, sweep_of
from solvers.control.loop import ModePlant
from solvers.thesis.active_beam import ActiveBeamData
from solvers.thesis.circuit import MasonData
from tests.helpers import site_fields
from tests.helpers.figures import assert_labelled_with_data, collected

ROOT = Path(__file__).resolve().parents[3]
CASE = str(ROOT / "studies" / "three-rows.toml")
FIGURES = {
    "mason": {"mason"},
    "pillar": {"point_force", "pillar_rows"},
    "beam": {"active_beam", "active_beam_sensitivity"},
    "dq": {"dq_step", "dq_circle", "dq_bode"},
    "shaping": {"shaping_conditioning", "shaping_patterns", "shaping_travelling"},
}


def run(*arguments: str) -> int:
    try:
        return main.main(["active", *arguments])
    except SystemExit as end:
        return int(end.code or 0)


@pytest.mark.slow
@pytest.mark.parametrize(
    "model",
    [
        "mason",
        "pillar",
        "beam",
        "dq",
        "shaping",
    ],
)
def test_each_model_gives_text_a_document_and_its_figures(model: str, tmp_path: Path, capsys, monkeypatch) -> None:
    figures = collected(monkeypatch)
    assert run(model, "--out", str(tmp_path), "--quiet") == 0
    text = capsys.readouterr().out
    document = json.loads((tmp_path / f"active_{model}.json").read_text())
    assert document["schema"] == 2 and site_fields.differing(f"active_{model}", document) == []
    for entry in document["comparison"]:
        assert set(entry) == {"quantity", "thesis", "ours", "agreement"}
        assert entry["ours"] in text and entry["agreement"] in text
    assert {path.stem for path in tmp_path.glob("*.svg")} == FIGURES[model]
    assert {path.stem for path in tmp_path.glob("*.png")} == FIGURES[model]
    assert sorted(name for name, _ in figures) == sorted(FIGURES[model])
    for name, figure in figures:
        assert_labelled_with_data(name, figure)


def test_json_on_standard_output_is_alone_beside_a_table_and_a_picture(tmp_path: Path, capsys) -> None:
    places = ["--csv", str(tmp_path / "dq.csv"), "--plot", str(tmp_path / "dq.png")]
    assert run("dq", "--json", "-", *places) == 0
    document = json.loads(capsys.readouterr().out)
    assert document["schema"] == 2 and (tmp_path / "dq.png").read_bytes().startswith(b"\x89PNG")
    with (tmp_path / "dq.csv").open() as file:
        assert [row["ours"] for row in csv.DictReader(file)] == [each["ours"] for each in document["comparison"]]


@pytest.mark.slow
def test_options_reach_the_model(capsys) -> None:
    assert run("beam", "--frequency", "2.5kHz", "--gain", "3e6", "--gain", "4e6", "--delay", "10us", "--json", "-") == 0
    beam = json.loads(capsys.readouterr().out)
    assert (
        beam["frequencies_hz"] == [2500.0]
        and beam["gains_n_m"] == [3e6, 4e6]
        and beam["delays_s"] == pytest.approx([1e-5])
    )
    assert run("mason", "--frequency", "20kHz", "--quality-factor", "100", "--band", "5kHz:30kHz", "--json", "-") == 0
    mason = json.loads(capsys.readouterr().out)
    assert (
        mason["target_hz"] == 20e3
        and mason["filter"]["rejected_hz"] == pytest.approx(20e3)
        and mason["quality_factor"] == 100
    )
    assert (mason["frequencies_hz"][0], mason["frequencies_hz"][-1]) == (5e3, 30e3)
    assert (
        run(
            "dq",
            "--frequency",
            "28kHz",
            "--quality-factor",
            "200",
            "--settling-time",
            "3ms",
            "--delay",
            "12us",
            "--json",
            "-",
        )
        == 0
    )
    dq = json.loads(capsys.readouterr().out)
    assert dq["plant"]["frequency_hz"] == 28e3 and dq["plant"]["quality_factor"] == pytest.approx(200)
    assert dq["design"]["within_s"] == 3e-3 and dq["plant"]["delay_s"] == pytest.approx(12e-6)
    assert dq["comparison"][0]["agreement"].startswith("differs, 3 ms were asked for")


@pytest.mark.slow
def test_the_case_gives_material_pillar_mode_and_losses(capsys) -> None:
    one = ("--frequency", "3kHz", "--gain", "3e6", "--delay", "10us")
    assert run("beam", CASE, *one, "--set", "material=steel", "--set", "damping.quality=150", "--json", "-") == 0
    beam = json.loads(capsys.readouterr().out)["beam"]
    assert beam["material"] == "steel" and beam["quality_factor"] == 150.0
    assert run("dq", CASE, "--set", "damping.quality=250", "--json", "-") == 0
    plant = json.loads(capsys.readouterr().out)["plant"]
    assert plant["frequency_hz"] == pytest.approx(33_979, rel=1e-3) and plant["quality_factor"] == pytest.approx(250)
    assert run("pillar", CASE, "--set", "pillar.height_mm=7.1", "--json", "-") == 0
    lower = json.loads(capsys.readouterr().out)
    assert run("pillar", "--json", "-") == 0
    higher = json.loads(capsys.readouterr().out)
    assert lower["clamped_hz"] < 0.85 * higher["clamped_hz"] and len(higher["transmitted"]) == 3
    assert higher["cell"] is None


def test_staggered_rows_meet_a_straight_wave_as_those_in_line_do(capsys) -> None:
    passed = []
    for stagger in ("false", "true"):
        assert run("pillar", CASE, "--set", "array.pitch_mm=5", "--set", f"array.stagger={stagger}", "--json", "-") == 0
        passed.append(json.loads(capsys.readouterr().out)["transmitted"])
    assert passed[0] == passed[1]


@pytest.mark.slow
def test_pillar_losses_are_the_cases_or_none(tmp_path: Path, capsys) -> None:
    bare = tmp_path / "pillar.toml"
    text = Path(CASE).read_text().replace("[damping]\nquality = 300.0\n", "")
    bare.write_text(text)
    absorbed, duller = [], ("--set", "damping.quality=50")
    for arguments in ((str(bare),), (CASE,), (CASE, "--quality-factor", "inf"), (CASE, *duller)):
        assert run("pillar", *arguments, "--json", "-") == 0
        result = json.loads(capsys.readouterr().out)
        shares = 1.0 - np.array(result["transmitted"]) - np.array(result["reflected"])
        absorbed.append(np.abs(shares).max())
    assert absorbed[0] < 1e-10 and absorbed[2] < 1e-10 and absorbed[3] > 2.0 * absorbed[1] > 1e-3


@pytest.mark.slow
def test_computed_cell_stands_beside_the_strip(monkeypatch, tmp_path: Path, capsys) -> None:
    """What `attenuation` returns is compared and drawn; None (too steep to keep) counts as stopped."""
    query = {}

    def answer(case, question, log):
        query.update(band=question.band_kHz, kx=question.kx_per_m)
        tones = 1e3 * np.linspace(*question.band_kHz, 41)
        points = [
            SimpleNamespace(
                frequency_hz=f, db_per_row=None if 34e3 < f < 35e3 else 3.0 * (30e3 < f < 36e3), db_error=f / 1e5
            )
            for f in tones
        ]
        return SimpleNamespace(model="stub", points=points)

    monkeypatch.setattr("pipeline.questions.question.ask", answer)
    assert run("pillar", "--cell", "--band", "25kHz:45kHz", "--quiet", "--out", str(tmp_path)) == 0
    document = json.loads((tmp_path / "active_pillar.json").read_text())
    assert site_fields.differing("active_pillar", document) == []
    assert query == {"band": (25.0, 45.0), "kx": 0.0} and document["cell"]["model"] == "stub"
    assert document["cell"]["db_error"] == [f / 1e5 for f in document["cell"]["frequencies_hz"]]
    assert document["comparison"][-1]["ours"] == "30.5-35.5 kHz"
    assert "edge lies" in document["comparison"][-1]["agreement"]
    capsys.readouterr()


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (("beam", "--gain", "0"), "--gain = 0: must be 0.001 or more"),
        (("beam", "--gain=-1e7"), "must be 0.001 or more"),
        (("beam", "--gain", "much"), "--gain = much"),
        (("beam", "--frequency", "0"), "--frequency"),
        (("beam", "--frequency=-3kHz"), "above 0"),
        (("beam", "--delay", "4"), "--delay"),
        (("mason", "--frequency", "0"), "--frequency"),
        (("mason", "--quality-factor", "inf"), "lossless resonance"),
        (("mason", "--quality-factor", "0"), "--quality-factor"),
        (("mason", "--gain", "1"), "active mason: unrecognized arguments: --gain"),
        (("mason", "--settling-time", "2ms"), "active mason: unrecognized arguments: --settling-time"),
        (("beam", "--gain", "1e-300"), "--gain = 1e-300: must be 0.001 or more, at most 1e+12"),
        (
            ("pillar", "--quality-factor", "1e-300"),
            "--quality-factor: 1e-300: must be 0.5 or more, at most 1e+12, or inf",
        ),
        (("dq", "--settling-time", "1e300s"), "--settling-time = '1e300s': must be a time of 0 or more in s, ms or us"),
        (("mason", "--band", "1kHz:30MHz"), "must end at 2500 kHz or below"),
        (("pillar", "--band", "30:34"), "30:34 could mean 30 Hz to 34 Hz or 30 kHz to 34 kHz: write the unit"),
        (("beam", "--frequency", "3"), "3 could mean 3 Hz or 3 kHz: write the unit"),
        (("mason", "--set", "plate.thickness_mm=1"), "needs a CASE"),
        (("pillar", "--band", "0Hz:3kHz"), "--band"),
        (("pillar", "--set", "pillar.height_mm=-1"), "pillar.height_mm"),
        (("dq", "--quality-factor", "inf"), "without losses"),
        (("dq", "--frequency", "0"), "--frequency"),
        (("dq", "--settling-time", "0.1ms"), "latency"),
        (("dq", "--table", "nothing.bin"), "nothing.bin"),
        (("dq", "--sweep", "nothing.csv"), "nothing.csv"),
        (("shaping", "--frequency", "0"), "--frequency"),
        (("mason", "nothing.toml"), "nothing.toml"),
    ],
)
def test_what_is_wrong_is_told_in_one_line(arguments: tuple[str, ...], said: str, capsys) -> None:
    assert run(*arguments) == 2
    caught = capsys.readouterr()
    text = [line for line in caught.err.splitlines() if line.startswith("antinode")]
    assert len(text) == 1 and said in text[0] and caught.out == ""


def test_lossless_resonance_of_the_beam_is_told(capsys) -> None:
    exact = float(ActiveBeamData(quality_factor=inf).beam.natural_rad_s(7)[6]) / (2 * pi)
    assert run("beam", "--quality-factor", "inf", "--frequency", f"{exact!r}Hz") == 2
    assert "lossless resonance" in capsys.readouterr().err
    assert MasonData(quality_factor=inf).cell.loss == 0.0


@pytest.mark.parametrize("band", ["24.9kHz:25.1kHz", "5kHz:8kHz"])
def test_the_circuits_verdicts_are_those_of_its_modes_whatever_band_is_shown(band: str, capsys) -> None:
    assert run("mason", "--json", "-") == 0
    whole = json.loads(capsys.readouterr().out)
    assert run("mason", "--band", band, "--quiet") == 0
    text = capsys.readouterr().out
    assert "nan" not in text
    for entry in whole["comparison"]:
        assert entry["ours"] in text and entry["agreement"] in text


def test_a_band_without_modes_says_where_they_are(capsys) -> None:
    assert run("mason", "--band", "30Hz:34Hz") == 2
    text = capsys.readouterr()
    assert text.out == "" and "contains no mode of the three bars" in text.err and "from 7.10 to 39.6 kHz" in text.err


class OneBeam:
    """A study whose loops confine from K' = 1e6 N/m on, at any frequency: what the comparison reads, and no more."""

    def __init__(self, gains: tuple[float, ...], tones: tuple[float, ...]) -> None:
        self.data = SimpleNamespace(gains_n_m=gains, frequencies_hz=tones)

    def case(self, layout: str, frequency_hz: float, gain_n_m: float) -> SimpleNamespace:
        after = SimpleNamespace(ratio=3.0 if gain_n_m > 1e6 else 1.0)
        return SimpleNamespace(frequency_hz=frequency_hz, gain_n_m=gain_n_m, strength=gain_n_m / 1e6, after=after)


def test_one_gain_or_one_frequency_is_not_compared_with_itself() -> None:
    one = OneBeam((1e7,), (3e3,))
    quantities = [("gain", thesis._gains(one)), ("higher", thesis._higher(one))]
    gains, tones = thesis.beside("beam", quantities)
    assert gains["ours"].count("K' =") == 1 and gains["agreement"].startswith("not compared: one gain")
    assert tones["agreement"] == "not compared: one frequency was given, the contrast takes two"


def test_gains_are_compared_by_size_in_any_order() -> None:
    (entry,) = thesis.beside("beam", [("gain", thesis._gains(OneBeam((1e8, 1e5), (3e3,))))])
    assert entry["ours"].index("K' = 100000") < entry["ours"].index("K' = 1e+08")
    assert entry["agreement"] == "agrees: the two gains lie on both sides of 4EI beta^3"


STATEMENT = {
    "verdicts": [{"near": {"ratio": 2.0}, "within": {"level": [0.0, 1.0]}, "text": "agrees"}, {"text": "differs"}],
    "also": [{"within": {"level": [1.0, 5.0]}, "text": ": {level:g}"}],
}


@pytest.mark.parametrize(
    ("figures", "words"),
    [
        ({"ratio": 1.71, "level": 0.0}, "agrees"),
        ({"ratio": 1.69, "level": 0.0}, "differs"),
        ({"ratio": 2.29, "level": 1.0}, "differs: 1"),  # a range ends below its upper value
        ({"ratio": 2.29, "level": 0.999}, "agrees"),
        ({"ratio": 2.31, "level": 0.5}, "differs"),
        ({"ratio": nan, "level": 0.5}, "differs"),
        ({"ratio": 2.0}, "differs"),  # a figure that is not there lies in no range
    ],
)
def test_a_statement_is_judged_by_its_ranges(figures: dict[str, float], words: str) -> None:
    assert thesis.agreement(STATEMENT, figures) == words


def test_every_statement_ends_in_a_verdict_that_always_holds() -> None:
    for model in thesis.statements().values():
        for statement in model.values():
            assert set(statement["verdicts"][-1]) == {"text"}


@pytest.mark.parametrize(("text", "value"), [("2ms", 2e-3), ("4us", 4e-6), ("0.5 s", 0.5), ("0us", 0.0)])
def test_times(text: str, value: float) -> None:
    assert parse_seconds(text, "--delay") == pytest.approx(value)


@pytest.mark.parametrize("text", ["", "4", "-1ms", "infs", "nanms", "ms", "4kHz"])
def test_times_refused(text: str) -> None:
    with pytest.raises(InputError, match="--delay"):
        parse_seconds(text, "--delay")


def table(**changes) -> table_file.ModeTable:
    modes = tuple(table_file.Mode.from_quality_factor(f, 300.0) for f in (30_900.0, 31_400.0, 32_200.0))
    return table_file.ModeTable(250e3, bytes(16), modes, 1, **changes)


def test_a_table_gives_the_mode_and_its_neighbours(tmp_path: Path, capsys) -> None:
    file = tmp_path / "plate.bin"
    file.write_bytes(table_file.to_bytes(table()))
    assert run("dq", "--table", str(file), "--json", "-") == 0
    document = json.loads(capsys.readouterr().out)
    assert document["plant"]["frequency_hz"] == 31_400.0 and document["plant"]["sensor"] == "displacement"
    assert [round(one["frequency_hz"]) for one in document["neighbours"]] == [30_900, 32_200]
    assert any(step["name"] == "with neighbours" for step in document["steps"])
    file.write_bytes(file.read_bytes()[:-1])
    assert run("dq", "--table", str(file)) == 2
    assert "truncated" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("gain", "sensor", "real"), [(-0.6j, "displacement", 0.6), (0.5j, "displacement", -0.5), (-0.4, "velocity", -0.4)]
)
def test_sign_of_a_tables_gain(gain: complex, sensor: str, real: float) -> None:
    """A displacement sensor shows a velocity response over j."""
    mode = replace(table().modes[0], gain=gain)
    assert plant_of(mode, True, sensor).gain == pytest.approx(real)


@pytest.mark.slow
@pytest.mark.parametrize("displacement", [True, False])
def test_a_measured_sweep_becomes_the_tables_mode(displacement: bool, tmp_path: Path, capsys) -> None:
    """Frequency, time constant, complex gain and delay of a plate that the table guessed wrongly."""
    truth = ModePlant.from_quality_factor(31_437.3, 260.0, 0.6)
    sensor = "displacement" if displacement else "velocity"
    result = noisy(sweep_of((truth,), np.linspace(31_100.0, 31_800.0, 141), sensor, 8e-6, 0.001), 1e-4)
    sweep = tmp_path / "sweep.csv"
    rows = [
        f"{f!r},{h.real!r},{h.imag!r}"
        for f, h in zip(result.frequencies_hz.tolist(), result.response.tolist(), strict=True)
    ]
    sweep.write_text("\n".join(["frequency_hz,re,im", *rows]))
    old = tmp_path / "old.bin"
    old.write_bytes(table_file.to_bytes(table(senses_displacement=displacement)))
    out = tmp_path / "out"
    assert run("dq", "--table", str(old), "--sweep", str(sweep), "--out", str(out), "--quiet") == 0
    new = table_file.from_bytes((out / "mode_table.bin").read_bytes())
    mode = new.modes[new.target]
    assert mode.frequency_identified and mode.tau_identified
    assert mode.frequency_hz == pytest.approx(31_437.3, abs=0.1) and mode.tau_s == pytest.approx(truth.tau_s, rel=2e-3)
    assert mode.gain == pytest.approx(-0.6j if displacement else 0.6, rel=2e-3)
    assert mode.delay_s == pytest.approx(8e-6, abs=2e-8)
    assert [one.gain for i, one in enumerate(new.modes) if i != new.target] == [None, None]
    header = (out / "mode_table.h").read_text()
    assert table_file.header_text(table_file.to_bytes(new)) == header
    document = json.loads((out / "active_dq.json").read_text())
    assert document["plant"]["frequency_hz"] == pytest.approx(31_437.3, abs=0.1)
    assert site_fields.differing("active_dq", document) == []
    assert document["measured"]["tau_s"] == pytest.approx(mode.tau_s, rel=1e-6)
    assert main.main(["doctor", "table", str(out / "mode_table.bin"), "--json", str(out / "table.json")]) == 0
    assert site_fields.differing("doctor table", json.loads((out / "table.json").read_text())) == []
    capsys.readouterr()


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("", "no columns"),
        ("frequency_hz,re,im\n", "no rows"),
        ("frequency_hz,re\n1e4,2\n", "line 1: columns frequency_hz, real: must hold real with imag"),
        ("frequency_hz,re,im\n1e4,2,3\n2e4,x,4\n", "line 3, column real"),
        ("frequency_hz,re,im\n1e4,2,3\n", "at least 8"),
    ],
)
def test_a_bad_sweep_is_told(text: str, said: str, tmp_path: Path, capsys) -> None:
    file = tmp_path / "sweep.csv"
    file.write_text(text)
    assert run("dq", "--sweep", str(file)) == 2
    assert said in capsys.readouterr().err
