"""Share of small faults that the tests notice: `python -m studies.mutants --folders solvers geometry --count 300`.

The tests run once in a copy of the sources, to record the lines that each of them runs. Then each fault is planted alone, and
only tests that run its lines are run, the quickest first.
"""

from __future__ import annotations

import argparse
import json
import os
import random
import shutil
import subprocess
import sys
import tempfile
import time
from collections import Counter
from pathlib import Path
from typing import Any

from pipeline.paths import ROOT
from studies.faults import Fault, of_folder

FOLDERS = ("solvers", "geometry", "pipeline/records", "pipeline/case")
START_S, PATIENCE = (
    120.0,
    10.0,
)  # of a run of tests: its start, and its time over that of the same tests without a fault
KILLED, SURVIVED, UNSEEN = "killed", "SURVIVED", "no test runs it"

Tests = dict[str, dict[str, Any]]


def copied(target: Path) -> Path:
    """Copy the files that git knows or would take.

    Parameters
    ----------
    target : Path
        Folder to create.

    Returns
    -------
    Path
        The folder.
    """
    words = ["git", "-C", str(ROOT), "ls-files", "-z", "--cached", "--others", "--exclude-standard"]
    for name in filter(None, subprocess.run(words, check=True, capture_output=True, text=True).stdout.split("\0")):
        if (ROOT / name).is_file():
            (target / name).parent.mkdir(parents=True, exist_ok=True)
            shutil.copyfile(ROOT / name, target / name)
    return target


def pytest_run(folder: Path, words: list[str], seconds: float | None = None, **more: str) -> int:
    """Run pytest on a copy; returns its exit code.

    Parameters
    ----------
    folder : Path
        The copy.
    words : list of str
        Arguments.
    seconds : float, optional
        Longest run time; beyond it, the code is that of failed tests.
    **more : str
        Further environment variables.
    """
    environment = {**os.environ, "PYTHONPATH": str(folder), "PYTHONDONTWRITEBYTECODE": "1", **more}
    command = [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", *words]
    try:
        return subprocess.run(command, cwd=folder, env=environment, timeout=seconds, capture_output=True).returncode
    except subprocess.TimeoutExpired:
        return 1


def recorded(folder: Path, tests: list[str]) -> Tests:
    """Run tests without a fault, and return seconds and lines of those that pass.

    Parameters
    ----------
    folder : Path
        The copy.
    tests : list of str
        Paths of tests.
    """
    target = folder / "covering.json"
    code = pytest_run(folder, ["-p", "studies.covering", *tests], COVERING=f"{folder}{os.pathsep}{target}")
    if not target.is_file():
        raise SystemExit(f"the tests ended with exit code {code} before any was recorded")
    known: Tests = json.loads(target.read_text())
    return known


def covering(fault: Fault, known: Tests, most_s: float) -> list[str]:
    """Choose tests that run the lines of a fault, the quickest first.

    Parameters
    ----------
    fault : Fault
        Where it is.
    known : dict
        What `recorded` returned.
    most_s : float
        Limit of their sum, s; one test is chosen in any case.

    Returns
    -------
    list of str
        Names of tests.
    """
    lines, chosen, total = set(fault.lines), list[str](), 0.0
    for name in sorted(known, key=lambda each: known[each]["seconds"]):
        if lines.intersection(known[name]["lines"].get(fault.path, ())):
            total += known[name]["seconds"]
            if chosen and total > most_s:
                break
            chosen.append(name)
    return chosen


def judged(fault: Fault, folder: Path, known: Tests, most_s: float) -> str:
    """Plant a fault in the copy, run its tests, and mend it again.

    Parameters
    ----------
    fault : Fault
    folder : Path
        The copy.
    known : dict
        What `recorded` returned.
    most_s : float
        Limit of the sum of the tests' durations, s.

    Returns
    -------
    str
        KILLED, SURVIVED or UNSEEN.
    """
    names = covering(fault, known, most_s)
    if not names:
        return UNSEEN
    path, limit = folder / fault.path, START_S + PATIENCE * sum(known[name]["seconds"] for name in names)
    whole = path.read_text(encoding="utf-8")
    path.write_text(fault.planted(whole), encoding="utf-8")
    try:
        return SURVIVED if pytest_run(folder, ["-x", *names], limit) == 0 else KILLED
    finally:
        path.write_text(whole, encoding="utf-8")


def place(path: str) -> str:
    """Folder under which a file counts: two levels below `pipeline`, one below the others."""
    parts = path.split("/")
    return "/".join(parts[: 2 if parts[0] == "pipeline" else 1])


def main(arguments: list[str] | None = None) -> int:
    """The command line; returns the exit code."""
    parser = argparse.ArgumentParser(prog="python -m studies.mutants", description=__doc__)
    parser.add_argument("--folders", nargs="+", default=list(FOLDERS), help="folders or files of sources")
    parser.add_argument("--tests", nargs="+", default=["tests"], help="tests to choose from")
    parser.add_argument("--count", type=int, default=300, help="faults in each folder")
    parser.add_argument("--seed", type=int, default=int(time.time()), help="that draws them; printed")
    parser.add_argument("--seconds", type=float, default=60.0, help="limit of the chosen tests' sum, without a fault")
    given = parser.parse_args(arguments)
    empty = [name for name in given.folders if not of_folder(ROOT, name)]
    if empty:
        parser.error(f"--folders: no source with a fault to plant in {', '.join(empty)}")
    print(f"seed {given.seed}", flush=True)
    score: Counter[tuple[str, str]] = Counter()
    with tempfile.TemporaryDirectory() as temporary:
        folder = copied(Path(temporary) / "copy")
        known = recorded(folder, given.tests)
        print(f"{len(known)} tests pass without a fault", flush=True)
        for name in given.folders:
            every = of_folder(ROOT, name)
            for fault in random.Random(f"{given.seed} {name}").sample(every, min(given.count, len(every))):
                verdict = judged(fault, folder, known, given.seconds)
                score[place(fault.path), verdict] += 1
                print(f"{verdict:16s}{fault}", flush=True)
    for name in sorted({name for name, _ in score}):
        killed, survived, unseen = (score[name, verdict] for verdict in (KILLED, SURVIVED, UNSEEN))
        total = killed + survived + unseen
        print(
            f"{name:20s}{killed:5d} of {total} killed ({killed / total:.0%}), {survived} survived, {unseen} run by no test"
        )
    return 0


if __name__ == "__main__":
    sys.exit(main())
