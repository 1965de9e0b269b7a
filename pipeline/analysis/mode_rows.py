"""One line a mode: where its vector is, and what was measured on it."""

from __future__ import annotations

from collections.abc import Sequence

from pydantic import Field

from pipeline.planning.error_bar import WidestBar
from pipeline.planning.request import SIGNS
from pipeline.quantity import frequency
from pipeline.records.record import ModeRecord
from solvers.fem.eigen import Modes
from solvers.measures.confinement import Confinement


class ModeRow(ModeRecord):
    """One mode: its record, where its vector is (class and column), and what its bar is made of (relative)."""

    column: int = Field(exclude=True)
    extension_db: float | None = Field(None, exclude=True)
    error_parts: dict[str, float] = Field({}, exclude=True)


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
            **{name: float(getattr(measures, name)[i]) if measures else None for name in MEASURES},
        )
        for i, frequency in enumerate(modes.frequency_hz)
    ]
