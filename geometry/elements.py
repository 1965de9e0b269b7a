"""Reference elements: nodes, shape functions, quadrature and faces of hexahedra (order 1 to 4), tetrahedra, wedges and
pyramids (1, 2).

Hexahedra live on [-1, 1]^3 with Gauss-Lobatto nodes, x fastest: local index = ix + (p + 1) (iy + (p + 1) iz).
Tetrahedra live on the unit simplex; order 2 adds the middles of edges 01, 12, 02, 03, 13, 23 (VTK order).
Wedges live on the unit triangle times [-1, 1], pyramids between [-1, 1]^2 at z = 0 and their tip at z = 1, nodes in VTK's
order; of order 2 they have 18 and 14 nodes, so that their faces are those of the others: 9 nodes on squares, 6 on triangles.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property, lru_cache
from itertools import permutations
from typing import ClassVar

import numpy as np
from numpy.polynomial import legendre
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]
BoolArray = NDArray[np.bool_]
ComplexArray = NDArray[np.complex128]

Rings = tuple[tuple[int, ...], ...]


@dataclass(frozen=True)
class Topology:
    """Corners of a kind on the reference element (n, 3), in VTK's order; its edges, and its faces as outward rings of them."""

    corners: FloatArray
    edges: Rings
    triangles: Rings = ()
    squares: Rings = ()


def _at(*corners: tuple[float, float, float]) -> FloatArray:
    return np.array(corners, dtype=float)


TOPOLOGY = {
    "hex": Topology(
        _at((-1, -1, -1), (1, -1, -1), (1, 1, -1), (-1, 1, -1), (-1, -1, 1), (1, -1, 1), (1, 1, 1), (-1, 1, 1)),
        ((0, 1), (1, 2), (2, 3), (3, 0), (4, 5), (5, 6), (6, 7), (7, 4), (0, 4), (1, 5), (2, 6), (3, 7)),
        squares=((0, 4, 7, 3), (1, 2, 6, 5), (0, 1, 5, 4), (3, 7, 6, 2), (0, 3, 2, 1), (4, 5, 6, 7)),
    ),
    "tet": Topology(
        _at((0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 1)),
        ((0, 1), (1, 2), (0, 2), (0, 3), (1, 3), (2, 3)),
        triangles=((0, 2, 1), (0, 1, 3), (1, 2, 3), (0, 3, 2)),
    ),
    "wedge": Topology(
        _at((0, 0, -1), (1, 0, -1), (0, 1, -1), (0, 0, 1), (1, 0, 1), (0, 1, 1)),
        ((0, 1), (1, 2), (2, 0), (3, 4), (4, 5), (5, 3), (0, 3), (1, 4), (2, 5)),
        ((0, 2, 1), (3, 4, 5)),
        ((0, 1, 4, 3), (1, 2, 5, 4), (2, 0, 3, 5)),
    ),
    "pyramid": Topology(
        _at((-1, -1, 0), (1, -1, 0), (1, 1, 0), (-1, 1, 0), (0, 0, 1)),
        ((0, 1), (1, 2), (2, 3), (3, 0), (0, 4), (1, 4), (2, 4), (3, 4)),
        ((0, 1, 4), (1, 2, 4), (2, 3, 4), (3, 0, 4)),
        ((0, 3, 2, 1),),
    ),
}
TET_EDGES, TET_FACES = np.array(TOPOLOGY["tet"].edges), np.array(TOPOLOGY["tet"].triangles)


@lru_cache(maxsize=16)
def gauss_lobatto(order: int) -> FloatArray:
    """Compute the Gauss-Lobatto points on [-1, 1]: both ends and the roots of P'_order.

    Parameters
    ----------
    order : int
        Degree of the Legendre polynomial.

    Returns
    -------
    ndarray, shape (order + 1,)
        Ascending points.
    """
    inner = legendre.legroots(legendre.legder(np.eye(order + 1)[order]))
    return np.concatenate([[-1.0], np.sort(inner), [1.0]])


def lagrange(nodes: FloatArray, at: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Evaluate the Lagrange polynomials on some nodes.

    Parameters
    ----------
    nodes : ndarray, shape (n,)
        Distinct nodes.
    at : ndarray, shape (m,)
        Points of evaluation.

    Returns
    -------
    values, derivatives : ndarray, shape (m, n)
        Each polynomial and its derivative at the points.
    """
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
class Element:
    """A reference element of an order.

    Unless it says otherwise Lagrange's of order 1 or 2, on the corners and the middles of edges and squares: the functions of
    the span of `_functions` that are 1 at one node and 0 at the others.
    """

    order: int

    kind: ClassVar[str]

    def _functions(self, at: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Values (q, k) and gradients (q, k, 3) of functions that span the element's."""
        raise NotImplementedError

    @property
    def quadrature(self) -> Quadrature:
        """A rule that is exact for the mass matrix of a straight element."""
        raise NotImplementedError

    @cached_property
    def points(self) -> FloatArray:
        """Reference nodes (k, 3)."""
        own = TOPOLOGY[self.kind]
        middles = [own.corners[list(place)].mean(axis=0) for place in (*own.edges, *own.squares)]
        return own.corners if self.order == 1 else np.vstack([own.corners, *middles])

    def shape(self, at: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Values (q, k) and reference gradients (q, k, 3) of the shape functions at points (q, 3)."""
        to_nodal = np.linalg.inv(self._functions(self.points)[0])
        value, slope = self._functions(at)
        return value @ to_nodal, np.asarray(np.einsum("qfm,fk->qkm", slope, to_nodal))

    @cached_property
    def facets(self) -> tuple[IntArray, ...]:
        """Local nodes of the faces by shape: triangles outward, corners first (m, 3 or 6), squares u fastest."""
        own, found = TOPOLOGY[self.kind], []
        for rings, places in ((own.triangles, _triangle_places), (own.squares, _square_places)):
            if rings:
                found.append(np.array([self.nodes_at(places(own.corners[list(ring)], self.order)) for ring in rings]))
        return tuple(found)

    def nodes_at(self, places: FloatArray) -> IntArray:
        """The local nodes nearest to reference places (..., 3)."""
        return np.asarray(np.linalg.norm(places[..., None, :] - self.points, axis=-1).argmin(axis=-1))


class Hexahedron(Element):
    """Tensor-product Lagrange hexahedron of order 1 to 4 on Gauss-Lobatto nodes."""

    kind = "hex"

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
    def facets(self) -> tuple[IntArray, ...]:
        """The six faces x-, x+, y-, y+, z-, z+, shape (6, (order + 1)^2), u fastest."""
        grid = np.arange((self.order + 1) ** 3).reshape((self.order + 1,) * 3)
        sides = [grid[:, :, 0], grid[:, :, -1], grid[:, 0, :], grid[:, -1, :], grid[0], grid[-1]]
        return (np.array([side.ravel() for side in sides]),)


class Tetrahedron(Element):
    """Lagrange tetrahedron: complete polynomials; 4 or 10 nodes."""

    kind = "tet"

    def _functions(self, at: FloatArray) -> tuple[FloatArray, FloatArray]:
        return _powers(at, _complete(self.order))

    @cached_property
    def quadrature(self) -> Quadrature:
        """Walkington's fourteen points, exact to degree 5; the mass of a straight quadratic tetrahedron needs 4."""
        a, b, c = 0.31088591926330060, 0.09273525031089123, 0.04550370412564965
        orbits = [(a, a, a, 1.0 - 3.0 * a), (b, b, b, 1.0 - 3.0 * b), (c, c, 0.5 - c, 0.5 - c)]
        points = [sorted(set(permutations(orbit))) for orbit in orbits]
        weights = np.repeat(
            [0.018781320953002642, 0.012248840519393658, 0.007091003462846911], [len(p) for p in points]
        )
        return Quadrature(np.concatenate(points)[:, 1:], weights)


class Wedge(Element):
    """Lagrange wedge (triangular prism): the triangle's polynomials times the line's; 6 or 18 nodes."""

    kind = "wedge"

    def _functions(self, at: FloatArray) -> tuple[FloatArray, FloatArray]:
        line = range(self.order + 1)
        return _powers(at, np.array([(i, j, k) for k in line for i in line for j in range(self.order + 1 - i)]))

    @cached_property
    def quadrature(self) -> Quadrature:
        """Gauss rule along the prism times the collapsed Gauss-Jacobi rule of the triangle, degree 2 order + 1."""
        (x, u), (y, v) = _gauss_jacobi(self.order + 1, 0), _gauss_jacobi(self.order + 1, 1)
        t, w = legendre.leggauss(self.order + 1)
        points = [((1.0 - b) * a, b, c) for c in t for b in y for a in x]
        return Quadrature(np.array(points), np.asarray(np.kron(w, np.kron(v, u))))


class Pyramid(Element):
    """Pyramid of 5 or 14 nodes: complete polynomials and the rational functions that its square base needs.

    With r = xy/(1 - z): order 1 spans 1, x, y, z, r; order 2 the ten quadratic monomials, r, rx, ry, r^2 (bergot2010). At the
    tip the limit along the axis.
    """

    kind = "pyramid"

    def _functions(self, at: FloatArray) -> tuple[FloatArray, FloatArray]:
        value, slope = _powers(at, _complete(self.order))
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


KINDS: dict[str, type[Element]] = {kind.kind: kind for kind in (Hexahedron, Tetrahedron, Wedge, Pyramid)}


@lru_cache(maxsize=16)
def element(kind: str, order: int) -> Element:
    """Return the reference element of a kind and order.

    Parameters
    ----------
    kind : {'hex', 'tet', 'wedge', 'pyramid'}
        Shape of the element.
    order : int
        From 1 to 4 for hex, 1 or 2 for the others.

    Returns
    -------
    Element
        The reference element.

    Raises
    ------
    ValueError
        For an element that does not exist.
    """
    if kind not in KINDS or not 1 <= order <= (4 if kind == "hex" else 2):
        raise ValueError(
            f"no {kind} element of order {order}: hex has orders 1 to 4; tet, wedge and pyramid have 1 and 2"
        )
    return KINDS[kind](order)


def _tensor_points(line: FloatArray) -> FloatArray:
    z, y, x = np.meshgrid(line, line, line, indexing="ij")
    return np.column_stack([x.ravel(), y.ravel(), z.ravel()])


TRIANGLES = (3, 6)  # nodes of a triangular facet of order 1 or 2; any other number is a square's


def corner_ring(facets: IntArray, order: int) -> IntArray:
    """Return the corners of facets in ring order.

    Parameters
    ----------
    facets : ndarray, shape (m, k)
        Nodes: of triangles the corners first, of squares u fastest.
    order : int
        Order of the elements.

    Returns
    -------
    ndarray, shape (m, 3) or (m, 4)
        Corner nodes.
    """
    if facets.shape[1] in TRIANGLES:
        return facets[:, :3]
    return facets[:, [0, order, (order + 1) ** 2 - 1, order * (order + 1)]]


def _complete(order: int) -> IntArray:
    """Powers (i, j, k) of the complete polynomials of an order."""
    return np.array([powers for powers in np.ndindex(3, 3, 3) if sum(powers) <= order])


def _powers(at: FloatArray, powers: IntArray) -> tuple[FloatArray, FloatArray]:
    """Monomials x^i y^j z^k (q, k) and their gradients (q, k, 3) at points (q, 3)."""
    each = at[:, None, :] ** powers
    slopes = powers * at[:, None, :] ** np.maximum(powers - 1, 0)
    others = [np.prod(np.delete(each, axis, axis=2), axis=2) for axis in range(3)]
    return each.prod(axis=2), np.stack([slopes[:, :, axis] * others[axis] for axis in range(3)], axis=2)


def _gauss_jacobi(count: int, power: int) -> tuple[FloatArray, FloatArray]:
    """Points and weights on [0, 1] for the weight (1 - t)^power."""
    from scipy.special import roots_jacobi

    at, weight = roots_jacobi(count, power, 0)
    return (1.0 + at) / 2.0, weight / 2.0 ** (power + 1)


def _triangle_places(corners: FloatArray, order: int) -> FloatArray:
    return corners if order == 1 else np.vstack([corners, (corners + np.roll(corners, -1, axis=0)) / 2.0])


def _square_places(corners: FloatArray, order: int) -> FloatArray:
    line = np.linspace(0.0, 1.0, order + 1)
    a, b, c, d = corners
    return np.array([(1 - v) * ((1 - u) * a + u * b) + v * ((1 - u) * d + u * c) for v in line for u in line])
