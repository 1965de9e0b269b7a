"""Reading TOML files and --set overrides into plain dictionaries."""

from __future__ import annotations

import copy
import json
import re
import tomllib
from collections.abc import Iterable
from contextlib import suppress
from pathlib import Path
from typing import Any

from geometry.files import read_by_command
from geometry.pillar_shapes.base import PillarShape
from geometry.pillar_shapes.shapes import SHAPES
from pipeline import paths
from pipeline.case.diagnostics import nearest_file, quoted
from pipeline.case.rows import INSTEAD, PITCHES
from pipeline.errors import InputError, reason
from pipeline.units import GPA

# keys that stand for one another: setting one drops the others that the file gave
ALTERNATIVES: dict[str, tuple[str, ...]] = {
    "array.pitch_mm": ("array.pitch_x_mm", "array.pitch_y_mm"),
    "solve.band_kHz": ("solve.near_kHz", "solve.count"),
    "solve.near_kHz": ("solve.band_kHz",),
    "patches.centres_mm": ("patches.at",),
    "patches.at": ("patches.centres_mm",),
    **INSTEAD,
    **{other: (key,) for key, others in INSTEAD.items() for other in others},
}
ALTERNATIVES["array.pitch_mm"] += (PITCHES,)
MAX_BYTES = 200_000  # of a case file: the most patches that it may hold take half
DEEPEST = 8  # tables and lists inside one another; a case has four
TOO_DEEP = f"tables or lists nested deeper than {DEEPEST}, which nothing in it may be"
# a key of so many parts costs tomllib the square of their number before its depth could be seen
LONG_KEY = re.compile(r"""(?<![\w"'-])(?:["']?[\w-]++["']?[ \t]*+\.[ \t]*+){50}""")


def _elsewhere(path: Path) -> str:
    """Where a file of this name, or nearly so, is here or among the program's own, which help and pages name from the
    checkout's folder.
    """
    with suppress(OSError):
        if (ours := paths.ROOT / path).is_file():
            return f" in this folder; there is {ours}"
    return nearest_file(path) or ("" if path.is_absolute() else nearest_file(paths.ROOT / path))


def read_toml(path: Path, max_bytes: int = MAX_BYTES) -> dict[str, Any]:
    """The file as a dictionary; InputError for what cannot be read or parsed, with the line number where known.

    A file of more than `max_bytes`, or nested deeper than DEEPEST, is refused as well.
    """
    read_by_command(path)
    try:
        with path.open("rb") as file:
            content = file.read(max_bytes + 1)
        text = content.decode("utf-8-sig")
    except FileNotFoundError:
        raise InputError(f"{path}: no such file{_elsewhere(path)}") from None
    except IsADirectoryError:
        raise InputError(f"{path}: is a directory, must be a TOML file") from None
    except UnicodeDecodeError as error:
        raise InputError(f"{path}: not UTF-8 text at byte {error.start}, must be a TOML file in UTF-8") from None
    except (OSError, ValueError) as error:
        raise InputError(f"{path}: cannot be read: {reason(error)}") from None
    if len(content) > max_bytes:
        raise InputError(f"{path}: more than {max_bytes} bytes: must be a TOML file of at most so many")
    if LONG_KEY.search(text):
        raise InputError(f"{path}: {TOO_DEEP}")
    try:
        parsed = tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        raise InputError(f"{path}: not valid TOML: {error}") from None
    except (ValueError, RecursionError) as error:
        raise InputError(f"{path}: not valid TOML: {type(error).__name__} {str(error)[:80]}") from None
    if _is_deeper(parsed):
        raise InputError(f"{path}: {TOO_DEEP}")
    return parsed


def is_file(path: Path) -> bool:
    """Whether a file stands there; a name that no file can have is none."""
    try:
        return path.is_file()
    except (OSError, ValueError):
        return False


def _is_deeper(value: Any) -> bool:
    """Whether dictionaries and lists stand inside one another more than DEEPEST times."""
    level = [value]
    for _ in range(DEEPEST + 1):
        inside = [each.values() if isinstance(each, dict) else each for each in level if isinstance(each, (dict, list))]
        level = [item for items in inside for item in items]
    return bool(level)


def parse_value(text: str) -> Any:
    """A TOML value, or the bare word as a string."""
    if len(text) > MAX_BYTES:
        return text.strip()
    try:
        parsed = tomllib.loads(f"value = {text}")
    except (ValueError, RecursionError):
        return text.strip()
    return parsed["value"] if set(parsed) == {"value"} else text.strip()


def parse_override(text: str) -> tuple[str, Any]:
    """(dotted key, value) from "key.path=value"; InputError otherwise."""
    key, equals, value = text.partition("=")
    parts = [part.strip() for part in key.split(".")]
    if not equals or not all(parts) or not value.strip():
        raise InputError(f"--set {quoted(text)[1:-1]}: must be key.path=value, such as array.pitch_mm=6")
    parsed = parse_value(value)
    if len(parts) > DEEPEST or _is_deeper(parsed):
        raise InputError(f"--set {quoted(text)[1:-1]}: nested deeper than {DEEPEST}, which no key is")
    return ".".join(parts), parsed


def apply_overrides(raw: dict[str, Any], overrides: Iterable[tuple[str, Any]]) -> dict[str, Any]:
    """A copy of `raw` with every override set in order; absent tables are created."""
    result = copy.deepcopy(raw)
    for key, value in overrides:
        if key in ("array.pitch_x_mm", "array.pitch_y_mm", PITCHES):
            _split_pitch(result)
        for other in ALTERNATIVES.get(key, ()):
            _drop(result, other)
        if key == "pillar.shape" and isinstance(value, str) and value in SHAPES:
            _keep_sizes(result, SHAPES[value])
        _put(result, key.split("."), value)
    return result


def _split_pitch(raw: dict[str, Any]) -> None:
    array = raw.get("array")
    if isinstance(array, dict) and "pitch_mm" in array:
        pitch = array.pop("pitch_mm")
        array.setdefault("pitch_x_mm", pitch)
        array.setdefault("pitch_y_mm", pitch)


def _keep_sizes(raw: dict[str, Any], shape: type[PillarShape]) -> None:
    """Drop the sizes that belong to other shapes alone."""
    others = {key for other in SHAPES.values() for key in other.keys} - {*shape.keys}
    for name in others if shape.has_height else others | {"height_mm"}:
        _drop(raw, f"pillar.{name}")


def _drop(raw: dict[str, Any], key: str) -> None:
    table, _, name = key.rpartition(".")
    owner = raw.get(table)
    if isinstance(owner, dict):
        owner.pop(name, None)


def _put(raw: dict[str, Any], parts: list[str], value: Any) -> None:
    owner = raw
    for depth, part in enumerate(parts[:-1]):
        below = owner.get(part)
        if isinstance(below, str) and part == "material":
            below = _material_table(below)
        if below is not None and not isinstance(below, dict):
            path = ".".join(parts[: depth + 1])
            raise InputError(f"--set {'.'.join(parts)}: {path} is a value, not a table")
        owner[part] = below = {} if below is None else below
        owner = below
    owner[parts[-1]] = value


def _material_table(name: str) -> dict[str, Any] | None:
    """The constants of a named material, so that one of them can be set."""
    from geometry.materials import MATERIALS

    known = MATERIALS.get(name)
    if known is None:
        return None
    return {"young_GPa": known.young_pa / GPA, "density_kg_m3": known.density_kg_m3, "poisson": known.poisson}


def toml_text(value: Any) -> str:
    """A value as TOML text that --set reads back unchanged; whole floats written as whole numbers."""
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, float):
        return repr(int(value)) if value.is_integer() and abs(value) < 1e15 else repr(value)
    if isinstance(value, (list, tuple)):
        return "[" + ", ".join(toml_text(item) for item in value) + "]"
    if isinstance(value, dict):
        return "{" + ", ".join(f"{key} = {toml_text(item)}" for key, item in value.items()) + "}"
    return _quoted(value) if isinstance(value, str) else str(value)


def _quoted(text: str) -> str:
    """A basic string of TOML, which takes every letter but control characters as it is."""
    return json.dumps(text, ensure_ascii=False).replace("\x7f", "\\u007f")
