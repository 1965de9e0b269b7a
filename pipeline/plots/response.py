"""Pictures of rows and patches together, and of a travelling wave."""

from __future__ import annotations

from typing import Any

import numpy as np

from pipeline.plots import style
from pipeline.plots.style import ReportFigure
from pipeline.quantity import figure as figure_text
from pipeline.quantity import frequency, level, percentage
from pipeline.records.record import (
    HybridMethod,
    HybridRecord,
    TravelRecord,
)
from pipeline.records.study import StoredCase
from pipeline.units import KHZ, MM, UM
from solvers.measures.levels import CONFINED_DB

FREQUENCY = "frequency (kHz)"


def _tone(peak: TravelRecord) -> str:
    return frequency(peak.frequency_hz, peak.frequency_error)


def hybrid(case: StoredCase, arrays: dict[str, Any]) -> ReportFigure | None:
    """Rows and patches together, from a case's record."""
    return hybrid_levels(case.record.hybrid) if case.record.hybrid else None


def hybrid_levels(record: HybridRecord) -> ReportFigure:
    """Levels of the four methods over frequency, the same detuned, and the voltages."""
    figure, panels = style.panels(7.6, 3, 1, sharex=True)
    draw_hybrid(panels[0], record)
    off = {
        method.method: method.off_db if method.rows_off_db is None else method.rows_off_db for method in record.methods
    }
    title = f"Resonances of the pillars (of the plate without rows) off by {percentage(record.detuning, 0.0)}, the worse sign"
    _methods(panels[1], record, off, "confinement (dB)", title)
    _methods(
        panels[2],
        record,
        {w.method: w.volts_per_um for w in record.methods},
        "largest voltage (V)",
        "For 1 µm rms in the zone",
    )
    panels[2].set(yscale="log", xlabel=FREQUENCY)
    return ReportFigure("hybrid", "Rows and patches together", _alt_hybrid(record), figure, vector=True)


def draw_hybrid(axes: Any, record: HybridRecord) -> None:
    """Confinement by rows, by patches, by both and by neither over frequency."""
    levels = {method.method: method.confinement_db for method in record.methods}
    _methods(axes, record, levels, "confinement (dB)", "As computed; dotted: the wanted mode's peak")
    axes.axhline(CONFINED_DB, color=style.GREEN, lw=0.9, ls=":")
    axes.set_xlabel(FREQUENCY)
    axes.legend(fontsize=8, ncols=4)


def _methods(axes: Any, record: HybridRecord, curves: Any, label: str, title: str) -> None:
    style.draw_lines(axes.plot, np.array(record.frequency_hz) / KHZ, curves)
    if record.wanted_hz:
        style.mark(axes, record.wanted_hz / KHZ)
    axes.set(ylabel=label, title=title)
    axes.grid(True)


def _alt_hybrid(record: HybridRecord) -> str:
    where = (
        "least over the band" if record.wanted_hz is None else f"at {frequency(record.wanted_hz, record.wanted_error)}"
    )
    levels = [f"{method.method} {_level_of(record, method)}" for method in record.methods]
    return f"Confinement over frequency by rows, by patches, by both and by neither; {where}: {', '.join(levels)}"


def _level_of(record: HybridRecord, method: HybridMethod) -> str:
    """At the wanted mode's peak, or the least over the band."""
    at = record.at_wanted(method.method, "confinement_db")
    if at is None:
        return level(min(method.confinement_db))
    return level(at, record.at_wanted(method.method, "confinement_error_db"))


def travelling(case: StoredCase, arrays: dict[str, Any]) -> ReportFigure | None:
    """The travelling wave of a case's record."""
    return travelling_wave(case.record.travel) if case.record.travel else None


def travelling_wave(record: TravelRecord) -> ReportFigure:
    """The wave through a period, and the power that flows with it beside that of patches in phase."""
    figure, (wave, flow) = style.panels(5.4, 2, 1, sharex=True)
    draw_wave(wave, record)
    powers = {"held a quarter period apart": record.flow_W, "all patches in phase": record.standing_flow_W}
    curves = {name: 1e3 * np.array(watts) for name, watts in powers.items()}
    style.draw_lines(flow.plot, np.array(record.flow_x_m) / MM, curves, marker="o", ms=3)
    flow.axhline(0.0, color=style.GREY, lw=0.8)
    flow.set(ylabel="power towards +x (mW)", xlabel="x (mm)", title="Through each section that no patch straddles")
    flow.legend(fontsize=8)
    name = "A wave that travels inside the zone"
    return ReportFigure("travelling", name, _alt_wave(record), figure, vector=True)


def draw_wave(axes: Any, record: TravelRecord) -> None:
    """u_z along the zone's centre line at six moments of a period, and the envelope; the window of the ratio is shaded."""
    x, field = np.array(record.x_m) / MM, np.array(record.field_m) @ np.array([1.0, 1j]) / UM
    for step in range(6):
        axes.plot(x, (field * np.exp(1j * np.pi * step / 3.0)).real, color=style.SKY, lw=0.7)
    for sign in (1.0, -1.0):
        axes.plot(x, sign * np.abs(field), color=style.BLUE)
    axes.axvspan(*(end / MM for end in record.window_m), color=style.GREY, alpha=0.1, lw=0)
    axes.set(ylabel="u_z (µm)", xlabel="x (mm)")
    axes.set_title(f"{_tone(record)}, travelling-wave ratio {figure_text(record.twr, record.twr_error)} where shaded")


def _alt_wave(record: TravelRecord) -> str:
    modes = " and ".join(f"(0, {mode.nodal_lines})" for mode in record.modes)
    most = max(record.flow_W, key=abs)
    flow = f"at most {figure_text(1e3 * most)} mW flow along the zone for 1 um rms"
    if record.inner_sections == 0:
        flow = "patches straddle every section between the plate's ends, so that the flow is unknown"
    return (
        f"Modes {modes} held a quarter period apart at {_tone(record)}: travelling-wave ratio "
        f"{figure_text(record.twr, record.twr_error)}, {flow}"
    )
