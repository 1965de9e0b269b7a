"""What each mesh did to the frequencies of the reference parts: the committed table that planner and error bars read.

`python -m studies.calibration` writes `calibration.csv` from the stored accuracy study: the largest relative error of each part
by element, order, graded layers and share of the planner's own element size, or tetrahedra across. Other scenes than those of
the study are given SAFETY times as much.
"""

from __future__ import annotations

import csv
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

TABLE = Path(__file__).with_name("calibration.csv")
FIELDS = ("part", "kind", "order", "layers", "factor", "share", "across", "error")
HEX, TET, TET_ORDER = "hex", "tet", 2
# tests/verification/test_error_bars.py counts how often the bar holds on other scenes; tetrahedra differ from run to run
SAFETY = {HEX: 1.5, TET: 2.0}


@dataclass(frozen=True)
class Measured:
    """Largest relative error of a reference part by one mesh.

    Of hexahedra: layers, their factor, and share of the planner's element size; of tetrahedra: how many across the smallest
    dimension.
    """

    part: str
    kind: str
    order: int
    layers: int
    factor: float
    share: float
    across: float
    error: float


@lru_cache(maxsize=1)
def table() -> tuple[Measured, ...]:
    """The committed calibration."""
    with TABLE.open(newline="", encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    return tuple(_measured(row) for row in rows)


def _measured(row: dict[str, str]) -> Measured:
    numbers = [float(row[name]) for name in ("factor", "share", "across", "error")]
    return Measured(row["part"], row["kind"], int(row["order"]), int(row["layers"]), *numbers)


def by_hexahedra(part: str, order: int, layers: int, factor: float, share: float = 1.0) -> float | None:
    """Error to expect of graded hexahedra; None where nothing like them was measured."""
    wanted = (part, HEX, order, layers, factor, share)
    rows = [row for row in table() if (row.part, row.kind, row.order, row.layers, row.factor, row.share) == wanted]
    return _least(HEX, rows)


def by_tetrahedra(part: str, across: float) -> float | None:
    """Error to expect of quadratic tetrahedra, so many over the smallest dimension; None below the coarsest measured."""
    rows = [row for row in table() if (row.part, row.kind, row.order) == (part, TET, TET_ORDER)]
    return _least(TET, [row for row in rows if row.across <= across * 1.01])


def _least(kind: str, rows: list[Measured]) -> float | None:
    return SAFETY[kind] * min(row.error for row in rows) if rows else None
