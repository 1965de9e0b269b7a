"""report.html of a study: one file, rebuilt from stored records and pictures alone."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any
from urllib.parse import quote

from pipeline import plots, report_words, store, tables
from pipeline.pages import data_url, environment
from pipeline.records import StoredCase, StoredStudy, read_study

if TYPE_CHECKING:
    from jinja2 import Environment

REPORT = "report.html"
EMBEDDED_BYTES = 11_000_000  # pictures beyond are linked, so that the page stays below 15 MB
MOST_DRAWN = 12
FILES = ("run.mess", "input.json", "record.json", "timing.json", "arrays.npz")


@dataclass(frozen=True)
class Shown:
    """A picture in the page: where its pixels come from (data or file), its links and words."""

    source: str
    svg: str
    png: str
    title: str
    alt: str


@dataclass(frozen=True)
class CasePage:
    """What the page shows of one case."""

    case: StoredCase
    anchor: str
    facts: list[tuple[str, str]]
    pictures: list[Shown]
    files: list[tuple[str, str]]
    seconds: dict[str, float]
    troubles: list[str] = field(default_factory=list)
    modes: list[dict[str, Any]] = field(default_factory=list)


def build(folder: Path, most_drawn: int = MOST_DRAWN, say: Callable[[str], None] | None = None) -> Path:
    """Write report.html of a study, pictures of at most `most_drawn` cases drawn anew or kept; returns its path.

    `say` is told when drawing takes its time. Solves nothing. Raises store.BadRecord when the folder holds no study.
    """
    study = read_study(folder)
    shown = StoredStudy(folder, study.about, tuple(study.for_showing(case) for case in study.cases))
    drawn = draw_cases(chosen(shown, most_drawn), say)
    embedder = _Embedder(folder)
    compared = _told(partial(plots.draw_study, study))
    pages = [_case_page(case, index, drawn.get(case.case_id), embedder) for index, case in enumerate(shown.cases)]
    page = (
        _environment()
        .get_template("report.html.j2")
        .render(
            study=study,
            cards=report_words.cards(study),
            sentences=report_words.sentences(study),
            comparison=report_words.comparison(study),
            columns=tables.columns_of(study),
            cell=tables.cell,
            pages=pages,
            pictures=[embedder.show(plots.PICTURES, picture) for picture in compared.pictures],
            troubles=compared.troubles,
            best=report_words.best_case(study),
            undrawn=sum(page.case.status in {"OK", "ALARM"} and page.case.case_id not in drawn for page in pages),
            linked=embedder.linked,
            versions=next((case.record["versions"] for case in study.cases if case.record.get("versions")), {}),
            left_out=report_words.left_out(study),
            repeat=f"antinode run {study.about['name']}" if study.about.get("name") else "",
        )
    )
    path = folder / REPORT
    store.write_atomic(path, page.encode())
    return path


def chosen(study: StoredStudy, most: int) -> list[StoredCase]:
    """Which cases get pictures: all of a short study; of a long one the best and the worst held, the rest evenly spread."""
    drawable = [case for case in study.cases if case.status in {"OK", "ALARM"}]
    if len(drawable) <= most or most < 2:
        return drawable[:most]
    ranked = sorted(
        (case for case in drawable if case.confined is not None), key=lambda case: case.wanted["confinement_db"]
    )
    picked = {case.case_id for case in (ranked[:1] + ranked[-1:])}
    spread = (drawable[round(i * (len(drawable) - 1) / max(1, most - 1))] for i in range(most))
    for case in spread:
        if len(picked) < most:
            picked.add(case.case_id)
    return [case for case in drawable if case.case_id in picked]


def draw_cases(cases: list[StoredCase], say: Callable[[str], None] | None = None) -> dict[str, plots.Drawn]:
    """Pictures of each case by its id, drawn in parallel."""
    from pipeline.runner import default_jobs
    from pipeline.workers import LocalWorkers

    stale = [case for case in cases if plots.kept_pictures(case) is None]
    if stale and say:
        say(f"drawing the pictures of {len(stale)} case{'s' * (len(stale) != 1)}")
    if len(stale) < 2:
        return {case.case_id: _told(partial(plots.draw_case, case)) for case in cases}
    with LocalWorkers(default_jobs(len(stale)), 1) as workers:
        futures = {case.case_id: workers.submit(plots.draw_case, case) for case in stale}
        kept = {case.case_id: partial(plots.draw_case, case) for case in cases if case.case_id not in futures}
        return {case.case_id: _told(kept.get(case.case_id) or futures[case.case_id].result) for case in cases}


def _told(draw: Callable[[], plots.Drawn]) -> plots.Drawn:
    """Pictures, or why there are none: a page without pictures is better than no page."""
    try:
        return draw()
    except Exception as error:
        return plots.Drawn([], [f"{type(error).__name__}: {error}"])


class _Embedder:
    """Puts pictures into the page until its budget is spent; links the rest."""

    def __init__(self, study: Path) -> None:
        self.study, self.left, self.linked = study, EMBEDDED_BYTES, 0

    def show(self, folder: str, picture: plots.Picture) -> Shown:
        """The picture of a folder (relative to the study), embedded or linked."""
        data = (self.study / folder / picture.shown).read_bytes()
        source = link(folder, picture.shown)
        if len(data) * 4 / 3 <= self.left:
            source = data_url(picture.shown, data)
            self.left -= len(source)
        else:
            self.linked += 1
        return Shown(source, link(folder, picture.svg), link(folder, picture.png), picture.title, picture.alt)


def link(*parts: str) -> str:
    """A relative address whose folder names may hold = and commas."""
    return "/".join(quote(piece) for part in parts for piece in part.split("/"))


def _case_page(case: StoredCase, index: int, drawn: plots.Drawn | None, embedder: _Embedder) -> CasePage:
    timing = case.read(store.TIMING) or {}
    return CasePage(
        case=case,
        anchor=f"case-{index + 1}",
        facts=report_words.facts(case),
        pictures=[
            embedder.show(f"{case.case_id}/{plots.PICTURES}", picture) for picture in (drawn.pictures if drawn else [])
        ],
        files=list(_files(case)),
        seconds=timing.get("seconds") or {},
        troubles=drawn.troubles if drawn else [],
        modes=report_words.modes(case),
    )


def _files(case: StoredCase) -> Iterator[tuple[str, str]]:
    """Names and addresses of a case's files, those for others first."""
    exported = list((case.record.get("geometry") or {}).get("files") or [])
    listed = sorted(case.read(store.MANIFEST) or {})
    for name in dict.fromkeys([*exported, *FILES, *listed]):
        if (case.folder / name).is_file():
            yield name, link(case.case_id, name)


def _environment() -> Environment:
    made = environment()
    made.filters["si"] = report_words.si
    return made
