"""The scenes of a design by tetrahedra: zone, pillar, panel, unit cell, and a plate assembled from mirrored columns."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from geometry.cad import solids
from geometry.cad.step_cell import CellBody
from geometry.elements import TET_EDGES, FloatArray, IntArray
from geometry.errors import MeshError
from geometry.layout import Design, Pillar
from geometry.mesh import Mesh, check_mesh
from geometry.tet.mesher import VOLUME_TOLERANCE, tet_mesh
from geometry.tet.tetwild import NearSegments
from geometry.tiling import Panel

# -- mirror images -----------------------------------------------------------------------------------------------------
# A mesh and its mirror image merged into one.

TET_SWAP = {1: [1, 0, 2, 3], 2: [1, 0, 2, 3, 4, 6, 5, 8, 7, 9]}  # nodes 0 and 1 exchanged keep the volume positive
TRIANGLE_SWAP = {1: [1, 0, 2], 2: [1, 0, 2, 3, 5, 4]}


def _mirror_mesh(mesh: Mesh, axis: int) -> Mesh:
    """A tetrahedral mesh at x_axis >= 0 joined with its image; both share the nodes of the plane x_axis = 0, bit for bit.

    Face "x-" (axis 0) or "y-" (axis 1) must be that plane, or MeshError; it becomes the image of the opposite side.
    """
    low, high = f"{'xyz'[axis]}-", f"{'xyz'[axis]}+"
    on_plane = mesh.nodes[:, axis] == 0.0
    if mesh.kind != "tet" or mesh.nodes[:, axis].min() < 0.0 or not on_plane[mesh.nodes_of(low)].all():
        raise MeshError(f"only a tetrahedral mesh whose face '{low}' lies exactly on 0 can be mirrored")
    image = np.arange(len(mesh.nodes))
    image[~on_plane] = len(mesh.nodes) + np.arange(np.count_nonzero(~on_plane))
    flip = np.ones(3)
    flip[axis] = -1.0
    nodes = np.vstack([mesh.nodes, mesh.nodes[~on_plane] * flip])
    cells = np.vstack([mesh.cells, image[mesh.cells][:, TET_SWAP[mesh.order]]])
    regions = {name: np.concatenate([part, part + len(mesh.cells)]) for name, part in mesh.regions.items()}
    faces = {name: np.vstack([own, _image(own, image, mesh.order)]) for name, own in mesh.faces.items()}
    if high in mesh.faces:
        faces[high], faces[low] = mesh.faces[high], _image(mesh.faces[high], image, mesh.order)
    else:
        del faces[low]
    return Mesh(nodes, cells, mesh.kind, mesh.order, regions, faces)


def _image(faces: IntArray, image: IntArray, order: int) -> IntArray:
    return np.asarray(image[faces][:, TRIANGLE_SWAP[order]])


# -- columns -----------------------------------------------------------------------------------------------------------
# A quarter of a plate from half a column of its pillars: meshed once, and mirrored again and again along the zone.
# A column ends half-way between two pillars, at a plane about which the plate is its own image but for its end;
# there, beyond the last foot, the elements are stretched as far as the plate reaches.

STRETCH = (0.5, 1.6)  # of the strip beyond the last foot: its elements stay well shaped
SAME = 1e-9  # of half a pitch: one plane
# Relative volume difference between the quarter and its columns; more where elements on a fillet's curved rim reach into what
# is stretched of the last column: one element lost or doubled is 1e-5 of a plate at least.
ROUNDING, FILLETED = 1e-9, 1e-6


@dataclass(frozen=True)
class Columns:
    """Columns of pillars of a plate's quarter x, y >= 0, of which half a column is meshed.

    Attributes
    ----------
    half_m : float
        Half-width of a column, whose pillar's middle lies at x = 0.
    foot_m : float
        Half-width of the foot, beyond which the last column is stretched.
    end_m : float
        Distance of the plate's end from the middle of the last pillar.
    count : int
        Number of half columns that make the quarter.
    begins_at_pillar : bool
        Whether a pillar stands at the plate's middle.
    """

    half_m: float
    foot_m: float
    end_m: float
    count: int
    begins_at_pillar: bool

    @classmethod
    def of(cls, design: Design) -> Columns | None:
        """Those of a plate; None for one without columns that are alike, or whose end no stretched column reaches."""
        if not design.row_pillars or design.is_staggered or not design.is_mirrored or design.larger_m:
            return None
        centres, half = design.column_centres(), design.pitch_x_m / 2.0
        foot = max(pillar.reach_m[0] for pillar in design.kinds) / 2.0
        end = design.length_m / 2.0 - float(centres[-1])
        if not (foot < half and STRETCH[0] * (half - foot) <= end - foot <= STRETCH[1] * (half - foot)):
            return None
        return cls(half, foot, end, len(centres), len(centres) % 2 == 1)

    def alone(self, design: Design) -> Design:
        """One column of the plate as a plate of its own."""
        return replace(design, length_m=2.0 * self.half_m)

    def stretched(self, x: FloatArray) -> FloatArray:
        """Map x of a column to x in the last, stretched one."""
        beyond = self.foot_m + (x - self.foot_m) * (self.end_m - self.foot_m) / (self.half_m - self.foot_m)
        return np.where(x > self.foot_m, beyond, x)


def _tet_quarter(design: Design, edge_m: float, columns: Columns, size: NearSegments) -> Mesh:
    """The quarter x, y >= 0 of a plate of such columns. Raises MeshError for a rejected mesh."""
    body = solids.plate_solid(columns.alone(design), "xy")
    column = tet_mesh(body, edge_m, size)
    quarter = _assembled(column, columns)
    added = 2.0 * (columns.end_m - columns.half_m) * design.half_span_m * design.thickness_m / 2.0
    check_mesh(quarter, columns.count * body.volume_m3 + added, VOLUME_TOLERANCE)
    allowed = FILLETED if any(pillar.fillet_m for pillar in design.kinds) else ROUNDING
    check_mesh(quarter, columns.count * check_mesh(column).volume_m3 + added, allowed)
    return quarter


def _assembled(column: Mesh, columns: Columns) -> Mesh:
    """Copies of a column side by side, every other one its mirror image; neighbours share the nodes of their plane."""
    planes = [column.nodes_of("x-"), column.nodes_of("x+")]
    nodes: list[FloatArray] = []
    cells: list[IntArray] = []
    faces: dict[str, list[IntArray]] = {name: [] for name in column.faces if not name.startswith("x")}
    count, before = 0, np.empty(0, dtype=np.int64)
    for number in range(columns.count):
        turned = (number % 2 == 0) != columns.begins_at_pillar  # its pillar stands at its upper end
        image = np.full(len(column.nodes), -1)
        if number:
            image[planes[int(turned)]] = before
        fresh = image < 0
        image[fresh] = count + np.arange(fresh.sum())
        before = image[planes[int(not turned)]]
        own = _placed(column, columns, number, turned)
        nodes.append(own[fresh])
        count += int(fresh.sum())
        swap = (TET_SWAP[column.order], TRIANGLE_SWAP[column.order]) if turned else (slice(None), slice(None))
        cells.append(image[column.cells][:, swap[0]])
        for name, parts in faces.items():
            parts.append(image[column.faces[name]][:, swap[1]])
        if number == 0:
            low = image[column.faces["x+" if turned else "x-"]][:, swap[1]]
    regions = {
        name: np.concatenate([part + number * len(column.cells) for number in range(columns.count)])
        for name, part in column.regions.items()
    }
    named = {name: np.vstack(parts) for name, parts in faces.items()} | {"x-": low, "x+": image[column.faces["x+"]]}
    return Mesh(np.vstack(nodes), np.vstack(cells), column.kind, column.order, regions, named)


def _placed(column: Mesh, columns: Columns, number: int, turned: bool) -> FloatArray:
    """The nodes of one copy; of the last one the elements beyond the foot stretched."""
    out, x, half = column.nodes.copy(), column.nodes[:, 0], columns.half_m
    x = np.where(np.abs(x - half) < SAME * half, half, x)
    if number == columns.count - 1:
        x = _straight(column, x, columns)
    out[:, 0] = (number + 1) * half - x if turned else number * half + x
    return out


def _straight(column: Mesh, x: FloatArray, columns: Columns) -> FloatArray:
    """Stretched places of the nodes, those between two corners as far from the middle of their edge as before."""
    moved = columns.stretched(x)
    for middle, (start, end) in zip(column.cells.T[4:], TET_EDGES, strict=column.order == 2):
        one, other = column.cells[:, start], column.cells[:, end]
        moved[middle] = (moved[one] + moved[other]) / 2.0 + (x[middle] - (x[one] + x[other]) / 2.0)
    return moved


# -- scenes ------------------------------------------------------------------------------------------------------------
# The scenes of a design through CAD and pytetwild: plate, zone, pillar, unit cell.

FINE = 1.0 / 6.0  # edge length at a singular edge over that away from it
GROWTH = 0.7  # of the edge length per distance from there
FOOT = 0.6  # of a plate's edge length at its feet: away from them elements as long as the plate is thick follow its bending
AWAY = 0.4  # growth of a plate's edge length per distance from its feet
SAME_VOLUME = 1e-12  # relative volume difference between a mesh and four times its quarter
NO_LINES = np.empty((0, 2, 3))


def tet_zone(design: Design, edge_m: float, mirrors: str = "") -> Mesh:
    """Mesh the bare strip by tetrahedra, finer near the edges of its long side faces, which a clamp makes singular.

    Parameters
    ----------
    design : Design
        The plate as built.
    edge_m : float
        Largest edge length in m.
    mirrors : {'', 'x', 'y', 'xy'}, optional
        Axes along which only the positive side is kept.

    Returns
    -------
    Mesh
        Tetrahedra in m.

    Raises
    ------
    MeshError
        For a rejected mesh.
    """
    half_x, half_y = design.length_m / 2.0, design.width_m / 2.0
    lines = [[(-half_x, y, z), (half_x, y, z)] for y in (-half_y, half_y) for z in (0.0, design.thickness_m)]
    return tet_mesh(solids.zone_solid(design, mirrors), edge_m, _graded(np.array(lines), edge_m))


def tet_pillar(pillar: Pillar, edge_m: float) -> Mesh:
    """Mesh the isolated pillar by tetrahedra, finer near the rim of its foot, which a clamp makes singular.

    Parameters
    ----------
    pillar : Pillar
        Shape and sizes in m.
    edge_m : float
        Largest edge length in m.

    Returns
    -------
    Mesh
        Tetrahedra in m.

    Raises
    ------
    GeometryError
        If the pillar cannot be built.
    MeshError
        For a rejected mesh.
    """
    return tet_mesh(solids.pillar_solid(pillar), edge_m, _graded(_rims(pillar, 0.0), edge_m))


def tet_plate(design: Design, edge_m: float, quarter: bool = False) -> Mesh:
    """Mesh the plate with its pillars by tetrahedra.

    A whole plate is its quarter mirrored twice if its pillars are their own mirror images. If its columns are alike,
    the quarter is half a column mirrored along the zone, finer near the feet and as long as the plate is thick away
    from them. A plate of a file is meshed whole, finer near the feet. Other plates are evenly fine.

    Parameters
    ----------
    design : Design
        The plate as built.
    edge_m : float
        Largest edge length in m; FOOT times it at the feet of alike columns and of a plate of a file. Between alike
        columns' feet edges are at least as long as the plate is thick.
    quarter : bool, optional
        Whether to keep x, y >= 0 only.

    Returns
    -------
    Mesh
        Tetrahedra in m.

    Raises
    ------
    GeometryError
        If a mirror plane of the quarter cuts a pillar that is not symmetric in it.
    MeshError
        For a rejected mesh.
    """
    if design.outline:
        return tet_mesh(solids.plate_solid(design), edge_m, _finer_at_feet(design, edge_m, edge_m))
    if not (quarter or design.is_mirrored):
        return tet_mesh(solids.plate_solid(design), edge_m)
    if columns := Columns.of(design):
        longest = max(edge_m, design.thickness_m)
        part = _tet_quarter(design, longest, columns, _finer_at_feet(columns.alone(design), edge_m, longest))
    else:
        part = tet_mesh(solids.plate_solid(design, "xy"), edge_m)
    return part if quarter else _whole(part)


def tet_part(design: Design, part: str, edge_m: float, quarter: bool = False) -> Mesh:
    """Mesh one part of a design by tetrahedra.

    Parameters
    ----------
    design : Design
        The plate as built.
    part : {'zone', 'pillar', 'plate'}
        The zone, the isolated pillar or the plate.
    edge_m : float
        Largest edge length in m, as of `tet_zone`, `tet_pillar` and `tet_plate`.
    quarter : bool, optional
        Whether to keep x, y >= 0 of zone or plate only; a pillar is always whole.

    Returns
    -------
    Mesh
        Tetrahedra in m.

    Raises
    ------
    MeshError
        For a rejected mesh.
    """
    if part == "pillar":
        assert design.pillar
        return tet_pillar(design.pillar, edge_m)
    return tet_zone(design, edge_m, "xy" * quarter) if part == "zone" else tet_plate(design, edge_m, quarter)


def tet_cell(design: Design, edge_m: float, mirrors: str = "") -> Mesh:
    """Mesh the unit cell by tetrahedra, finer near its pillar's foot.

    If the cell is mirrored from its quarter, opposite faces pair node for node, equal to the last bit except for the
    sign of x or y.

    Parameters
    ----------
    design : Design
        The plate as built.
    edge_m : float
        Largest edge length in m.
    mirrors : {'', 'x', 'y', 'xy'}, optional
        Axes along which only the positive side is kept.

    Returns
    -------
    Mesh
        Tetrahedra in m.

    Raises
    ------
    GeometryError
        If the pillar is not symmetric in a mirror.
    MeshError
        For a rejected mesh.
    """
    rims = _foot_rims(design.pillar, design.thickness_m) if design.pillar else NO_LINES
    return tet_mesh(solids.cell_solid(design, mirrors), edge_m, _graded(rims, edge_m))


def tet_step_cell(body: CellBody, edge_m: float) -> Mesh:
    """Mesh a unit cell from a STEP file by tetrahedra, finer near its re-entrant edges and where materials meet.

    Parameters
    ----------
    body : CellBody
        Solids of the cell.
    edge_m : float
        Largest edge length in m.

    Returns
    -------
    Mesh
        Tetrahedra in m, regions named as in the file.

    Raises
    ------
    MeshError
        For a rejected mesh.
    """
    return tet_mesh(body, edge_m, _graded(body.singular_lines(), edge_m))


def tet_panel(design: Design, panel: Panel, edge_m: float) -> Mesh:
    """Mesh a rectangular panel by tetrahedra, its middle at the origin, finer near its pillar's foot.

    Parameters
    ----------
    design : Design
        The plate as built.
    panel : Panel
        Corners and foot in m.
    edge_m : float
        Largest edge length in m.

    Returns
    -------
    Mesh
        Tetrahedra in m.

    Raises
    ------
    MeshError
        For a rejected mesh.
    """
    pillar, rims = panel.pillar or design.pillar, NO_LINES
    if pillar and panel.foot:
        rims = _foot_rims(pillar, design.thickness_m, *(np.array(panel.foot) - np.array(panel.middle)))
    return tet_mesh(solids.panel_solid(design, panel), edge_m, _graded(rims, edge_m))


def _whole(quarter: Mesh) -> Mesh:
    """The quarter x, y >= 0 mirrored in both planes, checked as one mesh."""
    whole = _mirror_mesh(_mirror_mesh(quarter, 0), 1)
    check_mesh(whole, 4.0 * check_mesh(quarter).volume_m3, SAME_VOLUME)
    return whole


def _graded(lines: FloatArray, edge_m: float) -> NearSegments | None:
    """An edge length that grows away from segments (k, 2, 3); none without any."""
    return NearSegments(lines, FINE * edge_m, edge_m, GROWTH) if len(lines) else None


def _finer_at_feet(design: Design, edge_m: float, longest_m: float) -> NearSegments:
    """Edges of FOOT edge_m at the rims of a design's feet (y >= 0, but on an outline), growing to longest_m away from them."""
    rims = [
        _foot_rims(stand.pillar, design.thickness_m, x, y)
        for stand in design.standing()
        for x, y in (stand.centres if design.outline else stand.centres[stand.centres[:, 1] >= 0.0])
    ]
    lines = np.concatenate([NO_LINES, *rims])
    return NearSegments(lines, *((FOOT * edge_m, longest_m) if len(lines) else (edge_m, edge_m)), AWAY)


def _foot_rims(pillar: Pillar, thickness_m: float, x: float = 0.0, y: float = 0.0) -> FloatArray:
    """The rims of a pillar at (x, y) on every face of the plate that it stands on, as segments (k, 2, 3), m."""
    lines = _rims(pillar, thickness_m) + np.array([x, y, 0.0])
    images = lines * [1.0, 1.0, -1.0] + [0.0, 0.0, thickness_m]
    return np.concatenate([lines, images]) if pillar.faces == 2 else lines


def _rims(pillar: Pillar, z: float) -> FloatArray:
    """The re-entrant edges round a foot at the origin, but for a fillet, and where sections meet, as segments (k, 2, 3), m."""
    rims = [] if pillar.fillet_m else [(pillar.form.rim(), z)]
    for level, below, above in zip(pillar.levels_m[1:], pillar.parts, pillar.upper, strict=False):
        top = below.form.rim() * below.form.taper
        narrower = top if below.tip_m <= above.base_m else above.form.rim()
        rims.append((narrower, z + level))
    loops = [NO_LINES]
    for rim, height in rims:
        corners = np.column_stack([rim, np.full(len(rim), height)])
        loops.append(np.stack([corners, np.roll(corners, -1, axis=0)], axis=1))
    return np.concatenate(loops)
