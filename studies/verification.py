"""docs/verification.md from the stored studies: `python -m studies.verification` after `make bench`.

Nothing is computed here. The tables come from results/extremes and results/accuracy, without those of single models and
cases. `python -m studies.benchmarks.before_after --write` adds the times of whole commands.
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

Written by `python -m studies.verification` from the results of `make bench` (most of an hour), with the times and
memory of a machine with two cores. `tests/verification/` compares Antinode with exact solutions and published
benchmarks, one file per test: Navier's plate in three dimensions and its families, rods, the cantilever against
Timoshenko's theory, Rayleigh-Lamb waves, NAFEMS FV32 and FV52, hexahedra against tetrahedra, and assembled against
whole plates. Faults planted on purpose must make them fail.

![Cell, the pillars' bending at M: relative error against wall time and memory by every model](pictures/error-against-time.svg)

Circles are the meshes that `solve.accuracy` may choose; grey is the uncertainty of the reference. The report of
`antinode run accuracy` has these pictures and a table of all models for every quantity, that of `antinode run
extremes` every case.

![Error bar over true error of every frequency](pictures/error-bars.svg)

[Error bars against true errors](error-bars.md) tests the error bars on random scenes.
"""
FIGURE = PAGE.parent / "pictures" / "error-against-time.svg"
STORED = Path("accuracy") / style.PICTURES / "accuracy_bending_at_M.svg"
SINGLE = r"\| (model|case) \| (dofs|confinement)"  # the tables of single models and cases
SPEED = "## Whole commands compared with an earlier commit"


def with_speed(page: str, rows: dict[str, str], lead: str) -> str:
    """Update the page's table of tasks: `rows` maps a task to its Markdown row, `lead` holds the words and the heading.

    Other rows of the page are kept if they follow the same `lead`; those of another commit are dropped.
    """
    rest, _, section = page.partition(SPEED)
    section = section if lead in section else ""
    stood = {line.split("|")[1].strip(): line for line in section.splitlines() if line.startswith("| ")}
    kept = {task: line for task, line in stood.items() if task != "task"}
    return f"{rest.rstrip()}\n\n{SPEED}\n\n{lead}\n" + "\n".join((kept | rows).values()) + "\n"


def text(names: tuple[str, ...] = ("accuracy", "extremes")) -> str:
    """The page but for its pictures. Raises FileNotFoundError for a study that was not run."""
    return INTRODUCTION + "".join("\n" + shortened((RESULTS / name / "report.md").read_text(), "#") for name in names)


def shortened(page: str, deeper: str = "") -> str:
    """A report without pictures and without the tables of single models and cases; headings move `deeper`."""
    lines = [line for line in page.splitlines() if not line.startswith("![")]
    sections = re.split(r"^(?=#+ )", "\n".join(lines), flags=re.MULTILINE)
    kept = [each for each in sections if not re.search(SINGLE, each)]
    return "".join(re.sub("^#", f"{deeper}#", each) for each in kept).rstrip() + "\n"


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
