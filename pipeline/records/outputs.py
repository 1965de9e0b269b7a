"""Places that a command writes to, looked at before anything is computed; tables as text, CSV and Markdown."""

from __future__ import annotations

import csv
import errno
import io
import os
import sys
import tempfile
from argparse import Namespace
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from geometry import files
from pipeline.errors import InputError
from pipeline.records.store import StoreError, write_atomic

STANDARD_OUTPUT = "-"
DOCUMENTS = ("json", "csv", "markdown")  # what a command writes where an option says, or alone on standard output
FORMULA = ("=", "+", "-", "@", "\t", "\n")  # what begins a formula in some spreadsheet


def is_standard_output(place: str | os.PathLike[str] | None) -> bool:
    """Whether a place named on the command line is standard output: -, /dev/stdout and their like."""
    return bool(place) and (str(place) == STANDARD_OUTPUT or files.open_descriptor(str(place)) == 1)


def check_places(arguments: Namespace) -> None:
    """Before computing: InputError with a line for each place named on the command line that cannot be written."""
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
        f"{option} = {each[option]}: standard output takes one document, here that of {first}" for option in others
    ]
    lines += _violations("--out", _known_files(arguments))
    lines += _same_place(each | {"--plot": getattr(arguments, "plot", None)})
    if lines:
        raise InputError(lines)


def _same_place(places: Mapping[str, str | None]) -> list[str]:
    """One line for each option whose file an earlier option writes, too."""
    first: dict[str, str] = {}
    lines = []
    for option, place in places.items():
        if not place or is_standard_output(place):
            continue
        other = first.setdefault(os.path.realpath(place), option)
        if other != option and not Path(place).is_char_device():
            lines.append(f"{option} = {place}: {other} writes this file, too; name another one")
    return lines


def check_files(option: str, places: Iterable[str | Path]) -> None:
    """Before computing: InputError with a line for each place of an option that cannot be written."""
    if lines := _violations(option, places):
        raise InputError(lines)


def _violations(option: str, places: Iterable[str | Path | None]) -> list[str]:
    """One line a reason: several files that lack the same folder are one fault."""
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
    """Files that stand where a command is known to write one into its folders."""
    into, measured = getattr(arguments, "out", None), getattr(arguments, "synthetic_data", None)
    known = [Path(into, f"{arguments.command}{ending}") for ending in (".json", ".csv")] if into else []
    known += [Path(measured, name) for name in ("sweep.csv", "field.csv")] if measured else []
    return [path for path in known if path.exists()]


def folder_obstacle(path: str) -> str | None:
    """Why an output folder cannot be made or written to, None when it can; nothing is made."""
    place = Path(path)
    if not path:
        return "it has no name"
    if place.is_symlink() and not place.exists():
        return "it is a link that leads nowhere"
    nearest = next((each for each in (place, *place.parents) if each.exists()), Path())
    if not nearest.is_dir():
        return f"{nearest} is not a folder"
    return None if os.access(nearest, os.W_OK | os.X_OK) else f"{nearest}: {os.strerror(errno.EACCES)}"


def folder(path: str) -> Path:
    """An output folder, made when it is not there. Raises InputError when it cannot be."""
    place = Path(path)
    try:
        place.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(f"--out = {path}: {error.strerror}: must be a folder that can be written") from error
    return place


def write_file(path: Path, data: bytes) -> None:
    """Write a file as geometry.files does. Raises InputError when the place cannot be written."""
    try:
        write_atomic(path, data)
    except StoreError as error:
        raise InputError(error.lines) from error


@contextmanager
def delivered(place: Path) -> Iterator[Path]:
    """A temporary path whose content goes to a file, or to standard output, when the block ends well.

    Raises InputError for a place that cannot be written and for a terminal, which bytes would leave unreadable.
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


@contextmanager
def _for_standard_output() -> Iterator[Path]:
    if sys.stdout.isatty():
        raise InputError("-o -: standard output is a terminal; send it to a file or a pipe")
    with tempfile.TemporaryDirectory(prefix="antinode-") as place:
        temporary = Path(place, "output")
        yield temporary
        sys.stdout.flush()
        sys.stdout.buffer.write(temporary.read_bytes())
        sys.stdout.flush()


def table(head: Sequence[str], rows: Iterable[Sequence[Any]]) -> str:
    """Aligned columns of text; None shows as a dash."""
    cells = [list(head), *([_shown(value) for value in row] for row in rows)]
    widths = [max(len(row[i]) for row in cells) for i in range(len(head))]
    return "\n".join("  ".join(value.rjust(width) for value, width in zip(row, widths, strict=True)) for row in cells)


def csv_bytes(head: Sequence[str], rows: Iterable[Sequence[Any]]) -> bytes:
    """The same as comma-separated values: full precision, nothing for None, no text that a spreadsheet would compute."""
    out = io.StringIO()
    writer = csv.writer(out, lineterminator="\n")
    writer.writerows([no_formula(value) if isinstance(value, str) else value for value in row] for row in (head, *rows))
    return out.getvalue().encode()


def markdown(head: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """A table in Markdown, a bar in a cell escaped."""
    lines = [head, ["---"] * len(head), *rows]
    return "".join("| " + " | ".join(cell.replace("|", "\\|") for cell in line) + " |\n" for line in lines)


def no_formula(text: str) -> str:
    """A cell's text with an apostrophe before what a spreadsheet would compute; numbers stay numbers."""
    text = text.replace("\r", "\\r")  # csv leaves it unquoted, and readers take it for the end of the row
    if not text.startswith(FORMULA):
        return text
    try:
        float(text)
    except ValueError:
        return f"'{text}"
    return text


def _shown(value: Any) -> str:
    if value is None:
        return "-"
    return f"{value:g}" if isinstance(value, float) else str(value)
