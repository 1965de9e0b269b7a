"""The band-gap check: edges recomputed now against committed ones that a finer mesh and another method gave."""

from __future__ import annotations

import csv
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pipeline.analysis.bands import solve_bands
from pipeline.case.model import Case
from pipeline.errors import CheckFailed
from pipeline.logs import Log
from pipeline.paths import REFERENCE
from pipeline.records.record import BandsRecord

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
    def words(self) -> str:
        """What became of it."""
        if self.relative_change is None:
            return f"{self.name} is gone: none was found beside the committed {self.reference_hz / 1e3:.2f} kHz"
        return f"{self.name} moved by {100 * self.relative_change:+.2f} %, allowed is {100 * self.allowed:.1f} %"


def edges_of(bands: BandsRecord) -> dict[str, float | None]:
    """Edges of the lowest complete gap and the cell's bending frequency at M, Hz; None where there is none."""
    gap = bands.gaps[0] if bands.gaps else None
    pair = bands.bending_at_m_hz
    return {
        "gap lower edge": gap.lower_hz if gap else None,
        "gap upper edge": gap.upper_hz if gap else None,
        "bending at M": sum(pair) / len(pair) if pair else None,
    }


def read_reference(path: Path = FILE) -> dict[str, tuple[float, float]]:
    """Committed edges, {name: (Hz, allowed relative change)}. Raises CheckFailed when the file is missing."""
    try:
        with path.open(newline="", encoding="utf-8") as file:
            return {row["name"]: (float(row["hz"]), float(row["allowed"])) for row in csv.DictReader(file)}
    except (OSError, KeyError, ValueError) as fault:
        raise CheckFailed(f"{path.name}: {fault}: the committed band-gap reference cannot be read") from fault


def check_gap(case: Case, log: Log) -> list[Edge]:
    """Every committed edge beside what is found now."""
    edges = edges_of(solve_bands(case, log).record)
    return [Edge(name, hz, edges.get(name), allowed) for name, (hz, allowed) in read_reference().items()]


def to_dict(edges: list[Edge]) -> dict[str, Any]:
    """The contract's fields; an edge that is gone is null."""
    return {
        "schema": 1,
        "holds": all(edge.holds for edge in edges),
        "edges": [
            {
                "name": edge.name,
                "reference_hz": edge.reference_hz,
                "found_hz": edge.found_hz,
                "relative_change": edge.relative_change,
                "allowed": edge.allowed,
            }
            for edge in edges
        ],
    }
