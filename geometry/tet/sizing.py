"""Edge length as a function of place: finer near singular edges, growing linearly away from them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from geometry.elements import FloatArray, IntArray
from geometry.errors import MeshError

Size = Callable[[FloatArray], FloatArray]
GRID_NODES = 400_000  # a finer background grid costs the mesher more than it brings
BOX_TETS = np.array([[0, 1, 3, 7], [0, 3, 2, 7], [0, 2, 6, 7], [0, 6, 4, 7], [0, 4, 5, 7], [0, 5, 1, 7]])


@dataclass(frozen=True)
class NearSegments:
    """Edge length h(d) = min(fine_m + growth d, coarse_m), d the distance to the nearest of the segments (k, 2, 3), m."""

    segments: FloatArray
    fine_m: float
    coarse_m: float
    growth: float = 0.5

    def __call__(self, points: FloatArray) -> FloatArray:
        """Edge length at points (n, 3), m."""
        nearest = np.full(len(points), np.inf)
        for start, end in self.segments:
            along = end - start
            share = np.clip((points - start) @ along / (along @ along), 0.0, 1.0)
            nearest = np.minimum(nearest, np.linalg.norm(points - start - share[:, None] * along, axis=1))
        return np.minimum(self.fine_m + self.growth * nearest, self.coarse_m)


def background(
    size: Size, low: FloatArray, high: FloatArray, spacing: float
) -> tuple[FloatArray, IntArray, FloatArray]:
    """A grid of tetrahedra around the box low-high that carries `size` at its nodes: points, cells, values.

    The spacing grows until the grid has at most GRID_NODES nodes. Raises MeshError for a size that is not positive.
    """
    room = high - low
    spacing = max(spacing, float((np.maximum(room, spacing).prod() / GRID_NODES) ** (1.0 / 3.0)))
    counts = np.maximum(np.ceil(room / spacing).astype(int), 1) + 2
    lines = [
        np.linspace(a - s / (n - 2), b + s / (n - 2), n + 1) for a, b, s, n in zip(low, high, room, counts, strict=True)
    ]
    z, y, x = np.meshgrid(*lines[::-1], indexing="ij")
    points = np.column_stack([x.ravel(), y.ravel(), z.ravel()])
    values = np.asarray(size(points), dtype=float)
    if values.shape != (len(points),) or not (values > 0.0).all():
        raise MeshError("the sizing field must give one positive edge length for each point")
    nx, ny, nz = counts
    i, j, k = np.meshgrid(np.arange(nx), np.arange(ny), np.arange(nz), indexing="ij")
    corner = (i + (nx + 1) * (j + (ny + 1) * k)).ravel()
    step = np.array([a + (nx + 1) * (b + (ny + 1) * c) for c in (0, 1) for b in (0, 1) for a in (0, 1)])
    cells = (corner[:, None] + step)[:, BOX_TETS].reshape(-1, 4)
    return points, cells, values
