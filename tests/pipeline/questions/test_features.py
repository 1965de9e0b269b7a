"""Every question honours a feature of the case, or refuses it in one line."""

from __future__ import annotations

import tomllib
from typing import Any

import pytest

from pipeline.case.features import DEFECTS, FEATURES, GROUPS, LARGER, OF_A_PLATE, SUPPORTS, ZONES
from pipeline.case.model import Case, case_from_dict
from pipeline.errors import InputError
from pipeline.questions import known
from pipeline.questions.modes import Modes
from tests.helpers.exploring import SMALL as FILE

SMALL = tomllib.loads(FILE.read_text())
TABLES: dict[str, dict[str, Any]] = {
    ZONES: {"zone": [SMALL["zone"], {"shared_rows": 3}]},
    LARGER: {"plate": {**SMALL["plate"], "length_mm": 80.0, "width_mm": 60.0}, "array": {"pitch_mm": 4.0, "rows": 1}},
    SUPPORTS: {"support": [{"kind": "clamp", "edge": "y-"}]},
    GROUPS: {"materials": {"ROOF": "steel"}},
    DEFECTS: {"defect": [{"at": [0, 0], "remove": True}]},
}
WORDS = {ZONES: "zone.count = 2: ", LARGER: "plate.length_mm = 80: ", SUPPORTS: "[[support]]: "}
ABOUT_CASES = {name: kind for name, kind in known().items() if kind.without_case is None}


def case_with(feature: str) -> Case:
    return case_from_dict(SMALL | TABLES[feature])


def test_there_is_a_case_of_each_feature() -> None:
    assert TABLES.keys() == FEATURES.keys()
    case_from_dict(SMALL).refuse("a command")  # nothing to refuse


@pytest.mark.parametrize("feature", FEATURES)
@pytest.mark.parametrize("name", ABOUT_CASES)
def test_what_a_question_cannot_honour_is_refused_in_one_line(name: str, feature: str) -> None:
    kind = ABOUT_CASES[name]
    if feature in kind.honours:
        case_with(feature).refuse(name, kind.honours)
        return
    question = kind.in_study() or kind()
    with pytest.raises(InputError) as fault:
        question.suited(case_with(feature))
    assert len(fault.value.lines) == 1
    assert WORDS.get(feature, f"{feature}: ") in fault.value.lines[0] and name in fault.value.lines[0]


def test_a_zone_or_a_pillar_alone_has_nothing_of_the_plate() -> None:
    for feature in OF_A_PLATE:
        Modes(part="pillar").suited(case_with(feature))
    with pytest.raises(InputError, match=r"zone\.count = 2"):
        Modes().suited(case_with(ZONES))
