"""Spread of peak and confinement by scatter from pillar to pillar, or by a batch deviation shared by a plate."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from math import sqrt
from typing import TYPE_CHECKING, Any

from pipeline.case.features import LARGER, SUPPORTS
from pipeline.case.limits import MAX_SAMPLES, MAX_SEED
from pipeline.models.answer_parts import SampleRecord, SpreadRecord, known, spread_of, statistics
from pipeline.quantity import KHZ, NM, figure, frequency, interval, level, percent, several, signed
from pipeline.questions.late import Axes, Case, Plan, ReportFigure, confinement, np, plans, style
from pipeline.questions.question import Declared, Pair, Question, Run, hz, option
from pipeline.questions.result import Result, figure_at
from pipeline.records.part import column

if TYPE_CHECKING:
    from pipeline.models.tolerance import VariedPlates

MOVED = 0.1  # relative to the spread of peaks or levels: beyond it, the reduced space is too small
ALIKE_DB = 0.01  # smaller differences of levels are ignored, however small the spread
PER = {"m/V": "_m_per_V", "m/N": "_m_per_N"}  # endings of column names, by unit
FRAME: dict[str, Any] = {"fontsize": 9, "frameon": True, "framealpha": 0.9, "edgecolor": "none"}
ALONE = "nothing: the free target mode of one column of cells, with one deviation of all pillars"
SAMPLES = "number of plates (default: the case's, 20)"


class ToleranceResult(Result, table="samples", axes=("sample",)):
    """Plates whose pillars deviate: the nominal plate, samples in Hz and dB, and statistics of the samples not lost.

    >>> import antinode
    >>> antinode.Tolerance.heading()[:2]
    ['sample', 'peak_hz']
    """

    tolerance: dict[str, Any] = column(
        "standard deviations and sampling: height_m, side_m, position_m, stiffness (relative), seed, cut_at_deviations"
    )
    drive: str = column("excitation: patches, or a pressure")
    rms_unit: str = column("m/V or m/N; empty without an excitation")
    pillars: int = column("number of pillars")
    dofs: int | None = column(
        "degrees of freedom of the reduced space in which samples are solved; None for a batch deviation"
    )
    nominal: SampleRecord = column("nominal plate")
    samples: list[SampleRecord] = column("sampled plates")
    lost: int = column("samples without the target mode, excluded from the statistics")
    split: int = column("samples with a split target mode")
    peak_hz: SpreadRecord | None = column("frequencies of the peaks, Hz")
    peak_shift_hz: SpreadRecord | None = column("peaks minus the nominal one, Hz")
    confinement_db: SpreadRecord | None = column("confinements at the peaks, dB")
    confined: int | None = column("number of confined samples")
    space_check: dict[str, float | None] = column(
        "change of one sample when solved in the space of a narrower band: peak_hz in Hz, confinement_db in dB; empty "
        "for a batch deviation"
    )
    interpolation_check: dict[str, float | None] = column(
        "error of the interpolation between reductions, with all pillars two standard deviations from nominal: peak_hz "
        "in Hz, confinement_db in dB; empty for a batch deviation",
        default_factory=dict,
    )
    frequency_error: float | None = column(
        "relative error bar of every frequency (half-width), if a column of cells represents the plate",
        default=None,
    )

    tolerance_peak_hz = figure_at("peak_hz.mean", "peak with scatter: mean", "Hz", error="peak_hz.relative")
    tolerance_peak_spread_hz = figure_at(
        "peak_hz.deviation", "its spread", "Hz", is_difference=True,
        error=lambda result: result.peak_hz and result.peak_hz.spread_error(result.counted),
    )  # fmt: skip
    tolerance_db = figure_at(
        "confinement_db.mean", "confinement with scatter: mean", "dB", error="confinement_db.deviation"
    )
    tolerance_spread_db = figure_at(
        "confinement_db.deviation", "its spread", "dB",
        error=lambda result: result.confinement_db and result.confinement_db.spread_error(result.counted),
    )  # fmt: skip
    tolerance_worst_db = figure_at("confinement_db.lowest", "its worst value", "dB", error="confinement_db.deviation")

    @property
    def counted(self) -> int:
        """Number of samples in the statistics."""
        return len(self.samples) - self.lost

    def to_rows(self) -> list[dict[str, Any]]:
        """Return one row per sample; rms columns carry their unit, and driven columns exist only with an excitation."""
        rows = super().to_rows()
        if not self.rms_unit:
            return [{name: row[name] for name in ("sample", "peak_hz", "confinement_db", "tracking")} for row in rows]
        own = f"zone_rms{PER[self.rms_unit]}"
        return [{own if name == "zone_rms" else name: value for name, value in row.items()} for row in rows]

    # -- words and pictures

    def lines(self) -> Iterator[str]:
        """Yield the deviations, the samples and their statistics."""
        yield self._varied()
        yield self.reading(("sample",))
        yield from self.summary()

    def _varied(self) -> str:
        from pipeline.search.fidelity import column_level_error_db

        if self.frequency_error is None:
            return f"{several(self.pillars, 'pillar')}, driven by {self.drive}"
        level = self.plate_design and column_level_error_db(self.nominal.confinement_db, self.plate_design.nodal_lines)
        return (
            f"{several(self.pillars, 'pillar')}, one deviation shared by all of a plate; "
            f"a column of cells represents the plate, within {percent(self.frequency_error)} of its frequency"
            + (f" and {figure(level, level)} dB of its confinement" if level else "")
        )

    def summary(self) -> Iterator[str]:
        """Yield the statistics: frequencies and levels with the digits that their spread allows.

        Yields
        ------
        str
            A line of text.
        """
        from solvers.variation.cells import CHECKED
        from solvers.variation.samples import CUT

        peak, shift, levels, count = self.peak_hz, self.peak_shift_hz, self.confinement_db, self.counted
        wide = peak.relative if peak else None
        yield self.nominal.line("nominal", wide)
        if peak and shift:
            moved = None if shift.deviation is None else shift.deviation / sqrt(count)
            yield (
                f"{count} plates: peak {frequency(peak.mean, wide)}, spread {peak.spread(count, 'Hz')}, "
                f"{interval(peak.lowest, peak.highest, wide, wide)}; moved by {signed(figure(shift.mean, moved))} Hz on average"
            )
        if levels:
            yield (
                f"confinement {level(levels.mean, levels.deviation)}, spread {levels.spread(count, 'dB')}, "
                f"worst {level(levels.lowest, levels.deviation)}; {self.confined} of {count} confined"
            )
        off_hz, off_db = (self.interpolation_check.get(name) for name in ("peak_hz", "confinement_db"))
        if off_hz is not None:
            of_level = "" if off_db is None else f" and its confinement by {figure(off_db, off_db or None)} dB"
            yield (
                f"with all pillars {CUT * CHECKED:g} standard deviations from nominal, interpolation between "
                f"reductions changes the peak by {figure(off_hz, off_hz or None)} Hz{of_level}"
            )
        if self.lost:
            yield f"{self.lost} of {len(self.samples)} plates lost the target mode: no mode has the target shape"

    def draw(self, ax: Axes) -> None:
        """Draw peak and driven confinement of each plate, the nominal plate marked."""
        both = [(one.peak_hz, one.confinement_db) for one in (self.nominal, *self.samples) if one.peak_hz is not None]
        tone, decibels = np.reshape(np.array(both, dtype=float), (-1, 2)).T
        ax.plot(tone[1:] / KHZ, decibels[1:], "o", ms=4, color=style.BLUE, label="samples")
        ax.plot(tone[:1] / KHZ, decibels[:1], "*", ms=11, color="black", label="nominal plate")
        least = confinement.CONFINED_DB
        ax.axhline(least, color=style.GREY, ls="--", lw=0.9, label=f"confined from {least:g} dB")
        ax.set(xlabel="peak (kHz)", ylabel="confinement at the peak (dB)")
        if spread := self.confinement_db:
            own = spread.deviation or 0.0
            ax.axhspan(spread.mean - own, spread.mean + own, color=style.SKY, alpha=0.25, lw=0)
            ax.set_title(f"Confinement {self._levels(', ')}")
        ax.grid(True)
        ax.legend(**FRAME)

    def pictures(self) -> list[ReportFigure]:
        """Return the picture of curves over frequency, if any, and of each plate's peak and confinement."""
        curves = self.arrays.get("tolerance_curves")
        drawn = [self._draw_curves] * (curves is not None) + [self.draw] * bool(self.confinement_db)
        figure, panels = style.panels(0.4 + 2.6 * len(drawn), len(drawn), 1, squeeze=False)
        for panel, draw in zip(panels[:, 0], drawn, strict=True):
            draw(panel)
        title = "Effect of batch deviations on the target mode"
        if curves is not None:
            title = "Effect of printing scatter on the response"
        return [style.ReportFigure("tolerance", title, self._alt(), figure, vector=True)]

    def _draw_curves(self, ax: Axes) -> None:
        tone, curves = self.arrays["tolerance_hz"] / KHZ, np.asarray(self.arrays["tolerance_curves"]) / NM
        for number, curve in enumerate(curves[1:]):
            ax.semilogy(tone, curve, color=style.SKY, lw=0.6, alpha=0.7, label="samples" if number == 0 else None)
        ax.semilogy(tone, curves[0], color="black", lw=1.3, label="nominal plate")
        title, peak, count = "No plate kept the target mode", self.peak_hz, self.counted
        if peak:
            mean = frequency(peak.mean, peak.relative)
            title = f"Target mode's peak {mean}, spread {peak.spread(count, 'Hz')} over {count} plates"
        ax.set(xlabel="frequency (kHz)", ylabel=f"zone rms u_z (n{self.rms_unit})", title=title)
        ax.grid(True)
        ax.legend(**FRAME)

    def _levels(self, to_worst: str) -> str:
        """Mean, spread and worst confinement of the samples, with the digits that the spread allows."""
        found = self.confinement_db
        assert found is not None
        mean, worst = (level(each, found.deviation) for each in (found.mean, found.lowest))
        return f"{mean}, spread {found.spread(self.counted, 'dB')}{to_worst}worst {worst}"

    def _alt(self) -> str:
        alike = self.frequency_error is not None
        plates = "plates, each with one deviation of all its pillars" if alike else "plates whose pillars differ"
        peak, tone = self.peak_hz, self.nominal.peak_hz
        if not peak:
            return f"None of {len(self.samples)} {plates} kept the target mode."
        nominal = "" if tone is None else f", nominally at {frequency(tone, peak.relative)}"
        spread = f"; confinement {self._levels(', at ')}" if self.confinement_db else ""
        return (
            f"{len(self.samples)} {plates}: the target mode's peak lies at {frequency(peak.mean, peak.relative)} "
            f"(spread {peak.spread(self.counted, 'Hz')}){nominal}{spread}"
        )

    def __repr__(self) -> str:
        return f"<antinode.Tolerance: {several(len(self.samples), 'sample')}>"


class _Drawn(Declared):
    """Options of a random sample of plates."""

    samples: int | None = option(default=None, at_least=1, at_most=MAX_SAMPLES, help=SAMPLES)
    seed: int | None = option(
        default=None, at_least=1, at_most=MAX_SEED, help="random seed of the samples (default: the case's, 1)"
    )

    def asked_of(self, case: Case) -> Case:
        """Return the case with the requested number of samples and seed."""
        given = case.tolerance
        if given is None:
            return case
        changed = {"samples": self.samples or given.samples, "seed": self.seed or given.seed}
        return replace(case, tolerance=given.but(**changed))


class Tolerance(
    _Drawn,
    Question[ToleranceResult],
    needs=("tolerance",),
    drives=True,
    honours=(LARGER, SUPPORTS),
    example="tolerance studies/three-rows.toml --set tolerance.height_mm=0.05 --samples 20 --out spread",
):
    """Compute the spread of peak (Hz) and confinement (dB) when every pillar differs (requires [tolerance]).

    >>> from antinode import Scatter, load
    >>> plate = load("examples/small.toml", accuracy=0.1, tolerance=Scatter(height_mm=0.05, samples=2))
    >>> spread = plate.tolerance((33.5, 35.5))
    >>> [round(sample.confinement_db) for sample in spread.samples]
    [10, 11]
    """

    band_kHz: Pair | None = option(default=None, unit="kHz", at_least=0.0, kw_only=False, help="frequencies")

    def check(self, case: Case) -> None:
        """Raise InputError for a case without pillars or deviations."""
        case.require_plate("tolerance")
        case.require("tolerance", "pillar", command="tolerance")
        case.one_quality_factor("tolerance")
        case.require_mirrored("tolerance")

    def plan(self, case: Case) -> Plan:
        return plans.plan_of(case, plans.tolerance_step(case, hz(self.band_kHz)))

    def compute(self, case: Case, plan: Plan, run: Run) -> ToleranceResult:
        from pipeline.models.tolerance import solve
        from pipeline.planning.model_choice import driven_band_hz
        from solvers.variation.samples import CUT

        given, choice, band = case.tolerance, plan.steps[0].choice, driven_band_hz(case, hz(self.band_kHz))
        assert given and choice
        solved = solve(case, given, choice, band, run)
        scatter = {name: getattr(given, name) for name in ("height_m", "side_m", "position_m", "stiffness", "seed")}
        result = ToleranceResult.of(
            solved,
            tolerance=scatter | {"cut_at_deviations": CUT},
            drive="patches" if case.patches else "pressure in the target shape",
            rms_unit="m/V" if case.patches else "m/N",
            **statistics(solved.nominal, solved.samples),
        )
        _report(result, solved, band, run)
        arrays = {"tolerance_hz": solved.frequency_hz, "tolerance_curves": solved.curves}
        run.arrays |= arrays
        return result.with_arrays(arrays)


class AlikeTolerance(_Drawn, Question[ToleranceResult], instead_of="tolerance", by="alike"):
    """Compute the spread of peak (Hz) and confinement (dB) by a batch deviation, shared by all pillars of a plate.

    Each plate of the batch is represented by one column of cells, from the reduced bases of `antinode explore`.

    >>> from antinode import Scatter, load
    >>> plate = load("examples/small.toml", tolerance=Scatter(height_mm=0.05, samples=2))
    >>> plate.alike_tolerance().pillars
    28
    """

    alike: bool = option(
        default=False,
        help="sample batch deviations, each shared by all pillars of a plate (uses the bases of antinode explore)",
    )

    def check(self, case: Case) -> None:
        """Raise InputError for a case without pillars or without deviations of their sizes."""
        from pipeline.explore.answer import check

        check(case)

    def plan(self, case: Case) -> Plan:
        from pipeline.explore.answer import FIXED

        assert case.tolerance
        step = plans.plain_step(
            "tolerance", f"{case.tolerance.samples} plates of a batch", "one column of parametric cells each"
        )
        return plans.plan_of(case, replace(step, left_out=(FIXED,) if case.tolerance.position_m else ()))

    def compute(self, case: Case, plan: Plan, run: Run) -> ToleranceResult:
        from pipeline.explore.answer import solve
        from solvers.variation.samples import CUT

        nominal, samples, error = solve(case, run)
        scatter = {name: getattr(case.tolerance, name) for name in ("height_m", "side_m", "seed")}
        return ToleranceResult(
            tolerance=scatter | {"cut_at_deviations": CUT},
            drive=ALONE,
            rms_unit="",
            pillars=len(case.design.pillar_centres()),
            dofs=None,
            nominal=nominal,
            samples=samples,
            space_check={},
            frequency_error=error,
            **statistics(nominal, samples),
        )


def _report(result: ToleranceResult, solved: VariedPlates, band_hz: Pair, run: Run) -> None:
    """Log the statistics; warn of modes outside the band or lost, and of a reduced space that is too small."""
    said = list(result.summary())
    for line in said:
        run.info(line)
    peaks, levels = (spread_of(known(result.samples, name)) for name in ("peak_hz", "confinement_db"))
    if peaks and (peaks.lowest <= band_hz[0] or peaks.highest >= band_hz[1]):
        run.warning("PEAK_AT_END", "the target mode of a sample lies outside the band: widen it")
    if result.lost:
        run.warning("LOST", said[-1])
    nominal, (change, louder) = (
        result.nominal.peak_hz,
        (solved.space_check[name] for name in ("peak_hz", "confinement_db")),
    )
    moved, apart = (MOVED * ((each and each.deviation) or 0.0) for each in (peaks, levels))
    small = "a narrower space of modes"
    if change is not None and nominal and change > max(moved, 0.1 * nominal * solved.loss):
        text = f"{small} moves the peak of a sample by {figure(change, change)} Hz: widen the band"
        run.warning("SPACE_TOO_SMALL", text)
    if louder is not None and louder > max(apart, ALIKE_DB):
        text = f"{small} changes the confinement of a sample by {figure(louder, louder)} dB: widen the band"
        run.warning("SPACE_TOO_SMALL", text)
