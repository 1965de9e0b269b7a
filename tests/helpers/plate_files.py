"""STEP files of plates for tests, lengths in mm, touch face on z = 0."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import cadquery as cq


def panel(length: float = 30.0, width: float = 20.0, thickness: float = 1.0, corner: float = 4.0) -> cq.Workplane:
    """A rectangle with rounded corners about the origin."""
    block = cq.Workplane().box(length, width, thickness, centered=(True, True, False))
    return block.edges("|Z").fillet(corner) if corner else block


def disc(outer: float, inner: float, thickness: float) -> cq.Workplane:
    """A disc with a hole in its middle, about the origin."""
    return cq.Workplane().circle(outer).circle(inner).extrude(thickness)


def drilled(plate: cq.Workplane, x: float, y: float, radius: float, deep: float = 100.0) -> cq.Workplane:
    """A plate with a hole, or a pocket of some depth from the back."""
    top = plate.val().BoundingBox().zmax
    return plate.cut(cq.Workplane(origin=(x, y, top - deep)).circle(radius).extrude(deep))


def written(shape: cq.Workplane, folder: Path, name: str = "plate.step") -> Path:
    """Write a STEP file."""
    cq.exporters.export(shape, str(folder / name))
    return folder / name


def raw_case(**tables: Any) -> dict[str, Any]:
    """A case with plate.file = plate.step, a small zone about the origin and a row on all its sides."""
    return {
        "name": "outline",
        "material": "aluminium",
        "plate": {"file": "plate.step"},
        "zone": {"length_mm": 8.0, "width_mm": 5.0, "nodal_lines": 1},
        "pillar": {"side_mm": 1.5, "height_mm": 2.5},
        "array": {"pitch_mm": 3.0, "rows": 1, "surround": True},
        "solve": {"accuracy": 0.02},
    } | tables
