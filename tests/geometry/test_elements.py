"""Reference elements: what every finite-element text asks of shape functions, quadrature and faces."""

from __future__ import annotations

from itertools import product
from math import factorial

import numpy as np
import pytest

from geometry.elements import element, gauss_lobatto, lagrange

ALL = [("hex", 1), ("hex", 2), ("hex", 3), ("hex", 4), ("tet", 1), ("tet", 2)]
ROUNDING = 1e-12


def inside(kind: str, count: int = 40) -> np.ndarray:
    """Points of the reference element."""
    draw = np.random.default_rng(7)
    if kind == "hex":
        return draw.uniform(-1.0, 1.0, (count, 3))
    return draw.dirichlet(np.ones(4), count)[:, 1:]


def exact_moment(kind: str, powers: tuple[int, int, int]) -> float:
    """Integral of x^a y^b z^c over the reference element."""
    if kind == "hex":
        return float(np.prod([0.0 if p % 2 else 2.0 / (p + 1) for p in powers]))
    return float(np.prod([factorial(p) for p in powers]) / factorial(sum(powers) + 3))


@pytest.mark.parametrize(("kind", "order"), ALL)
def test_each_shape_function_is_one_at_its_own_node_only(kind: str, order: int) -> None:
    shape = element(kind, order)
    value, _ = shape.shape(shape.points)
    assert np.abs(value - np.eye(len(shape.points))).max() < ROUNDING


@pytest.mark.parametrize(("kind", "order"), ALL)
def test_shape_functions_sum_to_one_and_their_slopes_to_zero(kind: str, order: int) -> None:
    value, gradient = element(kind, order).shape(inside(kind))
    assert np.abs(value.sum(axis=1) - 1.0).max() < ROUNDING
    assert np.abs(gradient.sum(axis=1)).max() < 1e-11


@pytest.mark.parametrize(("kind", "order"), ALL)
def test_gradients_are_the_slopes_of_the_values(kind: str, order: int) -> None:
    shape, at, step = element(kind, order), 0.9 * inside(kind) + 0.01, 1e-5
    _, gradient = shape.shape(at)
    for axis in range(3):
        move = np.zeros(3)
        move[axis] = step
        difference = (shape.shape(at + move)[0] - shape.shape(at - move)[0]) / (2.0 * step)
        assert np.abs(difference - gradient[:, :, axis]).max() < 1e-7


@pytest.mark.parametrize(("kind", "order"), ALL)
def test_an_element_of_order_p_reproduces_polynomials_of_degree_p(kind: str, order: int) -> None:
    shape, at = element(kind, order), inside(kind)
    value, _ = shape.shape(at)
    for powers in product(range(order + 1), repeat=3):
        if kind == "tet" and sum(powers) > order:
            continue
        nodal = np.prod(shape.points ** np.array(powers), axis=1)
        assert np.abs(value @ nodal - np.prod(at ** np.array(powers), axis=1)).max() < 1e-11


@pytest.mark.parametrize(("kind", "order"), ALL)
def test_quadrature_is_exact_to_its_stated_degree(kind: str, order: int) -> None:
    rule = element(kind, order).quadrature
    degree = 2 * order + 1 if kind == "hex" else 5
    for powers in product(range(degree + 1), repeat=3):
        if kind == "tet" and sum(powers) > degree:
            continue
        result = rule.weights @ np.prod(rule.points ** np.array(powers), axis=1)
        assert abs(result - exact_moment(kind, powers)) < 1e-12, powers


def test_quadrature_of_a_hexahedron_is_not_exact_beyond_its_degree() -> None:
    rule = element("hex", 2).quadrature
    assert abs(rule.weights @ rule.points[:, 0] ** 6 - exact_moment("hex", (6, 0, 0))) > 1e-3


@pytest.mark.parametrize(("kind", "order"), ALL)
def test_quadrature_weights_are_positive_and_points_inside(kind: str, order: int) -> None:
    rule = element(kind, order).quadrature
    assert (rule.weights > 0.0).all()
    low = -1.0 if kind == "hex" else 0.0
    assert (rule.points > low).all()
    assert (rule.points.sum(axis=1) < 1.0).all() if kind == "tet" else (rule.points < 1.0).all()


@pytest.mark.parametrize("order", [1, 2, 3, 4])
def test_faces_of_a_hexahedron_lie_on_their_planes(order: int) -> None:
    shape = element("hex", order)
    for face, (axis, side) in zip(shape.faces, [(0, -1), (0, 1), (1, -1), (1, 1), (2, -1), (2, 1)], strict=True):
        assert len(np.unique(face)) == (order + 1) ** 2
        assert (shape.points[face][:, axis] == side).all()


@pytest.mark.parametrize("order", [1, 2])
def test_faces_of_a_tetrahedron_point_outwards_and_their_middles_lie_between_corners(order: int) -> None:
    shape = element("tet", order)
    for face in shape.faces:
        a, b, c = shape.points[face[:3]]
        outward = np.cross(b - a, c - a)
        assert outward @ (a - 0.25) > 0.0
        if order == 2:
            assert np.allclose(shape.points[face[3:]], [(a + b) / 2, (b + c) / 2, (c + a) / 2], atol=1e-15)


def test_gauss_lobatto_points_are_the_known_ones() -> None:
    assert np.allclose(gauss_lobatto(2), [-1.0, 0.0, 1.0], atol=1e-15)
    assert np.allclose(gauss_lobatto(3), [-1.0, -1 / 5**0.5, 1 / 5**0.5, 1.0], atol=1e-15)
    assert np.allclose(gauss_lobatto(4), [-1.0, -((3 / 7) ** 0.5), 0.0, (3 / 7) ** 0.5, 1.0], atol=1e-15)


def test_lagrange_derivatives_of_a_cubic_are_exact() -> None:
    nodes, at = gauss_lobatto(3), np.linspace(-1.0, 1.0, 7)
    _, slope = lagrange(nodes, at)
    assert np.allclose(slope @ nodes**3, 3.0 * at**2, atol=1e-13)


@pytest.mark.parametrize(("kind", "order"), [("hex", 0), ("hex", 5), ("tet", 3), ("wedge", 1)])
def test_elements_that_are_not_offered_are_named_with_what_is(kind: str, order: int) -> None:
    with pytest.raises(ValueError, match=f"no {kind} element of order {order}: hex has 1 to 4, tet has 1 and 2"):
        element(kind, order)
