"""Pictures of a page: embedded while there is room, else linked; each with its size, so that nothing jumps as they load."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from urllib.parse import quote

from pipeline.plots import style
from pipeline.report.html import data_url

EMBEDDED_BYTES = 6_500_000  # the rest is linked: with shapes and a thousand cases a page stays below 15 MB


@dataclass(frozen=True)
class EmbeddedFigure:
    """A picture in the page: where its pixels come from (data or file), its size, links and words."""

    name: str
    source: str
    width: int
    height: int
    svg: str
    png: str
    title: str
    alt: str


class Embedder:
    """Puts pictures into the page until its budget is spent; links the rest."""

    def __init__(self, study: Path, budget: int | None = None) -> None:
        self.study, self.left, self.linked = study, EMBEDDED_BYTES if budget is None else budget, 0

    def show(self, folder: str, picture: style.StoredFigure) -> EmbeddedFigure:
        """The picture of a folder (relative to the study), embedded or linked."""
        data = (self.study / folder / picture.shown).read_bytes()
        source = link(folder, picture.shown)
        if len(data) * 4 / 3 <= self.left:
            source = data_url(picture.shown, data)
            self.left -= len(source)
        else:
            self.linked += 1
        links = (link(folder, picture.svg), link(folder, picture.png))
        size = (picture.width, picture.height)
        return EmbeddedFigure(picture.name, source, *size, *links, picture.title, picture.alt)


def link(*parts: str) -> str:
    """A relative address whose folder names may hold = and commas."""
    return "/".join(quote(panel) for part in parts for panel in part.split("/"))
