"""A question in a module of its own: command, method, tables, picture, measure, section of a report, page of the reference."""

from __future__ import annotations

import csv
import importlib
import inspect
import json
import sys
from collections.abc import Iterator
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest

import antinode
from pipeline.batch import case_study
from pipeline.batch.study_file import load_study
from pipeline.cli.main import main
from pipeline.logs import RunLog
from pipeline.questions import study as asked
from pipeline.questions.question import QUESTIONS
from pipeline.records import record, store
from pipeline.report import page

ROOT = Path(__file__).resolve().parents[3]
CASE = str(ROOT / "examples" / "small.toml")
STUDY = """
[study]
name = "masses"
case = "small.toml"
measure = ["mass"]
[sweep]
"plate.thickness_mm" = [1.0, 2.0]
"""


@pytest.fixture
def toy() -> Iterator[ModuleType]:
    """The toy's module imported, and nothing else touched."""
    sys.modules.pop("tests.helpers.toy_mass", None)
    yield importlib.import_module("tests.helpers.toy_mass")
    del QUESTIONS["mass"]


def grams() -> float:
    d = antinode.load(CASE).case.design
    return 1e3 * d.material.density_kg_m3 * d.length_m * d.width_m * d.thickness_m


def test_it_is_a_command_with_help_limits_and_a_plan(toy: ModuleType, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit):
        main(["mass", "--help"])
    said = " ".join(capsys.readouterr().out.split())
    assert "divide the mass" in said and "--strips N" in said and "number of strips (default: 4)" in said
    with pytest.raises(SystemExit) as refused:
        main(["mass", CASE, "--strips", "0"])
    assert refused.value.code == 2 and "must be 1 or more, at most 100" in capsys.readouterr().err
    assert main(["mass", CASE, "--explain"]) == 0
    assert "1. Divide the mass of the plate beneath the zone into strips" in capsys.readouterr().out


def test_it_is_a_method_with_signature_documentation_and_limits(toy: ModuleType) -> None:
    plate = antinode.load(CASE)
    method = plate.mass  # type: ignore[attr-defined]
    assert inspect.signature(method).parameters["strips"].default == 4
    assert "Parameters\n----------\nstrips : int, optional\n    Number of strips." in method.__doc__ and "mass" in dir(
        plate
    )
    assert method(strips=2).mass_total_g == pytest.approx(grams())
    for wrong in (2.5, "3", None, [1]):
        with pytest.raises(antinode.InputError, match="a whole number"):
            method(strips=wrong)
    with pytest.raises(antinode.InputError, match="strips = 0: must be 1 or more, at most 100"):
        method(strips=0)
    with pytest.raises(AttributeError):
        plate.weight  # type: ignore[attr-defined]  # noqa: B018


def test_its_tables_are_one_and_it_is_drawn(toy: ModuleType, tmp_path: Path) -> None:
    pytest.importorskip("pandas")
    assert main(["mass", CASE, "-q", "--strips", "3", "--out", str(tmp_path), "--plot", str(tmp_path / "m.svg")]) == 0
    document = json.loads((tmp_path / "mass.json").read_text())
    rows = list(csv.DictReader((tmp_path / "mass.csv").open()))
    result: Any = antinode.load(CASE).mass(strips=3)  # type: ignore[attr-defined]
    frame = result.to_dataframe()
    assert list(rows[0]) == list(frame.columns) == ["strip", "mass_g"]
    assert [float(row["mass_g"]) for row in rows] == frame["mass_g"].tolist() == document["mass_g"]
    assert [int(row["strip"]) for row in rows] == [1, 2, 3] and document["options"] == {"strips": 3}
    assert antinode.open(tmp_path / "mass.json") == result
    assert (tmp_path / "m.svg").stat().st_size > 1000 and (tmp_path / "mass.svg").exists()


@pytest.mark.slow
def test_it_is_a_column_of_a_sweep_a_part_of_each_record_and_a_section_of_the_page(
    toy: ModuleType, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "small.toml").write_text(Path(CASE).read_text())
    (tmp_path / "masses.toml").write_text(STUDY)
    study = load_study(tmp_path / "masses.toml")
    results = tmp_path / "results"
    for job in case_study.jobs_of(study):
        folder = results / job.case_id
        folder.mkdir(parents=True)
        with RunLog(folder / "run.mess") as log:
            found = case_study.compute(str(study.case_path), job.payload, folder, log)
        whole = record.Record.of_case(found, case_id=job.case_id, status="OK", sweep=job.sweep)
        store.seal(folder, whole.to_dict())
        assert record.read(folder).of(toy.MassResult) == found["mass"]
    table = list(csv.DictReader(asked.write_table(results).open()))
    assert [float(row["mass_total_g"]) for row in table] == pytest.approx([grams() / 2.0, grams()])
    text = page.build(results).read_text()
    assert "Divide the mass of the plate beneath the zone into strips" in text
    assert any((results / job / "pictures" / "mass.svg").exists() for job in ("thickness_mm=1", "thickness_mm=2")), (
        "drawn"
    )
    assert f"{grams():.3f} g beneath the zone" in text and "mass beneath the zone" in text


def test_it_stands_in_the_reference(toy: ModuleType, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.syspath_prepend(str(ROOT / "docs" / "site"))
    reference = importlib.import_module("reference")
    assert "| `mass_g` | mass of the strip. | `list[float]` | g |" in "\n".join(reference.json_fields())
    assert "| `mass_total_g` | mass beneath the zone | g |" in "\n".join(reference.columns())
    assert "## mass\n" in "\n".join(reference.commands())
