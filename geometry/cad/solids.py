"""CAD solids of plate, pillars and unit cell, metres in and out, the kernel's millimetres inside; surfaces of solids.

CadQuery takes seconds to import, so it is imported where it is used.

Lengths in mm, the CAD kernel's unit.
"""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass
from functools import cached_property
from itertools import combinations, pairwise
from threading import RLock
from typing import Any, cast

import numpy as np
from numpy.typing import NDArray

from geometry.elements import FloatArray, IntArray
from geometry.errors import GeometryError, MeshError
from geometry.layout import Design, Pillar, PillarGroup, section_names
from geometry.materials import Stack, layer_names
from geometry.outline import Outline
from geometry.tiling import Panel

MM = 1e3  # mm per m
SAME_VOLUME = 1e-6  # relative: two booleans of one solid agree to the kernel's tolerance, not to rounding

SAME_POINT_MM = 1e-7  # the kernel's own confusion distance
SMOOTH = np.cos(np.radians(20.0))  # faces that meet at less have no edge a mesh of this coarseness could follow
ALONG_AXIS = 1e-9  # a normal this close to an axis is that axis
_KERNEL = RLock()  # CadQuery resolves an overload at its first call, which two threads at once get wrong
ANGULAR_DEFLECTION = 0.6  # rad: a mesher needs the shape of a curve, not a smooth picture of it


@dataclass(frozen=True)
class Box:
    """An axis-parallel box between two corners, m."""

    low: tuple[float, float, float]
    high: tuple[float, float, float]


@dataclass(frozen=True)
class Body:
    """A CAD shape in mm with the data for a mesher, in m.

    The plate reaches from z = 0 to its thickness; pillars stand above it, or on both sides.

    Attributes
    ----------
    shape : cadquery.Shape
        One solid, or with `bonds` several solids that share their contact faces.
    thickness_m : float
        Thickness of the plate; 0 for the isolated pillar.
    bonds : frozenset of str
        Parts ("pillar", "section2", "layer2" and so on) of a material other than that of the part below.
    upper : tuple
        Upper parts of pillars: the name and the box round each.
    joints_m : tuple of float
        Heights where layers of the plate meet.
    """

    shape: Any
    thickness_m: float
    bonds: frozenset[str] = frozenset()
    upper: tuple[tuple[str, Box], ...] = ()
    joints_m: tuple[float, ...] = ()

    @property
    def regions(self) -> tuple[str, ...]:
        """Names of the regions that the body may have."""
        return (*layer_names(len(self.joints_m) + 1), "pillar", *dict.fromkeys(name for name, _ in self.upper))

    @property
    def bonded(self) -> bool:
        """True when parts of different materials must not share an element."""
        return bool(self.bonds)

    @property
    def volume_m3(self) -> float:
        """Volume of the CAD shape, m3."""
        return float(self.shape.Volume()) / MM**3

    def region_of(self, points: NDArray[np.float64]) -> NDArray[np.str_]:
        """Name of the region that holds each point (n, 3) of the body, m."""
        height, layers = points[:, 2], np.array(layer_names(len(self.joints_m) + 1), dtype="<U16")
        inside = layers[np.searchsorted(np.asarray(self.joints_m, dtype=float), height)]
        names = np.where((height > self.thickness_m) | (height < 0.0), "pillar", inside)
        for name, box in self.upper:
            names[((points > np.array(box.low)) & (points < np.array(box.high))).all(axis=1)] = name
        return names

    def solids(self) -> list[tuple[str, Any]]:
        """Its solids with the part that each belongs to: a bonded one, or "plate"."""
        found = []
        for solid in self.shape.Solids():
            region = str(self.region_of(np.array([solid.Center().toTuple()]) / MM)[0])
            found.append((region if region in self.bonds else self.lowest, solid))
        return found

    @property
    def lowest(self) -> str:
        """Name of its lowest part: the pillar's of a pillar alone."""
        return "plate" if self.thickness_m else "pillar"

    def part_volumes_m3(self) -> dict[str, float]:
        """CAD volume of each bonded part and of the rest, called "plate", m3."""
        volumes: dict[str, float] = {}
        for region, solid in self.solids():
            name = region if region in self.bonds else "plate"
            volumes[name] = volumes.get(name, 0.0) + float(solid.Volume()) / MM**3
        return volumes


@dataclass(frozen=True)
class CadFace:
    """One face of a CAD shape, lengths in mm.

    Attributes
    ----------
    surface : ShapeAnalysis_Surface or None
        Exact surface of a curved face; None for a plane.
    corners : ndarray, shape (m, 3, 3)
        Corners of its triangles.
    inner : bool
        Whether it lies between two bonded solids.
    normal : ndarray, shape (3,), or None
        Unit normal n of a plane n . x = offset; None for a curved face.
    offset : float
        Distance of a plane from the origin along its normal, in mm.
    """

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
        """Mask of the points inside the outer surface (faces between bonded solids ignored), shape (n,) bool."""
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


def pillar_solid(pillar: Pillar) -> Body:
    """Build the isolated pillar: foot on z = 0, axis +z, with fillet and all sections.

    Parameters
    ----------
    pillar : Pillar
        Shape and sizes in m.

    Returns
    -------
    Body
        The pillar, thickness 0; sections of other materials are bonded to it.

    Raises
    ------
    GeometryError
        If the shape or its fillet cannot be built, or the STEP file is not a pillar.
    """
    with _KERNEL:
        (_, stem), *upper = _parts(pillar)
        if not upper:
            return Body(stem, 0.0)
        shape = share_faces([stem, *(shape for _, shape in upper)])
        boxes = tuple(_box_of(name, shape) for name, shape in upper)
    return Body(shape, 0.0, frozenset(name for name, _ in upper), boxes)


def zone_solid(design: Design, mirrors: str = "") -> Body:
    """Build the active zone as a bare strip, length x width x thickness, centred.

    Parameters
    ----------
    design : Design
        The plate as built.
    mirrors : {'', 'x', 'y', 'xy'}, optional
        Axes along which only the positive side is kept.

    Returns
    -------
    Body
        The strip from z = 0 to the thickness.
    """
    return _assemble(design, (design.length_m, design.width_m), (), mirrors)


def cell_solid(design: Design, mirrors: str = "") -> Body:
    """Build the unit cell, pitch_x x pitch_y x thickness, centred, with its pillar in the middle.

    Parameters
    ----------
    design : Design
        The plate as built; the cell of a design without a pillar is bare.
    mirrors : {'', 'x', 'y', 'xy'}, optional
        Axes along which only the positive side is kept.

    Returns
    -------
    Body
        The cell.

    Raises
    ------
    GeometryError
        As `plate_solid`.
    """
    stands = (PillarGroup(design.pillar, np.zeros((1, 2))),) if design.pillar else ()
    return _assemble(design, (design.pitch_x_m, design.pitch_y_m), stands, mirrors)


def panel_solid(design: Design, panel: Panel) -> Body:
    """Build a rectangular panel of the plate with its pillar, if any, and its middle at the origin.

    Parameters
    ----------
    design : Design
        The plate as built.
    panel : Panel
        Corners and foot in m; along the axes in `halved` only the positive side is built.

    Returns
    -------
    Body
        The panel.

    Raises
    ------
    GeometryError
        As `plate_solid`.
    """
    size = np.array(panel.high) - np.array(panel.low)
    mirrors = "".join("xy"[axis] for axis in panel.halved)
    pillar = panel.pillar or design.pillar
    stands = (PillarGroup(pillar, np.array([panel.foot]) - np.array(panel.middle)),) if pillar and panel.foot else ()
    return _assemble(design, (float(size[0]), float(size[1])), stands, mirrors)


def plate_solid(design: Design, mirrors: str = "") -> Body:
    """Build the plate with its pillar rows.

    Parameters
    ----------
    design : Design
        The plate as built.
    mirrors : {'', 'x', 'y', 'xy'}, optional
        Axes along which only the positive side is kept; a pillar on a mirror plane is cut in half.

    Returns
    -------
    Body
        The plate; pillars and sections of other materials are bonded to it.

    Raises
    ------
    GeometryError
        If the parts do not make one body or overlap, or if a pillar is not symmetric in a mirror that cuts it.
    """
    return _assemble(design, None if design.outline else design.plate_m, design.standing(), mirrors)


def part_solid(design: Design, part: str) -> Body:
    """Build one whole part of a design.

    Parameters
    ----------
    design : Design
        The plate as built.
    part : {'zone', 'pillar', 'plate'}
        The zone, the isolated pillar or the plate.

    Returns
    -------
    Body
        The part.

    Raises
    ------
    GeometryError
        As `pillar_solid` and `plate_solid`.
    """
    if part == "pillar":
        assert design.pillar
        return pillar_solid(design.pillar)
    return (zone_solid if part == "zone" else plate_solid)(design)


def cad_surface(shape: Any, deflection: float, angle: float = ANGULAR_DEFLECTION) -> CadSurface:
    """Triangulate a CAD shape.

    The shape is copied first, because the kernel would otherwise return a coarser triangulation that it already holds.

    Parameters
    ----------
    shape : cadquery.Shape
        Shape in mm.
    deflection : float
        Largest distance of a triangle from the surface, in mm.
    angle : float, optional
        Largest angle between the facets of a curve, in rad.

    Returns
    -------
    CadSurface
        Triangles in mm, each with its CAD face.

    Raises
    ------
    MeshError
        For a shape without faces.
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


def _assemble(
    design: Design, size_m: tuple[float, float] | None, stands: tuple[PillarGroup, ...], mirrors: str
) -> Body:
    """Parts of the plate's material united, those of another one bonded to it; without a size on the plate's own outline."""
    with _KERNEL:
        return _united(design, size_m, stands, mirrors)


def _united(design: Design, size_m: tuple[float, float] | None, stands: tuple[PillarGroup, ...], mirrors: str) -> Body:
    placed = [part for each in stands for part in _standing(each, design.thickness_m, mirrors)]
    stems, upper = ([part for part in placed if (part[0] == "pillar") == is_stem] for is_stem in (True, False))
    foreign = bool(stems and design.pillar and design.pillar.material != design.stack.back)
    foreign |= bool(stems and design.layers)  # of the back's own material they would be a layer by height alone
    stack, pillars = design.stack, [shape for _, shape in stems]
    bonds = frozenset(["pillar"] if foreign else []) | {name for name, _ in upper}
    bonds |= frozenset(stack.region_names[1:])
    blocks = _blocks(size_m, stack, mirrors) if size_m else [cast(Outline, design.outline).solid()]
    if pillars and not foreign:  # one boolean for all: pairwise fusing grows with the square of their number
        blocks, pillars = [_one_solid(blocks[0].fuse(*pillars), "plate and pillars")], []
    shape = share_faces([*blocks, *pillars, *(part for _, part in upper)]) if bonds else blocks[0]
    boxes = tuple(_box_of(*part) for part in upper)
    return Body(shape, design.thickness_m, bonds, boxes, stack.joints_m)


def _box_of(name: str, shape: Any) -> tuple[str, Box]:
    """The box round a part, with its name."""
    box = shape.BoundingBox(1e-9)
    low, high = (box.xmin, box.ymin, box.zmin), (box.xmax, box.ymax, box.zmax)
    return name, Box(*((x / MM, y / MM, z / MM) for x, y, z in (low, high)))


def _standing(stand: PillarGroup, thickness_m: float, mirrors: str) -> list[tuple[str, Any]]:
    """Parts of pillars with their names, moved to their places on one face or both; those on a mirror cut by it, those
    beyond it left out.
    """
    import cadquery as cq

    if not len(stand.centres):
        return []
    parts, near = _parts(stand.pillar), 0.25 * stand.pillar.base_m
    known: dict[tuple[str, str, bool], Any] = {(name, "", False): shape for name, shape in parts}
    placed = []
    for x, y in stand.centres:
        at = {"x": x, "y": y}
        if any(at[letter] < -near for letter in mirrors):
            continue
        cut = "".join(letter for letter in mirrors if at[letter] < near)
        for name, shape in parts:
            if (name, cut, False) not in known:
                known[name, cut, False] = _half(shape, cut)
            own = known[name, cut, False]
            placed.append((name, own.moved(cq.Location(cq.Vector(MM * x, MM * y, MM * thickness_m)))))
            if stand.pillar.faces == 2:
                if (name, cut, True) not in known:
                    known[name, cut, True] = own.mirror("XY")
                placed.append((name, known[name, cut, True].moved(cq.Location(cq.Vector(MM * x, MM * y, 0.0)))))
    return placed


def _half(shape: Any, mirrors: str) -> Any:
    """Part of a centred shape at x >= 0 and/or y >= 0, after checking that the rest is its mirror image."""
    size = 4.0 * shape.BoundingBox().DiagonalLength
    low, high = np.full(3, -size), np.full(3, size)
    for letter in mirrors:
        low["xy".index(letter)] = 0.0
    kept = _one_solid(shape.intersect(_box(low / MM, high / MM)), "half a pillar")
    if abs(kept.Volume() * 2 ** len(mirrors) - shape.Volume()) > SAME_VOLUME * shape.Volume() or any(
        _one_solid(shape.intersect(shape.mirror({"x": "YZ", "y": "XZ"}[letter])), "a mirrored pillar").Volume()
        < (1.0 - SAME_VOLUME) * shape.Volume()
        for letter in mirrors
    ):
        raise GeometryError(f"the pillar is not symmetric in {' = 0 and '.join(mirrors)} = 0: it cannot be mirrored")
    return kept


def _parts(pillar: Pillar) -> list[tuple[str, Any]]:
    """Parts of a pillar on z = 0, named after their lowest section; sections of one material that touch are one part."""
    import cadquery as cq

    sections, names = pillar.sections, section_names(len(pillar.sections))
    parts = [("pillar", _stem_shape(pillar))]
    for place in range(1, len(sections)):
        own, below = sections[place], sections[place - 1]
        shape = own.form.solid(own.height_m).moved(cq.Location(cq.Vector(0.0, 0.0, MM * pillar.levels_m[place])))
        if own.material == below.material:
            name, lower = parts.pop()
            parts.append((name, _one_solid(lower.fuse(shape).clean(), "two sections of a pillar")))
        else:
            parts.append((names[place], shape))
    return parts


def _stem_shape(pillar: Pillar) -> Any:
    """The bare pillar, then its foot fillet: both cut from a filleted pillar on a slab, so that the flare is exact."""
    bare = pillar.form.solid(pillar.height_m)
    if pillar.fillet_m == 0.0:
        return bare
    reach = MM * (pillar.footprint_m + 2.0 * pillar.fillet_m)
    room = np.array([reach, reach, 2.0 * MM * pillar.height_m]) / MM
    slab = _box(np.array([-room[0], -room[1], -room[2]]), np.array([room[0], room[1], 0.0]))
    above = _box(np.array([-room[0], -room[1], 0.0]), room)
    try:
        fused = _one_solid(slab.fuse(bare), "the pillar's foot")
        inside = 0.75 * reach
        feet = [
            edge
            for edge in fused.Edges()
            if abs(edge.Center().z) < 1e-6 and max(abs(edge.Center().x), abs(edge.Center().y)) < inside
        ]
        return _one_solid(fused.fillet(MM * pillar.fillet_m, feet).intersect(above), "the filleted pillar")
    except GeometryError:
        raise
    except Exception as fault:  # the kernel raises its own untyped errors when a fillet does not fit
        what = f"fillet of {MM * pillar.fillet_m:g} mm at the foot of a {pillar.shape} pillar"
        raise GeometryError(f"{what} of {MM * pillar.base_m:g} mm cannot be built") from fault


def _blocks(size_m: tuple[float, float], stack: Stack, mirrors: str) -> list[Any]:
    """The layers of a rectangle of plate, from the touch face."""
    length_m, width_m = size_m
    low = [0.0 if "x" in mirrors else -length_m / 2.0, 0.0 if "y" in mirrors else -width_m / 2.0]
    high = [length_m / 2.0, width_m / 2.0]
    return [_box(np.array([*low, z0]), np.array([*high, z1])) for z0, z1 in pairwise(stack.levels_m.tolist())]


def _box(low_m: NDArray[np.float64], high_m: NDArray[np.float64]) -> Any:
    import cadquery as cq

    low, size = MM * low_m, MM * (high_m - low_m)
    if not (size > 0.0).all():
        raise GeometryError(f"a box needs three positive sides, got {' x '.join(f'{s:g}' for s in size)} mm")
    length, width, height = (float(side) for side in size)
    return cq.Solid.makeBox(length, width, height, cq.Vector(*(float(c) for c in low)))


def share_faces(solids: list[Any]) -> Any:
    """Join solids to one compound whose contact faces are shared, none of them merged.

    Parameters
    ----------
    solids : list of cadquery.Solid
        Solids in mm.

    Returns
    -------
    cadquery.Shape
        The compound.

    Raises
    ------
    GeometryError
        If they overlap.
    """
    import cadquery as cq
    from OCP.BOPAlgo import BOPAlgo_Builder

    builder = BOPAlgo_Builder()
    for solid in solids:
        builder.AddArgument(solid.wrapped)
    builder.Perform()
    shape = cq.Shape.cast(builder.Shape())
    volume = sum(solid.Volume() for solid in solids)
    if len(shape.Solids()) != len(solids) or abs(shape.Volume() - volume) > SAME_VOLUME * volume:
        raise GeometryError(
            "bonded parts overlap: sections of pillars may touch the plate and each other, but not intersect"
        )
    return shape


def _one_solid(shape: Any, what: str) -> Any:
    solids = shape.Solids()
    if len(solids) != 1 or not solids[0].isValid():
        raise GeometryError(f"{what} should make one valid solid, the CAD kernel found {len(solids)}")
    return solids[0]


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
