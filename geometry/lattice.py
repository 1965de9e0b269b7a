"""Plane lattices: vectors, reciprocal vectors, Brillouin zone, labelled points, and the paths and grids through it."""

from __future__ import annotations

import re
from collections.abc import Collection, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import combinations, pairwise

import numpy as np

from geometry.elements import BoolArray, FloatArray

HALF, SLOPE = 0.5, 0.5 * np.sqrt(3.0)  # of a triangular lattice's pitch: shift and distance of its rows
MIRRORS = {
    "x": np.diag([-1.0, 1.0]),
    "y": np.diag([1.0, -1.0]),
    "d": np.array([[0.0, 1.0], [1.0, 0.0]]),  # exchanges x and y
    "h": np.array([[-HALF, SLOPE], [SLOPE, HALF]]),  # about the line at 60 degrees from x
}
SAME = 1e-9  # of a reciprocal vector, or of a turn: wavevectors nearer to each other are one
FURTHEST = 10  # multiples of each lattice vector among which one along x is looked for
NEAREST = 2  # multiples of each reciprocal vector whose bisectors may bound the zone
LABELS = re.compile("[A-Z][0-9]?")
KNOWN = ("G", "X", "X1", "M", "S", "Y", "Y1", "K", "K1", "M1")  # of every lattice


@dataclass(frozen=True)
class PathSegment:
    """A straight part of a path between two labelled points: their labels and their indices in the path."""

    start: str
    end: str
    first: int
    last: int


@dataclass(frozen=True)
class Path:
    """Wavevectors (n, 2) in rad/m with a label at each high-symmetry point, and the arc length along the path."""

    wavevectors: FloatArray
    labels: tuple[str | None, ...]

    @property
    def arc(self) -> FloatArray:
        """Distance along the path, rad/m, shape (n,)."""
        steps = np.linalg.norm(np.diff(self.wavevectors, axis=0), axis=1)
        return np.concatenate([[0.0], np.cumsum(steps)])

    @property
    def segments(self) -> list[PathSegment]:
        """The straight parts, in their order."""
        marks = [(index, label) for index, label in enumerate(self.labels) if label]
        return [PathSegment(start, end, first, last) for (first, start), (last, end) in pairwise(marks)]

    @property
    def corners(self) -> FloatArray:
        """Wavevectors of the labelled points after the first, (segments, 2), rad/m."""
        return self.wavevectors[[segment.last for segment in self.segments]]

    def finer(self, factor: int) -> Path:
        """Return the path with every interval cut into `factor`; every factor-th wavevector is one of this path, unchanged."""
        k = self.wavevectors
        share = np.arange(1, factor)[:, None] / factor
        vectors, labels = [k[:1]], list(self.labels[:1])
        for start, end, label in zip(k[:-1], k[1:], self.labels[1:], strict=True):
            vectors += [start + share * (end - start), end[None]]
            labels += [None] * (factor - 1) + [label]
        return Path(np.concatenate(vectors), tuple(labels))


def rows_along_x(a1: Sequence[float], a2: Sequence[float]) -> tuple[float, float, bool] | None:
    """Find the rows along x of the lattice of two vectors.

    Parameters
    ----------
    a1, a2 : sequence of float
        Vectors (x, y) in any unit.

    Returns
    -------
    tuple or None
        Pitch along a row, distance of rows, and whether they are shifted by half a pitch; None for parallel vectors, without
        a lattice vector along x, and for rows shifted otherwise.
    """
    vectors = np.array([a1, a2], dtype=float)
    (ax, ay), (bx, by) = vectors.tolist()
    size, area = float(np.linalg.norm(vectors, axis=1).max()), abs(ax * by - bx * ay)
    if area <= SAME * size**2:
        return None
    steps = range(-FURTHEST, FURTHEST + 1)
    points = np.array([(i, j) for i in steps for j in steps]) @ vectors
    level = np.abs(points[:, 1]) <= SAME * size
    ahead = points[level & (points[:, 0] > SAME * size), 0]
    if not len(ahead):
        return None
    pitch = float(ahead.min())
    distance = area / pitch
    next_row = points[np.abs(points[:, 1] - distance) <= SAME * size * FURTHEST, 0]
    shift = float(next_row[0] / pitch % 1.0) if len(next_row) else 0.25
    if min(shift, 1.0 - shift) <= SAME * FURTHEST * size / pitch:
        return pitch, distance, False
    return (pitch, distance, True) if abs(shift - HALF) <= SAME * FURTHEST * size / pitch else None


def labels_of(path: str) -> tuple[str, ...]:
    """Split a path such as GXSX1YG into the labels of its points.

    Parameters
    ----------
    path : str
        Labels of high-symmetry points, one after another.

    Returns
    -------
    tuple of str
        Labels such as G, X or X1.
    """
    return tuple(LABELS.findall(path))


@dataclass(frozen=True)
class Lattice:
    """The points n a1 + m a2 of the plane: rectangular, or with every other row shifted by half a pitch, such as triangular.

    Attributes
    ----------
    a1_m, a2_m : tuple of float
        Lattice vectors (x, y) in m, a1 along x.
    """

    a1_m: tuple[float, float]
    a2_m: tuple[float, float]

    @classmethod
    def of_rows(cls, pitch_x_m: float, pitch_y_m: float, staggered: bool = False) -> Lattice:
        """Return the lattice of rows in line, or of rows shifted by half a pitch against their neighbours."""
        return cls((pitch_x_m, 0.0), (pitch_x_m / 2.0 if staggered else 0.0, pitch_y_m))

    @property
    def is_centred(self) -> bool:
        """Whether neighbouring rows are shifted."""
        return self.a2_m[0] != 0.0

    @property
    def is_triangular(self) -> bool:
        """Whether every point has six nearest neighbours."""
        pitch = self.a1_m[0]
        return bool(np.allclose(self.a2_m, (HALF * pitch, SLOPE * pitch), rtol=SAME, atol=SAME * pitch))

    @property
    def name(self) -> str:
        """The kind of lattice in one word."""
        return "triangular" if self.is_triangular else "staggered" if self.is_centred else "rectangular"

    @property
    def vectors_m(self) -> FloatArray:
        """Lattice vectors as rows, (2, 2), m."""
        return np.array([self.a1_m, self.a2_m])

    @property
    def area_m2(self) -> float:
        """Area of the primitive cell, m2."""
        return self.a1_m[0] * self.a2_m[1] - self.a1_m[1] * self.a2_m[0]

    @property
    def cell_m(self) -> tuple[float, float]:
        """Sides of the rectangle between two columns and two rows, m: a cell of the lattice, its rows laid like bricks."""
        return self.a1_m[0], self.a2_m[1]

    @cached_property
    def reciprocal_per_m(self) -> FloatArray:
        """Reciprocal vectors as rows, (2, 2), rad/m: b_i . a_j = 2 pi where i = j, else 0."""
        (x1, y1), (x2, y2) = self.a1_m, self.a2_m
        return 2.0 * np.pi * np.array([[y2, -x2], [-y1, x1]]) / self.area_m2 + 0.0

    def phases(self, wavevector: FloatArray) -> FloatArray:
        """Phases k.a1 and k.a2 of wavevectors (..., 2) in rad/m, (..., 2)."""
        return np.asarray(np.asarray(wavevector) @ self.vectors_m.T)

    def translations(self, count: int) -> FloatArray:
        """Return `count` times `count` translations about the origin, (count^2, 2), m."""
        steps = np.stack(np.meshgrid(*2 * [np.arange(count) - (count - 1) / 2.0], indexing="ij"), axis=-1)
        return np.asarray(steps.reshape(-1, 2) @ self.vectors_m)

    # -- symmetry

    def is_same(self, one: FloatArray, two: FloatArray) -> bool:
        """Whether two wavevectors (2,) in rad/m differ by a reciprocal vector."""
        turns = self.phases(np.asarray(one) - np.asarray(two)) / (2.0 * np.pi)
        return bool((np.abs(turns - np.round(turns)) < SAME).all())

    def point_group(self, mirrors: Collection[str]) -> list[FloatArray]:
        """Return the rotations and mirrors (2, 2) that leave the frequencies w(k) of a cell alone.

        They are generated by those of the cell's own mirrors that the lattice has, too, and by w(-k) = w(k).
        """
        group, own = [np.eye(2), -np.eye(2)], [MIRRORS[name] for name in mirrors]
        own = [each for each in own if all(self.is_same(each @ b, np.zeros(2)) for b in self.reciprocal_per_m)]
        for known in group:  # grows as long as there are new products
            products = (each @ known for each in own)
            group += [new for new in products if all(np.abs(new - other).max() > SAME for other in group)]
        return group

    @cached_property
    def zone(self) -> FloatArray:
        """Corners of the first Brillouin zone in order, (n, 2), rad/m."""
        return _corners(*self._bisectors)

    def irreducible(self, mirrors: Collection[str]) -> FloatArray:
        """Return the corners of the zone's irreducible part for a cell with these mirrors, in order, (n, 2), rad/m."""
        return _corners(*self._irreducible(mirrors))

    @cached_property
    def _bisectors(self) -> tuple[FloatArray, FloatArray]:
        """Normals n (m, 2) and bounds c (m,) of the zone, n.k <= c."""
        steps = range(-NEAREST, NEAREST + 1)
        others = np.array([(i, j) for i in steps for j in steps if i or j]) @ self.reciprocal_per_m
        return others, (others**2).sum(axis=1) / 2.0

    def _irreducible(self, mirrors: Collection[str]) -> tuple[FloatArray, FloatArray]:
        """The zone's half-planes and those of the sector that the point group leaves, from the kx axis on.

        The diagonal mirror alone has the sector about the axis.
        """
        group = self.point_group(mirrors)
        sector = 2.0 * np.pi / len(group)
        start = -sector / 2.0 if {*mirrors} == {"d"} and len(group) == 4 else 0.0
        end, (normals, bounds) = start + sector, self._bisectors
        sides = np.array([[np.sin(start), -np.cos(start)], [-np.sin(end), np.cos(end)]])
        return np.vstack([normals, sides * np.abs(normals).max()]), np.append(bounds, [0.0, 0.0])

    # -- paths and grids

    @cached_property
    def high_symmetry(self) -> dict[str, FloatArray]:
        """High-symmetry wavevectors (2,) in rad/m by their labels, around a quarter of the zone from the kx to the ky axis.

        Labels are those of setyawan2010: of shifted rows X and Y lie where the axes leave the zone, S is the middle of its
        oblique side, and X1 (Y1 where rows are closer than half a pitch) its other corner, equivalent to X (Y). A triangular
        zone has its corners K and the middles of its sides M; K1 and M1 differ from them where a cell has two mirrors alone.
        """
        if not self.is_centred:
            x, y = np.diag(self.reciprocal_per_m) / 2.0
            return {"G": np.zeros(2), "X": np.array([x, 0.0]), "M": np.array([x, y]), "Y": np.array([0.0, y])}
        x, y = self.reciprocal_per_m[0, 0], self.reciprocal_per_m[1, 1] / 2.0
        far_x, far_y, middle = (x * x + y * y) / (2.0 * x), (x * x + y * y) / (2.0 * y), np.array([x / 2.0, y / 2.0])
        if self.is_triangular:
            around = {"M1": (0.0, y), "K1": (x - far_x, y), "M": (x / 2.0, y / 2.0), "K": (far_x, 0.0)}
            return {"G": np.zeros(2)} | {label: np.array(place) for label, place in around.items()}
        if np.isclose(x, y, rtol=SAME, atol=0.0):
            return {"G": np.zeros(2), "X": np.array([x, 0.0]), "S": middle, "Y": np.array([0.0, y])}
        if y < x:
            ends = {"X": (far_x, 0.0), "S": middle, "X1": (x - far_x, y), "Y": (0.0, y)}
        else:
            ends = {"X": (x, 0.0), "Y1": (x, y - far_y), "S": middle, "Y": (0.0, far_y)}
        return {"G": np.zeros(2)} | {label: np.array(place) for label, place in ends.items()}

    def border(self, mirrors: Collection[str]) -> str:
        """Return the path along the border of the zone's irreducible part; empty where no mirror of an axis leaves one."""
        if not {"x", "y"} & {*mirrors}:
            return ""
        inside = _lie_in(np.array([*self.high_symmetry.values()]), *self._irreducible(mirrors))
        return "".join(label for label, own in zip(self.high_symmetry, inside, strict=True) if own) + "G"

    @property
    def default_path(self) -> str:
        """The path along the border of the zone's irreducible part, by the lattice's own mirrors."""
        return self.border(MIRRORS)

    def path(self, labels: str, points: int) -> Path:
        """Return the path through labelled points, such as GXMG, with `points` intervals per segment, ends shared.

        Raises
        ------
        ValueError
            For a label that the lattice does not have, or fewer than two of them.
        """
        names = labels_of(labels)
        if "".join(names) != labels or {*names} - {*self.high_symmetry} or len(names) < 2:
            raise ValueError(f"path '{labels}': needs at least two of the corners {', '.join(self.high_symmetry)}")
        return Path(np.array([self.high_symmetry[name] for name in names]), names).finer(points)

    def grid(self, intervals: int, mirrors: Collection[str]) -> FloatArray:
        """Return wavevectors (n, 2) in rad/m on a grid over the zone's irreducible part for a cell with these mirrors.

        `intervals` lie along each half of a reciprocal vector, and borders belong to the grid.
        """
        steps = np.arange(-2 * intervals, 2 * intervals + 1) / intervals
        shares = np.stack(np.meshgrid(steps, steps, indexing="ij"), axis=-1).reshape(-1, 2)
        wavevectors = shares @ (self.reciprocal_per_m / 2.0)
        return np.asarray(wavevectors[_lie_in(wavevectors, *self._irreducible(mirrors))])


def _lie_in(places: FloatArray, normals: FloatArray, bounds: FloatArray) -> BoolArray:
    """Mask of the points (n, 2) in the polygon normals.k <= bounds or on its border, (n,)."""
    room = SAME * np.outer(np.linalg.norm(places, axis=1), np.linalg.norm(normals, axis=1))
    return np.asarray((places @ normals.T <= bounds + room).all(axis=1))


def _corners(normals: FloatArray, bounds: FloatArray) -> FloatArray:
    """Corners (n, 2), counterclockwise, of the polygon normals.k <= bounds."""
    size = np.abs(normals).max()
    found: list[FloatArray] = []
    for i, j in combinations(range(len(bounds)), 2):
        pair = normals[[i, j]]
        if abs(np.linalg.det(pair)) > SAME * size**2:
            corner = np.asarray(np.linalg.solve(pair, bounds[[i, j]]))
            is_new = all(np.linalg.norm(corner - other) > SAME * size for other in found)
            if is_new and _lie_in(corner[None], normals, bounds)[0]:
                found.append(corner)
    corners = np.array(found)
    away = corners - corners.mean(axis=0)
    return np.asarray(corners[np.argsort(np.arctan2(away[:, 1], away[:, 0]), kind="stable")])
