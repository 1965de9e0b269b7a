"""Plates of any outline, read from STEP files: their size, and the rims of touch face and back.

The solid stands on z = 0 like every plate, in the file's own coordinates. Rims are polygons fine enough to place a zone
and pillars; the mesher follows the exact CAD faces.
"""

from __future__ import annotations

import hashlib
import os
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import lru_cache
from pathlib import Path
from typing import Any, Literal

import numpy as np

from geometry.elements import BoolArray, FloatArray
from geometry.errors import GeometryError
from geometry.pillar_shapes import ON_PLANE_MM, step_solid

MM = 1e-3  # m per mm
LEVEL_MM = 1e-6  # planes this close are one height
UPRIGHT = 1.0 - 1e-9  # cosine of a normal along z
CURVE = 120  # segments of a curved edge: they leave a full circle by 3e-4 of its radius
FLUSH_M = 2e-8  # what touches a rim to twenty nanometres is flush with it
ACROSS = 64  # places across a zone's end
LEAST_BACK = 0.3  # of the touch face: a smaller highest face is that of a boss
BEYOND = 0.05  # of the thickness: a zone that ends nearer to the rim ends with the plate

OffPlate = Literal["", "outline", "hole"]


@dataclass(frozen=True)
class Rim:
    """Polygons round one face: segments (s, 2, 2) in m, and whether each belongs to a hole, (s,)."""

    segments: FloatArray
    is_hole: BoolArray

    def contains(self, points: FloatArray) -> BoolArray:
        """Mask of the points (n, 2) on the face, (n,): a ray from each crosses its rims an odd number of times."""
        return _crossings(points, self.segments) % 2 == 1

    def beneath(self, polygon: FloatArray) -> OffPlate:
        """Name what a convex or star-shaped polygon (k, 2) about its mean does not stand on; '' on the face alone."""
        middle = polygon.mean(axis=0)
        reach = np.linalg.norm(polygon - middle, axis=1).max()
        shrunk = middle + (1.0 - min(0.5, FLUSH_M / reach)) * (polygon - middle)
        near = _distance(middle, self.segments) < reach
        met = near & (_meets(shrunk, self.segments) | _inside(self.segments[:, 0], shrunk))
        if met.any():
            return "outline" if not self.is_hole[met].all() else "hole"
        if self.contains(middle[None])[0]:
            return ""
        within = _crossings(middle[None], self.segments[~self.is_hole])[0] % 2 == 1
        return "hole" if within else "outline"


@dataclass(frozen=True)
class Outline:
    """A plate's solid in a STEP file, in the file's own coordinates; two are equal if the files' contents are.

    Attributes
    ----------
    sha256 : str
        Of the file's content.
    file : str
        Path of the file.
    thickness_m : float
        Height of its back.
    ends_m : tuple of float
        Rectangle x0, x1, y0, y1 about the solid.
    volume_m3 : float
        Volume of the solid.
    touch, back : Rim
        Rims of the plane faces on z = 0 and on z = thickness.
    """

    sha256: str
    file: str = field(compare=False)
    thickness_m: float = field(compare=False)
    ends_m: tuple[float, float, float, float] = field(compare=False)
    volume_m3: float = field(compare=False)
    touch: Rim = field(compare=False, repr=False)
    back: Rim = field(compare=False, repr=False)

    @property
    def size_m(self) -> tuple[float, float]:
        """Extents along x and y, m."""
        x0, x1, y0, y1 = self.ends_m
        return x1 - x0, y1 - y0

    def solid(self) -> Any:
        """The solid (cadquery, mm). GeometryError as `read_outline`, and for a file that has changed since it was read."""
        if hashlib.sha256(Path(self.file).read_bytes()).hexdigest() != self.sha256:
            raise GeometryError(f"{self.file}: has changed since it was read: start again")
        return _standing(self.file)

    def beneath(self, box_m: tuple[float, float, float, float]) -> OffPlate:
        """Name what a rectangle x0, x1, y0, y1 of the plate does not have on both faces; '' for a whole one."""
        corners = corners_of(box_m)
        return self.touch.beneath(corners) or self.back.beneath(corners)

    def goes_on(self, x: float, sign: int, y0: float, y1: float) -> bool:
        """Whether most of the line from y0 to y1 just beyond x, towards x * sign, lies on the touch face."""
        y = y0 + (y1 - y0) * (np.arange(ACROSS) + 0.5) / ACROSS
        beyond = np.column_stack([np.full(ACROSS, x + sign * BEYOND * self.thickness_m), y])
        return bool(self.touch.contains(beyond).mean() > 0.5)


def corners_of(box_m: Sequence[float]) -> FloatArray:
    """Corners (4, 2) of a rectangle x0, x1, y0, y1.

    Parameters
    ----------
    box_m : sequence of float
        In m.

    Returns
    -------
    ndarray, shape (4, 2)
        In m, counterclockwise.
    """
    x0, x1, y0, y1 = box_m
    return np.array([[x0, y0], [x1, y0], [x1, y1], [x0, y1]])


def read_outline(path: str | os.PathLike[str]) -> Outline:
    """Read a plate's outline from a STEP file of any length unit.

    Parameters
    ----------
    path : path
        The file: a solid whose touch face lies on z = 0 and whose back is a plane parallel to it.

    Returns
    -------
    Outline
        In the file's own coordinates.

    Raises
    ------
    GeometryError
        If the file is missing or unreadable, open, not one solid, or not such a plate.
    """
    file = Path(path)
    try:
        content = file.read_bytes() if file.is_file() else b""
    except (OSError, ValueError):
        content = b""
    return _outline(str(file), hashlib.sha256(content).hexdigest())


@lru_cache(maxsize=16)
def _outline(file: str, sha256: str) -> Outline:
    solid = _standing(file)
    faces, box = _merged(solid).Faces(), solid.BoundingBox()
    levels = [(face.Center().z, face.normalAt().z, face) for face in faces if face.geomType() == "PLANE"]
    back_mm = max((z for z, up, _ in levels if up > UPRIGHT), default=0.0)
    below = [face for z, up, face in levels if up < -UPRIGHT and abs(z) < LEVEL_MM]
    above = [face for z, up, face in levels if up > UPRIGHT and abs(z - back_mm) < LEVEL_MM]
    touch, back = _rim(below), _rim(above)
    known = bool(len(touch.segments)), abs(back_mm - box.zmax) < ON_PLANE_MM
    for is_plane, height in zip(known, (0.0, box.zmax), strict=True):
        if not is_plane:
            raise GeometryError(f"{file}: has no plane face on z = {height:g} mm: touch face and back must be planes")
    part = sum(face.Area() for face in above) / sum(face.Area() for face in below)
    if part < LEAST_BACK:
        what = f"its highest face, on z = {back_mm:g} mm, is {100.0 * part:.2g} % of its touch face"
        raise GeometryError(
            f"{file}: {what}: the back must be one plane, without bosses; pillars are those of [pillar]"
        )
    if len(solid.Shells()) > 1:
        raise GeometryError(f"{file}: has a cavity inside: must be a solid with a single surface")
    x0, x1, y0, y1 = (round(MM * end, 10) for end in (box.xmin, box.xmax, box.ymin, box.ymax))
    return Outline(sha256, file, MM * round(back_mm, 9), (x0, x1, y0, y1), MM**3 * solid.Volume(), touch, back)


def _standing(file: str) -> Any:
    """The solid of a file, its touch face on z = 0 exactly."""
    solid = step_solid(file)
    box = solid.BoundingBox()
    if abs(box.zmin) > ON_PLANE_MM:
        raise GeometryError(
            f"{file}: reaches from z = {box.zmin:g} to {box.zmax:g} mm: its touch face must lie on z = 0"
        )
    lowest = [
        face.Center().z for face in solid.Faces() if face.geomType() == "PLANE" and abs(face.normalAt().z) > UPRIGHT
    ]
    touch = min(lowest, key=abs, default=0.0)
    if touch == 0.0 or abs(touch) > ON_PLANE_MM:
        return solid
    import cadquery as cq

    return solid.moved(cq.Location(cq.Vector(0.0, 0.0, -touch)))


def _merged(solid: Any) -> Any:
    """The solid without seams between faces of one plane."""
    try:
        return solid.clean()
    except Exception:  # the kernel raises its own untyped errors
        return solid


def _rim(faces: list[Any]) -> Rim:
    """Rims of some plane faces of one height."""
    segments, holes = [np.empty((0, 2, 2))], [np.empty(0, dtype=bool)]
    for face in faces:
        for wire, is_hole in [(face.outerWire(), False), *((wire, True) for wire in face.innerWires())]:
            for edge in wire.Edges():
                count = 1 if edge.geomType() == "LINE" else CURVE
                places = edge.positions((np.arange(count + 1) / count).tolist())
                points = MM * np.array([place.toTuple()[:2] for place in places])
                segments.append(np.stack([points[:-1], points[1:]], axis=1))
                holes.append(np.full(count, is_hole))
    return Rim(np.concatenate(segments), np.concatenate(holes))


def _crossings(points: FloatArray, segments: FloatArray) -> Any:
    """Number of segments (s, 2, 2) that the ray from each point (n, 2) towards +x crosses, (n,)."""
    (x0, y0), (x1, y1) = segments[:, 0].T, segments[:, 1].T
    x, y = points[:, :1], points[:, 1:2]
    spans = (y0 > y) != (y1 > y)
    rise = np.where(y1 == y0, 1.0, y1 - y0)
    return (spans & (x < x0 + (y - y0) / rise * (x1 - x0))).sum(axis=1)


def _inside(points: FloatArray, polygon: FloatArray) -> BoolArray:
    """Mask of the points (n, 2) inside a polygon (k, 2)."""
    sides = np.stack([polygon, np.roll(polygon, -1, axis=0)], axis=1)
    return np.asarray(_crossings(points, sides) % 2 == 1)


def _distance(point: FloatArray, segments: FloatArray) -> FloatArray:
    """Distance of a point (2,) from each segment, (s,)."""
    start, along = segments[:, 0], segments[:, 1] - segments[:, 0]
    share = np.clip(((point - start) * along).sum(axis=1) / np.maximum((along**2).sum(axis=1), 1e-300), 0.0, 1.0)
    return np.asarray(np.linalg.norm(start + share[:, None] * along - point, axis=1))


def _meets(polygon: FloatArray, segments: FloatArray) -> BoolArray:
    """Mask of the segments (s, 2, 2) that cross a side of a polygon (k, 2), (s,)."""
    starts, ends = polygon[None], np.roll(polygon, -1, axis=0)[None]
    low, high = segments[:, None, 0], segments[:, None, 1]

    def side(origin: FloatArray, tip: FloatArray, point: FloatArray) -> FloatArray:
        one, other = tip - origin, point - origin
        return np.asarray(one[..., 0] * other[..., 1] - one[..., 1] * other[..., 0])

    apart = side(starts, ends, low) * side(starts, ends, high) < 0.0
    across = side(low, high, starts) * side(low, high, ends) < 0.0
    return np.asarray((apart & across).any(axis=1))
