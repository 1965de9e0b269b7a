"""Symbolic Cholesky analysis: which degrees of freedom are alike, the elimination tree, and the exact size of L.

No entry of L is formed: the tree comes from a minimum spanning tree, the counts from sums over its subtrees.
"""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp
from scipy.sparse.csgraph import minimum_spanning_tree

from geometry.elements import FloatArray, IntArray


def alike(graph: sp.csc_array) -> tuple[IntArray, IntArray]:
    """Class of each DOF (n,) and members of each class (m,): degrees of freedom coupled to the same ones are alike.

    Columns are compared by sums of random 62-bit keys of their rows.
    """
    key = np.random.default_rng(0).integers(0, 2**62, graph.shape[0], dtype=np.uint64)
    filled = np.flatnonzero(np.diff(graph.indptr))
    sums = np.zeros(graph.shape[0], dtype=np.uint64)
    sums[filled] = np.add.reduceat(key[graph.indices], graph.indptr[filled])
    _, first, label, size = np.unique(sums, return_index=True, return_inverse=True, return_counts=True)
    by_place = np.argsort(first)  # keep the degrees of freedom's own order
    rank = np.empty_like(by_place)
    rank[by_place] = np.arange(len(by_place))
    return rank[label], size[by_place]


def quotient(graph: sp.csc_array, label: IntArray, count: int) -> sp.csc_array:
    """The graph between classes of alike degrees of freedom."""
    first = np.full(count, graph.shape[0])
    np.minimum.at(first, label, np.arange(len(label)))
    part = graph[:, first]
    column = np.repeat(np.arange(count), np.diff(part.indptr))
    ones = np.ones(len(column), dtype=np.int32)
    small = sp.csc_array(sp.coo_array((ones, (label[part.indices], column)), shape=(count, count)))
    small.data[:] = 1
    return small


def postordered(graph: sp.csc_array, place: IntArray, size: IntArray) -> tuple[IntArray, int]:
    """An order as good as the given one in which supernodes are contiguous, and the entries of L, diagonal included.

    place (m,) is each DOF's turn, size (m,) how many alike degrees of freedom it stands for. Exact but for cancellation.
    Row subtrees as in davis2006, section 4.5: each adds its size at its leaves and takes it off where two leaves meet
    and above its root, so that sums over the tree's subtrees are the column counts.
    """
    column = np.repeat(np.arange(graph.shape[1]), np.diff(graph.indptr))
    row, column = place[graph.indices], place[column]
    below = row > column
    row, column = row[below], column[below]
    weight = np.empty(len(size))
    weight[place] = size
    parent = _elimination_tree(row, column, len(size))
    turn, first = _postorder(parent)
    new_parent = np.full(len(parent), -1)
    has = parent >= 0
    new_parent[turn[has]] = turn[parent[has]]
    old = np.argsort(turn)
    weight = weight[old]
    counts = _column_counts(turn[row], turn[column], new_parent, first[old], weight)
    entries = float((weight * counts - weight * (weight - 1.0) / 2.0).sum())
    return turn[place], round(entries)


def _elimination_tree(row: IntArray, column: IntArray, count: int) -> IntArray:
    """Parent of every degree of freedom, -1 at roots.

    Vertices up to k are joined alike by the graph and by its minimum spanning tree under the weight max(i, j), and
    that is all the elimination tree asks: count - 1 edges instead of all.
    """
    weights = sp.csr_array((row + 1.0, (row, column)), shape=(count, count))
    tree = minimum_spanning_tree(weights).tocoo()
    order = np.argsort(tree.row, kind="stable")
    parent, ancestor = [-1] * count, [-1] * count
    for high, low in zip(tree.row[order].tolist(), tree.col[order].tolist(), strict=True):
        here = low
        while ancestor[here] not in (-1, high):
            ancestor[here], here = high, ancestor[here]
        if ancestor[here] == -1:
            ancestor[here] = parent[here] = high
    return np.array(parent, dtype=np.int64)


def _postorder(parent: IntArray) -> tuple[IntArray, IntArray]:
    """Turn of every vertex in a postorder, and the turn of the first vertex of its subtree."""
    count = len(parent)
    size = [1] * count
    above = parent.tolist()
    for vertex, up in enumerate(above):  # parents come after their children
        if up >= 0:
            size[up] += size[vertex]
    first, used = [0] * count, [0] * (count + 1)
    for vertex in range(count - 1, -1, -1):
        up = above[vertex]  # -1 is the slot of the roots
        start = first[up] if up >= 0 else 0
        first[vertex] = start + used[up]
        used[up] += size[vertex]
    begins = np.array(first, dtype=np.int64)
    return begins + np.array(size, dtype=np.int64) - 1, begins


def _column_counts(
    row: IntArray, column: IntArray, parent: IntArray, first: IntArray, weight: FloatArray
) -> FloatArray:
    """Weighted entries of each column of L, diagonal included, everything in postorder."""
    order = np.lexsort((column, row))
    row, column = row[order], column[order]
    before = np.where(np.diff(row, prepend=-1) == 0, np.concatenate([[-1], column[:-1]]), -1)
    leaf = first[column] > before  # nothing of the row lies in the subtree below it
    row, column, before = row[leaf], column[leaf], before[leaf]
    change = weight.copy()
    has_leaf = np.zeros(len(parent), dtype=bool)
    has_leaf[row] = True
    change[has_leaf] = 0.0  # the row's own vertex is the root of its subtree, and a leaf only when alone
    np.add.at(change, column, weight[row])
    pair = before >= 0
    np.subtract.at(change, _meeting(before[pair], column[pair], parent), weight[row[pair]])
    below_root = parent >= 0
    np.subtract.at(change, parent[below_root], weight[below_root])
    total = np.concatenate([[0.0], np.cumsum(change)])
    return np.asarray(total[1:] - total[first])


def _meeting(low: IntArray, high: IntArray, parent: IntArray) -> IntArray:
    """Lowest common ancestors of low < high in postorder: above the shallowest vertex of low ... high - 1."""
    count = len(parent)
    depth = np.zeros(count, dtype=np.int64)
    for vertex, up in zip(range(count - 1, -1, -1), parent[::-1].tolist(), strict=True):
        depth[vertex] = depth[up] + 1 if up >= 0 else 0
    level = depth * (count + 1) + parent + 1  # the smallest one carries the parent
    answer = np.empty(len(low), dtype=np.int64)
    power = np.floor(np.log2(np.maximum(high - low, 1))).astype(np.int64)
    for k in range(int(power.max(initial=0)) + 1):
        here = power == k
        span = np.minimum(level[low[here]], level[high[here] - 2**k])
        answer[here] = span % (count + 1) - 1
        level = np.minimum(level[: -(2**k)], level[2**k :]) if len(level) > 2**k else level
    return answer
