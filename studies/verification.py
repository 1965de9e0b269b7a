"""docs/verification.md from the stored studies: `python -m studies.verification` after `make bench`.

Nothing is computed here. The tables come from results/extremes and results/accuracy, without those of single models and
cases. Those of the planner's meshes and of the references become files of results/reference. `python -m
studies.benchmarks.before_after --write` adds the times of whole commands.
"""

from __future__ import annotations

import csv
import io
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
`antinode run accuracy` has these pictures, a table of all models for every quantity, and the references with their
method. That of `antinode run extremes` has every case, and the errors of each element near Poisson's ratio 1/2, where
displacement elements lock, low orders first. `results/reference/accuracy-meshes.csv` gives error and time of
the planner's meshes: each is on the lower envelope of the picture, or misses it by less than the reference's
uncertainty. References (`accuracy-references.csv`) have elements of order 4 and are extrapolated from three meshes.

![Error bar over true error of every frequency](pictures/error-bars.svg)

[Error bars against true errors](error-bars.md) tests the error bars on random scenes, and [published band
diagrams](papers.md) are compared with ours.
"""
FIGURE = PAGE.parent / "pictures" / "error-against-time.svg"
STORED = Path("accuracy") / style.PICTURES / "accuracy_bending_at_M.svg"
SINGLE = r"\| (model|case) \| (dofs|confinement)"  # the tables of single models and cases
REFERENCE = PAGE.parents[1] / "results" / "reference"
LEFT_OUT = ("Poisson's ratio: where elements lock",)
FILES = {"The planner's meshes and the lower envelope": "accuracy-meshes.csv", "References": "accuracy-references.csv"}
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
    """A report without pictures, tables of single models and cases, FILES and LEFT_OUT; headings move `deeper`."""
    lines = [line for line in page.splitlines() if not line.startswith("![")]
    kept = [
        each for each in _sections(lines) if not re.search(SINGLE, each) and _heading(each) not in {*FILES, *LEFT_OUT}
    ]
    return "".join(re.sub("^#", f"{deeper}#", each) for each in kept).rstrip() + "\n"


def csv_of(page: str) -> dict[str, str]:
    """Tables of a report that become files, as CSV text by file name."""
    result = {}
    for section in _sections(page.splitlines()):
        if name := FILES.get(_heading(section)):
            rows = [line.strip("| ").split(" | ") for line in section.splitlines() if line.startswith("| ")]
            out = io.StringIO()
            csv.writer(out, lineterminator="\n").writerows(row for row in rows if set(row[0]) != {"-"})
            result[name] = out.getvalue()
    return result


def _sections(lines: list[str]) -> list[str]:
    return re.split(r"^(?=#+ )", "\n".join(lines), flags=re.MULTILINE)


def _heading(section: str) -> str:
    return section.partition("\n")[0].strip("# ")


def main() -> int:
    """Write the page, or say which study is missing."""
    try:
        _, speed, table = (PAGE.read_text() if PAGE.exists() else "").partition(SPEED)
        page, figure = text(), (RESULTS / STORED).read_bytes()
        for name, table_text in csv_of((RESULTS / "accuracy" / "report.md").read_text()).items():
            write_atomic(REFERENCE / name, table_text.encode())
        write_atomic(FIGURE, figure)
        write_atomic(PAGE, (page + ("\n" if speed else "") + speed + table).encode())
    except FileNotFoundError as fault:
        print(f"{fault.filename}: not there; run `make bench` first", file=sys.stderr)
        return 2
    print(f"verification {PAGE}")
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
