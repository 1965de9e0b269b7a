"""u_z on the touch face of a quarter cell: a polynomial on each rectangle that stretches as one."""

from __future__ import annotations

from itertools import product
from math import isqrt

import numpy as np
from numpy.polynomial import legendre

from geometry.elements import FloatArray
from solvers.fem.gauss_grid import COUNT, gauss_points
from solvers.fem.surface import face_quadrature
from solvers.parametric.affine import PITCH, SIDE, AffineCell


def fitted_touch(cell: AffineCell) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Gauss points (p, 2) in m and weights (p,) of the four rectangles, block or clearance along x and y, and u_z there from
    that at the points of `face_quadrature`, (p, q).

    The foot lies a plate's thickness away: degree COUNT - 1 follows the field, or as much as the points tell.
    """
    lines = [0.0, cell.box.foot.reach * cell.reference[SIDE] / 2.0, cell.reference[PITCH] / 2.0]
    at, (gauss, area) = face_quadrature(cell.mesh, "touch").points[:, :2], gauss_points()
    points, weights, rows = [], [], []
    for corner in product((0, 1), repeat=2):
        low, high = np.array([lines[i] for i in corner]), np.array([lines[i + 1] for i in corner])
        middle, half = (low + high) / 2.0, (high - low) / 2.0
        inside = np.flatnonzero(((at > low) & (at < high)).all(axis=1))
        degree = min(COUNT, isqrt(len(inside))) - 1
        row = np.zeros((len(gauss), len(at)))
        row[:, inside] = _products(gauss, degree) @ np.linalg.pinv(_products((at[inside] - middle) / half, degree))
        rows.append(row)
        points.append(middle + half * gauss)
        weights.append(area * half.prod())
    return np.concatenate(points), np.concatenate(weights), np.concatenate(rows)


def _products(points: FloatArray, degree: int) -> FloatArray:
    """Products of Legendre polynomials at points (n, 2), (n, (degree + 1)^2)."""
    x, y = (legendre.legvander(points[:, axis], degree) for axis in (0, 1))
    return np.asarray((x[:, :, None] * y[:, None, :]).reshape(len(points), -1), dtype=float)
