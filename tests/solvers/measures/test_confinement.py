"""Measures of confinement on touch fields whose answer is known by hand."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from geometry.layout import Design
from geometry.materials import MATERIALS
from solvers.measures.confinement import TouchField, measure, target_shape, target_symmetry

DESIGN = Design(60e-3, 20e-3, 2e-3, 6, MATERIALS["aluminium"], None, 4e-3, 4e-3, 0, 10e-3)


def field(of: object, half_m: float = 20e-3) -> TouchField:
    """A function of points (q, 2) sampled on the midpoints of a fine grid."""
    x = (np.arange(240) + 0.5) / 240 * 60e-3 - 30e-3
    y = ((np.arange(160) + 0.5) / 160 * 2.0 - 1.0) * half_m
    points = np.column_stack([g.ravel() for g in np.meshgrid(x, y)])
    weights = np.full(len(points), 60e-3 * 2.0 * half_m / len(points))
    return TouchField(points, weights, np.asarray(of(points)).reshape(len(points), -1))  # type: ignore[operator]


def test_a_field_ten_times_smaller_outside_is_twenty_decibels_confined() -> None:
    result = measure(field(lambda p: np.where(np.abs(p[:, 1]) < 10e-3, 1.0, 0.1)), DESIGN, None)
    assert result.confinement_db[0] == pytest.approx(20.0, abs=1e-9)
    assert result.zone_share[0] == pytest.approx(1.0 / 1.01, rel=1e-12)


def test_an_even_field_is_not_confined_whatever_its_size() -> None:
    for size in (1.0, 1e-6):
        result = measure(field(lambda p, size=size: np.full(len(p), size)), DESIGN, None)
        assert result.confinement_db[0] == pytest.approx(0.0, abs=1e-9)
        assert result.zone_share[0] == pytest.approx(0.5, rel=1e-12)


def test_the_target_shape_has_a_mac_of_one_and_another_order_none() -> None:
    other = Design(**{**vars(DESIGN), "nodal_lines": 4})
    both = field(lambda p: np.column_stack([-3.0 * target_shape(DESIGN, p), target_shape(other, p)]))
    result = measure(both, DESIGN, None)
    assert result.mac[0] == pytest.approx(1.0, abs=1e-12)
    assert result.mac[1] < 1e-4


def test_motion_outside_the_zone_does_not_change_the_mac() -> None:
    quiet = field(lambda p: np.where(np.abs(p[:, 1]) < 10e-3, target_shape(DESIGN, p), 0.0))
    loud = field(lambda p: np.where(np.abs(p[:, 1]) < 10e-3, target_shape(DESIGN, p), 5.0))
    assert measure(loud, DESIGN, None).mac[0] == pytest.approx(measure(quiet, DESIGN, None).mac[0], abs=1e-12)


def test_a_quarter_measures_what_the_whole_measures() -> None:
    whole = field(lambda p: target_shape(DESIGN, p) * (1.0 + 1e4 * p[:, 0] ** 2))
    keep = (whole.points > 0.0).all(axis=1)
    quarter = TouchField(whole.points[keep], 4.0 * whole.weights[keep], whole.values[keep])
    a, b = measure(whole, DESIGN, None), measure(quarter, DESIGN, "SS")
    assert np.allclose([a.zone_share, a.confinement_db, a.mac], [b.zone_share, b.confinement_db, b.mac], rtol=1e-12)


@pytest.mark.parametrize(("lines", "symmetry"), [(6, "SS"), (7, "AS"), (0, "SS"), (1, "AS")])
def test_the_target_class_follows_the_number_of_lines(lines: int, symmetry: str) -> None:
    assert target_symmetry(lines) == symmetry
    design = Design(**{**vars(DESIGN), "nodal_lines": lines})
    at = np.array([[7e-3, 3e-3]])
    sign = 1.0 if symmetry[0] == "S" else -1.0
    assert target_shape(design, at * [-1, 1])[0] == pytest.approx(sign * target_shape(design, at)[0], rel=1e-9)
    assert target_shape(design, at * [1, -1])[0] == pytest.approx(target_shape(design, at)[0], rel=1e-9)


def test_another_mirror_class_has_no_part_in_the_target_shape() -> None:
    assert measure(field(lambda p: target_shape(DESIGN, p)), DESIGN, "AS").mac[0] == 0.0


def test_a_plate_without_passive_face_has_no_confinement_number() -> None:
    result = measure(field(lambda p: np.ones(len(p)), 10e-3 * (1.0 - 1e-9)), DESIGN, None)
    assert np.isnan(result.zone_share[0]) and np.isnan(result.confinement_db[0])


def test_strength_is_one_for_a_plate_that_moves_in_the_target_shape_alone() -> None:
    """Modal mass rho h int w^2: the effective-mass fraction of a mode that is the shape itself, whatever its amplitude."""
    for size in (1.0, 1e-3):
        shaped = field(lambda p, size=size: np.where(np.abs(p[:, 1]) < 10e-3, size * target_shape(DESIGN, p), 0.0))
        mass = DESIGN.material.density_kg_m3 * DESIGN.thickness_m * float(shaped.weights @ shaped.values[:, 0] ** 2)
        assert measure(replace(shaped, modal_mass_kg=mass), DESIGN, None).strength[0] == pytest.approx(1.0, rel=1e-12)
        heavier = measure(replace(shaped, modal_mass_kg=4.0 * mass), DESIGN, None)
        assert heavier.strength[0] == pytest.approx(0.25, rel=1e-12) and heavier.mac[0] == pytest.approx(1.0)
    assert np.isnan(measure(shaped, DESIGN, None).strength[0]), "of no known mass, no strength"


def test_the_extension_is_what_lies_beyond_the_last_row() -> None:
    """u_z of 1 in the zone, 1/10 beyond the rows: 20 dB, whatever moves between."""
    y = np.array([0.0, 0.5, 0.9, 0.99]) * DESIGN.half_span_m
    beyond = y > DESIGN.half_span_m - DESIGN.extension_m
    values = np.where(y < DESIGN.width_m / 2.0, 1.0, np.where(beyond, 0.1, 7.0))[:, None]
    touch = TouchField(np.column_stack([np.zeros(4), y]), np.ones(4), values)
    assert measure(touch, DESIGN, None).extension_db == pytest.approx(20.0)
