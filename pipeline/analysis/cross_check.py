"""The same design through CAD and pytetwild, beside the structured meshes: its plate's wanted mode and its unit cell."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import Any

from geometry.elements import FloatArray
from pipeline.analysis import bands, mode_fields, mode_rows, modes
from pipeline.case.model import Case
from pipeline.logs import Log
from pipeline.planning.mesh_rules import NEAR_COUNT, PLATE_ACCURACY
from pipeline.records.record import MeshRecord, TetModesRecord
from solvers.errors import TooLarge

Found = tuple[list[MeshRecord], dict[str, FloatArray], dict[str, Any]]


def solve(case: Case, log: Log) -> Iterator[Found]:
    """Meshes, tet_* arrays and tet_modes of the plate, then tet_bands; a plate too large for the memory is left out."""
    structured = modes.solve_modes(case, modes.Request("plate", symmetry=case.symmetry_wanted), log)
    row = structured.wanted.row if structured.wanted else None
    if row is None:
        log.warning("NO_MODE", "no mode has the wanted shape: nothing to compare tetrahedra with")
    else:
        try:
            yield _plate(case, row, log)
        except TooLarge as fault:
            log.warning("TOO_LARGE", f"the whole plate by tetrahedra, a cross-check, is left out: {fault}")
    corners = replace(case, solve=replace(case.solve, mesh="tet"), bands=replace(case.bands, points=1))
    cell = bands.solve_bands(corners, log)
    yield cell.meshes, {}, {"tet_bands": cell.record}


def _plate(case: Case, structured: mode_rows.ModeRow, log: Log) -> Found:
    accuracy = max(PLATE_ACCURACY, case.solve.accuracy)
    coarse = replace(case, solve=replace(case.solve, mesh="tet", model="solid", accuracy=accuracy))
    request = modes.Request(
        "plate", near_hz=structured.frequency_hz, count=NEAR_COUNT, symmetry=case.symmetry_wanted, search=False
    )
    part_modes = modes.solve_modes(coarse, request, log)
    row = part_modes.wanted.row if part_modes.wanted else None
    if row is None:
        log.warning(
            "NO_MODE", "the tetrahedral plate has no mode of the wanted shape near the structured one's frequency"
        )
        return part_modes.meshes, {}, {}
    record = TetModesRecord.of(
        row,
        dof=part_modes.dof,
        hex_frequency_hz=structured.frequency_hz,
        relative_difference=row.frequency_hz / structured.frequency_hz - 1.0,
        **{"model": part_modes.model.name, "mac": row.mac, "count_check": part_modes.count_check.to_dict()},
        **{"confinement_db": row.confinement_db, "hex_confinement_db": structured.confinement_db},
    )
    log.info(f"wanted mode by tetrahedra {row.frequency_hz:.1f} Hz, structured {structured.frequency_hz:.1f} Hz")
    skin = part_modes.model.skin(row.symmetry, part_modes.vectors[row.symmetry][:, [row.column]]).unfolded(row.symmetry)
    surface = mode_fields.surface_arrays([skin])
    arrays = {
        "tet_points": surface["surface_points"],
        "tet_triangles": surface["surface_triangles"],
        "tet_u": surface["surface_u"][0],
    }
    return part_modes.meshes, arrays, {"tet_modes": record}
