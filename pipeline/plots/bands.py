"""The dispersion diagram: frequency against wavevector along the edge of the irreducible Brillouin zone."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from pipeline.plots import style
from pipeline.plots.plate import FloatArray
from pipeline.plots.style import ReportFigure
from pipeline.quantity import percentage
from pipeline.records.record import BandPoint, BandsRecord
from pipeline.records.study import StoredCase
from pipeline.units import KHZ
from solvers.waves.brillouin import Path

if TYPE_CHECKING:
    from matplotlib.axes import Axes

NAMES = {"G": "Γ"}
LABEL = {"ha": "center", "va": "center", "fontsize": 8, "clip_on": True}
WHITE = {"facecolor": "white", "edgecolor": "none", "alpha": 0.8, "pad": 1.0}
MAX_COLUMNS = 3
ZOOM = 1.6  # of the bending frequency at M
PILLAR = "pillar"
# colour, marker and size of the plate's polarisation: told apart in grey too
POLARISATIONS = {
    "flexural": (style.BLUE, "o", 2.8),
    "shear": (style.ORANGE, "s", 2.8),
    "longitudinal": (style.PURPLE, "^", 3.4),
}


def path_length(points: list[BandPoint]) -> FloatArray:
    """Distance along the path at each wavevector, 1/m."""
    return Path(np.array([(point.kx_per_m, point.ky_per_m) for point in points], dtype=float), ()).arc


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
    bands = case.record.bands
    if not bands or not bands.points:
        return None
    bending = bands.bending_at_m_hz
    figure = style.new_figure(style.WIDTH_IN, 4.4)
    panels = figure.subplots(1, 2, width_ratios=[1.15, 1]) if bending else [figure.subplots()]
    for axes in panels:
        draw_bands(axes, bands, "structured hexahedra" if case.record.tet_bands else "bands")
        _tetrahedra(axes, case, bands)
    _normalised_axis(panels[0], case)
    panels[0].set_title(_gap_title(bands))
    if bending:
        _bending(panels[1], case, bands, bending)
    _legend(figure, panels[0])
    return ReportFigure("dispersion", "Dispersion diagram of the unit cell", _alt(case, bands), figure, vector=True)


def draw_bands(axes: Axes, bands: BandsRecord, label: str = "bands") -> None:
    """Bands over the path, the waves marked by their polarisation where it is known, the complete gaps shaded."""
    points = bands.points
    s = path_length(points)
    values = np.array([point.frequencies_hz for point in points]) / KHZ
    if all(point.plate_polarisation for point in points):
        axes.plot(s, values, color="#C8C8C8", lw=0.7)
        _polarised(axes, s, values, points)
    else:
        axes.plot(s, values, color=style.BLUE, lw=1.0, marker=".", ms=2.2)
        axes.lines[0].set_label(label)
    marks = [(x, NAMES.get(p.label, p.label)) for x, p in zip(s, points, strict=True) if p.label]
    axes.set_xticks([x for x, _ in marks], [name for _, name in marks])
    axes.grid(True, axis="x")
    span = s[-1] or 1.0  # a lone point has none
    axes.set(xlim=(-0.02 * span, 1.02 * span), ylim=(0, 1.04 * values.max()))  # room for the marks at both ends
    axes.set(xlabel="wavevector along the path (to scale)", ylabel="frequency (kHz)")
    for gap in bands.gaps:
        low, high = gap.lower_hz / KHZ, gap.upper_hz / KHZ
        axes.axhspan(low, high, color=style.ORANGE, alpha=0.3, lw=0)
        text = f"complete gap {gap.interval}"
        axes.text(0.5, (low + high) / 2, text, transform=axes.get_yaxis_transform(), bbox=WHITE, **LABEL)  # type: ignore[arg-type]


def _polarised(axes: Axes, s: FloatArray, values: FloatArray, points: list[BandPoint]) -> None:
    """A mark for every wave by how it moves the plate, hollow where the pillar has most of its kinetic energy."""
    plate, whole = (
        np.array([getattr(point, key) for point in points]) for key in ("plate_polarisation", "polarisation")
    )
    x, hollow = np.broadcast_to(s[:, None], values.shape), whole == PILLAR
    for name, (color, marker, size) in POLARISATIONS.items():
        for here, fill, label in ((~hollow, color, name), (hollow, "white", f"{name}, mostly in the pillar")):
            here = here & (plate == name)
            if here.any():
                axes.plot(x[here], values[here], marker, color=color, mfc=fill, ms=size, mew=0.6, label=label)


def _tetrahedra(axes: Axes, case: StoredCase, bands: BandsRecord) -> None:
    label, places = "tetrahedra (pytetwild)", path_length(bands.points)
    for point in case.record.tet_bands.points if case.record.tet_bands else []:
        tones = np.array(point.frequencies_hz) / KHZ
        for x in (x for x, p in zip(places, bands.points, strict=True) if p.label == point.label):
            axes.plot(np.full(tones.size, x), tones, "o", mfc="none", color=style.VERMILION, ms=4.5, label=label)
            label = ""


def _gap_title(bands: BandsRecord) -> str:
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


def _bending(axes: Axes, case: StoredCase, bands: BandsRecord, bending: list[float]) -> None:
    points, tones = bands.points, np.array(bending) / KHZ
    axes.set(ylim=(0, ZOOM * tones.max()), title="Pillar bending bands")
    corner = next(x for x, point in zip(path_length(points), points, strict=True) if point.label == "M")
    axes.plot([corner] * len(bending), tones, "s", color=style.GREEN, ms=6, mfc="none", mew=1.6)
    text = f"bending at M\n{_listed(bands)}"
    look: dict[str, Any] = {"xytext": (-8, -34), "textcoords": "offset points", "ha": "right", "color": style.GREEN}
    line = {"arrowstyle": "-", "color": style.GREEN, "lw": 0.8}
    axes.annotate(text, (corner, tones.min()), bbox=WHITE, arrowprops=line, **look)
    if wanted := case.record.wanted:
        axes.axhline(wanted.frequency_hz / KHZ, color=style.PURPLE, lw=1.0, ls="--", label="wanted mode of the plate")


def _listed(bands: BandsRecord) -> str:
    return " and ".join(dict.fromkeys(bands.bending_texts))


def _legend(figure: Any, axes: Axes) -> None:
    handles: dict[str, Any] = {}
    for panel in figure.axes:
        handles |= dict(zip(*reversed(panel.get_legend_handles_labels()), strict=True))
    if len(handles) > 1:
        style.legend_below(figure, handles.values(), handles.keys(), MAX_COLUMNS, 8)


def _alt(case: StoredCase, bands: BandsRecord) -> str:
    gap, bending = bands.widest_gap, bands.bending_at_m_hz
    edges = (
        f"the widest complete gap, shaded, lies from {gap.interval} (bands {gap.lower_band} and {gap.upper_band})"
        if gap
        else f"no complete gap opens {bands.where_gaps_are_known}"
    )
    kinds = {name for point in bands.points for name in point.plate_polarisation or ()}
    names_text = ", ".join(name for name in POLARISATIONS if name in kinds)
    marked = f"; waves are marked as {names_text}" if names_text else ""
    at_m = f"; the bending bands meet M at {_listed(bands)}" if bending else ""
    return f"Frequency in kHz against wavevector for the unit cell of {case.case_id}: {edges}{at_m}{marked}."
