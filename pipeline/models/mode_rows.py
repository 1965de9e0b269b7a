"""One line a mode: where its vector is, and what was measured on it."""

from __future__ import annotations

from collections.abc import Sequence
from math import isfinite

from pipeline.models.mode_parts import ModeRecord
from pipeline.planning.error_bar import WidestBar
from pipeline.planning.model_choice import SIGNS
from pipeline.quantity import frequency
from pipeline.records.part import live
from solvers.fem.eigen import Modes
from solvers.measures.confinement import Confinement


class ModeRow(ModeRecord):
    """One mode: its record, where its vector is (class and column), and what its bar is made of (relative)."""

    column: int = live()
    extension_db: float | None = live()
    error_parts: dict[str, float] = live(default_factory=dict)


def widest_bar(rows: Sequence[ModeRow]) -> WidestBar:
    """Find the widest bar of some modes, and what it is made of; unknown where one of them has no bar."""
    bars = [row.error for row in rows]
    known = [bar for bar in bars if bar is not None]
    if not known or len(known) < len(bars):
        return WidestBar(None)
    row = rows[bars.index(max(known))]
    return WidestBar(row.error, f"the mode at {frequency(row.frequency_hz, row.error)}", row.error_parts)


MEASURES = ("zone_share", "confinement_db", "mac", "strength", "extension_db")


def mode_rows(modes: Modes, symmetry: str | None, measures: Confinement | None, first: int = 0) -> list[ModeRow]:
    """Return one row a mode with columns counted from `first`; a measure without meaning is None."""
    return [
        ModeRow(
            frequency_hz=float(frequency),
            residual=float(modes.residual[i]),
            symmetry=symmetry,
            parity=SIGNS[symmetry] if symmetry else None,
            error=None,
            confinement_error_db=None,
            column=first + i,
            error_parts={},
            **{name: _number(getattr(measures, name)[i]) if measures else None for name in MEASURES},
        )
        for i, frequency in enumerate(modes.frequency_hz)
    ]


def _number(value: float) -> float | None:
    return float(value) if isfinite(value) else None
