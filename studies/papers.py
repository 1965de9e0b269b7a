"""docs/papers.md: gaps of published band diagrams compared with ours, `python -m studies.papers [NAME ...]`.

Each paper of studies/data/papers.toml has a case file in examples/papers/. The command computes the cases, all or those named,
prints the table, and stores the figures in results/reference/papers.csv; the page and the quick tests read them there.
"""

from __future__ import annotations

import argparse
import csv
import sys
import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from math import inf
from pathlib import Path
from typing import Any

from geometry.files import written_whole
from geometry.lattice import Lattice
from pipeline.case.model import Case, load_case
from pipeline.logs import TerminalLog
from pipeline.paths import RESULTS
from pipeline.plots import style
from pipeline.quantity import MM, frequency_with_bar
from pipeline.questions.bands import Bands, BandsResult
from pipeline.questions.question import Run, ask
from pipeline.records import outputs
from pipeline.records.store import write_atomic
from studies.plane_waves import LoadedPlate

ROOT = Path(__file__).resolve().parents[1]
DATA, CASES = ROOT / "studies" / "data" / "papers.toml", ROOT / "examples" / "papers"
PAGE, PICTURES = ROOT / "docs" / "papers.md", ROOT / "docs" / "pictures" / "papers"
STORED = RESULTS / "reference" / "papers.csv"
IN_PLANE = 2  # waves of the plate at rest at G next to the flexural one
FIELDS = ("case", "edge", "ours_hz", "error", "second_hz", "theirs_hz")
HEAD = ("edge", "paper", "ours", "difference", "second computation", "as the paper computed")
SHOWN_DPI, HEIGHT_IN, ABOVE = 80, 3.4, 1.5  # of a picture, and the frequencies above the highest edge that it shows


@dataclass(frozen=True)
class Gap:
    """A published gap above a band of the primitive cell: its edges in Hz, and half of their last digit."""

    below: int
    digit_hz: float
    paper_hz: tuple[float, float]

    @property
    def published(self) -> dict[str, float]:
        """Published figures by name."""
        return {
            f"{side} edge above band {self.below}": hz
            for side, hz in zip(("lower", "upper"), self.paper_hz, strict=True)
        }


@dataclass(frozen=True)
class Paper:
    """A published diagram.

    plane: vectors (mm) and places of the resonators (mm) in the primitive cell, for plane waves; theirs: what the paper's own
    computation had instead; settings: of the case, for a second computation by other elements.
    """

    case: str
    key: str
    title: str
    source: str
    why: str
    gaps: tuple[Gap, ...]
    cells: int = 1
    plane: Mapping[str, Any] = field(default_factory=dict)
    theirs: Mapping[str, Any] = field(default_factory=dict)
    settings: tuple[str, ...] = ()
    second: str = "plane waves of a thin plate"

    @property
    def path(self) -> Path:
        """The case file."""
        return CASES / f"{self.case}.toml"

    def load(self, *settings: str) -> Case:
        """The case, with settings as of --set."""
        return load_case(self.path, settings)

    def plate(self, **changed: Any) -> LoadedPlate:
        """The primitive cell as a thin plate with the case's materials, masses and springs."""
        design, plane = self.load().design, {**self.plane, **changed}
        solid = design.material.average
        nu = plane.get("poisson", solid.poisson)
        stiff = solid.young_pa * design.thickness_m**3 / 12.0 / (1.0 - nu**2)
        a1, a2 = ((MM * x, MM * y) for x, y in plane["vectors_mm"])
        disc = replace(design.attached[0], radius_m=plane.get("radius_m", design.attached[0].radius_m))
        own = [replace(disc, at_m=(MM * x, MM * y)) for x, y in plane["at_mm"]]
        return LoadedPlate(Lattice(a1, a2), stiff, design.material.density_kg_m3 * design.thickness_m, own)


def papers() -> list[Paper]:
    """Read the list."""
    listed = tomllib.loads(DATA.read_text())["paper"]
    return [
        Paper(
            **{**each, "gaps": tuple(Gap(**gap) for gap in each["gaps"]), "settings": tuple(each.get("settings", ()))}
        )
        for each in listed
    ]


def edges_of(paper: Paper, result: BandsResult, below: int) -> list[tuple[float, float]]:
    """Edges in Hz and their relative error bars of the gap above a band, lower first, for flexural waves where they are alone.

    In-plane waves of a thin plate lie above the gap at all wavevectors of the path but G, where two of them are at rest.
    """
    if not paper.plane:
        gap = next(each for each in result.gaps if each.lower_band == below)
        return [(gap.lower_hz, _bar(gap.lower_error)), (gap.upper_hz, _bar(gap.upper_error))]
    found: list[list[tuple[float, float]]] = [[], []]
    for point in result.points:
        first = paper.cells * below - 1 + (0 if point.kx_per_m or point.ky_per_m else IN_PLANE)
        for side, place in zip(found, (first, first + 1), strict=True):
            side.append((point.frequencies_hz[place], _bar(point.error[place])))
    return [max(found[0]), min(found[1])]


def _bar(error: float | None) -> float:
    return inf if error is None else error


def computed(paper: Paper, log: TerminalLog) -> tuple[BandsResult, list[dict[str, Any]]]:
    """Bands of the case, and what each published figure is compared with."""
    result, rows = ask(paper.load(), Bands(), Run(log, detailed=False)), []
    other = ask(paper.load(*paper.settings), Bands(), Run(log, detailed=False)) if paper.settings else None
    for gap in paper.gaps:
        edges = edges_of(paper, result, gap.below)
        second = [hz for hz, _ in edges_of(paper, other, gap.below)] if other else plane_waves(paper, gap)
        theirs = plane_waves(paper, gap, theirs=True) if paper.theirs else [None for _ in edges]
        for name, (hz, error), other_hz, their_hz in zip(gap.published, edges, second, theirs, strict=True):
            rows.append(dict(zip(FIELDS, (paper.case, name, hz, error, other_hz, their_hz), strict=True)))
    return result, rows


def plane_waves(paper: Paper, gap: Gap, theirs: bool = False) -> list[float]:
    """A gap's figures by plane waves of the case, or of what the paper's own computation had."""
    own = dict(paper.theirs) if theirs else {}
    asked = {name: own.pop(name) for name in ("reach", "points", "corners_per_m") if name in own}
    return [*paper.plate(**own).gap(gap.below, **asked)]


def stored() -> list[dict[str, Any]]:
    """The figures of the last computation."""
    if not STORED.exists():
        return []
    numbers = set(FIELDS[2:])
    with STORED.open(newline="") as lines:
        return [
            {k: (float(v) if v else None) if k in numbers else v for k, v in row.items()}
            for row in csv.DictReader(lines)
        ]


def table(paper: Paper, rows: Sequence[Mapping[str, Any]]) -> list[tuple[str, ...]]:
    """One row per published figure: paper, ours with its error bar, difference, and the two other computations."""
    known, lines = {row["edge"]: row for row in rows if row["case"] == paper.case}, []
    for gap in paper.gaps:
        for name, hz in gap.published.items():
            row = known[name]
            shown = [frequency_with_bar(hz, gap.digit_hz / hz), frequency_with_bar(row["ours_hz"], row["error"])]
            others = [_relative(row[each], hz) for each in ("ours_hz", "second_hz", "theirs_hz")]
            lines.append((name, *shown, *others))
    return lines


def _relative(ours_hz: float | None, paper_hz: float) -> str:
    return "" if ours_hz is None else f"{100.0 * (ours_hz / paper_hz - 1.0):+.2f} %"


def text(rows: Sequence[Mapping[str, Any]]) -> str:
    """The page."""
    page = tomllib.loads(DATA.read_text())["introduction"]
    done = {row["case"] for row in rows}
    for paper in (each for each in papers() if each.case in done):
        page += f"\n## {paper.title}\n\n`examples/papers/{paper.case}.toml`. {paper.source} [{paper.key}]\n\n"
        name = paper.title[:1].lower() + paper.title[1:]
        page += f"![Bands of {name}; dashed: the paper's gap](pictures/papers/{paper.case}.png)\n\n"
        page += outputs.markdown((*HEAD[:4], paper.second, HEAD[5]), table(paper, rows)) + f"\n{paper.why}\n"
    return page


def write(rows: Sequence[Mapping[str, Any]]) -> None:
    """Write the figures, in the order of the list, and the page."""
    order = {paper.case: place for place, paper in enumerate(papers())}
    kept = sorted((row for row in rows if row["case"] in order), key=lambda row: order[row["case"]])
    write_atomic(STORED, outputs.csv_bytes(FIELDS, ([row[name] for name in FIELDS] for row in kept)))
    write_atomic(PAGE, text(kept).encode())


def draw(paper: Paper, result: BandsResult) -> None:
    """Write the picture of a paper's bands, its gap dashed."""
    with style.style(), written_whole(PICTURES / f"{paper.case}.png") as temporary:
        figure, axes = style.panels(HEIGHT_IN)
        result.draw_bands(axes)
        edges = [hz for gap in paper.gaps for hz in gap.paper_hz]
        ours = [hz for gap in paper.gaps for hz, _ in edges_of(paper, result, gap.below)]
        for hz in edges:
            axes.axhline(1e-3 * hz, color=style.VERMILION, lw=0.9, ls="--")
        axes.set_ylim(0.0, 1e-3 * ABOVE * max(ours))
        figure.savefig(temporary, format="png", dpi=SHOWN_DPI, bbox_inches="tight")


def main() -> int:
    """Compute, print and write."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("names", nargs="*", metavar="NAME", help="cases to compute (default: all)")
    names, every = parser.parse_args().names, papers()
    if unknown := set(names) - {paper.case for paper in every}:
        parser.error(f"{', '.join(sorted(unknown))}: must be among {', '.join(paper.case for paper in every)}")
    for paper in every:
        if not names or paper.case in names:
            result, own = computed(paper, TerminalLog(True))
            draw(paper, result)
            print(outputs.markdown(HEAD, table(paper, own)), flush=True)
            write([*(row for row in stored() if row["case"] != paper.case), *own])
    print(f"papers {PAGE}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
