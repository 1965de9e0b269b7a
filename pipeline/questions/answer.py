"""What a command answers, and where it goes: text for people, one JSON document for scripts, files into a folder."""

from __future__ import annotations

import json
import sys
from argparse import Namespace
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from pipeline.errors import InputError
from pipeline.questions.late import style
from pipeline.records.outputs import check_places, csv_bytes, folder, is_standard_output, write_file
from pipeline.records.reading import reading_markdown

if TYPE_CHECKING:
    from pipeline.case.model import Case
    from pipeline.logs import TerminalLog
    from pipeline.plots.style import ReportFigure

FORMATS = (".png", ".pdf", ".svg")


@dataclass(frozen=True)
class Answer:
    """A document, lines of text, rows under a head for CSV; pictures for --out, drawn when asked for; a figure for --plot."""

    document: dict[str, Any]
    lines: Sequence[str]
    head: Sequence[str] = ()
    rows: Sequence[Sequence[Any]] = ()
    pictures: Callable[[], Sequence[ReportFigure]] = tuple
    figure: Callable[[], Any] | None = None


def of_case(arguments: Namespace, case: Case) -> Case:
    """The case, kept as the one that is answered; places are looked at once more, now that it is known what it reads."""
    arguments.answered = case
    check_places(arguments)
    return case


def check(arguments: Namespace) -> None:
    """Before computing: InputError for a --plot in a format that is not drawn, or a place that cannot be written."""
    place = getattr(arguments, "plot", None)
    if place and Path(place).suffix.lower() not in FORMATS:
        raise InputError(f"--plot = {place}: must end in {', '.join(FORMATS[:-1])} or {FORMATS[-1]}")
    check_places(arguments)


def emit(arguments: Namespace, name: str, answer: Answer, log: TerminalLog | None = None) -> int:
    """Text on standard output unless a document goes there; JSON, CSV, pictures and files to where they are asked for.

    Every document also says which case it answers, with defaults, and by which version; with a log its seconds.
    """
    case: Case | None = getattr(arguments, "answered", None)
    from importlib.metadata import version  # slow to import, and what only explains needs none

    about = {"case": case and case.name, "with_defaults": case and case.to_dict(), "version": version("antinode")}
    seconds = {"seconds": log.seconds | {"total": log.elapsed}} if log else {}
    document = {"schema": 1, **about, **answer.document, **seconds}
    wants_json = arguments.json or getattr(arguments, "out", None)
    encoded = (json.dumps(document, indent=1, allow_nan=False) + "\n").encode() if wants_json else b""
    written = _files(arguments, name, answer, encoded)
    for place, data in written.items():
        if not is_standard_output(place):
            write_file(place, data)
    if out := getattr(arguments, "out", None):
        _draw(answer, folder(out))
    if answer.head and getattr(arguments, "plot", None):  # a plan has neither rows nor a figure
        _save(_figure(answer), Path(arguments.plot))
    _print(arguments, answer, written)  # last: whoever reads it may have left
    return 0


def _print(arguments: Namespace, answer: Answer, written: Mapping[Path, bytes]) -> None:
    alone = [data for place, data in written.items() if is_standard_output(place)]
    if alone:
        sys.stdout.write(alone[0].decode())
    elif not is_standard_output(getattr(arguments, "output", None)):
        print("\n".join(answer.lines))
    sys.stdout.flush()


def _figure(answer: Answer) -> Any:
    """The figure of an answer, else its first picture."""
    if answer.figure:
        return answer.figure()
    with style.style():
        return answer.pictures()[0].figure


def _save(figure: Any, place: Path) -> None:
    """A figure as a file, whole or not at all, in the format of its ending (png, pdf or svg)."""
    from geometry.files import written_whole

    with style.style(), written_whole(place) as temporary:
        figure.savefig(temporary, format=place.suffix.lstrip(".").lower() or "png", dpi=150, bbox_inches="tight")


def _files(arguments: Namespace, name: str, answer: Answer, encoded: bytes) -> dict[Path, bytes]:
    """What is written, by its place; standard output is one of them."""
    rows = csv_bytes(answer.head, answer.rows) if answer.head else b""
    readable = reading_markdown(answer.head, answer.rows).encode() if answer.head else b""
    known = {"json": encoded, "csv": rows, "markdown": readable}
    chosen = {place: data for key, data in known.items() if (place := getattr(arguments, key, None)) and data}
    written = {Path(place): data for place, data in chosen.items()}
    if out := getattr(arguments, "out", None):
        named = {f"{name}.json": encoded, **({f"{name}.csv": rows} if rows else {})}
        written |= {folder(out) / file: data for file, data in named.items()}
    return written


def _draw(answer: Answer, place: Path) -> None:
    """Every picture of an answer into a folder."""
    with style.style():
        for picture in answer.pictures():
            style.save(picture, place)
