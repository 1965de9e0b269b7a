"""Where a command's result goes: text for people, one JSON document for scripts, files into a folder."""

from __future__ import annotations

import csv
import io
import json
import sys
from argparse import Namespace
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

from pipeline.errors import InputFault
from pipeline.store import StoreError, write_atomic


def emit(arguments: Namespace, name: str, document: dict[str, Any], text: str) -> None:
    """Text on standard output unless the JSON goes there; JSON to its file, and as NAME.json into --out."""
    encoded = json.dumps(document, indent=1, allow_nan=False) + "\n"
    if arguments.json == "-":
        sys.stdout.write(encoded)
    else:
        print(text)
    if arguments.json and arguments.json != "-":
        write_file(Path(arguments.json), encoded.encode())
    if getattr(arguments, "out", None):
        write_file(folder(arguments.out) / f"{name}.json", encoded.encode())


def folder(path: str) -> Path:
    """An output folder, made when it is not there. Raises InputFault when it cannot be."""
    place = Path(path)
    try:
        place.mkdir(parents=True, exist_ok=True)
    except OSError as fault:
        raise InputFault(f"--out = {path}: {fault.strerror}: must be a folder that can be written") from fault
    return place


def write_file(path: Path, data: bytes) -> None:
    """Write a whole file or none. Raises InputFault when the place cannot be written."""
    try:
        write_atomic(path, data)
    except (OSError, StoreError) as fault:
        raise InputFault(f"{path}: cannot be written ({fault})") from fault


def table(head: Sequence[str], rows: Iterable[Sequence[Any]]) -> str:
    """Aligned columns of text; None shows as a dash."""
    cells = [list(head), *([_shown(value) for value in row] for row in rows)]
    widths = [max(len(row[i]) for row in cells) for i in range(len(head))]
    return "\n".join("  ".join(value.rjust(width) for value, width in zip(row, widths, strict=True)) for row in cells)


def csv_bytes(head: Sequence[str], rows: Iterable[Sequence[Any]]) -> bytes:
    """The same as comma-separated values, full precision."""
    out = io.StringIO()
    writer = csv.writer(out, lineterminator="\n")
    writer.writerow(head)
    writer.writerows(rows)
    return out.getvalue().encode()


def _shown(value: Any) -> str:
    if value is None:
        return "-"
    return f"{value:.6g}" if isinstance(value, float) else str(value)
