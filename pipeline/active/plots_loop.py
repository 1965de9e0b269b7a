"""Pictures of one mode's loop: step response, Nyquist circle, Bode diagram."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from pipeline.plots import style as plots_style
from pipeline.plots.style import ReportFigure

if TYPE_CHECKING:
    from solvers.control.dq_study import DqStudy

MS, DEG = 1e3, 180.0 / np.pi


def report_figures(study: DqStudy) -> list[ReportFigure]:
    """Step, circle, Bode."""
    return [step(study), circle(study), bode(study)]


def step(study: DqStudy) -> ReportFigure:
    """Figure 2.21 computed, detuned too, and a saturated step for each anti-windup."""
    figure = plots_style.new_figure(plots_style.WIDTH_IN, 5.2)
    small, large = figure.subplots(2, 1, sharex=True)
    for one, colour in zip(study.steps, plots_style.CYCLE, strict=False):
        trace, wanted = one.trace, one.reference
        name = f"{one.name}, {one.detuning_hz:+g} Hz"
        small.plot(trace.time_s * MS, trace.measured.real / wanted, color=colour, marker=".", ms=3, lw=0.9, label=name)
        small.plot(trace.time_s * MS, trace.measured.imag / wanted, color=colour, ls=":", lw=0.9)
    small.axhline(0.95, color=plots_style.GREY, lw=0.7, ls="--")
    small.axvline(study.data.within_s * MS, color=plots_style.GREY, lw=0.7, ls="--")
    small.set_title("Small step: U_d (lines with dots) and U_q (dotted)")
    for one, colour, style in zip(study.windups, plots_style.CYCLE, ("-", "--", "-."), strict=False):
        large.plot(
            one.trace.time_s * MS, np.abs(one.trace.measured) / one.reference, style, color=colour, label=one.name
        )
    share = study.windups[0].reference / (abs(study.identified.plant.gain) * study.data.drive_limit)
    large.set_title(f"Step to {share:.2f} of the amplitude at full drive: the drive meets its limit")
    large.set_xlabel("time since the reference changed (ms)")
    for axes in (small, large):
        axes.set_ylabel("U / reference")
        axes.set_xlim(0, 10)
        axes.legend(fontsize=7)
    reached = study.query.trace.reached_s() * MS
    alt = (
        f"Step response of the closed loop at the firmware's rates: 95 % after {reached:.2f} ms, overshoot "
        f"{100 * study.query.trace.overshoot():.1f} %; a saturated step with three treatments of the integral."
    )
    return ReportFigure("dq_step", "Step response of the closed loop", alt, figure, vector=True)


def circle(study: DqStudy) -> ReportFigure:
    """The sweep in the plane of U with its delay taken out, and the phase about the circle's centre."""
    figure = plots_style.new_figure(plots_style.WIDTH_IN, 3.4)
    plane, phase = figure.subplots(1, 2, width_ratios=[1.0, 1.3])
    identified, f = study.identified, study.sweep.frequencies_hz
    straight = study.sweep.response * np.exp(2j * np.pi * f * identified.delay_s)
    if study.data.sensor == "displacement":
        straight = straight * 1j * f / identified.plant.frequency_hz
    around = identified.circle.centre + identified.circle.radius * np.exp(1j * np.linspace(0, 2 * np.pi, 200))
    plane.plot(around.real, around.imag, color=plots_style.GREY, lw=0.9, label="fit")
    plane.plot(straight.real, straight.imag, "o", ms=2.5, color=plots_style.BLUE, label="sweep")
    plane.set_aspect("equal")
    plane.set_xlabel("U_d / V")
    plane.set_ylabel("U_q / V")
    plane.set_title("Circle")
    plane.legend(fontsize=7)
    angles = np.unwrap(np.angle(straight - identified.circle.centre)) * DEG
    detuning = f - identified.plant.frequency_hz
    fitted = -2.0 * np.arctan(2.0 * np.pi * detuning * identified.plant.tau_s) * DEG
    phase.plot(detuning, angles, "o", ms=2.5, color=plots_style.BLUE, label="sweep")
    phase.plot(detuning, fitted + np.median(angles - fitted), color=plots_style.GREY, lw=0.9, label="-2 atan(τ δω)")
    phase.set_xlabel("detuning (Hz)")
    phase.set_ylabel("angle about the centre (degrees)")
    phase.set_title(f"{identified.plant.frequency_hz:.2f} Hz, τ = {identified.plant.tau_s * MS:.3f} ms")
    phase.legend(fontsize=7)
    alt = (
        f"Response about resonance as a circle of diameter {2 * identified.circle.radius:.3f}, and its phase, which gives "
        f"{identified.plant.frequency_hz:.2f} Hz and a time constant of {identified.plant.tau_s * MS:.3f} ms."
    )
    return ReportFigure("dq_circle", "Identification by circle and phase", alt, figure, vector=True)


def bode(study: DqStudy) -> ReportFigure:
    """Open and closed loop of the envelope, as designed in continuous time and as sampled."""
    from solvers.control.dq_study import envelope_frequencies

    figure = plots_style.new_figure(plots_style.WIDTH_IN, 4.6)
    size, phase = figure.subplots(2, 1, sharex=True)
    omega = envelope_frequencies(study.data)
    loop, closed = study.pi.closed_loop(study.identified.plant, omega)
    sampled = study.sampled_loop()
    up = sampled.omega_rad_s > omega[0]
    curves = (
        (omega, loop, "-", plots_style.BLUE, "open, continuous design"),
        (omega, closed, "-", plots_style.VERMILION, "closed, continuous design"),
        (sampled.omega_rad_s[up], sampled.open_loop[up], "--", plots_style.BLUE, "open, sampled"),
        (sampled.omega_rad_s[up], sampled.closed_loop[up], "--", plots_style.VERMILION, "closed, sampled"),
    )
    for w, values, style, colour, name in curves:
        size.semilogx(w / (2 * np.pi), 20 * np.log10(np.abs(values)), style, color=colour, label=name)
        phase.semilogx(w / (2 * np.pi), np.unwrap(np.angle(values)) * DEG, style, color=colour)
    size.axhline(0, color=plots_style.GREY, lw=0.7, ls=":")
    size.set_ylabel("magnitude (dB)")
    size.set_ylim(-40, 60)
    size.legend(fontsize=7)
    size.set_title("Loop of the amplitude at resonance")
    phase.set_ylabel("phase (degrees)")
    phase.set_xlabel("frequency of the amplitude (Hz)")
    alt = (
        f"Bode diagram of the amplitude's loop: gain margin {study.margins.gain:.1f}, the carrier's phase may be off by "
        f"{study.margins.phase_deg:.0f} degrees."
    )
    return ReportFigure("dq_bode", "Bode diagram of the amplitude's loop", alt, figure, vector=True)
