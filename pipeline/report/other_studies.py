"""What other studies of the same results folder tell in a study's page: error against run time, and extreme scenes."""

from __future__ import annotations

import csv
import io
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from pipeline.plots import style
from pipeline.records import store
from pipeline.report.html import PAGE, SCHEMA, EmbeddedFigure, Embedder

STUDIES = {"accuracy": "Error against run time", "extremes": "Extreme scenes"}


@dataclass(frozen=True)
class StudySection:
    """A heading with words, tables as text and pictures."""

    heading: str
    words: list[str] = field(default_factory=list)
    tables: list[tuple[str, list[str], list[list[str]]]] = field(default_factory=list)
    pictures: list[EmbeddedFigure] = field(default_factory=list)


@dataclass(frozen=True)
class Beside:
    """Another study as shown here: its sections, the address of its page, or why there is nothing."""

    name: str
    title: str
    lead: str = ""
    address: str = ""
    missing: str = ""
    sections: list[StudySection] = field(default_factory=list)


def beside(folder: Path, embedder: Embedder) -> list[Beside]:
    """The scripted studies beside a study's folder: their opening section, and every section that has a picture."""
    return [
        _read(folder, name, title, embedder)
        for name, title in STUDIES.items()
        if folder.name != name and (folder.parent / name / PAGE).exists()
    ]


def _read(folder: Path, name: str, title: str, embedder: Embedder) -> Beside:
    other = folder.parent / name
    try:
        page = store.read_json(other / PAGE)
        if page["schema"] != SCHEMA:
            raise store.BadRecord(f"{PAGE} has schema {page['schema']!r}, this version reads {SCHEMA}")
        sections = [
            _section(folder, name, section, embedder)
            for place, section in enumerate(page["sections"])
            if place == 0 or section["pictures"]
        ]
        return Beside(name, page["title"], page["lead"], f"../{name}/report.html", "", sections)
    except (store.StoreError, OSError, KeyError, TypeError, AttributeError) as error:
        return Beside(name, title, missing=f"written by another version ({error}): antinode report {name}")


def _section(folder: Path, name: str, section: dict[str, Any], embedder: Embedder) -> StudySection:
    """A section; its tables only where it has no picture to say the same."""
    pictures = [style.StoredFigure(**entry) for entry in section["pictures"]]
    embedded = embedder.show_all(f"../{name}/{style.PICTURES}", pictures)
    tables = [] if embedded else [_table(folder.parent / name, table) for table in section["tables"]]
    return StudySection(section["heading"], list(section["words"]), tables, embedded)


def _table(other: Path, name: str) -> tuple[str, list[str], list[list[str]]]:
    heading, *rows = csv.reader(io.StringIO((other / f"{name}.csv").read_text(encoding="utf-8")))
    return f"../{other.name}/{name}.csv", heading, rows
