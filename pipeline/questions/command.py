"""Commands that ask questions: their options from the declarations, the answer as text, JSON, tables and pictures."""

from __future__ import annotations

import argparse
from collections.abc import Callable, Iterator
from dataclasses import fields, replace
from typing import TYPE_CHECKING, Any, Literal, get_args, get_origin

from pipeline.errors import InputError
from pipeline.questions import registered
from pipeline.questions.question import VARIANTS, Option, Question, Run, ask, kind_of
from pipeline.questions.result import Result
from pipeline.units import KHZ

if TYPE_CHECKING:
    from pipeline.case.model import Case
    from pipeline.logs import TerminalLog

Kind = type[Question[Any]]
EXAMPLES = {tuple[float, float]: ", such as 28kHz:38kHz", float: ", such as 32kHz"}  # of frequencies as typed
FIELDS = "write the field of every mode into --out DIR (fields.npz)"
MAX_DIGITS = 40  # characters of a number that are read and shown
SUFFIXES = {"kHz": "_kHz", "mm": "_mm", "dB": "_dB", "rad/m": "_per_m"}  # of options' names, by unit


def add_options(sub: argparse.ArgumentParser, question: Kind) -> None:
    """Add the options of a question to its command, and those of questions that may be asked in its place."""
    known: set[str] = set()
    for kind in (question, *_variants(question)):
        defaults = {each.name: each.default for each in fields(kind)}
        for name in (each for each in kind.options if each not in known):
            _add(sub, name, kind.options[name], kind_of(kind, name), defaults[name])
        known |= kind.options.keys()
    if hasattr(question.result, "fields"):
        sub.add_argument("--save-all-fields", action="store_true", help=FIELDS)


def _variants(question: Kind) -> list[Kind]:
    return [each for each in VARIANTS.values() if each.instead_of == question.name]


def _add(sub: argparse.ArgumentParser, name: str, about: Option, kind: Any, default: Any) -> None:
    """Add an option; its type says how its text is read."""
    shown = about.help + EXAMPLES.get(kind, "") * (about.unit == "kHz")
    shown += "" if default is None or kind is bool else f" (default: {default})"
    words: dict[str, Any] = {"dest": name, "default": default, "help": shown.replace("%", "%%")}
    if kind is bool:
        words |= {"action": "store_false" if default else "store_true"}
    elif get_origin(kind) is Literal:
        words |= {"choices": get_args(kind)}
    elif kind == tuple[str, ...]:
        words |= {"action": "append", "metavar": about.metavar, "default": list(default)}
        words["help"] = f"{about.help} (repeatable)"
    elif about.unit == "kHz":
        words |= {"metavar": "F:F" if get_origin(kind) is tuple else "F"}
    elif kind is str:
        words |= {"metavar": about.metavar, "help": about.help}
    else:
        words |= {"type": _reader(kind, about), "metavar": about.metavar or "N"}
    sub.add_argument(flag(name, about, default), **words)


def flag(name: str, about: Option, default: Any = None) -> str:
    """Return the flag of an option: its name without its unit."""
    words = about.flag or name.removesuffix(SUFFIXES.get(about.unit, "")).replace("_", "-")
    return f"--no-{words}" if default is True else f"--{words}"


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

    kind = _asked(arguments)
    case = of_case(arguments, load_case(arguments.case, arguments.set))
    log = TerminalLog(arguments.quiet)
    warn_of_doubts(case.design, log)
    question = kind(**{name: _given(arguments, kind, name, about) for name, about in kind.options.items()})
    if arguments.explain:
        question.check(case)
        from pipeline.planning.simplifications import no_figures

        plan = question.plan(case)
        undrawn = no_figures(bool(arguments.out or arguments.plot))
        plan = replace(plan, whole=(*plan.whole, *([undrawn] if undrawn else [])))
        return emit(arguments, "plan", Answer(plan.to_dict(), [plan.text()]))
    return answer(arguments, case, question, log)


def _asked(arguments: argparse.Namespace) -> Kind:
    """Return the question that a command line asks. Raises InputError for options that are another question's."""
    own: Kind = registered()[arguments.command]
    variants = _variants(own)
    kind = next((each for each in variants if getattr(arguments, each.by)), own)
    lines = [
        line for other in (own, *variants) if other is not kind for line in _others_options(arguments, kind, other)
    ]
    if getattr(arguments, "save_all_fields", False) and not (arguments.out or arguments.explain):
        lines.append("--save-all-fields: needs --out DIR, the folder that fields.npz goes to")
    if lines:
        raise InputError(lines)
    return kind


def _others_options(arguments: argparse.Namespace, kind: Kind, other: Kind) -> Iterator[str]:
    """Yield a line for each option given that only another question than the one asked has."""
    defaults = {each.name: each.default for each in fields(other)}
    for name, about in other.options.items():
        value = getattr(arguments, name)
        given = list(value) if isinstance(value, list) else [value] * (value != defaults[name])
        selected = flag(other.by or kind.by, (other if other.by else kind).options[other.by or kind.by])
        why = f"needs {selected} FILE" if other.by else f"must be left out beside {selected}"
        if name not in kind.options:
            yield from (f"{flag(name, about)} = {_shown(one)}: {why}" for one in given)


def _shown(value: Any) -> str:
    return f"{value:g}" if isinstance(value, float) else str(value)


def _given(arguments: argparse.Namespace, kind: Kind, name: str, about: Option) -> Any:
    """Return an option's value from a command line. Raises InputError for a frequency or a band that is none."""
    from pipeline.case.quantities import parse_band, parse_frequency

    value, named = getattr(arguments, name), flag(name, about)
    if isinstance(value, list):
        return tuple(value)
    if about.unit != "kHz" or not isinstance(value, str):
        return value
    if kind_of(kind, name) is float:
        return parse_frequency(value, named) / KHZ
    return tuple(end / KHZ for end in parse_band(value, named))


def answer(arguments: argparse.Namespace, case: Case, question: Question[Any], log: TerminalLog) -> int:
    """Ask a question and write its answer to where the command line asks for it."""
    from pipeline.records import outputs, store
    from pipeline.views.answer import Answer, emit

    kept = any(getattr(arguments, name) for name in ("json", "out", "csv", "markdown")) or arguments.verbose
    folder = outputs.folder(arguments.out) if arguments.out else None
    result: Result = ask(case, question, Run(log, detailed=kept, folder=folder))
    rows = result.to_rows()
    lines = [*result.lines(), *(result.details() if arguments.verbose else ())]
    head, cells = tuple(rows[0]) if rows else tuple(result.heading()), [list(row.values()) for row in rows]
    whole = Answer(result.to_dict(), lines, head, cells, result.pictures, draw=result.plot)
    code = emit(arguments, question.instead_of or question.name, whole, log)
    if getattr(arguments, "save_all_fields", False):
        store.save_arrays(outputs.folder(arguments.out), result.fields(), store.FIELDS)  # type: ignore[attr-defined]
    return code
