"""The outer surface of a body put together from parts: points in one place made one, faces inside left out, edges joined."""

from __future__ import annotations

import numpy as np
from scipy.spatial import cKDTree

from geometry.decimate import clusters, with_sides
from geometry.elements import BoolArray, FloatArray, IntArray

WELD = 1e-6  # of the body's size: points closer together are one
ON_EDGE = 1e-4  # of an edge's length: a vertex so near lies on it


def closed_surface(points: FloatArray, facets: IntArray, thickness_m: float | None = None) -> tuple[IntArray, IntArray]:
    """Indices (n,) of the points that stay and triangles (m, 3) between them, every edge of which belongs to two.

    points (p, 3) in m, facets (f, 3 or 4) of a whole body; `thickness_m`: of a plate, whose sides are closed where they are
    open. Facets that lie on one another are inside the body, as those on a plane about which its parts are mirrored. Edges are
    split at the vertices on them, where the grids of two parts differ. What the parts leave open otherwise stays open.
    """
    if thickness_m is not None:
        facets = with_sides(points, facets, thickness_m)
    same = clusters(points, WELD * float(np.ptp(points, axis=0).max()), points.mean(axis=0))
    _, kept = np.unique(same, return_index=True)
    welded = same[facets]
    triangles = _triangles(welded[~_inside(welded)])
    return kept, _stitched(points[kept], triangles)


def _inside(facets: IntArray) -> BoolArray:
    """Which facets share all of their corners with another one, (f,)."""
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
