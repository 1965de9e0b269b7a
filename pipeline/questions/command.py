"""Commands that ask questions: their options from the declarations, the answer as text, JSON, tables and pictures."""

from __future__ import annotations

import argparse
from collections.abc import Callable
from dataclasses import fields
from types import NoneType
from typing import TYPE_CHECKING, Any, Literal, get_args, get_origin, get_type_hints

from pipeline.questions import registered
from pipeline.questions.question import KHZ, Option, Question, Run, ask
from pipeline.questions.result import Result

if TYPE_CHECKING:
    from pipeline.case.model import Case
    from pipeline.logs import TerminalLog

Kind = type[Question[Any]]
MAX_DIGITS = 40  # characters of a number that are read and shown
SUFFIXES = {"kHz": "_kHz", "mm": "_mm", "dB": "_dB", "rad/m": "_per_m"}  # of options' names, by unit


def add_options(sub: argparse.ArgumentParser, question: Kind) -> None:
    """Add the options of a question to its command."""
    defaults = {each.name: each.default for each in fields(question)}
    for name, about in question.options.items():
        _add(sub, name, about, kind_of(question, name), defaults[name])


def _add(sub: argparse.ArgumentParser, name: str, about: Option, kind: Any, default: Any) -> None:
    """Add an option; its type says how its text is read."""
    shown = about.help if default is None or kind is bool else f"{about.help} (default: {default})"
    words: dict[str, Any] = {"dest": name, "default": default, "help": shown.replace("%", "%%")}
    if kind is bool:
        words |= {"action": "store_false" if default else "store_true"}
    elif get_origin(kind) is Literal:
        words |= {"choices": get_args(kind)}
    elif about.unit == "kHz":
        words |= {"metavar": "F:F" if get_origin(kind) is tuple else "F"}
    else:
        words |= {"type": _reader(kind, about), "metavar": "N"}
    sub.add_argument(flag(name, about, default), **words)


def flag(name: str, about: Option, default: Any = None) -> str:
    """Return the flag of an option: its name without its unit."""
    words = name.removesuffix(SUFFIXES.get(about.unit, "")).replace("_", "-")
    return f"--no-{words}" if default is True else f"--{words}"


def kind_of(question: Kind, name: str) -> Any:
    """Return the type of an option, without None."""
    hint = get_type_hints(question)[name]
    return next(each for each in get_args(hint) if each is not NoneType) if NoneType in get_args(hint) else hint


def _reader(kind: Any, about: Option) -> Callable[[str], Any]:
    """Return what reads the text of a number, with the faults of the question itself."""

    def read(text: str) -> Any:
        shown = text[:MAX_DIGITS]
        try:
            value = kind(text) if len(text) < MAX_DIGITS else None
        except ValueError:
            value = None
        if value is None:
            raise argparse.ArgumentTypeError(f"{shown}: must be a {'whole ' * (kind is int)}number")
        if fault := about.fault(value):
            raise argparse.ArgumentTypeError(f"{shown}: {fault}")
        return value

    return read


def run(arguments: argparse.Namespace) -> int:
    """Run the command of a question: read its case, then explain, or ask and write the answer."""
    from pipeline.case.model import load_case
    from pipeline.case.plausible import warn_of_doubts
    from pipeline.logs import TerminalLog
    from pipeline.views.answer import Answer, emit, of_case

    kind: Kind = registered()[arguments.command]
    case = of_case(arguments, load_case(arguments.case, arguments.set))
    log = TerminalLog(arguments.quiet)
    warn_of_doubts(case.design, log)
    question = kind(**{name: _given(arguments, name, about) for name, about in kind.options.items()})
    if arguments.explain:
        question.check(case)
        plan = question.plan(case)
        return emit(arguments, "plan", Answer(plan.to_dict(), [plan.text()]))
    return answer(arguments, case, question, log)


def _given(arguments: argparse.Namespace, name: str, about: Option) -> Any:
    """Return an option's value from a command line. Raises InputError for a frequency or a band that is none."""
    from pipeline.case.quantities import parse_band, parse_frequency

    value, named = getattr(arguments, name), flag(name, about)
    if about.unit != "kHz" or not isinstance(value, str):
        return value
    if kind_of(registered()[arguments.command], name) is float:
        return parse_frequency(value, named) / KHZ
    return tuple(end / KHZ for end in parse_band(value, named))


def answer(arguments: argparse.Namespace, case: Case, question: Question[Any], log: TerminalLog) -> int:
    """Ask a question and write its answer to where the command line asks for it."""
    from pipeline.views.answer import Answer, emit

    kept = any(getattr(arguments, name) for name in ("json", "out", "csv", "markdown")) or arguments.verbose
    result: Result = ask(case, question, Run(log, detailed=kept))
    rows = result.rows()
    lines = [*result.lines(), *(result.details() if arguments.verbose else ())]
    cells = [list(row.values()) for row in rows]
    return emit(
        arguments,
        question.name,
        Answer(result.to_dict(), lines, tuple(rows[0]), cells, result.pictures, draw=result.plot),
        log,
    )
