"""Gauss rules on rectangles, parted at lines y = const: integrals of polynomials over either side are exact."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import numpy as np
import scipy.sparse as sp
from numpy.polynomial import legendre

from geometry.elements import FloatArray, lagrange

COUNT = 6  # points each way: of a rectangle where u_z has degree 5, and its square 10
EDGE = 1e-9  # of half a rectangle's depth: a line so near to its edge runs along it


def gauss_points() -> tuple[FloatArray, FloatArray]:
    """Points (COUNT^2, 2) and weights (COUNT^2,) on [-1, 1]^2, y fastest."""
    s, w = legendre.leggauss(COUNT)
    return np.stack(np.meshgrid(s, s, indexing="ij"), axis=-1).reshape(-1, 2), np.outer(w, w).ravel()


def parted(
    points: FloatArray, weights: FloatArray, lines_m: Sequence[float]
) -> tuple[FloatArray, FloatArray, sp.csr_array | None]:
    """Points (q, 3) and weights (q,), none of whose rectangles reaches over a line, and the interpolation (q, p) to them, None
    where they are the same.

    points (p, 3) in m and weights (p,) are `gauss_points` of rectangles one after another, whichever way these are mirrored.
    """
    low, high = points[:, 1].min(), points[:, 1].max()
    margin = high - low  # a rectangle reaches beyond its outermost points, by less than this
    if not any(low - margin < line < high + margin for line in lines_m):
        return points, weights, None
    rows: list[tuple[FloatArray, FloatArray, FloatArray]] = []
    for first in range(0, len(points), COUNT**2):
        own = slice(first, first + COUNT**2)
        rows.append(_cut(points[own], weights[own], lines_m))
    moved, area, along = zip(*rows, strict=True)
    return np.concatenate(moved), np.concatenate(area), sp.csr_array(sp.block_diag(along))


def _cut(
    points: FloatArray, weights: FloatArray, lines_m: Sequence[float]
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """The same of one rectangle; its rule as it is where no line crosses it."""
    s, w = legendre.leggauss(COUNT)
    y = points[:COUNT, 1]
    middle, half = (y[0] + y[-1]) / 2.0, (y[-1] - y[0]) / (s[-1] - s[0])
    at = np.sort([(line - middle) / half for line in lines_m])
    inside = at[np.abs(at) < 1.0 - EDGE]
    if not len(inside):
        return points, weights, np.eye(len(points))
    parts = [((low + high) / 2.0, (high - low) / 2.0) for low, high in pairwise([-1.0, *inside.tolist(), 1.0])]
    t, share = (np.concatenate(part) for part in zip(*((c + h * s, h * w) for c, h in parts), strict=True))
    moved = np.repeat(points[::COUNT], len(t), axis=0)
    moved[:, 1] = np.tile(middle + half * t, COUNT)
    across = weights.reshape(COUNT, COUNT).sum(axis=1) / w.sum()
    return moved, np.asarray(np.outer(across, share).ravel()), np.asarray(np.kron(np.eye(COUNT), lagrange(s, t)[0]))
