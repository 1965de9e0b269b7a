"""Reference elements: what every finite-element text asks of shape functions, quadrature and faces."""

from __future__ import annotations

from itertools import product
from math import factorial

import numpy as np
import pytest

from geometry.elements import element, gauss_lobatto, lagrange

ALL = [("hex", 1), ("hex", 2), ("hex", 3), ("hex", 4), ("tet", 1), ("tet", 2)]
ALL += [("wedge", 1), ("wedge", 2), ("pyramid", 1), ("pyramid", 2)]
ROUNDING = 1e-12


def inside(kind: str, count: int = 40) -> np.ndarray:
    """Points of the reference element."""
    draw = np.random.default_rng(7)
    if kind == "hex":
        return draw.uniform(-1.0, 1.0, (count, 3))
    if kind == "tet":
        return draw.dirichlet(np.ones(4), count)[:, 1:]
    along = draw.uniform(0.0, 1.0, (count, 1))
    if kind == "wedge":
        return np.hstack([draw.dirichlet(np.ones(3), count)[:, 1:], 2.0 * along - 1.0])
    return np.hstack([(1.0 - along) * draw.uniform(-1.0, 1.0, (count, 2)), along])


def exact_moment(kind: str, powers: tuple[int, int, int]) -> float:
    """Integral of x^a y^b z^c over the reference element."""
    if kind == "hex":
        return float(np.prod([0.0 if p % 2 else 2.0 / (p + 1) for p in powers]))
    if kind == "wedge":
        a, b, c = powers
        return 0.0 if c % 2 else factorial(a) * factorial(b) / factorial(a + b + 2) * 2.0 / (c + 1)
    if kind == "pyramid":
        a, b, c = powers
        base = 0.0 if a % 2 or b % 2 else 4.0 / ((a + 1) * (b + 1))
        return base * factorial(a + b + 2) * factorial(c) / factorial(a + b + c + 3)
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
        if (kind in ("tet", "pyramid") and sum(powers) > order) or (kind == "wedge" and sum(powers[:2]) > order):
            continue
        nodal = np.prod(shape.points ** np.array(powers), axis=1)
        assert np.abs(value @ nodal - np.prod(at ** np.array(powers), axis=1)).max() < 1e-11


@pytest.mark.parametrize(("kind", "order"), ALL)
def test_quadrature_is_exact_to_its_stated_degree(kind: str, order: int) -> None:
    rule = element(kind, order).quadrature
    degree = 5 if kind == "tet" else 2 * order + 1
    for powers in product(range(degree + 1), repeat=3):
        if (kind in ("tet", "pyramid") and sum(powers) > degree) or (kind == "wedge" and sum(powers[:2]) > degree):
            continue
        result = rule.weights @ np.prod(rule.points ** np.array(powers), axis=1)
        assert abs(result - exact_moment(kind, powers)) < 1e-12, powers


def test_quadrature_of_a_hexahedron_is_not_exact_beyond_its_degree() -> None:
    rule = element("hex", 2).quadrature
    assert abs(rule.weights @ rule.points[:, 0] ** 6 - exact_moment("hex", (6, 0, 0))) > 1e-3


@pytest.mark.parametrize(("kind", "order"), ALL)
def test_quadrature_weights_are_positive_and_points_inside(kind: str, order: int) -> None:
    rule = element(kind, order).quadrature
    x, y, z = rule.points.T
    within = {
        "hex": np.abs(rule.points).max(axis=1) < 1.0,
        "tet": (rule.points > 0.0).all(axis=1) & (x + y + z < 1.0),
        "wedge": (x > 0.0) & (y > 0.0) & (x + y < 1.0) & (np.abs(z) < 1.0),
        "pyramid": (z > 0.0) & (np.maximum(np.abs(x), np.abs(y)) < 1.0 - z),
    }
    assert (rule.weights > 0.0).all() and within[kind].all()


@pytest.mark.parametrize("order", [1, 2, 3, 4])
def test_faces_of_a_hexahedron_lie_on_their_planes(order: int) -> None:
    shape = element("hex", order)
    for face, (axis, side) in zip(shape.facets[0], [(0, -1), (0, 1), (1, -1), (1, 1), (2, -1), (2, 1)], strict=True):
        assert len(np.unique(face)) == (order + 1) ** 2
        assert (shape.points[face][:, axis] == side).all()


@pytest.mark.parametrize("order", [1, 2])
def test_faces_of_a_tetrahedron_point_outwards_and_their_middles_lie_between_corners(order: int) -> None:
    shape = element("tet", order)
    for face in shape.facets[0]:
        a, b, c = shape.points[face[:3]]
        outward = np.cross(b - a, c - a)
        assert outward @ (a - 0.25) > 0.0
        if order == 2:
            assert np.allclose(shape.points[face[3:]], [(a + b) / 2, (b + c) / 2, (c + a) / 2], atol=1e-15)


@pytest.mark.parametrize(("kind", "order"), [(kind, order) for kind in ("wedge", "pyramid") for order in (1, 2)])
def test_faces_of_wedges_and_pyramids_move_as_those_of_tetrahedra_and_hexahedra(kind: str, order: int) -> None:
    """On a face only its own nodes count, by the shape functions that a neighbour of another kind has there."""
    shape = element(kind, order)
    at = np.random.default_rng(8).dirichlet(np.ones(3), 12)[:, 1:]
    plane = np.column_stack([at, np.zeros(len(at))])
    for facets, neighbour in zip(shape.facets, (element("tet", order), element("hex", order)), strict=True):
        inside = plane if neighbour.kind == "tet" else 2.0 * plane - 1.0
        value, _ = neighbour.shape(inside)
        own = [0, 1, 2, 4, 5, 6] if neighbour.kind == "tet" else list(range(9))  # its nodes on z = 0 or -1
        weights = value[:, own[: facets.shape[1]]]
        for face in facets:
            result, _ = shape.shape(weights @ shape.points[face])
            expected = np.zeros_like(result)
            expected[:, face] = weights
            assert np.abs(result - expected).max() < 1e-11
            a, b, c = (shape.points[face[i]] for i in (0, 1, -1 if neighbour.kind == "hex" else 2))
            assert np.cross(b - a, c - a) @ (a - shape.points.mean(axis=0)) > 0.0


def test_gauss_lobatto_points_are_the_known_ones() -> None:
    assert np.allclose(gauss_lobatto(2), [-1.0, 0.0, 1.0], atol=1e-15)
    assert np.allclose(gauss_lobatto(3), [-1.0, -1 / 5**0.5, 1 / 5**0.5, 1.0], atol=1e-15)
    assert np.allclose(gauss_lobatto(4), [-1.0, -((3 / 7) ** 0.5), 0.0, (3 / 7) ** 0.5, 1.0], atol=1e-15)


def test_lagrange_derivatives_of_a_cubic_are_exact() -> None:
    nodes, at = gauss_lobatto(3), np.linspace(-1.0, 1.0, 7)
    _, slope = lagrange(nodes, at)
    assert np.allclose(slope @ nodes**3, 3.0 * at**2, atol=1e-13)


@pytest.mark.parametrize(("kind", "order"), [("hex", 0), ("hex", 5), ("tet", 3), ("wedge", 3)])
def test_elements_that_are_not_offered_are_named_with_what_is(kind: str, order: int) -> None:
    with pytest.raises(
        ValueError, match=f"no {kind} element of order {order}: hex has orders 1 to 4; tet, wedge and pyramid"
    ):
        element(kind, order)
