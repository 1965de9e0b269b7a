"""The band-gap check: edges recomputed now against committed ones that a finer mesh and another method gave."""

from __future__ import annotations

import csv
from argparse import Namespace
from dataclasses import dataclass
from typing import Any

from pipeline.case.model import load_case
from pipeline.case.plausible import warn_of_doubts
from pipeline.errors import CheckFailed
from pipeline.logs import TerminalLog
from pipeline.paths import REFERENCE, STUDIES
from pipeline.plots.style import ReportFigure
from pipeline.quantity import frequency, percent, percentage, signed
from pipeline.questions.answer import Answer, emit, of_case
from pipeline.questions.bands import Bands, BandsResult
from pipeline.questions.question import Run, ask
from pipeline.records.reading import reading_table

FILE = REFERENCE / "band_gap.csv"


@dataclass(frozen=True)
class Edge:
    """One checked frequency: committed, found (None where there is no such edge), and the relative change allowed."""

    name: str
    reference_hz: float
    found_hz: float | None
    allowed: float

    @property
    def relative_change(self) -> float | None:
        """found/reference - 1."""
        return None if self.found_hz is None else self.found_hz / self.reference_hz - 1.0

    @property
    def holds(self) -> bool:
        """Whether the change is within what is allowed; an edge that is gone does not hold."""
        return self.relative_change is not None and abs(self.relative_change) <= self.allowed

    @property
    def change_text(self) -> str | None:
        """The change in per cent."""
        return None if self.relative_change is None else signed(percentage(self.relative_change, self.allowed))

    def to_dict(self) -> dict[str, Any]:
        """The contract's fields; an edge that is gone is null."""
        names = ("name", "reference_hz", "found_hz", "relative_change", "allowed")
        return {name: getattr(self, name) for name in names}

    @property
    def words(self) -> str:
        """What became of it."""
        if self.relative_change is None:
            return (
                f"{self.name} is gone: none was found beside the committed {frequency(self.reference_hz, self.allowed)}"
            )
        return f"{self.name} moved by {self.change_text}, allowed is {percent(self.allowed)}"


def edges_of(bands: BandsResult) -> dict[str, float | None]:
    """Edges of the lowest complete gap and the cell's bending frequency at M, Hz; None where there is none."""
    gap = bands.gaps[0] if bands.gaps else None
    pair = bands.bending_at_m_hz
    return {
        "gap lower edge": gap.lower_hz if gap else None,
        "gap upper edge": gap.upper_hz if gap else None,
        "bending at M": sum(pair) / len(pair) if pair else None,
    }


def read_reference() -> dict[str, tuple[float, float]]:
    """Committed edges, {name: (Hz, allowed relative change)}. Raises CheckFailed when the file is missing."""
    try:
        with FILE.open(newline="", encoding="utf-8") as file:
            return {row["name"]: (float(row["hz"]), float(row["allowed"])) for row in csv.DictReader(file)}
    except (OSError, KeyError, ValueError) as error:
        raise CheckFailed(f"{FILE.name}: {error}: the committed band-gap reference cannot be read") from error


def _figure(record: BandsResult) -> ReportFigure:
    """The bands whose edges are checked."""
    return ReportFigure("check-gap", "The checked bands", "Bands of the checked cell", record.as_figure(), vector=True)


def check_gap(arguments: Namespace) -> int:
    """Compare every committed edge with what is found now. Raises CheckFailed with a line for each that moved too far."""
    place = arguments.case or str(STUDIES / "three-rows.toml")
    case, log = of_case(arguments, load_case(place, arguments.set)), TerminalLog(arguments.quiet)
    warn_of_doubts(case.design, log)
    record = ask(case, Bands(), Run(log, detailed=False))
    computed = edges_of(record)
    edges = [Edge(name, hz, computed.get(name), allowed) for name, (hz, allowed) in read_reference().items()]
    head = ("edge", "reference_hz", "found_hz", "change", "allowed", "holds")
    rows = [[e.name, e.reference_hz, e.found_hz, e.change_text, e.allowed, e.holds] for e in edges]
    document = {"holds": all(e.holds for e in edges), "edges": [e.to_dict() for e in edges]}
    answer = Answer(document, [reading_table(head, rows)], head, rows, lambda: [_figure(record)])
    emit(arguments, "check-gap", answer)
    if not document["holds"]:
        raise CheckFailed(e.words for e in edges if not e.holds)
    return 0
