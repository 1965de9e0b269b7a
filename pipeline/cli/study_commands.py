"""Commands that work on a study: run it, rebuild its report, show it."""

from __future__ import annotations

import logging
import sys
import webbrowser
from argparse import Namespace
from collections.abc import Sequence
from concurrent.futures import Executor
from pathlib import Path
from typing import TYPE_CHECKING, Any

from pipeline.batch import study_file
from pipeline.batch.study_file import find_study, load_study
from pipeline.errors import InputError, NotAvailable
from pipeline.logs import TerminalLog
from pipeline.planning.resources import in_time
from pipeline.quantity import several

FEW_CASES, MANY_CASES = 5, 20  # most cases of which a dry run prints every plan; most that it lists
WORDS = {"explorer.html": "explorer"}  # label of a written file other than report or table

if TYPE_CHECKING:
    from pipeline.batch.job import Job
    from pipeline.batch.runner import StudyOutcome


def _study(path_or_name: str) -> tuple[Any, Any]:
    """Return the study and the module for its kind; both kinds offer the same functions."""
    from pipeline.batch import script_study

    if script := script_study.load_script(find_study(path_or_name)):
        return script_study, script
    study = load_study(path_or_name)
    from pipeline.batch import case_study  # only once the file has been validated: this loads the solvers

    return case_study, study


def run(arguments: Namespace) -> int:
    """Run a batch study: plan it, compute what is missing, write the table and the report."""
    from pipeline.batch import runner
    from pipeline.batch.runner import Options, Progress

    kind, study = _study(arguments.study)
    folder = study_file.folder_of(study.name, study.source, arguments.results)
    jobs = kind.jobs_of(study, arguments.save_all_fields)
    options = Options(
        jobs=arguments.jobs,
        executor=_executor(arguments.scheduler),
        force=arguments.force,
        fail_fast=arguments.fail_fast,
        dry_run=arguments.dry_run,
    )
    progress = Progress(arguments.quiet)
    outcome = runner.run_study(jobs, kind.computer(study), folder, options, progress, study.about)
    if arguments.dry_run:
        waiting = [job for planned, job in zip(outcome.plan, jobs, strict=True) if planned.why]
        for number, _ in enumerate(job.forecast for job in waiting):  # each may solve a coarse cell
            progress.planned(number + 1, len(waiting))
        progress.end()
        _print_plan(outcome, jobs, arguments.verbose)
        return 0
    if warning := study_file.remember_place(study.name, study.source, folder):
        print(f"antinode: warning: {warning}", file=sys.stderr)
    _log_summary(kind.conclude(study, folder), arguments.quiet)
    _log_without_effect(folder)
    if arguments.explorer and not outcome.failed:
        _log_summary(kind.explored(study, folder, TerminalLog(arguments.quiet)), arguments.quiet)
    if outcome.given_up:
        print(f"antinode: {_lost(arguments.scheduler, outcome)}", file=sys.stderr)
    for end in outcome.failed:
        print(f"antinode: case {end.case_id} failed: {end.diagnosis}", file=sys.stderr)
    return outcome.exit_code


def _print_plan(outcome: StudyOutcome, jobs: Sequence[Job], all_plans: bool) -> None:
    """Print what each case would do, the plan of a few or of the most demanding one, and the sum of their times."""
    shown = len(jobs) if all_plans or len(jobs) <= FEW_CASES else 0
    listed = len(jobs) if shown else MANY_CASES
    for planned, job in list(zip(outcome.plan, jobs, strict=True))[:listed]:
        print(f"{planned.case_id}: {'would run, ' + planned.why if planned.why else 'up to date'}")
        if shown and job.forecast.plan:
            print("  " + job.forecast.plan.replace("\n", "\n  "))
    if len(jobs) > listed:
        print(f"and {len(jobs) - listed} more (--verbose lists every case with its plan)")
    waiting = [job for planned, job in zip(outcome.plan, jobs, strict=True) if planned.why]
    if not waiting:
        return
    most = max(waiting, key=lambda job: (job.forecast.memory_bytes, job.forecast.seconds))
    if not shown and most.forecast.plan:
        print(f"most memory: {most.case_id}\n  " + most.forecast.plan.replace("\n", "\n  "))
    seconds = sum(job.forecast.seconds for job in waiting)
    total = f", roughly {in_time(seconds)} in all if computed one after the other" if seconds else ""
    print(f"{len(waiting)} of {several(len(jobs), 'case')} would run{total}")


def _lost(address: str, outcome: StudyOutcome) -> str:
    total, lost = len(outcome.plan), len(outcome.given_up)
    return (
        f"--scheduler = {address}: the Dask scheduler was lost or cancelled cases: {lost} of {total} were running "
        f"there. The {total - len(outcome.undone)} finished ones are kept. Restart the scheduler and repeat the "
        "command, or leave out --scheduler to continue on this machine: only missing cases are computed"
    )


def _log_summary(paths: Sequence[Path], quiet: bool) -> None:
    if not quiet:
        for path in paths:
            word = WORDS.get(path.name, "report" if path.suffix == ".html" else "table")
            print(f"{word:6} {path}")


def _log_without_effect(folder: Path) -> None:
    """Yield a line for each swept key that changes no result."""
    from pipeline.questions import study as asked
    from pipeline.records.study import read_study
    from pipeline.records.tables import without_effect

    study = read_study(folder)
    for key in without_effect(study, asked.columns_of(study)):
        print(f"antinode: {key} does not affect this study: none of its measures depends on it", file=sys.stderr)


def _executor(address: str | None) -> Executor | None:
    if not address:
        return None
    try:
        from distributed import Client
    except ModuleNotFoundError as error:
        raise NotAvailable("--scheduler needs the package distributed: pip install 'antinode[cluster]'") from error
    try:
        client = Client(address, timeout="10s")
    except (OSError, TimeoutError, ValueError) as error:
        raise InputError(f"--scheduler = {address}: no Dask scheduler answers there ({error})") from error
    for name in ("distributed", "distributed.client"):  # a lost scheduler is reported in one line, without a traceback
        logging.getLogger(name).setLevel(logging.CRITICAL)
    executor: Executor = client.get_executor()
    return executor


def _stored(arguments: Namespace) -> tuple[Any, Any, Path]:
    """Return a study's kind, the study and its results folder. Raises InputError when nothing is stored."""
    kind, study = _study(arguments.study)
    folder = study_file.stored_folder(study.name, study.source, arguments.results)
    if not (folder / "cases.json").exists():
        raise InputError(f"{arguments.study}: no results under {folder}; run it first: antinode run {arguments.study}")
    return kind, study, folder


def report(arguments: Namespace) -> int:
    """Rebuild table, figures and page from the records; list cases with damaged records."""
    from pipeline.records.study import read_study

    kind, study, folder = _stored(arguments)
    _log_summary(kind.conclude(study, folder, arguments.all_pictures), arguments.quiet)
    if arguments.open:
        webbrowser.open((folder / "report.html").resolve().as_uri())
    for case in read_study(folder).cases:
        if case.read_error:
            print(
                f"antinode: case {case.case_id} is not shown: {case.read_error}; run the study again", file=sys.stderr
            )
    return 0


def show(arguments: Namespace) -> int:
    """Print the result of a stored study, its facts and the main columns of its table."""
    from pipeline.questions import study as asked
    from pipeline.questions.command import Answer, emit
    from pipeline.records.outputs import table
    from pipeline.records.study import read_study
    from pipeline.report import text

    folder = _stored(arguments)[2]
    study = read_study(folder)
    columns = [column for column in asked.columns_of(study) if column.is_main]
    head = [f"{column.heading} ({column.shown_unit})" if column.shown_unit else column.heading for column in columns]
    rows = [[column.shown(case.record) or None for column in columns] for case in study.cases]
    lead = [
        *filter(None, [text.headline(study)]),
        "; ".join(text.facts_of(study)),
        f"report {folder / 'report.html'}",
        "",
    ]
    document = {
        "study": study.name,
        "folder": str(folder),
        "cases": [dict(zip(head, row, strict=True)) for row in rows],
    }
    return emit(arguments, "show", Answer(document, [*lead, table(head, rows)], head, rows))
