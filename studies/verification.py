"""docs/verification.md from the stored studies: `python -m studies.verification` after `make bench`.

Nothing here computes: the tables are those of results/extremes and results/accuracy, word for word, and that of tasks before
and after the work on speed, which `python -m studies.benchmarks.before_after --write` puts there.
"""

from __future__ import annotations

import re
import sys
from pathlib import Path

from pipeline.paths import RESULTS
from pipeline.plots import style
from pipeline.records.store import write_atomic

PAGE = Path(__file__).resolve().parents[1] / "docs" / "verification.md"
INTRODUCTION = """# Verification

Written by `python -m studies.verification` from what `make bench` stored; times and memory are those of the machine
that ran it (two cores). What is compared with exact solutions and published benchmarks is in `tests/verification/`,
one file a proof: Navier's plate in three dimensions and its families, the rods, the cantilever against Timoshenko,
Rayleigh-Lamb waves, NAFEMS FV32 and FV52, hexahedra against tetrahedra, assembled against whole plates, and faults
planted on purpose, each of which a proof must see.

![Cell, the pillars' bending at M: relative error against wall time and memory by every model](pictures/error-against-time.svg)

Circles are the meshes that `solve.accuracy` may choose, grey is the reference's own uncertainty; the other quantities have
pictures in the report of `antinode run accuracy`.

![Stated bar over true error of every frequency](pictures/error-bars.svg)

What every result says of its own error beside what it is truly off by, on scenes drawn at random:
[docs/error-bars.md](error-bars.md) has the parts and the scenes.
"""
FIGURE = PAGE.parent / "pictures" / "error-against-time.svg"
STORED = Path("accuracy") / style.PICTURES / "accuracy_bending_at_M.svg"


SPEED = "## Whole commands beside an earlier commit"


def with_speed(page: str, rows: dict[str, str], lead: str) -> str:
    """The page with the table of tasks, rows by task as Markdown after words and heading in `lead`; those given replace those
    that stand there. Rows beside other words, such as another commit, are dropped.
    """
    rest, _, section = page.partition(SPEED)
    section = section if lead in section else ""
    stood = {line.split("|")[1].strip(): line for line in section.splitlines() if line.startswith("| ")}
    kept = {task: line for task, line in stood.items() if task != "task"}
    return f"{rest.rstrip()}\n\n{SPEED}\n\n{lead}\n" + "\n".join((kept | rows).values()) + "\n"


def text(names: tuple[str, ...] = ("accuracy", "extremes")) -> str:
    """The page but for its pictures. Raises FileNotFoundError for a study that was not run."""
    return INTRODUCTION + "".join("\n" + _lowered((RESULTS / name / "report.md").read_text()) for name in names)


def _lowered(page: str) -> str:
    """Headings one level down, pictures left out: they are beside the stored report."""
    lines = [line for line in page.splitlines() if not line.startswith("![")]
    return re.sub(r"^(#+) ", r"#\1 ", "\n".join(lines), flags=re.MULTILINE).rstrip() + "\n"


def main() -> int:
    """Write the page, or say which study is missing."""
    try:
        _, speed, table = (PAGE.read_text() if PAGE.exists() else "").partition(SPEED)
        page, figure = text(), (RESULTS / STORED).read_bytes()
        write_atomic(FIGURE, figure)
        write_atomic(PAGE, (page + ("\n" if speed else "") + speed + table).encode())
    except FileNotFoundError as fault:
        print(f"{fault.filename}: not there; run `make bench` first", file=sys.stderr)
        return 2
    print(f"verification {PAGE}")
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
