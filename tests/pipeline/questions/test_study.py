"""Measures of studies: every one plans a step of its name and has columns of its own."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from pipeline.batch.study_file import load_study
from pipeline.case.model import load_case
from pipeline.errors import InputError
from pipeline.paths import ROOT
from pipeline.questions import study
from pipeline.questions.modes import Modes
from pipeline.questions.question import Question, Run, ask
from pipeline.records.record import Record
from pipeline.records.study import StoredCase
from tests.helpers.recording_log import RecordingLog

SMALL = ROOT / "examples" / "small.toml"
FULL = str(ROOT / "studies" / "three-rows.toml")


def test_a_measure_that_was_not_registered_is_refused(tmp_path: Path) -> None:
    (tmp_path / "toy.toml").write_text(f'[study]\ncase = "{SMALL}"\nmeasure = ["density"]\n')
    with pytest.raises(InputError, match="must be a list of modes, confinement, bands"):
        load_study(tmp_path / "toy.toml")


@pytest.mark.parametrize("question", study.questions(), ids=lambda question: question.name)
def test_every_question_plans_a_step_of_its_name(question: Question[Any]) -> None:
    lacking = {"tolerance": ["tolerance.samples=2", "tolerance.height_mm=0.05"], "touch": ["touch.radius_mm=5.0"]}
    case = load_case(FULL, [line for table in question.needs for line in lacking.get(table, [])])
    assert not question.spared(case) and question.plan(case).steps[0].measure == question.name


def test_names_and_columns_are_each_once() -> None:
    columns = [column.name for each in study.questions() for column in study.columns(each)]
    columns += [column.name for column in study.OF_SEVERAL]
    assert len(set(columns)) == len(columns) and len(set(study.names())) == len(study.names())


@pytest.mark.parametrize(
    ("measure", "said"), [("response", r"\[patches\]"), ("tolerance", r"\[tolerance\]"), ("touch", r"\[touch\]")]
)
def test_what_a_case_lacks_is_named(measure: str, said: str) -> None:
    with pytest.raises(InputError, match=rf"{said}: missing, the measure {measure} needs it"):
        study.check(load_case(SMALL), [measure])


@pytest.mark.slow
def test_a_part_that_is_asked_as_another_question_draws_nothing_of_its_own() -> None:
    """Modes of the bare zone and of the lone pillar are a result of `modes`, whose pictures are of the plate."""
    case = load_case(str(SMALL), ["solve.accuracy=0.1"])
    alone = ask(case, Modes(part="pillar", count=3), Run(RecordingLog()))
    record = Record(case_id="one", status="OK", pillar_modes=alone, zone_modes=alone)
    parts = [question for question in study.questions() if question.name in ("zone_modes", "pillar_modes")]
    assert len(parts) == 2 and alone.pictures()
    for question in parts:
        (draw,) = study._draws(question)
        assert draw(StoredCase(SMALL.parent, record), {}) is None
