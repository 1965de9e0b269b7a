"""Questions as measures of studies: plan, computation, columns and pictures from what a question declares."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any

from pipeline.case.model import Case
from pipeline.measures.measure import Draw, Measure, Work
from pipeline.planning.plan import Step
from pipeline.planning.simplifications import Simplification
from pipeline.questions.question import Question, ask
from pipeline.questions.result import Figure
from pipeline.records.record import Record
from pipeline.records.study import StoredCase
from pipeline.records.tables import Column

if TYPE_CHECKING:
    from pipeline.plots.style import ReportFigure


def of_question(question: Question[Any]) -> Measure:
    """Return the measure that asks a question in every case of a study."""
    kind = type(question)

    def plan(case: Case) -> Step | Simplification:
        return kind.spared(case) or question.plan(case).steps[0]

    def compute(work: Work) -> None:
        result = ask(work.case, question, work.run)
        work.keep(work.run.meshes, work.run.arrays, **{kind.name: result})
        work.run.meshes.clear()

    return Measure(
        kind.name,
        plan=plan,
        compute=compute,
        needs=kind.needs if kind.drives else (),
        drives=kind.drives,
        columns=tuple(_column(question, name, each) for name, each in kind.result.figures.items()),
        pictures=kind.pictures,
        drawn=() if kind.pictures else (_drawn(question),),
    )


def _column(question: Question[Any], name: str, about: Figure[Any]) -> Column:
    """Return the column of table.csv that holds a figure."""

    def of(figure: str | Callable[[Any], Any]) -> Callable[[Record], Any]:
        def value(record: Record) -> Any:
            answer = record.of(question.result)
            return None if answer is None else figure(answer) if callable(figure) else getattr(answer, figure)

        return value

    own = about.name or f"{question.name}_{name}"
    return Column(
        own, about.heading, of(name), about.unit, of(about.error) if about.error else None,
        about.is_difference, about.is_signed,
    )  # fmt: skip


def _drawn(question: Question[Any]) -> Draw:
    def pictures(case: StoredCase, arrays: dict[str, Any]) -> list[ReportFigure] | None:
        answer = case.record.of(question.result)
        return None if answer is None else answer.with_arrays(arrays, case.record.design).pictures()

    return pictures
