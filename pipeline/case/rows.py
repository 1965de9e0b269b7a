"""Rows that differ: lists with one value a row, from the zone outwards, and the case as each row has it."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from geometry.layout import Design
from geometry.pillar_shapes.shapes import SHAPES
from pipeline.units import MM

Values = dict[str, Any]
HEIGHTS, SIDES, PITCHES = "array.heights_mm", "array.sides_mm", "array.pitches_y_mm"
WIDTHS = tuple(dict.fromkeys(f"pillar.{shape.keys[0]}" for shape in SHAPES.values() if shape.keys[0].endswith("_mm")))
INSTEAD = {HEIGHTS: ("pillar.height_mm",), SIDES: WIDTHS, PITCHES: ("array.pitch_y_mm",)}  # keys of equal rows


def lists_of(good: Values) -> dict[str, list[float]]:
    """The lists that the file has, by the key that equal rows have instead, such as pillar.height_mm."""
    shape = SHAPES.get(good.get("pillar.shape", ""))
    one = {HEIGHTS: "pillar.height_mm", SIDES: f"pillar.{shape.keys[0]}" if shape else "", PITCHES: "array.pitch_y_mm"}
    return {one[key]: good[key] for key in one if good.get(key) and one[key]}


def named(key: str) -> str:
    """The list that stands for a key of equal rows."""
    return next(name for name, others in INSTEAD.items() if key in others)


def normalise_rows(good: Values) -> Iterator[tuple[str, Any, str]]:
    """The first row's values in place of the keys of equal rows from now on, and as many rows as the lists have values."""
    for key in (key for key in INSTEAD if "array" in good and key not in good):  # a faulty list: it is told already
        for other in INSTEAD[key]:
            good.pop(other, None)
    for key in (key for key in INSTEAD if good.get(key)):
        values = good[key]
        if "pillar" not in good or (good.get("pillar.shape") == "step" and key != PITCHES):
            why = (
                "without a [pillar]" if "pillar" not in good else "with a step pillar, which has the sizes of its file"
            )
            yield key, values, f"must be left out {why}"
            good[key] = None
            continue
        if good.get("array.rows", 0) is None:
            good["array.rows"] = len(values)
        rows = good.get("array.rows")
        if rows is not None and len(values) != rows:
            yield key, values, f"{len(values)} values, must be one for each of array.rows = {rows}"
        for other in (*INSTEAD[key], *(("array.pitch_mm",) if key == PITCHES else ())):
            if good.get(other) is not None:
                what = f"must be left out beside {key}" + (": give pitch_x_mm" if other == "array.pitch_mm" else "")
                yield other, good[other], what
    good |= {key: values[0] for key, values in lists_of(good).items() if good.get(key) is None}


def one_kind(design: Design) -> list[str]:
    """KEY=VALUE texts that make every row like the first, for the keys in which rows differ."""
    first, texts = design.pillar, []
    if first and len({pillar.height_m for pillar in design.graded}) > 1:
        texts.append(f"pillar.height_mm={first.height_m / MM:g}")
    if first and len({pillar.base_m for pillar in design.graded}) > 1:
        texts.append(f"pillar.{first.form.keys[0]}={first.base_m / MM:g}")
    return [*texts, *([f"array.pitch_y_mm={design.pitch_y_m / MM:g}"] if design.graded_pitches_m else ())]


def by_row(good: Values) -> list[Values]:
    """The valid values as each row has them; once where all rows are alike."""
    lists = lists_of(good)
    rows = min((len(values) for values in lists.values()), default=1)
    return [good | {key: values[row] for key, values in lists.items()} for row in range(rows)]
