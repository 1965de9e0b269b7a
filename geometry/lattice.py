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
SHORTEST = 2  # multiples of the shortest vectors among which the axes of a lattice are looked for
NEAREST = 2  # multiples of each reciprocal vector whose bisectors may bound the zone
LABELS = re.compile("[A-Z][0-9]?")
Vectors = tuple[tuple[float, float], tuple[float, float]]
KNOWN = ("G", "X", "X1", "M", "S", "Y", "Y1", "K", "K1", "M1", "H", "C", "H1")  # of every lattice


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


def _points(vectors: FloatArray, most: int) -> FloatArray:
    """Points of the lattice of vectors (2, 2) from -most to most multiples of each, the second one varying fastest."""
    steps = range(-most, most + 1)
    return np.asarray(np.array([(i, j) for i in steps for j in steps]) @ vectors)


def pitch_along_x(a1: Sequence[float], a2: Sequence[float]) -> float | None:
    """Find the distance of neighbouring points of a lattice along x.

    Parameters
    ----------
    a1, a2 : sequence of float
        Vectors (x, y) in any unit, not parallel.

    Returns
    -------
    float or None
        In that unit; None without a lattice vector along x among multiples of the vectors up to FURTHEST.
    """
    vectors = np.array([a1, a2], dtype=float)
    points = _points(vectors, FURTHEST)
    near = SAME * float(np.linalg.norm(vectors, axis=1).max())
    ahead = points[(np.abs(points[:, 1]) <= near) & (points[:, 0] > near), 0]
    return float(ahead.min()) if len(ahead) else None


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
    size = float(np.linalg.norm(np.array([a1, a2], dtype=float), axis=1).max())
    if abs(a1[0] * a2[1] - a2[0] * a1[1]) <= SAME * size**2:
        return None
    vectors = row_vectors(a1, a2)
    if vectors is None:
        return None
    (pitch, _), (shift, distance) = vectors
    return (pitch, distance, shift != 0.0) if shift in (0.0, HALF * pitch) else None


def row_vectors(a1: Sequence[float], a2: Sequence[float]) -> Vectors | None:
    """Find the vectors of a lattice along a row, and from there to the next one.

    Parameters
    ----------
    a1, a2 : sequence of float
        Vectors (x, y) in any unit, not parallel.

    Returns
    -------
    tuple or None
        (pitch, 0) and (shift, distance), the shift more than -pitch/2 and at most pitch/2; None without a lattice vector along
        x, or without a point of the next row among multiples of the vectors up to FURTHEST.
    """
    pitch = pitch_along_x(a1, a2)
    if pitch is None:
        return None
    vectors = np.array([a1, a2], dtype=float)
    points, distance = _points(vectors, FURTHEST), abs(a1[0] * a2[1] - a2[0] * a1[1]) / pitch
    near = SAME * FURTHEST * float(np.linalg.norm(vectors, axis=1).max())
    next_row = points[np.abs(points[:, 1] - distance) <= near, 0]
    if not len(next_row):
        return None
    shift = float(next_row[0] - pitch * np.ceil(next_row[0] / pitch - HALF - near / pitch))
    exact = next((each for each in (0.0, HALF * pitch) if abs(shift - each) <= near), shift)
    return (pitch, 0.0), (exact, distance)


def place_in_cell(vectors: Vectors, at: Sequence[float], radius: float) -> tuple[float, float] | None:
    """Find the image of a disc in the cell of two vectors about the origin.

    Parameters
    ----------
    vectors : tuple of tuple
        Vectors (x, y) along the sides of the cell, in any unit.
    at : sequence of float
        Middle (x, y) of the disc in that unit.
    radius : float
        Its radius in that unit.

    Returns
    -------
    tuple or None
        Middle of the image; None where it crosses a side.
    """
    edges = np.array(vectors)
    shares = np.asarray(at) @ np.linalg.inv(edges)
    place = (shares - np.floor(shares + HALF)) @ edges
    if room_in_cell(vectors, place) < radius * (1.0 - SAME):
        return None
    x, y = place.tolist()
    return x, y


def room_in_cell(vectors: Vectors, points: FloatArray) -> float:
    """Compute the least distance of points from the sides of the cell of two vectors about the origin.

    Parameters
    ----------
    vectors : tuple of tuple
        Vectors (x, y) along the sides of the cell, in any unit.
    points : ndarray, shape (..., 2)
        Points (x, y) in that unit.

    Returns
    -------
    float
        In that unit; negative for points beyond a side.
    """
    edges = np.array(vectors)
    shares = np.abs(points @ np.linalg.inv(edges))
    return float(((HALF - shares) * abs(np.linalg.det(edges)) / np.linalg.norm(edges[::-1], axis=1)).min())


def shortest_vectors(a1: Sequence[float], a2: Sequence[float]) -> Vectors:
    """Find the two shortest vectors of a lattice.

    Parameters
    ----------
    a1, a2 : sequence of float
        Vectors (x, y) in any unit, not parallel.

    Returns
    -------
    tuple of tuple
        One towards +x, and the other one 60 to 90 degrees to its left.
    """
    one, two = np.array([a1, a2], dtype=float)
    while abs(steps := float(np.rint(two @ one / (one @ one)))) > 0.0 and abs(two @ one) > (HALF + SAME) * (one @ one):
        one, two = two - steps * one, one
    if two @ two < one @ one:
        one, two = two, one
    if abs(two @ one) > (HALF + SAME) * (one @ one):
        return shortest_vectors(one.tolist(), two.tolist())
    if two @ one < 0.0:
        two = -two
    if one[0] * two[1] < one[1] * two[0]:
        one, two = two, one
    if one[0] < -SAME * float(np.abs(one).max()) or (one[0] <= SAME * float(np.abs(one).max()) and one[1] < 0.0):
        one, two = -one, -two
    (x1, y1), (x2, y2) = one.tolist(), two.tolist()
    return (x1, y1), (x2, y2)


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
    """The points n a1 + m a2 of the plane: rectangular, of rows shifted by half a pitch, such as triangular, or oblique.

    Attributes
    ----------
    a1_m, a2_m : tuple of float
        Lattice vectors (x, y) in m, a2 to the left of a1: a1 along x, or the two shortest ones.
    """

    a1_m: tuple[float, float]
    a2_m: tuple[float, float]

    @classmethod
    def of_rows(cls, pitch_x_m: float, pitch_y_m: float, staggered: bool = False) -> Lattice:
        """Return the lattice of rows in line, or of rows shifted by half a pitch against their neighbours."""
        return cls((pitch_x_m, 0.0), (pitch_x_m / 2.0 if staggered else 0.0, pitch_y_m))

    @property
    def is_centred(self) -> bool:
        """Whether neighbouring rows along x are shifted by half a pitch."""
        return self._lies_along_x and self.a2_m[0] != 0.0

    @property
    def _lies_along_x(self) -> bool:
        """Whether it is one of rows along x, in line or shifted by half a pitch."""
        (length, rise), (shift, _) = self.a1_m, self.a2_m
        return rise == 0.0 and (shift == 0.0 or abs(shift - HALF * length) <= SAME * length)

    @cached_property
    def axes(self) -> tuple[Lattice, FloatArray] | None:
        """The same lattice with its axes along x and y, and the turn (2, 2) from there; None for one without mirrors."""
        if self._lies_along_x:
            return self, np.eye(2)
        ahead = _points(self.vectors_m, SHORTEST)
        ahead = ahead[np.abs(ahead).max(axis=1) > 0.0]
        best: tuple[tuple[bool, bool, float], Lattice, FloatArray] | None = None
        for x, y in ahead / np.linalg.norm(ahead, axis=1)[:, None]:
            turn = np.array([[x, -y], [y, x]])
            rows = rows_along_x(*(self.vectors_m @ turn))
            if rows is None:
                continue
            own = Lattice.of_rows(*rows)
            rank = rows[2], not own.is_triangular, 1.0 - float(x)
            if best is None or rank < best[0]:
                best = rank, own, turn
        return best[1:] if best else None

    @property
    def is_triangular(self) -> bool:
        """Whether every point has six nearest neighbours; without pitches none has."""
        length, other = np.linalg.norm(self.vectors_m, axis=1)
        if not np.isfinite(length):
            return False
        across = abs(self.vectors_m[0] @ self.vectors_m[1])
        return bool(np.allclose([other, across / length], [length, HALF * length], rtol=SAME, atol=SAME * length))

    @property
    def name(self) -> str:
        """The kind of lattice in one word."""
        if self.axes is None:
            return "oblique"
        return "triangular" if self.is_triangular else "staggered" if self.axes[0].is_centred else "rectangular"

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
        """Sides of the rectangle between two columns and two rows, m: a cell of the lattice, its rows laid like bricks.

        Of rows that do not lie along x, the lengths of the two vectors.
        """
        if self._lies_along_x:
            return self.a1_m[0], self.a2_m[1]
        length, other = np.linalg.norm(self.vectors_m, axis=1).tolist()
        return length, other

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

        They are those of the cell's own mirrors, and of their products, that the lattice has, too, and w(-k) = w(k). A cell
        with d and h is round: it has all mirrors.
        """
        if {"d", "h"} <= {*mirrors} and not self._lies_along_x:
            return self._isometries
        group, own = [np.eye(2), -np.eye(2)], [MIRRORS[name] for name in mirrors]
        if self._lies_along_x:
            own = [each for each in own if self._keeps(each)]
        for known in group:  # grows as long as there are new products
            products = (each @ known for each in own)
            group += [new for new in products if all(np.abs(new - other).max() > SAME for other in group)]
        return [each for each in group if self._keeps(each)]

    def _keeps(self, turn: FloatArray) -> bool:
        """Whether a rotation or mirror (2, 2) takes the lattice to itself."""
        return all(self.is_same(turn @ b, np.zeros(2)) for b in self.reciprocal_per_m)

    @property
    def _isometries(self) -> list[FloatArray]:
        """All rotations and mirrors (2, 2) of the lattice: those of the lattice with its axes along x and y."""
        if self.axes is None:
            return [np.eye(2), -np.eye(2)]
        own, turn = self.axes
        mirrors = ("x", "y", *(name for name in ("d", "h") if own._keeps(MIRRORS[name])))
        return [turn @ each @ turn.T for each in own.point_group(mirrors)]

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
        """The zone's half-planes and those of the sector that the point group leaves: from a mirror's axis to the next one, or
        from the kx axis on where there is no mirror.
        """
        group = self.point_group(mirrors)
        sector = 2.0 * np.pi / len(group)
        lines = [np.arctan2(each[1, 0], each[0, 0]) / 2.0 for each in group if np.linalg.det(each) < 0.0]
        nearest = min((line - sector * np.ceil(line / sector - SAME) for line in lines), key=abs, default=0.0)
        start = float(nearest) if abs(nearest) > SAME else 0.0
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
        A lattice whose axes lie along other directions has them turned. An oblique one has the middles X, C and Y of the
        sides of its zone and the corners H1 and H between them.
        """
        if not self._lies_along_x:
            return self._turned_points
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

    @property
    def _turned_points(self) -> dict[str, FloatArray]:
        """High-symmetry wavevectors of a lattice that is not one of rows along x."""
        if self.axes is not None:
            own, turn = self.axes
            return {label: turn @ place for label, place in own.high_symmetry.items()}
        one, two = shortest_vectors(*self.reciprocal_per_m)
        x, y = (
            np.array(one),
            np.array(two) - np.array(one),
        )  # from the middle of a side of the hexagon to that after the next
        middle = x + y
        corners = (
            np.linalg.solve(2.0 * np.array(pair), [each @ each for each in pair]) for pair in ((x, middle), (middle, y))
        )
        after, before = corners
        places = {"X": x / 2.0, "H1": after, "C": middle / 2.0, "H": before, "Y": y / 2.0}
        return {"G": np.zeros(2)} | {label: np.asarray(place + 0.0) for label, place in places.items()}  # no -0.0

    def border(self, mirrors: Collection[str]) -> str:
        """Return the path along the border of the zone's irreducible part; empty where no mirror of an axis leaves one."""
        if not self._lies_along_x:
            return self._turned_border(mirrors)
        if not {"x", "y"} & {*mirrors}:
            return ""
        inside = _lie_in(np.array([*self.high_symmetry.values()]), *self._irreducible(mirrors))
        return "".join(label for label, own in zip(self.high_symmetry, inside, strict=True) if own) + "G"

    def _turned_border(self, mirrors: Collection[str]) -> str:
        """The border of a lattice that is not one of rows along x; empty where the cell lacks the mirrors of its axes."""
        if self.axes is None:
            return ""
        own, turn = self.axes
        group = self.point_group(mirrors)
        kept = [name for name, each in MIRRORS.items() if _is_among(turn @ each @ turn.T, group)]
        return own.border(kept)

    @property
    def default_path(self) -> str:
        """The path along the border of the zone's irreducible part, by the lattice's own mirrors.

        Of an oblique lattice, once around the half of its zone from one side to the next but one.
        """
        if self.axes is None:
            return "GXH1CHYG"
        return self.axes[0].border(MIRRORS)

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


def _is_among(matrix: FloatArray, group: Collection[FloatArray]) -> bool:
    return any(np.abs(matrix - each).max() <= SAME for each in group)


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
