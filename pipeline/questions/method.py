"""Methods of a plate that ask questions, with the options as their parameters."""

from __future__ import annotations

import inspect
from collections.abc import Callable
from types import MethodType
from typing import Any, Generic, ParamSpec, TypeVar

from pipeline.questions.question import Question, ask
from pipeline.questions.result import Result

P = ParamSpec("P")
R = TypeVar("R", bound=Result)
RAISES = """Raises
------
InputError
    Where the case lacks what the question needs.
SolverError
    Where a result could not be trusted."""


class asks(Generic[P, R]):
    """A method that asks a question: `bands = asks(Bands)` in the class of a plate.

    The plate has `case` and `_log(progress)`, the log of a computation.
    """

    def __init__(self, question: Callable[P, Question[R]]) -> None:
        self.function = _function(question)

    def __get__(self, plate: Any, owner: type | None = None) -> Callable[P, R]:
        bound: Callable[P, R] = self.function if plate is None else MethodType(self.function, plate)
        return bound


def _function(kind: Any) -> Any:
    def method(self: Any, *options: Any, **named: Any) -> Any:
        question = kind(*options, **named)
        return ask(self.case, question, self._log(question.progress))

    given = inspect.signature(kind)
    own = inspect.Parameter("self", inspect.Parameter.POSITIONAL_ONLY)
    method.__name__, method.__qualname__, method.__doc__ = kind.name, f"Plate.{kind.name}", numpydoc(kind)
    method.__signature__ = given.replace(  # type: ignore[attr-defined]
        parameters=[own, *given.parameters.values()], return_annotation=kind.result
    )
    return method


def numpydoc(question: type[Question[Any]]) -> str:
    """Return the docstring of a question's method."""
    summary, _, examples = (inspect.getdoc(question) or "").partition("\n>>> ")
    options = [f"{n}\n    {each.help}{each.unit and f', in {each.unit}'}." for n, each in question.options.items()]
    progress = "progress\n    Whether to report on standard error; None: in a terminal or a notebook."
    listed = "\n".join(["Parameters", "----------", *options, progress])
    of_result = (inspect.getdoc(question.result) or "").splitlines()[0]
    returned = f"Returns\n-------\n{question.result.__name__}\n    {of_result}"
    shown = f"\n\nExamples\n--------\n>>> {examples}" if examples else ""
    return "\n\n".join([summary.rstrip(), listed, returned, RAISES]) + shown + "\n"
