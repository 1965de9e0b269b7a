"""The headline of a study's page: every figure of one design, named, and no design counted twice."""

from __future__ import annotations

import json
import xml.etree.ElementTree as ET
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from pipeline.case.model import load_case
from pipeline.models.answer_parts import SpreadRecord
from pipeline.paths import RESULTS, ROOT
from pipeline.plots.fields import level_text
from pipeline.questions import study as asked
from pipeline.questions.bands import BandPoint, BandsResult, Gap
from pipeline.records.record import DesignRecord
from pipeline.records.study import StoredCase, StoredStudy
from pipeline.report import page as report_page
from pipeline.report import shapes, text
from pipeline.report.gallery import sketch
from pipeline.report.text import confinement_words
from tests.helpers import synthetic


def plate(pitch: int, rows: int, level_db: float, driven_db: float | None = None, **more: Any) -> StoredCase:
    """A record of one plate with the gap and the bending band of its own pitch."""
    gap = Gap(lower_band=9, upper_band=10, lower_hz=1e3 * pitch, upper_hz=2e3 * pitch)
    corner = BandPoint(label="M", kx_per_m=1.0, ky_per_m=1.0, frequencies_hz=[10e3 * pitch])
    text = replace(synthetic.prediction(rows, level_db), db_per_row=5.0 + pitch, rows_needed=2)
    driven = {} if driven_db is None else {"response": synthetic.response(driven_db)}
    return synthetic.case(
        more.get("name", f"p{pitch}r{rows}"),
        more.get("sweep", {"array.pitch_mm": pitch, "array.rows": rows}),
        design=synthetic.design(rows, 1e-3 * pitch, 5e-3),
        modes=synthetic.modes(synthetic.target(level_db, 35e3, mac=0.98)),
        bands=BandsResult(model="solid", dof=1, points=[corner], gaps=[gap]),
        prediction=text,
        **driven,
    )


@pytest.fixture
def study() -> StoredStudy:
    grid = [plate(p, r, 3.0 * r + p) for p in (4, 6) for r in (1, 2, 3)]
    base = plate(4, 3, 13.0, name="base", sweep={})
    return StoredStudy(Path("s"), {}, (base, *grid))


def cards(study: StoredStudy) -> dict[str, Any]:
    return {card.name: card for card in text.cards(study)}


def test_bending_is_that_of_the_best_plate_and_names_it(study: StoredStudy) -> None:
    """Best: pitch 6, three rows, 15 dB; the first plate of the list has pitch 4."""
    said = " ".join(text.sentences(study))
    assert "p6r3 meet M at 60.0\u202fkHz" in said
    assert all("p6r3" in card.note for name, card in cards(study).items() if name != "Cases")


def test_plates_of_one_shape_and_two_materials_are_two(study: StoredStudy) -> None:
    """The second of them holds its mode better: it is the best plate, and all seven are ranked."""
    brass = plate(6, 3, 31.0, name="brass", sweep={"material.plate": "brass"})
    assert brass.record.keys
    keys = brass.record.keys.model_copy(update={"plate": "brass"})
    other = brass.record.model_copy(update={"keys": keys})
    both = StoredStudy(Path("s"), {}, (*study.cases, replace(brass, record=other)))
    assert len(text.plates(both)) == len(text.plates(study)) + 1
    best = text.best_case(both)
    assert best is not None and best.case_id == "brass"


def test_a_level_of_exactly_ten_decibels_confines() -> None:
    assert plate(4, 1, 10.0).record.confined and not plate(4, 1, 9.999).record.confined
    assert plate(4, 1, 10.0, 9.0).record.verdict == "confined as a mode, not as driven"


def test_large_studies_compare_no_design_with_every_other(study: StoredStudy, monkeypatch: pytest.MonkeyPatch) -> None:
    """A sweep of thousands of cases is grouped by its designs' keys."""

    def compared(*_: object) -> bool:
        raise AssertionError("a design was compared with another")

    monkeypatch.setattr(DesignRecord, "__eq__", compared)
    assert text.headline(study) and text.facts_of(study)
    assert [study.with_cross_checks(case).case_id for case in study.cases] == [case.case_id for case in study.cases]


def test_rows_needed_are_those_of_finite_plates_beside_the_endless_estimate(study: StoredStudy) -> None:
    """The best plate has pitch 6: of two rows it holds its mode, of one row it does not (9 dB)."""
    rows = next(card for name, card in cards(study).items() if name.startswith("Rows"))
    assert rows.value == "2" and "finite plate" in rows.note and "an infinite array would need 2" in rows.note
    lone = StoredStudy(Path("s"), {}, (plate(4, 1, 7.0),))
    (rows,) = [card for name, card in cards(lone).items() if name.startswith("Rows")]
    assert rows.value == "≥ 2" and "estimate for an infinite array" in rows.note


@pytest.mark.parametrize(
    ("rows", "target_hz", "value"),
    [(2, 33.5e3, "32.0–34.0"), (5, 33.5e3, "29.0–37.0"), (2, 34.5e3, "not at"), (1, 33e3, "not at")],
)
def test_the_band_of_the_rows_is_where_they_take_ten_decibels(rows: int, target_hz: float, value: str) -> None:
    """Of 6 dB per row at 33 kHz, 1 dB less for every kilohertz away from it."""
    modes = synthetic.modes(synthetic.target(12.0, target_hz))
    held = synthetic.case(
        "p", design=synthetic.design(rows, 4e-3, 5e-3), modes=modes, attenuation=synthetic.attenuation(rows)
    )
    (card,) = [card for name, card in cards(StoredStudy(Path("s"), {}, (held,))).items() if " take 10" in name]
    assert card.value.startswith(value) and (card.severity == "bad") == (value == "not at")


def test_a_band_that_the_computation_cuts_says_so() -> None:
    """With 40 rows, every frequency from 27.25 to 38.75 kHz is enough; the computed band ends at 25 and 45 kHz."""
    wide = synthetic.attenuation(40)
    assert text.band_of_rows(wide, 33e3) == pytest.approx((27.25e3, 38.75e3))
    part = replace(wide, points=[each for each in wide.points if 29e3 <= each.frequency_hz <= 45e3])
    modes = synthetic.modes(synthetic.target(12.0, 33e3))
    cut = synthetic.case("p", design=synthetic.design(4, 4e-3, 5e-3), modes=modes, attenuation=part)
    (card,) = [card for name, card in cards(StoredStudy(Path("s"), {}, (cut,))).items() if " take 10" in name]
    assert "or wider: the computed band ends there" in card.note and card.value.startswith("29.0")


def test_the_drive_for_one_micrometre_is_that_of_the_driven_peak() -> None:
    """30 nm/V rms at the peak: a micrometre takes 33.3 V."""
    one = cards(StoredStudy(Path("s"), {}, (plate(4, 3, 12.0, 11.0),)))["Drive for 1\u202fµm"]
    assert one.value.startswith("33.3") and "30.0" in one.note and "quality factor of 300" in one.note
    assert not [name for name in cards(StoredStudy(Path("s"), {}, (plate(4, 3, 12.0),))) if "Drive" in name]


def test_a_plate_computed_beside_its_sweep_counts_once(study: StoredStudy) -> None:
    assert "4 of 6 plates confine the target mode" in " ".join(text.sentences(study))
    assert "best of 6 plates" in cards(study)["Confined to the zone"].note


def test_a_mode_held_but_not_as_driven_is_not_confined() -> None:
    """The reference design's 12.2 dB as a mode are 9.3 dB driven."""
    driven = plate(4, 3, 12.2, 9.3)
    assert driven.record.confined is False
    assert text.verdict(driven.record) == "confined as a mode, not as driven"
    assert level_text(driven).startswith(f"{driven.record.verdict}: ") and "dB as driven" in level_text(driven)
    assert plate(4, 3, 12.2, 10.1).record.confined is True and plate(4, 3, 9.9, 10.1).record.confined is False
    clamped = cards(StoredStudy(Path("s"), {}, (driven,)))["Confined to the zone"]
    note, value = (words.replace("\u202f", " ") for words in (clamped.note, clamped.value))
    assert value == "9.3 dB" and "driven at its own peak, 12.2 dB as a mode" in note and clamped.severity == "bad"


def test_designs_with_patches_are_ranked_as_driven() -> None:
    """The best as a mode is the worst as driven: it is no headline."""
    study = StoredStudy(Path("s"), {}, (plate(6, 4, 17.4, 15.3), plate(5, 4, 16.0, 20.0)))
    best = text.best_case(study)
    assert best is study.cases[1]
    said = text.headline(study).replace("\u202f", " ")
    assert "20.0 dB as driven, 16.0 dB as a mode" in said and "moves 10.0 times as much" in said


def test_without_a_target_mode_nothing_is_claimed() -> None:
    record = plate(4, 3, 12.0).record.with_parts(modes=synthetic.modes(synthetic.NO_MODE))
    assert record.target is None and record.confined is None and record.target_status == "none"
    assert set(cards(StoredStudy(Path("s"), {}, (StoredCase(Path("none"), record),)))) == {"Cases"}
    json.dumps(record.to_dict(), allow_nan=False)


def test_the_lead_tells_the_best_plate_in_words_that_need_no_glossary(study: StoredStudy) -> None:
    said = text.headline(study)
    assert said.startswith(
        "Best of this study: 3 rows of pillars 6\u202fmm apart on each side of the zone. At 35.0\u202fkHz"
    )
    assert (
        "moves 5.62 times as much as the rest of the plate (15.0\u202fdB; 10\u202fdB counts as confined)" in said
    )  # 10^(15/20)
    assert text.command(StoredStudy(Path("s"), {"case": "own.toml"}, study.cases), study.cases[-1]) == (
        "antinode modes own.toml --set array.pitch_mm=6 --set array.rows=3"
    )
    ours = StoredStudy(RESULTS / "rows", {"case": "three-rows.toml"}, study.cases)
    assert text.command(ours, study.cases[-1]).startswith("antinode modes studies/three-rows.toml --set")


@pytest.mark.parametrize(
    ("name", "said"),
    [
        ("examples/25-display.toml", ["aluminosilicate on optically-clear-adhesive on glass", "pillars of aluminium"]),
        ("studies/glass-plate.toml", ["glass", "pillars of aluminium under steel"]),
        ("studies/three-rows.toml", ["aluminium"]),
    ],
)
def test_the_facts_name_every_material(name: str, said: list[str]) -> None:
    assert text._materials(load_case(ROOT / name).to_dict()["design"]) == said


def test_the_facts_name_plate_pillars_day_and_program(study: StoredStudy, tmp_path: Path) -> None:
    (tmp_path / "journal.jsonl").write_text('{"at": "2031-05-06T07:08:09+00:00", "event": "run"}\n')
    facts = text.facts_of(StoredStudy(tmp_path, {"measure": ["modes"]}, study.cases))
    assert {"7 cases of modes", "computed 2031-05-06"} <= set(facts) and facts[-1].startswith("Antinode 0.")
    assert text.computed_on(StoredStudy(tmp_path / "none", {}, study.cases)) == ""
    (tmp_path / "journal.jsonl").write_text("torn")
    assert text.computed_on(StoredStudy(tmp_path, {}, study.cases)) == ""


def test_the_table_shows_frequencies_in_khz_and_few_columns_first(study: StoredStudy) -> None:
    columns = {column.name: column for column in asked.columns_of(study)}
    target, rows, zone = columns["target_hz"], columns["array.rows"], columns["zone_share"]
    record = study.cases[-1].record
    assert (target.shown_unit, target.shown(record), target.style("")) == ("kHz", "35.0", "number")
    assert rows.is_main and not zone.is_main and zone.style("") == "number more"
    assert sum(column.is_main for column in columns.values()) <= 10 < len(columns)


def test_a_plate_computed_beside_the_sweep_is_that_of_the_sweep(study: StoredStudy) -> None:
    base, swept = study.cases[0], study.cases[3]
    assert report_page._twin(study, base) is swept and report_page._twin(study, swept) is None


def test_the_sketch_has_every_pillar_and_the_dimensions(study: StoredStudy) -> None:
    design = study.cases[-1].record.design
    assert design is not None
    markup = str(sketch(design))
    (pillars,) = ET.fromstring(markup).findall("path")
    assert pillars.attrib["d"].count("z") == len(design.pillar_centres_m) > 0
    assert f"{design.length_m * 1e3:g} × {2e3 * design.half_span_m:g} ×" in markup


def test_words_have_the_digits_of_their_bars() -> None:
    """Of a mode known to 12 % and 4 dB, and of ten plates that spread by 200 Hz and 2 dB."""
    known = synthetic.target(12.24, 35.21e3, mac=0.98, frequency_error=0.12, confinement_error_db=4.0)
    case = synthetic.case("one", {}, modes=synthetic.modes(known))
    about = shapes._words(case, 35.21e3, target=True)["about"]
    assert "at 35 kHz, 12 dB" in about and ": 12 dB (confined" in level_text(case)
    said = confinement_words(12.24, 9.31, 4.0)
    assert said == "confined (12 dB as a mode, 9.3 dB driven by its patches, which is not confined)"
    peak = SpreadRecord(mean=35.21e3, deviation=200.0, lowest=35e3, highest=36e3)
    level = SpreadRecord(mean=12.24, deviation=2.0, lowest=9.87, highest=15.0)
    assert (peak.spread(10, "Hz"), level.spread(10, "dB")) == ("200 Hz", "2.0 dB")
    assert peak.relative == 200.0 / 35.21e3
