"""Symmetries of a cell: the mirror x <-> y of its mesh, and the half turn that makes its Bloch waves real."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp

from geometry.elements import BoolArray, ComplexArray, FloatArray, IntArray
from geometry.mesh import AnyMesh
from solvers.fem.assembly import System
from solvers.fem.eigen import PlainPencil
from solvers.fem.solid import mass_rows
from solvers.superelement.cell import Cell

# -- diagonal mirror ---------------------------------------------------------------------------------------------------
# The mirror x <-> y of a square cell: which node is whose image, whether the body really is its own image, and its
# halves.
# Fields that the mirror leaves alone and those it turns over do not mix: K and M fall into two blocks of half the size.

SAME = 1e-9  # of the largest coordinate; of a force


def diagonal_mirror(system: System) -> IntArray | None:
    """Find the image of every node under the mirror (x, y, z) -> (y, x, z), if the body is its own image.

    The nodes must fall on nodes, and K and M must act on the image of a generic field as on the field itself.

    Parameters
    ----------
    system : System
        Assembled matrices and mesh of the body.

    Returns
    -------
    ndarray, shape (n,), or None
        Number of each node's image; None where the mirror changes the body.
    """
    image = diagonal_image(system.mesh)
    if image is None:
        return None
    nodes = system.mesh.nodes
    field = np.sin(1.0 + np.arange(nodes.size) * 1.618).reshape(nodes.shape)
    force = (system.stiffness @ field.ravel()).reshape(field.shape)
    turned = (system.stiffness @ _turned(field, image).ravel()).reshape(field.shape)
    alike = np.abs(_turned(force, image) - turned).max() <= SAME * np.abs(force).max()
    heavy = system.mass @ field
    weighs = np.abs(_turned(heavy, image) - system.mass @ _turned(field, image)).max() <= SAME * np.abs(heavy).max()
    return image if alike and weighs else None


def diagonal_image(mesh: AnyMesh) -> IntArray | None:
    """Find the image of every node of a mesh under the mirror (x, y, z) -> (y, x, z).

    Parameters
    ----------
    mesh : AnyMesh
        Materials and connectivity are not compared.

    Returns
    -------
    ndarray, shape (n,), or None
        Number of each node's image; None where nodes do not fall on nodes.
    """
    nodes, turned = mesh.nodes, mesh.nodes[:, [1, 0, 2]]
    allowed = SAME * np.abs(nodes).max()
    image = _in_order(nodes, turned, allowed)
    if np.abs(nodes[image] - turned).max() > allowed:  # coordinates that round to either side, or no mirror image
        from scipy.spatial import cKDTree  # slow to import

        distance, image = cKDTree(nodes).query(turned)
        if distance.max() > allowed or len(np.unique(image)) != len(image):
            return None
    return np.asarray(image, dtype=np.int64)


def _in_order(nodes: FloatArray, others: FloatArray, step: float) -> IntArray:
    """Node at the place of each of the others, (n,), with both sorted by coordinates rounded to a step."""
    first, second = (np.lexsort(np.round(points / step).T) for points in (nodes, others))
    image = np.empty(len(nodes), dtype=np.int64)
    image[second] = first
    return image


def _turned(field: FloatArray, image: IntArray) -> FloatArray:
    return field[image][:, [1, 0, 2]]


def _pairs(image: IntArray, inside: BoolArray, sign: int) -> tuple[IntArray, IntArray]:
    """The first degree of freedom of every pair and its partner, itself where it is its own image and the sign allows it."""
    own = np.flatnonzero(inside.ravel())
    partner = (3 * image[:, None] + np.array([1, 0, 2])).ravel()[own]
    first = own < partner if sign < 0 else own <= partner
    return own[first], partner[first]


def diagonal_folding(image: IntArray, inside: BoolArray, sign: int) -> sp.csr_array:
    """Return F with F'F = 1 such that u = F v are the fields of one parity under the mirror x <-> y.

    Parameters
    ----------
    image : ndarray, shape (n,)
        Number of each node's image, as of `diagonal_image`.
    inside : ndarray, shape (n, 3)
        Mask of the free degrees of freedom; the mirror must map it onto itself.
    sign : int
        1 for fields that the mirror leaves alone, -1 for those whose sign it changes.

    Returns
    -------
    csr_array, shape (3n, m)
        One column per pair of images: both with weights sqrt(1/2), or 1 for a degree of freedom that is its own image.
    """
    first, partner = _pairs(image, inside, sign)
    alone = first == partner
    pair, columns = np.flatnonzero(~alone), np.arange(len(partner))
    rows = np.concatenate([first, partner[pair]])
    weight = np.where(alone, 1.0, np.sqrt(0.5))
    entries = np.concatenate([weight, sign * weight[pair]])
    return sp.csr_array((entries, (rows, np.concatenate([columns, pair]))), shape=(3 * len(image), len(partner)))


class DiagonalSector:
    """Fields u = F v that the mirror leaves alone (sign 1) or turns over (-1), F'F = 1, with K and M of v.

    image (n,) as diagonal_mirror gives it, inside (n, 3) the free degrees of freedom, alike under the mirror.
    """

    def __init__(self, system: System, image: IntArray, inside: BoolArray, sign: int) -> None:
        self.first, partner = _pairs(image, inside, sign)
        self.fold = diagonal_folding(image, inside, sign)
        # F'w of a field w that is alike under the mirror
        self.members = np.where(self.first == partner, 1.0, np.sqrt(2.0))
        self.pencil = PlainPencil(
            self._folded(sp.csr_array(system.stiffness[self.first])),
            self._folded(mass_rows(system, self.first)),
            system.scale,
        )

    def _folded(self, first: sp.csr_array) -> sp.csc_array:
        """F'AF from A's rows of the first of every pair: the second's say the same."""
        rows = sp.csr_array(first @ self.fold)
        rows.data *= np.repeat(self.members, np.diff(rows.indptr))
        rows.sort_indices()
        return sp.csc_array((rows.data, rows.indices, rows.indptr), shape=rows.shape)

    def spread(self, vectors: FloatArray) -> FloatArray:
        """F v at every node, (3n, k)."""
        return np.asarray(self.fold @ vectors)

    def restrict(self, field: FloatArray) -> FloatArray:
        """F'w of fields (3n, k) that belong to this half."""
        return np.asarray(field[self.first] * self.members[:, None])


# -- half turn ---------------------------------------------------------------------------------------------------------
# Bloch waves made real by a half turn about the cell's middle: a third of the time of a Hermitian pencil's dense solve.
# Half a turn takes k to -k, conjugation (time reversal) takes it back, so that both together leave the waves at k
# among themselves; degrees of freedom that they leave alone have real K and M (wigner1932).

REAL = 1e-9  # of the pencil's largest entry: an imaginary part that is rounding


@dataclass(frozen=True)
class C2Symmetry:
    """v = D w with real w, D = diag(exp(-i k.c) s): c (dof, 2) in m, s (dof,) of 1 or i.

    The turn takes a side's DOF to the opposite side, times its sign: c is half the step between the two, s makes the
    sign 1.
    """

    middle_m: FloatArray
    factor: ComplexArray

    def diagonal(self, wavevector: FloatArray) -> ComplexArray:
        """D at a wavevector (2,) in rad/m, (dof,)."""
        return np.asarray(np.exp(-1j * self.middle_m @ np.asarray(wavevector, dtype=float)) * self.factor)

    def turned(self, matrix: ComplexArray, wavevector: FloatArray) -> ComplexArray:
        """D^H A D."""
        diagonal = self.diagonal(wavevector)
        return np.asarray(diagonal.conj()[:, None] * matrix * diagonal)

    def is_real(self, matrix: ComplexArray, wavevector: FloatArray) -> bool:
        """Whether D^H A D is real but for rounding."""
        turned = self.turned(matrix, wavevector)
        return bool(np.abs(turned.imag).max() <= REAL * np.abs(turned).max())


def c2_symmetry(cell: Cell, column: IntArray, offset: FloatArray) -> C2Symmetry | None:
    """Find the half turn of a lattice's free degrees of freedom.

    Parameters
    ----------
    cell : Cell
        The reduced cell of the lattice.
    column : ndarray, shape (cell dof,)
        Free degree of freedom that each of the cell's follows.
    offset : ndarray, shape (cell dof, 2)
        Number of pitches along x and y from that one to the cell's.

    Returns
    -------
    C2Symmetry or None
        None where the parity of a fixed-interface mode is unknown; that it makes K and M real must be checked.

    References
    ----------
    .. [1] wigner1932 (docs/references.bib)
    """
    parity = cell.fixed_parity.prod(axis=1)
    if not parity.all():
        return None
    face, sign = cell.interface, np.empty(cell.dof)
    (_, one), (where, other) = face.mirror(0), face.mirror(1)
    sign[: face.count], sign[face.count :] = other * one[where], parity
    own, middle = np.empty(column.max() + 1), np.zeros((column.max() + 1, 2))
    first = offset.sum(axis=1) == 0.0
    own[column[first]] = sign[first]
    np.maximum.at(middle, column, offset)
    return C2Symmetry(middle @ cell.vectors_m / 2.0, np.where(own > 0.0, 1.0 + 0.0j, 1.0j))
