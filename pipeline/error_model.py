"""The error that a model and mesh are expected to make, from what they made on the reference parts.

The committed table `calibration.csv` holds the largest relative error of each part by element, order, graded layers or
tetrahedra across; `python -m studies.calibration` writes it from the stored accuracy study. Other scenes than those of the
study get SAFETY times as much.
"""

from __future__ import annotations

import csv
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

from geometry.layout import Design
from pipeline.case import Case
from pipeline.logs import Log
from pipeline.ways import TET, Way

TABLE = Path(__file__).with_name("calibration.csv")
FIELDS = ("part", "kind", "order", "layers", "across", "error")
SAFETY = 2.0  # tests/verification/test_error_bars.py counts how often the bar holds on other scenes


@dataclass(frozen=True)
class Measured:
    """Largest relative error of a reference part by one mesh; across = elements over the smallest dimension (tetrahedra)."""

    part: str
    kind: str
    order: int
    layers: int
    across: float
    error: float


@lru_cache(maxsize=1)
def table() -> tuple[Measured, ...]:
    """The committed calibration."""
    with TABLE.open(newline="", encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    return tuple(
        Measured(
            row["part"], row["kind"], int(row["order"]), int(row["layers"]), float(row["across"]), float(row["error"])
        )
        for row in rows
    )


def expected_error(way: Way, design: Design) -> float | None:
    """Relative error of a frequency that the way's mesh is expected to make; None where nothing like it was measured."""
    rows = [row for row in table() if row.part == way.part and row.kind == way.kind]
    if way.kind == TET:
        across = _smallest_m(way, design) / (way.edge_m or 1.0)
        known = [row.error for row in rows if row.order == 2 and row.across <= across * 1.01]
        return SAFETY * min(known) if known else None
    assert way.hexahedra
    known = [row.error for row in rows if (row.order, row.layers) == (way.hexahedra.order, way.hexahedra.layers)]
    return SAFETY * min(known) if known else None


def told(way: Way, case: Case, log: Log) -> float | None:
    """The expected error, said in the log; with what to do where the case asks for less."""
    error = expected_error(way, case.design)
    if error is None:
        log.info(f"no error was measured for {way.name} of the {way.part}: compare with a finer solve.accuracy")
        return None
    short = f"; solve.accuracy asks for {case.solve.accuracy:.2%}" if error > case.solve.accuracy else ""
    log.info(f"expected error of a frequency by the mesh {error:.2%} or less{short}")
    return error


def _smallest_m(way: Way, design: Design) -> float:
    """What the reference part's tetrahedra are counted across: the thinner of plate and pillar; the zone's two thicknesses."""
    if way.part == "zone" or design.pillar is None:
        return 2.0 * design.thickness_m
    return design.pillar.tip_m if way.part == "pillar" else min(design.thickness_m, design.pillar.tip_m)
