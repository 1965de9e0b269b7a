"""Several zones alike on one plate: `[[zone]]` tables as one table, and what cannot stand between them."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import pairwise
from typing import Any

from geometry.pillar_shapes.base import PillarShape
from pipeline.case.checks import Diagnostic, Values, footprint_mm
from pipeline.errors import InputError

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
