"""A user's own mesh through the same chain: read, put into our order, clamp a named group, solve."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from geometry.elements import FloatArray
from geometry.formats.neutral import VOLUME
from geometry.formats.reader import load
from geometry.materials import Material
from geometry.mesh import Mesh
from pipeline.analysis.mode_rows import ModeRow, mode_rows
from pipeline.analysis.modes import DEFAULT_COUNT, PartModes, Request, with_defaults
from pipeline.analysis.wanted_search import look_among
from pipeline.case.diagnostics import nearest
from pipeline.case.model import Case
from pipeline.errors import InputError
from pipeline.logs import Log
from pipeline.models.parts import mesh_record, warn_of_locking
from solvers.fem.eigen import Modes, modes_in_band, modes_near
from solvers.fem.solid import SolidModel
from solvers.measures.confinement import Confinement, measure

LARGE_M = 5.0


def solve(case: Case, file: str, unit: str, clamps: Sequence[str], query: Request, log: Log) -> PartModes:
    """Compute the modes of the mesh in a file with the case's material. Raises InputError for a mesh that cannot
    serve.
    """
    if query.symmetry:
        raise InputError(
            f"--symmetry {query.symmetry}: a mesh from a file has no symmetry classes; leave --symmetry out"
        )
    with log.step("read the mesh"):
        mesh = load(file, unit)
    for name in clamps:
        _known(name, mesh, file)
    pillar = case.design.pillar
    materials = dict.fromkeys(mesh.regions, case.design.material)
    if pillar:
        materials |= {name: pillar.material for name in mesh.regions if name.casefold() == "pillar"}
    _log_summary(mesh, materials, file, log)
    warn_of_locking(case.design, mesh, log)
    model = SolidModel(_with_touch(mesh), materials, tuple(clamps), False)
    request = _request(case, query)
    pencil = model.pencil(None)
    with log.step("solve"):
        if request.band_hz:
            solution = modes_in_band(pencil, *request.band_hz)
        else:
            solution = modes_near(pencil, request.near_hz or 0.0, request.count or DEFAULT_COUNT)
    rows = _rows(case, model, solution)
    meshes = [mesh_record("own mesh", mesh)]
    wanted = look_among(rows, solution.count) if _has_touch(case, model) else None
    vectors: dict[str | None, FloatArray] = {None: solution.vectors}
    return PartModes(
        "mesh",
        model,
        rows,
        vectors,
        pencil.dof,
        solution.rigid_count,
        solution.count,
        meshes,
        wanted=wanted,
        more_in_mesh=0,
    )


def _has_touch(case: Case, model: SolidModel) -> bool:
    """Whether the mesh has a touch face with a zone on it."""
    return "touch" in model.mesh.faces and "zone" in case.given


def _with_touch(mesh: Mesh) -> Mesh:
    """The mesh whose group TOUCH, however written, is the face that is measured."""
    named = [name for name, nodes in mesh.faces.items() if name.casefold() == "touch" and nodes.shape[1] > 1]
    return replace(mesh, faces=mesh.faces | {"touch": mesh.faces[named[0]]}) if named else mesh


def _request(case: Case, query: Request) -> Request:
    """Complete the command line's request by the case's; otherwise ask for the lowest modes."""
    solve = case.solve
    if not any((query.band_hz, query.near_hz, query.count, solve.band_hz, solve.near_hz, solve.count)):
        return replace(query, near_hz=0.0, count=DEFAULT_COUNT)
    return with_defaults(case, query)


def _log_summary(mesh: Mesh, materials: dict[str, Material], file: str, log: Log) -> None:
    size = 1e3 * np.ptp(mesh.nodes, axis=0)
    log.info(
        f"{file}: {len(mesh.cells)} {VOLUME[mesh.kind, mesh.order]}, {mesh.dof} degrees of freedom, "
        f"{size[0]:.4g} x {size[1]:.4g} x {size[2]:.4g} mm; faces {', '.join(sorted(mesh.faces)) or 'none'}; "
        + ", ".join(f"{name}: {material.name}" for name, material in materials.items())
    )
    if size.max() > 1e3 * LARGE_M:
        log.warning("UNIT", f"{file}: {size.max() / 1e3:.3g} m long; if the file is in millimetres, add --unit mm")


def _known(name: str, mesh: Mesh, file: str) -> None:
    if name not in mesh.faces:
        there = ", ".join(sorted(mesh.faces)) or "none"
        raise InputError(
            f"{file}: --clamp {name}: no such group of faces or nodes{nearest(name, list(mesh.faces))}; it has {there}"
        )


def _rows(case: Case, model: SolidModel, solution: Modes) -> tuple[ModeRow, ...]:
    """Frequencies, and the measures of the touch face where the mesh names one and the case has a zone."""
    measures: Confinement | None = None
    if _has_touch(case, model) and len(solution.frequency_hz):
        measures = measure(model.touch(None, solution.vectors), case.design, None)
    return tuple(mode_rows(solution, None, measures))
