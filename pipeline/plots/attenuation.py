"""Complex bands: decay per row of every wave, wavenumbers across the rows, and what the case's rows let through."""

from __future__ import annotations

from typing import Any

import numpy as np

from pipeline.plots import style
from pipeline.plots.style import ReportFigure
from pipeline.quantity import figure as figure_text
from pipeline.quantity import frequency, interval, level
from pipeline.records.record import AttenuationRecord, BroadbandRecord
from pipeline.records.study import StoredCase
from pipeline.units import KHZ
from solvers.measures.levels import CONFINED_DB

LOOKS = {"flexural": (style.BLUE, "o"), "shear": (style.ORANGE, "s"), "longitudinal": (style.PURPLE, "D")}
DEEPEST_DB = 30.0


def attenuation(case: StoredCase, arrays: dict[str, Any]) -> ReportFigure | None:
    """The complex bands of a case's record, its wanted mode marked."""
    record, wanted = case.record.attenuation, case.record.wanted
    return complex_bands(record, wanted.frequency_hz if wanted else None) if record else None


def complex_bands(record: AttenuationRecord, predicted_hz: float | None = None) -> ReportFigure:
    """Three panels over frequency: decay per row, Re k_y, power through the rows."""
    figure, (decay, phase, power) = style.panels(6.2, 3, 1, sharex=True, height_ratios=[1.2, 1.0, 1.0])
    _waves(decay, phase, record)
    draw_least(decay, record)
    _power(power, record)
    title = f"Waves across the rows at kx = {figure_text(record.kx_per_m)} rad/m"
    decay.set(ylim=(DEEPEST_DB, -0.5), ylabel="decay (dB per row)", title=title)
    phase.set(ylabel="|Re ky| p / π")
    power.set(ylabel="share of power", xlabel="frequency (kHz)")
    for axes in (decay, phase, power):
        axes.grid(True)
        if predicted_hz:
            axes.axvline(predicted_hz / KHZ, color=style.GREY, ls=":")
    figure.legend(*decay.get_legend_handles_labels(), loc="outside upper center", ncols=4, fontsize=7, markerscale=2.5)
    title = "Attenuation per row and power through the rows"
    return ReportFigure("attenuation", title, _alt(record), figure, vector=True)


def broadband(case: StoredCase, arrays: dict[str, Any]) -> ReportFigure | None:
    """The rows over frequency, as a case's record has them."""
    return rows_over_frequency(case.record.broadband) if case.record.broadband else None


def rows_over_frequency(record: BroadbandRecord) -> ReportFigure:
    """What the rows take from a wave, and the confinement of the driven motion, over frequency."""
    figure, axes = style.panels(3.6)
    draw_levels(axes, record)
    title = "What the rows hold over frequency"
    bands = ", ".join(interval(*ends, *record.end_errors(ends)) for ends in record.stopped) or "nowhere"
    alt = f"Over frequency: dB that {record.rows} rows take from a flexural wave, at least {CONFINED_DB:g} at {bands}; "
    return ReportFigure("broadband", title, alt + "and confinement of the driven zone", figure, vector=True)


def draw_levels(
    axes: Any, record: BroadbandRecord, label: str = "", colours: tuple[str, str] = (style.BLUE, style.ORANGE)
) -> None:
    """Both levels into axes, the wanted mode of the column marked."""
    tone = np.array([point.frequency_hz for point in record.points]) / KHZ
    taken = [point.taken_db for point in record.points]
    level = [np.nan if p.confinement_db is None else p.confinement_db for p in record.points]
    axes.plot(tone, taken, color=colours[0], label=f"{label}taken from a wave by {record.rows} rows")
    axes.plot(tone, level, color=colours[1], lw=0.9, ls="--", label=f"{label}confinement of the driven zone")
    if record.wanted_hz is not None and record.wanted_db is not None:
        axes.plot(record.wanted_hz / KHZ, record.wanted_db, "*", color=colours[1], ms=10)
    axes.axhline(CONFINED_DB, color=style.GREEN, lw=0.9, ls=":")
    axes.set(xlabel="frequency (kHz)", ylabel="level (dB)", ylim=(-15.0, 60.0))
    axes.grid(True)
    axes.legend(fontsize=7)


def _waves(decay: Any, phase: Any, record: AttenuationRecord) -> None:
    pitch = record.pitch_y_m
    for name, (colour, marker) in LOOKS.items():
        waves = [(p.frequency_hz, w) for p in record.points for w in p.waves if w.polarisation == name]
        if not waves:
            continue
        tone = np.array([f for f, _ in waves]) / KHZ
        look = {"color": colour, "marker": marker, "ls": "none", "ms": 1.8}
        decay.plot(tone, [w.db_per_row for _, w in waves], label=name, **look)
        weak = np.array([w.db_per_row < DEEPEST_DB for _, w in waves])
        phase.plot(tone[weak], np.array([abs(w.ky_re_per_m) * pitch / np.pi for _, w in waves])[weak], **look)


def draw_least(axes: Any, record: AttenuationRecord) -> None:
    """Decay per row of the least attenuated flexural wave over frequency."""
    tone, least = record.decay.T
    if len(tone):
        axes.plot(tone / KHZ, least, color=style.VERMILION, lw=1.4, label="least attenuated flexural wave")


def _power(axes: Any, record: AttenuationRecord) -> None:
    transmitted = [(p.frequency_hz, p.transmission) for p in record.points if p.transmission]
    if not transmitted:
        axes.text(0.5, 0.5, "no rows, or no flexural wave arrives", ha="center", transform=axes.transAxes)
        return
    tone = np.array([f for f, _ in transmitted]) / KHZ
    flexural, turned = np.array([(p.flexural, p.shear + p.longitudinal) for _, p in transmitted]).T
    axes.plot(tone, flexural, color=style.BLUE, label=f"through {record.rows} rows, flexural")
    axes.plot(tone, turned, color=style.ORANGE, ls="--", label="turned into in-plane waves")
    axes.set_yscale("symlog", linthresh=1e-4)
    axes.set_ylim(0.0, 1.5)
    axes.legend(loc="lower right", fontsize=7)


def _alt(record: AttenuationRecord) -> str:
    deepest = max(((point.db_per_row or 0.0, point) for point in record.points), key=lambda pair: pair[0])
    most = level(deepest[0], deepest[1].db_error)
    return (
        f"Decay per row of flexural, shear and longitudinal waves over frequency; the least attenuated flexural wave decays "
        f"most, {most} per row, at {frequency(deepest[1].frequency_hz)}; below, the power that passes {record.rows} rows"
    )
