"""The [tip] table: what it becomes in SI, whom it binds, and one line for each fault."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from geometry.cad.printing import features
from geometry.cad.solids import pillar_solid, plate_solid
from geometry.materials import MATERIALS
from pipeline.case.model import Case, case_from_dict
from pipeline.errors import InputError
from pipeline.records.record import DesignRecord
from pipeline.search.space import searchable_keys
from pipeline.search.terms import mass_kg, overhang_deg
from tests.helpers.scenes import STEEL_PILLARS


def case_of(*settings: str, **tip: Any) -> Case:
    given = {"side_mm": 3.0, "height_mm": 1.5, **tip}
    return case_from_dict({**STEEL_PILLARS, "tip": given}, None, settings)


def test_it_stands_on_every_pillar_in_the_pillars_material_or_its_own() -> None:
    pillar = case_of().design.pillar
    assert pillar and pillar.tip and (pillar.tip.side_m, pillar.tip.height_m) == (3e-3, 1.5e-3)
    assert pillar.tip.material == MATERIALS["steel"] and pillar.top_m == pytest.approx(7.5e-3)
    brass = case_of(material="brass").design.pillar
    assert brass and brass.tip and brass.tip.material == MATERIALS["brass"] and brass.material == MATERIALS["steel"]
    plain = case_of().to_dict()["design"]["pillar"]
    assert plain["tip"]["side_m"] == 3e-3 and "tip" not in case_of(height_mm=0.0).to_dict()["design"]["pillar"]


def test_mass_features_overhang_and_record_know_it() -> None:
    own, brass, bare = case_of().design, case_of(material="brass").design, case_of(height_mm=0.0).design
    count = 2 * len(own.column_centres())
    assert mass_kg(brass) - mass_kg(bare) == pytest.approx(count * 13.5e-9 * 8500.0 + _plate_more(brass, bare))
    assert features(own)["heavy tip"] == 3e-3 and features(own)["gap between pillars along x"] == pytest.approx(2e-3)
    assert own.pillar and brass.pillar and bare.pillar
    assert [overhang_deg(each) for each in (own.pillar, brass.pillar, bare.pillar)] == [90.0, 0.0, 0.0]
    record = DesignRecord.of_design(brass)
    assert record.pillar and record.pillar.top_m == pytest.approx(7.5e-3) and record.pillar.form.name == "square"
    known = DesignRecord.of_design(bare).to_dict()["pillar"]
    assert "heavy_tip" not in known and searchable_keys()["tip.side_mm"] is False


def _plate_more(one: Any, other: Any) -> float:
    """The plate ends below the last tip."""
    more = 2.0 * (one.half_span_m - other.half_span_m) * one.length_m * one.thickness_m
    return float(more * one.material.density_kg_m3)


def test_the_cad_solids_hold_every_part_once() -> None:
    own, brass = case_of().design, case_of(material="brass").design
    assert own.pillar and brass.pillar
    lone = pillar_solid(brass.pillar)
    assert lone.part_volumes_m3() == pytest.approx({"plate": 24e-9, "tip": 13.5e-9})
    assert pillar_solid(own.pillar).volume_m3 == pytest.approx(37.5e-9) and not pillar_solid(own.pillar).bonded
    quarter = plate_solid(brass, "xy")
    plate = 10e-3 * brass.half_span_m * 2e-3
    pillars = len(brass.column_centres()) / 2.0
    assert quarter.part_volumes_m3() == pytest.approx(
        {"plate": plate, "pillar": 24e-9 * pillars, "tip": 13.5e-9 * pillars}
    )
    inside = np.array([[brass.column_centres()[-1], brass.row_centres()[0], 8.6e-3]])
    assert list(quarter.region_of(inside)) == ["tip"]


@pytest.mark.parametrize(
    ("settings", "tip", "line"),
    [
        ((), {"side_mm": 5.0}, "tip.side_mm = 5: tips touch: must be below array.pitch_mm = 5"),
        (("array.pitch_mm=20",), {"side_mm": 7.0}, "tip.side_mm = 7: must be below 7"),
        ((), {"side_mm": 3000.0}, "1000 times 2"),
        ((), {"height_mm": -1.0}, "tip.height_mm = -1: must be a finite number of 0 or more"),
        (("tolerance.height_mm=0.1",), {}, "without fillet or heavy tip, on the back alone, can be varied"),
        (("pillar.shape=step",), {}, "tip.height_mm = 1.5: must be 0 with a step pillar"),
        (("tip.material=led",), {}, 'tip.material = "led": must be one of'),
    ],
)
def test_every_fault_has_its_line(settings: tuple[str, ...], tip: dict[str, float], line: str) -> None:
    with pytest.raises(InputError) as caught:
        case_of(*settings, **tip)
    assert any(line in text for text in caught.value.lines), caught.value.lines


def test_it_needs_a_pillar() -> None:
    bare = {table: values for table, values in STEEL_PILLARS.items() if table not in ("pillar", "array")}
    with pytest.raises(InputError, match=r"tip.side_mm = 3: needs a \[pillar\] to stand on"):
        case_from_dict({**bare, "tip": {"side_mm": 3.0, "height_mm": 1.0}})
