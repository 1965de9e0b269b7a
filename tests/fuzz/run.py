"""One input, many inputs, and the corpus of inputs that once failed."""

from __future__ import annotations

import hashlib
import random
import signal
import warnings
from collections import Counter
from collections.abc import Callable, Collection, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, NamedTuple, NoReturn

from firmware.client.client import BoardError
from firmware.mode_table import TableError
from geometry.errors import MeshFileError
from pipeline.errors import CommandError, one_line
from pipeline.records import store
from tests.fuzz import board, solves
from tests.fuzz.files import Files

CORPUS = Path(__file__).parent / "corpus"
MAX_DURATION_S = 10.0  # of processor time for one file: a hundred times what any takes
MAX_SOLVE_S = 300.0
SOLVES = 500  # files for each command that solves
SHARES = {
    "override": 20, "shape": 5, "number": 5, "case": 16, "study": 6, "quantity": 5, "sweep": 6, "field": 6, "universal": 2,
    "mesh": 8, "med": 5, "record_file": 3, "record": 6, "table": 4, "reply": 12,
}  # fmt: skip


class Kind(NamedTuple):
    """A kind of input."""

    draw: Callable[[random.Random], bytes]
    read: Callable[[bytes], Any]


class Failure(AssertionError):
    """An input that ended otherwise than in a result or one of the project's own faults."""


def kinds(folder: Path) -> dict[str, Kind]:
    """All kinds by name."""
    files = Files(folder)
    result = {
        name: Kind(getattr(files, f"draw_{name}"), getattr(files, f"read_{name}")) for name in SHARES if name != "reply"
    }
    result["reply"] = Kind(board.draw_reply, board.read_reply)
    result["solve"] = Kind(solves.draw_solve, solves.read_solve)
    return result


@contextmanager
def limited(seconds: float) -> Iterator[None]:
    """TimeoutError after these seconds of processor time."""

    def late(*_: object) -> NoReturn:
        raise TimeoutError(f"more than {seconds:g} s")

    before = signal.signal(signal.SIGPROF, late)
    signal.setitimer(signal.ITIMER_PROF, seconds)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_PROF, 0.0)
        signal.signal(signal.SIGPROF, before)


def outcome(kind: Kind, data: bytes) -> str:
    """What came of one input: "read" or "refused"; raises Failure for anything else."""
    try:
        with warnings.catch_warnings(), limited(MAX_SOLVE_S if kind.read is solves.read_solve else MAX_DURATION_S):
            warnings.simplefilter("ignore")  # of readers of other people's; what they lead to is what counts
            result = kind.read(data)
        return result if kind.read is solves.read_solve else "read"
    except CommandError as fault:
        if isinstance(fault, NotImplementedError) or not (fault.exit_code == 2 or isinstance(fault, store.StoreError)):
            raise Failure(f"{type(fault).__name__}, exit code {fault.exit_code}") from fault
        lines = list(fault.lines)
    except (MeshFileError, BoardError, TableError) as fault:  # their commands give them as one line
        lines = [one_line(" ".join(str(fault).split()))]
    except Exception as fault:
        raise Failure(f"{type(fault).__name__}: {fault}") from fault
    if not lines or not all(line.isprintable() and len(line) < 2200 for line in lines):
        raise Failure(f"no line, or none that can be read: {lines!r:.300}")
    return "refused"


def drawn(name: str, kind: Kind, seed: int) -> bytes:
    """The input of a seed."""
    return kind.draw(random.Random(f"{name} {seed}"))


def amounts(count: int) -> dict[str, int]:
    """How many inputs of each kind are drawn for a count of files."""
    total = sum(SHARES.values())
    return {name: -(-count * share // total) for name, share in SHARES.items()} | {"solve": count // SOLVES}


def run(
    folder: Path,
    count: int,
    seed: int,
    corpus: Path | None = None,
    tell: Callable[[str], object] = print,
    only: Collection[str] | None = None,
) -> dict[str, Counter[str]]:
    """Outcomes of each kind, or only of some; an input that fails is kept in the corpus, and told."""
    table, result = kinds(folder), {}
    for name, amount in amounts(count).items():
        if only is not None and name not in only:
            continue
        result[name] = Counter[str]()
        for one in range(seed, seed + amount):
            data = drawn(name, table[name], one)
            try:
                result[name][outcome(table[name], data)] += 1
            except Failure as failure:
                result[name]["failed"] += 1
                tell(f"{name}, seed {one}: {failure!s:.400}" + (f"; {keep(corpus, name, data)}" if corpus else ""))
    return result


def keep(corpus: Path, name: str, data: bytes) -> Path:
    """Write an input into the corpus."""
    path = corpus / name / hashlib.sha256(data).hexdigest()[:12]
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(data)
    return path
