"""Fields compared: mode shapes followed from one plate to the next, and a vibrometer's map with computed modes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.polynomial import legendre

from geometry.elements import ComplexArray, FloatArray, IntArray
from geometry.layout import Design
from solvers.errors import SolverError
from solvers.measures.confinement import NEGLIGIBLE, TouchField, measure, target_shape

# -- modes followed ----------------------------------------------------------------------------------------------------
# Modes followed from one plate to the next: their shapes on the active face, compared and assigned one to one.
# u_z on the active face is kept as coefficients c of orthonormal Legendre products, so that plates of different
# meshes, rows and pitches compare: MAC_ij = |c_i . d_j|^2 / (|c_i|^2 |d_j|^2) (allemang2003). The assignment
# maximises the sum of MAC times the geometric mean of the shares inside the zone (Hungarian method, kuhn1955).

ALONG, ACROSS = 8, 6  # degrees of the polynomials: in addition to the nodal lines along the zone; across it
KEPT = 0.5  # least MAC of one and the same mode
RIVAL = 0.8  # of the score: a second mode this close shares the shape; an even mixture of two gives 0.9 to 1


@dataclass(frozen=True)
class Shapes:
    """Modes of one plate: frequency_hz (k,), share of u_z^2 inside the zone (k,), coefficients (k, c) on the active face."""

    frequency_hz: FloatArray
    share: FloatArray
    coefficients: FloatArray


@dataclass(frozen=True)
class Step:
    """Counterpart of a mode of the first plate: its row in the second (None when lost), their MAC, and the best rival's."""

    row: int | None
    mac: float
    rival: float

    @property
    def kept(self) -> bool:
        """Whether the identity holds: alike enough, and no other mode nearly as alike."""
        return self.row is not None and self.mac >= KEPT and self.rival < RIVAL * self.mac


def zone_coefficients(touch: TouchField, design: Design, symmetry: str | None) -> FloatArray:
    """Project modes on the active face: c_ij = int u_z P_i(2x/L) P_j(2y/W), P orthonormal there.

    Parameters
    ----------
    touch : TouchField
        Points, weights and modes.
    design : Design
        The plate with its zone.
    symmetry : str or None
        Symmetry class of a halved model; None for a whole plate.

    Returns
    -------
    ndarray, shape (k, c)
        Coefficients; 0 for polynomials of another symmetry.
    """
    active = touch.is_active(design)
    points, values = (
        touch.points[active] - np.array(design.centre_m),
        touch.values[active] * touch.weights[active, None],
    )
    along = _orthonormal(points[:, 0], design.length_m, design.nodal_lines + ALONG)
    across = _orthonormal(points[:, 1], design.width_m, ACROSS)
    for basis, sign in zip((along, across), symmetry or (), strict=False):
        basis[:, (1 if sign == "S" else 0) :: 2] = 0.0
    coefficients = np.einsum("qi,qj,qk->kij", along, across, values, optimize=True)
    return np.asarray(coefficients.reshape(values.shape[1], -1))


def _orthonormal(at: FloatArray, edge: float, degree: int) -> FloatArray:
    return np.asarray(legendre.legvander(2.0 * at / edge, degree) * np.sqrt((2.0 * np.arange(degree + 1) + 1.0) / edge))


def mac_matrix(first: FloatArray, second: FloatArray) -> FloatArray:
    """Compute the modal assurance criterion of every pair of modes from their coefficients.

    Parameters
    ----------
    first : ndarray, shape (k, c)
        Modes of one plate.
    second : ndarray, shape (l, c)
        Modes of another plate.

    Returns
    -------
    ndarray, shape (k, l)
        From 0 to 1.
    """
    own = np.outer((first**2).sum(axis=1), (second**2).sum(axis=1))
    return np.asarray((first @ second.T) ** 2 / np.maximum(own, 1e-300))


def step(first: Shapes, second: Shapes, row: int) -> Step:
    """Follow one mode of the first plate into the second by the assignment of largest total score.

    Parameters
    ----------
    first, second : Shapes
        Modes of both plates.
    row : int
        The mode of the first plate.

    Returns
    -------
    Step
        Its row in the second plate or None, their MAC, and that of the strongest rival.
    """
    from scipy.optimize import linear_sum_assignment  # a third of a second that readers of records need not wait for

    if not len(second.frequency_hz):
        return Step(None, 0.0, 0.0)
    mac = mac_matrix(first.coefficients, second.coefficients)
    score = mac * np.sqrt(np.outer(first.share, second.share))
    rows, columns = linear_sum_assignment(score, maximize=True)
    partner = dict(zip(rows.tolist(), columns.tolist(), strict=True)).get(row)
    if partner is None:
        return Step(None, 0.0, float(score[row].max()))
    others = np.delete(score[row], partner)
    own = score[row, partner]
    # a rival is as much the same mode when its score reaches the assigned one's
    rival = float(mac[row, partner] * others.max(initial=0.0) / own) if own > 0.0 else 1.0
    return Step(partner, float(mac[row, partner]), rival)


def follow(plates: Sequence[Shapes], row: int) -> list[Step]:
    """Follow a mode of the first plate through all others, each compared with the one before.

    Parameters
    ----------
    plates : sequence of Shapes
        Modes of every plate.
    row : int
        The mode of the first plate.

    Returns
    -------
    list of Step
        One per further plate; it ends where the mode is lost.
    """
    steps: list[Step] = []
    for before, after in pairwise(plates):
        steps.append(step(before, after, row))
        last_row = steps[-1].row
        if last_row is None or not steps[-1].kept:
            break
        row = last_row
    return steps


# -- measured maps -----------------------------------------------------------------------------------------------------
# A field measured at points of the touch face: area weights, confinement by the definition of computed modes,
# correlation.
# Each point stands for its Voronoi cell within the part of the touch face it lies on (okabe2000); a point on the
# border of the zone counts on both sides, as the end points of a trapezoidal rule do.

Rectangle = tuple[tuple[float, float], tuple[float, float]]  # (low x, low y), (high x, high y)
INWARD = 1e-7  # of a rectangle's shorter side: distance by which points on an edge are moved inside
REACH = 1.05  # spacings: points represent a face up to its edge if they are this near, as those of an even grid are
BOTH = 2  # parts of a complex number


@dataclass(frozen=True)
class Weights:
    """Point (index into the map), the place it counts at (m, 2) in m, and the area it stands for (m,) in m2.

    active, passive: shares of the two faces' areas that the points cover; passive is None without such a face.
    """

    index: IntArray
    points: FloatArray
    area_m2: FloatArray
    active: float
    passive: float | None


@dataclass(frozen=True)
class FieldMeasures:
    """zone_share, confinement_db (None without a passive face or where nothing of it was measured), mac (target shape)."""

    zone_share: float | None
    confinement_db: float | None
    mac: float


def weigh(points_m: FloatArray, design: Design) -> Weights:
    """Assign an area to every point of a map on the touch face.

    Parameters
    ----------
    points_m : ndarray, shape (n, 2)
        Measured points from the plate's centre.
    design : Design
        The plate with its zone.

    Returns
    -------
    Weights
        Points used, their areas in m^2, and the fractions of both faces that they cover.

    Raises
    ------
    SolverError
        If no point lies on the active face.
    """
    half_x, half_y = design.half_length_m, design.half_span_m
    (left, right), border = design.zone_ends_m, design.width_m / 2.0
    low, high = design.centre_m[1] - border, design.centre_m[1] + border
    active: list[Rectangle] = [((left, low), (right, high))]
    around: list[Rectangle] = [((-half_x, high), (half_x, half_y)), ((-half_x, -half_y), (half_x, low))]
    around += [((-half_x, low), (left, high)), ((right, low), (half_x, high))]
    passive = [box for box in around if min(np.subtract(box[1], box[0])) > NEGLIGIBLE * border]
    whole_m = np.array([2.0 * half_x, 2.0 * half_y])
    spacing = np.array([_spacing(points_m, axis, float(whole_m[axis])) for axis in (0, 1)])
    parts = [[_part(points_m, box, spacing) for box in boxes] for boxes in (active, passive)]
    if not len(parts[0][0][0]):
        raise SolverError(
            f"no point of the map lies on the active touch face, y from {1e3 * low:g} to {1e3 * high:g} mm"
        )
    index, places, area_m2 = (np.concatenate(each) for each in zip(*parts[0], *parts[1], strict=True))
    aside = _covered(parts[1], passive) if passive else None
    return Weights(index, places, area_m2, _covered(parts[0], active), aside)


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
    """The rectangle that the points represent: up to the edge if they are near, half a spacing beyond them elsewhere."""
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
    """Compute the areas of the Voronoi cells of distinct points inside a rectangle, cut at its edges.

    No point lies on an edge. The images of the points in the four edges cut the cells there; a cell is the fan of triangles
    over its ridges.

    Parameters
    ----------
    points : ndarray, shape (n, 2)
        In m.
    low, high : ndarray, shape (2,)
        Opposite corners of the rectangle, in m.

    Returns
    -------
    ndarray, shape (n,)
        In m^2.
    """
    images = [points]
    for axis in (0, 1):
        for edge in (low[axis], high[axis]):
            image = points.copy()
            image[:, axis] = 2.0 * edge - points[:, axis]
            images.append(image)
    size = float((high - low).max())
    everything = (np.concatenate(images) - low) / size
    from scipy.spatial import Voronoi  # slow to import

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
    """Measure zone share, confinement and modal assurance of a measured field, as `solvers.measures.confinement` defines them.

    Parameters
    ----------
    weights : Weights
        Points of the field and their areas.
    values : ndarray, shape (n,)
        Complex u_z in any one unit.
    design : Design
        The plate with its zone.

    Returns
    -------
    FieldMeasures
        Share, level in dB and MAC; None where undefined.
    """
    field = values[weights.index]
    both = TouchField(
        np.tile(weights.points, (BOTH, 1)),
        np.tile(weights.area_m2, BOTH),
        np.concatenate([field.real, field.imag])[:, None],
    )
    confinement = measure(both, design, None)
    on = design.in_zone(weights.points)
    shape = target_shape(design, weights.points[on])
    return FieldMeasures(
        _finite(confinement.zone_share[0]),
        _finite(confinement.confinement_db[0]),
        assurance(weights.area_m2[on], field[on], shape.astype(complex)),
    )


def _finite(value: float) -> float | None:
    return float(value) if np.isfinite(value) else None


def assurance(area_m2: FloatArray, first: ComplexArray, second: ComplexArray) -> float:
    """Compute |<a, b>|^2 / (<a, a> <b, b>) with <a, b> = sum of area conj(a) b.

    Parameters
    ----------
    area_m2 : ndarray, shape (n,)
        Areas of the points.
    first, second : ndarray, shape (n,)
        Complex fields.

    Returns
    -------
    float
        From 0 to 1 (dimensionless); 0 where a field vanishes.

    References
    ----------
    .. [1] allemang2003 (docs/references.bib)
    """
    own = float(area_m2 @ np.abs(first) ** 2) * float(area_m2 @ np.abs(second) ** 2)
    return float(abs((area_m2 * first.conj()) @ second) ** 2 / own) if own > 0.0 else 0.0


def sampled(points_m: FloatArray, values: ComplexArray, at_m: FloatArray) -> ComplexArray:
    """Interpolate a field linearly between its points, and take the nearest value beyond them.

    Parameters
    ----------
    points_m : ndarray, shape (q, 2)
        Points of the field.
    values : ndarray, shape (q,)
        Complex values there.
    at_m : ndarray, shape (n, 2)
        Points to interpolate at.

    Returns
    -------
    ndarray, shape (n,)
        Complex values.
    """
    size = float(np.ptp(points_m, axis=0).max())
    _, once = np.unique(np.round(points_m / (1e-9 * size)).astype(np.int64), axis=0, return_index=True)
    points, values = points_m[once], values[once]
    from scipy.interpolate import LinearNDInterpolator  # slow to import
    from scipy.spatial import cKDTree

    values_at = np.asarray(LinearNDInterpolator(points, values)(at_m), dtype=complex)
    beyond = ~np.isfinite(values_at)
    if beyond.any():
        values_at[beyond] = values[cKDTree(points).query(at_m[beyond])[1]]
    return values_at
