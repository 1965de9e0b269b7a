"""The scenes of a design through CAD and pytetwild: plate, zone, pillar, unit cell."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from geometry.cad import solids
from geometry.hex.boxes import Panel
from geometry.layout import Design, Pillar
from geometry.mesh import Mesh, check_mesh
from geometry.patches import Patches
from geometry.tet.columns import Columns, tet_quarter
from geometry.tet.mesher import DEFAULTS, TetOptions, tet_mesh
from geometry.tet.mirror import mirror_mesh
from geometry.tet.sizing import NearSegments

FINE = 1.0 / 6.0  # edge length at a singular edge over that away from it, when the caller gives no sizing field
GROWTH = 0.7  # of the edge length per distance from there
FOOT = 0.6  # of a plate's edge length at its feet: away from them elements as long as the plate is thick follow its bending
AWAY = 0.4  # growth of a plate's edge length per distance from its feet
ROUNDING = 1e-12  # relative volume difference between a mesh and four times its quarter

Lines = list[list[tuple[float, float, float]]]


def tet_zone(design: Design, edge_m: float, mirrors: str = "", options: TetOptions = DEFAULTS) -> Mesh:
    """The bare strip, finer near the edges of its long side faces, which a clamp makes singular.

    `mirrors` ("x", "y", "xy") keeps x >= 0 and/or y >= 0. options.size replaces the built-in grading.
    """
    half_x, half_y = design.length_m / 2.0, design.width_m / 2.0
    lines = [[(-half_x, y, z), (half_x, y, z)] for y in (-half_y, half_y) for z in (0.0, design.thickness_m)]
    return tet_mesh(solids.zone_solid(design, mirrors), edge_m, options=graded(options, lines, edge_m))


def tet_pillar(pillar: Pillar, edge_m: float, options: TetOptions = DEFAULTS) -> Mesh:
    """The lone pillar (its foot is face "foot"), finer near the rim of its foot, which a clamp makes singular."""
    return tet_mesh(solids.pillar_solid(pillar), edge_m, options=graded(options, rims(pillar, 0.0), edge_m))


def tet_plate(
    design: Design,
    edge_m: float,
    quarter: bool = False,
    patches: Patches | None = None,
    options: TetOptions = DEFAULTS,
) -> Mesh:
    """The plate with pillars and patches, the quarter x, y >= 0 or all.

    A whole plate without patches is its quarter mirrored twice when its pillar is its own mirror image. Where its columns are
    alike, that quarter is half a column mirrored along the zone, finer near feet and as long as the plate is thick away from
    them; else it is evenly fine unless options.size says otherwise.
    Raises GeometryError when a quarter cuts a pillar that is not.
    """
    if quarter or (patches is None and design.is_mirrored):
        columns = Columns.of(design) if patches is None and options.size is None else None
        if columns:
            longest = max(edge_m, design.thickness_m)
            part = tet_quarter(
                design, longest, columns, _finer_at_feet(columns.alone(design), edge_m, longest, options)
            )
        else:
            part = tet_mesh(solids.plate_solid(design, "xy", patches), edge_m, options=options)
        return part if quarter else _whole(part)
    return tet_mesh(solids.plate_solid(design, "", patches), edge_m, options=options)


def tet_cell(design: Design, edge_m: float, quarter_then_mirror: bool = True, options: TetOptions = DEFAULTS) -> Mesh:
    """The unit cell, finer near its pillar's foot.

    Mirrored from its quarter, opposite faces pair node for node: equal to the last bit but for the sign of x or y.
    Raises GeometryError when the pillar is not symmetric in x = 0 and y = 0.
    """
    rim = foot_rims(design.pillar, design.thickness_m) if design.pillar else []
    body = solids.cell_solid(design, "xy" if quarter_then_mirror else "")
    mesh = tet_mesh(body, edge_m, options=graded(options, rim, edge_m))
    return _whole(mesh) if quarter_then_mirror else mesh


def tet_panel(design: Design, panel: Panel, edge_m: float, options: TetOptions = DEFAULTS) -> Mesh:
    """A rectangular panel of the plate, its middle at the origin, finer near its pillar's foot."""
    rim: Lines = []
    pillar = panel.pillar or design.pillar
    if pillar and panel.foot:
        x, y = np.array(panel.foot) - np.array(panel.middle)
        rim = [[(a + x, b + y, c) for a, b, c in line] for line in foot_rims(pillar, design.thickness_m)]
    return tet_mesh(solids.panel_solid(design, panel), edge_m, options=graded(options, rim, edge_m))


def _whole(quarter: Mesh) -> Mesh:
    """The quarter x, y >= 0 mirrored in both planes, checked again as one mesh."""
    whole = mirror_mesh(mirror_mesh(quarter, 0), 1)
    check_mesh(whole, 4.0 * check_mesh(quarter).volume_m3, ROUNDING)
    return whole


def graded(options: TetOptions, lines: Lines, edge_m: float) -> TetOptions:
    """The options with an edge length that grows away from the lines, unless they already have one."""
    if options.size is not None or not lines:
        return options
    fine = FINE * edge_m
    return replace(options, size=NearSegments(np.array(lines), fine, edge_m, GROWTH), min_edge_m=fine)


def _finer_at_feet(design: Design, edge_m: float, longest_m: float, options: TetOptions) -> TetOptions:
    """Edges of FOOT edge_m at the rims of a design's feet at y >= 0, growing to longest_m away from them."""
    rim = [
        [(a + x, b + y, c) for a, b, c in line]
        for stand in design.standing()
        for x, y in stand.centres
        if y >= 0.0
        for line in foot_rims(stand.pillar, design.thickness_m)
    ]
    if not rim:
        return replace(options, size=lambda at: np.full(len(at), edge_m), min_edge_m=edge_m)
    fine = FOOT * edge_m
    return replace(options, size=NearSegments(np.array(rim), fine, longest_m, AWAY), min_edge_m=fine)


def foot_rims(pillar: Pillar, thickness_m: float) -> Lines:
    """The rims of a pillar at the origin of a plate, on every face that it stands on, as segments, m."""
    lines = rims(pillar, thickness_m)
    images = [[(x, y, thickness_m - z) for x, y, z in line] for line in lines]
    return lines + images * (pillar.faces - 1)


def rims(pillar: Pillar, z: float) -> Lines:
    """The re-entrant edges round a foot at the origin, unless a fillet rounds it off, and below a heavy tip, as segments, m."""
    form, loops = pillar.form, []
    if pillar.fillet_m == 0.0:
        loops.append((form.rim(), z))
    if pillar.tip is not None:
        loops.append((form.rim() * form.taper, z + pillar.height_m))
    return [line for rim, height in loops for line in _closed([(float(x), float(y), height) for x, y in rim])]


def _closed(corners: list[tuple[float, float, float]]) -> Lines:
    return [[start, end] for start, end in zip(corners, corners[1:] + corners[:1], strict=True)]
