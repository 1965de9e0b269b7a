"""Zone, lone pillar, bands and a plate by Antinode, scikit-fem, NGSolve and CalculiX: error against processor seconds.

    python -m studies.benchmarks.peers [--ngsolve PYTHON] [--kept FOLDER] [--only PART ...] [--write]

Each row is a process of its own with one thread; its processor seconds hold meshing and all solves, and exclude, for all alike,
the time to load the interpreter and the libraries. Programs that are not installed are skipped and named.
"""

from __future__ import annotations

import argparse
import json
import shutil
import subprocess
import sys
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np

from pipeline.paths import ROOT
from pipeline.plots import style
from pipeline.records.store import write_atomic
from studies.benchmarks import ran
from studies.benchmarks.peers.scene import KEPT, PARTS, merged, task

SLOWEST = 1e-3  # of the highest frequency: slower waves are rigid-body modes
TARGETS = (0.01, 0.003, 0.001)
WINDOW = 0.1  # about the reference, relative: where a plate's target mode is looked for
MIN_ERROR = 1e-6  # errors below are drawn here
ZONE_MODE = 8  # the mode (0, 8) among the zone's: each has one line more than the one below it

PAGE, PICTURE = ROOT / "docs" / "peers.md", ROOT / "docs" / "pictures" / "peers.svg"
FOLDER = Path(__file__).parent
OURS, SUPERLU, SCIKIT, NGSOLVE, CALCULIX = "Antinode", "Antinode, SuperLU", "scikit-fem", "NGSolve", "CalculiX"
ONE_THREAD = dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "ANTINODE_THREADS"), "1")
FINEST = 0.0005

ACCURACIES = {
    "zone": (0.01, 0.003, FINEST),
    "pillar": (0.003, 0.001),
    "cell": (0.01, 0.003, 0.001),
    "plate": (0.01, 0.003, 0.001),
}

LONG = (("zone", FINEST), ("plate", 0.001))  # minutes by SuperLU: not repeated with it
MESHED = {"zone": (7.0, 7.0, 2), "pillar": (1.0, 0.8, 3)}  # references: order 4, mm, mm along a pillar, layers

TETRAHEDRA = {  # order, size in mm, levels of elements shrunk towards singular edges
    "zone": ((3, 8.0, 1), (3, 4.0, 1), (4, 4.0, 2)),
    "pillar": ((3, 2.0, 1), (4, 2.0, 2), (5, 2.0, 3)),
    "cell": ((3, 2.0, 1), (3, 2.0, 2), (4, 2.0, 2)),
    "plate": ((3, 4.0, 0), (3, 4.0, 1), (3, 2.0, 1), (4, 4.0, 2)),
}

# elements across a pillar: with one its bending lies so high that it mixes with the target mode
MIN_ACROSS = {"plate": 2}

HEXAHEDRA = {  # size in the plate and along a pillar in mm, layers shrunk towards singular edges
    "zone": ((4.0, 4.0, 0), (4.0, 4.0, 1), (2.0, 2.0, 1)),
    "pillar": ((1.0, 1.0, 1), (0.5, 0.7, 2), (0.5, 0.5, 3)),
    "cell": ((1.0, 1.0, 0), (2.0, 1.6, 1), (1.0, 1.0, 1)),
    "plate": ((4.0, 2.1, 0), (2.0, 2.1, 0)),
}

ELEMENT, LOWEST = {"plate": "C3D20"}, {"plate": 70}  # one layer of C3D20R moves without strain


@dataclass(frozen=True)
class Solution:
    """Result of a program for a part: frequencies by symmetry class or wavevector, strengths of modes in the target shape."""

    part: str
    program: str
    settings: str
    frequencies_hz: list[list[float]]
    dofs: int
    seconds: float
    strengths: list[float] = field(default_factory=list)

    @property
    def compared_hz(self) -> np.ndarray:
        """The frequencies that are compared, in an order that all programs share."""
        if self.part == "cell":
            return np.sort(np.array(self.frequencies_hz), axis=1).ravel()
        return np.array(merged(self.frequencies_hz, KEPT.get(self.part)))


@dataclass(frozen=True)
class Row:
    """One process: a program, a part, and how it is meshed."""

    part: str
    program: str
    description: str
    settings: dict[str, Any]
    environment: dict[str, str] = field(default_factory=dict)

    @property
    def name(self) -> str:
        """A file name."""
        return "".join(c if c.isalnum() else "-" for c in f"{self.part} {self.program} {self.description}")


def error(solution: Solution, reference: Solution) -> float:
    """The relative error of largest size, with its sign; waves that are rigid-body modes are left out."""
    errors = _errors(solution, reference)
    return float(errors[np.argmax(np.abs(errors))])


def target_error(solution: Solution, reference: Solution) -> float | None:
    """Relative error of the zone's mode (0, 8) alone; None for other parts."""
    return float(_errors(solution, reference)[ZONE_MODE]) if solution.part == "zone" else None


def rows(results: Sequence[Solution], references: dict[str, Solution]) -> list[str]:
    """The Markdown table, one line per result, the reference among them without an error."""
    lines = [
        "| part | program | settings | degrees of freedom | CPU s | largest error | mode (0, 8) |",
        "|---|---|---|---|---|---|---|",
    ]
    for one in results:
        known = references[one.part]
        of_mode = target_error(one, known)
        error_columns = (
            ("reference", "")
            if one == known
            else (f"{error(one, known):+.4%}", "" if of_mode is None else f"{of_mode:+.4%}")
        )
        figures = (one.part, one.program, one.settings, str(one.dofs), f"{one.seconds:.2f}", *error_columns)
        lines.append(f"| {' | '.join(figures)} |")
    return lines


def cheapest(results: Sequence[Solution], references: dict[str, Solution]) -> list[str]:
    """The least processor seconds of each program within each error, as a Markdown table."""
    programs = list(dict.fromkeys(one.program for one in results))
    lines = [f"| part | within | {' | '.join(programs)} |", f"|{'---|' * (2 + len(programs))}"]
    errors = [(one, abs(error(one, references[one.part]))) for one in results if one != references[one.part]]
    for part in references:
        for target in TARGETS:
            good = [one for one, off in errors if one.part == part and off <= target]
            least = [
                min((f"{s:.1f}" for s in sorted(o.seconds for o in good if o.program == p)[:1]), default="–")
                for p in programs
            ]
            lines.append(f"| {part} | {target:.1%} | {' | '.join(least)} |")
    return lines


def draw(results: Sequence[Solution], references: dict[str, Solution], path: Path) -> None:
    """Error against processor seconds: one panel per part, one line per program."""
    programs = list(dict.fromkeys(one.program for one in results))
    with style.style():
        figure = style.new_figure(style.WIDTH_IN, 5.6)
        for axes, part in zip(np.ravel(figure.subplots(2, 2)), references, strict=False):
            for program, colour, mark in zip(programs, style.CYCLE, style.MARKERS, strict=False):
                own = sorted((o for o in results if (o.part, o.program) == (part, program)), key=lambda o: o.seconds)
                off = [max(abs(error(o, references[part])), MIN_ERROR) for o in own if o != references[part]]
                seconds = [o.seconds for o in own if o != references[part]]
                axes.loglog(seconds, off, f"{mark}-", color=colour, markersize=4, label=program)
            axes.set(title=PARTS[part].title, xlabel="CPU seconds", ylabel="largest relative error")
            axes.grid(True)
        figure.legend(*axes.get_legend_handles_labels(), loc="outside lower center", ncols=len(programs))
        figure.savefig(path, metadata={"Date": None})


def listed() -> Iterator[Row]:
    """Every row, part by part; the first of a part is its reference."""
    for part in PARTS:
        yield _reference(part)
        for accuracy in ACCURACIES[part]:
            yield Row(part, OURS, f"accuracy {accuracy}", {"accuracy": accuracy})
            if (part, accuracy) not in LONG:
                yield Row(part, SUPERLU, f"accuracy {accuracy}", {"accuracy": accuracy}, {"ANTINODE_FACTOR": "superlu"})
        for order, size, levels in TETRAHEDRA[part]:
            description = f"tetrahedra of order {order}, {size:g} mm, {levels} levels"
            yield Row(part, NGSOLVE, description, {"order": order, "size_mm": size, "levels": levels})
        least = MIN_ACROSS.get(part, 1)
        for size, along, layers in HEXAHEDRA[part]:
            sizes = f"{size:g} x {along:g} mm, {layers} layers" + (f", {least} across a pillar" if least > 1 else "")
            own = {"size_mm": size, "along_mm": along, "layers": layers, "least": least}
            yield Row(part, SCIKIT, f"27 nodes, {sizes}", own)
            if part != "cell":
                element = ELEMENT.get(part, "C3D20R")
                yield Row(part, CALCULIX, f"{element}, {sizes}", own | {"element": element, "lowest": LOWEST.get(part)})


def left_out(interpreter: str) -> dict[str, str]:
    """Programs that are not on this machine, and why not."""
    missing = {}
    if not find_spec("skfem"):
        missing[SCIKIT] = "not installed: pip install scikit-fem"
    if not shutil.which("ccx"):
        missing[CALCULIX] = "no `ccx` on this machine"
    if (
        not shutil.which(interpreter)
        or subprocess.run([interpreter, "-c", "import ngsolve, scipy"], capture_output=True).returncode
    ):
        missing[NGSOLVE] = f"{interpreter} cannot import ngsolve and scipy: --ngsolve names one that can"
    return missing


def solve(row: Row, interpreter: str) -> Solution:
    """A row in a process of its own. RuntimeError with its last words."""
    module = "studies.benchmarks.peers"
    command = {
        SCIKIT: ["-m", f"{module}.hexahedra", "scikit-fem"],
        CALCULIX: ["-m", f"{module}.hexahedra", "calculix"],
        NGSOLVE: [str(FOLDER / "tetrahedra.py")],
    }.get(row.program, ["-m", f"{module}.ours"])
    python = interpreter if row.program == NGSOLVE else sys.executable
    given = json.dumps(task(row.part, row.settings))
    ended = ran(*command, given, python=python, environment=ONE_THREAD | row.environment)
    return Solution(row.part, row.program, row.description, **json.loads(ended.printed.splitlines()[-1]))


def kept(row: Row, interpreter: str, folder: Path | None) -> Solution:
    """A row computed now, or by an earlier run that was given the same folder."""
    file = folder and folder / f"{row.name}.json"
    if file and file.exists():
        return Solution(**json.loads(file.read_text()))
    solution = solve(row, interpreter)
    if file:
        file.parent.mkdir(parents=True, exist_ok=True)
        write_atomic(file, json.dumps(vars(solution)).encode())
    return solution


def page(results: list[Solution], references: dict[str, Solution], missing: dict[str, str]) -> str:
    """The page: how it was measured, the least seconds within an error, what was left out."""
    lines = [(FOLDER / "page.md").read_text().rstrip(), "", *cheapest(results, references), ""]
    lines += [f"{program} is left out: {why}." for program, why in missing.items()]
    return "\n".join(lines).rstrip() + "\n"


def main() -> int:
    """Compute the rows that are not stored, print them, and write the page on request."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument(
        "--ngsolve", default=sys.executable, metavar="PYTHON", help="an interpreter with ngsolve and scipy"
    )
    parser.add_argument("--kept", type=Path, help="folder of an earlier run of this version; new rows are added")
    parser.add_argument("--only", nargs="*", choices=PARTS, default=list(PARTS), help="parts")
    parser.add_argument("--write", action="store_true", help="write docs/peers.md and its picture")
    given = parser.parse_args()
    missing = left_out(given.ngsolve)
    for program, why in missing.items():
        print(f"{program} is left out: {why}", flush=True)
    results = []
    for row in listed():
        if row.part in given.only and row.program not in missing:
            results.append(kept(row, given.ngsolve, given.kept))
            print(
                f"{row.part}, {row.program}, {row.description}: {results[-1].seconds:.2f} s",
                file=sys.stderr,
                flush=True,
            )
    references: dict[str, Solution] = {}
    for one in results:
        references.setdefault(one.part, one)
    text = page(results, references, missing)
    print(text, *rows(results, references), sep="\n")
    if given.write:
        write_atomic(PAGE, text.encode())
        draw(results, references, PICTURE)
    return 0


def _errors(solution: Solution, reference: Solution) -> np.ndarray:
    known = reference.compared_hz
    if solution.strengths:
        return np.array([_strongest(solution, float(known[0])) / known[0] - 1.0])
    moving = known > SLOWEST * known.max()
    return np.asarray(solution.compared_hz[moving] / known[moving] - 1.0)


def _strongest(solution: Solution, near_hz: float) -> float:
    """The frequency of the mode of largest strength in the target shape, of those about the reference."""
    hz = np.array(solution.frequencies_hz[0])
    about = np.abs(hz / near_hz - 1.0) < WINDOW
    return float(hz[int(np.argmax(np.where(about, solution.strengths, -1.0)))])


def _reference(part: str) -> Row:
    """Order 4 on one fine mesh, without any reduction, where that is cheap; else the finest accuracy."""
    if part not in MESHED:
        return Row(part, OURS, f"accuracy {FINEST}", {"accuracy": FINEST})
    size, along, layers = MESHED[part]
    own = {"size_mm": size, "along_mm": along, "layers": layers}
    return Row(part, OURS, f"order 4, {size:g} x {along:g} mm, {layers} layers", own)


if __name__ == "__main__":
    raise SystemExit(main())
