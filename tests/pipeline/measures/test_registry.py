"""Measures: every one keeps its promises, and a new one is a module and a line, from the study file to table.csv."""

from __future__ import annotations

import csv
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest

from pipeline.batch import case_study, runner
from pipeline.batch.study_file import load_study
from pipeline.case.model import load_case
from pipeline.errors import InputError
from pipeline.measures import registry
from pipeline.measures.measure import Measure, Work
from pipeline.paths import ROOT
from pipeline.planning import plan
from pipeline.planning.plan import Step
from pipeline.records import record
from pipeline.records.study import read_study
from pipeline.records.tables import FILE_DIGITS, Column

SMALL = ROOT / "examples" / "small.toml"
FULL = str(ROOT / "studies" / "three-rows.toml")


def _count(work: Work) -> None:
    """What a module of its own would hold: pillars of the plate a square centimetre."""
    design = work.case.design
    area = design.length_m * 2.0 * design.half_span_m
    work.keep(density={"per_cm2": 1e-4 * len(design.pillar_centres()) / area})


TOY = Measure(
    "density",
    plan=lambda case: plan.plain_step("density", "pillars counted", "none"),
    compute=_count,
    columns=(Column("pillars_per_cm2", "pillars", lambda r: r.other.get("density", {}).get("per_cm2"), "1/cm²"),),
)


def test_a_new_measure_goes_from_the_study_file_to_the_table(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(registry, "MEASURES", (*registry.MEASURES, TOY))
    path = tmp_path / "toy.toml"
    path.write_text(f'[study]\ncase = "{SMALL}"\nmeasure = ["density"]\n[sweep]\narray.rows = [1, 2]\n')
    study = load_study(path)
    jobs = case_study.jobs_of(study)
    assert "pillars counted" in registry.plan_of(load_case(SMALL), study.measure).short()
    with ThreadPoolExecutor(1) as here:
        outcome = runner.run_study(jobs, case_study.computer(study), tmp_path / "toy", runner.Options(executor=here))
    assert outcome.exit_code == 0
    with registry.write_table(tmp_path / "toy").open(newline="") as file:
        rows = list(csv.DictReader(file))
    cases = [load_case(SMALL, [f"array.rows={count}"]).design for count in (1, 2)]
    area = [1e4 * design.length_m * 2.0 * design.half_span_m for design in cases]
    counts = [len(design.pillar_centres()) for design in cases]
    densities = [n / a for n, a in zip(counts, area, strict=True)]
    assert [float(row["pillars_per_cm2"]) for row in rows] == pytest.approx(
        densities, rel=0.5 * 10.0 ** (1 - FILE_DIGITS)
    )
    assert record.read(tmp_path / "toy" / "rows=2").plan.steps[0].name == "pillars counted"
    assert not read_study(tmp_path / "toy").cases[0].record.wanted


def test_a_measure_that_was_not_registered_is_refused(tmp_path: Path) -> None:
    (tmp_path / "toy.toml").write_text(f'[study]\ncase = "{SMALL}"\nmeasure = ["density"]\n')
    with pytest.raises(InputError, match="must be a list of modes, confinement, bands"):
        load_study(tmp_path / "toy.toml")


@pytest.mark.parametrize("measure", registry.MEASURES, ids=lambda measure: measure.name)
def test_every_measure_plans_a_step_of_its_name(measure: Measure) -> None:
    lacking = {"tolerance": ["tolerance.samples=2", "tolerance.height_mm=0.05"], "touch": ["touch.radius_mm=5.0"]}
    step = measure.plan(load_case(FULL, [line for table in measure.needs for line in lacking.get(table, [])]))
    assert isinstance(step, Step) and step.measure == measure.name


def test_names_and_columns_are_each_once() -> None:
    columns = [column.name for measure in registry.MEASURES for column in measure.columns]
    assert len(set(columns)) == len(columns) and len(set(registry.names())) == len(registry.names())


@pytest.mark.parametrize(
    ("measure", "said"), [("response", r"\[patches\]"), ("tolerance", r"\[tolerance\]"), ("touch", r"\[touch\]")]
)
def test_what_a_case_lacks_is_named(measure: str, said: str) -> None:
    with pytest.raises(InputError, match=rf"{said}: missing, the measure {measure} needs it"):
        registry.check(load_case(SMALL), [measure])
