"""Pictures of the circuit, of one pillar on a beam and of active pillars: the thesis' figures computed again."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from pipeline.plots import style
from pipeline.plots.style import ReportFigure
from pipeline.quantity import figure as figure_text
from pipeline.quantity import frequency, level, percentage
from pipeline.units import KHZ, MM, UM

if TYPE_CHECKING:
    from solvers.thesis.active_study import ActiveBeamStudy, Case
    from solvers.thesis.circuit import MasonStudy
    from solvers.thesis.pillar_row import PillarFilter
    from solvers.thesis.scattering import PointForce

JOINTS = {0: "free end", 1: "at the filter", 2: "between the filters"}
POINTS = {
    "spring": "spring 4EIβ³",
    "pinned": "pinned",
    "printed damper": "damper of (3.21)",
    "printed force": "force of (3.19)",
}
LAYOUTS = {
    "point": "one force a side",
    "pair": "two equal forces a side",
    "couple": "couple a side, relative velocity",
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
        f"filter's impedance. With filters a mode at {frequency(study.data.target_hz)} stays between them: inner joints lie "
        f"{level(study.confinement_filtered_db)} above outer ones, against {level(study.confinement_bare_db)} without."
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
    title = "A unit wave from the left at one point"
    axes.set(xlabel="x / wavelength", ylabel="|w| / incident", title=title, ylim=(0, 3.4))
    axes.legend(fontsize=7, loc="upper left", ncols=2)
    alt = (
        f"Amplitude along a beam met by one point: a spring 4 EI beta^3 passes {percentage(transmitted['spring'])} of the "
        f"power, a pinned point {percentage(transmitted['pinned'])}, the damper {percentage(transmitted['printed damper'])}."
    )
    return ReportFigure("point_force", "One point on an endless beam", alt, figure, vector=True)


def _rows(row: PillarFilter, cell: dict[str, Any] | None) -> ReportFigure:
    figure, (power, decay) = style.panels(4.8, 2, 1, sharex=True)
    f = row.frequencies_hz / KHZ
    for number, (share, colour) in enumerate(zip(row.transmitted, style.CYCLE, strict=False), start=1):
        power.semilogy(f, np.maximum(share, 1e-6), color=colour, label=f"{number} row{'s' if number > 1 else ''}")
    title = "Rows of pillars on a strip, normal incidence"
    power.set(ylabel="transmitted power / incident", title=title, ylim=(1e-6, 2.0))
    clamped, stopped, oscillator = (tone / KHZ for tone in (row.clamped_hz, row.stopped_hz, row.oscillator_stopped_hz))
    marks = (
        (clamped, "--", "pillar clamped"),
        (stopped, "-", "its moment alone stops"),
        (oscillator, ":", "oscillator stops"),
    )
    for tone, dashes, name in marks:
        power.axvline(tone, color=style.GREY, lw=0.9, ls=dashes, label=name)
        decay.axvline(tone, color=style.GREY, lw=0.9, ls=dashes)
    power.legend(fontsize=7, ncols=2)
    decay.plot(f, row.decay_db, color=style.BLUE, label="endless row on a strip")
    if cell:
        levels, tones = np.array(cell["db_per_row"], dtype=float), np.array(cell["frequencies_hz"]) / KHZ
        decay.plot(tones, levels, "o", ms=3, color=style.VERMILION, label="computed plate cell")
    decay.set(ylabel="decay (dB per row)", xlabel="frequency (kHz)")
    decay.legend(fontsize=7)
    alt = (
        f"Power through rows of pillars over frequency: one pillar's moment stops it at {frequency(row.stopped_hz)}, its "
        f"clamped resonance is at {frequency(row.clamped_hz)}; an oscillator of its mass and resonance would stop it at "
        f"{frequency(row.oscillator_stopped_hz)}."
    )
    return ReportFigure("pillar_rows", "Rows of pillars as a filter", alt, figure, vector=True)


def beam(study: ActiveBeamStudy) -> list[ReportFigure]:
    """Figures 3.5 to 3.8, then what gain and place do."""
    return [_shapes(study), _sensitivity(study)]


def _shapes(study: ActiveBeamStudy) -> ReportFigure:
    data = study.data
    first, last, weak, strong = data.frequencies_hz[0], data.frequencies_hz[-1], data.gains_n_m[0], data.gains_n_m[-1]
    gains = [study.case("point", first, gain) for gain in dict.fromkeys((strong, weak))]
    shown = {
        "3.5 Equal forces": _by_layout(study, ("point", "pair"), first),
        "3.6 Opposed forces": _by_layout(study, ("couple", "opposed"), first),
        "3.7 Two gains, one force a side": {f"K' = {case.gain_n_m:g} N/m": case for case in gains},
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
        axes.legend(fontsize=6.5, loc="upper center")
    verdict = study.case("point", first, strong)
    alt = (
        f"Amplitude along a free-free strip under {data.force_n:g} N in its middle without and with velocity feedback at the "
        f"marked places; rms inside over beyond is {figure_text(verdict.after.ratio)} with one force a side, "
        f"{figure_text(verdict.before.ratio)} open."
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
    gain.set(xlabel="gain K' (N/m)", ylabel="rms inside / beyond", title=f"Gain, {data.frequencies_hz[0] / KHZ:g} kHz")
    gain.set_ylim(top=4.0 * gain.get_ylim()[1])
    gain.legend(fontsize=6.5, loc="upper left")
    for i, (name, ratios) in enumerate(study.place_sweep.items()):
        kind, tone = divmod(i, len(data.frequencies_hz))
        look = {"color": style.CYCLE[kind % len(style.CYCLE)], "ls": style.DASHES[tone % len(style.DASHES)]}
        place.semilogy(places_mm, ratios, lw=1.0, label=name, **look)
    place.axvline(study.left_m / MM, color=style.ORANGE, lw=0.8)
    title = f"Place, K' = {data.gains_n_m[-1]:g} N/m"
    place.set(xlabel="middle of the loops from an end (mm)", title=title)
    place.set_ylim(top=8.0 * place.get_ylim()[1])
    place.legend(fontsize=6.0, loc="upper left", ncols=2)
    best = ", ".join(
        f"{name} {figure_text(places_mm[values.argmax()])} mm" for name, values in study.place_sweep.items()
    )
    alt = f"Confinement by active pillars over gain and over their place; best places: {best}."
    return ReportFigure("active_beam_sensitivity", "What gain and place do", alt, figure, vector=True)
