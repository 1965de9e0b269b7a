"""Modes of a user's own mesh: read it, reorder its nodes, clamp named groups, solve."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace
from math import pi
from typing import Any

import numpy as np

from geometry.elements import FloatArray
from geometry.formats.neutral import VOLUME
from geometry.formats.reader import MeshFile, read_mesh
from geometry.layout import Design, region_materials
from geometry.materials import Material
from geometry.mesh import AnyMesh
from pipeline.case.model import Case
from pipeline.case.reading import nearest
from pipeline.errors import InputError
from pipeline.logs import Log
from pipeline.models.modes import DEFAULT_COUNT, PartModes, Request, with_defaults, with_quality
from pipeline.models.parts import mesh_record, warn_of_locking
from pipeline.models.target import ModeRow, look_among, mode_rows
from pipeline.quantity import MM
from solvers.fem.eigen import Modes, modes_in_band, modes_near
from solvers.fem.solid import AXES, SolidModel
from solvers.fem.surface import Frame
from solvers.measures.confinement import Confinement, measure

FAR = 10.0  # times outside the range of the case's lengths: a different body, or another unit
USUAL_M = (1e-4, 5.0)  # range of body lengths if the case has none


@dataclass(frozen=True)
class UserMesh:
    """A mesh file and the supports of its body.

    unit: unit of its lengths, "m" or "mm".
    clamps: clamped groups; supports: groups held along some axes, such as "rim:z".
    merge: distance, in the file's unit, within which nodes are merged; 0 keeps them apart, None rejects touching bodies.
    """

    file: str
    unit: str = "m"
    clamps: Sequence[str] = ()
    supports: Sequence[str] = ()
    merge: float | None = None


def solve(case: Case, own: UserMesh, query: Request, log: Log) -> PartModes:
    """Compute the modes of a file's mesh with the case's material; InputError for an unsuitable mesh."""
    file, clamps = own.file, own.clamps
    if query.symmetry:
        without = "a mesh from a file has no symmetry classes; omit --symmetry"
        raise InputError(f"--symmetry {query.symmetry}: {without}")
    read, materials = read_bodies(case, own, log)
    mesh = read.mesh
    fixed = [_support(text) for text in own.supports]
    for name in clamps:
        _known(name, mesh, file, "--clamp")
    for name, _ in fixed:
        _known(name, mesh, file, "--support")
    mesh = _with_touch(mesh)
    _check_air(case, mesh, own)
    frame = touch_frame(mesh, case.design, file, bool(clamps or fixed)) if _has_touch(case, mesh) else None
    lines, cuts = case.design.touch_lines_m, case.design.touch_cuts_m
    model = SolidModel(mesh, materials, (*clamps, *fixed), False, lines, frame, cuts)
    request = _request(case, query)
    pencil = model.pencil(None)
    with log.step("solve"):
        if request.band_hz:
            solution = modes_in_band(pencil, *request.band_hz)
        else:
            solution = modes_near(pencil, request.near_hz or 0.0, request.count or DEFAULT_COUNT)
    rows, count = _rows(case, model, solution), solution.count
    target = look_among(rows, count) if _has_touch(case, mesh) else None
    vectors: dict[str | None, FloatArray] = {None: solution.vectors}
    about = (pencil.dof, solution.rigid_count, count, [mesh_record("own mesh", mesh)])
    return with_quality(case, PartModes("mesh", model, rows, vectors, *about, target=target, more_in_mesh=0))


def read_bodies(case: Case, own: UserMesh, log: Log) -> tuple[MeshFile, dict[str, Material]]:
    """Read a mesh and the material of each of its regions; InputError for an unsuitable mesh."""
    with log.step("read the mesh"):
        read = read_mesh(own.file, own.unit, max(own.merge or 0.0, 0.0), [name for name, _ in case.group_materials])
    mesh, materials = read.mesh, _materials(case, read, own.file)
    _check_bodies(read, own)
    _log_summary(mesh, materials, own.file, log)
    _warn_of_file(read, case, own.file, log)
    _warn_of_unit(case, mesh, own.file, own.unit, log)
    warn_of_locking(case.design, mesh, log)
    return read, materials


def _check_bodies(read: MeshFile, own: UserMesh) -> None:
    """Raise InputError for bodies that touch without sharing nodes, because they would move apart."""
    if read.coincident and own.merge is None:
        raise InputError(
            f"{own.file}: {read.parts} bodies share no node, but {read.coincident} of their nodes coincide: "
            "join them with --merge 1e-6 (a distance in the file's unit), or keep them apart with --merge 0"
        )


def _warn_of_file(read: MeshFile, case: Case, file: str, log: Log) -> None:
    """Warn of content of the file that the modes do not include."""
    if read.left_out:
        log.warning("LEFT_OUT", f"{file}: ignored, so that the modes do not include it: {', '.join(read.left_out)}")
    if read.unused:
        log.warning("UNUSED_NODES", f"{file}: {read.unused} nodes belong to no element and are ignored")
    if read.parts > 1:
        log.warning("SEPARATE_BODIES", f"{file}: {read.parts} bodies share no node: each moves on its own")
    pillar = case.design.pillar
    if (
        pillar
        and pillar.material != case.design.stack.back
        and "pillar" not in {name.casefold() for name in read.mesh.regions}
        and not case.group_materials
    ):
        log.warning("NO_PILLAR", f"{file}: no group PILLAR: pillar.material is not used")


def _materials(case: Case, read: MeshFile, file: str) -> dict[str, Material]:
    """Material of every region: that of the plate, except for groups of [materials] and those named after the pillar.

    Raises InputError for a name that no group of the file has, and for a group that may be any layer of a plate of several.
    """
    design, bodies = case.design, {name.casefold() for name in read.bodies}
    unknown = [name for name, _ in case.group_materials if name.casefold() not in bodies]
    if unknown:
        there = f"it has {', '.join(sorted(read.bodies)) or 'none'}"
        raise InputError(
            f"{file}: [materials] {name}: no such group of elements{nearest(name, read.bodies)}; {there}"
            for name in unknown
        )
    given = {name.casefold(): material for name, material in case.group_materials}
    known = region_materials(design.stack, design.pillar) | given
    if design.layers and case.group_materials and not {*read.mesh.regions} <= {*known} - {"plate"}:
        what = "which of the plate's layers it is made of is not known: name it in [materials]"
        raise InputError(f"{file}: group {_others(read, known)}: {what}")
    return {name: known.get(name.casefold(), design.stack.back) for name in read.mesh.regions}


def _others(read: MeshFile, known: Collection[str]) -> str:
    """Groups of elements without a material of their own, in words."""
    return ", ".join(sorted(name for name in read.bodies if name.casefold() not in known)) or "of all other elements"


def _has_touch(case: Case, mesh: AnyMesh) -> bool:
    """Whether the mesh has a touch face with a zone on it."""
    return "touch" in mesh.faces and "zone" in case.given


def _with_touch(mesh: AnyMesh) -> AnyMesh:
    """Return the mesh with its group TOUCH, in any case, as the measured face."""
    named = [name for name in mesh.faces if name.casefold() == "touch" and mesh.facets_of(name)[0].shape[1] > 1]
    measured: dict[str, Any] = {"faces": {**mesh.faces, "touch": mesh.faces[named[0]]}} if named else {}
    return replace(mesh, **measured)


def _check_air(case: Case, mesh: AnyMesh, own: UserMesh) -> None:
    """Raise InputError for air around a mesh whose radiating face is not known, or may be a part of it."""
    if case.air and "touch" not in mesh.faces:
        raise InputError(
            f"{own.file}: [air] needs a face group named touch, from which the plate radiates, or remove [air]"
        )
    if case.air and own.supports:
        raise InputError(
            f"--support {own.supports[0]}: [air] takes whole plates, and this may be a mirror plane: remove one"
        )


def _request(case: Case, query: Request) -> Request:
    """Complete the command line's request with the settings of the case, or else request the lowest modes."""
    solve = case.solve
    if not any((query.band_hz, query.near_hz, query.count, solve.band_hz, solve.near_hz, solve.count)):
        return replace(query, near_hz=0.0, count=DEFAULT_COUNT)
    return with_defaults(case, query)


def _log_summary(mesh: AnyMesh, materials: dict[str, Material], file: str, log: Log) -> None:
    size = np.ptp(mesh.nodes, axis=0) / MM
    cells = " and ".join(f"{len(block.cells)} {VOLUME[block.kind, block.order]}" for block in mesh.blocks)
    log.info(
        f"{file}: {cells}, {mesh.dof} degrees of freedom, "
        f"{size[0]:g} x {size[1]:g} x {size[2]:g} mm; faces {', '.join(sorted(mesh.faces)) or 'none'}; "
        + ", ".join(f"{name}: {material.name}" for name, material in materials.items())
    )


def _warn_of_unit(case: Case, mesh: AnyMesh, file: str, unit: str, log: Log) -> None:
    """Warn of a body whose longest edge is far outside the case's lengths: a wrong unit scales its frequencies."""
    long = float(np.ptp(mesh.nodes, axis=0).max())
    design = case.design
    own = [design.length_m, design.width_m, design.thickness_m, design.pillar.height_m if design.pillar else 0.0]
    known = [each for each in own if each > 0.0]
    low, high = (min(known) / FAR, FAR * max(known)) if known else USUAL_M
    if not low <= long <= high:
        other, factor = ("mm", MM) if unit == "m" else ("m", 1.0 / MM)
        usual = f"the case's lengths range from {min(known) / MM:g} to {max(known) / MM:g} mm" if known else "few are"
        log.warning(
            "UNIT",
            f"{file}: the body is {long / MM:g} mm long in {unit}, {usual}: with --unit {other} it would be "
            f"{factor * long / MM:g} mm",
        )


def _support(text: str) -> tuple[str, str]:
    """Split NAME:AXES into group and axes; a name may contain a colon."""
    name, _, axes = text.rpartition(":")
    if not name or not axes or not set(axes) <= set(AXES) or len(set(axes)) < len(axes):
        raise InputError(f"--support {text}: must be NAME:AXES with axes of x, y and z, such as RIM:z or FOOT:xy")
    return name, axes


def _known(name: str, mesh: AnyMesh, file: str, option: str) -> None:
    if name not in mesh.faces:
        there = ", ".join(sorted(mesh.faces)) or "none"
        raise InputError(
            f"{file}: {option} {name}: no such group of faces or nodes{nearest(name, list(mesh.faces))}; it has {there}"
        )


def _rows(case: Case, model: SolidModel, solution: Modes) -> tuple[ModeRow, ...]:
    """Frequencies, with the measures of the touch face if the mesh names one and the case has a zone."""
    measures: Confinement | None = None
    if _has_touch(case, model.mesh) and len(solution.frequency_hz):
        measures = measure(model.touch(None, solution.vectors), case.design, None)
    return tuple(mode_rows(solution, None, measures))


# -- the frame of its touch face ---------------------------------------------------------------------------------------

FLAT = 1e-3  # of the length: largest distance of the face's nodes from a plane
FITS = 0.01  # largest relative difference between the face and the zone's length
IN_PLACE = 1e-6  # of the length, and of a right angle: below it, the file's own axes are used


def touch_frame(mesh: AnyMesh, design: Design, file: str, is_held: bool = False) -> Frame | None:
    """Return the frame of the face `touch`: z into the body, x along the zone's length, the origin at its middle.

    Parameters
    ----------
    mesh : Mesh or MixedMesh
    design : Design
        Its zone: length along x, width along y, in m.
    file : str
        Name of the mesh's file for messages.
    is_held : bool
        Whether groups are clamped: the face may then be a half or a quarter, cut by the mirror planes x = 0 and y = 0.

    Returns
    -------
    Frame or None
        None if the file's own axes are that frame.

    Raises
    ------
    InputError
        For a face that is not flat, or whose smallest rectangle does not contain the zone.
    """
    points, design = mesh.nodes[mesh.nodes_of("touch")], _as_long(design)
    if is_held and _is_cut_by_mirrors(points, design):
        return None
    middle = points.mean(axis=0)
    _, _, axes = np.linalg.svd(points - middle, full_matrices=False)
    off = float(np.abs((points - middle) @ axes[2]).max())
    if off > FLAT * design.length_m:
        raise _unfit(file, f"is not flat: its nodes lie up to {off / MM:g} mm from a plane")
    along_z = axes[2] * np.sign((_inside(mesh) - middle) @ axes[2])
    sides, ends = _rectangle((points - middle) @ axes[:2].T)
    spans = ends[1] - ends[0]
    along = _of_the_length(spans, sides @ axes[:2], design, file)
    origin = middle + (ends.mean(axis=0) @ sides) @ axes[:2]
    along_x = sides[along] @ axes[:2]
    along_x = along_x * (1.0 if along_x[np.argmax(np.abs(along_x))] > 0.0 else -1.0)
    return _unless_in_place(Frame(origin, np.array([along_x, np.cross(along_z, along_x), along_z])), design)


def _as_long(design: Design) -> Design:
    """Return a design whose zone is as large as a plate larger than zone and rows: it is what the touch face has to fit."""
    if not design.larger_m:
        return design
    length, width = design.plate_m
    return replace(design, length_m=length, width_m=width, larger_m=None, centre_m=(0.0, 0.0), surround=False, rows=0)


def _is_cut_by_mirrors(points: FloatArray, design: Design) -> bool:
    """Whether points (n, 3) cover a half or a quarter of the zone in the file's own axes."""
    near, (low, high) = FITS * design.length_m, (points.min(axis=0), points.max(axis=0))
    half, wide = design.length_m / 2.0, (1.0 - FITS) * design.width_m / 2.0
    at_x = any(
        np.abs(np.array([low[0], high[0]]) - ends).max() <= near for ends in ((-half, 0.0), (0.0, half), (-half, half))
    )
    at_y = (abs(low[1]) <= near or low[1] <= -wide) and (abs(high[1]) <= near or high[1] >= wide)
    return bool(high[2] - low[2] <= FLAT * design.length_m and at_x and at_y and high[1] - low[1] >= wide)


def _inside(mesh: AnyMesh) -> FloatArray:
    """Mean of the nodes of all elements behind the face, (3,)."""
    on = np.zeros(len(mesh.nodes), dtype=bool)
    on[mesh.nodes_of("touch")] = True
    behind = [block.cells[on[block.cells].sum(axis=1) >= 3].ravel() for block in mesh.blocks]
    return np.asarray(mesh.nodes[np.concatenate(behind)].mean(axis=0))


def _rectangle(points: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Directions of the sides (2, 2) of the smallest rectangle around points, and its low and high ends along them (2, 2).

    One of its sides lies on the points' convex hull (freeman1975).
    """
    from scipy.spatial import ConvexHull

    outline = points[ConvexHull(points).vertices]
    edges = np.roll(outline, -1, axis=0) - outline
    angles = np.unique(np.arctan2(edges[:, 1], edges[:, 0]) % (pi / 2.0))
    turns = np.array([[np.cos(angles), np.sin(angles)], [-np.sin(angles), np.cos(angles)]]).transpose(2, 0, 1)
    seen = np.einsum("ist,pt->ips", turns, outline)
    ends = np.stack([seen.min(axis=1), seen.max(axis=1)], axis=1)
    best = int(np.argmin((ends[:, 1] - ends[:, 0]).prod(axis=1)))
    return turns[best], ends[best]


def _of_the_length(spans: FloatArray, directions: FloatArray, design: Design, file: str) -> int:
    """Find the side that has the zone's length, of two the one nearer to the file's x; InputError for none."""
    fitting = np.flatnonzero(np.abs(spans / design.length_m - 1.0) <= FITS)
    whole = [side for side in fitting if spans[1 - side] >= (1.0 - FITS) * design.width_m]
    if not whole:
        size = " x ".join(f"{span / MM:g}" for span in sorted(spans, reverse=True))
        raise _unfit(file, f"is {size} mm", design)
    return int(max(whole, key=lambda side: abs(directions[side, 0])))


def _unless_in_place(frame: Frame, design: Design) -> Frame | None:
    """Return None for the file's own axes, also if the plane is z = const other than 0."""
    moved = np.abs(frame.origin_m[:2]).max() > IN_PLACE * design.length_m
    turned = np.abs(frame.axes - np.eye(3)).max() > IN_PLACE
    return frame if moved or turned else None


def _unfit(file: str, what: str, design: Design | None = None) -> InputError:
    zone = "" if design is None else f" of {design.length_m / MM:g} mm (length_mm of zone or plate) within 1 %"
    wide = "" if design is None else f" and at least {design.width_m / MM:g} mm wide (width_mm)"
    allowed = f"must be a plane face{zone}{wide}; rename the group to skip the measures of a touch face"
    return InputError(f"{file}: group TOUCH {what}: {allowed}")
