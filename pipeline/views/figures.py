"""Figures of a result's document in matplotlib axes: axes in, axes out."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from geometry.files import written_whole
from pipeline.plots import style
from solvers.measures.levels import CONFINED_DB
from solvers.waves.brillouin import Path as WavePath

Document = dict[str, Any]


def axes() -> Any:
    """New axes of a new figure in the program's style."""
    return style.new_figure(style.WIDTH_IN, 3.6).subplots()


def draw(kind: str, document: Document, ax: Any = None) -> Any:
    """The figure of a document; ValueError for a kind that has none."""
    if kind not in FIGURES:
        raise ValueError(f"{kind}: has no figure")
    with style.style():
        ax = axes() if ax is None else ax
        FIGURES[kind](ax, document)
        return ax


def write(kind: str, document: Document, place: Path) -> None:
    """The figure as a file, whole or not at all, in the format of its ending (png, pdf or svg)."""
    figure = draw(kind, document).figure
    with style.style(), written_whole(place) as temporary:
        figure.savefig(temporary, format=place.suffix.lstrip(".").lower() or "png", dpi=150, bbox_inches="tight")


def bands(ax: Any, document: Document) -> None:
    """Dispersion diagram, gaps shaded."""
    points = document["points"]
    distance = WavePath(np.array([(point["kx_per_m"], point["ky_per_m"]) for point in points]), ()).arc
    ax.plot(distance, np.array([point["frequencies_hz"] for point in points]) / 1e3, color=style.BLUE, lw=1.1)
    for gap in document["gaps"]:
        ax.axhspan(gap["lower_hz"] / 1e3, gap["upper_hz"] / 1e3, color=style.GREEN, alpha=0.2)
    marks = [(at, point["label"]) for at, point in zip(distance, points, strict=True) if point["label"]]
    ax.set_xticks([at for at, _ in marks], ["Γ" if label == "G" else label for _, label in marks])
    for at, _ in marks:
        ax.axvline(at, color=style.GREY, lw=0.6)
    ax.set(xlim=(distance[0], distance[-1] or 1.0), ylim=(0.0, None), xlabel="wavevector", ylabel="frequency (kHz)")


def modes(ax: Any, document: Document) -> None:
    """Confinement of each mode over its frequency, the wanted mode marked; frequencies alone where nothing is passive."""
    khz = np.array([mode["frequency_hz"] for mode in document["modes"]]) / 1e3
    level = np.array([mode["confinement_db"] for mode in document["modes"]], dtype=float)
    if not np.isfinite(level).any():
        ax.plot(np.arange(1, len(khz) + 1), khz, "o", color=style.BLUE, ms=4)
        ax.set(xlabel="mode", ylabel="frequency (kHz)")
        return
    ax.plot(khz, level, "o", color=style.BLUE, ms=4)
    ax.axhline(CONFINED_DB, color=style.GREEN, lw=0.9, ls="--", label=f"confined from {CONFINED_DB:g} dB")
    wanted = document.get("wanted") or {}
    if wanted.get("frequency_hz") is not None and wanted.get("confinement_db") is not None:
        at = wanted["frequency_hz"] / 1e3, wanted["confinement_db"]
        ax.plot(*at, "*", color=style.VERMILION, ms=11, label=f"wanted mode ({wanted['status']})")
    ax.legend()
    ax.set(xlabel="frequency (kHz)", ylabel="confinement (dB)")


def attenuation(ax: Any, document: Document) -> None:
    """Decay per row of the least attenuated flexural wave over frequency."""
    khz = [point["frequency_hz"] / 1e3 for point in document["points"]]
    ax.plot(khz, np.array([point["db_per_row"] for point in document["points"]], dtype=float), color=style.BLUE)
    ax.set(xlabel="frequency (kHz)", ylabel="decay per row (dB)")


def response(ax: Any, document: Document) -> None:
    """Rms of zone and passive face per volt over frequency."""
    khz = np.array(document["frequency_hz"]) / 1e3
    ax.semilogy(khz, 1e9 * np.array(document["zone_rms_m_per_V"]), color=style.BLUE, label="active zone")
    if document["passive_rms_m_per_V"] is not None:
        passive = 1e9 * np.array(document["passive_rms_m_per_V"])
        ax.semilogy(khz, passive, color=style.ORANGE, ls="--", label="passive face")
    ax.legend()
    ax.set(xlabel="frequency (kHz)", ylabel="rms of $u_z$ (nm/V)")


def predesign(ax: Any, document: Document) -> None:
    """Frequencies of zone and pillar by each theory."""
    values = {
        f"{part}: {name.removesuffix('_hz').replace('_', ' ')}": value / 1e3
        for part in ("zone", "pillar")
        for name, value in (document.get(part) or {}).items()
        if name.endswith("_hz") and value is not None
    }
    ax.barh(list(values), list(values.values()), color=style.BLUE)
    ax.set(xlabel="frequency (kHz)")


def tolerance(ax: Any, document: Document) -> None:
    """Peaks of the samples against their driven confinement."""
    known = [sample for sample in document["samples"] if sample["peak_hz"] is not None]
    levels = np.array([sample["confinement_db"] for sample in known], dtype=float)
    ax.plot([sample["peak_hz"] / 1e3 for sample in known], levels, "o", color=style.BLUE, ms=4)
    ax.set(xlabel="peak (kHz)", ylabel="driven confinement (dB)")


def compare(ax: Any, document: Document) -> None:
    """Relative differences of two designs as bars, the largest last and so on top."""
    known = sorted((row for row in document["rows"] if row["difference"]), key=lambda row: abs(row["difference"]))
    ax.figure.set_size_inches(style.WIDTH_IN, 1.2 + 0.28 * max(1, len(known)))
    ax.barh([row["quantity"] for row in known], [100.0 * row["difference"] for row in known], color=style.BLUE)
    ax.axvline(0.0, color=style.GREY, lw=0.8)
    ax.set(xlabel="B over A, %")


FIGURES: dict[str, Callable[[Any, Document], None]] = {
    each.__name__: each for each in (modes, bands, attenuation, response, predesign, tolerance, compare)
}
