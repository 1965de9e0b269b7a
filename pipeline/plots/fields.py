"""Fields on the plate: modes on the touch face, for both kinds of mesh."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from pipeline.plots import style
from pipeline.plots.style import ReportFigure
from pipeline.quantity import MM, frequency, level, percentage
from pipeline.records.record import DesignRecord
from pipeline.records.study import StoredCase
from solvers.measures.confinement import CONFINED_DB

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.collections import TriMesh

    from solvers.fem.surface import Skin

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]
ZONE_EDGE: dict[str, Any] = {"color": "black", "lw": 0.9, "ls": (0, (5, 3))}
KINDS = {"hex": "structured hexahedra", "tet": "tetrahedra (pytetwild)"}
ROUNDED = 1e-6  # of places stored in single precision: those at the end of a zone may lie beyond it


def skin_faces(arrays: dict[str, Any], prefix: str) -> IntArray | None:
    """Return the faces (m, 3 or 4) of a stored surface, None if not stored."""
    return next((arrays[f"{prefix}_{kind}"] for kind in ("quads", "triangles") if f"{prefix}_{kind}" in arrays), None)


def footprints_mm(design: DesignRecord, centres_m: FloatArray) -> list[FloatArray]:
    """Return the outline of every foot, fillet included, around centres (n, 2): each (corners, 2), mm.

    If rows differ, the centres are those of all pillars.
    """
    if not design.pillar:
        return []
    pillars = design.standing if design.graded_pillars else [design.pillar] * len(centres_m)
    outlines = {id(pillar): pillar.form.outline(pillar.fillet_m) for pillar in pillars}
    return [(centre + outlines[id(pillar)]) / MM for centre, pillar in zip(centres_m, pillars, strict=True)]


def draw_outlines(axes: Axes, design: DesignRecord) -> None:
    """Draw the zone's sides within the plate (dashed) and every pillar's footprint, in mm."""
    from matplotlib.collections import LineCollection, PolyCollection
    from matplotlib.patches import Rectangle

    edge, (x0, x1, y0, y1) = design.width_m / 2 / MM, np.array(design.ends_m) / MM
    reach = design.length_m / 2 / MM
    for x, y in design.zone_places_m / MM:
        for side in (y - edge, y + edge):
            axes.plot([x - reach, x + reach], [side, side], **ZONE_EDGE)
        for end in (x - reach, x + reach):
            if x0 + 1e-9 * reach < end < x1 - 1e-9 * reach:
                axes.plot([end, end], [y - edge, y + edge], **ZONE_EDGE)
    feet = footprints_mm(design, np.reshape(design.pillar_centres_m, (-1, 2)))
    if design.rims_m:
        sides = [np.reshape(side, (2, 2)) / MM for side in design.rims_m]
        axes.add_collection(LineCollection(sides, colors="#333333", lw=0.6))
    else:
        axes.add_patch(Rectangle((x0, y0), x1 - x0, y1 - y0, fill=False, ec="#333333", lw=0.6))
    axes.add_collection(PolyCollection(feet, facecolor="none", edgecolor="#333333", linewidth=0.45))
    _draw_supports(axes, design)


def _draw_supports(axes: Axes, design: DesignRecord) -> None:
    """Draw held edges as thick lines and discs as circles, dotted where they yield; a mass alone is a full disc."""
    from matplotlib.patches import Circle

    for support in design.supports:
        dashes = ":" if support.is_elastic else "--" if support.kind == "simple" else "-"
        if support.edge:
            axes.plot(*np.array(design.edge_m(support.edge)) / MM, color="black", lw=3.0, ls=dashes, clip_on=False)
        else:
            at, is_mass = np.array(support.at_m) / MM, support.kind == "mass"
            axes.add_patch(Circle(tuple(at), support.radius_m / MM, fill=is_mass, color="black", lw=1.2, ls=dashes))


def frame_plate(axes: Axes, design: DesignRecord) -> None:
    """Set the axes in mm to the bounds of the plate."""
    x0, x1, y0, y1 = np.array(design.ends_m) / MM
    rim = 0.005 * (x1 - x0)
    axes.set(xlim=(x0 - rim, x1 + rim), ylim=(y0 - rim, y1 + rim))
    style.mm_axes(axes)
    axes.spines[:].set_visible(False)
    axes.tick_params(length=2)


def flat_height_in(design: DesignRecord, width_in: float) -> float:
    """Return the height of a plate drawn `width_in` wide, inches."""
    return float(width_in * design.half_span_m / design.half_length_m)


def zone_peak(arrays: dict[str, Any], design: DesignRecord) -> float:
    """Return the largest |u_z| of the target mode on the active touch face, in the scale of the mode."""
    return _largest(arrays["touch_xy"], arrays["touch_uz"][0], design)


def _largest(points_m: FloatArray, uz: FloatArray, design: DesignRecord) -> float:
    """Largest |u_z| at those of the points (n, 2) that lie on the zone."""
    places = np.abs(points_m - np.array(design.centre_m))
    inside = (places <= np.array([design.length_m, design.width_m]) / 2 * (1 + ROUNDED)).all(axis=1)
    return float(np.max(np.abs(uz[inside])))


MAX_NEIGHBOURS = 4


def moving_design(case: StoredCase, arrays: dict[str, Any]) -> DesignRecord | None:
    """Return the design of a case with a stored mode on the touch face."""
    return case.record.design if {"touch_xy", "touch_triangles", "touch_uz"} <= arrays.keys() else None


def target_hz(case: StoredCase, arrays: dict[str, Any]) -> float | None:
    """Return the frequency of the mode shown, Hz."""
    kept = arrays.get("surface_frequency_hz")
    if case.record.target:
        return case.record.target.frequency_hz
    return float(kept[0]) if kept is not None and len(kept) else None


def mode_at(case: StoredCase, arrays: dict[str, Any]) -> str:
    """Return the frequency of the mode shown, in words."""
    tone, target = target_hz(case, arrays), case.record.target
    error = target.frequency_error if target else None
    return "" if tone is None else f" at {frequency(tone, error)}"


def level_text(case: StoredCase) -> str:
    """Describe the confinement of the target mode in words."""
    record = case.record
    if record.confinement_db is None:
        return "confinement is undefined (no passive face)"
    driven = "" if record.driven_db is None else f", {level(record.driven_db, record.driven_error_db)} as driven"
    own = level(record.confinement_db, record.target.confinement_error_db if record.target else None)
    return f"{record.verdict}: {own}{driven} (confined from {CONFINED_DB:g} dB upwards)"


def _paint(axes: Axes, arrays: dict[str, Any], values: FloatArray, design: DesignRecord) -> TriMesh:
    field = _field(axes, arrays["touch_xy"], arrays["touch_triangles"], values)
    draw_outlines(axes, design)
    frame_plate(axes, design)
    return field


def _field(axes: Axes, points_m: FloatArray, triangles: IntArray, values: FloatArray) -> TriMesh:
    """Draw values from -1 to 1 over triangles of points (n, 2), interpolated between the points."""
    look: dict[str, Any] = {"shading": "gouraud", "cmap": style.SIGNED, "vmin": -1, "vmax": 1}
    field: TriMesh = axes.tripcolor(*(points_m / MM).T, triangles, values, **look)  # type: ignore[call-overload]
    field.set_rasterized(True)
    return field


def touch_face(case: StoredCase, arrays: dict[str, Any]) -> ReportFigure | None:
    """Draw the normal displacement of the target mode on the touch face, with zone and footprints."""
    design = moving_design(case, arrays)
    if design is None:
        return None
    figure, axes = style.panels(flat_height_in(design, 6.2) + 1.1)
    field = _paint(axes, arrays, arrays["touch_uz"][0] / zone_peak(arrays, design), design)
    label = "u$_z$ / maximum in the zone"
    figure.colorbar(field, ax=axes, shrink=0.85, pad=0.01, aspect=22, label=label)
    title = f"Target mode on the touch face{mode_at(case, arrays)}"
    axes.set_title(f"{title}\n{level_text(case)}")
    alt = (
        f"Map of the normal displacement of the target mode{mode_at(case, arrays)} on the touch face of "
        f"{case.case_id}: {level_text(case)}. Dashed lines bound the active zone; small outlines are the pillars' feet."
    )
    return ReportFigure("touch_face", title, alt, figure)


def neighbours(case: StoredCase, arrays: dict[str, Any]) -> ReportFigure | None:
    """Draw the stored modes, the target mode first."""
    design = moving_design(case, arrays)
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
        target = " (target)" if axes is panels[0] else ""
        axes.set_title(f"{tone}{target}")
        axes.label_outer()
    for axes in panels[len(shapes) :]:
        axes.set_axis_off()
    alt = (
        f"Normal displacement on the touch face of the target mode and its neighbours, at {', '.join(tones)}, "
        "each relative to its own maximum."
    )
    return ReportFigure("neighbours", "The target mode and its neighbours", alt, figure)


def mode_on_both_meshes(case: StoredCase, arrays: dict[str, Any]) -> ReportFigure | None:
    """Draw the target mode's normal displacement on the touch face for hexahedra and for tetrahedra."""
    design = case.record.design
    if not design or not {"tet_points", "tet_triangles", "tet_u", "touch_uz"} <= arrays.keys():
        return None
    points, faces, uz = arrays["tet_points"], arrays["tet_triangles"], arrays["tet_u"][:, 2]
    faces = faces[np.all(np.abs(points[faces][:, :, 2]) < 1e-3 * design.thickness_m, axis=1)]
    if not faces.size:
        return None
    box = np.array([points[faces].min(axis=(0, 1))[:2], points[faces].max(axis=(0, 1))[:2]]) / MM
    uz = _aligned(arrays, points, uz, np.unique(faces), design)
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
    figure.colorbar(field, ax=list(panels), shrink=0.8, pad=0.01, label="u$_z$ / maximum in the zone")
    text = f"; frequencies differ by {percentage(compared.relative_difference)}" if compared else ""
    alt = f"Normal displacement of {case.case_id}'s target mode on the touch face: hexahedra and tetrahedra{text}."
    return ReportFigure("mode_on_both_meshes", "Target mode with hexahedra and with tetrahedra", alt, figure)


def _aligned(
    arrays: dict[str, Any], points: FloatArray, uz: FloatArray, nodes: IntArray, design: DesignRecord
) -> FloatArray:
    """Return the tetrahedral field relative to its maximum on the zone, with the sign of the other (modes have no sign)."""
    from scipy.interpolate import NearestNDInterpolator

    other = NearestNDInterpolator(arrays["touch_xy"], arrays["touch_uz"][0])(points[nodes, :2])
    sign = 1.0 if float(other @ uz[nodes]) >= 0 else -1.0
    return sign * uz / _largest(points[nodes, :2], uz[nodes], design)


def draw_touch(axes: Axes, arrays: dict[str, Any], design: DesignRecord) -> None:
    """Draw the first shape of touch_* arrays in a corner of its axes, with zone and footprints."""
    _paint(axes, arrays, arrays["touch_uz"][0] / zone_peak(arrays, design), design)


EYE = np.array([1.0, -1.6, 1.3])  # direction from a body to the eye
SHADE = 0.35  # of a face that looks away from the eye


def draw_bodies(axes: Axes, skins: Sequence[Skin], captions: Sequence[str], reach_m: float) -> None:
    """Draw moved bodies side by side in parallel projection, coloured by the component of largest displacement.

    reach_m: largest displacement as drawn.
    """
    from matplotlib import colormaps
    from matplotlib.collections import PolyCollection

    eye = EYE / np.linalg.norm(EYE)
    right = np.cross([0.0, 0.0, 1.0], eye) / np.linalg.norm(eye[:2])
    up, left_mm = np.cross(eye, right), 0.0
    for skin, caption in zip(skins, captions, strict=True):
        motion = skin.displacement[0] / max(float(np.abs(skin.displacement[0]).max()), 1e-300)
        value = motion[:, np.abs(motion).max(axis=0).argmax()][skin.facets].mean(axis=1)
        corners = (skin.points + reach_m * motion)[skin.facets]
        order = np.argsort(corners.mean(axis=1) @ eye)  # the nearest last
        normal = np.cross(corners[:, 2] - corners[:, 0], corners[:, -1] - corners[:, 1])
        facing = np.abs(normal @ eye) / np.maximum(np.linalg.norm(normal, axis=1), 1e-300)
        colour = colormaps[style.SIGNED](0.5 + 0.5 * value)
        colour[:, :3] *= (1.0 - SHADE * (1.0 - facing))[:, None]
        flat = corners @ np.stack([right, up], axis=1) / MM
        low, high = flat.min(axis=(0, 1)), flat.max(axis=(0, 1))
        flat = (flat - low + [left_mm, 0.0])[order]
        axes.add_collection(PolyCollection(flat, facecolors=colour[order], edgecolors="face", lw=0.3, rasterized=True))
        middle = left_mm + (high[0] - low[0]) / 2.0
        axes.annotate(caption, (middle, 0.0), (0.0, -4.0), textcoords="offset points", ha="center", va="top", size=8)
        left_mm += 1.25 * (high[0] - low[0])
    axes.autoscale_view()
    axes.set(aspect="equal", anchor="W")
    axes.set_axis_off()


LOOK = {"shading": "nearest", "rasterized": True}


def panels(count: int, width_m: float | None) -> tuple[Any, list[Any]]:
    """Return a figure and axes for fields in a column, with the zone's borders if its width is known."""
    figure, grid = style.panels(2.4 * count + 0.4, count, 1, squeeze=False)
    sides = () if width_m is None else (-width_m / 2.0, width_m / 2.0)
    for axes in grid[:, 0]:
        for y_m in sides:
            axes.axhline(y_m / MM, color="black", lw=0.6, ls="--")
    return figure, list(grid[:, 0])


def field(axes: Any, x_m: Sequence[float], y_m: Sequence[float], values: Any, label: str, title: str) -> None:
    """Draw a field over positions, x first; nothing if it is None."""
    shown = np.ma.masked_invalid(np.array(values, dtype=float).T)
    image = axes.pcolormesh(np.array(x_m) / MM, np.array(y_m) / MM, shown, cmap=style.QUALITY, **LOOK)
    style.mm_axes(axes)
    axes.set_title(title)
    axes.set_anchor("W")
    axes.figure.colorbar(image, cax=axes.inset_axes((1.03, 0.0, 0.03, 1.0)), label=label)
