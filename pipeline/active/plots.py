"""Pictures of the `active` models: circuit, one pillar, active pillars, control loop of one mode, and shaping."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from pipeline.plots import style
from pipeline.plots.style import ReportFigure
from pipeline.quantity import CM, DEGREE, KHZ, MM, MS, UM, frequency, level, percentage
from pipeline.quantity import figure as figure_text
from solvers.shaping.voltages import REGIONS, drive_voltages, region_target

if TYPE_CHECKING:
    from solvers.thesis.active_beam import ActiveBeamStudy, Case
    from solvers.thesis.circuit import MasonStudy
    from solvers.thesis.loop_design import DqStudy
    from solvers.thesis.scattering import PillarFilter, PointForce
    from solvers.thesis.shaping_study import ShapingStudy

SMALL = 8.5  # points: letters of legends between many lines
JOINTS = {0: "free end", 1: "at the filter", 2: "between the filters"}
POINTS = {
    "spring": "spring 4EIβ³",
    "pinned": "pinned",
    "printed damper": "damper of (3.21)",
    "printed force": "force of (3.19)",
}
LAYOUTS = {
    "point": "one force per side",
    "pair": "two equal forces per side",
    "couple": "one couple per side, relative velocity",
    "opposed": "opposed forces, own velocities",
}


def mason(study: MasonStudy) -> ReportFigure:
    """Figures 1.24 to 1.27: joint velocities clamped, free, free with filters, and the filter's impedance."""
    figure, panels = style.panels(5.4, 2, 2, sharex=True)
    (clamped, bare), (impedance, filtered) = panels
    f, target = study.frequencies_hz / KHZ, study.data.target_hz / KHZ
    clamped.semilogy(f, np.abs(study.clamped[:, 1]), color=style.BLUE)
    for axes, currents in ((bare, study.bare), (filtered, study.filtered)):
        curves = {f"joint {joint}, {name}": np.abs(currents[:, joint]) for joint, name in JOINTS.items()}
        style.draw_lines(axes.semilogy, f, curves, lw=1.0)
    impedance.semilogy(f, np.abs(study.filter_impedance), color=style.BLUE)
    for axes in panels.ravel():
        style.mark(axes, target)
        axes.set_ylabel("|v| per force (m/(N s))")
    clamped.set(title="Three cells, clamped: joint 1")
    bare.set(title="Five cells, free, no filter")
    filtered.set(title="Five cells, free, filters at joints 1 and 4", xlabel="frequency (kHz)")
    impedance.set(title="Filter: L and C in parallel", ylabel="|Z| (N s/m)", xlabel="frequency (kHz)")
    style.legend_below(figure, *bare.get_legend_handles_labels())
    alt = (
        f"Joint velocities over frequency of three clamped cells and of five free ones without and with filters, and the "
        f"filter's impedance. Filters confine a mode at {frequency(study.data.target_hz)} between them: inner joints lie "
        f"{level(study.confinement_db['filtered'])} above outer ones; without filters, {level(study.confinement_db['bare'])}."
    )
    return ReportFigure("mason", "A band-reject filter confines a mode", alt, figure, vector=True)


def pillar(pillar_row: PillarFilter, point: PointForce, cell: dict[str, Any] | None) -> list[ReportFigure]:
    """Figure 3.2, then the design's rows over frequency."""
    return [_point_force(point), _rows(pillar_row, cell)]


def _point_force(point: PointForce) -> ReportFigure:
    figure, axes = style.panels(3.0)
    transmitted = {name: point.of(name).transmitted for name in POINTS}
    labels = {name: f"{text}: |t|² = {figure_text(transmitted[name])}" for name, text in POINTS.items()}
    curves = {labels[name]: np.abs(point.of(name).deflection) for name in POINTS}
    style.draw_lines(axes.plot, point.x_over_wavelength, curves)
    style.mark(axes, 0.0)
    title = "Unit wave from the left at a point scatterer"
    axes.set(xlabel="x / wavelength", ylabel="|w| / incident", title=title, ylim=(0, 3.4))
    axes.legend(fontsize=SMALL, loc="upper left", ncols=2)
    alt = (
        f"Amplitude along a beam with a point scatterer: a spring 4 EI beta^3 transmits {percentage(transmitted['spring'])} of "
        f"the power, a pinned point {percentage(transmitted['pinned'])}, the damper "
        f"{percentage(transmitted['printed damper'])}."
    )
    return ReportFigure("point_force", "Point scatterer on an infinite beam", alt, figure, vector=True)


def _rows(row: PillarFilter, cell: dict[str, Any] | None) -> ReportFigure:
    figure, (power, decay) = style.panels(4.8, 2, 1, sharex=True)
    f = row.frequencies_hz / KHZ
    for number, (share, colour) in enumerate(zip(row.transmitted, style.CYCLE, strict=False), start=1):
        power.semilogy(f, np.maximum(share, 1e-6), color=colour, label=f"{number} row{'s' if number > 1 else ''}")
    title = "Rows of pillars on a strip, normal incidence"
    power.set(ylabel="transmitted power / incident", title=title, ylim=(1e-6, 2.0))
    clamped, stopped, oscillator = (tone / KHZ for tone in (row.clamped_hz, row.stopped_hz, row.oscillator_stopped_hz))
    marks = (
        (clamped, "--", "clamped pillar"),
        (stopped, "-", "stopped by the pillar's moment"),
        (oscillator, ":", "stopped by an oscillator"),
    )
    for tone, dashes, name in marks:
        power.axvline(tone, color=style.GREY, lw=0.9, ls=dashes, label=name)
        decay.axvline(tone, color=style.GREY, lw=0.9, ls=dashes)
    power.legend(fontsize=SMALL, ncols=2)
    decay.plot(f, row.decay_db, color=style.BLUE, label="infinite array on a strip")
    if cell:
        levels, tones = np.array(cell["db_per_row"], dtype=float), np.array(cell["frequencies_hz"]) / KHZ
        decay.plot(tones, levels, "o", ms=3, color=style.VERMILION, label="computed plate cell")
    decay.set(ylabel="decay (dB per row)", xlabel="frequency (kHz)")
    decay.legend(fontsize=SMALL)
    alt = (
        f"Power through rows of pillars over frequency: one pillar's moment stops it at {frequency(row.stopped_hz)}, its "
        f"clamped resonance is at {frequency(row.clamped_hz)}; an oscillator of its mass and resonance would stop it at "
        f"{frequency(row.oscillator_stopped_hz)}."
    )
    return ReportFigure("pillar_rows", "Rows of pillars as a filter", alt, figure, vector=True)


def beam(study: ActiveBeamStudy) -> list[ReportFigure]:
    """Figures 3.5 to 3.8, then the influence of gain and place."""
    return [_shapes(study), _sensitivity(study)]


def _shapes(study: ActiveBeamStudy) -> ReportFigure:
    data = study.data
    first, last, weak, strong = data.frequencies_hz[0], data.frequencies_hz[-1], data.gains_n_m[0], data.gains_n_m[-1]
    gains = [study.case("point", first, gain) for gain in dict.fromkeys((strong, weak))]
    shown = {
        "3.5 Equal forces": _by_layout(study, ("point", "pair"), first),
        "3.6 Opposed forces": _by_layout(study, ("couple", "opposed"), first),
        "3.7 Two gains, one force per side": {f"K' = {case.gain_n_m:g} N/m": case for case in gains},
        "3.8 Higher frequency": _by_layout(study, ("point", "pair", "couple"), last),
    }
    figure, panels = style.panels(5.6, 2, 2)
    for axes, (title, cases) in zip(panels.ravel(), shown.items(), strict=True):
        tone = next(iter(cases.values())).frequency_hz
        opened = study.open_m[data.frequencies_hz.index(tone)] / UM
        moved = {name: data.force_n * np.abs(case.steady.deflection) / UM for name, case in cases.items()}
        axes.plot(study.x_m / MM, opened, color=style.GREY, lw=0.9, ls=":", label="open")
        style.draw_lines(axes.plot, study.x_m / MM, moved)
        for place in (study.left_m, data.length_m - study.left_m):
            axes.axvline(place / MM, color=style.ORANGE, lw=0.8)
        top = 1.5 * max(line.max() for line in (opened, *moved.values()))
        axes.set(title=f"{title}, {tone / KHZ:g} kHz", xlabel="x (mm)", ylabel="|w| (µm)", ylim=(0, top))
        axes.legend(fontsize=SMALL, loc="upper center")
    verdict = study.case("point", first, strong)
    alt = (
        f"Amplitude along a free-free strip under {data.force_n:g} N in its middle without and with velocity feedback at the "
        f"marked places; rms inside over outside is {figure_text(verdict.after.ratio)} with one force per side, "
        f"{figure_text(verdict.before.ratio)} with open loops."
    )
    return ReportFigure("active_beam", "Active pillars on a free-free strip", alt, figure, vector=True)


def _by_layout(study: ActiveBeamStudy, layouts: tuple[str, ...], tone_hz: float) -> dict[str, Case]:
    return {_named(study, name): study.case(name, tone_hz, study.data.gains_n_m[-1]) for name in layouts}


def _named(study: ActiveBeamStudy, layout: str) -> str:
    loop = next(one for one in study.stability if one.layout == layout)
    return LAYOUTS[layout] + (" (unstable)" if max(loop.growth_per_s) > 0.0 else "")


def _sensitivity(study: ActiveBeamStudy) -> ReportFigure:
    data, places_mm = study.data, study.sweep_places_m / MM
    figure, (gain, place) = style.panels(3.4, 1, 2)
    by_layout = {_named(study, name): ratios for name, ratios in study.gain_sweep.items()}
    style.draw_lines(gain.loglog, study.sweep_gains_n_m, by_layout)
    stiffness = data.beam.point_stiffness_n_m(2.0 * np.pi * data.frequencies_hz[0])
    gain.axvline(stiffness, color=style.GREY, lw=0.8, ls=":", label="4EIβ³")
    gain.set(xlabel="gain K' (N/m)", ylabel="rms inside / outside", title=f"Gain, {data.frequencies_hz[0] / KHZ:g} kHz")
    gain.set_ylim(top=4.0 * gain.get_ylim()[1])
    gain.legend(fontsize=SMALL, loc="upper left")
    for i, (name, ratios) in enumerate(study.place_sweep.items()):
        kind, tone = divmod(i, len(data.frequencies_hz))
        look = {"color": style.CYCLE[kind % len(style.CYCLE)], "ls": style.DASHES[tone % len(style.DASHES)]}
        place.semilogy(places_mm, ratios, lw=1.0, label=name, **look)
    place.axvline(study.left_m / MM, color=style.ORANGE, lw=0.8)
    title = f"Place, K' = {data.gains_n_m[-1]:g} N/m"
    place.set(xlabel="middle of the loops from an end (mm)", title=title)
    place.set_ylim(top=8.0 * place.get_ylim()[1])
    place.legend(fontsize=SMALL, loc="upper left", ncols=2)
    best = ", ".join(
        f"{name} {figure_text(places_mm[values.argmax()])} mm" for name, values in study.place_sweep.items()
    )
    alt = f"Confinement by active pillars over gain and over their place; best places: {best}."
    return ReportFigure("active_beam_sensitivity", "Influence of gain and place", alt, figure, vector=True)


def loop_figures(study: DqStudy) -> list[ReportFigure]:
    """Step, circle, Bode."""
    return [step(study), circle(study), bode(study)]


def step(study: DqStudy) -> ReportFigure:
    """Figure 2.21 computed, also detuned, and a saturated step for each anti-windup."""
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
    title = f"Saturated step, to {figure_text(share)} of the full amplitude"
    large.set(title=title, xlabel="time after the change of the reference (ms)")
    for axes in (small, large):
        axes.set(ylabel="U / reference", xlim=(0, 10))
        axes.legend(fontsize=SMALL)
    reached = study.query.trace.reached_s() / MS
    alt = (
        f"Step response of the closed loop at the firmware's rates: 95 % after {figure_text(reached)} ms, overshoot "
        f"{figure_text(100 * study.query.trace.overshoot())} %; a saturated step with three treatments of the integral."
    )
    return ReportFigure("dq_step", "Step response of the closed loop", alt, figure, vector=True)


def circle(study: DqStudy) -> ReportFigure:
    """Sweep in the plane of U without its delay, and the phase about the centre of the circle."""
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
        axes.legend(fontsize=SMALL)
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
    size.set(ylabel="magnitude (dB)", ylim=(-40, 60), title="Amplitude loop at resonance")
    size.legend(fontsize=SMALL)
    phase.set(ylabel="phase (degrees)", xlabel="frequency of the amplitude (Hz)")
    alt = (
        f"Bode diagram of the amplitude loop: gain margin {figure_text(study.margins.gain)}, tolerated phase error of the "
        f"carrier {figure_text(study.margins.phase_deg)} degrees."
    )
    return ReportFigure("dq_bode", "Bode diagram of the amplitude loop", alt, figure, vector=True)


def shaping_figures(study: ShapingStudy) -> list[ReportFigure]:
    """Conditioning, patterns, travelling waves."""
    return [conditioning(study), patterns(study), travelling(study)]


def conditioning(study: ShapingStudy) -> ReportFigure:
    """Coupling index and condition number of T over frequency for every beam and signal."""
    figure, (index, number) = style.panels(4.8, 2, 1, sharex=True)
    for i, ((name, signal), scan) in enumerate(study.scans.items()):
        dashes, colour = divmod(i, len(style.CYCLE))
        look: dict[str, Any] = {"ls": style.DASHES[dashes], "color": style.CYCLE[colour], "lw": 0.9}
        index.plot(scan.frequencies_hz / KHZ, scan.coupling, label=f"{name}, {signal}", **look)
        number.semilogy(scan.frequencies_hz / KHZ, scan.condition, **look)
    for axes in (index, number):
        style.mark(axes, *(tone / KHZ for tone in study.data.frequencies_hz))
    index.set(ylabel="coupling index", ylim=(0, 1), title="0: rows of T orthogonal, 1: all parallel")
    number.set(ylabel="condition number of T", xlabel="frequency (kHz)")
    style.legend_below(figure, *index.get_legend_handles_labels())
    alt = "Coupling index and condition number of the matrix from actuators to sensors over frequency, beam by beam."
    return ReportFigure("shaping_conditioning", "Conditioning of T", alt, figure, vector=True)


def patterns(study: ShapingStudy) -> ReportFigure:
    """Amplitude along each beam with two neighbouring sensors at one and the others at zero, left, middle, right."""
    signals = [(beam, beam.signals[0]) for beam in study.beams]
    figure, panels = style.panels(1.7 * len(signals) + 0.6, len(signals), len(REGIONS), squeeze=False, sharey="row")
    frequency = study.data.frequencies_hz[-1]
    for row, (beam, signal) in zip(panels, signals, strict=True):
        field, matrix = beam.field(frequency), beam.matrix(frequency, signal)
        for axes, region in zip(row, REGIONS, strict=True):
            moved = {
                name: np.abs(
                    field @ drive_voltages(matrix, region_target(region, len(beam.places_m), alternate)).voltages
                )
                for name, alternate in (("in phase", False), ("alternating", True))
            }
            shares = {name: values / values.max() for name, values in moved.items()}
            style.draw_lines(axes.plot, beam.line_m / MM, shares, lw=1.0)
            sensors = beam.places_m / MM
            axes.plot(sensors, np.zeros_like(sensors), "^", color=style.GREY, ms=3, clip_on=False)
            axes.set_ylim(0, 1.05)
        row[0].set_ylabel("|w| / largest")
        row[0].set_title(f"{beam.name}, {signal}", fontsize=SMALL)
    for axes, region in zip(panels[-1], REGIONS, strict=True):
        axes.set_xlabel(f"x (mm), confined {region}")
    panels[0, -1].legend(fontsize=SMALL)
    alt = f"Amplitude along each beam at {frequency / KHZ:g} kHz confined to the left, middle or right third of the sensors."
    return ReportFigure("shaping_patterns", "Confinement left, middle and right", alt, figure, vector=True)


def travelling(study: ShapingStudy) -> ReportFigure:
    """Travelling-wave ratio over the requested wavelength at the sensors."""
    tones = study.data.frequencies_hz
    figure, grid = style.panels(3.6, 1, len(tones), squeeze=False, sharey=True)
    panels = grid[0]
    for axes, tone in zip(panels, tones, strict=True):
        waves = [wave for wave in study.travelling if wave.frequency_hz == tone]
        for i, wave in enumerate(waves):
            look: dict[str, Any] = {
                "color": style.CYCLE[i % len(style.CYCLE)],
                "ls": style.DASHES[i % len(style.DASHES)],
            }
            axes.plot(wave.wavelengths_m / CM, wave.twr, lw=1.0, label=f"{wave.beam}, {wave.signal}", **look)
        style.mark(axes, waves[0].free_wavelength_m / CM)
        axes.set(title=f"{tone / KHZ:g} kHz (dotted: free wave)", xlabel="requested wavelength (cm)")
    panels[0].set_ylabel("TWR = 1 - SWR")
    style.legend_below(figure, *panels[0].get_legend_handles_labels())
    alt = "Travelling-wave ratio over the requested wavelength at the sensors, beam by beam and frequency by frequency."
    return ReportFigure("shaping_travelling", "Travelling waves", alt, figure, vector=True)
