"""Control loop for a mode's amplitude in the rotating frame: design, margins, steps, identification from a sweep."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import TYPE_CHECKING, Any

from pipeline.quantity import KHZ, MS, US, figure, frequency
from pipeline.questions.active import COMPARED, Compared, Modelled, asked, compared, quality_option
from pipeline.questions.late import Axes, Case, Plan, ReportFigure, outputs
from pipeline.questions.question import Question, Run, option
from pipeline.records.part import column

if TYPE_CHECKING:
    from firmware.mode_table import ModeTable
    from solvers.thesis.loop_design import DqData


class DqResult(Modelled, table="comparison", axes=("quantity",)):
    """Control loop of one mode on demodulated amplitudes: design, feasibility, margins, identification and steps."""

    plant: dict[str, Any] = column(
        "the controlled mode: frequency_hz, quality_factor, tau_s (time constant), gain (sensor / drive, full "
        "scales), sensor (displacement or velocity), delay_s"
    )
    neighbours: list[dict[str, float]] = column("other modes that the drive excites: frequency_hz and gain")
    design: dict[str, Any] = column(
        "the PI controller on demodulated amplitudes: within_s, the required time; latency_s of the loop; "
        "response_s, its time constant; proportional and integral_per_s in continuous time; sampled: the firmware's "
        "values, proportional and integral every period_s, planned_s to meet within_s, largest_share of the drive "
        "after noise and neighbours, bounded_by_neighbours"
    )
    feasibility: list[dict[str, Any]] = column(
        "drive needed for an amplitude, by share of the largest: reference, steady_drive, peak_drive while rising, "
        "feasible (the drive never reaches its limit), largest_reference that keeps the response, least_time_s to "
        "95 % at full drive (None beyond the largest sustainable amplitude)"
    )
    margins: dict[str, Any] = column(
        "margins of the sampled loop: gain, phase_deg of the carrier, sensitivity (its largest), stable, poles (real "
        "and imaginary)"
    )
    identified: dict[str, Any] = column(
        "mode identified from a simulated sweep: frequency_hz, tau_s, quality_factor, gain (real and imaginary), "
        "delay_s, background (real and imaginary), circle (centre, radius, misfit), and printed_tau_s by the "
        "thesis' formula"
    )
    measured: dict[str, Any] | None = column(
        "mode identified from the file of --sweep: frequency_hz, tau_s, quality_factor, gain, delay_s, background, "
        "circle (centre, radius, misfit); None without one"
    )
    steps: list[dict[str, Any]] = column(
        "simulated steps, by name: detuning_hz of the mode, reference, reached_95_s and settled_5_s (None where never), "
        "overshoot, limited_periods in which the drive was saturated"
    )
    anti_windup: list[dict[str, Any]] = column(
        "steps that saturate the drive, by name of the integrator's treatment: detuning_hz, reference, reached_95_s, "
        "settled_5_s, overshoot and limited_periods as in steps"
    )
    table_entry: dict[str, Any] = column(
        "the mode as stored in a mode table: frequency_hz, tau_s, gain (real and imaginary), delay_s, drive_limit, "
        "amplitude_limit"
    )
    comparison: list[Compared] = column(COMPARED)

    def lines(self) -> Iterator[str]:
        """Yield mode, identified mode, gains, margins, steps and the comparison."""
        mode, found, design, margins = self.plant, self.identified, self.design, self.margins
        sampled, measured = design["sampled"], " of the measured mode" * (self.measured is not None)
        rows = [*self.steps, *self.anti_windup]
        yield (
            f"mode {frequency(mode['frequency_hz'])}, quality factor {mode['quality_factor']:g}, "
            f"{len(self.neighbours)} neighbours"
        )
        yield (
            f"identified from a simulated sweep{measured}: {frequency(found['frequency_hz'])}, tau "
            f"{figure(found['tau_s'] / MS)} ms, |G| {figure(abs(complex(*found['gain'])))}, delay "
            f"{figure(found['delay_s'] / US)} us"
        )
        yield (
            f"continuous PI: K_p = {figure(design['proportional'])}, K_i = {figure(design['integral_per_s'])} 1/s for tau_d = "
            f"{design['response_s'] / MS:g} ms; each {sampled['period_s'] / US:g} us: K_p = "
            f"{figure(sampled['proportional'])}, integral {figure(sampled['integral'])}"
        )
        yield (
            f"margins: gain {figure(margins['gain'])}, phase of the carrier {figure(margins['phase_deg'])} degrees, "
            f"sensitivity {figure(margins['sensitivity'])}"
        )
        yield outputs.reading_table(tuple(rows[0]), [[*row.values()] for row in rows])
        yield from self.compared()

    def draw(self, ax: Axes) -> None:
        """Draw the time to 95 % of each step over the mode's detuning."""
        for one in self.steps:
            if one["reached_95_s"] is not None:
                ax.plot(one["detuning_hz"], one["reached_95_s"] / MS, "o", label=one["name"])
        ax.set(xlabel="detuning (Hz)", ylabel="time to 95 % (ms)")

    def pictures(self) -> list[ReportFigure]:
        """Return the pictures of step, circle and open loop."""
        from pipeline.active import plots

        return plots.loop_figures(self.study)


class ActiveDq(Question[DqResult], family="active", without_case="", example="active dq --settling-time 2ms"):
    """Control a mode's amplitude in the rotating frame, or identify it from a measured sweep.

    A case supplies the mode by pre-design; --table supplies the computed modes of a mode table.

    >>> import antinode
    >>> antinode.load("examples/small.toml").active_dq(settling_time_s=2e-3).margins["stable"]
    True
    """

    frequency_kHz: float | None = option(default=None, unit="kHz", at_least=0.0, help="frequency of the mode")
    quality_factor: float | None = quality_option("the mode")
    delay_s: float | None = option(default=None, unit="s", at_least=0.0, help="dead time of the loop")
    settling_time_s: float | None = option(default=None, unit="s", at_least=0.0, help="required 95 % settling time")
    table: str = option(default="", metavar="FILE", help="mode table with the mode and its neighbours")
    sweep: str = option(
        default="", metavar="FILE", help="measured sweep from which to identify the mode (CSV: frequency_hz, re, im)"
    )

    def compute(self, case: Case | None, plan: Plan, run: Run) -> DqResult:
        """Study the loop of the mode given by a sweep, a mode table, a case or an option."""
        from pipeline.active import loop, thesis
        from pipeline.measured.files import read_sweep
        from solvers.control.identification import identify
        from solvers.thesis.loop_design import dq_study

        table = loop.read_table(self.table) if self.table else None
        with asked("dq"):
            data, measured = self._data(case, table, run), None
            if self.sweep:
                measured = identify(read_sweep(self.sweep).sweep, data.sensor, data.delay_guess_s)
                late = max(
                    measured.delay_s - 0.5 / data.rates.sample_rate_hz, 0.0
                )  # in addition to the half sample of the hold
                data = replace(data, target=loop.velocity_of(measured.plant, data.sensor), delay_s=late)
            study = dq_study(data)
        if table and measured:
            loop.write_table(table, measured, run.folder, run.log)
        found = measured.to_dict() if measured else None
        comparison = compared("dq", thesis.dq(study))
        return DqResult(**study.to_dict(), measured=found, comparison=comparison, study=study)

    def _data(self, case: Case | None, table: ModeTable | None, run: Run) -> DqData:
        from pipeline.active import loop
        from solvers.control.loop import ModePlant
        from solvers.thesis.loop_design import DqData

        data = DqData()
        if table is not None:
            data = loop.of_table(data, table, run.log)
        elif case is not None:
            case.require("plate", "zone", command="active dq without --table")
            data = replace(data, target=loop.of_case(case, run.log))
        plant, late = data.target, self.delay_s
        tone = plant.frequency_hz if self.frequency_kHz is None else KHZ * self.frequency_kHz
        return replace(
            data,
            target=ModePlant.from_quality_factor(tone, self.quality_factor or plant.quality_factor, plant.gain),
            within_s=data.within_s if self.settling_time_s is None else self.settling_time_s,
            delay_s=data.delay_s if late is None else late,
            delay_guess_s=data.delay_guess_s if late is None else late,
        )
