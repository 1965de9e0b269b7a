"""The commands that work on a study: run it, rebuild its report."""

from __future__ import annotations

import logging
import sys
from argparse import Namespace
from collections.abc import Callable, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from pipeline import paths
from pipeline.batch.job import Job
from pipeline.batch.study_file import find_study, load_study
from pipeline.errors import InputError, NotAvailable

if TYPE_CHECKING:
    from pipeline.batch.runner import StudyOutcome


@dataclass(frozen=True)
class _Task:
    """A study of either kind: its cases, what computes one, what to write at the end."""

    name: str
    jobs: Callable[[], Sequence[Job]]
    computer: Callable[[], Any]
    about: dict[str, Any]
    conclude: Callable[[Path], Sequence[Path]]
    explain: Callable[[Job], str] = lambda job: ""


def _task(path_or_name: str, fields_too: bool = False) -> _Task:
    from pipeline.batch import script_study

    if script := script_study.load_script(find_study(path_or_name)):
        return _Task(
            script.name,
            lambda: script_study.jobs_of(script),
            lambda: script_study.computer(script),
            {"name": script.name, "script": script.script},
            lambda folder: script_study.conclude(script, folder),
        )
    study = load_study(path_or_name)

    def jobs() -> Sequence[Job]:
        from pipeline.batch import case_study

        return case_study.jobs_of(study, fields_too)

    def computer() -> Any:
        from pipeline.batch import case_study

        return case_study.computer(study)

    def explain(job: Job) -> str:
        from pipeline.case.model import load_case
        from pipeline.measures import registry

        case = load_case(study.case_path, job.payload["overrides"])
        return registry.plan_of(case, job.payload["measure"]).short()

    return _Task(study.name, jobs, computer, study.about, _table_and_report, explain)


def run(arguments: Namespace) -> int:
    """Run a batch study: plan it, compute what is missing, write the table and the report."""
    from pipeline.batch import runner
    from pipeline.batch.lock import StudyBusy
    from pipeline.batch.progress import Progress
    from pipeline.batch.runner import Options

    task = _task(arguments.study, arguments.save_all_fields)
    folder = paths.RESULTS / task.name
    jobs = task.jobs()
    options = Options(
        jobs=arguments.jobs,
        executor=_executor(arguments.scheduler),
        force=arguments.force,
        fail_fast=arguments.fail_fast,
        dry_run=arguments.dry_run,
    )
    try:
        progress = Progress(arguments.quiet)
        outcome = runner.run_study(jobs, task.computer(), folder, options, progress, task.about)
    except StudyBusy as error:
        raise InputError(str(error)) from error
    if arguments.dry_run:
        for planned, job in zip(outcome.plan, jobs, strict=True):
            print(f"{planned.case_id}: {'would run, ' + planned.why if planned.why else 'stands'}")
            if text := task.explain(job):
                print("  " + text.replace("\n", "\n  "))
        return 0
    _log_summary(task.conclude(folder), arguments.quiet)
    if outcome.given_up:
        print(f"antinode: {_lost(arguments.scheduler, outcome)}", file=sys.stderr)
    for end in outcome.failed:
        print(f"antinode: case {end.case_id} failed: {end.diagnosis}", file=sys.stderr)
    return outcome.exit_code


def _lost(address: str, outcome: StudyOutcome) -> str:
    total, lost = len(outcome.plan), len(outcome.given_up)
    return (
        f"--scheduler = {address}: the Dask scheduler was lost, or cancelled cases: {lost} of {total} were at work there. "
        f"The {total - len(outcome.undone)} finished ones are kept. Start a scheduler again and repeat the command, or leave "
        "--scheduler out to go on here: only what is missing is computed"
    )


def _table_and_report(folder: Path) -> Sequence[Path]:
    from pipeline.measures import registry
    from pipeline.report import page

    return [registry.write_table(folder), page.build(folder)]


def _log_summary(paths: Sequence[Path], quiet: bool) -> None:
    if not quiet:
        for path in paths:
            print(f"{'report' if path.suffix == '.html' else 'table '} {path}")


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
    for name in ("distributed", "distributed.client"):  # a lost scheduler is told in one line, not in its traceback
        logging.getLogger(name).setLevel(logging.CRITICAL)
    executor: Executor = client.get_executor()
    return executor


def report(arguments: Namespace) -> int:
    """Rebuild table, figures and page from the records; cases whose records cannot be trusted are named."""
    from pipeline.records.study import read_study

    task = _task(arguments.study)
    folder = paths.RESULTS / task.name
    if not (folder / "cases.json").exists():
        raise InputError(
            f"{arguments.study}: no results under {folder.name}; run it first: antinode run {arguments.study}"
        )
    _log_summary(task.conclude(folder), arguments.quiet)
    for case in read_study(folder).cases:
        if case.read_error:
            print(
                f"antinode: case {case.case_id} is not shown: {case.read_error}; run the study again", file=sys.stderr
            )
    return 0
