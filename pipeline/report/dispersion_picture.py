"""The dispersion diagrams of a study's case: its bands with the target mode among them, and its complex bands."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from pipeline.plots import style
from pipeline.plots.style import ReportFigure
from pipeline.quantity import percentage
from pipeline.questions.attenuation import AttenuationResult
from pipeline.questions.bands import LEGEND_COLUMNS, MARKS, WHITE, BandsResult
from pipeline.records.study import StoredCase
from pipeline.units import KHZ

if TYPE_CHECKING:
    from matplotlib.axes import Axes

ZOOM = 1.6  # of the bending frequency at M


def shear_speed(case: StoredCase) -> float | None:
    """Speed of shear waves in the plate's material, sqrt(G/rho), m/s; None when the input does not tell it."""
    stored = case.read("input.json") or {}
    material = ((stored.get("case") or stored).get("design") or {}).get("material") or {}
    try:
        shear = material["young_pa"] / (2 * (1 + material["poisson"]))
        return float(np.sqrt(shear / material["density_kg_m3"]))
    except (KeyError, TypeError, ZeroDivisionError):
        return None


def dispersion(case: StoredCase, arrays: dict[str, Any]) -> ReportFigure | None:
    """Bands with the complete gaps shaded; beside it the low bands with the bending ones marked at M."""
    bands = case.record.of(BandsResult)
    if not bands or not bands.points:
        return None
    bending = bands.bending_at_m_hz
    figure = style.new_figure(style.WIDTH_IN, 4.4)
    panels = figure.subplots(1, 2, width_ratios=[1.15, 1]) if bending else [figure.subplots()]
    for axes in panels:
        bands.draw_bands(axes, "structured hexahedra" if case.record.answers.get("tet_bands") else "bands")
        _tetrahedra(axes, case, bands)
    _normalised_axis(panels[0], case)
    panels[0].set_title(_gap_title(bands))
    if bending:
        _bending(panels[1], case, bands, bending)
    _legend(figure, panels[0])
    return ReportFigure("dispersion", "Dispersion diagram of the unit cell", _alt(case, bands), figure, vector=True)


def _tetrahedra(axes: Axes, case: StoredCase, bands: BandsResult) -> None:
    label, places = "tetrahedra (pytetwild)", bands.distance_per_m
    tetrahedra: BandsResult | None = case.record.answers.get("tet_bands")
    for point in tetrahedra.points if tetrahedra else []:
        tones = np.array(point.frequencies_hz) / KHZ
        for x in (x for x, p in zip(places, bands.points, strict=True) if p.label == point.label):
            axes.plot(np.full(tones.size, x), tones, "o", mfc="none", color=style.VERMILION, ms=4.5, label=label)
            label = ""


def _gap_title(bands: BandsResult) -> str:
    gap = bands.widest_gap
    if not gap:
        return f"No complete gap {bands.where_gaps_are_known}"
    return f"Gap: bands {gap.lower_band} to {gap.upper_band}, {percentage(gap.relative_width, gap.width_error)} wide"


def _normalised_axis(axes: Axes, case: StoredCase) -> None:
    speed, design = shear_speed(case), case.record.design
    if not speed or design is None or design.pitch_x_m is None:
        return
    scale: Any = KHZ * design.pitch_x_m / speed
    axes.spines["right"].set_visible(True)
    right = axes.secondary_yaxis("right", functions=(lambda f: f * scale, lambda f: f / scale))
    right.set_ylabel("f a / c$_t$ (no unit)")


def _bending(axes: Axes, case: StoredCase, bands: BandsResult, bending: list[float]) -> None:
    points, tones = bands.points, np.array(bending) / KHZ
    axes.set(ylim=(0, ZOOM * tones.max()), title="Pillar bending bands")
    corner = next(x for x, point in zip(bands.distance_per_m, points, strict=True) if point.label == "M")
    axes.plot([corner] * len(bending), tones, "s", color=style.GREEN, ms=6, mfc="none", mew=1.6)
    text = f"bending at M\n{_listed(bands)}"
    look: dict[str, Any] = {"xytext": (-8, -34), "textcoords": "offset points", "ha": "right", "color": style.GREEN}
    line = {"arrowstyle": "-", "color": style.GREEN, "lw": 0.8}
    axes.annotate(text, (corner, tones.min()), bbox=WHITE, arrowprops=line, **look)
    if target := case.record.target:
        axes.axhline(target.frequency_hz / KHZ, color=style.PURPLE, lw=1.0, ls="--", label="target mode of the plate")


def _listed(bands: BandsResult) -> str:
    return " and ".join(dict.fromkeys(bands.bending_texts))


def _legend(figure: Any, axes: Axes) -> None:
    handles: dict[str, Any] = {}
    for panel in figure.axes:
        handles |= dict(zip(*reversed(panel.get_legend_handles_labels()), strict=True))
    if len(handles) > 1:
        style.legend_below(figure, handles.values(), handles.keys(), LEGEND_COLUMNS, 8)


def _alt(case: StoredCase, bands: BandsResult) -> str:
    gap, bending = bands.widest_gap, bands.bending_at_m_hz
    edges = (
        f"the widest complete gap, shaded, lies from {gap.interval} (bands {gap.lower_band} and {gap.upper_band})"
        if gap
        else f"no complete gap opens {bands.where_gaps_are_known}"
    )
    kinds = {name for point in bands.points for name in point.plate_polarisation or ()}
    names_text = ", ".join(name for name in MARKS if name in kinds)
    marked = f"; waves are marked as {names_text}" if names_text else ""
    at_m = f"; the bending bands meet M at {_listed(bands)}" if bending else ""
    return f"Frequency in kHz against wavevector for the unit cell of {case.case_id}: {edges}{at_m}{marked}."


def attenuation(case: StoredCase, arrays: dict[str, Any]) -> ReportFigure | None:
    """Draw decay per row, wavenumbers across the rows and the power that passes them."""
    answer, target = case.record.of(AttenuationResult), case.record.target
    return answer.complex_bands(target.frequency_hz if target else None) if answer else None
