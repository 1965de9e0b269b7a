"""Questions that can be asked of a case: one file each, with options, plan, computation and one result.

A question declares its options (`option`) and what it computes (`pipeline.questions.result`). Its command, its method of a
plate, its measure in studies and its page of the reference follow from that (`command`, `method`, `pipeline.measures.asked`).
Only the standard library is imported here and at the head of a question's file, so that `antinode --help` stays quick.
"""

from __future__ import annotations

from contextlib import AbstractContextManager
from dataclasses import dataclass, field, fields
from inspect import cleandoc
from math import inf, isfinite
from operator import index
from types import NoneType
from typing import (
    TYPE_CHECKING,
    Any,
    ClassVar,
    Generic,
    Literal,
    TypeVar,
    dataclass_transform,
    get_args,
    get_origin,
    get_type_hints,
)

from pipeline.errors import InputError
from pipeline.questions.result import Origin, Result
from pipeline.records.part import ABOUT, Axis, plain
from pipeline.units import KHZ

if TYPE_CHECKING:
    from pathlib import Path

    from pipeline.case.model import Case
    from pipeline.logs import Log
    from pipeline.planning.plan import Plan
    from pipeline.planning.simplifications import Simplification
    from pipeline.records.record import MeshRecord

T = TypeVar("T")
R = TypeVar("R", bound=Result)
Pair = tuple[float, float]
KINDS = {tuple[float, float]: "two rising numbers", tuple[str, ...]: "names", int: "a whole number", float: "a number",
         bool: "True or False", str: "a text"}  # fmt: skip
NO_PLAN: Any = None  # of a question that is answered at once
QUESTIONS: dict[str, type[Question[Any]]] = {}
VARIANTS: dict[str, type[Question[Any]]] = {}  # asked in the place of another, whose command they share


# -- declarations ------------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Option:
    """What an option means and its limits; name, type and default are those of the field that it is declared for."""

    help: str
    unit: str = ""
    at_least: float = -inf
    at_most: float = inf
    metavar: str = ""
    flag: str = ""

    def fault(self, value: Any) -> str:
        """Return what a value of this option must be, or '' for a good one."""
        pair = isinstance(value, tuple)
        numbers = [each for each in (value if pair else (value,)) if isinstance(each, int | float)]
        is_finite = all(map(isfinite, numbers))
        if not is_finite or not all(self.at_least <= each <= self.at_most for each in numbers):
            return self._limits(is_finite)
        return "must be two rising numbers" if pair and len(numbers) == 2 and numbers[0] >= numbers[1] else ""

    def _limits(self, is_finite: bool) -> str:
        if -inf < self.at_least == -self.at_most:
            return f"must be a number of at most {self.at_most:g} {self.unit}".rstrip()
        if not is_finite:
            return "must be a finite number"
        return f"must be {self.at_least:g} or more" + (f", at most {self.at_most:g}" if self.at_most < inf else "")


def option(
    *, default: Any, help: str, unit: str = "", at_least: float = -inf, at_most: float = inf, metavar: str = "",
    flag: str = "", kw_only: bool = True,
) -> Any:  # fmt: skip
    """Declare an option of a question.

    Parameters
    ----------
    default
        Its value where none is given.
    help
        What it is, in the help of the command, the method and the reference.
    unit
        Its unit, in which its name ends (`band_kHz`); its flag on the command line does not (`--band`).
    at_least, at_most
        Limits of the number, or of each end of a band.
    metavar
        What stands for its value in the help of the command.
    flag
        Its name there, where that is not its own.
    kw_only
        False for an option that the method also takes by position.
    """
    return field(
        default=default, kw_only=kw_only, metadata={ABOUT: Option(help, unit, at_least, at_most, metavar, flag)}
    )


# -- runs --------------------------------------------------------------------------------------------------------------


class Run:
    """What a computation uses of its surroundings: a log, and what several questions of one case share.

    detailed: whether someone keeps the answer; else it is only printed, and costly details may be left out. shapes: whether a
    page will show moving shapes. folder: where files beside the answer go; None: nowhere. meshes, arrays: what was meshed, and
    arrays that are kept beside the record. solved: what one question has solved and another of the same case can go on from, by
    name.
    """

    def __init__(self, log: Log, *, detailed: bool = True, shapes: bool = False, folder: Path | None = None) -> None:
        self.log, self.detailed, self.shapes, self.folder = log, detailed, shapes, folder
        self.warnings: list[str] = []
        self.meshes: list[MeshRecord] = []
        self.arrays: dict[str, Any] = {}
        self.solved: dict[str, Any] = {}

    def info(self, text: str, id: str = "") -> None:
        """Log a fact."""
        self.log.info(text, id)

    def left_out(self, what: str, why: str) -> None:
        """Log what the case does not need."""
        self.log.left_out(what, why)

    def warning(self, id: str, text: str) -> None:
        """Log a warning and keep it with the result."""
        self.warnings.append(f"{id}: {text}")
        self.log.warning(id, text)

    def step(self, name: str) -> AbstractContextManager[None]:
        """Time a step."""
        return self.log.step(name)


# -- questions ---------------------------------------------------------------------------------------------------------


@dataclass_transform(kw_only_default=True, frozen_default=True, field_specifiers=(option, field))
class _Declared:
    """Makes a frozen dataclass of each question, for type checkers, too."""

    def __init_subclass__(cls) -> None:
        super().__init_subclass__()
        dataclass(frozen=True, kw_only=True)(cls)


class Question(_Declared, Generic[R]):
    """A question: options, plan and computation of one result. Its docstring is the help of command and method.

    Questions are values: equal options make equal questions. progress: whether the method reports on standard error; None: in a
    terminal or a notebook. Class keywords:

    needs : tables and keys that a case must have.
    example : a command line.
    drives : whether it drives the plate.
    pictures : functions that draw a study's case from several answers together, in the place of the result's own.
    instead_of, by : the question whose command asks this one where its option `by` is given.
    is_quick : whether it is answered by a formula: no plan is made before and no solver is loaded.
    """

    name: ClassVar[str]
    needs: ClassVar[Axis]
    example: ClassVar[str]
    drives: ClassVar[bool]
    pictures: ClassVar[Axis]
    instead_of: ClassVar[str]
    by: ClassVar[str]
    is_quick: ClassVar[bool]
    result: ClassVar[type[Result]]
    options: ClassVar[dict[str, Option]]
    progress: bool | None = field(default=None, compare=False, repr=False)

    def __init_subclass__(
        cls, *, needs: Axis = (), example: str = "", drives: bool = False, pictures: Axis = (), instead_of: str = "",
        by: str = "", is_quick: bool = False,
    ) -> None:  # fmt: skip
        super().__init_subclass__()
        cls.name, cls.needs, cls.drives, cls.pictures = _snake_case(cls.__name__), needs, drives, pictures
        cls.instead_of, cls.by, cls.is_quick = instead_of, by, is_quick
        cls.options = {each.name: each.metadata[ABOUT] for each in fields(cls) if ABOUT in each.metadata}
        cls.example = example or f"{cls.name} studies/three-rows.toml"
        cls.result = get_args(cls.__orig_bases__[0])[0]  # type: ignore[attr-defined]
        if instead_of:
            VARIANTS[cls.name] = cls
            return
        cls.result.question, cls.result.title = cls.name, cls.summary()
        QUESTIONS[cls.name] = cls

    def __post_init__(self) -> None:
        faults = {f"{n} = {getattr(self, n)!r}": self._fault(n) for n in self.options}
        if any(faults.values()):
            raise InputError([f"{given}: {fault}" for given, fault in faults.items() if fault])
        for name in self.options:
            object.__setattr__(self, name, _as_kind(getattr(self, name), kind_of(type(self), name)))

    def _fault(self, name: str) -> str:
        """Return what an option must be, or '' where it is so."""
        value, kind = getattr(self, name), kind_of(type(self), name)
        if value is None:
            return "" if NoneType in get_args(get_type_hints(type(self))[name]) else f"must be {KINDS[kind]}"
        if get_origin(kind) is Literal and value not in get_args(kind):
            *first, last = get_args(kind)
            return f"must be {', '.join(first)} or {last}"
        try:
            return self.options[name].fault(_as_kind(value, kind))
        except (TypeError, ValueError):
            return f"must be {KINDS[kind]}"

    @classmethod
    def summary(cls) -> str:
        """Return the first paragraph of the docstring, without its full stop."""
        return " ".join(cleandoc(cls.__doc__ or "").partition("\n\n")[0].split()).removesuffix(".")

    def given(self) -> dict[str, Any]:
        """Return the options by name, as JSON has them."""
        return {name: plain(getattr(self, name)) for name in self.options}

    # what subclasses say

    def check(self, case: Case) -> None:
        """Raise InputError for a case that cannot answer; subclasses add what `needs` cannot say."""
        case.require(*self.needs, command=self.name)

    @classmethod
    def spared(cls, case: Case) -> Simplification | None:
        """Return why a study does not ask this of a case, None where it does."""
        return None

    def plan(self, case: Case) -> Plan:
        """Return what `compute` will do, what it leaves out and what that takes. Nothing is meshed or solved."""
        from pipeline.planning.plan import Plan, plain_step

        return Plan(case.name, (plain_step(self.name, self.summary(), ""),), ())

    def compute(self, case: Case, plan: Plan, run: Run) -> R:
        """Return the answer, by the decisions of the plan."""
        raise NotImplementedError


def ask(case: Case, question: Question[R], log: Log | Run) -> R:
    """Return the answer of a case to a question.

    Parameters
    ----------
    case
        The case.
    question
        The question with its options.
    log
        Where progress goes; a `Run` is shared by several questions of one case.

    Raises
    ------
    InputError
        Where the case lacks what the question needs.
    SolverError
        Where a result could not be trusted.
    """
    from importlib.metadata import version

    run = log if isinstance(log, Run) else Run(log)
    question.check(case)
    before = len(run.warnings)
    plan = NO_PLAN if question.is_quick else question.plan(case)
    if plan:
        announce(plan, run)
    result = question.compute(case, plan, run)
    seconds, warnings = dict(getattr(run.log, "seconds", {})), tuple(run.warnings[before:])
    origin = Origin(case.name, case.to_dict(), version("antinode"), question.given(), warnings, seconds)
    object.__setattr__(result, "origin", origin)
    return result


def announce(plan: Plan, run: Run) -> None:
    """Log what each step leaves out and takes. Raises InputError where this machine cannot hold a step."""
    from pipeline.planning import foresight

    for step in plan.steps:
        for each in step.left_out:
            run.left_out(each.what, each.why)
    for name, demand in plan.demands.items():
        foresight.announce(name, demand, run)


def kind_of(question: type[Question[Any]], name: str) -> Any:
    """Return the type of an option, without None."""
    hint = get_type_hints(question)[name]
    return next(each for each in get_args(hint) if each is not NoneType) if NoneType in get_args(hint) else hint


def _as_kind(value: Any, kind: Any) -> Any:
    """Return a value as its option's type. Raises TypeError or ValueError for one that is of another."""
    if value is None or get_origin(kind) is Literal:
        return value
    if kind == tuple[float, float]:
        low, high = value
        return float(low), float(high)
    if kind == tuple[str, ...]:
        return tuple(map(str, value))
    return index(value) if kind is int else kind(value)


def _snake_case(name: str) -> str:
    return "".join(f"_{each.lower()}" if each.isupper() else each for each in name).lstrip("_")


def hz(band_kHz: Pair | None) -> Pair | None:
    """Return a band in Hz."""
    return None if band_kHz is None else (KHZ * band_kHz[0], KHZ * band_kHz[1])
