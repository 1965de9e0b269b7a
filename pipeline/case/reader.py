"""Reading a parsed case file: every table checked, every fault collected, values still in the file's units."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from itertools import chain
from pathlib import Path
from typing import Any

from geometry.errors import GeometryError
from geometry.materials import MATERIALS, Material
from geometry.pillar_shapes.base import PillarShape
from geometry.pillar_shapes.shapes import SHAPES
from pipeline.case.checks import CHECKS, Diagnostic, normalise_pitch
from pipeline.case.diagnostics import Diagnostics, check_table, nearest
from pipeline.case.limits import MAX_CONTRAST
from pipeline.case.rows import INSTEAD, PITCHES, by_row, lists_of, named, normalise_rows
from pipeline.case.schema import MATERIAL_ALLOWED, MATERIAL_OWNERS, NAME_ALLOWED, TABLES, MaterialTable, known_keys
from pipeline.case.zones import check_zones
from pipeline.units import GPA

ALWAYS = ("solve", "bands", "damping")  # tables that hold settings only: absent means their defaults


@dataclass(frozen=True)
class CaseValues:
    """What the file says, faults included; good holds the valid values by dotted key, defaults filled in."""

    name: str
    good: dict[str, Any]
    materials: dict[str, Material]
    rows: tuple[tuple[dict[str, Any], PillarShape | None], ...]  # as each row has them, once where all rows are alike
    given: frozenset[str]
    diagnostics: Diagnostics


def read_values(raw: dict[str, Any], source: Path | None, overridden: Iterable[str]) -> CaseValues:
    """Check a parsed case file table by table, then across tables; nothing is raised, `diagnostics` has the lines."""
    diagnostics = Diagnostics(str(source) if source is not None else "case", overridden)
    known = known_keys()
    good: dict[str, Any] = {}
    materials: dict[str, Material] = {}
    for key in raw:
        if key not in TABLES and key not in ("name", "material"):
            diagnostics.unknown(key, raw[key], [*known, *TABLES] if not isinstance(raw[key], dict) else [*TABLES])
    for table, model in TABLES.items():
        if table not in raw and table not in ALWAYS:
            continue
        content = raw.get(table, {})
        if not isinstance(content, dict):
            diagnostics.add(table, content, f"must be a table [{table}]")
            continue
        hidden = "material" if table in MATERIAL_OWNERS else None
        own = {key: value for key, value in content.items() if key != hidden}
        good |= {table: True} | check_table(model, own, f"{table}.", known, diagnostics)
    for owner in MATERIAL_OWNERS:
        _read_material(raw if owner == "" else raw.get(owner, {}), owner, materials, known, diagnostics)
    _check_contrast(materials, diagnostics)
    name = _read_name(raw, source, diagnostics)
    _add_all(chain(normalise_rows(good), normalise_pitch(good)), diagnostics)
    rows = tuple((own, _read_shape(own, source, diagnostics)) for own in by_row(good))
    _check_across(rows, diagnostics)
    return CaseValues(name, good, materials, rows, _given(raw), diagnostics)


def _read_material(
    owner_table: Any, owner: str, materials: dict[str, Material], known: list[str], diagnostics: Diagnostics
) -> None:
    key = f"{owner}.material".lstrip(".")
    if not isinstance(owner_table, dict) or "material" not in owner_table:
        if owner == "":
            diagnostics.missing(key, f"must be {MATERIAL_ALLOWED} ({', '.join(MATERIALS)})")
        return
    value = owner_table["material"]
    if isinstance(value, str):
        if value in MATERIALS:
            materials[owner] = MATERIALS[value]
        else:
            diagnostics.add(key, value, f"must be one of {', '.join(MATERIALS)} or a table{nearest(value, MATERIALS)}")
    elif isinstance(value, dict):
        before = len(diagnostics.lines)
        good = check_table(MaterialTable, value, f"{key}.", known, diagnostics)
        if len(diagnostics.lines) == before:
            young, density, poisson = (good[f"{key}.{name}"] for name in MaterialTable.model_fields)
            materials[owner] = Material("given", GPA * young, float(density), float(poisson))
    else:
        diagnostics.add(key, value, f"must be {MATERIAL_ALLOWED}")


def _check_contrast(materials: dict[str, Material], diagnostics: Diagnostics) -> None:
    """One line where plate and pillar or tip differ in stiffness by more than one matrix can hold."""
    young = {owner: material.young_pa / GPA for owner, material in materials.items()}
    plate = young.pop("", None)
    for owner, other in young.items():
        if plate is not None and max(plate, other) > MAX_CONTRAST * min(plate, other):
            limit = f"must be within a factor of {MAX_CONTRAST:g} of the plate's {plate:g} GPa"
            diagnostics.add(f"{owner}.material.young_GPa", other, limit)


def _read_name(raw: dict[str, Any], source: Path | None, diagnostics: Diagnostics) -> str:
    name = raw.get("name", source.stem if source is not None else "case")
    if not (isinstance(name, str) and 0 < len(name) <= 100 and name.isprintable() and not set(name) & set("/\\")):
        diagnostics.add("name", name, f"must be {NAME_ALLOWED}")
    return str(name)


def _read_shape(good: dict[str, Any], source: Path | None, diagnostics: Diagnostics) -> PillarShape | None:
    """The pillar's shape with its sizes; None while some are missing. A STEP file is read here, with CAD."""
    shape = SHAPES.get(good.get("pillar.shape", ""))
    if shape is None or any(good.get(f"pillar.{key}") is None for key in shape.keys):
        return None
    given = {key: good[f"pillar.{key}"] for key in shape.keys}
    try:
        return shape.from_case(given, source.parent if source is not None else Path())
    except GeometryError as error:
        file = good.get("pillar.file")
        diagnostics.add("pillar.file", file, str(error).rpartition(f"{file}: ")[2])
        return None


def _check_across(rows: tuple[tuple[dict[str, Any], PillarShape | None], ...], diagnostics: Diagnostics) -> None:
    for number, (good, form) in enumerate(rows, start=1):
        _add_all(
            (_of_row(number, fault, good) for check in (*CHECKS, check_zones) for fault in check(good, form)),
            diagnostics,
        )


def _of_row(number: int, fault: Diagnostic, good: dict[str, Any]) -> Diagnostic:
    """A fault of a row's value, at the list that holds it."""
    key, _, text = fault
    return (named(key), good[named(key)], f"row {number}: {text}") if key in lists_of(good) else fault


def _add_all(faults: Iterable[Diagnostic], diagnostics: Diagnostics) -> None:
    for key, value, text in faults:
        if value is None:
            diagnostics.missing(key, text)
        else:
            diagnostics.add(key, value, text)


def _given(raw: dict[str, Any]) -> frozenset[str]:
    """The tables and dotted keys that the file has."""
    keys = set(raw)
    for table, content in raw.items():
        if isinstance(content, dict):
            keys |= {f"{table}.{name}" for name in content}
    if keys & {*INSTEAD}:
        keys.add("array.rows")
    if "array.pitch_x_mm" in keys and keys & {"array.pitch_y_mm", PITCHES}:
        keys.add("array.pitch_mm")
    return frozenset(keys)
