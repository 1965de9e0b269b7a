"""The pictures of a case and of a study, drawn from records and kept while what they show is unchanged; a plate's sketch."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import asdict, dataclass, field, replace
from functools import partial
from importlib import metadata
from pathlib import Path
from typing import TYPE_CHECKING, Any

from pipeline.plots import style as style_module
from pipeline.plots.style import PICTURES, ReportFigure, StoredFigure, save, style
from pipeline.questions.study import draws
from pipeline.records import store
from pipeline.records.fingerprint import canonical_json, file_hash
from pipeline.records.record import DesignRecord
from pipeline.records.study import StoredCase, StoredStudy
from pipeline.units import MM

INDEX = "index.json"
OF_THE_BEST = ("report_figures",)  # drawn of a sweep's best case, unless those of all are asked for
OF_A_CELL = ("dispersion",)  # the same for all cases of one cell


@dataclass(frozen=True)
class FigureSet:
    """Pictures, what could not be drawn and why, and whether some were left out."""

    pictures: list[StoredFigure]
    troubles: list[str] = field(default_factory=list)
    is_brief: bool = False


def draw_case(case: StoredCase, without: tuple[str, ...] = ()) -> FigureSet:
    """Draw every picture that a case's records allow, or take the stored ones when nothing they show has changed.

    without: names of the functions whose pictures are left out.
    """
    if (kept := kept_pictures(case, without)) is not None:
        return kept
    arrays, errors = case.read_arrays()
    chosen = [partial(draw, case, arrays) for draw in draws() if draw.__name__ not in without]
    key = _without(_case_key(case), without)
    return replace(_draw(case.folder / PICTURES, key, chosen, errors), is_brief=bool(without))


def kept_pictures(case: StoredCase, without: tuple[str, ...] = ()) -> FigureSet | None:
    """The stored pictures of a case, all or all but some of them, None when they have to be drawn again."""
    if not case.record.answered:
        return FigureSet([])
    key = _case_key(case)
    for left_out in dict.fromkeys(((), without)):
        if (pictures := _kept(case.folder / PICTURES, _without(key, left_out))) is not None:
            return FigureSet(pictures, is_brief=bool(left_out))
    return None


def _without(key: str, names: tuple[str, ...]) -> str:
    """The key of a case's pictures but for those of some functions."""
    return "-".join((key, *names))


def _case_key(case: StoredCase) -> str:
    folders = (case.folder, *case.siblings)
    return _key(case.record.to_dict(), [folder / name for folder in folders for name in (store.ARRAYS, store.INPUT)])


def draw_study(study: StoredStudy) -> FigureSet:
    """Draw the pictures that compare a study's cases, or take the stored ones."""
    from pipeline.plots import sweep

    key = _key([study.about, *(case.record.to_dict() for case in study.cases)], [])
    if (kept := _kept(study.folder / PICTURES, key)) is not None:
        return FigureSet(kept)
    return _draw(
        study.folder / PICTURES,
        key,
        [partial(sweep.against_sweep, study), partial(sweep.how_many_rows, study)],
    )


def _draw(
    folder: Path,
    key: str,
    draws: Sequence[Callable[[], ReportFigure | list[ReportFigure] | None]],
    errors: Sequence[str] = (),
) -> FigureSet:
    """Draw and save; one that cannot be drawn is told beside what is wrong with its data and spoils no other."""
    pictures: list[StoredFigure] = []
    troubles = list(errors)
    for draw in draws:
        try:
            with style():
                made = draw() or []
            pictures += [save(report_figure, folder) for report_figure in (made if isinstance(made, list) else [made])]
        except (store.StoreError, MemoryError):
            raise
        except Exception as error:
            name = getattr(draw, "func", draw).__name__
            troubles.append(f"{name}: {type(error).__name__}: {error}")
    pictures.sort(key=lambda picture: picture.name.endswith("meshes"))  # the shapes first
    if not troubles and (pictures or folder.exists()):
        folder.mkdir(parents=True, exist_ok=True)
        _remove_others(folder, pictures)
        store.write_json(folder / INDEX, {"key": key, "pictures": [asdict(picture) for picture in pictures]})
    return FigureSet(pictures, troubles)


def _remove_others(folder: Path, pictures: Sequence[StoredFigure]) -> None:
    """Remove what an earlier drawing left: it shows another record."""
    own = {name for picture in pictures for name in (picture.svg, picture.png, picture.shown)}
    for path in folder.iterdir():
        if path.is_file() and path.name not in own and path.suffix in {".svg", ".png", ".webp"}:
            path.unlink(missing_ok=True)


def _kept(folder: Path, key: str) -> list[StoredFigure] | None:
    with suppress(store.BadRecord, TypeError, KeyError):
        index = store.read_json(folder / INDEX)
        pictures = [StoredFigure(**entry) for entry in index["pictures"]]
        files = [folder / name for picture in pictures for name in (picture.svg, picture.png, picture.shown)]
        if index["key"] == key and all(path.is_file() for path in files):
            return pictures
    return None


def _key(visible: Any, files: list[Path]) -> str:
    """Hash of what pictures show and of what draws them."""
    sources = sorted(Path(style_module.__file__).parent.glob("*.py"))
    parts = [canonical_json(visible), metadata.version("matplotlib")]
    parts += [file_hash(path) for path in [*files, *sources] if path.exists()]
    return hashlib.sha256("\n".join(parts).encode()).hexdigest()


if TYPE_CHECKING:
    from markupsafe import Markup

MARGIN = 14.0  # mm of paper on each side, for dimensions
WIDE = 150.0  # mm of plate that are drawn 1:1; others are scaled, so that letters stay readable

PLATE = 'fill="#f3f6f8" stroke="#55606b" stroke-width=".4"'  # where no style sheet says otherwise
ZONE, PILLARS = 'fill="#009e73" fill-opacity=".22"', 'fill="#0072b2"'


def sketch(design: DesignRecord) -> Markup:
    """Plate, zone and pillars with their dimensions in mm."""
    from markupsafe import Markup

    length, breadth = design.length_m / MM, 2.0 * design.half_span_m / MM
    scale = min(1.0, WIDE / length)
    x0, y0, zone = -length / 2.0, -breadth / 2.0, design.width_m / MM
    letters = 3.6 / scale
    pillars = " ".join(
        f"M{x / MM - half:.2f} {-y / MM - half:.2f}h{2 * half:.2f}v{2 * half:.2f}h{-2 * half:.2f}z"
        for (x, y), pillar in zip(design.pillar_centres_m, design.standing, strict=True)
        for half in [pillar.base_m / MM / 2.0]
    )
    side = MARGIN / scale
    box = f"{x0 - side:.2f} {y0 - 0.4 * side:.2f} {length + 2 * side:.2f} {breadth + 1.2 * side:.2f}"
    words = f"{length:g} × {breadth:g} × {design.thickness_m / MM:g} mm"
    return Markup(
        f'<svg class="sketch" viewBox="{box}" role="img" aria-label="Sketch of the plate: {words}">'
        f'<rect class="plate" {PLATE} x="{x0:.2f}" y="{y0:.2f}" width="{length:.2f}" height="{breadth:.2f}"/>'
        f'<rect class="zone" {ZONE} x="{x0:.2f}" y="{-zone / 2:.2f}" width="{length:.2f}" height="{zone:.2f}"/>'
        f'<path class="pillars" {PILLARS} d="{pillars}"/>'
        f'<g font-size="{letters:.2f}" text-anchor="middle"><text y="{letters / 3:.2f}">active zone, {zone:g} mm wide</text>'
        f'<text y="{breadth / 2 + 1.6 * letters:.2f}">{words}</text></g></svg>'
    )
