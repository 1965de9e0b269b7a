"""What each program found beside the reference: errors, the page's tables and its picture."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from pipeline.plots import style
from studies.benchmarks.peers.scene import KEPT, PARTS, merged

SLOWEST = 1e-3  # of the highest frequency: slower waves are rigid-body modes
TARGETS = (0.01, 0.003, 0.001)
WINDOW = 0.1  # about the reference, relative: where a plate's target mode is looked for
MIN_ERROR = 1e-6  # errors below are drawn here
ZONE_MODE = 8  # the mode (0, 8) among the zone's: each has one line more than the one below it


@dataclass(frozen=True)
class Solution:
    """What a program gave of a part: frequencies by symmetry class or wavevector, strengths of modes in the target shape."""

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


def error(solution: Solution, reference: Solution) -> float:
    """The relative error of largest size, with its sign; waves that are rigid-body modes are left out."""
    errors = _errors(solution, reference)
    return float(errors[np.argmax(np.abs(errors))])


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


def target_error(solution: Solution, reference: Solution) -> float | None:
    """The same of the zone's mode (0, 8) alone; None of other parts."""
    return float(_errors(solution, reference)[ZONE_MODE]) if solution.part == "zone" else None


def rows(results: Sequence[Solution], references: dict[str, Solution]) -> list[str]:
    """The Markdown table, a line a result, the reference among them without an error."""
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
    """Error against processor seconds: a panel a part, a line a program."""
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
