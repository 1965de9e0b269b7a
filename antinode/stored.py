"""Results read back from files."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from antinode.results import KIND, KINDS, Result
from antinode.sweeps import TABLE, SweepTable, read_table
from pipeline.errors import InputError
from pipeline.questions import registered
from pipeline.questions.result import Result as Answer
from pipeline.records import store
from pipeline.records.record import first_fault

MARKS = {
    "response": "zone_rms_m_per_V",
    "tolerance": "samples",
    "search": "evaluations",
}


def open(path: str | Path) -> Result | Answer | SweepTable:
    """Read a result that `save` or `--json` wrote, or the table of a study or a sweep by its folder or its CSV file.

    Raises InputError for a file that holds none.

    >>> import antinode, tempfile
    >>> file = f"{tempfile.mkdtemp()}/sizes.json"
    >>> antinode.open(antinode.load("examples/small.toml").predesign().save(file)).zone_hz > 33e3
    True
    """
    file = Path(path) / TABLE if Path(path).is_dir() else Path(path)
    if file.suffix == ".csv":
        return read_table(file)
    try:
        document = store.read_json(Path(path))
    except store.BadRecord as error:
        raise InputError(f"{path}: cannot be read: {error}") from error
    kind = _kind(document) if isinstance(document, dict) else None
    if kind in registered() and document.get("schema") == 1:
        return _answer(path, registered()[kind].result, document)
    if kind is None or document.get("schema") != 1:
        raise InputError(
            f"{path}: holds no result: must be a JSON document of modes, bands, attenuation, response, ..."
        )
    return KINDS[kind](document)


def _answer(path: str | Path, kind: type[Answer], document: dict[str, Any]) -> Answer:
    from pydantic import ValidationError

    try:
        return kind.from_document(document)
    except ValidationError as error:
        raise InputError(f"{path}: holds no result: {first_fault(error)}") from error


def _kind(document: dict[str, Any]) -> str | None:
    if document.get(KIND) in KINDS or document.get(KIND) in registered():
        return str(document[KIND])
    for name, question in sorted(registered().items(), key=lambda each: -len(each[1].result.required())):
        if question.result.required() <= document.keys():
            return name
    return next((kind for kind, mark in MARKS.items() if mark in document), None)
