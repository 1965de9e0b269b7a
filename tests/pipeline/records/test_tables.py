import csv
from dataclasses import replace
from itertools import product
from pathlib import Path
from typing import Any

import pytest

from pipeline.questions import study as asked
from pipeline.questions.bands import BandPoint, BandsResult, Gap
from pipeline.records import outputs, store, tables
from pipeline.records.record import Record
from pipeline.records.study import read_study
from pipeline.records.tables import Column
from tests.helpers import synthetic


def put(study: Path, case_id: str, sweep: dict, **sections: Any) -> dict:
    folder = study / case_id
    folder.mkdir(parents=True)
    store.seal(folder, synthetic.case(case_id, sweep, **{"diagnosis": "done", **sections}).record.to_dict())
    return {"case_id": case_id, "sweep": sweep}


def read(path: Path) -> list[dict[str, str]]:
    with path.open(newline="") as file:
        return list(csv.DictReader(file))


@pytest.fixture
def study(tmp_path: Path) -> Path:
    modes = [
        synthetic.modes(synthetic.target(level, 31234.5678, mac=0.91234567, rivals=[]), dof=1234)
        for level in (10.0, 9.99)
    ]
    gaps = [
        Gap(lower_band=1, upper_band=2, lower_hz=low, upper_hz=high) for low, high in ((1.0, 2.0), (163.1e3, 175.8e3))
    ]
    corner = BandPoint(label="M", kx_per_m=1.0, ky_per_m=1.0, frequencies_hz=[32540.0, 32541.0, 80e3])
    bands = BandsResult(model="solid", dof=99, points=[corner], gaps=gaps)
    listed = [
        put(tmp_path, "b", {"array.rows": 2}, modes=modes[0]),
        put(tmp_path, "a", {"array.rows": 1}, modes=modes[1]),
        put(tmp_path, "f", {"array.rows": 3}, status="FAILED", diagnosis='no count, "31 kHz"'),
        put(tmp_path, "cell", {"array.rows": 0}, bands=bands),
        {"case_id": "gone", "sweep": {"array.rows": 4}},
    ]
    store.write_sealed(tmp_path / "cases.json", {"schema": 1, "about": {}, "cases": listed})
    return tmp_path


def test_a_key_that_changes_no_figure_is_told(tmp_path: Path) -> None:
    """Rows change the level, the quality factor changes nothing; a case that failed says nothing of either."""

    def written(name: str, shift: float) -> list[str]:
        listed = []
        for number, (rows, quality_factor) in enumerate(product((1, 2), (100.0, 300.0))):
            modes = synthetic.modes(synthetic.target(10.0 + rows + shift * quality_factor, 31e3, mac=0.9, rivals=[]))
            listed.append(
                put(tmp_path / name, f"c{number}", {"array.rows": rows, "damping.quality": quality_factor}, modes=modes)
            )
        listed.append(put(tmp_path / name, "f", {"array.rows": 1, "damping.quality": 9.0}, status="FAILED"))
        store.write_sealed(tmp_path / name / "cases.json", {"schema": 1, "about": {}, "cases": listed})
        study = read_study(tmp_path / name)
        return tables.without_effect(study, asked.columns_of(study))

    assert written("same", 0.0) == ["damping.quality"]
    assert written("moves", 1e-3) == []


def test_a_row_per_case_in_the_study_s_order(study: Path):
    rows = read(asked.write_table(study))
    assert [row["case"] for row in rows] == ["b", "a", "f", "cell", "gone"]
    assert [row["array.rows"] for row in rows] == ["2", "1", "3", "0", "4"]
    assert rows[0]["target_hz"] == "31234.5678" and rows[0]["mac"] == "0.91234567" and rows[0]["dof"] == "1234"
    assert [row["confined"] for row in rows] == ["yes", "no", "", "", ""]
    assert rows[0]["count_check"] == "holds"
    assert (rows[2]["status"], rows[2]["diagnosis"]) == ("FAILED", 'no count, "31 kHz"')
    assert (rows[3]["gap_lower_hz"], rows[3]["gap_upper_hz"]) == ("163100.0", "175800.0")  # the widest
    assert rows[3]["bending_m_2_hz"] == "32541.0" and rows[3]["dof"] == "99"
    assert (rows[4]["status"], rows[4]["diagnosis"]) == ("MISSING", "record.json is missing")


def test_columns_only_where_some_case_has_them_and_no_times(study: Path):
    header = asked.write_table(study).read_text().splitlines()[0].split(",")
    assert not {"mass_kg", "pillar_share", "rivals"} & set(header)
    assert not [name for name in header if "second" in name or "time" in name]


def test_the_same_records_give_the_same_bytes(study: Path):
    first = asked.write_table(study).read_bytes()
    store.write_json(study / "b" / store.TIMING, {"seconds": {"total": 99.0}})
    assert asked.write_table(study).read_bytes() == first


@pytest.mark.parametrize("text", ["=cmd|'/C calc'!A0", "+1+1", "-2+3", "@SUM(A1)", "\t=1", "\n=1"])
def test_a_swept_text_is_no_formula_of_a_spreadsheet(study: Path, text: str):
    put(study, "formula", {"name": text}, status="FAILED", diagnosis=text)
    listed = store.read_json(study / "cases.json")["cases"]
    listed.append({"case_id": "formula", "sweep": {"name": text, "array.rows": -1}})
    store.write_sealed(study / "cases.json", {"schema": 1, "about": {}, "cases": listed})
    row = read(asked.write_table(study))[-1]
    assert row["name"] == row["diagnosis"] == f"'{text}"
    assert row["array.rows"] == "-1"  # numbers stay numbers


def test_a_return_in_a_swept_text_ends_no_row(study: Path):
    listed = [{"case_id": "gone", "sweep": {"name": "a\rb"}}]
    store.write_sealed(study / "cases.json", {"schema": 1, "about": {}, "cases": listed})
    assert [row["name"] for row in read(asked.write_table(study))] == ["a\\rb"]


def test_a_signed_number_is_no_formula():
    assert [outputs.no_formula(text) for text in ("-1.5", "+12.30", "-3e-05", "a=b", "")] == [
        "-1.5", "+12.30", "-3e-05", "a=b", "",
    ]  # fmt: skip


def test_a_count_that_does_not_hold_is_told(study: Path):
    modes = synthetic.record_of(study / "b").modes
    synthetic.change(study / "b", modes=replace(modes, count_check=synthetic.count(7, 6)))
    assert read(asked.write_table(study))[0]["count_check"] == "6 of 7"


def test_nothing_stored_is_one_clear_line(tmp_path: Path):
    with pytest.raises(store.BadRecord, match="run it first"):
        asked.write_table(tmp_path)


def test_the_file_holds_numbers_and_a_reader_sees_the_digits_of_the_bar() -> None:
    column = Column("hz", "mode", lambda _: 31234.56789012345, "Hz", lambda _: 3e-3)
    error, level = Column("e", "error", lambda _: 3.3e-3, "%"), Column("db", "level", lambda _: 11.62, "dB")
    record = Record(case_id="a", status="OK")
    assert [each.cell(record) for each in (column, error, level)] == [31234.56789, 0.0033, 11.62]
    assert [each.text(record) for each in (column, error, level)] == ["31230", "0.33", "11.6"]
    assert Column("db", "level", lambda _: 11.6243, "dB", lambda _: 0.06).text(record) == "11.62"
    shift = Column("s", "shift", lambda _: 21.4, "Hz", lambda _: 30.0, is_difference=True, is_signed=True)
    assert shift.text(record) == "+21" and shift.cell(record) == 21.4
    assert Column("mac", "MAC", lambda _: 0.91234, "").text(record) == "0.912"
    assert Column("swept", "swept", lambda _: 2.12345678).text(record) == "2.12345678"


def test_no_column_of_a_figure_with_an_estimate_lacks_its_bar() -> None:
    """Every column of a measure in whose record an error of the same name stands."""
    columns = {column.name: column for each in asked.questions() for column in asked.columns(each)}
    named = ("target_hz", "confinement_db", "mac", "zone_share", "strength", "gap_lower_hz", "db_per_row", "rows_db")
    named += ("target_peak_hz", "target_peak_nm_per_v", "highest_peak_hz", "touched_um", "touched_db", "touch_share")
    named += (
        "touch_quality_factor",
        "touch_shift_hz",
        "hybrid_both_db",
        "hybrid_both_v_per_um",
        "travel_hz",
        "travel_twr",
    )
    named += ("travel_db", "travel_mw", "crosstalk_db", "crosstalk_hz", "stopped_width_hz", "live_confinement_db")
    assert [name for name in named if columns[name].bar is None] == []
