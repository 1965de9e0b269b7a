"""What pictures of a plate share: its outlines, its pillars on the stored skin, its scale."""

from __future__ import annotations

from dataclasses import dataclass
from math import floor, log10
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from pipeline.plots import style
from pipeline.records.record import DesignRecord
from pipeline.units import MM

if TYPE_CHECKING:
    from matplotlib.axes import Axes

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
