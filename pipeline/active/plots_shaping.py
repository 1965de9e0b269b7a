"""Pictures of shaping: how well T can be inverted, patterns held left, middle and right, travelling waves."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from pipeline.plots import style as plots_style
from pipeline.plots.style import ReportFigure
from solvers.shaping.acoustic_contrast import REGIONS, region_target
from solvers.shaping.inversion import drive_voltages

if TYPE_CHECKING:
    from solvers.shaping_study.study import ShapingStudy

KHZ, MM, CM = 1e-3, 1e3, 1e2


def report_figures(study: ShapingStudy) -> list[ReportFigure]:
    """Conditioning, patterns, travelling waves."""
    return [conditioning(study), patterns(study), travelling(study)]


def conditioning(study: ShapingStudy) -> ReportFigure:
    """Coupling index and condition number of T over frequency for every beam and signal."""
    figure = plots_style.new_figure(plots_style.WIDTH_IN, 4.8)
    index, number = figure.subplots(2, 1, sharex=True)
    for i, ((name, signal), scan) in enumerate(study.scans.items()):
        style, colour = (
            ("-", "--", "-.", ":")[i // len(plots_style.CYCLE)],
            plots_style.CYCLE[i % len(plots_style.CYCLE)],
        )
        f = scan.frequencies_hz * KHZ
        index.plot(f, scan.coupling, style, color=colour, lw=0.9, label=f"{name}, {signal}")
        number.semilogy(f, scan.condition, style, color=colour, lw=0.9)
    for axes in (index, number):
        for tone in study.data.frequencies_hz:
            axes.axvline(tone * KHZ, color=plots_style.GREY, lw=0.8, ls=":")
    index.set_ylabel("coupling index")
    index.set_ylim(0, 1)
    index.set_title("0: rows of T orthogonal, 1: all parallel")
    number.set_ylabel("condition number of T")
    number.set_xlabel("frequency (kHz)")
    figure.legend(*index.get_legend_handles_labels(), loc="outside lower center", ncols=3, fontsize=7)
    alt = "Coupling index and condition number of the matrix from actuators to sensors over frequency, beam by beam."
    return ReportFigure("shaping_conditioning", "How well T can be inverted", alt, figure, vector=True)


def patterns(study: ShapingStudy) -> ReportFigure:
    """Amplitude along each beam with two neighbouring sensors held at one and the others at zero, left, middle, right."""
    signals = [(beam, beam.signals[0]) for beam in study.beams]
    figure = plots_style.new_figure(plots_style.WIDTH_IN, 1.7 * len(signals) + 0.6)
    panels = figure.subplots(len(signals), len(REGIONS), squeeze=False, sharey="row")
    frequency = study.data.frequencies_hz[-1]
    for row, (beam, signal) in zip(panels, signals, strict=True):
        field, matrix = beam.field(frequency), beam.matrix(frequency, signal)
        for axes, region in zip(row, REGIONS, strict=True):
            for alternate, colour, name in (
                (False, plots_style.BLUE, "in phase"),
                (True, plots_style.VERMILION, "alternating"),
            ):
                drive = drive_voltages(matrix, region_target(region, len(beam.places_m), alternate))
                moved = np.abs(field @ drive.voltages)
                style = "--" if alternate else "-"
                axes.plot(beam.line_m * MM, moved / moved.max(), style, color=colour, lw=1.0, label=name)
            axes.plot(
                beam.places_m * MM, np.zeros(len(beam.places_m)), "^", color=plots_style.GREY, ms=3, clip_on=False
            )
            axes.set_ylim(0, 1.05)
        row[0].set_ylabel("|w| / largest")
        row[0].set_title(f"{beam.name}, {signal}", fontsize=8)
    for axes, region in zip(panels[-1], REGIONS, strict=True):
        axes.set_xlabel(f"x (mm), held {region}")
    panels[0, -1].legend(fontsize=6.5)
    alt = f"Amplitude along each beam at {frequency * KHZ:g} kHz with the left, middle or right third of the sensors held."
    return ReportFigure("shaping_patterns", "Held left, in the middle, right", alt, figure, vector=True)


def travelling(study: ShapingStudy) -> ReportFigure:
    """Travelling-wave ratio over the wavelength asked for at the sensors."""
    tones = study.data.frequencies_hz
    figure = plots_style.new_figure(plots_style.WIDTH_IN, 3.6)
    panels = figure.subplots(1, len(tones), squeeze=False, sharey=True)[0]
    for axes, tone in zip(panels, tones, strict=True):
        waves = [wave for wave in study.travelling if wave.frequency_hz == tone]
        for i, wave in enumerate(waves):
            colour, style = plots_style.CYCLE[i % len(plots_style.CYCLE)], ("-", "--", "-.", ":")[i % 4]
            name = f"{wave.beam}, {wave.signal}"
            axes.plot(wave.wavelengths_m * CM, wave.twr, style, color=colour, lw=1.0, label=name)
        axes.axvline(waves[0].free_wavelength_m * CM, color=plots_style.GREY, lw=0.8, ls=":")
        axes.set_title(f"{tone * KHZ:g} kHz (dotted: free wave)")
        axes.set_xlabel("wavelength asked for (cm)")
    panels[0].set_ylabel("TWR = 1 - SWR")
    figure.legend(*panels[0].get_legend_handles_labels(), loc="outside lower center", ncols=3, fontsize=7)
    alt = "Travelling-wave ratio over the wavelength asked for at the sensors, beam by beam and frequency by frequency."
    return ReportFigure("shaping_travelling", "Travelling waves", alt, figure, vector=True)
