"""Checks for geometry that cannot be built, in mm, on values that are valid by themselves; one or several zones."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from itertools import combinations, pairwise
from math import hypot
from typing import Any

import numpy as np

from geometry.elements import FloatArray
from geometry.lattice import SAME, SLOPE, labels_of, rows_along_x, shortest_vectors
from geometry.layout import PLAIN
from geometry.pillar_shapes import SHAPES, PillarShape
from pipeline.case import limits
from pipeline.case.schema import AXES, SIZE_KEYS, Tables
from pipeline.case.several import check_several
from pipeline.errors import InputError
from pipeline.quantity import MM

VECTORS = ("a1_mm", "a2_mm")
PITCHES = ("pitch_mm", "pitch_x_mm", "pitch_y_mm")
Diagnostic = tuple[str, Any, str]  # key, value, message
THINNEST = 5000.0
"""Largest ratio of the longest side to the thickness that the meshers support.

A structured hexahedron of aspect 100 (still well shaped for orders 2 to 4) then takes 50 elements along the plate; and
eps |K|/omega^2, the relative round-off error of a bending eigenvalue, grows as (side/thickness)^4: about 0.4 % at
2000 across the clamped width, 100 % at some thousands.
"""


def section_mm(file: Tables, form: PillarShape | None) -> float | None:
    """Return the width of the foot without fillet, mm, even if the shape's name is wrong; None while unknown."""
    if form is not None:
        return form.width_m / MM
    shape = SHAPES.get(file.pillar.shape)
    widths = (getattr(file.pillar, each.keys[0]) for each in ([shape] if shape else SHAPES.values()))
    return next((width for width in widths if isinstance(width, float | int)), None)


def footprint_mm(file: Tables, form: PillarShape | None) -> float | None:
    """Return the largest extent of the foot, fillet included, mm; None while unknown."""
    section, fillet = section_mm(file, form), file.pillar.fillet_mm
    if section is None or fillet is None:
        return None
    return section + 2.0 * fillet if form is None else form.footprint_m(MM * fillet) / MM


def _sizes_mm(file: Tables) -> dict[str, float]:
    """Return the known lengths of the pillar's shape, mm."""
    return {key: getattr(file.pillar, key) for key in SIZE_KEYS if key.endswith("_mm") and getattr(file.pillar, key)}


def check_pillar_keys(file: Tables, form: PillarShape | None) -> Iterator[Diagnostic]:
    """Check the keys of the pillar's shape: none missing, none of another shape, compatible sizes."""
    name = file.pillar.shape
    shape = SHAPES.get(name)
    if shape is None:
        return
    needed = [*shape.keys, *(("height_mm",) if shape.has_height else ())]
    for part in (*SIZE_KEYS, "height_mm"):
        key, value = f"pillar.{part}", getattr(file.pillar, part)
        if value is None and key not in file.faulty and part in needed:
            yield key, None, f"a {name} pillar needs it"
        elif value is not None and part not in needed:
            yield key, value, f"does not belong to a {name} pillar, which takes {' and '.join(needed)}"
    fillet = file.pillar.fillet_mm
    if fillet and not shape.can_have_fillet:
        yield "pillar.fillet_mm", fillet, f"must be 0 with a {name} pillar, whose file contains the final shape"
    for part, text in shape.size_violations(_sizes_mm(file) | {"fillet_mm": fillet or 0.0}):
        yield f"pillar.{part}", getattr(file.pillar, part), text


def check_fillet(file: Tables, form: PillarShape | None) -> Iterator[Diagnostic]:
    """Check that the foot fillet ends below the tip."""
    fillet, height = file.pillar.fillet_mm, file.pillar.height_mm
    if fillet and height and fillet >= height:
        yield "pillar.fillet_mm", fillet, f"must be smaller than the pillar's height {height:g} mm"


def _of_vectors(file: Tables) -> Iterator[Diagnostic]:
    """Set pitches and shift of the rows along x of a lattice that its vectors give, or the lengths of its shortest vectors."""
    vectors = [getattr(file.array, name) for name in VECTORS]
    given = [name for name, vector in zip(VECTORS, vectors, strict=True) if vector is not None]
    if {f"array.{name}" for name in VECTORS} & file.faulty:
        return
    if len(given) < len(VECTORS):
        (lacking,) = {*VECTORS} - {*given}
        yield f"array.{lacking}", None, f"must accompany {given[0]}"
        return
    for name in (*PITCHES, "pitches_y_mm", "lattice", "stagger"):
        if value := getattr(file.array, name):
            yield f"array.{name}", value, "cannot be combined with a1_mm and a2_mm, which give the lattice: remove it"
            return
    (x1, y1), (x2, y2) = vectors
    if abs(x1 * y2 - x2 * y1) <= SAME * hypot(x1, y1) * hypot(x2, y2):
        yield "array.a2_mm", vectors[1], f"parallel to a1_mm = {vectors[0]}: must not be"
        return
    if rows := rows_along_x(*vectors):
        pitch, distance, is_shifted = rows
        file.set({"array.pitch_x_mm": pitch, "array.pitch_y_mm": distance, "array.stagger": is_shifted})
        file.pitches_given = PITCHES[1:]
        return
    (x1, y1), (x2, y2) = shortest_vectors(*vectors)
    file.set({"array.pitch_x_mm": hypot(x1, y1), "array.pitch_y_mm": hypot(x2, y2)})
    file.pitches_given = VECTORS


def oblique_mm(file: Tables) -> tuple[tuple[float, float], tuple[float, float]] | None:
    """Return the two shortest vectors, in mm, of a lattice given by vectors that has no rows as pitches give them."""
    one, two = file.array.a1_mm, file.array.a2_mm
    if not one or not two or {f"array.{name}" for name in VECTORS} & file.faulty or rows_along_x(one, two):
        return None
    return shortest_vectors(one, two)


def _check_neighbours(file: Tables, form: PillarShape) -> Iterator[Diagnostic]:
    """Check that no pillar of an oblique lattice touches a neighbour, by the normals of its outline's sides."""
    vectors = oblique_mm(file)
    if vectors is None:
        return
    (x1, y1), (x2, y2) = vectors
    sections = [(form, MM * (file.pillar.fillet_mm or 0.0)), *((each.form, 0.0) for each in file.upper)]
    for x, y in ((i * x1 + j * x2, i * y1 + j * y2) for i in (-1, 0, 1) for j in (0, 1) if j or i == 1):
        room = min(_room(own.outline(grown) / MM, own.plan == "disc", (x, y)) for own, grown in sections)
        if room < 1.0 + limits.MIN_GAP:
            what = f"pillars {'overlap' if room <= 1.0 else 'almost touch'}"
            yield "array.a2_mm", file.array.a2_mm, f"{what}: neighbours are {x:g} mm apart along x and {y:g} mm along y"
            return


def _room(outline: FloatArray, is_round: bool, step: tuple[float, float]) -> float:
    """Distance of a centrally symmetric outline (n, 2) and its image a step away, over that at which they touch."""
    if is_round:
        return hypot(*step) / (2.0 * float(np.linalg.norm(outline, axis=1).max()))
    sides = np.roll(outline, -1, axis=0) - outline
    normals = np.column_stack([sides[:, 1], -sides[:, 0]])
    return float((np.abs(normals @ step) / (2.0 * (outline @ normals.T).max(axis=0))).max())


def normalise_pitch(file: Tables) -> Iterator[Diagnostic]:
    """Set one pitch along x and one along y from either pitch_mm or both of its parts, or from lattice vectors."""
    if any(getattr(file.array, name) is not None or f"array.{name}" in file.faulty for name in VECTORS):
        yield from _of_vectors(file)
        return
    known = {name: getattr(file.array, name) for name in PITCHES if file.knows("array", name)}
    given = [name for name, pitch in known.items() if pitch is not None]
    if "pitch_mm" in given and len(given) > 1:
        yield f"array.{given[1]}", known[given[1]], "cannot be combined with pitch_mm: remove one of them"
    elif len(given) == 1 and given[0] != "pitch_mm":
        (other,) = {*PITCHES} - {"pitch_mm", given[0]}
        if other in known:
            yield f"array.{other}", None, f"must accompany {given[0]} (or give only pitch_mm)"
    file.pitches_given = tuple(given) if len(known) == len(PITCHES) else None
    if (both := known.get("pitch_mm")) is not None:
        file.set({"array.pitch_x_mm": both, "array.pitch_y_mm": both})
    yield from _lay_out(file, given)


def _lay_out(file: Tables, given: list[str]) -> Iterator[Diagnostic]:
    """Shift rows and set the distance of rows of a named lattice; report what contradicts it."""
    array, kind = file.array, file.array.lattice
    if kind in ("square", "rectangular") and array.stagger:
        yield "array.stagger", True, f"cannot be combined with lattice = '{kind}', whose rows are in line"
    if kind == "square" and array.pitch_x_mm != array.pitch_y_mm:
        yield "array.pitch_y_mm", array.pitch_y_mm, "must equal pitch_x_mm in a square lattice"
    if kind in ("staggered", "triangular"):
        file.set({"array.stagger": True})
    if kind != "triangular":
        return
    for name in (*PITCHES[1:], "pitches_y_mm"):
        if name in given or (name == "pitches_y_mm" and array.pitches_y_mm):
            text = "must be left out of a triangular lattice: pitch_mm is the distance of neighbours"
            yield f"array.{name}", getattr(array, name), text
    if array.pitch_x_mm is not None and given == ["pitch_mm"]:
        file.set({"array.pitch_y_mm": SLOPE * array.pitch_x_mm})


def _given_pitches(file: Tables) -> list[tuple[str, float]]:
    """Yield the keys that set a pitch, and their values, mm."""
    known = {**dict(file.array), "pitch_mm": file.array.pitch_x_mm}
    return [(name, known[name]) for name in file.pitches_given or () if name not in VECTORS]


def check_pitch(file: Tables, form: PillarShape | None) -> Iterator[Diagnostic]:
    """Check that neighbouring pillars do not touch."""
    footprint = footprint_mm(file, form)
    if footprint is None:
        return
    if form is not None and file.pitches_given == VECTORS:
        yield from _check_neighbours(file, form)
    widest = max(footprint, max(form.reach_m()) / MM) if form else footprint
    for name, pitch in _given_pitches(file):
        if pitch <= widest:
            yield f"array.{name}", pitch, f"pillars overlap: must exceed the pillar's footprint {widest:g} mm"
        elif pitch - widest < limits.MIN_GAP * widest:
            text = f"pillars almost touch: must exceed the footprint {widest:g} mm by at least {limits.MIN_GAP:g} of it"
            yield f"array.{name}", pitch, f"{text}, a gap that can be meshed"


def check_sections(file: Tables, form: PillarShape | None) -> Iterator[Diagnostic]:
    """Check that the upper sections of a pillar stay clear of its neighbours and of the rows across the zone."""
    section, width, most = section_mm(file, form), file.zone.width_mm, limits.MAX_SLENDERNESS
    for upper in file.upper:
        side, key = upper.form.footprint_m(0.0) / MM, f"pillar.section.{upper.number}.{upper.form.keys[0]}"
        if section and not 1.0 / most <= side / section <= most:
            text = (
                f"must be from {section / most:g} to {section * most:g}, {1.0 / most:g} to {most:g} times {section:g}"
            )
            yield key, side, text
        for name, pitch in _given_pitches(file):
            if pitch - side < limits.MIN_GAP * side:
                text = (
                    f"sections touch: must be below array.{name} = {pitch:g} by at least {limits.MIN_GAP:g} of itself"
                )
                yield key, side, text
        if width and section and file.array.rows != 0 and 2.0 * (side - section) >= width:
            allowed = (
                f"must be below {section + width / 2.0:g}: it may cover at most a quarter of zone.width_mm = {width:g}"
            )
            yield key, side, allowed


def check_slenderness(file: Tables, form: PillarShape | None) -> Iterator[Diagnostic]:
    """Check that pillar height, sides and fillet differ by no more than beam theory and elements allow."""
    height, most, sizes = file.pillar.height_mm, limits.MAX_SLENDERNESS, _sizes_mm(file)
    for name, side in sizes.items():
        if height and not 1.0 / most <= height / side <= most:
            allowed = f"must be from {side / most:g} to {side * most:g}, {1.0 / most:g} to {most:g} times pillar.{name}"
            yield "pillar.height_mm", height, allowed
    for (first, width), (name, side) in combinations(sizes.items(), 2):
        if not 1.0 / most <= side / width <= most:
            allowed = f"must be from {width / most:g} to {width * most:g}, for pillar.{first} = {width:g}"
            yield f"pillar.{name}", side, allowed
    fillet, section = file.pillar.fillet_mm, section_mm(file, form)
    if fillet and section and fillet < section / most:
        yield "pillar.fillet_mm", fillet, f"must be 0, or at least {section / most:g}, {1.0 / most:g} of the foot"


def check_pillar_on_plate(file: Tables, form: PillarShape | None) -> Iterator[Diagnostic]:
    """Check that feet and passive rim are not too narrow for the plate's thickness, and limit the number of pillars."""
    thickness, section, most = file.plate.thickness_mm, section_mm(file, form), limits.MAX_SLENDERNESS
    if thickness and section and file.array.rows != 0 and thickness > most * section:
        limit = f"must be at most {most * section:g}, {most:g} times the pillar's foot of {section:g} mm"
        yield "plate.thickness_mm", thickness, limit
    rim = file.array.extension_mm
    if thickness and rim and rim < thickness / most:
        limit = f"must be 0, or at least {thickness / most:g}, {1.0 / most:g} of plate.thickness_mm"
        yield "array.extension_mm", rim, limit
    rows, length, pitch = file.array.rows, file.zone.length_mm, file.array.pitch_x_mm
    if rows and length and pitch and 2.0 * rows * (length / pitch + 1.0) > limits.MAX_PILLARS:
        count = int(2.0 * rows * (length / pitch + 1.0))
        text = f"{count} pillars: at most {limits.MAX_PILLARS} can be assembled (rows x columns)"
        yield "array.rows", rows, text


def check_nodal_lines(file: Tables, form: PillarShape | None) -> Iterator[Diagnostic]:
    """Check that the target mode's flexural wave is longer than the thickness; a shorter one is two surface waves."""
    lines, length, thickness = (file.zone.nodal_lines, file.zone.length_mm, file.plate.thickness_mm)
    if lines and length and thickness and lines > 1 and 2.0 * length / lines < thickness:
        most = max(1, int(2.0 * length / thickness))
        text = f"must be at most {most}: the wave would be shorter than the plate is thick, {thickness:g} mm"
        yield "zone.nodal_lines", lines, text


def check_zone_width(file: Tables, form: PillarShape | None) -> Iterator[Diagnostic]:
    """Check that the zone is at least two pillar sides wide."""
    width, side = file.zone.width_mm, section_mm(file, form)
    if width is not None and side is not None and file.array.rows != 0 and width < 2.0 * side:
        yield "zone.width_mm", width, f"zone narrower than two pillar sides: must be at least {2.0 * side:g} mm"


def check_row_fits(file: Tables, form: PillarShape | None) -> Iterator[Diagnostic]:
    """Check that at least one pillar fits along the zone."""
    length, footprint = file.zone.length_mm, footprint_mm(file, form)
    if footprint is not None:
        footprint = max([footprint, *(upper.form.footprint_m(0.0) / MM for upper in file.upper)])
    if length is not None and footprint is not None and file.array.rows != 0 and footprint > length:
        yield (
            "zone.length_mm",
            length,
            f"pillars reach beyond the plate: must be at least the footprint, {footprint:g} mm",
        )
    rows, pitch = file.array.rows or 0, file.array.pitch_x_mm
    if file.array.stagger and rows > 1 and length and pitch and footprint and length < pitch + footprint:
        text = f"a shifted row contains no pillar: zone.length_mm must be at least {pitch + footprint:g}"
        yield "array.stagger", True, text


def _whole_width(file: Tables, form: PillarShape | None) -> list[float]:
    """Return the width of the plate across the zone, mm, or both sizes of a larger one, in a list that is empty while the
    zone's width is unknown.
    """
    width, rows = file.zone.width_mm, file.array.rows or 0
    if file.plate.length_mm is not None and file.plate.width_mm is not None:
        return [file.plate.length_mm, file.plate.width_mm]
    if width is None:
        return []
    pitch = file.array.pitch_y_mm or 0.0
    span = (rows - 1) * pitch + (footprint_mm(file, form) or 0.0) if rows else 0.0
    return [width + 2.0 * (span + (file.array.extension_mm or 0.0))]


def check_thickness(file: Tables, form: PillarShape | None) -> Iterator[Diagnostic]:
    """Check that the plate is not too thin for the mesher."""
    thickness = file.plate.thickness_mm
    sides = [file.zone.length_mm, file.array.pitch_x_mm, file.array.pitch_y_mm, *_whole_width(file, form)]
    longest = max((side for side in sides if side is not None), default=None)
    if thickness is not None and longest is not None and longest / thickness > THINNEST:
        text = (
            f"plate too thin to be meshed: must be at least {longest / THINNEST:g} mm "
            f"(longest side {longest:g} mm / {THINNEST:g})"
        )
        yield "plate.thickness_mm", thickness, text


def check_not_a_block(file: Tables, form: PillarShape | None) -> Iterator[Diagnostic]:
    """Check that the plate is thinner than its zone is wide; otherwise a unit is probably wrong."""
    thickness, width = file.plate.thickness_mm, file.zone.width_mm
    if thickness is not None and width is not None and thickness > width:
        text = f"must be at most zone.width_mm = {width:g}: a plate, not a block (lengths are in mm)"
        yield "plate.thickness_mm", thickness, text


LARGER = ("length_mm", "width_mm")
CENTRES = ("centre_mm", "centre_x_mm", "centre_y_mm", "centres_mm")
BESIDE = (
    "requires a larger plate (plate.length_mm and plate.width_mm): zones on a plate as long as they are lie side by side "
    "along y, each at its centre_y_mm"
)
EACH = "must give the centre of each zone, [x, y], in its own table"


def check_larger(file: Tables, form: PillarShape | None) -> Iterator[Diagnostic]:
    """Check that a plate larger than zone and rows is given whole, with what only it has, and holds both."""
    given = [name for name in LARGER if getattr(file.plate, name, None) is not None]
    if len(given) == 1 and not {f"plate.{name}" for name in LARGER} & file.faulty:
        (other,) = {*LARGER} - {*given}
        yield f"plate.{other}", None, f"must accompany {given[0]}"
    placed = {f"zone.{name}": getattr(file.zone, name) for name in CENTRES}
    placed |= {"array.surround": file.array.surround or None}
    if "plate.length_mm" in file.faulty:  # such as that of a file that cannot be read
        return
    if not given:
        for key, value in placed.items():
            if value is not None and not (key == "zone.centre_y_mm" and value == 0.0):
                yield key, value, "requires a larger plate: give plate.length_mm and plate.width_mm, or plate.file"
        return
    if len(given) == 1:
        return
    said = [key for key in placed if key.startswith("zone.") and placed[key] is not None]
    for key in said[1:] if not {*said} <= {*AXES} else ():
        yield key, placed[key], f"cannot be combined with {said[0].removeprefix('zone.')}: remove one of them"
    sized = "file, which sets" if file.plate.file else "length_mm and width_mm, which set"
    if file.array.extension_mm:
        text = f"must be left out of a plate with {sized} its margins"
        yield "array.extension_mm", file.array.extension_mm, text
    if (file.zone.count or 1) > 1:
        text = f"must be 1 on a plate with {sized.partition(',')[0]}: give the centre of each zone by centres_mm"
        yield "zone.count", file.zone.count, text
    if file.zone.centres_mm:
        yield from check_several(file)
    yield from _surrounded(file)
    for x, y in () if file.plate.file else file.zone.places_mm:  # its rims are checked against the design
        faults = list(_margins(file, form, x, y))
        yield from faults
        if faults:
            return


def _surrounded(file: Tables) -> Iterator[Diagnostic]:
    """Check that rows around a zone are alike and in line."""
    array = file.array
    if not array.surround:
        return
    for name in ("heights_mm", "sides_mm", "pitches_y_mm"):
        if values := getattr(array, name):
            yield f"array.{name}", values, "cannot be combined with surround: rows around a zone are alike"
    if array.stagger:
        yield (
            "array.surround",
            True,
            "cannot be combined with shifted rows (stagger, staggered and triangular lattices)",
        )
    if "pillar" not in file.present or not array.rows:
        yield "array.surround", True, "requires a [pillar] and array.rows of 1 or more"


def _margins(file: Tables, form: PillarShape | None, x: float, y: float) -> Iterator[Diagnostic]:
    """Check that a zone about (x, y) and its rows lie on the plate, with margins that can be meshed."""
    known = [file.plate.length_mm, file.plate.width_mm, file.zone.length_mm, file.zone.width_mm]
    sizes = [size for size in known if size is not None]
    if len(sizes) < len(known):
        return
    rows, foot = file.array.rows or 0, footprint_mm(file, form) or 0.0
    pitches = [file.array.pitch_x_mm or 0.0, file.array.pitch_y_mm or 0.0]
    widths = list(file.array.pitches_y_mm or [pitches[1]] * rows)
    deep = [(rows - 1) * pitches[0] + foot if file.array.surround else 0.0]
    deep.append(sum(widths) - (widths[0] + widths[-1]) / 2.0 + foot if widths else 0.0)
    least = (file.plate.thickness_mm or 0.0) / limits.MAX_SLENDERNESS
    for axis, centre, plate, zone, depth in zip(
        "xy", (x, y), sizes[:2], sizes[2:], deep if rows else (0.0, 0.0), strict=True
    ):
        names = {"x": "length", "y": "width"}
        key = f"plate.{names[axis]}_mm"
        room = plate / 2.0 - abs(centre) - zone / 2.0
        if room < -SAME_MM:
            need = 2.0 * (abs(centre) + zone / 2.0)
            yield key, plate, f"the zone extends beyond the plate: must be at least {need:g} along {axis}"
        elif room - depth < -SAME_MM:
            need = 2.0 * (abs(centre) + zone / 2.0 + depth)
            yield key, plate, f"{rows} rows do not fit between zone and edge: must be at least {need:g} along {axis}"
        else:
            for margin in (room - depth, room - depth + 2.0 * abs(centre)):
                if SAME_MM < margin < least:
                    text = f"leaves a margin of {margin:g} along {axis}: must be 0, or at least {least:g}"
                    yield key, plate, f"{text}, {1.0 / limits.MAX_SLENDERNESS:g} of plate.thickness_mm"
                    break


def check_rows(file: Tables, form: PillarShape | None) -> Iterator[Diagnostic]:
    """Check that rows have a pillar and a pitch."""
    rows = file.array.rows
    if not rows:
        return
    if "pillar" not in file.present and not file.cell.file:
        yield "array.rows", rows, "must be 0 without a [pillar] or a [cell]"
    if file.pitches_given == ():
        yield "array.pitch_mm", None, "rows need a pitch: give pitch_mm, or pitch_x_mm and pitch_y_mm"


def check_solve(file: Tables, form: PillarShape | None) -> Iterator[Diagnostic]:
    """Check for a rising band, or a frequency with a count, but not both."""
    band, near, count = (getattr(file.solve, name) for name in ("band_kHz", "near_kHz", "count"))
    if band is not None and not (band[0] < band[1] and band[1] >= limits.FREQUENCY_KHZ[0]):
        least = f"high at least {limits.FREQUENCY_KHZ[0]:g}"
        yield "solve.band_kHz", band, f"must be two numbers [low, high], 0 <= low < high, {least}"
    if band is not None and near is not None:
        yield "solve.near_kHz", near, "cannot be combined with band_kHz: remove one of them"
    if band is not None and near is None and count is not None:
        yield "solve.count", count, "applies to near_kHz only: remove it, or replace band_kHz with near_kHz"


def check_path(file: Tables, form: PillarShape | None) -> Iterator[Diagnostic]:
    """Check that neighbouring points of the wavevector path differ."""
    path = file.bands.path
    if any(a == b for a, b in pairwise(labels_of(path or ""))):
        yield "bands.path", path, "must not contain the same point twice in succession"


def check_patch_keys(file: Tables, form: PillarShape | None) -> Iterator[Diagnostic]:
    """Check for centres or antinodes, not both, a zone for antinodes, and distinct sensors."""
    if "patches" not in file.present:
        return
    at, centres, sensors = (getattr(file.patches, name) for name in ("at", "centres_mm", "sensors"))
    if at and centres:
        yield "patches.at", at, "cannot be combined with centres_mm: remove one of them"
    if centres and file.patches.behind_mm:
        yield "patches.behind_mm", file.patches.behind_mm, "cannot be combined with centres_mm: remove one of them"
    if not centres and "zone" not in file.present and not {"patches.at", "patches.centres_mm"} & file.faulty:
        yield "patches.at", at or "antinodes", "requires a [zone]: add one, or give centres_mm"
    if sensors and len(set(sensors)) < len(sensors):
        yield "patches.sensors", sensors, "must name each patch only once"


def check_cell(file: Tables, form: PillarShape | None) -> Iterator[Diagnostic]:
    """Check that a cell has a plate and a lattice, and one from a file no other pillar."""
    own = file.cell.file
    if "cell" in file.present and "plate" not in file.present:
        yield "plate.thickness_mm", None, "must be given with [cell]"
    if "cell" in file.present and file.pitches_given == ():
        yield "array.pitch_mm", None, "must be given with [cell]"
    if own is None:
        return
    if "pillar" in file.present:
        yield "cell.file", own, "cannot be combined with [pillar]: the file holds the whole cell"


def check_measured(file: Tables, form: PillarShape | None) -> Iterator[Diagnostic]:
    """Check that [measured] names a file, that the plate has patches, and that a laser position has a sweep."""
    if "measured" not in file.present:
        return
    sweep, field, place = (getattr(file.measured, name) for name in ("sweep", "map", "at_mm"))
    if not (sweep or field):
        yield "measured.sweep", None, "must name a sweep, a map or both"
    if place and not sweep:
        yield "measured.at_mm", place, "applies to measured.sweep only: remove it, or give measured.sweep"
    if "patches" not in file.present:
        yield "measured.sweep", sweep, "requires [patches], with whose response the measurement is compared"


def check_tolerance(file: Tables, form: PillarShape | None) -> Iterator[Diagnostic]:
    """Check that something varies on plain pillars, and that three standard deviations leave valid pillars."""
    if "tolerance" not in file.present:
        return
    sizes = {name: getattr(file.tolerance, f"{name}_mm") for name in ("height", "side", "position")}
    height, side, position = sizes.values()
    young = file.tolerance.young_percent
    if height is None or side is None or position is None or young is None:
        return
    if not (height or side or position or young):
        text = "nothing varies: height_mm, side_mm, position_mm or young_percent must be above 0"
        yield "tolerance.height_mm", height, text
    plain = file.pillar.fillet_mm == 0.0 and not file.upper and file.pillar.faces != "both"
    if form is not None and not (form.grows and plain):
        yield "tolerance.height_mm", height, f"only {PLAIN} can be varied"
        return
    if "pillar" not in file.present or file.array.rows == 0:
        yield "tolerance.height_mm", height, "requires a [pillar] and array.rows above 0"
        return
    width = form.keys[0] if form else "side_mm"
    tall, wide = file.pillar.height_mm, getattr(file.pillar, width)
    for name, given, key, whole in (("height", height, "height_mm", tall), ("side", side, width, wide)):
        if whole and 3.0 * given >= whole:
            yield f"tolerance.{name}_mm", given, f"must be below {whole / 3.0:g}, a third of pillar.{key}"
    if form is not None and wide:
        yield from _room_between(file, form, wide, 3.0 * side, position)


def _room_between(file: Tables, form: PillarShape, wide: float, grown: float, position: float) -> Iterator[Diagnostic]:
    """Check that pillars three standard deviations wider and displaced do not touch and stay in their cells; in mm.

    Cells of staggered rows are half a pitch wide.
    """
    ratios = [extent / form.width_m for extent in form.reach_m()]
    pitches = [getattr(file.array, name) for name in PITCHES[1:]]
    places = ["two pillars"] * 2
    if file.array.stagger and pitches[0]:
        pitches[0] /= 2.0
        places[0] = "one pillar and that of the next row, half a pitch further"
    given = zip(pitches, ratios, places, strict=True)
    room, place = min(((pitch - wide * ratio, place) for pitch, ratio, place in given if pitch), default=(0.0, ""))
    if grown * max(ratios) + 6.0 * position >= room > 0.0:
        text = f"pillars may touch: 3 side_mm + 6 position_mm must be below the room {room:g} mm between {place}"
        yield "tolerance.position_mm", position, text


CHECKS: tuple[Callable[[Tables, PillarShape | None], Iterator[Diagnostic]], ...] = (
    check_pillar_keys,
    check_fillet,
    check_slenderness,
    check_pitch,
    check_sections,
    check_pillar_on_plate,
    check_nodal_lines,
    check_zone_width,
    check_row_fits,
    check_thickness,
    check_not_a_block,
    check_rows,
    check_cell,
    check_larger,
    check_solve,
    check_path,
    check_patch_keys,
    check_measured,
    check_tolerance,
)


SAME_MM = 1e-6


def one_table(raw: dict[str, Any], source: str) -> dict[str, Any]:
    """Merge `[[zone]]` tables of a parsed file into one [zone] with count, shared_rows and gap_mm, or with centres_mm on a
    larger plate.

    Raises InputError, one line per fault, for zones that are not identical, and for those that are not evenly spaced around
    y = 0 on a plate as long as they are.
    """
    tables = raw.get("zone")
    if not isinstance(tables, list) or not all(isinstance(table, dict) for table in tables) or not tables:
        return raw
    if len(tables) == 1:
        return raw | {"zone": tables[0]}
    plate = raw.get("plate")
    larger = isinstance(plate, dict) and not {"length_mm", "width_mm", "file"}.isdisjoint(plate)
    first = {key: value for key, value in tables[0].items() if key not in CENTRES}
    said = [
        f"[[zone]]: count = {table['count']}: must be left out: the tables themselves are counted"
        for table in tables
        if "count" in table
    ]
    for name in ("centre_mm", "centre_x_mm", "centres_mm"):
        if any(name in table for table in tables) and (not larger or name == "centres_mm"):
            said.append(f"[[zone]]: {name}: {BESIDE if name != 'centres_mm' else EACH}")
            tables = [{key: value for key, value in table.items() if key != name} for table in tables]
    for number, table in enumerate(tables[1:], start=2):
        for key, value in table.items():
            if key not in (*CENTRES, "shared_rows") and first.get(key) != value:
                said.append(
                    f"[[zone]] {number}: {key} = {value}: must be {first.get(key, 'left out')} as in the first: all "
                    "zones are identical"
                )
    shared = {table["shared_rows"] for table in tables[1:] if "shared_rows" in table}
    if len(shared) > 1:
        said.append(
            f"[[zone]]: shared_rows = {', '.join(map(str, sorted(shared)))}: must be the same between all zones"
        )
    merged = first | ({"shared_rows": shared.pop()} if shared else {})
    merged |= _centres(tables, said) if larger else {"count": len(tables)} | _gap(tables, said)
    if said:
        raise InputError(f"{source}: {text}" for text in said)
    return raw | {"zone": merged}


def _centres(tables: list[dict[str, Any]], said: list[str]) -> dict[str, Any]:
    """Return the centres of zones anywhere on a larger plate."""
    places = []
    for number, table in enumerate(tables, start=1):
        given = {*CENTRES} & {*table}
        if not given or ("centre_mm" in given and len(given) > 1):
            said.append(f"[[zone]] {number}: centre_mm: {EACH}")
        places.append(table.get("centre_mm", [table.get("centre_x_mm", 0.0), table.get("centre_y_mm", 0.0)]))
    return {"centres_mm": places}


def _gap(tables: list[dict[str, Any]], said: list[str]) -> dict[str, Any]:
    """Return gap_mm from the centres of the zones, if they are given."""
    name, width = "centre_y_mm", tables[0].get("width_mm")
    centres = [table[name] for table in tables if name in table]
    if not centres:
        return {}
    numbers = [value for value in (*centres, width) if isinstance(value, int | float) and not isinstance(value, bool)]
    if len(numbers) != len(tables) + 1:
        said.append(f"[[zone]]: {name}: must be a number in every table or in none")
        return {}
    steps = [high - low for low, high in pairwise(numbers[:-1])]
    if abs(sum(numbers[:-1])) > SAME_MM or not steps or max(steps) - min(steps) > SAME_MM or steps[0] <= numbers[-1]:
        text = ", ".join(f"{value:g}" for value in numbers[:-1])
        said.append(
            f"[[zone]]: {name} = {text}: must ascend evenly around 0, more than the width {numbers[-1]:g} apart"
        )
        return {}
    return {"gap_mm": steps[0] - numbers[-1]}


def span_mm(file: Tables, form: PillarShape | None) -> float | None:
    """Return the width of the shared rows between two borders, mm; None while unknown."""
    rows, pitch, foot = file.zone.shared_rows, file.array.pitch_y_mm, footprint_mm(file, form)
    return None if not rows or not pitch or foot is None else (rows - 1) * pitch + foot


def check_zones(file: Tables, form: PillarShape | None) -> Iterator[Diagnostic]:
    """Check that zones do not touch, that the rows between them fit, and that all rows are alike."""
    count, shared, gap = (getattr(file.zone, name) for name in ("count", "shared_rows", "gap_mm"))
    if count == 1:
        for name, value in (("shared_rows", shared), ("gap_mm", gap)):
            if value:
                text = "applies to several zones only: remove it, or raise zone.count"
                yield f"zone.{name}", value, "must be left out with centres_mm" if file.zone.centres_mm else text
    if count is None or count == 1 or shared is None:
        return
    for name in ("heights_mm", "sides_mm", "pitches_y_mm"):
        if values := getattr(file.array, name):
            yield f"array.{name}", values, "applies to a single zone only: between several zones all rows are alike"
    if file.array.stagger:
        yield "array.stagger", True, "applies to a single zone only: between several zones rows are aligned"
    if shared and ("pillar" not in file.present or not file.array.rows):
        yield "zone.shared_rows", shared, "requires a [pillar] and array.rows of 1 or more"
        return
    if not shared and gap is None:
        yield "zone.shared_rows", shared, "the zones touch: must be 1 or more, or give gap_mm"
    span = span_mm(file, form)
    if span is None or gap is None:
        return
    if gap < span - SAME_MM:
        yield "zone.gap_mm", gap, f"must be at least {span:g}, the width of {shared} rows"
    elif shared % 2 and gap > span + SAME_MM:
        text = f"must be even if gap_mm = {gap:g} leaves room: half the rows stand at each border"
        yield "zone.shared_rows", shared, text
