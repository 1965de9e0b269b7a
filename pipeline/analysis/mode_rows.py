"""One line a mode: where its vector is, and what was measured on it."""

from __future__ import annotations

from pydantic import Field

from pipeline.planning.request import SIGNS
from pipeline.records.record import ModeRecord
from solvers.fem.eigen import Modes
from solvers.measures.confinement import Confinement


class ModeRow(ModeRecord):
    """One mode: its record, and where its vector is (class and column)."""

    column: int = Field(exclude=True)
    extension_db: float | None = Field(None, exclude=True)


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
            column=first + i,
            **{name: float(getattr(measures, name)[i]) if measures else None for name in MEASURES},
        )
        for i, frequency in enumerate(modes.frequency_hz)
    ]
