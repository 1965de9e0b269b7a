"""Gauss rules on rectangles parted at lines: integrals of polynomials over either side."""

from __future__ import annotations

from itertools import pairwise, product

import numpy as np
import pytest
from numpy.polynomial import legendre

from solvers.fem.surface import COUNT, gauss_points, parted

EDGES = (-2.0, -0.7, 0.4, 1.5)  # of rectangles along y
LINES = (-1.1, 0.4, 0.9, 1.2)


def mirrored_grid() -> tuple[np.ndarray, np.ndarray]:
    """Three rectangles side by side along y, the middle one upside down."""
    at, weights = gauss_points()
    points, areas = [], []
    for number, (low, high) in enumerate(pairwise(EDGES)):
        half = (high - low) / 2.0
        y = (low + high) / 2.0 + half * at[:, 1] * (-1.0 if number == 1 else 1.0)
        points.append(np.column_stack([at[:, 0], y, np.zeros(len(at))]))
        areas.append(half * weights)
    return np.concatenate(points), np.concatenate(areas)


def test_squares_of_polynomials_are_integrated_exactly_on_either_side_of_every_line() -> None:
    points, areas = mirrored_grid()
    cut, weights, along = parted(points, areas, LINES)
    assert along is not None and weights.sum() == pytest.approx(2.0 * (EDGES[-1] - EDGES[0]), rel=1e-13)
    borders = [EDGES[0], *LINES, EDGES[-1]]
    for i, j in product(range(COUNT), repeat=2):
        row = legendre.Legendre.basis(j)
        values = along @ (legendre.legval(points[:, 0], np.eye(COUNT)[i]) * row(points[:, 1]))
        whole = (row**2).integ()
        for low, high in pairwise(borders):
            inside = (cut[:, 1] > low) & (cut[:, 1] < high)
            exact = 2.0 / (2 * i + 1) * (whole(high) - whole(low))
            assert weights[inside] @ values[inside] ** 2 == pytest.approx(exact, rel=1e-11)


def test_a_rule_that_no_line_crosses_stays_as_it_is() -> None:
    points, areas = mirrored_grid()
    moved, weights, along = parted(points, areas, (-9.0, 9.0))
    assert moved is points and weights is areas and along is None
