"""Geometry that cannot be built, by name: checks over values that are valid by themselves, in mm, of one zone or of several."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from itertools import combinations, pairwise
from typing import Any

from geometry.layout import PLAIN
from geometry.pillar_shapes.base import PillarShape
from geometry.pillar_shapes.shapes import SHAPES
from pipeline.case import limits
from pipeline.case.schema import SIZE_KEYS
from pipeline.errors import InputError
from pipeline.units import MM

Values = dict[str, Any]
PITCHES = ("pitch_mm", "pitch_x_mm", "pitch_y_mm")
Diagnostic = tuple[str, Any, str]  # key, value, what is wrong and what is allowed
THINNEST = 5000.0
"""Longest side over thickness that the meshers hold.

A structured hexahedron of aspect 100 (still well shaped for orders 2 to 4) then takes 50 elements along the plate; and
eps |K|/omega^2, the share of a bending eigenvalue that rounding may take, grows as (side/thickness)^4: about 0.4 % at
2000 across the clamped width, everything beyond some thousands.
"""


def section_mm(good: Values, form: PillarShape | None) -> float | None:
    """The foot section's width without fillet, mm, also when the shape's name is wrong; None while it is unknown."""
    if form is not None:
        return form.width_m / MM
    shape = SHAPES.get(good.get("pillar.shape", ""))
    widths = (good.get(f"pillar.{each.keys[0]}") for each in ([shape] if shape else SHAPES.values()))
    return next((width for width in widths if isinstance(width, float | int)), None)


def footprint_mm(good: Values, form: PillarShape | None) -> float | None:
    """The largest extent of the foot, fillet included, mm; None while it is unknown."""
    section, fillet = section_mm(good, form), good.get("pillar.fillet_mm")
    if section is None or fillet is None:
        return None
    return section + 2.0 * fillet if form is None else form.footprint_m(MM * fillet) / MM


def _sizes_mm(good: Values) -> dict[str, float]:
    """The lengths of the pillar's shape that are known, mm."""
    return {key: good[f"pillar.{key}"] for key in SIZE_KEYS if key.endswith("_mm") and good.get(f"pillar.{key}")}


def check_pillar_keys(good: Values, form: PillarShape | None) -> Iterator[Diagnostic]:
    """Each shape has its own keys: none missing, none of another shape, sizes that go together."""
    name = good.get("pillar.shape", "")
    shape = SHAPES.get(name)
    if shape is None:
        return
    needed = [*shape.keys, *(("height_mm",) if shape.has_height else ())]
    for part in (*SIZE_KEYS, "height_mm"):
        key = f"pillar.{part}"
        if key in good and good[key] is None and part in needed:
            yield key, None, f"a {name} pillar needs it"
        elif good.get(key) is not None and part not in needed:
            yield key, good[key], f"does not belong to a {name} pillar, which takes {' and '.join(needed)}"
    fillet = good.get("pillar.fillet_mm")
    if fillet and not shape.can_have_fillet:
        yield "pillar.fillet_mm", fillet, f"must be 0 with a {name} pillar: the file has the final shape"
    for part, text in shape.size_violations(_sizes_mm(good) | {"fillet_mm": fillet or 0.0}):
        yield f"pillar.{part}", good[f"pillar.{part}"], text


def check_fillet(good: Values, form: PillarShape | None) -> Iterator[Diagnostic]:
    """The foot fillet ends below the tip."""
    fillet, height = good.get("pillar.fillet_mm"), good.get("pillar.height_mm")
    if fillet and height and fillet >= height:
        yield "pillar.fillet_mm", fillet, f"must be smaller than the pillar's height {height:g} mm"


def normalise_pitch(good: Values) -> Iterator[Diagnostic]:
    """One pitch along x and one along y from now on, whichever keys gave them; pitch_mm alone or both of its parts.

    array.pitch_given names the keys that said it: () for none, absent where one of them is no number.
    """
    known = {name: good.get(f"array.{name}") for name in PITCHES if f"array.{name}" in good}
    given = [name for name, pitch in known.items() if pitch is not None]
    if "pitch_mm" in given and len(given) > 1:
        yield f"array.{given[1]}", known[given[1]], "must be left out beside pitch_mm"
    elif len(given) == 1 and given[0] != "pitch_mm":
        (other,) = {*PITCHES} - {"pitch_mm", given[0]}
        if other in known:
            yield f"array.{other}", None, f"must be given beside {given[0]} (or pitch_mm alone)"
    if len(known) == len(PITCHES):
        good["array.pitch_given"] = tuple(given)
    both = good.pop("array.pitch_mm", None)
    if both is not None:
        good["array.pitch_x_mm"] = good["array.pitch_y_mm"] = both


def check_pitch(good: Values, form: PillarShape | None) -> Iterator[Diagnostic]:
    """Neighbours apart."""
    footprint = footprint_mm(good, form)
    if footprint is None:
        return
    widest = max(footprint, max(form.reach_m()) / MM) if form else footprint
    for name in good.get("array.pitch_given", ()):
        pitch = good["array.pitch_x_mm" if name == "pitch_mm" else f"array.{name}"]
        if pitch <= widest:
            yield f"array.{name}", pitch, f"pillars overlap: must exceed the pillar's footprint {widest:g} mm"
        elif pitch - widest < limits.MIN_GAP * widest:
            text = f"pillars all but touch: must exceed the footprint {widest:g} mm by {limits.MIN_GAP:g} of it"
            yield f"array.{name}", pitch, f"{text}, a gap that a mesh can hold"


def check_tip(good: Values, form: PillarShape | None) -> Iterator[Diagnostic]:
    """A heavy tip stands on a pillar drawn here, beside its neighbours and the rows across the zone."""
    side, height = good.get("tip.side_mm"), good.get("tip.height_mm")
    if "tip" not in good or not side or not height:
        return
    if "pillar" not in good:
        yield "tip.side_mm", side, "needs a [pillar] to stand on"
    elif good.get("pillar.shape") == "step":
        yield "tip.height_mm", height, "must be 0 with a step pillar: the file has the final shape"
    section, width, most = section_mm(good, form), good.get("zone.width_mm"), limits.MAX_SLENDERNESS
    for name, other in (("tip.side_mm", section), ("tip.height_mm", side)):
        given = good[name]
        if other and not 1.0 / most <= given / other <= most:
            yield (
                name,
                given,
                f"must be from {other / most:g} to {other * most:g}, {1.0 / most:g} to {most:g} times {other:g}",
            )
    for name in good.get("array.pitch_given", ()):
        pitch = good["array.pitch_x_mm" if name == "pitch_mm" else f"array.{name}"]
        if pitch - side < limits.MIN_GAP * side:
            yield (
                "tip.side_mm",
                side,
                f"tips touch: must be below array.{name} = {pitch:g} by {limits.MIN_GAP:g} of itself",
            )
    if width and section and good.get("array.rows") != 0 and 2.0 * (side - section) >= width:
        allowed = (
            f"must be below {section + width / 2.0:g}: a tip may reach over a quarter of zone.width_mm = {width:g}"
        )
        yield "tip.side_mm", side, allowed


def check_slenderness(good: Values, form: PillarShape | None) -> Iterator[Diagnostic]:
    """Pillar height, sides and foot fillet differ by no more than beams and elements can follow."""
    height, most, sizes = good.get("pillar.height_mm"), limits.MAX_SLENDERNESS, _sizes_mm(good)
    for name, side in sizes.items():
        if height and not 1.0 / most <= height / side <= most:
            allowed = f"must be from {side / most:g} to {side * most:g}, {1.0 / most:g} to {most:g} times pillar.{name}"
            yield "pillar.height_mm", height, allowed
    for (first, width), (name, side) in combinations(sizes.items(), 2):
        if not 1.0 / most <= side / width <= most:
            allowed = f"must be from {width / most:g} to {width * most:g}, beside pillar.{first} = {width:g}"
            yield f"pillar.{name}", side, allowed
    fillet, section = good.get("pillar.fillet_mm"), section_mm(good, form)
    if fillet and section and fillet < section / most:
        yield "pillar.fillet_mm", fillet, f"must be 0, or at least {section / most:g}, {1.0 / most:g} of the foot"


def check_pillar_on_plate(good: Values, form: PillarShape | None) -> Iterator[Diagnostic]:
    """The pillars' feet and the passive rim are no needles beside the plate's thickness; fewer than a million pillars."""
    thickness, section, most = good.get("plate.thickness_mm"), section_mm(good, form), limits.MAX_SLENDERNESS
    if thickness and section and good.get("array.rows") != 0 and thickness > most * section:
        limit = f"must be at most {most * section:g}, {most:g} times the pillar's foot of {section:g} mm"
        yield "plate.thickness_mm", thickness, limit
    rim = good.get("array.extension_mm")
    if thickness and rim and rim < thickness / most:
        limit = f"must be 0, or at least {thickness / most:g}, {1.0 / most:g} of plate.thickness_mm"
        yield "array.extension_mm", rim, limit
    rows, length, pitch = good.get("array.rows"), good.get("zone.length_mm"), good.get("array.pitch_x_mm")
    if rows and length and pitch and 2.0 * rows * (length / pitch + 1.0) > limits.MAX_PILLARS:
        count = int(2.0 * rows * (length / pitch + 1.0))
        yield (
            "array.rows",
            rows,
            f"{count} pillars: no more than {limits.MAX_PILLARS} can be assembled (rows x columns)",
        )


def check_nodal_lines(good: Values, form: PillarShape | None) -> Iterator[Diagnostic]:
    """The wanted mode's flexural wave is longer than the plate is thick: a shorter one is two separate surface waves."""
    lines, length, thickness = (good.get(key) for key in ("zone.nodal_lines", "zone.length_mm", "plate.thickness_mm"))
    if lines and length and thickness and lines > 1 and 2.0 * length / lines < thickness:
        most = max(1, int(2.0 * length / thickness))
        text = f"must be at most {most}: the wave would be shorter than the plate is thick, {thickness:g} mm"
        yield "zone.nodal_lines", lines, text


def check_zone_width(good: Values, form: PillarShape | None) -> Iterator[Diagnostic]:
    """The zone holds at least two pillar sides between its rows."""
    width, side = good.get("zone.width_mm"), section_mm(good, form)
    if width is not None and side is not None and good.get("array.rows") != 0 and width < 2.0 * side:
        yield "zone.width_mm", width, f"zone narrower than two pillar sides: must be at least {2.0 * side:g} mm"


def check_row_fits(good: Values, form: PillarShape | None) -> Iterator[Diagnostic]:
    """A row of at least one pillar fits along the zone."""
    length, footprint = good.get("zone.length_mm"), footprint_mm(good, form)
    footprint = max(footprint, good.get("tip.side_mm") or 0.0) if footprint and good.get("tip.height_mm") else footprint
    if length is not None and footprint is not None and good.get("array.rows") != 0 and footprint > length:
        yield "zone.length_mm", length, f"pillar row outside the plate: must be at least the footprint {footprint:g} mm"
    rows, pitch = good.get("array.rows") or 0, good.get("array.pitch_x_mm")
    if good.get("array.stagger") and rows > 1 and length and pitch and footprint and length < pitch + footprint:
        yield (
            "array.stagger",
            True,
            f"a shifted row holds no pillar: zone.length_mm must be at least {pitch + footprint:g}",
        )


def _whole_width(good: Values, form: PillarShape | None) -> list[float]:
    """The plate's width across the zone, mm, in a list that is empty while the zone's width is unknown."""
    width, rows = good.get("zone.width_mm"), good.get("array.rows") or 0
    if width is None:
        return []
    pitch = good.get("array.pitch_y_mm") or 0.0
    span = (rows - 1) * pitch + (footprint_mm(good, form) or 0.0) if rows else 0.0
    return [width + 2.0 * (span + (good.get("array.extension_mm") or 0.0))]


def check_thickness(good: Values, form: PillarShape | None) -> Iterator[Diagnostic]:
    """The plate is not thinner than the mesher can hold."""
    thickness = good.get("plate.thickness_mm")
    names = ("zone.length_mm", "array.pitch_x_mm", "array.pitch_y_mm")
    sides = [good[name] for name in names if good.get(name) is not None] + _whole_width(good, form)
    longest = max(sides, default=None)
    if thickness is not None and longest is not None and longest / thickness > THINNEST:
        yield (
            "plate.thickness_mm",
            thickness,
            f"plate thinner than the mesher can hold: must be at least {longest / THINNEST:g} mm "
            f"(the longest side {longest:g} mm over {THINNEST:g})",
        )


def check_not_a_block(good: Values, form: PillarShape | None) -> Iterator[Diagnostic]:
    """The plate is thinner than its zone is wide; else a unit was mistaken."""
    thickness, width = good.get("plate.thickness_mm"), good.get("zone.width_mm")
    if thickness is not None and width is not None and thickness > width:
        yield (
            "plate.thickness_mm",
            thickness,
            f"must be at most zone.width_mm = {width:g}: a plate, not a block (lengths are in mm)",
        )


def check_rows(good: Values, form: PillarShape | None) -> Iterator[Diagnostic]:
    """Rows need a pillar and a pitch."""
    rows = good.get("array.rows")
    if not rows:
        return
    if "pillar" not in good:
        yield "array.rows", rows, "must be 0 without a [pillar]"
    if good.get("array.pitch_given") == ():
        yield "array.pitch_mm", None, "rows need a pitch: pitch_mm, or pitch_x_mm and pitch_y_mm"


def check_solve(good: Values, form: PillarShape | None) -> Iterator[Diagnostic]:
    """A rising band, or a target with a count, not both."""
    band, near, count = (good.get(f"solve.{name}") for name in ("band_kHz", "near_kHz", "count"))
    if band is not None and not (band[0] < band[1] and band[1] >= limits.FREQUENCY_KHZ[0]):
        least = f"high from {limits.FREQUENCY_KHZ[0]:g} on"
        yield "solve.band_kHz", band, f"must be two numbers [low, high], 0 <= low < high, {least}"
    if band is not None and near is not None:
        yield "solve.near_kHz", near, "must be left out beside band_kHz"
    if band is not None and near is None and count is not None:
        yield "solve.count", count, "goes with near_kHz, must be left out beside band_kHz"


def check_path(good: Values, form: PillarShape | None) -> Iterator[Diagnostic]:
    """Neighbouring points of the wavevector path differ."""
    path = good.get("bands.path")
    if path and any(a == b for a, b in pairwise(path)):
        yield "bands.path", path, "must not repeat a point twice in a row"


def check_patch_keys(good: Values, form: PillarShape | None) -> Iterator[Diagnostic]:
    """Centres or antinodes, not both; antinodes need a zone; sensors counted once."""
    if "patches" not in good:
        return
    at, centres, sensors = (good.get(f"patches.{name}") for name in ("at", "centres_mm", "sensors"))
    if at and centres:
        yield "patches.at", at, "must be left out beside centres_mm"
    if centres and good.get("patches.behind_mm"):
        yield "patches.behind_mm", good["patches.behind_mm"], "must be left out beside centres_mm"
    if not centres and "zone" not in good and {"patches.at", "patches.centres_mm"} <= good.keys():
        yield "patches.at", at or "antinodes", "needs a [zone] (or give centres_mm)"
    if sensors and len(set(sensors)) < len(sensors):
        yield "patches.sensors", sensors, "must name each patch once"


def check_measured(good: Values, form: PillarShape | None) -> Iterator[Diagnostic]:
    """Something was measured, on a plate with patches; a laser's place belongs to a sweep."""
    if "measured" not in good:
        return
    sweep, field, place = (good.get(f"measured.{name}") for name in ("sweep", "map", "at_mm"))
    if not (sweep or field):
        yield "measured.sweep", None, "a [measured] table names a sweep, a map or both"
    if place and not sweep:
        yield "measured.at_mm", place, "must be left out without measured.sweep"
    if "patches" not in good:
        yield "measured.sweep", sweep, "needs [patches]: what was measured is compared with their response"


def check_tolerance(good: Values, form: PillarShape | None) -> Iterator[Diagnostic]:
    """Something varies, on pillars that grow as a whole, and three standard deviations leave each a body and its place."""
    if "tolerance" not in good:
        return
    sizes = {name: good.get(f"tolerance.{name}_mm") for name in ("height", "side", "position")}
    height, side, position = sizes.values()
    if height is None or side is None or position is None:
        return
    if not (height or side or position):
        yield "tolerance.height_mm", height, "nothing varies: height_mm, side_mm or position_mm must be above 0"
    if good.get("array.stagger"):
        yield "tolerance.height_mm", height, "must be left out beside array.stagger = true"
    plain = good.get("pillar.fillet_mm") == 0.0 and not good.get("tip.height_mm") and good.get("pillar.faces") != "both"
    if form is not None and not (form.grows and plain):
        yield "tolerance.height_mm", height, f"only {PLAIN} can be varied"
        return
    if "pillar" not in good or good.get("array.rows") == 0:
        yield "tolerance.height_mm", height, "needs a [pillar] and array.rows above 0"
        return
    width = form.keys[0] if form else "side_mm"
    tall, wide = good.get("pillar.height_mm"), good.get(f"pillar.{width}")
    for name, given, key, whole in (("height", height, "height_mm", tall), ("side", side, width, wide)):
        if whole and 3.0 * given >= whole:
            yield f"tolerance.{name}_mm", given, f"must be below {whole / 3.0:g}, a third of pillar.{key}"
    if form is not None and wide:
        yield from _room_between(good, form, wide, 3.0 * side, position)


def _room_between(good: Values, form: PillarShape, wide: float, grown: float, position: float) -> Iterator[Diagnostic]:
    """Pillars so much wider that stand off by three standard deviations do not touch; all in mm."""
    ratios = [extent / form.width_m for extent in form.reach_m()]
    pitches = [good.get(f"array.{name}") for name in PITCHES[1:]]
    room = min((pitch - wide * ratio for pitch, ratio in zip(pitches, ratios, strict=True) if pitch), default=None)
    if room is not None and grown * max(ratios) + 6.0 * position >= room > 0.0:
        text = f"pillars may touch: 3 side_mm + 6 position_mm must be below the room {room:g} mm between two of them"
        yield "tolerance.position_mm", position, text


CHECKS: tuple[Callable[[Values, PillarShape | None], Iterator[Diagnostic]], ...] = (
    check_pillar_keys,
    check_fillet,
    check_slenderness,
    check_pitch,
    check_tip,
    check_pillar_on_plate,
    check_nodal_lines,
    check_zone_width,
    check_row_fits,
    check_thickness,
    check_not_a_block,
    check_rows,
    check_solve,
    check_path,
    check_patch_keys,
    check_measured,
    check_tolerance,
)


CENTRE = "centre_y_mm"
SAME_MM = 1e-6


def one_table(raw: dict[str, Any], source: str) -> dict[str, Any]:
    """The parsed file with `[[zone]]` tables as one [zone] with count, shared_rows and gap_mm; any other as it is.

    InputError, one line a fault, for zones that are not alike or not evenly spaced about y = 0.
    """
    tables = raw.get("zone")
    if not isinstance(tables, list) or not all(isinstance(table, dict) for table in tables) or not tables:
        return raw
    first = {key: value for key, value in tables[0].items() if key != CENTRE}
    said = [
        f"[[zone]]: count = {table['count']}: must be left out, the tables are counted"
        for table in tables
        if "count" in table
    ]
    if any("centre_x_mm" in table for table in tables):
        said.append(
            "[[zone]]: centre_x_mm: must be left out, zones lie side by side along y and are as long as the plate"
        )
        tables = [{key: value for key, value in table.items() if key != "centre_x_mm"} for table in tables]
    for number, table in enumerate(tables[1:], start=2):
        for key, value in table.items():
            if key not in (CENTRE, "shared_rows") and first.get(key) != value:
                said.append(
                    f"[[zone]] {number}: {key} = {value}: must be {first.get(key, 'left out')} as in the first: zones are alike"
                )
    shared = {table["shared_rows"] for table in tables[1:] if "shared_rows" in table}
    if len(shared) > 1:
        said.append(
            f"[[zone]]: shared_rows = {', '.join(map(str, sorted(shared)))}: must be the same between all zones"
        )
    merged = first | {"count": len(tables)} | ({"shared_rows": shared.pop()} if shared else {})
    merged |= _gap(tables, said)
    if said:
        raise InputError(f"{source}: {text}" for text in said)
    return raw | {"zone": merged}


def _gap(tables: list[dict[str, Any]], said: list[str]) -> dict[str, Any]:
    """gap_mm by the zones' centres, where they are given."""
    centres, width = [table[CENTRE] for table in tables if CENTRE in table], tables[0].get("width_mm")
    if not centres:
        return {}
    numbers = [value for value in (*centres, width) if isinstance(value, int | float) and not isinstance(value, bool)]
    if len(numbers) != len(tables) + 1:
        said.append(f"[[zone]]: {CENTRE}: must be a number in every table or in none")
        return {}
    steps = [high - low for low, high in pairwise(numbers[:-1])]
    if len(tables) == 1 and abs(numbers[0]) <= SAME_MM:
        return {}
    if abs(sum(numbers[:-1])) > SAME_MM or not steps or max(steps) - min(steps) > SAME_MM or steps[0] <= numbers[-1]:
        text = ", ".join(f"{value:g}" for value in numbers[:-1])
        said.append(
            f"[[zone]]: {CENTRE} = {text}: must ascend evenly about 0, more than the width {numbers[-1]:g} apart"
        )
        return {}
    return {"gap_mm": steps[0] - numbers[-1]}


def span_mm(good: Values, form: PillarShape | None) -> float | None:
    """What the shared rows take between two borders, mm; None while it is unknown."""
    rows, pitch, foot = good.get("zone.shared_rows"), good.get("array.pitch_y_mm"), footprint_mm(good, form)
    return None if not rows or not pitch or foot is None else (rows - 1) * pitch + foot


def check_zones(good: Values, form: PillarShape | None) -> Iterator[Diagnostic]:
    """Zones apart, rows between them that fit, and one kind of row."""
    count, shared, gap = (good.get(f"zone.{name}") for name in ("count", "shared_rows", "gap_mm"))
    if count == 1:
        for name, value in (("shared_rows", shared), ("gap_mm", gap)):
            if value:
                yield f"zone.{name}", value, "must be left out with one zone"
    if count is None or count == 1 or shared is None:
        return
    for name in ("heights_mm", "sides_mm", "pitches_y_mm"):
        if values := good.get(f"array.{name}"):
            yield f"array.{name}", values, "must be left out with several zones, between which rows have no order"
    if good.get("array.stagger"):
        yield "array.stagger", True, "must be left out with several zones, between which rows stand in line"
    if shared and ("pillar" not in good or not good.get("array.rows")):
        yield "zone.shared_rows", shared, "needs a [pillar] and array.rows of 1 or more"
        return
    if not shared and gap is None:
        yield "zone.shared_rows", shared, "the zones touch: must be 1 or more, or give gap_mm"
    span = span_mm(good, form)
    if span is None or gap is None:
        return
    if gap < span - SAME_MM:
        yield "zone.gap_mm", gap, f"must be at least {span:g}, which {shared} rows take"
    elif shared % 2 and gap > span + SAME_MM:
        yield (
            "zone.shared_rows",
            shared,
            f"must be even where the gap {gap:g} mm leaves room: half stand at each border",
        )
