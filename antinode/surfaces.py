"""The outer surface of a computed body, whole and closed, for pyvista."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from scipy.spatial import cKDTree

from geometry.decimate import with_sides
from solvers.fem.surface import Skin

if TYPE_CHECKING:
    from pipeline.analysis.modes import PartModes
    from pipeline.case.model import Case

WELD = 1e-6  # of the body's size: points closer together are one


def closed_surface(solved: PartModes, case: Case, index: int) -> Any:
    """A pyvista PolyData in m of the whole body in one mode; `displacement` (points, 3) has unit modal mass."""
    import pyvista

    row = solved.rows[index]
    vector = solved.vectors[row.symmetry][:, [row.column]]
    skin = _without_planes(solved.model.skin(row.symmetry, vector), row.symmetry).unfolded(row.symmetry)
    facets = with_sides(skin.points, skin.facets, case.design.thickness_m) if solved.part == "plate" else skin.facets
    size = np.full((len(facets), 1), facets.shape[1])
    surface = pyvista.PolyData(np.asarray(skin.points, dtype=float), np.hstack([size, facets]).ravel())
    surface.point_data["displacement"] = skin.displacement[0]
    surface = _stitched(surface.triangulate().clean(tolerance=WELD, absolute=False))
    if surface.n_open_edges:  # such as a clamped foot
        surface = surface.fill_holes(10.0 * surface.length)
    surface = surface.compute_normals(point_normals=False, auto_orient_normals=True)  # facets turned outwards
    surface.cell_data.clear()
    surface.field_data["frequency_hz"] = np.array([row.frequency_hz])
    return surface


def _stitched(surface: Any) -> Any:
    """The surface with every open edge split at the open vertices that lie on it: panels side by side differ in their grids."""
    import pyvista

    points, triangles = np.asarray(surface.points), np.asarray(surface.faces).reshape(-1, 4)[:, 1:]
    edges = np.stack([triangles, np.roll(triangles, -1, axis=1)], axis=-1).reshape(-1, 2)
    _, index, times = np.unique(np.sort(edges, axis=1), axis=0, return_index=True, return_counts=True)
    alone = index[times == 1]
    hanging = np.unique(edges[alone])
    splits: dict[int, dict[int, list[int]]] = {}
    tree = cKDTree(points[hanging])
    for at in alone.tolist():
        on = _on_edge(points, edges[at], hanging, tree)
        if len(on):
            splits.setdefault(at // 3, {})[at % 3] = on
    faces = [triangles[[i for i in range(len(triangles)) if i not in splits]]]
    for which, sides in splits.items():
        rim = [node for side in range(3) for node in (int(triangles[which, side]), *sides.get(side, []))]
        faces.append(_fan(points, rim))
    all_faces = np.concatenate(faces)
    whole = pyvista.PolyData(points, np.hstack([np.full((len(all_faces), 1), 3), all_faces]).ravel())
    whole.point_data["displacement"] = surface.point_data["displacement"]
    return whole


def _on_edge(points: Any, edge: Any, hanging: Any, tree: cKDTree) -> list[int]:
    """Hanging vertices strictly inside an edge, in order from its start."""
    start, end = points[edge]
    length = float(np.linalg.norm(end - start))
    near = hanging[tree.query_ball_point((start + end) / 2.0, length / 2.0 * (1.0 + WELD))]
    along = (points[near] - start) @ (end - start) / length**2
    off = np.linalg.norm(points[near] - start - along[:, None] * (end - start), axis=1)
    inside = (along > WELD) & (along < 1.0 - WELD) & (off < WELD * max(length, 1e-12) * 100.0)
    return [int(node) for node in near[inside][np.argsort(along[inside])]]


def _fan(points: Any, rim: list[int]) -> Any:
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


def _without_planes(skin: Skin, symmetry: str | None) -> Skin:
    """The skin of a quarter without its faces on the mirror planes, which lie inside the whole body."""
    inside = np.zeros(len(skin.facets), dtype=bool)
    for axis in range(len(symmetry or "")):
        flat = np.abs(skin.points[:, axis]) < WELD * float(np.ptp(skin.points, axis=0).max())
        inside |= flat[skin.facets].all(axis=1)
    return Skin(skin.points, skin.facets[~inside], skin.displacement)
