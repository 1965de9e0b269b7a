"""A study's cases through any Executor: what stands is kept, what is missing is computed, what fails is recorded.

One run at a time holds the study's lock, and journal.jsonl has a line for everything that happens to it.
"""

from __future__ import annotations

import json
import os
from collections.abc import Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, CancelledError, Executor, Future, wait
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field, replace
from datetime import UTC, datetime
from math import inf
from pathlib import Path
from typing import Any

from pipeline import workers
from pipeline.batch.job import CaseEnd, Compute, Forecast, Job, Planned, record_loss, run_case
from pipeline.batch.progress import Progress
from pipeline.errors import InputError
from pipeline.records import fingerprint, store
from pipeline.records.run_log import close_abandoned
from pipeline.records.study import CASES
from pipeline.workers import default_jobs
from solvers.machine import available_bytes

JOURNAL = "journal.jsonl"


def note(folder: Path, event: str, **fields: Any) -> None:
    """Append a line to a study's journal; one torn by a killed run is closed first, so that it spoils no other."""
    entry = {"at": datetime.now(UTC).isoformat(timespec="seconds"), "event": event, **fields}
    with (folder / JOURNAL).open("ab+") as file:
        if file.tell():
            file.seek(-1, os.SEEK_END)
        begun = file.read() not in (b"", b"\n")
        file.write(b"\n" * begun + json.dumps(entry, ensure_ascii=False).encode() + b"\n")


def known_seconds(folder: Path, jobs: Sequence[Job]) -> dict[str, float]:
    """How long each case took when it was computed before, s: what time left is reckoned from."""
    found = {}
    for job in jobs:
        with suppress(store.BadRecord, KeyError, TypeError):
            seconds = store.read_json(folder / job.case_id / store.TIMING)["seconds"]["total"]
            if isinstance(seconds, int | float) and 0.0 <= seconds < inf:
                found[job.case_id] = float(seconds)
    return found


LOCK = ".lock"


class StudyBusy(InputError):
    """Another process is running this study."""


@contextmanager
def study_lock(folder: Path) -> Iterator[None]:
    """Hold the study's lock. The kernel frees it when the process ends, so a killed run leaves no stale lock.

    Raises StudyBusy when another process holds it.
    """
    import fcntl

    folder.mkdir(parents=True, exist_ok=True)
    descriptor = os.open(folder / LOCK, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o644)
    try:
        try:
            fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError as error:
            holder = os.pread(descriptor, 200, 0).decode(errors="replace").strip() or "an unknown process"
            raise StudyBusy(
                f"{folder}: another run of this study is at work ({holder}); wait for it or end it"
            ) from error
        os.ftruncate(descriptor, 0)
        os.pwrite(descriptor, f"process {os.getpid()}, since {datetime.now():%Y-%m-%d %H:%M:%S}\n".encode(), 0)
        yield
    finally:
        os.close(descriptor)


MEMORY_SHARE = 0.8  # of what is free at the start
POLL_S = 0.25
LOOK_AHEAD = 8  # waiting cases that may overtake one too large for the free memory


@dataclass(frozen=True)
class StudyOutcome:
    """What a run did: its plan, the cases it computed, and those left undone by --fail-fast or a lost executor."""

    folder: Path
    plan: tuple[Planned, ...]
    ended: tuple[CaseEnd, ...] = ()
    undone: tuple[str, ...] = ()
    given_up: tuple[str, ...] = ()  # those of the undone that the executor cancelled

    @property
    def reused(self) -> tuple[str, ...]:
        """Cases whose records stood."""
        return tuple(planned.case_id for planned in self.plan if planned.why is None)

    @property
    def failed(self) -> tuple[CaseEnd, ...]:
        """Cases that failed in this run."""
        return tuple(end for end in self.ended if end.status == "FAILED")

    @property
    def exit_code(self) -> int:
        """0, or 3 when a case failed or was left undone."""
        return 3 if self.failed or self.undone else 0


@dataclass(frozen=True)
class Options:
    """How to run: worker processes (None: one per core) or an Executor; recompute all, stop at a failure, plan only."""

    jobs: int | None = None
    executor: Executor | None = None
    force: bool = False
    fail_fast: bool = False
    dry_run: bool = False


def run_study(
    jobs: Sequence[Job],
    compute: Compute,
    folder: Path,
    options: Options | None = None,
    progress: Progress | None = None,
    about: dict[str, Any] | None = None,
) -> StudyOutcome:
    """Compute what is missing of a study, each case in folder/<case id>; returns what was done.

    `compute(payload, case folder, log)` runs in a worker process (a function of a module), writes its arrays
    through the store and returns the record without what the runner adds (case_id, hashes, versions, sweep).
    `about` is kept for the report. Raises lock.StudyBusy when the study is running elsewhere, ValueError for case
    ids that repeat or cannot name a folder, KeyboardInterrupt after cleaning up.
    """
    options, progress = options or Options(), progress or Progress(quiet=True)
    _check_ids(jobs, folder)
    if options.dry_run:
        return StudyOutcome(folder, plan(jobs, folder, options.force))
    with study_lock(folder):
        store.sweep_leftovers(folder)
        planned = plan(jobs, folder, options.force)
        listed = [{"case_id": job.case_id, "sweep": job.sweep} for job in jobs]
        store.write_sealed(folder / CASES, {"schema": store.DOCUMENT_SCHEMA, "about": about or {}, "cases": listed})
        return _Run(jobs, compute, folder, options, progress, planned).go()


def plan(jobs: Sequence[Job], folder: Path, force: bool = False) -> tuple[Planned, ...]:
    """Which cases have to be computed, and why."""
    now = fingerprint.current()
    return tuple(
        Planned(job.case_id, "forced" if force else store.why_recompute(folder / job.case_id, job.payload, now))
        for job in jobs
    )


def _check_ids(jobs: Sequence[Job], folder: Path) -> None:
    seen: set[str] = set()
    for job in jobs:
        store.case_folder(folder, job.case_id)
        if job.case_id in seen:
            raise ValueError(f"two cases of this study have the id {job.case_id!r}")
        seen.add(job.case_id)


@dataclass
class _Run:
    """One run of a study, while it lasts."""

    jobs: Sequence[Job]
    compute: Compute
    folder: Path
    options: Options
    progress: Progress
    planned: tuple[Planned, ...]
    ended: list[CaseEnd] = field(default_factory=list)
    running: dict[Future[CaseEnd], Job] = field(default_factory=dict)
    given_up: list[Job] = field(default_factory=list)
    made: set[str] = field(default_factory=set)  # parts of the cases that ended well

    def __post_init__(self) -> None:
        self.why = {item.case_id: item.why for item in self.planned}
        self.waiting = [job for job in self.jobs if self.why[job.case_id] is not None]
        self.unsaid = ""  # why a line of the journal is missing
        count = len(self.jobs)
        at_once = count if self.options.executor else default_jobs(count)  # a cluster queues by itself
        self.workers = self.options.jobs or max(1, at_once)

    def go(self) -> StudyOutcome:
        self.progress.begin(self.folder, self.planned, known_seconds(self.folder, self.jobs))
        self._note("run", cases=len(self.planned), to_compute=len(self.waiting), pid=os.getpid())
        executor = self.options.executor or (_local(self.workers) if self.waiting else None)
        try:
            if executor:
                self._drain(executor)
        except KeyboardInterrupt:
            self._interrupted(executor)
            raise
        finally:
            if executor and not self.options.executor:
                executor.shutdown(wait=True)
            self.progress.end()
        lost = {job.case_id for job in self.given_up}
        given_up = tuple(item.case_id for item in self.planned if item.case_id in lost)
        if given_up:
            self._note("executor_lost", at_work=given_up)
        undone = given_up + tuple(job.case_id for job in self.waiting)
        self._note("end", failed=sum(end.status == "FAILED" for end in self.ended), undone=len(undone))
        if self.unsaid:
            self.progress.say(self.unsaid)
        return StudyOutcome(self.folder, self.planned, tuple(self.ended), undone, given_up)

    def _note(self, event: str, **fields: Any) -> None:
        """Write a line of the journal; a full disk does not stop a study."""
        try:
            note(self.folder, event, **fields)
        except OSError as error:
            self.unsaid = f"{self.folder / JOURNAL}: a line could not be written ({error.strerror})"

    def _drain(self, executor: Executor) -> None:
        while self.waiting or self.running:
            if self._stopped() and not self.running:
                return
            while not self._stopped() and (job := self._next_that_fits()):
                self._submit(executor, job)
            done, _ = wait(self.running, timeout=POLL_S, return_when=FIRST_COMPLETED)
            for future in done:
                self._collect(future)
            self.progress.tick()

    def _stopped(self) -> bool:
        return bool(self.given_up) or (self.options.fail_fast and any(end.status == "FAILED" for end in self.ended))

    def _next_that_fits(self) -> Job | None:
        """The next case, unless all workers are busy or its memory is taken; one case alone always fits."""
        if not self.waiting or len(self.running) >= self.workers:
            return None
        granted = sum(job.forecast.memory_bytes for job in self.running.values())
        room = MEMORY_SHARE * (granted + available_bytes()) - granted
        bounded = bool(self.running) and self.options.executor is None
        ahead = self._apart_first()[: LOOK_AHEAD if bounded else 1]
        job = next((each for each in ahead if not bounded or each.forecast.memory_bytes <= room), None)
        if job:
            self.waiting.remove(job)
        return job

    def _apart_first(self) -> list[Job]:
        """The waiting cases, those last that compute what a running one is just making for them to find kept."""
        at_work = {job.parts for job in self.running.values()} - self.made - {""}
        return sorted(self.waiting, key=lambda job: job.parts in at_work)

    def _submit(self, executor: Executor, job: Job) -> None:
        self._note("started", case=job.case_id, why=self.why[job.case_id])
        self.progress.case_started(job.case_id)
        bare = replace(job, forecaster=Forecast)  # what a worker has no use for stays here
        task = executor.submit(run_case, self.compute, bare, self.folder, fingerprint.current())
        self.running[task] = job

    def _collect(self, future: Future[CaseEnd]) -> None:
        job = self.running.pop(future)
        try:
            end = future.result()
        except CancelledError as error:  # no cancellation of ours is collected: the executor gave the case up
            if store.why_recompute(self.folder / job.case_id, job.payload, fingerprint.current()) is not None:
                self.given_up.append(job)
                self._abandon(job, "the executor gave this case up; the next run computes it again")
                return
            end = record_loss(job, self.folder, error)
        except Exception as error:
            end = record_loss(job, self.folder, error)
        self.ended.append(end)
        if end.status != "FAILED":
            self.made.add(job.parts)
        event = "failed" if end.status == "FAILED" else "finished"
        self._note(event, case=end.case_id, status=end.status, seconds=end.seconds, diagnosis=end.diagnosis)
        self.progress.case_ended(end.case_id, end.status, end.diagnosis, end.seconds)

    def _interrupted(self, executor: Executor | None) -> None:
        if isinstance(executor, workers.LocalWorkers):
            executor.kill()
        for future, job in self.running.items():
            future.cancel()
            self._abandon(job, "interrupted; the next run computes this case again")
        self._note("interrupted", at_work=[job.case_id for job in self.running.values()])

    def _abandon(self, job: Job, text: str) -> None:
        """Close the log of a case that was begun and not finished."""
        folder = self.folder / job.case_id
        store.sweep_leftovers(folder)
        if (folder / store.RUN_LOG).exists() and not (folder / store.RECORD).exists():
            close_abandoned(folder / store.RUN_LOG, "INTERRUPTED", text)


def _local(count: int) -> workers.LocalWorkers:
    """Threads per worker depend on nothing that a resumed run would see differently, so that numbers repeat."""
    return workers.LocalWorkers(count, max(1, default_jobs(1 << 30) // count))
