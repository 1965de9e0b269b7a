"""Positions of zone, pillars, plate edges and piezo patches: arrays and boxes only, no CAD.

Axes: x along the zone, y across, z = 0 the touch face, pillars on z = thickness, origin at the plate's centre.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from math import atan2, floor, inf, pi
from typing import Literal

import numpy as np

from geometry.elements import BoolArray, FloatArray
from geometry.lattice import Lattice, room_in_cell
from geometry.materials import USUAL_C, Layer, Material, PiezoMaterial, Stack
from geometry.outline import Outline
from geometry.pillar_shapes import PillarShape, shape_of
from geometry.supports import Support, are_mirrored

SHORT = 2.0  # half-wavelength over thickness: there thin-plate theory is 45 % too high, Mindlin's a few percent
PLACES = 12  # digits of a length in m: places that agree to a picometre are one
ROUNDING = 1e-9  # relative: 4.0 mm seven times is 28 mm, whatever binary fractions say


def half_wavelength_m(length_m: float, nodal_lines: int, held: int = 0) -> float | None:
    """Compute the half-wavelength of the beam shape with N nodal lines along a length L.

    L/(N - 1/2) between free ends: cosh kL cos kL = 1 has its roots at kL = (N - 1/2) pi, to 0.4 % at N = 2 and better
    beyond, so that the free ends take half a half-wavelength less than N. L/(N + 1/4) with one pinned end, L/(N + 1) with
    two. A count of lines, such as that of elements, follows L/N instead.

    Parameters
    ----------
    length_m : float
        Length L in m.
    nodal_lines : int
        Number N of nodal lines between the ends.
    held : int, optional
        Number of pinned ends; the others are free.

    Returns
    -------
    float or None
        Half-wavelength in m; None for shapes that are rigid: N = 0 and 1 between free ends, N = 0 with one.
    """
    if held == 2:
        return length_m / (nodal_lines + 1.0)
    if held == 1:
        return length_m / (nodal_lines + 0.25) if nodal_lines else None
    return length_m / (nodal_lines - 0.5) if nodal_lines > 1 else None


@dataclass(frozen=True)
class Section:
    """A part of a pillar that stands on the part below, about the same axis: shape, sizes and height in m, material."""

    shape: str
    base_m: float
    tip_m: float
    height_m: float
    material: Material
    more_m: tuple[tuple[str, float], ...] = ()

    @classmethod
    def square(cls, side_m: float, height_m: float, material: Material) -> Section:
        """A square prism."""
        return cls("square", side_m, side_m, height_m, material)

    @property
    def form(self) -> PillarShape:
        """Its shape with its sizes. Raises GeometryError for an unknown name."""
        return shape_of(self.shape, self.base_m, self.tip_m, self.more_m, None)

    @property
    def outline(self) -> tuple[object, ...]:
        """Its section at foot and top: equal for parts that differ in height and material alone."""
        return self.shape, self.base_m, self.tip_m, self.more_m

    @property
    def mass_kg(self) -> float:
        """Its mass, kg."""
        return self.form.volume_m3(self.height_m) * self.material.density_kg_m3


MAX_SECTIONS = 8


def section_names(count: int) -> tuple[str, ...]:
    """Name the regions of a mesh for the sections of a pillar.

    Parameters
    ----------
    count : int
        Number of sections.

    Returns
    -------
    tuple of str
        From the foot: pillar, then section2 and so on.
    """
    return ("pillar", *(f"section{number}" for number in range(2, count + 1)))


Rim = tuple[tuple[Material, float], tuple[Material, float]]  # wedges at an edge: material and angle in rad

PLAIN = "square, round, hexagonal, tapered or cross-shaped pillars of one section without fillet, on the back alone,"


@dataclass(frozen=True)
class Pillar:
    """One pillar, lengths in m.

    Attributes
    ----------
    shape : str
        Name of its shape.
    base_m, tip_m : float
        Widths of foot and tip.
    height_m : float
        Height of its first section.
    material : Material
        Its material.
    fillet_m : float
        Radius of the fillet at the foot.
    file : str or None
        CAD file of the shape.
    more_m : tuple of tuple
        Further sizes of the shape, as pairs of name and length.
    upper : tuple of Section
        Its sections above the first one, from the foot up.
    faces : int
        1 on the back only, 2 with its mirror image on the touch face.
    """

    shape: str
    base_m: float
    tip_m: float
    height_m: float
    material: Material
    fillet_m: float = 0.0
    file: str | None = None
    more_m: tuple[tuple[str, float], ...] = ()
    upper: tuple[Section, ...] = ()
    faces: int = 1

    @property
    def form(self) -> PillarShape:
        """The shape with its sizes. Raises GeometryError for an unknown name."""
        return shape_of(self.shape, self.base_m, self.tip_m, self.more_m, self.file)

    @property
    def footprint_m(self) -> float:
        """Largest extent of the foot, fillet included, m."""
        return self.form.footprint_m(self.fillet_m)

    @property
    def top_m(self) -> float:
        """Height from foot to top, m."""
        return self.height_m + sum(section.height_m for section in self.upper)

    @property
    def parts(self) -> tuple[Pillar | Section, ...]:
        """All sections from the foot up, the first one with the pillar's own fillet and file."""
        return self, *self.upper

    @property
    def highest(self) -> int:
        """Number of its highest section from 0, the lowest of equal ones: pre-design varies the height of this one."""
        heights = [section.height_m for section in self.parts]
        return heights.index(max(heights))

    @property
    def sections(self) -> tuple[Section, ...]:
        """All sections from the foot up; the first one's fillet and STEP file are the pillar's."""
        first = Section(self.shape, self.base_m, self.tip_m, self.height_m, self.material, self.more_m)
        return first, *self.upper

    @property
    def levels_m(self) -> tuple[float, ...]:
        """Heights above the foot where sections begin and end, ascending from 0, m."""
        return tuple(np.cumsum([0.0, self.height_m, *(section.height_m for section in self.upper)]).tolist())

    @property
    def widest_m(self) -> float:
        """Largest extent of its sections, the foot's fillet included, m."""
        return max([self.footprint_m, *(section.form.footprint_m(0.0) for section in self.upper)])

    @property
    def reach_m(self) -> tuple[float, float]:
        """Extent of the pillar along x and y at any height, fillet included, m."""
        reaches = [self.form.reach_m(self.fillet_m), *(section.form.reach_m(0.0) for section in self.upper)]
        return max(x for x, _ in reaches), max(y for _, y in reaches)

    @property
    def features(self) -> dict[str, float]:
        """Lengths in plan that a printer must resolve and a mesh must follow, m."""
        own = self.form.features
        for number, section in enumerate(self.upper, start=2):
            known = section.form.features.items()
            own |= {f"section {number} {name.removeprefix('pillar ')}": size for name, size in known}
        return own

    @property
    def smallest_m(self) -> float:
        """The smallest of them and of the heights of several sections, m."""
        return min([*self.features.values(), *(section.height_m for section in self.sections if self.upper)])

    @property
    def is_made_of_boxes(self) -> bool:
        """True when structured hexahedra can follow the pillar exactly."""
        return self.fillet_m == 0.0 and all(each.form.rectangles is not None for each in self.parts)

    @property
    def takes_hexahedra(self) -> bool:
        """True when hexahedra, straight or curved, can follow the pillar where its panel leaves them room."""
        upright = {section.outline for section in self.sections} == {
            self.sections[0].outline
        } and self.base_m == self.tip_m
        return self.is_made_of_boxes or (self.form.grows and not self.fillet_m and (not self.upper or upright))

    @property
    def is_plain(self) -> bool:
        """True when the pillar can grow as a whole and hexahedra follow it, as PLAIN describes."""
        return self.form.grows and not self.fillet_m and not self.upper and self.faces == 1

    @property
    def wall_angle(self) -> float:
        """Angle that the pillar fills above the rim of its foot, rad: a right one unless its sides lean."""
        return atan2(self.height_m, (self.base_m - self.tip_m) / 2.0)

    @property
    def is_square_prism(self) -> bool:
        """True when the pillar is a single box on a square foot: only such pillars can be varied, or were calibrated."""
        return self.form.is_square_prism and self.fillet_m == 0.0 and not self.upper

    @property
    def mirrors(self) -> tuple[str, ...]:
        """Mirrors that leave its shape and its materials alone: x, y, and "d", which exchanges x and y."""
        own = [section.form.mirrors for section in self.upper] + [section.material.mirrors for section in self.upper]
        return tuple(name for name in self.form.mirrors if all(name in each for each in (self.material.mirrors, *own)))

    @property
    def is_symmetric(self) -> bool:
        """True when the pillar is its own mirror image in x and y."""
        return {"x", "y"} <= {*self.mirrors}

    @property
    def joints(self) -> tuple[Rim, ...]:
        """Edges at which stress is singular where its sections meet: the material and the angle in rad of either part."""
        found: list[Rim] = []
        for below, above in pairwise(self.sections):
            parts = (below.material, pi), (above.material, pi)
            halved = tuple((material, angle / 2.0) for material, angle in parts)
            if below.tip_m > above.base_m:
                found.append((parts[0], halved[1]))
            elif below.tip_m < above.base_m:
                found.append((parts[1], halved[0]))
            elif below.material != above.material:
                found.append((halved[0], halved[1]))
        return tuple(found)

    @property
    def step_m(self) -> float:
        """Least distance of the sides of other sections from those of the foot, m, flush ones apart; inf without any."""
        widths = [width for section in self.upper for width in (section.base_m, section.tip_m)]
        return min((abs(width - self.base_m) / 2.0 for width in widths if width != self.base_m), default=inf)

    @property
    def volume_m3(self) -> float:
        """Volume without fillet, m3; NaN where it is not known."""
        return sum(section.form.volume_m3(section.height_m) for section in self.parts)

    @property
    def mass_kg(self) -> float:
        """Mass without fillet, kg; NaN where the volume is not known."""
        return self.form.volume_m3(self.height_m) * self.material.density_kg_m3 + sum(
            section.mass_kg for section in self.upper
        )


def region_materials(stack: Stack, pillar: Pillar | None) -> dict[str, Material]:
    """Return the material of each region that a mesh of a plate with such pillars may have.

    Parameters
    ----------
    stack : Stack
        Layers of the plate.
    pillar : Pillar or None
        Pillar on the plate.

    Returns
    -------
    dict of Material
        Materials by region: those of the stack, body, and the pillar's sections.
    """
    sections = [section.material for section in pillar.sections] if pillar else [stack.back]
    return stack.regions | {"body": stack.back} | dict(zip(section_names(len(sections)), sections, strict=True))


@dataclass(frozen=True)
class PillarGroup:
    """Equal pillars and where they stand: centres (n, 2), m."""

    pillar: Pillar
    centres: FloatArray


@dataclass(frozen=True)
class Design:
    """The plate as built: zones, pillar rows on both sides of each, passive margin; lengths in m.

    Attributes
    ----------
    length_m, width_m, thickness_m : float
        Length of the plate and its zones along x, width of one zone along y, thickness of the plate.
    nodal_lines : int
        Nodal lines of the target shape.
    material : Material
        Material of the plate; that of its back if it has several layers.
    pillar : Pillar or None
        Pillar of all rows, or of the first row if rows differ.
    pitch_x_m, pitch_y_m : float
        Pitches along a row and between rows, those of the first row if rows differ.
    rows : int
        Rows beyond each outer zone.
    extension_m : float
        Margin beyond the last row.
    graded, graded_pitches_m : tuple of Pillar or float
        Pillar and pitch of each row from the zone outwards if rows differ, else empty. A row stands in the middle of a
        strip as wide as its pitch.
    stagger : bool
        Whether every other row, from the second onwards, is shifted by half a pitch along x.
    zones : int
        Number of equal zones, next to each other along y.
    shared_rows : int
        Rows in each gap between zones, half of them at either border.
    zone_gap_m : float
        Distance between the borders of neighbouring zones.
    layers : tuple of Layer
        Layers of the plate from the touch face to the back if it has several, else empty.
    larger_m : tuple of float or None
        Length and width of a plate larger than its zone and rows; None for a plate as long as its zone that ends
        `extension_m` beyond its rows.
    centre_m : tuple of float
        Centre (x, y) of the zone, or of all zones together, from that of the plate, or from the origin of an outline.
    surround : bool
        Whether rows stand on all four sides of the zone, with closed corners.
    others_m : tuple of tuple
        Centres (x, y) of further zones of the same size on a larger plate, with the same rows; pillars at one place are one.
    supports : tuple of Support
        Supports of the plate; free without.
    outline : Outline or None
        Solid of a plate of another outline than a rectangle, whose extents are then `larger_m`.
    oblique_m : tuple of tuple or None
        The two shortest vectors (x, y) of a lattice without rows along x that are in line or shifted by half a pitch; pitches
        are then their lengths.
    """

    length_m: float
    width_m: float
    thickness_m: float
    nodal_lines: int
    material: Material
    pillar: Pillar | None
    pitch_x_m: float
    pitch_y_m: float
    rows: int
    extension_m: float
    graded: tuple[Pillar, ...] = ()
    graded_pitches_m: tuple[float, ...] = ()
    stagger: bool = False
    zones: int = 1
    shared_rows: int = 0
    zone_gap_m: float = 0.0
    layers: tuple[Layer, ...] = ()
    larger_m: tuple[float, float] | None = None
    centre_m: tuple[float, float] = (0.0, 0.0)
    surround: bool = False
    others_m: tuple[tuple[float, float], ...] = ()

    @property
    def plate_m(self) -> tuple[float, float]:
        """Length and width of the plate, m."""
        return self.larger_m or (self.length_m, 2.0 * self.half_span_m)

    @property
    def half_length_m(self) -> float:
        """Half of the plate's length along the zone, m."""
        return self.plate_m[0] / 2.0

    @property
    def ends_m(self) -> tuple[float, float, float, float]:
        """Rectangle x0, x1, y0, y1 about the plate, m."""
        if self.outline:
            return self.outline.ends_m
        length, width = self.plate_m
        return -length / 2.0, length / 2.0, -width / 2.0, width / 2.0

    @property
    def zone_ends_m(self) -> tuple[float, float]:
        """x of both ends of the zone, m."""
        return self.centre_m[0] - self.length_m / 2.0, self.centre_m[0] + self.length_m / 2.0

    @property
    def goes_on(self) -> tuple[bool, bool]:
        """Whether the plate goes on beyond the zone's lower and upper end along x."""
        half, (low, high) = self.half_length_m, self.zone_ends_m
        if self.outline:
            sides = self.centre_m[1] - self.width_m / 2.0, self.centre_m[1] + self.width_m / 2.0
            return self.outline.goes_on(low, -1, *sides), self.outline.goes_on(high, 1, *sides)
        slack = ROUNDING * half
        return self.larger_m is not None and low > slack - half, self.larger_m is not None and high < half - slack

    @property
    def held_ends(self) -> int:
        """Ends of the zone at which the plate goes on: the target shape is pinned there, and free at the others."""
        return sum(self.goes_on)

    @property
    def zone_alone(self) -> Design:
        """The same zone and rows on a plate that ends with the zone along x and `extension_m` beyond the rows along y."""
        alone = {"larger_m": None, "centre_m": (0.0, 0.0), "surround": False, "outline": None, "others_m": ()}
        return replace(self, **alone) if self.larger_m else self  # type: ignore[arg-type]

    @property
    def views(self) -> tuple[Design, ...]:
        """The plate seen from each of its zones in turn, whose middle is `centre_m`: for measures over one zone."""
        if self.zones > 1:
            return tuple(replace(self, centre_m=(0.0, y)) for y in self.zone_centres_m.tolist())
        return self._placed

    @property
    def _placed(self) -> tuple[Design, ...]:
        """The plate seen from each of the zones that stand anywhere on it; alone where it has no such zones."""
        places = (self.centre_m, *self.others_m)
        others = [(*places[:number], *places[number + 1 :]) for number in range(len(places))]
        seen = (replace(self, centre_m=own, others_m=rest) for own, rest in zip(places, others, strict=True))
        return tuple(seen) if self.others_m else (self,)

    @property
    def lists_feet(self) -> bool:
        """Whether the pillars of a row are not counted by its length: rows around a zone, or about several anywhere."""
        return self.surround or bool(self.others_m)

    @property
    def lone(self) -> Design:
        """The same plate with its first zone and the rows of that alone."""
        return replace(self, others_m=()) if self.others_m else self

    def passive(self, points: FloatArray) -> BoolArray:
        """Mask of the points (q, 2 or 3) outside the zone about the middle and any other anywhere on the plate, (q,)."""
        return np.asarray(~np.logical_or.reduce([each.in_zone(points) for each in self._placed]))

    def in_zone(self, points: FloatArray) -> BoolArray:
        """Mask of the points (q, 2 or 3), from the plate's centre in m, that lie in the zone about the middle, (q,)."""
        inside = np.abs(points[:, 1] - self.centre_m[1]) < self.width_m / 2.0
        if self.larger_m is not None:
            inside &= np.abs(points[:, 0] - self.centre_m[0]) < self.length_m / 2.0
        return np.asarray(inside)

    def beyond_rows(self, points: FloatArray) -> BoolArray:
        """Mask of the points (q, 2 or 3) outside the rectangles that zones and rows fill, (q,)."""
        beyond = np.ones(len(points), dtype=bool)
        for (x, half_x), (y, half_y) in (each._reach_m for each in self._placed):
            outside = np.abs(points[:, 1] - y) > half_y
            if self.larger_m is not None:
                outside |= np.abs(points[:, 0] - x) > half_x
            beyond &= outside
        return beyond

    @property
    def _reach_m(self) -> tuple[tuple[float, float], tuple[float, float]]:
        """Middle and half extent along x, then along y, of the rectangle that zone and rows fill, m."""
        if self.larger_m is None:
            return (0.0, self.length_m / 2.0), (0.0, self.half_span_m - self.extension_m)
        around = self._rows_depth_m if self.surround else 0.0
        return (self.centre_m[0], self.length_m / 2.0 + around), (self.centre_m[1], self._outer_m + self._rows_depth_m)

    @property
    def reach_m(self) -> tuple[float, float, float, float]:
        """Rectangle x0, x1, y0, y1 that zone and rows fill, m."""
        (x, half_x), (y, half_y) = self._reach_m
        return x - half_x, x + half_x, y - half_y, y + half_y

    supports: tuple[Support, ...] = ()
    outline: Outline | None = None
    cell_file: str | None = None
    oblique_m: tuple[tuple[float, float], tuple[float, float]] | None = None
    attached: tuple[Support, ...] = ()

    @property
    def stack(self) -> Stack:
        """The plate's layers."""
        return Stack(self.layers) if self.layers else Stack.of(self.thickness_m, self.material)

    @property
    def materials(self) -> tuple[Material, ...]:
        """Materials of plate and pillars, each once."""
        sections = (section.material for pillar in self.kinds for section in pillar.sections)
        return tuple(dict.fromkeys((*(layer.material for layer in self.stack.layers), *sections)))

    @property
    def is_staggered(self) -> bool:
        """Whether rows are shifted relative to their neighbours."""
        return self.stagger and self.rows > 1

    @property
    def zone_centres_m(self) -> FloatArray:
        """y of the middle of every zone, ascending, (zones,), m."""
        steps = np.arange(self.zones) - (self.zones - 1) / 2.0
        return np.asarray(steps * (self.width_m + self.zone_gap_m) + self.centre_m[1])

    def from_zone_m(self, y: FloatArray) -> FloatArray:
        """Places y (q,) from the middle of the nearest zone, (q,), m."""
        middles = self.zone_centres_m
        return np.asarray(y - middles[np.argmin(np.abs(np.subtract.outer(y, middles)), axis=1)])

    @property
    def _outer_m(self) -> float:
        """Distance of the outer border of the last zone from the middle of all zones, m."""
        return self.width_m / 2.0 + (self.zones - 1) / 2.0 * (self.width_m + self.zone_gap_m)

    @property
    def one_zone(self) -> Design:
        """One of its zones alone on a plate, with the same rows beyond it."""
        return replace(self, zones=1, shared_rows=0, zone_gap_m=0.0)

    @property
    def is_graded(self) -> bool:
        """Whether rows differ: then no single unit cell stands for all of them."""
        return bool(self.graded or self.graded_pitches_m)

    @property
    def row_pillars(self) -> tuple[Pillar, ...]:
        """The pillar of every row, from the zone outwards; empty without pillars."""
        return self.graded or ((self.pillar,) * self.rows if self.pillar else ())

    @property
    def kinds(self) -> tuple[Pillar, ...]:
        """The pillars that differ; the pillar alone where all rows are alike, also where no row stands."""
        return tuple(dict.fromkeys(self.graded)) or ((self.pillar,) if self.pillar else ())

    @property
    def row_pitches_m(self) -> FloatArray:
        """Width of every row's strip across the zone, shape (rows,), m."""
        return np.array(self.graded_pitches_m) if self.graded_pitches_m else np.full(self.rows, self.pitch_y_m)

    def of_row(self, row: int) -> Design:
        """Return the plate with every row like row `row`, counted from 0 at the zone."""
        pillar = self.row_pillars[row] if self.row_pillars else None
        return replace(
            self, pillar=pillar, pitch_y_m=float(self.row_pitches_m[row]), graded=(), graded_pitches_m=(), stagger=False
        )

    @property
    def row_designs(self) -> tuple[Design, ...]:
        """Plates of one kind of row each, of every kind once, from the zone outwards; the plate itself without grading."""
        return tuple(dict.fromkeys(self.of_row(row) for row in range(self.rows))) if self.is_graded else (self,)

    @property
    def half_wavelength_m(self) -> float | None:
        """Half-wavelength of the target mode along the zone, m; None for rigid shapes."""
        return half_wavelength_m(self.length_m, self.nodal_lines, self.held_ends)

    @property
    def line_spacing_m(self) -> float:
        """The zone's length for each nodal line of the target mode, L/N, m; its width for rigid shapes."""
        return self.length_m / self.nodal_lines if self.nodal_lines > 1 else self.width_m

    @property
    def is_short_wave(self) -> bool:
        """Whether the target mode's half-wavelength is below SHORT thicknesses, where no plate theory holds."""
        return (self.half_wavelength_m or self.width_m) < SHORT * self.thickness_m

    @property
    def footprint_m(self) -> float:
        """Largest extent of the widest pillar's section, 0 without pillars, m."""
        return max((pillar.widest_m for pillar in self.kinds), default=0.0) if self.row_pillars else 0.0

    @property
    def foot_room_m(self) -> float:
        """Least distance of a foot, its fillet with it, from the sides of its panel, m; infinite without pillars."""
        if self.oblique_m:
            feet_m = (pillar.form.outline(pillar.fillet_m) for pillar in self.kinds)
            return min((room_in_cell(self.oblique_m, foot) for foot in feet_m), default=inf)
        width = self.pitch_x_m / (1 + self.is_staggered)
        rows = (self.of_row(row) for row in range(self.rows)) if self.rows else (self,)
        feet = ((row.pillar.reach_m, row.pitch_y_m) for row in rows if row.pillar)
        return min((min(width - x, pitch - y) / 2.0 for (x, y), pitch in feet), default=inf)

    @property
    def half_span_m(self) -> float:
        """Half of the plate's whole width across the zone, m."""
        if self.larger_m is not None:
            return self.larger_m[1] / 2.0
        return self._outer_m + self._rows_depth_m + self.extension_m

    @property
    def _rows_depth_m(self) -> float:
        """Width of all rows beyond a zone, m: from its border to the end of the last row."""
        first, last = (
            (self.row_pillars[0].footprint_m, self.row_pillars[-1].widest_m) if self.row_pillars else (0.0, 0.0)
        )
        return float(self._row_offsets()[-1]) + (first + last) / 2.0 if self.rows else 0.0

    @property
    def touch_lines_m(self) -> tuple[float, ...]:
        """y where parts of the touch face meet, ascending, m: the borders of the zones, and the ends of the last rows."""
        half, places = self.width_m / 2.0, set()
        for each in self._placed:
            places |= {*np.add.outer(each.zone_centres_m, [-half, half]).ravel().tolist(), *each.reach_m[2:]}
        return tuple(sorted(places))

    @property
    def touch_cuts_m(self) -> tuple[float, ...]:
        """x where parts of the touch face meet, ascending, m: the ends of zone and rows within a larger plate."""
        ends = {end for each in self._placed for end in (*each.zone_ends_m, *each.reach_m[:2])}
        first, last = self.ends_m[:2]
        return tuple(sorted(end for end in ends if first < end < last)) if self.larger_m else ()

    @property
    def bare_touch_m(self) -> float:
        """y up to which the touch face carries no pillar, m: where the first row begins, or the plate ends."""
        if not (self.row_pillars and self.row_pillars[0].faces == 2):
            return self.half_span_m
        return self._outer_m - max(self.row_pillars[0].reach_m[1] - self.row_pillars[0].footprint_m, 0.0) / 2.0

    @property
    def unsupported(self) -> Design:
        """The plate with free edges, nothing attached to it."""
        return replace(self, supports=()) if self.supports else self

    @property
    def holds_expansion(self) -> bool:
        """Whether supports hold layers that expand, or may do so, along the plate."""
        held = any({*each.held_axes} & {*"xy"} for each in self.supports)
        return held and any(material.expansion_per_k != 0.0 for material, _ in self.stack.layers)

    @property
    def is_stressed(self) -> bool:
        """Whether supports hold the expansion between the usual temperature and the plate's."""
        return self.holds_expansion and self.stack.back.temperature_c != USUAL_C

    @property
    def is_mirrored(self) -> bool:
        """True when plate and supports are their own mirror image in x = 0 and y = 0: the quarter stands for the whole."""
        pillar, centred = self.pillar if self.rows else None, not any(self.centre_m) and not self.others_m
        alone = centred and {"x", "y"} <= {*self.stack.mirrors} and (pillar is None or pillar.is_symmetric)
        alone &= self.outline is None  # nothing is known of its mirrors
        return alone and are_mirrored(self.supports)

    @property
    def lattice(self) -> Lattice:
        """The lattice that its rows are part of."""
        if self.oblique_m:
            return Lattice(*self.oblique_m)
        return Lattice.of_rows(self.pitch_x_m, self.pitch_y_m, self.stagger)

    @property
    def cell_mirrors(self) -> tuple[str, ...]:
        """Mirrors of the unit cell: x, y, "d", which exchanges x and y, where the pillar and equal pitches have it, and "h",
        about the line at 60 degrees from x, of a triangular lattice.
        """
        if (
            self.cell_file or self.attached or self.oblique_m
        ):  # nothing is known of its symmetry, or it has no such mirror
            return ()
        shared = ("x", "y", "d") if self.pitch_x_m == self.pitch_y_m and not self.stagger else ("x", "y")
        kept = {*self.stack.mirrors} & {*(self.pillar or self.stack).mirrors}
        return (*(name for name in shared if name in kept), *(("h",) if self._is_sixfold else ()))

    @property
    def zone_mirrors(self) -> tuple[str, ...]:
        """Mirrors that may fold the Brillouin zone: in an oblique lattice those of the body, whose cell is never halved."""
        return self.body_mirrors if self.oblique_m else self.cell_mirrors

    @property
    def body_mirrors(self) -> tuple[str, ...]:
        """Mirrors of the body in a unit cell, whatever its lattice: x, y, d and h; none where nothing is known of it."""
        if self.cell_file or self.attached:
            return ()
        kept = {*self.stack.mirrors} & {*(self.pillar or self.stack).mirrors}
        return (*(name for name in ("x", "y", "d") if name in kept), *(("h",) if self._has_sixfold_body else ()))

    @property
    def _is_sixfold(self) -> bool:
        """Whether its cell has the mirrors of a triangular lattice."""
        return self.lattice.is_triangular and self._has_sixfold_body

    @property
    def _has_sixfold_body(self) -> bool:
        """Whether its body has the mirrors of a triangular lattice: isotropic materials, and sections that have them."""
        sections = self.pillar.sections if self.pillar else ()
        shaped = all("h" in section.form.mirrors for section in sections)
        return shaped and all(each.constants for each in self.materials)

    def column_centres(self, row: int = 0) -> FloatArray:
        """x of the pillars of a row, counted from 0 at the zone, shape (columns,), m: floor((length - footprint)/pitch_x) + 1,
        centred; one less between them in a row that is shifted.
        """
        room = (self.length_m - self.footprint_m) / self.pitch_x_m
        count = floor(room * (1.0 + ROUNDING) + ROUNDING) + 1 - (self.stagger and row % 2)
        if self.surround:
            count = self._between(self.length_m, self.pitch_x_m)
        return np.asarray((np.arange(count) - (count - 1) / 2.0) * self.pitch_x_m + self.centre_m[0])

    def _between(self, length_m: float, pitch_m: float) -> int:
        """Most places a pitch apart along a zone, and at least a pitch from the first row beyond either end."""
        return max(floor((length_m + self.footprint_m) / pitch_m * (1.0 + ROUNDING) + ROUNDING) - 1, 0)

    def row_centres(self) -> FloatArray:
        """Distance of the rows beyond the last zone from the middle of all zones, shape (rows,), m: width/2 + footprint/2,
        then every pitch_y.
        """
        first = self.row_pillars[0].footprint_m if self.row_pillars else 0.0
        return np.asarray(self._outer_m + first / 2.0 + self._row_offsets())

    def row_places(self) -> FloatArray:
        """y of every row of the plate above and below its zones, ascending, shape (2 rows + shared_rows (zones - 1),), m."""
        outer, middle = self.row_centres(), self.centre_m[1]
        return np.concatenate([middle - outer[::-1], *map(self._shared, self.zone_centres_m[:-1]), middle + outer])

    def lines_of_feet(self) -> list[tuple[float, FloatArray]]:
        """Every line of pillars along x: y, ascending, and x of its pillars, ascending, m.

        Rows around a zone stand on the lines of a grid that leaves the zone itself free: rows and columns beyond the
        zone's borders, and as many between these as stand a pitch apart.
        """
        if not self.row_pillars:
            return []
        if self.others_m:
            return _joined(line for each in self._placed for line in each.lone.lines_of_feet())
        own = [self.column_centres(number) for number in self.row_numbers]
        if not self.surround:
            return list(zip(self.row_places().tolist(), own, strict=True))
        beyond = self.length_m / 2.0 + self.footprint_m / 2.0 + self.pitch_x_m * np.arange(self.rows)
        left, right = self.centre_m[0] - beyond[::-1], self.centre_m[0] + beyond
        count = self._between(self.width_m, self.pitch_y_m)
        aside = (np.arange(count) - (count - 1) / 2.0) * self.pitch_y_m + self.centre_m[1]
        places = self.row_places().tolist()
        full = [(y, np.concatenate([left, x, right])) for y, x in zip(places, own, strict=True)]
        ends = np.concatenate([left, right])
        return [*full[: self.rows], *((y, ends) for y in aside.tolist()), *full[self.rows :]]

    def _shared(self, centre: float) -> FloatArray:
        """y of the rows between the zone about `centre` and the next one."""
        low, half = centre + self.width_m / 2.0, (self.shared_rows + 1) // 2
        steps = self.pitch_y_m * np.arange(half) + self.footprint_m / 2.0
        upper = low + self.zone_gap_m - steps[: self.shared_rows - half]
        return np.concatenate([low + steps, upper[::-1]])

    def _row_offsets(self) -> FloatArray:
        """Distance of every row from the first, m: half of both strips between neighbours."""
        if not self.graded_pitches_m:
            return np.asarray(self.pitch_y_m * np.arange(self.rows))
        pitches = self.row_pitches_m
        return np.concatenate([[0.0], np.cumsum((pitches[1:] + pitches[:-1]) / 2.0)])

    def pillar_centres(self) -> FloatArray:
        """Centres of every pillar, shape (pillars, 2), m, row by row along y; empty without pillars."""
        return _places(self.lines_of_feet())

    @property
    def row_numbers(self) -> tuple[int, ...]:
        """Number of every row along y, counted from the border of a zone outwards; rows between zones are alike."""
        own = tuple(range(len(self.row_pillars)))
        return (*own[::-1], *own[:1] * (self.shared_rows * (self.zones - 1)), *own)

    def standing(self) -> tuple[PillarGroup, ...]:
        """Every kind of pillar with the centres where it stands."""
        lines = self.lines_of_feet()
        if self.pillar and lines and not self.graded:
            return (PillarGroup(self.pillar, _places(lines)),)
        pillars = [self.row_pillars[number] for number in self.row_numbers]
        kinds = {kind: [row for row, pillar in enumerate(pillars) if pillar == kind] for kind in dict.fromkeys(pillars)}
        return tuple(PillarGroup(kind, _places([lines[row] for row in own])) for kind, own in kinds.items())


def _joined(lines: Iterable[tuple[float, FloatArray]]) -> list[tuple[float, FloatArray]]:
    """Lines of pillars along x as one where they have the same y, and pillars as one at the same place."""
    rows: dict[float, tuple[float, dict[float, float]]] = {}
    for y, columns in lines:
        own = rows.setdefault(round(y, PLACES), (y, {}))[1]
        own |= {round(x, PLACES): own.get(round(x, PLACES), x) for x in columns.tolist()}
    return [(y, np.array(sorted(own.values()))) for _, (y, own) in sorted(rows.items())]


def _places(lines: Sequence[tuple[float, FloatArray]]) -> FloatArray:
    """Centres (pillars, 2) of some lines of pillars along x."""
    return np.concatenate([np.empty((0, 2)), *(np.column_stack([x, np.full(len(x), at)]) for at, x in lines)])


# -- patches -----------------------------------------------------------------------------------------------------------
# Where the piezo patches stand on the plate: boxes only, no CAD.

SAME_M = 1e-12  # places that agree to a picometre are the same


@dataclass(frozen=True)
class Patches:
    """Piezoelectric patches bonded to a plate, lengths in m.

    Attributes
    ----------
    material : PiezoMaterial
        Their material.
    size_m : tuple of float
        Length along x, width and thickness of a patch.
    face : {'back', 'touch'}
        Face that they are bonded to.
    at : {'antinodes', 'centres'}
        Whether they stand on the N + 1 antinodes of the shape with N nodal lines, free ends included and numbered along
        x.
        The two end patches are then cut to the space beyond their neighbours.
    centres_m : tuple of tuple
        Centres (x, y) from the plate's centre.
    lengths_m : tuple of float
        Length of each patch along x.
    sensors : tuple of int
        Numbers of the sensor patches, from 0.
    resting : tuple of int
        Numbers of those in other zones than the one that is driven, held at 0 V.
    drive_v : float
        Amplitude of the drive voltage in V.
    circuit : {'short', 'open'}
        Whether a voltage or a charge is prescribed on the actuators.
    glue : Layer or None
        Layer between every patch and the plate.
    """

    material: PiezoMaterial
    size_m: tuple[float, float, float]
    face: Literal["back", "touch"]
    at: Literal["antinodes", "centres"]
    centres_m: tuple[tuple[float, float], ...]
    lengths_m: tuple[float, ...]
    sensors: tuple[int, ...]
    drive_v: float
    circuit: Literal["short", "open"] = "short"  # of the actuators: a prescribed voltage or charge
    glue: Layer | None = None
    resting: tuple[int, ...] = ()

    @property
    def count(self) -> int:
        """Number of patches."""
        return len(self.centres_m)

    @property
    def drivers(self) -> tuple[int, ...]:
        """The numbers of the actuators."""
        return tuple(i for i in range(self.count) if i not in (*self.sensors, *self.resting))

    def boxes_m(self) -> FloatArray:
        """Footprints x0, x1, y0, y1, shape (patches, 4), m."""
        x, y = np.array(self.centres_m).reshape(-1, 2).T
        half_x, half_y = np.array(self.lengths_m) / 2.0, self.size_m[1] / 2.0
        return np.column_stack([x - half_x, x + half_x, y - half_y, y + half_y])


def mirrored_axes(boxes_m: FloatArray) -> tuple[bool, bool]:
    """Check whether footprints together are their own mirror image.

    Parameters
    ----------
    boxes_m : ndarray, shape (n, 4)
        Rectangles x0, x1, y0, y1 in m.

    Returns
    -------
    along_x, along_y : bool
        Whether reflecting x, or y, maps the set of rectangles onto itself.
    """
    images = -boxes_m[:, [1, 0]], -boxes_m[:, [3, 2]]
    x, y = np.hstack([images[0], boxes_m[:, 2:]]), np.hstack([boxes_m[:, :2], images[1]])
    x_apart, y_apart = (np.abs(boxes_m[:, None] - image[None]).max(axis=2).min(axis=1) for image in (x, y))
    return bool((x_apart < SAME_M).all()), bool((y_apart < SAME_M).all())


def antinode_places(
    inner_m: tuple[float, ...], length_m: float, size_m: tuple[float, float, float], ends: bool
) -> tuple[tuple[tuple[float, float], ...], tuple[float, ...]]:
    """Place patches on the antinodes of a strip.

    With `ends`, one more patch lies flush with each free end. It is at most as long as the others and one patch
    thickness away from its neighbour.

    Parameters
    ----------
    inner_m : tuple of float
        Inner antinodes from the strip's centre, ascending, in m.
    length_m : float
        Length of the strip in m.
    size_m : tuple of float
        Length, width and thickness of a patch in m.
    ends : bool
        Whether to add patches at both ends.

    Returns
    -------
    centres : tuple of tuple of float
        Centres (x, 0) in m.
    lengths : tuple of float
        Lengths along x in m.
    """
    size = size_m[0]
    places = [(x, size) for x in inner_m]
    if ends:
        room = length_m / 2.0 - (max(inner_m) + size / 2.0 + size_m[2] if inner_m else 0.0)
        cut = min(size, room)
        end = (length_m - cut) / 2.0
        places = [(-end, cut), *places, (end, cut)]
    return tuple((x, 0.0) for x, _ in places), tuple(length for _, length in places)
