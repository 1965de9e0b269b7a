"""Plates whose pillars differ: every sample's response beside the nominal one, peak against confinement."""

from __future__ import annotations

from typing import Any

import numpy as np

from pipeline import plots
from pipeline.plots import Drawing
from pipeline.records import CONFINED_DB, StoredCase

KHZ = 1e-3


def tolerance(case: StoredCase, arrays: dict[str, Any]) -> Drawing | None:
    """The tolerance study of a case's record."""
    found = case.record.get("tolerance")
    return drawing(found, arrays) if found else None


def drawing(found: dict[str, Any], arrays: dict[str, Any]) -> Drawing:
    """Curves over frequency; below, each plate's peak and how well it holds it."""
    held = found["confinement_db"] is not None
    figure = plots.new_figure(plots.WIDTH_IN, 5.6 if held else 3.0)
    panels = list(np.atleast_1d(figure.subplots(1 + held, 1)))
    _curves(panels[0], found, arrays)
    if held:
        _peaks(panels[1], found)
    return Drawing("tolerance", "What printed pillars do to the response", _alt(found), figure, vector=True)


def _curves(axes: Any, found: dict[str, Any], arrays: dict[str, Any]) -> None:
    tone, curves = KHZ * arrays["tolerance_hz"], 1e9 * np.asarray(arrays["tolerance_curves"])
    for number, curve in enumerate(curves[1:]):
        axes.semilogy(tone, curve, color=plots.SKY, lw=0.6, alpha=0.7, label="samples" if number == 0 else None)
    axes.semilogy(tone, curves[0], color="black", lw=1.3, label="nominal plate")
    axes.set_xlabel("frequency (kHz)")
    axes.set_ylabel(f"zone rms u_z (n{found['rms_unit']})")
    peak = found["peak_hz"]
    count = len(found["samples"]) - found["lost"]
    axes.set_title(
        f"Wanted mode's peak {KHZ * peak['mean']:.2f} kHz, spread {peak['deviation']:.0f} Hz over {count} plates"
        if peak
        else "No plate kept the wanted mode"
    )
    axes.grid(True)
    axes.legend(fontsize=8, frameon=True, framealpha=0.9, edgecolor="none")


def _peaks(axes: Any, found: dict[str, Any]) -> None:
    samples = [one for one in found["samples"] if one["peak_hz"] is not None]
    nominal, level = found["nominal"], found["confinement_db"]
    axes.plot(
        [KHZ * one["peak_hz"] for one in samples],
        [one["confinement_db"] for one in samples],
        "o",
        ms=4,
        color=plots.BLUE,
        label="samples",
    )
    axes.plot(KHZ * nominal["peak_hz"], nominal["confinement_db"], "*", ms=11, color="black", label="nominal plate")
    axes.axhline(CONFINED_DB, color=plots.GREY, ls="--", lw=0.9, label=f"confined from {CONFINED_DB:.0f} dB")
    axes.axhspan(
        level["mean"] - level["deviation"], level["mean"] + level["deviation"], color=plots.SKY, alpha=0.25, lw=0
    )
    axes.set_xlabel("peak (kHz)")
    axes.set_ylabel("confinement at the peak (dB)")
    axes.set_title(
        f"Confinement {level['mean']:.1f} dB, spread {level['deviation']:.1f}, worst {level['lowest']:.1f} dB"
    )
    axes.grid(True)
    axes.legend(fontsize=8, frameon=True, framealpha=0.9, edgecolor="none")


def _alt(found: dict[str, Any]) -> str:
    peak, level = found["peak_hz"], found["confinement_db"]
    if not peak:
        return f"None of {len(found['samples'])} plates whose pillars differ kept the wanted mode."
    said = (
        f"Response of {len(found['samples'])} plates whose pillars differ: the peak lies at {KHZ * peak['mean']:.2f} kHz "
        f"with a spread of {peak['deviation']:.0f} Hz, nominally at {KHZ * found['nominal']['peak_hz']:.2f} kHz"
    )
    if level:
        said += (
            f"; confinement {level['mean']:.1f} dB with a spread of {level['deviation']:.1f} dB, at worst "
            f"{level['lowest']:.1f} dB"
        )
    return said
