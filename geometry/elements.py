"""Reference elements: nodes, shape functions, quadrature and faces of hexahedra (order 1 to 4), tetrahedra, wedges and
pyramids (1, 2).

Hexahedra live on [-1, 1]^3 with Gauss-Lobatto nodes, x fastest: local index = ix + (p + 1) (iy + (p + 1) iz).
Tetrahedra live on the unit simplex; order 2 adds the middles of edges 01, 12, 02, 03, 13, 23 (VTK order).
Wedges live on the unit triangle times [-1, 1], pyramids between [-1, 1]^2 at z = 0 and their tip at z = 1, nodes in VTK's
order; of order 2 they have 18 and 14 nodes, so that their faces are those of the others: 9 nodes on squares, 6 on triangles.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache
from itertools import permutations

import numpy as np
from numpy.polynomial import legendre
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]
BoolArray = NDArray[np.bool_]
ComplexArray = NDArray[np.complex128]

TET_EDGES = np.array([[0, 1], [1, 2], [0, 2], [0, 3], [1, 3], [2, 3]])
TET_FACES = np.array([[0, 2, 1], [0, 1, 3], [1, 2, 3], [0, 3, 2]])  # outward normals
WEDGE_EDGES = ((0, 1), (1, 2), (2, 0), (3, 4), (4, 5), (5, 3), (0, 3), (1, 4), (2, 5))
WEDGE_SQUARES = ((0, 1, 4, 3), (1, 2, 5, 4), (2, 0, 3, 5))  # the rings of corners, outward, as the triangles
WEDGE_TRIANGLES = ((0, 2, 1), (3, 4, 5))
PYRAMID_EDGES = ((0, 1), (1, 2), (2, 3), (3, 0), (0, 4), (1, 4), (2, 4), (3, 4))
PYRAMID_SQUARES = ((0, 3, 2, 1),)
PYRAMID_TRIANGLES = ((0, 1, 4), (1, 2, 4), (2, 3, 4), (3, 0, 4))


@lru_cache(maxsize=16)
def gauss_lobatto(order: int) -> FloatArray:
    """Gauss-Lobatto points of degree `order` on [-1, 1], shape (order + 1,): the ends and the roots of P'_order."""
    if order == 1:
        return np.array([-1.0, 1.0])
    inner = legendre.legroots(legendre.legder(np.eye(order + 1)[order]))
    return np.concatenate([[-1.0], np.sort(inner), [1.0]])


def lagrange(nodes: FloatArray, at: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Values and derivatives of the Lagrange polynomials on `nodes`, each of shape (len(at), len(nodes))."""
    count = len(nodes)
    vander = legendre.legvander(nodes, count - 1)
    to_nodal = np.linalg.inv(vander)
    slopes = np.column_stack([legendre.legval(at, legendre.legder(row)) for row in np.eye(count)])
    return legendre.legvander(at, count - 1) @ to_nodal, slopes @ to_nodal


@dataclass(frozen=True)
class Quadrature:
    """Points (q, 3) and weights (q,) on a reference element."""

    points: FloatArray
    weights: FloatArray


@dataclass(frozen=True)
class Hexahedron:
    """Tensor-product Lagrange hexahedron of order 1 to 4 on Gauss-Lobatto nodes."""

    order: int
    kind: str = "hex"

    @cached_property
    def points(self) -> FloatArray:
        """Reference nodes, shape ((order + 1)^3, 3)."""
        return _tensor_points(gauss_lobatto(self.order))

    def shape(self, at: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Values (q, k) and reference gradients (q, k, 3) of the shape functions at points (q, 3)."""
        nodes = gauss_lobatto(self.order)
        (vx, dx), (vy, dy), (vz, dz) = (lagrange(nodes, at[:, axis]) for axis in range(3))

        def product(x: FloatArray, y: FloatArray, z: FloatArray) -> FloatArray:
            return np.asarray(np.einsum("qz,qy,qx->qzyx", z, y, x).reshape(len(at), -1))

        gradient = np.stack([product(dx, vy, vz), product(vx, dy, vz), product(vx, vy, dz)], axis=2)
        return product(vx, vy, vz), gradient

    @cached_property
    def quadrature(self) -> Quadrature:
        """Gauss rule, exact for the mass matrix of a parallelepiped (degree 2 order + 1 an axis)."""
        points, weights = legendre.leggauss(self.order + 1)
        return Quadrature(_tensor_points(points), _tensor_points(weights).prod(axis=1))

    @cached_property
    def faces(self) -> IntArray:
        """Local nodes of the six faces x-, x+, y-, y+, z-, z+, shape (6, (order + 1)^2), u fastest."""
        grid = np.arange((self.order + 1) ** 3).reshape((self.order + 1,) * 3)
        sides = [grid[:, :, 0], grid[:, :, -1], grid[:, 0, :], grid[:, -1, :], grid[0], grid[-1]]
        return np.array([side.ravel() for side in sides])

    @property
    def facets(self) -> tuple[IntArray, ...]:
        """The faces by shape, one array of local nodes each."""
        return (self.faces,)


@dataclass(frozen=True)
class Tetrahedron:
    """Lagrange tetrahedron of order 1 or 2."""

    order: int
    kind: str = "tet"

    @cached_property
    def points(self) -> FloatArray:
        """Reference nodes, shape (4 or 10, 3)."""
        corners = np.vstack([np.zeros(3), np.eye(3)])
        return corners if self.order == 1 else np.vstack([corners, corners[TET_EDGES].mean(axis=1)])

    def shape(self, at: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Values (q, k) and reference gradients (q, k, 3) of the shape functions at points (q, 3)."""
        bary = np.column_stack([1.0 - at.sum(axis=1), at])
        slope = np.vstack([-np.ones(3), np.eye(3)])
        if self.order == 1:
            return bary, np.broadcast_to(slope, (len(at), 4, 3)).copy()
        first, second = bary[:, TET_EDGES[:, 0]], bary[:, TET_EDGES[:, 1]]
        corner_slope = (4.0 * bary - 1.0)[:, :, None] * slope
        edge_slope = 4.0 * (first[:, :, None] * slope[TET_EDGES[:, 1]] + second[:, :, None] * slope[TET_EDGES[:, 0]])
        return (
            np.hstack([bary * (2.0 * bary - 1.0), 4.0 * first * second]),
            np.concatenate([corner_slope, edge_slope], axis=1),
        )

    @cached_property
    def quadrature(self) -> Quadrature:
        """Fourteen points, exact to degree 5; the mass matrix of a straight quadratic tetrahedron needs 4."""
        return _tet_degree_five()

    @cached_property
    def faces(self) -> IntArray:
        """Local nodes of the four faces, corners first, outward, shape (4, 3 or 6)."""
        if self.order == 1:
            return TET_FACES
        edge_of = {frozenset(edge): 4 + index for index, edge in enumerate(TET_EDGES.tolist())}
        middles = [[edge_of[frozenset((f[i], f[(i + 1) % 3]))] for i in range(3)] for f in TET_FACES.tolist()]
        return np.hstack([TET_FACES, middles])

    @property
    def facets(self) -> tuple[IntArray, ...]:
        """The faces by shape, one array of local nodes each."""
        return (self.faces,)


@dataclass(frozen=True)
class Wedge:
    """Lagrange wedge (triangular prism) of order 1 or 2: the triangle's polynomials times the line's; 6 or 18 nodes."""

    order: int
    kind: str = "wedge"

    @cached_property
    def points(self) -> FloatArray:
        """Reference nodes: corners, then the middles of edges and of squares."""
        corners = np.array([(x, y, t) for t in (-1.0, 1.0) for x, y in ((0.0, 0.0), (1.0, 0.0), (0.0, 1.0))])
        return _with_middles(corners, WEDGE_EDGES, WEDGE_SQUARES, self.order)

    def shape(self, at: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Values (q, k) and reference gradients (q, k, 3) of the shape functions at points (q, 3)."""
        return _nodal(self._monomials, self.points, at)

    def _monomials(self, at: FloatArray) -> tuple[FloatArray, FloatArray]:
        powers = [
            (i, j, k) for k in range(self.order + 1) for i in range(self.order + 1) for j in range(self.order + 1 - i)
        ]
        return _powers(at, np.array(powers))

    @cached_property
    def quadrature(self) -> Quadrature:
        """Gauss rule along the prism times the collapsed Gauss-Jacobi rule of the triangle, degree 2 order + 1."""
        (x, u), (y, v) = _gauss_jacobi(self.order + 1, 0), _gauss_jacobi(self.order + 1, 1)
        t, w = legendre.leggauss(self.order + 1)
        points = [((1.0 - b) * a, b, c) for c in t for b in y for a in x]
        return Quadrature(np.array(points), np.asarray(np.kron(w, np.kron(v, u))))

    @cached_property
    def facets(self) -> tuple[IntArray, ...]:
        """Local nodes of the triangles (corners first) and of the squares (u fastest), outward."""
        return _facets(self.points, WEDGE_TRIANGLES, WEDGE_SQUARES, self.order)


@dataclass(frozen=True)
class Pyramid:
    """Pyramid of order 1 or 2, 5 or 14 nodes: complete polynomials and the rational functions that its square base needs.

    With r = xy/(1 - z): order 1 spans 1, x, y, z, r; order 2 the ten quadratic monomials, r, rx, ry, r^2 (bergot2010).
    """

    order: int
    kind: str = "pyramid"

    @cached_property
    def points(self) -> FloatArray:
        """Reference nodes: corners, then the middles of edges and of the base."""
        corners = np.array([(-1, -1, 0), (1, -1, 0), (1, 1, 0), (-1, 1, 0), (0, 0, 1)], dtype=float)
        return _with_middles(corners, PYRAMID_EDGES, PYRAMID_SQUARES, self.order)

    def shape(self, at: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Values (q, k) and reference gradients (q, k, 3) at points (q, 3); at the tip the limit along the axis."""
        return _nodal(self._functions, self.points, at)

    def _functions(self, at: FloatArray) -> tuple[FloatArray, FloatArray]:
        powers = [(i, j, k) for i, j, k in np.ndindex(3, 3, 3) if i + j + k <= self.order]
        value, slope = _powers(at, np.array(powers))
        x, y = at[:, 0], at[:, 1]
        deep = np.maximum(1.0 - at[:, 2], 1e-14)
        r, flat = x * y / deep, np.zeros(len(at))
        steep = np.stack([y / deep, x / deep, x * y / deep**2], axis=1)
        along = [np.stack([np.ones(len(at)), flat, flat], axis=1), np.stack([flat, np.ones(len(at)), flat], axis=1)]
        more, slopes = [r], [steep]
        if self.order == 2:
            more += [r * x, r * y, r * r]
            slopes += [axis[:, None] * steep + r[:, None] * unit for axis, unit in zip((x, y), along, strict=True)]
            slopes.append(2.0 * r[:, None] * steep)
        return np.column_stack([value, *more]), np.concatenate([slope, np.stack(slopes, axis=1)], axis=1)

    @cached_property
    def quadrature(self) -> Quadrature:
        """Gauss rule of squares that shrink towards the tip, Gauss-Jacobi along the height: the mass of a straight one."""
        at, weight = legendre.leggauss(self.order + 1)
        z, high = _gauss_jacobi(self.order + 1, 2)
        points = [((1.0 - c) * a, (1.0 - c) * b, c) for c in z for b in at for a in at]
        return Quadrature(np.array(points), np.asarray(np.kron(high, np.kron(weight, weight))))

    @cached_property
    def facets(self) -> tuple[IntArray, ...]:
        """Local nodes of the triangles (corners first) and of the base (u fastest), outward."""
        return _facets(self.points, PYRAMID_TRIANGLES, PYRAMID_SQUARES, self.order)


Element = Hexahedron | Tetrahedron | Wedge | Pyramid


@lru_cache(maxsize=16)
def element(kind: str, order: int) -> Element:
    """The reference element of a mesh. Raises ValueError for what is not offered."""
    if kind == "hex" and 1 <= order <= 4:
        return Hexahedron(order)
    if kind == "tet" and 1 <= order <= 2:
        return Tetrahedron(order)
    if kind in ("wedge", "pyramid") and 1 <= order <= 2:
        return Wedge(order) if kind == "wedge" else Pyramid(order)
    raise ValueError(f"no {kind} element of order {order}: hex has 1 to 4; tet, wedge and pyramid have 1 and 2")


def _tensor_points(line: FloatArray) -> FloatArray:
    z, y, x = np.meshgrid(line, line, line, indexing="ij")
    return np.column_stack([x.ravel(), y.ravel(), z.ravel()])


TRIANGLES = (3, 6)  # nodes of a triangular facet of order 1 or 2; any other number is a square's


def corner_ring(facets: IntArray, order: int) -> IntArray:
    """The corners of facets (m, k), triangles' first three, squares' (u fastest) in ring order."""
    if facets.shape[1] in TRIANGLES:
        return facets[:, :3]
    return facets[:, [0, order, (order + 1) ** 2 - 1, order * (order + 1)]]


Rings = tuple[tuple[int, ...], ...]


def _with_middles(corners: FloatArray, edges: Rings, squares: Rings, order: int) -> FloatArray:
    middles = [corners[list(place)].mean(axis=0) for place in (*edges, *squares)]
    return corners if order == 1 else np.vstack([corners, *middles])


def _powers(at: FloatArray, powers: IntArray) -> tuple[FloatArray, FloatArray]:
    """Monomials x^i y^j z^k (q, k) and their gradients (q, k, 3) at points (q, 3)."""
    each = at[:, None, :] ** powers
    slopes = powers * at[:, None, :] ** np.maximum(powers - 1, 0)
    others = [np.prod(np.delete(each, axis, axis=2), axis=2) for axis in range(3)]
    return each.prod(axis=2), np.stack([slopes[:, :, axis] * others[axis] for axis in range(3)], axis=2)


def _nodal(
    functions: Callable[[FloatArray], tuple[FloatArray, FloatArray]], nodes: FloatArray, at: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Values and gradients of the functions of the same span that are 1 at one node and 0 at the others."""
    to_nodal = np.linalg.inv(functions(nodes)[0])
    value, slope = functions(at)
    return value @ to_nodal, np.asarray(np.einsum("qfm,fk->qkm", slope, to_nodal))


def _gauss_jacobi(count: int, power: int) -> tuple[FloatArray, FloatArray]:
    """Points and weights on [0, 1] for the weight (1 - t)^power."""
    from scipy.special import roots_jacobi

    at, weight = roots_jacobi(count, power, 0)
    return (1.0 + at) / 2.0, weight / 2.0 ** (power + 1)


def _facets(points: FloatArray, triangles: Rings, squares: Rings, order: int) -> tuple[IntArray, ...]:
    """Local nodes of faces given by their rings of corners, (m, 3 or 6) and (m, 4 or 9), each node found by its place."""
    return np.array([_placed(points, _triangle_places, ring, order) for ring in triangles]), np.array(
        [_placed(points, _square_places, ring, order) for ring in squares]
    )


def _placed(
    points: FloatArray, places: Callable[[FloatArray, int], FloatArray], ring: Sequence[int], order: int
) -> IntArray:
    wanted = places(points[list(ring)], order)
    return np.asarray(np.linalg.norm(wanted[:, None] - points, axis=2).argmin(axis=1))


def _triangle_places(corners: FloatArray, order: int) -> FloatArray:
    return corners if order == 1 else np.vstack([corners, (corners + np.roll(corners, -1, axis=0)) / 2.0])


def _square_places(corners: FloatArray, order: int) -> FloatArray:
    line = np.linspace(0.0, 1.0, order + 1)
    a, b, c, d = corners
    return np.array([(1 - v) * ((1 - u) * a + u * b) + v * ((1 - u) * d + u * c) for v in line for u in line])


def _orbit(barycentric: tuple[float, float, float, float]) -> FloatArray:
    return np.array(sorted(set(permutations(barycentric))))[:, 1:]


def _tet_degree_five() -> Quadrature:
    """Walkington's fourteen-point rule; its three orbits are solved for here rather than copied from a table."""
    from scipy.optimize import fsolve

    def moments(unknown: FloatArray) -> list[float]:
        points, weights = rule(unknown)
        x, y = points[:, 0], points[:, 1]
        exact = [1 / 6, 1 / 60, 1 / 120, 1 / 210, 1 / 1260, 1 / 336]
        values = [np.ones_like(x), x**2, x**3, x**4, x**2 * y**2, x**5]
        return [float(weights @ v - e) for v, e in zip(values, exact, strict=True)]

    def rule(unknown: FloatArray) -> tuple[FloatArray, FloatArray]:
        a, b, c, wa, wb, wc = unknown
        orbits = [_orbit((a, a, a, 1 - 3 * a)), _orbit((b, b, b, 1 - 3 * b)), _orbit((c, c, 0.5 - c, 0.5 - c))]
        weights = np.repeat([wa, wb, wc], [len(orbit) for orbit in orbits])
        return np.vstack(orbits), weights

    start = np.array([0.3109, 0.0927, 0.0455, 0.0188, 0.0122, 0.0071])
    return Quadrature(*rule(fsolve(moments, start, xtol=1e-12)))
