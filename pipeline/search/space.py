"""Search space: keys of the case file between two ends, snapped to values that can be made."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from math import isfinite
from pathlib import Path
from typing import Annotated, Any, Literal, get_args, get_origin

import numpy as np
from pydantic import ConfigDict, TypeAdapter, ValidationError

from geometry.elements import FloatArray
from geometry.layout import Design
from geometry.materials import MATERIALS
from pipeline.case.model import Case, parsed
from pipeline.case.reading import HEIGHTS, SIDES, UNIFORM_ROW_KEYS, apply_overrides, check_exclusive, nearest, toml_text
from pipeline.case.schema import AXES, LISTS, MATERIAL_OWNERS, TABLES, Table, known_keys, of_any_element
from pipeline.errors import InputError
from pipeline.quantity import MM
from pipeline.search.terms import Range, Window

VARIED = ("plate", "zone", "pillar", "array")  # the tables that shape the plate
STEP_MM = 0.01  # printers are no more accurate
EXAMPLE = "such as pillar.height_mm=5:8"
SEVERAL = "zone.centres_mm"  # lists no single numbers
CENTRE = "zone.centre_mm"  # x and y, each between the two ends
WORDS = {"true": True, "false": False}  # and the values that they stand for


@dataclass(frozen=True)
class Variable:
    """One key between two ends, in the file's unit; its values are snapped to the grid `step`.

    A key with one value per row has a `row` (from 1 at the zone), and so have both coordinates of a zone's centre; for a key
    with two words, 0 and 1 stand for `words`.
    """

    key: str
    low: float
    high: float
    step: float
    whole: bool
    row: int | None = None
    words: tuple[str, ...] = ()

    @property
    def name(self) -> str:
        """The key, with its row in brackets if it has one."""
        return self.key if self.row is None else f"{self.key}[{self.row}]"

    def snapped(self, share: float) -> float | int:
        """Value at a share (0 to 1) of the range, snapped to the grid."""
        value = self.low + min(max(share, 0.0), 1.0) * (self.high - self.low)
        value = min(max(self.low + self.step * round((value - self.low) / self.step), self.low), self.high)
        return round(value) if self.whole else round(value, 9)

    def written(self, value: float) -> float | str:
        """Write a value for output: the word if the key has words."""
        return self.words[round(value)] if self.words else round(value) if self.whole else value

    def share(self, value: float) -> float:
        """Share of the range at which a value lies, 0 to 1."""
        return (value - self.low) / (self.high - self.low)


@dataclass(frozen=True)
class Space:
    """A case and the keys that vary."""

    base: Case
    variables: tuple[Variable, ...]

    @property
    def path(self) -> Path:
        """File of the case, or the name that it would have."""
        return self.base.source or Path(f"{self.base.name}.toml")

    @property
    def fixed(self) -> list[str]:
        """The --set texts of the case itself."""
        return [each if isinstance(each, str) else _text(*each) for each in self.base.overrides]

    def values(self, shares: Sequence[float] | FloatArray) -> tuple[float | int, ...]:
        """Snapped values at a point of the unit cube."""
        return tuple(variable.snapped(float(share)) for variable, share in zip(self.variables, shares, strict=True))

    def shares(self, values: Sequence[float]) -> FloatArray:
        """Point of the unit cube at values."""
        return np.array([variable.share(value) for variable, value in zip(self.variables, values, strict=True)])

    def overrides(self, values: Sequence[float | int]) -> list[str]:
        """Return the --set texts of a design."""
        return [_text(*each) for each in _settings(self.variables, values).items()]

    def written(self, values: Sequence[float | int]) -> dict[str, float | str]:
        """Return values by the names of their variables; {} for the design of the file."""
        return {variable.name: variable.written(value) for variable, value in zip(self.variables, values, strict=False)}

    def case(self, values: Sequence[float | int] = (), window: Window | None = None) -> Case:
        """Return the case with these values (none: as in the file), solved in a window; InputError if it cannot be built."""
        changes = _settings(self.variables, values) if values else {}
        return self.base.but(changes | ({"solve.band_kHz": list(window)} if window else {}))

    def own_values(self) -> tuple[float | int, ...] | None:
        """Values of the file itself, snapped; None if one is missing or outside its range."""
        values = [self._own(variable) for variable in self.variables]
        shares = [v.share(value) for v, value in zip(self.variables, values, strict=True) if value is not None]
        inside = len(shares) == len(values) and all(0.0 <= share <= 1.0 for share in shares)
        return self.values(shares) if inside else None

    def _own(self, variable: Variable) -> float | None:
        """Value of a key in the file, as a number for words; None if the file has none."""
        table, _, name = variable.key.rpartition(".")
        raw, design = apply_overrides(self.base.raw, parsed(self.base.overrides)), self.base.design
        value = _at(raw, table).get(name)
        if variable.row is not None:
            return self._of_row(design, variable.key, variable.row)
        if variable.key in AXES and design.larger_m:
            return round(design.centre_m[AXES.index(variable.key)] / MM, 9)
        if variable.key == "zone.gap_mm" and design.zones > 1:
            return round(design.zone_gap_m / MM, 9)
        if variable.words:
            if name == "material":
                value = _material(design, table)
            word = _word(
                dict(_varied())[of_any_element(f"{table}.")[:-1]].model_fields[name].default if value is None else value
            )
            return float(variable.words.index(word)) if word in variable.words else None
        return value if isinstance(value, int | float) else None

    @staticmethod
    def _of_row(design: Design, key: str, row: int) -> float:
        """Value of a key in one row of a design, or along one axis, mm."""
        if key == CENTRE:
            return round(design.centre_m[row - 1] / MM, 9)
        own = {HEIGHTS: design.row_pillars[row - 1].height_m, SIDES: design.row_pillars[row - 1].base_m}
        return round(own.get(key, float(design.row_pitches_m[row - 1])) / MM, 9)


def _at(raw: dict[str, Any], table: str) -> dict[str, Any]:
    """Return a table of a file, or an element of a list of tables, by its dotted name; empty where there is none."""
    found: Any = raw
    for part in table.split(".") if table else ():
        if isinstance(found, list):
            found = found[int(part)] if part.isdecimal() and int(part) < len(found) else {}
        else:
            found = found.get(part, {})
    return found if isinstance(found, dict) else {}


def _material(design: Design, owner: str) -> str:
    """Name of the material of a table, "" for the top of the file."""
    list_name, _, number = owner.rpartition(".")
    if list_name == "pillar.section" and design.pillar:
        return design.pillar.sections[int(number)].material.name
    if list_name == "plate.layer":
        return design.stack.layers[int(number)].material.name
    return ((design.pillar if owner else None) or design).material.name


def _settings(variables: Sequence[Variable], values: Sequence[float | int]) -> dict[str, Any]:
    """Map each key to its value, or to the list of its values per row."""
    found: dict[str, list[Any]] = {}
    for variable, value in zip(variables, values, strict=True):
        written = variable.written(value)
        found.setdefault(variable.key, []).append(WORDS.get(written, written) if isinstance(written, str) else written)
    listed = {variable.key for variable in variables if variable.row}
    return {key: each if key in listed else each[0] for key, each in found.items()}


def _text(key: str, value: Any) -> str:
    """Write KEY=VALUE for --set, words without quotes."""
    if isinstance(value, list):
        return f"{key}=[{','.join(map(toml_text, value))}]"
    return f"{key}={value if isinstance(value, str) else toml_text(value)}"


def space_of(case: Case, ranges: Sequence[Range]) -> Space:
    """Return the search space of a case; InputError, with one line per fault, for ranges that cannot be searched."""
    faults: list[str] = []
    found: dict[str, tuple[Range, list[Variable]]] = {}
    for each in ranges:
        try:
            variable = variable_of(each)
            if variable.key in found:
                raise InputError(f"--vary {each}: {variable.key} is varied already")
            found[variable.key] = each, _rows(case, variable, each)
        except InputError as error:
            faults += error.lines
    variables = [variable for _, rows in found.values() for variable in rows]
    for each, rows in found.values():
        try:
            _check_ends(case, rows, [other for other in variables if other not in rows], each)
        except InputError as error:
            faults += error.lines
    if not ranges:
        faults.append(f"--vary: missing, search needs at least one KEY=LOW:HIGH, {EXAMPLE}")
    keys = {variable.key for variable in variables}
    if "array.rows" in keys and any(variable.row and variable.key != CENTRE for variable in variables):
        faults.append("--vary array.rows: cannot vary together with a key that has one value per row")
    if CENTRE in keys and (own := sorted(keys & {*AXES})):
        faults.append(f"--vary {CENTRE}: cannot vary together with {own[0]}, which it moves, too")
    if not faults:
        check_exclusive([(key, ()) for key in found], "--vary")
    if faults:
        raise InputError(faults)
    return Space(case, tuple(variables))


def variable_of(between: Range) -> Variable:
    """Return the variable of a range; InputError for an unknown key, or ends that are not ascending numbers."""
    key, *ends = between
    known, worded, own = searchable_keys(), word_keys(), of_any_element(key)
    if own in worded:
        words = tuple(word for word in worded[own] if word in map(_word, ends))
        if len(words) != 2:
            others = "" if len(worded[own]) == 2 else f", two of {', '.join(worded[own])}"
            raise InputError(f"--vary {between}: must be {key}={':'.join(worded[own][:2])}{others}")
        return Variable(key, 0.0, 1.0, 1.0, True, None, words)
    if own not in known:
        guess = "" if own in known_keys() else nearest(key, sorted({*known, *worded}))
        allowed = f"must be a number or a choice in one of {', '.join(f'[{table}]' for table in VARIED)}"
        raise InputError(f"--vary {between}: {key} does not set a number of the plate{guess}, {allowed}")
    whole = known[own]
    numbers = [float(n) for n in ends if isinstance(n, int | float) and not isinstance(n, bool) and isfinite(n)]
    if len(numbers) != 2:
        raise InputError(f"--vary {between}: both ends must be numbers, {EXAMPLE}")
    low, high = numbers
    if not low < high:
        raise InputError(f"--vary {between}: the low end must lie below the high end")
    if whole and not (low.is_integer() and high.is_integer()):
        raise InputError(f"--vary {between}: {key} is a count, both ends must be whole numbers")
    return Variable(key, low, high, 1.0 if whole else min(STEP_MM, (high - low) / 10.0), whole)


def searchable_keys() -> dict[str, bool]:
    """Keys with a single number in the tables that shape the plate, and whether it is a whole one."""
    keys: dict[str, bool] = {}
    for table, model in _varied():
        for name, field in model.model_fields.items():
            kind = str(field.annotation)
            if not any(word in kind for word in ("Literal", "str", "bool")):
                keys[f"{table}.{name}"] = "int" in kind
    del keys[SEVERAL]
    return keys


def word_keys() -> dict[str, tuple[str, ...]]:
    """Keys with a choice of words in the tables that shape the plate, and these words."""
    owners = (*MATERIAL_OWNERS, *(f"{name}.0" for name in LISTS))
    words: dict[str, tuple[str, ...]] = {f"{owner}.material".lstrip("."): tuple(MATERIALS) for owner in owners}
    for table, model in _varied():
        for name, field in model.model_fields.items():
            kind = field.annotation
            options = (False, True) if kind is bool else get_args(kind) if get_origin(kind) is Literal else ()
            if len(options) > 1:
                words[f"{table}.{name}"] = tuple(map(_word, options))
    return words


def _varied() -> Iterator[tuple[str, type[Table]]]:
    """Tables and elements of lists that shape the plate, as prefixes of their keys."""
    yield from ((name, TABLES[name]) for name in VARIED)
    yield from ((f"{name}.0", model) for name, model in LISTS.items())


def _word(value: Any) -> str:
    """Write a word for an override."""
    return str(value).lower() if isinstance(value, bool) else str(value)


def _rows(case: Case, variable: Variable, between: Range) -> list[Variable]:
    """Return the variable, or one per row of the file, or per axis, if its key has these values; InputError without rows."""
    if variable.key == CENTRE:
        return [replace(variable, row=axis) for axis in (1, 2)]
    if variable.key not in UNIFORM_ROW_KEYS:
        return [variable]
    rows = case.design.rows
    if not rows:
        raise InputError(f"--vary {between}: {variable.key} has one value per row, but array.rows is 0 or missing")
    return [replace(variable, row=row) for row in range(1, rows + 1)]


def _check_ends(case: Case, variables: list[Variable], others: list[Variable], between: Range) -> None:
    """Raise InputError if the key cannot take an end, or if neither end can be built.

    An end can be built if it works with the other keys as in the file, or with all of them at their low or high ends.
    """
    lines: list[list[str]] = []
    beside = [_settings(others, ends) for ends in ([v.low for v in others], [v.high for v in others])]
    for end in (variables[0].low, variables[0].high):
        own = _settings(variables, [end] * len(variables))
        refused = None
        for more in ({}, *beside):
            try:
                case.but(more | own)
                break
            except InputError as error:
                refused = refused or error.lines
        else:
            assert refused is not None
            lines.append(refused)
            if variables[0].words or not all(_is_allowed(*each) for each in own.items()):
                break
    else:
        if len(lines) < 2:
            return
    raise InputError(f"--vary {between}: {lines[-1][0].partition(': ')[2] or lines[-1][0]}")


def _is_allowed(key: str, value: Any) -> bool:
    """Whether the schema allows a value for a key, regardless of the other keys."""
    table, _, name = of_any_element(key).rpartition(".")
    model = LISTS[table.removesuffix(".0")] if table.endswith(".0") else TABLES[table]
    if name == "material":
        return True
    field = model.model_fields[name]
    try:
        strictly = ConfigDict(strict=True, allow_inf_nan=False)
        kind: Any = Annotated[field.annotation, field]
        TypeAdapter(kind, config=strictly).validate_python(value)
    except ValidationError:
        return False
    return True
