"""Share of small faults that the tests notice: `python -m studies.mutants --folders solvers geometry --count 300`.

The tests run once in a copy of the sources, with this module as a plugin of pytest, to record the lines that each of them runs:
COVERING holds folder and file. Then each fault is planted alone, and only tests that run its lines are run, the quickest first.
A fault is a sign, a factor, an index, a comparison, a dropped term, a guard or a tolerance.
"""

from __future__ import annotations

import argparse
import ast
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
from dataclasses import dataclass
from pathlib import Path
from types import FrameType
from typing import Any

import pytest

from pipeline.paths import ROOT

FOLDERS = ("solvers", "geometry", "pipeline/records", "pipeline/case")
# of a run of tests: its start, and its time over that of the same tests without a fault
START_S, PATIENCE = 120.0, 10.0
KILLED, SURVIVED, UNSEEN = "killed", "SURVIVED", "no test runs it"

Tests = dict[str, dict[str, Any]]

TRACED, TARGET = os.environ.get("COVERING", os.pathsep).split(os.pathsep)
_lines: dict[str, set[int]] = defaultdict(set)
_known: Tests = {}

OPPOSITE: dict[type[ast.AST], type[ast.AST]] = {
    ast.Add: ast.Sub,
    ast.Sub: ast.Add,
    ast.Lt: ast.LtE,
    ast.LtE: ast.Lt,
    ast.Gt: ast.GtE,
    ast.GtE: ast.Gt,
    ast.Eq: ast.NotEq,
    ast.NotEq: ast.Eq,
}
FACTOR, LOOSER = 2, 1000
SMALL = 1e-3  # a constant of a module below it is a tolerance


@dataclass(frozen=True)
class Fault:
    """One change of a file, relative to the checkout: its span in characters, both texts, and the lines that run it."""

    path: str
    kind: str
    span: tuple[int, int]
    before: str
    after: str
    lines: tuple[int, ...]

    def planted(self, text: str) -> str:
        """The source with the fault."""
        return text[: self.span[0]] + self.after + text[self.span[1] :]

    def __str__(self) -> str:
        """Where it is, and both texts in one line."""
        before, after = (" ".join(text.split()) for text in (self.before, self.after))
        return f"{self.path}:{self.lines[0]}: {self.kind}: {before} -> {after}"


def faults(path: str, text: str) -> Iterator[Fault]:
    """Every fault that can be planted in a source, in no particular order."""
    tree = ast.parse(text)
    starts = [0]
    for line in text.splitlines(keepends=True):
        starts.append(starts[-1] + len(line))
    rows = text.splitlines()

    def span(node: ast.expr) -> tuple[int, int]:
        ends = (node.lineno, node.col_offset), (node.end_lineno or 0, node.end_col_offset or 0)
        first, last = (starts[n - 1] + len(rows[n - 1].encode()[:column].decode()) for n, column in ends)
        return first, last

    for node, kind, changed, lines in _changes(tree):
        at = span(node)
        yield Fault(path, kind, at, text[slice(*at)], f"({ast.unparse(changed)})", lines)


def _changes(tree: ast.Module) -> Iterator[tuple[ast.expr, str, ast.expr, tuple[int, ...]]]:
    """Nodes, what is wrong with each, the wrong node, and lines that run it."""
    functions = [node for node in ast.walk(tree) if isinstance(node, ast.FunctionDef)]
    inside = {part: None for function in functions for part in ast.walk(function) if isinstance(part, ast.stmt)}
    for statement in inside:
        if not isinstance(statement, ast.FunctionDef | ast.ClassDef):
            for node in _running(statement):
                whole = node if hasattr(statement, "body") else statement
                for kind, changed in _wrong(node):
                    yield node, kind, changed, tuple(range(whole.lineno, (whole.end_lineno or 0) + 1))
    for statement in tree.body:
        value = getattr(statement, "value", None)
        if isinstance(statement, ast.Assign) and isinstance(value, ast.Constant) and isinstance(value.value, float):
            name, own = getattr(statement.targets[0], "id", ""), statement.lineno
            uses = {n.lineno for n in ast.walk(tree) if isinstance(n, ast.Name) and n.id == name} - {own}
            kind, factor = ("tolerance", LOOSER) if 0.0 < abs(value.value) < SMALL else ("factor", FACTOR)
            yield value, kind, ast.Constant(value.value * factor), tuple(sorted(uses)) or (own,)


def _running(node: ast.AST) -> Iterator[ast.expr]:
    """Expressions of a statement itself, without annotations and texts."""
    if isinstance(node, ast.JoinedStr):
        return
    if isinstance(node, ast.expr):
        yield node
    for name, value in ast.iter_fields(node):
        if name != "annotation":
            for child in value if isinstance(value, list) else [value]:
                if isinstance(child, ast.AST) and not isinstance(child, ast.stmt | ast.excepthandler):
                    yield from _running(child)


def _wrong(node: ast.AST) -> Iterator[tuple[str, ast.expr]]:
    """Wrong forms of an expression."""
    if isinstance(node, ast.BinOp) and not isinstance(node.left, ast.Constant | ast.JoinedStr):
        if isinstance(node.op, ast.Add | ast.Sub):
            yield "sign", ast.BinOp(node.left, OPPOSITE[type(node.op)](), node.right)  # type: ignore[arg-type]
            yield "dropped term", node.left
        elif isinstance(node.op, ast.Mult):
            yield "dropped factor", node.left
        elif isinstance(node.op, ast.Pow):
            yield "dropped power", node.left
    if isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.USub) and not isinstance(node.operand, ast.Constant):
        yield "sign", node.operand
    if isinstance(node, ast.Constant) and type(node.value) is float and node.value not in (0.0, float("inf")):
        yield "factor", ast.Constant(node.value * FACTOR)
    if isinstance(node, ast.Subscript) and isinstance(node.slice, ast.Constant) and type(node.slice.value) is int:
        yield "index", ast.Subscript(node.value, ast.Constant(node.slice.value + 1), node.ctx)
    if isinstance(node, ast.Compare) and type(node.ops[0]) in OPPOSITE:
        operators = [OPPOSITE[type(node.ops[0])](), *node.ops[1:]]
        yield "comparison", ast.Compare(node.left, operators, node.comparators)  # type: ignore[arg-type]
    if isinstance(node, ast.BoolOp):
        yield "guard", node.values[0]


def of_folder(root: Path, folder: str) -> list[Fault]:
    """Every fault that can be planted in a folder below the checkout, or in a file, by file."""
    base = root / folder
    found = [base] if base.is_file() else base.rglob("*.py")
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


def run_pytest(folder: Path, words: list[str], seconds: float | None = None, **more: str) -> int:
    """The exit code of pytest on a copy; beyond a limit in seconds, that of failed tests."""
    environment = {**os.environ, "PYTHONPATH": str(folder), "PYTHONDONTWRITEBYTECODE": "1", **more}
    command = [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", *words]
    try:
        return subprocess.run(command, cwd=folder, env=environment, timeout=seconds, capture_output=True).returncode
    except subprocess.TimeoutExpired:
        return 1


def recorded(folder: Path, tests: list[str]) -> Tests:
    """Tests that pass without a fault, with the seconds and the lines of each."""
    target = folder / "covering.json"
    code = run_pytest(folder, ["-p", "studies.mutants", *tests], COVERING=f"{folder}{os.pathsep}{target}")
    if not target.is_file():
        raise SystemExit(f"the tests ended with exit code {code} before any was recorded")
    known: Tests = json.loads(target.read_text())
    return known


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
    """KILLED, SURVIVED or UNSEEN: a fault planted in the copy, judged by its tests, and mended again."""
    names = chosen_tests(fault, known, most_s)
    if not names:
        return UNSEEN
    path, limit = folder / fault.path, START_S + PATIENCE * sum(known[name]["seconds"] for name in names)
    whole = path.read_text(encoding="utf-8")
    path.write_text(fault.planted(whole), encoding="utf-8")
    try:
        return SURVIVED if run_pytest(folder, ["-x", *names], limit) == 0 else KILLED
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
