"""Pictures of the forced response and of its spread over printed plates."""

from __future__ import annotations

from typing import Any

import numpy as np

from pipeline.plots import style
from pipeline.plots.style import ReportFigure
from pipeline.quantity import figure as figure_text
from pipeline.quantity import frequency, level, with_bar
from pipeline.records.record import (
    PeakRecord,
    ResponseRecord,
    SpreadRecord,
    ToleranceRecord,
)
from pipeline.records.study import StoredCase
from pipeline.units import KHZ, MM, NM
from solvers.measures.levels import CONFINED_DB

FREQUENCY = "frequency (kHz)"
BAND = 0.1  # of a value: how far down a bar is drawn that is longer


def response(case: StoredCase, arrays: dict[str, Any]) -> ReportFigure | None:
    """The response of a case's record."""
    record = case.record.response
    return curves(record, arrays.get("response_xy"), arrays.get("response_uz")) if record else None


def curves(record: ResponseRecord, points: Any = None, shape: Any = None) -> ReportFigure:
    """Curves over frequency, and the operating deflection shape at the peak when its field is there."""
    count = 1 + (record.sensor_V_per_V is not None) + (shape is not None)
    figure, panels = style.panels(2.3 * count + 0.6, count, 1, squeeze=False)
    draw_amplitudes(panels[0, 0], record)
    if record.sensor_V_per_V is not None:
        _sensor(panels[1, 0], record)
    if shape is not None:
        _shape(panels[-1, 0], points, shape, record)
    return ReportFigure("response", "Response per volt of drive", _alt(record), figure, vector=shape is None)


def draw_amplitudes(axes: Any, record: ResponseRecord) -> None:
    """Rms of zone and passive face per volt over frequency, the peaks marked."""
    tone = np.array(record.frequency_hz) / KHZ
    zone, passive = (
        (record.zone_rms_m_per_V, record.zone_rms_error_m_per_V),
        (record.passive_rms_m_per_V, record.passive_rms_error_m_per_V),
    )
    _with_bars(axes, tone, *zone, color=style.BLUE, label="zone")
    _with_bars(axes, tone, *passive, color=style.VERMILION, ls="--", label="passive face")
    wanted, highest = record.wanted_peak, record.highest_peak
    for peak, dashes in ((wanted, ":"), (highest, "-.")):
        if peak:
            axes.axvline(peak.frequency_hz / KHZ, color=style.GREY, ls=dashes, lw=0.8)
    other = f"highest peak at {_tone(highest)} (dash-dotted)"
    own = f"Wanted mode's peak at {_tone(wanted)} (dotted),\n" if wanted else ""
    axes.set(ylabel="rms u_z (nm/V)", xlabel=FREQUENCY, title=own + other if own else other.capitalize())
    axes.grid(True)
    axes.legend(fontsize=8)


def _with_bars(axes: Any, tone: Any, rms_m: list[float] | None, error_m: list[float] | None, **look: Any) -> None:
    """A curve, and a band between the ends of its bars; down to BAND of it where they are longer than itself."""
    if rms_m is None:
        return
    values = np.array(rms_m) / NM
    axes.semilogy(tone, values, **look)
    if error_m is not None:
        half = np.array(error_m) / NM
        low = np.maximum(values - half, BAND * values)
        axes.fill_between(tone, low, values + half, color=look["color"], alpha=0.2, lw=0)


def _sensor(axes: Any, record: ResponseRecord) -> None:
    tone, volts = np.array(record.frequency_hz) / KHZ, np.array(record.sensor_V_per_V) @ np.array([1.0, 1j])
    axes.semilogy(tone, np.abs(volts), color=style.GREEN)
    axes.set(ylabel="sensor (V/V)", xlabel=FREQUENCY, title=f"Sensor patch {record.sensors[0]}, open circuit")
    axes.grid(True)
    phase = axes.twinx()
    phase.plot(tone, np.degrees(np.unwrap(np.angle(volts))), color=style.ORANGE, ls="--")
    phase.set_ylabel("phase (°)", color=style.ORANGE)
    phase.spines["right"].set_visible(True)


def _shape(axes: Any, points: Any, shape: Any, record: ResponseRecord) -> None:
    turned = shape * np.exp(-1j * np.angle(shape[np.argmax(np.abs(shape))]))
    limit = np.abs(shape).max() / NM
    x, y = np.unique(points[:, 0]), np.unique(points[:, 1])
    field = turned.real.reshape(len(x), len(y)).T / NM
    look = {"cmap": style.SIGNED, "vmin": -limit, "vmax": limit, "shading": "gouraud", "rasterized": True}
    image = axes.pcolormesh(x / MM, y / MM, field, **look)
    style.mm_axes(axes)
    axes.set_title(f"Operating deflection shape at {_tone(record.peak)}")
    axes.set_anchor("W")
    axes.figure.colorbar(image, cax=axes.inset_axes((1.05, 0.0, 0.05, 1.0)), label="u_z (nm/V)")


def _tone(peak: PeakRecord) -> str:
    return frequency(peak.frequency_hz, peak.frequency_error)


def _alt(record: ResponseRecord) -> str:
    peak = record.peak
    bar = None if peak.height_error is None else peak.height_error * peak.zone_nm_per_V
    whose = "the wanted mode peaks" if record.wanted_peak else "the zone peaks highest"
    level_text = "" if peak.confinement_db is None else f", {level(peak.confinement_db)} above the passive face"
    read = "" if peak.quality_factor is None else figure_text(peak.quality_factor, peak.quality_error)
    quality_factor = f", quality factor {read} read from the curve" if read else ""
    return (
        f"Displacement per volt over frequency: {whose} at {_tone(peak)} with "
        f"{with_bar(peak.zone_nm_per_V, bar, 'nm/V')} rms{level_text}{quality_factor}"
    )


def tolerance(case: StoredCase, arrays: dict[str, Any]) -> ReportFigure | None:
    """The tolerance study of a case's record."""
    record = case.record.tolerance
    return report_figure(record, arrays) if record else None


def report_figure(record: ToleranceRecord, arrays: dict[str, Any]) -> ReportFigure:
    """Curves over frequency, where there are any; below, each plate's peak and how well its zone confines the mode there."""
    draw = [lambda axes: _curves(axes, record, arrays)] if arrays else []
    if record.confinement_db:
        draw.append(lambda axes: draw_peaks(axes, record))
    figure, panels = style.panels(0.4 + 2.6 * len(draw), len(draw), 1, squeeze=False)
    for panel, own in zip(panels[:, 0], draw, strict=True):
        own(panel)
    title = (
        "What printed pillars do to the response"
        if arrays
        else "What pillars that are all off alike do to the wanted mode"
    )
    return ReportFigure("tolerance", title, _spread_alt(record), figure, vector=True)


def _curves(axes: Any, record: ToleranceRecord, arrays: dict[str, Any]) -> None:
    tone, curves = arrays["tolerance_hz"] / KHZ, np.asarray(arrays["tolerance_curves"]) / NM
    for number, curve in enumerate(curves[1:]):
        axes.semilogy(tone, curve, color=style.SKY, lw=0.6, alpha=0.7, label="samples" if number == 0 else None)
    axes.semilogy(tone, curves[0], color="black", lw=1.3, label="nominal plate")
    peak, count = record.peak_hz, len(record.samples) - record.lost
    title = "No plate kept the wanted mode"
    if peak:
        title = f"Wanted mode's peak {_mean(peak)}, spread {peak.spread(count, 'Hz')} over {count} plates"
    axes.set(xlabel=FREQUENCY, ylabel=f"zone rms u_z (n{record.rms_unit})", title=title)
    axes.grid(True)
    axes.legend(fontsize=8, frameon=True, framealpha=0.9, edgecolor="none")


def draw_peaks(axes: Any, record: ToleranceRecord) -> None:
    """Each plate's peak and its driven confinement there, the nominal plate marked."""
    both = [(one.peak_hz, one.confinement_db) for one in (record.nominal, *record.samples) if one.peak_hz is not None]
    tone, decibels = np.reshape(np.array(both, dtype=float), (-1, 2)).T
    axes.plot(tone[1:] / KHZ, decibels[1:], "o", ms=4, color=style.BLUE, label="samples")
    axes.plot(tone[:1] / KHZ, decibels[:1], "*", ms=11, color="black", label="nominal plate")
    axes.axhline(CONFINED_DB, color=style.GREY, ls="--", lw=0.9, label=f"confined from {CONFINED_DB:g} dB")
    axes.set(xlabel="peak (kHz)", ylabel="confinement at the peak (dB)")
    if spread := record.confinement_db:
        own = spread.deviation or 0.0
        axes.axhspan(spread.mean - own, spread.mean + own, color=style.SKY, alpha=0.25, lw=0)
        axes.set_title(f"Confinement {_levels(record, ', ')}")
    axes.grid(True)
    axes.legend(fontsize=8, frameon=True, framealpha=0.9, edgecolor="none")


def _mean(peak: SpreadRecord) -> str:
    return frequency(peak.mean, peak.relative)


def _levels(record: ToleranceRecord, to_worst: str) -> str:
    """Mean, spread and least of the samples' confinement, with the digits that the spread allows."""
    found, count = record.confinement_db, len(record.samples) - record.lost
    assert found is not None
    mean, worst = (level(each, found.deviation) for each in (found.mean, found.lowest))
    return f"{mean}, spread {found.spread(count, 'dB')}{to_worst}worst {worst}"


def _spread_alt(record: ToleranceRecord) -> str:
    peak = record.peak_hz
    plates = (
        "plates whose pillars differ"
        if record.frequency_error is None
        else "plates whose pillars are all off by the same"
    )
    if not peak:
        return f"None of {len(record.samples)} {plates} kept the wanted mode."
    tone = frequency(record.nominal.peak_hz, peak.relative)
    nominal = "" if record.nominal.peak_hz is None else f", nominally at {tone}"
    spread = f"; confinement {_levels(record, ', at ')}" if record.confinement_db else ""
    return (
        f"{len(record.samples)} {plates}: the wanted mode's peak lies at {_mean(peak)} "
        f"(spread {peak.spread(len(record.samples) - record.lost, 'Hz')}){nominal}{spread}"
    )
