"""Pictures of the circuit, of one pillar on a beam and of active pillars: the thesis' figures computed again."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from pipeline.plots import style as plots_style
from pipeline.plots.style import ReportFigure

if TYPE_CHECKING:
    from solvers.active_beam.study import ActiveBeamStudy, Case
    from solvers.resonators.mason_study import MasonStudy
    from solvers.resonators.pillar_row import PillarFilter
    from solvers.resonators.point_load import PointForce

KHZ, MM, UM = 1e-3, 1e3, 1e6
JOINTS = {0: "free end", 1: "at the filter", 2: "between the filters"}
LAYOUTS = {
    "point": "one force a side",
    "pair": "two equal forces a side",
    "couple": "couple a side, relative velocity",
    "opposed": "opposed forces, own velocities",
}


def mason(study: MasonStudy) -> ReportFigure:
    """Figures 1.24 to 1.27: joint velocities clamped, free, free with filters, and the filter's impedance."""
    figure = plots_style.new_figure(plots_style.WIDTH_IN, 5.4)
    panels = figure.subplots(2, 2, sharex=True)
    f, target = study.frequencies_hz * KHZ, study.data.target_hz * KHZ
    panels[0, 0].semilogy(f, np.abs(study.clamped[:, 1]), color=plots_style.BLUE)
    panels[0, 0].set_title("Three cells, clamped: joint 1")
    for axes, currents, title in (
        (panels[0, 1], study.bare, "Five cells, free, no filter"),
        (panels[1, 1], study.filtered, "Five cells, free, filters at joints 1 and 4"),
    ):
        for (joint, name), colour, style in zip(JOINTS.items(), plots_style.CYCLE, ("-", "--", "-."), strict=False):
            axes.semilogy(f, np.abs(currents[:, joint]), style, color=colour, lw=1.0, label=f"joint {joint}, {name}")
        axes.set_title(title)
    panels[1, 0].semilogy(f, np.abs(study.filter_impedance), color=plots_style.BLUE)
    panels[1, 0].set_title("Filter: L and C in parallel")
    for axes in panels.ravel():
        axes.axvline(target, color=plots_style.GREY, lw=0.8, ls=":")
        axes.set_ylabel("|v| per force (m/(N s))")
    panels[1, 0].set_ylabel("|Z| (N s/m)")
    for axes in panels[1]:
        axes.set_xlabel("frequency (kHz)")
    figure.legend(*panels[0, 1].get_legend_handles_labels(), loc="outside lower center", ncols=3, fontsize=7)
    alt = (
        f"Joint velocities over frequency of three clamped cells and of five free ones without and with filters, and the "
        f"filter's impedance. With filters a mode at {target:.2f} kHz stays between them: inner joints lie "
        f"{study.confinement_filtered_db:.0f} dB above outer ones, against {study.confinement_bare_db:.0f} dB without."
    )
    return ReportFigure("mason", "A band-reject filter confines a mode", alt, figure, vector=True)


def pillar(pillar_row: PillarFilter, point: PointForce, cell: dict[str, Any] | None) -> list[ReportFigure]:
    """Figure 3.2, then the design's rows over frequency."""
    return [_point_force(point), _rows(pillar_row, cell)]


def _point_force(point: PointForce) -> ReportFigure:
    figure = plots_style.new_figure(plots_style.WIDTH_IN, 3.0)
    axes = figure.subplots()
    styles = {"spring": "-", "pinned": "--", "printed damper": "-.", "printed force": ":"}
    kinds = {
        "spring": "spring 4EIβ³",
        "pinned": "pinned",
        "printed damper": "damper of (3.21)",
        "printed force": "force of (3.19)",
    }
    labels = {name: f"{verdict}: |t|² = {point.of(name).transmitted:.2g}" for name, verdict in kinds.items()}
    for (name, style), colour in zip(styles.items(), plots_style.CYCLE, strict=False):
        axes.plot(point.x_over_wavelength, np.abs(point.of(name).deflection), style, color=colour, label=labels[name])
    axes.axvline(0.0, color=plots_style.GREY, lw=0.8, ls=":")
    axes.set_xlabel("x / wavelength")
    axes.set_ylabel("|w| / incident")
    axes.set_title("A unit wave from the left at one point")
    axes.legend(fontsize=7, loc="upper left", ncols=2)
    axes.set_ylim(0, 3.4)
    alt = (
        f"Amplitude along a beam met by one point: a spring 4 EI beta^3 passes {point.of('spring').transmitted:.0%} of the "
        f"power, a pinned point {point.of('pinned').transmitted:.0%}, the damper {point.of('printed damper').transmitted:.0%}."
    )
    return ReportFigure("point_force", "One point on an endless beam", alt, figure, vector=True)


def _rows(pillar_row: PillarFilter, cell: dict[str, Any] | None) -> ReportFigure:
    figure = plots_style.new_figure(plots_style.WIDTH_IN, 4.8)
    power, decay = figure.subplots(2, 1, sharex=True)
    f = pillar_row.frequencies_hz * KHZ
    for number, (share, colour) in enumerate(zip(pillar_row.transmitted, plots_style.CYCLE, strict=False), start=1):
        power.semilogy(f, np.maximum(share, 1e-6), color=colour, label=f"{number} row{'s' if number > 1 else ''}")
    power.set_ylabel("transmitted power / incident")
    power.set_title("Rows of pillars on a strip, normal incidence")
    power.set_ylim(1e-6, 2.0)
    marks = {
        "pillar clamped": pillar_row.clamped_hz,
        "its moment alone stops": pillar_row.stopped_hz,
        "oscillator stops": pillar_row.oscillator_stopped_hz,
    }
    for (name, tone), style in zip(marks.items(), ("--", "-", ":"), strict=True):
        for axes in (power, decay):
            axes.axvline(tone * KHZ, color=plots_style.GREY, lw=0.9, ls=style, label=name if axes is power else None)
    power.legend(fontsize=7, ncols=2)
    decay.plot(f, pillar_row.decay_db, color=plots_style.BLUE, label="endless row on a strip")
    if cell:
        levels = np.array([np.nan if value is None else value for value in cell["db_per_row"]])
        decay.plot(
            np.array(cell["frequencies_hz"]) * KHZ,
            levels,
            "o",
            ms=3,
            color=plots_style.VERMILION,
            label="computed plate cell",
        )
    decay.set_ylabel("decay (dB per row)")
    decay.set_xlabel("frequency (kHz)")
    decay.legend(fontsize=7)
    alt = (
        f"Power through rows of pillars over frequency: one pillar's moment stops it at "
        f"{pillar_row.stopped_hz * KHZ:.2f} kHz, its "
        f"clamped resonance is at {pillar_row.clamped_hz * KHZ:.2f} kHz; an oscillator of its mass and resonance "
        "would stop it at "
        f"{pillar_row.oscillator_stopped_hz * KHZ:.2f} kHz."
    )
    return ReportFigure("pillar_rows", "Rows of pillars as a filter", alt, figure, vector=True)


def beam(study: ActiveBeamStudy) -> list[ReportFigure]:
    """Figures 3.5 to 3.8, then what gain and place do."""
    return [_shapes(study), _sensitivity(study)]


def _shapes(study: ActiveBeamStudy) -> ReportFigure:
    data = study.data
    first, last, weak, strong = data.frequencies_hz[0], data.frequencies_hz[-1], data.gains_n_m[0], data.gains_n_m[-1]
    rows = (
        ("3.5 Equal forces", [study.case(name, first, strong) for name in ("point", "pair")]),
        ("3.6 Opposed forces", [study.case(name, first, strong) for name in ("couple", "opposed")]),
        (
            "3.7 Two gains, one force a side",
            [study.case("point", first, gain) for gain in dict.fromkeys((strong, weak))],
        ),
        ("3.8 Higher frequency", [study.case(name, last, strong) for name in ("point", "pair", "couple")]),
    )
    figure = plots_style.new_figure(plots_style.WIDTH_IN, 5.6)
    for axes, (title, cases) in zip(figure.subplots(2, 2).ravel(), rows, strict=True):
        opened = study.open_m[data.frequencies_hz.index(cases[0].frequency_hz)]
        axes.plot(study.x_m * MM, opened * UM, color=plots_style.GREY, lw=0.9, ls=":", label="open")
        for case, colour, style in zip(cases, plots_style.CYCLE, ("-", "--", "-."), strict=False):
            moved = data.force_n * np.abs(case.steady.deflection) * UM
            axes.plot(study.x_m * MM, moved, style, color=colour, label=_label(study, title, case))
        for place in (study.left_m, data.length_m - study.left_m):
            axes.axvline(place * MM, color=plots_style.ORANGE, lw=0.8)
        axes.set_title(f"{title}, {cases[0].frequency_hz * KHZ:g} kHz")
        axes.set_xlabel("x (mm)")
        axes.set_ylabel("|w| (µm)")
        axes.set_ylim(0, 1.5 * max(line.get_ydata().max() for line in axes.lines[: len(cases) + 1]))
        axes.legend(fontsize=6.5, loc="upper center")
    verdict = study.case("point", first, strong)
    alt = (
        f"Amplitude along a free-free strip under {data.force_n:g} N in its middle without and with velocity feedback at the "
        f"marked places; rms inside over beyond is {verdict.after.ratio:.2f} with one force a side, "
        f"{verdict.before.ratio:.2f} open."
    )
    return ReportFigure("active_beam", "Active pillars on a free-free strip", alt, figure, vector=True)


def _label(study: ActiveBeamStudy, title: str, case: Case) -> str:
    return f"K' = {case.gain_n_m:.0e} N/m" if "gains" in title else _named(study, case.layout)


def _named(study: ActiveBeamStudy, layout: str) -> str:
    loop = next(one for one in study.stability if one.layout == layout)
    return LAYOUTS[layout] + (" (unstable)" if max(loop.growth_per_s) > 0.0 else "")


def _sensitivity(study: ActiveBeamStudy) -> ReportFigure:
    figure = plots_style.new_figure(plots_style.WIDTH_IN, 3.4)
    gain, place = figure.subplots(1, 2)
    for (name, ratios), colour, style in zip(
        study.gain_sweep.items(), plots_style.CYCLE, ("-", "--", "-.", ":"), strict=False
    ):
        gain.loglog(study.sweep_gains_n_m, ratios, style, color=colour, label=_named(study, name))
    stiffness = study.data.beam.point_stiffness_n_m(2.0 * np.pi * study.data.frequencies_hz[0])
    gain.axvline(stiffness, color=plots_style.GREY, lw=0.8, ls=":", label="4EIβ³")
    gain.set_xlabel("gain K' (N/m)")
    gain.set_ylabel("rms inside / beyond")
    gain.set_title(f"Gain, {study.data.frequencies_hz[0] * KHZ:g} kHz")
    gain.set_ylim(top=4.0 * gain.get_ylim()[1])
    gain.legend(fontsize=6.5, loc="upper left")
    for i, (name, ratios) in enumerate(study.place_sweep.items()):
        colour = plots_style.CYCLE[i // len(study.data.frequencies_hz) % len(plots_style.CYCLE)]
        style = ("-", "--", "-.", ":")[i % len(study.data.frequencies_hz) % 4]
        place.semilogy(study.sweep_places_m * MM, ratios, style, color=colour, lw=1.0, label=name)
    place.axvline(study.left_m * MM, color=plots_style.ORANGE, lw=0.8)
    place.set_xlabel("middle of the loops from an end (mm)")
    place.set_title(f"Place, K' = {study.data.gains_n_m[-1]:.0e} N/m")
    place.set_ylim(top=8.0 * place.get_ylim()[1])
    place.legend(fontsize=6.0, loc="upper left", ncols=2)
    best = {name: float(study.sweep_places_m[values.argmax()]) * MM for name, values in study.place_sweep.items()}
    verdict = ", ".join(f"{name} {at:.0f} mm" for name, at in best.items())
    alt = f"Confinement by active pillars over gain and over their place; best places: {verdict}."
    return ReportFigure("active_beam_sensitivity", "What gain and place do", alt, figure, vector=True)
