"""Search for the design that confines the target mode best, with cheap models everywhere and expensive ones where it pays.

Strips evaluate a whole grid of designs in seconds. The best of them, well apart, go to columns of computed cells, and the
best of those to assembled plates. Each computed model ends with a Nelder-Mead descent from its best design (scipy), and with
steps of one in counts and choices. The best and the original design are finally solved like `antinode modes`, so that the
reported result is the one that the user gets.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from itertools import product
from typing import NamedTuple

import numpy as np

from geometry.elements import FloatArray
from geometry.layout import Design
from pipeline.case.features import LARGER, SUPPORTS, ZONES
from pipeline.case.model import Case, parsed
from pipeline.case.reading import effective
from pipeline.errors import CheckFailed, InputError
from pipeline.logs import Log
from pipeline.models.broadband import checked
from pipeline.models.forced import check_zones
from pipeline.planning import simplifications
from pipeline.planning.model_choice import check_stagger
from pipeline.planning.simplifications import Simplification
from pipeline.quantity import figure, frequency
from pipeline.search.fidelity import (
    COLUMN,
    STRIP,
    EvaluationCache,
    FidelityResult,
    by_strip,
    evaluate,
    frequency_slack,
    kept_cell,
    window_around,
    worst,
)
from pipeline.search.space import Space
from pipeline.search.terms import GOALS, LESS, PLATE, UNBUILT, FoundDesign, Limits, Values, Window, mass_kg, unit_of

EVALUATIONS = 16  # assembled plates
VIOLATION_DB = 1000.0  # dB below any design that keeps the limits
STEEP = 1000.0  # dB for exceeding a limit by 100 %: a slope that guides the local search, where a step would trap it

COLUMNS_A_PLATE = 3
OF_ZONES = ("confinement", "worst", "isolation", "closest")  # goals of several zones; the last two need several
UNLIKE = {"pillar.shape", "pillar.fillet_mm"}  # keys that may rule out a column of cells
MAX_ENDS = 8  # most variables for which all combinations of ends are checked
SOFTNESS = 0.5  # of a half-space's compliance, at a pillar's foot, until a column calibrates it
SOFTEST = 2.0
GRID = {1: 121, 2: 25}  # strips along each axis; more than two axes use Sobol's points
SOBOL = 10  # 2^10 strips
APART = 0.12  # of the box: least distance between candidates for the next model
FIRST_STEP = 0.06  # of the box: the descent's first simplex
FINEST = 0.004
MAX_CONFIRMED = 3


@dataclass(frozen=True)
class Settings:
    """Goal, limits and number of assembled plates of a search."""

    goal: str = "confinement"
    limits: Limits = field(default_factory=Limits)
    evaluations: int = EVALUATIONS


@dataclass(frozen=True)
class Outcome:
    """All evaluations by model, with the design of the file and the best one, both solved like `antinode modes`.

    window: band around the best design's mode, kHz, if the mode does not lie well inside the case's own window.
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
        """Return the --set texts that turn the file's design into the best one."""
        window = ["solve.band_kHz=[{!r},{!r}]".format(*self.window)] if self.window else []
        changes = [*self.space.overrides(self.best.point), *window]
        texts = [*self.space.fixed, *changes]
        given = parsed(texts)
        kept = dict(effective(given))
        return [text for text, (key, _) in zip(texts, given, strict=True) if key in kept]

    @property
    def gain(self) -> float | None:
        """Gain of the best design over the design of the file, in the goal's unit."""
        if self.best.goal_value is None or self.base.goal_value is None:
            return None
        return self.best.goal_value - self.base.goal_value

    @property
    def gain_error_db(self) -> float | None:
        """Error of the gain, dB: the sum of both designs' errors."""
        if self.gain is None:
            return None
        base, best = (each.goal_error(self.settings.goal) for each in (self.base, self.best))
        return None if base is None or best is None else base + best

    @property
    def tradeoff(self) -> list[FoundDesign]:
        """Pareto-optimal assembled plates within the limits, by goal, frequency and mass, best goal first."""
        return front([each for each in self.by_fidelity[PLATE] if each.keeps])


class Budget(NamedTuple):
    """Largest number of designs for each model: 0 if it is left out, by the rules in `left_out`."""

    strips: int
    columns: int
    plates: int
    left_out: tuple[Simplification, ...] = ()


class _Spent(Exception):
    """The budget of a model is used up."""


class _Search:
    """State of one search."""

    def __init__(self, space: Space, settings: Settings, budget: Budget, log: Log, cache: EvaluationCache) -> None:
        self.space, self.settings, self.log, self.cache = space, settings, log, cache
        self.known: dict[str, dict[Values, FoundDesign]] = {STRIP: {}, COLUMN: {}, PLATE: {}}
        self.budget = {STRIP: budget.strips, COLUMN: budget.columns, PLATE: budget.plates}
        self.softness = SOFTNESS
        self.columns = bool(budget.columns)
        self.goal_options = {"banded": True} if settings.goal == "widest" else {}

    def go(self) -> Outcome:
        screened, source = bool(self.budget[STRIP]), STRIP
        if screened:
            if self.columns:
                self._calibrate()
            self._screen()
        if self.columns:
            first = max(2, self.budget[COLUMN] // 2)
            even = first // 3 if screened else first
            self._at_fidelity(COLUMN, source, first - even, even_points(self.space, even))
            source = COLUMN
        first = max(2, self.budget[PLATE] // 3)
        alone = not (screened or self.columns)  # no cheaper model suggests where to search
        self._at_fidelity(PLATE, source, first, even_points(self.space, first * alone))
        own = (
            evaluate(self.space.case(), COLUMN, None, self.cache, **self.goal_options).frequency_hz
            if self.columns
            else None
        )
        base = self._confirmed((), own)
        best = self._best()
        window = window_around(self.space.case(best.point), best.frequency_hz)
        results = {fidelity: tuple(known.values()) for fidelity, known in self.known.items()}
        return Outcome(self.space, self.settings, results, base, best, self.softness, window)

    def _calibrate(self) -> None:
        """Adjust the compliance of the strips' feet until the file's design has the frequency of a column of cells."""
        case = self.space.case()
        with self.log.step("calibrate the strips on one column"):
            column = evaluate(case, COLUMN, None, self.cache)
            if kept_cell(case):
                self.log.info("columns: parametric cell from the explorer's cache (a hundredth of the time)")
            tried = [(softness, by_strip(case, softness).frequency_hz) for softness in np.linspace(0.0, SOFTEST, 41)]
        known = [(abs(tone - column.frequency_hz), s, tone) for s, tone in tried if tone and column.frequency_hz]
        if not known:
            return
        _, softness, tone = min(known)
        self.softness = float(softness)
        compared = f"strip {frequency(tone)}, column {frequency(column.frequency_hz)}"
        self.log.info(f"compliance of the strips' feet: {figure(softness)} times a half-space's ({compared})")

    def _screen(self) -> None:
        """Evaluate the whole box with strips."""
        with self.log.step("evaluate strips over the whole box"):
            for shares in screening_points(self.space):
                self._evaluation(self.space.values(shares), STRIP)
        screened = list(self.known[STRIP].values())
        unbuilt = [each for each in screened if each.goal_value is None]
        keeping = sum(each.keeps for each in screened)
        self.log.info(f"strips: {len(screened)} designs, {keeping} within the limits, {len(unbuilt)} cannot be built")
        if len(unbuilt) == len(screened):
            raise CheckFailed(f"no design between the ends can be built: {unbuilt[0].why_not}")

    def _at_fidelity(self, fidelity: str, source: str, first: int, more: Sequence[Values] = ()) -> None:
        """Evaluate the file's design, the best of the cheaper model and `more`, then search locally from the best two."""
        picked = [each.point for each in spread(self.known[source].values(), first, self.space)]
        own = self.space.own_values()
        for values in list(dict.fromkeys([*([own] if own else []), *picked, *more]))[: self.budget[fidelity]]:
            self._tried(values, fidelity)
        with_goal = [each for each in self.known[fidelity].values() if each.goal_value is not None]
        if not with_goal:
            reasons = [each.why_not for each in self.known[fidelity].values()]
            raise CheckFailed(
                f"{fidelity}: no design could be evaluated: {reasons[0] if reasons else 'none was tried'}"
            )
        for start in sorted(with_goal, key=lambda each: -each.penalised_objective)[:2]:
            if not self._descend(fidelity, start):
                self.log.info(f"{fidelity}: budget of {self.budget[fidelity]} designs used up")
                return
        with suppress(_Spent):
            self._step(fidelity)

    def _step(self, fidelity: str) -> None:
        """Change the best design's counts and choices by one as long as the design improves."""
        while True:
            best = max(self.known[fidelity].values(), key=lambda each: each.penalised_objective)
            for place, variable in enumerate(self.space.variables):
                for value in (best.point[place] - 1, best.point[place] + 1):
                    if variable.whole and variable.low <= value <= variable.high:
                        self._tried((*best.point[:place], value, *best.point[place + 1 :]), fidelity)
            if best == max(self.known[fidelity].values(), key=lambda each: each.penalised_objective):
                return

    def _descend(self, fidelity: str, start: FoundDesign) -> bool:
        """Search locally by Nelder-Mead over the continuous keys; False if the budget ended the search."""
        from scipy.optimize import minimize

        loose = [i for i, variable in enumerate(self.space.variables) if not variable.whole]
        origin = self.space.shares(start.point)
        if not loose:
            return True

        def worse(shares: FloatArray) -> float:
            point = origin.copy()
            point[loose] = shares
            return -self._tried(self.space.values(point), fidelity).penalised_objective

        been = self.columns and fidelity != COLUMN  # a column has searched here already
        first = FIRST_STEP / 2.0 if been else FIRST_STEP
        options = {"initial_simplex": _simplex(origin[loose], first), "xatol": FINEST, "fatol": 1e-2, "maxfev": 500}
        try:
            minimize(worse, origin[loose], method="Nelder-Mead", bounds=[(0.0, 1.0)] * len(loose), options=options)
        except _Spent:
            return False
        return True

    def _tried(self, values: Values, fidelity: str) -> FoundDesign:
        """Evaluate a design with a computed model and log it. Raises _Spent if the budget is used up."""
        if values in self.known[fidelity]:
            return self.known[fidelity][values]
        if len(self.known[fidelity]) >= self.budget[fidelity]:
            raise _Spent
        evaluation = self._evaluation(values, fidelity)
        count = f"{len(self.known[fidelity])}/{self.budget[fidelity]}"
        said = evaluation.text(self.settings.goal)
        self.log.info(f"{fidelity} {count}: {', '.join(self.space.overrides(values))}: {said}")
        return evaluation

    def _evaluation(self, values: Values, fidelity: str) -> FoundDesign:
        if values not in self.known[fidelity]:
            near = self._near(values) if fidelity == PLATE else None
            self.known[fidelity][values] = self._evaluated(values, fidelity, near)
        return self.known[fidelity][values]

    def _near(self, values: Values) -> float | None:
        """Centre of the search for the plate's target mode, Hz: the frequency from the column."""
        if not self.columns:
            return None
        column = self.known[COLUMN].get(values) or self._evaluated(values, COLUMN, None)
        self.known[COLUMN][values] = column
        return column.frequency_hz

    def _evaluated(
        self, values: Values, fidelity: str, near_hz: float | None, window: Window | None = None
    ) -> FoundDesign:
        try:
            case = self.space.case(values, window)
        except InputError as error:
            nothing = FidelityResult(fidelity=fidelity, why_not=error.lines[0])
            return rate(self.space, values, nothing, self.settings)

        def evaluated(each: Case) -> FidelityResult:
            if fidelity == STRIP:
                return by_strip(each, self.softness)
            return evaluate(each, fidelity, near_hz, self.cache, **self.goal_options)

        spread_m = case.tolerance.height_m if case.tolerance and self.settings.goal == "worst" else 0.0
        results = worst(case, spread_m, evaluated) if spread_m else evaluated(case)
        return rate(self.space, values, results, self.settings, case.design)

    def _confirmed(self, values: Values, near_hz: float | None) -> FoundDesign:
        """Evaluate a design (none: the file's) as an assembled plate in the case's window, which must contain the mode."""
        with self.log.step("solve the original design" if not values else "solve the best design again"):
            confirmed = self._evaluated(values, PLATE, None, window_around(self.space.case(values), near_hz))
        for id, text in confirmed.warnings:
            self.log.warning(id, text)
        return confirmed

    def _best(self) -> FoundDesign:
        """Find the best assembled plate whose result holds when solved in the case's own window."""
        ranked = sorted((e for e in self.known[PLATE].values() if e.keeps), key=lambda e: -e.objective)
        if not ranked:
            raise CheckFailed(_none_keeps(self.known[PLATE].values(), self.space))
        confirmed: list[FoundDesign] = []
        for position, each in enumerate(ranked[:MAX_CONFIRMED]):
            confirmed.append(self._confirmed(each.point, each.frequency_hz))
            leader = max(confirmed, key=lambda e: e.objective)
            if position + 1 == len(ranked) or leader.objective >= ranked[position + 1].objective:
                break
        if not leader.keeps:
            raise CheckFailed(_none_keeps(confirmed, self.space))
        return leader


def front(evaluations: Sequence[FoundDesign]) -> list[FoundDesign]:
    """Pareto-optimal designs by goal, frequency and mass, in order of decreasing goal."""

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
    """Compute goal, mass and violated limits of an evaluated design; none of them if it could not be built."""
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


def budget_of(space: Space, settings: Settings) -> Budget:
    """Choose the models that precede the assembled plates."""
    design = space.case().design
    alike = not UNLIKE & {variable.key for variable in space.variables}
    larger = design.larger_m is not None  # neither strips nor columns know what lies around its zone
    columns = bool(design.pillar and alike and not larger and _have_columns(space))
    screened, rules = settings.goal != "widest" and not larger, []
    if not screened:
        what, why = "strips over the whole box", "they do not give the width of the stop band"
        why = "they end with the zone, the plate does not" if larger else why
        rules.append(Simplification("no_strips", what, why))
    if not columns:
        what, why = "columns of reduced cells", "they need pillars that hexahedra can follow"
        why = "they are as long as the zone, the plate is not" if larger else why
        rules.append(Simplification("no_columns", what, why))
    if design.supports and (screened or columns):
        what, why = (
            "the supports, from strips and columns",
            "these rank designs of the free plate; assembled plates have them",
        )
        rules.append(Simplification("no_supports", what, why))
    strips = len(screening_points(space)) if screened else 0
    return Budget(strips, COLUMNS_A_PLATE * settings.evaluations * columns, settings.evaluations, tuple(rules))


def search(
    space: Space, settings: Settings, log: Log, cache: EvaluationCache | None = None, budget: Budget | None = None
) -> Outcome:
    """Search the best design of a space. Raises InputError without rows, CheckFailed if no design keeps the limits."""
    check(space, settings)
    return _Search(space, settings, budget or budget_of(space, settings), log, cache or EvaluationCache()).go()


def check(space: Space, settings: Settings) -> None:
    """Raise InputError for a case or keys that do not suit the goal."""
    case = space.case()
    case.refuse("search", (ZONES, LARGER, SUPPORTS))  # the varied keys, too
    case.require_plate("search")
    case.require("pillar", "array.pitch_mm", command="search")
    case.one_quality_factor("search")
    case.require_mirrored("search")
    varied = {variable.key for variable in space.variables}
    _check_zones(case, varied, settings)
    if not case.design.rows and "array.rows" not in varied:
        raise InputError(f"{space.path}: array.rows = 0: must be 1 or more, a bare plate confines nothing")
    if settings.goal == "widest":
        case.refuse("search --goal widest", (ZONES,))
        if checked(case).oblique_m:  # no plate can be joined from such cells
            check_stagger(case)
    if settings.goal == "worst" and not (case.tolerance and case.tolerance.height_m):
        raise InputError(f"{space.path}: tolerance.height_mm: missing, --goal worst needs the deviation of heights")
    margin = case.design.extension_m or case.design.larger_m
    if settings.goal == "extension" and not margin and "array.extension_mm" not in varied:
        raise InputError(f"{space.path}: array.extension_mm = 0: must be above 0 for --goal extension")


def screening_points(space: Space) -> FloatArray:
    """Points of the unit cube for the strips, (n, keys): a grid for up to two keys, Sobol's points for more."""
    count = len(space.variables)
    if count not in GRID:
        from scipy.stats import qmc

        return np.asarray(qmc.Sobol(count, scramble=False).random_base2(SOBOL))
    lines = []
    for variable in space.variables:
        steps = round((variable.high - variable.low) / variable.step)
        lines.append(np.linspace(0.0, 1.0, min(GRID[count], steps + 1)))
    return np.stack(np.meshgrid(*lines, indexing="ij"), axis=-1).reshape(-1, count)


def even_points(space: Space, count: int) -> list[Values]:
    """Spread designs evenly over the box (Halton), since a cheaper model may misplace the best ones."""
    if not count:
        return []
    from scipy.stats import qmc

    return [space.values(shares) for shares in qmc.Halton(len(space.variables), scramble=False).random(count + 1)[1:]]


def spread(evaluations: Iterable[FoundDesign], count: int, space: Space) -> list[FoundDesign]:
    """Return up to `count` of the best designs that lie apart in the box."""
    picked: list[FoundDesign] = []
    steps = [variable.share(variable.low + 1.0) if variable.whole else 1.0 for variable in space.variables]
    apart = np.minimum(APART, 0.99 * np.array(steps))  # the next whole number is another design
    for each in sorted(evaluations, key=lambda each: -each.penalised_objective):
        if len(picked) == count or each.penalised_objective <= UNBUILT:
            break
        here = space.shares(each.point)
        if all((np.abs(here - space.shares(other.point)) >= apart).any() for other in picked):
            picked.append(each)
    return picked


def _check_zones(case: Case, varied: set[str], settings: Settings) -> None:
    if "zone.count" in varied:
        what = "cannot vary, one zone has no other: search with --set zone.count=2, or sweep it in a study"
        raise InputError(f"--vary zone.count: {what}")
    if case.design.zones > 1:
        if settings.goal not in OF_ZONES:
            what = f"applies to a single zone, must be {', '.join(OF_ZONES[:-1])} or {OF_ZONES[-1]} for several"
            raise InputError(f"--goal {settings.goal}: {what}")
        case.require("patches", command="search")
        case.refuse("search of several zones", (ZONES,))
        check_zones(case)
    elif settings.goal in OF_ZONES[2:] or settings.limits.isolation_db is not None:
        name = f"--goal {settings.goal}" if settings.goal in OF_ZONES[2:] else "--min-isolation"
        raise InputError(f"{name}: needs several zones, set zone.count to 2 or more")


def _have_columns(space: Space) -> bool:
    """Whether hexahedra can follow the pillars of every design, as columns of cells require.

    Curved pillars need room around each foot, which a design of other sizes may lack.
    """
    pillar, names = space.case().design.pillar, [variable.key for variable in space.variables if variable.words]
    if pillar is None or pillar.is_made_of_boxes:
        return pillar is not None
    if len(space.variables) > MAX_ENDS or any(not name.endswith("material") for name in names):
        return False
    ends = product((0.0, 1.0), repeat=len(space.variables))
    with suppress(InputError):
        return all(simplifications.hexahedra(case, "plate") for case in (space.case(space.values(end)) for end in ends))
    return False


def _simplex(origin: FloatArray, first: float) -> FloatArray:
    """Corners of a simplex around a point of the unit cube, all inside it."""
    steps = np.where(origin + first <= 1.0, first, -first)
    return np.vstack([origin, origin + np.diag(steps)])


def _none_keeps(evaluations: Iterable[FoundDesign], space: Space) -> str:
    closest = max(evaluations, key=lambda each: each.objective)
    where = ", ".join(space.overrides(closest.point))
    why = "; ".join(closest.violations) or closest.why_not
    return f"no design tried keeps every limit; the closest, {where}: {why}"
