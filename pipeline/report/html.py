"""HTML pages from templates, with embedded pictures and data, and the page of a scripted study."""

from __future__ import annotations

import base64
import json
import mimetypes
import zlib
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, field
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any
from urllib.parse import quote

from pipeline.plots import style
from pipeline.records import outputs, store

if TYPE_CHECKING:
    from jinja2 import Environment
    from markupsafe import Markup

TEMPLATES = Path(__file__).with_name("templates")


@cache
def _templates() -> Environment:
    """Return the environment that reads the templates and keeps those it has compiled."""
    from jinja2 import Environment, FileSystemLoader, StrictUndefined

    look: dict[str, Any] = {"trim_blocks": True, "lstrip_blocks": True, "autoescape": True}
    return Environment(loader=FileSystemLoader(TEMPLATES), undefined=StrictUndefined, **look)


def render(template: str, **values: Any) -> str:
    """Render a page from a template; values are escaped, and a missing name is an error."""
    _templates().filters |= {name: value for name, value in values.items() if callable(value)}
    return _templates().get_template(template).render(values)


def script_data(value: Any) -> Markup:
    """Return a value as JSON that is safe inside a script element."""
    from markupsafe import Markup

    text = json.dumps(value, separators=(",", ":"), ensure_ascii=False, allow_nan=False)
    return Markup(text.replace("<", "\\u003c"))


def vendored(name: str) -> str:
    """Return a third-party script of templates/vendor as text for unpack.js."""
    return deflated((TEMPLATES / "vendor" / name).read_bytes())


def deflated(data: bytes) -> str:
    """Return bytes as base64 text of their zlib stream, which browsers inflate."""
    return base64.b64encode(zlib.compress(data, 9)).decode()


def data_url(name: str, data: bytes) -> str:
    """Return a picture's bytes as a data address."""
    suffix = name.rsplit(".", 1)[-1]
    media = {"webp": "image/webp", "svg": "image/svg+xml"}.get(suffix) or str(mimetypes.guess_type(name)[0])
    return f"data:{media};base64,{base64.b64encode(data).decode()}"


EMBEDDED_BYTES = 2_700_000  # keeps a page with shapes, diagrams, viewer and a dozen cases below 4 MB


class Embedder:
    """Embed pictures in the page up to a size budget, so that the page is complete as a single file."""

    def __init__(self, study: Path, budget: int | None = None) -> None:
        self.study, self.left = study, EMBEDDED_BYTES if budget is None else budget

    def show(self, folder: str, picture: style.StoredFigure) -> dict[str, Any] | None:
        """Return the picture of a folder (relative to the study) with its data and links; None if it does not fit."""
        source = data_url(picture.shown, (self.study / folder / picture.shown).read_bytes())
        if len(source) > self.left:
            return None
        self.left -= len(source)
        return vars(picture) | {"source": source, "svg": link(folder, picture.svg), "png": link(folder, picture.png)}

    def show_all(self, folder: str, pictures: list[style.StoredFigure]) -> list[dict[str, Any]]:
        """Return those pictures of a folder that fit."""
        return [embedded for picture in pictures if (embedded := self.show(folder, picture))]


def link(*parts: str) -> str:
    """Return a relative address whose folder names may contain = and commas."""
    return "/".join(quote(panel) for part in parts for panel in part.split("/"))


PAGE = "page.json"  # content of the page, for the pages of other studies
SCHEMA = 1
SCRIPT_PAGE_BYTES = 12_000_000


@dataclass(frozen=True)
class Table:
    """Rows of text or numbers under headings; `name` is its CSV file."""

    name: str
    headings: Sequence[str]
    rows: Sequence[Sequence[Any]]


@dataclass(frozen=True)
class Section:
    """Section: heading, paragraphs, tables and functions that draw pictures."""

    heading: str
    words: Sequence[str] = ()
    tables: Sequence[Table] = ()
    report_figures: Sequence[Callable[[], style.ReportFigure]] = ()


@dataclass(frozen=True)
class Page:
    """Conclusion of a scripted study."""

    sections: Sequence[Section] = field(default_factory=list)


def write_page(folder: Path, name: str, title: str, lead: str, page: Page) -> list[Path]:
    """Write CSV files, pictures, report.html, report.md and page.json; return the tables and the page."""
    written, embedded, kept = [], [], []
    embedder = Embedder(folder, SCRIPT_PAGE_BYTES)
    for section in page.sections:
        for table in section.tables:
            path = folder / f"{table.name}.csv"
            store.write_atomic(path, outputs.csv_bytes(table.headings, table.rows))
            written.append(path)
        with style.style():
            pictures = [style.save(draw(), folder / style.PICTURES) for draw in section.report_figures]
        embedded.append((section, embedder.show_all(style.PICTURES, pictures)))
        names = [table.name for table in section.tables]
        plain = {"heading": section.heading, "words": list(section.words), "tables": names}
        kept.append(plain | {"pictures": [asdict(picture) for picture in pictures]})
    html = folder / "report.html"
    page_text = render("scripted.html.j2", name=name, title=title, lead=lead, sections=embedded, text=text)
    store.write_atomic(html, page_text.encode())
    store.write_atomic(folder / "report.md", markdown(title, lead, page).encode())
    store.write_json(folder / PAGE, {"schema": SCHEMA, "name": name, "title": title, "lead": lead, "sections": kept})
    return [*written, html]


def markdown(title: str, lead: str, page: Page) -> str:
    """Return words and tables as Markdown, without pictures."""
    lines = [f"# {title}", "", lead, ""]
    for section in page.sections:
        lines += [f"## {section.heading}", ""]
        for words in section.words:
            lines += [words, ""]
        for table in section.tables:
            lines.append(outputs.markdown(table.headings, [[text(value) for value in row] for row in table.rows]))
    return "\n".join(lines)


def text(value: Any) -> str:
    """Format a cell: numbers to five digits, None as a dash."""
    if value is None or value == "":
        return "–"
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, float):
        return f"{value:.2e}" if value != 0.0 and not 1e-3 <= abs(value) < 1e7 else f"{value:.6g}"
    return str(value)
