"""Share of small faults that the tests notice: `python -m studies.mutants --folders solvers geometry --count 300`.

The tests run once in a copy of the sources, with this module as a plugin of pytest, to record the lines that each of them runs:
COVERING holds folder and file. Then each fault is planted alone, and only tests that run its lines are run, the quickest first.
studies/faults.py draws the faults. Those of the firmware's core (`--folders firmware/core`) are judged by whole files of tests,
whose lines gcov counts; those that do not compile are left out.
"""

from __future__ import annotations

import argparse
import gzip
import json
import os
import random
import shutil
import subprocess
import sys
import tempfile
import time
from collections import Counter, defaultdict
from collections.abc import Iterator
from math import inf
from pathlib import Path
from types import FrameType
from typing import Any

import pytest

from pipeline.paths import ROOT
from studies.faults import Fault, faults

FOLDERS = ("solvers", "geometry", "pipeline/records", "pipeline/case", "firmware/core")
# of a run of tests: its start, and its time over that of the same tests without a fault
START_S, PATIENCE = 120.0, 10.0
KILLED, SURVIVED, UNSEEN, NONE = "killed", "SURVIVED", "no test runs it", "does not compile"
COUNTING = {"ANTINODE_HOST_FLAGS": "--coverage -O0 -fprofile-update=single -UAN_CHECKED", "CC": "gcc"}

Tests = dict[str, dict[str, Any]]

TRACED, TARGET = os.environ.get("COVERING", os.pathsep).split(os.pathsep)
_lines: dict[str, set[int]] = defaultdict(set)
_known: Tests = {}


def of_folder(root: Path, folder: str) -> list[Fault]:
    """Every fault that can be planted in a folder below the checkout, or in a file, by file."""
    base = root / folder
    found = [base] if base.is_file() else [*base.rglob("*.py"), *base.rglob("*.c")]
    files = sorted(path for path in found if "build" not in path.relative_to(root).parts)
    return [fault for path in files for fault in faults(str(path.relative_to(root)), path.read_text(encoding="utf-8"))]


def _called(frame: FrameType, event: str, argument: object) -> Any:
    """Trace the lines of the folder's functions; other functions cost one call."""
    return _line if frame.f_code.co_filename.startswith(TRACED) else None


def _line(frame: FrameType, event: str, argument: object) -> Any:
    _lines[frame.f_code.co_filename].add(frame.f_lineno)
    return _line


@pytest.hookimpl(wrapper=True)
def pytest_runtest_protocol(item: pytest.Item) -> Iterator[None]:
    """Record what a test runs, its fixtures included: those shared by several tests count for the first of them."""
    _lines.clear()
    begin = time.process_time()
    sys.settrace(_called)
    try:
        return (yield)
    finally:
        sys.settrace(None)
        ran = {str(Path(name).relative_to(TRACED)): sorted(numbers) for name, numbers in _lines.items()}
        _known.setdefault(item.nodeid, {}).update(seconds=time.process_time() - begin, lines=ran)


def pytest_runtest_logreport(report: pytest.TestReport) -> None:
    """Leave out tests that fail without any fault planted."""
    if report.failed:
        _known.setdefault(report.nodeid, {})["failed"] = True


def pytest_sessionfinish() -> None:
    """Write what every test that passed runs."""
    Path(TARGET).write_text(json.dumps({name: each for name, each in _known.items() if "failed" not in each}))


def copied(target: Path) -> Path:
    """The files that git knows or would take, copied to a folder to create."""
    words = ["git", "-C", str(ROOT), "ls-files", "-z", "--cached", "--others", "--exclude-standard"]
    for name in filter(None, subprocess.run(words, check=True, capture_output=True, text=True).stdout.split("\0")):
        if (ROOT / name).is_file():
            (target / name).parent.mkdir(parents=True, exist_ok=True)
            shutil.copyfile(ROOT / name, target / name)
    return target


def run_pytest(folder: Path, words: list[str], more: dict[str, str], seconds: float | None = None) -> int:
    """The exit code of pytest on a copy, in an environment with more; beyond a limit in seconds, that of failed tests."""
    environment = {**os.environ, "PYTHONPATH": str(folder), "PYTHONDONTWRITEBYTECODE": "1", **more}
    command = [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", *words]
    try:
        return subprocess.run(command, cwd=folder, env=environment, timeout=seconds, capture_output=True).returncode
    except subprocess.TimeoutExpired:
        return 1


def recorded(folder: Path, tests: list[str]) -> Tests:
    """Tests that pass without a fault, with the seconds and the lines of each."""
    target = folder / "covering.json"
    code = run_pytest(folder, ["-p", "studies.mutants", *tests], {"COVERING": f"{folder}{os.pathsep}{target}"})
    if not target.is_file():
        raise SystemExit(f"the tests ended with exit code {code} before any was recorded")
    known: Tests = json.loads(target.read_text())
    return known


def gcov(folder: Path) -> Iterator[dict[str, Any]]:
    """What gcov says about each source with counters in a folder."""
    for counters in sorted(folder.rglob("*.gcda")):
        subprocess.run(["gcov", "-b", "-j", str(counters)], cwd=folder, capture_output=True, check=True)
    for packed in sorted(folder.glob("*.gcov.json.gz")):
        yield from json.loads(gzip.decompress(packed.read_bytes()))["files"]


def recorded_in_c(folder: Path, tests: list[str]) -> Tests:
    """Files of the firmware's tests that pass without a fault, with the seconds of each and the core's lines that it runs."""
    known: Tests = {}
    for path in sorted(path for name in tests for path in _of_firmware(folder / name)):
        with tempfile.TemporaryDirectory() as cache:
            begin = time.monotonic()
            if run_pytest(folder, [str(path)], {"XDG_CACHE_HOME": cache, **COUNTING}) == 0:
                lines: dict[str, list[int]] = {}
                for file in gcov(Path(cache)):
                    own = str(Path(file["file"]).relative_to(folder))
                    lines[own] = [each["line_number"] for each in file["lines"] if each["count"]]
                known[str(path.relative_to(folder))] = {"seconds": time.monotonic() - begin, "lines": lines}
    known = {name: each for name, each in known.items() if each["lines"]}
    if not known:
        raise SystemExit(f"--tests {' '.join(tests)}: none of the firmware's tests there runs the core")
    return known


def _of_firmware(path: Path) -> list[Path]:
    return [path] if path.is_file() else [each for each in path.rglob("test_*.py") if each.parent.name == "firmware"]


def compiles(folder: Path, cache: str) -> bool:
    """Whether the core of a copy is still a program; the tests find it in the cache."""
    words = [sys.executable, "-c", "from firmware.host import load; load()"]
    more = {**os.environ, "PYTHONPATH": str(folder), "XDG_CACHE_HOME": cache}
    return subprocess.run(words, cwd=folder, env=more, capture_output=True).returncode == 0


def chosen_tests(fault: Fault, known: Tests, most_s: float) -> list[str]:
    """Names of tests that run the lines of a fault, the quickest first, up to `most_s` in all, but one in any case."""
    lines, chosen, total = set(fault.lines), list[str](), 0.0
    for name in sorted(known, key=lambda each: known[each]["seconds"]):
        if lines.intersection(known[name]["lines"].get(fault.path, ())):
            total += known[name]["seconds"]
            if chosen and total > most_s:
                break
            chosen.append(name)
    return chosen


def judged(fault: Fault, folder: Path, known: Tests, most_s: float) -> str:
    """KILLED, SURVIVED, UNSEEN or NONE: a fault planted in the copy, judged by its tests, and mended again."""
    in_c = fault.path.endswith(".c")
    names = chosen_tests(fault, known, inf if in_c else most_s)
    if not names:
        return UNSEEN
    path, limit = folder / fault.path, START_S + PATIENCE * sum(known[name]["seconds"] for name in names)
    whole = path.read_text(encoding="utf-8")
    path.write_text(fault.planted(whole), encoding="utf-8")
    try:
        with tempfile.TemporaryDirectory() as cache:
            if in_c and not compiles(folder, cache):
                return NONE
            more = {"XDG_CACHE_HOME": cache} if in_c else {}
            return SURVIVED if run_pytest(folder, ["-x", *names], more, limit) == 0 else KILLED
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
    parser.add_argument(
        "--seconds", type=float, default=60.0, help="limit of the chosen tests' sum, without a fault; none in C"
    )
    given = parser.parse_args(arguments)
    every = {name: of_folder(ROOT, name) for name in given.folders}
    empty = [name for name, own in every.items() if not own]
    if empty:
        parser.error(f"--folders: no source with a fault to plant in {', '.join(empty)}")
    print(f"seed {given.seed}", flush=True)
    score: Counter[tuple[str, str]] = Counter()
    with tempfile.TemporaryDirectory() as temporary:
        folder = copied(Path(temporary) / "copy")
        known: Tests = {}
        for kind, record in ((".py", recorded), (".c", recorded_in_c)):
            if any(fault.path.endswith(kind) for own in every.values() for fault in own):
                known |= record(folder, given.tests)
        print(f"{len(known)} tests pass without a fault", flush=True)
        for name, own in every.items():
            for fault in random.Random(f"{given.seed} {name}").sample(own, min(given.count, len(own))):
                verdict = judged(fault, folder, known, given.seconds)
                score[place(fault.path), verdict] += 1
                print(f"{verdict:16s}{fault}", flush=True)
    for name in sorted({name for name, _ in score}):
        killed, survived, unseen = (score[name, verdict] for verdict in (KILLED, SURVIVED, UNSEEN))
        total = killed + survived + unseen or 1
        print(
            f"{name:20s}{killed:5d} of {total} killed ({killed / total:.0%}), {survived} survived, {unseen} run by no test"
        )
    return 0


if __name__ == "__main__":
    sys.exit(main())
