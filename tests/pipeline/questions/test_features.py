"""Every question honours a feature of the case, or refuses it in one line."""

from __future__ import annotations

import tomllib
from pathlib import Path
from typing import Any

import pytest

from pipeline.case.features import (
    ATTACHED,
    CELL,
    DEFECTS,
    FEATURES,
    GROUPS,
    LARGER,
    OBLIQUE,
    OF_ROWS,
    OUTLINE,
    PLACES,
    STRESS,
    SUPPORTS,
    UNKNOWN,
    ZONES,
    refusals,
)
from pipeline.case.model import Case, case_from_dict
from pipeline.errors import InputError
from pipeline.questions import known
from pipeline.questions.modes import Modes
from pipeline.questions.search import Search
from pipeline.questions.tolerance import AlikeTolerance, Tolerance
from pipeline.questions.touch import Touch
from tests.helpers.exploring import SMALL as FILE

SMALL = tomllib.loads(FILE.read_text())
PANEL = Path(__file__).resolve().parents[3] / "examples" / "housing.step"
TABLES: dict[str, dict[str, Any]] = {
    OUTLINE: {
        "plate": {"file": str(PANEL)},
        "zone": {**SMALL["zone"], "length_mm": 20.0, "width_mm": 8.0},
        "array": {"rows": 0},
    },
    ZONES: {"zone": [SMALL["zone"], {"shared_rows": 3}]},
    LARGER: {"plate": {**SMALL["plate"], "length_mm": 80.0, "width_mm": 60.0}, "array": {"pitch_mm": 4.0, "rows": 1}},
    PLACES: {
        "plate": {**SMALL["plate"], "length_mm": 200.0, "width_mm": 60.0},
        "zone": {**SMALL["zone"], "centres_mm": [[-50.0, 0.0], [50.0, 0.0]]},
        "array": {"pitch_mm": 4.0, "rows": 1},
    },
    SUPPORTS: {"support": [{"kind": "clamp", "edge": "y-"}]},
    STRESS: {"support": [{"kind": "simple", "edge": "x+"}], "solve": {"temperature_C": 60.0}},
    UNKNOWN: {
        "material": {"density_kg_m3": 2700.0, "young_GPa": 70.0, "poisson": 0.33},
        "support": [{"kind": "clamp", "edge": "x+"}],
        "solve": {"temperature_C": 60.0},
    },
    GROUPS: {"materials": {"ROOF": "steel"}},
    DEFECTS: {"defect": [{"at": [0, 0], "remove": True}]},
    CELL: {"cell": {"file": str(FILE)}, "pillar": None},
    ATTACHED: {
        "cell": {"attached": [{"at_mm": [1.5, 1.5], "mass_g": 0.01}]},
        "pillar": None,
        "array": {"pitch_mm": 6.0},
    },
    OBLIQUE: {"array": {"a1_mm": [4.0, 0.0], "a2_mm": [1.0, 4.0], "rows": 1, "extension_mm": 5.0}},
}
ALLOY = {"density_kg_m3": 2700.0, "young_GPa": 70.0, "poisson": 0.33}
WORDS = {
    OUTLINE: "plate.file = housing.step: ",
    ZONES: "zone.count = 2: ",
    LARGER: "plate.length_mm = 80: ",
    PLACES: "zone.centres_mm = 2 centres: ",
    SUPPORTS: "[[support]]: ",
    STRESS: "solve.temperature_C = 60: ",
    UNKNOWN: "expansion_per_K of given: ",
    OBLIQUE: "array.a2_mm of an oblique lattice: ",
}
ABOUT_CASES = {name: kind for name, kind in known().items() if kind.without_case is None}


def case_with(feature: str) -> Case:
    return case_from_dict({name: own for name, own in (SMALL | TABLES[feature]).items() if own is not None})


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
    line = next(each for each in fault.value.lines if WORDS.get(feature, f"{feature}: ") in each)
    with_it = {STRESS: (SUPPORTS,), UNKNOWN: (SUPPORTS, STRESS)}.get(feature, ())
    assert name in line and len(fault.value.lines) == 1 + sum(each not in kind.honours for each in with_it)


@pytest.mark.parametrize(
    ("question", "said"),
    [
        (AlikeTolerance(alike=True), "tolerance --alike supports free plates only"),
        (
            Search(vary=(("pillar.height_mm", 5.8, 6.6),), goal="widest"),
            "search --goal widest supports free plates only",
        ),
        (Search(vary=(("pillar.height_mm", 5.8, 6.6),), verify_with="solid"), "solid meshes carry no supports"),
        (Search(vary=(("pillar.height_mm", 5.8, 6.6),)), ""),
        (Tolerance(), ""),
        (Touch(), ""),
    ],
)
def test_options_that_know_no_supports_refuse_them_in_one_line(question: Any, said: str) -> None:
    tables = {"tolerance": {"height_mm": 0.05}, "patches": {"size_mm": [8.0, 3.0, 0.3]}, "touch": {"radius_mm": 5.0}}
    case = case_from_dict(SMALL | TABLES[SUPPORTS] | tables)
    if not said:
        question.suited(case)
        return
    with pytest.raises(InputError, match=said) as fault:
        question.suited(case)
    assert len(fault.value.lines) == 1


def test_scatter_is_of_any_rectangle_but_a_batch_of_plates_as_long_as_their_zone() -> None:
    case = case_from_dict(SMALL | TABLES[LARGER] | {"tolerance": {"height_mm": 0.05}})
    Tolerance().suited(case)
    with pytest.raises(InputError, match="tolerance --alike supports a plate as long as its zone only") as fault:
        AlikeTolerance(alike=True).suited(case)
    assert len(fault.value.lines) == 1


def test_a_zone_or_a_pillar_alone_has_nothing_of_the_plate() -> None:
    for feature in OF_ROWS:
        Modes(part="pillar").suited(case_with(feature))
    with pytest.raises(InputError, match=r"zone\.count = 2"):
        Modes().suited(case_with(ZONES))


@pytest.mark.parametrize(
    ("changes", "stressed"),
    [
        ({}, True),
        ({"support.0.kind": "foam", "support.0.stiffness_N_per_m2": 1e4}, False),
        ({"solve.temperature_C": 20.0}, False),
        ({"material": {**ALLOY, "expansion_per_K": 0.0}}, False),
        ({"material": ALLOY}, True),  # unknown is not small
    ],
)
def test_only_held_plates_that_expand_are_stressed(changes: dict[str, Any], stressed: bool) -> None:
    case = case_with(STRESS).but(changes)
    assert any(STRESS in line for line in refusals(case, "modes", (SUPPORTS,))) == stressed


@pytest.mark.parametrize("name", ["prediction", "shapes", "tet_bands"])
def test_what_accompanies_a_question_honours_the_same(name: str) -> None:
    kind = known()[name]
    assert kind.honours == known()[kind.follows].honours
