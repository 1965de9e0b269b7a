"""What a search may change: keys of the case file between two ends, snapped to what can be made."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import isfinite
from pathlib import Path
from typing import Any, Literal, get_args, get_origin

import numpy as np

from geometry.elements import FloatArray
from geometry.layout import Design
from geometry.materials import MATERIALS
from pipeline.case.diagnostics import nearest
from pipeline.case.model import Case, case_from_dict
from pipeline.case.overrides import apply_overrides, parse_override, parse_value, read_toml
from pipeline.case.rows import HEIGHTS, INSTEAD, SIDES
from pipeline.case.schema import MATERIAL_OWNERS, TABLES, known_keys
from pipeline.case.zones import one_table
from pipeline.errors import InputError
from pipeline.units import MM

VARIED = ("plate", "zone", "pillar", "tip", "array")  # the tables that shape the plate
STEP_MM = 0.01  # a printer holds no more
EXAMPLE = "such as pillar.height_mm=5:8"


@dataclass(frozen=True)
class Variable:
    """One key between two ends, in the file's unit; `step` is the grid that its values are snapped to.

    Of a key with one value a row, `row` (from 1 at the zone) tells whose; of a key with two words, 0 and 1 stand for `words`.
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
        """The key, and the row in brackets where it has one."""
        return self.key if self.row is None else f"{self.key}[{self.row}]"

    def snapped(self, share: float) -> float | int:
        """The value at a share (0 to 1) of the way, on the grid and between the ends."""
        value = self.low + min(max(share, 0.0), 1.0) * (self.high - self.low)
        value = min(max(self.low + self.step * round((value - self.low) / self.step), self.low), self.high)
        return round(value) if self.whole else round(value, 9)

    def written(self, value: float) -> float | str:
        """A value as it is told: the word where the key has words."""
        return self.words[round(value)] if self.words else value

    def share(self, value: float) -> float:
        """Where a value lies between the ends, 0 to 1."""
        return (value - self.low) / (self.high - self.low)


@dataclass(frozen=True)
class Space:
    """A case file and the keys that vary."""

    path: Path
    raw: dict[str, Any]
    fixed: tuple[str, ...]
    variables: tuple[Variable, ...]

    def values(self, shares: Sequence[float] | FloatArray) -> tuple[float | int, ...]:
        """Snapped values at a point of the unit cube."""
        return tuple(variable.snapped(float(share)) for variable, share in zip(self.variables, shares, strict=True))

    def shares(self, values: Sequence[float]) -> FloatArray:
        """The point of the unit cube at values."""
        return np.array([variable.share(value) for variable, value in zip(self.variables, values, strict=True)])

    def overrides(self, values: Sequence[float | int]) -> list[str]:
        """The --set texts that make a design."""
        return _overrides(self.variables, values)

    def written(self, values: Sequence[float | int]) -> list[float | str]:
        """Values as they are told, words where a key has them."""
        return [variable.written(value) for variable, value in zip(self.variables, values, strict=True)]

    def case(self, values: Sequence[float | int] = (), more: Sequence[str] = ()) -> Case:
        """The scene with these values (none: as the file has it) and more overrides. InputError for what cannot be built."""
        return case_from_dict(self.raw, self.path, [*self.fixed, *(self.overrides(values) if values else ()), *more])

    def own_values(self) -> tuple[float | int, ...] | None:
        """The values that the file itself has, snapped; None where it lacks one or has it outside the ends."""
        values = [self._own(variable) for variable in self.variables]
        shares = [v.share(value) for v, value in zip(self.variables, values, strict=True) if value is not None]
        inside = len(shares) == len(values) and all(0.0 <= share <= 1.0 for share in shares)
        return self.values(shares) if inside else None

    def _own(self, variable: Variable) -> float | None:
        """The file's own value of a key, of one with words its number; None where it has none."""
        table, _, name = variable.key.rpartition(".")
        raw = apply_overrides(self.raw, [parse_override(text) for text in self.fixed])
        value = (raw.get(table, {}) if table else raw).get(name)
        design = self.case().design
        if variable.row is not None:
            return self._of_row(design, variable.key, variable.row)
        if variable.key == "zone.gap_mm" and design.zones > 1:
            return round(design.zone_gap_m / MM, 9)
        if variable.words:
            if name == "material":
                value = _material(design, table)
            word = _word(TABLES[table].model_fields[name].default if value is None else value)
            return float(variable.words.index(word)) if word in variable.words else None
        return value if isinstance(value, int | float) else None

    @staticmethod
    def _of_row(design: Design, key: str, row: int) -> float:
        """The value that a design has in a row, mm."""
        own = {HEIGHTS: design.row_pillars[row - 1].height_m, SIDES: design.row_pillars[row - 1].base_m}
        return round(own.get(key, float(design.row_pitches_m[row - 1])) / MM, 9)


def _material(design: Design, owner: str) -> str:
    """Name of the material of a table, "" for the top of the file."""
    pillar = design.pillar if owner else None
    return (pillar.tip if pillar and pillar.tip and owner == "tip" else pillar or design).material.name


def _overrides(variables: Sequence[Variable], values: Sequence[float | int]) -> list[str]:
    """KEY=VALUE of each key, KEY=[...] of one with a value a row."""
    texts: dict[str, list[str]] = {}
    for variable, value in zip(variables, values, strict=True):
        written = variable.written(value)
        texts.setdefault(variable.key, []).append(written if isinstance(written, str) else f"{written:g}")
    listed = {variable.key for variable in variables if variable.row}
    return [f"{key}=[{','.join(each)}]" if key in listed else f"{key}={each[0]}" for key, each in texts.items()]


def read_space(path: str, fixed: Sequence[str], texts: Sequence[str]) -> Space:
    """The search space of a case file. InputError, one line a fault, for a --vary that cannot be searched."""
    file = Path(path)
    raw = read_toml(file)
    case_from_dict(raw, file, fixed)  # a fault of the file itself is told first
    return space_of(raw, file, fixed, texts)


def space_of(raw: dict[str, Any], file: Path, fixed: Sequence[str], texts: Sequence[str]) -> Space:
    """The search space of a parsed case. InputError as read_space."""
    raw = one_table(raw, str(file))
    faults: list[str] = []
    parsed: dict[str, tuple[str, list[Variable]]] = {}
    for text in texts:
        try:
            variable = parse_vary(text)
            if variable.key in parsed:
                raise InputError(f"--vary {text}: {variable.key} is varied already")
            parsed[variable.key] = text, _rows(raw, file, fixed, variable, text)
        except InputError as error:
            faults += error.lines
    variables = [variable for _, rows in parsed.values() for variable in rows]
    for text, rows in parsed.values():
        try:
            _check_ends(raw, file, fixed, rows, [each for each in variables if each not in rows], text)
        except InputError as error:
            faults += error.lines
    if not texts:
        faults.append(f"--vary: missing, search needs at least one KEY=LOW:HIGH, {EXAMPLE}")
    if any(variable.row for variable in variables) and "array.rows" in {variable.key for variable in variables}:
        faults.append("--vary array.rows: must be left alone beside a key with one value a row")
    if faults:
        raise InputError(faults)
    return Space(file, raw, tuple(fixed), tuple(variables))


def parse_vary(text: str) -> Variable:
    """A variable from "key=low:high". InputError for an unknown key, or ends that are no rising numbers."""
    key, equals, ends = (part.strip() for part in text.partition("="))
    parts = ends.split(":")
    if not equals or len(parts) != 2:
        raise InputError(f"--vary {text}: must be KEY=LOW:HIGH, {EXAMPLE}")
    known, worded = searchable_keys(), word_keys()
    if key in worded:
        words = tuple(word for word in worded[key] if word in {part.strip() for part in parts})
        if len(words) != 2:
            others = "" if len(worded[key]) == 2 else f", two of {', '.join(worded[key])}"
            raise InputError(f"--vary {text}: must be {key}={':'.join(worded[key][:2])}{others}")
        return Variable(key, 0.0, 1.0, 1.0, True, None, words)
    if key not in known:
        guess = "" if key in known_keys() else nearest(key, sorted({*known, *worded}))
        tables = ", ".join(f"[{table}]" for table in VARIED)
        raise InputError(
            f"--vary {text}: {key} is no number that shapes the plate{guess}, must be a number or a choice in one of {tables}"
        )
    whole = known[key]
    numbers = [parse_value(part) for part in parts]
    if not all(isinstance(n, int | float) and not isinstance(n, bool) and isfinite(n) for n in numbers):
        raise InputError(f"--vary {text}: both ends must be numbers, {EXAMPLE}")
    low, high = (float(n) for n in numbers)
    if not low < high:
        raise InputError(f"--vary {text}: the low end must lie below the high end")
    if whole and not (low.is_integer() and high.is_integer()):
        raise InputError(f"--vary {text}: {key} counts something, both ends must be whole numbers")
    return Variable(key, low, high, 1.0 if whole else min(STEP_MM, (high - low) / 10.0), whole)


def searchable_keys() -> dict[str, bool]:
    """Keys of the tables that shape the plate whose value is one number, and whether it is a whole one."""
    keys: dict[str, bool] = {}
    for table in VARIED:
        for name, field in TABLES[table].model_fields.items():
            kind = str(field.annotation)
            if not any(word in kind for word in ("Literal", "str", "bool")):
                keys[f"{table}.{name}"] = "int" in kind
    return keys


def word_keys() -> dict[str, tuple[str, ...]]:
    """Keys of the tables that shape the plate whose value is one of some words, and these."""
    words: dict[str, tuple[str, ...]] = {f"{owner}.material".lstrip("."): tuple(MATERIALS) for owner in MATERIAL_OWNERS}
    for table in VARIED:
        for name, field in TABLES[table].model_fields.items():
            kind = field.annotation
            options = (False, True) if kind is bool else get_args(kind) if get_origin(kind) is Literal else ()
            if len(options) > 1:
                words[f"{table}.{name}"] = tuple(map(_word, options))
    return words


def _word(value: Any) -> str:
    """A word as an override has it."""
    return str(value).lower() if isinstance(value, bool) else str(value)


def _rows(raw: dict[str, Any], file: Path, fixed: Sequence[str], variable: Variable, text: str) -> list[Variable]:
    """The variable, or one for each of the file's rows where its key has a value a row. InputError without rows."""
    if variable.key not in INSTEAD:
        return [variable]
    rows = case_from_dict(raw, file, fixed).design.rows
    if not rows:
        raise InputError(f"--vary {text}: {variable.key} has one value a row, and array.rows is 0 or missing")
    return [replace(variable, row=row) for row in range(1, rows + 1)]


def _check_ends(
    raw: dict[str, Any], file: Path, fixed: Sequence[str], variables: list[Variable], others: list[Variable], text: str
) -> None:
    """InputError when an end is no value that the key may have, or neither end can be built: with the others as the file has
    them, nor with all of them at an end.
    """
    lines: list[list[str]] = []
    settings = [_overrides(others, ends) for ends in ([v.low for v in others], [v.high for v in others])]
    for end in (variables[0].low, variables[0].high):
        refused = None
        for more in ([], *settings):
            try:
                case_from_dict(raw, file, [*fixed, *more, *_overrides(variables, [end] * len(variables))])
                break
            except InputError as error:
                refused = refused or error.lines
        else:
            assert refused is not None
            lines.append(refused)
            if variables[0].words or any(
                "must be a " in line for line in refused
            ):  # the schema's words: wrong by itself
                break
    else:
        if len(lines) < 2:
            return
    raise InputError(f"--vary {text}: {lines[-1][0].partition(': ')[2] or lines[-1][0]}")
