"""The wanted mode on both kinds of mesh, side by side."""

from __future__ import annotations

from typing import Any

import numpy as np

from pipeline import plots
from pipeline.plots import Drawing
from pipeline.plots_plate import KINDS, MM, FloatArray, IntArray, zone_peak
from pipeline.records import StoredCase


def mode_on_both_meshes(case: StoredCase, arrays: dict[str, Any]) -> Drawing | None:
    """The wanted mode's normal displacement on the touch face: hexahedra beside tetrahedra, the same part of the plate."""
    design = case.record.get("design")
    if not design or not {"tet_points", "tet_triangles", "tet_u", "touch_uz"} <= arrays.keys():
        return None
    points, faces, uz = arrays["tet_points"], arrays["tet_triangles"], arrays["tet_u"][:, 2]
    faces = faces[np.all(points[faces][:, :, 2] < 1e-3 * design["thickness_m"], axis=1)]
    if not faces.size:
        return None
    box = np.array([points[faces].min(axis=(0, 1))[:2], points[faces].max(axis=(0, 1))[:2]]) * MM
    uz = _aligned(arrays, points, uz, faces)
    aspect = (box[1, 1] - box[0, 1]) / (box[1, 0] - box[0, 0])
    figure = plots.new_figure(plots.WIDTH_IN, 3.3 * aspect + 1.5)
    panels = figure.subplots(1, 2, sharex=True, sharey=True)
    xy = arrays["touch_xy"] * MM
    hexahedra = (xy, arrays["touch_triangles"], arrays["touch_uz"][0] / zone_peak(arrays, design))
    both = (hexahedra, (points[:, :2] * MM, faces, uz))
    compared = case.record.get("tet_modes") or {}
    tones = (compared.get("hex_frequency_hz"), compared.get("frequency_hz"))
    for axes, (flat, cells, values), kind, tone in zip(panels, both, KINDS.values(), tones, strict=True):
        field = axes.tripcolor(*flat.T, cells, values, shading="gouraud", cmap=plots.SIGNED, vmin=-1, vmax=1)
        field.set_rasterized(True)
        axes.triplot(*flat.T, cells, color="black", lw=0.1, alpha=0.3, rasterized=True)
        axes.set_title(kind + (f"\n{tone / 1e3:.3f} kHz" if tone else ""))
        axes.axhline(design["width_m"] / 2 * MM, color="black", lw=0.9, ls=(0, (5, 3)))
        axes.set_xlim(*box[:, 0])
        axes.set_ylim(*box[:, 1])
        plots.mm_axes(axes)
        axes.label_outer()
    bar = figure.colorbar(field, ax=list(panels), shrink=0.8, pad=0.01)
    bar.set_label("u$_z$ / largest in the zone")
    told = f"; frequencies differ by {compared['relative_difference']:.2%}" if "relative_difference" in compared else ""
    alt = f"Normal displacement of {case.case_id}'s wanted mode on the touch face by hexahedra and by tetrahedra{told}."
    return Drawing("mode_on_both_meshes", "The wanted mode by hexahedra and by tetrahedra", alt, figure)


def _aligned(arrays: dict[str, Any], points: FloatArray, uz: FloatArray, faces: IntArray) -> FloatArray:
    """The tetrahedral field over its own largest value, in the sign of the other one (a mode's sign is free)."""
    from scipy.interpolate import NearestNDInterpolator

    nodes = np.unique(faces)
    other = NearestNDInterpolator(arrays["touch_xy"], arrays["touch_uz"][0])(points[nodes, :2])
    sign = 1.0 if float(other @ uz[nodes]) >= 0 else -1.0
    return sign * uz / float(np.max(np.abs(uz[nodes])))
