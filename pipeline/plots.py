"""One style for every picture: saved as SVG and PNG with its alternative text, kept while what it shows is unchanged."""

from __future__ import annotations

import hashlib
import io
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import asdict, dataclass, field
from functools import partial
from importlib import metadata
from pathlib import Path
from typing import TYPE_CHECKING, Any

from pipeline import store
from pipeline.fingerprint import canonical_json, file_hash
from pipeline.records import StoredCase, StoredStudy

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

PICTURES = "pictures"
INDEX = "index.json"
WIDTH_IN = 7.6
DPI = 150
WEBP_QUALITY = 84
# Okabe and Ito's colours: told apart with any colour vision.
BLUE, VERMILION, GREEN, ORANGE, SKY, PURPLE, GREY = (
    *("#0072B2", "#D55E00", "#009E73", "#E69F00", "#56B4E9", "#CC79A7"),
    "#5A5A5A",
)
CYCLE = (BLUE, VERMILION, GREEN, ORANGE, PURPLE, SKY, GREY)
MARKERS = "osD^vP*"
SIGNED, QUALITY = "RdBu_r", "cividis"
STYLE = {
    "font.size": 9.0,
    "axes.titlesize": 9.5,
    "axes.titleweight": "bold",
    "axes.titlelocation": "left",
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
class Drawing:
    """A figure with its file name, its title and what it shows in words."""

    name: str
    title: str
    alt: str
    figure: Figure
    vector: bool = False  # mostly lines: a page shows the SVG, else a compressed image


@dataclass(frozen=True)
class Picture:
    """A stored picture: file names without folder, title, alternative text; `shown` is the file that a page embeds."""

    name: str
    title: str
    alt: str
    svg: str
    png: str
    shown: str


@dataclass(frozen=True)
class Drawn:
    """Pictures, and what could not be drawn and why."""

    pictures: list[Picture]
    troubles: list[str] = field(default_factory=list)


ORDER = (
    *("geometry", "touch_face", "side_view", "pillars_in_plane", "neighbours"),
    *("plate_meshes", "mode_on_both_meshes", "dispersion", "attenuation", "response"),
    *("measured", "tolerance", "board", "cell_meshes"),
)


@contextmanager
def style() -> Iterator[None]:
    """The common look."""
    import matplotlib as mpl

    with mpl.rc_context(STYLE):  # type: ignore[arg-type]
        yield


def new_figure(width: float, height: float) -> Figure:
    """An empty figure, inches; drawn off-screen whatever the machine offers."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(width, height), layout="constrained")
    FigureCanvasAgg(figure)
    return figure


def mm_axes(axes: Axes, x: str = "x", y: str = "y") -> None:
    """Equal scales and labels in mm."""
    axes.set_aspect("equal")
    axes.set_xlabel(f"{x} (mm)")
    axes.set_ylabel(f"{y} (mm)")


def save(drawing: Drawing, folder: Path) -> Picture:
    """Write folder/NAME.svg and .png, each whole or not at all; the same figure gives the same bytes."""
    folder.mkdir(parents=True, exist_ok=True)
    words = {"Title": drawing.title, "Description": drawing.alt}
    files: dict[str, str] = {}
    with style():
        if engine := drawing.figure.get_layout_engine():  # once for both files
            engine.execute(drawing.figure)
        drawing.figure.set_layout_engine("none")
    for kind, notes in (("svg", {**words, "Date": None}), ("png", {**words, "Software": None})):
        buffer = io.BytesIO()
        with style():
            drawing.figure.savefig(buffer, format=kind, dpi=DPI, metadata=notes)
        files[kind] = f"{drawing.name}.{kind}"
        store.write_atomic(folder / files[kind], buffer.getvalue())
    shown = files["svg"] if drawing.vector else _compressed(folder, files["png"])
    return Picture(drawing.name, drawing.title, drawing.alt, files["svg"], files["png"], shown)


def _compressed(folder: Path, png: str) -> str:
    """A WebP beside the PNG, several times smaller; the PNG itself where this Pillow cannot write WebP."""
    from PIL import Image, features

    if not features.check("webp"):
        return png
    buffer = io.BytesIO()
    with Image.open(folder / png) as image:
        image.convert("RGB").save(buffer, "WEBP", quality=WEBP_QUALITY, method=4)
    name = f"{png[:-4]}.webp"
    store.write_atomic(folder / name, buffer.getvalue())
    return name


def draw_case(case: StoredCase) -> Drawn:
    """Draw every picture that a case's records allow, or take the stored ones when nothing they show has changed."""
    from pipeline import (
        plots_attenuation,
        plots_bands,
        plots_board,
        plots_both,
        plots_fields,
        plots_measured,
        plots_mesh,
        plots_response,
        plots_tolerance,
    )

    if case.status not in {"OK", "ALARM"}:
        return Drawn([])
    if (kept := kept_pictures(case)) is not None:
        return Drawn(kept)
    draws: tuple[Callable[..., Drawing | list[Drawing] | None], ...] = (
        plots_mesh.drawings,
        plots_fields.touch_face,
        plots_fields.side_view,
        plots_fields.pillars_in_plane,
        plots_fields.neighbours,
        plots_both.mode_on_both_meshes,
        plots_bands.dispersion,
        plots_attenuation.attenuation,
        plots_response.response,
        plots_measured.measured,
        plots_tolerance.tolerance,
        plots_board.board,
    )
    arrays, complaints = case.read_arrays()
    return _draw(case.folder / PICTURES, _case_key(case), [partial(draw, case, arrays) for draw in draws], complaints)


def kept_pictures(case: StoredCase) -> list[Picture] | None:
    """The stored pictures of a case, None when they have to be drawn again."""
    return _kept(case.folder / PICTURES, _case_key(case)) if case.status in {"OK", "ALARM"} else []


def _case_key(case: StoredCase) -> str:
    folders = (case.folder, *case.kin)
    return _key(case.record, [folder / name for folder in folders for name in (store.ARRAYS, store.INPUT)])


def draw_study(study: StoredStudy) -> Drawn:
    """Draw the pictures that compare a study's cases, or take the stored ones."""
    from pipeline import plots_study

    key = _key([study.about, *([case.sweep, case.record] for case in study.cases)], [])
    if (kept := _kept(study.folder / PICTURES, key)) is not None:
        return Drawn(kept)
    return _draw(
        study.folder / PICTURES,
        key,
        [partial(plots_study.against_sweep, study), partial(plots_study.how_many_rows, study)],
    )


def _draw(
    folder: Path,
    key: str,
    draws: Sequence[Callable[[], Drawing | list[Drawing] | None]],
    complaints: Sequence[str] = (),
) -> Drawn:
    """Draw and save; one that cannot be drawn is told beside the complaints about its data and spoils no other."""
    pictures: list[Picture] = []
    troubles = list(complaints)
    for draw in draws:
        try:
            with style():
                made = draw() or []
            pictures += [save(drawing, folder) for drawing in (made if isinstance(made, list) else [made])]
        except (store.StoreError, MemoryError):
            raise
        except Exception as error:
            name = getattr(draw, "func", draw).__name__
            troubles.append(f"{name}: {type(error).__name__}: {error}")
    pictures.sort(key=lambda picture: ORDER.index(picture.name) if picture.name in ORDER else -1)
    if not troubles and (pictures or folder.exists()):
        folder.mkdir(parents=True, exist_ok=True)
        store.write_json(folder / INDEX, {"key": key, "pictures": [asdict(picture) for picture in pictures]})
    return Drawn(pictures, troubles)


def _kept(folder: Path, key: str) -> list[Picture] | None:
    with suppress(store.BadRecord, TypeError, KeyError):
        index = store.read_json(folder / INDEX)
        pictures = [Picture(**entry) for entry in index["pictures"]]
        files = [folder / name for picture in pictures for name in (picture.svg, picture.png, picture.shown)]
        if index["key"] == key and all(path.is_file() for path in files):
            return pictures
    return None


def _key(shown: Any, files: list[Path]) -> str:
    """Hash of what pictures show and of what draws them."""
    sources = [*sorted(Path(__file__).parent.glob("plots*.py")), Path(__file__).with_name("renders.py")]
    parts = [canonical_json(shown), metadata.version("matplotlib")]
    parts += [file_hash(path) for path in [*files, *sources] if path.exists()]
    return hashlib.sha256("\n".join(parts).encode()).hexdigest()
