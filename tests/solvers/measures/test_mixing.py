"""What moves a confinement: what a neighbour mixed in by a known share really does, to first order."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from geometry.layout import Design
from geometry.materials import MATERIALS
from solvers.measures.confinement import (
    Overlaps,
    TouchField,
    Weighed,
    measure,
    mixed_energy,
    share_error,
    strength_force,
)

DESIGN = Design(60e-3, 20e-3, 2e-3, 6, MATERIALS["aluminium"], None, 4e-3, 4e-3, 0, 10e-3)
TONES = np.array([30e3, 31e3, 40e3])


def face(values: np.ndarray, half_m: float = 20e-3) -> TouchField:
    """Random fields (1000, k) at random points of the touch face."""
    draw = np.random.default_rng(4)
    points = draw.uniform(-1.0, 1.0, (1000, 2)) * (30e-3, half_m)
    return TouchField(points, np.full(1000, 1e-6), values, 1.0)


def fields(count: int = 3) -> np.ndarray:
    return np.random.default_rng(5).normal(size=(1000, count)) + 0.3


def level(values: np.ndarray) -> float:
    return float(measure(face(values[:, None]), DESIGN, None).confinement_db[0])


def level_db(touch: TouchField, tones: np.ndarray, index: int, error: float, design: Design) -> float | None:
    overlaps = Weighed.over([touch], design).overlaps[0]
    return overlaps and overlaps.mixing_db(tones, index, error)


def test_one_neighbour_moves_the_level_as_its_share_does() -> None:
    values, tones, error = fields(2), TONES[:2], 1e-5
    share = 2.0 * error * tones[0] * tones[1] / (tones[1] ** 2 - tones[0] ** 2)
    moved = level(values[:, 0] + share * values[:, 1]) - level(values[:, 0])
    result = level_db(face(values), tones, 0, error, DESIGN)
    assert result == pytest.approx(abs(moved), rel=10.0 * share)


def test_one_neighbour_moves_the_level_over_the_plate_beyond_the_rows_as_its_share_does() -> None:
    """Of 4 mm with rows of 4 mm between: the level over the whole passive face moves otherwise."""
    design = replace(DESIGN, rows=2, extension_m=4e-3)
    values, error = fields(2), 1e-5
    share = 2.0 * error * TONES[0] * TONES[1] / (TONES[1] ** 2 - TONES[0] ** 2)
    mixed = np.column_stack([values[:, 0], values[:, 0] + share * values[:, 1]])
    before, after = measure(face(mixed, design.half_span_m), design, None).extension_db
    touch = face(values, design.half_span_m)
    overlaps = Weighed.over([touch], design).overlaps[1]
    assert overlaps and overlaps.mixing_db(TONES[:2], 0, error) == pytest.approx(abs(after - before), rel=10.0 * share)
    assert overlaps.mixing_db(TONES[:2], 0, error) != pytest.approx(
        level_db(touch, TONES[:2], 0, error, design), rel=0.1
    )
    short = replace(design, extension_m=0.0)
    assert Weighed.over([face(values, short.half_span_m)], short).overlaps[1] is None


def test_a_face_weighed_part_by_part_measures_as_the_whole() -> None:
    """Parts of a few points, some within the zone, some outside, of other sizes."""
    design = replace(DESIGN, rows=2, extension_m=4e-3)
    touch, ends = replace(face(fields(), design.half_span_m), modal_mass_kg=3e-3), [0, 7, 300, 301, 1000]
    parts = [
        replace(touch, points=touch.points[a:b], weights=touch.weights[a:b], values=touch.values[a:b])
        for a, b in pairwise(ends)
    ]
    whole, measured = measure(touch, design, None), Weighed.over(parts, design).measures
    for name, value in vars(whole).items():
        assert getattr(measured, name) == pytest.approx(value, rel=1e-12, abs=1e-12), name
        assert np.isfinite(value).all()


def test_overlaps_of_some_modes_are_those_of_their_motion_alone() -> None:
    values = fields(4)
    every, one = (Weighed.over([face(own)], DESIGN).overlaps for own in (values, values[:, [3, 1]]))
    for all_of_them, alone in zip(every, one, strict=True):
        assert all_of_them and alone
        for name in ("active", "passive", "projection"):
            assert getattr(all_of_them.among([3, 1]), name) == pytest.approx(getattr(alone, name), rel=1e-12)


def test_complex_neighbours_move_the_level_as_that_of_the_worst_phase_does() -> None:
    """A column's modes at a wavenumber: what the neighbour's share of any phase does to the level, to first order."""
    draw = np.random.default_rng(6).normal(size=(2, 1000, 2)) + 0.3
    values, half, error = draw[0] + 1j * draw[1], np.arange(1000) < 400, 1e-5
    share = 2.0 * error * TONES[0] * TONES[1] / (TONES[1] ** 2 - TONES[0] ** 2)

    def ratio(moved: np.ndarray) -> np.ndarray:
        return 10.0 * np.log10(np.mean(np.abs(moved[half]) ** 2, axis=0) / np.mean(np.abs(moved[~half]) ** 2, axis=0))

    phases = np.exp(1j * np.linspace(0.0, 2.0 * np.pi, 181))
    worst = np.abs(ratio(values[:, :1] + share * phases * values[:, 1:]) - ratio(values[:, :1])).max()
    overlaps = Overlaps.between(1e-6 * half, 1e-6 * ~half, values)
    assert overlaps.mixing_db(TONES[:2], 0, error) == pytest.approx(worst, rel=1e-2)


def test_neighbours_add_by_their_squares() -> None:
    values = fields()
    both = level_db(face(values), TONES, 0, 1e-4, DESIGN)
    alone = [level_db(face(values[:, [0, j]]), TONES[[0, j]], 0, 1e-4, DESIGN) for j in (1, 2)]
    assert both == pytest.approx(np.hypot(*alone), rel=1e-12)
    assert alone[0] > alone[1]


def test_it_is_proportional_to_the_error_until_modes_are_one() -> None:
    values = fields()
    small = level_db(face(values), TONES, 1, 1e-4, DESIGN)
    assert small and level_db(face(values), TONES, 1, 2e-4, DESIGN) == pytest.approx(2.0 * small)
    same = level_db(face(values), np.array([30e3, 30e3, 40e3]), 0, 1e-4, DESIGN)
    assert same is not None and np.isfinite(same)


def test_a_neighbour_of_the_same_field_moves_nothing_and_a_zone_alone_has_no_level() -> None:
    values = fields(1)
    assert level_db(face(np.hstack([values, 3.0 * values])), TONES[:2], 0, 1e-2, DESIGN) == pytest.approx(0.0)
    assert level_db(face(values, half_m=9e-3), TONES[:1], 0, 1e-2, DESIGN) is None


def alike(values: np.ndarray) -> np.ndarray:
    """MAC and strength."""
    measured = measure(face(values[:, None]), DESIGN, None)
    return np.array([measured.mac[0], measured.strength[0]])


def shape_bars(values: np.ndarray, error: float, index: int = 0, **more: float) -> np.ndarray:
    overlaps = Weighed.over([face(values)], DESIGN).overlaps[0]
    assert overlaps
    return np.array(overlaps.mixing_shape(TONES[: values.shape[1]], index, error, **more))


@pytest.mark.parametrize("error", [1e-5, 1e-3, 1e-2])
def test_one_neighbour_moves_mac_and_strength_by_what_its_share_does_in_the_worse_sign(error: float) -> None:
    """Not to first order alone: the bars of a mode that has nothing of the shape are not 0."""
    values = fields(2)
    share = 2.0 * error * TONES[0] * TONES[1] / (TONES[1] ** 2 - TONES[0] ** 2)
    mixed = [(values[:, 0] + sign * share * values[:, 1]) / np.hypot(1.0, share) for sign in (1.0, -1.0)]
    moved = np.abs([alike(each) - alike(values[:, 0]) for each in mixed]).max(axis=0)
    assert shape_bars(values, error) == pytest.approx(moved, rel=1e-9)
    assert shape_bars(values, error, share=0.25) == pytest.approx(shape_bars(values, 0.25 * error), rel=1e-9)


def test_bars_of_mac_and_strength_add_by_their_squares_and_a_mode_alone_has_none() -> None:
    values = fields()
    alone = [shape_bars(values[:, :2], 1e-6), shape_bars(values[:, [0, 2]], 1e-6 * _further())]
    assert shape_bars(values, 1e-6) == pytest.approx(np.hypot(*alone), rel=1e-4)
    assert np.isnan(shape_bars(values[:, :1], 1e-4)).all()


def _further() -> float:
    """The share of the third mode over that of a second one in its place."""
    return TONES[2] / (TONES[2] ** 2 - TONES[0] ** 2) * (TONES[1] ** 2 - TONES[0] ** 2) / TONES[1]


@pytest.mark.parametrize("louder", [0.3, 3.0])
def test_a_share_s_bar_is_that_of_its_level(louder: float) -> None:
    """With any motion that is louder in the zone alone by so many decibels, or softer; of a small and a large share."""
    active = np.abs(face(fields(1)).points[:, 1]) < DESIGN.width_m / 2.0

    def of(factor: float) -> tuple[float, float]:
        measured = measure(face(np.where(active[:, None], factor, 1.0) * fields(1)), DESIGN, None)
        return float(measured.confinement_db[0]), float(measured.zone_share[0])

    level_db, share = of(louder)
    assert (share < 0.5) == (louder < 1.0)
    for decibels in (0.01, 1.0, 6.0):
        ends = [of(louder * 10.0 ** (sign * decibels / 20.0)) for sign in (1.0, -1.0)]
        assert [abs(end - level_db) for end, _ in ends] == pytest.approx([decibels] * 2)
        assert share_error(share, decibels) == pytest.approx(max(abs(end - share) for _, end in ends), rel=1e-9)
    assert share_error(None, 1.0) is None and share_error(0.5, None) is None
    assert share_error(0.25, 1e4) == pytest.approx(0.75)  # a bar that tells nothing


@pytest.mark.parametrize("mass_kg", [1.0, 1e-9])
def test_a_class_that_lacks_the_shape_has_no_strength_at_any_scale(mass_kg: float) -> None:
    touch = face(fields(1))
    light = TouchField(touch.points, touch.weights, touch.values, mass_kg)
    assert not strength_force(light, DESIGN, "AA").any()
    force = strength_force(light, DESIGN, None)
    strength = measure(light, DESIGN, None).strength
    assert (force @ touch.values) ** 2 == pytest.approx(strength, rel=1e-12)


def test_a_share_of_energy_moves_as_its_mixed_modes_do() -> None:
    """By the worse sign of each neighbour, not to first order alone: a part that one mode leaves still has a bar."""
    part, vectors, mixed = np.diag([1.0, 0.0, 0.5, 0.0]), np.eye(4)[:, [1, 0, 2]], np.array([0.0, 0.2, 0.1])
    share_of = lambda moved: np.einsum("ik,ik->k", moved, part @ moved)  # noqa: E731
    alone = [0.2**2 / (1.0 + 0.2**2), 0.5 * 0.1**2 / (1.0 + 0.1**2)]
    assert mixed_energy(share_of, vectors, 0, mixed) == pytest.approx((0.0, np.hypot(*alone)), rel=1e-12)
    assert mixed_energy(share_of, vectors[:, :1], 0, mixed[:1]) == (0.0, 0.0)
