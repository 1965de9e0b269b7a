"""Reading of a case: TOML and --set overrides as dictionaries, checks of tables, a line per fault, graded rows."""

from __future__ import annotations

import copy
import json
import re
import tomllib
from collections.abc import Collection, Iterable, Iterator
from contextlib import suppress
from dataclasses import dataclass
from difflib import get_close_matches
from itertools import chain, islice, pairwise
from pathlib import Path
from typing import Any, TypeVar, get_args

from pydantic import BaseModel, ValidationError
from pydantic.fields import FieldInfo

from geometry.errors import GeometryError
from geometry.files import read_by_command
from geometry.layout import MAX_SECTIONS, Design
from geometry.materials import LAWS, LIBRARY, MATERIALS, OTHER_NAMES, SPECTRA, USUAL_C, Material
from geometry.outline import Outline
from geometry.pillar_shapes import SHAPES, PillarShape
from pipeline import paths
from pipeline.case.checks import (
    CHECKS,
    Diagnostic,
    check_pillar_keys,
    check_slenderness,
    check_zones,
    normalise_pitch,
)
from pipeline.case.limits import FREQUENCY_KHZ, LOSS_FACTOR, MAX_CONTRAST, MAX_LAYERS, MIN_LAYER, YOUNG_GPA, span
from pipeline.case.outlines import read_file, sizes_mm
from pipeline.case.schema import (
    AXES,
    GLUE_ALLOWED,
    LAYERS_ALLOWED,
    MATERIAL_ALLOWED,
    MATERIAL_OWNERS,
    NAME_ALLOWED,
    SECTIONS_ALLOWED,
    SIZE_KEYS,
    TABLES,
    LayerTable,
    MaterialTable,
    SectionTable,
    Table,
    Tables,
    UpperSection,
    known_keys,
)
from pipeline.errors import InputError, reason
from pipeline.quantity import GPA, KHZ, MM

Checked = TypeVar("Checked", bound=BaseModel)
FIRST_LAYER, SECTION = "plate.layer.0", "pillar.section"
GLUE = "patches.glue"
GROUPS = "materials."  # owners of the materials of a mesh file's groups
HIDDEN = {
    "plate": ("layer",),
    "pillar": ("material", "section"),
    "patches": ("glue",),
    "cell": ("attached",),
}  # keys of tables that are read one by one
# a number written as text: with a decimal comma, with its unit
NUMBER = re.compile(r"\s*(?P<number>[+-]?\d{1,12}(?:[.,]\d{1,12})?)\s*(?P<unit>[A-Za-z]{0,6})\s*")
SETTING = re.compile(r"\s*(?P<key>[\w.\"-]+)\s*(?P<sign>[=:])\s*(?P<value>[^#]*[^#\s])")
MAX_LINE = 200  # characters of a line that are searched for a slip
STRAIGHT = str.maketrans("“”„‟«»‘’‚", '""""""' + "'" * 3)
MAX_LENGTH = 60  # longest value or key that is shown, in characters
MAX_NAMES = 2000  # largest folder in which a misspelled name is compared
MAX_LINES = 50  # largest number of faults listed; a file with more is not a case file

HEIGHTS, SIDES, PITCHES = "array.heights_mm", "array.sides_mm", "array.pitches_y_mm"
WIDTHS = tuple(dict.fromkeys(f"pillar.{shape.keys[0]}" for shape in SHAPES.values() if shape.keys[0].endswith("_mm")))
UNIFORM_ROW_KEYS = {HEIGHTS: ("pillar.height_mm",), SIDES: WIDTHS, PITCHES: ("array.pitch_y_mm",)}  # keys of equal rows

# alternative keys: setting one drops the others in the file
ALTERNATIVES: dict[str, tuple[str, ...]] = {
    "array.pitch_mm": ("array.pitch_x_mm", "array.pitch_y_mm"),
    "solve.band_kHz": ("solve.near_kHz", "solve.count"),
    "solve.near_kHz": ("solve.band_kHz",),
    "patches.centres_mm": ("patches.at",),
    "patches.at": ("patches.centres_mm",),
    "plate.length_mm": ("array.extension_mm", "plate.file"),
    "plate.width_mm": ("array.extension_mm", "plate.file"),
    "plate.file": ("array.extension_mm", "plate.length_mm", "plate.width_mm", "plate.thickness_mm", "plate.layer"),
    "zone.centre_mm": ("zone.centre_x_mm", "zone.centre_y_mm"),
    "zone.centres_mm": ("zone.centre_mm", "zone.centre_x_mm", "zone.centre_y_mm"),
    **UNIFORM_ROW_KEYS,
    **{other: (key,) for key, others in UNIFORM_ROW_KEYS.items() for other in others},
}

ALTERNATIVES["array.pitch_mm"] += (PITCHES, "array.a1_mm", "array.a2_mm")
MAX_BYTES = 200_000  # of a case file: the largest number of patches takes half
DEEPEST = 8  # nesting of tables and lists; a case has four levels
TOO_DEEP = f"tables or lists nested deeper than the limit of {DEEPEST}"

# tomllib spends time quadratic in the parts of a key before its depth could be checked
LONG_KEY = re.compile(r"""(?<![\w"'-])(?:["']?[\w-]++["']?[ \t]*+\.[ \t]*+){50}""")

ALWAYS = ("solve", "bands", "damping")  # tables with settings only: if absent, defaults apply


class Diagnostics:
    """Faults found so far in one file; those of overridden keys are attributed to --set."""

    def __init__(self, file: str, overridden: Iterable[str] = ()) -> None:
        self.file = file
        self.overridden = frozenset(overridden)
        self.lines: list[str] = []
        self.keys: set[str] = set()
        self.unlisted = 0

    def origin(self, key: str) -> str:
        """Return the name of the file, or --set if the key, a part of it or what holds it was set on the command line."""
        from_command = any(f"{name}.".startswith(f"{key}.") or key.startswith(f"{name}.") for name in self.overridden)
        return "--set" if from_command else self.file

    def add(self, key: str, value: Any, text: str) -> None:
        """Add a line: origin: key = value: text; for no value that the key is missing."""
        if value is None:
            self.missing(key, text)
        else:
            self._note(key, f"{self.origin(key)}: {key_quoted(key)} = {quoted(value)}: {text}")

    def missing(self, key: str, text: str) -> None:
        """Add a line for a missing key."""
        self._note(key, f"{self.file}: {key}: missing, {text}")

    def touch(self, *tables: str) -> bool:
        """Whether a fault was found in one of these tables or top-level keys."""
        return any(key.partition(".")[0] in tables for key in self.keys)

    def _note(self, key: str, line: str) -> None:
        self.keys.add(key)
        if len(self.lines) >= MAX_LINES:
            self.unlisted += 1
        elif line not in self.lines:
            self.lines.append(line)

    def unknown(self, key: str, value: Any, known: Collection[str]) -> None:
        """Add a line for an unknown key, with the nearest known one."""
        hint = nearest(key, known) if len(self.lines) < MAX_LINES else ""
        self.add(key, value, f"unknown {'table' if isinstance(value, dict) else 'key'}{hint}")

    def stop(self) -> None:
        """Raise InputError with every line, if any; beyond MAX_LINES, with their number."""
        if self.lines:
            more = [f"{self.file}: {self.unlisted} more errors"] if self.unlisted else []
            raise InputError([*self.lines, *more])


@dataclass(frozen=True)
class CaseValues:
    """Content of the file, with its faults; `tables` hold the valid values, defaults filled in."""

    name: str
    tables: Tables
    materials: dict[str, Material]
    rows: tuple[tuple[Tables, PillarShape | None], ...]  # for each row; a single entry if all rows are alike
    given: frozenset[str]
    diagnostics: Diagnostics
    layers_mm: tuple[float, ...] = ()  # thicknesses of a plate of several layers
    glue_mm: float | None = None  # thickness of the glue between patches and plate
    outline: Outline | None = None  # of a plate of a file


def quoted(value: Any) -> str:
    """Return a value as TOML, cut to one short line."""
    if isinstance(value, bool):
        text = str(value).lower()
    elif isinstance(value, str):
        text = '"' + value[:MAX_LENGTH].encode("unicode_escape").decode().replace('"', '\\"') + '"'
        text = text if len(value) <= MAX_LENGTH else text[:-1].ljust(MAX_LENGTH + 1, ".")
    elif isinstance(value, dict):
        first = islice(value.items(), MAX_LENGTH)
        text = "{" + ", ".join(f"{key_quoted(key)} = {quoted(item)}" for key, item in first) + "}"
    elif isinstance(value, (list, tuple)):
        text = "[" + ", ".join(quoted(item) for item in value[:MAX_LENGTH]) + "]"
    elif isinstance(value, float):
        text = f"{value:.12g}"
    else:
        text = str(value) if not isinstance(value, int) or abs(value) < 10**30 else "an integer beyond 1e30"
    return text if len(text) <= MAX_LENGTH else text[: MAX_LENGTH - 3] + "..."


def key_quoted(key: str) -> str:
    """Return a key as written in a file, cut to one short line."""
    return key if len(key) <= MAX_LENGTH else f"{key[: MAX_LENGTH - 3]}..."


def nearest(word: str, known: Collection[str]) -> str:
    """Return ' (did you mean X?)' with the known word nearest to `word`, or '' if none resembles it.

    A dotted key is compared whole first, then by its last part; text longer than any key resembles none.
    """
    if len(word) > MAX_LENGTH:
        return ""
    match = get_close_matches(word, known, n=1, cutoff=0.6)
    if not match:
        leaves: dict[str, str] = {}
        for name in known:
            leaves.setdefault(name.rpartition(".")[2], name)
        match = [leaves[leaf] for leaf in get_close_matches(word.rpartition(".")[2], leaves, n=1, cutoff=0.6)]
    return f" (did you mean {match[0]}?)" if match else ""


def known_as(material: str) -> str:
    """Return ' (did you mean X?)' with the material of this trade name or spelling, or of nearly this name, or ''."""
    known = OTHER_NAMES.get(material.strip().lower())
    return f" (did you mean {known}?)" if known else nearest(material, MATERIALS)


def _as_number(key: str, value: Any) -> str:
    """Return ' (did you mean X?)' for a number written as text, with a decimal comma or with its unit; else ''."""
    found = NUMBER.fullmatch(value) if isinstance(value, str) else None
    if found is None:
        return ""
    number, unit = found["number"].replace(",", "."), found["unit"]
    if unit and not key.endswith(f"_{unit}"):
        return " (a number alone: its unit is in the name of the key)" if "_" in key else ""
    return f" (did you mean {number}?)"


def nearest_file(path: Path) -> str:
    """Return ' (did you mean X?)' with the existing file of nearly this name, folder by folder, or ''."""
    there = Path(path.anchor)
    with suppress(OSError, ValueError):
        for part in path.relative_to(path.anchor).parts:
            if not (there / part).exists():
                names = sorted(each.name for each in islice(there.iterdir(), MAX_NAMES))
                match = get_close_matches(part, names, n=1, cutoff=0.75)
                if not match:
                    return ""
                part = match[0]
            there /= part
        return f" (did you mean {there}?)" if there.is_file() else ""
    return ""


def check_table(
    model: type[Checked], raw: dict[str, Any], prefix: str, known: Collection[str], diagnostics: Diagnostics
) -> tuple[Checked, set[str]]:
    """Validate a table: return its values with defaults, faulty ones as None, and the dotted names of the faulty keys.

    Every fault is added to `diagnostics`.
    """
    bad: dict[str, str] = {}
    inner: dict[str, list[str]] = {}  # unknown keys of a table in this one
    try:
        model.model_validate(raw)
    except ValidationError as error:
        for detail in error.errors(include_url=False):
            name, *within = map(str, detail["loc"])
            bad.setdefault(name, detail["type"])
            if detail["type"] == "extra_forbidden" and within:
                inner.setdefault(name, []).append(within[-1])
    fields = model.model_fields
    for name, kind in bad.items():
        key, value = prefix + name, raw.get(name)
        allowed = _allowed(fields[name]) if name in fields else ""
        if kind == "extra_forbidden":
            diagnostics.unknown(key, value, known)
        elif kind == "missing":
            diagnostics.missing(key, f"must be {allowed}")
        elif name in inner:
            for each in inner[name]:
                diagnostics.unknown(f"{key}.{each}", raw[name].get(each), known)
        else:
            named = kind == "literal_error" and isinstance(value, str)
            hint = nearest(str(value), allowed.replace(" or ", ", ").split(", ")) if named else _as_number(key, value)
            diagnostics.add(key, value, f"must be {allowed}{hint}")
    valid = {
        name: raw[name] if name in raw else field.get_default(call_default_factory=True)
        for name, field in fields.items()
        if name not in bad
    }
    return model.model_construct(**dict.fromkeys(fields) | valid), {prefix + name for name in bad}


def lists_of(file: Tables) -> dict[str, list[float]]:
    """Return the lists in the file by the key that equal rows use, such as pillar.height_mm."""
    shape = SHAPES.get(file.pillar.shape)
    one = {HEIGHTS: "pillar.height_mm", SIDES: f"pillar.{shape.keys[0]}" if shape else "", PITCHES: "array.pitch_y_mm"}
    return {one[key]: file.get(key) for key in one if file.get(key) and one[key]}


def named(key: str) -> str:
    """Return the list that replaces a key of equal rows."""
    return next(name for name, others in UNIFORM_ROW_KEYS.items() if key in others)


def normalise_rows(file: Tables) -> Iterator[tuple[str, Any, str]]:
    """Set the keys of equal rows to the values of the first row, and the number of rows to the lists' length."""
    for key in file.faulty & UNIFORM_ROW_KEYS.keys():  # a faulty list, which is reported already
        file.faulty |= {*UNIFORM_ROW_KEYS[key]}
        file.set(dict.fromkeys(UNIFORM_ROW_KEYS[key]))
    for key in (key for key in UNIFORM_ROW_KEYS if file.get(key)):
        values, has_pillar = file.get(key), "pillar" in file.present
        if not has_pillar or (file.pillar.shape == "step" and key != PITCHES):
            why = "without a [pillar]" if not has_pillar else "with a step pillar, whose file sets its sizes"
            yield key, values, f"must be left out {why}"
            file.set({key: None})
            continue
        if file.array.rows is None and file.knows("array", "rows"):
            file.set({"array.rows": len(values)})
        rows = file.array.rows
        if rows is not None and len(values) != rows:
            yield key, values, f"{len(values)} values: must be one for each of array.rows = {rows}"
        for other in (*UNIFORM_ROW_KEYS[key], *(("array.pitch_mm",) if key == PITCHES else ())):
            if file.get(other) is not None:
                what = f"cannot be combined with {key}: remove one of them" + (
                    ", or give pitch_x_mm" if other == "array.pitch_mm" else ""
                )
                yield other, file.get(other), what
    file.set({key: values[0] for key, values in lists_of(file).items() if file.get(key) is None})


def one_kind(design: Design) -> list[str]:
    """Return KEY=VALUE texts that make every row like the first, for the keys in which rows differ."""
    first, texts = design.pillar, []
    if first and len({pillar.height_m for pillar in design.graded}) > 1:
        texts.append(f"pillar.height_mm={first.height_m / MM:g}")
    if first and len({pillar.base_m for pillar in design.graded}) > 1:
        texts.append(f"pillar.{first.form.keys[0]}={first.base_m / MM:g}")
    return [*texts, *([f"array.pitch_y_mm={design.pitch_y_m / MM:g}"] if design.graded_pitches_m else ())]


def by_row(file: Tables) -> list[Tables]:
    """Return the tables of each row; a single entry if all rows are alike."""
    lists = lists_of(file)
    rows = [copy.copy(file) for _ in range(min((len(values) for values in lists.values()), default=1))]
    for number, row in enumerate(rows):
        row.set({key: values[number] for key, values in lists.items()})
    return rows


def read_toml(path: Path, max_bytes: int = MAX_BYTES) -> dict[str, Any]:
    """Read the file as a dictionary; InputError if it cannot be read or parsed, with the line number if known.

    A file larger than `max_bytes`, or nested deeper than DEEPEST, is also rejected.
    """
    read_by_command(path)
    try:
        with path.open("rb") as file:
            content = file.read(max_bytes + 1)
        text = content.decode("utf-8-sig")
    except FileNotFoundError:
        raise InputError(f"{path}: no such file{_elsewhere(path)}") from None
    except IsADirectoryError:
        raise InputError(f"{path}: is a directory: must be a TOML file") from None
    except UnicodeDecodeError as error:
        raise InputError(f"{path}: not UTF-8 text at byte {error.start}: must be a TOML file in UTF-8") from None
    except (OSError, ValueError) as error:
        raise InputError(f"{path}: cannot be read: {reason(error)}") from None
    if len(content) > max_bytes:
        raise InputError(f"{path}: larger than {max_bytes} bytes, the limit for a TOML file")
    if LONG_KEY.search(text):
        raise InputError(f"{path}: {TOO_DEEP}")
    try:
        parsed = tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        raise InputError(f"{path}: not valid TOML: {error}{_slip(text, str(error))}") from None
    except (ValueError, RecursionError) as error:
        raise InputError(f"{path}: not valid TOML: {type(error).__name__} {str(error)[:80]}") from None
    if _is_deeper(parsed):
        raise InputError(f"{path}: {TOO_DEEP}")
    return parsed


def _slip(text: str, fault: str) -> str:
    """Return ' (did you mean X?)' where the line of a TOML fault has a decimal comma, a unit, a colon, or no plain quotes."""
    place = re.search(r"at line (\d+)", fault)
    line = text.split("\n")[int(place[1]) - 1] if place else ""
    found = SETTING.match(line[:MAX_LINE])
    if found is None:
        return ""
    key, value = found["key"], found["value"]
    better, number = value.translate(STRAIGHT), NUMBER.fullmatch(value)
    if number:
        better = number["number"].replace(",", ".")
    elif value.lower() in ("true", "false"):
        better = value.lower()
    elif value.isascii() and value[0].isalpha() and value.replace("-", "").replace(".", "").isalnum():
        better = f'"{value}"'
    if (better, found["sign"]) == (value, "="):
        return ""
    why = "; its unit is in the name of the key" if number and number["unit"] else ""
    return f" (did you mean {key_quoted(f'{key} = {better}')}{why}?)"


def is_file(path: Path) -> bool:
    """Whether a file exists; False for a name that no file can have."""
    try:
        return path.is_file()
    except (OSError, ValueError):
        return False


def parse_value(text: str) -> Any:
    """Parse a TOML value, or take a bare word as a string."""
    if len(text) > MAX_BYTES:
        return text.strip()
    try:
        parsed = tomllib.loads(f"value = {text}")
    except (ValueError, RecursionError):
        return text.strip()
    return parsed["value"] if set(parsed) == {"value"} else text.strip()


def parse_override(text: str) -> tuple[str, Any]:
    """Parse "key.path=value" into a dotted key and a value; InputError otherwise."""
    key, equals, value = text.partition("=")
    parts = [part.strip() for part in key.split(".")]
    if not equals or not all(parts) or not value.strip():
        raise InputError(f"--set {quoted(text)[1:-1]}: must be key.path=value, such as array.pitch_mm=6")
    parsed = parse_value(value)
    if len(parts) > DEEPEST or _is_deeper(parsed):
        raise InputError(f"--set {quoted(text)[1:-1]}: nested deeper than the limit of {DEEPEST}")
    return ".".join(parts), parsed


def apply_overrides(raw: dict[str, Any], overrides: Iterable[tuple[str, Any]]) -> dict[str, Any]:
    """Return a copy of `raw` with every override applied in order; absent tables are created."""
    result = copy.deepcopy(raw)
    for key, value in overrides:
        if key in ("array.pitch_x_mm", "array.pitch_y_mm", PITCHES):
            _split_pitch(result)
        if key in AXES and (centre := _centre(result)):
            centre[AXES.index(key)] = value
            key, value = "zone.centre_mm", centre
        for other in _dropped(key, value):
            _drop(result, other)
        _put(result, key.split("."), value)
    return result


def _dropped(key: str, value: Any) -> set[str]:
    """Keys that an override drops: its alternatives, and sizes that only other shapes have."""
    dropped = {*ALTERNATIVES.get(key, ())}
    if key == "pillar.shape" and isinstance(value, str) and value in SHAPES:
        dropped |= {f"pillar.{name}" for name in _foreign_sizes(SHAPES[value])}
    return dropped


def exclusive(given: Iterable[tuple[str, Any]], paired: bool = False) -> Iterator[tuple[str, str]]:
    """Yield the pairs of given keys of which the later one, with its value or a list of them, drops the earlier one.

    A whole table drops what stood in it. If lists are paired, only what each shape of a list drops has been given in vain.
    """
    before: dict[str, None] = {}
    for key, value in given:
        each = [_dropped(key, one) for one in (value if isinstance(value, list) and value else [value])]
        dropped = set.intersection(*each) if paired else set.union(*each)
        yield from ((earlier, key) for earlier in before if earlier in dropped or earlier.startswith(f"{key}."))
        if value is not None:
            before[key] = None


def effective(given: Iterable[tuple[str, Any]]) -> list[tuple[str, Any]]:
    """Return the given pairs of key and value without those that a later one drops."""
    pairs = list(given)
    dropped = {earlier for earlier, _ in exclusive(pairs)}
    return [(key, value) for key, value in pairs if key not in dropped]


def check_exclusive(given: Iterable[tuple[str, Any]], place: str) -> None:
    """Raise InputError with a line for each pair of given keys that exclude each other."""
    if lines := [
        f"{place}: {' and '.join(pair)} exclude each other: give only one of them" for pair in exclusive(given)
    ]:
        raise InputError(lines)


def _centre(raw: dict[str, Any]) -> list[Any]:
    """A zone's `centre_mm`, of which one value stays when the other is set; empty without one."""
    zone = raw.get("zone")
    centre = zone.get("centre_mm") if isinstance(zone, dict) else None
    return list(centre) if isinstance(centre, list) and len(centre) == 2 else []


def toml_text(value: Any) -> str:
    """Return a value as TOML text that --set reads back unchanged; whole floats are written as integers."""
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, float):
        return repr(int(value)) if value.is_integer() and abs(value) < 1e15 else repr(value)
    if isinstance(value, (list, tuple)):
        return "[" + ", ".join(toml_text(item) for item in value) + "]"
    if isinstance(value, dict):
        return "{" + ", ".join(f"{key} = {toml_text(item)}" for key, item in value.items()) + "}"
    return _quoted(value) if isinstance(value, str) else str(value)


def read_values(raw: dict[str, Any], source: Path | None, overridden: Iterable[str]) -> CaseValues:
    """Check a parsed case file table by table, then across tables; faults go to `diagnostics`, none is raised."""
    diagnostics = Diagnostics(str(source) if source is not None else "case", overridden)
    known = known_keys()
    found: dict[str, Table] = {}
    faulty: set[str] = set()
    materials: dict[str, Material] = {}
    layers: tuple[float, ...] = ()
    sections: list[dict[str, Any]] = []
    glue: float | None = None
    outline: Outline | None = None
    for key in raw:
        if key == "tip":
            diagnostics.add("tip", raw[key], f"replaced by sections: {_as_sections(raw)}")
        elif key not in TABLES and key not in ("name", "material", "support"):
            named = [*TABLES, "defect", "support"]
            diagnostics.unknown(key, raw[key], [*known, *named] if not isinstance(raw[key], dict) else named)
    for table, model in TABLES.items():
        if table not in raw and table not in ALWAYS:
            continue
        content = raw.get(table, {})
        if not isinstance(content, dict):
            diagnostics.add(table, content, f"must be a table [{table}]")
            continue
        own = {key: value for key, value in content.items() if key not in HIDDEN.get(table, ())}
        if table == "materials":
            _read_group_materials(content, materials, known, diagnostics)
            own = {}
        if table == "patches" and "glue" in content:
            glue = _read_glue(content, materials, known, diagnostics)
        if table == "pillar" and "section" in content:
            sections = _read_sections(content, raw, materials, known, diagnostics)
            own |= sections[0] if sections else {}
        if table == "plate" and "layer" in content and "file" not in content:
            layers = _read_layers(content, materials, known, diagnostics)
            own = own | ({"thickness_mm": sum(layers)} if layers else {})
            faulty |= set() if layers else {"plate.thickness_mm"}
            if not layers:
                continue
        if table == "plate" and "file" in content:
            outline, faults = read_file(content, source.parent if source is not None else Path(), raw.get("zone"))
            _add_all(faults, diagnostics)
            faulty |= set() if outline else {"plate.thickness_mm", "plate.length_mm", "plate.width_mm"}
            if not outline:
                continue
            own = own | sizes_mm(outline)
        found[table], bad = check_table(model, own, f"{table}.", known, diagnostics)
        faulty |= bad
        if table == "pillar" and "section" in content and not sections:  # neither shape nor sizes are known
            faulty |= {f"{table}.{name}" for name in model.model_fields}
            found[table] = model.model_construct(**dict.fromkeys(model.model_fields))
    for owner in MATERIAL_OWNERS:
        _read_material(raw if owner == "" else raw.get(owner, {}), owner, materials, known, diagnostics, bool(layers))
    _check_contrast(materials, diagnostics)
    _tune(materials, found, faulty)
    _warm(materials, found, faulty, diagnostics)
    name = _read_name(raw, source, diagnostics)
    tables = Tables.of(found, faulty)
    tables.upper = _upper_sections(sections, tables, diagnostics)
    _add_all(chain(normalise_rows(tables), normalise_pitch(tables)), diagnostics)
    rows = tuple((own, _read_shape(own, source, diagnostics)) for own in by_row(tables))
    _check_across(rows, diagnostics)
    return CaseValues(name, tables, materials, rows, _given(raw), diagnostics, layers, glue, outline)


def _allowed(field: FieldInfo) -> str:
    """Return the requirement of a field: its description, or its type in words."""
    *first, last = [str(word) for word in get_args(field.annotation)] or ["something else"]
    return field.description or (f"{', '.join(first)} or {last}" if first else last)


def _elsewhere(path: Path) -> str:
    """Suggest a file of this or a similar name, here or in the checkout, to which help and pages refer."""
    with suppress(OSError):
        if (ours := paths.ROOT / path).is_file():
            return f" in this folder; there is {ours}"
    return nearest_file(path) or ("" if path.is_absolute() else nearest_file(paths.ROOT / path))


def _is_deeper(value: Any) -> bool:
    """Whether dictionaries and lists are nested more than DEEPEST levels."""
    level = [value]
    for _ in range(DEEPEST + 1):
        inside = [each.values() if isinstance(each, dict) else each for each in level if isinstance(each, (dict, list))]
        level = [item for items in inside for item in items]
    return bool(level)


def _split_pitch(raw: dict[str, Any]) -> None:
    array = raw.get("array")
    if isinstance(array, dict) and "pitch_mm" in array:
        pitch = array.pop("pitch_mm")
        array.setdefault("pitch_x_mm", pitch)
        array.setdefault("pitch_y_mm", pitch)


def keep_sizes(raw: dict[str, Any], shape: type[PillarShape]) -> None:
    """Drop the sizes that only other shapes have."""
    for name in _foreign_sizes(shape):
        _drop(raw, f"pillar.{name}")


def _foreign_sizes(shape: type[PillarShape]) -> set[str]:
    others = {key for other in SHAPES.values() for key in other.keys} - {*shape.keys}
    return others if shape.has_height else others | {"height_mm"}


def _drop(raw: dict[str, Any], key: str) -> None:
    table, _, name = key.rpartition(".")
    owner = raw.get(table)
    if isinstance(owner, dict):
        owner.pop(name, None)


def _put(raw: dict[str, Any], parts: list[str], value: Any) -> None:
    owner: Any = raw
    for depth, part in enumerate(parts[:-1]):
        if isinstance(owner, list):
            owner = _item(owner, part, parts)
            continue
        below = owner.get(part)
        if isinstance(below, list):
            owner = below
            continue
        if isinstance(below, str) and part == "material":
            below = _material_table(below)
        if below is not None and not isinstance(below, dict):
            path = ".".join(parts[: depth + 1])
            raise InputError(f"--set {'.'.join(parts)}: {path} is a value, not a table")
        owner[part] = below = {} if below is None else below
        owner = below
    if isinstance(owner, list):
        raise InputError(f"--set {'.'.join(parts)}: must name a key of one of its tables, such as thickness_mm")
    owner[parts[-1]] = value


def _item(tables: list[Any], part: str, parts: list[str]) -> Any:
    """Return the table of a list by its number, from 0."""
    known = {str(number): table for number, table in enumerate(tables) if is_table(table)}
    if part not in known:
        last = f"0 to {len(tables) - 1}" if len(tables) > 1 else "0"
        key, number = key_quoted(".".join(parts)), key_quoted(part)
        raise InputError(f"--set {key}: {number} must be the number of one of its tables, {last}")
    return known[part]


def _material_table(name: str) -> dict[str, Any] | None:
    """Return the constants of a named material, so that one of them can be overridden."""
    known = LIBRARY.get(name)
    return None if known is None else {key: copy.copy(value) for key, value in known.items() if key != "source"}


def _quoted(text: str) -> str:
    """Return a basic TOML string, in which only control characters are escaped."""
    return json.dumps(text, ensure_ascii=False).replace("\x7f", "\\u007f")


def _read_layers(
    plate: dict[str, Any], materials: dict[str, Material], known: list[str], diagnostics: Diagnostics
) -> tuple[float, ...]:
    """Read the materials of the plate's layers, and return their thicknesses in mm; () for faulty ones."""
    layers, before = plate["layer"], len(diagnostics.lines)
    if not isinstance(layers, list) or not 0 < len(layers) <= MAX_LAYERS or not all(map(is_table, layers)):
        diagnostics.add("plate.layer", layers, f"must be one to {MAX_LAYERS} {LAYERS_ALLOWED}")
        return ()
    if "thickness_mm" in plate:
        diagnostics.add("plate.thickness_mm", plate["thickness_mm"], "must be left out: the layers have their own")
    for number, layer in enumerate(layers):
        owner = f"plate.layer.{number}"
        own = {key: value for key, value in layer.items() if key != "material"}
        check_table(LayerTable, own, f"{owner}.", known, diagnostics)
        _read_material(layer, owner, materials, known, diagnostics)
    if len(diagnostics.lines) > before:
        return ()
    thicknesses = tuple(float(layer["thickness_mm"]) for layer in layers)
    for number, thickness in enumerate(thicknesses):
        if thickness < (least := MIN_LAYER * sum(thicknesses)):
            what = f"must be at least {least:.4g}, {MIN_LAYER:g} of the plate's thickness: no element is as thin"
            diagnostics.add(f"plate.layer.{number}.thickness_mm", thickness, what)
    return thicknesses


def _read_glue(
    patches: dict[str, Any], materials: dict[str, Material], known: list[str], diagnostics: Diagnostics
) -> float | None:
    """Read the material of the glue between patches and plate, and return its thickness in mm; None for a faulty one."""
    glue, before = patches["glue"], len(diagnostics.lines)
    if not is_table(glue):
        diagnostics.add(GLUE, glue, f"must be {GLUE_ALLOWED}")
        return None
    own = {key: value for key, value in glue.items() if key != "material"}
    check_table(LayerTable, own, f"{GLUE}.", known, diagnostics)
    if "material" not in glue:
        diagnostics.missing(f"{GLUE}.material", f"must be {MATERIAL_ALLOWED} ({', '.join(MATERIALS)})")
    _read_material(glue, GLUE, materials, known, diagnostics)
    if len(diagnostics.lines) > before:
        return None
    thickness, size = float(glue["thickness_mm"]), patches.get("size_mm")
    patch = size[2] if isinstance(size, list) and len(size) == 3 and isinstance(size[2], int | float) else None
    if patch and not MIN_LAYER * patch <= thickness <= patch:
        text = f"must be from {MIN_LAYER * patch:.4g} to {patch:g}, {MIN_LAYER:g} to 1 times the patches' thickness"
        diagnostics.add(f"{GLUE}.thickness_mm", thickness, text)
    return thickness


def _as_sections(raw: dict[str, Any]) -> str:
    """Write the sections of a pillar that take the place of a table [tip], with the values of the file."""
    tip, pillar = (raw[name] if is_table(raw.get(name)) else {} for name in ("tip", "pillar"))
    first, second = pillar.get("height_mm", "..."), {"shape": "square"} | tip
    lists = isinstance(raw.get("array"), dict) and "heights_mm" in raw["array"]
    stem = "" if lists else f"height_mm = {quoted(first) if first != '...' else first}"
    upper = ", ".join(f"{key} = {quoted(value)}" for key, value in second.items())
    return f"write pillar.section = [{{{stem}}}, {{{upper}}}] without pillar.height_mm"


def _read_sections(
    pillar: dict[str, Any],
    raw: dict[str, Any],
    materials: dict[str, Material],
    known: list[str],
    diagnostics: Diagnostics,
) -> list[dict[str, Any]]:
    """Read the materials of a pillar's sections, and return the keys of each, those of the section below where it has none;
    [] for faulty ones.
    """
    tables, before = pillar["section"], len(diagnostics.lines)
    if not isinstance(tables, list) or not 0 < len(tables) <= MAX_SECTIONS or not all(map(is_table, tables)):
        diagnostics.add("pillar.section", tables, f"must be one to {MAX_SECTIONS} {SECTIONS_ALLOWED}")
        return []
    if "height_mm" in pillar:
        diagnostics.add("pillar.height_mm", pillar["height_mm"], "must be left out: the sections have their own")
    below = {key: value for key, value in pillar.items() if key in ("shape", *SIZE_KEYS)}
    if below.get("shape") == "step":
        diagnostics.add(
            "pillar.section", tables, "must be left out with a step pillar, whose file contains the final shape"
        )
    by_row = isinstance(raw.get("array"), dict) and "heights_mm" in raw["array"]
    found = []
    for number, table in enumerate(tables):
        owner = f"pillar.section.{number}"
        own = {key: value for key, value in table.items() if key != "material"}
        check_table(SectionTable, own, f"{owner}.", known, diagnostics)
        _read_material(table, owner, materials, known, diagnostics)
        if "height_mm" not in own and not (number == 0 and by_row):
            diagnostics.missing(f"{owner}.height_mm", "a section needs it")
        if number == 0 and own.get("height_mm") == 0.0:
            diagnostics.add(f"{owner}.height_mm", 0.0, "must be above 0: the other sections stand on this one")
        same = own.get("shape", below.get("shape")) == below.get("shape")
        below = {key: value for key, value in ((below if same else {}) | own).items() if key != "height_mm"}
        found.append(below | ({"height_mm": own["height_mm"]} if "height_mm" in own else {}))
    return found if len(diagnostics.lines) == before else []


def _upper_sections(sections: list[dict[str, Any]], file: Tables, diagnostics: Diagnostics) -> tuple[UpperSection, ...]:
    """Check the shapes of the sections above the first one, and return those with a height."""
    upper = []
    for number, section in enumerate(sections[1:], start=1):
        if not section["height_mm"]:
            continue
        alone = copy.copy(file)
        empty = type(file.pillar).model_construct(**dict.fromkeys(type(file.pillar).model_fields))
        alone.pillar = empty.but(**({"shape": next(iter(SHAPES)), "fillet_mm": 0.0} | section))
        form = _read_shape(alone, None, diagnostics)
        faults = chain(check_pillar_keys(alone, form), check_slenderness(alone, form))
        owner = f"{SECTION}.{number}"
        _add_all(((key.replace("pillar.", f"{owner}."), value, text) for key, value, text in faults), diagnostics)
        if form is not None:
            upper.append(UpperSection(number, form, section["height_mm"], owner))
    return tuple(upper)


def is_table(value: Any) -> bool:
    """Whether a value is a table."""
    return isinstance(value, dict)


def _read_group_materials(
    table: dict[str, Any], materials: dict[str, Material], known: list[str], diagnostics: Diagnostics
) -> None:
    """Read the materials of groups of a mesh file, owners such as materials.CORE."""
    folded: dict[str, str] = {}
    for name, value in table.items():
        if name.casefold() in folded:
            diagnostics.add(f"{GROUPS}{name}", value, f"is {folded[name.casefold()]} again: case does not count")
        folded[name.casefold()] = name
        _read_material({"material": value}, f"{GROUPS}{name}", materials, known, diagnostics)


def _read_material(
    owner_table: Any,
    owner: str,
    materials: dict[str, Material],
    known: list[str],
    diagnostics: Diagnostics,
    layered: bool = False,
) -> None:
    """Read the material of a table; the case's own is needed unless the plate has layers and the pillars one of theirs."""
    key = owner if owner.startswith(GROUPS) else f"{owner}.material".lstrip(".")
    if not isinstance(owner_table, dict) or "material" not in owner_table:
        pillar = owner_table.get("pillar") if isinstance(owner_table, dict) and owner == "" else None
        if owner.startswith("plate."):
            diagnostics.missing(key, f"must be {MATERIAL_ALLOWED} ({', '.join(MATERIALS)})")
        elif owner == "" and layered and (not is_table(pillar) or _has_materials(pillar)):
            pass
        elif owner == "":
            why = ", of the pillars: the plate's layers have their own" if layered else ""
            diagnostics.missing(key, f"must be {MATERIAL_ALLOWED} ({', '.join(MATERIALS)}){why}")
        return
    value = owner_table["material"]
    if isinstance(value, str):
        if value in MATERIALS:
            materials[owner] = MATERIALS[value]
        else:
            diagnostics.add(key, value, f"must be one of {', '.join(MATERIALS)} or a table{known_as(value)}")
    elif isinstance(value, dict):
        before = len(diagnostics.lines)
        check_table(MaterialTable, value, f"{key}.", known, diagnostics)
        _check_law(value, key, diagnostics)
        if len(diagnostics.lines) == before:
            try:
                materials[owner] = Material.of_table("given", value)
            except GeometryError as error:
                name, _, what = str(error).partition(": ")
                law = next(law for law in (*LAWS, *SPECTRA) if law in value)
                named_by_law = (
                    name.partition(".")[0] == law
                )  # else it is the material's own check that rounding has failed
                diagnostics.add(f"{key}.{name if named_by_law else law}", value[law], what)
    else:
        diagnostics.add(key, value, f"must be {MATERIAL_ALLOWED}")


def _has_materials(pillar: Any) -> bool:
    """Whether a table of a pillar names its material, or those of all its sections."""
    sections = pillar.get("section")
    named = isinstance(sections, list) and all(is_table(each) and "material" in each for each in sections)
    return "material" in pillar or (named and bool(sections))


def _check_law(value: dict[str, Any], key: str, diagnostics: Diagnostics) -> None:
    """Report a table of a material that has no law, or several, and keys that its law does not take."""
    laws = [law for law in LAWS if law in value]
    if spectra := [each for each in SPECTRA if each in value]:
        _check_spectrum(value, spectra, key, diagnostics)
        laws = ["young_GPa", *(law for law in laws if law != "young_GPa")]
    if not laws:
        others = ", ".join(LAWS[1:])
        diagnostics.missing(f"{key}.young_GPa", f"must be given with poisson, or one of {others} in its place")
    for other in laws[1:]:
        diagnostics.add(f"{key}.{other}", value[other], f"cannot be combined with {laws[0]}: one law only")
    if laws == ["young_GPa"] and "poisson" not in value:
        allowed = MaterialTable.model_fields["poisson"].description
        diagnostics.missing(f"{key}.poisson", f"must be {allowed}")
    if laws[:1] not in ([], ["young_GPa"]) and "poisson" in value:
        diagnostics.add(f"{key}.poisson", value["poisson"], f"must be left out with {laws[0]}")
    if laws[:1] == ["young_GPa"] and "axes_deg" in value:
        diagnostics.add(f"{key}.axes_deg", value["axes_deg"], "must be left out of an isotropic law, which has no axes")


def _check_spectrum(value: dict[str, Any], spectra: list[str], key: str, diagnostics: Diagnostics) -> None:
    """Report a modulus over frequency given twice, without rise, or against a single modulus or loss factor."""
    spectrum, young = spectra[0], value.get("young_GPa")
    if len(spectra) > 1:
        diagnostics.add(f"{key}.{spectra[1]}", value[spectra[1]], f"cannot be combined with {spectrum}: one law only")
    if not any(fault.startswith(f"{key}.{spectrum}") for fault in diagnostics.keys):
        check = _check_zener if spectrum == "zener" else _check_rows
        low, high = check(value[spectrum], f"{key}.{spectrum}", diagnostics)
        if isinstance(young, int | float) and not low <= young <= high:
            what = f"must lie within {spectrum}, {low:g} to {high:g}, or be left out"
            diagnostics.add(f"{key}.young_GPa", young, what)
    if "loss_factor" in value:
        what = f"must be left out: {spectrum} has its own over the frequency"
        diagnostics.add(f"{key}.loss_factor", value["loss_factor"], what)


def _check_rows(rows: list[list[float]], key: str, diagnostics: Diagnostics) -> tuple[float, float]:
    """Report rows that do not rise or exceed limits; the smallest and the largest modulus."""
    bounds = {"Hz": (KHZ * FREQUENCY_KHZ[0], KHZ * FREQUENCY_KHZ[1]), "GPa": YOUNG_GPA, "loss": LOSS_FACTOR}
    for row in rows:
        if not all(low <= number <= high for number, (low, high) in zip(row, bounds.values(), strict=True)):
            allowed = ", ".join(f"{what} {span(each)}" for what, each in bounds.items())
            diagnostics.add(key, row, f"must be {allowed}")
    if any(low[0] >= high[0] for low, high in pairwise(rows)):
        diagnostics.add(key, [row[0] for row in rows], "must be rows in order of rising frequency")
    return min(row[1] for row in rows), max(row[1] for row in rows)


def _check_zener(table: dict[str, float], key: str, diagnostics: Diagnostics) -> tuple[float, float]:
    """Report a law that softens with frequency; its two moduli."""
    low, high = table["relaxed_GPa"], table["unrelaxed_GPa"]
    if not low <= high:
        diagnostics.add(
            f"{key}.unrelaxed_GPa", high, f"must be relaxed_GPa = {low:g} or more: no solid softens with frequency"
        )
    return low, high


def _tune(materials: dict[str, Material], found: dict[str, Table], faulty: set[str]) -> None:
    """Bring the materials to the frequency at which the case takes its moduli, if it gives one."""
    tone = getattr(found.get("solve"), "moduli_hz", None)
    if tone is not None and "solve.moduli_kHz" not in faulty:
        materials |= {owner: material.at_hz(tone) for owner, material in materials.items()}


def _warm(materials: dict[str, Material], found: dict[str, Table], faulty: set[str], diagnostics: Diagnostics) -> None:
    """Bring the materials to the temperature of the case."""
    celsius = getattr(found.get("solve"), "temperature_C", USUAL_C)
    if "solve.temperature_C" in faulty or celsius == USUAL_C:
        return
    for owner, material in materials.items():
        try:
            materials[owner] = material.at(celsius)
        except GeometryError as error:
            diagnostics.add("solve.temperature_C", celsius, str(error))


def _check_contrast(materials: dict[str, Material], diagnostics: Diagnostics) -> None:
    """Report a stiffness contrast of plate and a pillar's section, or of two layers, that a single matrix cannot resolve."""
    own = {owner: each for owner, each in materials.items() if not owner.startswith(GROUPS)}
    young = {owner: material.average.young_pa / GPA for owner, material in own.items()}
    plate = young.pop(FIRST_LAYER, young.pop("", None))
    for owner, other in young.items():
        if plate is not None and max(plate, other) > MAX_CONTRAST * min(plate, other):
            limit = f"must be within a factor of {MAX_CONTRAST:g} of the plate's {plate:g} GPa"
            diagnostics.add(f"{owner}.material.young_GPa".lstrip("."), other, limit)


def _read_name(raw: dict[str, Any], source: Path | None, diagnostics: Diagnostics) -> str:
    name = raw.get("name", source.stem if source is not None else "case")
    if not (isinstance(name, str) and 0 < len(name) <= 100 and name.isprintable() and not set(name) & set("/\\")):
        diagnostics.add("name", name, f"must be {NAME_ALLOWED}")
    return str(name)


def _read_shape(file: Tables, source: Path | None, diagnostics: Diagnostics) -> PillarShape | None:
    """Return the pillar's shape with its sizes; None while some are missing. A STEP file is read here with CAD."""
    shape = SHAPES.get(file.pillar.shape)
    if shape is None or any(getattr(file.pillar, key) is None for key in shape.keys):
        return None
    given = {key: getattr(file.pillar, key) for key in shape.keys}
    try:
        return shape.from_case(given, source.parent if source is not None else Path())
    except GeometryError as error:
        path = file.pillar.file
        diagnostics.add("pillar.file", path, str(error).rpartition(f"{path}: ")[2])
        return None


def _check_across(rows: tuple[tuple[Tables, PillarShape | None], ...], diagnostics: Diagnostics) -> None:
    for number, (row, form) in enumerate(rows, start=1):
        _add_all(
            (_of_row(number, fault, row) for check in (*CHECKS, check_zones) for fault in check(row, form)),
            diagnostics,
        )


def _of_row(number: int, fault: Diagnostic, row: Tables) -> Diagnostic:
    """Attribute the fault of a row's value to the list that contains it."""
    key, _, text = fault
    return (named(key), row.get(named(key)), f"row {number}: {text}") if key in lists_of(row) else fault


def _add_all(faults: Iterable[Diagnostic], diagnostics: Diagnostics) -> None:
    for key, value, text in faults:
        if value is None:
            diagnostics.missing(key, text)
        else:
            diagnostics.add(key, value, text)


def _given(raw: dict[str, Any]) -> frozenset[str]:
    """Return the tables and dotted keys in the file."""
    keys = set(raw)
    for table, content in raw.items():
        if isinstance(content, dict):
            keys |= {f"{table}.{name}" for name in content}
    if SECTION in keys:
        keys.add("pillar.height_mm")
    if keys & {*UNIFORM_ROW_KEYS}:
        keys.add("array.rows")
    if {"array.a1_mm", "array.a2_mm"} <= keys:
        keys |= {"array.pitch_mm"}
    if "array.pitch_x_mm" in keys and keys & {"array.pitch_y_mm", PITCHES}:
        keys.add("array.pitch_mm")
    return frozenset(keys)
