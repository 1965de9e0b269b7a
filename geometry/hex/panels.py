"""Panels of plate meshed by hexahedra about round, hexagonal and tapered feet, and panels whose pillar moves or grows."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from geometry.elements import FloatArray, IntArray
from geometry.errors import MeshError
from geometry.hex.boxes import Boxes, hex_mesh, interpolation, panel_boxes
from geometry.hex.scenes import Grading, HexSettings, breaks_through, grid_lines
from geometry.layout import Pillar, Section, section_names
from geometry.materials import Stack, layer_names
from geometry.mesh import Mesh
from geometry.pillar_shapes import Square
from geometry.tiling import Panel

if TYPE_CHECKING:
    from scipy.sparse import csr_array

CORNERS = 2.0 / np.sqrt(3.0)  # width of a hexagon across corners over that across flats
CORE = 0.5  # half-width of the middle of a disc over its radius
NOTCH = 0.42  # of the radius: where the middle's corner lies along x and y
SAME = 1.2345e-9  # of the largest coordinate: one place
Map = Callable[[FloatArray, FloatArray], FloatArray]
Rim = Callable[[FloatArray], FloatArray]
ROOM = 0.6  # of half a foot's width: plate beyond the rim that the block fills where the panel has so much
SLIVER = 0.2  # of the same: a strip beyond the block that is narrower belongs to it
CLEAR = 0.02  # of the foot's reach: plate that must lie between rim and side for elements to fill it

FLUSH_M = 1e-12


@dataclass(frozen=True)
class Patch:
    """A rectangle of elements in plan, with coordinates u and v of its own.

    Attributes
    ----------
    u, v : ndarray, shape (nu + 1,) or (nv + 1,)
        Ascending lines of its coordinates.
    place : callable
        Map of coordinates u (n,) and v (n,) to places (n, 2).
    inside : ndarray, shape (nu, nv)
        1 for elements on which the pillar stands, else 0.
    block : tuple of bool
        Whether the patch belongs to the block about the foot, along x and along y.
    """

    u: FloatArray
    v: FloatArray
    place: Map
    inside: FloatArray
    block: tuple[bool, bool] = (True, True)


@dataclass(frozen=True)
class PlanLines:
    """Lines of the patches of a quadrant, each from 0 to 1 except for those of the plate.

    Attributes
    ----------
    turn : ndarray, shape (n,)
        Lines around a foot.
    inner : ndarray, shape (n,)
        Lines inside the foot towards its rim.
    fill : ndarray, shape (n,)
        Lines from the rim to the edge of the block.
    plate : tuple of ndarray, shape (n,)
        Lines of the plate beyond the block along x and y, in m; a single line without such a plate.
    """

    turn: FloatArray
    inner: FloatArray
    fill: FloatArray
    plate: tuple[FloatArray, FloatArray] = (np.empty(0), np.empty(0))


@dataclass(frozen=True)
class PatchedMesh:
    """A mesh of joined patches.

    Attributes
    ----------
    mesh : Mesh
        The mesh.
    boxes : tuple of Boxes
        Grid of each patch in its own coordinates, before it was put in place.
    numbers : tuple of ndarray, shape (n,)
        Numbers in the mesh of the nodes of each grid.
    """

    mesh: Mesh
    boxes: tuple[Boxes, ...]
    numbers: tuple[IntArray, ...]


Quadrant = Callable[[float, tuple[float, float], PlanLines], Iterator[Patch]]


@dataclass(frozen=True)
class PillarChange:
    """Change of a pillar's height and width, and offset of its foot along x and y, m.

    Its section keeps its shape: all widths grow by the same ratio.
    """

    height_m: float = 0.0
    side_m: float = 0.0
    x_m: float = 0.0
    y_m: float = 0.0


@dataclass(frozen=True)
class VariedPanel:
    """A panel with a pillar that may change.

    It is meshed together with its mirror image about each axis in `opened`; the panel must be halved along these.
    """

    panel: Panel
    stack: Stack
    pillar: Pillar
    settings: HexSettings
    opened: tuple[int, ...] = ()

    @cached_property
    def still(self) -> Mesh:
        """The mesh of the unchanged pillar. Raises MeshError as panel_mesh."""
        return self._patched.mesh if self.pillar.form.plan in PLANS else self._of_boxes

    def moved(self, change: PillarChange) -> Mesh:
        """Return the mesh with a changed pillar and the same panel.

        Raises MeshError if the foot leaves the panel.
        """
        if change.height_m <= -self.pillar.height_m:
            raise MeshError("a pillar's height must stay above 0")
        shifts = _Shift.along(self.panel, self.pillar, change, 0), _Shift.along(self.panel, self.pillar, change, 1)
        if self.pillar.form.plan not in PLANS:
            return self._shifted(shifts, change)
        grown, shift_m = 1.0 + change.side_m / self.pillar.base_m, (change.x_m, change.y_m)
        patches = _foot_patches(self._whole, self.pillar, self.settings, grown, shift_m)
        z = lines_along_z(self.stack, self.pillar, self.settings)
        return _relaid(self._patched, patches, self._raised(z, change), self.stack.thickness_m)

    def _raised(self, z: FloatArray, change: PillarChange) -> FloatArray:
        """Places along z, those above the plate stretched to the changed height."""
        beyond = np.maximum(z - self.stack.thickness_m, 0.0)
        return np.asarray(z + beyond * change.height_m / self.pillar.height_m)

    @property
    def _whole(self) -> Panel:
        kept = tuple(axis for axis in self.panel.halved if axis not in self.opened)
        return replace(self.panel, halved=kept)

    @cached_property
    def _patched(self) -> PatchedMesh:
        return panel_mesh(self._whole, self.stack, self.pillar, self.settings)

    @cached_property
    def _of_boxes(self) -> Mesh:
        boxes = panel_boxes(replace(self.panel, pillar=square_of(self.pillar)), self.stack, None, self.settings)
        for axis in self.opened:
            boxes = unfolded(boxes, axis)
        taper = 1.0 if self.pillar.is_made_of_boxes else self.pillar.form.taper
        mesh = hex_mesh(boxes, self.settings.order)
        return leaning(mesh, _foot_from_middle(self.panel), self.stack.thickness_m, self.pillar.height_m, taper)

    def _shifted(self, shifts: tuple[_Shift, _Shift], change: PillarChange) -> Mesh:
        """Lines along the axes go along with the foot: the plate's nodes piecewise linearly between the panel's sides and the
        foot's, those of the pillar as its foot does.
        """
        mesh = self.still
        x, y, z = mesh.nodes.T
        above = z > self.stack.thickness_m + FLUSH_M
        plan = [np.where(above, own.foot(line), own.plate(line)) for own, line in zip(shifts, (x, y), strict=True)]
        nodes = np.column_stack([*plan, self._raised(z, change)])
        spans = None if mesh.spans is None else np.ptp(nodes[mesh.cells], axis=1)
        return replace(mesh, nodes=nodes, spans=spans)


@dataclass(frozen=True)
class _Shift:
    """Coordinates of the panel's and the foot's sides along an axis, before and after a change, (4,) m each."""

    old: FloatArray
    new: FloatArray

    @classmethod
    def along(cls, panel: Panel, pillar: Pillar, change: PillarChange, axis: int) -> _Shift:
        """A foot flush with a side stays so and grows to the other side."""
        edge = (panel.high[axis] - panel.low[axis]) / 2.0
        half, grown = pillar.form.extent_m()[axis] / 2.0, 1.0 + change.side_m / pillar.base_m
        ends, centre = np.array([-half, half]), _foot_from_middle(panel)[axis]
        feet, moved = centre + ends, centre + (change.x_m, change.y_m)[axis] + grown * ends
        flush = np.abs(np.abs(feet) - edge) < FLUSH_M
        if flush.any():
            moved = np.where(flush, feet, feet + (0.0 if flush.all() else 2.0 * (grown - 1.0) * ends))
        inner = np.concatenate([moved[:1] + edge, np.diff(moved), edge - moved[1:]])
        if inner[1] <= 0.0 or (inner[[0, 2]] < np.where(flush, 0.0, FLUSH_M) - FLUSH_M / 2.0).any():
            raise MeshError("a pillar extends beyond its panel: reduce its scatter or increase the pitch")
        return cls(np.array([-edge, *feet, edge]), np.array([-edge, *moved, edge]))

    def plate(self, line: FloatArray) -> FloatArray:
        """Places along the axis in the plate."""
        once = np.concatenate([[True], np.diff(self.old) > FLUSH_M])
        return np.asarray(np.interp(line, self.old[once], self.new[once]))

    def foot(self, line: FloatArray) -> FloatArray:
        """Places along the axis in the pillar, whose sections may reach beyond the foot."""
        ratio = (self.new[2] - self.new[1]) / (self.old[2] - self.old[1])
        return np.asarray(self.new[1] + (line - self.old[1]) * ratio)


def straight(u: FloatArray, v: FloatArray) -> FloatArray:
    """Place a patch whose coordinates are places.

    Parameters
    ----------
    u, v : ndarray, shape (n,)
        Coordinates x and y.

    Returns
    -------
    ndarray, shape (n, 2)
        Places.
    """
    return np.column_stack([u, v])


def disc(radius: float, block: tuple[float, float], lines: PlanLines) -> Iterator[Patch]:
    """Yield the patches of the quadrant x, y >= 0 about a round foot: middle, ring, rest of the block, plate.

    Parameters
    ----------
    radius : float
        Radius of the foot, in the unit of `lines` (m in `panel_mesh`).
    block : tuple of float
        Half-widths of the block about the foot along x and y, in the same unit.
    lines : PlanLines
        Lines of the patches.

    Yields
    ------
    Patch
        A patch about the foot's centre.
    """
    turn = lines.turn

    def middle(u: FloatArray, v: FloatArray) -> FloatArray:
        return radius * np.column_stack([CORE * u * (1.0 - v) + NOTCH * u * v, CORE * v * (1.0 - u) + NOTCH * v * u])

    def arc(v: FloatArray) -> FloatArray:
        return radius * np.column_stack([np.cos(np.pi / 4.0 * v), np.sin(np.pi / 4.0 * v)])

    def around(u: FloatArray, v: FloatArray) -> FloatArray:
        return between(middle(np.ones_like(v), v), arc(v), u)

    yield Patch(turn, turn, middle, filled(turn, turn, 1.0))
    yield Patch(lines.inner, turn, around, filled(lines.inner, turn, 1.0))
    yield Patch(turn, lines.inner, _exchanged(around), filled(turn, lines.inner, 1.0))
    yield from _filling(arc, lambda u: arc(u)[:, ::-1], block, turn, lines)


def hexagon(flat: float, block: tuple[float, float], lines: PlanLines) -> Iterator[Patch]:
    """Yield the patches of the quadrant x, y >= 0 about a hexagonal foot, whose quarter is one patch of four corners.

    Parameters
    ----------
    flat : float
        Distance of the flats y = +-flat from the centre, in the unit of `lines` (m in `panel_mesh`).
    block : tuple of float
        Half-widths of the block about the foot along x and y, in the same unit.
    lines : PlanLines
        Lines of the patches.

    Yields
    ------
    Patch
        A patch about the foot's centre.
    """
    corner, inner = CORNERS * flat, lines.inner

    def quarter(u: FloatArray, v: FloatArray) -> FloatArray:
        return np.column_stack([corner * u * (1.0 - v / 2.0), flat * v])

    yield Patch(inner, inner, quarter, filled(inner, inner, 1.0))
    right, upper = (lambda v: quarter(np.ones_like(v), v)), (lambda u: quarter(u, np.ones_like(u)))
    yield from _filling(right, upper, block, inner, lines)


def beside(under_x: FloatArray, under_y: FloatArray, lines: tuple[FloatArray, FloatArray]) -> Iterator[Patch]:
    """Yield the patches of the plate around a block: two arms and the corner.

    Parameters
    ----------
    under_x, under_y : ndarray, shape (n,)
        Lines of the block's edges along x and y.
    lines : tuple of ndarray, shape (m,)
        Lines beyond the block along x and y; fewer than two where there is no plate.

    Yields
    ------
    Patch
        A straight patch without a pillar.
    """
    x, y = lines
    for u, v, block in ((x, under_y, (False, True)), (under_x, y, (True, False)), (x, y, (False, False))):
        if len(u) > 1 and len(v) > 1:
            yield Patch(u, v, straight, filled(u, v), block)


def _reflected(patch: Patch, signs: tuple[int, int], origin: FloatArray) -> Patch:
    """The mirror image of a patch in the axes whose sign is -1, about an origin (2,); its elements keep their handedness."""
    place, flip = patch.place, signs[0] * signs[1]

    def image(u: FloatArray, v: FloatArray) -> FloatArray:
        return np.asarray(place(flip * u, v) * np.array(signs) + origin)

    if flip > 0:
        return replace(patch, place=image)
    return replace(patch, u=-patch.u[::-1], place=image, inside=patch.inside[::-1])


def leaning(mesh: Mesh, centre: FloatArray, thickness: float, height: float, taper: float) -> Mesh:
    """Taper the pillar of a mesh, and its image below the plate, linearly with its height.

    Parameters
    ----------
    mesh : Mesh
        Mesh with a prismatic pillar.
    centre : ndarray, shape (2,)
        Centre of the foot, in the unit of the mesh.
    thickness, height : float
        Thickness of the plate and height of the pillar, in the same unit.
    taper : float
        Width of the pillar at its height, relative to its foot.

    Returns
    -------
    Mesh
        Mesh with moved nodes and without `spans`; the mesh itself for a taper of 1.
    """
    if taper == 1.0:
        return mesh
    above = np.maximum(np.maximum(mesh.nodes[:, 2] - thickness, -mesh.nodes[:, 2]), 0.0) / height
    plan = centre + (mesh.nodes[:, :2] - centre) * (1.0 + (taper - 1.0) * above)[:, None]
    return replace(mesh, nodes=np.column_stack([plan, mesh.nodes[:, 2]]), spans=None)


def joined(
    patches: list[Patch],
    z: FloatArray,
    thickness: float,
    order: int,
    joints: Sequence[float] = (),
    levels: Sequence[float] = (),
    edges: FloatArray | None = None,
) -> PatchedMesh:
    """Extrude patches along z and join them into one mesh.

    Nodes in the same place become one. The pillar stands above the thickness and hangs below 0.

    Parameters
    ----------
    patches : list of Patch
        Patches in plan, which meet node for node.
    z : ndarray, shape (n,)
        Ascending lines along z, in the unit of the patches.
    thickness : float
        Thickness of the plate, in the same unit.
    order : int
        Order of the elements, 1 to 4.
    joints : sequence of float, optional
        Heights where layers of the plate meet, lines along z among them, in the unit of `z`.
    levels : sequence of float, optional
        Heights above the plate where sections of the pillar meet, in the unit of `z`.
    edges : ndarray, shape (2, 2), optional
        Vectors along the sides of an oblique cell, in the unit of `z`; by default sides lie along x and y.

    Returns
    -------
    PatchedMesh
        The mesh, and the grid and node numbers of each patch.

    Raises
    ------
    MeshError
        If two patches do not meet node for node.
    """
    grids = tuple(boxes_of_patch(patch, z, thickness) for patch in patches)
    own = [hex_mesh(grid, order) for grid in grids]
    places = np.concatenate([_placed(patch, mesh) for patch, mesh in zip(patches, own, strict=True)])
    _, first, same = np.unique(
        np.round(places / (SAME * np.abs(places).max())).astype(np.int64),
        axis=0,
        return_index=True,
        return_inverse=True,
    )
    numbers = tuple(np.split(same.ravel(), np.cumsum([len(mesh.nodes) for mesh in own])[:-1]))
    cells = np.concatenate([number[mesh.cells] for number, mesh in zip(numbers, own, strict=True)])
    standing = np.concatenate(
        [np.isin(np.arange(len(m.cells)), m.regions.get("pillar", np.empty(0, dtype=int))) for m in own]
    )
    middles = places[first][cells][:, :, 2].mean(axis=1)
    layer = np.where(standing, -1, np.searchsorted(np.asarray(joints, dtype=float), middles))
    regions = {name: np.flatnonzero(layer == number) for number, name in enumerate(layer_names(len(joints) + 1))}
    above = np.where(middles > thickness, middles - thickness, -middles)
    section = np.where(standing, np.searchsorted(np.asarray(levels, dtype=float), above), -1)
    regions |= {name: np.flatnonzero(section == number) for number, name in enumerate(section_names(len(levels) + 1))}
    spans = [mesh.spans for mesh in own if mesh.spans is not None]
    lengths = np.concatenate(spans) if all(patch.place is straight for patch in patches) else None
    mesh = Mesh(places[first], cells, "hex", order, regions, {}, lengths)
    mesh = replace(mesh, faces=_outer(mesh, edges))
    _check_joints(mesh, thickness)
    return PatchedMesh(mesh, grids, numbers)


def _relaid(still: PatchedMesh, patches: list[Patch], z: FloatArray, thickness: float) -> Mesh:
    """The mesh with its nodes where other patches, as many and cut alike, and other lines along z put them."""
    mesh, nodes = still.mesh, np.empty_like(still.mesh.nodes)
    for patch, own in zip(patches, still.numbers, strict=True):
        nodes[own] = _placed(patch, hex_mesh(boxes_of_patch(patch, z, thickness), mesh.order))
    return replace(mesh, nodes=nodes, spans=None)


def boxes_of_patch(patch: Patch, z: FloatArray, thickness: float) -> Boxes:
    """Make the grid of a patch in its own two coordinates and z.

    Parameters
    ----------
    patch : Patch
        Patch in plan.
    z : ndarray, shape (n,)
        Ascending lines along z.
    thickness : float
        Thickness of the plate, in the unit of z.

    Returns
    -------
    Boxes
        Grid with regions plate and pillar.
    """
    middle = (z[1:] + z[:-1]) / 2.0
    region = np.where((middle > thickness) | (middle < 0.0), np.where(patch.inside[:, :, None] > 0.0, 1, -1), 0)
    return Boxes(patch.u, patch.v, z, region, ("plate", "pillar"))


PLANS: dict[str, tuple[Quadrant, tuple[float, float]]] = {
    "disc": (disc, (1.0, 1.0)),
    "hexagon": (hexagon, (CORNERS, 1.0)),
}


def panel_mesh(panel: Panel, stack: Stack, pillar: Pillar | None, settings: HexSettings) -> PatchedMesh:
    """Mesh a rectangular panel with its pillar, if any, and its middle at the origin.

    Parameters
    ----------
    panel : Panel
        Corners and foot in m; along the axes in `halved` only the positive side is meshed.
    stack : Stack
        Layers of the plate.
    pillar : Pillar or None
        Pillar of a panel that does not name its own.
    settings : HexSettings
        Order, element sizes and grading.

    Returns
    -------
    PatchedMesh
        The mesh in m, and the grid and node numbers of each patch.

    Raises
    ------
    MeshError
        For a pillar or a place that hexahedra cannot follow.
    """
    own = panel.pillar or pillar
    if panel.foot is None or own is None or own.is_made_of_boxes:
        return _of_boxes(panel, stack, pillar, settings)
    if not (own.takes_hexahedra and has_room(panel, own)):
        raise MeshError(f"hexahedra cannot follow a {own.shape} pillar in a panel of this size")
    if own.form.plan == "rectangle":
        prism = _of_boxes(replace(panel, pillar=square_of(own)), stack, None, settings)
        frustum = leaning(prism.mesh, _foot_from_middle(panel), stack.thickness_m, own.height_m, own.form.taper)
        return replace(prism, mesh=frustum)
    z, patches = lines_along_z(stack, own, settings), _foot_patches(panel, own, settings)
    return joined(patches, z, stack.thickness_m, settings.order, stack.joints_m, own.levels_m[1:-1])


def with_nodes_along(
    panel: Panel, along: int, settings: HexSettings, mesh_of: Callable[[HexSettings], Mesh]
) -> HexSettings:
    """Return the elements of a panel with a foot, more where a side has too few nodes for a polynomial of a degree.

    Two elements at least lie along a side, whichever the foot: degrees up to twice their order need no look at the mesh.

    Parameters
    ----------
    panel : Panel
        The panel.
    along : int
        Degree along its sides.
    settings : HexSettings
        The elements to begin with.
    mesh_of : callable
        Meshes the panel with given elements.

    Returns
    -------
    HexSettings
        The elements, each side with more nodes than `along`.
    """
    if along > 2 * settings.order * settings.least:
        while settings.least < along and _side_nodes(mesh_of(settings), panel) <= along:
            settings = replace(settings, least=settings.least + 1)
    return settings


def _side_nodes(mesh: Mesh, panel: Panel) -> int:
    """Nodes along the side that has fewest of them, those beyond a mirror included."""
    counts, sides = [], np.eye(3)
    if panel.edges_m is not None:
        sides[:2, :2] = panel.edges_m
    for axis, side in ((1, "x+"), (0, "y+")):
        places = mesh.nodes[mesh.nodes_of(side)] @ sides[axis]
        along = len(np.unique(np.round(places / np.ptp(places), 9)))
        counts.append(2 * along - 1 if axis in panel.halved else along)
    return min(counts)


def disc_mesh(panel: Panel, stack: Stack, radius_m: float, settings: HexSettings) -> Mesh:
    """Mesh a rectangular panel about a disc of its bare back face, graded towards the disc's rim.

    Parameters
    ----------
    panel : Panel
        Corners and the disc's centre, its foot, in m.
    stack : Stack
        Layers of the plate.
    radius_m : float
        Radius of the disc.
    settings : HexSettings
        Order, element sizes and grading.

    Returns
    -------
    Mesh
        Nodes in m from the panel's middle; those on the disc are on nodes of its elements' faces.

    Raises
    ------
    MeshError
        If elements about the rim do not meet node for node.
    """
    z = grid_lines(breaks_through(stack, False, True), settings.through_grading(stack))
    patches = _quadrants(panel, "disc", radius_m, settings.grading)
    mesh = joined(patches, z, stack.thickness_m, settings.order, stack.joints_m).mesh
    return replace(mesh, regions={name: cells for name, cells in mesh.regions.items() if len(cells)})


def transfer(coarse: PatchedMesh, fine: PatchedMesh) -> csr_array:
    """Build the matrix that carries a field from a panel's mesh to a finer one nested in the same lines.

    Parameters
    ----------
    coarse, fine : PatchedMesh
        Meshes of the same patches.

    Returns
    -------
    csr_array, shape (fine nodes, coarse nodes)
        Values of the coarse shape functions at the fine nodes.

    Raises
    ------
    MeshError
        If the meshes are not nested.
    """
    shape = len(fine.mesh.nodes), len(coarse.mesh.nodes)
    rows, columns, weights, known = [], [], [], np.zeros(shape[0], dtype=bool)
    for one, other, own, theirs in zip(coarse.boxes, fine.boxes, fine.numbers, coarse.numbers, strict=True):
        part = interpolation(one, other, fine.mesh.order, coarse.mesh.order).tocoo()
        fresh = ~known[own[part.row]]
        rows.append(own[part.row][fresh])
        columns.append(theirs[part.col][fresh])
        weights.append(part.data[fresh])
        known[own] = True
    from scipy.sparse import csr_array  # slow to import, and of no use to a plan

    return csr_array((np.concatenate(weights), (np.concatenate(rows), np.concatenate(columns))), shape=shape)


def has_room(panel: Panel, pillar: Pillar) -> bool:
    """Check that elements about a foot have some plate between rim and side.

    Parameters
    ----------
    panel : Panel
        Corners and foot in m.
    pillar : Pillar
        Pillar on the foot.

    Returns
    -------
    bool
        True also for a bare panel, and for a foot that follows the lines of the grid.
    """
    if pillar.form.plan not in PLANS or panel.foot is None:
        return True
    _, rim = PLANS[pillar.form.plan]
    reach = [(1.0 + CLEAR) * wide * pillar.base_m / 2.0 for wide in rim]
    return all(end >= reach[axis] for axis, ends in enumerate(_ends(panel)) for end in ends.values())


def square_of(pillar: Pillar) -> Pillar:
    """Return the square prisms with the heights of a pillar's sections and the widths of their feet.

    Parameters
    ----------
    pillar : Pillar
        Any pillar.

    Returns
    -------
    Pillar
        The prisms; the pillar itself if it is made of boxes.
    """
    if pillar.is_made_of_boxes:
        return pillar
    upper = tuple(Section.square(each.base_m, each.height_m, each.material) for each in pillar.upper)
    return replace(pillar, shape=Square.name, tip_m=pillar.base_m, fillet_m=0.0, file=None, more_m=(), upper=upper)


def _foot_patches(
    panel: Panel, pillar: Pillar, settings: HexSettings, grown: float = 1.0, shift_m: tuple[float, float] = (0.0, 0.0)
) -> list[Patch]:
    """Quadrants about the foot, as many as the panel is not halved along.

    Of a pillar `grown` times as wide that stands off its place by `shift_m` the same patches, in the same block of the plate.
    """
    return _quadrants(panel, pillar.form.plan, pillar.base_m / 2.0, settings.grading, grown, shift_m)


def _quadrants(
    panel: Panel,
    plan: str,
    half: float,
    grading: Grading,
    grown: float = 1.0,
    shift_m: tuple[float, float] = (0.0, 0.0),
) -> list[Patch]:
    """The patches about a foot of a plan, half its width across."""
    (quadrant, rim), origin, patches = PLANS[plan], _foot_from_middle(panel), []
    x_ends, y_ends = _ends(panel)
    places = [((x, y), (x_end, y_end)) for x, x_end in x_ends.items() for y, y_end in y_ends.items()]
    blocks = [_block(half, rim, ends) for _, ends in places]
    shared = _lines(half, rim, blocks, grading)  # quadrants meet along the axes
    for (signs, ends), block in zip(places, blocks, strict=True):
        less = signs[0] * shift_m[0], signs[1] * shift_m[1]
        plate = _beyond(block[0], ends[0], grading) - less[0], _beyond(block[1], ends[1], grading) - less[1]
        own = quadrant(grown * half, (block[0] - less[0], block[1] - less[1]), replace(shared, plate=plate))
        patches += [_reflected(patch, signs, origin + np.array(shift_m)) for patch in own]
    return patches


def lines_along_z(stack: Stack, pillar: Pillar, settings: HexSettings) -> FloatArray:
    """Lay lines through the plate and along its pillar, and along its mirror image below.

    Parameters
    ----------
    stack : Stack
        Layers of the plate.
    pillar : Pillar
        Pillar on it.
    settings : HexSettings
        Element sizes and grading.

    Returns
    -------
    ndarray, shape (n,)
        Ascending heights in m.
    """
    thickness_m = stack.thickness_m
    both, levels = pillar.faces == 2, [thickness_m + level for level in pillar.levels_m]
    z = grid_lines(breaks_through(stack, both, True), settings.through_grading(stack))
    along = grid_lines(dict.fromkeys(levels, True) | {levels[-1]: False}, settings.pillar_grading)
    below = thickness_m - along[:0:-1] if both else z[:0]
    return np.concatenate([below, z, along[1:]])


def _foot_from_middle(panel: Panel) -> FloatArray:
    """The foot's centre from the panel's middle, (2,) m."""
    assert panel.foot is not None
    return np.array(panel.foot) - np.array(panel.middle)


def unfolded(boxes: Boxes, axis: int) -> Boxes:
    """Mirror boxes about the plane at 0, which bounds them.

    Parameters
    ----------
    boxes : Boxes
        Boxes on the positive side of the plane.
    axis : {0, 1, 2}
        Axis normal to the plane.

    Returns
    -------
    Boxes
        Boxes on both sides.

    Raises
    ------
    MeshError
        For boxes that do not begin at 0.
    """
    lines = [boxes.x, boxes.y, boxes.z]
    half = lines[axis]
    if half[0] != 0.0:
        raise MeshError("only boxes that begin at 0 can be unfolded")
    lines[axis] = np.concatenate([-half[:0:-1], half])
    region = np.concatenate([np.flip(boxes.region, axis), boxes.region], axis)
    return Boxes(lines[0], lines[1], lines[2], region, boxes.names)


def _filling(
    right: Rim, upper: Rim, block: tuple[float, float], under: FloatArray, lines: PlanLines
) -> Iterator[Patch]:
    """Patches between the right and upper part of a foot's rim and the block's edge, and the plate around the block."""

    def beyond(u: FloatArray, v: FloatArray) -> FloatArray:
        return between(right(v), np.column_stack([np.full_like(v, block[0]), block[1] * v]), u)

    def above(u: FloatArray, v: FloatArray) -> FloatArray:
        return between(upper(u), np.column_stack([block[0] * u, np.full_like(u, block[1])]), v)

    yield Patch(lines.fill, under, beyond, filled(lines.fill, under))
    yield Patch(under, lines.fill, above, filled(under, lines.fill))
    yield from beside(block[0] * under, block[1] * under, lines.plate)


def _placed(patch: Patch, mesh: Mesh) -> FloatArray:
    """Places of the nodes of a patch's own grid."""
    return np.column_stack([patch.place(*mesh.nodes[:, :2].T), mesh.nodes[:, 2]])


def _check_joints(mesh: Mesh, thickness: float) -> None:
    """Raise MeshError if a facet of one element alone lies neither on a side, nor on the plate's faces or beyond them."""
    alone = np.sort(_alone(mesh), axis=1)
    z = mesh.nodes[alone, 2] / thickness
    above = (z >= 1.0 - 1e-9).all(axis=1) | (z <= 1e-9).all(axis=1)
    named = np.sort(np.concatenate(list(mesh.faces.values())), axis=1)
    known = np.unique(np.concatenate([named, alone[~above]]), axis=0)
    if len(known) != len(np.unique(named, axis=0)):
        raise MeshError("elements about a foot do not meet node for node")


def _outer(mesh: Mesh, edges: FloatArray | None) -> dict[str, IntArray]:
    """The facets in the planes that bound the mesh, by name; x and y count along the edges of an oblique cell."""
    facets = _alone(mesh)  # the face that a pillar below hangs from has no name
    nodes = (
        mesh.nodes if edges is None else np.column_stack([mesh.nodes[:, :2] @ np.linalg.inv(edges), mesh.nodes[:, 2]])
    )
    low, high = nodes.min(axis=0), nodes.max(axis=0)
    low[2] = 0.0
    near = 1e-9 * (high - low)
    names = (("x-", 0, low), ("x+", 0, high), ("y-", 1, low), ("y+", 1, high), ("touch", 2, low), ("top", 2, high))
    flat = {name: (np.abs(nodes[:, axis] - end[axis]) <= near[axis])[facets].all(axis=1) for name, axis, end in names}
    return {name: facets[on] for name, on in flat.items()}


def _alone(mesh: Mesh) -> IntArray:
    """The facets of one element alone."""
    (local,) = mesh.element.facets
    facets = np.concatenate([mesh.cells[:, face] for face in local])
    _, index, counts = np.unique(np.sort(facets, axis=1), axis=0, return_index=True, return_counts=True)
    return facets[np.sort(index[counts == 1])]


def filled(u: FloatArray, v: FloatArray, value: float = 0.0) -> FloatArray:
    """Give every element of a patch one value.

    Parameters
    ----------
    u, v : ndarray, shape (nu + 1,) or (nv + 1,)
        Lines of the patch.
    value : float, optional
        The value, dimensionless.

    Returns
    -------
    ndarray, shape (nu, nv)
        The value of each element.
    """
    return np.full((len(u) - 1, len(v) - 1), value)


def between(start: FloatArray, end: FloatArray, share: FloatArray) -> FloatArray:
    """Interpolate between places.

    Parameters
    ----------
    start, end : ndarray, shape (n, 2) or (2,)
        Places in one unit.
    share : ndarray, shape (n,)
        0 at the start, 1 at the end.

    Returns
    -------
    ndarray, shape (n, 2)
        Places in that unit.
    """
    return np.asarray(start + share[:, None] * (end - start))


def _exchanged(place: Map) -> Map:
    """The mirror image under x <-> y."""
    return lambda u, v: place(v, u)[:, ::-1]


def _of_boxes(panel: Panel, stack: Stack, pillar: Pillar | None, settings: HexSettings) -> PatchedMesh:
    boxes = panel_boxes(panel, stack, pillar, settings)
    mesh = hex_mesh(boxes, settings.order)
    return PatchedMesh(mesh, (boxes,), (np.arange(len(mesh.nodes)),))


def _ends(panel: Panel) -> tuple[dict[int, float], dict[int, float]]:
    """Distances of the panel's sides from the foot along x and y, m, by direction, without those beyond a mirror."""
    assert panel.foot is not None
    ends = []
    for axis in (0, 1):
        both = {1: panel.high[axis] - panel.foot[axis], -1: panel.foot[axis] - panel.low[axis]}
        ends.append({1: both[1]} if axis in panel.halved else both)
    return ends[0], ends[1]


def _block(half: float, rim: tuple[float, float], ends: tuple[float, float]) -> tuple[float, float]:
    """Half-widths of the block about a foot: as far as the panel goes where little lies beyond."""
    nominal = [wide * half + ROOM * half for wide in rim]
    x, y = (end if end <= want + SLIVER * half else want for want, end in zip(nominal, ends, strict=True))
    return x, y


def _lines(half: float, rim: tuple[float, float], blocks: list[tuple[float, float]], grading: Grading) -> PlanLines:
    """The lines that all quadrants share, graded towards the rim from both sides."""
    turns = max(grading.least, int(np.ceil(np.pi / 4.0 * half / grading.size_m)))  # around an eighth of a disc
    core = (1.0 - CORE) * half if rim[0] == rim[1] else half
    fill = max(edge - wide * half for block in blocks for edge, wide in zip(block, rim, strict=True))
    inner, outer = unit_lines(core, (False, True), grading), unit_lines(fill, (True, False), grading)
    return PlanLines(np.linspace(0.0, 1.0, turns + 1), inner, outer)


def unit_lines(length: float, ends: tuple[bool, bool], grading: Grading) -> FloatArray:
    """Lay lines from 0 to 1 over a length.

    Parameters
    ----------
    length : float
        The length, in the unit of the grading.
    ends : tuple of bool
        Whether either end is singular: lines are graded towards it.
    grading : Grading
        Element size and grading.

    Returns
    -------
    ndarray, shape (n,)
        Ascending shares of the length.
    """
    return grid_lines({0.0: ends[0], 1.0: ends[1]}, replace(grading, size_m=grading.size_m / length))


def _beyond(block: float, end: float, grading: Grading) -> FloatArray:
    return grid_lines({block: False, end: False}, grading) if end > block else np.array([block])
