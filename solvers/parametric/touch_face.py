"""u_z on the touch face of a quarter cell: a polynomial on each rectangle that stretches as one."""

from __future__ import annotations

from itertools import product

import numpy as np
from numpy.polynomial import legendre

from geometry.elements import FloatArray
from geometry.mesh import Mesh
from solvers.fem.quadrature import COUNT, gauss_points
from solvers.fem.surface import face_quadrature
from solvers.parametric.affine import PITCH, SIDE, Sizes
from solvers.parametric.foot import Foot

APART = 20.0  # condition number of such polynomials: 11 where the rule is exact for their squares


def fitted_touch(mesh: Mesh, foot: Foot, reference: Sizes) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Gauss points (p, 2) in m and weights (p,) of the four rectangles, block or clearance along x and y, and u_z there from
    that at the points of `face_quadrature`, (p, q).

    The foot lies a plate's thickness away: degree COUNT - 1 each way follows the field, or as much as the points tell.
    """
    lines = [0.0, foot.reach * reference[SIDE] / 2.0, reference[PITCH] / 2.0]
    rule, (gauss, area) = face_quadrature(mesh, "touch"), gauss_points()
    at = rule.points[:, :2]
    points, weights, rows = [], [], []
    for corner in product((0, 1), repeat=2):
        low, high = np.array([lines[i] for i in corner]), np.array([lines[i + 1] for i in corner])
        middle, half = (low + high) / 2.0, (high - low) / 2.0
        inside = np.flatnonzero(((at > low) & (at < high)).all(axis=1))
        row = np.zeros((len(gauss), len(at)))
        row[:, inside] = _fit((at[inside] - middle) / half, rule.weights[inside], gauss)
        rows.append(row)
        points.append(middle + half * gauss)
        weights.append(area * half.prod())
    return np.concatenate(points), np.concatenate(weights), np.concatenate(rows)


def _fit(known: FloatArray, weights: FloatArray, wanted: FloatArray) -> FloatArray:
    """Values at points (p, 2) of the projection on most products that a rule's points (q, 2) and weights tell apart, (p, q)."""
    root = np.sqrt(weights / weights.sum())
    degrees = [(i, j) for i in range(COUNT) for j in range(COUNT)]
    for each in sorted(degrees, key=lambda each: -(each[0] + 1) * (each[1] + 1)):
        table = root[:, None] * _products(known, each)
        if table.shape[1] <= len(known) and np.linalg.cond(table) < APART:
            return np.asarray(_products(wanted, each) @ np.linalg.pinv(table) * root)
    raise ValueError("no points of a rule lie in a part of the touch face")


def _products(points: FloatArray, degrees: tuple[int, int]) -> FloatArray:
    """Products of Legendre polynomials at points (n, 2), (n, (i + 1) (j + 1))."""
    x, y = (legendre.legvander(points[:, axis], degrees[axis]) for axis in (0, 1))
    return np.asarray((x[:, :, None] * y[:, None, :]).reshape(len(points), -1), dtype=float)
