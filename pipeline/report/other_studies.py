"""What other studies of the same results folder tell in a study's page: error against run time, and extreme scenes."""

from __future__ import annotations

import csv
import io
from pathlib import Path
from typing import Any

from pipeline.plots import style
from pipeline.records import store
from pipeline.report.html import PAGE, SCHEMA, Embedder

STUDIES = {"accuracy": "Error against run time", "extremes": "Extreme scenes"}


def beside(folder: Path, embedder: Embedder) -> list[dict[str, Any]]:
    """The scripted studies beside a study's folder: their opening section, and every section that has a picture."""
    return [
        {"name": name, "title": title, "missing": "", "sections": []} | _read(folder, name, embedder)
        for name, title in STUDIES.items()
        if folder.name != name and (folder.parent / name / PAGE).exists()
    ]


def _read(folder: Path, name: str, embedder: Embedder) -> dict[str, Any]:
    """What another study tells, the address of its page, or why there is nothing."""
    try:
        page = store.read_json(folder.parent / name / PAGE)
        if page["schema"] != SCHEMA:
            raise store.BadRecord(f"{PAGE} has schema {page['schema']!r}, this version reads {SCHEMA}")
        sections = [
            _section(folder, name, section, embedder)
            for place, section in enumerate(page["sections"])
            if place == 0 or section["pictures"]
        ]
        told = {"title": page["title"], "lead": page["lead"]}
        return told | {"address": f"../{name}/report.html", "sections": sections}
    except (store.StoreError, OSError, KeyError, TypeError, AttributeError) as error:
        return {"missing": f"written by another version ({error}): antinode report {name}"}


def _section(folder: Path, name: str, section: dict[str, Any], embedder: Embedder) -> dict[str, Any]:
    """A section; its tables only where it has no picture to say the same."""
    pictures = [style.StoredFigure(**entry) for entry in section["pictures"]]
    embedded = embedder.show_all(f"../{name}/{style.PICTURES}", pictures)
    tables = [] if embedded else [_table(folder.parent / name, table) for table in section["tables"]]
    return {"heading": section["heading"], "words": list(section["words"]), "tables": tables, "pictures": embedded}


def _table(other: Path, name: str) -> tuple[str, list[str], list[list[str]]]:
    heading, *rows = csv.reader(io.StringIO((other / f"{name}.csv").read_text(encoding="utf-8")))
    return f"../{other.name}/{name}.csv", heading, rows
