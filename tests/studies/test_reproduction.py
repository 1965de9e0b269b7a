"""The page of the thesis' figures: verdicts follow the numbers, missing studies are named, pillars are computed."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from pipeline.batch.study_file import load_study
from pipeline.models.answer_parts import DrivenZone, TargetMode, TouchStateRecord
from pipeline.questions.crosstalk import CrosstalkResult
from pipeline.questions.touch import TouchResult
from pipeline.records.record import (
    PillarRecord,
    SectionRecord,
)
from studies import reproduction
from tests.helpers.synthetic import design


@pytest.mark.parametrize(
    ("thesis", "ours", "verdict"),
    [
        (32.0, 32.5, "agrees"),
        (32.0, 33.0, "differs by +3.1%"),
        ("leaks", "leaks (5.7 dB)", "agrees"),
        ("confined", "leaks (9.9 dB)", "differs"),
    ],
)
def test_the_verdict_follows_the_figures(thesis: object, ours: object, verdict: str) -> None:
    assert reproduction.verdict_of(thesis, ours) == verdict


@pytest.mark.slow
def test_pillars_get_lower_as_they_get_longer() -> None:
    rows = {row[0]: row[2] for row in reproduction.pillars()}
    tones = [float(text.split(" kHz")[0]) for text in rows.values()]
    assert tones == sorted(tones)
    assert tones[0] == pytest.approx(32.633, abs=0.005)  # (1.8751)^2 / 2 pi * h / l^2 sqrt(E / 12 rho)


def test_studies_that_were_not_run_are_named(tmp_path: Path) -> None:
    result, missing = reproduction.plates(tmp_path)
    assert result == []
    assert missing == list(reproduction.STUDIES)


@pytest.mark.parametrize("name", reproduction.STUDIES)
def test_what_the_page_asks_to_run_is_a_study(name: str) -> None:
    assert load_study(name).name == name


def test_the_page_names_the_wishes_that_are_not_stored(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("pillars", "active"):
        monkeypatch.setattr(reproduction, name, lambda *_: [])
    page = reproduction.text(tmp_path)
    assert page.endswith(
        "Not stored: graded, touch, glass, hybrid, travelling, zones, faces, staggered (`antinode run NAME`).\n"
    )
    assert [load_study(name).name for name in ("graded", "graded-heights")] == ["graded", "graded-heights"]


def test_heights_off_together_belong_to_one_design() -> None:
    assert reproduction._off_mm((6.1, 5.5), (6.2, 5.6)) == pytest.approx(-0.1)
    assert reproduction._off_mm((6.1, 5.6), (6.2, 5.6)) is None is reproduction._off_mm((6.7, 6.1), (6.2, 5.6))


def test_the_outlook_appears_once_its_study_is_stored(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A record with two states: what is known stands in the table, what is not says so; no zero is made of none."""
    finger = next(wish for wish in reproduction.WISHES if wish.study == "touch")
    figures: dict[str, Any] = {name: 2e-7 if name.endswith("_m") else 0.5 for name in TouchStateRecord.declared}
    touched = TouchStateRecord(**{**figures, "state": "touched", "confinement_db": None, "drawn_mW_at_1um": 7.5})
    free = replace(touched, state="free", confinement_db=12.0, finger_m=9e-7)
    texts: dict[str, Any] = {"model": "", "fingertip": "", "source": "", "states": [free, touched], "unknown": []}
    numbers: dict[str, Any] = {
        "dof": 1,
        "at_m": (0, 0),
        "radius_m": 5e-3,
        "impedance_N_s_m": (5, 0),
        "quality_factor_given": 300,
    }
    empty: dict[str, Any] = dict.fromkeys(("force_N", "gap_m", "mode", "loop", "map"))
    touch = TouchResult(**texts, **numbers, **empty)
    records = [
        SimpleNamespace(sweep={"array.rows": 2, "touch.impedance": name}, of=lambda kind: touch)
        for name in ("finger", "light")
    ]
    monkeypatch.setattr(
        reproduction, "read_study", lambda folder: SimpleNamespace(cases=[SimpleNamespace(record=r) for r in records])
    )
    monkeypatch.setattr(reproduction, "PAGE", tmp_path / "page.md")
    (tmp_path / "pictures").mkdir()
    page = finger.text(tmp_path)
    assert "| 2 rows, finger | unknown | 0.9 | 0.2 | 12.0 | none | none | 7.5 mW | none |" in page
    assert "light |" not in page and "light" in (tmp_path / "pictures" / "touch.svg").read_text()
    assert (tmp_path / "pictures" / "touch.svg").stat().st_size > 1000 and "(pictures/touch.svg)" in page


def test_the_cover_glass_appears_once_its_study_is_stored(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A plate with tips and its target mode; a bare one without any says none in every place."""
    glass = next(wish for wish in reproduction.WISHES if wish.study == "glass")
    assert glass.text(tmp_path) == "" and load_study("glass").name == "glass"
    small = {"shape": "square", "base_m": 1e-3, "tip_m": 1e-3, "height_m": 2e-3, "fillet_m": 0.0}
    heavy = PillarRecord(**small, upper=(SectionRecord(shape="square", base_m=1.5e-3, tip_m=1.5e-3, height_m=9e-4),))
    plate = design(3, 4e-3, 0.01).model_copy(update={"pillar": heavy})
    mode = TargetMode(
        status="single", frequency_hz=30e3, mac=0.9, strength=0.5, confinement_db=15.5, confinement_error_db=0.25
    )
    known = SimpleNamespace(design=plate, target=mode, confinement_db=15.5)
    bare = SimpleNamespace(design=design(0, 4e-3, 0.01), target=None, confinement_db=None)
    cases = [SimpleNamespace(record=record) for record in (known, bare)]
    monkeypatch.setattr(reproduction, "read_study", lambda folder: SimpleNamespace(cases=cases))
    monkeypatch.setattr(reproduction, "PAGE", tmp_path / "page.md")
    (tmp_path / "pictures").mkdir()
    page = glass.text(tmp_path)
    picture = (tmp_path / "pictures" / "glass.svg").read_text()
    assert "heavy caps" in picture and "no pillars" not in picture  # a plate without a level has no mark
    tips = "1 x 2 | 1.5 x 0.9"
    assert f"| 3 | {tips} | 20 | 30.00, single | 15.5 ± 0.2 |" in page
    assert "| 0 | none | none | 20 | none | none |" in page


def test_one_section_is_written_anew_and_the_rest_is_left(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    page = "# Page\n\nwords\n\n## One\n\nold\n\n## Two\n\nkept\n"
    assert reproduction.renewed(page, ["\n## One\n\nnew\n"]) == page.replace("old", "new")
    assert reproduction.renewed(page, ["\n## Three\n\nlast\n"]) == f"{page}\n## Three\n\nlast\n"
    assert reproduction.renewed(page, []) == page
    table = "| a | b |\n| one row (x) | old |\n| one row (x) more | kept |\n"
    assert reproduction.with_rows(table, [("one row (x)", "new")]) == table.replace("old", "new")
    for name in ("faces", "extension", "nothing"):
        monkeypatch.setattr("sys.argv", ["reproduction", "--results", str(tmp_path), "--only", name])
        with pytest.raises(SystemExit, match=f"--only {name}: must be a stored study of rows, .*graded, touch, glass"):
            reproduction.main()


def test_pillars_on_both_faces_stand_beside_those_on_one() -> None:
    plate = design(2, 4e-3, 0.01)
    assert plate.pillar
    both = plate.model_copy(update={"pillar": plate.pillar.model_copy(update={"faces": 2})})
    bands = None, SimpleNamespace(stopped_hz=(28e3, 36.5e3))
    records = [
        SimpleNamespace(design=each, target=None, confinement_db=12.0, of=lambda kind, band=band: band)
        for each, band in zip((plate, both), bands, strict=True)
    ]
    rows = [reproduction._of_faces(record) for record in records]  # type: ignore[arg-type]
    assert rows[0] == ("2", "back alone", "none", "none", "12.0")
    assert rows[1] == ("2", "both", "28.0 to 36.5", "none", "12.0")


def test_shifted_rows_stand_beside_rows_in_line_with_the_gap_of_their_own_lattice() -> None:
    plate = design(3, 5e-3, 0.025)
    shifted = plate.model_copy(update={"staggered": True})
    gaps = [SimpleNamespace(lower_hz=158.4e3, upper_hz=170.2e3)], []
    bands = [SimpleNamespace(gaps=own, known_to_hz=110e3) for own in gaps]
    records = [
        SimpleNamespace(design=each, target=None, confinement_db=None, of=lambda kind, own=own: own)
        for each, own in zip((plate, shifted), bands, strict=True)
    ]
    rows = [reproduction._of_staggered(record) for record in records]  # type: ignore[arg-type]
    assert rows[0] == ("3", "in line", "158.4 to 170.2", "none", "none")
    assert rows[1] == ("3", "shifted", "none up to 110.0", "none", "none")


def test_a_wish_stands_on_the_page_once_its_study_is_stored(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Rows come from the records; a record without the figure leaves its row out, and no row leaves the section out."""
    monkeypatch.setattr(reproduction, "PAGE", tmp_path / "page.md")
    (tmp_path / "pictures").mkdir()
    assert all(wish.text(tmp_path) == "" and load_study(wish.study).name == wish.study for wish in reproduction.WISHES)

    def zone(level: float) -> DrivenZone:
        own = {"centre_m": 0.0, "drivers": [0], "peak_hz": 34.9e3, "rms_m_per_V": [1e-9, 1e-10], "over_rms_m_per_V": []}
        return DrivenZone(**own, level_db=[0.0, level], passive_db=None)

    def record(rows: int, level: float) -> SimpleNamespace:
        crosstalk = CrosstalkResult(
            model="", dof=1, shared_rows=rows, gap_m=rows * 4e-3, frequency_hz=[], zones=[zone(level)]
        )
        return SimpleNamespace(of=lambda kind: crosstalk)

    cases = [
        SimpleNamespace(record=each)
        for each in (record(2, -3.0), SimpleNamespace(of=lambda kind: None), record(6, -21.0))
    ]
    monkeypatch.setattr(reproduction, "read_study", lambda folder: SimpleNamespace(cases=cases))
    zones = next(wish for wish in reproduction.WISHES if wish.study == "zones")
    page = zones.text(tmp_path)
    assert "| 2 | 8.0 | 34.90 | -3.0 | none |" in page and page.count("\n|") == 4
    assert (tmp_path / "pictures" / "zones.svg").stat().st_size > 1000
