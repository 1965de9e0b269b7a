"""Pillar shapes, one class each: keys, section, symmetry, solid, rim, outline, volume and printable limits."""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from math import pi
from pathlib import Path
from typing import Any, ClassVar, Self

import numpy as np
from numpy.polynomial.polynomial import polyval

from geometry.elements import FloatArray
from geometry.errors import GeometryError
from geometry.files import read_by_command, silence_kernel
from geometry.lattice import MIRRORS

MM = 1e-3  # m
SAME = 1e-9  # of the width: points closer than this are one
CORNERS = np.array([[1.0, 1.0], [-1.0, 1.0], [-1.0, -1.0], [1.0, -1.0]])

ON_PLANE_MM = 1e-4  # a foot this close to z = 0 is on it: CAD systems write about seven digits

DRAWN, RIM = 48, 16  # corners of the polygons that stand for the circle in drawings and for the sizing of meshes

# Saint-Venant's flexure of a regular hexagon solved on triangles; tests/geometry/test_pillar_shapes.py solves it again
HEXAGON_P, HEXAGON_Q = 1.17367, 1.02248

# Saint-Venant's flexure of crosses solved on graded triangles for arms of 0.01 to 1 times the width, as polynomials of that
# ratio; tests/geometry/test_pillar_shapes.py solves it again
CROSS_P = (2.4001, -2.4543, -4.3225, 14.3765, -9.967, -1.5695, 3.4709, -0.7342)

CROSS_Q = (2.701, -2.6734, -4.5463, 1.8769, 30.9222, -53.5845, 34.4635, -8.0593)
SHAPES: dict[str, type[PillarShape]] = {}


@dataclass(frozen=True)
class Section:
    """A plane section: area (m2) and second moments about the x and the y axis through its centroid (m4)."""

    area_m2: float
    about_x_m4: float
    about_y_m4: float


@dataclass(frozen=True)
class PillarShape:
    """A pillar's shape with its sizes in m: width of the foot, of the tip, further sizes by name, the CAD file if any.

    Centred on the z axis, foot on z = 0. `keys` are those of the case file's [pillar] in addition to height_mm, all of
    them required, the foot's width first. A shape says its outline and its shear factor; it overrides what does not follow.
    """

    width_m: float
    tip_m: float
    more_m: tuple[tuple[str, float], ...] = ()
    file: str | None = None

    name: ClassVar[str]
    keys: ClassVar[tuple[str, ...]]
    has_height: ClassVar[bool] = True  # given by height_mm; otherwise the shape knows it
    can_have_fillet: ClassVar[bool] = True
    sizing_note: ClassVar[str] = ""  # what beam theory neglects
    plan: ClassVar[str] = ""  # how hexahedra follow a foot that boxes cannot: geometry/hex/panels.py

    @classmethod
    def from_case(cls, given: Mapping[str, Any], folder: Path) -> Self:
        """The shape from its keys of the case file, lengths in mm; files are looked for from `folder`. GeometryError."""
        more = tuple((f"{key.removesuffix('_mm')}_m", MM * given[key]) for key in cls.keys[1:])
        return cls(MM * given[cls.keys[0]], MM * given[cls.keys[0]], more)

    @classmethod
    def size_violations(cls, given: Mapping[str, float]) -> Iterator[tuple[str, str]]:
        """Incompatible sizes among the known ones in mm (fillet_mm too): the key at fault and its limit."""
        yield from ()

    def size_m(self, name: str) -> float:
        """A further size by its name, such as arm_m; NaN where it is not known."""
        return dict(self.more_m).get(name, float("nan"))

    def height_m(self, given_m: float) -> float:
        """The height, m: the one that the case gives, for all but shapes that bring their own."""
        return given_m

    def outline(self, grow_m: float = 0.0) -> FloatArray:
        """Corners of the foot anticlockwise, (n, 2) m, every side moved outwards by `grow_m`."""
        raise NotImplementedError

    def shear_factor(self, poisson: float) -> float:
        """Timoshenko's shear factor of the section."""
        raise NotImplementedError

    @property
    def rectangles(self) -> FloatArray | None:
        """Foot of a straight pillar as a union of rectangles x0, x1, y0, y1, (n, 4) m; None where boxes cannot make it."""
        return None

    @property
    def is_square_prism(self) -> bool:
        """True when the pillar is a single box on a square foot of its width."""
        half = self.width_m / 2.0
        return self.rectangles is not None and self.rectangles.tolist() == [[-half, half, -half, half]]

    @property
    def grows(self) -> bool:
        """True when a wider pillar is the same shape with all its widths in proportion, and hexahedra follow it."""
        return self.rectangles is not None or bool(self.plan)

    @property
    def mirrors(self) -> tuple[str, ...]:
        """Mirrors of the pillar: "x" (x -> -x), "y", and "d", which exchanges x and y; derived from the outline."""
        corners = self.outline()
        points = np.vstack([corners, (corners + np.roll(corners, 1, axis=0)) / 2.0])
        return tuple(name for name, mirror in MIRRORS.items() if _alike(points, points @ mirror))

    @property
    def section(self) -> Section:
        """The foot's section without fillet, from Green's theorem on its outline."""
        (x, y), (nx, ny) = self.outline().T, np.roll(self.outline(), -1, axis=0).T
        cross = x * ny - nx * y
        about_x, about_y = (float(cross @ (a * a + a * b + b * b)) / 12.0 for a, b in ((y, ny), (x, nx)))
        return Section(float(cross.sum()) / 2.0, about_x, about_y)

    def extent_m(self, fillet_m: float = 0.0) -> tuple[float, float]:
        """Extent of the foot along x and y, fillet included (its flares meet in mitres), m."""
        x, y = np.ptp(self.outline(fillet_m), axis=0)
        return float(x), float(y)

    def reach_m(self, fillet_m: float = 0.0) -> tuple[float, float]:
        """Extent of the pillar along x and y at any height, fillet included, m."""
        (x, y), (foot_x, foot_y) = self.extent_m(), self.extent_m(fillet_m)
        return max(foot_x, self.taper * x), max(foot_y, self.taper * y)

    def footprint_m(self, fillet_m: float) -> float:
        """Largest extent of the foot, fillet included, m."""
        return max(self.extent_m(fillet_m))

    @property
    def features(self) -> dict[str, float]:
        """Lengths in plan that a printer must resolve and a mesh must follow, m."""
        return {"pillar foot": self.width_m} | ({"pillar tip": self.tip_m} if self.tip_m > 0.0 else {})

    @property
    def smallest_m(self) -> float:
        """The smallest of them, m."""
        return min(self.features.values())

    @property
    def sizes_text(self) -> str:
        """Its sizes in plan, for a caption."""
        return f"{self.width_m / MM:g} mm wide"

    @property
    def taper(self) -> float:
        """Width of the section at the tip over that at the foot, changing linearly between."""
        return self.tip_m / self.width_m

    def volume_m3(self, height_m: float) -> float:
        """Volume without fillet, m3."""
        ratio = self.taper
        return self.section.area_m2 * height_m * (1.0 + ratio + ratio**2) / 3.0

    def rim(self) -> FloatArray:
        """The foot's edge as a closed polygon, (n, 2) m: re-entrant where the pillar stands on a plate."""
        return self.outline()

    def solid(self, height_m: float) -> Any:
        """The CAD solid without fillet (cadquery, mm): the outline pulled up. GeometryError where it cannot be built."""
        import cadquery as cq

        corners = [(float(x), float(y)) for x, y in self.outline() / MM]
        return cq.Workplane().polyline(corners).close().extrude(height_m / MM).val()


class Square(PillarShape):
    """A square prism of side `width_m`, its sides along x and y."""

    name = "square"
    keys: ClassVar[tuple[str, ...]] = ("side_mm",)

    def outline(self, grow_m: float = 0.0) -> FloatArray:
        """Its four corners."""
        return CORNERS * (self.width_m / 2.0 + grow_m)

    def shear_factor(self, poisson: float) -> float:
        """10 (1 + nu)/(12 + 11 nu). Source: cowper1966."""
        return 10.0 * (1.0 + poisson) / (12.0 + 11.0 * poisson)

    @property
    def rectangles(self) -> FloatArray | None:
        """The square itself."""
        half = self.width_m / 2.0
        return np.array([[-half, half, -half, half]])


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
        solid = _step_pillar_shape(path)
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
        return _step_pillar_shape(self.file or "")


class Round(PillarShape):
    """A cylinder of diameter `width_m`."""

    name = "round"
    keys = ("diameter_mm",)
    plan = "disc"

    def outline(self, grow_m: float = 0.0) -> FloatArray:
        """A polygon in the circle, with corners on both axes."""
        return self._polygon(DRAWN, self.width_m / 2.0 + grow_m)

    def rim(self) -> FloatArray:
        """A coarser polygon."""
        return self._polygon(RIM, self.width_m / 2.0)

    def shear_factor(self, poisson: float) -> float:
        """6 (1 + nu)/(7 + 6 nu). Source: cowper1966."""
        return 6.0 * (1.0 + poisson) / (7.0 + 6.0 * poisson)

    @property
    def section(self) -> Section:
        """The circle, not its polygon."""
        about = pi * self.width_m**4 / 64.0
        return Section(pi * self.width_m**2 / 4.0, about, about)

    def solid(self, height_m: float) -> Any:
        """A cylinder."""
        import cadquery as cq

        return cq.Solid.makeCylinder(self.width_m / MM / 2.0, height_m / MM)

    @staticmethod
    def _polygon(count: int, radius_m: float) -> FloatArray:
        angle = 2.0 * pi * np.arange(count) / count
        return radius_m * np.column_stack([np.cos(angle), np.sin(angle)])


class Hexagonal(PillarShape):
    """A regular hexagonal prism, `width_m` across flats. Two flats face y (along the zone), two corners lie on the x axis.

    Across corners it is 2/sqrt(3) times as wide. It is its own mirror image in x and in y, but not with x and y exchanged.
    """

    name = "hexagonal"
    keys = ("side_mm",)
    plan = "hexagon"

    def outline(self, grow_m: float = 0.0) -> FloatArray:
        """Its six corners."""
        half = self.width_m / 2.0 + grow_m
        corner = 2.0 * half / np.sqrt(3.0)
        return np.array(
            [[corner, 0.0], [corner / 2.0, half], [-corner / 2.0, half], [-corner, 0.0], [-corner / 2.0, -half],
             [corner / 2.0, -half]]
        )  # fmt: skip

    def shear_factor(self, poisson: float) -> float:
        """(1 + nu)/(P + Q nu), to 1e-5: between a square's and a circle's, alike in every direction. Source: cowper1966."""
        return (1.0 + poisson) / (HEXAGON_P + HEXAGON_Q * poisson)


class Cross(PillarShape):
    """A prism of two crossed bars along x and y: `width_m` overall, arms `arm_m` wide."""

    name = "cross"
    keys = ("side_mm", "arm_mm")

    @classmethod
    def size_violations(cls, given: Mapping[str, float]) -> Iterator[tuple[str, str]]:
        """Arms narrower than the whole; a foot fillet that ends within the notch between two arms."""
        side, arm, fillet = given.get("side_mm"), given.get("arm_mm"), given.get("fillet_mm")
        if side is None or arm is None:
            return
        if arm >= side:
            yield "arm_mm", f"must be smaller than the pillar's overall width, side_mm = {side:g}"
        elif fillet and fillet >= (side - arm) / 2.0:
            notch = f"{(side - arm) / 2.0:g}, the depth of the notch between two arms"
            yield "fillet_mm", f"must be smaller than {notch}, (side_mm - arm_mm)/2"

    @property
    def arm_m(self) -> float:
        """Width of an arm, m."""
        return self.size_m("arm_m")

    def outline(self, grow_m: float = 0.0) -> FloatArray:
        """Its twelve corners."""
        a, b = self.arm_m / 2.0 + grow_m, self.width_m / 2.0 + grow_m
        quarter = np.array([[b, a], [a, a], [a, b]])
        turn = np.array([[0.0, 1.0], [-1.0, 0.0]])  # a quarter turn of rows
        return np.vstack([quarter @ np.linalg.matrix_power(turn, count) for count in range(4)])

    def shear_factor(self, poisson: float) -> float:
        """(1 + nu)/(P + Q nu) with polynomials of arm over width, to 3e-4. Source: cowper1966."""
        ratio = self.arm_m / self.width_m
        return float((1.0 + poisson) / (polyval(ratio, CROSS_P) + polyval(ratio, CROSS_Q) * poisson))

    @property
    def rectangles(self) -> FloatArray | None:
        """The bar along x and the bar along y."""
        a, b = self.arm_m / 2.0, self.width_m / 2.0
        return np.array([[-b, b, -a, a], [-a, a, -b, b]])

    @property
    def features(self) -> dict[str, float]:
        """The arms, too."""
        return super().features | {"pillar arm": self.arm_m}

    @property
    def sizes_text(self) -> str:
        """Width and arms."""
        return f"{super().sizes_text} with arms of {self.arm_m / MM:g} mm"


class Tapered(Square):
    """A square frustum: side `width_m` at the foot, `tip_m` at the tip."""

    name = "tapered"
    keys = ("base_mm", "tip_mm")
    plan = "rectangle"

    @classmethod
    def from_case(cls, given: Mapping[str, Any], folder: Path) -> Self:
        """The frustum from both of its sides."""
        return cls(MM * given["base_mm"], MM * given["tip_mm"])

    @property
    def rectangles(self) -> FloatArray | None:
        """None: its sides lean."""
        return None

    def solid(self, height_m: float) -> Any:
        """A ruled loft between the two squares, a box where they are alike."""
        import cadquery as cq

        base, tip = self.width_m / MM, self.tip_m / MM
        if base == tip:
            return super().solid(height_m)
        return cq.Workplane().rect(base, base).workplane(offset=height_m / MM).rect(tip, tip).loft(ruled=True).val()


def _step_pillar_shape(path: str | os.PathLike[str]) -> Any:
    """The one solid of a STEP file (cadquery, mm) once it is known to stand on z = 0; errors as Step.from_file."""
    solid = step_solid(path)
    _check_foot(solid, Path(path))
    return solid


def step_solid(path: str | os.PathLike[str]) -> Any:
    """Read the one solid of a STEP file of any length unit.

    Parameters
    ----------
    path : path
        The file.

    Returns
    -------
    cadquery.Solid
        In mm.

    Raises
    ------
    GeometryError
        If the file is missing or unreadable, or does not hold exactly one closed, valid solid.
    """
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
    return solid


def register(*shapes: type[PillarShape]) -> None:
    """Make shapes known by their names, before a case file is read.

    Parameters
    ----------
    *shapes : type
        Subclasses of PillarShape.
    """
    SHAPES.update({shape.name: shape for shape in shapes})


def _alike(points: FloatArray, images: FloatArray) -> bool:
    """Whether every image falls on a point."""
    gaps = np.abs(points[:, None, :] - images[None, :, :]).max(axis=2).min(axis=0)
    return bool(gaps.max() <= SAME * np.abs(points).max())


def _read(file: Path) -> Any:
    """The shape in mm, whatever unit the file declares; the reader's own messages stay off standard output."""
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
        raise GeometryError(f"{file}: holds loose faces in addition to its solid, need exactly one closed solid")
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


register(Square, Round, Tapered, Hexagonal, Cross, Step)


def shape_of(name: str, width_m: float, tip_m: float, more: Any = (), file: str | None = None) -> PillarShape:
    """Return the shape of a name with its sizes.

    Parameters
    ----------
    name : str
        Name of a registered shape, such as square.
    width_m, tip_m : float
        Widths of the foot and of the tip in m.
    more : iterable, optional
        Further sizes in m, as pairs of name and size.
    file : str, optional
        CAD file of the shape.

    Returns
    -------
    PillarShape
        The shape.

    Raises
    ------
    GeometryError
        For an unknown name.
    """
    if name not in SHAPES:
        raise GeometryError(f"pillar shape '{name}' is not one of {', '.join(SHAPES)}")
    return SHAPES[name](width_m, tip_m, tuple(more), file)


def stored_shape(record: Mapping[str, Any]) -> PillarShape:
    """Return the shape of a pillar as records describe it.

    Parameters
    ----------
    record : mapping
        Name `shape`, widths `base_m` and `tip_m`, and further sizes in m by name.

    Returns
    -------
    PillarShape
        The shape.

    Raises
    ------
    GeometryError
        For an unknown name.
    """
    more = tuple((name, size) for name, size in record.items() if isinstance(size, float))
    return shape_of(record["shape"], record["base_m"], record["tip_m"], more)


def in_words(names: Mapping[str, Any] | None = None) -> str:
    """List shapes as a message does, such as "square, round or step".

    Parameters
    ----------
    names : mapping, optional
        Shapes by name; all registered ones by default.

    Returns
    -------
    str
        The names.
    """
    *first, last = names or SHAPES
    return f"{', '.join(first)} or {last}" if first else last
