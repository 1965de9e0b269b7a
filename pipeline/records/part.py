"""Parts of answers, declared once: `column` describes each field, from which tables, documents and readers follow.

A part is a frozen dataclass of plain values, laid out as its JSON document. Only the standard library is imported here, so that
the help of a command stays quick.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import MISSING, FrozenInstanceError, dataclass, field, fields, is_dataclass
from functools import cache
from inspect import cleandoc
from itertools import product
from math import isfinite
from pathlib import Path
from typing import Any, ClassVar, Self, dataclass_transform, get_args, get_type_hints

DOCUMENT_SCHEMA = 2  # of JSON documents and of a study's list of cases
ABOUT, LIVE = "about", "live"
BAR = "error bar of {} (half-width); None without an estimate"  # description of an error bar's column
Axis = tuple[str, ...]


# -- declarations ------------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Column:
    """Description of a field, for the reference and for xarray's attributes, and its place in tables."""

    about: str
    unit: str = ""
    along: Axis = ()  # axes of its lists, the slowest first; a field named like its axis contains the axis values
    name: str = ""  # name of its column in tables, if different
    error: str = ""  # field with its error bar (half-width)
    parts: Axis = ()  # column names for the entries of one more axis, such as real and imaginary part
    table: bool = True  # whether it appears in tables
    spread: bool = False  # of a part: whether its columns appear in the table


def column(
    about: str,
    unit: str = "",
    *,
    along: str | Axis = (),
    name: str = "",
    error: str = "",
    parts: Axis = (),
    table: bool = True,
    spread: bool = False,
    default: Any = MISSING,
    default_factory: Any = MISSING,
) -> Any:
    """Declare a field of a part with the fields of `Column`; default, default_factory: as in `dataclasses.field`."""
    axes = (along,) if isinstance(along, str) else along
    declared = Column(about, unit, axes, name, error, parts, table, spread)
    return field(default=default, default_factory=default_factory, metadata={ABOUT: declared})


def bar(of: str, unit: str = "", **options: Any) -> Any:
    """Declare the error bar of a field (half-width), None without an estimate. Options as in `column`."""
    return column(BAR.format(of), unit, **{"default": None} | options)


def live(about: str, unit: str = "", *, default: Any = None, default_factory: Any = MISSING) -> Any:
    """Declare a field that exists only in memory: shapes, a solved model. A result read from a file lacks it."""
    given = {"default": default} if default_factory is MISSING else {"default_factory": default_factory}
    return field(**given, compare=False, repr=False, metadata={LIVE: Column(about, unit)})


def sentence(about: str, unit: str = "") -> str:
    """Return a description as a sentence, with its unit before the first semicolon."""
    first, semicolon, rest = about.partition(";")
    head = first[:1].upper() + first[1:] if first.partition(" ")[0].rstrip(",:").isalpha() else first
    return f"{head}{unit and f', in {unit}'}{semicolon}{rest}."


class Frozen:
    """Immutable object: no public attribute can be set or removed."""

    def __setattr__(self, name: str, value: Any) -> None:
        if not name.startswith("_"):
            raise FrozenInstanceError(f"cannot assign to {name!r}: a {type(self).__name__} is immutable")
        object.__setattr__(self, name, value)

    def __delattr__(self, name: str) -> None:
        raise FrozenInstanceError(f"cannot delete {name!r}: a {type(self).__name__} is immutable")


# -- parts -------------------------------------------------------------------------------------------------------------


@dataclass_transform(kw_only_default=True, frozen_default=True, field_specifiers=(bar, column, live))
class Part:
    """A part of a result: frozen fields of plain values. NaN becomes None, arrays lists, complex numbers pairs."""

    question: ClassVar[str] = ""  # the question that it answers; set by the question
    __pydantic_config__: ClassVar[dict[str, Any]] = {"extra": "forbid"}  # type: ignore[misc]
    declared: ClassVar[dict[str, Column]] = {}

    def __init_subclass__(cls) -> None:
        dataclass(frozen=True, kw_only=True)(cls)
        cls.declared = {each.name: each.metadata[ABOUT] for each in fields(cls) if ABOUT in each.metadata}  # type: ignore[arg-type]
        cls.__doc__ = _documented(cls)

    def __post_init__(self) -> None:
        for name in self.declared:
            object.__setattr__(self, name, plain(getattr(self, name)))

    @classmethod
    def of(cls, source: Any, **more: Any) -> Self:
        """Build the part from an object's fields of the same names, and more.

        Parameters
        ----------
        source : object
            Object whose attributes are taken.
        **more : object
            Further fields, which take precedence.

        Returns
        -------
        Part
            The part.
        """
        known = {name: getattr(source, name) for name in cls.declared if name not in more and hasattr(source, name)}
        return cls(**known, **more)

    @classmethod
    def from_dict(cls, given: Mapping[str, Any]) -> Self:
        """Read the part that `to_dict` wrote.

        Parameters
        ----------
        given : mapping
            JSON values by field.

        Returns
        -------
        Part
            The part, without the fields that exist only in memory.

        Raises
        ------
        pydantic.ValidationError
            For missing or unknown fields.
        """
        read: Self = _reader(cls).validate_python(dict(given))  # type: ignore[arg-type]
        return read

    @classmethod
    def required(cls) -> set[str]:
        """Return the names of the fields that every such part has.

        Returns
        -------
        set of str
            Declared fields without a default.
        """
        given = {each.name: each for each in fields(cls)}  # type: ignore[arg-type]
        return {n for n in cls.declared if given[n].default is MISSING and given[n].default_factory is MISSING}

    def stored(self) -> Self:
        """Return the part as read back from a file.

        Returns
        -------
        Part
            Copy with the declared fields, without those that exist only in memory.
        """
        return type(self).from_dict(self.values())

    def to_dict(self) -> dict[str, Any]:
        """Return the declared fields as JSON values.

        Returns
        -------
        dict
            JSON values by field.
        """
        return self.values()

    def values(self) -> dict[str, Any]:
        """Return the declared fields as JSON values.

        Returns
        -------
        dict
            JSON values by field, also for results, whose `to_dict` adds their origin.
        """
        return {name: _written(getattr(self, name)) for name in self.declared}


def _documented(kind: type[Part]) -> str:
    """Return the docstring of a part with its fields as parameters, from their declarations, before the examples."""
    text, _, examples = cleandoc(kind.__doc__ or "").partition("\n>>> ")
    lines = [text.rstrip(), "", "Parameters", "----------"]
    for each in fields(kind):  # type: ignore[arg-type]
        about = each.metadata[ABOUT if ABOUT in each.metadata else LIVE]
        may_lack = each.default is not MISSING or each.default_factory is not MISSING
        lines.append(f"{each.name} : {str(each.type).replace(' | ', ' or ')}{', optional' * may_lack}")
        lines.append(f"    {sentence(about.about, about.unit)}")
    shown = ["", "Examples", "--------", f">>> {examples}"] if examples else []
    return "\n".join([*lines, *shown, ""])


@cache
def _reader(kind: type[Part]) -> Any:
    from pydantic import TypeAdapter

    return TypeAdapter(kind)


def part_of(kind: type[Part], name: str) -> type[Part]:
    """Return the class of the part in a field, directly or as the items of a list."""
    hint = get_type_hints(kind)[name]
    held: type[Part] = next((each for each in get_args(hint) if isinstance(each, type)), hint)
    return held


def plain(given: Any) -> Any:
    """Convert a value to JSON, parts unchanged: None for NaN, lists for arrays, pairs for complex numbers."""
    if isinstance(given, str | bool | int | Part) or given is None:
        return given
    if isinstance(given, float):
        return float(given) if isfinite(given) else None
    if hasattr(given, "tolist"):
        return plain(given.tolist())
    if isinstance(given, complex):
        return [plain(given.real), plain(given.imag)]
    if is_dataclass(given):
        return {each.name: plain(getattr(given, each.name)) for each in fields(given)}
    if isinstance(given, Path):
        return given.as_posix()
    if isinstance(given, Mapping):
        return {str(key): plain(value) for key, value in given.items()}
    return [plain(each) for each in given] if isinstance(given, Sequence) else given


def _written(value: Any) -> Any:
    if isinstance(value, Part):
        return value.values()
    if isinstance(value, list):
        return [_written(each) for each in value]
    return {key: _written(each) for key, each in value.items()} if isinstance(value, dict) else value


# -- tables ------------------------------------------------------------------------------------------------------------


def rows_of(whole: Part, table: str, axes: Axis) -> list[dict[str, Any]]:
    """Return a table as dictionaries of plain values, one per row.

    Parameters
    ----------
    whole
        The part that contains the table.
    table
        The field whose items run along the first axis; "" where its own lists run along the axes.
    axes
        Axes of the table, the slowest first. A column of an item stands in the table when all its axes are among these, and so
        does a list of the whole along them. An axis without a column of its name is counted from 1.
    """
    items: list[Part] = getattr(whole, table) if table else [whole]
    inner = axes[1:] if table else axes
    shared = [each for each in _table_columns(whole, inner) if each[2].along or not axes]
    rows = []
    for number, item in enumerate(items, start=1):
        columns = [*shared, *(_table_columns(item, inner) if table else ())]
        numbered = {axes[0]: number} if table and axes[0] not in {name for _, name, _ in columns} else {}
        rows += [numbered | row for row in _expanded(columns, inner)]
    return rows


Entry = tuple["Part | None", str, Column]  # part of the column (None: all cells are None), name, description


def _table_columns(part: Part, inner: Axis) -> list[Entry]:
    """Return the columns of a part in a table over these axes, without its parts and lists along other axes."""
    out: list[Entry] = []
    for name, about in part.declared.items():
        if about.spread:
            own = part_of(type(part), name).declared.items()
            out += [(getattr(part, name), each, what) for each, what in own]
        elif _fits(getattr(part, name), about, set(inner)):
            out.append((part, name, about))
    return out


def _fits(value: Any, about: Column, axes: set[str]) -> bool:
    if not about.table or not set(about.along) <= axes:
        return False
    single = about.along or about.parts
    return not isinstance(value, Part | dict) and (bool(single) or not isinstance(value, list))


def _expanded(columns: list[Entry], inner: Axis) -> Iterator[dict[str, Any]]:
    """Yield the rows of one item: one row per entry along the axis, other values repeated."""
    sizes: dict[str, int] = {}
    for part, name, about in columns:
        value = getattr(part, name, None)
        for axis in about.along:
            if value is not None:
                sizes.setdefault(axis, len(value))
                value = value[0] if value else None
    named = {name for _, name, _ in columns}
    for index in product(*(range(sizes.get(axis, 0)) for axis in inner)):
        at = dict(zip(inner, index, strict=True))
        row: dict[str, Any] = {}
        for part, name, about in columns:
            row |= {axis: at[axis] + 1 for axis in about.along if axis not in named and axis not in row}
            row |= _cells(_entry(getattr(part, name, None), [at[axis] for axis in about.along]), name, about)
        yield row


def _entry(value: Any, index: Sequence[int]) -> Any:
    for place in index:
        value = value[place] if value else None  # an empty list was not computed
    return value


def _cells(value: Any, name: str, about: Column) -> dict[str, Any]:
    if not about.parts:
        return {about.name or name: value}
    return dict(zip(about.parts, value or [None] * len(about.parts), strict=True))
