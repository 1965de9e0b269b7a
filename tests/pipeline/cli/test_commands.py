"""The command line from outside: exit codes, one line a fault, one JSON document, the band-gap check both ways."""

from __future__ import annotations

import argparse
import importlib
import json
import os
import signal
import subprocess
import sys
import webbrowser
from pathlib import Path

import pytest

from pipeline import paths, process
from pipeline.batch import case_study
from pipeline.cli import main
from pipeline.cli.compare import Edge
from pipeline.questions import predesign
from pipeline.records import store
from solvers.machine import factorisations

ROOT = Path(__file__).resolve().parents[3]
CASE = str(ROOT / "studies" / "three-rows.toml")
CHEAP = ("--quiet", "--set", "solve.accuracy=0.1", "--set", "bands.points=1", "--set", "bands.count=3")


def run(*arguments: str) -> int:
    try:
        return main.main(list(arguments))
    except SystemExit as end:
        return int(end.code or 0)


def lines(text: str) -> list[str]:
    return [line for line in text.splitlines() if line]


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (("modes", "nothing.toml"), "nothing.toml"),
        (("modes", CASE, "--near", "-3kHz"), "--near"),
        (("modes", CASE, "--band", "30:34"), "could mean 30 Hz to 34 Hz or 30 kHz to 34 kHz: write the unit"),
        (("modes", CASE, "--count", "99999999999"), "must be 1 or more, at most 10000"),
        (("response", CASE, "--points", "99999999999"), "must be 1 or more, at most 100000"),
        (("attenuation", CASE, "--kx", "nan"), "must be a number of at most 3e+09 rad/m"),
        (("modes", CASE, "--band", "34kHz:30kHz"), "low end"),
        (("modes", CASE, "--set", "array.pitch_mm=1.5"), "array.pitch_mm"),
        (("modes", CASE, "--set", "pilar.side_mm=2"), "pillar"),
        (("modes", CASE, "--count", "0"), "1 or more"),
        (("bands", CASE, "--set", "bands.path='GQ'"), "bands.path"),
        (("modes", CASE, "--set", "solve.model=analytic"), "solve.model"),
        (("bands", CASE, "--set", "solve.mesh=hex", "--set", "pillar.fillet_mm=0.2"), "solve.mesh"),
        (("run", "rowz"), "rows"),
        (("doctor", "table", "nothing.bin"), ": nothing.bin: No such file or directory"),
        (("frobnicate",), "frobnicate"),
    ],
)
def test_wrong_input_is_one_clear_line_and_exit_code_2(
    arguments: tuple[str, ...], said: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run(*arguments) == 2
    text = lines(capsys.readouterr().err)
    assert len(text) == 1
    assert said in text[0]


@pytest.mark.parametrize(
    ("settings", "said"),
    [
        ((), "[touch]: missing, touch needs it"),
        (("touch.radius_mm=5.0", "touch.at_mm=[57.0, 0.0]"), "the contact extends beyond the plate"),
        (("touch.radius_mm=5.0", "touch.impedance={damping_Ns_per_m=-1.0}"), "must be the name of a fingertip"),
    ],
)
def test_a_finger_that_cannot_be_is_one_line(
    settings: tuple[str, ...], said: str, capsys: pytest.CaptureFixture[str]
) -> None:
    overrides = [part for setting in settings for part in ("--set", setting)]
    assert run("touch", CASE, *overrides) == 2
    (line,) = lines(capsys.readouterr().err)
    assert said in line


def commands() -> list[str]:
    """Every command that the parser knows."""
    actions = main._parser()._actions
    return next(list(action.choices) for action in actions if isinstance(action, argparse._SubParsersAction))


def test_every_command_ends_its_help_with_an_example(capsys: pytest.CaptureFixture[str]) -> None:
    assert {"predesign", "modes", "search", "tolerance", "view", "doctor", "check-gap"} <= set(commands())
    for name in commands():
        assert run(name, "--help") == 0
        assert lines(capsys.readouterr().out)[-1].startswith(f"example: antinode {name}")


def test_every_command_runs_a_function_that_is_there() -> None:
    """What commands.toml names by its module and function, and what questions share."""
    waiting, found = [main._parser()], {}
    while waiting:
        for action in waiting.pop()._actions:
            if isinstance(action, argparse._SubParsersAction):
                found |= action.choices
                waiting += action.choices.values()
    for name, sub in found.items():
        if name in main.FAMILIES:
            continue
        module, _, function = sub.get_default("handler").partition(":")
        assert callable(getattr(importlib.import_module(module), function)), name


def test_a_plan_leaves_neither_a_table_nor_a_figure(tmp_path: Path) -> None:
    places = ("--csv", str(tmp_path / "b.csv"), "--plot", str(tmp_path / "b.png"))
    assert run("bands", CASE, "--explain", *places) == 0 and not list(tmp_path.iterdir())


def test_json_on_standard_output_is_alone_and_holds_the_pillar(capsys: pytest.CaptureFixture[str]) -> None:
    arguments = ("modes", CASE, "--part", "pillar", "--count", "2", "--json", "-", "--set", "solve.accuracy=0.02")
    assert run(*arguments) == 0
    document = json.loads(capsys.readouterr().out)
    assert document["schema"] == 2
    assert document["count_check"]["expected"] == document["count_check"]["found"] == 2
    first, second = (mode["frequency_hz"] for mode in document["modes"])
    assert first == pytest.approx(second, rel=1e-6)  # a square pillar bends alike both ways
    assert first == pytest.approx(39115.0, rel=0.02)  # a finer computation of the same pillar
    assert all(mode["zone_share"] is None and mode["mac"] is None for mode in document["modes"])


def test_an_edge_that_is_gone_is_said_in_words_and_never_as_a_number() -> None:
    gone = Edge("gap lower edge", 163083.0, None, 0.005)
    assert gone.relative_change is None and not gone.holds
    assert "is missing" in gone.words and "163.1 kHz" in gone.words and "nan" not in gone.words
    assert "moved by +1.0 %" in Edge("bending at M", 100.0, 101.0, 0.005).words


@pytest.mark.slow
def test_band_gap_check_holds_on_the_reference_and_fails_when_the_pillar_grows() -> None:
    assert run("check-gap", "--quiet") == 0
    assert run("check-gap", "--quiet", "--set", "pillar.height_mm=6.426") == 4


@pytest.mark.slow
def test_bands_of_a_bare_cell_need_no_pillar(tmp_path: Path) -> None:
    bare = tmp_path / "bare.toml"
    bare.write_text(
        'name = "bare"\nmaterial = "steel"\n[plate]\nthickness_mm = 2.0\n[array]\npitch_mm = 4.0\nrows = 0\n'
    )
    assert run("bands", str(bare), *CHEAP, "--json", str(tmp_path / "bands.json")) == 0
    points = json.loads((tmp_path / "bands.json").read_text())["points"]
    assert [point["label"] for point in points] == ["G", "X", "M", "G"]
    assert points[0]["frequencies_hz"][:3] == [0.0, 0.0, 0.0]


def test_a_table_without_pillar_is_refused_only_where_it_is_needed(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    bare = tmp_path / "zone.toml"
    bare.write_text(
        'name = "zone"\nmaterial = "aluminium"\n[plate]\nthickness_mm = 2.0\n'
        "[zone]\nlength_mm = 60.0\nwidth_mm = 20.0\nnodal_lines = 4\n"
    )
    assert run("predesign", str(bare), "--json", "-") == 0
    assert json.loads(capsys.readouterr().out)["pillar"] is None
    assert run("modes", str(bare), "--part", "pillar") == 2
    assert "[pillar]" in capsys.readouterr().err


def test_the_console_script_answers(tmp_path: Path) -> None:
    done = subprocess.run(
        [sys.executable, "-m", "pipeline.cli.main", "--help"], capture_output=True, text=True, cwd=tmp_path
    )
    assert done.returncode == 0
    assert "    modes " in done.stdout
    seldom = done.stdout.partition("other commands: ")[2]
    for name in main.SELDOM:
        assert f"\n    {name}" not in done.stdout and name in seldom and name in commands()


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGHUP, signal.SIGINT])
def test_a_command_that_is_ended_says_so_and_leaves_the_signals_as_they_were(
    number: signal.Signals, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(predesign, "sized", lambda design: os.kill(os.getpid(), number))
    usual = signal.default_int_handler if number == signal.SIGINT else signal.SIG_DFL
    inherited = signal.signal(number, usual)  # under nohup SIGHUP is ignored from the start
    try:
        before = signal.getsignal(number)
        assert run("predesign", CASE) == 130
        assert lines(capsys.readouterr().err) == ["antinode: interrupted; finished work is kept"]
        assert signal.getsignal(number) is before
    finally:
        signal.signal(number, inherited)


def test_a_signal_that_the_parent_has_ignored_stays_ignored(monkeypatch: pytest.MonkeyPatch) -> None:
    """As nohup asks for."""
    before = signal.signal(signal.SIGHUP, signal.SIG_IGN)
    try:
        with process.terminable():
            os.kill(os.getpid(), signal.SIGHUP)
    finally:
        signal.signal(signal.SIGHUP, before)


def test_a_report_names_the_cases_that_it_does_not_believe(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(paths, "RESULTS", tmp_path)
    monkeypatch.setattr(case_study, "conclude", lambda study, folder, all_pictures: [])
    (tmp_path / "rows/a").mkdir(parents=True)
    store.seal(tmp_path / "rows/a", {"schema": store.SCHEMA, "case_id": "a", "status": "OK"})
    store.write_sealed(tmp_path / "rows/cases.json", {"schema": 2, "about": {}, "cases": [{"case_id": "a"}]})
    assert run("report", "rows") == 0 and capsys.readouterr().err == ""
    opened: list[str] = []
    monkeypatch.setattr(webbrowser, "open", opened.append)
    assert run("report", "rows", "--open") == 0 and opened == [(tmp_path / "rows" / "report.html").as_uri()]
    record = tmp_path / "rows/a/record.json"
    record.write_text(record.read_text().replace("OK", "WARNING"))
    assert run("report", "rows") == 0
    text = lines(capsys.readouterr().err)
    assert len(text) == 1 and "case a is not shown" in text[0] and "do not match their checksum" in text[0]


@pytest.mark.parametrize("words", [["--symmetry", "AS"], ["--symmetry=AA"]])
def test_a_symmetry_class_is_named_by_its_letters(words: list[str], capsys: pytest.CaptureFixture[str]) -> None:
    assert main.main(["modes", CASE, *words, "--explain"]) == 0
    assert f"class {words[-1][-2:]}" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("variable", "given", "allowed"),
    [
        *(("THREADS", each, "a whole number of threads; 0 uses every core") for each in ("abc", "-1", "1.5", "")),
        *(("MEMORY_GIB", each, "a number above 0, in GiB") for each in ("8GB", "-1", "0", "nan", "inf", "")),
        ("FACTOR", "lapack", f"one of {', '.join(factorisations())} here"),
    ],
)
def test_a_variable_that_means_nothing_is_wrong_input(
    variable: str, given: str, allowed: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv(f"ANTINODE_{variable}", given)
    assert main.main(["materials"]) == 2
    assert capsys.readouterr().err == f"antinode: ANTINODE_{variable} = {given!r}: must be {allowed}\n"


@pytest.mark.parametrize(
    ("words", "joined"),
    [
        (["response", "c.toml", "--at", "-7,3"], ["response", "c.toml", "--at=-7,3"]),
        (["modes", "--near", "-5kHz", "--quiet"], ["modes", "--near=-5kHz", "--quiet"]),
        (["modes", "--near", "-.5kHz"], ["modes", "--near=-.5kHz"]),
        (["touch", "--gain", "-1e-3"], ["touch", "--gain=-1e-3"]),
        (
            ["a", "--list", "-1", "-2.5", "--x=1", "-3,4", "-o", "-"],
            ["a", "--list", "-1", "-2.5", "--x=1", "-3,4", "-o", "-"],
        ),
    ],
)
def test_a_value_that_begins_with_a_negative_number_is_no_option(words: list[str], joined: list[str]) -> None:
    assert main._with_negatives(words) == joined
