"""A unit cell from a STEP file: its solids with their names, and the edges at which stresses are singular. Lengths in mm."""

from __future__ import annotations

import os
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from geometry.cad.solids import MM, Body, CadSurface, cad_surface, share_faces
from geometry.elements import FloatArray
from geometry.errors import GeometryError
from geometry.files import read_by_command, silence_kernel

SAME_PITCH = 1e-6  # of a pitch: how much the cell may be longer
FINE_MM = 1e-3  # of the diagonal: largest distance of triangles from curved faces where points are looked up
AROUND, SPOKES = 2e-3, 36  # of the diagonal: radius of the circle about an edge on which the solid is looked up
REENTRANT = 0.55  # of the circle: an edge with more of it in the solid is re-entrant
ON_CURVE = 16  # segments of a curved edge


@dataclass(frozen=True)
class CellBody(Body):
    """Solids of a cell, centred along x and y, each of the region that its name gives.

    Attributes
    ----------
    names : tuple of str
        Region of each solid of the shape.
    """

    names: tuple[str, ...] = ()

    @property
    def regions(self) -> tuple[str, ...]:
        """Names of the regions."""
        return tuple(dict.fromkeys(self.names))

    def region_of(self, points: NDArray[np.float64]) -> NDArray[np.str_]:
        """Name of the region that holds each point (n, 3) of the body, m."""
        out = np.full(len(points), self.regions[0], dtype=f"<U{max(map(len, self.names))}")
        for name, surface in self._surfaces if len(self.regions) > 1 else ():
            out[np.asarray(surface.encloses(MM * points), dtype=bool)] = name
        return out

    @cached_property
    def _surfaces(self) -> list[tuple[str, CadSurface]]:
        fine = FINE_MM * self.shape.BoundingBox().DiagonalLength
        return [(name, cad_surface(solid, fine)) for name, solid in self.solids()]

    def solids(self) -> list[tuple[str, Any]]:
        """Its solids with their regions."""
        return list(zip(self.names, self.shape.Solids(), strict=True))

    def singular_lines(self) -> FloatArray:
        """Segments (k, 2, 3) along re-entrant edges, and along all edges where regions meet, m."""
        surface = cad_surface(self.shape, FINE_MM * self.shape.BoundingBox().DiagonalLength)
        faces = [face for solid in self.shape.Solids() for face in solid.Faces()]
        hashes = [face.hashCode() for face in faces]
        inner = {edge.hashCode() for face in faces if hashes.count(face.hashCode()) > 1 for edge in face.Edges()}
        lines = [np.empty((0, 2, 3))]
        for edge in self.shape.Edges():
            if edge.hashCode() in inner or self._share(edge, surface) > REENTRANT:
                count = 1 if edge.geomType() == "LINE" else ON_CURVE
                points = np.array([p.toTuple() for p in edge.positions(np.linspace(0.0, 1.0, count + 1))])
                lines.append(np.stack([points[:-1], points[1:]], axis=1) / MM)
        return np.concatenate(lines)

    def _share(self, edge: Any, surface: CadSurface) -> float:
        """Share of a small circle about the middle of an edge that lies in the body."""
        middle, along = np.array(edge.positionAt(0.5).toTuple()), np.array(edge.tangentAt(0.5).toTuple())
        one = np.cross(along, np.eye(3)[np.argmin(np.abs(along))])
        one /= np.linalg.norm(one)
        turn = 2.0 * np.pi * (np.arange(SPOKES) + 0.5) / SPOKES
        circle = np.outer(np.cos(turn), one) + np.outer(np.sin(turn), np.cross(along, one))
        return float(np.mean(surface.encloses(middle + AROUND * surface.diagonal * circle)))


def step_cell(path: str | os.PathLike[str], size_m: tuple[float | None, float], thickness_m: float) -> CellBody:
    """Read the solids of a unit cell from a STEP file, whatever length unit it declares.

    Parameters
    ----------
    path : str or Path
        STEP file, the touch face on z = 0.
    size_m : tuple of float or None
        Size along x, None for an oblique cell, which may lean either way, and along y, m.
    thickness_m : float
        Thickness of the plate, m.

    Returns
    -------
    CellBody
        Its middle at x = y = 0.

    Raises
    ------
    GeometryError
        For a file that cannot be read, holds no valid solid, or whose solids overlap or have another size.
    """
    import cadquery as cq

    file = Path(path)
    named = _named_solids(file)
    for _, solid in named:
        if not solid.isValid() or solid.Volume() <= 0.0:
            raise GeometryError(f"{file}: a solid is not valid (open, self-intersecting or badly stitched faces)")
    shape = share_faces([solid for _, solid in named]) if len(named) > 1 else named[0][1]
    box = shape.BoundingBox(1e-9)
    sizes = [(own, MM * size) for own, size in zip((box.xlen, box.ylen), size_m, strict=True) if size]
    _check_size(file, *np.array(sizes).T)
    move = cq.Location(cq.Vector(-(box.xmin + box.xmax) / 2.0, -(box.ymin + box.ymax) / 2.0, 0.0))
    names = tuple(_name_of(solid, named) for solid in shape.Solids())
    regions = tuple(dict.fromkeys(names))
    return CellBody(shape.moved(move), thickness_m, frozenset(regions[1:]), names=names)


def _check_size(file: Path, size: FloatArray, pitch: FloatArray) -> None:
    if (np.abs(size / pitch - 1.0) <= SAME_PITCH).all():
        return
    has, must = (" x ".join(f"{each:.9g}" for each in edges) for edges in (size, pitch))
    ratio = float(np.median(size / pitch))
    doubt = ""
    for unit, factor in (("metres", 1e3), ("inches", 25.4)):
        if abs(ratio / factor - 1.0) < 0.1:
            doubt = f" (the file says {unit}: export it in mm)"
    if abs(ratio * 1e3 - 1.0) < 0.1:
        doubt = " (its lengths look like metres in a file that says mm: export it in mm)"
    raise GeometryError(f"{file}: the cell is {has} mm, must be a pitch wide, {must} mm{doubt}")


def _name_of(solid: Any, named: list[tuple[str, Any]]) -> str:
    """Name of the solid read from the file that lies where one with shared faces does."""
    centre = solid.Center()
    near = [
        (centre.sub(own.Center()).Length + abs(solid.Volume() - own.Volume()) ** (1.0 / 3.0), name)
        for name, own in named
    ]
    return min(near)[1]


def _named_solids(file: Path) -> list[tuple[str, Any]]:
    """Solids of a file in mm, each with the name of its body or part."""
    from OCP.IFSelect import IFSelect_RetDone
    from OCP.Interface import Interface_Static
    from OCP.STEPCAFControl import STEPCAFControl_Reader
    from OCP.TCollection import TCollection_ExtendedString
    from OCP.TDF import TDF_LabelSequence
    from OCP.TDocStd import TDocStd_Document
    from OCP.XCAFDoc import XCAFDoc_DocumentTool

    read_by_command(file)
    silence_kernel()
    reader, document = STEPCAFControl_Reader(), TDocStd_Document(TCollection_ExtendedString("XmlXCAF"))
    Interface_Static.SetCVal_s("xstep.cascade.unit", "MM")
    reader.SetNameMode(True)
    if reader.ReadFile(str(file)) != IFSelect_RetDone or not reader.Transfer(document):
        raise GeometryError(f"{file}: not a readable STEP file (it needs at least one shape)")
    labels = TDF_LabelSequence()
    XCAFDoc_DocumentTool.ShapeTool_s(document.Main()).GetFreeShapes(labels)
    found = [each for number in range(labels.Length()) for each in _solids_at(labels.Value(number + 1))]
    if not found:
        raise GeometryError(f"{file}: holds no solid: must hold at least one closed solid")
    return found


def _solids_at(label: Any, place: Any = None, outer: str = "") -> Iterator[tuple[str, Any]]:
    """Solids at a label of a CAD document, those of an assembly's parts at their places."""
    import cadquery as cq
    from OCP.TDF import TDF_Label, TDF_LabelSequence
    from OCP.TopLoc import TopLoc_Location
    from OCP.XCAFDoc import XCAFDoc_ShapeTool as Tool

    place = place or TopLoc_Location()
    if Tool.IsAssembly_s(label):
        parts = TDF_LabelSequence()
        Tool.GetComponents_s(label, parts)
        for number in range(parts.Length()):
            part, own = parts.Value(number + 1), TDF_Label()
            Tool.GetReferredShape_s(part, own)
            yield from _solids_at(own, place * Tool.GetLocation_s(part), _label_name(own) or _label_name(part))
        return
    shape = cq.Shape.cast(Tool.GetShape_s(label).Moved(place))
    solids, inside = shape.Solids(), TDF_LabelSequence()
    Tool.GetSubShapes_s(label, inside)
    known = {}
    for number in range(inside.Length()):
        own = inside.Value(number + 1)
        known[cq.Shape.cast(Tool.GetShape_s(own).Moved(place)).hashCode()] = _label_name(own)
    for solid in solids:
        yield known.get(solid.hashCode()) or outer or _label_name(label) or "body", solid


def _label_name(label: Any) -> str:
    from OCP.TDataStd import TDataStd_Name

    name = TDataStd_Name()
    return str(name.Get().ToExtString()) if label.FindAttribute(TDataStd_Name.GetID_s(), name) else ""
