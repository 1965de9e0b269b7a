"""The outer surface of a computed body, whole and closed, for pyvista."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from geometry import closed

if TYPE_CHECKING:
    from pipeline.analysis.modes import PartModes
    from pipeline.case.model import Case


def closed_surface(solved: PartModes, case: Case, index: int) -> Any:
    """A pyvista PolyData in m of the whole body in one mode; `displacement` (points, 3) has unit modal mass."""
    import pyvista

    row = solved.rows[index]
    vector = solved.vectors[row.symmetry][:, [row.column]]
    skin = solved.model.skin(row.symmetry, vector).unfolded(row.symmetry)
    kept, triangles = closed.closed_surface(
        skin.points, skin.facets, case.design.thickness_m if solved.part == "plate" else None
    )
    size = np.full((len(triangles), 1), 3)
    surface = pyvista.PolyData(np.asarray(skin.points[kept], dtype=float), np.hstack([size, triangles]).ravel())
    surface.point_data["displacement"] = skin.displacement[0, kept]
    if surface.n_open_edges:  # such as a clamped foot
        surface = surface.fill_holes(10.0 * surface.length)
    surface = surface.compute_normals(point_normals=False, auto_orient_normals=True)  # facets turned outwards
    surface.cell_data.clear()
    surface.field_data["frequency_hz"] = np.array([row.frequency_hz])
    return surface
