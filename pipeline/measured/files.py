"""Measured sweeps and maps from CSV and universal files; the first error is reported with its line.

Lines that begin with # are comments, and blank lines are skipped; the first other line names the columns. Commas, semicolons
or tabs separate them; with semicolons or tabs, numbers may have a decimal comma. A column name may begin with the quantity
(velocity_, displacement_, acceleration_, sensor_) and end in its unit. The unit may also stand in brackets, or in a line of
its own below the names. Lines "name: value" above the names, which vibrometers export, are skipped.

Only motion along z, the plate's normal, is read: direction +3, or -3 with the sign reversed; 0 is unspecified and counts as
+3. From a file with several responses, a sweep uses that of the node with the largest motion along z.
"""

from __future__ import annotations

import csv
import re
from dataclasses import dataclass
from itertools import zip_longest
from math import isfinite
from pathlib import Path
from typing import Any, Literal, cast

import numpy as np

from geometry.elements import ComplexArray, FloatArray
from geometry.files import read_by_command
from geometry.layout import Design
from pipeline.case.limits import FREQUENCY_KHZ, span
from pipeline.case.reading import nearest, nearest_file, quoted
from pipeline.errors import InputError
from pipeline.quantity import KHZ, MM
from solvers.control.identification import Sweep

Quantity = Literal["velocity", "displacement", "sensor"]
SYNTHETIC = "SYNTHETIC"  # first word of the first comment in files written by this program
MIN_COUNT = 8  # rows of a sweep that a circle fit needs
PLACES = {"x": {"x_mm": MM, "x_m": 1.0}, "y": {"y_mm": MM, "y_m": 1.0}}
TONES = {"frequency": {"frequency_hz": 1.0, "frequency_khz": KHZ, "frequency_mhz": 1e6}}
KINDS = ("velocity", "displacement", "acceleration", "sensor")
VALUE = re.compile(rf"(?:({'|'.join(KINDS)})_)?(amplitude|phase|real|imag)(?:_(.+))?")
SYNONYMS = {"magnitude": "amplitude", "imaginary": "imag", "freq": "frequency", "re": "real", "im": "imag", "°": "deg"}
UNIT_IN_BRACKETS = re.compile(r"(.*?)\s*[(\[]\s*(.*?)\s*[)\]]")
PREAMBLE = re.compile(r"[^,;\t]*:(?:[ \t].*)?")
BASES = {"m/s": "velocity", "m": "displacement", "m/s2": "acceleration", "v": "sensor"}
OF_UNIT: dict[str, str | None] = {
    f"{prefix}{base}": BASES[base] for prefix in ("", "m", "u", "n", "p") for base in BASES
}
OF_UNIT |= {"g": "acceleration", "": None, "part": None} | {kind: kind for kind in KINDS}
DECIBEL = re.compile(r"db\W*(?:re|ref|rel)?\W*1?\W*(.*)")
PAIRS = (("real", "imag"), ("amplitude", "phase"))
PAIRS_ALLOWED = "real with imag, or amplitude with phase_deg or phase_rad"
LARGEST = 1e30  # of any number: measurements lie far below in any unit, and squares stay finite
LARGEST_DB = 600.0  # 20 log10 of it
EDGE_M = 1e-6  # a point this far beyond the plate still counts as on its edge
SAME_M = 1e-9

UNIVERSAL = (".uff", ".unv", ".bunv")
FREQUENCY_RESPONSE = 4
QUANTITIES: dict[int, Quantity] = {0: "velocity", 8: "displacement", 11: "velocity", 12: "displacement"}
ACCELERATION = 12  # becomes a displacement: over -omega^2
NORMAL = {0: 1.0, 3: 1.0, -3: -1.0}  # directions along the plate's normal, and their signs
DIRECTIONS = {1: "x", 2: "y", 4: "rotation about x", 5: "rotation about y", 6: "rotation about z"}


@dataclass(frozen=True)
class MeasuredSweep:
    """A frequency response: frequencies in Hz, complex values in the file's unit; synthetic if this program wrote it."""

    file: str
    synthetic: bool
    quantity: Quantity
    sweep: Sweep


@dataclass(frozen=True)
class MeasuredField:
    """A field on the touch face: points (n, 2) in m from the plate's centre, complex values (n,) in the file's unit."""

    file: str
    synthetic: bool
    quantity: Quantity
    points_m: FloatArray
    values: ComplexArray


class _Table:
    """Cells of a CSV file, the line of each row, and the role of each column."""

    def __init__(self, path: Path) -> None:
        self.path = path
        text = _text(path)
        comments = [line for line in text.splitlines() if line.lstrip().startswith("#")]
        self.synthetic = bool(comments) and comments[0].lstrip("# \t").startswith(SYNTHETIC)
        numbered = [(n, line) for n, line in enumerate(text.splitlines(), 1) if line.strip()]
        numbered = [(n, line) for n, line in numbered if not line.lstrip().startswith("#")]
        if not numbered:
            raise self.error("no columns: the first line that is not a comment must name them")
        while len(numbered) > 1 and PREAMBLE.fullmatch(numbered[0][1].strip()):
            del numbered[0]
        self.head_line, head = numbered[0]
        self.delimiter = next((mark for mark in ("\t", ";", ",") if mark in head), ",")
        self.names = [_plain(name) for name in self._cells(head)]
        if len(numbered) > 1 and all(_is_unit(cell) for cell in self._cells(numbered[1][1])):
            units = self._cells(numbered.pop(1)[1])
            self.names = [_plain(f"{name} {unit}") for name, unit in zip_longest(self.names, units, fillvalue="")]
        self.roles = self._roles()
        self.lines = [n for n, _ in numbered[1:]]
        self.rows = [self._cells(line) for _, line in numbered[1:]]
        for row, cells in enumerate(self.rows):
            if len(cells) != len(self.names):
                raise self.error(f"{len(cells)} values: must be {len(self.names)}, one for each column", row)
        if not self.rows:
            raise self.error("no rows: values must follow the line of column names")

    @property
    def names_text(self) -> str:
        """Names of the file's columns."""
        return ", ".join(self.names)

    def name(self, role: str) -> str:
        """Name of the column with a role."""
        return self.names[self.roles[role]]

    def numbers(self, role: str, scales: dict[str, float] | None = None) -> FloatArray:
        """Values of a column, (rows,), times the factor of its unit; `scales` lists the names that the role may have."""
        scale = 1.0
        if scales is not None:
            if role not in self.roles:
                near = next((hint for name in self.names if (hint := nearest(name.lower(), list(scales)))), "")
                raise self.error(f"columns {self.names_text}: must hold {_spelled(' or '.join(scales) + near)}")
            scale = scales[self.name(role).lower()]
        return scale * np.array([self._number(row, role) for row in range(len(self.rows))])

    def error(self, text: str, row: int | None = None, role: str = "") -> InputError:
        """Return an error of one line: file, line, column, value, and what is allowed."""
        line = self.lines[row] if row is not None else getattr(self, "head_line", None)
        where = f"{self.path}: line {line}" if line is not None else str(self.path)
        if role:
            assert row is not None
            where += f", column {self.name(role)} = {quoted(self.rows[row][self.roles[role]])}"
        return InputError(f"{where}: {text}")

    def _cells(self, line: str) -> list[str]:
        try:
            cells = next(csv.reader([line], delimiter=self.delimiter, skipinitialspace=True))
        except csv.Error as error:
            raise self.error(f"a line of {len(line)} characters is not valid CSV ({error})") from error
        return [cell.strip() for cell in cells]

    def _number(self, row: int, role: str) -> float:
        try:
            text = self.rows[row][self.roles[role]]
            value = float(text if self.delimiter == "," else text.replace(",", "."))
        except ValueError:
            value = float("nan")
        if not isfinite(value):
            raise self.error("must be a finite number, with a point for decimals", row, role)
        if abs(value) > LARGEST:
            raise self.error(f"must be within {LARGEST:g}", row, role)
        return value

    def _roles(self) -> dict[str, int]:
        roles: dict[str, int] = {}
        for index, name in enumerate(self.names):
            role = _role(name.lower())
            if role in roles:
                raise self.error(f"columns {self.names[roles[role]]} and {name} both hold {role}: must be one")
            if role:
                roles[role] = index
        return roles


def read_sweep(path: str | Path) -> MeasuredSweep:
    """Read a sweep with the columns frequency_Hz (or _kHz, _MHz) and real, imag or amplitude, phase_deg (or phase_rad).

    A universal file is recognised by its ending. Raises InputError for any other file: one line with file, line, column and
    what is allowed.
    """
    if Path(path).suffix.lower() in UNIVERSAL:
        return _universal_sweep(Path(path))
    table = _Table(Path(path))
    tone = table.numbers("frequency", TONES["frequency"])
    quantity, values = _values(table)
    if quantity == "acceleration":
        quantity, values = "displacement", values / -((2.0 * np.pi * np.maximum(tone, 1e-300)) ** 2)
    for row, hertz in enumerate(tone):
        if hertz <= 0.0:
            raise table.error("must be above 0", row, "frequency")
        if not FREQUENCY_KHZ[0] <= hertz / KHZ <= FREQUENCY_KHZ[1]:
            raise table.error(f"must be {span(FREQUENCY_KHZ)} kHz", row, "frequency")
    order = np.argsort(tone, kind="stable")
    twice = np.flatnonzero(np.diff(tone[order]) == 0.0)
    if len(twice):
        first, second = sorted(order[twice[0] : twice[0] + 2])
        raise table.error(f"repeats the frequency of line {table.lines[first]}", int(second), "frequency")
    if len(tone) < MIN_COUNT:
        raise table.error(f"{len(tone)} frequencies: must be at least {MIN_COUNT}")
    return MeasuredSweep(str(path), table.synthetic, cast("Quantity", quantity), Sweep(tone[order], values[order]))


def read_field(path: str | Path, design: Design) -> MeasuredField:
    """Read a map with the columns x_mm, y_mm (or x_m, y_m; origin at the plate's centre) and values as in a sweep.

    Universal files and InputError as in `read_sweep`; points outside the plate and repeated points are rejected, too.
    """
    if Path(path).suffix.lower() in UNIVERSAL:
        return _universal_field(Path(path), design)
    table = _Table(Path(path))
    points = np.column_stack([table.numbers(axis, PLACES[axis]) for axis in "xy"])
    quantity, values = _values(table)
    if (
        quantity == "acceleration"
    ):  # at one frequency it is proportional to displacement, and comparisons of maps ignore the factor
        quantity, values = "displacement", -values
    for axis, half in enumerate((design.half_length_m, design.half_span_m)):
        beyond = np.flatnonzero(np.abs(points[:, axis]) > half + EDGE_M)
        if len(beyond):
            limit = f"beyond the plate: must be from {-half / MM:g} to {half / MM:g} mm"
            raise table.error(limit, int(beyond[0]), "xy"[axis])
    rounded = np.round(points / SAME_M).astype(np.int64)
    _, first, place = np.unique(rounded, axis=0, return_index=True, return_inverse=True)
    again = np.flatnonzero(first[place.ravel()] != np.arange(len(points)))
    if len(again):
        row = int(again[0])
        raise table.error(f"repeats the point of line {table.lines[int(first[place.ravel()[row]])]}", row, "x")
    return MeasuredField(str(path), table.synthetic, cast("Quantity", quantity), points, values)


def _values(table: _Table) -> tuple[str, ComplexArray]:
    """Return the quantity and its complex values."""
    for first, second in PAIRS:
        if first in table.roles and second in table.roles:
            break
    else:
        lone = next((pair for pair in PAIRS if set(pair) & set(table.roles)), None)
        lacking = "" if lone is None else f" ({next(role for role in lone if role not in table.roles)} is missing)"
        raise table.error(f"columns {table.names_text}: must hold {PAIRS_ALLOWED}{lacking}")
    kinds, units = zip(*(_parsed(table, role) for role in (first, second)), strict=True)
    if kinds[0] != kinds[1] and not (second == "phase" and kinds[1] is None):
        raise table.error(f"columns {table.name(first)} and {table.name(second)}: must be of one quantity")
    one, two = table.numbers(first), table.numbers(second)
    if first == "real":
        if units[0] != units[1]:
            raise table.error(f"columns {table.name(first)} and {table.name(second)}: must have one unit")
        values = one + 1j * two
    else:
        values = _amplitude(table, one, units[0]) * np.exp(1j * _radians(table, two, units[1]))
    if not np.abs(values).max() > 1.0 / LARGEST:
        raise table.error(
            f"columns {table.name(first)} and {table.name(second)}: every value is 0, must hold a measurement"
        )
    return kinds[0] or "velocity", values


def _parsed(table: _Table, role: str) -> tuple[str | None, str]:
    """Return the quantity that a column's name or unit says, if any, and the unit."""
    match = VALUE.fullmatch(table.name(role).lower())
    assert match is not None
    named, unit = match.group(1), match.group(3) or ""
    if role == "phase":
        return named, unit
    known = _bare(unit) in OF_UNIT
    by_unit = OF_UNIT.get(_bare(unit))
    if not known and named is None:
        raise table.error(
            f"column {table.name(role)}: unknown unit: must be m/s, m, m/s2, g or V, with a prefix or in dB, or the name must "
            f"begin with {', '.join(f'{kind}_' for kind in KINDS[:-1])} or {KINDS[-1]}_"
        )
    if named and by_unit not in (None, named, "sensor"):  # an instrument gives any quantity in V
        raise table.error(f"column {table.name(role)}: its unit is that of a {by_unit}: must be of a {named}")
    return named or by_unit, unit


def _bare(unit: str) -> str:
    """Normalise a unit: m_per_s_per_V, (m/s)/V, m s^-1/V and m/s become m/s; dB re 1 nm becomes nm."""
    text = unit.lower().replace("µ", "u").replace("μ", "u").replace("_per_", "/").replace("²", "2")
    if found := DECIBEL.fullmatch(text):
        text = found.group(1)
    text = re.sub(r"\s*[_/ ·*]\s*", "/", re.sub(r"[()^]|\*\*", "", text)).replace("s-1", "s").replace("s-2", "s2")
    return text.removesuffix("/v") if text != "/v" else text


def _amplitude(table: _Table, values: FloatArray, unit: str) -> FloatArray:
    if unit.startswith("db"):
        beyond = np.flatnonzero(np.abs(values) > LARGEST_DB)
        if len(beyond):
            raise table.error(f"must be from {-LARGEST_DB:g} to {LARGEST_DB:g} dB", int(beyond[0]), "amplitude")
        return np.asarray(10.0 ** (values / 20.0))
    below = np.flatnonzero(values < 0.0)
    if len(below):
        raise table.error("must be 0 or more (or amplitude_dB)", int(below[0]), "amplitude")
    return values


def _radians(table: _Table, values: FloatArray, unit: str) -> FloatArray:
    if unit not in ("deg", "rad"):
        raise table.error(f"column {table.name('phase')}: must be phase_deg or phase_rad")
    return np.radians(values) if unit == "deg" else values


def _is_unit(cell: str) -> bool:
    return cell[:1] in ("[", "(") and cell[-1:] in ("]", ")")


def _plain(name: str) -> str:
    """Normalise a column's name, with its quantity first and its unit last: Frequency (kHz) becomes frequency_kHz."""
    found = UNIT_IN_BRACKETS.fullmatch(name)
    if not found:
        return SYNONYMS.get(name.lower(), name)
    word, unit = (part.strip() for part in found.groups())
    role = SYNONYMS.get(word.lower(), word.lower())
    unit = SYNONYMS.get(unit, unit)
    return f"{role}_{unit}" if unit else role


def _role(name: str) -> str:
    for role, scales in (TONES | PLACES).items():
        if name in scales:
            return role
    match = VALUE.fullmatch(name)
    return match.group(2) if match else ""


def _spelled(text: str) -> str:
    """Write the units in column names correctly: frequency_kHz."""
    return text.replace("_khz", "_kHz").replace("_mhz", "_MHz").replace("_hz", "_Hz")


def _text(path: Path) -> str:
    read_by_command(path)
    try:
        return path.read_bytes().decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise InputError(f"{path}: not UTF-8 text at byte {error.start}: must be a CSV file in UTF-8") from error
    except OSError as error:
        missing = isinstance(error, FileNotFoundError)
        why = f"no such file{nearest_file(path)}" if missing else f"cannot be read ({error.strerror})"
        raise InputError(f"{path}: {why}: must be a CSV file") from error


def _universal_sweep(path: Path) -> MeasuredSweep:
    """Read the response of the file, or of its node with the largest motion; InputError for a file without one."""
    responses, _ = _read(path)
    quantity = _quantity(responses, path)
    frequency, values = max((_curve(each, path) for each in responses), key=lambda curve: float(np.abs(curve[1]).max()))
    return MeasuredSweep(str(path), False, quantity, Sweep(frequency, values))


def _universal_field(path: Path, design: Design) -> MeasuredField:
    """Every node's response at the frequency of the largest motion; InputError for nodes without a place on the plate."""
    responses, places = _read(path)
    curves = [_curve(each, path) for each in responses]
    frequency = curves[0][0]
    if any(len(tones) != len(frequency) or not np.allclose(tones, frequency) for tones, _ in curves):
        raise InputError(f"{path}: the responses have different frequencies: must be the same for a map")
    values = np.stack([curve for _, curve in curves])
    nodes = [int(each["rsp_node"]) for each in responses]
    faults = [
        f"{path}: node {node} has a response but no coordinates: must be in dataset 15 or 2411"
        for node in nodes
        if node not in places
    ]
    if faults or len(set(nodes)) < len(nodes):
        raise InputError(faults or f"{path}: a node has several responses: must have one each for a map")
    points = np.array([places[node] for node in nodes])
    beyond = np.abs(points) > np.array([design.half_length_m, design.half_span_m]) + EDGE_M
    if beyond.any():
        node = nodes[int(np.flatnonzero(beyond.any(axis=1))[0])]
        raise InputError(
            f"{path}: node {node} lies outside the plate: coordinates must start at its centre, in the file's unit (164)"
        )
    peak = int(np.argmax((np.abs(values) ** 2).sum(axis=0)))
    return MeasuredField(str(path), False, _quantity(responses, path), points, values[:, peak])


def _read(path: Path) -> tuple[list[dict[str, Any]], dict[int, FloatArray]]:
    """Read the frequency responses, and the coordinates (x, y) of nodes in m."""
    import pyuff

    read_by_command(path)
    if not path.is_file():
        raise InputError(f"{path}: no such file: must be a universal file")
    try:
        sets = pyuff.UFF(str(path)).read_sets()
    except Exception as fault:  # pyuff raises many types of exception for malformed lines
        raise InputError(f"{path}: cannot be read ({fault}): must be a universal file") from fault
    listed = sets if isinstance(sets, list) else [sets]
    responses = [each for each in listed if each.get("type") == 58 and each.get("func_type") == FREQUENCY_RESPONSE]
    if not responses:
        raise InputError(
            f"{path}: contains no frequency response: must have a dataset 58 of function type {FREQUENCY_RESPONSE}"
        )
    normal = [each for each in responses if _direction(each) in NORMAL]
    if not normal:
        there = ", ".join(sorted({DIRECTIONS.get(abs(_direction(each)), "unknown") for each in responses}))
        raise InputError(
            f"{path}: has responses along {there} only: must have some along z, the plate's normal (record 6)"
        )
    length = next((float(each["length"]) for each in listed if each.get("type") == 164), 1.0)
    if not 0.0 < length < np.inf:
        raise InputError(f"{path}: dataset 164: length factor {length:g}: must be above 0")
    places: dict[int, FloatArray] = {}
    for each in listed:
        if each.get("type") in (15, 2411):
            numbers = np.atleast_1d(each.get("node_nums", each.get("grid_global")))
            columns = [np.atleast_1d(each[axis]) for axis in "xy"]
            if {len(column) for column in columns} != {len(numbers)} or not np.isfinite([numbers, *columns]).all():
                raise InputError(f"{path}: dataset {each['type']}: every node must have a number and finite x, y and z")
            places |= {int(number): np.array(place) / length for number, *place in zip(numbers, *columns, strict=True)}
    return normal, places


def _direction(response: dict[str, Any]) -> int:
    return int(response.get("rsp_dir") or 0)


def _curve(response: dict[str, Any], path: Path) -> tuple[FloatArray, ComplexArray]:
    """Return frequencies above 0 and complex values along z; accelerations become displacements."""
    frequency, values = np.asarray(response["x"], dtype=float), np.asarray(response["data"], dtype=complex)
    above = frequency > 0.0
    if above.sum() < MIN_COUNT:
        raise InputError(f"{path}: {above.sum()} frequencies above 0: must be at least {MIN_COUNT}")
    if not np.isfinite(values).all():
        raise InputError(f"{path}: node {response['rsp_node']}: every value must be a finite number")
    if not (np.isfinite(frequency[above]).all() and np.all(np.diff(frequency[above]) > 0.0)):
        raise InputError(f"{path}: node {response['rsp_node']}: its frequencies must be finite and ascend")
    frequency, values = frequency[above], NORMAL[_direction(response)] * values[above]
    if int(response["ordinate_spec_data_type"]) == ACCELERATION:
        values = values / -((2.0 * np.pi * frequency) ** 2)
    return frequency, np.asarray(values, dtype=complex)


def _quantity(responses: list[dict[str, Any]], path: Path) -> Quantity:
    """Return the quantity of all responses."""
    codes = sorted({int(each["ordinate_spec_data_type"]) for each in responses})
    for code in codes:
        if code not in QUANTITIES:
            known = "8 (displacement), 11 (velocity), 12 (acceleration) or 0 (read as a velocity)"
            raise InputError(f"{path}: ordinate of type {code}: must be {known}")
    if len(found := {QUANTITIES[code] for code in codes}) > 1:
        raise InputError(f"{path}: ordinates of types {', '.join(map(str, codes))}: must be of one quantity")
    return found.pop()
