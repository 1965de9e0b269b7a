"""Search for the design that confines the target mode best: keys varied between two ends, within limits."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING, Any, Literal

from pipeline.case.features import LARGER, SUPPORTS, ZONES
from pipeline.case.limits import MAX_EVALUATIONS
from pipeline.errors import InputError
from pipeline.quantity import GRAM, KHZ, MM, frequency, level, level_figure, level_with_bar, signed, with_bar
from pipeline.questions.late import Axes, Case, Plan, ReportFigure, np, outputs, plans, style
from pipeline.questions.question import ONE_OR_TWO, Pair, Question, Run, option
from pipeline.questions.result import Result, scaled
from pipeline.records.part import Part, bar, column, live
from pipeline.search.terms import COLUMN, GOALS, LESS, PLATE, STRIP, FoundDesign, Limits, Range, unit_of

if TYPE_CHECKING:
    from pipeline.search.optimiser import Outcome, Settings
    from pipeline.search.space import Space

Goal = Literal["confinement", "extension", "worst", "widest", "isolation", "closest"]
SHOWN = 8
LOWEST_KHZ = 25.0  # of the target mode: above what is heard
# of a legend: below the axes, where it hides no design
BELOW: dict[str, Any] = {
    "loc": "upper center",
    "bbox_to_anchor": (0.5, -0.16),
    "ncols": 3,
    "fontsize": 9,
    "columnspacing": 1.2,
}


class Varied(Part):
    """A varied key between two ends, in the unit of the file."""

    key: str = column("key of the case file, with the row in brackets if every row has its own value")
    low: float = column("low end; 0 for a choice")
    high: float = column("high end; 1 for a choice")
    step: float = column("grid to which values are rounded")
    words: list[str] | None = column("meaning of 0 and 1; None for numbers", default=None)

    @property
    def title(self) -> str:
        """Key as the title of an axis."""
        key, bracket, row = self.key.partition("[")
        name = key.removesuffix("_mm").replace(".", " ").replace("_", " ")
        return f"{name}{f' {bracket}{row}' if row else ''}{' (mm)' if key.endswith('_mm') else ''}"


class Fidelity(Part):
    """A model and the number of designs it evaluated."""

    name: str = column("strip, column or plate")
    model: str = column("model in words")
    designs: int = column("number of designs evaluated")
    not_evaluated: int = column("number of designs that could not be evaluated")


class SearchResult(Result, table="evaluations", axes=("evaluation",)):
    """Best design compared with the initial one, and every evaluation as a row; dB, Hz, mm, kg.

    >>> import antinode
    >>> plate = antinode.load("examples/small.toml", accuracy=0.1)
    >>> found = plate.search(height_mm=(6.0, 6.6), evaluations=2, mac=0.3)
    >>> found.best_values, plate.with_(**found.changes).to_dict()["pillar"]["height_mm"]
    ({'pillar.height_mm': 6.0}, 6.0)
    """

    goal: str = column("maximised goal")
    vary: list[Varied] = column("varied keys")
    limits: Limits = column("limits on the designs")
    fidelities: list[Fidelity] = column("number of designs evaluated by each model")
    softness: float = column("calibrated compliance of the pillars' feet in the strip model, relative to a half-space")
    repeat: list[str] = column("KEY=VALUE of the best design, for --set")
    base: FoundDesign = column("initial design, solved as by `antinode modes`")
    best: FoundDesign = column("best design, solved as by `antinode modes`")
    gain_db: float | None = column(
        "gain of the goal; None if a design has no target mode or the goal is not a level", "dB", error="gain_error_db"
    )
    gain_khz: float | None = column("gain of a goal that is a band; None for others", "kHz")
    gain_mm: float | None = column("reduction of the gap between the zones, if that is the goal; None for others", "mm")
    gain_error_db: float | None = bar("gain_db", "dB")
    tradeoff: list[FoundDesign] = column("Pareto-optimal designs in goal, frequency and mass, the best first")
    evaluations: list[FoundDesign] = column("every evaluated design")
    solid: dict[str, FoundDesign] | None = column(
        "`base` and `best` by solid meshes of the whole plate; None without --verify-with solid"
    )
    file: str = live("case file of the initial design", default="CASE")

    @classmethod
    def of_outcome(cls, outcome: Outcome, solid: dict[str, FoundDesign] | None = None) -> SearchResult:
        """Return the result of a search.

        Parameters
        ----------
        outcome : Outcome
            Evaluated designs, the initial and the best one.
        solid : dict of FoundDesign, optional
            `base` and `best` by solid meshes of the whole plate.

        Returns
        -------
        SearchResult
            The result.
        """
        from pipeline.search.fidelity import MODELS

        listed = outcome.by_fidelity.items()
        counts = {name: (len(each), sum(e.goal_value is None for e in each)) for name, each in listed}
        gain = dict.fromkeys(("dB", "kHz", "mm")) | {unit_of(outcome.settings.goal): outcome.gain}
        return cls.of(
            outcome,
            goal=outcome.settings.goal,
            vary=[Varied.of(each, key=each.name, words=list(each.words) or None) for each in outcome.space.variables],
            limits=outcome.settings.limits,
            fidelities=[
                Fidelity(name=name, model=MODELS[name], designs=all_, not_evaluated=none)
                for name, (all_, none) in counts.items()
            ],
            gain_db=gain["dB"],
            gain_khz=gain["kHz"],
            gain_mm=gain["mm"],
            evaluations=[each for _, found in listed for each in found],
            solid=solid,
            file=str(outcome.space.path),
        )

    @property
    def best_values(self) -> dict[str, float | str]:
        """Values of the varied keys in the best design, in the units of the file, or words."""
        return dict(self.best.set)

    @property
    def changes(self) -> dict[str, Any]:
        """Best design as keywords: `plate.with_(**found.changes)` is that plate."""
        from pipeline.case.reading import effective  # loads what help does without

        found: dict[str, Any] = {}
        for name, value in effective(self.best.set.items()):
            key, row, _ = name.replace(".", "__").partition("[")
            if row:
                found.setdefault(key, []).append(value)
            else:
                found[key] = {"true": True, "false": False}.get(value, value) if isinstance(value, str) else value
        return found

    def to_rows(self) -> list[dict[str, Any]]:
        """Return the evaluations, the varied keys after the model."""
        rows = []
        for row, each in zip(super().to_rows(), self.evaluations, strict=True):
            first = {name: row.pop(name) for name in ("evaluation", "fidelity")}
            last = {"violations": "; ".join(each.violations), "why_not": row.pop("why_not")}
            rows.append(first | each.set | row | last)
        return rows

    # -- words

    @property
    def _value(self) -> str:
        return GOALS[self.goal][0]

    @property
    def _title(self) -> str:
        return GOALS[self.goal][1]

    @property
    def _unit(self) -> str:
        return unit_of(self.goal)

    def lines(self) -> Iterator[str]:
        """Yield the best designs as a table, the gain, and the command that repeats it."""
        keeping = [each for each in self._of(PLATE) if getattr(each, self._value) is not None and not each.violations]
        keeping.sort(key=lambda each: getattr(each, self._value), reverse=self._unit not in LESS)
        names = [name for name, each in FoundDesign.declared.items() if each.unit or name in ("frequency_error", "mac")]
        names.remove("mass_kg")
        figures = [[getattr(each, name) for name in names] for each in keeping[:SHOWN]]
        grams = [scaled(each.mass_kg, GRAM) for each in keeping[:SHOWN]]
        rows = [[*one.set.values(), *own, mass] for one, own, mass in zip(keeping, figures, grams, strict=False)]
        yield f"{', '.join(f'{each.designs} by {each.name}' for each in self.fidelities)}; best assembled plates:"
        yield outputs.reading_table(*outputs.filled((*(each.key for each in self.vary), *names, "mass_g"), rows))
        yield f"initial: {self.base.text(self.goal)}"
        gain = {"dB": self.gain_db, "kHz": self.gain_khz, "mm": self.gain_mm}[self._unit]
        text = ""
        if gain is not None:
            own = level_with_bar(gain, self.gain_error_db) if self._unit == "dB" else with_bar(gain, None, self._unit)
            text = f", {signed(own)}"
        yield f"best:    {self.best.text(self.goal)}{text}"
        for name, design in (self.solid or {}).items():
            text = f"{level(design.confinement_db)} at {frequency(design.frequency_hz or 0.0)}"
            yield f"solid mesh, {name}: {text}"
        command = "modes" if self.best.isolation_db is None else "crosstalk"
        yield f"to repeat: antinode {command} {self.file} " + " ".join(f"--set {part}" for part in self.repeat)

    def __repr__(self) -> str:
        gain = "" if self.gain_db is None else f", {signed(level(self.gain_db))}"
        return f"<antinode.Search: {len(self.evaluations)} evaluations, best {self.best_values}{gain}>"

    # -- pictures

    def draw(self, ax: Axes) -> None:
        """Draw the goal over one or two keys."""
        keys = self._shown_keys()
        if len(keys) == 1:
            self._line(ax, keys[0])
        else:
            self._map(ax, keys)

    def pictures(self) -> list[ReportFigure]:
        """Return the pictures of the goal over the varied keys, and against frequency and mass."""
        drawn, (over, against) = style.panels(7.2, 2, 1)
        self.draw(over)
        self._tradeoff(against)
        title = "Best confinement of the target mode"
        return [style.ReportFigure("search", title, self._alt(), drawn, vector=True)]

    def _of(self, fidelity: str) -> list[FoundDesign]:
        return [each for each in self.evaluations if each.fidelity == fidelity]

    def _number(self, design: FoundDesign, key: Varied) -> float:
        """Return a design's value of a key; 0 or 1 for a choice."""
        value = design.set[key.key]
        return float(key.words.index(str(value))) if key.words else float(value)

    def _points(self, listed: list[FoundDesign], keys: list[Varied]) -> Any:
        """Return the values of the keys and of the goal for the evaluated designs."""
        known = [each for each in listed if getattr(each, self._value) is not None]
        return np.array([[*(self._number(each, key) for key in keys), getattr(each, self._value)] for each in known]).T

    def _shown_keys(self) -> list[Varied]:
        """Return one or two keys; of several, those that correlate most (rank) with the cheapest model's goal."""
        if len(self.vary) <= 2:
            return self.vary
        from scipy.stats import spearmanr

        known = (self._points(self._of(name), self.vary) for name in (STRIP, COLUMN, PLATE))
        *columns, goal = next(points for points in known if points.size)
        strength = [np.nan_to_num(abs(spearmanr(values, goal).statistic)) for values in columns]
        places = sorted(range(len(self.vary)), key=lambda place: -strength[place])
        return [self.vary[place] for place in places[:2]]

    def _line(self, axes: Any, key: Varied) -> None:
        """Draw the goal over one key, by every model."""
        looks = {STRIP: (style.GREY, "", "-"), COLUMN: (style.SKY, "s", ""), PLATE: (style.BLUE, "o", "")}
        for fidelity, (colour, marker, line) in looks.items():
            points = self._points(self._of(fidelity), [key])
            if points.size:
                x, y = points[:, np.argsort(points[0])]
                axes.plot(x, y, color=colour, marker=marker or None, ls=line or "none", ms=4, label=fidelity)
        best = self._points([self.best], [key])
        axes.plot(*best, "*", color=style.VERMILION, ms=13, label="best")
        axes.set(xlabel=key.title, ylabel=self._title, title="Landscape")
        axes.grid(True)
        axes.legend(fontsize=9)

    def _map(self, axes: Any, keys: list[Varied]) -> None:
        """Draw the goal over two keys: strips as background, computed designs as points, on one colour scale."""
        strips, columns, plates = (self._points(self._of(name), keys) for name in (STRIP, COLUMN, PLATE))
        low = min(0.0, float(np.percentile(strips[2], 5))) if strips.size else 0.0
        high = max(float(np.percentile(strips[2], 99)) if strips.size else 1.0, *plates[2], low + 1.0)
        look: dict[str, Any] = {"cmap": style.QUALITY, "vmin": low, "vmax": high}
        if strips.size and len(self.vary) == 2:
            axes.tripcolor(*strips[:2], strips[2], shading="gouraud", rasterized=True, **look)
        if columns.size:
            own: dict[str, Any] = {"marker": "s", "s": 14, "edgecolors": "white", "linewidths": 0.5, "label": "column"}
            axes.scatter(*columns[:2], c=columns[2], **own, **look)
        own = {"marker": "o", "s": 42, "edgecolors": "black", "linewidths": 0.8, "label": "assembled plate"}
        image = axes.scatter(*plates[:2], c=plates[2], **own, **look)
        best = [self._number(self.best, key) for key in keys]
        axes.plot(*best, "*", color=style.VERMILION, mec="white", ms=15, ls="none", label="best")
        axes.set(xlabel=keys[0].title, ylabel=keys[1].title, title="Landscape (background: strips)")
        axes.legend(**BELOW)
        axes.figure.colorbar(image, ax=axes, label=self._title)

    def _tradeoff(self, axes: Any) -> None:
        """Draw the goal against frequency, coloured by mass; Pareto-optimal designs are connected."""
        value = self._value
        for fidelity, look in ((COLUMN, {"marker": "s", "s": 12, "alpha": 0.6}), (PLATE, {"marker": "o", "s": 36})):
            listed = [each for each in self._of(fidelity) if getattr(each, value) is not None and not each.violations]
            if not listed:
                continue
            mass = [each.mass_kg / GRAM if each.mass_kg is not None else np.nan for each in listed]
            x, y = [(each.frequency_hz or np.nan) / KHZ for each in listed], [getattr(each, value) for each in listed]
            own: dict[str, Any] = {"cmap": "viridis_r", "plotnonfinite": True, "edgecolors": "black", "linewidths": 0.4}
            image = axes.scatter(x, y, c=mass, **own, **look)
        axes.figure.colorbar(image, ax=axes, label="mass (g)")
        front = sorted(((each.frequency_hz or 0.0) / KHZ, getattr(each, value)) for each in self.tradeoff)
        axes.plot(*zip(*front, strict=True), color=style.GREY, lw=0.8, ls="--", label="Pareto-optimal designs")
        marked = (("initial", self.base, "D", style.ORANGE), ("best", self.best, "*", style.VERMILION))
        for name, design, marker, colour in marked:
            if design.frequency_hz is not None and getattr(design, value) is not None:
                place = design.frequency_hz / KHZ, getattr(design, value)
                axes.plot(*place, marker, color=colour, mec="white", ms=11, label=name)
        for limit_hz in (self.limits.lowest_hz, self.limits.highest_hz):
            if limit_hz is not None:
                axes.axvline(limit_hz / KHZ, color=style.GREY, lw=0.8, ls=":")
        axes.set(xlabel="frequency of the target mode (kHz)", ylabel=self._title, title="Trade-off")
        axes.grid(True)
        axes.legend(**BELOW)

    def _alt(self) -> str:
        base, best = (getattr(design, self._value) for design in (self.base, self.best))
        where = ", ".join(f"{key.key} = {self._number(self.best, key):g}" for key in self.vary)
        was = "" if base is None else f"; initially {level_figure(base)}"
        counts = ", ".join(f"{each.designs} by {each.name}" for each in self.fidelities)
        return (
            f"Goal over the varied keys ({counts}) and against frequency: best {level_figure(best)} {self._title} at "
            f"{frequency(self.best.frequency_hz or 0.0)} with {where}{was}"
        )


class Search(
    Question[SearchResult],
    needs=("pillar", "array.pitch_mm"),
    example="search studies/three-rows.toml --vary pillar.height_mm=5:8 --vary array.pitch_mm=4:8 --out found",
    is_measure=False,
    honours=(ZONES, LARGER, SUPPORTS),
):
    """Search for the design that confines the target mode best, with keys varied between two ends.

    Strips rank many designs, three columns of cells precede each assembled plate, and the best one is solved again;
    this takes minutes. Raises CheckFailed if no design meets the limits.

    >>> from antinode import load
    >>> plate = load("examples/small.toml", accuracy=0.1)
    >>> best = plate.search(height_mm=(6.0, 6.6), evaluations=2, mac=0.3)
    >>> best.best_values, round(best.gain_db)
    ({'pillar.height_mm': 6.0}, 3)
    """

    vary: tuple[Range, ...] = option(
        default=(), metavar="KEY=LOW:HIGH",
        help="key of plate, zone, pillar or array with two ends; array.heights_mm=5:7 varies each row, "
        "zone.centre_mm=-8:8 x and y of a zone on a larger plate (zone.centre_x_mm and zone.centre_y_mm one of them), "
        "array.stagger=false:true, pillar.faces=back:both and pillar.material=steel:brass are choices",
    )  # fmt: skip
    goal: Goal = option(
        default="confinement",
        help="confinement: level of the zone over the passive face, dB; extension: over the plate beyond the rows; "
        "worst: smallest confinement when tolerance.height_mm changes all heights; widest: width of the band around "
        "the target mode in which the rows attenuate a wave by 10 dB; for several zones, each driven in turn: "
        "confinement, worst, isolation (smallest level of the driven zone over another one, dB) or closest (smallest "
        "gap between zones)",
    )
    evaluations: int = option(
        default=16,
        at_least=1,
        at_most=MAX_EVALUATIONS,
        help="number of assembled plates, with three columns of cells for each",
    )
    min_frequency_kHz: float | None = option(
        default=None, unit="kHz", at_least=0.0, help=f"lowest allowed frequency (default {LOWEST_KHZ:g} kHz)"
    )
    target_kHz: Pair | None = option(
        default=None,
        unit="kHz",
        at_least=0.0,
        metavar=ONE_OR_TWO,
        help="window of the target mode in the place of a lowest frequency; the command takes a single frequency, "
        "which the mode meets within 1 %, too",
    )
    max_half_wavelength_mm: float = option(
        default=20.0,
        unit="mm",
        at_least=1e-3,
        at_most=1e6,
        metavar="MM",
        help="largest allowed half-wavelength along the zone",
    )
    min_feature_mm: float = option(
        default=0.4, unit="mm", at_least=1e-3, at_most=1e6, metavar="MM", help="smallest printable feature"
    )
    mac: float = option(
        default=0.8,
        at_least=0.0,
        at_most=1.0,
        metavar="SHARE",
        help="smallest allowed modal assurance criterion with the target shape, 0 to 1",
    )
    min_isolation_dB: float | None = option(
        default=None, unit="dB", at_least=1e-3, at_most=1e3, metavar="DB",
        help="smallest allowed level of a driven zone over every other one, for several zones",
    )  # fmt: skip
    verify_with: Literal["plate", "solid"] = option(
        default="plate", help="also solve the initial and the best design with this model (solid: minutes each)"
    )

    def check(self, case: Case) -> None:
        """Raise InputError for keys, limits and cases that do not suit the goal."""
        space = self._space(case)  # report faults before anything heavy is loaded
        from pipeline.search.optimiser import check

        check(space, self._settings())
        if self.target_kHz and self.min_frequency_kHz is not None:
            raise InputError("--min-frequency: must not be given with --target, whose window has a lowest frequency")
        if case.design.supports and self.verify_with == "solid":
            raise InputError("--verify-with solid: must be plate with [[support]]: solid meshes carry no supports")
        if case.design.zones > 1 and self.verify_with == "solid":
            count = case.design.zones
            raise InputError(
                f"--verify-with solid: zone.count = {count}: must be plate, because solid meshes carry no patches"
            )

    def _space(self, case: Case) -> Space:
        from pipeline.search.space import space_of

        return space_of(case, self.vary)

    def _settings(self) -> Settings:
        from pipeline.search.optimiser import Settings

        lowest = LOWEST_KHZ if self.min_frequency_kHz is None else self.min_frequency_kHz
        lowest_kHz, highest_kHz = self.target_kHz or (lowest, None)
        limits = Limits(
            lowest_hz=KHZ * lowest_kHz,
            highest_hz=None if highest_kHz is None else KHZ * highest_kHz,
            half_wavelength_m=MM * self.max_half_wavelength_mm,
            feature_m=MM * self.min_feature_mm,
            mac=self.mac,
            isolation_db=self.min_isolation_dB,
        )
        return Settings(self.goal, limits, self.evaluations)

    def plan(self, case: Case) -> Plan:
        from pipeline.search.fidelity import MODELS
        from pipeline.search.optimiser import budget_of

        budget = budget_of(self._space(case), self._settings())
        numbers = {"strips": budget.strips, "columns": budget.columns, "plates": budget.plates}
        counts = ", ".join(f"{most} {name}" for name, most in numbers.items() if most)
        looks = (
            f"at most {counts} over {', '.join(each.key for each in self.vary)}; then the initial and the best design"
        )
        step = plans.Step(self.name, f"best {self.goal}", MODELS[PLATE], "", (), looks, (), budget.left_out, numbers)
        return plans.plan_of(case, step)

    def compute(self, case: Case, plan: Plan, run: Run) -> SearchResult:
        """Evaluate designs with cheap models first, and the best ones as assembled plates."""
        from pipeline.search.optimiser import Budget, search

        outcome = search(self._space(case), self._settings(), run, budget=Budget(**plan.steps[0].numbers))
        return SearchResult.of_outcome(outcome, _solid(outcome, run) if self.verify_with == "solid" else None)


def _solid(outcome: Outcome, run: Run) -> dict[str, FoundDesign]:
    """Solve both designs with solid meshes of the whole plate."""
    from pipeline.search.fidelity import SOLID, EvaluationCache, evaluate

    solved = {}
    for name, each in (("base", outcome.base), ("best", outcome.best)):
        with run.step(f"solid model of the {name} design"):
            result = evaluate(outcome.space.case(each.point), SOLID, each.frequency_hz, EvaluationCache())
        if result.why_not:
            raise InputError(f"--verify-with solid: the {name} design: {result.why_not}")
        solved[name] = FoundDesign.of(result, set=each.set, mass_kg=each.mass_kg, violations=each.violations)
    return solved
