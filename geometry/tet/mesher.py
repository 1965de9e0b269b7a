"""Quadratic tetrahedra of a CAD body: surface -> pytetwild -> snapped onto the CAD faces -> checked, or refused.

pytetwild is not deterministic: a mesh is known by its sha256, not by what it was made from.
"""

from __future__ import annotations

import logging
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from geometry.cad.solids import Body
from geometry.cad.surface import CadSurface, cad_surface
from geometry.elements import FloatArray, IntArray
from geometry.errors import MeshError
from geometry.mesh import Mesh, cell_volumes, check_mesh
from geometry.tet.boundary import (
    Boundary,
    check_moves,
    find_boundary,
    named_faces,
    off_plane,
    quadratic,
    snap_vertices,
    without_flat_cells,
)
from geometry.tet.tetwild import Size, background, tet_quality, tetrahedralize

MM = 1e3
SAGITTA_PER_EDGE = 1 / 16  # of a chord as long as an edge on a curve of twice its radius
EPSILON_PER_DIAGONAL = 1e-3  # the mesher's own default, a ceiling when the edge is long beside the body
FLAT_QUALITY = 1e-3  # mean-ratio quality of a tetrahedron that is as good as flat (regular: 1)
PART_TOLERANCE = 1e-3  # relative volume error allowed to each bonded part
REGIONS = ("plate", "pillar", "tip", "patch")
ON_PLANE = 1e-9  # of the diagonal: planes must be met to rounding

log = logging.getLogger(__name__)


@dataclass(frozen=True)
class TetOptions:
    """What the mesher is asked beside the edge length.

    size: edge length (m) at points (n, 3) in m, finer than edge_m where wanted; epsilon: how far the mesher's
    surface may leave the CAD's before snapping, over edge_m, halved at each of the `attempts`; min_edge_m: spacing of the
    background grid that carries `size`; faces: further named planes as (axis 0..2, position in m).
    """

    size: Size | None = None
    min_edge_m: float | None = None
    epsilon: float = 1 / 60
    attempts: int = 3
    threads: int = 0
    time_limit_s: float | None = None
    volume_tolerance: float = 1e-3
    faces: Mapping[str, tuple[int, float]] = field(default_factory=dict)


DEFAULTS = TetOptions()


def tet_mesh(body: Body, edge_m: float, order: int = 2, options: TetOptions = DEFAULTS) -> Mesh:
    """Tetrahedra (order 1 or 2) of a CAD body with edges of about edge_m.

    Regions "plate", "pillar", "tip", "patch"; faces "touch", "back", "foot", "top", "x-" ... "y+", "patch0-", "patch0+" where
    the body has them, and those of the options. Raises MeshError naming the worst element when every attempt fails
    its checks (Jacobians, orphan nodes, flat elements, volume of the body and of each bonded part against CAD).
    """
    if not edge_m > 0.0:
        raise MeshError(f"edge length {edge_m:g} m must be > 0")
    epsilon = options.epsilon
    for attempt in range(1, options.attempts + 1):
        try:
            return _attempt(body, edge_m, order, options, epsilon)
        except MeshError as fault:
            if attempt == options.attempts:
                raise MeshError(f"{fault} (after {attempt} attempt(s), the last with epsilon {epsilon:.1e})") from fault
            log.warning("mesh refused (%s): trying again with epsilon %.1e", fault, epsilon / 2.0)
            epsilon /= 2.0
    raise MeshError(f"attempts must be at least 1, got {options.attempts}")


def _attempt(body: Body, edge_m: float, order: int, options: TetOptions, epsilon: float) -> Mesh:
    diagonal = float(body.shape.BoundingBox().DiagonalLength)
    envelope = min(epsilon * MM * edge_m, EPSILON_PER_DIAGONAL * diagonal)
    surface = cad_surface(body.shape, SAGITTA_PER_EDGE * MM * edge_m)
    vertices, cells = tetrahedralize(_request(body, surface, edge_m, options, envelope), options.time_limit_s)
    cells = _inside(body, surface, vertices, cells)
    region = body.region_of(vertices[cells].mean(axis=1) / MM)
    part = np.select([(region == name) & (name in body.bonds) for name in REGIONS], range(len(REGIONS)), 0)
    boundary = find_boundary(vertices, cells, part, surface)
    snapped = snap_vertices(vertices, boundary, surface)
    check_moves(vertices, snapped, 0.5 * MM * edge_m)
    snapped = without_flat_cells(vertices, snapped, cells, boundary, surface)
    _check_corners(snapped, cells, boundary, surface)
    nodes, full = (snapped, cells) if order == 1 else quadratic(snapped, cells, boundary, surface)
    used, compact = np.unique(full, return_inverse=True)  # orphans dropped
    mesh = Mesh(nodes[used] / MM, compact.reshape(full.shape).astype(np.int64), "tet", order)
    regions = {name: np.flatnonzero(region == name) for name in REGIONS if (region == name).any()}
    mesh = replace(mesh, regions=regions, faces=named_faces(mesh, body, boundary, surface, options.faces))
    check_mesh(mesh, body.volume_m3, options.volume_tolerance)
    check_parts(mesh, body)
    return mesh


def _request(body: Body, surface: CadSurface, edge_m: float, options: TetOptions, envelope: float) -> dict[str, Any]:
    request = {
        "vertices": surface.points,
        "triangles": surface.triangles,
        "edge": MM * edge_m,
        "epsilon": envelope / surface.diagonal,
        "threads": options.threads,
        "keep_outside": body.bonded,
    }
    if options.size is not None:
        size = options.size
        points, cells, values = background(
            lambda at: np.minimum(size(at / MM), edge_m) * MM,
            surface.points.min(axis=0),
            surface.points.max(axis=0),
            MM * (options.min_edge_m or edge_m / 2.0),
        )
        request |= {"bg_vertices": points, "bg_tets": cells, "bg_values": values}
    return request


def _inside(body: Body, surface: CadSurface, vertices: FloatArray, cells: IntArray) -> IntArray:
    """Of a bonded body the mesher keeps the whole box, since faces between parts would confuse its filter."""
    if not body.bonded:
        return cells
    return cells[surface.encloses(vertices[cells].mean(axis=1))]


def _check_corners(vertices: FloatArray, cells: IntArray, boundary: Boundary, surface: CadSurface) -> None:
    """Raise MeshError for a flat or inverted straight tetrahedron, or a corner off its plane."""
    quality = tet_quality(vertices, cells)
    worst = int(quality.argmin())
    if not quality[worst] > FLAT_QUALITY:
        place = ", ".join(f"{c:.3f}" for c in vertices[cells[worst]].mean(axis=0))
        raise MeshError(
            f"element {worst} at ({place}) mm is flat or inverted: "
            f"quality {quality[worst]:.1e}, must be > {FLAT_QUALITY:.0e}"
        )
    gap = off_plane(vertices, boundary, surface)
    if gap > ON_PLANE * surface.diagonal:
        raise MeshError(f"a boundary triangle cuts a CAD edge: a corner is {gap:.2e} mm off its plane")


def check_parts(mesh: Mesh, body: Body) -> None:
    """Raise MeshError when a bonded part has not its CAD volume: the mesher did not keep the face that bonds it."""
    if not body.bonded:
        return
    volumes = {name: float(cell_volumes(mesh)[cells].sum()) for name, cells in mesh.regions.items()}
    for name, exact in body.part_volumes_m3().items():
        plate_volume = sum(volumes[region] for region in volumes if region not in body.bonds)
        volume = volumes.get(name, 0.0) if name in body.bonds else plate_volume
        if abs(volume - exact) > PART_TOLERANCE * exact:
            raise MeshError(
                f"the {name} part of the mesh is {volume / exact - 1.0:+.1e} off its CAD volume, "
                f"allowed is {PART_TOLERANCE:.0e}: its face to the other material was not kept"
            )
