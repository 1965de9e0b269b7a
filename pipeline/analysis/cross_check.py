"""The same design through CAD and pytetwild, beside the structured meshes: its plate's wanted mode and its unit cell."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

from geometry.elements import FloatArray
from pipeline.analysis import bands, mode_fields, mode_rows, modes
from pipeline.case.model import Case
from pipeline.logs import Log
from pipeline.planning.mesh_rules import NEAR_COUNT, PLATE_ACCURACY
from solvers.errors import TooLarge


def add(case: Case, log: Log, record: dict[str, Any], arrays: dict[str, FloatArray]) -> None:
    """Add tet_modes, tet_bands and the tet_* arrays to a record; a plate that memory cannot hold is left out with a
    warning.
    """
    structured = modes.solve_modes(case, modes.Request("plate", symmetry=case.symmetry_wanted), log)
    row = structured.wanted.row if structured.wanted else None
    if row is None:
        log.warning("NO_MODE", "no mode has the wanted shape: nothing to compare tetrahedra with")
    else:
        try:
            _plate(case, row, log, record, arrays)
        except TooLarge as fault:
            log.warning("TOO_LARGE", f"the whole plate by tetrahedra, a cross-check, is left out: {fault}")
    _cell(case, log, record, arrays)


def _plate(
    case: Case, structured: mode_rows.ModeRow, log: Log, record: dict[str, Any], arrays: dict[str, FloatArray]
) -> None:
    accuracy = max(PLATE_ACCURACY, case.solve.accuracy)
    coarse = replace(case, solve=replace(case.solve, mesh="tet", model="solid", accuracy=accuracy))
    request = modes.Request(
        "plate", near_hz=structured.frequency_hz, count=NEAR_COUNT, symmetry=case.symmetry_wanted, search=False
    )
    part_modes = modes.solve_modes(coarse, request, log)
    record["meshes"] += part_modes.meshes
    row = part_modes.wanted.row if part_modes.wanted else None
    if row is None:
        log.warning(
            "NO_MODE", "the tetrahedral plate has no mode of the wanted shape near the structured one's frequency"
        )
        return
    record["tet_modes"] = {
        "model": part_modes.model.name,
        "dof": part_modes.dof,
        "frequency_hz": row.frequency_hz,
        "mac": row.mac,
        "confinement_db": row.confinement_db,
        "hex_frequency_hz": structured.frequency_hz,
        "hex_confinement_db": structured.confinement_db,
        "relative_difference": row.frequency_hz / structured.frequency_hz - 1.0,
        "count_check": part_modes.json()["count_check"],
    }
    log.info(f"wanted mode by tetrahedra {row.frequency_hz:.1f} Hz, structured {structured.frequency_hz:.1f} Hz")
    skin = part_modes.model.skin(row.symmetry, part_modes.vectors[row.symmetry][:, [row.column]]).unfolded(row.symmetry)
    surface = mode_fields.surface_arrays([skin])
    arrays["tet_points"], arrays["tet_triangles"] = surface["surface_points"], surface["surface_triangles"]
    arrays["tet_u"] = surface["surface_u"][0]


def _cell(case: Case, log: Log, record: dict[str, Any], arrays: dict[str, FloatArray]) -> None:
    corners = replace(case, solve=replace(case.solve, mesh="tet"), bands=replace(case.bands, points=1))
    corner_bands = bands.solve_bands(corners, log)
    record["tet_bands"] = corner_bands.json() | {"method": corner_bands.model}
    record["meshes"] += corner_bands.meshes
