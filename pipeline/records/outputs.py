"""Output places of a command, checked before computing; tables as text, CSV, Markdown and for pandas."""

from __future__ import annotations

import csv
import errno
import io
import os
import re
import sys
import tempfile
from argparse import Namespace
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from types import ModuleType
from typing import Any, NamedTuple

from geometry import files
from pipeline import quantity
from pipeline.errors import InputError
from pipeline.quantity import Unit

STANDARD_OUTPUT = "-"
DOCUMENTS = ("json", "csv", "markdown")  # documents written to a file or, one of them, to standard output
FORMULA = ("=", "+", "-", "@", "\t", "\n")  # first characters of a formula in some spreadsheets
RIGID = 1e-4  # relative to the largest frequency of a table: a smaller one with an error bar of 0 is a rigid-body wave
UNREAD = ("residual",)  # for checking a solver: only in files
# error bars that set the digits, and appear only in files
UNREAD_BARS = re.compile(r"band_\d+_error|(zone_share|mac|strength)_error")
OF_ITS_OWN = ("quantity", "value")  # columns with the name of a figure, and its value

BARS = {  # error bars not named after their figure
    "frequency_hz": "error",
    "db_per_row": "db_error",
    "quality_factor": "quality_error",
    "reference_hz": "allowed",
    "found_hz": "allowed",
}

UNITS = {
    "hz": "Hz", "khz": "kHz", "db": "dB", "m": "m", "mm": "mm", "kg": "kg", "per_m": "rad/m", "m_per_V": "m/V",
    "GPa": "GPa", "deg": "deg",
}  # fmt: skip


class Form(NamedTuple):
    """Format of a figure without an error bar: unit, factor, and whether it was given instead of computed."""

    unit: str
    factor: float = 1.0
    is_given: bool = False


PERCENT = Form("%", 100.0)
GIVEN_HZ = Form("kHz", 1e-3, is_given=True)
ENDINGS = {
    "_error_db": Form("dB"),
    "_rms_error_m_per_V": Form("nm/V", 1e9),
    "_error": PERCENT,
    "_hz": Form("kHz", 1e-3),
    "_rms_m_per_V": Form("nm/V", 1e9),
    "_rms_m_per_N": Form("nm/N", 1e9),
    "_per_m": Form("rad/m"),
    "_db": Form("dB"),
    "_mm": Form("mm", is_given=True),
}
KHZ, MS = ENDINGS["_hz"], Form("ms", 1e3)
NAMES = {
    "frequency_hz": ("frequency", GIVEN_HZ),
    "detuning_hz": ("detuning", GIVEN_HZ),
    "kx_per_m": ("kx", Form("rad/m", is_given=True)),
    "ky_per_m": ("ky", Form("rad/m", is_given=True)),
    "db_per_row": ("attenuation per row", Form("dB")),
    "zone_share": ("zone fraction", Form("")),
    "quality_error": ("± quality factor", Form("")),
    "db_error": ("± attenuation per row", Form("dB")),
    "formula_hz": ("beam formula", KHZ),
    "pinned_hz": ("pinned sides (Mindlin)", KHZ),
    "thin_clamped_hz": ("clamped sides (thin plate)", KHZ),
    "clamped_hz": ("clamped sides (Mindlin)", KHZ),
    "timoshenko_height_mm": ("height (Timoshenko)", ENDINGS["_mm"]),
    "given_euler_hz": ("given (Euler)", KHZ),
    "given_timoshenko_hz": ("given (Timoshenko)", KHZ),
    "gain_n_m": ("gain K'", Form("N/m", is_given=True)),
    "largest_force_n": ("largest force", Form("N")),
    "reached_95_s": ("95 % reached", MS),
    "settled_5_s": ("settled within 5 %", MS),
    "limited_periods": ("saturated periods", Form("")),
    "mass_g": ("mass", Form("g")),
    "band_khz": ("stop band", Form("kHz")),
    "given_second_hz": ("given, second bending", KHZ),
    "allowed": ("allowed", PERCENT),
    "young_GPa": ("young GPa", Form("", is_given=True)),
    "density_kg_m3": ("density kg m3", Form("", is_given=True)),
    "poisson": ("poisson", Form("", is_given=True)),
}


def is_standard_output(place: str | os.PathLike[str] | None) -> bool:
    """Whether a place on the command line is standard output: -, /dev/stdout and the like."""
    return bool(place) and (str(place) == STANDARD_OUTPUT or files.open_descriptor(str(place)) == 1)


def check_places(arguments: Namespace) -> None:
    """Raise InputError, before computing, with a line for each place on the command line that cannot be written."""
    lines = []
    for name in ("out", "synthetic_data"):
        place = getattr(arguments, name, None)
        if place is not None and (reason := folder_obstacle(place)):
            lines.append(f"--{name.replace('_', '-')} = {place}: {reason}: must be a folder that can be written")
    alone = {f"--{name}": place for name in DOCUMENTS if (place := getattr(arguments, name, None)) is not None}
    for option, place in (alone | {"--plot": getattr(arguments, "plot", None)}).items():
        lines += _violations(option, [place])
    each = alone | {"-o": getattr(arguments, "output", None)}
    first, *others = [option for option, place in each.items() if place and is_standard_output(place)] or [""]
    lines += [
        f"{option} = {each[option]}: standard output takes a single document, here that of {first}" for option in others
    ]
    lines += _violations("--out", _known_files(arguments))
    lines += _same_place(each | {"--plot": getattr(arguments, "plot", None)})
    if lines:
        raise InputError(lines)


def check_files(option: str, places: Iterable[str | Path]) -> None:
    """Raise InputError, before computing, with a line for each place of an option that cannot be written."""
    if lines := _violations(option, places):
        raise InputError(lines)


def folder_obstacle(path: str) -> str | None:
    """Return why an output folder cannot be created or written to, None if it can; nothing is created."""
    place = Path(path)
    if not path:
        return "it has no name"
    if place.is_symlink() and not place.exists():
        return "it is a broken link"
    nearest = next((each for each in (place, *place.parents) if each.exists()), Path())
    if not nearest.is_dir():
        return f"{nearest} is not a folder"
    return None if os.access(nearest, os.W_OK | os.X_OK) else f"{nearest}: {os.strerror(errno.EACCES)}"


def folder(path: str) -> Path:
    """Return an output folder, created if missing. Raises InputError if that fails."""
    place = Path(path)
    try:
        place.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(f"--out = {path}: {error.strerror}: must be a folder that can be written") from error
    return place


def write_file(path: Path, data: bytes) -> None:
    """Write a file or standard output. Raises InputError if the place cannot be written."""
    with delivered(path) as temporary:
        temporary.write_bytes(data)


@contextmanager
def delivered(place: Path) -> Iterator[Path]:
    """Yield a temporary path whose content goes to a file or standard output if the block succeeds.

    Raises InputError for a place that cannot be written and for a terminal, which binary data would garble.
    """
    if is_standard_output(place):
        with _for_standard_output() as temporary:
            yield temporary
        return
    try:
        with files.written_whole(place) as temporary:
            yield temporary
    except files.UnwritableError as error:
        raise InputError(str(error)) from error
    except OSError as error:
        raise InputError(f"{place}: cannot be written ({error.strerror or error})") from error


def table(head: Sequence[str], rows: Iterable[Sequence[Any]]) -> str:
    """Format aligned columns of text; None becomes a dash."""
    cells = [list(head), *([_shown(value) for value in row] for row in rows)]
    widths = [max(len(row[i]) for row in cells) for i in range(len(head))]
    return "\n".join("  ".join(value.rjust(width) for value, width in zip(row, widths, strict=True)) for row in cells)


def csv_bytes(head: Sequence[str], rows: Iterable[Sequence[Any]]) -> bytes:
    """Format as comma-separated values: full precision, empty for None, no text that a spreadsheet would evaluate."""
    out = io.StringIO()
    writer = csv.writer(out, lineterminator="\n")
    writer.writerows([no_formula(value) if isinstance(value, str) else value for value in row] for row in (head, *rows))
    return out.getvalue().encode()


def markdown(head: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """Format a table in Markdown, vertical bars in cells escaped."""
    lines = [head, ["---"] * len(head), *rows]
    return "".join("| " + " | ".join(cell.replace("|", "\\|") for cell in line) + " |\n" for line in lines)


def no_formula(text: str) -> str:
    """Prefix a cell with an apostrophe if a spreadsheet would evaluate it; numbers stay numbers."""
    text = text.replace("\r", "\\r")  # csv leaves it unquoted, and readers treat it as the end of the row
    if not text.startswith(FORMULA):
        return text
    try:
        float(text)
    except ValueError:
        return f"'{text}"
    return text


def named(name: str) -> tuple[str, Form]:
    """Return heading and format of a figure from its name in files: band_1_hz -> band 1, in kHz."""
    if name in NAMES:
        return NAMES[name]
    if name == "error":
        return "± error", PERCENT
    if (figure := name.removesuffix("_error")) in NAMES:
        return f"{NAMES[figure][0]}: expected error", PERCENT
    ending = next((ending for ending in ENDINGS if name.endswith(ending)), "")
    words = name.removesuffix(ending).replace("_", " ").strip()
    return f"± {words}".strip() if "error" in ending else words, ENDINGS.get(ending, Form(""))


def bar_of(name: str, head: Collection[str]) -> str | None:
    """Return the column with the error bar of a figure; None if there is none."""
    if "error" in name:
        return None
    parts = name.split("_")
    within = ("_".join([*parts[:i], "error", *parts[i:]]) for i in range(1, len(parts) + 1))
    tried = (*([f"{name.removesuffix('_hz')}_error"] if name.endswith("_hz") else ()), *within, BARS.get(name, ""))
    return next((bar for bar in tried if bar in head), None)


def is_relative(name: str, bar: str) -> bool:
    """Whether an error bar is relative: that of a frequency, unless it has its own unit."""
    return name.endswith("_hz") and not bar.endswith("_hz")


def shown(name: str, value: Any, form: Form) -> Any:
    """Format a figure without an error bar, or an error bar; anything but a float stays unchanged."""
    if not isinstance(value, float):
        return value
    if form.unit == "%":
        return quantity.percent(value).removesuffix(" %")
    if form.is_given:
        return f"{form.factor * value:g}"
    if "error" in name:
        return quantity.figure(form.factor * value, form.factor * value)
    return quantity.level_figure(value) if form.unit == "dB" else quantity.figure(form.factor * value)


def frequency_unit(head: Sequence[str], rows: Iterable[Sequence[Any]]) -> Unit:
    """Return the unit of all frequencies of a table: that of the largest."""
    values = [value for row in rows for name, value in zip(head, row, strict=True) if name.endswith("_hz")]
    known = [value for value in values if isinstance(value, float)]
    return quantity.frequency_unit(known) if known else Unit(ENDINGS["_hz"].unit, 1.0 / ENDINGS["_hz"].factor)


def cells(head: Sequence[str], rows: Sequence[Sequence[Any]]) -> tuple[list[str], list[list[Any]]]:
    """Return headings with units, and rows of figures with the digits that their error bars allow; None stays None."""
    unit = frequency_unit(head, rows)
    known = {name: _in_unit(form, unit) if name.endswith("_hz") else form for name in head for form in [named(name)[1]]}
    read = [name for at, name in enumerate(head) if not (UNREAD_BARS.fullmatch(name) or _is_empty_bar(name, at, rows))]
    words = [f"{named(name)[0]} ({known[name].unit})" if known[name].unit else named(name)[0] for name in read]
    bars = {name: bar_of(name, head) for name in head}
    largest = max(
        (abs(v) for row in rows for n, v in zip(head, row, strict=True) if n.endswith("_hz") and v), default=0.0
    )

    def cell(name: str, row: Mapping[str, Any]) -> Any:
        value, form, bar = row[name], known[name], bars[name]
        if bar is None or not isinstance(value, float):
            return shown(name, value, form)
        own = row[bar]
        if own == 0.0 == value:
            return "0"
        if name.endswith("_hz") and is_relative(name, bar):
            at_rest = not value or (own == 0.0 and abs(value) < RIGID * largest)
            return "0" if at_rest else quantity.frequency_figure(value, own, unit)
        scaled = [None if each is None else form.factor * each for each in (value, own)]
        return quantity.level_figure(*scaled) if form.unit == "dB" else quantity.figure(*scaled)

    named_rows = (dict(zip(head, row, strict=True)) for row in rows)
    return words, [[cell(name, row) for name in read] for row in named_rows]


def filled(head: Sequence[str], rows: Sequence[Sequence[Any]]) -> tuple[list[str], list[list[Any]]]:
    """Return head and rows without unread columns and those that are empty in every row.

    An empty column of error bars stays: its figures have no estimate, which sets their digits.
    """
    bars = {bar_of(name, head) for name in head}
    some = [at for at in range(len(head)) if not rows or head[at] in bars or any(row[at] is not None for row in rows)]
    kept = [at for at in some if head[at] not in UNREAD]
    return [head[at] for at in kept], [[row[at] for at in kept] for row in rows]


def reading_table(head: Sequence[str], rows: Iterable[Sequence[Any]], marked: Collection[int] = ()) -> str:
    """Format aligned columns under headings with units; rows with `marked` numbers begin with a star."""
    first, *lines = table(*_in_words(head, rows)).splitlines()
    if not marked:
        return "\n".join([first, *lines])
    return "\n".join([f"  {first}", *(f"{'*' if i in marked else ' '} {line}" for i, line in enumerate(lines))])


def reading_markdown(head: Sequence[str], rows: Sequence[Sequence[Any]]) -> str:
    """Format a table for reading in Markdown, without empty columns."""
    heading, cells = _in_words(*filled(head, rows))
    return markdown(heading, [["-" if cell is None else str(cell) for cell in row] for row in cells])


def unit_of(name: str) -> str | None:
    """Return the unit at the end of a column's name; None for a name without one.

    >>> from pipeline.records.outputs import unit_of
    >>> unit_of("zone_rms_m_per_V"), unit_of("kx_per_m"), unit_of("mac")
    ('m/V', 'rad/m', None)
    """
    ends = [end for end in UNITS if name.endswith(f"_{end}")]
    return UNITS[max(ends, key=len)] if ends else None


def frame(rows: Sequence[dict[str, Any]], heading: Sequence[str] = ()) -> Any:
    """Return the rows as a pandas DataFrame, with the columns `heading` if empty. Raises ImportError without pandas."""
    return _needed("pandas").DataFrame(list(rows), columns=None if rows else list(heading))


def dataset(rows: Sequence[dict[str, Any]], dimensions: Sequence[str]) -> Any:
    """Return the rows as an xarray Dataset over the index columns; `units` in the attributes.

    Raises ImportError without pandas and xarray.
    """
    _needed("xarray")
    data = frame(rows).set_index(list(dimensions)).to_xarray()
    for name, variable in data.variables.items():
        if unit := unit_of(str(name)):
            variable.attrs["units"] = unit
    return data


def html_table(names: Sequence[str], rows: Sequence[Sequence[Any]], marked: Collection[int] = ()) -> str:
    """Format rows as an HTML table, units in the head, digits by the error bars; `marked` rows bold, with a star.

    >>> from pipeline.records.outputs import html_table
    >>> html_table(["confinement_db"], [[11.52], [None]], [0])[-66:]
    '<tr><td><b>11.5 *</b></td></tr><tr><td>-</td></tr></tbody></table>'
    """
    from html import escape

    words, shown = cells(names, rows)
    head = "".join(f"<th>{escape(each)}</th>" for each in words)
    lines = []
    for number, row in enumerate(shown):
        texts = [escape(str("-" if value is None else value)) for value in row]
        if number in marked:
            texts = [f"<b>{text}{' *' if place == 0 else ''}</b>" for place, text in enumerate(texts)]
        lines.append("<tr>" + "".join(f"<td>{text}</td>" for text in texts) + "</tr>")
    return f"<table><thead><tr>{head}</tr></thead><tbody>{''.join(lines)}</tbody></table>"


def _same_place(places: Mapping[str, str | None]) -> list[str]:
    """Return one line for each option that writes the same file as an earlier one."""
    first: dict[str, str] = {}
    lines = []
    for option, place in places.items():
        if not place or is_standard_output(place):
            continue
        other = first.setdefault(os.path.realpath(place), option)
        if other != option and not Path(place).is_char_device():
            lines.append(f"{option} = {place}: {other} also writes this file; choose another name")
    return lines


def _violations(option: str, places: Iterable[str | Path | None]) -> list[str]:
    """Return one line per reason: several files that lack the same folder are one fault."""
    first: dict[str, str | Path] = {}
    for place in places:
        if place is not None and (reason := _obstacle(place)):
            first.setdefault(reason, place)
    return [f"{option} = {place}: cannot be written ({reason})" for reason, place in first.items()]


def _obstacle(place: str | Path) -> str | None:
    if not str(place):
        return "it has no name"
    return None if is_standard_output(place) else files.obstacle(place)


def _known_files(arguments: Namespace) -> list[Path]:
    """Return existing files at the places where a command writes into its folders."""
    into, measured = getattr(arguments, "out", None), getattr(arguments, "synthetic_data", None)
    known = [Path(into, f"{arguments.command}{ending}") for ending in (".json", ".csv")] if into else []
    known += [Path(measured, name) for name in ("sweep.csv", "field.csv")] if measured else []
    return [path for path in known if path.exists()]


@contextmanager
def _for_standard_output() -> Iterator[Path]:
    if sys.stdout.isatty():
        raise InputError("-o -: standard output is a terminal; redirect it to a file or a pipe")
    with tempfile.TemporaryDirectory(prefix="antinode-") as place:
        temporary = Path(place, "output")
        yield temporary
        sys.stdout.flush()
        sys.stdout.buffer.write(temporary.read_bytes())
        sys.stdout.flush()


def _shown(value: Any) -> str:
    if value is None:
        return "-"
    return f"{value:g}" if isinstance(value, float) else str(value)


def _is_empty_bar(name: str, at: int, rows: Sequence[Sequence[Any]]) -> bool:
    return "error" in name and len(rows) > 0 and all(row[at] is None for row in rows)


def _in_unit(form: Form, unit: Unit) -> Form:
    return form._replace(unit=unit.symbol, factor=1.0 / unit.size)


def _in_words(head: Sequence[str], rows: Iterable[Sequence[Any]]) -> tuple[list[str], list[list[Any]]]:
    if not set(OF_ITS_OWN) <= set(head):
        return cells(head, list(rows))
    each = [dict(zip(head, row, strict=True)) for row in rows]
    known = {(row.get("part"), row["quantity"]): row["value"] for row in each}
    bars = [known.get((row.get("part"), f"{row['quantity']}_error")) for row in each]
    return cells(head, [_one_quantity(row, bar) for row, bar in zip(each, bars, strict=True)])


def _one_quantity(row: dict[str, Any], bar: float | None) -> list[Any]:
    """Format a row in the unit of its own figure; figures by theory, without an error bar, get few digits."""
    name, value = (row[key] for key in OF_ITS_OWN)
    words, form = named(name)
    text: Any = shown(name, value, form)
    if "part" in row and isinstance(value, float) and "error" not in name:
        unit = quantity.frequency_unit([value]) if name.endswith("_hz") else Unit(form.unit, 1.0 / form.factor)
        form, scaled = _in_unit(form, unit), value / unit.size
        text = quantity.figure(scaled, None if bar is None else abs(scaled) * bar)
    return [*(row | {"quantity": f"{words} ({form.unit})" if form.unit else words, "value": text}).values()]


def _needed(name: str) -> ModuleType:
    from importlib import import_module

    try:
        return import_module(name)
    except ModuleNotFoundError as fault:
        raise ImportError(f"tables need {fault.name}: pip install 'antinode[tables]'") from fault
