"""The mirror x <-> y of a square cell: which node is whose image, and whether the body really is its own image."""

from __future__ import annotations

import numpy as np
from scipy.spatial import cKDTree

from geometry.elements import FloatArray, IntArray
from solvers.fem.assembly import System

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
