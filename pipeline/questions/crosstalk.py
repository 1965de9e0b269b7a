"""Cross-talk between several zones on one plate: each driven in turn, all measured."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from pipeline.case.features import LARGER, PLACES, STRESS, SUPPORTS, ZONES
from pipeline.case.limits import MAX_FREQUENCIES
from pipeline.models.answer_parts import DrivenZone, worst_of
from pipeline.quantity import KHZ, MM, NM, frequency_with_bar, level, level_figure, level_with_bar, several
from pipeline.questions.late import Axes, Case, Plan, ReportFigure, np, plans, style
from pipeline.questions.question import Pair, Question, Run, hz, option
from pipeline.questions.result import Result, figure, figure_at, stacked
from pipeline.records.part import column

POINTS = 401
DARK = -25.0  # dB: below this level letters are white


class CrosstalkResult(Result, table="zones", axes=("driven", "measured")):
    """Cross-talk of several zones on one plate, each driven in turn: levels relative to the driven zone, dB.

    >>> import antinode
    >>> from pipeline.models.answer_parts import DrivenZone
    >>> zone = {"centre_m": 0.0, "drivers": [0], "peak_hz": 33e3, "passive_db": None, "over_rms_m_per_V": []}
    >>> zones = [DrivenZone(**zone, rms_m_per_V=[1e-9, 2e-11], level_db=[0.0, -34.0])] * 2
    >>> levels = antinode.Crosstalk(model="", dof=0, shared_rows=3, gap_m=0.01, frequency_hz=[], zones=zones)
    >>> float(levels.level_db[0, 1])
    -34.0
    """

    model: str = column("model of the plate and its element order, and the number of patches")
    dof: int = column("degrees of freedom that were solved for")
    shared_rows: int = column("rows between two zones")
    gap_m: float = column("distance between the borders of two zones", "m")
    frequency_hz: list[float] = column("frequencies of over_rms_m_per_V", "Hz", along="frequency_hz")
    zones: list[DrivenZone] = column("one entry per driven zone, in ascending y")

    level_db = stacked("level_db", "Levels (driven zones, measured zones) in dB.")

    @property
    def first(self) -> DrivenZone:
        """Entry of the first driven zone."""
        return self.zones[0]

    crosstalk_gap_mm = figure_at(
        "gap_m", "gap between zones", "mm", scale=MM, error=lambda levels: 0.0
    )  # a given value

    @figure("largest cross-talk", "dB", name="crosstalk_db", error=lambda levels: worst_of(levels.zones)[1])
    def worst_db(self) -> float | None:
        """Largest level of a zone while another is driven; None for a single zone."""
        return worst_of(self.zones)[0]

    crosstalk_hz = figure_at("first.peak_hz", "peak of the first zone, driven", "Hz")
    crosstalk_passive_db = figure_at("first.passive_db", "passive face, first zone driven", "dB")

    def lines(self) -> Iterator[str]:
        """Yield the gap and one line per driven zone."""
        between = several(self.shared_rows, "row") if self.shared_rows else "no row"
        head = f"{len(self.zones)} zones, {self.gap_m / MM:g} mm and {between} between neighbours"
        if any(zone.centre_x_m for zone in self.zones):
            head = f"{len(self.zones)} zones, at least {self.gap_m / MM:g} mm between their borders"
        yield head if len(self.zones) > 1 else "one zone"
        yield from map(_in_words, self.zones)

    def draw(self, ax: Axes) -> None:
        """Draw the level of every zone for each driven zone, dB."""
        levels, names = self.level_db, [str(number) for number in range(1, len(self.zones) + 1)]
        ax.imshow(levels, cmap=style.QUALITY, vmin=-60.0, vmax=0.0)
        for row, at in np.ndindex(levels.shape):
            errors, level = self.zones[row].level_error_db, float(levels[row, at])
            words: dict[str, Any] = {"ha": "center", "va": "center", "color": "black" if level > DARK else "white"}
            ax.text(at, row, level_figure(level, errors[at] if errors else None), **words)
        ax.set_xticks(range(len(levels)), names)
        ax.set_yticks(range(len(levels)), names)
        ax.set(xlabel="measured zone", ylabel="driven zone", title="level relative to the driven zone (dB)")

    def pictures(self) -> list[ReportFigure]:
        """Return the pictures of the levels, and of every zone over frequency while the first is driven."""
        drawn, (table, over) = style.panels(3.4, 1, 2, width_ratios=(1.0, 1.6))
        self.draw(table)
        curves = {f"zone {i}": np.array(rms) / NM for i, rms in enumerate(self.first.over_rms_m_per_V, start=1)}
        style.draw_lines(over.semilogy, np.array(self.frequency_hz) / KHZ, curves)
        style.mark(over, self.first.peak_hz / KHZ)
        over.set(xlabel="frequency (kHz)", ylabel="rms u_z (nm/V)", title="Zone 1 driven")
        over.legend(fontsize=9)
        worst = "one zone" if self.worst_db is None else f"at most {level(self.worst_db)} in another zone"
        alt = f"Cross-talk between {len(self.zones)} zones, {self.gap_m / MM:g} mm between neighbours: {worst}"
        return [style.ReportFigure("crosstalk", "Cross-talk between zones", alt, drawn, vector=True)]

    def __repr__(self) -> str:
        return f"<antinode.Crosstalk: {len(self.zones)} zones>"


def _in_words(zone: DrivenZone) -> str:
    errors = zone.level_error_db or [None] * len(zone.level_db)
    levels = ", ".join(level_with_bar(*each) for each in zip(zone.level_db, errors, strict=True))
    passive = ""
    if zone.passive_db is not None:
        passive = f"; passive face {level_with_bar(zone.passive_db, zone.passive_error_db)}"
    peak = frequency_with_bar(zone.peak_hz, zone.peak_error)
    at = f"x = {zone.centre_x_m / MM:g} mm, " if zone.centre_x_m else ""
    return f"driven at {at}y = {zone.centre_m / MM:g} mm, {peak}: zones at {levels}{passive}"


class Crosstalk(
    Question[CrosstalkResult],
    needs=("patches",),
    drives=True,
    honours=(ZONES, LARGER, PLACES, SUPPORTS, STRESS),
    example="crosstalk examples/37-two-zones.toml --out crosstalk",
):
    """Drive each of several zones on one plate in turn and measure all, in dB ([[zone]] in the case).

    >>> from antinode import Patches, load
    >>> one = load("examples/small.toml", accuracy=0.1, patches=Patches(size_mm=(8.0, 3.0, 0.3)))
    >>> plate = one.with_(zone=[one.to_dict()["zone"], {"shared_rows": 3}])
    >>> bool(plate.crosstalk((33.0, 36.0), points=5).level_db[0, 1] < -3.0)
    True
    """

    band_kHz: Pair | None = option(default=None, unit="kHz", at_least=0.0, kw_only=False, help="frequencies")
    points: int = option(default=POINTS, at_least=1, at_most=MAX_FREQUENCIES, help="number of frequencies")

    def check(self, case: Case) -> None:
        """Raise InputError for a case without patches that drive each of its zones."""
        from pipeline.models.forced import check_zones

        super().check(case)
        check_zones(case)

    def plan(self, case: Case) -> Plan:
        from dataclasses import replace

        step = plans.response_step(case, hz(self.band_kHz), self.points)
        looks = f"{self.points} frequencies, {len(case.design.views)} zones, each driven in turn"
        own = replace(step, measure=self.name, name="cross-talk between zones", looks_for=looks)
        return plans.plan_of(case, own)

    def compute(self, case: Case, plan: Plan, run: Run) -> CrosstalkResult:
        """Drive each zone at its own peak and measure every zone."""
        from pipeline.models.forced import solve

        result = CrosstalkResult(**solve(case, run, hz(self.band_kHz), self.points, run.meshes, is_announced=True))
        run.report(result)
        return result
