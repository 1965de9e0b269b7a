"""A field measured at points of the touch face: area weights, confinement by the definition of computed modes, correlation.

Each point stands for its Voronoi cell within the part of the touch face it lies on (okabe2000); a point on the border of
the zone counts on both sides, as the end points of a trapezoidal rule do.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.interpolate import LinearNDInterpolator
from scipy.spatial import Voronoi, cKDTree

from geometry.elements import ComplexArray, FloatArray, IntArray
from geometry.layout import Design
from solvers.errors import SolverError
from solvers.measures.confinement import NEGLIGIBLE, TouchField, measure, wanted_shape

Rectangle = tuple[tuple[float, float], tuple[float, float]]  # (low x, low y), (high x, high y)
INWARD = 1e-7  # of a rectangle's shorter side: points on an edge are moved inside by so much
REACH = 1.05  # spacings: points speak for a face as far as its edge when they come so near, as those of an even grid do
BOTH = 2  # parts of a complex number


@dataclass(frozen=True)
class Weights:
    """Which point (index into the map), where it counts (m, 2) in m, and for what area (m,) in m2.

    active, passive: shares of the two faces' areas that the points cover; passive is None without such a face.
    """

    index: IntArray
    points: FloatArray
    area_m2: FloatArray
    active: float
    passive: float | None


@dataclass(frozen=True)
class FieldMeasures:
    """zone_share, confinement_db (None without a passive face or where nothing of it was measured), mac (wanted shape)."""

    zone_share: float | None
    confinement_db: float | None
    mac: float


def weigh(points_m: FloatArray, design: Design) -> Weights:
    """Area weights of points (n, 2) on the touch face. SolverError when none lies on the active part."""
    half_x, border, half_y = design.length_m / 2.0, design.width_m / 2.0, design.half_span_m
    active: list[Rectangle] = [((-half_x, -border), (half_x, border))]
    passive: list[Rectangle] = []
    if half_y - border > NEGLIGIBLE * border:
        passive = [((-half_x, border), (half_x, half_y)), ((-half_x, -half_y), (half_x, -border))]
    whole_m = np.array([2.0 * half_x, 2.0 * half_y])
    spacing = np.array([_spacing(points_m, axis, float(whole_m[axis])) for axis in (0, 1)])
    parts = [[_part(points_m, box, spacing) for box in boxes] for boxes in (active, passive)]
    if not len(parts[0][0][0]):
        raise SolverError(f"no point of the map lies on the active touch face, |y| <= {1e3 * border:g} mm")
    whole = [part for side in parts for part in side]
    return Weights(
        np.concatenate([index for index, _, _ in whole]),
        np.concatenate([place for _, place, _ in whole]),
        np.concatenate([area for _, _, area in whole]),
        _covered(parts[0], active),
        _covered(parts[1], passive) if passive else None,
    )


def _covered(parts: list[tuple[IntArray, FloatArray, FloatArray]], boxes: list[Rectangle]) -> float:
    whole = sum((high[0] - low[0]) * (high[1] - low[1]) for low, high in boxes)
    return float(sum(area.sum() for _, _, area in parts) / whole)


def _part(points: FloatArray, box: Rectangle, spacing: FloatArray) -> tuple[IntArray, FloatArray, FloatArray]:
    """Points on one rectangle: their numbers, their places moved inside by a hair, their areas."""
    low, high = np.array(box[0]), np.array(box[1])
    hair = INWARD * float((high - low).min())
    inside = np.flatnonzero(((points >= low - hair) & (points <= high + hair)).all(axis=1))
    if not len(inside):
        return inside, np.empty((0, 2)), np.empty(0)
    low, high = _reached(points[inside], low, high, spacing)
    places = np.clip(points[inside], low + hair, high - hair)
    return inside, places, voronoi_areas(places, low, high)


def _reached(
    points: FloatArray, low: FloatArray, high: FloatArray, spacing: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """The rectangle that the points speak for: to the edge where they come near, half a spacing beyond them elsewhere."""
    first, last = low.copy(), high.copy()
    for axis in (0, 1):
        nearest, farthest, step = points[:, axis].min(), points[:, axis].max(), spacing[axis]
        if nearest - low[axis] > REACH * step:
            first[axis] = nearest - step / 2.0
        if high[axis] - farthest > REACH * step:
            last[axis] = farthest + step / 2.0
    return first, last


def _spacing(points: FloatArray, axis: int, width: float) -> float:
    """Median distance of grid lines along an axis; that of evenly strewn points when they form no lines."""
    lines = np.unique(np.round(points[:, axis] / (1e-6 * width)))
    if len(lines) == 1:
        return width
    if len(lines) <= len(points) / 2.0:
        return float(np.median(np.diff(lines))) * 1e-6 * width
    spread = np.ptp(points, axis=0)
    return float(np.sqrt(max(spread.prod(), (1e-3 * width) ** 2) / len(points)))


def voronoi_areas(points: FloatArray, low: FloatArray, high: FloatArray) -> FloatArray:
    """Areas (n,) in m2 of the Voronoi cells of distinct points inside the rectangle from low to high, cut at its edges.

    No point lies on an edge. The points' images in the four edges cut the cells there; a cell is the fan of triangles
    over its ridges.
    """
    images = [points]
    for axis in (0, 1):
        for edge in (low[axis], high[axis]):
            image = points.copy()
            image[:, axis] = 2.0 * edge - points[:, axis]
            images.append(image)
    size = float((high - low).max())
    everything = (np.concatenate(images) - low) / size
    cells = Voronoi(everything)
    ends = np.array(cells.ridge_vertices)
    finite = (ends >= 0).all(axis=1)
    first, second = cells.vertices[ends[finite, 0]], cells.vertices[ends[finite, 1]]
    areas = np.zeros(len(everything))
    for owner in cells.ridge_points[finite].T:
        a, b = first - everything[owner], second - everything[owner]
        np.add.at(areas, owner, 0.5 * np.abs(a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]))
    return np.asarray(areas[: len(points)] * size**2)


def confinement_of(weights: Weights, values: ComplexArray, design: Design) -> FieldMeasures:
    """Share, confinement and modal assurance of a complex field (n,) by the definitions of `solvers.measures.confinement`."""
    field = values[weights.index]
    both = TouchField(
        np.tile(weights.points, (BOTH, 1)),
        np.tile(weights.area_m2, BOTH),
        np.concatenate([field.real, field.imag])[:, None],
    )
    confinement = measure(both, design, None)
    on = np.abs(weights.points[:, 1]) < design.width_m / 2.0
    shape = wanted_shape(design, weights.points[on])
    return FieldMeasures(
        _finite(confinement.zone_share[0]),
        _finite(confinement.confinement_db[0]),
        assurance(weights.area_m2[on], field[on], shape.astype(complex)),
    )


def _finite(value: float) -> float | None:
    return float(value) if np.isfinite(value) else None


def assurance(area_m2: FloatArray, first: ComplexArray, second: ComplexArray) -> float:
    """|<a, b>|^2 / (<a, a> <b, b>), <a, b> = sum of area conj(a) b; 0 where a field vanishes (allemang2003)."""
    own = float(area_m2 @ np.abs(first) ** 2) * float(area_m2 @ np.abs(second) ** 2)
    return float(abs((area_m2 * first.conj()) @ second) ** 2 / own) if own > 0.0 else 0.0


def sampled(points_m: FloatArray, values: ComplexArray, at_m: FloatArray) -> ComplexArray:
    """A field known at many points (q, 2), read at others (n, 2): linear between its points, the nearest one beyond them."""
    size = float(np.ptp(points_m, axis=0).max())
    _, once = np.unique(np.round(points_m / (1e-9 * size)).astype(np.int64), axis=0, return_index=True)
    points, values = points_m[once], values[once]
    values_at = np.asarray(LinearNDInterpolator(points, values)(at_m), dtype=complex)
    beyond = ~np.isfinite(values_at)
    if beyond.any():
        values_at[beyond] = values[cKDTree(points).query(at_m[beyond])[1]]
    return values_at
