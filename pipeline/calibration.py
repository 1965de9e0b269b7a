"""What each mesh did to the frequencies of the reference parts: the committed table that planner and error bars read.

`python -m studies.calibration` writes `calibration.csv` from the stored accuracy study: the largest relative error of each part
by element, order, graded layers and share of the planner's own element size, or tetrahedra across; that of a theory's first
frequency; how much of what may move a confinement at most does move it. Other scenes than those of the study are given SAFETY
times as much.
"""

from __future__ import annotations

import csv
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

TABLE = Path(__file__).with_name("calibration.csv")
FIELDS = ("part", "kind", "order", "layers", "factor", "share", "through", "across", "error")
HEX, TET, TET_ORDER = "hex", "tet", 2
PLATE, MIXING = "plate", "mixing"
EDGE = 1.5  # power of an element's length in a frequency's error by the field at a clamped edge
# of the study's parts: thickness over half-wavelength, side over height
SLENDER = {"zone": 8 * 2.0 / 115.5, "pillar": 2.0 / 6.3}
# tests/verification/test_error_bars.py counts how often the bar holds on other scenes; tetrahedra differ from run to run
SAFETY = {HEX: 1.5, TET: 2.0, PLATE: 1.25}  # a plate's modes lie far below the highest bands that a cell is asked for


@dataclass(frozen=True)
class Measured:
    """Largest relative error of a reference part by one mesh.

    Of hexahedra: layers, their factor, share of the planner's element size and how many through a plate; of tetrahedra: how
    many across the smallest dimension.
    """

    part: str
    kind: str
    order: int
    layers: int
    factor: float
    share: float
    through: int
    across: float
    error: float


@lru_cache(maxsize=1)
def table() -> tuple[Measured, ...]:
    """The committed calibration."""
    with TABLE.open(newline="", encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    return tuple(_measured(row) for row in rows)


def _measured(row: dict[str, str]) -> Measured:
    order, layers, through = (int(row[name]) for name in ("order", "layers", "through"))
    factor, share, across, error = (float(row[name]) for name in ("factor", "share", "across", "error"))
    return Measured(row["part"], row["kind"], order, layers, factor, share, through, across, error)


def by_hexahedra(
    part: str,
    order: int,
    layers: int,
    factor: float,
    share: float = 1.0,
    through: int = 1,
    kind: str = HEX,
    growth: float = 1.0,
) -> float | None:
    """Error to expect of graded hexahedra, with the safety of a kind; None where nothing like them was measured.

    At `growth` times the frequencies measured, bending waves are sqrt(growth) shorter: as on elements so much longer, of which
    the next measured ones tell. Beyond the longest, S h^EDGE + C h^(2 order) through the two longest, or the latter alone.
    """
    if growth < 1.0:
        raise ValueError(f"growth = {growth}: must be 1 or more")
    alike = [
        row
        for row in table()
        if (row.part, row.kind, row.order, row.layers, row.factor, row.through)
        == (part, HEX, order, layers, factor, through)
    ]
    if not any(row.share == share for row in alike):
        return None
    length = share * growth**0.5
    longer = [row for row in alike if row.share >= length * (1.0 - 1e-9)]
    error = min(longer, key=lambda row: row.share).error if longer else _extrapolated(alike, length, 2 * order)
    return SAFETY[kind] * error


def _extrapolated(rows: list[Measured], length: float, smooth: int) -> float:
    """Error on longer elements than any measured; two sizes tell that of singular edges from that of the smooth wave."""
    longest, *shorter = sorted(rows, key=lambda row: -row.share)
    stretch, share_smooth = length / longest.share, 1.0
    if shorter:
        ratio, fall = shorter[0].share / longest.share, shorter[0].error / longest.error
        share_smooth = min(max((ratio**EDGE - fall) / (ratio**EDGE - ratio**smooth), 0.0), 1.0)
    return longest.error * ((1.0 - share_smooth) * stretch**EDGE + share_smooth * stretch**smooth)


def by_tetrahedra(part: str, across: float) -> float | None:
    """Error to expect of quadratic tetrahedra, so many over the smallest dimension; None below the coarsest measured."""
    rows = [row for row in table() if (row.part, row.kind, row.order) == (part, TET, TET_ORDER)]
    return _least(TET, [row for row in rows if row.across <= across * 1.01])


def by_theory(part: str, theory: str, slender: float) -> float | None:
    """Error to expect of an analytic frequency of a part with a ratio of its sides; None for a theory that was not measured.

    What a beam or a plate theory leaves out, shear, rotary inertia or a foot's Poisson strain, grows as the ratio squared.
    """
    rows = [row.error for row in table() if (row.part, row.kind) == (part, theory)]
    return SAFETY[HEX] * rows[0] * max(1.0, slender / SLENDER[part]) ** 2 if rows else None


def mixing() -> float | None:
    """Share of the largest change that neighbours mixed in may bring to a confinement (`solvers.mixing`) to expect."""
    return _least(HEX, [row for row in table() if (row.part, row.kind) == (PLATE, MIXING)])


def _least(kind: str, rows: list[Measured]) -> float | None:
    return SAFETY[kind] * min(row.error for row in rows) if rows else None
