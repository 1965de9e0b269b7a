"""A pillar drawn by the user: read from STEP and refused, with its reason, when it cannot stand on a plate."""

from __future__ import annotations

import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Self

import numpy as np

from geometry.elements import FloatArray
from geometry.errors import GeometryError
from geometry.files import read_by_command, silence_kernel
from geometry.pillar_shapes.base import MM, Square

ON_PLANE_MM = 1e-4  # a foot this close to z = 0 is on it: CAD systems write about seven digits


class Step(Square):
    """Any solid from a STEP file: height, foot, tip, extent and volume are the file's; `width_m` is the larger side of the
    foot face's bounding square, and beam theory takes that square for its section.

    Nothing is assumed of its symmetry. It may be wider above its foot: pillars clash when the pitch is below its extent.
    """

    name = "step"
    keys = ("file",)
    has_height = False
    can_have_fillet = False
    sizing_note = "the STEP solid is sized as a uniform beam of its foot section: compute the solid"

    @classmethod
    def from_case(cls, given: Mapping[str, Any], folder: Path) -> Self:
        """The pillar of the file that the case names. GeometryError as from_file."""
        return cls.from_file(folder / given["file"])

    @classmethod
    def from_file(cls, path: str | os.PathLike[str]) -> Self:
        """The pillar in a STEP file (any length unit), foot on z = 0 and centred, axis +z.

        Raises GeometryError when the file is missing or unreadable, open, not one solid, or not standing on z = 0.
        """
        solid = step_pillar_shape(path)
        box = solid.BoundingBox()
        foot, tip = _level_size(solid, 0.0), _level_size(solid, box.zmax)
        extent, volume = max(box.xlen, box.ylen), solid.Volume()
        more = (("height_m", MM * box.zmax), ("extent_m", MM * extent), ("volume_m3", MM**3 * volume))
        return cls(MM * foot, MM * tip, more, str(path))

    @property
    def rectangles(self) -> FloatArray | None:
        """None: the solid goes through CAD."""
        return None

    @property
    def mirrors(self) -> tuple[str, ...]:
        """None is known."""
        return ()

    def reach_m(self, fillet_m: float = 0.0) -> tuple[float, float]:
        """The solid's larger extent along both axes."""
        extent = max(self.width_m, self.tip_m, dict(self.more_m).get("extent_m", 0.0))
        return extent, extent

    @property
    def taper(self) -> float:
        """1: nothing is known of the sections above the foot."""
        return 1.0

    def height_m(self, given_m: float) -> float:
        """The file's."""
        return self.size_m("height_m")

    def volume_m3(self, height_m: float) -> float:
        """The file's, NaN where it was not read."""
        return self.size_m("volume_m3")

    def solid(self, height_m: float) -> Any:
        """The file's solid. GeometryError as from_file."""
        return step_pillar_shape(self.file or "")


def step_pillar_shape(path: str | os.PathLike[str]) -> Any:
    """The one solid of a STEP file (cadquery, mm) once it is known to stand on z = 0; errors as Step.from_file."""
    file = Path(path)
    try:
        there = file.is_file()
    except (OSError, ValueError):  # a name that no file can have
        there = False
    if not there:
        raise GeometryError(f"{file}: no such STEP file")
    read_by_command(file)
    solid = _only_solid(_read(file), file)
    if not solid.isValid():
        raise GeometryError(f"{file}: the solid is not valid (self-intersecting or badly stitched faces)")
    if solid.Volume() <= 0.0:
        raise GeometryError(f"{file}: the solid has volume {solid.Volume():g} mm3, must be > 0")
    _check_foot(solid, file)
    return solid


def _read(file: Path) -> Any:
    """The shape in mm, whatever unit the file declares; the reader's own chatter stays off standard output."""
    import cadquery as cq
    from OCP.IFSelect import IFSelect_RetDone
    from OCP.Interface import Interface_Static
    from OCP.STEPControl import STEPControl_Reader

    silence_kernel()
    reader = STEPControl_Reader()
    Interface_Static.SetCVal_s("xstep.cascade.unit", "MM")
    if reader.ReadFile(str(file)) != IFSelect_RetDone or reader.TransferRoots() < 1:
        raise GeometryError(f"{file}: not a readable STEP file (it needs at least one shape)")
    shape = reader.OneShape()
    if shape.IsNull():
        raise GeometryError(f"{file}: the STEP file holds no shape")
    return cq.Shape.cast(shape)


def _only_solid(shape: Any, file: Path) -> Any:
    solids = shape.Solids()
    if not solids:
        raise GeometryError(f"{file}: open: {len(shape.Faces())} face(s) that close no volume, need one closed solid")
    if len(solids) > 1:
        raise GeometryError(f"{file}: holds {len(solids)} solids, need exactly one")
    if len(shape.Faces()) > len(solids[0].Faces()):
        raise GeometryError(f"{file}: holds loose faces beside its solid, need exactly one closed solid")
    if not all(shell.Closed() for shell in solids[0].Shells()):
        raise GeometryError(f"{file}: open: the solid's shell has a gap, need one closed solid")
    return solids[0]


def _check_foot(solid: Any, file: Path) -> None:
    box = solid.BoundingBox()
    if abs(box.zmin) > ON_PLANE_MM:
        raise GeometryError(f"{file}: lowest point at z = {box.zmin:g} mm, the foot must be on z = 0")
    feet = _level_faces(solid, 0.0)
    if not feet:
        raise GeometryError(f"{file}: no flat face on z = 0 to bond to the plate")
    x, y = _corners(feet).mean(axis=0)
    if max(abs(x), abs(y)) > ON_PLANE_MM:
        raise GeometryError(f"{file}: foot centred at ({x:g}, {y:g}) mm, must be centred on the z axis")


def _level_faces(solid: Any, z: float) -> list[Any]:
    boxes = [(face, face.BoundingBox()) for face in solid.Faces() if face.geomType() == "PLANE"]
    return [face for face, box in boxes if max(abs(box.zmax - z), box.zlen) < ON_PLANE_MM]


def _corners(faces: list[Any]) -> FloatArray:
    """Least and greatest x and y of some faces together, (2, 2) mm."""
    boxes = [face.BoundingBox() for face in faces]
    low, high = [(b.xmin, b.ymin) for b in boxes], [(b.xmax, b.ymax) for b in boxes]
    return np.array([np.min(low, axis=0), np.max(high, axis=0)])


def _level_size(solid: Any, z: float) -> float:
    """Largest extent of the flat faces at height z, mm; 0 for a pointed or rounded tip."""
    faces = _level_faces(solid, z)
    return float(np.ptp(_corners(faces), axis=0).max()) if faces else 0.0
