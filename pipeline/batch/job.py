"""One case in one process: compute, record and report it; an exception becomes a FAILED record."""

from __future__ import annotations

import time
import traceback
import warnings
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, field
from functools import cached_property
from importlib import metadata
from pathlib import Path
from typing import Any

from pipeline.logs import RunLog, close_abandoned
from pipeline.records import record, store
from pipeline.records.record import Record
from solvers import machine
from solvers.machine import memory_text

Compute = Callable[[dict[str, Any], Path, RunLog], dict[str, Any]]


@dataclass(frozen=True)
class Forecast:
    """Resource estimate of a case: peak memory in B, a plan in a few lines, and the order of magnitude of its time."""

    memory_bytes: int = 0
    plan: str = ""
    seconds: float = 0.0


@dataclass(frozen=True)
class Job:
    """One case: id (folder name), input with defaults, swept keys.

    parts: names data that it computes and stores for other cases, such as reduced cells; '' for none.
    forecaster: makes the estimate on first use, since it may solve a coarse cell.
    """

    case_id: str
    payload: dict[str, Any]
    sweep: dict[str, Any] = field(default_factory=dict)
    parts: str = ""
    forecaster: Callable[[], Forecast] = field(default=Forecast, compare=False)

    @cached_property
    def forecast(self) -> Forecast:
        """Memory and plan of the case."""
        return self.forecaster()


@dataclass(frozen=True)
class CaseEnd:
    """Outcome of a case: status OK, WARNING or FAILED, one line of diagnosis, seconds spent."""

    case_id: str
    status: str
    diagnosis: str
    seconds: float


def record_loss(job: Job, study: Path, error: BaseException) -> CaseEnd:
    """Record a case whose process was lost, so that the table shows it."""
    folder = study / job.case_id
    if store.why_recompute(folder, job.payload, store.current_fingerprint()) is None:  # lost after it had finished
        result = record.read(folder)
        return CaseEnd(job.case_id, result.status, result.diagnosis, 0.0)
    diagnosis = _one_line(error)
    with suppress(store.StoreError, OSError):
        folder.mkdir(parents=True, exist_ok=True)
        store.sweep_leftovers(folder)
        close_abandoned(folder / store.RUN_LOG, "LOST", diagnosis)
        store.finish(
            folder,
            _dressed(job, {"status": "FAILED", "diagnosis": diagnosis}, store.current_fingerprint()).to_dict(),
            {"seconds": {}},
        )
    return CaseEnd(job.case_id, "FAILED", diagnosis, 0.0)


def _dressed(job: Job, result: dict[str, Any], mark: store.Fingerprint) -> Record:
    """Return the record of the results, with the fields that every record has."""
    return Record.of_case(
        result,
        case_id=job.case_id,
        name=job.payload.get("name", job.case_id),
        input_hash=store.input_hash(job.payload),
        code_hash=mark.code_hash,
        versions=mark.versions,
        sweep=job.sweep,
    )


def run_case(compute: Compute, job: Job, study: Path, mark: store.Fingerprint) -> CaseEnd:
    """Compute one case in this process, record it and return its outcome; an exception becomes a FAILED record."""
    folder = store.case_folder(study, job.case_id)
    start = time.perf_counter()
    try:
        machine.restart_peak()
        store.begin(folder, job.payload)
        with RunLog(folder / store.RUN_LOG) as log:
            log.banner(job.case_id, metadata.version("antinode"), mark.versions)
            log.echo(job.payload)
            result = _guarded(compute, job, folder, log, mark)
            timing = {
                "seconds": {**log.seconds, "total": log.elapsed},
                "peak_memory_bytes": machine.reported_peak_bytes(),
            }
            store.finish(folder, result.to_dict(), timing)
            log.close(result.status)
    except (store.StoreError, OSError) as error:
        close_abandoned(folder / store.RUN_LOG, "LOST", str(error))
        store.sweep_leftovers(folder)
        return CaseEnd(job.case_id, "FAILED", str(error), time.perf_counter() - start)
    finally:
        machine.give_back()  # before the free memory is checked for the next case
    return CaseEnd(job.case_id, result.status, result.diagnosis, time.perf_counter() - start)


def _guarded(compute: Compute, job: Job, folder: Path, log: RunLog, mark: store.Fingerprint) -> Record:
    try:
        if store.current_fingerprint().code_hash != mark.code_hash:
            raise RuntimeError(
                "the sources of this worker differ from those that started the study; run the study again"
            )
        with warnings.catch_warnings():
            warnings.showwarning = lambda message, kind, *_: log.info(f"{kind.__name__}: {message}", "PYTHON")
            return _concluded(job, compute(job.payload, folder, log), log, mark)
    except (store.DiskFull, KeyboardInterrupt):
        raise
    except BaseException as error:
        text = _one_line(error)
        log.error(type(error).__name__, text)
        if not _is_expected(error):
            log.info(traceback.format_exc())
        return _concluded(job, {"status": "FAILED", "diagnosis": text}, log, mark)


def _concluded(job: Job, result: dict[str, Any], log: RunLog, mark: store.Fingerprint) -> Record:
    """Return the record with warnings and simplifications of the log and the outcome of the case."""
    status, diagnosis = ("WARNING", log.warnings[0]) if log.warnings else ("OK", "done")
    left_out = list(dict.fromkeys(log.left_out_list))
    return _dressed(
        job, {"status": status, "diagnosis": diagnosis, **result, "left_out": left_out, "warnings": log.warnings}, mark
    )


def _is_expected(error: BaseException) -> bool:
    """Return the message of an error that this program raises on purpose, else also its type."""
    return type(error).__module__.split(".")[0] in {"geometry", "solvers", "pipeline"}


def _one_line(error: BaseException) -> str:
    if isinstance(error, MemoryError):
        return memory_text(error)
    text = " ".join(str(error).split())
    if _is_expected(error) and text:
        return text
    return f"{type(error).__name__}: {text}" if text else type(error).__name__


@dataclass(frozen=True)
class Planned:
    """A case and why it has to be computed; None if its record is valid."""

    case_id: str
    why: str | None
