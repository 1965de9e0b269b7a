"""Scenes of boxes before they are meshed: their grid lines, the grading of these, and the number of elements."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from itertools import combinations, pairwise
from math import ceil, inf

import numpy as np

from geometry.elements import FloatArray
from geometry.errors import MeshError
from geometry.layout import Design, Pillar, PillarGroup, section_names
from geometry.materials import Stack
from geometry.tiling import Panel, lattice_panel

# -- lines -------------------------------------------------------------------------------------------------------------
# Lines of a tensor-product grid: breakpoints, element sizes, and geometric grading towards singular edges.

PER_LAYER = 2  # elements through each layer of several: so many nodes has each degree at one order less, too
SAME = 1e-9  # of the breakpoints' span: those closer than this are one


@dataclass(frozen=True)
class Grading:
    """Element size and geometric grading towards singular edges.

    Attributes
    ----------
    size_m : float
        Element size away from singular edges.
    layers : int
        Layers towards each singular edge.
    factor : float
        Shrink factor from a layer to the next one towards the edge.
    skipped : int
        Innermost layers that are left out; such a grid is nested in the one that has them.
    least : int
        Smallest number of elements between two breakpoints.
    """

    size_m: float
    layers: int = 0
    factor: float = 0.3
    skipped: int = 0
    least: int = 1

    @property
    def cuts(self) -> FloatArray:
        """Cuts of the element next to a singular edge, as fractions of its length from the edge, in ascending order."""
        return np.asarray(self.factor ** np.arange(self.layers - self.skipped, 0, -1), dtype=float)


def grid_lines(breaks: dict[float, bool], grading: Grading) -> FloatArray:
    """Compute grid lines through all breakpoints, graded towards singular edges.

    Between two breakpoints the interval is cut evenly. Then the end element next to a singular edge is cut repeatedly
    into the fractions `factor` and 1 - `factor`, once per layer.

    Parameters
    ----------
    breaks : dict of bool
        Breakpoints, in m like `grading`, as keys; True marks singular edges.
    grading : Grading
        Element size, layers and shrink factor.

    Returns
    -------
    ndarray, shape (n,)
        Ascending coordinates.

    References
    ----------
    .. [1] babuska1981 (docs/references.bib)
    """
    points = _merged(breaks)
    panels = [_interval(a, b, grading) for a, b in pairwise(points)]
    return np.concatenate([[points[0][0]], *panels])


def _interval_count(breaks: dict[float, bool], grading: Grading) -> int:
    """Intervals of `grid_lines`, counted without making them."""
    return sum(_even_count(a, b, grading) + len(grading.cuts) * (a[1] + b[1]) for a, b in pairwise(_merged(breaks)))


def _merged(breaks: dict[float, bool]) -> list[tuple[float, bool]]:
    ordered = sorted(breaks.items())
    span = ordered[-1][0] - ordered[0][0]
    merged = [ordered[0]]
    for value, singular in ordered[1:]:
        if value - merged[-1][0] > SAME * span:
            merged.append((value, singular))
        else:
            merged[-1] = (merged[-1][0], merged[-1][1] or singular)
    return merged


def _interval(start: tuple[float, bool], end: tuple[float, bool], grading: Grading) -> FloatArray:
    """Coordinates after `start` up to and with `end`."""
    (a, grade_a), (b, grade_b) = start, end
    lines = np.linspace(a, b, _even_count(start, end, grading) + 1)
    shrink = grading.cuts
    if grade_a:
        lines = np.concatenate([[a], a + shrink * (lines[1] - a), lines[1:]])
    if grade_b:
        lines = np.concatenate([lines[:-1], b - shrink[::-1] * (b - lines[-2]), [b]])
    return lines[1:]


def _even_count(start: tuple[float, bool], end: tuple[float, bool], grading: Grading) -> int:
    """Even intervals between two breakpoints, before those at singular edges are cut."""
    count = max(grading.least, ceil((end[0] - start[0]) / grading.size_m - 1e-6))
    return max(2, count) if start[1] and end[1] and grading.layers else count


# -- scenes ------------------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class HexSettings:
    """Order, element sizes and grading of a hexahedral mesh.

    Attributes
    ----------
    order : int
        Order of the elements, 1 to 4.
    size_m : float
        Element size in the plate.
    layers, factor, skipped, least : int or float
        Numbers of `Grading`.
    pillar_size_m : float or None
        Element size along the height of a pillar; that in the plate if None.
    through : int
        Smallest number of elements through the thickness, not counting layers.
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
        """Settings without the innermost layer: those of a mesh nested in this one."""
        return replace(self, skipped=self.skipped + 1)

    @property
    def grading(self) -> Grading:
        """Grading of the plate's lines."""
        return self._grading(self.size_m)

    @property
    def pillar_grading(self) -> Grading:
        """Grading along the pillar's height."""
        return self._grading(self.pillar_size_m or self.size_m)

    def through_grading(self, stack: Stack) -> Grading:
        """Grading through the thickness of a plate with pillars."""
        own = self._grading(min(self.size_m, stack.thickness_m / self.through))
        return replace(own, least=max(own.least, PER_LAYER)) if stack.joints else own

    def _grading(self, size_m: float) -> Grading:
        return Grading(size_m, self.layers, self.factor, self.skipped, self.least)


@dataclass(frozen=True)
class Foot:
    """Equal prisms that stand on a body.

    Attributes
    ----------
    rectangles : ndarray, shape (r, 4)
        Outline as a union of rectangles x0, x1, y0, y1 about a centre, in m.
    centres : ndarray, shape (n, 2)
        Centres in m.
    bottom_m, top_m : float
        Heights at which the prisms begin and end.
    region : str
        Region of the mesh.
    below : ndarray, shape (r, 4), or None
        Outline of the prisms on which they stand; None on the lowest body.
    """

    rectangles: FloatArray
    centres: FloatArray
    bottom_m: float
    top_m: float
    region: str = "pillar"
    below: FloatArray | None = None


@dataclass(frozen=True)
class Scene:
    """Breakpoints and gradings of a scene of boxes before it is meshed.

    Attributes
    ----------
    x, y, z : dict of bool
        Breakpoints in m of the lowest body; True marks singular edges.
    across, through : Grading
        Gradings along x and y, and along z.
    name : str
        Region of the lowest body.
    above : dict of bool or None
        Breakpoints along z of the pillars on it; None without pillars.
    along : Grading or None
        Grading of the pillars along z.
    feet : tuple of Foot
        Sections of pillars, one entry per kind and section.
    body : ndarray, shape (r, 4), or None
        Rectangles x0, x1, y0, y1 that the lowest body fills; None for all of it.
    faces : int
        2 if mirror images of the pillars hang below the body, else 1.
    joints : tuple of float
        Heights in m where layers of the lowest body meet.
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
    joints: tuple[float, ...] = ()


def zone_scene(design: Design, settings: HexSettings, quarter: bool = True) -> Scene:
    """Lay out the bare strip, length x width x thickness, whose long side faces are clamped.

    It is graded towards the clamped faces, and towards the free ends that meet them in singular corners.

    Parameters
    ----------
    design : Design
        The plate as built.
    settings : HexSettings
        Element sizes and grading.
    quarter : bool, optional
        Whether to keep x, y >= 0 only.

    Returns
    -------
    Scene
        Breakpoints in m.
    """
    x, y = (_span(size / 2.0, True, quarter) for size in (design.length_m, design.width_m))
    z = breaks_through(design.stack, True, True)
    return Scene(x, y, z, settings.grading, settings.grading, joints=design.stack.joints_m)


def pillar_scene(pillar: Pillar, settings: HexSettings, quarter: bool = True) -> Scene:
    """Lay out the isolated pillar, its foot on z = 0 (face `touch`).

    It is graded towards the rim of the clamped foot and its own re-entrant edges.

    Parameters
    ----------
    pillar : Pillar
        Pillar made of boxes.
    settings : HexSettings
        Element sizes and grading.
    quarter : bool, optional
        Whether to keep x, y >= 0 only.

    Returns
    -------
    Scene
        Breakpoints in m.

    Raises
    ------
    MeshError
        If boxes cannot follow the pillar.
    """
    foot = _outlines(pillar)[0]
    x, y = _edges(pillar)
    if quarter:
        x, y = ({0.0: False} | {edge: inner for edge, inner in breaks.items() if edge > 0.0} for breaks in (x, y))
    _, first, *levels = pillar.levels_m
    height, along = {0.0: True, first: bool(levels)}, settings.pillar_grading
    if not levels:
        return Scene(x, y, height, settings.grading, along, "pillar", body=foot)
    above, feet = (
        dict.fromkeys([first, *levels], True) | {levels[-1]: False},
        _prisms(pillar, np.zeros((1, 2)), 0.0)[1:],
    )
    return Scene(x, y, height, settings.grading, along, "pillar", above, along, feet, foot)


def panel_scene(panel: Panel, stack: Stack, pillar: Pillar | None, settings: HexSettings) -> Scene:
    """Lay out a rectangular panel of plate with its pillar, if any, and its middle at the origin.

    Parameters
    ----------
    panel : Panel
        Corners and foot in m; along the axes in `halved` only the positive side is kept.
    stack : Stack
        Layers of the plate.
    pillar : Pillar or None
        Pillar of a panel that does not name its own.
    settings : HexSettings
        Element sizes and grading.

    Returns
    -------
    Scene
        Breakpoints in m.

    Raises
    ------
    MeshError
        If boxes cannot follow the pillar.
    """
    middle = np.array(panel.middle)
    spans = []
    for axis in (0, 1):
        half = (panel.high[axis] - panel.low[axis]) / 2.0
        spans.append(_span(half, False, axis in panel.halved))
    pillar = panel.pillar or pillar
    stands = (PillarGroup(pillar, np.array([panel.foot]) - middle),) if pillar and panel.foot else ()
    return _plate_with_pillars(stack, settings, stands, *spans)


def bonded_scene(
    span_m: FloatArray,
    stack: Stack,
    stands: tuple[PillarGroup, ...],
    box_m: FloatArray,
    back: bool,
    settings: HexSettings,
) -> Scene:
    """Lay out a rectangle of plate with its pillars and a body bonded to it.

    It is graded towards the edges of the body too, where the forces between both concentrate.

    Parameters
    ----------
    span_m : ndarray, shape (4,)
        The rectangle x0, x1, y0, y1 in m.
    stack : Stack
        Layers of the plate.
    stands : tuple of PillarGroup
        Pillars and their centres.
    box_m : ndarray, shape (4,)
        The bonded rectangle x0, x1, y0, y1 in m.
    back : bool
        Whether the body is bonded to the back of the plate, not to its touch face.
    settings : HexSettings
        Element sizes and grading.

    Returns
    -------
    Scene
        Breakpoints in m.

    Raises
    ------
    MeshError
        If boxes cannot follow a pillar.
    """
    lines: list[dict[float, bool]] = [{}, {}]
    for breaks, ends, edges in zip(lines, span_m.reshape(2, 2), box_m.reshape(2, 2), strict=True):
        breaks |= dict.fromkeys(ends.tolist(), False) | {e: True for e in edges.tolist() if ends[0] < e < ends[1]}
    scene = _plate_with_pillars(stack, settings, stands, lines[0], lines[1])
    return replace(scene, z=scene.z | {stack.thickness_m if back else 0.0: True})


def cell_scene(design: Design, settings: HexSettings, quarter: bool = False) -> Scene:
    """Lay out the unit cell, pitch_x x pitch_y x thickness, centred, with its pillar in the middle.

    For staggered rows, the lines along y are also those of the neighbouring rows, half a pitch further along x.

    Parameters
    ----------
    design : Design
        The plate as built.
    settings : HexSettings
        Element sizes and grading.
    quarter : bool, optional
        Whether to keep x, y >= 0 only.

    Returns
    -------
    Scene
        Breakpoints in m.

    Raises
    ------
    MeshError
        If boxes cannot follow the pillar.
    """
    panel = replace(lattice_panel(design), halved=(0, 1) if quarter else ())
    scene = panel_scene(panel, design.stack, design.pillar, settings)
    if not design.stagger:
        return scene
    half = design.pitch_x_m / 2.0
    shifted = {x - np.copysign(half, x): inner for x, inner in scene.x.items()} | {0.0: False}
    return replace(scene, x=scene.x | shifted)


def plate_scene(design: Design, settings: HexSettings, quarter: bool = True) -> Scene:
    """Lay out the plate with every pillar; lines run along the borders of the zones.

    Parameters
    ----------
    design : Design
        The plate as built.
    settings : HexSettings
        Element sizes and grading.
    quarter : bool, optional
        Whether to keep x, y >= 0 only.

    Returns
    -------
    Scene
        Breakpoints in m.

    Raises
    ------
    MeshError
        If boxes cannot follow a pillar.
    """
    x = _span(design.half_length_m, False, quarter)
    y = _span(design.half_span_m, False, quarter)
    borders = (each.centre_m[1] + side * design.width_m / 2.0 for each in design.views for side in (-1.0, 1.0))
    y |= {v: False for v in borders if v >= min(y)}
    x |= {v: False for v in design.touch_cuts_m if v >= min(x)}
    stands, reach = design.standing(), design.footprint_m / 2.0
    if quarter:
        stands = tuple(PillarGroup(each.pillar, each.centres[(each.centres > -reach).all(axis=1)]) for each in stands)
    return _plate_with_pillars(design.stack, settings, stands, x, y)


def part_scene(design: Design, part: str, settings: HexSettings, quarter: bool = True) -> Scene:
    """Lay out one part of a design.

    Parameters
    ----------
    design : Design
        The plate as built.
    part : {'zone', 'pillar', 'plate'}
        The zone, the isolated pillar or the plate.
    settings : HexSettings
        Element sizes and grading.
    quarter : bool, optional
        Whether to keep x, y >= 0 only.

    Returns
    -------
    Scene
        Breakpoints in m.

    Raises
    ------
    MeshError
        If boxes cannot follow a pillar.
    """
    if part == "pillar":
        assert design.pillar
        return pillar_scene(design.pillar, settings, quarter)
    return (zone_scene if part == "zone" else plate_scene)(design, settings, quarter)


def _span(half: float, singular: bool, quarter: bool) -> dict[float, bool]:
    return {(0.0 if quarter else -half): singular and not quarter, half: singular}


def breaks_through(stack: Stack, touch: bool, back: bool) -> dict[float, bool]:
    """List the breakpoints through a plate: both faces, and the heights where its layers meet.

    Parameters
    ----------
    stack : Stack
        Layers of the plate.
    touch, back : bool
        Whether edges on the touch face, or on the back, are singular.

    Returns
    -------
    dict of bool
        Breakpoints in m; True marks singular edges.
    """
    return {0.0: touch} | dict.fromkeys(stack.joints_m, False) | {stack.thickness_m: back}


def _plate_with_pillars(
    stack: Stack,
    settings: HexSettings,
    stands: tuple[PillarGroup, ...],
    x: dict[float, bool],
    y: dict[float, bool],
) -> Scene:
    """Lines pass along every foot edge, graded there in x, y and in z on both sides of the foot."""
    stands = tuple(each for each in stands if len(each.centres))
    if not stands:
        z, through = breaks_through(stack, False, False), settings.through_grading(stack)
        return Scene(x, y, z, settings.grading, through, joints=stack.joints_m)
    for breaks, column in ((x, 0), (y, 1)):
        low, high = min(breaks), max(breaks)
        for each in stands:
            for centre in sorted(set(each.centres[:, column].tolist())):
                for edge, inner in _edges(each.pillar)[column].items():
                    if low < centre + edge < high:
                        breaks[centre + edge] = inner or breaks.get(centre + edge, False)
    (faces,) = {each.pillar.faces for each in stands}
    z, through, top = breaks_through(stack, faces == 2, True), settings.through_grading(stack), stack.thickness_m
    feet = tuple(foot for each in stands for foot in _prisms(each.pillar, each.centres, top))
    junctions = {foot.bottom_m for foot in feet}
    above = {height: height in junctions for foot in feet for height in (foot.bottom_m, foot.top_m)}
    along, joints = settings.pillar_grading, stack.joints_m
    return Scene(x, y, z, settings.grading, through, "plate", above, along, feet, faces=faces, joints=joints)


def _edges(pillar: Pillar) -> tuple[dict[float, bool], dict[float, bool]]:
    """Coordinates of the sides of all sections along x and y, m, and whether the edge there is re-entrant."""
    outlines = _outlines(pillar)
    sides: list[dict[float, bool]] = []
    for columns in ([0, 1], [2, 3]):
        reaches = [inf, *(np.abs(outline[:, columns]).max() for outline in outlines), 0.0]
        found: dict[float, bool] = {}
        for outline, below, above in zip(outlines, reaches, reaches[2:], strict=False):
            for edge in sorted(set(outline[:, columns].ravel().tolist())):
                found[edge] = found.get(edge, False) or bool(abs(edge) < max(below, above))
        sides.append(found)
    return sides[0], sides[1]


def _prisms(pillar: Pillar, centres: FloatArray, bottom_m: float) -> tuple[Foot, ...]:
    """The sections of the pillars at centres (n, 2) that stand at a height."""
    levels = [bottom_m + level for level in pillar.levels_m]
    outlines = _outlines(pillar)
    parts = zip(outlines, pairwise(levels), section_names(len(outlines)), [None, *outlines], strict=False)
    return tuple(Foot(outline, centres, *ends, name, below) for outline, ends, name, below in parts)


def _outlines(pillar: Pillar) -> list[FloatArray]:
    """The rectangles of every section. MeshError where boxes cannot follow the pillar."""
    found = [section.form.rectangles for section in pillar.parts]
    known = [rectangles for rectangles in found if rectangles is not None]
    if len(known) < len(found) or pillar.fillet_m:
        shapes = " and ".join(dict.fromkeys(section.shape for section in pillar.sections))
        what = f"{shapes} pillar{' with a fillet' if pillar.fillet_m else ''}"
        raise MeshError(
            f"a {what} is not made of boxes: structured hexahedra cannot follow it, nor a body bonded over it"
        )
    return known


# -- counts ------------------------------------------------------------------------------------------------------------
# Exact sizes of a mesh from its breakpoints, without meshing, so that a mesh too large to build is counted too.


@dataclass(frozen=True)
class Block:
    """A product of columns, rows and layers of boxes, for counting.

    A union of rectangles is counted by inclusion and exclusion: intersections of several have the sign -1 and +1 in
    turn.

    Attributes
    ----------
    x, y : tuple of int
        Elements along x of each column, and along y of each row.
    z : int
        Elements along z.
    stands : bool
        Whether the lowest nodes are shared with the block below.
    sign : int
        1 or -1.
    """

    x: tuple[int, ...]
    y: tuple[int, ...]
    z: int
    stands: bool = False
    sign: int = 1

    def total(self, along: Callable[[int], int]) -> int:
        """A count that is a product over the axes, less the part that feet share with the bodies below."""
        return self.sign * sum(map(along, self.x)) * sum(map(along, self.y)) * (along(self.z) - self.stands)


@dataclass(frozen=True)
class BoxCounts:
    """Blocks of hexahedra of an order, and what follows: exact."""

    order: int
    blocks: tuple[Block, ...]

    @property
    def elements(self) -> int:
        """Hexahedra."""
        return sum(block.sign * sum(block.x) * sum(block.y) * block.z for block in self.blocks)

    @property
    def nodes(self) -> int:
        """Nodes."""
        return sum(block.total(lambda count: self.order * count + 1) for block in self.blocks)

    @property
    def pairs(self) -> int:
        """Ordered pairs of nodes that share an element: entries of the scalar mass, a ninth of the stiffness's."""
        # along one axis, (order + 1)^2 pairs per element, of which neighbours share that of their common node with itself
        return sum(block.total(lambda count: count * (self.order + 1) ** 2 - (count - 1)) for block in self.blocks)


def box_counts(scene: Scene, order: int) -> BoxCounts:
    """Count the elements and nodes of `hex_mesh(boxes_of(scene), order)` without meshing.

    Parameters
    ----------
    scene : Scene
        Breakpoints, gradings and feet.
    order : int
        Order of the elements.

    Returns
    -------
    BoxCounts
        Exact counts.
    """
    up = _interval_count(scene.z, scene.through)
    if scene.body is None:
        whole = (_interval_count(scene.x, scene.across),), (_interval_count(scene.y, scene.across),)
        blocks = [Block(*whole, up)]
    else:
        blocks = [_block(scene, np.zeros((1, 2)), part, up, False, sign) for sign, part in _union(scene.body)]
    if scene.above is not None and scene.along is not None:
        for foot in scene.feet:
            span = {z: graded for z, graded in scene.above.items() if foot.bottom_m <= z <= foot.top_m}
            up, alone = _interval_count(span, scene.along), foot.below is None
            own = [_block(scene, foot.centres, part, up, alone, sign) for sign, part in _union(foot.rectangles)]
            own += [_block(scene, foot.centres, part, 0, False, -sign) for sign, part in _shared(foot)]
            blocks += own * scene.faces
    return BoxCounts(order, tuple(blocks))


def _shared(foot: Foot) -> Iterator[tuple[int, FloatArray]]:
    """Signs and rectangles of the faces that prisms share with others that they stand on."""
    for sign, part in _union(foot.rectangles):
        for other, below in _union(np.empty((0, 4)) if foot.below is None else foot.below):
            x0, y0 = np.maximum(part[::2], below[::2])
            x1, y1 = np.minimum(part[1::2], below[1::2])
            if x0 < x1 and y0 < y1:
                yield sign * other, np.array([x0, x1, y0, y1])


def _union(rectangles: FloatArray) -> Iterator[tuple[int, FloatArray]]:
    """Signs and rectangles whose signed sum covers the union of rectangles (r, 4) once."""
    for count in range(1, len(rectangles) + 1):
        for members in combinations(rectangles, count):
            shared = np.array(members)
            x0, x1, y0, y1 = shared[:, 0].max(), shared[:, 1].min(), shared[:, 2].max(), shared[:, 3].min()
            if x0 <= x1 and y0 <= y1:
                yield (-1) ** (count + 1), np.array([x0, x1, y0, y1])


def _block(scene: Scene, centres: FloatArray, part: FloatArray, up: int, stands: bool, sign: int) -> Block:
    x = _counts(scene.x, centres[:, 0], part[:2], scene.across)
    return Block(x, _counts(scene.y, centres[:, 1], part[2:], scene.across), up, stands, sign)


def _counts(breaks: dict[float, bool], centres: FloatArray, side: FloatArray, grading: Grading) -> tuple[int, ...]:
    """Elements that a side about each column of centres takes along one axis; a mirror or the plate's edge may cut it."""
    low, high = min(breaks), max(breaks)
    slack = SAME * (high - low)
    counts = []
    for centre in sorted(set(centres.tolist())):
        start, end = max(low, centre + side[0]) - slack, min(high, centre + side[1]) + slack
        within = {place: graded for place, graded in breaks.items() if start <= place <= end}
        if within:
            counts.append(_interval_count(within, grading))
    return tuple(counts)
