"""Structured hexahedra of order 1 to 4 for scenes made of boxes along the axes.

A scene is a tensor grid and a mask: which boxes are solid, and to which region each belongs.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from geometry.elements import BoolArray, FloatArray, IntArray, gauss_lobatto
from geometry.errors import MeshError
from geometry.hex.grading import Grading, grid_lines
from geometry.layout import Design, Pillar, Stand
from geometry.mesh import Mesh

VOID = -1
REGIONS = ("", "pillar", "tip")  # the lowest body has a name of its own


@dataclass(frozen=True)
class Boxes:
    """A tensor grid (lines in m along x, y, z) with a region number per box, shape (nx, ny, nz), -1 where void."""

    x: FloatArray
    y: FloatArray
    z: FloatArray
    region: IntArray
    names: tuple[str, ...]


def hex_mesh(boxes: Boxes, order: int) -> Mesh:
    """Mesh of every solid box, with the faces touch, back, x-, x+, y-, y+ of the lowest body.

    `touch` is the lowest body's underside where nothing hangs; `back`, its top, is not named, since pillars stand there.
    """
    solid, full = _solid_elements(boxes, order)
    lines = [nodal_line(axis, order) for axis in (boxes.x, boxes.y, boxes.z)]
    counts = [len(line) for line in lines]
    used, cells = np.unique(full, return_inverse=True)
    cells = cells.reshape(len(solid), -1).astype(np.int64)
    nodes = np.column_stack(
        [lines[0][used % counts[0]], lines[1][used // counts[0] % counts[1]], lines[2][used // (counts[0] * counts[1])]]
    )
    spans = np.column_stack([np.diff(axis)[solid[:, i]] for i, axis in enumerate((boxes.x, boxes.y, boxes.z))])
    numbers = boxes.region[tuple(solid.T)]
    regions = {name: np.flatnonzero(numbers == i) for i, name in enumerate(boxes.names) if (numbers == i).any()}
    mesh = Mesh(nodes, cells, "hex", order, regions, {}, spans)
    return Mesh(nodes, cells, "hex", order, regions, _outer_faces(mesh, boxes, solid), spans)


def _solid_elements(boxes: Boxes, order: int) -> tuple[IntArray, IntArray]:
    """Places (n, 3) of the solid boxes, x fastest, and their nodes' numbers (n, nodes) in the full grid."""
    solid = np.argwhere(boxes.region.transpose(2, 1, 0) >= 0)[:, ::-1]
    counts = [order * (len(axis) - 1) + 1 for axis in (boxes.x, boxes.y)]
    local = np.arange(order + 1)
    ix, iy, iz = (order * solid[:, axis, None] + local for axis in range(3))
    full = ix[:, None, None, :] + counts[0] * (iy[:, None, :, None] + counts[1] * iz[:, :, None, None])
    return solid, full.reshape(len(solid), -1)


def used_nodes(boxes: Boxes, order: int) -> IntArray:
    """Numbers in the full grid of the nodes of `hex_mesh`, in its order, x fastest."""
    return np.unique(_solid_elements(boxes, order)[1])


def nodal_line(lines: FloatArray, order: int) -> FloatArray:
    """Coordinates of the nodes of elements of an order along one axis."""
    inner = (gauss_lobatto(order) + 1.0) / 2.0
    steps = lines[:-1, None] + np.diff(lines)[:, None] * inner[None, :-1]
    return np.append(steps.ravel(), lines[-1])


def _outer_faces(mesh: Mesh, boxes: Boxes, solid: IntArray) -> dict[str, IntArray]:
    """The faces on the sides of the grid's bounding box, and below the lowest body where nothing hangs."""
    (local,) = mesh.element.facets
    floor = int(np.flatnonzero((boxes.region == 0).any(axis=(0, 1)))[0])
    hung = boxes.region[solid[:, 0], solid[:, 1], floor - 1] != VOID if floor else np.zeros(len(solid), dtype=bool)
    last = [len(boxes.x) - 2, len(boxes.y) - 2, len(boxes.z) - 2]
    sides = {
        "x-": (0, solid[:, 0] == 0),
        "x+": (1, solid[:, 0] == last[0]),
        "y-": (2, solid[:, 1] == 0),
        "y+": (3, solid[:, 1] == last[1]),
        "touch": (4, (solid[:, 2] == floor) & ~hung),
        "top": (5, solid[:, 2] == last[2]),
    }
    return {name: mesh.cells[on][:, local[face]] for name, (face, on) in sides.items() if on.any()}


@dataclass(frozen=True)
class HexSettings:
    """Order, element size in the plate and along a pillar (m), layers and shrink factor at singular edges.

    `through` is how many elements at least lie through the thickness of a plate, layers not counted; the
    `skipped` innermost layers are left out, which nests the mesh in the one that has them. `least` elements at least lie
    between two lines that the scene prescribes.
    """

    order: int = 3
    size_m: float = 4e-3
    layers: int = 1
    factor: float = 0.25
    pillar_size_m: float | None = None  # along its height; the plate's size when left out
    through: int = 1
    skipped: int = 0
    least: int = 1

    @property
    def coarser(self) -> HexSettings:
        """The same without the innermost layer: a mesh nested in this one."""
        return replace(self, skipped=self.skipped + 1)

    @property
    def grading(self) -> Grading:
        """Grading of the plate's lines."""
        return self._grading(self.size_m)

    @property
    def pillar_grading(self) -> Grading:
        """Grading along the pillar's height."""
        return self._grading(self.pillar_size_m or self.size_m)

    def through_grading(self, thickness_m: float) -> Grading:
        """Grading through the thickness of a plate with pillars."""
        return self._grading(min(self.size_m, thickness_m / self.through))

    def _grading(self, size_m: float) -> Grading:
        return Grading(size_m, self.layers, self.factor, self.skipped, self.least)


@dataclass(frozen=True)
class Foot:
    """Prisms of one kind: rectangles x0, x1, y0, y1 about a centre (r, 4), centres (n, 2), where they begin and end, m.

    They stand on the prisms of the outline `below`, on the lowest body without one.
    """

    rectangles: FloatArray
    centres: FloatArray
    bottom_m: float
    top_m: float
    region: str = "pillar"
    below: FloatArray | None = None


@dataclass(frozen=True)
class Scene:
    """Where the lines of a scene of boxes pass, before any is drawn: breakpoints in m, True at singular edges.

    x, y and z span the lowest body (region `name`), above the pillars that stand on it (None without), `feet` of each kind.
    The lowest body fills the rectangles `body` (r, 4) only, where that is given. With two `faces` the mirror images of the
    pillars hang below it.
    """

    x: dict[float, bool]
    y: dict[float, bool]
    z: dict[float, bool]
    across: Grading
    through: Grading
    name: str = "plate"
    above: dict[float, bool] | None = None
    along: Grading | None = None
    feet: tuple[Foot, ...] = ()
    body: FloatArray | None = None
    faces: int = 1


def zone_scene(design: Design, settings: HexSettings, quarter: bool = True) -> Scene:
    """The bare strip length x width x thickness, graded towards its clamped long side faces and the free ends that meet them
    in singular corners; x, y >= 0 when quartered.
    """
    x, y = (_span(size / 2.0, True, quarter) for size in (design.length_m, design.width_m))
    return Scene(x, y, {0.0: True, design.thickness_m: True}, settings.grading, settings.grading)


def zone_boxes(design: Design, settings: HexSettings, quarter: bool = True) -> Boxes:
    """The boxes of `zone_scene`."""
    return boxes_of(zone_scene(design, settings, quarter))


def pillar_scene(pillar: Pillar, settings: HexSettings, quarter: bool = True) -> Scene:
    """The lone pillar, foot on z = 0 (face `touch`), graded towards the clamped foot's rim and its own inner edges."""
    foot = _foot(pillar)
    x, y = _edges(pillar)
    if quarter:
        x, y = ({0.0: False} | {edge: inner for edge, inner in breaks.items() if edge > 0.0} for breaks in (x, y))
    height, along = {0.0: True, pillar.height_m: pillar.tip is not None}, settings.pillar_grading
    if pillar.tip is None:
        return Scene(x, y, height, settings.grading, along, "pillar", body=foot)
    above, feet = {pillar.height_m: True, pillar.top_m: False}, _prisms(pillar, np.zeros((1, 2)), 0.0)[1:]
    return Scene(x, y, height, settings.grading, along, "pillar", above, along, feet, foot)


def pillar_boxes(pillar: Pillar, settings: HexSettings, quarter: bool = True) -> Boxes:
    """The boxes of `pillar_scene`."""
    return boxes_of(pillar_scene(pillar, settings, quarter))


@dataclass(frozen=True)
class Panel:
    """A rectangular panel of plate from (x0, y0) to (x1, y1), lengths in m, with a pillar's centre or None.

    `halved` lists the axes along which only the half beyond the panel's middle is meshed (its mirrors), `free` the
    sides (x-, x+, y-, y+) to which nothing is attached. `pillar` names the one that stands there where rows differ.
    """

    low: tuple[float, float]
    high: tuple[float, float]
    foot: tuple[float, float] | None = None
    halved: tuple[int, ...] = ()
    free: tuple[str, ...] = ()
    pillar: Pillar | None = None

    @property
    def middle(self) -> tuple[float, float]:
        """Centre of the panel, m."""
        return ((self.low[0] + self.high[0]) / 2.0, (self.low[1] + self.high[1]) / 2.0)


def panel_scene(panel: Panel, thickness_m: float, pillar: Pillar | None, settings: HexSettings) -> Scene:
    """A rectangular panel of plate, its own middle at the origin, with its pillar where it has one."""
    middle = np.array(panel.middle)
    spans = []
    for axis in (0, 1):
        half = (panel.high[axis] - panel.low[axis]) / 2.0
        spans.append(_span(half, False, axis in panel.halved))
    pillar = panel.pillar or pillar
    stands = (Stand(pillar, np.array([panel.foot]) - middle),) if pillar and panel.foot else ()
    return _plate_with_pillars(thickness_m, settings, stands, *spans)


def panel_boxes(panel: Panel, thickness_m: float, pillar: Pillar | None, settings: HexSettings) -> Boxes:
    """The boxes of `panel_scene`."""
    return boxes_of(panel_scene(panel, thickness_m, pillar, settings))


def bonded_boxes(
    span_m: FloatArray,
    thickness_m: float,
    stands: tuple[Stand, ...],
    box_m: FloatArray,
    back: bool,
    settings: HexSettings,
) -> Boxes:
    """A rectangle span_m = (x0, x1, y0, y1) of plate with its pillars and a body bonded to the rectangle box_m of its back or
    touch face: graded towards that one's edges too, where the forces between both gather.
    """
    lines: list[dict[float, bool]] = [{}, {}]
    for breaks, ends, edges in zip(lines, span_m.reshape(2, 2), box_m.reshape(2, 2), strict=True):
        breaks |= dict.fromkeys(ends.tolist(), False) | {e: True for e in edges.tolist() if ends[0] < e < ends[1]}
    scene = _plate_with_pillars(thickness_m, settings, stands, lines[0], lines[1])
    return boxes_of(replace(scene, z=scene.z | {thickness_m if back else 0.0: True}))


def cell_scene(design: Design, settings: HexSettings, quarter: bool = False) -> Scene:
    """The unit cell pitch_x x pitch_y x thickness centred at the origin, its pillar in its middle.

    Of staggered rows the rectangle of two: a pillar in the lower half's middle, half a one on either side of the upper half.
    """
    if design.stagger:
        return _staggered_scene(design, settings)
    half_x, half_y = design.pitch_x_m / 2.0, design.pitch_y_m / 2.0
    foot = (0.0, 0.0) if design.pillar else None
    panel = Panel((-half_x, -half_y), (half_x, half_y), foot, (0, 1) if quarter else ())
    return panel_scene(panel, design.thickness_m, design.pillar, settings)


def _staggered_scene(design: Design, settings: HexSettings) -> Scene:
    half_x, pitch = design.pitch_x_m / 2.0, design.pitch_y_m
    x, y = _span(half_x, False, False), _span(pitch, False, False)
    centres = np.array([[0.0, -pitch / 2.0], [-half_x, pitch / 2.0], [half_x, pitch / 2.0]])
    stands = (Stand(design.pillar, centres),) if design.pillar else ()
    return _plate_with_pillars(design.thickness_m, settings, stands, x, y)


def cell_boxes(design: Design, settings: HexSettings, quarter: bool = False) -> Boxes:
    """The boxes of `cell_scene`."""
    return boxes_of(cell_scene(design, settings, quarter))


def plate_scene(design: Design, settings: HexSettings, quarter: bool = True) -> Scene:
    """The whole plate, or its quarter x, y >= 0, with every pillar; a line runs along the zone's border."""
    x = _span(design.length_m / 2.0, False, quarter)
    y = _span(design.half_span_m, False, quarter)
    borders = (
        centre + side * design.width_m / 2.0 for centre in design.zone_centres_m.tolist() for side in (-1.0, 1.0)
    )
    y |= {v: False for v in borders if v >= min(y)}
    stands, reach = design.standing(), design.footprint_m / 2.0
    if quarter:
        stands = tuple(Stand(each.pillar, each.centres[(each.centres > -reach).all(axis=1)]) for each in stands)
    return _plate_with_pillars(design.thickness_m, settings, stands, x, y)


def plate_boxes(design: Design, settings: HexSettings, quarter: bool = True) -> Boxes:
    """The boxes of `plate_scene`."""
    return boxes_of(plate_scene(design, settings, quarter))


def _span(half: float, singular: bool, quarter: bool) -> dict[float, bool]:
    return {(0.0 if quarter else -half): singular and not quarter, half: singular}


def _plate_with_pillars(
    thickness_m: float,
    settings: HexSettings,
    stands: tuple[Stand, ...],
    x: dict[float, bool],
    y: dict[float, bool],
) -> Scene:
    """Lines pass along every foot edge, graded there in x, y and in z on both sides of the foot."""
    stands = tuple(each for each in stands if len(each.centres))
    if not stands:
        return Scene(x, y, {0.0: False, thickness_m: False}, settings.grading, settings.through_grading(thickness_m))
    for breaks, column in ((x, 0), (y, 1)):
        low, high = min(breaks), max(breaks)
        for each in stands:
            for centre in sorted(set(each.centres[:, column].tolist())):
                for edge, inner in _edges(each.pillar)[column].items():
                    if low < centre + edge < high:
                        breaks[centre + edge] = inner or breaks.get(centre + edge, False)
    (faces,) = {each.pillar.faces for each in stands}
    z, through = {0.0: faces == 2, thickness_m: True}, settings.through_grading(thickness_m)
    feet = tuple(foot for each in stands for foot in _prisms(each.pillar, each.centres, thickness_m))
    junctions = {foot.bottom_m for foot in feet}
    above = {height: height in junctions for foot in feet for height in (foot.bottom_m, foot.top_m)}
    return Scene(x, y, z, settings.grading, through, "plate", above, settings.pillar_grading, feet, faces=faces)


def _edges(pillar: Pillar) -> tuple[dict[float, bool], dict[float, bool]]:
    """Where the sides of foot and heavy tip lie along x and y, m, and whether an edge there is re-entrant."""
    foot = _foot(pillar)
    tip = np.empty((0, 4)) if pillar.tip is None else pillar.tip.rectangles
    sides: list[dict[float, bool]] = []
    for columns in ([0, 1], [2, 3]):
        reach = np.abs(foot[:, columns]).max()
        overhang = {edge: bool(abs(edge) < reach) for edge in sorted(set(tip[:, columns].ravel().tolist()))}
        sides.append(overhang | dict.fromkeys(sorted(set(foot[:, columns].ravel().tolist())), True))
    return sides[0], sides[1]


def _prisms(pillar: Pillar, centres: FloatArray, bottom_m: float) -> tuple[Foot, ...]:
    """The pillars at centres (n, 2) that stand at a height, and their heavy tips."""
    foot, joint = _foot(pillar), bottom_m + pillar.height_m
    stem = Foot(foot, centres, bottom_m, joint)
    if pillar.tip is None:
        return (stem,)
    return stem, Foot(pillar.tip.rectangles, centres, joint, bottom_m + pillar.top_m, "tip", foot)


def _foot(pillar: Pillar) -> FloatArray:
    """The rectangles of a foot. MeshError where boxes cannot follow the pillar."""
    rectangles = pillar.form.rectangles
    if rectangles is None or pillar.fillet_m:
        what = f"{pillar.shape} pillar{' with a fillet' if pillar.fillet_m else ''}"
        raise MeshError(
            f"a {what} is not made of boxes: hexahedra in straight lines cannot follow it, nor what is bonded over it"
        )
    return rectangles


def boxes_of(scene: Scene) -> Boxes:
    """The tensor grid of a scene and what is solid in it."""
    lines_x, lines_y = grid_lines(scene.x, scene.across), grid_lines(scene.y, scene.across)
    z = grid_lines(scene.z, scene.through)
    layers = len(z) - 1
    if scene.above is not None and scene.along is not None:
        z = np.append(z, grid_lines(scene.above, scene.along)[1:])
    region = np.full(_cuts(lines_x, lines_y, z), VOID, dtype=np.int64)
    region[_inside(lines_x, lines_y, scene.body), :layers] = 0
    middles = (z[1:] + z[:-1]) / 2.0
    for foot in scene.feet:
        first, last = np.searchsorted(middles, (foot.bottom_m, foot.top_m))
        for centre in foot.centres:
            region[_inside(lines_x, lines_y, foot.rectangles, centre), first:last] = REGIONS.index(foot.region)
    if scene.faces == 2:
        z = np.concatenate([max(scene.z) - z[:layers:-1], z])
        region = np.concatenate([region[:, :, : layers - 1 : -1], region], axis=2)
    return Boxes(lines_x, lines_y, z, region, (scene.name, *REGIONS[1:]))


def _inside(
    x: FloatArray, y: FloatArray, rectangles: FloatArray | None, centre: FloatArray | tuple[float, float] = (0.0, 0.0)
) -> BoolArray:
    """Which intervals of x and y lie in the union of rectangles about a centre, (nx, ny); all where none are given."""
    if rectangles is None:
        return np.ones(_cuts(x, y), dtype=bool)
    along, across = ((line[1:] + line[:-1]) / 2.0 - c for line, c in zip((x, y), centre, strict=True))
    result = np.zeros(_cuts(x, y), dtype=bool)
    for x0, x1, y0, y1 in rectangles:
        result |= ((along > x0) & (along < x1))[:, None] & ((across > y0) & (across < y1))[None, :]
    return result


def _cuts(*lines: FloatArray) -> tuple[int, ...]:
    return tuple(len(line) - 1 for line in lines)
