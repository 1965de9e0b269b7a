"""Reading a parsed case file: every table checked, every fault collected, values still in the file's units."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from geometry.cad.step_pillar import StepPillar, load_step_pillar
from geometry.errors import GeometryError
from geometry.materials import MATERIALS, Material
from pipeline.case.checks import CHECKS
from pipeline.case.diagnostics import Diagnostics, check_table, nearest
from pipeline.case.limits import MAX_CONTRAST
from pipeline.case.schema import MATERIAL_ALLOWED, MATERIAL_OWNERS, NAME_ALLOWED, TABLES, MaterialTable, known_keys

MM = 1e-3
KHZ = 1e3
GPA = 1e9
ALWAYS = ("solve", "bands", "damping")  # tables that hold settings only: absent means their defaults


@dataclass(frozen=True)
class CaseValues:
    """What the file says, faults included; good holds the valid values by dotted key, defaults filled in."""

    name: str
    good: dict[str, Any]
    materials: dict[str, Material]
    step: StepPillar | None
    step_file: str | None
    given: frozenset[str]
    faults: Diagnostics


def read_values(raw: dict[str, Any], source: Path | None, overridden: Iterable[str]) -> CaseValues:
    """Check a parsed case file table by table, then across tables; nothing is raised, `faults` has the lines."""
    faults = Diagnostics(str(source) if source is not None else "case", overridden)
    known = known_keys()
    good: dict[str, Any] = {}
    materials: dict[str, Material] = {}
    for key in raw:
        if key not in TABLES and key not in ("name", "material"):
            faults.unknown(key, raw[key], [*known, *TABLES] if not isinstance(raw[key], dict) else [*TABLES])
    for table, model in TABLES.items():
        if table not in raw and table not in ALWAYS:
            continue
        content = raw.get(table, {})
        if not isinstance(content, dict):
            faults.add(table, content, f"must be a table [{table}]")
            continue
        good |= {table: True} | check_table(model, _without_material(table, content), f"{table}.", known, faults)
    for owner in MATERIAL_OWNERS:
        _read_material(raw if owner == "" else raw.get(owner, {}), owner, materials, known, faults)
    _check_contrast(materials, faults)
    name = _read_name(raw, source, faults)
    step_file, step = _read_step(good, source, faults)
    _check_across(good, step, faults)
    return CaseValues(name, good, materials, step, step_file, _given(raw), faults)


def _without_material(table: str, content: dict[str, Any]) -> dict[str, Any]:
    hidden = "material" if table in MATERIAL_OWNERS else None
    return {key: value for key, value in content.items() if key != hidden}


def _read_material(
    owner_table: Any, owner: str, materials: dict[str, Material], known: list[str], faults: Diagnostics
) -> None:
    key = f"{owner}.material".lstrip(".")
    if not isinstance(owner_table, dict) or "material" not in owner_table:
        if owner == "":
            faults.missing(key, f"must be {MATERIAL_ALLOWED} ({', '.join(MATERIALS)})")
        return
    value = owner_table["material"]
    if isinstance(value, str):
        if value in MATERIALS:
            materials[owner] = MATERIALS[value]
        else:
            faults.add(key, value, f"must be one of {', '.join(MATERIALS)} or a table{nearest(value, MATERIALS)}")
    elif isinstance(value, dict):
        before = len(faults.lines)
        good = check_table(MaterialTable, value, f"{key}.", known, faults)
        if len(faults.lines) == before:
            young, density, poisson = (good[f"{key}.{name}"] for name in MaterialTable.model_fields)
            materials[owner] = Material("given", GPA * young, float(density), float(poisson))
    else:
        faults.add(key, value, f"must be {MATERIAL_ALLOWED}")


def _check_contrast(materials: dict[str, Material], faults: Diagnostics) -> None:
    """One line where plate and pillar differ in stiffness by more than one matrix can hold."""
    if set(materials) != {"", "pillar"}:
        return
    plate, pillar = (materials[owner].young_pa / GPA for owner in ("", "pillar"))
    if max(plate, pillar) > MAX_CONTRAST * min(plate, pillar):
        limit = f"must be within a factor of {MAX_CONTRAST:g} of the plate's {plate:g} GPa"
        faults.add("pillar.material.young_GPa", pillar, limit)


def _read_name(raw: dict[str, Any], source: Path | None, faults: Diagnostics) -> str:
    name = raw.get("name", source.stem if source is not None else "case")
    if not (isinstance(name, str) and 0 < len(name) <= 100 and name.isprintable() and not set(name) & set("/\\")):
        faults.add("name", name, f"must be {NAME_ALLOWED}")
    return str(name)


def _read_step(good: dict[str, Any], source: Path | None, faults: Diagnostics) -> tuple[str | None, StepPillar | None]:
    """Path and measures of the STEP pillar; CAD is imported only here, and only for shape = "step"."""
    file = good.get("pillar.file")
    if good.get("pillar.shape") != "step" or file is None:
        return None, None
    path = (source.parent if source is not None else Path()) / file
    try:
        return str(path), load_step_pillar(path)
    except GeometryError as error:
        faults.add("pillar.file", file, str(error).removeprefix(f"{path}: "))
        return str(path), None


def _check_across(good: dict[str, Any], step: StepPillar | None, faults: Diagnostics) -> None:
    for check in CHECKS:
        for key, value, text in check(good, step):
            if value is None:
                faults.missing(key, text)
            else:
                faults.add(key, value, text)


def _given(raw: dict[str, Any]) -> frozenset[str]:
    """The tables and dotted keys that the file has."""
    keys = set(raw)
    for table, content in raw.items():
        if isinstance(content, dict):
            keys |= {f"{table}.{name}" for name in content}
    if {"array.pitch_x_mm", "array.pitch_y_mm"} <= keys:
        keys.add("array.pitch_mm")
    return frozenset(keys)
