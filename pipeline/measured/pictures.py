"""Pictures of measurement and computation: both sweeps over frequency, the circle fit, both fields on the touch face."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from pipeline.measured.parts import MeasuredMapRecord, MeasuredRecord, MeasuredSweepRecord, marked
from pipeline.plots import style
from pipeline.plots.fields import draw_outlines, flat_height_in, frame_plate
from pipeline.plots.style import ReportFigure
from pipeline.quantity import KHZ, MM, frequency, level
from pipeline.quantity import figure as figure_text
from pipeline.records.record import DesignRecord

SQUARE = 0.6  # width over length of a plate above which two of them fit side by side
AROUND = 10.0  # half-power widths shown around both resonances


def report_figure(record: MeasuredRecord, arrays: Mapping[str, Any], design: DesignRecord) -> ReportFigure:
    """Draw measured and computed sweeps and maps, where available."""
    abreast = flat_height_in(design, 1.0) > SQUARE
    field_in = flat_height_in(design, style.WIDTH_IN * (0.36 if abreast else 0.8)) + 0.8
    heights = [2.6] * bool(record.sweep) + [field_in * (1 if abreast else 2)] * bool(record.map)
    figure = style.new_figure(style.WIDTH_IN, sum(heights))
    rows = list(figure.subfigures(len(heights), 1, height_ratios=heights, squeeze=False)[:, 0])
    if record.sweep:
        _sweep(rows.pop(0), record.sweep, arrays)
    if record.map:
        panels = rows[0].subplots(*((1, 2) if abreast else (2, 1)))
        _fields(rows[0], list(panels), record.map, arrays, design)
    return ReportFigure("measured", "Measured and computed", _alt(record), figure)


def _sweep(figure: Any, record: MeasuredSweepRecord, arrays: Mapping[str, Any]) -> None:
    curve, circle = figure.subplots(1, 2, width_ratios=[1.4, 1])
    pairs = (
        ("measured_hz", "measured_response", record, style.VERMILION, "measured" + marked(record)),
        ("measured_computed_hz", "measured_computed", record.computed, style.BLUE, "computed"),
    )
    for tone, response, about, colour, name in pairs:
        values = arrays[response] / np.abs(arrays[response]).max()
        dots = {"ls": "none", "marker": ".", "ms": 3} if name != "computed" else {"lw": 1.2}
        curve.semilogy(arrays[tone] / KHZ, np.abs(values), color=colour, label=name, **dots)
        curve.axvline(about.frequency_hz / KHZ, color=colour, ls=":", lw=0.8)
    title = f"Shift {record.shift_text}"
    window = [edge / KHZ for edge in _shown_hz(record)]
    curve.set(xlim=window, xlabel="frequency (kHz)", ylabel="amplitude relative to its peak", title=title)
    curve.set_ylim(bottom=5e-3)
    curve.grid(True)
    curve.legend(fontsize=9)
    _circle(circle, record, arrays)


def _shown_hz(record: MeasuredSweepRecord) -> tuple[float, float]:
    """Return a frequency window around both resonances."""
    both = [record, record.computed]
    width = max(one.frequency_hz / (one.quality_factor or 100.0) for one in both)
    tones = [one.frequency_hz for one in both]
    return min(tones) - AROUND * width, max(tones) + AROUND * width


def _circle(axes: Any, record: MeasuredSweepRecord, arrays: Mapping[str, Any]) -> None:
    values, tone = arrays["measured_response"], arrays["measured_hz"]
    size, fit = np.abs(values).max(), record.circle
    delay = fit["delay_s"] if fit else 0.0
    straight = values * np.exp(2j * np.pi * tone * delay) / size
    axes.plot(straight.real, straight.imag, ".", ms=3, color=style.VERMILION)
    if fit:
        centre, radius = complex(*fit["circle"]["centre"]) / size, fit["circle"]["radius"] / size
        turn = np.exp(1j * np.linspace(0.0, 2.0 * np.pi, 181))
        around = centre + radius * turn
        axes.plot(around.real, around.imag, color="black", lw=0.9)
    axes.set_aspect("equal", adjustable="datalim")
    axes.grid(True)
    quality_factor = "none" if record.quality_factor is None else figure_text(record.quality_factor)
    axes.set(xlabel="real part (peak: 1)", ylabel="imaginary part", title=f"Quality factor {quality_factor}")


def _fields(
    figure: Any, panels: list[Any], record: MeasuredMapRecord, arrays: Mapping[str, Any], design: DesignRecord
) -> None:
    seen, made = arrays["measured_field"], arrays["measured_operating"]
    phase = np.exp(-1j * np.angle(seen[int(np.argmax(np.abs(seen)))]))
    seen, made = phase * seen, phase * made * np.exp(-1j * np.angle(np.vdot(seen, made)))
    level_text = _decibels(record.confinement_db), _decibels(record.computed.confinement_at_points_db)
    titles = (f"Measured{marked(record)}{level_text[0]}", f"Computed, same points{level_text[1]}")
    for axes, values, title in zip(panels, (seen, made), titles, strict=True):
        largest = float(np.abs(values).max()) or 1.0
        image = _painted(axes, arrays["measured_xy"] / MM, values.real / largest)
        draw_outlines(axes, design)
        frame_plate(axes, design)
        axes.set_title(title)
    figure.colorbar(image, ax=panels, shrink=0.8, pad=0.01, label="relative to the largest value")


def _painted(axes: Any, xy: Any, values: Any) -> Any:
    """Draw a smooth field between the points, or the points alone if they span no area."""
    look: dict[str, Any] = {"cmap": style.SIGNED, "vmin": -1, "vmax": 1, "rasterized": True}
    if len(xy) > 3 and np.linalg.matrix_rank(xy - xy.mean(axis=0), tol=1e-6) == 2:
        return axes.tripcolor(xy[:, 0], xy[:, 1], values, shading="gouraud", **look)
    return axes.scatter(xy[:, 0], xy[:, 1], c=values, s=12, **look)


def _decibels(level_db: float | None) -> str:
    return "" if level_db is None else f": {level(level_db)}"


def _alt(record: MeasuredRecord) -> str:
    said = []
    if sweep := record.sweep:
        quality_factor = (
            "" if sweep.quality_factor is None else f", with a quality factor of {figure_text(sweep.quality_factor)}"
        )
        said.append(
            f"The measured resonance{marked(sweep)} is at {frequency(sweep.frequency_hz, sweep.frequency_error)}, "
            f"{sweep.shift_text} from the computed one{quality_factor}"
        )
    if field := record.map:
        said.append(
            f"The field measured at {field.points} points{marked(field)}{_decibels(field.confinement_db)}; its "
            f"correlation with the computed operating deflection shape is {figure_text(field.mac_operating)}"
        )
    return ". ".join(said) + "."
