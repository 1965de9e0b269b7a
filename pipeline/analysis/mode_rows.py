"""One line a mode: where its vector is, and what was measured on it."""

from __future__ import annotations

import math
from dataclasses import dataclass

from geometry.elements import FloatArray
from pipeline.planning.request import SIGNS
from solvers.fem.eigen import Modes
from solvers.measures.confinement import Confinement


@dataclass(frozen=True)
class ModeRow:
    """One mode: where its vector is (class and column), and its measures (None where they have no meaning)."""

    frequency_hz: float
    residual: float
    symmetry: str | None
    column: int
    zone_share: float | None
    confinement_db: float | None
    mac: float | None
    extension_db: float | None = None
    strength: float | None = None

    @property
    def parity(self) -> str | None:
        """The symmetry class as two signs, x then y: u_z even (+) or odd (-)."""
        return SIGNS[self.symmetry] if self.symmetry else None


def mode_rows(modes: Modes, symmetry: str | None, measures: Confinement | None, first: int = 0) -> list[ModeRow]:
    """Return one row a mode with columns counted from `first`; a measure without meaning is None."""

    def at(values: FloatArray | None, index: int) -> float | None:
        value = float(values[index]) if values is not None else math.nan
        return value if math.isfinite(value) else None

    return [
        ModeRow(
            float(frequency),
            float(modes.residual[i]),
            symmetry,
            first + i,
            at(measures.zone_share if measures else None, i),
            at(measures.confinement_db if measures else None, i),
            at(measures.mac if measures else None, i),
            at(measures.extension_db if measures else None, i),
            at(measures.strength if measures else None, i),
        )
        for i, frequency in enumerate(modes.frequency_hz)
    ]
