"""Questions in studies: selection for a case, plan, stored answers, pictures, columns of table.csv."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from pathlib import Path
from typing import TYPE_CHECKING, Any

from pipeline.case.model import Case
from pipeline.errors import InputError
from pipeline.planning import simplifications
from pipeline.planning.plan import Plan
from pipeline.questions import known
from pipeline.questions.late import named
from pipeline.questions.question import Question, Run, Unanswered, ask
from pipeline.questions.result import Figure, Result, reach
from pipeline.records import store, tables
from pipeline.records.record import Record
from pipeline.records.study import StoredCase, StoredStudy, read_study
from pipeline.records.tables import Column
from solvers.measures.confinement import CONFINED_DB

if TYPE_CHECKING:
    from pipeline.plots.style import ReportFigure

Draw = Callable[[StoredCase, dict[str, Any]], "ReportFigure | list[ReportFigure] | None"]
IN_ORDER = (  # asked in this order: a later question may use the answer of an earlier one
    *("modes", "bands", "attenuation", "broadband", "response", "tolerance", "touch", "hybrid", "travel", "crosstalk"),
    *("live", "board", "predesign", "zone_modes", "pillar_modes", "geometry", "tet_modes"),
)


def questions() -> list[Question[Any]]:
    """Return every question that studies ask, in order, those of other modules last."""
    found = {name: kind.in_study() for name, kind in known().items() if not kind.follows}
    asked = {name: question for name, question in found.items() if question}
    return [*(asked.pop(name) for name in IN_ORDER), *asked.values()]


def followers(question: Question[Any]) -> list[Question[Any]]:
    """Return the questions that accompany another one."""
    return [kind.in_study() for kind in known().values() if kind.follows == question.name]


def names() -> list[str]:
    """Return the measures that a study file may name."""
    return [*dict.fromkeys(name for each in questions() for name in (each.name, *each.aliases))]


def chosen(query: Iterable[str]) -> list[Question[Any]]:
    """Return the questions of these names in their order."""
    requested = set(query)
    return [each for each in questions() if requested & {each.name, *each.aliases}]


def check(case: Case, query: Iterable[str]) -> None:
    """Raise InputError for a case that lacks a table or key that its questions need."""
    asked = chosen(query)
    case.require_plate("a study")
    for each in asked:
        case.refuse(f"the measure {each.name}", each.honoured())
        if each.drives and each.needs:
            case.require(*each.needs, command=f"the measure {each.name}")
        if each.after and each.after not in [other.name for other in asked]:
            raise InputError(f"the measure {each.name} uses {each.after}: add {each.after} to measure")


def plan_of(case: Case, query: Iterable[str]) -> Plan:
    """Return the steps of a case's questions, in the order in which they are asked."""
    asked = chosen(query)
    spared = {each.name: each.spared(case) for each in asked}
    driven = any(each.drives for each in asked)
    whole = (
        *spared.values(),
        None if "modes" in spared else simplifications.no_plate_modes(),
        simplifications.no_patches(case.patches, driven),
        None if driven else simplifications.no_response(),
        simplifications.no_figures(),
    )
    steps = tuple(each.plan(case).steps[0] for each in asked if not spared[each.name])
    return Plan(case.name, steps, tuple(each for each in whole if each))


def answer(question: Question[Any], case: Case, run: Run) -> None:
    """Ask a question and those that accompany it; keep the stored part of the answers, without solved models."""
    for each in (question, *followers(question)):
        if each.spared(case):
            continue
        try:
            run.found[each.name] = ask(case, each, run).stored()
        except Unanswered as why:
            if why.args:
                run.left_out(*why.args)


# -- pictures and columns --------------------------------------------------------------------------------------------


def draws() -> list[Draw]:
    """Return the functions that draw the pictures of a case."""
    return [draw for question in questions() for draw in _draws(question)]


def _draws(question: Question[Any]) -> list[Draw]:
    """Return the functions that draw a question's pictures: functions of pipeline by name, or the result's own."""
    if question.pictures:
        return [named(place) for place in question.pictures]

    def pictures(case: StoredCase, arrays: dict[str, Any]) -> list[ReportFigure] | None:
        found = case.record.answers.get(question.name)
        if found is None or not question.is_own or type(found).draw is Result.draw:
            return None
        drawn: list[ReportFigure] = found.with_arrays(arrays, case.record.design).pictures()
        return drawn

    return [pictures]


def columns(question: Question[Any]) -> list[Column]:
    """Return the columns of table.csv for the answers to a question and those that accompany it."""
    every = [each for each in (question, *followers(question)) if each.is_own]
    return [_column(each.name, name, about) for each in every for name, about in each.result.figures.items()]


def _column(question: str, name: str, about: Figure[Any]) -> Column:
    def at(place: str | Callable[[Any], Any]) -> Callable[[Record], Any]:
        def value(record: Record) -> Any:
            found = record.answers.get(question)
            return reach(found, place) if isinstance(place, str) else None if found is None else place(found)

        return value

    own, bar = about.name or name, at(about.error) if about.error else None
    return Column(own, about.heading, at(name), about.unit, bar, about.is_difference, about.is_signed)


def _dof(record: Record) -> int | None:
    solved = record.modes or record.held("bands")
    return solved.dof if solved else None


def _confined(record: Record) -> str | None:
    return None if record.confined is None else "yes" if record.confined else "no"


OF_SEVERAL = (  # columns computed from several answers of a case
    Column("confined", f"confined (at least {CONFINED_DB:g} dB)", _confined),
    Column("dof", "degrees of freedom", _dof, ""),
)


def columns_of(study: StoredStudy) -> list[Column]:
    """Return the columns of a study's table."""
    return tables.columns_of(study, [*(column for each in questions() for column in columns(each)), *OF_SEVERAL])


def write_table(folder: Path) -> Path:
    """Write table.csv of a study from its records, atomically. Raises store.BadRecord when nothing is stored."""
    study = read_study(folder)
    store.write_atomic(folder / tables.TABLE, tables.table_bytes(study, columns_of(study)))
    return folder / tables.TABLE
