"""A plate as a labelled sketch, seen from the pillars' side: drawn from its record as inline SVG."""

from __future__ import annotations

from typing import TYPE_CHECKING

from pipeline.records.record import DesignRecord
from pipeline.units import MM

if TYPE_CHECKING:
    from markupsafe import Markup

MARGIN = 14.0  # mm of paper on each side, for dimensions
WIDE = 150.0  # mm of plate that are drawn 1:1; others are scaled, so that letters stay readable

PLATE = 'fill="#f3f6f8" stroke="#55606b" stroke-width=".4"'  # where no style sheet says otherwise
ZONE, PILLARS = 'fill="#009e73" fill-opacity=".22"', 'fill="#0072b2"'


def sketch(design: DesignRecord) -> Markup:
    """Plate, zone and pillars with their dimensions in mm."""
    from markupsafe import Markup

    length, breadth = design.length_m / MM, 2.0 * design.half_span_m / MM
    scale = min(1.0, WIDE / length)
    x0, y0, zone = -length / 2.0, -breadth / 2.0, design.width_m / MM
    letters = 3.6 / scale
    pillars = " ".join(
        f"M{x / MM - half:.2f} {-y / MM - half:.2f}h{2 * half:.2f}v{2 * half:.2f}h{-2 * half:.2f}z"
        for (x, y), pillar in zip(design.pillar_centres_m, design.standing, strict=True)
        for half in [pillar.base_m / MM / 2.0]
    )
    side = MARGIN / scale
    box = f"{x0 - side:.2f} {y0 - 0.4 * side:.2f} {length + 2 * side:.2f} {breadth + 1.2 * side:.2f}"
    words = f"{length:g} × {breadth:g} × {design.thickness_m / MM:g} mm"
    return Markup(
        f'<svg class="sketch" viewBox="{box}" role="img" aria-label="Sketch of the plate: {words}">'
        f'<rect class="plate" {PLATE} x="{x0:.2f}" y="{y0:.2f}" width="{length:.2f}" height="{breadth:.2f}"/>'
        f'<rect class="zone" {ZONE} x="{x0:.2f}" y="{-zone / 2:.2f}" width="{length:.2f}" height="{zone:.2f}"/>'
        f'<path class="pillars" {PILLARS} d="{pillars}"/>'
        f'<g font-size="{letters:.2f}" text-anchor="middle"><text y="{letters / 3:.2f}">active zone, {zone:g} mm wide</text>'
        f'<text y="{breadth / 2 + 1.6 * letters:.2f}">{words}</text></g></svg>'
    )
