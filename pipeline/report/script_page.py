"""The page of a scripted study: sections of words, tables and pictures; each table also as CSV, and all as Markdown."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

from pipeline.plots import style
from pipeline.records import outputs, store
from pipeline.report.html import render
from pipeline.report.pictures import Embedder

PAGE = "page.json"  # what the page holds, for the pages of other studies
SCHEMA = 1
EMBEDDED_BYTES = 12_000_000


@dataclass(frozen=True)
class Table:
    """Rows of text or numbers under headings; `name` is its CSV file."""

    name: str
    headings: Sequence[str]
    rows: Sequence[Sequence[Any]]


@dataclass(frozen=True)
class Section:
    """A heading, paragraphs, tables and functions that draw pictures."""

    heading: str
    words: Sequence[str] = ()
    tables: Sequence[Table] = ()
    report_figures: Sequence[Callable[[], style.ReportFigure]] = ()


@dataclass(frozen=True)
class Page:
    """What a script concludes."""

    sections: Sequence[Section] = field(default_factory=list)


def write_page(folder: Path, name: str, title: str, lead: str, page: Page) -> list[Path]:
    """Write CSV files, pictures, report.html, report.md and page.json; returns the tables and the page."""
    written, embedded, kept = [], [], []
    embedder = Embedder(folder, EMBEDDED_BYTES)
    for section in page.sections:
        for table in section.tables:
            path = folder / f"{table.name}.csv"
            store.write_atomic(path, outputs.csv_bytes(table.headings, table.rows))
            written.append(path)
        with style.style():
            pictures = [style.save(draw(), folder / style.PICTURES) for draw in section.report_figures]
        embedded.append((section, embedder.show_all(style.PICTURES, pictures)))
        kept.append(_kept(section, pictures))
    html = folder / "report.html"
    page_text = render("scripted.html.j2", name=name, title=title, lead=lead, sections=embedded, text=text)
    store.write_atomic(html, page_text.encode())
    store.write_atomic(folder / "report.md", markdown(title, lead, page).encode())
    store.write_json(folder / PAGE, {"schema": SCHEMA, "name": name, "title": title, "lead": lead, "sections": kept})
    return [*written, html]


def _kept(section: Section, pictures: list[style.StoredFigure]) -> dict[str, Any]:
    return {
        "heading": section.heading,
        "words": list(section.words),
        "tables": [table.name for table in section.tables],
        "pictures": [asdict(picture) for picture in pictures],
    }


def markdown(title: str, lead: str, page: Page) -> str:
    """The words and tables as Markdown, without pictures."""
    lines = [f"# {title}", "", lead, ""]
    for section in page.sections:
        lines += [f"## {section.heading}", ""]
        for words in section.words:
            lines += [words, ""]
        for table in section.tables:
            lines.append(outputs.markdown(table.headings, [[text(value) for value in row] for row in table.rows]))
    return "\n".join(lines)


def text(value: Any) -> str:
    """A cell as text: numbers to five digits, nothing as a dash."""
    if value is None or value == "":
        return "–"
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, float):
        return f"{value:.2e}" if value != 0.0 and not 1e-3 <= abs(value) < 1e7 else f"{value:.6g}"
    return str(value)
