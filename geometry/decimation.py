"""Surfaces to display: the outer surface of a body assembled from parts, and coarser triangulations of it."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from geometry.elements import BoolArray, FloatArray, IntArray

if TYPE_CHECKING:
    from scipy.spatial import cKDTree

# -- coarser surfaces --------------------------------------------------------------------------------------------------
# A coarser surface to display on a page: vertices clustered on a grid, edges and corners of the body kept
# (rossignac1993).

SAME = 1e-6  # of the body's size: vertices closer together are one
GROWTH = 1.12


def coarse(points: FloatArray, facets: IntArray, most: int) -> tuple[IntArray, IntArray]:
    """Coarsen a surface by clustering its vertices on a grid.

    Each cluster is shown by its sharpest vertex, so edges and the rim of an open surface stay in place. A quadrangle
    that loses one corner repeats its last corner; one that loses two is removed.

    Parameters
    ----------
    points : ndarray, shape (p, 3)
        Vertices, in any unit.
    facets : ndarray, shape (f, 3) or (f, 4)
        Vertices of each facet.
    most : int
        Largest number of remaining vertices.

    Returns
    -------
    kept : ndarray, shape (n,)
        Indices of the remaining vertices, at which a field keeps its values.
    facets : ndarray, shape (m, 3) or (m, 4)
        Facets, as indices into `kept`.

    References
    ----------
    .. [1] rossignac1993 (docs/references.bib)
    """
    extent = float(np.ptp(points, axis=0).max())
    middle, sharp = points.mean(axis=0), None
    step = SAME * extent
    while True:
        cluster = _clusters(points, step, middle)
        if cluster.max(initial=-1) < most:
            break
        if sharp is None:
            sharp = _sharpness(points[_first(cluster)], cluster[facets])
            points_of = cluster
            step = float(np.sqrt(_area(points, facets) / most)) / GROWTH
        step *= GROWTH
    weight = np.zeros(len(points)) if sharp is None else sharp[points_of]
    kept = _sharpest(points, cluster, weight)
    return kept, _joined(cluster[facets])


def with_sides(points: FloatArray, facets: IntArray, thickness_m: float) -> IntArray:
    """Close the sides of a plate's skin where it is open between z = 0 and the thickness.

    An edge of the lower rim on an outer side is joined to the edge of the upper rim straight above it. Without such an
    edge, the skin stays open.

    Parameters
    ----------
    points : ndarray, shape (p, 3)
        Vertices in m, the plate's lower face at z = 0.
    facets : ndarray, shape (f, 3) or (f, 4)
        Vertices of each facet.
    thickness_m : float
        Thickness of the plate in m.

    Returns
    -------
    ndarray, shape (m, 3) or (m, 4)
        The facets, followed by those that close the sides.
    """
    step = SAME * float(np.ptp(points, axis=0).max())
    same = _clusters(points, step, points.mean(axis=0))
    first = _first(same)
    place = points[first]
    edges, _ = _rim(same[facets])
    outer = np.abs(place[:, :2]) > np.abs(place[:, :2]).max(axis=0) - step
    edges = edges[outer[edges].all(axis=1).any(axis=1)]
    key = [tuple(row) for row in np.round(place[:, :2] / step).astype(np.int64)]
    level = np.round(place[:, 2] / step).astype(np.int64)
    top = {key[node]: node for node in np.unique(edges) if level[node] == round(thickness_m / step)}
    above = {frozenset(pair) for pair in edges.tolist()}
    closed = []
    for low, high in edges[(level[edges] == 0).all(axis=1)].tolist():
        pair = (top.get(key[low]), top.get(key[high]))
        if None not in pair and frozenset(pair) in above:
            closed.append([high, low, *pair])
    if not closed:
        return facets
    quads = first[np.array(closed)]
    added = quads if facets.shape[1] == 4 else np.concatenate([quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]])
    return np.concatenate([facets, added])


def _clusters(points: FloatArray, step: float, middle: FloatArray) -> IntArray:
    """Number of the grid box that each point lies in; the middle of the body is the middle of a box."""
    boxes = np.floor((points - middle) / step + 0.5).astype(np.int64)
    boxes -= boxes.min(axis=0)
    size = boxes.max(axis=0) + 1
    flat = (boxes[:, 0] * size[1] + boxes[:, 1]) * size[2] + boxes[:, 2]
    return np.asarray(np.unique(flat, return_inverse=True)[1].reshape(-1))


def _first(cluster: IntArray) -> IntArray:
    return np.asarray(np.unique(cluster, return_index=True)[1])


def _area(points: FloatArray, facets: IntArray) -> float:
    corners = points[facets]
    one, two = corners[:, 2] - corners[:, 0], corners[:, -1] - corners[:, 1]
    return float(np.linalg.norm(np.cross(one, two), axis=1).sum() / 2.0)


def _sharpness(points: FloatArray, facets: IntArray) -> FloatArray:
    """Deviation of the facets at each point from one plane: 0 on a flat, more on an edge or a rim, most in a corner."""
    corners = points[facets]
    normal = _unit(np.cross(corners[:, 2] - corners[:, 0], corners[:, -1] - corners[:, 1]))
    spread = np.zeros((len(points), 3, 3))
    for corner in facets.T:
        np.add.at(spread, corner, normal[:, :, None] * normal[:, None, :])
    ends, owner = _rim(facets)
    outward = _unit(np.cross(points[ends[:, 1]] - points[ends[:, 0]], normal[owner]))
    for end in ends.T:
        np.add.at(spread, end, outward[:, :, None] * outward[:, None, :])
    # Mean of n n' over the normals n around a vertex: its largest eigenvalue is 1 where they are parallel, less otherwise.
    # At a rim, the outward normal within the facet counts as one more direction.
    spread /= np.maximum(np.trace(spread, axis1=1, axis2=2), 1e-300)[:, None, None]
    return np.asarray(np.round(1.0 - np.linalg.eigvalsh(spread)[:, 2], 3))


def _rim(facets: IntArray) -> tuple[IntArray, IntArray]:
    """Edges (e, 2) that belong to a single facet, and that facet: the boundary of an open surface."""
    count = facets.shape[1]
    edges = np.stack([facets, np.roll(facets, -1, axis=1)], axis=-1).reshape(-1, 2).astype(np.int64)
    low, high = edges.min(axis=1), edges.max(axis=1)
    _, index, times = np.unique(low * (facets.max() + 1) + high, return_index=True, return_counts=True)
    alone = index[(times == 1) & (low[index] != high[index])]
    return edges[alone], alone // count


def _unit(vectors: FloatArray) -> FloatArray:
    return np.asarray(vectors / np.maximum(np.linalg.norm(vectors, axis=1, keepdims=True), 1e-300))


def _sharpest(points: FloatArray, cluster: IntArray, weight: FloatArray) -> IntArray:
    """One point of each cluster: the sharpest, of equals the nearest to their middle."""
    count = int(cluster.max(initial=-1)) + 1
    members = np.maximum(np.bincount(cluster, minlength=count), 1)
    middle = np.column_stack([np.bincount(cluster, points[:, i], count) for i in range(3)]) / members[:, None]
    distance = np.linalg.norm(points - middle[cluster], axis=1)
    order = np.lexsort((distance, -weight, cluster))
    return np.asarray(order[_first(cluster[order])])


def _joined(facets: IntArray) -> IntArray:
    """Facets without repeated corners; a quadrangle with three different ones repeats the last."""
    if facets.shape[1] == 3:
        alive = (facets != np.roll(facets, 1, axis=1)).all(axis=1)
        return np.asarray(facets[alive])
    same = facets == np.roll(facets, -1, axis=1)  # corner i equals corner i + 1
    crossed = (facets[:, 0] == facets[:, 2]) | (facets[:, 1] == facets[:, 3])
    whole, three = ~same.any(axis=1) & ~crossed, (same.sum(axis=1) == 1) & ~crossed
    place = np.argmax(same[three], axis=1)
    turned = np.take_along_axis(facets[three], (place[:, None] + 1 + np.arange(4)) % 4, axis=1)
    turned[:, 3] = turned[:, 2]  # its last corner was the first once more
    return np.concatenate([facets[whole], turned])


# -- one closed surface ------------------------------------------------------------------------------------------------
# The outer surface of a body assembled from parts: coincident points merged, internal faces removed, edges joined.

WELD = 1e-6  # of the body's size: points closer together are one
ON_EDGE = 1e-4  # of an edge's length: a vertex so near lies on it


def closed_surface(points: FloatArray, facets: IntArray, thickness_m: float | None = None) -> tuple[IntArray, IntArray]:
    """Join the surfaces of a body's parts into one closed triangulation.

    Facets that coincide lie inside the body, such as those on a mirror plane between two parts, and are removed. Where
    the grids of two parts differ, edges are split at the vertices on them. Other openings stay open.

    Parameters
    ----------
    points : ndarray, shape (p, 3)
        Vertices in m.
    facets : ndarray, shape (f, 3) or (f, 4)
        Vertices of each facet of the whole body.
    thickness_m : float, optional
        Thickness of a plate in m, whose open sides are closed first.

    Returns
    -------
    kept : ndarray, shape (n,)
        Indices of the remaining vertices.
    triangles : ndarray, shape (m, 3)
        Triangles, as indices into `kept`; two of them share every edge.
    """
    if thickness_m is not None:
        facets = with_sides(points, facets, thickness_m)
    same = _clusters(points, WELD * float(np.ptp(points, axis=0).max()), points.mean(axis=0))
    _, kept = np.unique(same, return_index=True)
    welded = same[facets]
    triangles = _triangles(welded[~_inside(welded)])
    return kept, _stitched(points[kept], triangles)


def _inside(facets: IntArray) -> BoolArray:
    """Mask of the facets that share all of their corners with another one, (f,)."""
    _, which, times = np.unique(np.sort(facets, axis=1), axis=0, return_inverse=True, return_counts=True)
    return np.asarray(times[which.ravel()] > 1)


def _triangles(facets: IntArray) -> IntArray:
    """Triangles (m, 3) of facets, without those that welding made flat."""
    if facets.shape[1] == 4:
        facets = np.concatenate([facets[:, [0, 1, 2]], facets[:, [0, 2, 3]]])
    return np.asarray(facets[(facets != np.roll(facets, 1, axis=1)).all(axis=1)])


def _stitched(points: FloatArray, triangles: IntArray) -> IntArray:
    """The triangles with every open edge split at the open vertices that lie on it."""
    edges = np.stack([triangles, np.roll(triangles, -1, axis=1)], axis=-1).reshape(-1, 2)
    _, index, times = np.unique(np.sort(edges, axis=1), axis=0, return_index=True, return_counts=True)
    alone = index[times == 1]
    hanging = np.unique(edges[alone])
    if not len(alone):
        return triangles
    from scipy.spatial import cKDTree  # slow to import

    splits: dict[int, dict[int, list[int]]] = {}
    tree = cKDTree(points[hanging])
    for at in alone.tolist():
        on = _on_edge(points, edges[at], hanging, tree)
        if on:
            splits.setdefault(at // 3, {})[at % 3] = on
    faces = [np.delete(triangles, list(splits), axis=0)]
    for which, sides in splits.items():
        rim = [node for side in range(3) for node in (int(triangles[which, side]), *sides.get(side, []))]
        faces.append(_fan(points, rim))
    return np.concatenate(faces)


def _on_edge(points: FloatArray, edge: IntArray, hanging: IntArray, tree: cKDTree) -> list[int]:
    """Hanging vertices strictly inside an edge, in order from its start."""
    start, end = points[edge]
    length = float(np.linalg.norm(end - start))
    near = hanging[tree.query_ball_point((start + end) / 2.0, length / 2.0 * (1.0 + WELD))]
    along = (points[near] - start) @ (end - start) / length**2
    off = np.linalg.norm(points[near] - start - along[:, None] * (end - start), axis=1)
    inside = (along > WELD) & (along < 1.0 - WELD) & (off < ON_EDGE * length)
    return [int(node) for node in near[inside][np.argsort(along[inside])]]


def _fan(points: FloatArray, rim: list[int]) -> IntArray:
    """Triangles about the middle-most corner of a convex rim with vertices along its sides; none of them is flat."""
    best: list[tuple[int, int, int]] = []
    for turn in range(len(rim)):
        at = rim[turn:] + rim[:turn]
        fan = [(at[0], at[i], at[i + 1]) for i in range(1, len(at) - 1)]
        corners = points[np.array(fan)]
        area = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1)
        if area.min() > WELD * area.max():
            return np.array(fan)
        best = best or fan
    return np.array(best)
