"""Fields on the plate: a mode on the touch face, from the side, in the plane of the pillars, on both kinds of mesh."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import floor, log10
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from pipeline.plots import style
from pipeline.plots.style import ReportFigure
from pipeline.quantity import figure as figure_text
from pipeline.quantity import frequency, level, percentage
from pipeline.records.record import DesignRecord
from pipeline.records.study import StoredCase
from pipeline.units import MM, UM
from solvers.measures.confinement import CONFINED_DB

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.collections import TriMesh

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]
ZONE_EDGE: dict[str, Any] = {"color": "black", "lw": 0.9, "ls": (0, (5, 3))}
KINDS = {"hex": "structured hexahedra", "tet": "tetrahedra (pytetwild)"}


def skin_faces(arrays: dict[str, Any], prefix: str) -> IntArray | None:
    """Faces (m, 3 or 4) of a stored skin, None when it is not stored."""
    return next((arrays[f"{prefix}_{kind}"] for kind in ("quads", "triangles") if f"{prefix}_{kind}" in arrays), None)


def footprint_m(design: DesignRecord) -> float:
    """Largest foot section of a pillar, m; 0 without pillars."""
    return max((pillar.form.footprint_m(pillar.fillet_m) for pillar in design.pillars), default=0.0)


def footprints_mm(design: DesignRecord, centres_m: FloatArray) -> list[FloatArray]:
    """The outline of every pillar's foot, fillet included, about centres (n, 2): each (corners, 2), mm.

    Where rows differ, the centres are those of all pillars.
    """
    if not design.pillar:
        return []
    pillars = design.standing if design.graded_pillars else [design.pillar] * len(centres_m)
    outlines = {id(pillar): pillar.form.outline(pillar.fillet_m) for pillar in pillars}
    return [(centre + outlines[id(pillar)]) / MM for centre, pillar in zip(centres_m, pillars, strict=True)]


def draw_outlines(axes: Axes, design: DesignRecord) -> None:
    """The zone's long sides (dashed) and every pillar's footprint, in mm."""
    from matplotlib.collections import PolyCollection
    from matplotlib.patches import Rectangle

    half, edge, span = design.length_m / 2 / MM, design.width_m / 2 / MM, design.half_span_m / MM
    for middle in design.zone_centres_m or [0.0]:
        for side in (middle / MM - edge, middle / MM + edge):
            axes.plot([-half, half], [side, side], **ZONE_EDGE)
    feet = footprints_mm(design, np.reshape(design.pillar_centres_m, (-1, 2)))
    axes.add_patch(Rectangle((-half, -span), 2 * half, 2 * span, fill=False, ec="#333333", lw=0.6))
    axes.add_collection(PolyCollection(feet, facecolor="none", edgecolor="#333333", linewidth=0.45))


def frame_plate(axes: Axes, design: DesignRecord) -> None:
    """Axes in mm just around the plate."""
    half_x, half_y = design.length_m / 2 / MM, design.half_span_m / MM
    rim = 0.01 * half_x
    axes.set(xlim=(-half_x - rim, half_x + rim), ylim=(-half_y - rim, half_y + rim))
    style.mm_axes(axes)
    axes.spines[:].set_visible(False)
    axes.tick_params(length=2)


def flat_height_in(design: DesignRecord, width_in: float) -> float:
    """Height of a plate drawn `width_in` wide, inches."""
    return float(width_in * design.half_span_m / (design.length_m / 2))


def zone_peak(arrays: dict[str, Any], design: DesignRecord) -> float:
    """Largest |u_z| of the wanted mode on the active touch face, in the mode's own scale."""
    inside = np.abs(arrays["touch_xy"][:, 1]) <= design.width_m / 2 * (1 + 1e-9)
    return float(np.max(np.abs(arrays["touch_uz"][0][inside])))


@dataclass(frozen=True)
class Pillars:
    """Pillars on the stored skin: which faces and which tip nodes belong to which."""

    centres: FloatArray  # (pillars, 2), m
    faces: IntArray  # indices into the skin's faces
    face_owner: IntArray
    tips: IntArray  # indices into the skin's points
    tip_owner: IntArray


def find_pillars(arrays: dict[str, Any], design: DesignRecord) -> Pillars | None:
    """Pillars of the skin by position: above or below the plate, the nearest centre; tips of those above."""
    from scipy.spatial import cKDTree

    faces, centres = skin_faces(arrays, "surface"), np.reshape(design.pillar_centres_m, (-1, 2))
    if faces is None or design.pillar is None or not centres.size:
        return None
    points = arrays["surface_points"]
    top, tree = design.thickness_m, cKDTree(centres)
    heights = np.array([pillar.top_m for pillar in design.standing])
    middles = points[faces].mean(axis=1)
    beside = np.flatnonzero(np.abs(middles[:, 2] - top / 2.0) > top / 2.0 + 1e-3 * heights.min())
    high = np.flatnonzero(points[:, 2] > top + 1e-3 * heights.min())
    owner = tree.query(points[high, :2])[1]
    tip = points[high, 2] > top + 0.98 * heights[owner]
    return Pillars(centres, beside, tree.query(middles[beside, :2])[1], high[tip], owner[tip])


def nice_below(value: float) -> float:
    """Largest of 1, 2, 5 times a power of ten not above a positive value."""
    decade = 10.0 ** floor(log10(value))
    return next(step * decade for step in (5.0, 2.0, 1.0) if step * decade <= value * (1 + 1e-12))


DRAWN_SHARE = 0.3  # of a pillar's height: the largest displacement in the side view
MAX_NEIGHBOURS = 4


def _design(case: StoredCase, arrays: dict[str, Any]) -> DesignRecord | None:
    """The design of a case whose mode on the touch face is stored."""
    return case.record.design if {"touch_xy", "touch_triangles", "touch_uz"} <= arrays.keys() else None


def wanted_hz(case: StoredCase, arrays: dict[str, Any]) -> float | None:
    """Frequency of the mode shown, Hz."""
    kept = arrays.get("surface_frequency_hz")
    if case.record.wanted:
        return case.record.wanted.frequency_hz
    return float(kept[0]) if kept is not None and len(kept) else None


def _at(case: StoredCase, arrays: dict[str, Any]) -> str:
    """The frequency of the mode shown, in words."""
    tone, wanted = wanted_hz(case, arrays), case.record.wanted
    error = wanted.frequency_error if wanted else None
    return "" if tone is None else f" at {frequency(tone, error)}"


def level_text(case: StoredCase) -> str:
    """How well the wanted mode is confined, in words."""
    record = case.record
    if record.confinement_db is None:
        return "confinement has no meaning here (no passive face)"
    driven = "" if record.driven_db is None else f", {level(record.driven_db)} as driven"
    own = level(record.confinement_db, record.wanted.confinement_error_db if record.wanted else None)
    return f"{record.verdict}: {own}{driven} (at least {CONFINED_DB:g} dB counts as confined)"


def _paint(axes: Axes, arrays: dict[str, Any], values: FloatArray, design: DesignRecord) -> TriMesh:
    field = _field(axes, arrays["touch_xy"], arrays["touch_triangles"], values)
    draw_outlines(axes, design)
    frame_plate(axes, design)
    return field


def _field(axes: Axes, points_m: FloatArray, triangles: IntArray, values: FloatArray) -> TriMesh:
    """Values from -1 to 1 over triangles of points (n, 2), smooth between the points."""
    look: dict[str, Any] = {"shading": "gouraud", "cmap": style.SIGNED, "vmin": -1, "vmax": 1}
    field: TriMesh = axes.tripcolor(*(points_m / MM).T, triangles, values, **look)  # type: ignore[call-overload]
    field.set_rasterized(True)
    return field


def touch_face(case: StoredCase, arrays: dict[str, Any]) -> ReportFigure | None:
    """Normal displacement of the wanted mode on the touch face, zone and footprints drawn."""
    design = _design(case, arrays)
    if design is None:
        return None
    figure, axes = style.panels(flat_height_in(design, 6.2) + 1.1)
    field = _paint(axes, arrays, arrays["touch_uz"][0] / zone_peak(arrays, design), design)
    label = "u$_z$ / largest in the zone (no unit)"
    figure.colorbar(field, ax=axes, shrink=0.85, pad=0.01, aspect=22, label=label)
    title = f"Wanted mode on the touch face{_at(case, arrays)}"
    axes.set_title(f"{title}\n{level_text(case)}")
    alt = (
        f"Map of the normal displacement of the wanted mode{_at(case, arrays)} on the touch face of "
        f"{case.case_id}: {level_text(case)}. Dashed lines bound the active zone, small outlines the pillars' feet."
    )
    return ReportFigure("touch_face", title, alt, figure)


def neighbours(case: StoredCase, arrays: dict[str, Any]) -> ReportFigure | None:
    """The kept modes side by side, the wanted one first."""
    design = _design(case, arrays)
    if design is None or len(arrays["touch_uz"]) < 2 or "surface_frequency_hz" not in arrays:
        return None
    shapes = arrays["touch_uz"][:MAX_NEIGHBOURS]
    rows = -(-len(shapes) // 2)
    height = rows * (flat_height_in(design, 3.4) + 0.55)
    figure, grid = style.panels(height, rows, 2, squeeze=False, sharex=True, sharey=True)
    panels = grid.ravel()
    tones = [
        frequency(float(hz), case.record.error_at(float(hz))) for hz in arrays["surface_frequency_hz"][: len(shapes)]
    ]
    for axes, shape, tone in zip(panels, shapes, tones, strict=False):
        _paint(axes, arrays, shape / np.max(np.abs(shape)), design)
        wanted = " (wanted)" if axes is panels[0] else ""
        axes.set_title(f"{tone}{wanted}")
        axes.label_outer()
    for axes in panels[len(shapes) :]:
        axes.set_axis_off()
    alt = (
        f"Normal displacement on the touch face of the wanted mode and its neighbours, at {', '.join(tones)}, "
        "each over its own largest value."
    )
    return ReportFigure("neighbours", "The wanted mode and its neighbours", alt, figure)


def pillars_in_plane(case: StoredCase, arrays: dict[str, Any]) -> ReportFigure | None:
    """In-plane displacement of each pillar's tip, over the zone's largest normal displacement."""
    design = _design(case, arrays)
    if design is None or "surface_u" not in arrays:
        return None
    pillars = find_pillars(arrays, design)
    if pillars is None or not pillars.tips.size:
        return None
    count = np.maximum(1, np.bincount(pillars.tip_owner, minlength=len(pillars.centres)))
    tip = arrays["surface_u"][0][pillars.tips] / zone_peak(arrays, design)
    mean = [np.bincount(pillars.tip_owner, tip[:, i], len(pillars.centres)) / count for i in (0, 1)]
    limit = max(1e-12, float(np.max(np.abs(mean))))
    reach = float(np.abs(pillars.centres[:, 1]).max())
    figure, panels = style.panels(2 * 6.2 * 1.25 * reach / (design.length_m / 2) + 1.5, 2, 1, sharex=True)
    for axes, values, name in zip(panels, mean, "xy", strict=True):
        feet = _feet(axes, design, pillars, values, limit)
        draw_outlines(axes, design)
        frame_plate(axes, design)
        edge = 1.25 * reach / MM
        axes.set(title=f"Tip displacement along {name}", ylim=(-edge, edge))
    panels[0].set_xlabel("")
    label = "displacement of the tips /\nlargest u$_z$ in the zone (no unit)"
    figure.colorbar(feet, ax=list(panels), shrink=0.7, pad=0.01, aspect=30, label=label)
    title = f"In-plane motion of the pillars{_at(case, arrays)}"
    alt = (
        f"Two maps of the pillars of {case.case_id}, coloured by the displacement of their tips along x and along y; the "
        f" largest is {figure_text(limit)} times the zone's largest normal displacement."
    )
    return ReportFigure("pillars_in_plane", title, alt, figure)


def _feet(axes: Axes, design: DesignRecord, pillars: Pillars, values: FloatArray, limit: float) -> Any:
    """Every pillar's footprint, coloured by its value."""
    from matplotlib.collections import PolyCollection

    feet = PolyCollection(footprints_mm(design, pillars.centres), cmap=style.SIGNED)
    feet.set_array(values)
    feet.set_clim(-limit, limit)
    axes.add_collection(feet)
    return feet


def side_view(case: StoredCase, arrays: dict[str, Any]) -> ReportFigure | None:
    """Two side views with displacements exaggerated by a stated factor: across the zone, and along the first row."""
    design = _design(case, arrays)
    faces = skin_faces(arrays, "surface")
    if design is None or "surface_u" not in arrays or faces is None:
        return None
    u = arrays["surface_u"][0] / zone_peak(arrays, design) * UM  # 1 um at the zone's largest
    pillars = find_pillars(arrays, design)
    tallest = design.pillar.top_m if pillars and design.pillar else design.thickness_m
    factor = nice_below(DRAWN_SHARE * tallest / max(1e-30, float(np.max(np.abs(u)))))
    x0, y0 = _cuts(arrays, design, pillars)
    tall = design.thickness_m + 1.3 * tallest * (design.pillar.faces if pillars and design.pillar else 1)
    heights = [7.0 * tall / (2 * half) for half in (design.half_span_m, design.length_m / 2)]
    figure, panels = style.panels(sum(heights) + 2.0, 2, 1, height_ratios=heights)
    across, along = (round(each / MM, 6) for each in (x0, y0))  # a middle is 0, not what rounding leaves of it
    cuts = ((1, x0, f"Across the zone, at x = {across:g} mm"), (0, y0, f"Along the zone, at y = {along:g} mm"))
    for axes, (axis, where, heading) in zip(panels, cuts, strict=True):
        _plate_cut(axes, arrays, design, (axis, where), factor)
        if pillars is not None:
            in_view = np.abs(pillars.centres[pillars.face_owner, 1 - axis] - where) < footprint_m(design) / 2
            _pillars_in_view(axes, arrays["surface_points"] + factor * u, faces[pillars.faces[in_view]], axis)
        axes.autoscale_view(scalex=False)
        axes.margins(y=0.08)
        axes.set_title(heading)
        style.mm_axes(axes, "xy"[axis], "z")
    for side in (-1, 1):
        panels[0].axvline(side * design.width_m / 2 / MM, **ZONE_EDGE)
    times = f"{factor:,.0f}".replace(",", "\u202f")
    title = f"Side views{_at(case, arrays)}, displacements drawn {times} times as large"
    figure.suptitle(f"{title} (zone's largest u$_z$ = 1 µm)", fontsize=9, x=0.01, ha="left")
    alt = (
        f"Plate and pillars of {case.case_id} seen along x and along y in the wanted mode; displacements are exaggerated "
        f"{factor:.0f} times for 1 micrometre at the zone's largest normal displacement. Dashed lines bound the active zone."
    )
    return ReportFigure("side_view", title, alt, figure)


def _cuts(arrays: dict[str, Any], design: DesignRecord, pillars: Pillars | None) -> tuple[float, float]:
    """Where to look: the pillar column nearest an antinode of the zone, the first row on the positive side."""
    uz, xy = np.abs(arrays["touch_uz"][0]), arrays["touch_xy"]
    inner = (np.abs(xy[:, 0]) < 0.3 * design.length_m) & (np.abs(xy[:, 1]) < design.width_m / 2)
    antinode = float(xy[inner][np.argmax(uz[inner]), 0]) if inner.any() else 0.0
    if pillars is None:
        return antinode, 0.0
    columns = np.unique(pillars.centres[:, 0])
    rows = pillars.centres[:, 1]
    return float(columns[np.argmin(np.abs(columns - antinode))]), float(rows[rows > 0].min())


def _plate_cut(axes: Axes, arrays: dict[str, Any], design: DesignRecord, cut: tuple[int, float], factor: float) -> None:
    """The plate cut along a line, lifted by its displacement."""
    half = design.half_span_m if cut[0] else design.length_m / 2
    line = np.linspace(-half, half, 400)
    lift = _along(arrays, line, cut) / zone_peak(arrays, design) * UM * factor
    axes.fill_between(line / MM, lift / MM, (lift + design.thickness_m) / MM, color="#B9C4CE", lw=0.4, ec="#44525E")
    axes.set_xlim(-1.03 * half / MM, 1.03 * half / MM)


def _pillars_in_view(axes: Axes, points_m: FloatArray, faces: IntArray, axis: int) -> None:
    from matplotlib.collections import PolyCollection

    outlines = points_m[faces][:, :, [axis, 2]] / MM
    axes.add_collection(PolyCollection(list(outlines), facecolor=style.BLUE, edgecolor=style.BLUE, lw=0.3))


def _along(arrays: dict[str, Any], line: FloatArray, cut: tuple[int, float]) -> FloatArray:
    """u_z of the wanted mode on the touch face along a straight line: exact where triangle edges cross it, linear between."""
    axis, where = cut
    triangles = arrays["touch_triangles"]
    edges = np.concatenate([triangles[:, pair] for pair in ([0, 1], [1, 2], [2, 0])])
    off = arrays["touch_xy"][:, 1 - axis] - where
    first, second = edges[off[edges[:, 0]] * off[edges[:, 1]] <= 0].T
    apart = off[first] - off[second]
    share = np.divide(off[first], apart, out=np.zeros_like(apart), where=apart != 0)
    place, value = arrays["touch_xy"][:, axis], arrays["touch_uz"][0]
    at = np.concatenate([place[first] + share * (place[second] - place[first]), place[second][apart == 0]])
    field = np.concatenate([value[first] + share * (value[second] - value[first]), value[second][apart == 0]])
    order = np.argsort(at, kind="stable")
    return np.asarray(np.interp(line, at[order], field[order]))


def mode_on_both_meshes(case: StoredCase, arrays: dict[str, Any]) -> ReportFigure | None:
    """The wanted mode's normal displacement on the touch face: hexahedra beside tetrahedra, the same part of the plate."""
    design = case.record.design
    if not design or not {"tet_points", "tet_triangles", "tet_u", "touch_uz"} <= arrays.keys():
        return None
    points, faces, uz = arrays["tet_points"], arrays["tet_triangles"], arrays["tet_u"][:, 2]
    faces = faces[np.all(np.abs(points[faces][:, :, 2]) < 1e-3 * design.thickness_m, axis=1)]
    if not faces.size:
        return None
    box = np.array([points[faces].min(axis=(0, 1))[:2], points[faces].max(axis=(0, 1))[:2]]) / MM
    uz = _aligned(arrays, points, uz, faces)
    aspect = (box[1, 1] - box[0, 1]) / (box[1, 0] - box[0, 0])
    figure, panels = style.panels(3.3 * aspect + 1.5, 1, 2, sharex=True, sharey=True)
    hexahedra = (arrays["touch_xy"], arrays["touch_triangles"], arrays["touch_uz"][0] / zone_peak(arrays, design))
    both = (hexahedra, (points[:, :2], faces, uz))
    compared = case.record.held("tet_modes")
    tones = (compared.hex_frequency_hz, compared.frequency_hz) if compared else (None, None)
    for axes, (flat, cells, values), kind, tone in zip(panels, both, KINDS.values(), tones, strict=True):
        field = _field(axes, flat, cells, values)
        axes.triplot(*(flat / MM).T, cells, color="black", lw=0.1, alpha=0.3, rasterized=True)
        axes.axhline(design.width_m / 2 / MM, **ZONE_EDGE)
        axes.set(xlim=box[:, 0], ylim=box[:, 1], title=kind + (f"\n{frequency(tone)}" if tone else ""))
        style.mm_axes(axes)
        axes.label_outer()
    figure.colorbar(field, ax=list(panels), shrink=0.8, pad=0.01, label="u$_z$ / largest in the zone")
    text = f"; frequencies differ by {percentage(compared.relative_difference)}" if compared else ""
    alt = f"Normal displacement of {case.case_id}'s wanted mode on the touch face by hexahedra and by tetrahedra{text}."
    return ReportFigure("mode_on_both_meshes", "The wanted mode by hexahedra and by tetrahedra", alt, figure)


def _aligned(arrays: dict[str, Any], points: FloatArray, uz: FloatArray, faces: IntArray) -> FloatArray:
    """The tetrahedral field over its own largest value, in the sign of the other one (a mode's sign is free)."""
    from scipy.interpolate import NearestNDInterpolator

    nodes = np.unique(faces)
    other = NearestNDInterpolator(arrays["touch_xy"], arrays["touch_uz"][0])(points[nodes, :2])
    sign = 1.0 if float(other @ uz[nodes]) >= 0 else -1.0
    return sign * uz / float(np.max(np.abs(uz[nodes])))


LOOK = {"shading": "nearest", "rasterized": True}


def panels(count: int, width_m: float | None) -> tuple[Any, list[Any]]:
    """Return a figure and axes for fields one below another, with the zone's borders where its width is known."""
    figure, grid = style.panels(2.4 * count + 0.4, count, 1, squeeze=False)
    sides = () if width_m is None else (-width_m / 2.0, width_m / 2.0)
    for axes in grid[:, 0]:
        for y_m in sides:
            axes.axhline(y_m / MM, color="black", lw=0.6, ls="--")
    return figure, list(grid[:, 0])


def field(axes: Any, x_m: Sequence[float], y_m: Sequence[float], values: Any, label: str, title: str) -> None:
    """Draw a field over places, x first; nothing where it is None."""
    shown = np.ma.masked_invalid(np.array(values, dtype=float).T)
    image = axes.pcolormesh(np.array(x_m) / MM, np.array(y_m) / MM, shown, cmap=style.QUALITY, **LOOK)
    style.mm_axes(axes)
    axes.set_title(title)
    axes.set_anchor("W")
    axes.figure.colorbar(image, cax=axes.inset_axes((1.03, 0.0, 0.03, 1.0)), label=label)
