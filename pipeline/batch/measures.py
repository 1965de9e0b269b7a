"""One case of a study: scene, meshes, modes, measures; what each asks for and nothing else."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from geometry.elements import FloatArray
from pipeline.analysis import mode_fields, modes
from pipeline.analysis.wanted_text import warn_of_wanted
from pipeline.batch.job import Job
from pipeline.batch.study_file import StudyFile
from pipeline.case.model import Case, load_case
from pipeline.errors import InputError
from pipeline.logs import Log
from pipeline.planning import plan, resources, simplifications
from pipeline.planning.request import of_case
from pipeline.records import store
from pipeline.records.run_log import RunLog

if TYPE_CHECKING:
    from solvers.piezo.forced import ForcedPlate

NEIGHBOURS = 6
KEPT = 4  # shapes of them in a record: what a page draws and moves


def jobs_of(study: StudyFile, fields_too: bool = False) -> list[Job]:
    """The cases of a study, with every mode's field on demand; every fault of every case is raised before any is computed."""
    faults: list[str] = []
    jobs: list[Job] = []
    wanted: list[tuple[str, list[str], tuple[str, ...]]] = [("base", [], study.once)] if study.once else []
    wanted += [(case_id, overrides, study.measure) for case_id, overrides in study.cases()]
    for case_id, overrides, measure in wanted:
        try:
            case = load_case(study.case_path, overrides)
            _check(case, measure)
        except InputError as fault:
            faults += [f"case {case_id}: {line}" for line in fault.lines]
            continue
        sweep = dict(zip(study.sweep, _values(overrides), strict=True)) if overrides else {}
        payload: dict[str, Any] = {"name": case.name, "case": case.as_understood(), "overrides": overrides}
        payload["measure"] = list(measure)
        if fields_too and {"modes", "confinement"} & set(measure):
            payload["fields"] = True
        if "board" in measure:
            from pipeline.board import emulation

            payload["firmware"] = emulation.sources_hash()
        jobs.append(Job(case_id, payload, sweep, _memory(case, measure)))
    if faults:
        raise InputError(faults)
    return jobs


def _memory(case: Case, measure: tuple[str, ...]) -> int:
    """What a case is foreseen to take, B; 0 for one that its own run will refuse."""
    with suppress(InputError):
        return round(max(demand.memory_bytes for demand in plan.of_measures(case, measure).demands.values()))
    return 0


def _values(overrides: list[str]) -> list[Any]:
    from pipeline.case.overrides import parse_override

    return [parse_override(text)[1] for text in overrides]


def _check(case: Case, measure: tuple[str, ...]) -> None:
    case.require_plate(command="a study")
    if "response" in measure:
        case.require("patches", command="the measure response")
    if "tolerance" in measure:
        case.require("tolerance", command="the measure tolerance")
    if "board" in measure and not {"modes", "confinement"} & set(measure):
        raise InputError("the measure board plays the modes' table: measure must hold modes too")


def computer(study: StudyFile) -> Any:
    """The picklable function that computes one case in a worker process."""
    return partial(compute, str(study.case_path))


def compute(case_path: str, payload: dict[str, Any], folder: Path, log: RunLog) -> dict[str, Any]:
    """Record of one case; arrays go to the case's folder. Raises what its solvers and meshers raise."""
    case = load_case(case_path, payload["overrides"])
    if case.as_understood() != payload["case"]:
        raise InputError(f"{Path(case_path).name}: changed while the study was running; run the study again")
    record: dict[str, Any] = {"design": describe(case), "meshes": []}
    arrays: dict[str, FloatArray] = {}
    planned = plan.of_measures(case, payload["measure"])
    log.info(planned.text(), "PLAN")
    resources.refuse(planned.demands)
    simplifications.log_all(planned.whole, log)
    record["plan"] = planned.json()
    solved: dict[str, ForcedPlate] = {}
    run: dict[str, Callable[[], None]] = {
        "modes": lambda: _in_full(_plate(case, log, record, arrays, folder), payload, folder, log),
        "bands": lambda: _bands(case, log, record, arrays),
        "attenuation": lambda: _attenuation(case, log, record),
        "response": lambda: solved.update(forced=_response(case, log, record, arrays)),
        "tolerance": lambda: _tolerance(case, log, record, arrays),
        "board": lambda: _board(case, log, record, arrays, folder, solved.get("forced")),
        "parts": lambda: _parts(case, log, record),
        "geometry": lambda: _geometry(case, log, record, folder),
        "tetrahedra": lambda: _tetrahedra(case, log, record, arrays),
    }
    for step in planned.steps:
        run[step.measure]()
    if arrays:
        store.save_arrays(folder, arrays)
    return record


def describe(case: Case) -> dict[str, Any]:
    """The design for tables and pictures, SI."""
    design, pillar = case.design, case.design.pillar
    keys = (
        "length_m",
        "width_m",
        "thickness_m",
        "half_span_m",
        "rows",
        "pitch_x_m",
        "pitch_y_m",
        "extension_m",
        "nodal_lines",
    )
    plain = {key: getattr(design, key) for key in keys}
    shape = (
        {key: getattr(pillar, key) for key in ("shape", "base_m", "tip_m", "height_m", "fillet_m")} if pillar else None
    )
    return plain | {"pillar": shape, "pillar_centres_m": design.pillar_centres().tolist()}


def _in_full(part_modes: modes.PartModes, payload: dict[str, Any], folder: Path, log: Log) -> None:
    """Every mode's field into the case's folder, where the run asked for it."""
    if payload.get("fields"):
        with log.step("fields in full"):
            store.save_arrays(folder, mode_fields.full_fields(part_modes), store.FIELDS)


def _plate(
    case: Case, log: RunLog, record: dict[str, Any], arrays: dict[str, FloatArray], folder: Path
) -> modes.PartModes:
    part_modes = modes.solve_modes(case, of_case(case), log).whole_window
    record["modes"] = part_modes.json()
    record["meshes"] += part_modes.meshes
    assert part_modes.wanted
    record["wanted"] = modes.wanted_record(part_modes)
    index = part_modes.index(part_modes.wanted.row)
    warn_of_wanted(part_modes.wanted, case, log)
    if index is None:
        return part_modes
    record["shapes"] = mode_fields.shapes_record(part_modes, case.design)
    with log.step("fields"):
        arrays |= mode_fields.kept_arrays(part_modes, nearest_rows(part_modes, index)[:KEPT])
    from pipeline.board.export import write_table

    write_table(case, part_modes, index, folder)
    return part_modes


def nearest_rows(part_modes: modes.PartModes, index: int) -> list[int]:
    """The wanted mode and its neighbours in frequency, the wanted one first."""
    distance = np.abs(np.array([row.frequency_hz for row in part_modes.rows]) - part_modes.rows[index].frequency_hz)
    return [int(i) for i in np.argsort(distance, kind="stable")[: NEIGHBOURS + 1]]


def _bands(case: Case, log: Log, record: dict[str, Any], arrays: dict[str, FloatArray]) -> None:
    from pipeline.analysis import bands

    computed = bands.solve_bands(case, log, shapes=True)
    corner = computed.at("M")
    record["bands"] = computed.json() | {
        "method": computed.model,
        "bending_at_m_hz": [float(f) for f in corner[:2]] if corner is not None else None,
    }
    record["meshes"] += computed.meshes
    arrays |= computed.shapes


def _attenuation(case: Case, log: Log, record: dict[str, Any]) -> None:
    """Complex bands, and beside them what the finite plate does: rows times the decay per row at the wanted mode."""
    from pipeline.analysis import attenuation

    computed = attenuation.solve(case, log, points=plan.ATTENUATION_POINTS)
    record["attenuation"] = computed.json()
    record["meshes"] += computed.meshes
    wanted = record.get("wanted") or {}
    if wanted.get("frequency_hz"):
        record["prediction"] = attenuation.prediction(computed, wanted["frequency_hz"], wanted["extension_db"])


def _response(case: Case, log: Log, record: dict[str, Any], arrays: dict[str, FloatArray]) -> ForcedPlate:
    """The forced response, its operating shape at the peak among the arrays; returns the plate that it solved."""
    from pipeline.analysis import response
    from pipeline.measured import comparison

    measured = comparison.read(case, None, None, None)
    computed = response.solve(case, log, points=plan.RESPONSE_POINTS)
    record["response"] = computed.json()
    if measured:
        beside = comparison.compare(case, computed, measured, log)
        record["measured"] = beside.document
        arrays |= beside.arrays
    record["meshes"] += computed.meshes
    arrays |= {
        "response_xy": computed.shape_points.astype(np.float32),
        "response_uz": computed.shape.astype(np.complex64),
    }
    return computed.forced


def _tolerance(case: Case, log: Log, record: dict[str, Any], arrays: dict[str, FloatArray]) -> None:
    from pipeline.analysis import tolerance

    computed = tolerance.solve(case, log)
    record["tolerance"] = computed.json()
    arrays |= computed.arrays()


def _board(
    case: Case,
    log: Log,
    record: dict[str, Any],
    arrays: dict[str, FloatArray],
    folder: Path,
    forced: ForcedPlate | None,
) -> None:
    """The case's mode table, its gains computed when the response was, played by the firmware on the emulated board."""
    from pipeline.board import emulation, export
    from pipeline.board.gains import can_be_computed

    if not (record.get("wanted") or {}).get("frequency_hz"):
        log.left_out("closed loop on the emulated board", "no mode of the wanted shape: there is no mode table")
        return
    if forced and can_be_computed(case) and forced.wanted_hz():
        export.write_gains(case, folder, log, forced=forced)
    record["board"], computed = emulation.solve(folder, log)
    arrays |= computed


def _geometry(case: Case, log: Log, record: dict[str, Any], folder: Path) -> None:
    from pipeline.exchange.exports import print_files

    record["geometry"] = print_files(case, folder, log)


def _tetrahedra(case: Case, log: Log, record: dict[str, Any], arrays: dict[str, FloatArray]) -> None:
    from pipeline.analysis import cross_check

    cross_check.add(case, log, record, arrays)


def _parts(case: Case, log: Log, record: dict[str, Any]) -> None:
    """The bare zone and the lone pillar, as the pre-design saw them."""
    from solvers.analytic.predesign import predesign

    record["predesign"] = predesign(case.design).as_json()
    lines = case.design.nodal_lines
    zone = modes.solve_modes(case, modes.Request("zone"), log)
    record["zone_modes"] = zone.json() | {"nodal_lines": lines}
    record["meshes"] += zone.meshes
    if case.design.pillar:
        pillar = modes.solve_modes(case, modes.Request("pillar", near_hz=0.0, count=4), log)
        record["pillar_modes"] = pillar.json()
        record["meshes"] += pillar.meshes
