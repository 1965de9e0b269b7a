"""Pictures of the forced response and of its spread over printed plates."""

from __future__ import annotations

from typing import Any

import numpy as np

from pipeline.plots import style as plots_style
from pipeline.plots.style import ReportFigure
from pipeline.records.record import ResponseRecord, SpreadRecord, ToleranceRecord
from pipeline.records.study import StoredCase
from solvers.measures.levels import CONFINED_DB

KHZ, NM, MM = 1e-3, 1e9, 1e3


def response(case: StoredCase, arrays: dict[str, Any]) -> ReportFigure | None:
    """The response of a case's record."""
    record = case.record.response
    return curves(record, arrays.get("response_xy"), arrays.get("response_uz")) if record else None


def curves(record: ResponseRecord, points: Any = None, shape: Any = None) -> ReportFigure:
    """Curves over frequency, and the operating shape at the peak when its field is there."""
    has_sensor = record.sensor_V_per_V is not None
    count = 1 + has_sensor + (shape is not None)
    figure = plots_style.new_figure(plots_style.WIDTH_IN, 2.3 * count + 0.6)
    panels = list(np.atleast_1d(figure.subplots(count, 1)))
    tone = KHZ * np.array(record.frequency_hz)
    _amplitudes(panels[0], tone, record)
    if has_sensor:
        _sensor(panels[1], tone, record)
    if shape is not None:
        _shape(panels[-1], points, shape, record)
    return ReportFigure("response", "Response per volt of drive", _alt(record), figure, vector=shape is None)


def _amplitudes(axes: Any, tone: Any, record: ResponseRecord) -> None:
    axes.semilogy(tone, NM * np.array(record.zone_rms_m_per_V), color=plots_style.BLUE, label="zone")
    if record.passive_rms_m_per_V is not None:
        axes.semilogy(
            tone,
            NM * np.array(record.passive_rms_m_per_V),
            color=plots_style.VERMILION,
            ls="--",
            label="passive face",
        )
    wanted, highest = record.wanted_peak, record.highest_peak
    for peak, style in ((wanted, ":"), (highest, "-.")) if wanted else ((highest, "-."),):
        axes.axvline(KHZ * peak.frequency_hz, color=plots_style.GREY, ls=style, lw=0.8)
    axes.set_ylabel("rms u_z (nm/V)")
    axes.set_xlabel("frequency (kHz)")
    other = f"highest peak at {KHZ * highest.frequency_hz:.2f} kHz (dash-dotted)"
    own = f"Wanted mode's peak at {KHZ * wanted.frequency_hz:.2f} kHz (dotted), " if wanted else ""
    axes.set_title(own + other if own else other.capitalize())
    axes.grid(True)
    axes.legend(fontsize=8)


def _sensor(axes: Any, tone: Any, record: ResponseRecord) -> None:
    volts = np.array(record.sensor_V_per_V) @ np.array([1.0, 1j])
    axes.semilogy(tone, np.abs(volts), color=plots_style.GREEN)
    axes.set_ylabel("sensor (V/V)")
    axes.set_xlabel("frequency (kHz)")
    axes.grid(True)
    phase = axes.twinx()
    phase.plot(tone, np.degrees(np.unwrap(np.angle(volts))), color=plots_style.ORANGE, ls="--")
    phase.set_ylabel("phase (°)", color=plots_style.ORANGE)
    phase.spines["right"].set_visible(True)
    axes.set_title(f"Sensor patch {record.sensors[0]}, open circuit")


def _shape(axes: Any, points: Any, shape: Any, record: ResponseRecord) -> None:
    turned = shape * np.exp(-1j * np.angle(shape[np.argmax(np.abs(shape))]))
    limit = NM * np.abs(shape).max()
    x, y = np.unique(points[:, 0]), np.unique(points[:, 1])
    field = NM * turned.real.reshape(len(x), len(y)).T
    image = axes.pcolormesh(
        MM * x, MM * y, field, cmap=plots_style.SIGNED, vmin=-limit, vmax=limit, shading="gouraud", rasterized=True
    )
    plots_style.mm_axes(axes)
    axes.set_title(f"Operating shape at {KHZ * record.peak.frequency_hz:.2f} kHz")
    axes.figure.colorbar(image, ax=axes, label="u_z (nm/V)")


def _alt(record: ResponseRecord) -> str:
    peak, whose = record.peak, "the wanted mode peaks" if record.wanted_peak else "the zone peaks highest"
    level_text = "" if peak.confinement_db is None else f", {peak.confinement_db:.1f} dB above the passive face"
    quality = "" if peak.quality is None else f", quality factor {peak.quality:.0f} read from the curve"
    return (
        f"Displacement per volt over frequency: {whose} at {KHZ * peak.frequency_hz:.2f} kHz with "
        f"{NM * peak.zone_rms_m_per_V:.2f} nm/V rms{level_text}{quality}"
    )


def tolerance(case: StoredCase, arrays: dict[str, Any]) -> ReportFigure | None:
    """The tolerance study of a case's record."""
    record = case.record.tolerance
    return report_figure(record, arrays) if record else None


def report_figure(record: ToleranceRecord, arrays: dict[str, Any]) -> ReportFigure:
    """Curves over frequency; below, each plate's peak and how well it holds it."""
    level = record.confinement_db
    figure = plots_style.new_figure(plots_style.WIDTH_IN, 5.6 if level else 3.0)
    panels = list(figure.subplots(2 if level else 1, 1, squeeze=False)[:, 0])
    _curves(panels[0], record, arrays)
    if level:
        _peaks(panels[1], record, level)
    return ReportFigure(
        "tolerance", "What printed pillars do to the response", _spread_alt(record), figure, vector=True
    )


def _curves(axes: Any, record: ToleranceRecord, arrays: dict[str, Any]) -> None:
    tone, curves = KHZ * arrays["tolerance_hz"], 1e9 * np.asarray(arrays["tolerance_curves"])
    for number, curve in enumerate(curves[1:]):
        axes.semilogy(tone, curve, color=plots_style.SKY, lw=0.6, alpha=0.7, label="samples" if number == 0 else None)
    axes.semilogy(tone, curves[0], color="black", lw=1.3, label="nominal plate")
    axes.set_xlabel("frequency (kHz)")
    axes.set_ylabel(f"zone rms u_z (n{record.rms_unit})")
    peak = record.peak_hz
    count = len(record.samples) - record.lost
    axes.set_title(
        f"Wanted mode's peak {KHZ * peak.mean:.2f} kHz, spread {peak.deviation:.0f} Hz over {count} plates"
        if peak
        else "No plate kept the wanted mode"
    )
    axes.grid(True)
    axes.legend(fontsize=8, frameon=True, framealpha=0.9, edgecolor="none")


def _peaks(axes: Any, record: ToleranceRecord, level: SpreadRecord) -> None:
    both = [(one.peak_hz, one.confinement_db) for one in (record.nominal, *record.samples) if one.peak_hz is not None]
    tone, decibels = np.array(both, dtype=float).T
    axes.plot(KHZ * tone[1:], decibels[1:], "o", ms=4, color=plots_style.BLUE, label="samples")
    axes.plot(KHZ * tone[0], decibels[0], "*", ms=11, color="black", label="nominal plate")
    axes.axhline(CONFINED_DB, color=plots_style.GREY, ls="--", lw=0.9, label=f"confined from {CONFINED_DB:.0f} dB")
    axes.axhspan(level.mean - level.deviation, level.mean + level.deviation, color=plots_style.SKY, alpha=0.25, lw=0)
    axes.set_xlabel("peak (kHz)")
    axes.set_ylabel("confinement at the peak (dB)")
    axes.set_title(f"Confinement {level.mean:.1f} dB, spread {level.deviation:.1f}, worst {level.lowest:.1f} dB")
    axes.grid(True)
    axes.legend(fontsize=8, frameon=True, framealpha=0.9, edgecolor="none")


def _spread_alt(record: ToleranceRecord) -> str:
    peak, level = record.peak_hz, record.confinement_db
    if not peak:
        return f"None of {len(record.samples)} plates whose pillars differ kept the wanted mode."
    nominal = "" if record.nominal.peak_hz is None else f", nominally at {KHZ * record.nominal.peak_hz:.2f} kHz"
    said = (
        f"Response of {len(record.samples)} plates whose pillars differ: the peak lies at {KHZ * peak.mean:.2f} kHz "
        f"with a spread of {peak.deviation:.0f} Hz{nominal}"
    )
    if level:
        said += (
            f"; confinement {level.mean:.1f} dB with a spread of {level.deviation:.1f} dB, at worst "
            f"{level.lowest:.1f} dB"
        )
    return said
