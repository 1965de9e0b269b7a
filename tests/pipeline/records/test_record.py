"""The record of a case: written and read by the same classes, refused as a whole where it is of another version."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from pydantic import ValidationError

from pipeline.batch import runner
from pipeline.models.answer_parts import TargetMode
from pipeline.questions.modes import ModesResult
from pipeline.questions.response import PeakRecord
from pipeline.records import record, store
from pipeline.records.record import PillarRecord, Record, SectionRecord
from tests.helpers import fake_study, synthetic


def stored(folder: Path) -> Record:
    folder.mkdir(exist_ok=True)
    made = synthetic.record(folder.name, {"array.rows": 1}, synthetic.design(1, 4e-3, 5e-3), 12.0)
    store.seal(folder, made.to_dict())
    return made


def test_what_was_written_is_read_field_by_field(tmp_path: Path) -> None:
    made = stored(tmp_path / "case")
    read = record.read(tmp_path / "case")
    assert read == made and isinstance(read.target, TargetMode)
    text = json.loads((tmp_path / "case" / store.RECORD).read_text())
    assert text["schema"] == store.SCHEMA and text["modes"]["modes"][0]["frequency_hz"] == 31500.0
    assert "tolerance" not in text  # nothing stands for what was not measured


@pytest.mark.parametrize("number", [None, 1, store.SCHEMA - 1, store.SCHEMA + 1])
def test_an_older_record_is_refused_by_its_number_and_computed_again(tmp_path: Path, number: int | None) -> None:
    folder = tmp_path / "value=0"
    (job,) = fake_study.jobs(1)
    mark = store.current_fingerprint()
    store.begin(folder, job.payload)
    made = Record(case_id=folder.name, status="OK", code_hash=mark.code_hash, versions=mark.versions)
    whole = {**made.to_dict(), "input_hash": store.input_hash(job.payload)}
    store.seal(folder, whole)
    assert runner.plan([job], tmp_path)[0].why is None  # it stands
    store.seal(folder, {**whole, "schema": number})
    (planned,) = runner.plan([job], tmp_path)
    is_older = number is not None and number < store.SCHEMA
    said = store.EARLIER if is_older else f"has schema {number}, this version reads {store.SCHEMA}"
    assert planned.why is not None and said in planned.why
    with pytest.raises(store.BadRecord, match=said):
        record.read(folder)


def test_a_field_that_is_not_of_this_version_refuses_the_record_by_its_place(tmp_path: Path) -> None:
    made = stored(tmp_path / "case").to_dict()
    made["modes"]["modes"][2]["hz"] = 3e4
    store.seal(tmp_path / "case", made)
    with pytest.raises(store.BadRecord, match=r"not a record of schema 5: modes\.modes\.2\.hz: "):
        record.read(tmp_path / "case")


def test_no_number_is_none_where_that_is_allowed_and_refused_elsewhere() -> None:
    peak = {"frequency_hz": 3e4, "zone_rms_m_per_V": 1e-8, "passive_rms_m_per_V": None, "confinement_db": None}
    assert PeakRecord(**peak, quality_factor=float("nan")).quality_factor is None
    assert PeakRecord(**peak, quality_factor=np.float64("inf")).quality_factor is None
    with pytest.raises(ValidationError):
        PeakRecord.from_dict({**peak, "frequency_hz": None, "quality_factor": None})
    with pytest.raises(ValidationError):
        synthetic.response(1.0).from_dict({**synthetic.response(1.0).values(), "frequency_hz": [None]})


def test_what_was_measured_once_stood_beside_the_response_and_is_still_read(tmp_path: Path) -> None:
    made = Record(case_id="c", status="OK", response=synthetic.response(12.0)).to_dict()
    field = {"sweep": None, "map": None}
    before = {**made, "response": {k: v for k, v in made["response"].items() if k != "measured"}, "measured": field}
    assert Record.model_validate(before).response.measured.values() == field


def test_without_a_target_mode_no_figure_of_it_is_claimed() -> None:
    modes = ModesResult.from_document(json.loads(json.dumps(synthetic.modes(synthetic.NO_MODE).to_dict())))
    result = Record(case_id="c", status="OK", modes=modes)
    assert result.target is None and result.target_status == "none" and result.confined is None
    assert modes.to_dict()["target"]["frequency_hz"] is None


@pytest.mark.parametrize(
    ("level", "driven", "confined"), [(12.2, 9.3, False), (12.2, 10.1, True), (9.9, 10.1, False), (None, 12.0, None)]
)
def test_confined_means_as_a_mode_and_driven(level: float | None, driven: float, confined: bool | None) -> None:
    modes = synthetic.modes(synthetic.target(level))
    assert Record(case_id="c", status="OK", modes=modes, response=synthetic.response(driven)).confined is confined


def test_what_has_no_field_of_its_own_is_kept_beside() -> None:
    result = Record.of_case({"density": {"per_cm2": 1.5}, "other": {"kept": 1}}, case_id="c", status="OK")
    assert result.other == {"kept": 1, "density": {"per_cm2": 1.5}}
    assert Record.model_validate(result.to_dict()) == result


def test_a_pillar_is_as_high_as_its_sections_together() -> None:
    upper = (SectionRecord(shape="square", base_m=1e-3, tip_m=1e-3, height_m=2e-3),)
    one = PillarRecord(shape="square", base_m=2e-3, tip_m=2e-3, height_m=5e-3, fillet_m=0.0)
    assert one.top_m == 5e-3 and one.model_copy(update={"upper": upper}).top_m == pytest.approx(7e-3)


def test_a_response_without_the_target_modes_peak_has_no_driven_level() -> None:
    missed = replace(synthetic.response(9.0), target_peak=None)
    assert Record(case_id="c", status="OK", response=missed).driven_db is None
