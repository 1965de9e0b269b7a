"""Reference elements: nodes, shape functions, quadrature and faces of hexahedra (order 1 to 4) and tetrahedra (1, 2).

Hexahedra live on [-1, 1]^3 with Gauss-Lobatto nodes, x fastest: local index = ix + (p + 1) (iy + (p + 1) iz).
Tetrahedra live on the unit simplex; order 2 adds the middles of edges 01, 12, 02, 03, 13, 23 (VTK order).
"""

from __future__ import annotations

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


Element = Hexahedron | Tetrahedron


@lru_cache(maxsize=16)
def element(kind: str, order: int) -> Element:
    """The reference element of a mesh. Raises ValueError for what is not offered."""
    if kind == "hex" and 1 <= order <= 4:
        return Hexahedron(order)
    if kind == "tet" and 1 <= order <= 2:
        return Tetrahedron(order)
    raise ValueError(f"no {kind} element of order {order}: hex has 1 to 4, tet has 1 and 2")


def _tensor_points(line: FloatArray) -> FloatArray:
    z, y, x = np.meshgrid(line, line, line, indexing="ij")
    return np.column_stack([x.ravel(), y.ravel(), z.ravel()])


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
