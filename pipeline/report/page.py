"""report.html of a study, rebuilt only from stored records and pictures, with its explorer and linked studies."""

from __future__ import annotations

import csv
import io
import json
import shlex
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from functools import partial
from importlib import metadata
from pathlib import Path
from typing import Any

from pipeline import quantity
from pipeline.case.model import case_from_dict
from pipeline.case.reading import read_toml
from pipeline.errors import InputError
from pipeline.logs import Log
from pipeline.plots import style
from pipeline.quantity import GRAM, MM
from pipeline.questions import study as asked
from pipeline.questions.bands import BandsResult
from pipeline.records import store
from pipeline.records.study import StoredCase, StoredStudy, read_study
from pipeline.report import gallery, text
from pipeline.report import shapes as moving_shapes
from pipeline.report.gallery import sketch
from pipeline.report.html import PAGE, SCHEMA, Embedder, link, render
from pipeline.report.text import TITLE
from solvers.errors import SolverError

NAME = "explorer.html"

STUDIES = {"accuracy": "Error against run time", "extremes": "Extreme scenes"}

REPORT = "report.html"
MAX_FIGURES = 12
FILES = ("run.mess", "input.json", "record.json", "timing.json", "arrays.npz")

# pictures of a case, most informative first, in addition to the animated shapes; the best case has all of them
FIGURE_ORDER = ("touch_face", "response", "dispersion", "attenuation", "neighbours")

STILL_FIGURES = (
    "moving_plate",
    "touch_face",
    "geometry",
)  # still pictures that replace an animated shape, in order of preference
MALFORMED_ARRAY_ERRORS = (KeyError, TypeError, ValueError, IndexError)  # raised for arrays of an unexpected shape
OF_BEST = {"attenuation": "Attenuation", "response": "Response"}

# Functions available to the template of a case's results.
SHOWN = {
    name: getattr(text, name)
    for name in (
        "si",
        "khz",
        "db",
        "bar",
        "mode_cells",
        "verdict",
        "band_difference",
        "share_of_zone",
        "CONFINED_DB",
    )
}

SHOWN |= {name: getattr(quantity, name) for name in ("figure", "percentage", "percent", "signed")}
SHOWN |= {"GRAM": GRAM, "MM": MM}


@dataclass(frozen=True)
class CasePage:
    """Content of the page for one case."""

    case: StoredCase
    anchor: str
    pictures: list[dict[str, Any]]
    elsewhere: list[str]
    files: list[tuple[str, str]]
    seconds: dict[str, float]
    troubles: list[str] = field(default_factory=list)
    modes: list[dict[str, Any]] = field(default_factory=list)
    overrides: list[str] = field(default_factory=list)
    drawn: bool = True
    twin: str = ""  # anchor of a case with the same plate, whose pictures it shares


def put_explorer(folder: Path, case_path: Path, log: Log | None = None) -> list[Path]:
    """Write the explorer of the study's case if its reduced bases are cached; with a log, compute them if necessary.

    Computing them takes longer than most studies. Nothing is written for an unsupported cell.
    """
    from pipeline.explore import offline
    from pipeline.explore.answer import Explorer, Scene
    from pipeline.models.parametric import cell_model, kept_model, laid_about

    try:
        raw = read_toml(case_path)
        case = case_from_dict(raw, case_path)
        case.require("pillar", "zone", command="explore")
        scene = Scene(case, raw, ())
        scene.check()
        about = laid_about(case)
        model = cell_model(case, log, about) if log else kept_model(case, about)
        if model is None:
            return []
        html = offline.page(Explorer(scene, model))
    except (InputError, SolverError) as fault:  # an unsupported cell: the study has no explorer
        if log:
            log.warning("NO_EXPLORER", f"the report has no explorer: {' '.join(str(fault).split())}")
        return []
    store.write_atomic(folder / NAME, html.encode())
    return [folder / NAME]


def explorer_link(folder: Path) -> str:
    """Return the address of the explorer next to a study's report, or ''."""
    return NAME if (folder / NAME).exists() else ""


def linked_studies(folder: Path, embedder: Embedder) -> list[dict[str, Any]]:
    """Return the scripted studies next to a study's folder: opening section, and every section with a picture."""
    return [
        {"name": name, "title": title, "missing": "", "sections": []} | _read(folder, name, embedder)
        for name, title in STUDIES.items()
        if folder.name != name and (folder.parent / name / PAGE).exists()
    ]


def build(folder: Path, max_figures: int = MAX_FIGURES, all_pictures: bool = False) -> Path:
    """Write report.html of a study, with pictures of at most `max_figures` cases, drawn or reused; return its path.

    Solves nothing. all_pictures: draw for every case the pictures that otherwise only the best one gets. Raises
    store.BadRecord if the folder has no study.
    """
    study = read_study(folder)
    visible = StoredStudy(folder, study.about, tuple(study.with_cross_checks(case) for case in study.cases))
    cases = chosen(visible, max_figures)
    figure_sets = draw_cases(cases, {} if all_pictures else _left_out(visible, cases))
    embedder = Embedder(folder)
    compared = _without_failing(partial(gallery.draw_study, study))
    pictures = embedder.show_all(style.PICTURES, compared.pictures)
    pages = _case_pages(visible, figure_sets, embedder)
    moving, troubles = _moving(visible, [page for page in pages if page.drawn])
    path = folder / REPORT
    is_brief = any(figures.is_brief for figures in figure_sets.values())
    more = {"pictures": pictures, "troubles": [*compared.troubles, *troubles], **moving}
    shown = _page(study, pages, embedder, more, is_brief)
    store.write_atomic(path, shown.encode())
    return path


def chosen(study: StoredStudy, most: int) -> list[StoredCase]:
    """Choose the cases with pictures: all of a short study; of a long one best, worst and an even selection.

    Cases that add computations to a plate of the sweep come in addition.
    """
    twins = [case for case in study.cases if case.record.answered and _twin(study, case)] if most else []
    drawable = [case for case in study.cases if case.record.answered and case not in twins]
    if len(drawable) <= most or most < 2:
        return [*twins, *drawable[:most]]
    ranked = sorted((level, case.case_id) for case in drawable if (level := case.record.ranked_db) is not None)
    best = text.best_case(study)
    picked = {name for _, name in ranked[:1]} | ({best.case_id} if best in drawable else set())
    spread = (drawable[round(i * (len(drawable) - 1) / max(1, most - 1))] for i in range(most))
    for case in spread:
        if len(picked) < most:
            picked.add(case.case_id)
    return [*twins, *(case for case in drawable if case.case_id in picked)]


def draw_cases(cases: list[StoredCase], brief: dict[str, tuple[str, ...]]) -> dict[str, gallery.FigureSet]:
    """Draw the pictures of each case in parallel, by case id; `brief` names those to leave out, by case id."""
    from pipeline.workers import LocalWorkers, default_jobs

    kept = {case.case_id: gallery.kept_pictures(case, brief.get(case.case_id, ())) for case in cases}
    stale = [case for case in cases if kept[case.case_id] is None]
    draws = {case.case_id: partial(gallery.draw_case, case, brief.get(case.case_id, ())) for case in stale}
    if len(draws) < 2:
        made = {name: _without_failing(draw) for name, draw in draws.items()}
    else:
        with LocalWorkers(default_jobs(len(draws)), 1) as workers:
            futures = {name: workers.submit(draw) for name, draw in draws.items()}
            made = {name: _without_failing(future.result) for name, future in futures.items()}
    return {name: figures or made[name] for name, figures in kept.items()}


def _read(folder: Path, name: str, embedder: Embedder) -> dict[str, Any]:
    """Return the content of another study, the address of its page, or the reason why there is nothing."""
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
    """Return a section; its tables only if no picture shows the same."""
    pictures = [style.StoredFigure(**entry) for entry in section["pictures"]]
    embedded = embedder.show_all(f"../{name}/{style.PICTURES}", pictures)
    tables = [] if embedded else [_table(folder.parent / name, table) for table in section["tables"]]
    return {"heading": section["heading"], "words": list(section["words"]), "tables": tables, "pictures": embedded}


def _table(other: Path, name: str) -> tuple[str, list[str], list[list[str]]]:
    heading, *rows = csv.reader(io.StringIO((other / f"{name}.csv").read_text(encoding="utf-8")))
    return f"../{other.name}/{name}.csv", heading, rows


def _page(study: StoredStudy, pages: list[CasePage], embedder: Embedder, more: dict[str, Any], is_brief: bool) -> str:
    """Render the page; `more` holds the pictures over the study, the animated parts, and what could not be drawn.

    is_brief: some pictures were drawn for the best case only.
    """
    columns = asked.columns_of(study)
    return render(
        "study.html.j2",
        **SHOWN,
        **_answer(study),
        **more,
        study=study,
        comparison=text.comparison(study),
        columns=columns,
        brief=any(not column.is_main for column in columns),
        example="confinement>10" if any(column.name == "confinement_db" for column in columns) else columns[1].heading,
        program=metadata.version("antinode"),
        thesis=TITLE,
        pages=pages,
        of_best=_of_best(study, pages),
        linked=linked_studies(study.folder, embedder),
        explorer=explorer_link(study.folder),
        case_file=text.case_file(study),
        brief_pictures=is_brief and f"antinode report {study.about.get('name', 'STUDY')} --all-pictures",
        undrawn=sum(page.case.record.answered and not page.drawn for page in pages),
        versions=next((case.record.versions for case in study.cases if case.record.versions), {}),
        left_out=text.left_out(study),
        plans=text.plans(study),
        repeat=shlex.join(["antinode", "run", str(study.about["name"])]) if study.about.get("name") else "",
        with_defaults=_with_defaults(study),
    )


def _answer(study: StoredStudy) -> dict[str, Any]:
    """Return the head of the page: the answer, the best plate, the cards."""
    best = text.best_case(study)
    return {
        "best": best,
        "headline": text.headline(study),
        "facts_of_study": text.facts_of(study),
        "sketch": sketch(best.record.design) if best and best.record.design else "",
        "command": text.command(study, best) if best else "",
        "cards": text.cards(study),
        "sentences": text.sentences(study),
    }


def _moving(study: StoredStudy, pages: list[CasePage]) -> tuple[dict[str, Any], list[str]]:
    """Return mode shapes and dispersion diagrams as JSON text, with the viewer; malformed arrays are reported."""
    best = text.best_case(study)
    stills = {page.case.case_id: f"{page.anchor}-{still}" for page in pages if (still := _still(page))}
    cases = [page.case for page in pages if not page.twin]
    troubles: list[str] = []
    plates = _fitting("animated mode shapes", partial(moving_shapes.plates, cases, best, stills), troubles)
    diagrams = _fitting("interactive dispersion diagram", partial(moving_shapes.diagrams, study, best), troubles)
    return moving_shapes.parts(plates, diagrams), troubles


def _fitting(name: str, make: Callable[[], dict[str, Any]], troubles: list[str]) -> dict[str, Any]:
    """Return data made of stored arrays; nothing, and one more trouble, for arrays of an unexpected shape."""
    try:
        return make()
    except MALFORMED_ARRAY_ERRORS as error:
        troubles.append(f"{name}: {type(error).__name__}: {error}")
        return {"cells": [], "shapes": []}


def _still(page: CasePage) -> str:
    names = {picture["name"] for picture in page.pictures}
    return next((name for name in STILL_FIGURES if name in names), "")


def _of_best(study: StoredStudy, pages: list[CasePage]) -> list[tuple[str, str]]:
    """Return titles and anchors of attenuation and response of the best case, or of the first case with them."""
    best = text.best_case(study)
    ordered = sorted(pages, key=lambda page: best is None or page.case.case_id != best.case_id)
    figures = []
    for name, title in OF_BEST.items():
        page = next((page for page in ordered if any(picture["name"] == name for picture in page.pictures)), None)
        if page:
            figures.append((title, f"{page.anchor}-{name}"))
    return figures


def _with_defaults(study: StoredStudy) -> str:
    """Return the first stored input as readable text."""
    for case in study.cases:
        stored = case.read(store.INPUT)
        if isinstance(stored, dict) and stored:
            return json.dumps(stored.get("case", stored), indent=1, ensure_ascii=False)
    return ""


def _left_out(study: StoredStudy, cases: list[StoredCase]) -> dict[str, tuple[str, ...]]:
    """Return the pictures not drawn for cases other than the best one, by case id.

    The page has no room for all of them, and shows those of a cell once.
    """
    best = text.best_case(study)
    if best not in cases:
        return {}
    left_out: dict[str, tuple[str, ...]] = {}
    drawn = _cells_of(best)
    for case in cases:
        if not case.sweep or case is best:
            continue
        own = _cells_of(case)
        left_out[case.case_id] = gallery.OF_THE_BEST + (gallery.OF_A_CELL if own & drawn else ())
        drawn |= own
    return left_out


def _cells_of(case: StoredCase) -> set[str]:
    """Return the unit cell of a case's bands, None without bands."""
    bands = case.record.of(BandsResult)
    return {moving_shapes.same_bands(bands)} if bands else set()


def _without_failing(draw: Callable[[], gallery.FigureSet]) -> gallery.FigureSet:
    """Return pictures, or the reason why there are none: a page without pictures is better than no page."""
    try:
        return draw()
    except Exception as error:
        return gallery.FigureSet([], [f"{type(error).__name__}: {error}"])


def _case_pages(study: StoredStudy, figure_sets: dict[str, gallery.FigureSet], embedder: Embedder) -> list[CasePage]:
    """Return the page content of every case in the order of the study."""
    shown = _shown(study, figure_sets, embedder)
    pages = []
    for index, case in enumerate(study.cases):
        figures = figure_sets.get(case.case_id)
        twin = next((i for i in range(len(study.cases)) if study.cases[i] is _twin(study, case)), None)
        pages.append(
            _case_page(case, index, figures, shown.get(case.case_id, []), "" if twin is None else f"case-{twin + 1}")
        )
    return pages


def _shown(
    study: StoredStudy, figure_sets: dict[str, gallery.FigureSet], embedder: Embedder
) -> dict[str, list[dict[str, Any]]]:
    """Return the embedded pictures by case: all of the best one, then the most informative of each while they fit."""
    best = text.best_case(study)
    ordered = sorted(study.cases, key=lambda case: best is None or case.case_id != best.case_id)
    drawn = {
        case.case_id: {p.name: p for p in figure_sets[case.case_id].pictures}
        for case in ordered
        if case.case_id in figure_sets
    }
    in_order = [(case, name) for name in FIGURE_ORDER for case in ordered[1:]]
    in_order = [(case, name) for case in ordered[:1] for name in drawn.get(case.case_id, {})] + in_order
    for case in ordered:
        if twin := _twin(study, case):  # only what the identical plate lacks
            own = [name for name in drawn.get(case.case_id, {}) if name not in drawn.get(twin.case_id, {})]
            in_order = [(case, name) for name in own] + [pair for pair in in_order if pair[0] is not case]
    by_case: dict[str, dict[str, dict[str, Any]]] = {}
    cells: set[tuple[str, str]] = set()
    for case, name in in_order:
        mark = (name, next(iter(_cells_of(case)), case.case_id))
        picture = drawn.get(case.case_id, {}).get(name)
        if picture is None or (name in gallery.OF_A_CELL and mark in cells):
            continue
        if embedded := embedder.show(f"{case.case_id}/{style.PICTURES}", picture):
            by_case.setdefault(case.case_id, {})[name] = embedded
            cells.add(mark)
    return {case: [by_case[case][name] for name in drawn[case] if name in by_case[case]] for case in by_case}


def _twin(study: StoredStudy, case: StoredCase) -> StoredCase | None:
    """Return the case of the sweep with the same plate as this one, which the study computes in addition."""
    if case.sweep or not (keys := case.record.keys):
        return None
    swept = (other for other in study.cases if other.sweep)
    return next((other for other in swept if other.record.keys and other.record.keys.plate == keys.plate), None)


def _case_page(
    case: StoredCase, index: int, figure_sets: gallery.FigureSet | None, shown: list[dict[str, Any]], twin: str
) -> CasePage:
    timing, stored = case.read(store.TIMING) or {}, case.read(store.INPUT)
    names = {picture["name"] for picture in shown}
    return CasePage(
        case=case,
        anchor=f"case-{index + 1}",
        pictures=shown,
        elsewhere=[p.title for p in figure_sets.pictures if p.name not in names] if figure_sets and not twin else [],
        files=list(_files(case)),
        seconds=_seconds(timing.get("seconds")),
        troubles=figure_sets.troubles if figure_sets else [],
        modes=text.modes(case.record) if figure_sets is not None and not twin else [],
        overrides=[str(text) for text in (stored.get("overrides") or [])] if isinstance(stored, dict) else [],
        drawn=figure_sets is not None,
        twin=twin,
    )


def _seconds(part: Any) -> dict[str, float]:
    """Return times by step; the record's checksum does not cover them, so anything other than a time is skipped."""
    if not isinstance(part, dict):
        return {}
    return {name: value for name, value in part.items() if isinstance(value, int | float)}


def _files(case: StoredCase) -> Iterator[tuple[str, str]]:
    """Return names and addresses of a case's files, exchange formats first."""
    exported = case.record.held("geometry").files if case.record.held("geometry") else []
    listed = sorted(case.read(store.MANIFEST) or {})
    for name in dict.fromkeys([*exported, *FILES, *listed]):
        if (case.folder / name).is_file():
            yield name, link(case.case_id, name)
