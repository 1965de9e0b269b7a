"""The commands a designer waits for, beside an earlier commit of this repository: processor seconds, and where they go.

    python -m studies.benchmarks.before_after [--commit COMMIT] [--repeats N] [TASK ...]

The commit's files are put into a temporary folder and run there, in alternation with this checkout, each run with a results
folder of its own, so that nothing comes from a cache. `main job` is `antinode run rows` and takes minutes; the other tasks take
seconds and are run unless tasks are named. Seconds are those of all processes a command starts, least of the repeats.
"""

from __future__ import annotations

import argparse
import io
import os
import pstats
import resource
import subprocess
import sys
import tarfile
import tempfile
from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from pipeline.paths import ROOT

COMMIT = "73e5629"
CASE = "studies/three-rows.toml"
TASKS: dict[str, tuple[str, ...]] = {
    "start": ("modes", CASE, "--explain"),
    "zone, 14 modes at 0.003": ("modes", CASE, "--part", "zone", "--count", "14"),
    "four classes, 30 to 34 kHz": ("modes", CASE, "--band", "30kHz:34kHz"),
    "bands": ("bands", CASE),
    "response": ("response", CASE),
    "main job": ("run", "rows", "--jobs", "2"),
}
LONG = ("main job",)
# by the name of a function, or of its file
SHARES = {
    "factorisation": ("method 'factor' of 'rslab", "analyze_ldlt", "lower_triangle", "splu", "gstrf"),
    "solves": ("'solve_many' of", "method 'solve' of 'rslab", "method 'solve' of 'SuperLU"),
    "orthogonalisation": ("block_lanczos.py", "linalg.py:qr", "eigh"),
    "products": ("matvecs", "matvec}", "csr_matmat"),
}


@contextmanager
def checkout(commit: str) -> Iterator[Path]:
    """The files of a commit in a temporary folder. CalledProcessError where this is no repository or has no such commit."""
    packed = subprocess.run(["git", "archive", commit], cwd=ROOT, capture_output=True, check=True).stdout
    with tempfile.TemporaryDirectory(prefix="antinode-before-") as folder:
        with tarfile.open(fileobj=io.BytesIO(packed)) as archive:
            archive.extractall(folder, filter="data")
        yield Path(folder)


def _run(root: Path, *arguments: str, **more: str) -> None:
    """A command of the checkout at `root`, with an empty results folder. CalledProcessError with what it said."""
    with tempfile.TemporaryDirectory(prefix="antinode-results-") as results:
        own = {"PYTHONPATH": str(root), "ANTINODE_RESULTS": results, **more}
        subprocess.run(
            [sys.executable, *arguments], cwd=root, env=os.environ | own, capture_output=True, text=True, check=True
        )


def processor_seconds(root: Path, command: tuple[str, ...]) -> float:
    """Processor time of a command and of every process that it waited for, s."""
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    _run(root, "-m", "antinode", *command)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime


def shares(root: Path, command: tuple[str, ...]) -> dict[str, float]:
    """Share of a command's time by what was done, in one thread under the profiler; `rest` is Python and all else."""
    with tempfile.NamedTemporaryFile(suffix=".prof") as profile:
        _run(root, "-m", "cProfile", "-o", profile.name, "-m", "antinode", *command, ANTINODE_THREADS="1")
        entries = pstats.Stats(profile.name).stats.items()  # type: ignore[attr-defined]
    spent: Counter[str] = Counter()
    for (file, _, function), (_, _, own, *_) in entries:
        spent[_kind(f"{Path(file).name}:{function}")] += own
    total = sum(spent.values())
    return {name: spent[name] / total for name in (*SHARES, "rest")}


def _kind(function: str) -> str:
    return next((kind for kind, marks in SHARES.items() if any(mark in function for mark in marks)), "rest")


def main(arguments: list[str] | None = None) -> None:
    """One line of a Markdown table a task."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--commit", default=COMMIT)
    parser.add_argument("--repeats", type=int, default=2)
    parser.add_argument("tasks", nargs="*", metavar="TASK", help=", ".join(TASKS))
    given = parser.parse_args(arguments)
    if unknown := set(given.tasks) - TASKS.keys():
        parser.error(f"unknown task {', '.join(sorted(unknown))}: must be of {', '.join(TASKS)}")
    columns = ("task", "before, s", "after, s", "ratio", *(f"{name} after" for name in (*SHARES, "rest")))
    print(f"| {' | '.join(columns)} |\n|{'---|' * len(columns)}", flush=True)
    with checkout(given.commit) as earlier:
        for name in given.tasks or [each for each in TASKS if each not in LONG]:
            command, before, after = TASKS[name], float("inf"), float("inf")
            for _ in range(given.repeats):
                before = min(before, processor_seconds(earlier, command))
                after = min(after, processor_seconds(ROOT, command))
            spent = [] if name in LONG else [f"{100.0 * part:.0f} %" for part in shares(ROOT, command).values()]
            figures = (f"{before:.2f}", f"{after:.2f}", f"{after / before:.2f}", *spent)
            print(f"| {' | '.join((name, *figures))} |", flush=True)


if __name__ == "__main__":
    main()
