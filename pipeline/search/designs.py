"""Designs as a search evaluates them: the goal, what limits they break, which of them no other beats."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from geometry.elements import FloatArray
from geometry.layout import Design
from pipeline.quantity import figure, frequency_with_bar, level_with_bar, with_bar
from pipeline.search.fidelity import FidelityResult, frequency_slack
from pipeline.search.limits import Limits, mass_kg
from pipeline.search.space import Space
from pipeline.search.terms import GOALS, LESS, PLATE, UNITS, error_of

EVALUATIONS = 16  # assembled plates
VIOLATION_DB = 1000.0  # dB below any design that keeps the limits
STEEP = 1000.0  # dB for breaking a limit by its own size: a slope that the local search follows, not a cliff that it sticks to
UNBUILT = -1e6  # objective of what cannot be built or evaluated

Values = tuple[float | int, ...]


@dataclass(frozen=True)
class Settings:
    """What to maximise, what to keep, how many assembled plates to spend."""

    goal: str = "confinement"
    limits: Limits = field(default_factory=Limits)
    evaluations: int = EVALUATIONS


@dataclass(frozen=True)
class Evaluation:
    """A design as one fidelity evaluated it: the goal in dB or in `unit` (None: nothing to evaluate; less than 0 where the less
    is the better), the limits it breaks, its objective.

    `penalised_objective` ranks designs for the next fidelity, and a local search raises it: the goal, less what a violated
    limit costs the more it is violated, without the slack that a cheap fidelity has before a limit counts as violated.
    `goal_error_db` is the half-width of the goal's error bar; None for a goal that is no level, and without an estimate.
    """

    values: Values
    result: FidelityResult
    goal_db: float | None
    mass_kg: float | None
    violations: tuple[str, ...]
    objective: float
    penalised_objective: float
    unit: str = "dB"
    goal_error_db: float | None = None

    @property
    def keeps(self) -> bool:
        """Whether the design was evaluated and keeps every limit."""
        return self.goal_db is not None and not self.violations


@dataclass(frozen=True)
class Outcome:
    """All evaluations by fidelity; the design of the file and the best one, both solved as `antinode modes` would."""

    space: Space
    settings: Settings
    by_fidelity: dict[str, tuple[Evaluation, ...]]
    base: Evaluation
    best: Evaluation
    softness: float
    window: tuple[str, ...] = ()

    @property
    def repeat(self) -> list[str]:
        """The --set texts that make the best design from the file."""
        return [*self.space.fixed, *self.space.overrides(self.best.values), *self.window]

    @property
    def gain_db(self) -> float | None:
        """Gain of the best design over the design of the file, dB."""
        if self.best.goal_db is None or self.base.goal_db is None:
            return None
        return self.best.goal_db - self.base.goal_db

    @property
    def gain_error_db(self) -> float | None:
        """Error bar of the gain, dB: both designs' own expected errors."""
        base, best = self.base.goal_error_db, self.best.goal_error_db
        return None if base is None or best is None else base + best

    @property
    def tradeoff(self) -> list[Evaluation]:
        """Assembled plates within the limits that no other beats in goal, frequency and mass at once, best goal first."""
        return front([each for each in self.by_fidelity[PLATE] if each.keeps])


def front(evaluations: Sequence[Evaluation]) -> list[Evaluation]:
    """Designs that no other beats in goal, frequency and mass at once (Pareto), by falling goal."""

    def worth(each: Evaluation) -> FloatArray:
        mass = each.mass_kg if each.mass_kg is not None else 0.0
        return np.array([each.goal_db or 0.0, each.result.frequency_hz or 0.0, -mass])

    undominated = [
        each
        for each in evaluations
        if not any((worth(o) >= worth(each)).all() and (worth(o) > worth(each)).any() for o in evaluations)
    ]
    return sorted(undominated, key=lambda each: -each.objective)


def rate(values: Values, result: FidelityResult, settings: Settings, design: Design) -> Evaluation:
    """Compute goal, mass and limits of an evaluated design."""
    goal: float | None = getattr(result, GOALS[settings.goal][0])
    if goal is None or result.frequency_hz is None or result.mac is None:
        return Evaluation(values, result, None, None, (), UNBUILT, UNBUILT)
    unit = UNITS.get(settings.goal, "dB")
    goal = -goal if unit in LESS else goal
    violated, strict = (
        settings.limits.of_design(design)
        + settings.limits.of_mode(result.frequency_hz, result.mac, slack)
        + settings.limits.of_zones(result.isolation_db, slack)
        for slack in (frequency_slack(result.fidelity, design.nodal_lines), 0.0)
    )
    excess = sum(amount for _, amount in violated)
    mass = mass_kg(design)
    objective = goal if not violated else -VIOLATION_DB * (1.0 + excess)
    penalised_objective = goal - STEEP * sum(amount for _, amount in strict) - float(bool(strict))
    texts = tuple(text for text, _ in violated)
    known, error = mass if mass == mass else None, getattr(result, error_of(settings.goal), None)
    return Evaluation(values, result, goal, known, texts, objective, penalised_objective, unit, error)


def summary(each: Evaluation) -> str:
    """Describe an evaluation in a few words."""
    goal = None if each.goal_db is None else -each.goal_db if each.unit in LESS else each.goal_db
    return in_words(goal, each.unit, each.goal_error_db, each.result, each.violations)


def in_words(goal: float | None, unit: str, error: float | None, judged: Any, violations: Sequence[str]) -> str:
    """Describe a goal with its bar, the mode that it is of, and the limits that it breaks."""
    if goal is None or judged.frequency_hz is None:
        return f"not evaluated: {judged.why_not}"
    breaks = f"; breaks: {'; '.join(violations)}" if violations else ""
    best = level_with_bar(goal, error) if unit == "dB" else with_bar(goal, None, unit)
    tone = frequency_with_bar(judged.frequency_hz, judged.frequency_error)
    return f"{best} at {tone}, MAC {figure(judged.mac)}{breaks}"
