"""Study of one case file: plan and computation of its cases."""

from __future__ import annotations

from collections.abc import Container
from functools import partial
from pathlib import Path
from typing import Any

from pipeline.batch.job import Forecast, Job
from pipeline.batch.study_file import StudyFile
from pipeline.case.limits import warn_of_doubts
from pipeline.case.model import Case, case_from_dict, read_case
from pipeline.case.reading import toml_text
from pipeline.errors import InputError
from pipeline.logs import Log, RunLog
from pipeline.planning import resources, simplifications
from pipeline.questions import study as asked
from pipeline.questions.question import Run
from pipeline.records import store
from pipeline.records.record import DesignRecord, KeysRecord

NOT_PLATE = ("bands", "tolerance", "measured")  # tables of a case that are not about the plate
ONLY_COMPUTING = ("accuracy", "model", "mesh", "count")  # keys of [solve] that do not change what is computed
OF_CELL = ("solve", "bands", "materials", "defects")  # tables on which the bands of a cell depend, with the design
NOT_CELL = (  # fields of a design that leave its cells as they are
    *("width_m", "rows", "extension_m", "zones", "shared_rows", "zone_gap_m", "larger_m", "centre_m", "surround"),
    *("others_m", "supports", "outline"),
)


def jobs_of(study: StudyFile, all_fields: bool = False) -> list[Job]:
    """Return the cases of a study, optionally with all fields; faults of all cases are raised before computing any."""
    faults: list[str] = []
    jobs: list[Job] = []
    requested: list[tuple[str, list[tuple[str, Any]], tuple[str, ...]]] = []
    if study.base_measure:
        requested.append(("base", [], study.base_measure))
    requested += [(case_id, overrides, study.measure) for case_id, overrides in study.cases()]
    raw = read_case(study.case_path)
    for case_id, overrides, query in requested:
        try:
            case = case_from_dict(raw, study.case_path, overrides)
            asked.check(case, query)
        except InputError as error:
            faults += [f"case {case_id}: {line}" for line in error.lines]
            continue
        texts = [f"{key}={toml_text(value)}" for key, value in overrides]  # in the form of --set
        payload: dict[str, Any] = {"name": case.name, "case": case.to_dict(), "overrides": texts}
        payload["measure"] = list(query)
        questions = asked.chosen(query)
        if all_fields and any(each.name == "modes" for each in questions):
            payload["fields"] = True
        for each in questions:
            payload |= each.inputs()
        jobs.append(Job(case_id, payload, dict(overrides), keys_of(case).cell_bands, partial(_forecast, case, query)))
    if faults:
        raise InputError(faults)
    return jobs


def keys_of(case: Case) -> KeysRecord:
    """Return the keys of a case: of its plate, however computed, and of the modes of that and the bands of its cell."""
    whole = case.to_dict()
    plate = _without(whole, NOT_PLATE) | {"solve": _without(whole["solve"], ONLY_COMPUTING)}
    modes = _without(whole, ("bands",))
    bands = {name: whole[name] for name in OF_CELL if name in whole} | {"design": _without(whole["design"], NOT_CELL)}
    plate_key, modes_key, bands_key = (store.input_hash(about) for about in (plate, modes, bands))
    return KeysRecord(plate=plate_key, plate_modes=modes_key, cell_bands=bands_key)


def _without(table: dict[str, Any], names: Container[str]) -> dict[str, Any]:
    return {name: value for name, value in table.items() if name not in names}


def _forecast(case: Case, query: tuple[str, ...]) -> Forecast:
    """Return estimated peak memory and plan of a case; no memory and the reason for a rejected case."""
    try:
        planned = asked.plan_of(case, query)
    except InputError as error:
        return Forecast(plan=str(error))
    memory = round(max((demand.memory_bytes for demand in planned.demands.values()), default=0))
    return Forecast(memory, planned.short(), sum(demand.seconds for demand in planned.demands.values()))


def conclude(study: StudyFile, folder: Path, all_pictures: bool = False) -> list[Path]:
    """Write table and page from the stored records; all_pictures: as in `pipeline.report.page.build`."""
    from pipeline.report import page

    made = page.put_explorer(folder, study.case_path)
    return [asked.write_table(folder), *made, page.build(folder, all_pictures=all_pictures)]


def explored(study: StudyFile, folder: Path, log: Log) -> list[Path]:
    """Compute the explorer's bases and write its page and the report with its link, unless it exists or cannot."""
    from pipeline.report import page

    made = [] if page.explorer_link(folder) else page.put_explorer(folder, study.case_path, log)
    return [*made, page.build(folder)] if made else []


def computer(study: StudyFile) -> Any:
    """Return the picklable function that computes one case in a worker process."""
    return partial(compute, str(study.case_path))


def compute(case_path: str, payload: dict[str, Any], folder: Path, log: RunLog) -> dict[str, Any]:
    """Compute the measures of a case; arrays go to the case's folder. Raises the errors of solvers and meshers."""
    path = Path(case_path)
    case = case_from_dict(read_case(path), path, payload["overrides"])
    if case.to_dict() != payload["case"]:
        raise InputError(f"{path.name}: changed while the study was running; run the study again")
    warn_of_doubts(case.design, log)
    planned = asked.plan_of(case, payload["measure"])
    log.info(planned.text(), "PLAN")
    resources.refuse(planned.demands)
    simplifications.log_all(planned.whole, log)
    questions = {each.name: each for each in asked.chosen(payload["measure"])}
    run = Run(log, detailed=False, shapes=True, folder=folder, all_fields=bool(payload.get("fields")))
    for step in planned.steps:
        asked.answer(questions[step.measure], case, run)
    if run.arrays:
        store.save_arrays(folder, run.arrays)
    design = DesignRecord.of_design(case.design)
    return {"plan": planned.to_dict(), "design": design, "keys": keys_of(case), "meshes": run.meshes, **run.found}
