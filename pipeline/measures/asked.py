"""Questions as measures of studies: plan, computation, columns and pictures from what a question declares."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any

from pipeline.case.model import Case
from pipeline.measures.measure import Draw, Measure, Work
from pipeline.planning.plan import Step
from pipeline.planning.simplifications import Simplification
from pipeline.questions import known
from pipeline.questions.question import Question, Run, Unanswered, ask
from pipeline.questions.result import Figure, Result, reach
from pipeline.records.record import Record
from pipeline.records.study import StoredCase
from pipeline.records.tables import Column

if TYPE_CHECKING:
    from pipeline.plots.style import ReportFigure


def of_question(question: Question[Any]) -> Measure:
    """Return the measure that asks a question, and those that follow it, in every case of a study."""
    kind = type(question)
    every = (question, *(each.in_study() for each in known().values() if each.follows == kind.name))

    def plan(case: Case) -> Step | Simplification:
        return kind.spared(case) or question.plan(case).steps[0]

    def compute(work: Work) -> None:
        for each in every:
            if each is question or not each.spared(work.case):
                answer(each, work.case, work.run)

    return Measure(
        kind.name,
        plan=plan,
        compute=compute,
        needs=kind.needs if kind.drives else (),
        after=kind.after,
        aliases=kind.aliases,
        drives=kind.drives,
        inputs=kind.inputs,
        columns=tuple(
            _column(each.name, *figure) for each in every if each.is_own for figure in each.result.figures.items()
        ),
        pictures=kind.pictures,
        drawn=() if kind.pictures else (_drawn(question),),
    )


def answer(question: Question[Any], case: Case, run: Run) -> None:
    """Ask a question in a study and keep what is stored of its answer, without solved models."""
    try:
        run.found[question.name] = ask(case, question, run).stored()
    except Unanswered as why:
        if why.args:
            run.left_out(*why.args)


def _column(question: str, name: str, about: Figure[Any]) -> Column:
    """Return the column of table.csv that holds a figure."""

    def at(place: str | Callable[[Any], Any]) -> Callable[[Record], Any]:
        def value(record: Record) -> Any:
            found = record.answers.get(question)
            return reach(found, place) if isinstance(place, str) else None if found is None else place(found)

        return value

    own, bar = about.name or f"{question}_{name}", at(about.error) if about.error else None
    return Column(own, about.heading, at(name), about.unit, bar, about.is_difference, about.is_signed)


def _drawn(question: Question[Any]) -> Draw:
    def pictures(case: StoredCase, arrays: dict[str, Any]) -> list[ReportFigure] | None:
        found = case.record.answers.get(question.name)
        if found is None or type(found).draw is Result.draw:
            return None
        return found.with_arrays(arrays, case.record.design).pictures()

    return pictures
