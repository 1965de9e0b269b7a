"""A plate of a STEP file: read in place of its sizes, and checked for zone, pillars and patches."""

from __future__ import annotations

from collections.abc import Iterator
from math import isclose
from pathlib import Path
from typing import Any

from geometry.elements import FloatArray
from geometry.errors import GeometryError
from geometry.layout import Design, PillarGroup
from geometry.outline import OffPlate, Outline, Rim, corners_of, read_outline
from pipeline.case.checks import Diagnostic
from pipeline.quantity import MM

SAME = 1e-6  # relative: CAD systems write about seven digits

METRES = 10.0  # times as long as the plate: a zone this long on it means a file whose unit is wrong
WORDS = {"outline": "beyond the outline", "hole": "over a hole or a pocket"}


def read_file(plate: dict[str, Any], folder: Path, zone: Any) -> tuple[Outline | None, list[Diagnostic]]:
    """Read the file of a table [plate], for a table [zone]; returns its outline, None for a faulty table, and the faults."""
    given = plate["file"]
    if not isinstance(given, str) or not given:
        return None, [("plate.file", given, "must be the path of a STEP file")]
    beside = [key for key in ("length_mm", "width_mm", "layer") if key in plate]
    faults: list[Diagnostic] = [
        (f"plate.{key}", plate[key], "must be left out with plate.file, a solid of one material") for key in beside
    ]
    try:
        outline = read_outline(folder / given)
    except GeometryError as error:
        return None, [*faults, ("plate.file", given, str(error).rpartition(f"{folder / given}: ")[2])]
    long = zone.get("length_mm") if isinstance(zone, dict) else None
    if isinstance(long, int | float) and MM * long > METRES * max(outline.size_m):
        length, width = (side / MM for side in outline.size_m)
        text = (
            f"is {length:g} x {width:g} mm, far smaller than the zone, {long:g} mm long: is it in metres but says mm?"
        )
        faults.append(("plate.file", given, text))
    stated, thickness = plate.get("thickness_mm"), outline.thickness_m / MM
    if isinstance(stated, int | float) and not isclose(stated, thickness, rel_tol=SAME):
        text = f"must be {thickness:g}, the thickness of plate.file, or be left out"
        faults.append(("plate.thickness_mm", stated, text))
    return None if faults else outline, faults


def sizes_mm(outline: Outline) -> dict[str, float]:
    """Return the sizes that the file gives, as keys of [plate]."""
    length, width = outline.size_m
    return {"thickness_mm": outline.thickness_m / MM, "length_mm": length / MM, "width_mm": width / MM}


def check_outline(design: Design, given: frozenset[str]) -> Iterator[Diagnostic]:
    """Check that nothing supports the plate, and that zone and pillars stand on it."""
    outline = design.outline
    assert outline
    if design.supports:
        yield "support", [each.kind for each in design.supports], "must be left out with plate.file"
    if "zone" not in given:
        return
    low, high = design.zone_ends_m
    half = design.width_m / 2.0
    under = outline.beneath((low, high, design.centre_m[1] - half, design.centre_m[1] + half))
    if under:
        yield _off_zone(design, outline, under, given)
        return
    for stand in design.standing():
        yield from _off_feet(stand, outline, design.rows)


def _off_zone(design: Design, outline: Outline, under: OffPlate, given: frozenset[str]) -> Diagnostic:
    """The fault of a zone that is not on the plate."""
    zone = f"zone of {design.length_m / MM:g} x {design.width_m / MM:g} mm"
    (x, y), long = (place / MM for place in design.centre_m), design.length_m / MM
    values = {"zone.centre_mm": [x, y], "zone.centre_y_mm": y, "zone.length_mm": long}
    key = next(key for key in values if key in given)
    x0, x1, y0, y1 = (f"{end / MM:g}" for end in outline.ends_m)
    reach = f"which reaches over x from {x0} to {x1} and y from {y0} to {y1} mm"
    where = f"the {zone} about ({x:g}, {y:g}) reaches {WORDS[under]} of plate.file"
    return key, values[key], f"{where}, {reach}" if under == "outline" else f"{where}: must be on whole plate"


def _off_feet(stand: PillarGroup, outline: Outline, rows: int) -> Iterator[Diagnostic]:
    """The fault of the first pillar whose foot is not whole on the plate, with the number of such pillars."""
    foot = stand.pillar.form.outline(stand.pillar.fillet_m)
    rims = (outline.back, outline.touch) if stand.pillar.faces == 2 else (outline.back,)
    off = [(at, under) for at in stand.centres if (under := _under(foot + at, rims))]
    if off:
        (x, y), under = off[0]
        count = f"{len(off)} of {len(stand.centres)} pillars, such as the one at ({x / MM:g}, {y / MM:g}) mm,"
        yield "array.rows", rows, f"{count} would stand {WORDS[under]} of plate.file"


def faults_of_boxes(outline: Outline, boxes_m: FloatArray, face: str) -> list[int]:
    """Return the numbers of the rectangles x0, x1, y0, y1, (n, 4), that are not whole on a face of the plate."""
    rim = outline.back if face == "back" else outline.touch
    return [number for number, box in enumerate(boxes_m) if rim.beneath(corners_of(box))]


def _under(foot: FloatArray, rims: tuple[Rim, ...]) -> OffPlate:
    return next((under for rim in rims if (under := rim.beneath(foot))), "")
