"""Boundary functions of a rectangular cell, polynomials along each side and through the thickness, and a reduction's settings.

Vertex lines carry linear hats, sides carry bubbles (integrated Legendre polynomials, szabo1991); both are multiplied by
Legendre polynomials through the thickness. Opposite sides carry the same functions, so cells join whatever their meshes.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.polynomial import legendre

from geometry.elements import ComplexArray, FloatArray, IntArray
from geometry.hex.scenes import HexSettings

VERTICES = ((-1, -1), (1, -1), (-1, 1), (1, 1))
SIDES = ("x-", "x+", "y-", "y+")
OFFSETS = ((0, 0), (1, 0), (0, 1), (1, 1))  # of the vertex lines from the first, in cells


@dataclass(frozen=True)
class Interface:
    """Degrees of the boundary functions: `along` each side (at least 1), `through` the thickness (at least 1).

    joints: heights from -1 to 1 where layers of the plate meet. Functions through it are then continuous polynomials of each
    layer, which may have a kink between two of them.
    """

    along: int
    through: int
    joints: tuple[float, ...] = ()

    @property
    def layers(self) -> int:
        """Functions through the thickness."""
        return (len(self.joints) + 1) * self.through + 1

    @property
    def highest(self) -> IntArray:
        """Those of them that have the highest degree, (n,)."""
        return np.arange((len(self.joints) + 1) * (self.through - 1) + 1, self.layers)

    @property
    def vertex_block(self) -> int:
        """Degrees of freedom of one vertex line."""
        return 3 * self.layers

    @property
    def side_block(self) -> int:
        """Degrees of freedom of one side: its bubble functions times those through the thickness, of three components."""
        return 3 * self.layers * (self.along - 1)

    @property
    def count(self) -> int:
        """Boundary degrees of freedom of a cell."""
        return 4 * (self.vertex_block + self.side_block)

    def vertex(self, index: int) -> IntArray:
        """Degrees of freedom of vertex line `index` (order -x-y, +x-y, -x+y, +x+y): component fastest, then thickness."""
        return np.arange(self.vertex_block) + index * self.vertex_block

    def side(self, index: int) -> IntArray:
        """Degrees of freedom of side `index` (x-, x+, y-, y+): component fastest, then thickness, then bubble degree."""
        return np.arange(self.side_block) + 4 * self.vertex_block + index * self.side_block

    @property
    def along_side(self) -> IntArray:
        """Degree along its side of each degree of freedom, (count,); 0 on vertex lines."""
        degree = np.zeros(self.count, dtype=np.int64)
        for index in range(4):
            degree[self.side(index)] = np.repeat(np.arange(2, self.along + 1), 3 * self.layers)
        return degree

    @property
    def across(self) -> IntArray:
        """Function through the thickness of each degree of freedom, (count,): ascending in degree."""
        return np.arange(self.count) // 3 % self.layers

    @property
    def free(self) -> IntArray:
        """One vertex line and one side along each axis, which the others of a lattice follow, (free,)."""
        return np.concatenate([self.vertex(0), self.side(2), self.side(0)])

    def within(self, smaller: Interface) -> IntArray:
        """Degrees of freedom of an interface of lower degrees among these, in its order."""
        return np.flatnonzero((self.along_side <= smaller.along) & (self.across < smaller.layers))

    def evaluate(self, points: FloatArray) -> FloatArray:
        """Scalar boundary functions at boundary points (n, 3) in the cell's own coordinates [-1, 1]^3, shape (n, count / 3)."""
        x, y, z = points.T
        layers = through_functions(z, self.through, self.joints)
        flat = [np.einsum("n,nr->nr", (1 + sx * x) * (1 + sy * y) / 4, layers) for sx, sy in VERTICES]
        bubbles_x, bubbles_y = bubble_functions(x, self.along), bubble_functions(y, self.along)
        for sign in (-1, 1):
            flat.append(self._side((1 + sign * x) / 2, bubbles_y, layers))
        for sign in (-1, 1):
            flat.append(self._side((1 + sign * y) / 2, bubbles_x, layers))
        return np.hstack(flat)

    def _side(self, blend: FloatArray, bubbles: FloatArray, layers: FloatArray) -> FloatArray:
        return np.asarray(np.einsum("n,nb,nr->nbr", blend, bubbles, layers).reshape(len(blend), -1))

    def mirror(self, axis: int) -> tuple[IntArray, FloatArray]:
        """Effect of the mirror normal to an axis on the degrees of freedom: u'[i] = sign[i] u[where[i]], shapes (count,)."""
        where, sign = np.arange(self.count), np.ones(self.count)
        for index, corner in enumerate(VERTICES):
            image = list(corner)
            image[axis] = -image[axis]
            where[self.vertex(index)] = self.vertex(VERTICES.index((image[0], image[1])))
        where[self.side(2 * axis)], where[self.side(2 * axis + 1)] = self.side(2 * axis + 1), self.side(2 * axis)
        degree = np.repeat(np.arange(2, self.along + 1), 3 * self.layers)
        for side in (2 - 2 * axis, 3 - 2 * axis):
            sign[self.side(side)] *= (-1.0) ** degree
        sign[axis::3] *= -1.0
        return where, sign

    def diagonal(self) -> IntArray:
        """Effect of the mirror x <-> y on the degrees of freedom: u'[i] = u[where[i]], shape (count,)."""
        where = np.arange(self.count)
        for index, corner in enumerate(VERTICES):
            where[self.vertex(index)] = self.vertex(VERTICES.index((corner[1], corner[0])))
        for index in range(4):
            where[self.side(index)] = self.side((index + 2) % 4)
        components = where.reshape(-1, 3)
        return np.asarray(components[:, [1, 0, 2]].ravel())

    def parity_basis(self, signs: dict[int, int], diagonal: int = 0) -> FloatArray:
        """Orthonormal combinations with the given symmetry of u_z under each mirror axis, shape (count, m).

        `diagonal`: the symmetry under x <-> y too, where both axes have the same; 0 for either.
        """
        mirrors = [(*self.mirror(axis), symmetry) for axis, symmetry in signs.items()]
        mirrors += [(self.diagonal(), np.ones(self.count), diagonal)] if diagonal else []
        projector = np.eye(self.count)
        for where, sign, symmetry in mirrors:
            image = np.zeros((self.count, self.count))
            image[np.arange(self.count), where] = sign
            projector = projector @ (np.eye(self.count) + symmetry * image) / 2.0
        length = np.linalg.norm(projector, axis=0)
        columns = projector[:, length > 0] / length[length > 0]
        leading = np.take_along_axis(columns, np.abs(columns).argmax(axis=0)[None], axis=0)
        columns = columns * np.sign(leading)
        _, once = np.unique(np.round(columns, 9), axis=1, return_index=True)
        return np.asarray(columns[:, np.sort(once)])


class Ties:
    """Ties of the degrees of freedom of adjacent cells in a lattice: u(r + a) = u(r) exp(i k.a).

    a1 leads from the first of a row's cells to the place beyond the last, a2 from the first of the `rows` to the one beyond
    the last; each begins `shift` cells further on than the one below. The lower edge and the inside, with the edges between
    rows, are free; an open row keeps its upper edge free, too.

    column (dof,): the free one, numbered [lower edge, inside], an edge as [vertex line, side] of each cell; offset (dof, 2): by
    how many a1 and a2 it lies beyond it. edge, inside: how many there are of both.
    """

    def __init__(self, face: Interface, modes: Sequence[int], shift: int = 0, rows: int = 1) -> None:
        self.count, self.shift, self.rows = len(modes) // rows, shift, rows
        self.edge = self.count * (face.vertex_block + face.side_block)
        self.inside = len(modes) * face.side_block + (rows - 1) * self.edge + sum(modes)
        self.starts = np.cumsum([0, *(face.count + own for own in modes)])
        self.column = np.empty(self.starts[-1], dtype=np.int64)
        self.offset = np.zeros((self.starts[-1], 2))
        fixed = rows * self.edge + len(modes) * face.side_block
        for index, own in enumerate(modes):
            start = int(self.starts[index])
            self._tie(face, start, index)
            self.column[start + face.count : start + face.count + own] = fixed + np.arange(own)
            fixed += own

    def _tie(self, face: Interface, start: int, index: int) -> None:
        """The boundary of cell `index`, whose degrees of freedom begin at `start`."""
        row, index = divmod(index, self.count)
        block = face.vertex_block + face.side_block
        between = self.edge + self.rows * self.count * face.side_block  # where the edges between rows begin
        lines = [(row + dy) % self.rows for dy in (0, 1)]
        edges = [between + (line - 1) * self.edge if line else 0 for line in lines]
        along_y = [(face.vertex(corner), dx, dy, edges[dy], block) for corner, (dx, dy) in enumerate(OFFSETS)]
        along_y += [(face.side(2 + dy), 0, dy, edges[dy] + face.vertex_block, block) for dy in (0, 1)]
        inner = self.edge + row * self.count * face.side_block
        along_x = [(face.side(dx), dx, 0, inner, face.side_block) for dx in (0, 1)]
        for dofs, dx, dy, first, step in along_y + along_x:
            periods, place = divmod(index + dx - dy * self.shift, self.count)
            self.column[start + dofs] = first + place * step + np.arange(len(dofs))
            self.offset[start + dofs] = periods, (row + dy) // self.rows

    @property
    def dof(self) -> int:
        """Free degrees of freedom of the lattice."""
        return self.edge + self.inside

    def closed(self, phase: FloatArray) -> ComplexArray:
        """T (dof, free) of the lattice, at phases (2,) of a1 and a2."""
        return self._transform(self.column, phase, self.dof)

    @property
    def open_column(self) -> IntArray:
        """Master of each degree of freedom in a row left open, numbered [lower edge, upper edge, inside], (dof,)."""
        beyond = (self.offset[:, 1] > 0.0) | (self.column >= self.edge)
        return np.asarray(self.column + self.edge * beyond)

    def open(self, phase: FloatArray) -> ComplexArray:
        """T (dof, free) of the row left open, at phases (2,) of a1 and a2."""
        return self._transform(self.open_column, phase, self.dof + self.edge)

    def _transform(self, column: IntArray, phase: FloatArray, width: int) -> ComplexArray:
        out = np.zeros((len(column), width), dtype=complex)
        out[np.arange(len(column)), column] = np.exp(1j * self.offset @ phase)
        return out


def bubble_functions(s: FloatArray, degree: int) -> FloatArray:
    """Evaluate integrated Legendre polynomials of degree 2 to `degree`, zero at both ends of [-1, 1].

    Parameters
    ----------
    s : ndarray, shape (n,)
        Coordinates on [-1, 1].
    degree : int
        Highest degree; below 2 there are none.

    Returns
    -------
    ndarray, shape (n, degree - 1)
        Values (P_k - P_(k-2)) / sqrt(2 (2k - 1)), degree k of a column ascending from 2.

    References
    ----------
    .. [1] szabo1991 (docs/references.bib)
    """
    values = legendre.legvander(s, degree)
    return np.column_stack(
        [(values[:, k] - values[:, k - 2]) / np.sqrt(2.0 * (2 * k - 1)) for k in range(2, degree + 1)]
        or [np.empty((len(s), 0))]
    )


def through_functions(z: FloatArray, degree: int, joints: tuple[float, ...] = ()) -> FloatArray:
    """Evaluate the functions through the thickness: continuous, and polynomials of each layer; lower degrees come first.

    Parameters
    ----------
    z : ndarray, shape (n,)
        Coordinates on [-1, 1].
    degree : int
        Highest degree.
    joints : tuple of float, optional
        Places on (-1, 1) where layers meet, ascending.

    Returns
    -------
    ndarray, shape (n, layers * degree + 1)
        Legendre polynomials of one layer. Of several, 1, z and a kink at each joint, then bubbles of each layer, zero outside
        it, by degree.

    References
    ----------
    .. [1] szabo1991 (docs/references.bib)
    """
    if not joints:
        return np.asarray(legendre.legvander(z, degree))
    ends = np.array([-1.0, *joints, 1.0])
    kinks = np.abs(z[:, None] - np.array(joints)) - (1.0 - z[:, None] * np.array(joints))  # zero on both faces
    columns = [np.ones((len(z), 1)), z[:, None], kinks]
    own = np.clip(np.searchsorted(ends, z) - 1, 0, len(joints))
    local = 2.0 * (z - ends[own]) / np.diff(ends)[own] - 1.0
    bubbles = bubble_functions(local, degree)
    inside = own[:, None] == np.arange(len(joints) + 1)
    columns += [bubbles[:, [k]] * inside for k in range(degree - 1)]
    return np.hstack(columns)


@dataclass(frozen=True)
class ReductionSettings:
    """Settings of a panel's reduction: boundary degrees, fixed-interface modes up to top_hz, mesh, longest bare panel (m).

    bare_size_m: elements of panels without a pillar, where they may be longer than those about a foot. further: number of
    further degrees through the thickness, reduced only to estimate their effect; no plate is assembled from them.
    sparing: highest frequency, Hz, and relative change of a frequency up to which bare panels away from feet and supports do
    without some of the functions; None where all panels keep all of them.
    """

    interface: Interface
    top_hz: float
    hexahedra: HexSettings
    max_edge_m: float = 6e-3
    bare_size_m: float | None = None
    further: int = 0
    sparing: tuple[float, float] | None = field(default=None, repr=False)  # of plates: no cell depends on it

    @property
    def ample(self) -> Interface:
        """The boundary functions with those that only estimate the truncation error."""
        return replace(self.interface, through=self.interface.through + self.further)
