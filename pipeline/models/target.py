"""Target mode among the modes of a part, found by one rule (`solvers.measures.target_mode`), and the verdict in words.

The search reuses the modes of the request. If the requested frequencies do not reach the target window, there is no search,
and the verdict says so.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from math import isfinite
from typing import Any

from geometry.layout import Design
from pipeline.case.model import Case
from pipeline.logs import Log
from pipeline.models.answer_parts import ModeRecord, RivalRecord, TargetMode, TargetRecord
from pipeline.planning.model_choice import SIGNS, Expected
from pipeline.planning.refinement import WidestBar
from pipeline.quantity import figure, frequency, frequency_with_bar, interval, with_bar
from pipeline.records.part import BAR, live
from solvers.fem.eigen import Count, Modes
from solvers.measures.confinement import Confinement
from solvers.measures.target_mode import (
    MIN_MAC_SINGLE,
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


class ModeRow(ModeRecord):
    """One mode: its record, the place of its vector (class and column), and the relative parts of its error."""

    column: int = live("column of its vector in its symmetry class")
    extension_db: float | None = live("rms in the zone over that on the plate beyond the rows", "dB")
    extension_error_db: float | None = live(BAR.format("extension_db"), "dB")
    error_parts: dict[str, float] = live("relative parts of the frequency's error bar", default_factory=dict)
    rounding: float = live("relative error of the frequency by the rounding of the stiffness", default=0.0)


def widest_bar(rows: Sequence[ModeRow]) -> WidestBar:
    """Find the largest error bar of some modes and its parts; unknown if one of them has none."""
    bars = [row.error for row in rows]
    known = [bar for bar in bars if bar is not None]
    if not known or len(known) < len(bars):
        return WidestBar(None)
    row = rows[bars.index(max(known))]
    return WidestBar(row.error, f"the mode at {frequency(row.frequency_hz, row.error)}", row.error_parts)


MEASURES = ("zone_share", "confinement_db", "mac", "strength", "extension_db")


def mode_rows(modes: Modes, symmetry: str | None, measures: Confinement | None, first: int = 0) -> list[ModeRow]:
    """Return one row per mode with columns counted from `first`; a measure without meaning is None."""
    return [
        ModeRow(
            frequency_hz=float(frequency),
            residual=float(modes.residual[i]),
            symmetry=symmetry,
            parity=SIGNS[symmetry] if symmetry else None,
            error=None,
            confinement_error_db=None,
            column=first + i,
            rounding=float(modes.rounding[i]),
            error_parts={},
            **_measures(measures, i),
        )
        for i, frequency in enumerate(modes.frequency_hz)
    ]


def measured(row: ModeRow, measures: Confinement, place: int) -> ModeRow:
    """Return a mode with other measures, whose error bars are not known."""
    bars = ("zone_share_error", "confinement_error_db", "mac_error", "strength_error", "extension_error_db")
    return replace(row, **_measures(measures, place) | dict.fromkeys(bars))


def _measures(measures: Confinement | None, place: int) -> dict[str, Any]:
    """The measures of one mode by name, None where one has no meaning."""
    return {name: _number(getattr(measures, name)[place]) if measures else None for name in MEASURES}


def _number(value: float) -> float | None:
    return float(value) if isfinite(value) else None


# -- the search --------------------------------------------------------------------------------------------------------


ROUNDS = 6  # most widenings: each moves an end by a fifth of a frequency
# of the expected strength: a mode with more is the expected one, because all others together have less
SURE = 0.5


@dataclass(frozen=True)
class Target:
    """Target mode among the modes of its symmetry class.

    `rows` are all modes of the class from low_hz to high_hz, `beyond` those outside that the search examined; the verdict
    numbers both consecutively. `count` covers `rows`; it is None if there was no search, and `why` then gives the reason.
    missing: bound on the weight of any mode that was not computed, 0 if none was requested; reach_hz: interval in which all
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
        """Whether a mode outside the searched range may rival the target mode."""
        return self.row is not None and leaves_room(self.missing, float(weights([self.row])[0]))

    @property
    def status(self) -> Status:
        """Status of the verdict: single, split or none."""
        return self.verdict.status

    @property
    def row(self) -> ModeRow | None:
        """The target mode, or None."""
        return None if self.verdict.index is None else (*self.rows, *self.beyond)[self.verdict.index]

    @property
    def rivals(self) -> tuple[ModeRow, ...]:
        """Other modes that carry the target shape, strongest first."""
        every = (*self.rows, *self.beyond)
        return tuple(every[i] for i in self.verdict.rivals)

    def each(self, change: Callable[[ModeRow], ModeRow]) -> Target:
        """Apply a function to every mode; the verdict stays."""
        return replace(self, rows=tuple(map(change, self.rows)), beyond=tuple(map(change, self.beyond)))

    def record(self, **more: Any) -> TargetRecord:
        """Record of the mode, its rivals, the window, and the mode's share of the target shape there."""
        rivals = [RivalRecord.of(rival) for rival in self.rivals]
        more |= {"status": self.status, "share": self.verdict.share, "rivals": rivals}
        more |= {"window_hz": [self.low_hz, self.high_hz], "driven_confinement_db": None}
        if self.row is None:
            return TargetRecord(frequency_hz=None, mac=None, strength=None, confinement_db=None, **more)
        return TargetMode.of(self.row, **more)


def look(
    window_hz: tuple[float, float],
    known: Count,
    rows: tuple[ModeRow, ...],
    solve: Callable[[float, float], tuple[tuple[ModeRow, ...], Count]],
    largest: Largest[ModeRow] | None = None,
) -> Target:
    """Search the target mode from a window outwards, reusing the `rows` of its class that are already known.

    `solve` returns every mode of the class between two frequencies, `largest` an upper bound on the share of the shape that
    a mode outside an interval can have. The result does not depend on `rows`.
    """
    if known.high_hz < window_hz[0] or known.low_hz > window_hz[1]:
        return Target(NONE, (), *window_hz, None, "the requested frequencies do not reach it")
    found = search(window_hz, (known.low_hz, known.high_hz), rows, lambda low, high: solve(low, high)[0], largest)
    low, high = found.window_hz
    inside = [low <= row.frequency_hz <= high for row in found.modes]
    order = [i for side in (True, False) for i, own in enumerate(inside) if own is side]
    place = {old: new for new, old in enumerate(order)}
    index = None if found.verdict.index is None else place[found.verdict.index]
    judged = replace(found.verdict, index=index, rivals=tuple(place[i] for i in found.verdict.rivals))
    every, own = tuple(found.modes[i] for i in order), sum(inside)
    count = Count(low, high, own, own)
    return Target(judged, every[:own], low, high, count, "", every[own:], found.missing, found.reach_hz)


def look_about(
    expected: Expected,
    known: Count,
    rows: tuple[ModeRow, ...],
    solve: Callable[[float, float], tuple[tuple[ModeRow, ...], Count]],
) -> Target:
    """Search a mode found by another model from the window of the `rows` outwards, by half its width on each side."""
    for _ in range(ROUNDS):
        outcome = look_among(rows, known)
        if outcome.row is not None and (outcome.row.strength or 0.0) >= SURE * expected.strength:
            break
        step = (known.high_hz - known.low_hz) / 2.0
        ends = max(known.low_hz - step, expected.frequency_hz / 2.0), known.high_hz + step
        rows, known = _completed(rows, known, ends, solve)
    return outcome


def look_among(rows: tuple[ModeRow, ...], known: Count) -> Target:
    """Return the verdict over the given modes alone."""
    reach, missing = (known.low_hz, known.high_hz), missing_strength(rows)
    judged = verdict(*measures(rows), missing=missing) if rows else NONE
    return Target(judged, rows, *reach, known, missing=missing, reach_hz=reach)


def _completed(
    rows: tuple[ModeRow, ...],
    known: Count,
    ends: tuple[float, float],
    solve: Callable[[float, float], tuple[tuple[ModeRow, ...], Count]],
) -> tuple[tuple[ModeRow, ...], Count]:
    """Return the rows and their count over the known interval and the window together."""
    if ends[0] < known.low_hz:
        more, count = solve(ends[0], known.low_hz)
        rows, known = (*more, *rows), joined(count, known)
    if ends[1] > known.high_hz:
        more, count = solve(known.high_hz, ends[1])
        rows, known = (*rows, *more), joined(known, count)
    return rows, known


def joined(low: Count, high: Count) -> Count:
    """Count over two intervals, of which the second begins where the first ends."""
    return Count(low.low_hz, high.high_hz, low.expected + high.expected, low.found + high.found, low.below)


# -- in words ----------------------------------------------------------------------------------------------------------


def verdict_text(target: Target, design: Design) -> list[str]:
    """Name the target mode, or explain why there is none."""
    name, row = f"(0, {design.nodal_lines})", target.row
    window = interval(target.low_hz, target.high_hz, to=" and ")
    if row is None and target.count is None:
        return [f"The target {name} mode is expected between {window}: {target.why}."]
    if row is None:
        return [f"No mode between {window} has the target {name} shape: every MAC is below one half."]
    level_text = _level(row)
    tone = frequency_with_bar(row.frequency_hz, row.error)
    if target.status == "single":
        return [f"target {name} mode: {tone}, {_alike(row)}{level_text}"]
    others = "; ".join(_named(rival) for rival in target.rivals)
    how = "is split among several modes" if others or not target.is_open else "may be split among several modes"
    return [
        f"The target {name} shape {how}: strongest at {tone}, "
        f"{_alike(row)}{level_text}" + (f"; others: {others}" if others else _alone(row)) + _outside(target)
    ]


def _outside(target: Target) -> str:
    """State the possible strength of modes that were not computed, if it could rival the strongest."""
    if not target.is_open or target.reach_hz is None:
        return ""
    reach = interval(*target.reach_hz)
    most = figure(target.missing, target.missing)
    return f"; modes outside the searched range of {reach} may have a strength of up to {most}"


def _named(row: ModeRow) -> str:
    tone = frequency_with_bar(row.frequency_hz, row.error)
    return f"{tone} ({_alike(row)}{_level(row)})"


def _alike(row: ModeRow) -> str:
    return f"MAC {figure(row.mac, row.mac_error)}, strength {figure(row.strength, row.strength_error)}"


def _level(row: ModeRow) -> str:
    return "" if row.confinement_db is None else f", {with_bar(row.confinement_db, row.confinement_error_db, 'dB')}"


def _alone(row: ModeRow) -> str:
    return (
        f"; no other is a quarter as strong, but its MAC is below {MIN_MAC_SINGLE:g}"
        if (row.mac or 0.0) < MIN_MAC_SINGLE
        else ""
    )


def warn_of_target(target: Target, case: Case, log: Log) -> None:
    """Log the target mode; warn if there is none, or if several modes share its shape."""
    (said,) = verdict_text(target, case.design)
    if target.status == "single":
        log.info(said)
    else:
        log.warning("NO_MODE" if target.status == "none" else "SPLIT_MODE", said)
