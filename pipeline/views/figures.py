"""Figures of a result's document in matplotlib axes: axes in, axes out."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace
from typing import Any, TypeVar

from geometry.files import written_whole
from pipeline.plots import response as of_response
from pipeline.plots import style
from pipeline.records.record import (
    Part,
    ResponseRecord,
    ToleranceRecord,
)

Document = dict[str, Any]
P = TypeVar("P", bound=Part)


def _read(kind: type[P], document: Document) -> P:
    """What a record would hold of a document."""
    return kind.of(SimpleNamespace(**document))


def draw(kind: str, document: Document, ax: Any = None) -> Any:
    """The figure of a document; ValueError for a kind that has none."""
    if kind not in FIGURES:
        raise ValueError(f"{kind}: has no figure")
    with style.style():
        ax = style.panels(3.6)[1] if ax is None else ax
        FIGURES[kind](ax, document)
        return ax


def write(kind: str, document: Document, place: Path) -> None:
    """The figure of a document as a file."""
    save(draw(kind, document).figure, place)


def save(figure: Any, place: Path) -> None:
    """A figure as a file, whole or not at all, in the format of its ending (png, pdf or svg)."""
    with style.style(), written_whole(place) as temporary:
        figure.savefig(temporary, format=place.suffix.lstrip(".").lower() or "png", dpi=150, bbox_inches="tight")


def response(ax: Any, document: Document) -> None:
    """Rms of zone and passive face per volt over frequency, the peaks marked."""
    of_response.draw_amplitudes(ax, _read(ResponseRecord, document))


def tolerance(ax: Any, document: Document) -> None:
    """Peaks of the samples against their driven confinement."""
    of_response.draw_peaks(ax, _read(ToleranceRecord, document))


def differences(ax: Any, rows: list[Document]) -> None:
    """Relative differences of two designs as bars, the largest last and so on top."""
    known = sorted((row for row in rows if row["difference"]), key=lambda row: abs(row["difference"]))
    ax.figure.set_size_inches(style.WIDTH_IN, 1.2 + 0.28 * max(1, len(known)))
    ax.barh([row["quantity"] for row in known], [100.0 * row["difference"] for row in known], color=style.BLUE)
    ax.axvline(0.0, color=style.GREY, lw=0.8)
    ax.set(xlabel="B over A, %")


FIGURES: dict[str, Callable[[Any, Document], None]] = {
    each.__name__: each
    for each in (
        response,
        tolerance,
    )
}
