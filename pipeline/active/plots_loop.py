"""Pictures of one mode's loop: step response, Nyquist circle, Bode diagram."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from pipeline.plots import style
from pipeline.plots.style import ReportFigure
from pipeline.quantity import figure as figure_text
from pipeline.quantity import frequency
from pipeline.units import DEGREE, MS

if TYPE_CHECKING:
    from solvers.thesis.loop_design import DqStudy


def report_figures(study: DqStudy) -> list[ReportFigure]:
    """Step, circle, Bode."""
    return [step(study), circle(study), bode(study)]


def step(study: DqStudy) -> ReportFigure:
    """Figure 2.21 computed, detuned too, and a saturated step for each anti-windup."""
    figure, (small, large) = style.panels(5.2, 2, 1, sharex=True)
    for one, colour in zip(study.steps, style.CYCLE, strict=False):
        time, seen = one.trace.time_s / MS, one.trace.measured / one.reference
        name = f"{one.name}, {one.detuning_hz:+g} Hz"
        small.plot(time, seen.real, color=colour, marker=".", ms=3, lw=0.9, label=name)
        small.plot(time, seen.imag, color=colour, ls=":", lw=0.9)
    small.axhline(0.95, color=style.GREY, lw=0.7, ls="--")
    small.axvline(study.data.within_s / MS, color=style.GREY, lw=0.7, ls="--")
    small.set_title("Small step: U_d (lines with dots) and U_q (dotted)")
    for one, look in zip(study.windups, style.LOOKS, strict=False):
        large.plot(one.trace.time_s / MS, np.abs(one.trace.measured) / one.reference, label=one.name, **look)
    share = study.windups[0].reference / (abs(study.identified.plant.gain) * study.data.drive_limit)
    title = f"Step to {figure_text(share)} of the amplitude at full drive: the drive meets its limit"
    large.set(title=title, xlabel="time since the reference changed (ms)")
    for axes in (small, large):
        axes.set(ylabel="U / reference", xlim=(0, 10))
        axes.legend(fontsize=7)
    reached = study.query.trace.reached_s() / MS
    alt = (
        f"Step response of the closed loop at the firmware's rates: 95 % after {figure_text(reached)} ms, overshoot "
        f"{figure_text(100 * study.query.trace.overshoot())} %; a saturated step with three treatments of the integral."
    )
    return ReportFigure("dq_step", "Step response of the closed loop", alt, figure, vector=True)


def circle(study: DqStudy) -> ReportFigure:
    """The sweep in the plane of U with its delay taken out, and the phase about the circle's centre."""
    figure, (plane, phase) = style.panels(3.4, 1, 2, width_ratios=[1.0, 1.3])
    identified, f = study.identified, study.sweep.frequencies_hz
    plant, fit = identified.plant, identified.circle
    straight = study.sweep.response * np.exp(2j * np.pi * f * identified.delay_s)
    if study.data.sensor == "displacement":
        straight = straight * 1j * f / plant.frequency_hz
    around = fit.centre + fit.radius * np.exp(1j * np.linspace(0, 2 * np.pi, 200))
    plane.plot(around.real, around.imag, color=style.GREY, lw=0.9, label="fit")
    plane.plot(straight.real, straight.imag, "o", ms=2.5, color=style.BLUE, label="sweep")
    plane.set(aspect="equal", xlabel="U_d / V", ylabel="U_q / V", title="Circle")
    angles = np.unwrap(np.angle(straight - fit.centre)) / DEGREE
    detuning = f - plant.frequency_hz
    fitted = -2.0 * np.arctan(2.0 * np.pi * detuning * plant.tau_s) / DEGREE
    phase.plot(detuning, angles, "o", ms=2.5, color=style.BLUE, label="sweep")
    phase.plot(detuning, fitted + np.median(angles - fitted), color=style.GREY, lw=0.9, label="-2 atan(τ δω)")
    title = f"{frequency(plant.frequency_hz)}, τ = {figure_text(plant.tau_s / MS)} ms"
    phase.set(xlabel="detuning (Hz)", ylabel="angle about the centre (degrees)", title=title)
    for axes in (plane, phase):
        axes.legend(fontsize=7)
    alt = (
        f"Response about resonance as a circle of diameter {figure_text(2 * fit.radius)}, and its phase, which gives "
        f"{frequency(plant.frequency_hz)} and a time constant of {figure_text(plant.tau_s / MS)} ms."
    )
    return ReportFigure("dq_circle", "Identification by circle and phase", alt, figure, vector=True)


def bode(study: DqStudy) -> ReportFigure:
    """Open and closed loop of the envelope, as designed in continuous time and as sampled."""
    from solvers.thesis.loop_design import envelope_frequencies

    figure, (size, phase) = style.panels(4.6, 2, 1, sharex=True)
    omega = envelope_frequencies(study.data)
    loop, closed = study.pi.closed_loop(study.identified.plant, omega)
    sampled = study.sampled_loop()
    up = sampled.omega_rad_s > omega[0]
    curves = (
        (omega, loop, "-", style.BLUE, "open, continuous design"),
        (omega, closed, "-", style.VERMILION, "closed, continuous design"),
        (sampled.omega_rad_s[up], sampled.open_loop[up], "--", style.BLUE, "open, sampled"),
        (sampled.omega_rad_s[up], sampled.closed_loop[up], "--", style.VERMILION, "closed, sampled"),
    )
    for w, values, dashes, colour, name in curves:
        size.semilogx(w / (2 * np.pi), 20 * np.log10(np.abs(values)), dashes, color=colour, label=name)
        phase.semilogx(w / (2 * np.pi), np.unwrap(np.angle(values)) / DEGREE, dashes, color=colour)
    size.axhline(0, color=style.GREY, lw=0.7, ls=":")
    size.set(ylabel="magnitude (dB)", ylim=(-40, 60), title="Loop of the amplitude at resonance")
    size.legend(fontsize=7)
    phase.set(ylabel="phase (degrees)", xlabel="frequency of the amplitude (Hz)")
    alt = (
        f"Bode diagram of the amplitude's loop: gain margin {figure_text(study.margins.gain)}, the carrier's phase may be "
        f"off by {figure_text(study.margins.phase_deg)} degrees."
    )
    return ReportFigure("dq_bode", "Bode diagram of the amplitude's loop", alt, figure, vector=True)
