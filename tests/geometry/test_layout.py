"""The half-wavelength of the target mode: one rule for design, case, search and pre-design."""

from __future__ import annotations

from dataclasses import replace
from math import inf, pi
from pathlib import Path

import numpy as np
import pytest

from geometry.layout import half_wavelength_m, mirrored_axes
from geometry.supports import Support
from pipeline.case.model import load_case
from pipeline.search.terms import Limits
from solvers.analytic.beams import roots
from solvers.analytic.predesign import predesign

CASE = Path(__file__).parents[2] / "studies" / "three-rows.toml"


def test_half_a_wave_is_that_of_the_free_free_beam() -> None:
    """The roots kL of cosh kL cos kL = 1 tend to (N - 1/2) pi exponentially: to 0.4 % at N = 2, 0.02 % at N = 3."""
    for lines, kappa in zip(range(2, 9), roots("free", "free", 7), strict=True):
        assert half_wavelength_m(0.1, lines) == pytest.approx(0.1 * pi / kappa, rel=4e-3 if lines == 2 else 2e-4)
    assert half_wavelength_m(0.1, 1) is None is half_wavelength_m(0.1, 0)


def test_design_case_search_and_predesign_say_the_same() -> None:
    case = load_case(CASE)
    half = case.design.half_wavelength_m
    assert half == pytest.approx(0.1155 / 7.5, rel=1e-15)
    assert case.target_kx_per_m == pytest.approx(pi / half, rel=1e-15)
    zone = predesign(case.design).zone
    assert zone and zone.half_wavelength_m == half
    assert not Limits(half_wavelength_m=1.0001 * half).of_design(case.design)
    assert Limits(half_wavelength_m=0.9999 * half).of_design(case.design)
    rigid = replace(case.design, nodal_lines=1)
    assert rigid.half_wavelength_m is None and Limits(half_wavelength_m=0.1).of_design(rigid)  # the whole length counts


def test_a_foot_has_room_up_to_the_leaning_sides_of_an_oblique_cell() -> None:
    """Sides along (6, 8) are 4 apart, and the corner of a square of side 1 nearest to them 0.5 (0.8 + 0.6) from the middle."""
    design = load_case(CASE).design
    assert design.pillar
    foot = replace(design.pillar, base_m=1e-3, tip_m=1e-3)
    cell = replace(design, pillar=foot, pitch_x_m=5e-3, pitch_y_m=8e-3)
    leaning = replace(cell, oblique_m=((5e-3, 0.0), (6e-3, 8e-3)))
    assert cell.foot_room_m == pytest.approx(2e-3)
    assert leaning.foot_room_m == pytest.approx(2e-3 - 0.7e-3)
    assert replace(leaning, pillar=None).foot_room_m == inf


@pytest.mark.parametrize(("zones", "places"), [(1, [0.0]), (2, [-13e-3, 13e-3]), (3, [-26e-3, 0.0, 26e-3])])
def test_zones_lie_beside_each_other_about_the_middle(zones: int, places: list[float]) -> None:
    several = replace(load_case(CASE).design, zones=zones, zone_gap_m=6e-3)
    assert several.zone_centres_m == pytest.approx(places)


def test_rows_around_a_zone_leave_a_pitch_to_those_beyond_its_ends() -> None:
    """Pillars 2 mm wide beyond both ends of a zone of 20 mm are 22 mm apart: four fit between them 4 mm apart."""
    design = load_case(CASE).design
    around = replace(design, length_m=20e-3, larger_m=(90e-3, 60e-3), surround=True)
    assert design.pillar and design.pillar.base_m == 2e-3 and design.pitch_x_m == 4e-3
    assert around.column_centres() == pytest.approx(4e-3 * np.array([-1.5, -0.5, 0.5, 1.5]))


def test_a_plate_held_on_one_side_has_no_mirror_there() -> None:
    design = load_case(CASE).design
    both = (Support("clamp", "x-"), Support("clamp", "x+"))
    assert design.is_mirrored and replace(design, supports=both).is_mirrored
    assert not replace(design, supports=both[:1]).is_mirrored


def test_supports_hold_what_expands() -> None:
    """A coefficient that is not known may be any."""
    design, clamp = load_case(CASE).design, (Support("clamp", "x-"),)
    for per_k, held in ((23e-6, True), (None, True), (0.0, False)):
        own = replace(design, material=replace(design.material, expansion_per_k=per_k))
        assert replace(own, supports=clamp).holds_expansion is held and not own.holds_expansion


@pytest.mark.parametrize(
    ("centres", "mirrors"),
    [
        ([(0.0, 0.0)], (True, True)),
        ([(-7.0, 2.0), (7.0, 2.0)], (True, False)),
        ([(3.0, -2.0), (3.0, 2.0)], (False, True)),
        ([(3.0, -2.0), (-3.0, 2.0)], (False, False)),
        ([(3.0, 2.0), (-3.0, 2.0), (3.0, -2.0), (-3.0, -2.0)], (True, True)),
    ],
)
def test_footprints_are_mirrored_where_their_images_are_footprints(
    centres: list[tuple[float, float]], mirrors: tuple[bool, bool]
) -> None:
    x, y = 1e-3 * np.array(centres).T
    boxes = np.column_stack([x - 2e-3, x + 2e-3, y - 0.5e-3, y + 0.5e-3])
    assert mirrored_axes(boxes) == mirrors
    assert mirrored_axes(boxes + np.array([1e-6, 1e-6, 0.0, 0.0])) == (False, mirrors[1])
