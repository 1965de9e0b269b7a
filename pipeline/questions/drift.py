"""Drift of the target mode's frequency and confinement with temperature, and the stress of warm layers."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

from pipeline.case.features import LARGER, STRESS, SUPPORTS
from pipeline.errors import InputError
from pipeline.models.answer_parts import LayerStress, WarmPlate
from pipeline.quantity import KHZ, figure, percent, with_bar
from pipeline.questions.late import Axes, Case, Plan, ReportFigure, np, plans, simplifications, style
from pipeline.questions.question import Pair, Question, Run, option
from pipeline.questions.result import Result, stacked
from pipeline.records.part import bar, column

POINTS, LEAST, MOST = 5, 3, 101
AROUND_K = 20.0
MPA = 1e6


class DriftResult(Result, table="points", axes=("temperature_C",)):
    """Target mode over temperature: arrays (points,) in Hz and dB, and their slopes at the case's temperature.

    >>> import antinode
    >>> warm = antinode.load("examples/small.toml", accuracy=0.1).drift(points=3)
    >>> warm.drift_hz_per_K < 0.0, warm.frequency_hz.shape
    (True, (3,))
    """

    temperature_C: float = column("temperature of the case in degrees Celsius", "C")
    drift_hz_per_K: float | None = column("drift of the target mode", "Hz/K", error="drift_error_hz_per_K")
    drift_db_per_K: float | None = column("drift of its confinement", "dB/K", error="drift_error_db_per_K")
    points: list[WarmPlate] = column("the target mode at each temperature")
    layers: list[LayerStress] = column("stress of each layer of the free plate per kelvin; empty for one layer")
    curvature_per_m_K: list[float] | None = column(
        "curvatures of the free plate along x and y per kelvin; None where an expansion is not known", "1/(m K)"
    )
    drift_error_hz_per_K: float | None = bar("drift_hz_per_K", "Hz/K")
    drift_error_db_per_K: float | None = bar("drift_db_per_K", "dB/K")

    frequency_hz = stacked("frequency_hz", "Frequencies of the target mode (points,) in Hz; NaN without one.")
    confinement_db = stacked("confinement_db", "Confinement (points,) in dB; NaN without a target mode.")

    def lines(self) -> Iterator[str]:
        """Yield the target mode at each temperature, its drift, and the stress of layers."""
        yield self.reading(("confinement_error_db",))
        if self.drift_hz_per_K is not None:
            tone = with_bar(self.drift_hz_per_K, self.drift_error_hz_per_K, "Hz/K")
            per_db = self.drift_db_per_K
            level = "" if per_db is None else f", confinement {with_bar(per_db, self.drift_error_db_per_K, 'dB/K')}"
            yield f"drift at {self.temperature_C:g} C: target mode {tone}{level}"
        for number, layer in enumerate(self.layers, start=1):
            along, across = (figure(each / MPA) for each in (layer.along_Pa_per_K, layer.across_Pa_per_K))
            yield f"layer {number} ({layer.material}): {along} MPa/K along x, {across} MPa/K along y"
        if self.layers and self.curvature_per_m_K:
            along, across = map(figure, self.curvature_per_m_K)
            yield f"the free plate bows by {along} 1/(m K) along x, {across} 1/(m K) along y"
        if self.layers:
            worst = max((point.left_out for point in self.points if point.left_out is not None), default=None)
            if worst:
                yield f"the bow of the layers is left out: it changes frequencies by at most {percent(worst)}"

    def draw(self, ax: Axes) -> None:
        """Draw the target mode's frequency and its confinement over temperature."""
        celsius = self.array("temperature_C")
        ax.plot(celsius, self.frequency_hz / KHZ, "o-", color=style.BLUE, ms=4, lw=0.9)
        ax.set(xlabel="temperature (C)", ylabel="target mode (kHz)")
        ax.grid(True)
        if np.isfinite(self.confinement_db).any():
            other = ax.twinx()
            other.plot(celsius, self.confinement_db, "s--", color=style.ORANGE, ms=4, lw=0.9)
            other.set_ylabel("confinement (dB)", color=style.ORANGE)

    def pictures(self) -> list[ReportFigure]:
        """Return the picture of frequency and confinement over temperature."""
        slope = (
            "" if self.drift_hz_per_K is None else f", {figure(self.drift_hz_per_K)} Hz/K at {self.temperature_C:g} C"
        )
        alt = f"Target mode's frequency over temperature{slope}; and its confinement in dB."
        return [style.ReportFigure("drift", "Target mode over temperature", alt, self.as_figure(), vector=True)]

    def __repr__(self) -> str:
        return f"<antinode.Drift: {len(self.points)} temperatures>"


class Drift(
    Question[DriftResult],
    needs=("plate", "zone"),
    example="drift examples/small.toml --points 3",
    honours=(LARGER, SUPPORTS, STRESS),
):
    """Compute the drift of the target mode with temperature (Hz/K, dB/K), and the stress of the plate's layers (Pa/K).

    Materials follow `dE_dT_per_K` and `expansion_per_K`; one without either stays as it is.

    >>> import antinode
    >>> plate = antinode.load("examples/small.toml", accuracy=0.1)
    >>> len(plate.drift(40.0, points=3).points)
    3
    """

    around_K: float = option(
        default=AROUND_K, unit="K", at_least=0.1, at_most=1000.0, kw_only=False,
        help="temperatures to either side of the case's",
    )  # fmt: skip
    points: int = option(default=POINTS, at_least=LEAST, at_most=MOST, help="number of temperatures")

    def check(self, case: Case) -> None:
        """Raise InputError for a case without target mode or without a material that changes with temperature."""
        from pipeline.models.drift import checked

        super().check(case)
        checked(case)
        for celsius in self._span(case):
            try:
                warm = case.but({"solve.temperature_C": celsius})
            except InputError as error:
                raise InputError(f"around_K = {self.around_K:g}: {error.lines[0].rpartition('--set: ')[2]}") from None
            warm.refuse(self.name, self.honours)

    def plan(self, case: Case) -> Plan:
        from pipeline.planning.model_choice import of_case

        low, high = self._span(case)
        step, looks = plans.modes_step(case, of_case(case)), f"{self.points} temperatures from {low:g} to {high:g} C"
        return plans.plan_of(
            case,
            replace(step, measure=self.name, name="target mode over temperature", looks_for=looks),
            simplifications.alike_drift(case.design),
        )

    @classmethod
    def in_study(cls) -> None:
        """Return nothing: a study sweeps `solve.temperature_C` itself."""
        return

    def compute(self, case: Case, plan: Plan, run: Run) -> DriftResult:
        from pipeline.models.drift import drift, unknown

        for text in unknown(case.design):
            run.warning("TEMPERATURE", text)
        return DriftResult(**drift(case, self._span(case), self.points, run))

    def _span(self, case: Case) -> Pair:
        own = case.solve.temperature_C
        return own - self.around_K, own + self.around_K
