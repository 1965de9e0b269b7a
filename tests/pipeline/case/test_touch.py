"""The [touch] table: what it becomes in SI, its default place, and one line for each fault."""

from __future__ import annotations

from typing import Any

import pytest

from geometry.fingertips import FINGERTIPS
from pipeline.case.model import Case, case_from_dict
from pipeline.errors import InputError
from tests.helpers.scenes import STEEL_PILLARS


def case_of(nodal_lines: int = 3, **touch: Any) -> Case:
    zone = {**STEEL_PILLARS["zone"], "nodal_lines": nodal_lines}
    return case_from_dict({**STEEL_PILLARS, "zone": zone, "touch": {"radius_mm": 2.0, **touch}})


def test_left_out_nothing_of_it_is_known() -> None:
    case = case_from_dict(STEEL_PILLARS)
    assert case.touch is None and "touch" not in case.to_dict()


def test_it_is_turned_to_si() -> None:
    impedance = {"stiffness_N_per_m": 1e3, "damping_Ns_per_m": 2, "mass_g": 0.5}
    touch = case_of(at_mm=[3, -2.0], impedance=impedance, force_N=0.4, gap_um=[1.0, 4.0], limit_V=30.0).touch
    assert touch and (touch.at_m, touch.radius_m) == ((3e-3, -2e-3), 2e-3)
    assert (touch.tip.stiffness_n_m, touch.tip.damping_n_s_m, touch.tip.mass_kg) == (1e3, 2.0, 5e-4)
    assert (touch.force_n, touch.gap_m, touch.limit_v) == (0.4, pytest.approx((1e-6, 4e-6)), 30.0)
    assert all(
        each.touch and each.touch.tip is tip for name, tip in FINGERTIPS.items() for each in [case_of(impedance=name)]
    )


@pytest.mark.parametrize(("lines", "shift"), [(0, 0.0), (1, 0.0), (2, 0.0), (4, 0.0)])
def test_its_place_is_the_antinode_nearest_the_centre(lines: int, shift: float) -> None:
    touch = case_of(lines).touch
    assert touch and touch.at_m == (shift, 0.0)


def test_of_two_antinodes_as_near_it_takes_the_one_at_positive_x() -> None:
    touch = case_of(3).touch
    assert touch and touch.at_m[0] == pytest.approx(0.192 * 20e-3, rel=0.02)  # free-free beam, third mode


@pytest.mark.parametrize(
    ("touch", "line"),
    [
        ({"radius_mm": -1.0}, "touch.radius_mm = -1: must be a finite number above 0"),
        (
            {"at_mm": [1e9, 0.0]},
            "touch.at_mm = [1000000000, 0]: must be two numbers [x, y] within 1e+07 mm of the plate's centre",
        ),
        ({"at_mm": [9.0, 0.0]}, "touch.at_mm = [9, 0]: the contact extends beyond the plate of 20 x"),
        ({"radius_mm": 15.0}, "touch.radius_mm = 15: the contact extends beyond the plate"),
        ({"impedance": "fingr"}, "must be one of finger, light, tissue or a table (did you mean finger?)"),
        (
            {"impedance": {"damping_Ns_per_m": -1.0}},
            "must be the name of a fingertip (finger, light, tissue) or a table",
        ),
        (
            {"impedance": {"damping_N_s_m": 40.0}},
            "impedance.damping_N_s_m = 40: unknown key (did you mean touch.impedance.damping_Ns_per_m?)",
        ),
        (
            {"impedance": {"stiffness_N_m": 1e3}},
            "impedance.stiffness_N_m = 1000: unknown key (did you mean touch.impedance.stiffness_N_per_m?)",
        ),
        ({"force_N": 0.5}, "touch.force_N = 0.5: requires touch.gap_um"),
        ({"gap_um": [2.0, 10.0]}, "touch.gap_um = [2, 10]: requires touch.force_N"),
        ({"gap_um": [10.0, 2.0], "force_N": 0.5}, "must be [low, high] with low <= high"),
        ({"gap_um": [0.1, 2.0], "force_N": 0.5}, "from 0.7 to 100"),
        ({"presure": 1.0}, "touch.presure = 1: unknown key"),
    ],
)
def test_a_fault_is_one_line(touch: dict[str, Any], line: str) -> None:
    with pytest.raises(InputError) as fault:
        case_of(**touch)
    assert len(fault.value.lines) == 1 and line in fault.value.lines[0]
