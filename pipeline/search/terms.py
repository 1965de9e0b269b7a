"""Terms of a search: models, goals, limits, and keys between two ends. It imports light modules only, because help needs it."""

from __future__ import annotations

from itertools import pairwise
from math import atan2, degrees
from typing import TYPE_CHECKING, Any, NamedTuple

from pipeline.errors import InputError
from pipeline.quantity import KHZ, MM, figure, frequency, frequency_with_bar, level, level_with_bar, with_bar
from pipeline.records.part import Part, bar, column, live

if TYPE_CHECKING:
    from geometry.layout import Design, Pillar

STRIP, COLUMN, PLATE, SOLID = "strip", "column", "plate", "solid"

GOALS = {  # figure to maximise, and its axis label
    "confinement": ("confinement_db", "confinement (dB)"),
    "extension": ("extension_db", "zone relative to margin (dB)"),
    "worst": ("worst_db", "least confinement with height errors (dB)"),
    "widest": ("band_khz", "band with 10 dB attenuation by the rows (kHz)"),
    "isolation": ("isolation_db", "driven zone relative to the others (dB)"),
    "closest": ("gap_mm", "gap between zones (mm)"),
}

UNITS = {"widest": "kHz", "closest": "mm"}  # of a goal; dB of any other
LESS = ("mm",)  # units of goals to minimise, which count as negative
End = float | str | bool  # end of a range: a number in the file's unit, or one of two choices
MISSING = "must be KEY=LOW:HIGH, such as pillar.height_mm=5:8"
UNBUILT = -1e6  # objective of a design that cannot be built or evaluated
Values = tuple[float | int, ...]
Window = tuple[float, float]  # kHz


class Range(NamedTuple):
    """A dotted key of the case file and the two ends that it varies between."""

    key: str
    low: End
    high: End

    @classmethod
    def between(cls, key: str, ends: Any) -> Range:
        """Return the range of a key between two ends; InputError for anything else."""
        if not isinstance(ends, tuple | list) or len(ends) != 2:
            raise InputError(f"{key} = {ends!r}: must be two ends, (low, high)")
        return cls(key, *ends)

    @classmethod
    def read(cls, text: str) -> Range:
        """Return the range of "key=low:high"; InputError for any other text."""
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
    """Target mode of one design from one model; figures are None without a target mode, and `why_not` gives the reason.

    Several zones are driven in turn; the result has the lowest peak, and the least MAC, confinement and isolation.
    """

    fidelity: str = column("model that evaluated it: strip, column or plate")
    frequency_hz: float | None = column("frequency of the target mode", "Hz", error="frequency_error", default=None)
    frequency_error: float | None = bar("frequency_hz, relative", default=None)
    confinement_db: float | None = column("confinement", "dB", error="confinement_error_db", default=None)
    confinement_error_db: float | None = bar("confinement_db", "dB", default=None)
    extension_db: float | None = column(
        "level of the zone relative to the plate beyond the rows", "dB", error="extension_error_db", default=None
    )
    extension_error_db: float | None = bar("extension_db", "dB", default=None)
    mac: float | None = column("modal assurance criterion with the target shape", default=None)
    worst_db: float | None = column(
        "least confinement with all heights as designed, too low or too high",
        "dB",
        error="worst_error_db",
        default=None,
    )
    worst_error_db: float | None = bar("worst_db", "dB", default=None)
    band_khz: float | None = column(
        "width of the band around the mode in which the rows attenuate by 10 dB", "kHz", default=None
    )
    isolation_db: float | None = column(
        "least level of a driven zone relative to another one", "dB", error="isolation_error_db", default=None
    )
    isolation_error_db: float | None = bar("isolation_db", "dB", default=None)
    gap_mm: float | None = column("gap between the borders of two zones", "mm", default=None)
    why_not: str | None = column("reason why it could not be evaluated; None if it was", default=None)
    warnings: list[tuple[str, str]] = live("id and text of each warning of the solve", default_factory=list)


class FoundDesign(FidelityResult):
    """Design evaluated by a model. Several zones are driven in turn: lowest peak, least MAC and level of all."""

    set: dict[str, float | str] = column(
        "values of the varied keys in the file's units, or words; empty for the original"
    )
    mass_kg: float | None = column("mass of plate and pillars without fillets", "kg")
    violations: list[str] = column("limits that it violates")
    point: Values = live("values of the variables in their order", default=())
    goal_value: float | None = live(
        "value in dB or the goal's unit, negative if less is better; None if nothing was evaluated"
    )
    objective: float = live(
        "the goal, or a negative penalty for a design that violates a limit or was not evaluated", default=UNBUILT
    )
    penalised_objective: float = live(
        "goal minus a penalty that grows with the violation of a limit, without the slack that a cheap model otherwise "
        "has: it ranks designs for the next model, and the local search maximises it",
        default=UNBUILT,
    )

    @property
    def keeps(self) -> bool:
        """Whether the design was evaluated and keeps every limit."""
        return self.goal_value is not None and not self.violations

    def text(self, goal: str) -> str:
        """Describe the figure of a goal with its error bar, its mode, and the limits that the design violates."""
        value, unit = getattr(self, GOALS[goal][0]), unit_of(goal)
        if value is None or self.frequency_hz is None:
            return f"not evaluated: {self.why_not}"
        breaks = f"; violates: {'; '.join(self.violations)}" if self.violations else ""
        best = level_with_bar(value, self.goal_error(goal)) if unit == "dB" else with_bar(value, None, unit)
        tone = frequency_with_bar(self.frequency_hz, self.frequency_error)
        return f"{best} at {tone}, MAC {figure(self.mac)}{breaks}"

    def goal_error(self, goal: str) -> float | None:
        """Error of a goal's level, dB; None for a goal that is not a level, and without an estimate."""
        error: float | None = getattr(self, f"{GOALS[goal][0].removesuffix('_db')}_error_db", None)
        return error


class Limits(Part):
    """Limits on the target mode, on the printed geometry, and on a driven zone's level relative to the others."""

    lowest_hz: float = column("least frequency of the target mode", "Hz", default=25 * KHZ)
    highest_hz: float | None = column("largest frequency of the target mode; None for no limit", "Hz", default=None)
    half_wavelength_m: float = column("largest half-wavelength along the zone", "m", default=20 * MM)
    feature_m: float = column("smallest feature", "m", default=0.4 * MM)
    mac: float = column("least modal assurance criterion with the target shape", default=0.8)
    isolation_db: float | None = column(
        "least level of a driven zone relative to every other; None for no limit", "dB", default=None
    )

    def of_design(self, design: Design) -> list[tuple[str, float]]:
        """Limits that the geometry violates, in words, with the relative excess."""
        from geometry.cad.printing import SUPPORT_DEG, features

        violations = []
        half = design.half_wavelength_m or design.length_m  # rigid shapes: the whole length
        if not half <= self.half_wavelength_m:
            text = f"half-wavelength {figure(half / MM)} mm, at most {self.half_wavelength_m / MM:g}"
            violations.append((text, half / self.half_wavelength_m - 1.0))
        name, size = min(features(design).items(), key=lambda item: item[1])
        if size < self.feature_m * (1.0 - 1e-9):
            violations.append(
                (f"{name} {size / MM:g} mm, at least {self.feature_m / MM:g}", 1.0 - size / self.feature_m)
            )
        lean = max((overhang_deg(pillar) for pillar in design.kinds), default=0.0)
        first = design.pillar
        if first and design.rows and first.faces == 2 and first.material == design.stack.back:
            violations.append(
                ("pillars on both faces cannot be printed with the plate, whose underside would be unsupported", 1.0)
            )
        if lean > SUPPORT_DEG:
            violations.append(
                (f"pillars lean out by {figure(lean)} degrees, at most {SUPPORT_DEG:g}", lean / SUPPORT_DEG - 1.0)
            )
        return violations

    def of_mode(self, frequency_hz: float, mac: float, slack: float = 0.0) -> list[tuple[str, float]]:
        """Limits that the target mode violates by more than `slack` (the relative error of a cheap model)."""
        violations = []
        if frequency_hz < self.lowest_hz * (1.0 - slack):
            text = f"{frequency(frequency_hz)}, at least {self.lowest_hz / KHZ:g}"
            violations.append((text, 1.0 - frequency_hz / self.lowest_hz))
        if self.highest_hz is not None and frequency_hz > self.highest_hz * (1.0 + slack):
            text = f"{frequency(frequency_hz)}, at most {self.highest_hz / KHZ:g}"
            violations.append((text, frequency_hz / self.highest_hz - 1.0))
        if mac < self.mac * (1.0 - slack):
            violations.append((f"MAC {figure(mac)} with the target shape, at least {self.mac:g}", 1.0 - mac / self.mac))
        return violations

    def of_zones(self, isolation_db: float | None, slack: float = 0.0) -> list[tuple[str, float]]:
        """The limit on a driven zone's level relative to the others, if it is violated by more than `slack`."""
        least = self.isolation_db
        if least is None or isolation_db is None or isolation_db >= least * (1.0 - slack):
            return []
        return [(f"isolation {level(isolation_db)}, at least {least:g}", 1.0 - isolation_db / least)]


def unit_of(goal: str) -> str:
    """Return the unit of a goal."""
    return UNITS.get(goal, "dB")


def overhang_deg(pillar: Pillar) -> float:
    """Overhang of the pillar's sides, degrees from the vertical; 0 for sides that do not lean outwards, and for a STEP file.

    Sections of one material are printed together; one that is wider than the section below has a horizontal underside.
    """
    for below, above in pairwise(pillar.parts):
        if above.material == below.material and above.base_m > below.tip_m:
            return 90.0
    slopes = [degrees(atan2((part.tip_m - part.base_m) / 2.0, part.height_m)) for part in pillar.parts]
    return max(0.0, *slopes)


def mass_kg(design: Design) -> float:
    """Mass of plate and pillars without fillets, kg."""
    length, width = design.plate_m
    plate = length * width * design.stack.mass_kg_m2
    return plate + sum(len(each.centres) * each.pillar.faces * each.pillar.mass_kg for each in design.standing())
