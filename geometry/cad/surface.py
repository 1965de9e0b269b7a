"""The surface of a CAD shape as a mesher sees it: one conforming triangulation, and the exact face under each triangle.

Lengths in mm, the CAD kernel's unit.
"""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass
from functools import cached_property
from itertools import combinations
from typing import Any, cast

import numpy as np

from geometry.elements import FloatArray, IntArray
from geometry.errors import MeshError

SAME_POINT_MM = 1e-7  # the kernel's own confusion distance
SMOOTH = np.cos(np.radians(20.0))  # faces that meet at less have no edge a mesh of this coarseness could follow
ALONG_AXIS = 1e-9  # a normal this close to an axis is that axis
ANGULAR_DEFLECTION = 0.6  # rad: a mesher needs the shape of a curve, not its gloss


@dataclass(frozen=True)
class CadFace:
    """One face: its triangles, its exact surface, and whether it lies between two bonded solids."""

    surface: Any
    corners: FloatArray
    inner: bool
    normal: FloatArray | None
    offset: float

    @property
    def flat(self) -> bool:
        """True for a plane."""
        return self.normal is not None

    @property
    def axis(self) -> int | None:
        """0, 1, 2 when the plane is normal to x, y, z; None otherwise."""
        if self.normal is None or np.abs(self.normal).max() < 1.0:
            return None
        return int(np.abs(self.normal).argmax())

    @property
    def position(self) -> float:
        """Coordinate of an axis-normal plane along its axis, mm."""
        assert self.normal is not None and self.axis is not None
        return float(self.offset * self.normal[self.axis]) + 0.0

    def project(self, points: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Closest points on the untrimmed surface and unit normals there, each (n, 3)."""
        if self.normal is not None:
            return points - np.outer(points @ self.normal - self.offset, self.normal), np.tile(
                self.normal, (len(points), 1)
            )
        pairs = [_project_one(self.surface, point) for point in points]
        return np.array([p[0] for p in pairs]).reshape(-1, 3), np.array([p[1] for p in pairs]).reshape(-1, 3)

    def distance(self, points: FloatArray) -> FloatArray:
        """Distance of each point to the trimmed face (to its triangles), shape (n,)."""
        nearest = self._skin.find_closest_cell(points, return_closest_point=True)[1]
        return np.asarray(np.linalg.norm(points - nearest, axis=1))

    @cached_property
    def _skin(self) -> Any:
        return _skin(self.corners.reshape(-1, 3), np.arange(3 * len(self.corners)).reshape(-1, 3))


@dataclass(frozen=True)
class CadSurface:
    """Triangulation (points (n, 3) mm, triangles (m, 3)) and the number of the face under each triangle (m,)."""

    points: FloatArray
    triangles: IntArray
    face_of: IntArray
    faces: tuple[CadFace, ...]

    @property
    def diagonal(self) -> float:
        """Diagonal of the bounding box, mm."""
        return float(np.linalg.norm(np.ptp(self.points, axis=0)))

    def nearest_face(self, points: FloatArray) -> IntArray:
        """Number of the face nearest to each point (n, 3)."""
        return np.asarray(self.face_of[_skin(self.points, self.triangles).find_closest_cell(points)])

    def encloses(self, points: FloatArray) -> FloatArray:
        """Which points lie inside the outer surface (faces between bonded solids left out), shape (n,) bool."""
        from pyvista import PolyData

        outer = ~np.array([face.inner for face in self.faces])[self.face_of]
        skin = _skin(self.points, self.triangles[outer])
        inside = PolyData(points).select_interior_points(skin, method="signed_distance")
        return np.asarray(inside["selected_points"], dtype=bool)

    @cached_property
    def meetings(self) -> dict[tuple[int, int], bool]:
        """Pairs of faces (lower number first) that touch; True where they form an edge, False where they go over
        smoothly (normals within SMOOTH wherever they meet)."""
        meeting = np.unique(np.column_stack([self.triangles.ravel(), np.repeat(self.face_of, 3)]), axis=0)
        shared: dict[tuple[int, int], list[int]] = {}
        for group in np.split(meeting, np.flatnonzero(np.diff(meeting[:, 0])) + 1):
            for pair in combinations(group[:, 1].tolist(), 2):
                shared.setdefault(pair, []).append(int(group[0, 0]))
        return {pair: not self._smooth(pair, self.points[points]) for pair, points in shared.items()}

    def edge_between(self, first: int, second: int) -> bool:
        """True when two faces meet at an edge or a corner that a mesh must follow."""
        return self.meetings.get((min(first, second), max(first, second)), False)

    def _smooth(self, pair: tuple[int, int], points: FloatArray) -> bool:
        first, second = (self.faces[i].project(points)[1] for i in pair)
        return bool((np.abs((first * second).sum(axis=1)) > SMOOTH).all())


def cad_surface(shape: Any, deflection: float, angle: float = ANGULAR_DEFLECTION) -> CadSurface:
    """Triangulate a cadquery shape to a linear deflection (mm) and an angular one (rad between facets).

    Raises MeshError for a shape without faces.

    The shape is copied first: the kernel would silently hand back a coarser triangulation it already holds.
    """
    from OCP.BRepMesh import BRepMesh_IncrementalMesh

    fresh = shape.copy()
    BRepMesh_IncrementalMesh(fresh.wrapped, deflection, False, angle)
    owners = Counter(face.hashCode() for solid in fresh.Solids() for face in solid.Faces())
    corners, faces = [], []
    for face in fresh.Faces():
        triangles = _face_triangles(face)
        corners.append(triangles)
        faces.append(_cad_face(face, triangles, owners[face.hashCode()] > 1))
    if not corners:
        raise MeshError("the CAD shape has no face to mesh")
    return _joined(corners, faces)


def _joined(corners: list[FloatArray], faces: list[CadFace]) -> CadSurface:
    soup = np.concatenate(corners).reshape(-1, 3)
    _, first, number = np.unique(
        np.round(soup / SAME_POINT_MM).astype(np.int64), axis=0, return_index=True, return_inverse=True
    )
    triangles = number.reshape(-1, 3).astype(np.int64)
    face_of = np.repeat(np.arange(len(corners)), [len(c) for c in corners])
    a, b, c = triangles.T
    whole = (a != b) & (b != c) & (a != c)
    return CadSurface(soup[first], triangles[whole], face_of[whole], tuple(faces))


def _face_triangles(face: Any) -> FloatArray:
    """Corners of a face's triangles, (m, 3, 3) mm, outward for a solid's own face."""
    from OCP.BRep import BRep_Tool
    from OCP.TopAbs import TopAbs_REVERSED
    from OCP.TopLoc import TopLoc_Location

    place = TopLoc_Location()
    mesh = BRep_Tool.Triangulation_s(face.wrapped, place)
    if mesh is None:
        raise MeshError(f"the CAD kernel could not triangulate the face at {face.Center().toTuple()} mm")
    move = place.Transformation()
    nodes = [mesh.Node(i + 1).Transformed(move) for i in range(mesh.NbNodes())]
    points = np.array([(p.X(), p.Y(), p.Z()) for p in nodes])
    numbers = np.array([mesh.Triangle(i + 1).Get() for i in range(mesh.NbTriangles())]) - 1
    corners = points[numbers]
    return corners[:, ::-1] if face.wrapped.Orientation() == TopAbs_REVERSED else corners


def _cad_face(face: Any, corners: FloatArray, inner: bool) -> CadFace:
    from OCP.BRep import BRep_Tool
    from OCP.ShapeAnalysis import ShapeAnalysis_Surface

    if face.geomType() != "PLANE":
        return CadFace(ShapeAnalysis_Surface(BRep_Tool.Surface_s(face.wrapped)), corners, inner, None, 0.0)
    normal = np.array(face.normalAt().toTuple())
    near = np.round(normal)
    if np.abs(normal - near).max() < ALONG_AXIS:
        normal = near + 0.0
    offset = float(np.array(face.Center().toTuple()) @ normal)
    offset = 0.0 if abs(offset) < SAME_POINT_MM else offset
    return CadFace(None, corners, inner, normal, offset)


def _project_one(surface: Any, point: FloatArray) -> tuple[FloatArray, FloatArray]:
    from OCP.GeomLProp import GeomLProp_SLProps
    from OCP.gp import gp_Pnt

    uv = surface.ValueOfUV(gp_Pnt(*(float(c) for c in point)), SAME_POINT_MM)
    local = GeomLProp_SLProps(surface.Surface(), uv.X(), uv.Y(), 1, SAME_POINT_MM)
    foot = local.Value()
    where = np.array([foot.X(), foot.Y(), foot.Z()])
    if local.IsNormalDefined():
        normal = local.Normal()
        return where, np.array([normal.X(), normal.Y(), normal.Z()])
    gap = point - where
    return where, gap / max(float(np.linalg.norm(gap)), 1e-300)


def _skin(points: FloatArray, triangles: IntArray) -> Any:
    """Triangles to search in; they keep their search tree."""
    from pyvista import PolyData

    return PolyData.from_regular_faces(points, cast(Any, triangles))
