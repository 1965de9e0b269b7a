"""The wanted mode of a part, searched by one rule (`solvers.measures.wanted_mode`) whatever was asked for.

What was asked for decides what is listed and saves solves. Where it lies elsewhere altogether, nothing is searched, and that
is said.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

from pipeline.models.mode_parts import RivalRecord, WantedMode, WantedRecord
from pipeline.planning.model_choice import Expected
from solvers.fem.eigen import Count
from solvers.measures.wanted_mode import (
    NONE,
    Largest,
    Status,
    Verdict,
    leaves_room,
    measures,
    missing_strength,
    search,
    verdict,
    weights,
)

if TYPE_CHECKING:
    from pipeline.models.mode_rows import ModeRow

ROUNDS = 6  # widenings at most: each moves an end by a fifth of a frequency
SURE = (
    0.5  # of the expected strength: a mode that has it is the one expected, for all others together have less beside it
)


@dataclass(frozen=True)
class Wanted:
    """The wanted mode among the modes of its symmetry class.

    `rows` are all modes of the class from low_hz to high_hz, `beyond` those outside that the search went through; the verdict
    counts both, one after another. `count` covers `rows` and is None where nothing was looked for: then `why` says what stands
    against it. missing: bound of the weight of any mode that was not computed; 0 where none was asked for. reach_hz: where all
    modes were computed.
    """

    verdict: Verdict
    rows: tuple[ModeRow, ...]
    low_hz: float
    high_hz: float
    count: Count | None
    why: str = ""
    beyond: tuple[ModeRow, ...] = ()
    missing: float = 0.0
    reach_hz: tuple[float, float] | None = None

    @property
    def is_open(self) -> bool:
        """Whether a mode outside the searched range may rival the wanted one."""
        return self.row is not None and leaves_room(self.missing, float(weights([self.row])[0]))

    @property
    def status(self) -> Status:
        """single, split or none."""
        return self.verdict.status

    @property
    def row(self) -> ModeRow | None:
        """The wanted mode; None where there is none."""
        return None if self.verdict.index is None else (*self.rows, *self.beyond)[self.verdict.index]

    @property
    def rivals(self) -> tuple[ModeRow, ...]:
        """Other modes that carry the wanted shape, strongest first."""
        every = (*self.rows, *self.beyond)
        return tuple(every[i] for i in self.verdict.rivals)

    def each(self, change: Callable[[ModeRow], ModeRow]) -> Wanted:
        """The same verdict over rows that were changed one by one."""
        return replace(self, rows=tuple(map(change, self.rows)), beyond=tuple(map(change, self.beyond)))

    def record(self, **more: Any) -> WantedRecord:
        """The mode, its rivals, the window, and the mode's part of the shape in it."""
        rivals = [RivalRecord.of(rival) for rival in self.rivals]
        more |= {"status": self.status, "share": self.verdict.share, "rivals": rivals}
        more |= {"window_hz": [self.low_hz, self.high_hz], "driven_confinement_db": None}
        if self.row is None:
            return WantedRecord(frequency_hz=None, mac=None, strength=None, confinement_db=None, **more)
        return WantedMode.of(self.row, **more)


def look(
    window_hz: tuple[float, float],
    known: Count,
    rows: tuple[ModeRow, ...],
    solve: Callable[[float, float], tuple[tuple[ModeRow, ...], Count]],
    largest: Largest[ModeRow] | None = None,
) -> Wanted:
    """Search the wanted mode from a window outwards, reusing the `rows` of its class that are already known.

    `solve` returns every mode of the class between two frequencies, `largest` what any one outside an interval may have of the
    shape. The outcome is the same whatever is known.
    """
    if known.high_hz < window_hz[0] or known.low_hz > window_hz[1]:
        return Wanted(NONE, (), *window_hz, None, "the frequencies asked for do not reach it")
    found = search(window_hz, (known.low_hz, known.high_hz), rows, lambda low, high: solve(low, high)[0], largest)
    low, high = found.window_hz
    inside = [low <= row.frequency_hz <= high for row in found.modes]
    order = [i for side in (True, False) for i, own in enumerate(inside) if own is side]
    place = {old: new for new, old in enumerate(order)}
    index = None if found.verdict.index is None else place[found.verdict.index]
    judged = replace(found.verdict, index=index, rivals=tuple(place[i] for i in found.verdict.rivals))
    every, own = tuple(found.modes[i] for i in order), sum(inside)
    count = Count(low, high, own, own)
    return Wanted(judged, every[:own], low, high, count, "", every[own:], found.missing, found.reach_hz)


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
    reach, missing = (known.low_hz, known.high_hz), missing_strength(rows)
    judged = verdict(*measures(rows), missing=missing) if rows else NONE
    return Wanted(judged, rows, *reach, known, missing=missing, reach_hz=reach)


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
