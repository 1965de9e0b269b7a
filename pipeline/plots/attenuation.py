"""Complex bands: decay per row of every wave, wavenumbers across the rows, and what the case's rows let through."""

from __future__ import annotations

from typing import Any

import numpy as np

from pipeline.plots import style
from pipeline.plots.style import ReportFigure
from pipeline.records.record import AttenuationRecord
from pipeline.records.study import StoredCase

KHZ = 1e-3
LOOKS = {
    "flexural": (style.BLUE, "o"),
    "shear": (style.ORANGE, "s"),
    "longitudinal": (style.GREEN, "D"),
}
DEEPEST_DB = 30.0


def attenuation(case: StoredCase, arrays: dict[str, Any]) -> ReportFigure | None:
    """The complex bands of a case's record, its wanted mode marked."""
    record, wanted = case.record.attenuation, case.record.wanted
    return complex_bands(record, wanted.frequency_hz if wanted else None) if record else None


def complex_bands(record: AttenuationRecord, predicted_hz: float | None = None) -> ReportFigure:
    """Three panels over frequency: decay per row, Re k_y, power through the rows."""
    figure = style.new_figure(style.WIDTH_IN, 6.2)
    decay, phase, power = figure.subplots(3, 1, sharex=True, height_ratios=[1.2, 1.0, 1.0])
    _waves(decay, phase, record)
    _least(decay, record)
    _power(power, record)
    decay.set_ylim(DEEPEST_DB, -0.5)
    decay.set_ylabel("decay (dB per row)")
    decay.set_title(f"Waves across the rows at kx = {record.kx_per_m:.0f} rad/m")
    phase.set_ylabel("|Re ky| p / π")
    power.set_ylabel("share of power")
    power.set_xlabel("frequency (kHz)")
    for axes in (decay, phase, power):
        axes.grid(True)
        if predicted_hz:
            axes.axvline(KHZ * predicted_hz, color=style.GREY, ls=":")
    figure.legend(*decay.get_legend_handles_labels(), loc="outside upper center", ncols=4, fontsize=7, markerscale=2.5)
    return ReportFigure(
        "attenuation", "Attenuation per row and power through the rows", _alt(record), figure, vector=True
    )


def _waves(decay: Any, phase: Any, record: AttenuationRecord) -> None:
    pitch = record.pitch_y_m
    for name, (colour, marker) in LOOKS.items():
        waves = [(p.frequency_hz, w) for p in record.points for w in p.waves if w.polarisation == name]
        if not waves:
            continue
        tone = KHZ * np.array([f for f, _ in waves])
        look = {"color": colour, "marker": marker, "ls": "none", "ms": 1.8}
        decay.plot(tone, [w.db_per_row for _, w in waves], label=name, **look)
        weak = np.array([w.db_per_row < DEEPEST_DB for _, w in waves])
        phase.plot(tone[weak], np.array([abs(w.ky_re_per_m) * pitch / np.pi for _, w in waves])[weak], **look)


def _least(decay: Any, record: AttenuationRecord) -> None:
    tone, least = record.decay.T
    if len(tone):
        decay.plot(KHZ * tone, least, color=style.VERMILION, lw=1.4, label="least attenuated flexural wave")


def _power(axes: Any, record: AttenuationRecord) -> None:
    transmitted = [(p.frequency_hz, p.through_rows) for p in record.points if p.through_rows]
    if not transmitted:
        axes.text(0.5, 0.5, "no rows, or no flexural wave arrives", ha="center", transform=axes.transAxes)
        return
    tone = KHZ * np.array([f for f, _ in transmitted])
    axes.plot(
        tone, [p.flexural for _, p in transmitted], color=style.BLUE, label=f"through {record.rows} rows, flexural"
    )
    turned = [p.shear + p.longitudinal for _, p in transmitted]
    axes.plot(tone, turned, color=style.ORANGE, ls="--", label="turned into in-plane waves")
    axes.set_yscale("symlog", linthresh=1e-4)
    axes.set_ylim(0.0, 1.5)
    axes.legend(loc="lower right", fontsize=7)


def _alt(record: AttenuationRecord) -> str:
    deepest = max(((least, tone) for tone, least in record.decay), default=(0.0, 0.0))
    return (
        f"Decay per row of flexural, shear and longitudinal waves over frequency; the least attenuated flexural wave decays "
        f"most, {deepest[0]:.1f} dB per row, at {KHZ * deepest[1]:.2f} kHz; below, the power that passes {record.rows} rows"
    )
