"""Tables [[pillar.section]]: what they become in SI, whom they bind, and one line for each fault."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from geometry.cad.printing import features
from geometry.cad.solids import pillar_solid, plate_solid
from geometry.hex.panels import panel_mesh
from geometry.hex.scenes import HexSettings
from geometry.materials import MATERIALS
from geometry.mesh import cell_volumes, check_mesh
from geometry.tiling import lattice_panel
from pipeline.case.model import Case, case_from_dict
from pipeline.errors import InputError
from pipeline.logs import TerminalLog
from pipeline.models.modes import Request, solve_modes
from pipeline.records.record import DesignRecord
from pipeline.search.terms import mass_kg, overhang_deg
from tests.helpers.scenes import STEEL_PILLARS

PILLAR = {key: value for key, value in STEEL_PILLARS["pillar"].items() if key != "height_mm"}


def case_of(*settings: str, **cap: Any) -> Case:
    sections = [{"height_mm": 6.0}, {"side_mm": 3.0, "height_mm": 1.5, **cap}]
    return case_from_dict({**STEEL_PILLARS, "pillar": PILLAR | {"section": sections}}, None, settings)


def test_a_section_has_the_shape_and_the_pillars_material_unless_it_names_its_own() -> None:
    pillar = case_of().design.pillar
    assert pillar and [(each.base_m, each.height_m) for each in pillar.sections] == [(2e-3, 6e-3), (3e-3, 1.5e-3)]
    assert pillar.upper[0].material == MATERIALS["steel"] and pillar.levels_m == pytest.approx((0.0, 6e-3, 7.5e-3))
    brass = case_of(material="brass").design.pillar
    assert brass and brass.upper[0].material == MATERIALS["brass"] and brass.material == MATERIALS["steel"]
    capped = case_of("pillar.section=[{height_mm=6.0}, {shape='round', diameter_mm=2.5, height_mm=1.0}]").design.pillar
    assert capped and (capped.upper[0].shape, capped.upper[0].base_m) == ("round", 2.5e-3)
    plain = case_of().to_dict()["design"]["pillar"]
    assert plain["upper"][0]["base_m"] == 3e-3 and "upper" not in case_of(height_mm=0.0).to_dict()["design"]["pillar"]


def test_sections_like_the_one_below_are_one_more_height() -> None:
    """Three sections, of which the second says only its height."""
    sections = [{"height_mm": 2.0}, {"height_mm": 3.0}, {"height_mm": 1.0, "material": "brass"}]
    pillar = case_from_dict({**STEEL_PILLARS, "pillar": PILLAR | {"section": sections}}).design.pillar
    assert pillar and pillar.top_m == pytest.approx(6e-3) and len({each.outline for each in pillar.sections}) == 1
    assert pillar.highest == 1 and pillar.mass_kg == pytest.approx(4e-6 * (5e-3 * 7850.0 + 1e-3 * 8500.0))
    assert pillar_solid(pillar).part_volumes_m3() == pytest.approx({"plate": 20e-9, "section3": 4e-9})


def test_the_lists_of_rows_act_on_the_first_section() -> None:
    sections = [{"material": "glass"}, {"height_mm": 1.0}]
    raw = {**STEEL_PILLARS, "pillar": PILLAR | {"section": sections}}
    design = case_from_dict(raw, None, ["array.heights_mm=[5.0, 6.0]", "array.rows=2"]).design
    assert [pillar.height_m for pillar in design.row_pillars] == [5e-3, 6e-3]
    assert {pillar.material.name for pillar in design.row_pillars} == {"glass"}
    assert {pillar.upper[0].material.name for pillar in design.row_pillars} == {"steel"}


def test_mass_features_overhang_and_record_know_them() -> None:
    own, brass, bare = case_of().design, case_of(material="brass").design, case_of(height_mm=0.0).design
    count = 2 * len(own.column_centres())
    assert mass_kg(brass) - mass_kg(bare) == pytest.approx(count * 13.5e-9 * 8500.0 + _plate_more(brass, bare))
    assert features(own)["section 2 foot"] == 3e-3 and features(own)["gap between pillars along x"] == pytest.approx(
        2e-3
    )
    assert own.pillar and brass.pillar and bare.pillar
    assert [overhang_deg(each) for each in (own.pillar, brass.pillar, bare.pillar)] == [90.0, 0.0, 0.0]
    record = DesignRecord.of_design(brass)
    assert (
        record.pillar and record.pillar.top_m == pytest.approx(7.5e-3) and record.pillar.upper[0].form.name == "square"
    )
    assert not DesignRecord.of_design(bare).to_dict()["pillar"].get("upper")


def _plate_more(one: Any, other: Any) -> float:
    """The plate ends below the last section."""
    more = 2.0 * (one.half_span_m - other.half_span_m) * one.length_m * one.thickness_m
    return float(more * one.material.density_kg_m3)


def test_the_cad_solids_hold_every_part_once() -> None:
    own, brass = case_of().design, case_of(material="brass").design
    assert own.pillar and brass.pillar
    lone = pillar_solid(brass.pillar)
    assert lone.part_volumes_m3() == pytest.approx({"plate": 24e-9, "section2": 13.5e-9})
    assert pillar_solid(own.pillar).volume_m3 == pytest.approx(37.5e-9) and not pillar_solid(own.pillar).bonded
    quarter = plate_solid(brass, "xy")
    plate = 10e-3 * brass.half_span_m * 2e-3
    pillars = len(brass.column_centres()) / 2.0
    assert quarter.part_volumes_m3() == pytest.approx(
        {"plate": plate, "pillar": 24e-9 * pillars, "section2": 13.5e-9 * pillars}
    )
    inside = np.array([[brass.column_centres()[-1], brass.row_centres()[0], 8.6e-3]])
    assert list(quarter.region_of(inside)) == ["section2"]


def test_hexahedra_follow_round_sections_of_one_diameter() -> None:
    sections = [{"height_mm": 2.0}, {"height_mm": 1.0, "material": "brass"}]
    pillar = {"shape": "round", "diameter_mm": 2.0, "material": "steel", "section": sections}
    design = case_from_dict({**STEEL_PILLARS, "pillar": pillar}).design
    assert design.pillar and design.pillar.takes_hexahedra
    mesh = panel_mesh(lattice_panel(design), design.stack, design.pillar, HexSettings(3, 1e-3, 1)).mesh
    check_mesh(mesh)
    volumes = {name: 4.0 * cell_volumes(mesh)[cells].sum() for name, cells in mesh.regions.items()}
    assert volumes == pytest.approx({"plate": 50e-9, "pillar": 2e-9 * np.pi, "section2": 1e-9 * np.pi}, rel=1e-4)
    wider = case_from_dict({**STEEL_PILLARS, "pillar": pillar}, None, ["pillar.section.1.diameter_mm=3"]).design
    assert wider.pillar and not wider.pillar.takes_hexahedra


@pytest.mark.parametrize(
    ("settings", "cap", "line"),
    [
        ((), {"side_mm": 5.0}, "pillar.section.1.side_mm = 5: sections touch: must be below array.pitch_mm = 5"),
        (("array.pitch_mm=20",), {"side_mm": 7.0}, "pillar.section.1.side_mm = 7: must be below 7"),
        ((), {"side_mm": 3000.0}, "1000 times 2"),
        ((), {"height_mm": -1.0}, "pillar.section.1.height_mm = -1: must be a finite number of 0 or more"),
        ((), {"height_mm": 1e-4}, "pillar.section.1.height_mm = 0.0001: must be"),
        (("tolerance.height_mm=0.1",), {}, "of one section without fillet, on the back alone, can be varied"),
        (("pillar.section.1.material=led",), {}, 'pillar.section.1.material = "led": must be one of'),
        (("pillar.height_mm=6",), {}, "pillar.height_mm = 6: must be left out: the sections have their own"),
        (("pillar.section.0.height_mm=0",), {}, "pillar.section.0.height_mm = 0: must be above 0"),
        ((), {"shape": "round"}, "pillar.section.1.diameter_mm: missing, a round pillar needs it"),
        ((), {"shape": "round", "diameter_mm": 2.0}, "pillar.section.1.side_mm = 3: does not belong to a round pillar"),
        ((), {"shape": "step"}, 'pillar.section.1.shape = "step": must be square or round'),
        (("pillar.section=[]",), {}, "pillar.section = []: must be one to 8 tables"),
        (("pillar.section=[{}]",), {}, "pillar.section.0.height_mm: missing, a section needs it"),
        ((), {"hight_mm": 1.0}, "unknown key (did you mean pillar.section.0.height_mm?)"),
    ],
)
def test_every_fault_has_its_line(settings: tuple[str, ...], cap: dict[str, float], line: str) -> None:
    with pytest.raises(InputError) as caught:
        case_of(*settings, **cap)
    assert any(line in text for text in caught.value.lines), caught.value.lines


def test_a_tip_is_refused_with_the_sections_to_write() -> None:
    tip = {"side_mm": 3.0, "height_mm": 1.5, "material": "brass"}
    with pytest.raises(InputError) as caught:
        case_from_dict({**STEEL_PILLARS, "tip": tip})
    (line,) = caught.value.lines
    said = (
        'write pillar.section = [{height_mm = 6}, {shape = "square", side_mm = 3, height_mm = 1.5, material = "brass"}]'
    )
    assert said in line and "without pillar.height_mm" in line


@pytest.mark.slow
def test_a_pillar_alone_needs_no_zone_for_its_modes() -> None:
    raw = {"name": "alone", "material": "aluminium", "pillar": {"side_mm": 2.0, "height_mm": 5.0}}
    rows = solve_modes(
        case_from_dict(raw, None, ["solve.accuracy=0.05"]), Request("pillar", count=2), TerminalLog(True)
    ).rows
    assert len(rows) == 2 and rows[0].frequency_hz == pytest.approx(60e3, rel=0.01)


def test_a_step_pillar_has_no_sections() -> None:
    pillar = {"shape": "step", "file": "pillar.step", "section": [{"height_mm": 1.0}]}
    with pytest.raises(InputError, match="must be left out with a step pillar"):
        case_from_dict({**STEEL_PILLARS, "pillar": pillar})


def test_a_faulty_section_is_told_in_one_line() -> None:
    with pytest.raises(InputError) as caught:
        case_from_dict({**STEEL_PILLARS, "pillar": {"section": [{"height_mm": 2.0, "sid_mm": 2.0}]}})
    (line,) = caught.value.lines
    assert "pillar.section.0.sid_mm = 2: unknown key (did you mean pillar.section.0.side_mm?)" in line
