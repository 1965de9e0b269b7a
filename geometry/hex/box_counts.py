"""Sizes of a mesh of boxes, told from its breakpoints: nothing is meshed, and a mesh too large to make is counted too."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from geometry.elements import FloatArray
from geometry.hex.boxes import Scene
from geometry.hex.grading import Grading, interval_count


@dataclass(frozen=True)
class BoxCounts:
    """Elements of the body (along x, y, z) and of each pillar on it, the order, and what follows: exact.

    columns, rows: how many elements a foot takes along x and y, one entry a column and a row of pillars; up: along a pillar.
    """

    body: tuple[int, int, int]
    order: int
    columns: tuple[int, ...] = ()
    rows: tuple[int, ...] = ()
    up: int = 0

    @property
    def pillars(self) -> int:
        """Pillars, those cut by a mirror included."""
        return len(self.columns) * len(self.rows)

    @property
    def elements(self) -> int:
        """Hexahedra."""
        nx, ny, nz = self.body
        return nx * ny * nz + sum(self.columns) * sum(self.rows) * self.up

    @property
    def nodes(self) -> int:
        """Nodes."""
        return self._sum(lambda count: self.order * count + 1)

    @property
    def pairs(self) -> int:
        """Ordered pairs of nodes that share an element: entries of the scalar mass, a ninth of the stiffness's."""
        return self._sum(lambda count: count * (self.order + 1) ** 2 - (count - 1))

    def _sum(self, along: Callable[[int], int]) -> int:
        """A figure that is a product over the axes: the body's and the pillars', less what their feet share."""
        nx, ny, nz = (along(count) for count in self.body)
        feet = sum(map(along, self.columns)) * sum(map(along, self.rows))
        return nx * ny * nz + feet * (along(self.up) - 1 if self.up else 0)


def box_counts(scene: Scene, order: int) -> BoxCounts:
    """Sizes of `hex_mesh(boxes_of(scene), order)`."""
    body = (
        interval_count(scene.x, scene.across),
        interval_count(scene.y, scene.across),
        interval_count(scene.z, scene.through),
    )
    if scene.above is None or scene.along is None:
        return BoxCounts(body, order)
    columns, rows = (
        _feet(breaks, scene.centres[:, axis], scene.half_m, scene.across)
        for axis, breaks in enumerate((scene.x, scene.y))
    )
    return BoxCounts(body, order, columns, rows, interval_count(scene.above, scene.along))


def _feet(breaks: dict[float, bool], centres: FloatArray, half_m: float, grading: Grading) -> tuple[int, ...]:
    """Elements that each column of feet takes along one axis; a mirror or the plate's edge may cut a foot."""
    low, high = min(breaks), max(breaks)
    sides = [(max(low, centre - half_m), min(high, centre + half_m)) for centre in np.unique(centres).tolist()]
    return tuple(interval_count({start: start > low, end: end < high}, grading) for start, end in sides)
