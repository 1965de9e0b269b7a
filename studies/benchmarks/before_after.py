"""The commands a designer waits for, compared with an earlier commit: processor and wall seconds, by kind of work.

    python -m studies.benchmarks.before_after [--commit COMMIT] [--repeats N] [--write] [TASK ...]

The commit's files are put into a temporary folder and run there, in alternation with this checkout, each run with a results
folder of its own, so that nothing comes from a cache. `main job` is `antinode run rows`, `grid` the study of 54 plates: they
take minutes, the other tasks seconds, which are run unless tasks are named; `response, nine patches` wants a later --commit.
Processor seconds are those of all processes a command starts, wall seconds those until it ends, memory that of the largest
process, each the median of the repeats. --write puts seconds and memory into docs/verification.md.
"""

from __future__ import annotations

import argparse
import io
import pstats
import shutil
import subprocess
import tarfile
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from statistics import median

from pipeline.paths import ROOT
from pipeline.records.store import write_atomic
from studies import verification
from studies.benchmarks import ran

COMMIT = "73e5629"
CASE = "studies/three-rows.toml"
TASKS: dict[str, tuple[str, ...]] = {
    "start": ("modes", CASE, "--explain"),
    "zone, 14 modes at 0.003": ("modes", CASE, "--part", "zone", "--count", "14"),
    "four classes, 30 to 34 kHz": ("modes", CASE, "--band", "30kHz:34kHz"),
    "bands": ("bands", CASE),
    "response": ("response", CASE),
    "response, nine patches": ("response", "studies/touch-plate.toml", "--band", "30kHz:40kHz"),
    "main job": ("run", "rows", "--jobs", "2"),
    "grid": ("run", "grid", "--jobs", "2"),
}
LONG = ("main job", "grid")
LATER = ("response, nine patches",)  # the default commit has no such case
LEAD = """\
Written by `python -m studies.benchmarks.before_after --write`: processor seconds of whole commands with an empty cache, at
commit {commit} and now, one run each, and the memory of the largest process. The command also prints wall seconds and the
shares of factorisation, solves and other work."""
# by the name of a function, or of its file
SHARES = {
    "factorisation": ("method 'factor' of 'rslab", "analyze_ldlt", "lower_triangle", "splu", "gstrf"),
    "solves": ("'solve_many' of", "method 'solve' of 'rslab", "method 'solve' of 'SuperLU"),
    "orthogonalisation": ("block_lanczos.py", "linalg.py:qr", "eigh"),
    "products": ("matvecs", "matvec}", "csr_matmat"),
}


@contextmanager
def checkout(commit: str) -> Iterator[Path]:
    """A commit's files, with the examples of this one; CalledProcessError outside a repository or without such a commit."""
    packed = subprocess.run(["git", "archive", commit], cwd=ROOT, capture_output=True, check=True).stdout
    with tempfile.TemporaryDirectory(prefix="antinode-before-") as folder:
        with tarfile.open(fileobj=io.BytesIO(packed)) as archive:
            archive.extractall(folder, filter="data")
        shutil.copytree(ROOT / "examples", Path(folder) / "examples", dirs_exist_ok=True)  # theirs may have other names
        yield Path(folder)


def shares(command: tuple[str, ...]) -> dict[str, float]:
    """Share of a command's time by what was done, in one thread under the profiler; `rest` is Python and all else."""
    with tempfile.NamedTemporaryFile(suffix=".prof") as profile:
        ran("-m", "cProfile", "-o", profile.name, "-m", "antinode", *command, environment={"ANTINODE_THREADS": "1"})
        entries = pstats.Stats(profile.name).stats.items()  # type: ignore[attr-defined]
    spent = dict.fromkeys((*SHARES, "rest"), 0.0)
    for (file, _, function), (_, _, own, *_) in entries:
        called = f"{Path(file).name}:{function}"
        kind = next((kind for kind, marks in SHARES.items() if any(mark in called for mark in marks)), "rest")
        spent[kind] += own
    total = sum(spent.values())
    return {name: part / total for name, part in spent.items()}


def _head(columns: tuple[str, ...]) -> str:
    """The head of a Markdown table."""
    return f"| {' | '.join(columns)} |\n|{'---|' * len(columns)}"


def _beside(before: float, after: float) -> tuple[str, str, str]:
    """Two times and their ratio."""
    return f"{before:.2f}", f"{after:.2f}", f"{after / before:.2f}"


def main(arguments: list[str] | None = None) -> None:
    """Print a Markdown table with one line per task."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--commit", default=COMMIT)
    parser.add_argument("--repeats", type=int, default=2)
    parser.add_argument("--write", action="store_true", help="put the rows into docs/verification.md")
    parser.add_argument("tasks", nargs="*", metavar="TASK", help=", ".join(TASKS))
    given = parser.parse_args(arguments)
    if unknown := set(given.tasks) - TASKS.keys():
        parser.error(f"unknown task {', '.join(sorted(unknown))}: must be of {', '.join(TASKS)}")
    columns = ("task", "before, s", "after, s", "ratio", "peak, MB")
    rows: dict[str, str] = {}
    more = (*(f"{name}, %" for name in (*SHARES, "rest")), "wall before, s", "wall after, s", "wall ratio")
    print(_head((*columns, *more)), flush=True)
    with checkout(given.commit) as earlier:
        for name in given.tasks or [each for each in TASKS if each not in LONG + LATER]:
            pairs = [
                [ran("-m", "antinode", *TASKS[name], root=root) for root in (earlier, ROOT)]
                for _ in range(given.repeats)
            ]
            seconds, wall, peak = (
                [median(getattr(each, figure) for each in side) for side in zip(*pairs, strict=True)]
                for figure in ("seconds", "wall", "peak_bytes")
            )
            spent = [f"{100 * part:.0f}" for part in shares(TASKS[name]).values()] if name not in LONG else []
            spent = spent or ["-"] * (len(SHARES) + 1)
            memory = f"{peak[1] / 1e6:.0f}"
            rows[name] = f"| {' | '.join((name, *_beside(*seconds), memory))} |"
            print(rows[name], " | ".join((*spent, *_beside(*wall))), "|", flush=True)
    if given.write:
        lead = f"{LEAD.format(commit=given.commit)}\n\n{_head(columns)}"
        write_atomic(verification.PAGE, verification.with_speed(verification.PAGE.read_text(), rows, lead).encode())


if __name__ == "__main__":
    main()
