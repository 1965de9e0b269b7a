"""Gauss rules over rectangles and facets that lines y = const part, each point clearly on one side of every line."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
import scipy.sparse as sp
from numpy.polynomial import chebyshev, legendre, polynomial

from geometry.elements import BoolArray, FloatArray, lagrange

# -- rectangles --------------------------------------------------------------------------------------------------------
# Gauss rules on rectangles, parted at lines y = const: integrals of polynomials over either side are exact.

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


# -- facets ------------------------------------------------------------------------------------------------------------
# Quadrature over facets that lines y = const cut: every point lies clearly on one side of every line.
# Over a facet the place y(s, t) is a polynomial. Where it is monotone in t, each line is the graph of a smooth height
# t = h(s), and Gauss rules between these heights, over intervals of s that no line enters or leaves by an edge,
# converge spectrally (saye2015). Elsewhere the facet is quartered.

STEEP = 0.03  # least slope along the height over the greatest slope: below it the facet is quartered
DEEPEST = 8  # quarterings: what is left then is 4^-8 of a facet, whose points are sorted as they lie
NEAR = 1e-9  # of the facet's extent across the lines: a line so near to a straight edge runs along it
BULGE = 0.02  # of the same: how far a curved facet may reach beyond the places where it is sampled
STRAIGHT = 1e-12  # relative deviation from an affine map
DROPPED = 1e-14  # of the facet's area: slivers that rounding makes
STEPS = 60  # of Newton's method, bracketed
REAL = 1e-7  # imaginary part up to which a root counts as real

Shape = Callable[[FloatArray], tuple[FloatArray, FloatArray]]  # points (q, 2): values (q, k), slopes (2, q, k)


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
        """The same piece with s and t exchanged."""
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
        lines = self._within(piece)
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

    def _within(self, piece: Piece) -> FloatArray:
        """The lines that may cross the piece."""
        y = self.y(piece, *self._samples(piece))[None]
        flat = np.array([self.is_straight])
        return self.lines_m[[bool(may_be_cut(y, flat, [line])[0]) for line in self.lines_m]]

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
        return np.array([top * _root(fitted - np.eye(len(at))[:, :1] * line) for line in lines])


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


def is_straight(corners: FloatArray, reference: FloatArray) -> BoolArray:
    """Which facets, nodes (f, k, 3) at reference places (k, 2), are affine images of the reference facet, (f,)."""
    basis = np.column_stack([np.ones(len(reference)), reference])
    off = np.eye(len(reference)) - basis @ np.linalg.pinv(basis)
    deviation = np.abs(np.einsum("ak,fkj->faj", off, corners)).max(axis=(1, 2))
    return np.asarray(deviation <= STRAIGHT * np.ptp(corners, axis=1).max(axis=1))


def may_be_cut(y_m: FloatArray, straight: BoolArray, lines_m: Sequence[float]) -> BoolArray:
    """Which facets a line may cross, (f,), by y of their nodes, (f, k), and whether they are straight, (f,)."""
    low, high = y_m.min(axis=1), y_m.max(axis=1)
    margin = np.where(straight, NEAR, -BULGE) * (high - low)
    crossed = np.zeros(len(y_m), dtype=bool)
    for line in lines_m:
        crossed |= (line > low + margin) & (line < high - margin)
    return crossed


def gauss(count: int, low: float = 0.0, high: float = 1.0) -> tuple[FloatArray, FloatArray]:
    """Gauss points and weights between two ends."""
    at, weight = legendre.leggauss(count)
    half = (high - low) / 2.0
    return low + half * (at + 1.0), half * weight


def _roots(fitted: FloatArray, level: float) -> FloatArray:
    """Where a Chebyshev series on [0, 1] has a value, between the ends."""
    series = fitted.copy()
    series[0] -= level
    size = np.abs(series).max()
    roots = chebyshev.chebroots(chebyshev.chebtrim(series, 1e-13 * size)) if size > 0.0 else np.empty(0)
    inside = (1.0 + np.real(roots[np.abs(np.imag(roots)) < REAL])) / 2.0
    return np.asarray(inside[(inside > STRAIGHT) & (inside < 1.0 - STRAIGHT)])
