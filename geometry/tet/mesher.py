"""Quadratic tetrahedra of a CAD body: surface -> pytetwild -> snapped onto the CAD faces -> checked, or refused.

pytetwild is not deterministic: a mesh is known by its sha256, not by what it was made from.
"""

from __future__ import annotations

import logging
from dataclasses import replace
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
from geometry.tet.tetwild import NearSegments, background, tet_quality, tetrahedralize

MM = 1e3
SAGITTA_PER_EDGE = 1 / 16  # of a chord as long as an edge on a curve of twice its radius
EPSILON_PER_EDGE, ATTEMPTS = 1 / 60, 3  # how far the mesher's surface may leave the CAD's before snapping
EPSILON_PER_DIAGONAL = 1e-3  # the mesher's own default, a ceiling when the edge is long beside the body
FLAT_QUALITY = 1e-3  # mean-ratio quality of a tetrahedron that is as good as flat (regular: 1)
PART_TOLERANCE = 1e-3  # relative volume error allowed to each bonded part
REGIONS = ("plate", "pillar", "tip")
VOLUME_TOLERANCE = 1e-3  # relative, of the whole body
ON_PLANE = 1e-9  # of the diagonal: planes must be met to rounding

log = logging.getLogger(__name__)


def tet_mesh(
    body: Body,
    edge_m: float,
    size: NearSegments | None = None,
    epsilon: float = EPSILON_PER_EDGE,
    attempts: int = ATTEMPTS,
) -> Mesh:
    """Quadratic tetrahedra of a CAD body with edges of about edge_m, or as `size` wants them, at most edge_m.

    epsilon: how far the mesher's surface may leave the CAD's before snapping, over edge_m, halved at each attempt.
    Regions "plate", "pillar", "tip"; faces "touch", "back", "foot", "top", "x-" ... "y+" where the body has them. Raises
    MeshError naming the worst element when every attempt fails its checks (Jacobians, orphan nodes, flat elements, volume of
    the body and of each bonded part against CAD).
    """
    if not edge_m > 0.0:
        raise MeshError(f"edge length {edge_m:g} m must be > 0")
    for attempt in range(1, attempts + 1):
        try:
            return _attempt(body, edge_m, size, epsilon)
        except MeshError as fault:
            if attempt == attempts:
                raise MeshError(f"{fault} (after {attempt} attempt(s), the last with epsilon {epsilon:.1e})") from fault
            log.warning("mesh refused (%s): trying again with epsilon %.1e", fault, epsilon / 2.0)
            epsilon /= 2.0
    raise MeshError(f"attempts must be at least 1, got {attempts}")


def _attempt(body: Body, edge_m: float, size: NearSegments | None, epsilon: float) -> Mesh:
    diagonal = float(body.shape.BoundingBox().DiagonalLength)
    envelope = min(epsilon * MM * edge_m, EPSILON_PER_DIAGONAL * diagonal)
    surface = cad_surface(body.shape, SAGITTA_PER_EDGE * MM * edge_m)
    vertices, cells = tetrahedralize(_request(body, surface, edge_m, size, envelope))
    if body.bonded:  # then the mesher keeps the whole box, since faces between parts would confuse its filter
        cells = cells[surface.encloses(vertices[cells].mean(axis=1))]
    region = body.region_of(vertices[cells].mean(axis=1) / MM)
    part = np.select([(region == name) & (name in body.bonds) for name in REGIONS], range(len(REGIONS)), 0)
    boundary = find_boundary(vertices, cells, part, surface)
    snapped = snap_vertices(vertices, boundary, surface)
    check_moves(vertices, snapped, 0.5 * MM * edge_m)
    snapped = without_flat_cells(vertices, snapped, cells, boundary, surface)
    _check_corners(snapped, cells, boundary, surface)
    nodes, full = quadratic(snapped, cells, boundary, surface)
    used, compact = np.unique(full, return_inverse=True)  # orphans dropped
    mesh = Mesh(nodes[used] / MM, compact.reshape(full.shape).astype(np.int64), "tet", 2)
    regions = {name: np.flatnonzero(region == name) for name in REGIONS if (region == name).any()}
    mesh = replace(mesh, regions=regions, faces=named_faces(mesh, body, boundary, surface))
    check_mesh(mesh, body.volume_m3, VOLUME_TOLERANCE)
    check_parts(mesh, body)
    return mesh


def _request(
    body: Body, surface: CadSurface, edge_m: float, size: NearSegments | None, envelope: float
) -> dict[str, Any]:
    request = {
        "vertices": surface.points,
        "triangles": surface.triangles,
        "edge": MM * edge_m,
        "epsilon": envelope / surface.diagonal,
        "keep_outside": body.bonded,
    }
    if size is not None:
        low, high = surface.points.min(axis=0), surface.points.max(axis=0)
        points, cells, values = background(lambda at: MM * size(at / MM), low, high, MM * size.fine_m)
        request |= {"bg_vertices": points, "bg_tets": cells, "bg_values": values}
    return request


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
