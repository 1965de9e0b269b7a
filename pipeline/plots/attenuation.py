"""Complex bands: decay per row of every wave, wavenumbers across the rows, and what the case's rows let through."""

from __future__ import annotations

from typing import Any

import numpy as np

from pipeline.plots import style
from pipeline.plots.style import ReportFigure
from pipeline.records.record import AttenuationRecord
from pipeline.records.study import StoredCase
from pipeline.units import KHZ

LOOKS = {"flexural": (style.BLUE, "o"), "shear": (style.ORANGE, "s"), "longitudinal": (style.GREEN, "D")}
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
    title = f"Waves across the rows at kx = {record.kx_per_m:.0f} rad/m"
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
    transmitted = [(p.frequency_hz, p.through_rows) for p in record.points if p.through_rows]
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
    deepest = max(((least, tone) for tone, least in record.decay), default=(0.0, 0.0))
    return (
        f"Decay per row of flexural, shear and longitudinal waves over frequency; the least attenuated flexural wave decays "
        f"most, {deepest[0]:.1f} dB per row, at {deepest[1] / KHZ:.2f} kHz; below, the power that passes {record.rows} rows"
    )
