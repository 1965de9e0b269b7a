"""A field measured at points: area weights against counting and closed forms, confinement and correlation of known fields."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial import cKDTree

from geometry.layout import Design
from geometry.materials import MATERIALS
from solvers.errors import SolverError
from solvers.measures.confinement import target_shape
from solvers.measures.correlation import assurance, confinement_of, sampled, voronoi_areas, weigh

ALUMINIUM = MATERIALS["aluminium"]
DESIGN = Design(60e-3, 20e-3, 2e-3, 4, ALUMINIUM, None, float("nan"), float("nan"), 0, 12e-3)
BARE = Design(60e-3, 20e-3, 2e-3, 4, ALUMINIUM, None, float("nan"), float("nan"), 0, 0.0)
LOW, HIGH = np.array([0.0, 0.0]), np.array([3.0, 2.0])


def lines(*counts: int) -> np.ndarray:
    """A grid over the whole touch face, its outer points on the plate's edges."""
    x = np.linspace(-DESIGN.length_m / 2, DESIGN.length_m / 2, counts[0])
    y = np.linspace(-DESIGN.half_span_m, DESIGN.half_span_m, counts[1])
    return np.stack(np.meshgrid(x, y, indexing="ij"), axis=-1).reshape(-1, 2)


def strewn(count: int, seed: int = 3) -> np.ndarray:
    """Points that crowd along y = 0, as an operator's hand would set them."""
    random = np.random.default_rng(seed)
    unit = random.uniform(-1.0, 1.0, (count, 2))
    unit[:, 1] = np.sign(unit[:, 1]) * np.abs(unit[:, 1]) ** 1.7
    return unit * np.array([DESIGN.length_m / 2, DESIGN.half_span_m])


def test_cells_fill_the_rectangle_and_are_those_of_the_nearest_point() -> None:
    points = np.random.default_rng(1).uniform(LOW, HIGH, (40, 2))
    areas = voronoi_areas(points, LOW, HIGH)
    assert areas.sum() == pytest.approx(6.0, rel=1e-12)
    random = np.random.default_rng(2)
    thrown = 400_000
    nearest = cKDTree(points).query(random.uniform(LOW, HIGH, (thrown, 2)))[1]
    hits = np.bincount(nearest, minlength=len(points))
    share = areas / 6.0
    assert np.all(np.abs(hits / thrown - share) < 5.0 * np.sqrt(share * (1.0 - share) / thrown))


def test_a_grid_to_the_edges_is_the_trapezoidal_rule() -> None:
    weights = weigh(lines(13, 45), DESIGN)
    x = np.isclose(np.abs(weights.points[:, 0]), DESIGN.length_m / 2, atol=1e-6)
    y = np.isclose(np.abs(weights.points[:, 1])[:, None], [10e-3, 22e-3], atol=1e-6).any(axis=1)
    expected = 5e-3 * 1e-3 * np.where(x, 0.5, 1.0) * np.where(y, 0.5, 1.0)
    assert np.allclose(weights.area_m2, expected, rtol=1e-4)
    assert len(weights.index) == 13 * (45 + 2)  # those on the zone's border count on both sides
    assert (weights.active, weights.passive) == pytest.approx((1.0, 1.0), rel=1e-5)


@pytest.mark.parametrize("points", [lines(7, 20), strewn(900)], ids=["grid", "strewn"])
def test_a_field_of_two_levels_is_held_by_their_ratio_on_any_grid(points: np.ndarray) -> None:
    values = np.where(np.abs(points[:, 1]) < DESIGN.width_m / 2, 2.0 + 1.0j, 1.0j)
    clamped = confinement_of(weigh(points, DESIGN), values, DESIGN)
    assert clamped.confinement_db == pytest.approx(10.0 * np.log10(5.0), abs=1e-9)
    assert clamped.zone_share == pytest.approx(5.0 * 20.0 / (5.0 * 20.0 + 24.0), rel=1e-3)


def falling(points: np.ndarray) -> np.ndarray:
    """A wave along x that falls off across the plate, turning its phase on the way."""
    x, y = points.T
    return np.cos(2.0 * np.pi * x / 30e-3) * np.exp(-np.abs(y) / 8e-3 + 40.0j * np.abs(y))


def test_strewn_points_measure_what_the_integral_is() -> None:
    """Integrals in closed form; each cell errs by at most its area times the field's slope times its reach."""
    points = strewn(4000)
    clamped = confinement_of(weigh(points, DESIGN), falling(points), DESIGN)
    inner, outer = (1.0 - np.exp(-20.0 / 8.0)) / 20.0, (np.exp(-20.0 / 8.0) - np.exp(-44.0 / 8.0)) / 24.0
    exact = 10.0 * np.log10(inner / outer)
    assert clamped.confinement_db == pytest.approx(exact, abs=0.15)
    even = np.abs(points[:, 1]) < DESIGN.width_m / 2
    plain = np.mean(np.abs(falling(points[even])) ** 2) / np.mean(np.abs(falling(points[~even])) ** 2)
    assert abs(10.0 * np.log10(plain) - exact) > 0.6  # without areas the crowd about y = 0 decides


@pytest.mark.slow
def test_the_target_shape_has_a_mac_of_one_whatever_its_phase_and_size() -> None:
    points = lines(121, 45)
    inside = np.abs(points[:, 1]) < DESIGN.width_m / 2 + 1e-9
    values = np.where(inside, target_shape(DESIGN, points), 0.0) * (0.3 - 2.0j)
    assert confinement_of(weigh(points, DESIGN), values, DESIGN).mac == pytest.approx(1.0, abs=1e-9)
    turned = values * np.where(points[:, 0] > 0.0, 1.0, 1.0j)  # half of it a quarter of a period late
    assert confinement_of(weigh(points, DESIGN), turned, DESIGN).mac == pytest.approx(0.5, abs=0.01)


def test_a_plate_without_passive_face_has_no_confinement() -> None:
    points = lines(13, 45)
    points = points[np.abs(points[:, 1]) <= 10e-3 + 1e-9]
    clamped = confinement_of(weigh(points, BARE), np.ones(len(points), dtype=complex), BARE)
    assert clamped.confinement_db is None and clamped.zone_share is None


def test_what_a_map_does_not_cover_is_told() -> None:
    points = lines(61, 45)
    right = points[points[:, 0] > 1e-6]
    weights = weigh(right, DESIGN)
    assert weights.active == pytest.approx(0.5, abs=0.02) and weights.passive == pytest.approx(0.5, abs=0.02)
    upper = weigh(points[points[:, 1] > -10.5e-3], DESIGN)
    assert upper.active == pytest.approx(1.0, rel=1e-5) and upper.passive == pytest.approx(
        0.5 + 0.25e-3 * 2 / 24e-3, abs=1e-3
    )
    for part, whole in ((right, weights), (points[points[:, 1] > -10.5e-3], upper)):
        mirrored = weigh(-part, DESIGN)  # what is not covered lies on the other side
        assert (mirrored.active, mirrored.passive) == pytest.approx((whole.active, whole.passive), rel=1e-9)
    with pytest.raises(SolverError, match="active touch face"):
        weigh(points[np.abs(points[:, 1]) > 12e-3], DESIGN)


def test_one_point_stands_for_what_is_about_it() -> None:
    weights = weigh(np.array([[0.0, 0.0], [0.0, 15e-3]]), DESIGN)
    assert len(weights.index) == 2 and np.all(weights.area_m2 > 0.0)


def test_a_linear_field_is_read_exactly_between_points_and_the_nearest_beyond() -> None:
    points = strewn(200)
    values = 1.0 + 3.0 * points[:, 0] - 2.0j * points[:, 1]
    at = np.array([[0.0, 0.0], [5e-3, -3e-3]])
    assert sampled(points, values, at) == pytest.approx(1.0 + 3.0 * at[:, 0] - 2.0j * at[:, 1])
    far = sampled(points, values, np.array([[1.0, 0.0]]))
    assert far[0] == values[np.argmin(np.hypot(points[:, 0] - 1.0, points[:, 1]))]


def test_assurance_is_one_for_multiples_and_zero_across() -> None:
    random = np.random.default_rng(5)
    area, field = random.uniform(0.5, 1.0, 50), random.normal(size=50) + 1j * random.normal(size=50)
    assert assurance(area, field, (2.0 - 1.0j) * field) == pytest.approx(1.0)
    other = random.normal(size=50) + 1j * random.normal(size=50)
    across = other - field * ((area * field.conj()) @ other) / (area @ np.abs(field) ** 2)
    assert assurance(area, field, across) == pytest.approx(0.0, abs=1e-20)
    assert assurance(area, field, 0.0 * field) == 0.0
