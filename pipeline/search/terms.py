"""The terms of a search: models, goals, and keys between two ends. Only light modules are imported: help shows them."""

from __future__ import annotations

from typing import Any, NamedTuple

from pipeline.errors import InputError
from pipeline.quantity import figure, frequency_with_bar, level_with_bar, with_bar
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
UNBUILT = -1e6  # objective of what cannot be built or evaluated
Values = tuple[float | int, ...]
Window = tuple[float, float]  # kHz


def unit_of(goal: str) -> str:
    """Return the unit of a goal."""
    return UNITS.get(goal, "dB")


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
    """The target mode of one design as one model computed it; None where it has none, and then the reason.

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


class FoundDesign(FidelityResult):
    """A design as a model evaluated it. With several zones: lowest peak, least MAC and level of all, each driven in turn."""

    set: dict[str, float | str] = column("values of the varied keys in the file's units, or words; none as given")
    mass_kg: float | None = column("mass of plate and pillars, fillets left out", "kg")
    violations: list[str] = column("limits that it breaks")
    point: Values = live(default=())  # values of the variables in their order
    # None: nothing to evaluate. In dB or in the goal's unit; below 0 where less is better
    goal_value: float | None = live()
    objective: float = live(default=UNBUILT)
    # ranks designs for the next model, and a local search raises it: the goal, less what a violated limit costs the more it is
    # violated, without the slack that a cheap model has before a limit counts as violated
    penalised_objective: float = live(default=UNBUILT)

    @property
    def keeps(self) -> bool:
        """Whether the design was evaluated and keeps every limit."""
        return self.goal_value is not None and not self.violations

    def text(self, goal: str) -> str:
        """Describe the figure of a goal with its bar, the mode that it is of, and the limits that the design breaks."""
        value, unit = getattr(self, GOALS[goal][0]), unit_of(goal)
        if value is None or self.frequency_hz is None:
            return f"not evaluated: {self.why_not}"
        breaks = f"; breaks: {'; '.join(self.violations)}" if self.violations else ""
        best = level_with_bar(value, self.goal_error(goal)) if unit == "dB" else with_bar(value, None, unit)
        tone = frequency_with_bar(self.frequency_hz, self.frequency_error)
        return f"{best} at {tone}, MAC {figure(self.mac)}{breaks}"

    def goal_error(self, goal: str) -> float | None:
        """Half-width of the error bar of a goal's level; None for a goal that is no level, and without an estimate."""
        error: float | None = getattr(self, f"{GOALS[goal][0].removesuffix('_db')}_error_db", None)
        return error
