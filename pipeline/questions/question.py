"""Questions that a case can answer: one file each, with options, plan, computation and one result.

A question declares its options (`option`) and what it computes (`pipeline.questions.result`). Its command, its method of a
plate, its measure in studies and its reference page follow from that (`command`, `method`, `study`).
Only the standard library is imported here and at the head of a question's file, so that `antinode --help` stays quick; `late`
holds the modules that most of them compute and draw with.
"""

from __future__ import annotations

from contextlib import AbstractContextManager
from dataclasses import KW_ONLY, dataclass, field, fields
from functools import cache
from inspect import cleandoc
from math import inf, isfinite
from operator import index
from pathlib import Path
from types import NoneType
from typing import (
    TYPE_CHECKING,
    Any,
    ClassVar,
    Generic,
    Literal,
    Self,
    TypeVar,
    dataclass_transform,
    get_args,
    get_origin,
    get_type_hints,
)

from pipeline.errors import InputError
from pipeline.quantity import KHZ
from pipeline.questions.late import Case, Plan, Simplification, plans, resource_estimate
from pipeline.questions.result import Origin, Result
from pipeline.records.part import ABOUT, Axis, plain

if TYPE_CHECKING:
    from pathlib import Path

    from pipeline.logs import Log
    from pipeline.models.answer_parts import TargetMode
    from pipeline.records.record import MeshRecord

T = TypeVar("T")
R = TypeVar("R", bound=Result)
Pair = tuple[float, float]
ONE_OR_TWO = "F[:F]"  # metavar of a window of frequencies that a single one stands for, too
KINDS: dict[Any, str] = {
    Pair: "two rising numbers",
    int: "a whole number",
    float: "a number",
    bool: "True or False",
    str: "a text",
}
NO_PLAN: Any = None  # of a question answered by a formula
QUESTIONS: dict[str, type[Question[Any]]] = {}
VARIANTS: dict[str, type[Question[Any]]] = {}  # replace another question, whose command they share
IN_STUDIES: dict[str, type[Question[Any]]] = {}  # asked only by studies: no command and no method


# -- declarations ------------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Option:
    """Meaning and limits of an option; name, type and default are those of its field."""

    help: str  # in the help of the command, the method and the reference
    unit: str = ""  # with which its name ends (`band_kHz`), unlike its flag on the command line (`--band`)
    at_least: float = -inf  # of the number, or of each end of a band
    at_most: float = inf
    metavar: str = ""  # placeholder for its value in the help of the command
    or_infinite: bool = False  # whether the number may also be infinite
    flag: str = ""  # its name there, if different

    def fault(self, value: Any) -> str:
        """Return the requirement that a value violates, or '' for a valid one."""
        several = isinstance(value, tuple)
        numbers = [each for each in (value if several else (value,)) if isinstance(each, int | float)]
        if self.or_infinite:
            numbers = [each for each in numbers if each != inf]
        is_finite = all(map(isfinite, numbers))
        if not is_finite or not all(self.at_least <= each <= self.at_most for each in numbers):
            return self._limits(is_finite)
        return ""

    def _limits(self, is_finite: bool) -> str:
        if -inf < self.at_least == -self.at_most:
            return f"must be a number of at most {self.at_most:g} {self.unit}".rstrip()
        if not is_finite and not self.or_infinite:
            return "must be a finite number"
        most = f", at most {self.at_most:g}" if self.at_most < inf else ""
        return f"must be {self.at_least:g} or more{most}" + ", or inf" * self.or_infinite


def option(
    *,
    default: Any,
    help: str,
    unit: str = "",
    at_least: float = -inf,
    at_most: float = inf,
    metavar: str = "",
    or_infinite: bool = False,
    flag: str = "",
    kw_only: bool = True,
) -> Any:
    """Declare an option of a question with the fields of `Option`; kw_only=False if it may be positional."""
    about = Option(help, unit, at_least, at_most, metavar, or_infinite, flag)
    return field(default=default, kw_only=kw_only, metadata={ABOUT: about})


# -- runs --------------------------------------------------------------------------------------------------------------


@dataclass
class Run:
    """Context of a computation: a log, and data that several questions of one case share."""

    log: Log
    _: KW_ONLY
    # whether the answer is stored; otherwise it is only printed, and costly details may be skipped
    detailed: bool = True
    shapes: bool = False  # whether a page will animate the shapes
    folder: Path | None = None  # folder for files that accompany the answer
    all_fields: bool = False  # whether the field of every mode goes there
    asked_by: str = ""  # the command line
    warnings: list[str] = field(default_factory=list)
    meshes: list[MeshRecord] = field(default_factory=list)
    arrays: dict[str, Any] = field(default_factory=dict)  # arrays stored with the record
    solved: dict[str, Any] = field(default_factory=dict)  # left by one question for a later one of the same case
    found: dict[str, Any] = field(default_factory=dict)  # answers and parts of the record so far

    @property
    def target(self) -> TargetMode | None:
        """Target mode, if the plate's modes were computed before and contain one."""
        modes = self.found.get("modes")
        return modes.target if modes and modes.target and modes.target.is_found else None

    def info(self, text: str, id: str = "") -> None:
        """Log a fact."""
        self.log.info(text, id)

    def report(self, result: Result) -> None:
        """Log a result in words."""
        for line in result.lines():
            self.info(line)

    def left_out(self, what: str, why: str) -> None:
        """Log a simplification and its reason."""
        self.log.left_out(what, why)

    def warning(self, id: str, text: str) -> None:
        """Log a warning and keep it with the result."""
        self.warnings.append(f"{id}: {text}")
        self.log.warning(id, text)

    def step(self, name: str) -> AbstractContextManager[None]:
        """Time a step."""
        return self.log.step(name)


class Unanswered(Exception):
    """A question does not apply: the case lacks its subject, or this machine lacks the tools. Not an error."""


# -- questions ---------------------------------------------------------------------------------------------------------


@dataclass_transform(kw_only_default=True, frozen_default=True, field_specifiers=(option, field))
class Declared:
    """Make a frozen dataclass of each question and of shared options, also for type checkers."""

    def __init_subclass__(cls) -> None:
        super().__init_subclass__()
        dataclass(frozen=True, kw_only=True)(cls)


class Question(Declared, Generic[R]):
    """A question: options, plan and computation of one result. Its docstring is the help of command and method.

    A subclass of a question asks it in another way, as studies do (`in_study`).

    Questions are values: equal options make equal questions. progress: whether the method reports on standard error;
    None: in a terminal or a notebook. Class variables with a default are set by class keywords of the same names.
    """

    name: ClassVar[str]
    result: ClassVar[type[Result]]
    options: ClassVar[dict[str, Option]]
    needs: ClassVar[Axis] = ()  # tables and keys that a case must have
    example: ClassVar[str] = ""  # a command line
    drives: ClassVar[bool] = False  # whether it drives the plate
    # functions that draw a study's case from several answers, in place of the result's own
    pictures: ClassVar[Axis] = ()
    step: ClassVar[tuple[str, str]] = ("", "")  # for a plan of one step: what is computed, and by which model
    at_own_frequencies: ClassVar[bool] = False  # whether it takes moduli at the frequency of each figure
    is_quick: ClassVar[bool] = False  # whether a formula answers it, without a plan or a solver
    is_measure: ClassVar[bool] = True  # whether studies ask each case, with default options
    in_studies_only: ClassVar[bool] = False  # whether it has no command and no method
    aliases: ClassVar[Axis] = ()  # further names in study files; several questions may share one
    follows: ClassVar[str] = ""  # another question with which studies also ask this one, without a separate step
    after: ClassVar[str] = ""  # another question that a study must also ask, and whose answer this one uses
    family: ClassVar[str] = ""  # parent command, such as active in `antinode active mason`
    without_case: ClassVar[str | None] = None  # the study's case if none is given, "" for none; no study asks it
    instead_of: ClassVar[str] = ""  # the question whose command asks this one
    honours: ClassVar[Axis] = ()  # what it honours of `pipeline.case.features`
    by: ClassVar[str | Axis] = ()  # the option that selects it, or one of several
    progress: bool | None = field(default=None, compare=False, repr=False)

    def __init_subclass__(cls, **about: Any) -> None:
        known = {name: value for name, value in about.items() if name in Question.__annotations__}
        super().__init_subclass__(**{name: value for name, value in about.items() if name not in known})
        if Question not in cls.__bases__ and "instead_of" not in about:
            return  # a variant of the same question
        for name, value in known.items():
            setattr(cls, name, value)
        if cls.follows and "honours" not in known:
            cls.honours = (QUESTIONS | IN_STUDIES)[cls.follows].honours
        cls.name, cls.by = _snake_case(cls.__name__), (cls.by,) if isinstance(cls.by, str) else cls.by
        cls.is_measure = cls.is_measure and cls.without_case is None
        cls.options = {each.name: each.metadata[ABOUT] for each in fields(cls) if ABOUT in each.metadata}
        cls.example = about.get("example", f"{cls.name} studies/three-rows.toml")
        cls.result = next(get_args(each)[0] for each in cls.__orig_bases__ if get_origin(each) is Question)  # type: ignore[attr-defined]
        if cls.instead_of:
            VARIANTS[cls.name] = cls
            return
        if not cls.result.question:
            cls.result.question, cls.result.title = cls.name, cls.summary()
        (IN_STUDIES if cls.in_studies_only or cls.follows else QUESTIONS)[cls.name] = cls

    def __post_init__(self) -> None:
        faults = {f"{n} = {getattr(self, n)!r}": self._fault(n) for n in self.options}
        if any(faults.values()):
            raise InputError([f"{given}: {fault}" for given, fault in faults.items() if fault])
        for name in self.options:
            object.__setattr__(self, name, _as_kind(getattr(self, name), kind_of(type(self), name)))

    def _fault(self, name: str) -> str:
        """Return the requirement that an option violates, or ''."""
        value, kind, unit = getattr(self, name), kind_of(type(self), name), self.options[name].unit
        if value is None:
            return "" if NoneType in get_args(_hints(type(self))[name]) else f"must be {_in_words(kind)}"
        if get_origin(kind) is Literal and value not in get_args(kind):
            *first, last = get_args(kind)
            return f"must be {', '.join(first)} or {last}"
        try:
            read = _as_kind(value, kind)
            rising = kind != Pair or read[0] < read[1]
            return self.options[name].fault(read) or ("" if rising else f"must be {KINDS[Pair]}")
        except (TypeError, ValueError):
            return f"must be {_in_words(kind)}{f' in {unit}' if unit else ''}"

    @classmethod
    def summary(cls) -> str:
        """Return the first paragraph of the docstring, without its full stop."""
        return " ".join(cleandoc(cls.__doc__ or "").partition("\n\n")[0].split()).removesuffix(".")

    @classmethod
    def command(cls) -> str:
        """Return the words of its command."""
        return f"{cls.family} {cls.name.removeprefix(cls.family + '_')}" if cls.family else cls.name

    def given(self) -> dict[str, Any]:
        """Return the options by name, as JSON has them."""
        return {name: plain(getattr(self, name)) for name in self.options}

    # for subclasses to override

    def asked_of(self, case: Case) -> Case:
        """Return the case with the options that override its keys."""
        return case

    def honoured(self) -> Axis:
        """Return what these options honour of `pipeline.case.features`."""
        return self.honours

    def suited(self, case: Case | None) -> Any:
        """Return the case as it is asked of. Raises InputError for an unsuitable one."""
        about: Any = case and self.asked_of(case)
        if about:
            option = f" --{self.by[0].replace('_', '-')}" if self.instead_of and self.by else ""
            about.refuse((self.instead_of or self.name) + option, self.honoured())
        self.check(about)
        return about

    def check(self, case: Case) -> None:
        """Raise InputError for an unsuitable case; subclasses add conditions beyond `needs`."""
        command = self.instead_of or self.name
        if self.drives:
            case.require_plate(command)
        if self.needs:
            case.require(*self.needs, command=command)

    @property
    def is_own(self) -> bool:
        """Whether its result class belongs to it alone, not to a question about another part."""
        return self.result.question == self.name

    @classmethod
    def in_study(cls) -> Self | None:
        """Return the question as studies ask it; None if they do not."""
        return cls() if cls.is_measure else None

    @classmethod
    def inputs(cls) -> dict[str, Any]:
        """Return further inputs of the answer, besides case, sources and packages."""
        return {}

    @classmethod
    def spared(cls, case: Case) -> Simplification | None:
        """Return why a study does not ask this of a case, or None if it does."""
        return None

    def plan(self, case: Case) -> plans.Plan:
        """Plan `compute`: its steps, simplifications and resources; by default the single step named by `step`.

        Nothing is meshed or solved.
        """
        return plans.Plan(
            case.name if case else self.name,
            (plans.plain_step(self.name, self.step[0] or self.summary(), self.step[1]),),
            (),
        )

    def compute(self, case: Case, plan: Plan, run: Run) -> R:
        """Compute the answer as planned."""
        raise NotImplementedError


def ask(case: Case | None, question: Question[R], log: Log | Run) -> R:
    """Answer a question about a case.

    Parameters
    ----------
    case
        The case; None for a question that needs none.
    question
        The question with its options.
    log
        Receiver of progress; a `Run` is shared by several questions of one case.

    Raises
    ------
    InputError
        If the case lacks a table or key that the question needs.
    SolverError
        If a result fails its own checks.
    """
    from importlib.metadata import version

    from pipeline.case.limits import warn_of_moduli

    run = log if isinstance(log, Run) else Run(log)
    assert case is not None or question.without_case is not None
    about = question.suited(case)
    before = len(run.warnings)
    if about and not question.at_own_frequencies and about.solve.moduli_kHz is None:
        warn_of_moduli(about.materials, run)
    plan = NO_PLAN if question.is_quick else question.plan(about)
    if plan:
        announce(plan, run)
    result = question.compute(about, plan, run)
    seconds, warnings = dict(getattr(run.log, "seconds", {})), tuple(run.warnings[before:])
    named, given = (about.name, about.to_dict()) if about else (None, None)
    origin = Origin(named, given, version("antinode"), question.given(), warnings, seconds)
    object.__setattr__(result, "origin", origin)
    if about and result.plate_design is None:
        object.__setattr__(result, "plate_design", about.design)
    return result


def announce(plan: Plan, run: Run) -> None:
    """Log the simplifications and resources of each step. Raises InputError if a step exceeds this machine's memory."""
    for step in plan.steps:
        for each in step.left_out:
            run.left_out(each.what, each.why)
    for name, demand in plan.demands.items():
        resource_estimate.log_estimate(name, demand, run)


_hints: Any = cache(get_type_hints)


def kind_of(question: type[Question[Any]], name: str) -> Any:
    """Return the type of an option, without None."""
    hint = _hints(question)[name]
    return next(each for each in get_args(hint) if each is not NoneType) if NoneType in get_args(hint) else hint


def item_of(kind: Any) -> Any:
    """Return the type of the items of an option that may be given several times; None for another."""
    first, *rest = get_args(kind) or (None,)
    return first if rest == [...] else None


def _in_words(kind: Any) -> str:
    item = item_of(kind)
    return KINDS[kind] if item is None else "names" if item is str else f"{item.__name__.lower()}s"


def _as_kind(value: Any, kind: Any) -> Any:
    """Convert a value to its option's type. Raises TypeError or ValueError if that is impossible."""
    if value is None or get_origin(kind) is Literal:
        return value
    if kind == tuple[float, float]:
        low, high = value
        return float(low), float(high)
    if item := item_of(kind):
        return tuple(item(*each) if issubclass(item, tuple) else item(each) for each in value)
    return index(value) if kind is int else kind(value)


def _snake_case(name: str) -> str:
    return "".join(f"_{each.lower()}" if each.isupper() else each for each in name).lstrip("_")


def hz(band_kHz: Pair | None) -> Pair | None:
    """Return a band in Hz."""
    return None if band_kHz is None else (KHZ * band_kHz[0], KHZ * band_kHz[1])
