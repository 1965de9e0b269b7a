"""Run of a study's cases through any Executor: reuse, compute or record a failure, with progress display.

Only one run at a time holds the study's lock; journal.jsonl has one line per event.
"""

from __future__ import annotations

import json
import os
import sys
import time
from collections.abc import Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, CancelledError, Executor, Future, wait
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field, replace
from datetime import UTC, datetime
from math import inf
from pathlib import Path
from typing import Any, TextIO

from pipeline import workers
from pipeline.batch.job import CaseEnd, Compute, Forecast, Job, Planned, record_loss, run_case
from pipeline.errors import InputError
from pipeline.logs import close_abandoned, current_step
from pipeline.quantity import several
from pipeline.records import store
from pipeline.records.store import RUN_LOG
from pipeline.records.study import CASES
from pipeline.workers import default_jobs
from solvers.machine import available_bytes

HEARTBEAT_S, PLANNING_S = 30.0, 3.0  # longest silence while cases run, and while they are planned
LOOK_S = 1.0  # interval between checks of the begun cases
LONGER = 1.2  # a case is late beyond this multiple of its previous time
MAX_NAMED = 4
MAX_REASONS = 8
EXPECTED = {"new", "not finished before", "forced"}

JOURNAL = "journal.jsonl"
LOCK = ".lock"
MEMORY_SHARE = 0.8  # of the memory free at the start
POLL_S = 0.25
LOOK_AHEAD = 8  # waiting cases that may overtake one too large for the free memory


class Progress:
    """Progress of a study on standard error."""

    def __init__(self, quiet: bool = False, stream: TextIO | None = None) -> None:
        self.quiet = quiet
        self.stream = stream or sys.stderr
        self._live: Any = None
        self._task: Any = None
        self._running: dict[str, int | None] = {}  # submitted, with the modification time of an earlier run's log
        self._begun: dict[str, float] = {}  # time at which their own log appeared: before, a case may wait for a worker
        self._looked = 0.0
        self._known: dict[str, float] = {}
        self._left: set[str] = set()
        self._folder = Path()
        self._total = self._done = 0
        self._spoke = self._began = time.monotonic()
        self._spent: list[float] = []

    def begin(self, folder: Path, planned: Sequence[Planned], known_seconds: dict[str, float]) -> None:
        """Start the display; `known_seconds` are durations of earlier runs."""
        todo = [item.case_id for item in planned if item.why is not None]
        self._folder, self._total, self._known, self._left = folder, len(todo), known_seconds, set(todo)
        self._began = self._spoke = time.monotonic()
        if self.quiet:
            return
        reused = len(planned) - len(todo)
        kept = f", {reused} already computed" if reused else ""
        self.say(f"{folder}: {several(len(planned), 'case')}{kept}, {len(todo)} to compute")
        again = [item for item in planned if item.why and item.why not in EXPECTED]
        for item in again[:MAX_REASONS]:
            self.say(f"{item.case_id}: computed again, {item.why}")
        if len(again) > MAX_REASONS:
            self.say(f"and {len(again) - MAX_REASONS} more (antinode run --dry-run lists the reasons)")
        if todo and self.stream.isatty():
            self._open_live()

    def _open_live(self) -> None:
        from rich.console import Console
        from rich.progress import BarColumn, MofNCompleteColumn, TextColumn, TimeElapsedColumn
        from rich.progress import Progress as Bar

        columns = (BarColumn(bar_width=24), MofNCompleteColumn(), TimeElapsedColumn(), TextColumn("{task.description}"))
        self._live = Bar(*columns, console=Console(file=self.stream), transient=True)
        self._task = self._live.add_task("", total=self._total)
        self._live.start()

    def planned(self, done: int, total: int) -> None:
        """Report that so many cases of a dry run are planned: a bar in a terminal, elsewhere a line every few seconds."""
        if self.quiet or total < 2:
            return
        if not self._live and self.stream.isatty():
            self._total = total
            self._open_live()
        if self._live:
            self._live.update(self._task, completed=done, description="planned")
        elif time.monotonic() - self._spoke > PLANNING_S:
            self.say(f"{done} of {several(total, 'case')} planned")

    def say(self, text: str) -> None:
        """Print one line."""
        if self.quiet:
            return
        if self._live:
            self._live.console.print(text, markup=False, highlight=False)
        else:
            print(text, file=self.stream, flush=True)
        self._spoke = time.monotonic()

    def case_started(self, case_id: str) -> None:
        """Report that a case was sent to a worker."""
        self._running[case_id] = self._log_time(case_id)
        if not self._live:
            self.say(f"{case_id}: started")

    def case_ended(self, case_id: str, status: str, diagnosis: str, seconds: float) -> None:
        """Report that a case ended."""
        self._running.pop(case_id, None)
        self._begun.pop(case_id, None)
        self._left.discard(case_id)
        self._done += 1
        if status != "FAILED":
            self._spent.append(seconds)
        left = f"; {self.time_left()}" if self._left else ""
        self.say(f"[{self._done}/{self._total}] {case_id}: {status}, {seconds:.1f} s, {diagnosis}{left}")
        if self._live:
            self._live.update(self._task, completed=self._done)

    def tick(self) -> None:
        """Update the display; called a few times per second."""
        if self.quiet or not self._running:
            return
        self._look()
        if self._live:
            self._live.update(self._task, description=self._now())
        elif time.monotonic() - self._spoke > HEARTBEAT_S:
            self.say(f"[{self._done}/{self._total}] {self._now()}")

    def end(self) -> None:
        """Close the display."""
        if self._live:
            self._live.stop()
            self._live = None

    def _now(self) -> str:
        first = sorted(self._running, key=lambda case_id: case_id not in self._begun)[:MAX_NAMED]
        logs = {case_id: self._folder / case_id / RUN_LOG for case_id in first}
        steps = {case_id: current_step(logs[case_id]) if case_id in self._begun else "" for case_id in first}
        at_work = [f"{case_id} ({step or 'starting'})" for case_id, step in steps.items()]
        if len(self._running) > len(first):
            at_work.append(f"and {len(self._running) - len(first)} more")
        return f"{', '.join(at_work)}; {self.time_left()}"

    def _log_time(self, case_id: str) -> int | None:
        with suppress(OSError):
            return (self._folder / case_id / RUN_LOG).stat().st_mtime_ns
        return None

    def _look(self) -> None:
        """Check which cases have begun."""
        now = time.monotonic()
        if now - self._looked < LOOK_S:
            return
        self._looked = now
        for case_id, earlier in self._running.items():
            if case_id not in self._begun and self._log_time(case_id) != earlier:
                self._begun[case_id] = now

    def time_left(self) -> str:
        """Estimate the remaining time from earlier durations, else from the mean of this run's cases."""
        mean = sum(self._spent) / len(self._spent) if self._spent else None
        guesses = [self._known.get(case_id, mean) for case_id in self._left]
        if not guesses or any(guess is None for guess in guesses):
            return "remaining time not yet known"
        spent = {case_id: time.monotonic() - start for case_id, start in self._begun.items()}
        usual = {case_id: self._known.get(case_id, mean or 0.0) for case_id in self._left}
        remaining_s = sum(max(0.0, usual[case_id] - spent.get(case_id, 0.0)) for case_id in usual)
        if remaining_s <= 0.0:
            late = any(seconds > LONGER * usual.get(case_id, 0.0) for case_id, seconds in spent.items())
            return "taking longer than earlier cases" if late else "almost finished"
        return f"about {_duration(remaining_s / max(1, len(self._begun)))} left"


class StudyBusy(InputError):
    """Another process is running this study."""


@dataclass(frozen=True)
class StudyOutcome:
    """Outcome of a run: plan, computed cases, and cases not computed because of --fail-fast or a lost executor."""

    folder: Path
    plan: tuple[Planned, ...]
    ended: tuple[CaseEnd, ...] = ()
    undone: tuple[str, ...] = ()
    given_up: tuple[str, ...] = ()  # uncomputed cases that the executor cancelled

    @property
    def reused(self) -> tuple[str, ...]:
        """Cases with valid records."""
        return tuple(planned.case_id for planned in self.plan if planned.why is None)

    @property
    def failed(self) -> tuple[CaseEnd, ...]:
        """Cases that failed in this run."""
        return tuple(end for end in self.ended if end.status == "FAILED")

    @property
    def exit_code(self) -> int:
        """Exit code: 0, or 3 if a case failed or was not computed."""
        return 3 if self.failed or self.undone else 0


@dataclass(frozen=True)
class Options:
    """Options of a run: worker processes (None: one per core) or an Executor; recompute all, fail fast, plan only."""

    jobs: int | None = None
    executor: Executor | None = None
    force: bool = False
    fail_fast: bool = False
    dry_run: bool = False


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
    made: set[str] = field(default_factory=set)  # parts of successful cases

    def __post_init__(self) -> None:
        self.why = {item.case_id: item.why for item in self.planned}
        self.waiting = [job for job in self.jobs if self.why[job.case_id] is not None]
        self.unsaid = ""  # reason for a missing line of the journal
        count = len(self.jobs)
        at_once = count if self.options.executor else default_jobs(count)  # a cluster has its own queue
        self.workers = self.options.jobs or max(1, at_once)

    def go(self) -> StudyOutcome:
        self.progress.begin(self.folder, self.planned, known_seconds(self.folder, self.jobs))
        self._note("run", cases=len(self.planned), to_compute=len(self.waiting), pid=os.getpid())
        executor = self.options.executor
        if self.waiting and not executor:  # as many threads each as before, so that a resumed run repeats its numbers
            executor = workers.LocalWorkers(self.workers, max(1, default_jobs(1 << 30) // self.workers))
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
        """Return the next case, unless all workers are busy or memory is short; a single case always runs."""
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
        """Return the waiting cases, those last whose shared parts a running case is computing."""
        at_work = {job.parts for job in self.running.values()} - self.made - {""}
        return sorted(self.waiting, key=lambda job: job.parts in at_work)

    def _submit(self, executor: Executor, job: Job) -> None:
        self._note("started", case=job.case_id, why=self.why[job.case_id])
        self.progress.case_started(job.case_id)
        bare = replace(job, forecaster=Forecast)  # a worker does not need the forecaster
        task = executor.submit(run_case, self.compute, bare, self.folder, store.current_fingerprint())
        self.running[task] = job

    def _collect(self, future: Future[CaseEnd]) -> None:
        job = self.running.pop(future)
        try:
            end = future.result()
        except CancelledError as error:  # not cancelled by us: the executor gave up the case
            if store.why_recompute(self.folder / job.case_id, job.payload, store.current_fingerprint()) is not None:
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
        """Close the log of an unfinished case."""
        folder = self.folder / job.case_id
        store.sweep_leftovers(folder)
        if (folder / store.RUN_LOG).exists() and not (folder / store.RECORD).exists():
            close_abandoned(folder / store.RUN_LOG, "INTERRUPTED", text)


def note(folder: Path, event: str, **fields: Any) -> None:
    """Append a line to a study's journal, after closing one torn by a killed run."""
    entry = {"at": datetime.now(UTC).isoformat(timespec="seconds"), "event": event, **fields}
    with (folder / JOURNAL).open("ab+") as file:
        if file.tell():
            file.seek(-1, os.SEEK_END)
        begun = file.read() not in (b"", b"\n")
        file.write(b"\n" * begun + json.dumps(entry, ensure_ascii=False).encode() + b"\n")


def known_seconds(folder: Path, jobs: Sequence[Job]) -> dict[str, float]:
    """Return the earlier computing time of each case, s, for the estimate of the remaining time."""
    found = {}
    for job in jobs:
        with suppress(store.BadRecord, KeyError, TypeError):
            seconds = store.read_json(folder / job.case_id / store.TIMING)["seconds"]["total"]
            if isinstance(seconds, int | float) and 0.0 <= seconds < inf:
                found[job.case_id] = float(seconds)
    return found


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
                f"{folder}: another run of this study is in progress ({holder}); wait for it or stop it"
            ) from error
        os.ftruncate(descriptor, 0)
        os.pwrite(descriptor, f"process {os.getpid()}, since {datetime.now():%Y-%m-%d %H:%M:%S}\n".encode(), 0)
        yield
    finally:
        os.close(descriptor)


def run_study(
    jobs: Sequence[Job],
    compute: Compute,
    folder: Path,
    options: Options | None = None,
    progress: Progress | None = None,
    about: dict[str, Any] | None = None,
) -> StudyOutcome:
    """Compute the missing cases of a study, each in folder/<case id>; return the outcome.

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
    """Return which cases have to be computed, and why."""
    now = store.current_fingerprint()
    return tuple(
        Planned(job.case_id, "forced" if force else store.why_recompute(folder / job.case_id, job.payload, now))
        for job in jobs
    )


def _duration(seconds: float) -> str:
    if seconds < 90:
        return f"{max(1, round(seconds))} s"
    return f"{round(seconds / 60)} min" if seconds < 5400 else f"{seconds / 3600:.1f} h"


def _check_ids(jobs: Sequence[Job], folder: Path) -> None:
    seen: set[str] = set()
    for job in jobs:
        store.case_folder(folder, job.case_id)
        if job.case_id in seen:
            raise ValueError(f"two cases of this study have the id {job.case_id!r}")
        seen.add(job.case_id)
