"""Results of schema 1, in which the target mode went by another name, are refused in one line."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

import antinode
from pipeline import paths
from pipeline.cli import main
from pipeline.errors import CommandError
from pipeline.records import store
from tests.helpers import synthetic

EARLIER = "written by an earlier version: run it again"


def aged(study: Path) -> Path:
    """A study as the version before left it: schema 1 of its list, schema 4 of its records, the former column names."""
    synthetic.put_study(study)
    listed = store.read_sealed(study / "cases.json")
    store.write_sealed(study / "cases.json", {**listed, "schema": 1})
    for folder in (path.parent for path in study.glob("*/record.json")):
        store.seal(folder, {**store.read_record(folder), "schema": 4})
    (study / "table.csv").write_text("case,wanted_status,wanted_hz\na,single,34600\n")
    return study


@pytest.mark.parametrize("command", ["show", "report"])
def test_a_study_of_schema_1_is_refused(
    command: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(paths, "RESULTS", tmp_path)
    aged(tmp_path / "rows")
    assert main.main([command, "rows"]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert EARLIER in line and "cases.json" in line


def test_results_of_schema_1_are_not_compared(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    document = tmp_path / "modes.json"
    document.write_text(json.dumps({"schema": 1, "modes": []}))
    case = next(path.parent for path in aged(tmp_path / "rows").glob("*/record.json"))
    for place in (document, case):
        assert main.main(["compare", str(place), str(place)]) == 2
        (line,) = capsys.readouterr().err.splitlines()
        assert EARLIER in line


def test_results_of_schema_1_are_not_opened(tmp_path: Path) -> None:
    document = tmp_path / "modes.json"
    document.write_text(json.dumps({"schema": 1, "kind": "modes", "modes": []}))
    for place in (document, aged(tmp_path / "rows")):
        with pytest.raises(CommandError, match=EARLIER):
            antinode.open(place)


def test_a_document_says_which_shape_along_x_its_target_has() -> None:
    found = antinode.Target(status="single", frequency_hz=34.6e3, mac=0.97, strength=0.62, confinement_db=12.1)
    assert found.values()["shape"] == "free-free"
