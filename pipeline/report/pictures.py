"""Pictures of a page: in the file itself while there is room; each with its size, so that nothing jumps as they load."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from urllib.parse import quote

from pipeline.plots import style
from pipeline.report.html import data_url

EMBEDDED_BYTES = 2_700_000  # with shapes, diagrams, viewer and a dozen cases a page stays below 4 MB


@dataclass(frozen=True)
class EmbeddedFigure:
    """A picture in the page: its pixels as data, its size, links and words."""

    name: str
    source: str
    width: int
    height: int
    svg: str
    png: str
    title: str
    alt: str
    lines: bool


class Embedder:
    """Puts pictures into the page until its budget is spent; a page sent alone misses nothing that it shows."""

    def __init__(self, study: Path, budget: int | None = None) -> None:
        self.study, self.left = study, EMBEDDED_BYTES if budget is None else budget

    def show(self, folder: str, picture: style.StoredFigure) -> EmbeddedFigure | None:
        """The picture of a folder (relative to the study), None where it does not fit any more."""
        source = data_url(picture.shown, (self.study / folder / picture.shown).read_bytes())
        if len(source) > self.left:
            return None
        self.left -= len(source)
        links = (link(folder, picture.svg), link(folder, picture.png))
        about = {"title": picture.title, "alt": picture.alt}
        return EmbeddedFigure(picture.name, source, picture.width, picture.height, *links, **about, lines=picture.lines)

    def show_all(self, folder: str, pictures: list[style.StoredFigure]) -> list[EmbeddedFigure]:
        """Those of a folder's pictures that fit."""
        return [embedded for picture in pictures if (embedded := self.show(folder, picture))]


def link(*parts: str) -> str:
    """A relative address whose folder names may hold = and commas."""
    return "/".join(quote(panel) for part in parts for panel in part.split("/"))
