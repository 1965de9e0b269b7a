"""Modes followed through a sweep: crossings kept, lost identities told, shapes compared across meshes."""

from __future__ import annotations

import numpy as np
import pytest

from geometry.layout import Design
from geometry.materials import MATERIALS
from solvers.measures.confinement import TouchField, target_shape
from solvers.measures.correlation import Shapes, follow, mac_matrix, step, zone_coefficients

DESIGN = Design(0.1155, 0.020, 2e-3, 8, MATERIALS["aluminium"], None, 4e-3, 4e-3, 0, 10e-3)


def two_modes(detuning: float) -> Shapes:
    """The target mode crosses another one as a parameter passes 0: frequencies repel, shapes turn by an angle."""
    coupled = np.array([[30e3 + detuning, 20.0], [20.0, 30e3 - detuning]])
    hz, vectors = np.linalg.eigh(coupled)
    return Shapes(hz, np.ones(2), vectors.T)


def touch(shapes: list, count: int) -> TouchField:
    """Functions of points (n, 2) on a Gauss grid over the whole touch face, twice as wide as the zone."""
    x, wx = np.polynomial.legendre.leggauss(count)
    points = np.stack(np.meshgrid(x * DESIGN.length_m / 2, x * DESIGN.width_m, indexing="ij"), axis=-1).reshape(-1, 2)
    weights = np.outer(wx, wx).ravel() * DESIGN.length_m * DESIGN.width_m / 2
    return TouchField(points, weights, np.column_stack([shape(points) for shape in shapes]))


def test_a_crossing_in_small_steps_of_large_angle_is_followed() -> None:
    plates = [two_modes(d) for d in (-400.0, -200.0, 200.0, 400.0)]  # the coupling of 20 is jumped over
    steps = follow(plates, 0)
    assert [result.row for result in steps] == [0, 1, 1]
    assert all(result.kept and result.mac > 0.9 for result in steps)


def test_an_even_mixture_loses_the_identity() -> None:
    steps = follow([two_modes(-400.0), two_modes(0.0), two_modes(400.0)], 0)
    assert len(steps) == 1
    assert not steps[0].kept


def test_a_mode_that_went_elsewhere_is_lost() -> None:
    gone = Shapes(np.array([1.0]), np.ones(1), np.array([[0.0, 0.0, 1.0]]))
    here = Shapes(np.array([1.0]), np.ones(1), np.array([[1.0, 0.0, 0.0]]))
    assert not step(here, gone, 0).kept
    assert step(here, Shapes(np.empty(0), np.empty(0), np.empty((0, 3))), 0).row is None


def test_of_two_equal_shapes_the_one_inside_the_zone_is_taken() -> None:
    first = Shapes(np.array([1.0]), np.array([0.9]), np.array([[1.0, 0.0]]))
    second = Shapes(np.array([1.0, 2.0]), np.array([0.1, 0.9]), np.array([[1.0, 0.0], [1.0, 0.1]]))
    assert step(first, second, 0).row == 1


@pytest.mark.parametrize("symmetry", ["SS", None])
def test_the_target_shape_is_kept_by_its_coefficients_on_any_grid(symmetry: str | None) -> None:
    shape = lambda points: target_shape(DESIGN, points)  # noqa: E731
    fine, coarse = (zone_coefficients(touch([shape], n), DESIGN, symmetry) for n in (64, 48))
    assert mac_matrix(fine, coarse)[0, 0] > 0.99
    points = touch([shape], 64)
    active = np.abs(points.points[:, 1]) < DESIGN.width_m / 2
    energy = (points.weights[active] * points.values[active, 0] ** 2).sum()
    assert (fine**2).sum() == pytest.approx(energy, rel=0.02)  # Parseval, but for the cut at the zone's edge


def test_a_quarter_tells_the_shape_of_the_whole_plate() -> None:
    whole = touch([lambda points: target_shape(DESIGN, points)], 48)
    quarter = (whole.points > 0.0).all(axis=1)
    part = TouchField(whole.points[quarter], 4.0 * whole.weights[quarter], whole.values[quarter])
    full, folded = zone_coefficients(whole, DESIGN, None), zone_coefficients(part, DESIGN, "SS")
    assert np.allclose(
        folded, full, atol=1e-12 * np.abs(full).max()
    )  # without the symmetry odd degrees would not vanish
