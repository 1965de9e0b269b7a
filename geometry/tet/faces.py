"""Named faces of a tetrahedral mesh, told by the CAD plane their triangles lie on."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from geometry.cad.solids import Body, Box
from geometry.cad.surface import CadSurface
from geometry.elements import BoolArray, FloatArray, IntArray
from geometry.mesh import Mesh
from geometry.tet.snapping import Boundary

MM = 1e3
SAME_PLANE_MM = 1e-6
Plane = tuple[int, float]


def named_faces(
    mesh: Mesh, body: Body, boundary: Boundary, surface: CadSurface, extra: Mapping[str, Plane]
) -> dict[str, IntArray]:
    """Face nodes (m, 3 or 6) by name: sides of the box, touch, back, foot, top, both faces of each patch, and `extra`.

    `back` ends where pillars and patches stand; `touch` goes on under patches, not where pillars hang. A face between bonded
    parts is listed once, outward of the plate.
    """
    nodes = mesh.cells[boundary.cell[:, None], mesh.element.facets[0][boundary.local]]
    planes = _planes(body, surface) | {name: (axis, MM * at) for name, (axis, at) in extra.items()}
    centres = mesh.nodes[nodes[:, :3]].mean(axis=1)
    faces, over = {}, [_over(box, centres) for box in body.patches]
    seen = {"back": ~boundary.inner, "touch": ~boundary.inner | np.any(over, axis=0)}
    for name, plane in planes.items():
        on = _on(plane, boundary, surface) & seen.get(name, True)
        if on.any():
            faces[name] = nodes[on]
    for box, there in zip(body.patches, over, strict=True):
        for sign, z in (("-", box.low[2]), ("+", box.high[2])):
            faces[f"patch{box.number}{sign}"] = nodes[_on((2, MM * z), boundary, surface) & there]
    return faces


def _over(box: Box, centres: FloatArray) -> BoolArray:
    """Which places (n, 3), m, lie in a box's outline."""
    inside = (centres[:, :2] > np.array(box.low[:2])) & (centres[:, :2] < np.array(box.high[:2]))
    return np.asarray(inside.all(axis=1))


def _planes(body: Body, surface: CadSurface) -> dict[str, Plane]:
    low, high = surface.points.min(axis=0), surface.points.max(axis=0)
    sides = {
        f"{'xy'[axis]}{sign}": (axis, float(end[axis])) for axis in (0, 1) for sign, end in (("-", low), ("+", high))
    }
    if body.thickness_m == 0.0:
        return sides | {"foot": (2, 0.0), "touch": (2, 0.0), "top": (2, float(high[2]))}
    return sides | {"touch": (2, 0.0), "back": (2, MM * body.thickness_m), "top": (2, float(high[2]))}


def _on(plane: Plane, boundary: Boundary, surface: CadSurface) -> np.ndarray:
    axis, position = plane
    flat = [face.axis == axis and abs(face.position - position) < SAME_PLANE_MM for face in surface.faces]
    return np.array(flat)[boundary.face_of]
