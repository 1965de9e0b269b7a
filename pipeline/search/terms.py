"""The terms of a search: models, goals, and keys between two ends. Only light modules are imported: help shows them."""

from __future__ import annotations

from typing import Any, NamedTuple

from pipeline.errors import InputError
from pipeline.records.part import Part, bar, column, live

STRIP, COLUMN, PLATE, SOLID = "strip", "column", "plate", "solid"
GOALS = {  # of a design: the figure that is raised, and its words on an axis
    "confinement": ("confinement_db", "confinement (dB)"),
    "extension": ("extension_db", "zone to extension (dB)"),
    "worst": ("worst_db", "least confinement, heights off (dB)"),
    "widest": ("band_khz", "band in which rows take 10 dB (kHz)"),
    "isolation": ("isolation_db", "driven zone over the others (dB)"),
    "closest": ("gap_mm", "gap between zones (mm)"),
}
UNITS = {"widest": "kHz", "closest": "mm"}  # of a goal; dB of any other
LESS = ("mm",)  # of units: the less the better, so that a goal counts below 0
End = float | str | bool  # of a range: a number in the file's unit, or one of two choices
MISSING = "must be KEY=LOW:HIGH, such as pillar.height_mm=5:8"


def error_of(goal: str) -> str:
    """Return the name of the error bar of a goal's level."""
    return f"{GOALS[goal][0].removesuffix('_db')}_error_db"


class Range(NamedTuple):
    """A dotted key of the case file and the two ends that it varies between."""

    key: str
    low: End
    high: End

    @classmethod
    def between(cls, key: str, ends: Any) -> Range:
        """Return the range of a key between two ends. Raises InputError for what are none."""
        if not isinstance(ends, tuple | list) or len(ends) != 2:
            raise InputError(f"{key} = {ends!r}: must be two ends, (low, high)")
        return cls(key, *ends)

    @classmethod
    def read(cls, text: str) -> Range:
        """Return the range of "key=low:high". Raises InputError for another text."""
        from pipeline.case.reading import parse_value

        key, equals, ends = (part.strip() for part in text.partition("="))
        if not equals or ends.count(":") != 1:
            raise InputError(f"--vary {text}: {MISSING}")
        return cls(key, *map(parse_value, ends.split(":")))

    def __str__(self) -> str:
        from pipeline.case.reading import toml_text

        low, high = (end if isinstance(end, str) else toml_text(end) for end in self[1:])
        return f"{self.key}={low}:{high}"


class FidelityResult(Part):
    """The wanted mode of one design as one model computed it; None where it has none, and then the reason.

    With several zones each is driven in turn: the lowest peak, and the least MAC, confinement and level over another zone.
    """

    fidelity: str = column("model that evaluated it: strip, column or plate")
    frequency_hz: float | None = column("frequency of the target mode", "Hz", error="frequency_error", default=None)
    frequency_error: float | None = bar("frequency_hz, relative", default=None)
    confinement_db: float | None = column("confinement", "dB", error="confinement_error_db", default=None)
    confinement_error_db: float | None = bar("confinement_db", "dB", default=None)
    extension_db: float | None = column(
        "level of the zone over the plate beyond the rows", "dB", error="extension_error_db", default=None
    )
    extension_error_db: float | None = bar("extension_db", "dB", default=None)
    mac: float | None = column("modal assurance criterion with the target shape", default=None)
    worst_db: float | None = column(
        "least confinement with all heights as designed, too low and too high",
        "dB",
        error="worst_error_db",
        default=None,
    )
    worst_error_db: float | None = bar("worst_db", "dB", default=None)
    band_khz: float | None = column(
        "width of the band about the mode in which the rows take 10 dB", "kHz", default=None
    )
    isolation_db: float | None = column(
        "least level of a driven zone over another one", "dB", error="isolation_error_db", default=None
    )
    isolation_error_db: float | None = bar("isolation_db", "dB", default=None)
    gap_mm: float | None = column("distance of two zones' borders", "mm", default=None)
    why_not: str | None = column("why it could not be evaluated; None where it was", default=None)
    warnings: list[tuple[str, str]] = live(default_factory=list)  # id and text of the solve's
