"""A user's own mesh through the same chain: read, put into our order, clamp a named group, solve."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from geometry.elements import FloatArray
from geometry.formats.neutral import VOLUME
from geometry.formats.reader import MeshFile, read_mesh
from geometry.layout import region_materials
from geometry.materials import Material
from geometry.mesh import AnyMesh
from pipeline.case.diagnostics import nearest
from pipeline.case.model import Case
from pipeline.errors import InputError
from pipeline.logs import Log
from pipeline.models.mode_rows import ModeRow, mode_rows
from pipeline.models.modes import DEFAULT_COUNT, PartModes, Request, with_defaults
from pipeline.models.parts import mesh_record, warn_of_locking
from pipeline.models.touch_bars import touch_frame
from pipeline.models.wanted_search import look_among
from pipeline.units import MM
from solvers.fem.eigen import Modes, modes_in_band, modes_near
from solvers.fem.solid import AXES, SolidModel
from solvers.measures.confinement import Confinement, measure

FAR = 10.0  # beyond the lengths of the case: another body than the case's, or another unit
USUAL_M = (1e-4, 5.0)  # lengths of bodies, where the case has none


@dataclass(frozen=True)
class UserMesh:
    """A mesh file and how its body is held.

    unit: of its lengths, "m" or "mm".
    clamps: groups at rest. supports: groups held along some axes, such as "rim:z".
    merge: nodes closer than this, in the file's unit, become one; 0 leaves them apart, None refuses bodies that should be one.
    """

    file: str
    unit: str = "m"
    clamps: Sequence[str] = ()
    supports: Sequence[str] = ()
    merge: float | None = None


def solve(case: Case, own: UserMesh, query: Request, log: Log) -> PartModes:
    """Compute the modes of a file's mesh with the case's material. Raises InputError for a mesh that cannot serve."""
    file, clamps = own.file, own.clamps
    if query.symmetry:
        without = "a mesh from a file has no symmetry classes; leave --symmetry out"
        raise InputError(f"--symmetry {query.symmetry}: {without}")
    with log.step("read the mesh"):
        read = read_mesh(file, own.unit, max(own.merge or 0.0, 0.0))
    mesh = read.mesh
    fixed = [_support(text) for text in own.supports]
    for name in clamps:
        _known(name, mesh, file, "--clamp")
    for name, _ in fixed:
        _known(name, mesh, file, "--support")
    materials = _materials(case, mesh)
    _check_bodies(read, own)
    _log_summary(mesh, materials, file, log)
    _warn_of_file(read, case, file, log)
    _warn_of_unit(case, mesh, file, own.unit, log)
    warn_of_locking(case.design, mesh, log)
    mesh = _with_touch(mesh)
    frame = touch_frame(mesh, case.design, file, bool(clamps or fixed)) if _has_touch(case, mesh) else None
    model = SolidModel(mesh, materials, (*clamps, *fixed), False, case.design.touch_lines_m, frame)
    request = _request(case, query)
    pencil = model.pencil(None)
    with log.step("solve"):
        if request.band_hz:
            solution = modes_in_band(pencil, *request.band_hz)
        else:
            solution = modes_near(pencil, request.near_hz or 0.0, request.count or DEFAULT_COUNT)
    rows, count = _rows(case, model, solution), solution.count
    wanted = look_among(rows, count) if _has_touch(case, mesh) else None
    vectors: dict[str | None, FloatArray] = {None: solution.vectors}
    about = (pencil.dof, solution.rigid_count, count, [mesh_record("own mesh", mesh)])
    return PartModes("mesh", model, rows, vectors, *about, wanted=wanted, more_in_mesh=0)


def _check_bodies(read: MeshFile, own: UserMesh) -> None:
    """InputError for bodies that touch without sharing nodes: they would move apart."""
    if read.coincident and own.merge is None:
        raise InputError(
            f"{own.file}: {read.parts} bodies share no node, but {read.coincident} nodes lie where another body's do: "
            "join them with --merge 1e-6 (a distance in the file's unit), or keep them apart with --merge 0"
        )


def _warn_of_file(read: MeshFile, case: Case, file: str, log: Log) -> None:
    """A warning for what the file holds and the answer does not."""
    if read.left_out:
        log.warning("LEFT_OUT", f"{file}: not read, and the modes are without it: {', '.join(read.left_out)}")
    if read.unused:
        log.warning("UNUSED_NODES", f"{file}: {read.unused} nodes belong to no element and are left out")
    if read.parts > 1:
        log.warning("SEPARATE_BODIES", f"{file}: {read.parts} bodies share no node: each moves by itself")
    pillar = case.design.pillar
    if (
        pillar
        and pillar.material != case.design.material
        and "pillar" not in {name.casefold() for name in read.mesh.regions}
    ):
        log.warning("NO_PILLAR", f"{file}: no group PILLAR: nothing has the material of pillar.material")


def _materials(case: Case, mesh: AnyMesh) -> dict[str, Material]:
    """The case's material for every region, the pillar's and its tip's for those of that name."""
    own = region_materials(case.design.material, case.design.pillar)
    return {name: own.get(name.casefold(), case.design.material) for name in mesh.regions}


def _has_touch(case: Case, mesh: AnyMesh) -> bool:
    """Whether the mesh has a touch face with a zone on it."""
    return "touch" in mesh.faces and "zone" in case.given


def _with_touch(mesh: AnyMesh) -> AnyMesh:
    """The mesh whose group TOUCH, however written, is the face that is measured."""
    named = [name for name in mesh.faces if name.casefold() == "touch" and mesh.facets_of(name)[0].shape[1] > 1]
    measured: dict[str, Any] = {"faces": {**mesh.faces, "touch": mesh.faces[named[0]]}} if named else {}
    return replace(mesh, **measured)


def _request(case: Case, query: Request) -> Request:
    """Complete the command line's request by the case's; otherwise ask for the lowest modes."""
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
    """Warn of a body whose longest edge is far from the case's lengths: its frequencies would be off by as much."""
    long = float(np.ptp(mesh.nodes, axis=0).max())
    design = case.design
    own = [design.length_m, design.width_m, design.thickness_m, design.pillar.height_m if design.pillar else 0.0]
    known = [each for each in own if each > 0.0]
    low, high = (min(known) / FAR, FAR * max(known)) if known else USUAL_M
    if not low <= long <= high:
        other, factor = ("mm", MM) if unit == "m" else ("m", 1.0 / MM)
        beside = f"the case's lengths run from {min(known) / MM:g} to {max(known) / MM:g} mm" if known else "few are"
        log.warning(
            "UNIT",
            f"{file}: the body is {long / MM:g} mm long as read in {unit}, {beside}: with --unit {other} it would be "
            f"{factor * long / MM:g} mm",
        )


def _support(text: str) -> tuple[str, str]:
    """The group and the axes of NAME:AXES; a name may hold a colon."""
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
    """Frequencies, and the measures of the touch face where the mesh names one and the case has a zone."""
    measures: Confinement | None = None
    if _has_touch(case, model.mesh) and len(solution.frequency_hz):
        measures = measure(model.touch(None, solution.vectors), case.design, None)
    return tuple(mode_rows(solution, None, measures))
