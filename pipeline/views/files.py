"""What a computing command leaves: text or JSON, and where asked its figure and its rows."""

from __future__ import annotations

from argparse import Namespace
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from pipeline.errors import InputError
from pipeline.records import outputs

FORMATS = (".png", ".pdf", ".svg")
Cells = Sequence[Sequence[Any]]


def check(arguments: Namespace) -> None:
    """Before computing: InputError for a --plot in a format that is not drawn."""
    place = getattr(arguments, "plot", None)
    if place and Path(place).suffix.lower() not in FORMATS:
        raise InputError(f"--plot = {place}: must end in {', '.join(FORMATS[:-1])} or {FORMATS[-1]}")


def emit(
    arguments: Namespace, kind: str, document: dict[str, Any], text: str, head: Sequence[str], rows: Cells
) -> None:
    """Emit the document as every command does; rows go to --csv and into --out, the figure to --plot."""
    outputs.emit(arguments, kind, document, text)
    places = [Path(arguments.csv)] if arguments.csv else []
    places += [Path(arguments.out) / f"{kind}.csv"] if getattr(arguments, "out", None) else []
    for place in places:
        outputs.write_file(place, outputs.csv_bytes(head, rows))
    if arguments.plot:
        from pipeline.views import figures

        figures.write(kind, document, Path(arguments.plot))
