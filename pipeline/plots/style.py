"""Common style of all pictures, saved as SVG and PNG with alternative text."""

from __future__ import annotations

import io
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from pipeline.records import store

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

PICTURES = "pictures"
WIDTH_IN = 7.6
POINTS_IN, LETTER_EM = 72.0, 0.56  # points of an inch; mean width of a letter of a legend
DPI = 150
POINTS_PER_IN = 72  # length unit of an SVG
PNG_LEVEL = 4  # of 9: half the time of the default 6 for files 5 % larger
WEBP_QUALITY = 75
SHOWN_PX = 960  # width in a page: twice that of one of two columns on a screen
SVG_BYTES = 40_000  # limit for line drawings; larger ones are smaller as pixels
# Okabe and Ito's colours, distinguishable with any colour vision.
BLUE, VERMILION, GREEN, ORANGE, SKY, PURPLE, GREY = (
    *("#0072B2", "#D55E00", "#009E73", "#E69F00", "#56B4E9", "#CC79A7"),
    "#5A5A5A",
)
CYCLE = (BLUE, VERMILION, GREEN, ORANGE, PURPLE, SKY, GREY)
DASHES = ("-", "--", "-.", ":")
MARKERS = "osD^vP*X<"
LOOKS = [{"color": colour, "ls": dashes} for colour, dashes in zip(CYCLE, DASHES, strict=False)]
SIGNED, QUALITY = "RdBu_r", "cividis"
STYLE = {
    "font.size": 9.0,
    "axes.titlesize": 9.5,
    "axes.titleweight": "bold",
    "axes.titlelocation": "left",
    "axes.titley": 1.0,  # no axis has ticks on top, so titles need no search for a position
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.linewidth": 0.7,
    "axes.edgecolor": "#333333",
    "axes.grid": False,
    "grid.color": "#D8D8D8",
    "grid.linewidth": 0.5,
    "legend.frameon": False,
    "lines.linewidth": 1.2,
    "savefig.facecolor": "white",
    "svg.fonttype": "path",
    "svg.hashsalt": "antinode",
    "image.composite_image": True,
}


@dataclass(frozen=True)
class ReportFigure:
    """A figure with its file name, title and description."""

    name: str
    title: str
    alt: str
    figure: Figure
    vector: bool = False  # mostly lines: a page shows the SVG if small, else a compressed image


@dataclass(frozen=True)
class StoredFigure:
    """A stored picture: file names without folder, title, alternative text; a page embeds `shown`, with its size."""

    name: str
    title: str
    alt: str
    svg: str
    png: str
    shown: str
    width: int
    height: int
    lines: bool = False  # on white: a dark page inverts it


@contextmanager
def style() -> Iterator[None]:
    """Context with the common style."""
    import matplotlib as mpl

    with mpl.rc_context(STYLE):  # type: ignore[arg-type]
        yield


def new_figure(width: float, height: float) -> Figure:
    """Return an empty figure, size in inches, drawn off-screen on any machine."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(width, height), layout="constrained")
    FigureCanvasAgg(figure)
    return figure


def panels(height: float, *grid: int, **look: Any) -> tuple[Figure, Any]:
    """Return an empty figure of page width, and its axes: one, or an array of rows and columns."""
    figure = new_figure(WIDTH_IN, height)
    return figure, figure.subplots(*grid, **look)


def draw_lines(draw: Callable[..., Any], x: Any, curves: Mapping[str, Any], **look: Any) -> None:
    """Draw named curves over x with a method of axes such as semilogy, each with its own colour and dashes."""
    for (name, y), own in zip(curves.items(), LOOKS, strict=False):
        draw(x, y, label=name, **own, **look)


def mark(axes: Axes, *places: float) -> None:
    """Draw dotted vertical lines."""
    for x in places:
        axes.axvline(x, color=GREY, lw=0.8, ls=":")


def mm_axes(axes: Axes, x: str = "x", y: str = "y") -> None:
    """Set equal scales and labels in mm."""
    axes.set(aspect="equal", xlabel=f"{x} (mm)", ylabel=f"{y} (mm)")


def legend_below(figure: Figure, handles: Any, labels: Any, columns: int = 3, size: float = 9.0) -> None:
    """Draw one legend for all panels, below them, in as many columns as the figure is wide."""
    widest = size * (LETTER_EM * max(map(len, labels), default=0) + 4.0) / POINTS_IN
    fitting = max(1, int(figure.get_figwidth() / widest))
    figure.legend(handles, labels, loc="outside lower center", ncols=min(columns, len(labels), fitting), fontsize=size)


def save(report_figure: ReportFigure, folder: Path) -> StoredFigure:
    """Write folder/NAME.svg and .png atomically; the same figure gives the same bytes."""
    folder.mkdir(parents=True, exist_ok=True)
    words = {"Title": report_figure.title, "Description": report_figure.alt}
    files: dict[str, str] = {}
    with style():
        if engine := report_figure.figure.get_layout_engine():  # once for both files
            engine.execute(report_figure.figure)
            if any(axes.get_aspect() != "auto" for axes in report_figure.figure.axes):
                engine.execute(report_figure.figure)  # whose positions and labels are only known now
        report_figure.figure.set_layout_engine("none")
        # the last bits of the layout depend on memory addresses, and name clip paths
        for axes in report_figure.figure.axes:
            left, low, width, height = (round(edge, 9) for edge in axes.get_position(original=True).bounds)
            axes.set_position((left, low, width, height))
    for kind, notes in (("svg", {**words, "Date": None}), ("png", {**words, "Software": None})):
        files[kind] = f"{report_figure.name}.{kind}"
        store.write_atomic(folder / files[kind], _drawn(report_figure.figure, kind, notes))
    small = report_figure.vector and (folder / files["svg"]).stat().st_size <= SVG_BYTES
    file = files["svg"] if small else _compressed(folder, files["png"], report_figure.vector)
    scale = POINTS_PER_IN if small else DPI
    width, height = (round(scale * edge) for edge in report_figure.figure.get_size_inches())
    about = (report_figure.name, report_figure.title, report_figure.alt)
    return StoredFigure(*about, files["svg"], files["png"], file, width, height, report_figure.vector)


def _drawn(figure: Figure, kind: str, notes: dict[str, str | None]) -> bytes:
    """Return the file's bytes, drawn once: `savefig` draws twice to repeat a finished layout."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.backends.backend_svg import FigureCanvasSVG

    buffer = io.BytesIO()
    figure.set_dpi(DPI)
    with style():
        if kind == "svg":
            FigureCanvasSVG(figure).print_svg(buffer, metadata=notes)
        else:
            FigureCanvasAgg(figure).print_png(buffer, metadata=notes, pil_kwargs={"compress_level": PNG_LEVEL})
    return buffer.getvalue()


def _compressed(folder: Path, png: str, lines: bool) -> str:
    """Write a WebP next to the PNG, of the width in a page, lossless for lines on white if smaller.

    The PNG itself is used if this Pillow cannot write WebP.
    """
    from PIL import Image, features

    if not features.check("webp"):
        return png
    looks: tuple[dict[str, Any], ...] = ({"quality": WEBP_QUALITY}, *([{"lossless": True}] if lines else []))
    with Image.open(folder / png) as image:
        height = round(image.height * SHOWN_PX / image.width)
        shown = image.convert("RGB").resize((SHOWN_PX, height), Image.Resampling.LANCZOS)
    written = []
    for look in looks:
        buffer = io.BytesIO()
        shown.save(buffer, "WEBP", method=4, **look)
        written.append(buffer.getvalue())
    name = f"{png[:-4]}.webp"
    store.write_atomic(folder / name, min(written, key=len))
    return name
