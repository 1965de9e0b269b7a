"""The mirror x <-> y of a square cell: which node is whose image, whether the body really is its own image, and its halves.

What the mirror leaves alone and what it turns over do not mix: K and M fall into two blocks of half the size.
"""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp
from scipy.spatial import cKDTree

from geometry.elements import BoolArray, FloatArray, IntArray
from solvers.fem.assembly import System
from solvers.fem.constraints import mass_rows
from solvers.fem.eigen import PlainPencil

SAME = 1e-9  # of the largest coordinate; of a force


def diagonal_mirror(system: System) -> IntArray | None:
    """Image of every node under (x, y, z) -> (y, x, z), shape (n,), or None where the mirror changes the body.

    The nodes must fall on nodes, and K and M must act on the image of a generic field as on the field itself.
    """
    nodes = system.mesh.nodes
    distance, image = cKDTree(nodes).query(nodes[:, [1, 0, 2]])
    if distance.max() > SAME * np.abs(nodes).max() or len(np.unique(image)) != len(image):
        return None
    field = np.sin(1.0 + np.arange(nodes.size) * 1.618).reshape(nodes.shape)
    force = (system.stiffness @ field.ravel()).reshape(field.shape)
    turned = (system.stiffness @ _turned(field, image).ravel()).reshape(field.shape)
    alike = np.abs(_turned(force, image) - turned).max() <= SAME * np.abs(force).max()
    heavy = system.mass @ field
    weighs = np.abs(_turned(heavy, image) - system.mass @ _turned(field, image)).max() <= SAME * np.abs(heavy).max()
    return np.asarray(image, dtype=np.int64) if alike and weighs else None


def _turned(field: FloatArray, image: IntArray) -> FloatArray:
    return field[image][:, [1, 0, 2]]


class DiagonalSector:
    """Fields u = F v that the mirror leaves alone (sign 1) or turns over (-1), F'F = 1, with K and M of v.

    image (n,) as diagonal_mirror gives it, inside (n, 3) the free degrees of freedom, alike under the mirror.
    """

    def __init__(self, system: System, image: IntArray, inside: BoolArray, sign: int) -> None:
        own = np.flatnonzero(inside.ravel())
        partner = (3 * image[:, None] + np.array([1, 0, 2])).ravel()[own]
        first = own < partner if sign < 0 else own <= partner
        self.first, partner = own[first], partner[first]
        alone = self.first == partner
        pair, columns = np.flatnonzero(~alone), np.arange(len(partner))
        rows = np.concatenate([self.first, partner[pair]])
        weight = np.where(alone, 1.0, np.sqrt(0.5))
        entries = np.concatenate([weight, sign * weight[pair]])
        shape = (3 * len(image), len(partner))
        self.fold = sp.csr_array((entries, (rows, np.concatenate([columns, pair]))), shape=shape)
        self.members = np.where(alone, 1.0, np.sqrt(2.0))  # F'w of a field w that is alike under the mirror
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

    def gathered(self, field: FloatArray) -> FloatArray:
        """F'w of fields (3n, k) that belong to this half."""
        return np.asarray(field[self.first] * self.members[:, None])
