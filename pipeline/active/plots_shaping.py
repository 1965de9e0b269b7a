"""Pictures of shaping: how well T can be inverted, patterns confined left, middle and right, travelling waves."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from pipeline.plots import style
from pipeline.plots.style import ReportFigure
from pipeline.units import CM, KHZ, MM
from solvers.shaping.contrast import REGIONS, region_target
from solvers.shaping.inversion import drive_voltages

if TYPE_CHECKING:
    from solvers.thesis.shaping_study import ShapingStudy


def report_figures(study: ShapingStudy) -> list[ReportFigure]:
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
    return ReportFigure("shaping_conditioning", "How well T can be inverted", alt, figure, vector=True)


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
        row[0].set_title(f"{beam.name}, {signal}", fontsize=8)
    for axes, region in zip(panels[-1], REGIONS, strict=True):
        axes.set_xlabel(f"x (mm), confined {region}")
    panels[0, -1].legend(fontsize=6.5)
    alt = f"Amplitude along each beam at {frequency / KHZ:g} kHz confined to the left, middle or right third of the sensors."
    return ReportFigure("shaping_patterns", "Confined left, in the middle, right", alt, figure, vector=True)


def travelling(study: ShapingStudy) -> ReportFigure:
    """Travelling-wave ratio over the wavelength asked for at the sensors."""
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
        axes.set(title=f"{tone / KHZ:g} kHz (dotted: free wave)", xlabel="wavelength asked for (cm)")
    panels[0].set_ylabel("TWR = 1 - SWR")
    style.legend_below(figure, *panels[0].get_legend_handles_labels())
    alt = "Travelling-wave ratio over the wavelength asked for at the sensors, beam by beam and frequency by frequency."
    return ReportFigure("shaping_travelling", "Travelling waves", alt, figure, vector=True)
