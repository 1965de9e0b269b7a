"""The half-wavelength of the target mode: one rule for design, case, search and pre-design."""

from __future__ import annotations

from dataclasses import replace
from math import inf, pi
from pathlib import Path

import pytest

from geometry.layout import half_wavelength_m
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
