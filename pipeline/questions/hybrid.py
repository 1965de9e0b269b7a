"""Rows and patches together: confinement by either and by both over frequency, and its loss by detuning."""

from __future__ import annotations

from collections.abc import Iterator
from math import nan
from typing import Any

from pipeline.case.limits import MAX_FREQUENCIES
from pipeline.errors import InputError
from pipeline.quantity import KHZ, frequency, frequency_with_bar, level, level_with_bar, percentage, several, with_bar
from pipeline.questions.late import Axes, Case, FloatArray, Plan, ReportFigure, confinement, np, plans, style
from pipeline.questions.question import Pair, Question, Run, hz, option
from pipeline.questions.result import Figure, Result, figure, stacked
from pipeline.records.part import Part, bar, column

POINTS = 61
ALPHA = 0.3  # on the thesis' plate a tenth of the voltage for 0.3 dB less than the maximum
WORDS = {"rows": "rows only", "patches": "patches only", "both": "rows and patches"}


class HybridMethod(Part):
    """Confinement by one method over frequency.

    "neither" and "rows" drive the patches inside the zone in phase with the target mode; "patches" and "both" drive
    all patches with the voltages of the largest contrast. The plate has rows of pillars for "rows" and "both".
    """

    method: str = column("neither, rows, patches or both")
    confinement_db: list[float] = column(
        "confinement", "dB", along="frequency_hz", name="db", error="confinement_error_db"
    )
    off_db: list[float] = column(
        "smaller confinement with every resonance lower or higher by the detuning, at the same voltages", "dB",
        along="frequency_hz", error="off_error_db",
    )  # fmt: skip
    rows_off_db: list[float] | None = column(
        "the same with only the pillars' resonances detuned; None without rows", "dB", along="frequency_hz",
        error="rows_off_error_db",
    )  # fmt: skip
    volts_per_um: list[float] = column(
        "largest voltage for 1 um rms in the zone", "V", along="frequency_hz", error="volts_error_per_um"
    )
    confinement_error_db: list[float | None] | None = bar("confinement_db", "dB", along="frequency_hz", name="error_db")
    off_error_db: list[float | None] | None = bar("off_db", "dB", along="frequency_hz")
    rows_off_error_db: list[float | None] | None = bar("rows_off_db", "dB", along="frequency_hz")
    volts_error_per_um: list[float | None] | None = bar("volts_per_um", "V", along="frequency_hz")

    def at(self, name: str, place: int) -> tuple[float, float | None]:
        """Return a figure at an index of the frequencies (NaN if missing) and its error bar."""
        values, errors = getattr(self, name), getattr(self, self.declared[name].error)
        return values[place] if values else nan, errors[place] if errors else None


def _at_peak(method: str, name: str, heading: str) -> Figure[float | None]:
    """Declare a figure of a method at the target mode's peak."""
    error = HybridMethod.declared[name].error
    unit = HybridMethod.declared[name].unit
    about = figure(heading.format(WORDS[method]), unit, error=lambda answer: answer.at_target(method, error))
    return about(lambda answer: answer.at_target(method, name))


class HybridResult(Result, axes=("frequency_hz",)):
    """Confinement in dB and voltage for 1 um over frequency, by neither, rows, patches and both.

    >>> import antinode
    >>> from pipeline.questions.hybrid import HybridMethod
    >>> rows = HybridMethod(method="rows", confinement_db=[14.6], off_db=[9.1], rows_off_db=[8.2], volts_per_um=[2.0])
    >>> plate = {"model": "", "dof": 0, "inside": 7, "behind": 14, "detuning": 0.02, "alpha": 0.3, "target_hz": None}
    >>> antinode.Hybrid(**plate, frequency_hz=[34.8e3], methods=[rows]).to_rows()[0]["rows_db"]
    14.6
    """

    model: str = column("model of the plate and its element order, and the number of patches")
    dof: int = column("degrees of freedom that were solved for")
    inside: int = column("driving patches inside the zone")
    behind: int = column("driving patches beyond the zone")
    detuning: float = column("detuning of the resonances, relative")
    alpha: float = column("penalty on voltages that move little, 0 to 1")
    target_hz: float | None = column(
        "peak of the plate with rows; None if outside the band", "Hz", error="target_error"
    )
    frequency_hz: list[float] = column("frequencies of the methods", "Hz", along="frequency_hz")
    methods: list[HybridMethod] = column("the four methods of confinement")
    target_error: float | None = bar("target_hz, relative")
    target_elsewhere_hz: float | None = column(
        "peak of the plate with rows if outside the band", "Hz", error="target_elsewhere_error", default=None
    )
    target_elsewhere_error: float | None = bar("target_elsewhere_hz, relative")

    frequencies_hz = stacked("frequency_hz", "Frequencies (points,) in Hz.")

    @property
    def target_place(self) -> int | None:
        """Index of the target mode's peak among the frequencies; None if the band contains none."""
        return None if self.target_hz is None else self.frequency_hz.index(self.target_hz)

    def method(self, name: str) -> HybridMethod:
        """Return a method by name.

        Parameters
        ----------
        name : {'neither', 'rows', 'patches', 'both'}
            Name of the method.

        Returns
        -------
        HybridMethod
            Its levels and voltages over frequency.
        """
        return next(each for each in self.methods if each.method == name)

    def at_target(self, method: str, values: str) -> float | None:
        """Return a figure of a method at the target mode's peak.

        Parameters
        ----------
        method : {'neither', 'rows', 'patches', 'both'}
            Name of the method.
        values : str
            Field of the method over frequency, such as off_db or off_error_db.

        Returns
        -------
        float or None
            Value in the unit of the field; None if it is missing or the band contains no peak of the target mode.
        """
        figures: list[float] | None = getattr(self.method(method), values)
        return None if figures is None or self.target_place is None else figures[self.target_place]

    hybrid_rows_db = _at_peak("rows", "confinement_db", "confinement by {}")
    hybrid_rows_off_db = _at_peak("rows", "off_db", "{}, all detuned by 2 %")
    hybrid_rows_rows_off_db = _at_peak("rows", "rows_off_db", "{}, pillars detuned by 2 %")
    hybrid_rows_v_per_um = _at_peak("rows", "volts_per_um", "drive for 1 um, {}")
    hybrid_patches_db = _at_peak("patches", "confinement_db", "confinement by {}")
    hybrid_patches_off_db = _at_peak("patches", "off_db", "{}, all detuned by 2 %")
    hybrid_patches_v_per_um = _at_peak("patches", "volts_per_um", "drive for 1 um, {}")
    hybrid_both_db = _at_peak("both", "confinement_db", "confinement by {}")
    hybrid_both_off_db = _at_peak("both", "off_db", "{}, all detuned by 2 %")
    hybrid_both_rows_off_db = _at_peak("both", "rows_off_db", "{}, pillars detuned by 2 %")
    hybrid_both_v_per_um = _at_peak("both", "volts_per_um", "drive for 1 um, {}")

    def to_rows(self) -> list[dict[str, Any]]:
        """Return one row per frequency with the figures of each method, such as both_off_db."""
        columns = {
            f"{method.method}_{about.name or name}": values
            for method in self.methods
            for name, about in method.declared.items()
            if about.along and (values := getattr(method, name)) is not None
        }
        return [
            {"frequency_hz": frequency, **{name: values[place] for name, values in columns.items()}}
            for place, frequency in enumerate(self.frequency_hz)
        ]

    def lines(self) -> Iterator[str]:
        """Yield the patches, and each method at the target mode's peak."""
        yield f"{self.inside} patches drive inside the zone, {self.behind} beyond it"
        place = self.target_place
        if place is None:
            elsewhere = frequency_with_bar(self.target_elsewhere_hz, self.target_elsewhere_error)
            known = self.target_elsewhere_hz is not None
            where = f"it lies at {elsewhere}" if known else "no mode of the plate has the target shape"
            yield f"the band does not contain the target mode, {where}: only the levels over frequency are reported"
            return
        yield f"at the target mode's peak, {frequency_with_bar(self.target_hz, self.target_error)}:"
        for method in self.methods:
            names = ("confinement_db", "volts_per_um", "off_db", "rows_off_db")
            level, volts, off, rows_off = (method.at(name, place) for name in names)
            alone = "" if method.rows_off_db is None else f", {level_with_bar(*rows_off)} with only the pillars'"
            yield (
                f"{method.method}: {level_with_bar(*level)}, {with_bar(*volts, 'V')} for 1 um rms in the zone; "
                f"{level_with_bar(*off)} with every resonance detuned by {100.0 * self.detuning:g} %{alone}"
            )

    def draw(self, ax: Axes) -> None:
        """Draw confinement by rows, by patches, by both and by neither over frequency."""
        levels = {method.method: method.confinement_db for method in self.methods}
        self._draw_methods(ax, levels, "confinement (dB)", "Nominal plate; dotted: peak of the target mode")
        ax.axhline(confinement.CONFINED_DB, color=style.GREEN, lw=0.9, ls=":")
        ax.set_xlabel("frequency (kHz)")
        ax.legend(fontsize=9, ncols=4)

    def pictures(self) -> list[ReportFigure]:
        """Return the pictures of the four methods over frequency, nominal and detuned, and of the voltages."""
        drawn, (levels, detuned, drive) = style.panels(7.6, 3, 1, sharex=True)
        self.draw(levels)
        off = {each.method: each.off_db if each.rows_off_db is None else each.rows_off_db for each in self.methods}
        shift = percentage(self.detuning, 0.0)
        title = f"Resonances of the pillars (of the plate without rows) detuned by {shift}, worse sign"
        self._draw_methods(detuned, off, "confinement (dB)", title)
        volts = {each.method: each.volts_per_um for each in self.methods}
        self._draw_methods(drive, volts, "largest voltage (V)", "For 1 µm rms in the zone")
        drive.set(yscale="log", xlabel="frequency (kHz)")
        return [style.ReportFigure("hybrid", "Rows and patches together", self._alt(), drawn, vector=True)]

    def _draw_methods(self, ax: Axes, curves: dict[str, list[float]], label: str, title: str) -> None:
        style.draw_lines(ax.plot, self.frequencies_hz / KHZ, curves)
        if self.target_hz:
            style.mark(ax, self.target_hz / KHZ)
        ax.set(ylabel=label, title=title)
        ax.grid(True)

    def _alt(self) -> str:
        place, where = self.target_place, "minimum over the band"
        if place is not None:
            where = f"at {frequency(self.target_hz, self.target_error)}"
        levels = [
            f"{each.method} {level(min(each.confinement_db)) if place is None else level(*each.at('confinement_db', place))}"
            for each in self.methods
        ]
        return f"Confinement over frequency by rows, by patches, by both and by neither; {where}: {', '.join(levels)}"

    def __repr__(self) -> str:
        return f"<antinode.Hybrid: {len(self.frequency_hz)} frequencies, {', '.join(each.method for each in self.methods)}>"


class Hybrid(
    Question[HybridResult],
    needs=("patches",),
    drives=True,
    example="hybrid examples/35-hybrid.toml --out hybrid",
):
    """Compare rows and patches: confinement by either and by both over frequency, drive voltages, loss by detuning.

    Two or more patches must drive, one of them inside the zone.

    >>> from antinode import Patches, load
    >>> two = Patches(size_mm=(8.0, 3.0, 0.3), centres_mm=[(-14.0, 0.0), (14.0, 0.0)])
    >>> result = load("examples/small.toml", accuracy=0.1, patches=two).hybrid((33.0, 36.0), points=3)
    >>> {name: round(result.method(name).confinement_db[0]) for name in ("rows", "both")}
    {'rows': 8, 'both': 16}
    """

    band_kHz: Pair | None = option(default=None, unit="kHz", at_least=0.0, kw_only=False, help="frequencies")
    points: int = option(default=POINTS, at_least=1, at_most=MAX_FREQUENCIES, help="number of frequencies")
    alpha: float = option(
        default=ALPHA, at_least=0.0, at_most=0.999, metavar="A",
        help="penalty on large voltages for little motion, relative to the motion of the passive face (0: largest "
        "contrast at any voltage)",
    )  # fmt: skip

    def check(self, case: Case) -> None:
        """Raise InputError for a case without rows, a patch inside the zone, or two drivers fed by voltages."""
        from pipeline.models.hybrid import driven_inside

        super().check(case)
        patches = case.patches
        assert patches is not None
        said = []
        if not case.design.rows:
            said.append("array.rows = 0: must be 1 or more; hybrid compares rows with patches")
        if patches.circuit != "short":
            said.append(
                f"patches.circuit = {patches.circuit!r}: must be 'short'; the method drives patches with voltages"
            )
        if not driven_inside(case).any():
            said.append("patches.centres_mm: no driving patch lies inside the zone; place at least one there")
        elif len(patches.drivers) < 2:
            said.append("patches: only one drives; the comparison needs two or more")
        if said:
            raise InputError(f"{case.source or case.name}: {text}" for text in said)

    def plan(self, case: Case) -> Plan:
        """Plan four plates: nominal, without rows, and with the pillars detuned by 2 % both ways."""
        from dataclasses import replace

        step = plans.response_step(case, hz(self.band_kHz), self.points)
        assert case.patches is not None and step.demand
        demand = step.demand
        for _ in range(3):
            demand = demand.then(step.demand)
        plates = "four plates: nominal, without rows, pillars detuned both ways"
        looks = f"{self.points} frequencies, {several(case.patches.count, 'patch')}; {plates}"
        about = {"measure": self.name, "name": "rows and patches together", "looks_for": looks, "demand": demand}
        return plans.plan_of(case, replace(step, **about))  # type: ignore[arg-type]

    def compute(self, case: Case, plan: Plan, run: Run) -> HybridResult:
        """Drive the four plates and compare them."""
        from pipeline.models.hybrid import DETUNING, driven_inside, solve

        forced = run.solved.get("forced")
        if forced is not None and forced.moduli:  # of a response, frequency by frequency: this needs one plate for all
            forced = None
        solved = solve(case, run, hz(self.band_kHz), self.points, self.alpha, forced, [] if forced else run.meshes)
        patches, plate, inside = case.patches, solved.forced.plate, int(driven_inside(case).sum())
        assert patches is not None
        result = HybridResult.of(
            solved, model=f"{plate.name} with {several(patches.count, 'patch')}",
            dof=sum(len(group.loads) for group in plate.groups),
            inside=inside, behind=len(patches.drivers) - inside, detuning=DETUNING, alpha=self.alpha,
            methods=[_method(name, *figures) for name, figures in solved.methods.items()],
        )  # fmt: skip
        run.report(result)
        return result


def _method(name: str, figures: FloatArray, bars: FloatArray) -> HybridMethod:
    """Build a method from its figures and their error bars, (4, frequencies) each."""
    level, volts, off, rows_off = figures
    errors = dict(
        zip(("confinement_error_db", "volts_error_per_um", "off_error_db", "rows_off_error_db"), bars, strict=True)
    )
    if not np.isfinite(rows_off).all():
        rows_off = errors["rows_off_error_db"] = None
    return HybridMethod(
        method=name, confinement_db=level, volts_per_um=volts, off_db=off, rows_off_db=rows_off, **errors
    )
