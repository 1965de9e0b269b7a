"""Quadratic tetrahedra of a CAD body: surface -> pytetwild -> snapped onto the CAD faces -> checked, or rejected.

pytetwild is not deterministic: a mesh is identified by its sha256, not by its inputs.
"""

from __future__ import annotations

import logging
from dataclasses import dataclass, replace
from itertools import combinations
from typing import Any

import numpy as np

from geometry.cad.solids import Body, CadFace, CadSurface, cad_surface
from geometry.elements import TET_EDGES, TET_FACES, BoolArray, FloatArray, IntArray
from geometry.errors import MeshError
from geometry.mesh import Mesh, cell_volumes, check_mesh, jacobians
from geometry.tet.tetwild import NearSegments, tet_volumes, tetrahedralize

log = logging.getLogger(__name__)
POOR = 0.05  # mean ratio below which a cell counts as flattened; the mesher's own worst are about 0.2
RELAXATIONS = 8
NEWTON_STEPS = 20
NEWTON_STOP = 1e-12
PARALLEL = 1e-6  # singular values below this (relative) are one plane given twice
MIN_RATIO = 0.1  # least Jacobian over its greatest in an element before its edges are straightened again
ROUNDS = 10
FEW_OFF = 8  # nodes off a curved face that another mesh is likely to avoid
MM = 1e3
SAME_PLANE_MM = 1e-6

SAGITTA_PER_EDGE = 1 / 16  # of a chord as long as an edge on a curve of twice its radius
EPSILON_PER_EDGE, ATTEMPTS = 1 / 60, 3  # how far the mesher's surface may leave the CAD's before snapping
EPSILON_PER_DIAGONAL = 1e-3  # the mesher's own default, a limit when the edge is long compared with the body
FLAT_QUALITY = 1e-3  # mean-ratio quality of a tetrahedron that is as good as flat (regular: 1)
PART_TOLERANCE = 1e-3  # relative volume error allowed to each bonded part
VOLUME_TOLERANCE = 1e-3  # relative, of the whole body
ON_PLANE = 1e-9  # of the diagonal: planes must be met to rounding

GRID_NODES = 400_000  # a finer background grid costs the mesher more than it brings
BOX_TETS = np.array([[0, 1, 3, 7], [0, 3, 2, 7], [0, 2, 6, 7], [0, 6, 4, 7], [0, 4, 5, 7], [0, 5, 1, 7]])


@dataclass(frozen=True)
class Boundary:
    """Triangles between a body and the void, or between bonded parts.

    Attributes
    ----------
    triangles : ndarray, shape (m, 3)
        Vertices, outward from the cell.
    face_of : ndarray, shape (m,)
        CAD face of each triangle.
    cell, local : ndarray, shape (m,)
        Cell of each triangle, and the number of the cell's side.
    inner : ndarray, shape (m,)
        Whether it lies between bonded parts.
    """

    triangles: IntArray
    face_of: IntArray
    cell: IntArray
    local: IntArray
    inner: BoolArray

    def vertex_faces(self) -> dict[int, tuple[int, ...]]:
        """The CAD faces that meet at each boundary vertex."""
        return _faces_at(self.triangles.ravel(), np.repeat(self.face_of, 3))

    def edge_faces(self) -> tuple[IntArray, list[tuple[int, ...]]]:
        """Boundary edges (k, 2), ends sorted, and the CAD faces that meet at each."""
        ends = np.sort(self.triangles[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1)
        edges, number = np.unique(ends, axis=0, return_inverse=True)
        faces = _faces_at(number.ravel(), np.repeat(self.face_of, 3))
        return edges, [faces[i] for i in range(len(edges))]


def _find_boundary(vertices: FloatArray, cells: IntArray, part: IntArray, surface: CadSurface) -> Boundary:
    """Boundary triangles of cells labelled by part, given to the nearest CAD face; between parts they count to the lower."""
    sides = cells[:, TET_FACES].reshape(-1, 3)
    cell, local = np.divmod(np.arange(len(sides)), 4)
    key = np.sort(sides, axis=1)
    order = np.lexsort((part[cell], *key.T[::-1]))
    same = (key[order][1:] == key[order][:-1]).all(axis=1)
    with_next = np.append(same, False)
    with_last = np.append(False, same)
    other_part = np.append(part[cell[order]][1:] != part[cell[order]][:-1], False)
    chosen = ~with_last & (~with_next | other_part)
    listed = order[chosen]
    triangles = sides[listed]
    nearest = surface.nearest_face(vertices[triangles].mean(axis=1))
    return Boundary(triangles, nearest, cell[listed], local[listed], with_next[chosen])


def _snap_vertices(vertices: FloatArray, boundary: Boundary, surface: CadSurface) -> FloatArray:
    """Vertices with every boundary one moved onto all the CAD faces its triangles belong to."""
    moved = vertices.copy()
    groups: dict[tuple[int, ...], list[int]] = {}
    for vertex, faces in boundary.vertex_faces().items():
        groups.setdefault(faces, []).append(vertex)
    for faces, members in groups.items():
        moved[members] = _onto_faces(vertices[members], faces, surface)
    return moved


def _without_flat_cells(
    vertices: FloatArray, snapped: FloatArray, cells: IntArray, boundary: Boundary, surface: CadSurface
) -> FloatArray:
    """Snapped vertices, those of flattened cells moved only part of the way onto curved faces (flat ones always hold).

    The surface given to the mesher cuts chords off curved faces; where cells are smaller than the chord's height, the
    whole way would turn them inside out.
    """
    curved = {
        vertex: tuple(i for i in faces if surface.faces[i].flat)
        for vertex, faces in boundary.vertex_faces().items()
        if not _all_flat(faces, surface)
    }
    share = np.ones(len(vertices))
    start = snapped.copy()
    for vertex, flat in curved.items():
        start[vertex] = _onto_faces(vertices[[vertex]], flat, surface)[0] if flat else vertices[vertex]
    here = snapped
    for _ in range(RELAXATIONS):
        poor = np.unique(cells[_tet_quality(here, cells) < POOR])
        if not (share[poor] * np.isin(poor, list(curved))).any():
            break
        share[poor] /= 2.0
        here = start + share[:, None] * (snapped - start)
    moved_back = np.flatnonzero((here != snapped).any(axis=1))
    if len(moved_back):
        far = float(np.linalg.norm(here[moved_back] - snapped[moved_back], axis=1).max())
        log.info(
            "%d vertices stay up to %.2g mm off a curved face, where the whole way would flatten a cell",
            len(moved_back),
            far,
        )
    return here


def _onto_faces(points: FloatArray, numbers: tuple[int, ...], surface: CadSurface) -> FloatArray:
    """Points (n, 3) moved onto the intersection of CAD faces; where two form no edge, a point belongs to the nearer one."""
    if all(surface.edge_between(first, second) for first, second in combinations(numbers, 2)):
        return _onto(points, [surface.faces[i] for i in numbers])
    kept = [_with_edges(point, numbers, surface) for point in points]
    return np.array([_onto(point[None], faces)[0] for point, faces in zip(points, kept, strict=True)])


def _off_plane(vertices: FloatArray, boundary: Boundary, surface: CadSurface) -> float:
    """Largest distance (mm) of a corner from its triangle's plane, but for planes that go over into a curved face."""
    worst = 0.0
    bent = {i for pair, edge in surface.meetings.items() if not edge and not _all_flat(pair, surface) for i in pair}
    for number in np.unique(boundary.face_of):
        face = surface.faces[number]
        if face.normal is not None and number not in bent:
            corners = vertices[np.unique(boundary.triangles[boundary.face_of == number])]
            worst = max(worst, float(np.abs(corners @ face.normal - face.offset).max()))
    return worst


def _check_moves(before: FloatArray, after: FloatArray, allowed: float) -> None:
    """Raise MeshError when snapping moved a vertex farther than `allowed` (mm): it was given to a wrong face."""
    moves = np.linalg.norm(after - before, axis=1)
    worst = int(moves.argmax())
    if not moves[worst] <= allowed:
        place = ", ".join(f"{c:.3f}" for c in before[worst])
        raise MeshError(f"vertex at ({place}) mm is {moves[worst]:.3g} mm off the CAD faces, allowed is {allowed:.3g}")


def _quadratic(
    vertices: FloatArray, cells: IntArray, boundary: Boundary, surface: CadSurface
) -> tuple[FloatArray, IntArray, int]:
    """Nodes and ten-node cells (VTK order), edges shared once, and the number of middle nodes off a curved face; in mm.

    Middle nodes on curved faces are projected onto them; in an element whose Jacobian would fall below MIN_RATIO of
    its largest value they go back to the straight middle.
    """
    ends = np.sort(cells[:, TET_EDGES].reshape(-1, 2), axis=1)
    edges, number = np.unique(ends, axis=0, return_inverse=True)
    full = np.hstack([cells, len(vertices) + number.reshape(-1, 6)])
    straight = vertices[edges].mean(axis=1)
    curved = _projected(vertices, edges, boundary, surface)
    bent = (curved != straight).any(axis=1)
    keep = bent.copy()
    for _ in range(ROUNDS):
        nodes = np.vstack([vertices, np.where(keep[:, None], curved, straight)])
        bad = _bent_too_far(nodes, full, keep[full[:, 4:] - len(vertices)].any(axis=1))
        if not len(bad):
            break
        keep[full[bad, 4:] - len(vertices)] = False
        log.info("%d element(s) next to curved faces keep straight edges", len(bad))
    return nodes, full, int((bent & ~keep).sum())


def _named_faces(mesh: Mesh, body: Body, boundary: Boundary, surface: CadSurface) -> dict[str, IntArray]:
    """Face nodes (m, 6) by name: sides of the box, touch, back, foot, top. `back` and `touch` end where pillars stand."""
    nodes = mesh.cells[boundary.cell[:, None], mesh.element.facets[0][boundary.local]]
    faces = {}
    for name, (axis, position) in _planes(body, surface).items():
        flat = [face.axis == axis and abs(face.position - position) < SAME_PLANE_MM for face in surface.faces]
        on = np.array(flat)[boundary.face_of] & ~(boundary.inner & (name in ("back", "touch")))
        if on.any():
            faces[name] = nodes[on]
    return faces


def tet_mesh(
    body: Body,
    edge_m: float,
    size: NearSegments | None = None,
    epsilon: float = EPSILON_PER_EDGE,
    attempts: int = ATTEMPTS,
) -> Mesh:
    """Mesh a CAD body by quadratic tetrahedra.

    Regions are plate, pillar, section2 and so on; faces are touch, back, foot, top, x-, x+, y- and y+, where the body has them.

    Parameters
    ----------
    body : Body
        CAD body.
    edge_m : float
        Largest edge length in m.
    size : NearSegments, optional
        Edge length by place; `edge_m` everywhere by default.
    epsilon : float, optional
        Allowed distance of the mesher's surface from the CAD surface before snapping, relative to `edge_m`; halved after
        a failure.
    attempts : int, optional
        Largest number of attempts. The mesh with the fewest nodes off a curved face is returned.

    Returns
    -------
    Mesh
        Tetrahedra in m, of which edges on curved faces follow them.

    Raises
    ------
    MeshError
        If every attempt fails its checks: Jacobians, orphan nodes, flat elements, and volumes compared with CAD.
    """
    if not edge_m > 0.0:
        raise MeshError(f"edge length {edge_m:g} m must be > 0")
    if attempts < 1:
        raise MeshError(f"attempts must be at least 1, got {attempts}")
    best: tuple[int, Mesh] | None = None
    for attempt in range(1, attempts + 1):
        try:
            off, mesh = _attempt(body, edge_m, size, epsilon)
        except MeshError as fault:
            if attempt == attempts and best is None:
                raise MeshError(f"{fault} (after {attempt} attempt(s), the last with epsilon {epsilon:.1e})") from fault
            log.warning("mesh rejected (%s): trying again with epsilon %.1e", fault, epsilon / 2.0)
            epsilon /= 2.0
            continue
        if best is None or off < best[0]:
            best = off, mesh
        if not 0 < best[0] <= FEW_OFF:  # no estimate of the error knows that a corner is cut off
            break
    assert best
    return best[1]


def _check_parts(mesh: Mesh, body: Body) -> None:
    """MeshError for a bonded part without its CAD volume: the mesher did not keep the face that bonds it."""
    if not body.bonded:
        return
    volumes = {name: float(cell_volumes(mesh)[cells].sum()) for name, cells in mesh.regions.items()}
    for name, exact in body.part_volumes_m3().items():
        plate_volume = sum(volumes[region] for region in volumes if region not in body.bonds)
        volume = volumes.get(name, 0.0) if name in body.bonds else plate_volume
        if abs(volume - exact) > PART_TOLERANCE * exact:
            raise MeshError(
                f"the {name} part of the mesh is {volume / exact - 1.0:+.1e} off its CAD volume, "
                f"allowed is {PART_TOLERANCE:.0e}: the mesher did not keep its face to the other material"
            )


def _onto(points: FloatArray, faces: list[CadFace]) -> FloatArray:
    if all(face.flat for face in faces):
        return _exact(_onto_planes(points, faces), faces)
    return np.array([_newton(point, faces) for point in points])


def _with_edges(point: FloatArray, numbers: tuple[int, ...], surface: CadSurface) -> list[CadFace]:
    """The nearest face, then the others in order of distance that form an edge with every face already kept."""
    kept: list[int] = []
    for number in sorted(numbers, key=lambda i: float(surface.faces[i].distance(point[None])[0])):
        if all(surface.edge_between(number, other) for other in kept):
            kept.append(number)
    return [surface.faces[i] for i in kept]


def _onto_planes(points: FloatArray, planes: list[CadFace]) -> FloatArray:
    normals = np.array([plane.normal for plane in planes])
    offsets = np.array([plane.offset for plane in planes])
    step = np.linalg.pinv(normals, rcond=PARALLEL)
    return np.asarray(points - (points @ normals.T - offsets) @ step.T)


def _newton(point: FloatArray, faces: list[CadFace]) -> FloatArray:
    """One point onto curved faces: each step solves for their tangent planes."""
    here = point
    for _ in range(NEWTON_STEPS):
        feet, normals = zip(*(face.project(here[None]) for face in faces), strict=True)
        rows, gaps = np.vstack(normals), np.array([n[0] @ (f[0] - here) for f, n in zip(feet, normals, strict=True)])
        step = np.linalg.pinv(rows, rcond=PARALLEL) @ gaps
        here = here + step
        if np.linalg.norm(step) < NEWTON_STOP * (1.0 + np.linalg.norm(here)):
            break
    return np.asarray(_exact(here[None], faces)[0])


def _exact(points: FloatArray, faces: list[CadFace]) -> FloatArray:
    """Planes normal to an axis hold to the last bit: mirrored and neighbouring cells share these coordinates."""
    for face in faces:
        if face.axis is not None:
            points[:, face.axis] = face.position
    return points


def _all_flat(numbers: tuple[int, ...], surface: CadSurface) -> bool:
    return all(surface.faces[i].flat for i in numbers)


def _faces_at(items: IntArray, faces: IntArray) -> dict[int, tuple[int, ...]]:
    pairs = np.unique(np.column_stack([items, faces]), axis=0)
    starts = np.flatnonzero(np.append(True, np.diff(pairs[:, 0]) > 0))
    groups = np.split(pairs[:, 1], starts[1:])
    return {int(item): tuple(group.tolist()) for item, group in zip(pairs[starts, 0], groups, strict=True)}


def _projected(vertices: FloatArray, edges: IntArray, boundary: Boundary, surface: CadSurface) -> FloatArray:
    """Edge middles, those of edges on curved faces moved onto them."""
    middles = vertices[edges].mean(axis=1)
    outer, faces_at = boundary.edge_faces()
    both = np.array([len(vertices), 1])
    place = np.searchsorted(edges @ both, outer @ both)  # edges stand in ascending order
    for index, faces in zip(place, faces_at, strict=True):
        if not all(surface.faces[i].flat for i in faces):
            middles[index] = _onto_faces(middles[index : index + 1], faces, surface)[0]
    return middles


def _bent_too_far(nodes: FloatArray, full: IntArray, candidates: FloatArray) -> IntArray:
    chosen = np.flatnonzero(candidates)
    if not len(chosen):
        return chosen
    mesh = Mesh(nodes, full, "tet", 2)
    at = np.vstack([mesh.element.quadrature.points, mesh.element.points])
    determinants = np.linalg.det(jacobians(mesh, chosen, at))
    return chosen[determinants.min(axis=1) < MIN_RATIO * determinants.max(axis=1)]


def _planes(body: Body, surface: CadSurface) -> dict[str, tuple[int, float]]:
    """Axis and position (mm) of the planes that have a name."""
    low, high = surface.points.min(axis=0), surface.points.max(axis=0)
    sides = {
        f"{'xy'[axis]}{sign}": (axis, float(end[axis])) for axis in (0, 1) for sign, end in (("-", low), ("+", high))
    }
    if body.thickness_m == 0.0:
        return sides | {"foot": (2, 0.0), "touch": (2, 0.0), "top": (2, float(high[2]))}
    return sides | {"touch": (2, 0.0), "back": (2, MM * body.thickness_m), "top": (2, float(high[2]))}


def _attempt(body: Body, edge_m: float, size: NearSegments | None, epsilon: float) -> tuple[int, Mesh]:
    """A checked mesh, and the number of its nodes off a curved face."""
    diagonal = float(body.shape.BoundingBox().DiagonalLength)
    envelope = min(epsilon * MM * edge_m, EPSILON_PER_DIAGONAL * diagonal)
    surface = cad_surface(body.shape, SAGITTA_PER_EDGE * MM * edge_m)
    vertices, cells = tetrahedralize(_request(body, surface, edge_m, size, envelope))
    if body.bonded:  # then the mesher keeps the whole box, since faces between parts would confuse its filter
        cells = cells[surface.encloses(vertices[cells].mean(axis=1))]
    region = body.region_of(vertices[cells].mean(axis=1) / MM)
    names = body.regions
    part = np.select([(region == name) & (name in body.bonds) for name in names], range(len(names)), 0)
    boundary = _find_boundary(vertices, cells, part, surface)
    snapped = _snap_vertices(vertices, boundary, surface)
    _check_moves(vertices, snapped, 0.5 * MM * edge_m)
    there = _without_flat_cells(vertices, snapped, cells, boundary, surface)
    _check_corners(there, cells, boundary, surface)
    nodes, full, off = _quadratic(there, cells, boundary, surface)
    used, compact = np.unique(full, return_inverse=True)  # orphans dropped
    mesh = Mesh(nodes[used] / MM, compact.reshape(full.shape).astype(np.int64), "tet", 2)
    regions = {name: np.flatnonzero(region == name) for name in names if (region == name).any()}
    mesh = replace(mesh, regions=regions, faces=_named_faces(mesh, body, boundary, surface))
    check_mesh(mesh, body.volume_m3, VOLUME_TOLERANCE)
    _check_parts(mesh, body)
    return off + int((there != snapped).any(axis=1).sum()), mesh


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
        points, cells, values = _background(size, low, high)
        request |= {"bg_vertices": points, "bg_tets": cells, "bg_values": values}
    return request


def _background(size: NearSegments, low: FloatArray, high: FloatArray) -> tuple[FloatArray, IntArray, FloatArray]:
    """Nodes (n, 3) of a grid of tetrahedra (m, 4) around a box, and edge lengths (n,) there, all in mm.

    The spacing begins with the finest edge and grows until the grid has about GRID_NODES nodes at most. Raises MeshError
    for an edge length that is not positive.
    """
    room = high - low
    finest = MM * size.fine_m
    spacing = max(finest, float((np.maximum(room, finest).prod() / GRID_NODES) ** (1.0 / 3.0)))
    counts = np.maximum(np.ceil(room / spacing).astype(int), 1) + 2
    lines = [
        np.linspace(a - s / (n - 2), b + s / (n - 2), n + 1) for a, b, s, n in zip(low, high, room, counts, strict=True)
    ]
    z, y, x = np.meshgrid(*lines[::-1], indexing="ij")
    points = np.column_stack([x.ravel(), y.ravel(), z.ravel()])
    values = MM * size(points / MM)
    if not (values > 0.0).all():
        raise MeshError("the sizing field must give a positive edge length everywhere")
    nx, ny, nz = counts
    i, j, k = np.indices((nx, ny, nz))
    corner = (i + (nx + 1) * (j + (ny + 1) * k)).ravel()
    step = np.array([a + (nx + 1) * (b + (ny + 1) * c) for c in (0, 1) for b in (0, 1) for a in (0, 1)])
    cells = (corner[:, None] + step)[:, BOX_TETS].reshape(-1, 4)
    return points, cells, values


def _check_corners(vertices: FloatArray, cells: IntArray, boundary: Boundary, surface: CadSurface) -> None:
    """Raise MeshError for a flat or inverted straight tetrahedron, or a corner off its plane."""
    quality = _tet_quality(vertices, cells)
    worst = int(quality.argmin())
    if not quality[worst] > FLAT_QUALITY:
        place = ", ".join(f"{c:.3f}" for c in vertices[cells[worst]].mean(axis=0))
        raise MeshError(
            f"element {worst} at ({place}) mm is flat or inverted: "
            f"quality {quality[worst]:.1e}, must be > {FLAT_QUALITY:.0e}"
        )
    gap = _off_plane(vertices, boundary, surface)
    if gap > ON_PLANE * surface.diagonal:
        raise MeshError(f"a boundary triangle cuts a CAD edge: a corner is {gap:.2e} mm off its plane")


def _tet_quality(vertices: FloatArray, cells: IntArray) -> FloatArray:
    """Mean ratio 12 (3 V)^(2/3) / sum of squared edges of straight tetrahedra (m,): 1 if regular, negative if inverted.

    Source: liu1994.
    """
    volumes = tet_volumes(vertices, cells)
    corners = vertices[cells[:, :4]]
    edges = corners[:, [0, 1, 0, 0, 1, 2]] - corners[:, [1, 2, 2, 3, 3, 3]]
    squares = np.maximum((edges**2).sum(axis=(1, 2)), np.finfo(float).tiny)
    return np.asarray(np.sign(volumes) * 12.0 * np.cbrt(3.0 * np.abs(volumes)) ** 2 / squares)
