"""Target mode of a plate meshed whole with tetrahedra, compared with that of the structured mesh."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

from geometry.elements import FloatArray
from pipeline.case.model import Case
from pipeline.logs import Log
from pipeline.models import mode_fields, modes
from pipeline.models.target import ModeRow
from pipeline.planning.mesh_rules import PLATE_ACCURACY, PLATE_TETRAHEDRA
from pipeline.quantity import frequency, level, percent, percentage, signed
from pipeline.records.record import MeshRecord
from solvers.accuracy import calibration

BELOW = 0.002  # search margin below the structured frequency; uncorrected tetrahedra lie above the exact one
Compared = tuple[list[MeshRecord], dict[str, FloatArray], dict[str, Any]]


def excess(across: float) -> float:
    """Largest relative overestimate with `across` tetrahedra through a plate: calibrated for one, it falls as 1/across^2."""
    return (calibration.by_tetrahedra("plate", 1.0) or 0.0) / across**2


def compared(case: Case, own: modes.PartModes, structured: ModeRow, bar: float, log: Log) -> Compared:
    """Return meshes, tet_* arrays and figures of the target mode with tetrahedra; no figures if it was not found.

    Parameters
    ----------
    case
        The case.
    own, structured
        The plate's modes on the structured mesh, and the target mode among them.
    bar
        Its error, relative.
    log
        Receives the verdict.
    """
    part_modes = _by_tetrahedra(case, structured, bar, log)
    row = part_modes.target_row
    if row is None:
        log.warning(
            "NO_MODE",
            "the plate of tetrahedra has no mode of the target shape near the frequency from the structured mesh",
        )
        return part_modes.meshes, {}, {}
    own_bar = _own_bar(part_modes)
    agrees = _agrees(row.frequency_hz, structured.frequency_hz, bar, own_bar, log)
    mixing = modes.level_bars_db(case, own, bar + (modes.shape_error(part_modes, row) or own_bar))[0]
    if mixing is not None and row.confinement_db is not None:
        log.info(
            f"confinement of the target mode: {level(row.confinement_db, mixing)} with tetrahedra, "
            f"{level(structured.confinement_db, structured.confinement_error_db)} on the structured mesh; frequency errors "
            f"that mix neighbouring modes allow a difference of {level(mixing, mixing)}"
        )
    figures = {
        "model": part_modes.model.name,
        "dof": part_modes.dof,
        "frequency_hz": row.frequency_hz,
        "error": own_bar,
        "hex_frequency_hz": structured.frequency_hz,
        "hex_error": bar,
        "relative_difference": row.frequency_hz / structured.frequency_hz - 1.0,
        "agrees": agrees,
        "mac": row.mac,
        "count_check": part_modes.whole_window.count_check,
        "confinement_db": row.confinement_db,
        "hex_confinement_db": structured.confinement_db,
        "hex_confinement_error_db": structured.confinement_error_db,
        "confinement_bar_db": mixing,
    }
    skin = part_modes.model.skin(row.symmetry, part_modes.vectors[row.symmetry][:, [row.column]]).unfolded(row.symmetry)
    surface = mode_fields.surface_arrays([skin])
    arrays = {
        "tet_points": surface["surface_points"],
        "tet_triangles": surface["surface_triangles"],
        "tet_u": surface["surface_u"][0],
    }
    return part_modes.meshes, arrays, figures


def _by_tetrahedra(case: Case, structured: ModeRow, bar: float, log: Log) -> modes.PartModes:
    """Solve the plate meshed whole around the target mode's frequency, in a window just wide enough to find the mode."""
    tone, accuracy = structured.frequency_hz, max(PLATE_ACCURACY, case.solve.accuracy)
    coarse = replace(case, solve=case.solve.but(mesh="tet", model="solid", accuracy=accuracy))
    request = modes.Request(
        "plate",
        band_hz=(tone * (1.0 - bar - BELOW), tone * (1.0 + excess(PLATE_TETRAHEDRA))),
        symmetry=case.target_symmetry,
        search=False,
        expected=modes.Expected(tone, structured.strength or 0.0),
    )
    return modes.solve_modes(coarse, request, log)


def _own_bar(part_modes: modes.PartModes) -> float:
    """Error of the frequency from stress recovery, or else the largest error of such a mesh, relative."""
    row = part_modes.target_row
    return excess(PLATE_TETRAHEDRA) if row is None or row.error is None else row.error


def _agrees(tet_hz: float, hex_hz: float, bar: float, own: float, log: Log) -> bool:
    """Whether the two frequencies agree within both error bars."""
    both, difference = bar + own, tet_hz / hex_hz - 1.0
    log.info(f"target mode: {frequency(tet_hz, own)} with tetrahedra, {frequency(hex_hz, bar)} on the structured mesh")
    if abs(difference) <= both:
        return True
    log.warning(
        "CROSS_CHECK",
        f"the target mode with tetrahedra, {frequency(tet_hz, own)}, differs by {signed(percentage(difference, both))} from "
        f"that on the structured mesh, {frequency(hex_hz, bar)}; their error bars allow {percent(both)}",
    )
    return False
