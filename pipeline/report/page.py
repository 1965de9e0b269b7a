"""report.html of a study: one file, rebuilt from stored records and pictures alone."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any

from pipeline.measures import registry
from pipeline.plots import style
from pipeline.records import store
from pipeline.records.study import StoredCase, StoredStudy, read_study
from pipeline.report import dispersion, explorer, gallery, mode_shapes, text
from pipeline.report.html import render, script_data, vendored
from pipeline.report.other_studies import beside
from pipeline.report.pictures import EmbeddedFigure, Embedder, link
from pipeline.units import GRAM, MM, UM

REPORT = "report.html"
MAX_FIGURES = 12
FILES = ("run.mess", "input.json", "record.json", "timing.json", "arrays.npz")
STILLS = ("side_view", "touch_face", "geometry")  # what stands for a moving shape, the first that is drawn
UNFIT = (KeyError, TypeError, ValueError, IndexError)  # arrays of another shape than the page draws
OF_BEST = {"attenuation": "Attenuation", "response": "Response"}
# What the template of a case's results writes them with.
SHOWN = {name: getattr(text, name) for name in ("si", "khz", "verdict", "band_difference", "CONFINED_DB")}
SHOWN |= {"f": format, "GRAM": GRAM, "MM": MM, "UM": UM}


@dataclass(frozen=True)
class CasePage:
    """What the page shows of one case."""

    case: StoredCase
    anchor: str
    pictures: list[EmbeddedFigure]
    files: list[tuple[str, str]]
    seconds: dict[str, float]
    troubles: list[str] = field(default_factory=list)
    modes: list[dict[str, Any]] = field(default_factory=list)
    overrides: list[str] = field(default_factory=list)
    drawn: bool = True


@dataclass(frozen=True)
class Moving:
    """Interactive parts of a page as JSON text ('' for none), the cells' names, and what could not be made of records.

    `moves` tells whether any shape is there, so that the page needs its viewer.
    """

    shapes: Any
    bands: Any
    cells: list[str]
    moves: bool
    troubles: list[str]


def build(folder: Path, max_figures: int = MAX_FIGURES) -> Path:
    """Write report.html of a study, pictures of at most `max_figures` cases drawn anew or kept; returns its path.

    Solves nothing. Raises store.BadRecord when the folder holds no study.
    """
    study = read_study(folder)
    visible = StoredStudy(folder, study.about, tuple(study.with_cross_checks(case) for case in study.cases))
    figure_sets = draw_cases(chosen(visible, max_figures))
    embedder = Embedder(folder)
    compared = _without_failing(partial(gallery.draw_study, study))
    pictures = [embedder.show(style.PICTURES, picture) for picture in compared.pictures]
    pages = _case_pages(visible, figure_sets, embedder)
    moving = _moving(visible, [page for page in pages if page.drawn])
    path = folder / REPORT
    store.write_atomic(path, _page(study, pages, embedder, moving, (pictures, compared.troubles)).encode())
    return path


def _page(
    study: StoredStudy,
    pages: list[CasePage],
    embedder: Embedder,
    moving: Moving,
    compared: tuple[list[EmbeddedFigure], list[str]],
) -> str:
    """The page's HTML; `compared` holds the pictures over the study and what could not be drawn."""
    columns = registry.columns_of(study)
    return render(
        "study.html.j2",
        **SHOWN,
        study=study,
        cards=text.cards(study),
        sentences=text.sentences(study),
        comparison=text.comparison(study),
        columns=columns,
        example="confinement>10" if any(column.name == "confinement_db" for column in columns) else columns[1].heading,
        pages=pages,
        pictures=compared[0],
        troubles=[*compared[1], *moving.troubles],
        best=text.best_case(study),
        of_best=_of_best(study, pages),
        beside=beside(study.folder, embedder),
        explorer=explorer.link(study.folder),
        undrawn=sum(page.case.record.answered and not page.drawn for page in pages),
        linked=embedder.linked,
        versions=next((case.record.versions for case in study.cases if case.record.versions), {}),
        left_out=text.left_out(study),
        plans=text.plans(study),
        repeat=f"antinode run {study.about['name']}" if study.about.get("name") else "",
        with_defaults=_with_defaults(study),
        shapes=moving.shapes,
        bands=moving.cells,
        bands_data=moving.bands,
        three=vendored("three.min.js") if moving.moves else "",
    )


def _moving(study: StoredStudy, pages: list[CasePage]) -> Moving:
    """Mode shapes of the drawn cases and the dispersion diagrams; arrays that do not fit are told, not raised."""
    best = text.best_case(study)
    stills = {page.case.case_id: f"{page.anchor}-{still}" for page in pages if (still := _still(page))}
    troubles: list[str] = []
    gallery = mode_shapes.Gallery()
    diagrams: dict[str, Any] = {"cells": [], "shapes": []}
    try:
        gallery = mode_shapes.plates([page.case for page in pages], best, stills)
    except UNFIT as error:
        troubles.append(f"moving mode shapes: {type(error).__name__}: {error}")
    try:
        diagrams = dispersion.diagrams(study, best)
    except UNFIT as error:
        troubles.append(f"interactive dispersion diagram: {type(error).__name__}: {error}")
    cells = [cell["name"] for cell in diagrams["cells"]]
    shapes = script_data(vars(gallery)) if gallery.shapes else ""
    return Moving(shapes, script_data(diagrams), cells, bool(gallery.shapes or diagrams["shapes"]), troubles)


def _still(page: CasePage) -> str:
    names = {picture.name for picture in page.pictures}
    return next((name for name in STILLS if name in names), "")


def _of_best(study: StoredStudy, pages: list[CasePage]) -> list[tuple[str, str]]:
    """Titles and anchors of the best case's attenuation and response, or of the first case that has them."""
    best = text.best_case(study)
    ordered = sorted(pages, key=lambda page: best is None or page.case.case_id != best.case_id)
    figures = []
    for name, title in OF_BEST.items():
        page = next((page for page in ordered if any(picture.name == name for picture in page.pictures)), None)
        if page:
            figures.append((title, f"{page.anchor}-{name}"))
    return figures


def _with_defaults(study: StoredStudy) -> str:
    """The first stored input as readable text."""
    for case in study.cases:
        stored = case.read(store.INPUT)
        if isinstance(stored, dict) and stored:
            return json.dumps(stored.get("case", stored), indent=1, ensure_ascii=False)
    return ""


def chosen(study: StoredStudy, most: int) -> list[StoredCase]:
    """Which cases get pictures: all of a short study; of a long one the best and the worst confined, the rest evenly spread."""
    drawable = [case for case in study.cases if case.record.answered]
    if len(drawable) <= most or most < 2:
        return drawable[:most]
    ranked = sorted((level, case.case_id) for case in drawable if (level := case.record.confinement_db) is not None)
    picked = {name for _, name in (ranked[:1] + ranked[-1:])}
    spread = (drawable[round(i * (len(drawable) - 1) / max(1, most - 1))] for i in range(most))
    for case in spread:
        if len(picked) < most:
            picked.add(case.case_id)
    return [case for case in drawable if case.case_id in picked]


def draw_cases(cases: list[StoredCase]) -> dict[str, gallery.FigureSet]:
    """Pictures of each case by its id, drawn in parallel."""
    from pipeline.workers import LocalWorkers, default_jobs

    stale = [case for case in cases if gallery.kept_pictures(case) is None]
    if len(stale) < 2:
        return {case.case_id: _without_failing(partial(gallery.draw_case, case)) for case in cases}
    with LocalWorkers(default_jobs(len(stale)), 1) as workers:
        futures = {case.case_id: workers.submit(gallery.draw_case, case) for case in stale}
        jobs = {case.case_id: partial(gallery.draw_case, case) for case in cases if case.case_id not in futures}
        return {
            case.case_id: _without_failing(jobs.get(case.case_id) or futures[case.case_id].result) for case in cases
        }


def _without_failing(draw: Callable[[], gallery.FigureSet]) -> gallery.FigureSet:
    """Pictures, or why there are none: a page without pictures is better than no page."""
    try:
        return draw()
    except Exception as error:
        return gallery.FigureSet([], [f"{type(error).__name__}: {error}"])


def _case_pages(study: StoredStudy, figure_sets: dict[str, gallery.FigureSet], embedder: Embedder) -> list[CasePage]:
    """Every case's part of the page in the study's order; the best case's pictures are embedded first."""
    best = text.best_case(study)
    order = sorted(range(len(study.cases)), key=lambda i: best is None or study.cases[i].case_id != best.case_id)
    made = {i: _case_page(study.cases[i], i, figure_sets.get(study.cases[i].case_id), embedder) for i in order}
    return [made[i] for i in range(len(study.cases))]


def _case_page(case: StoredCase, index: int, figure_sets: gallery.FigureSet | None, embedder: Embedder) -> CasePage:
    timing, stored = case.read(store.TIMING) or {}, case.read(store.INPUT)
    folder = f"{case.case_id}/{style.PICTURES}"
    return CasePage(
        case=case,
        anchor=f"case-{index + 1}",
        pictures=[embedder.show(folder, picture) for picture in (figure_sets.pictures if figure_sets else [])],
        files=list(_files(case)),
        seconds=_seconds(timing.get("seconds")),
        troubles=figure_sets.troubles if figure_sets else [],
        modes=text.modes(case.record) if figure_sets is not None else [],
        overrides=[str(text) for text in (stored.get("overrides") or [])] if isinstance(stored, dict) else [],
        drawn=figure_sets is not None,
    )


def _seconds(part: Any) -> dict[str, float]:
    """Times by step; they stand outside of the record's proof, so what is no time is left out."""
    if not isinstance(part, dict):
        return {}
    return {name: value for name, value in part.items() if isinstance(value, int | float)}


def _files(case: StoredCase) -> Iterator[tuple[str, str]]:
    """Names and addresses of a case's files, those for others first."""
    exported = case.record.geometry.files if case.record.geometry else []
    listed = sorted(case.read(store.MANIFEST) or {})
    for name in dict.fromkeys([*exported, *FILES, *listed]):
        if (case.folder / name).is_file():
            yield name, link(case.case_id, name)
