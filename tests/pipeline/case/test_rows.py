"""Rows that differ: lists of the case file, what they become, and what is refused of them in one line."""

from __future__ import annotations

import copy
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from geometry.layout import Design
from pipeline.case.model import case_from_dict
from pipeline.cli.compare import _of_case, lined_up
from pipeline.errors import InputError
from pipeline.paths import STUDIES
from pipeline.records.record import DesignRecord
from pipeline.report.text import _same_design
from pipeline.search.terms import mass_kg

RAW: dict[str, Any] = {
    "name": "rows",
    "material": "aluminium",
    "plate": {"thickness_mm": 2.0},
    "zone": {"length_mm": 40.0, "width_mm": 12.0, "nodal_lines": 4},
    "pillar": {"shape": "square", "side_mm": 2.0, "height_mm": 6.3},
    "array": {"pitch_mm": 4.0, "rows": 3, "extension_mm": 5.0},
}
HEIGHTS = ("array.heights_mm", [6.3, 6.0, 5.7])


def design(*overrides: tuple[str, Any], raw: dict[str, Any] = RAW) -> Design:
    return case_from_dict(raw, None, overrides).design


def test_a_list_of_equal_rows_is_the_same_case_to_the_last_digit() -> None:
    alone = case_from_dict(RAW)
    listed = case_from_dict(
        RAW,
        None,
        [("array.heights_mm", [6.3] * 3), ("array.sides_mm", [2.0] * 3), ("array.pitches_y_mm", [4.0] * 3)],
    )
    assert listed.design == alone.design and listed.to_dict() == alone.to_dict()


def test_a_list_alone_sets_the_number_of_rows() -> None:
    raw = copy.deepcopy(RAW)
    del raw["array"]["rows"], raw["pillar"]["height_mm"]
    raw["array"]["heights_mm"] = [6.3, 6.0]
    case = case_from_dict(raw)
    case.require_plate()
    assert case.design.rows == 2 and [pillar.height_m for pillar in case.design.graded] == [6.3e-3, 6e-3]


def test_an_equal_height_set_over_a_list_takes_its_place_and_the_other_way_round() -> None:
    graded = design(HEIGHTS)
    assert [round(pillar.height_m, 6) for pillar in graded.row_pillars] == [6.3e-3, 6e-3, 5.7e-3]
    assert design(HEIGHTS, ("pillar.height_mm", 6.3)) == design()
    assert design(("array.pitches_y_mm", [4.0, 5.0, 6.0]), ("array.pitch_mm", 4.0)) == design()


def test_rows_stand_in_the_middle_of_strips_as_wide_as_their_pitches() -> None:
    """Closed forms: the first row half a foot beyond the zone, then half of both strips; the edge beyond the last foot."""
    graded = design(("array.pitches_y_mm", [4.0, 5.0, 7.0]), ("array.sides_mm", [2.0, 1.0, 3.0]))
    assert graded.row_centres() == pytest.approx([7e-3, 11.5e-3, 17.5e-3])
    assert graded.half_span_m == pytest.approx(17.5e-3 + 1.5e-3 + 5e-3)
    assert graded.column_centres()[-1] == pytest.approx(18e-3)  # the widest foot decides: floor((40 - 3)/4) + 1
    places = np.concatenate([stand.centres for stand in graded.standing()])
    assert sorted(places.tolist()) == sorted(graded.pillar_centres().tolist())
    plate = 40.0 * 48.0 * 2.0
    assert mass_kg(graded) == pytest.approx(2700e-9 * (plate + 2 * 10 * 6.3 * (4.0 + 1.0 + 9.0)))


def test_a_record_tells_which_pillar_stands_at_each_centre() -> None:
    graded = design(HEIGHTS)
    record = DesignRecord.of_design(graded)
    tall = {round(abs(y), 9): pillar.height_m for y, pillar in zip(graded.row_centres(), graded.graded, strict=True)}
    placed_pillars = zip(record.pillar_centres_m, record.standing, strict=True)
    assert all(pillar.height_m == tall[round(abs(y), 9)] for (_, y), pillar in placed_pillars)
    assert DesignRecord.model_validate(record.to_dict()) == record
    equal = DesignRecord.of_design(design())
    assert "graded_pillars" not in equal.to_dict()
    assert len(equal.standing) == len(equal.pillar_centres_m)


@pytest.mark.parametrize(
    ("overrides", "said"),
    [
        ([("array.heights_mm", [6.3, 6.0])], "2 values: must be one for each of array.rows = 3"),
        ([("array.heights_mm", [6.3, 0.0, 5.0])], "one per row from the zone outwards"),
        ([("array.heights_mm", 6.3)], "one per row from the zone outwards"),
        ([("array.heights_mm", [6.3, 0.001, 5.0])], "row 2: must be from 0.002"),
        ([("array.sides_mm", [2.0, 4.5, 2.0])], "pillars overlap: must exceed the pillar's footprint 4.5 mm"),
        ([("array.pitches_y_mm", [4.0, 1.5, 4.0])], "row 2: pillars overlap"),
        ([("pillar.shape", "step"), ("pillar.file", "a.step"), HEIGHTS], "must be left out with a step pillar"),
    ],
)
def test_what_cannot_be_is_refused_by_name(overrides: list[tuple[str, Any]], said: str) -> None:
    with pytest.raises(InputError, match="array") as refusal:
        case_from_dict(RAW, None, overrides)
    assert any(said in line for line in refusal.value.lines)


def test_a_comparison_tells_the_rows_apart(tmp_path: Path) -> None:
    """Designs that differ in the third row alone are not alike."""
    for name, last in (("a", 5.7), ("b", 5.6)):
        text = (STUDIES / "three-rows.toml").read_text().replace("height_mm = 6.3\n", "")
        (tmp_path / f"{name}.toml").write_text(text.replace("rows = 3", f"heights_mm = [6.3, 6.0, {last}]"))
    one, two = (_of_case(tmp_path / f"{name}.toml", False, True).quantities for name in "ab")
    apart = [row["quantity"] for row in lined_up(one, two) if row["difference"]]
    assert apart == ["case.design.row_3.height_m"]


def test_no_figure_of_the_thesis_is_held_against_rows_that_differ() -> None:
    record = DesignRecord.of_design(design(HEIGHTS))
    entry = {"rows": "3", "pitch_mm": "4", "extension_mm": "5"}
    assert _same_design(entry, DesignRecord.of_design(design())) and not _same_design(entry, record)


def test_a_file_with_both_keys_is_refused_in_one_line() -> None:
    raw = copy.deepcopy(RAW)
    raw["array"] |= {"heights_mm": [6.3, 6.0, 5.7]}
    with pytest.raises(InputError) as refusal:
        case_from_dict(raw)
    assert refusal.value.lines == [
        "case: pillar.height_mm = 6.3: cannot be combined with array.heights_mm: remove one of them"
    ]


def test_one_cell_is_refused_with_what_to_ask_instead() -> None:
    case = case_from_dict(RAW, None, [HEIGHTS, ("array.sides_mm", [2.0, 1.9, 1.8])])
    with pytest.raises(InputError, match=r"--set pillar\.height_mm=6\.3 --set pillar\.side_mm=2$"):
        case.require_one_kind("bands are")
    case_from_dict(RAW).require_one_kind("bands are")
