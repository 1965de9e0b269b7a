"""Fields prolonged from a mesh of boxes to a finer one that is nested in the same lines."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from geometry.elements import FloatArray, IntArray, gauss_lobatto
from geometry.errors import MeshError
from geometry.hex.boxes import Boxes, nodal_line, used_nodes

if TYPE_CHECKING:
    from scipy.sparse import csr_array

SAME = 1e-9  # a weight below is zero: the point lies on a node or on a line of the coarse grid


def interpolation(coarse: Boxes, fine: Boxes, order: int, coarse_order: int | None = None) -> csr_array:
    """Matrix (fine nodes, coarse nodes) that carries a field exactly from a mesh of boxes to one of `order` nested in it.

    Raises MeshError where the coarse mesh does not cover a node of the fine one.
    """
    lower = coarse_order or order
    lines = [
        _along_a_line(one, other, lower, order)
        for one, other in zip((coarse.x, coarse.y, coarse.z), (fine.x, fine.y, fine.z), strict=True)
    ]
    own, theirs = used_nodes(fine, order), used_nodes(coarse, lower)
    counts = [len(line[0]) for line in lines]
    columns, weights = np.zeros((len(own), 1), dtype=np.int64), np.ones((len(own), 1))
    stride = 1
    for axis, place in enumerate((own % counts[0], own // counts[0] % counts[1], own // (counts[0] * counts[1]))):
        index, weight, size = lines[axis]
        columns = (columns[:, :, None] + stride * index[place][:, None, :]).reshape(len(own), -1)
        weights = (weights[:, :, None] * weight[place][:, None, :]).reshape(len(own), -1)
        stride *= size
    row, entry = np.nonzero(np.abs(weights) > SAME)
    known = np.minimum(np.searchsorted(theirs, columns[row, entry]), len(theirs) - 1)
    if (theirs[known] != columns[row, entry]).any():
        raise MeshError("a mesh is not nested in the coarser one: a node lies where that has no element")
    from scipy.sparse import csr_array  # slow to import, and of no use to a plan

    return csr_array((weights[row, entry], (row, known)), shape=(len(own), len(theirs)))


def _along_a_line(
    coarse: FloatArray, fine: FloatArray, order: int, fine_order: int
) -> tuple[IntArray, FloatArray, int]:
    """Coarse nodes and weights (fine nodes, order + 1) along one axis, and the number of coarse nodes."""
    inner, points = (gauss_lobatto(order) + 1.0) / 2.0, nodal_line(fine, fine_order)
    element = np.clip(np.searchsorted(coarse, points, side="right") - 1, 0, len(coarse) - 2)
    local = (points - coarse[element]) / np.diff(coarse)[element]
    if local.min() < -SAME or local.max() > 1.0 + SAME:
        raise MeshError("a mesh is not nested in the coarser one: it reaches beyond it")
    others = [np.delete(inner, i) for i in range(order + 1)]
    weights = np.stack(
        [
            np.prod((local[:, None] - other_nodes) / (inner[i] - other_nodes), axis=1)
            for i, other_nodes in enumerate(others)
        ],
        axis=1,
    )
    return order * element[:, None] + np.arange(order + 1), weights, order * (len(coarse) - 1) + 1
