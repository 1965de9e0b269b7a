"""Designs as a search evaluates them: the goal, what limits they break, which of them no other beats."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from geometry.elements import FloatArray
from geometry.layout import Design
from pipeline.search.fidelity import FidelityResult, frequency_slack
from pipeline.search.limits import Limits, mass_kg
from pipeline.search.space import Space
from pipeline.search.terms import GOALS, LESS, PLATE, FoundDesign, Values, Window, unit_of

EVALUATIONS = 16  # assembled plates
VIOLATION_DB = 1000.0  # dB below any design that keeps the limits
STEEP = 1000.0  # dB for breaking a limit by its own size: a slope that the local search follows, not a cliff that it sticks to


@dataclass(frozen=True)
class Settings:
    """What to maximise, what to keep, how many assembled plates to spend."""

    goal: str = "confinement"
    limits: Limits = field(default_factory=Limits)
    evaluations: int = EVALUATIONS


@dataclass(frozen=True)
class Outcome:
    """All evaluations by fidelity; the design of the file and the best one, both solved as `antinode modes` would.

    window: the band about the best design's mode, kHz, where the case's own window does not hold it well inside.
    """

    space: Space
    settings: Settings
    by_fidelity: dict[str, tuple[FoundDesign, ...]]
    base: FoundDesign
    best: FoundDesign
    softness: float
    window: Window | None = None

    @property
    def repeat(self) -> list[str]:
        """The --set texts that make the best design from the file."""
        window = ["solve.band_kHz=[{!r},{!r}]".format(*self.window)] if self.window else []
        return [*self.space.fixed, *self.space.overrides(self.best.point), *window]

    @property
    def gain(self) -> float | None:
        """Gain of the best design over the design of the file, in the goal's unit."""
        if self.best.goal_value is None or self.base.goal_value is None:
            return None
        return self.best.goal_value - self.base.goal_value

    @property
    def gain_error_db(self) -> float | None:
        """Error bar of the gain, dB: both designs' own expected errors."""
        if self.gain is None:
            return None
        base, best = (each.goal_error(self.settings.goal) for each in (self.base, self.best))
        return None if base is None or best is None else base + best

    @property
    def tradeoff(self) -> list[FoundDesign]:
        """Assembled plates within the limits that no other beats in goal, frequency and mass at once, best goal first."""
        return front([each for each in self.by_fidelity[PLATE] if each.keeps])


def front(evaluations: Sequence[FoundDesign]) -> list[FoundDesign]:
    """Designs that no other beats in goal, frequency and mass at once (Pareto), by falling goal."""

    def worth(each: FoundDesign) -> FloatArray:
        mass = each.mass_kg if each.mass_kg is not None else 0.0
        return np.array([each.goal_value or 0.0, each.frequency_hz or 0.0, -mass])

    undominated = [
        each
        for each in evaluations
        if not any((worth(o) >= worth(each)).all() and (worth(o) > worth(each)).any() for o in evaluations)
    ]
    return sorted(undominated, key=lambda each: -each.objective)


def rate(
    space: Space, values: Values, result: FidelityResult, settings: Settings, design: Design | None = None
) -> FoundDesign:
    """Compute goal, mass and limits of an evaluated design; none of them without one, which could not be built."""
    own = {"set": space.written(values), "point": values, "warnings": result.warnings}
    goal: float | None = getattr(result, GOALS[settings.goal][0])
    if design is None or goal is None or result.frequency_hz is None or result.mac is None:
        return FoundDesign.of(result, mass_kg=None, violations=[], **own)
    goal = -goal if unit_of(settings.goal) in LESS else goal
    violated, strict = (
        settings.limits.of_design(design)
        + settings.limits.of_mode(result.frequency_hz, result.mac, slack)
        + settings.limits.of_zones(result.isolation_db, slack)
        for slack in (frequency_slack(result.fidelity, design.nodal_lines), 0.0)
    )
    excess = sum(amount for _, amount in violated)
    return FoundDesign.of(
        result,
        mass_kg=mass_kg(design),
        violations=[text for text, _ in violated],
        goal_value=goal,
        objective=goal if not violated else -VIOLATION_DB * (1.0 + excess),
        penalised_objective=goal - STEEP * sum(amount for _, amount in strict) - float(bool(strict)),
        **own,
    )
