"""The commands that work on a study: run it, rebuild its report."""

from __future__ import annotations

import sys
from argparse import Namespace
from concurrent.futures import Executor
from pathlib import Path

from pipeline import house
from pipeline.errors import InputFault, NotAvailable
from pipeline.study_file import load_study


def run(arguments: Namespace) -> int:
    """A batch study: plan, compute what is missing, write the table and the report."""
    from pipeline import runner, steps
    from pipeline.lock import StudyBusy
    from pipeline.progress import Progress
    from pipeline.runner import Options

    study = load_study(arguments.study)
    folder = house.RESULTS / study.name
    jobs = steps.jobs_of(study)
    options = Options(
        jobs=arguments.jobs,
        executor=_executor(arguments.scheduler),
        force=arguments.force,
        fail_fast=arguments.fail_fast,
        dry_run=arguments.dry_run,
    )
    try:
        about = {"name": study.name, "case": study.case_path.name, "measure": list(study.measure)}
        progress = Progress(arguments.quiet)
        outcome = runner.run_study(jobs, steps.computer(study), folder, options, progress, about)
    except StudyBusy as fault:
        raise InputFault(str(fault)) from fault
    if arguments.dry_run:
        for planned in outcome.plan:
            print(f"{planned.case_id}: {'would run, ' + planned.why if planned.why else 'stands'}")
        return 0
    _conclude(folder, arguments.quiet)
    for end in outcome.failed:
        print(f"antinode: case {end.case_id} failed: {end.diagnosis}", file=sys.stderr)
    return outcome.exit_code


def _conclude(folder: Path, quiet: bool) -> None:
    from pipeline import report, tables

    table = tables.write_table(folder)
    page = report.build(folder)
    if not quiet:
        print(f"table  {table}\nreport {page}")


def _executor(address: str | None) -> Executor | None:
    if not address:
        return None
    try:
        from distributed import Client
    except ModuleNotFoundError as fault:
        raise NotAvailable("--scheduler needs the package distributed: pip install 'antinode[cluster]'") from fault
    try:
        client = Client(address, timeout="10s")
    except (OSError, TimeoutError, ValueError) as fault:
        raise InputFault(f"--scheduler = {address}: no Dask scheduler answers there ({fault})") from fault
    executor: Executor = client.get_executor()
    return executor


def report(arguments: Namespace) -> int:
    """Rebuild table, pictures and page from what is stored."""
    if arguments.study in ("accuracy", "extremes"):
        raise NotAvailable(f"report {arguments.study} is not part of this version yet; `make bench` comes with it")
    folder = house.RESULTS / load_study(arguments.study).name
    if not (folder / "cases.json").exists():
        raise InputFault(
            f"{arguments.study}: no results under {folder.name}; run it first: antinode run {arguments.study}"
        )
    _conclude(folder, arguments.quiet)
    return 0
