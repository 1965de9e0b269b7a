"""Commands and methods of a plate: options built from the questions' declarations, and output of the answers.

Text is for people, a JSON document for scripts; files go into a folder.
"""

from __future__ import annotations

import argparse
import inspect
import json
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, fields, replace
from math import nan
from pathlib import Path
from shlex import join
from types import MethodType
from typing import TYPE_CHECKING, Any, Generic, Literal, ParamSpec, TypeVar, get_args, get_origin

from pipeline.errors import InputError
from pipeline.logs import TerminalLog
from pipeline.paths import STUDIES
from pipeline.quantity import KHZ
from pipeline.questions.late import outputs, simplifications, style
from pipeline.questions.question import (
    ONE_OR_TWO,
    QUESTIONS,
    VARIANTS,
    Option,
    Pair,
    Question,
    Run,
    ask,
    item_of,
    kind_of,
)
from pipeline.questions.result import Result
from pipeline.records.part import DOCUMENT_SCHEMA, sentence

if TYPE_CHECKING:
    from pipeline.case.model import Case
    from pipeline.plots.style import ReportFigure

Kind = type[Question[Any]]
FIELDS = "write the field of every mode into --out DIR (fields.npz)"
MAX_DIGITS = 40  # longest number that is read and shown, in characters
FORMATS = (".png", ".pdf", ".svg")
OF_UNIT = {"rad/m": "per_m", "N/m": "N_per_m"}  # endings of option names that differ from the unit

P = ParamSpec("P")
R = TypeVar("R", bound=Result)

PROGRESS = """progress : bool, optional
    Whether to report progress on standard error; by default in a terminal or a notebook."""
RAISES = """Raises
------
InputError
    If the case lacks a table or key that the question needs.
SolverError
    If a result fails its own checks."""


@dataclass(frozen=True)
class Answer:
    """Document, lines of text, rows under a head for CSV; pictures for --out, drawn on demand; a figure for --plot."""

    document: dict[str, Any]
    lines: Sequence[str]
    head: Sequence[str] = ()
    rows: Sequence[Sequence[Any]] = ()
    pictures: Callable[[], Sequence[ReportFigure]] = tuple
    figure: Callable[[], Any] | None = None


class asks(Generic[P, R]):
    """Method that asks a question: `bands = asks(Bands)` in the class of a plate.

    The plate has `case` and `_log(progress)`, the log of a computation.
    """

    def __init__(self, question: Callable[P, Question[R]]) -> None:
        self.function = _function(question)

    def __get__(self, plate: Any, owner: type | None = None) -> Callable[P, R]:
        bound: Callable[P, R] = self.function if plate is None else MethodType(self.function, plate)
        return bound


def add_options(sub: argparse.ArgumentParser, question: Kind) -> None:
    """Add the options of a question to its command, and those of the questions that may replace it."""
    known: set[str] = set()
    for kind in (question, *_variants(question)):
        defaults = {each.name: each.default for each in fields(kind)}
        for name in (each for each in kind.options if each not in known):
            _add(sub, name, kind.options[name], kind_of(kind, name), defaults[name])
        known |= kind.options.keys()
    if hasattr(question.result, "fields"):
        sub.add_argument("--save-all-fields", action="store_true", help=FIELDS)


def flag(name: str, about: Option, default: Any = None) -> str:
    """Return the flag of an option: its name without the unit."""
    words = about.flag or name.removesuffix(f"_{OF_UNIT.get(about.unit, about.unit)}").replace("_", "-")
    return f"--no-{words}" if default is True else f"--{words}"


def run(arguments: argparse.Namespace) -> int:
    """Run the command of a question: read the case, then explain, or ask and write the answer."""
    from pipeline.case.limits import warn_of_doubts

    kind = _asked(arguments)
    case, log = _case(arguments, kind), TerminalLog(arguments.quiet)
    if case:
        warn_of_doubts(case.design, log)
    question = kind(**{name: _given(arguments, kind, name, about) for name, about in kind.options.items()})
    if arguments.explain:
        case = question.suited(case)
        plan = question.plan(case)  # type: ignore[arg-type]
        undrawn = simplifications.no_figures(bool(arguments.out or arguments.plot))
        plan = replace(plan, whole=(*plan.whole, *([undrawn] if undrawn else [])))
        return emit(arguments, "plan", Answer(plan.to_dict(), [plan.text()]))
    return answer(arguments, case, question, log)


def answer(arguments: argparse.Namespace, case: Case | None, question: Question[Any], log: TerminalLog) -> int:
    """Ask a question and write its answer to the requested places."""
    from pipeline.records import store

    kept = any(getattr(arguments, name) for name in ("json", "out", "csv", "markdown")) or arguments.verbose
    folder = outputs.folder(arguments.out) if arguments.out else None
    run = Run(log, detailed=kept, folder=folder, asked_by=join(["antinode", *arguments.words]))
    result: Result = ask(case, question, run)
    rows = result.to_rows()
    lines = [*result.lines(), *(result.details() if arguments.verbose else ())]
    head, cells = tuple(rows[0]) if rows else tuple(result.heading()), [list(row.values()) for row in rows]
    whole = Answer(result.to_dict(), lines, head, cells, result.pictures, figure=result.as_figure)
    code = emit(arguments, question.instead_of or question.name, whole, log)
    if getattr(arguments, "save_all_fields", False):
        store.save_arrays(outputs.folder(arguments.out), result.fields(), store.FIELDS)  # type: ignore[attr-defined]
    return code


def of_case(arguments: argparse.Namespace, case: Case) -> Case:
    """Keep the case that is answered, and check the output places again now that its input files are known."""
    arguments.answered = case
    outputs.check_places(arguments)
    return case


def check(arguments: argparse.Namespace) -> None:
    """Raise InputError, before computing, for an unsupported format of --plot or a place that cannot be written."""
    place = getattr(arguments, "plot", None)
    if place and Path(place).suffix.lower() not in FORMATS:
        raise InputError(f"--plot = {place}: must end in {', '.join(FORMATS[:-1])} or {FORMATS[-1]}")
    outputs.check_places(arguments)


def emit(arguments: argparse.Namespace, name: str, answer: Answer, log: TerminalLog | None = None) -> int:
    """Write text to standard output unless a document goes there, and JSON, CSV, pictures and files to their places.

    Every document also names the case with its defaults, the version and, with a log, the seconds spent.
    """
    case: Case | None = getattr(arguments, "answered", None)
    from importlib.metadata import version  # slow to import, and not needed by --explain

    about = {"case": case and case.name, "with_defaults": case and case.to_dict(), "version": version("antinode")}
    seconds = {"seconds": log.seconds | {"total": log.elapsed}} if log else {}
    document = {"schema": DOCUMENT_SCHEMA, **about, **answer.document, **seconds}
    wants_json = arguments.json or getattr(arguments, "out", None)
    encoded = (json.dumps(document, indent=1, allow_nan=False) + "\n").encode() if wants_json else b""
    written = _files(arguments, name, answer, encoded)
    for place, data in written.items():
        if not outputs.is_standard_output(place):
            outputs.write_file(place, data)
    if out := getattr(arguments, "out", None):
        _draw(answer, outputs.folder(out))
    if answer.head and getattr(arguments, "plot", None):  # a plan has neither rows nor a figure
        _save(_figure(answer), Path(arguments.plot))
    _print(arguments, answer, written)  # last: the reading process may have closed the pipe
    return 0


def numpydoc(question: type[Question[Any]], without: str = "", further: str = "") -> str:
    """Return the docstring of a question's method: without an option, with an entry for further keywords."""
    summary, _, examples = (inspect.getdoc(question) or "").partition("\n>>> ")
    options = [
        f"{name} : {_type(kind_of(question, name))}, optional\n    {sentence(about.help, about.unit)}"
        for name in inspect.signature(question).parameters
        if name != without and (about := question.options.get(name))
    ]
    listed = "\n".join(["Parameters", "----------", *options, PROGRESS, *([further] if further else [])])
    of_result = (inspect.getdoc(question.result) or "").splitlines()[0]
    returned = f"Returns\n-------\n{question.result.__name__}\n    {of_result}"
    shown = f"\n\nExamples\n--------\n>>> {examples}" if examples else ""
    return "\n\n".join([summary.rstrip(), listed, returned, RAISES]) + shown + "\n"


def _type(kind: Any) -> str:
    """Return the type of an option in numpydoc's words."""
    if get_origin(kind) is Literal:
        return f"{{{', '.join(map(repr, get_args(kind)))}}}"
    item = float if kind == Pair else item_of(kind)
    return f"tuple of {item.__name__}" if item else str(kind.__name__)


def _variants(question: Kind) -> list[Kind]:
    return [each for each in VARIANTS.values() if each.instead_of == question.name]


def _add(sub: argparse.ArgumentParser, name: str, about: Option, kind: Any, default: Any) -> None:
    """Add an option; its type decides how its text is parsed."""
    shown = about.help
    if about.unit == "kHz":
        shown += f", such as {'28kHz:38kHz' if kind == Pair else '32kHz'}"
    known = f"{default:g}kHz" if about.unit == "kHz" and isinstance(default, float) else default
    shown += ", such as 4us" * (about.unit == "s")
    shown += "" if default in (None, ()) or kind is bool else f" (default: {known})"
    words: dict[str, Any] = {"dest": name, "default": default, "help": shown.replace("%", "%%")}
    if kind is bool:
        words |= {"action": "store_false" if default else "store_true"}
    elif get_origin(kind) is Literal:
        words |= {"choices": get_args(kind)}
    elif item_of(kind):
        words |= {"action": "append", "metavar": about.metavar, "default": list(default)}
        words["help"] = f"{shown} (repeatable)".replace("%", "%%")
    elif about.unit == "s":
        words |= {"metavar": "T"}
    elif about.unit == "kHz":
        words |= {"metavar": about.metavar or ("F:F" if get_origin(kind) is tuple else "F")}
    elif kind is str:
        words |= {"metavar": about.metavar, "help": about.help}
    else:
        words |= {"type": _reader(kind, about), "metavar": about.metavar or "N"}
    sub.add_argument(flag(name, about, default), **words)


def _reader(kind: Any, about: Option) -> Callable[[str], Any]:
    """Return the parser of a number, which reports the same faults as the question."""

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


def _case(arguments: argparse.Namespace, kind: Kind) -> Case | None:
    """Return the case of a command line; None for a question that needs none. Raises InputError for a faulty case."""
    from pipeline.case.model import load_case

    if arguments.case is not None:
        return of_case(arguments, load_case(arguments.case, arguments.set))
    if kind.without_case:
        return of_case(arguments, load_case(STUDIES / kind.without_case, arguments.set))
    if arguments.set:
        raise InputError("--set: needs a CASE to change")
    return None


def _asked(arguments: argparse.Namespace) -> Kind:
    """Return the question of a command line. Raises InputError for options of another question."""
    own: Kind = QUESTIONS[arguments.question]
    variants = _variants(own)
    kind = next((each for each in variants if _is_selected(arguments, each)), own)
    lines = [
        line for other in (own, *variants) if other is not kind for line in _others_options(arguments, kind, other)
    ]
    if getattr(arguments, "save_all_fields", False) and not (arguments.out or arguments.explain):
        lines.append("--save-all-fields: needs --out DIR, the folder for fields.npz")
    if lines:
        raise InputError(lines)
    return kind


def _is_selected(arguments: argparse.Namespace, kind: Kind) -> bool:
    return any(getattr(arguments, name) for name in kind.by)


def _others_options(arguments: argparse.Namespace, kind: Kind, other: Kind) -> Iterator[str]:
    """Yield a line for each given option that belongs to another question only."""
    defaults = {each.name: each.default for each in fields(other)}
    for name, about in other.options.items():
        value = getattr(arguments, name)
        given = list(value) if isinstance(value, list) else [value] * (value != defaults[name])
        if name in kind.options:
            continue
        needed = other.by and not _is_selected(arguments, other)
        by = (other if needed else kind).by[0]
        selected = (other if needed else kind).options[by]
        why = (
            f"needs {flag(by, selected)} {selected.metavar}"
            if needed
            else f"cannot be combined with {flag(by, selected)}: remove one of them"
        )
        yield from (f"{flag(name, about)} = {_shown(one)}: {why}" for one in given)


def _shown(value: Any) -> str:
    return f"{value:g}" if isinstance(value, float) else str(value)


def _given(arguments: argparse.Namespace, kind: Kind, name: str, about: Option) -> Any:
    """Parse an option's value. Raises InputError for text that is not a number, frequency or time."""
    value, named = getattr(arguments, name), flag(name, about)
    read: Any = kind_of(kind, name)
    if isinstance(value, list):
        return _items(value, item_of(read), about, named)
    return _of_text(value, read, about, named) if isinstance(value, str) else value


def _of_text(text: str, kind: Any, about: Option, named: str) -> Any:
    from pipeline.case.limits import parse_band, parse_frequency, parse_seconds, parse_target

    if about.unit == "kHz":
        parse = parse_target if about.metavar == ONE_OR_TWO else parse_band
        return parse_frequency(text, named) / KHZ if kind is float else tuple(e / KHZ for e in parse(text, named))
    if about.unit == "s":
        return parse_seconds(text, named)
    if kind is not float:
        return text
    try:
        value = float(text)
    except ValueError:
        value = nan
    if fault := about.fault(value):
        raise InputError(f"{named} = {text}: {fault}")
    return value


def _items(texts: list[str], item: Any, about: Option, named: str) -> tuple[Any, ...]:
    """Return the items of a repeatable option. Raises InputError with one line per fault."""
    if item is str:
        return tuple(texts)
    found, lines = [], []
    for text in texts:
        try:
            found.append(_of_text(text, float, about, named) if item is float else item.read(text))
        except InputError as error:
            lines += error.lines
    if lines:
        raise InputError(lines)
    return tuple(found)


def _print(arguments: argparse.Namespace, answer: Answer, written: Mapping[Path, bytes]) -> None:
    alone = [data for place, data in written.items() if outputs.is_standard_output(place)]
    if alone:
        sys.stdout.write(alone[0].decode())
    elif not outputs.is_standard_output(getattr(arguments, "output", None)):
        print("\n".join(answer.lines))
    sys.stdout.flush()


def _figure(answer: Answer) -> Any:
    """Return the figure of an answer, else its first picture."""
    if answer.figure:
        return answer.figure()
    with style.style():
        return answer.pictures()[0].figure


def _save(figure: Any, place: Path) -> None:
    """Write a figure atomically, in the format of the file's ending (png, pdf or svg)."""
    from geometry.files import written_whole

    with style.style(), written_whole(place) as temporary:
        figure.savefig(temporary, format=place.suffix.lstrip(".").lower() or "png", dpi=150, bbox_inches="tight")


def _files(arguments: argparse.Namespace, name: str, answer: Answer, encoded: bytes) -> dict[Path, bytes]:
    """Return the documents to write by place; standard output is one of them."""
    rows = outputs.csv_bytes(answer.head, answer.rows) if answer.head else b""
    readable = outputs.reading_markdown(answer.head, answer.rows).encode() if answer.head else b""
    known = {"json": encoded, "csv": rows, "markdown": readable}
    chosen = {place: data for key, data in known.items() if (place := getattr(arguments, key, None)) and data}
    written = {Path(place): data for place, data in chosen.items()}
    if out := getattr(arguments, "out", None):
        named = {f"{name}.json": encoded, **({f"{name}.csv": rows} if rows else {})}
        written |= {outputs.folder(out) / file: data for file, data in named.items()}
    return written


def _draw(answer: Answer, place: Path) -> None:
    """Write every picture of an answer into a folder."""
    with style.style():
        for picture in answer.pictures():
            style.save(picture, place)


def _refuse_unknown(kind: Kind, named: Mapping[str, Any]) -> None:
    """Raise InputError for keywords that are not options, with the option, the method or the key of the case that was meant."""
    from pipeline.case.reading import nearest
    from pipeline.case.schema import TABLES

    lines = []
    for name in named.keys() - kind.options.keys() - {"progress"}:
        others = [each.name for each in _variants(kind) if name in each.options]
        why = f"no such option{nearest(name, kind.options)}"
        if others:
            why = f"an option of {others[0]}"
        elif any(name in table.model_fields for table in TABLES.values()):
            why = f"a key of the case: plate.with_({name}=...).{kind.name}()"
        lines.append(f"{kind.name}: {name} = {named[name]!r}: {why}")
    if lines:
        raise InputError(lines)


def _function(kind: Any) -> Any:
    def method(self: Any, *options: Any, **named: Any) -> Any:
        _refuse_unknown(kind, named)
        question = kind(*options, **named)
        return ask(self.case, question, self._log(question.progress))

    given = inspect.signature(kind)
    own = inspect.Parameter("self", inspect.Parameter.POSITIONAL_ONLY)
    method.__name__, method.__qualname__, method.__doc__ = kind.name, f"Plate.{kind.name}", numpydoc(kind)
    method.__annotations__ = {"return": kind.result}
    method.__signature__ = given.replace(  # type: ignore[attr-defined]
        parameters=[own, *sorted(given.parameters.values(), key=lambda each: each.name == "progress")],
        return_annotation=kind.result,
    )
    return method
