"""Plates of several layers as written in a case file: their stack, their records, their keys and their faults."""

from __future__ import annotations

from typing import Any

import pytest

from geometry.materials import MATERIALS
from pipeline.case.model import Case, case_from_dict
from pipeline.errors import InputError

LAYERS = [
    {"material": "glass", "thickness_mm": 0.7},
    {"material": "optically-clear-adhesive", "thickness_mm": 0.2},
    {"material": "steel", "thickness_mm": 1.1},
]
ZONE = {"length_mm": 40.0, "width_mm": 20.0, "nodal_lines": 3}


def read(layers: Any, overrides: tuple[str, ...] = (), **more: Any) -> Case:
    raw = {"material": "aluminium", "plate": {"layer": layers}, "zone": ZONE, **more}
    return case_from_dict({key: value for key, value in raw.items() if value is not None}, overrides=overrides)


def test_layers_lie_from_the_touch_face_to_the_back_and_pillars_have_the_cases_material() -> None:
    pillars = {"pillar": {"side_mm": 2.0, "height_mm": 4.0}, "array": {"pitch_mm": 4.0, "rows": 1}}
    design = read(LAYERS, **pillars).design
    assert [layer.material.name for layer in design.stack.layers] == [layer["material"] for layer in LAYERS]
    assert design.thickness_m == pytest.approx(2e-3) and design.stack.levels_m == pytest.approx([0, 7e-4, 9e-4, 2e-3])
    assert design.stack.touch is MATERIALS["glass"] and design.stack.back is MATERIALS["steel"]
    assert design.pillar and design.pillar.material is MATERIALS["aluminium"]


def test_a_layer_cut_in_two_is_one_layer_and_one_layer_is_a_plate() -> None:
    cut = [*LAYERS[:2], {"material": "steel", "thickness_mm": 0.6}, {"material": "steel", "thickness_mm": 0.5}]
    one, other = (read(each).design.stack for each in (cut, LAYERS))
    assert [layer.material for layer in one.layers] == [layer.material for layer in other.layers]
    assert one.levels_m == pytest.approx(other.levels_m, rel=1e-14)
    whole = read([{"material": "glass", "thickness_mm": 2.0}]).design
    plain = case_from_dict({"material": "glass", "plate": {"thickness_mm": 2.0}, "zone": ZONE}).design
    assert whole.stack == plain.stack and not whole.layers


def test_the_record_names_every_layer_and_a_plate_without_them_none() -> None:
    kept = read(LAYERS).to_dict()["design"]["layers"]
    assert [(each["material"]["name"], each["thickness_m"]) for each in kept] == [
        ("glass", pytest.approx(7e-4)),
        ("optically-clear-adhesive", pytest.approx(2e-4)),
        ("steel", pytest.approx(1.1e-3)),
    ]
    plain = case_from_dict({"material": "glass", "plate": {"thickness_mm": 2.0}, "zone": ZONE})
    assert "layers" not in plain.to_dict()["design"]


def test_an_element_of_the_list_is_a_key() -> None:
    case = read(LAYERS, ("plate.layer.1.thickness_mm=0.4", "plate.layer.0.material.young_GPa=60"))
    first, second, _ = case.design.stack.layers
    assert second.thickness_m == pytest.approx(4e-4) and first.material.as_isotropic.young_pa == 60e9


def test_layers_need_no_material_of_the_case_where_pillars_have_their_own_or_there_are_none() -> None:
    assert read(LAYERS, material=None).design.layers
    own = {"pillar": {"side_mm": 2.0, "height_mm": 4.0, "material": "brass"}, "array": {"pitch_mm": 4.0, "rows": 1}}
    design = read(LAYERS, material=None, **own).design
    assert design.pillar and design.pillar.material is MATERIALS["brass"]


PILLAR = {"pillar": {"side_mm": 2.0, "height_mm": 4.0}, "array": {"pitch_mm": 4.0, "rows": 1}}


@pytest.mark.parametrize(
    ("layers", "overrides", "more", "line"),
    [
        ([], (), {}, "plate.layer = []: must be one to 20 tables [[plate.layer]]"),
        (3, (), {}, "plate.layer = 3: must be one to 20 tables"),
        (LAYERS, ("plate.thickness_mm=2",), {}, "plate.thickness_mm = 2: must be left out: the layers have their own"),
        (LAYERS, ("plate.layer.1.thickness_mm=0.0015",), {}, "must be at least 0.0018"),
        (LAYERS, ("plate.layer.1.material=adhesive",), {}, 'plate.layer.1.material = "adhesive": must be one of'),
        (LAYERS, ("plate.layer.3.thickness_mm=1",), {}, "3 must be the number of one of its tables, 0 to 2"),
        (LAYERS, ("plate.layer.\u00b2.thickness_mm=1",), {}, "must be the number of one of its tables, 0 to 2"),
        (LAYERS, (f"plate.layer.{'9' * 5000}.thickness_mm=1",), {}, "must be the number of one of its tables, 0 to 2"),
        (LAYERS, ("plate.layer.1.thickness=1",), {}, "did you mean plate.layer.0.thickness_mm?"),
        ([{"thickness_mm": 1.0}], (), {}, "plate.layer.0.material: missing"),
        ([{"material": "glass"}], (), {}, "plate.layer.0.thickness_mm: missing"),
        (LAYERS, (), {"material": None, **PILLAR}, "of the pillars: the plate's layers have their own"),
    ],
)
def test_every_fault_is_one_line(layers: Any, overrides: tuple[str, ...], more: dict[str, Any], line: str) -> None:
    with pytest.raises(InputError) as caught:
        read(layers, overrides, **more)
    assert any(line in each for each in caught.value.lines), caught.value.lines
