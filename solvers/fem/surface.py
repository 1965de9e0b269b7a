"""Integrals over a named face, and Gauss rules over rectangles and facets that lines y = const part."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import pairwise, product

import numpy as np
import scipy.sparse as sp
from numpy.polynomial import chebyshev, legendre, polynomial

from geometry.elements import (
    TRIANGLES,
    BoolArray,
    Element,
    FloatArray,
    IntArray,
    corner_ring,
    element,
    gauss_lobatto,
    lagrange,
)
from geometry.mesh import AnyMesh, Mesh
from solvers.errors import SolverError

COUNT = 6  # points each way: of a rectangle where u_z has degree 5, and its square 10
EDGE = 1e-9  # of half a rectangle's depth: a line so near to its edge runs along it
STEEP = 0.03  # least slope along the height over the greatest slope: below it the facet is quartered
DEEPEST = 8  # quarterings: the rest is then 4^-8 of a facet, whose points are sorted as they lie
NEAR = 1e-9  # of the facet's extent across the lines: a line so near to a straight edge runs along it
BULGE = 0.02  # of the same: how far a curved facet may reach beyond the places where it is sampled
STRAIGHT = 1e-12  # relative deviation from an affine map
DROPPED = 1e-14  # of the facet's area: slivers that rounding makes
STEPS = 60  # of Newton's method, bracketed
REAL = 1e-7  # imaginary part up to which a root counts as real
Shape = Callable[[FloatArray], tuple[FloatArray, FloatArray]]  # points (q, 2): values (q, k), slopes (2, q, k)

# Dunavant's rule of degree 4 on the unit triangle, from its two orbits (dunavant1985)
_TRIANGLE = ((0.44594849091596489, 0.22338158967801147), (0.09157621350977073, 0.10995174365532187))

SAME_M = 1e-9  # places that are one

BENT = 1e-3  # of an edge's length: deviation of its nodes from the chord


@dataclass(frozen=True)
class Piece:
    """A square (0 <= s, t <= 1) or a triangle (s + t <= 1) in a facet's reference coordinates: origin + s first + t second."""

    origin: FloatArray
    first: FloatArray
    second: FloatArray
    is_triangle: bool

    @property
    def area(self) -> float:
        """Reference area of one unit of s and t."""
        return float(abs(self.first[0] * self.second[1] - self.first[1] * self.second[0]))

    @property
    def turned(self) -> Piece:
        """Return the piece with s and t exchanged."""
        return replace(self, first=self.second, second=self.first)

    def at(self, s: FloatArray, t: FloatArray) -> FloatArray:
        """Reference coordinates (q, 2)."""
        return np.asarray(self.origin + s[:, None] * self.first + t[:, None] * self.second)

    def top(self, s: FloatArray) -> FloatArray:
        """Greatest t at each s."""
        return 1.0 - s if self.is_triangle else np.ones_like(s)

    def quarters(self) -> Iterator[Piece]:
        """The piece cut into four alike."""
        a, b = self.first / 2.0, self.second / 2.0
        yield from (replace(self, origin=self.origin + o, first=a, second=b) for o in (np.zeros(2), a, b))
        if self.is_triangle:
            yield replace(self, origin=self.origin + a + b, first=-a, second=-b)
        else:
            yield replace(self, origin=self.origin + a + b, first=a, second=b)


SQUARE = Piece(np.array([-1.0, -1.0]), np.array([2.0, 0.0]), np.array([0.0, 2.0]), False)


TRIANGLE = Piece(np.zeros(2), np.array([1.0, 0.0]), np.array([0.0, 1.0]), True)


@dataclass(frozen=True)
class CutFacet:
    """One facet: its shape functions and order, the y of its nodes (k,) in m, and the lines (n,) that may cut it."""

    shape: Shape
    order: int
    y_m: FloatArray
    lines_m: FloatArray
    is_straight: bool

    def rule(self, whole: Piece) -> tuple[FloatArray, FloatArray]:
        """Points (q, 2) and weights (q,) in reference coordinates over a piece, each point on one side of every line."""
        parts = list(self._rules(whole, 0))
        points, weights = (np.concatenate(each) for each in zip(*parts, strict=True))
        kept = weights > DROPPED * whole.area
        return points[kept], weights[kept]

    def y(self, piece: Piece, s: FloatArray, t: FloatArray) -> FloatArray:
        """Places across the lines, (q,)."""
        return np.asarray(self.shape(piece.at(s, t))[0] @ self.y_m)

    def slopes(self, piece: Piece, s: FloatArray, t: FloatArray) -> tuple[FloatArray, FloatArray]:
        """dy/ds and dy/dt, (q,) each."""
        u, v = (slope @ self.y_m for slope in self.shape(piece.at(s, t))[1])
        return u * piece.first[0] + v * piece.first[1], u * piece.second[0] + v * piece.second[1]

    def _rules(self, piece: Piece, depth: int) -> Iterator[tuple[FloatArray, FloatArray]]:
        lines = self.within(piece)
        upright = self._upright(piece) if len(lines) and depth < DEEPEST else piece
        if upright is None:
            for quarter in piece.quarters():
                yield from self._rules(quarter, depth + 1)
            return
        yield self._between(upright, lines if depth < DEEPEST else lines[:0])

    def _samples(self, piece: Piece) -> tuple[FloatArray, FloatArray]:
        """A grid over the piece, its edges included."""
        line = (1.0 - np.cos(np.linspace(0.0, np.pi, 2 * self.order + 1))) / 2.0
        s, t = (part.ravel() for part in np.meshgrid(line, line, indexing="ij"))
        return s, t * piece.top(s)

    def within(self, piece: Piece) -> FloatArray:
        """The lines that may cross the piece."""
        y = self.y(piece, *self._samples(piece))[None]
        flat = np.array([self.is_straight])
        return self.lines_m[[bool(_may_be_cut(y, flat, [line])[0]) for line in self.lines_m]]

    def _upright(self, piece: Piece) -> Piece | None:
        """The piece, turned where that is better, with y monotone along t; None where it is monotone along neither."""
        along = self.slopes(piece, *self._samples(piece))
        most = max(float(np.abs(slope).max()) for slope in along)
        least = [float(max(slope.min(), -slope.max(), 0.0)) for slope in along]
        if max(least) < STEEP * most:
            return None
        return piece if least[1] >= least[0] else piece.turned

    def _between(self, piece: Piece, lines: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Gauss rules between the lines, over the intervals of s between the places where one meets an edge."""
        (at, weight), (height, share) = gauss(2 * self.order + 1), gauss(self.order + 1)
        ends = self._breaks(piece, lines)
        s = np.concatenate([low + (high - low) * at for low, high in pairwise(ends)])
        ds = np.concatenate([(high - low) * weight for low, high in pairwise(ends)])
        bounds = np.sort(np.vstack([np.zeros_like(s), self._heights(piece, s, lines), piece.top(s)]), axis=0)
        low, thick = bounds[:-1, :, None], np.diff(bounds, axis=0)[:, :, None]
        t, weights = low + thick * height, ds[:, None] * thick * share
        return piece.at(np.broadcast_to(s[:, None], t.shape).ravel(), t.ravel()), piece.area * weights.ravel()

    def _breaks(self, piece: Piece, lines: FloatArray) -> FloatArray:
        """0, 1 and the s between at which a line meets the lower or the upper edge."""
        degree = 2 * self.order
        nodes = (1.0 - np.cos((np.arange(degree + 1) + 0.5) * np.pi / (degree + 1))) / 2.0
        found = [np.array([0.0, 1.0])]
        for t in (np.zeros_like(nodes), piece.top(nodes)):
            y = self.y(piece, nodes, t)
            fitted = np.asarray(chebyshev.chebfit(2.0 * nodes - 1.0, y, degree), dtype=np.float64)
            found += [_roots(fitted, float(line)) for line in lines]
        return np.unique(np.concatenate(found))

    def _heights(self, piece: Piece, s: FloatArray, lines: FloatArray) -> FloatArray:
        """t of each line at each s, kept within the piece, (lines, q): roots of y(s, .), a polynomial of the facet's order."""
        top, at = piece.top(s), np.linspace(0.0, 1.0, self.order + 1)
        grid = np.repeat(s, len(at)), np.outer(top, at).ravel()
        y = self.y(piece, *grid).reshape(len(s), -1)
        fitted = np.linalg.solve(np.vander(at, increasing=True), y.T)
        heights = [top * _root(fitted - np.eye(len(at))[:, :1] * line) for line in lines]
        return np.array(heights).reshape(len(lines), len(s))


@dataclass(frozen=True)
class FaceQuadrature:
    """Points (q, 3) in m, weights (q,) in m2, and the sparse interpolation (q, n) from nodes to points."""

    points: FloatArray
    weights: FloatArray
    interpolation: sp.csr_array


@dataclass(frozen=True)
class Frame:
    """A frame that a face is measured in: origin (3,) in m, and right-handed axes as rows (3, 3), z into the body."""

    origin_m: FloatArray
    axes: FloatArray

    def places(self, points: FloatArray) -> FloatArray:
        """Points (n, 3), m, in the frame."""
        return np.asarray((points - self.origin_m) @ self.axes.T)


@dataclass(frozen=True)
class Skin:
    """An outer surface that moves: points (p, 3) in m, facets (m, corners), displacements (k, p, 3)."""

    points: FloatArray
    facets: IntArray
    displacement: FloatArray

    def unfolded(self, symmetry: str | None) -> Skin:
        """The whole body from its quarter x, y >= 0 of a symmetry class (SS to AA, of u_z), or itself."""
        skin = self
        for axis, mark in enumerate(symmetry or ""):
            flip = np.ones(3)
            flip[axis] = -1.0
            image = flip * skin.displacement * (1.0 if mark == "S" else -1.0)
            facets = np.concatenate([skin.facets, skin.facets[:, ::-1] + len(skin.points)])
            points = np.concatenate([skin.points, skin.points * flip])
            skin = Skin(points, facets, np.concatenate([skin.displacement, image], axis=1))
        return skin


def gauss_points() -> tuple[FloatArray, FloatArray]:
    """Return the Gauss rule on [-1, 1]^2, y fastest.

    Returns
    -------
    points : ndarray, shape (COUNT^2, 2)
        Places.
    weights : ndarray, shape (COUNT^2,)
        They add up to 4.
    """
    s, w = legendre.leggauss(COUNT)
    return np.stack(np.meshgrid(s, s, indexing="ij"), axis=-1).reshape(-1, 2), np.outer(w, w).ravel()


def parted(
    points: FloatArray, weights: FloatArray, lines_m: Sequence[float], cuts_m: Sequence[float] = ()
) -> tuple[FloatArray, FloatArray, sp.csr_array | None]:
    """Cut the rules of rectangles at lines y = const and x = const, so that none reaches over a line.

    Parameters
    ----------
    points : ndarray, shape (p, 3)
        `gauss_points` of rectangles one after another, mirrored in any way, in m.
    weights : ndarray, shape (p,)
        Their weights, in m^2.
    lines_m : sequence of float
        y of the lines along x.
    cuts_m : sequence of float, optional
        x of the lines along y.

    Returns
    -------
    points : ndarray, shape (q, 3)
        In m.
    weights : ndarray, shape (q,)
        In m^2.
    interpolation : sparse array, shape (q, p), or None
        From the points given; None where they are the same.
    """
    if not any(_may_cross(points[:, axis], at) for axis, at in ((0, cuts_m), (1, lines_m))):
        return points, weights, None
    rows: list[tuple[FloatArray, FloatArray, FloatArray]] = []
    for first in range(0, len(points), COUNT**2):
        own = slice(first, first + COUNT**2)
        rows.append(_cut_rectangle(points[own], weights[own], lines_m, cuts_m))
    moved, area, along = zip(*rows, strict=True)
    return np.concatenate(moved), np.concatenate(area), sp.csr_array(sp.block_diag(along))


def _may_cross(places: FloatArray, lines_m: Sequence[float]) -> bool:
    """Whether a line may cross a rectangle, which reaches beyond its outermost points by less than their distance."""
    low, high = places.min(), places.max()
    return any(2.0 * low - high < line < 2.0 * high - low for line in lines_m)


def _is_straight(corners: FloatArray, reference: FloatArray) -> BoolArray:
    """Mask of the facets, nodes (f, k, 3) at reference places (k, 2), that are affine images of the reference facet, (f,)."""
    basis = np.column_stack([np.ones(len(reference)), reference])
    off = np.eye(len(reference)) - basis @ np.linalg.pinv(basis)
    deviation = np.abs(np.einsum("ak,fkj->faj", off, corners)).max(axis=(1, 2))
    return np.asarray(deviation <= STRAIGHT * np.ptp(corners, axis=1).max(axis=1))


def _may_be_cut(y_m: FloatArray, straight: BoolArray, lines_m: Sequence[float]) -> BoolArray:
    """Mask of the facets that a line may cross, (f,), from y of their nodes (f, k) and whether they are straight, (f,)."""
    low, high = y_m.min(axis=1), y_m.max(axis=1)
    margin = np.where(straight, NEAR, -BULGE) * (high - low)
    crossed = np.zeros(len(y_m), dtype=bool)
    for line in lines_m:
        crossed |= (line > low + margin) & (line < high - margin)
    return crossed


def gauss(count: int, low: float = 0.0, high: float = 1.0) -> tuple[FloatArray, FloatArray]:
    """Return the Gauss rule between two ends.

    Parameters
    ----------
    count : int
        Number of points.
    low, high : float, optional
        The ends, in any unit.

    Returns
    -------
    points, weights : ndarray, shape (count,)
        In that unit.
    """
    at, weight = legendre.leggauss(count)
    half = (high - low) / 2.0
    return low + half * (at + 1.0), half * weight


def face_quadrature(
    mesh: AnyMesh, face: str, lines_m: Sequence[float] = (), cuts_m: Sequence[float] = ()
) -> FaceQuadrature:
    """Build the quadrature over a named face, exact for squared displacements on flat faces.

    No facet's rule reaches over one of the lines, so that sums over the points on one side are integrals.

    Parameters
    ----------
    mesh : Mesh
        Nodes in m.
    face : str
        Name of the face.
    lines_m : sequence of float, optional
        y of the lines along x.
    cuts_m : sequence of float, optional
        x of the lines along y.

    Returns
    -------
    FaceQuadrature
        Points in m, weights in m^2 and the interpolation from the nodes.

    Raises
    ------
    MeshError
        For a face that the mesh does not have.
    """
    each = mesh.facets_of(face)
    return _joined([facet_quadrature(mesh.nodes, facets, mesh.order, lines_m, cuts_m) for facets in each])


def _joined(parts: list[FaceQuadrature]) -> FaceQuadrature:
    """The rules over several sets of facets on the same nodes, one after another."""
    if len(parts) == 1:
        return parts[0]
    points, weights = (np.concatenate([getattr(part, name) for part in parts]) for name in ("points", "weights"))
    return FaceQuadrature(points, weights, sp.csr_array(sp.vstack([part.interpolation for part in parts])))


def facet_quadrature(
    nodes: FloatArray, faces: IntArray, order: int, lines_m: Sequence[float] = (), cuts_m: Sequence[float] = ()
) -> FaceQuadrature:
    """Build the quadrature over facets of one shape, as `face_quadrature`.

    Parameters
    ----------
    nodes : ndarray, shape (n, 3)
        In m.
    faces : ndarray of int, shape (f, k)
        Nodes of the facets.
    order : int
        Order of the elements.
    lines_m : sequence of float, optional
        y of the lines along x.
    cuts_m : sequence of float, optional
        x of the lines along y.

    Returns
    -------
    FaceQuadrature
        Points in m, weights in m^2 and the interpolation from the nodes.
    """
    if not len(lines_m) and not len(cuts_m):
        return _uncut(nodes, faces, order)
    solid, own = _solid(faces.shape[1], order)
    straight = _is_straight(nodes[faces], solid.points[own, :2])
    cut = np.zeros(len(faces), dtype=bool)
    for axis, lines in ((0, cuts_m), (1, lines_m)):
        cut |= _may_be_cut(nodes[faces][:, :, axis], straight, lines)
    rules = _cut_rules(nodes, faces[cut], order, (cuts_m, lines_m), straight[cut]) if cut.any() else []
    return _joined([_uncut(nodes, faces[~cut], order), *rules])


def boundary_facets(mesh: AnyMesh) -> list[tuple[IntArray, IntArray]]:
    """List the facets that belong to one element only.

    Parameters
    ----------
    mesh : AnyMesh
        The mesh.

    Returns
    -------
    list of tuple
        For each shape of facets, their corners in a ring (n, 3) or (n, 4), and all their nodes.
    """
    kinds: dict[int, list[tuple[IntArray, IntArray]]] = {}
    for block in mesh.blocks:
        for local in block.element.facets:
            ring = corner_ring(local, block.order)
            rows = (block.cells[:, each].reshape(-1, each.shape[1]) for each in (ring, local))
            kinds.setdefault(ring.shape[1], []).append(tuple(rows))  # type: ignore[arg-type]
    outer = []
    for parts in kinds.values():
        corners, full = (np.vstack(each) for each in zip(*parts, strict=True))
        alone = _once(corners)
        outer.append((corners[alone], full[alone]))
    return outer


def facet_places(
    nodes: FloatArray, facets: IntArray, order: int, at_m: FloatArray
) -> tuple[IntArray, IntArray, FloatArray]:
    """Find points on plane facets of one shape, and the weights of their nodes.

    Parameters
    ----------
    nodes : ndarray, shape (n, 2)
        In m.
    facets : ndarray of int, shape (f, k)
        Nodes of the facets.
    order : int
        Order of the elements.
    at_m : ndarray, shape (q, 2)
        Points.

    Returns
    -------
    found : ndarray of int, shape (p,)
        Points that lie on a facet, each once.
    own : ndarray of int, shape (p, k)
        Nodes of that facet.
    values : ndarray, shape (p, k)
        Their weights.
    """
    none = np.empty((0, facets.shape[1]))
    solid, found, own, values = None, [], [none.astype(np.int64)], [none]
    corners = nodes[facets]
    low, high = corners.min(axis=1, initial=np.inf), corners.max(axis=1, initial=-np.inf)
    for number, point in enumerate(at_m):
        for facet in np.flatnonzero(((low <= point + CLOSE_M) & (high >= point - CLOSE_M)).all(axis=1)):
            solid = solid or _solid(facets.shape[1], order)
            weights = _within(solid, nodes[facets[facet]], point)
            if weights is not None:
                found.append(number)
                own.append(facets[[facet]])
                values.append(weights[None])
                break
    return np.array(found, dtype=np.int64), np.concatenate(own), np.concatenate(values)


CLOSE_M, CORRECTIONS, INSIDE = 1e-12, 12, 1e-6  # of a facet's box; of Newton; of the reference facet


def _within(solid: tuple[Element, IntArray], corners: FloatArray, point: FloatArray) -> FloatArray | None:
    """Values (k,) of a facet's functions at a point of its plane; None outside it."""
    is_triangle = solid[0].points[solid[1], :2].min() >= 0.0
    at = np.full(2, 1.0 / 3.0 if is_triangle else 0.0)
    for _ in range(CORRECTIONS):
        value, slope = _shape(solid, at[None])
        at = at + np.linalg.solve((slope[:, 0] @ corners).T, point - value[0] @ corners)
    value = _shape(solid, at[None])[0][0]
    ends = (at.min(), 1.0 - at.sum()) if is_triangle else (1.0 - np.abs(at).max(), 1.0)
    hits = np.abs(value @ corners - point).max() <= INSIDE * np.ptp(corners, axis=0).max()
    return value if min(ends) >= -INSIDE and hits else None


def triangles(facets: IntArray) -> IntArray:
    """Split facets into triangles.

    Parameters
    ----------
    facets : ndarray of int, shape (m, 3) or (m, 4)
        Corners.

    Returns
    -------
    ndarray of int, shape (m, 3) or (2 m, 3)
        Triangles as they are, quadrangles cut in two.
    """
    return np.concatenate([facets[:, [0, 1, 2]], facets[:, [0, 2, 3]]]) if facets.shape[1] == 4 else facets


def skin_faces(mesh: AnyMesh) -> IntArray:
    """List the corners of every outer facet; those of hexahedra are cut at every node of their curved edges.

    Parameters
    ----------
    mesh : Mesh
        The mesh.

    Returns
    -------
    ndarray of int, shape (m, 4) or (m, 3)
        Of hexahedra in ring order, of tetrahedra; where both occur, triangles repeat their last corner.
    """
    if isinstance(mesh, Mesh) and mesh.kind == "hex" and mesh.spans is None:
        (local,) = mesh.element.facets
        facets = mesh.cells[:, local].reshape(-1, local.shape[1])
        return _corners(mesh.nodes, facets[_once(corner_ring(facets, mesh.order))], mesh.order)
    outer = sorted((corners for corners, _ in boundary_facets(mesh)), key=lambda corners: corners.shape[1])
    return outer[0] if len(outer) == 1 else np.concatenate([outer[0][:, [0, 1, 2, 2]], outer[1]])


def _cut_rectangle(
    points: FloatArray, weights: FloatArray, lines_m: Sequence[float], cuts_m: Sequence[float]
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Parted rule of one rectangle, unchanged if no line crosses it."""
    x, y = _cut_line(points[::COUNT, 0], cuts_m), _cut_line(points[:COUNT, 1], lines_m)
    if len(x[0]) == len(y[0]) == COUNT:
        return points, weights, np.eye(len(points))
    moved = np.repeat(points[:1], len(x[0]) * len(y[0]), axis=0)
    moved[:, 0], moved[:, 1] = np.repeat(x[0], len(y[0])), np.tile(y[0], len(x[0]))
    share = np.outer(x[1], y[1]).ravel() * (weights.sum() / 4.0)
    return moved, np.asarray(share), np.asarray(np.kron(x[2], y[2]))


def _cut_line(places: FloatArray, lines_m: Sequence[float]) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Gauss points (q,), weights (q,) of sum 2 and interpolation (q, COUNT) of a rule on one axis, parted at some places."""
    s, w = legendre.leggauss(COUNT)
    middle, half = (places[0] + places[-1]) / 2.0, (places[-1] - places[0]) / (s[-1] - s[0])
    at = np.sort([(line - middle) / half for line in lines_m])
    inside = at[np.abs(at) < 1.0 - EDGE]
    if not len(inside):
        return places, w, np.eye(COUNT)
    parts = [((low + high) / 2.0, (high - low) / 2.0) for low, high in pairwise([-1.0, *inside.tolist(), 1.0])]
    t, share = (np.concatenate(part) for part in zip(*((c + h * s, h * w) for c, h in parts), strict=True))
    return np.asarray(middle + half * t), share, np.asarray(lagrange(s, t)[0])


def _root(fitted: FloatArray) -> FloatArray:
    """Roots in [0, 1] of monotone polynomials (degree + 1, q), the nearer end where one has none: Newton in a bracket."""
    first, last = fitted[0], fitted.sum(axis=0)
    rising = np.where(last > first, 1.0, -1.0)
    low, high = np.zeros_like(first), np.ones_like(first)
    ends = np.where(first * rising >= 0.0, 0.0, 1.0)
    inside = (first * rising < 0.0) & (last * rising > 0.0)
    t, slopes = np.where(inside, 0.5, ends), fitted[1:] * np.arange(1, len(fitted))[:, None]
    for _ in range(STEPS):
        off = polynomial.polyval(t, fitted, tensor=False)
        low, high = np.where(off * rising > 0.0, low, t), np.where(off * rising > 0.0, t, high)
        slope = polynomial.polyval(t, slopes, tensor=False)
        step = t - off / np.where(slope == 0.0, np.inf, slope)
        step = np.where((step >= low) & (step <= high), step, (low + high) / 2.0)
        moved = np.where(inside, step, ends)
        if np.abs(moved - t).max() < STRAIGHT:
            return np.asarray(moved)
        t = moved
    return np.asarray(t)


def _roots(fitted: FloatArray, level: float) -> FloatArray:
    """Points between the ends at which a Chebyshev series on [0, 1] takes a value."""
    series = fitted.copy()
    series[0] -= level
    size = np.abs(series).max()
    roots = chebyshev.chebroots(chebyshev.chebtrim(series, 1e-13 * size)) if size > 0.0 else np.empty(0)
    inside = (1.0 + np.real(roots[np.abs(np.imag(roots)) < REAL])) / 2.0
    return np.asarray(inside[(inside > STRAIGHT) & (inside < 1.0 - STRAIGHT)])


def _uncut(nodes: FloatArray, faces: IntArray, order: int) -> FaceQuadrature:
    """One rule on every facet."""
    if faces.shape[1] in TRIANGLES:
        at, weights = _dunavant()
    else:
        line, weight = legendre.leggauss(order + 1)
        at = np.column_stack([np.tile(line, len(line)), np.repeat(line, len(line))])
        weights = np.asarray(np.kron(weight, weight))
    return _mapped(nodes, faces, *_shape(_solid(faces.shape[1], order), at), weights)


def _mapped(
    nodes: FloatArray, faces: IntArray, value: FloatArray, slopes: FloatArray, weights: FloatArray
) -> FaceQuadrature:
    """A rule by its shape functions (q, k), their slopes (2, q, k) and reference weights (q,), on facets (f, k)."""
    corners = nodes[faces]
    points = np.einsum("qk,fkj->fqj", value, corners)
    tangents = np.einsum("mqk,fkj->mfqj", slopes, corners)
    area = np.linalg.norm(np.cross(tangents[0], tangents[1]), axis=2) * weights
    rows = np.repeat(np.arange(points.shape[0] * points.shape[1]), value.shape[1])
    columns = np.repeat(faces[:, None, :], len(weights), axis=1).ravel()
    data = np.broadcast_to(value, (len(faces), *value.shape)).ravel()
    matrix = sp.csr_array((data, (rows, columns)), shape=(len(faces) * len(weights), len(nodes)))
    return FaceQuadrature(points.reshape(-1, 3), area.ravel(), matrix)


def _cut_rules(
    nodes: FloatArray, faces: IntArray, order: int, lines_m: tuple[Sequence[float], ...], straight: BoolArray
) -> list[FaceQuadrature]:
    """A rule of its own for every facet that lines of x or y = const, `lines_m`, may cut."""
    is_triangle, rules = faces.shape[1] in TRIANGLES, []
    shape = partial(_shape, _solid(faces.shape[1], order))
    whole = TRIANGLE if is_triangle else SQUARE
    for facet, flat in zip(faces, straight.tolist(), strict=True):
        along = [CutFacet(shape, order, nodes[facet, axis], np.sort(lines), flat) for axis, lines in enumerate(lines_m)]
        at, weights = _rule_of(along, whole)
        rules.append(_mapped(nodes, facet[None], *shape(at), weights))
    return rules


def _rule_of(along: list[CutFacet], whole: Piece) -> tuple[FloatArray, FloatArray]:
    """Points (q, 2) and weights (q,) of one facet, cut at lines of either kind: into quarters until one kind alone meets a
    piece; what both still meet at the deepest level, around a corner, is 4^-DEEPEST of the facet.
    """
    pieces, points, weights = [(whole, 0)], [], []
    while pieces:
        piece, depth = pieces.pop()
        met = [each for each in along if len(each.within(piece))]
        if len(met) > 1 and depth < DEEPEST:
            pieces += [(quarter, depth + 1) for quarter in piece.quarters()]
            continue
        at, own = (met or along)[-1].rule(piece)
        points.append(at)
        weights.append(own)
    return np.concatenate(points), np.concatenate(weights)


def _solid(count: int, order: int) -> tuple[Element, IntArray]:
    """The element with a facet of this number of nodes at its least z, and those nodes, in the facet's order."""
    solid = element("tet" if count in TRIANGLES else "hex", order)
    height = solid.points[:, 2]
    return solid, np.flatnonzero(height == height.min())


def _shape(solid: tuple[Element, IntArray], at: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Values (q, k) and slopes (2, q, k) of a facet's functions at points (q, 2) of [-1, 1]^2 or of the unit triangle."""
    body, own = solid
    value, slope = body.shape(np.column_stack([at, np.full(len(at), body.points[own[0], 2])]))
    return value[:, own], slope[:, own, :2].transpose(2, 0, 1)


def _dunavant() -> tuple[FloatArray, FloatArray]:
    """Points (6, 2) and weights (6,) on the unit triangle."""
    points, weights = [], []
    for a, weight in _TRIANGLE:
        for place in range(3):
            point = [a, a, a]
            point[place] = 1.0 - 2.0 * a
            points.append(point[1:])
            weights.append(weight / 2.0)
    return np.array(points), np.array(weights)


def _once(facets: IntArray) -> IntArray:
    """Numbers of the facets that stand once."""
    _, index, counts = np.unique(np.sort(facets, axis=1), axis=0, return_index=True, return_counts=True)
    return np.sort(index[counts == 1])


def _corners(nodes: FloatArray, facets: IntArray, order: int) -> IntArray:
    """Corners (m, 4) of facets (f, nodes), u fastest, those with curved edges cut into `order` pieces along these."""
    grid = facets.reshape(-1, order + 1, order + 1)  # v, u
    along_u = _bent(nodes[grid[:, ::order]]).any(axis=1)
    along_v = _bent(nodes[grid.swapaxes(1, 2)[:, ::order]]).any(axis=1)
    pieces = []
    for v_bent, u_bent in product((False, True), repeat=2):
        own = grid[(along_v == v_bent) & (along_u == u_bent)]
        lines = own[:, :: 1 if v_bent else order, :: 1 if u_bent else order]
        corners = [lines[:, :-1, :-1], lines[:, :-1, 1:], lines[:, 1:, 1:], lines[:, 1:, :-1]]
        pieces.append(np.stack(corners, axis=-1).reshape(-1, 4))
    return np.concatenate(pieces)


def _bent(edges: FloatArray) -> BoolArray:
    """Mask of the edges, nodes (..., n, 3) in a row, that leave the chord between their ends."""
    start, chord = edges[..., :1, :], edges[..., -1:, :] - edges[..., :1, :]
    length = np.linalg.norm(chord, axis=-1)
    off = np.linalg.norm(np.cross(edges - start, np.broadcast_to(chord, edges.shape)), axis=-1)
    return np.asarray((off > BENT * length**2).any(axis=-1))


def grid_weights(nodes_m: FloatArray, order: int, at_m: FloatArray) -> FloatArray:
    """Interpolate from the nodes of a tensor grid of elements by the elements' polynomials.

    Parameters
    ----------
    nodes_m : ndarray, shape (n, 2)
        Nodes.
    order : int
        Order of the elements.
    at_m : ndarray, shape (p, 2)
        Places.

    Returns
    -------
    ndarray, shape (p, n)
        Weights of the nodes.

    Raises
    ------
    SolverError
        If the nodes do not form a tensor grid.
    """
    (x, i), (y, j) = (_lines(nodes_m[:, axis]) for axis in range(2))
    if len(x) * len(y) != len(nodes_m):
        raise SolverError(
            "the nodes of a face do not form a tensor grid: displacements between them cannot be interpolated"
        )
    along, across = (_weights(nodes, order, at_m[:, axis]) for axis, nodes in enumerate((x, y)))
    return np.asarray(along[:, i] * across[:, j])


def _lines(places_m: FloatArray) -> tuple[FloatArray, IntArray]:
    """The different coordinates in ascending order, and which of them each place has."""
    _, first, which = np.unique(np.round(places_m / SAME_M), return_index=True, return_inverse=True)
    return places_m[first], np.asarray(which)


def _weights(nodes: FloatArray, order: int, at: FloatArray) -> FloatArray:
    """Weights (p, n) of the elements' polynomials between nodes (n,), `order` + 1 of them in each element, shared ends."""
    at = np.clip(at, nodes[0], nodes[-1])
    ends = nodes[::order]
    element = np.clip(np.searchsorted(ends, at, side="right") - 1, 0, len(ends) - 2)
    local = (2.0 * at - ends[element] - ends[element + 1]) / np.diff(ends)[element]
    out = np.zeros((len(at), len(nodes)))
    places = element[:, None] * order + np.arange(order + 1)
    np.put_along_axis(out, places, lagrange(gauss_lobatto(order), local)[0], axis=1)
    return out
