"""The wanted mode of a part, looked for in a window of its own: what was asked for does not decide which mode it is.

The window is the one about the zone's exact thin-plate frequency, widened until it reaches past the mode found on both
sides (`solvers.measures.wanted_mode.PAST`). Where what was asked for lies elsewhere altogether, nothing is looked for,
and that is said.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from geometry.elements import FloatArray
from pipeline.planning.request import Expected
from pipeline.records.record import RivalRecord, WantedMode, WantedRecord
from solvers.fem.eigen import Count
from solvers.measures.wanted_mode import NONE, Status, Verdict, reaching, verdict, weight

if TYPE_CHECKING:
    from pipeline.analysis.mode_rows import ModeRow

ROUNDS = 6  # widenings at most: each moves an end by a fifth of a frequency
SURE = (
    0.5  # of the expected strength: a mode that has it is the one expected, for all others together have less beside it
)


@dataclass(frozen=True)
class Wanted:
    """The verdict over `rows`, all modes of the wanted symmetry class from low_hz to high_hz, with their count.

    `count` is None where nothing was looked for: then `why` says what stands against it.
    """

    verdict: Verdict
    rows: tuple[ModeRow, ...]
    low_hz: float
    high_hz: float
    count: Count | None
    why: str = ""

    @property
    def status(self) -> Status:
        """single, split or none."""
        return self.verdict.status

    @property
    def row(self) -> ModeRow | None:
        """The wanted mode; None where there is none."""
        return None if self.verdict.index is None else self.rows[self.verdict.index]

    @property
    def rivals(self) -> tuple[ModeRow, ...]:
        """Other modes that carry the wanted shape, strongest first."""
        return tuple(self.rows[i] for i in self.verdict.rivals)

    def each(self, change: Callable[[ModeRow], ModeRow]) -> Wanted:
        """The same verdict over rows that were changed one by one."""
        return replace(self, rows=tuple(change(row) for row in self.rows))

    def record(self, **more: Any) -> WantedRecord:
        """The mode, its rivals, the window, and the mode's part of the shape in it."""
        rivals = [RivalRecord.of(rival) for rival in self.rivals]
        more |= {"status": self.status, "share": self.verdict.share, "rivals": rivals}
        more |= {"window_hz": (self.low_hz, self.high_hz), "driven_confinement_db": None}
        if self.row is None:
            return WantedRecord(frequency_hz=None, mac=None, strength=None, confinement_db=None, **more)
        return WantedMode.of(self.row, **more)


def look(
    window_hz: tuple[float, float],
    known: Count,
    rows: tuple[ModeRow, ...],
    solve: Callable[[float, float], tuple[tuple[ModeRow, ...], Count]],
) -> Wanted:
    """Search the wanted mode from a window outwards, starting with the `rows` of its class that are already known.

    `solve` returns every mode of the class between two frequencies. Modes beyond the window that are known all the same have no
    say, unless the window itself holds no mode of the wanted shape.
    """
    if known.high_hz < window_hz[0] or known.low_hz > window_hz[1]:
        return Wanted(NONE, (), *window_hz, None, "the frequencies asked for do not reach it")
    ends, verdict = window_hz, NONE
    for _ in range(ROUNDS):
        rows, known = _completed(rows, known, ends, solve)
        inside = _within(rows, ends)
        verdict = _verdict(inside)
        if verdict.index is None:
            break
        wider = reaching(ends, inside[verdict.index].frequency_hz)
        if wider == ends:
            break
        ends = wider
    if verdict.index is None and rows_beyond(rows, ends):
        return look_among(rows, known)
    return Wanted(verdict, _within(rows, ends), *ends, known)


def look_about(
    expected: Expected,
    known: Count,
    rows: tuple[ModeRow, ...],
    solve: Callable[[float, float], tuple[tuple[ModeRow, ...], Count]],
) -> Wanted:
    """Search the mode that another model has, from the narrow window of the `rows` outwards, by half of it on each side."""
    for _ in range(ROUNDS):
        outcome = look_among(rows, known)
        if outcome.row is not None and (outcome.row.strength or 0.0) >= SURE * expected.strength:
            break
        step = (known.high_hz - known.low_hz) / 2.0
        ends = max(known.low_hz - step, expected.frequency_hz / 2.0), known.high_hz + step
        rows, known = _completed(rows, known, ends, solve)
    return outcome


def look_among(rows: tuple[ModeRow, ...], known: Count) -> Wanted:
    """Give the verdict over the modes at hand, where no others can be computed."""
    return Wanted(_verdict(rows), rows, known.low_hz, known.high_hz, known)


def rows_beyond(rows: tuple[ModeRow, ...], ends: tuple[float, float]) -> bool:
    """Whether a mode of the wanted shape is known outside the window."""
    return _verdict(rows).index is not None and len(_within(rows, ends)) < len(rows)


def _within(rows: tuple[ModeRow, ...], ends: tuple[float, float]) -> tuple[ModeRow, ...]:
    return tuple(row for row in rows if ends[0] <= row.frequency_hz <= ends[1])


def _verdict(rows: tuple[ModeRow, ...]) -> Verdict:
    return verdict(*_measures(rows)) if rows else NONE


def weights(rows: tuple[ModeRow, ...]) -> FloatArray:
    """How much of the wanted shape each mode carries, (k,)."""
    return weight(*_measures(rows))


def _measures(rows: tuple[ModeRow, ...]) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Strength, zone share and MAC, (k,) each; NaN where not known."""
    values = np.array([(row.strength, row.zone_share, row.mac) for row in rows], dtype=float)
    return values[:, 0], values[:, 1], values[:, 2]


def _completed(
    rows: tuple[ModeRow, ...],
    known: Count,
    ends: tuple[float, float],
    solve: Callable[[float, float], tuple[tuple[ModeRow, ...], Count]],
) -> tuple[tuple[ModeRow, ...], Count]:
    """Return the rows and their count over the known interval and the window together."""
    if ends[0] < known.low_hz:
        more, count = solve(ends[0], known.low_hz)
        rows, known = (*more, *rows), _joined(count, known)
    if ends[1] > known.high_hz:
        more, count = solve(known.high_hz, ends[1])
        rows, known = (*rows, *more), _joined(known, count)
    return rows, known


def _joined(low: Count, high: Count) -> Count:
    return Count(low.low_hz, high.high_hz, low.expected + high.expected, low.found + high.found, low.below)
