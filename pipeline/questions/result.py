"""Answer to a question: a part with a main table and figures, from which its other outputs follow."""

from __future__ import annotations

import base64
import io
import json
from collections.abc import Callable, Iterator, Mapping
from copy import deepcopy
from dataclasses import dataclass
from html import escape
from inspect import cleandoc
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar, Generic, Self, TypeVar, overload

from pipeline.questions.late import Axes, FloatArray, ReportFigure, named, np, outputs, style
from pipeline.records.part import DOCUMENT_SCHEMA, Axis, Part, part_of, rows_of

if TYPE_CHECKING:
    from pipeline.records.record import DesignRecord

T = TypeVar("T")
SHARES = (1.0, 1.15)  # widths of a drawing and of the shape next to it
BREAK = "\n\n"  # between the summary of a docstring and its sections
# source of a figure's error bar: property, path of a field or function of the result; relative for a frequency, else in
# the figure's unit
Bar = str | Callable[[Any], float | None]


@dataclass(frozen=True)
class Figure(Generic[T]):
    """Property that summarises the answer in one number: a column of every sweep, a headline of every report."""

    of: Callable[[Any], T]
    heading: str  # heading shown in tables, together with the unit
    unit: str | None = ""  # None for words, "" for a number without unit
    name: str = ""  # name of its column in table.csv, if different
    error: Bar = ""
    is_difference: bool = False  # whether it is a difference of frequencies, with an error bar in Hz
    is_signed: bool = False  # whether a plus sign is written

    @overload
    def __get__(self, result: None, owner: type) -> Self: ...
    @overload
    def __get__(self, result: object, owner: type) -> T: ...
    def __get__(self, result: object, owner: type) -> Self | T:
        return self if result is None else self.of(result)


def figure(
    heading: str,
    unit: str | None = "",
    *,
    name: str = "",
    error: Bar = "",
    is_difference: bool = False,
    is_signed: bool = False,
) -> Callable[[Callable[[Any], T]], Figure[T]]:
    """Declare a figure of a result with the fields of `Figure`: a property, None where it is undefined."""
    return lambda of: Figure(of, heading, unit, name, error, is_difference, is_signed)


def figure_at(
    place: str,
    heading: str,
    unit: str | None = "",
    *,
    scale: float = 1.0,
    name: str = "",
    error: Bar | None = None,
    is_difference: bool = False,
    is_signed: bool = False,
) -> Figure[Any]:
    """Declare a figure that is a field of one of the result's parts, by its path, with the field's error bar.

    scale: size of its unit in that of the field, such as 1e-6 for a length in um. error: as in `figure`.
    """

    def value(result: Any) -> Any:
        return scaled(reach(result, place), scale)

    def bar(result: Any) -> float | None:
        way, _, own = place.rpartition(".")
        part = reach(result, way) if way else result
        about = part.declared.get(own) if part is not None else None
        return scaled(getattr(part, about.error), scale) if about and about.error else None

    return Figure(value, heading, unit, name, bar if error is None else error, is_difference, is_signed)


class stacked(property):
    """Property with a column of the main table as an array over its axes; NaN for missing values."""

    def __init__(self, name: str, about: str) -> None:
        super().__init__(lambda result: result.array(name))
        self.__doc__ = about  # an argument `doc` would not override that of the class

    if TYPE_CHECKING:

        def __get__(self, result: Any, owner: type | None = None) -> FloatArray: ...  # type: ignore[override]


def scaled(value: Any, scale: float) -> Any:
    """Divide a value by a unit, such as 1e-6 for a length in um; None stays None."""
    return value if value is None or scale == 1.0 else value / scale


def reach(part: Any, place: str) -> Any:
    """Return the value at a path such as "target.frequency_hz"; None if a part along the path is missing."""
    for name in place.split("."):
        part = part.get(name) if isinstance(part, Mapping) else None if part is None else getattr(part, name)
    return part


@dataclass(frozen=True)
class Origin:
    """Origin of a result: case with defaults, the question's options, version, warnings, seconds per step."""

    case: str | None
    with_defaults: dict[str, Any] | None
    version: str
    options: dict[str, Any]
    warnings: tuple[str, ...]
    seconds: dict[str, float]


class Result(Part):
    """Answer to a question: declared columns and figures, which subclasses also describe and draw.

    Class keywords: `axes` of the main table, which --csv writes and `to_dataframe` returns, the slowest first; `table`, the
    field whose items run along the first of them. A column of an item stands in the table when all its axes are among these, as
    does a list of the result itself.
    """

    title: ClassVar[str] = ""  # the question in words; set by the question
    moves: ClassVar[str] = ""  # function of the report that makes its interactive part for a notebook
    table: ClassVar[str] = ""
    axes: ClassVar[Axis] = ()
    figures: ClassVar[dict[str, Figure[Any]]] = {}
    origin: ClassVar[Origin | None] = None  # of each instance, set where it is computed or read
    arrays: ClassVar[Mapping[str, Any]] = {}  # of each instance: arrays for pictures, stored with the record
    plate_design: ClassVar[Any] = None  # of each instance: the case's DesignRecord, if pictures need it

    def __init_subclass__(cls, *, axes: Axis, table: str = "") -> None:
        super().__init_subclass__()
        cls.table, cls.axes = table, axes
        cls.figures = {name: each for name, each in vars(cls).items() if isinstance(each, Figure)}
        for name in ("lines", "details", "draw", "illustrate", "pictures", "to_rows"):
            own, of_all = vars(cls).get(name), cleandoc(getattr(Result, name).__doc__)
            if own:  # an overriding method says what differs; its parameters and returns are those of all results
                own.__doc__ = f"{cleandoc(own.__doc__)}\n\n{of_all.partition(BREAK)[2]}\n"

    # for subclasses to override

    def lines(self) -> Iterator[str]:
        """Yield the result in words, for the terminal and the report.

        Yields
        ------
        str
            A line of text, or a table of several lines.
        """
        yield from ()

    def details(self) -> Iterator[str]:
        """Yield the lines that `--verbose` adds.

        Yields
        ------
        str
            A line of text.
        """
        yield from ()

    def draw(self, ax: Axes) -> None:
        """Draw the result into matplotlib axes.

        Parameters
        ----------
        ax : Axes
            Axes to draw in.
        """
        raise NotImplementedError

    @property
    def has_shape(self) -> bool:
        """Whether `illustrate` can draw the thing itself."""
        return False

    def illustrate(self, ax: Axes) -> None:
        """Draw the thing itself, such as a mode shape, next to the drawing of `draw`.

        Parameters
        ----------
        ax : Axes
            Axes to draw in.
        """
        raise NotImplementedError

    def pictures(self) -> list[ReportFigure]:
        """Return the pictures for a report and `--out`: that of `draw`, unless a subclass has more.

        Returns
        -------
        list of ReportFigure
            Matplotlib figures, each with its title and its description in words.
        """
        return [style.ReportFigure(self.question, self.title, " ".join(self.lines()), self.as_figure(), vector=True)]

    # derived outputs

    def reading(self, without: Axis = (), most: int = 0) -> str:
        """Format the main table for reading.

        Parameters
        ----------
        without : tuple of str, optional
            Columns to leave out.
        most : int, optional
            Approximate number of rows after even thinning; 0 keeps every row.

        Returns
        -------
        str
            The table as aligned text.
        """
        rows = [{name: value for name, value in row.items() if name not in without} for row in self.to_rows()]
        step = max(1, len(rows) // most) if most else 1
        return outputs.reading_table(tuple(rows[0]), [[*row.values()] for row in rows[::step]])

    def with_arrays(self, arrays: Mapping[str, Any], design: DesignRecord | None = None) -> Self:
        """Attach the arrays and the design from which pictures are drawn.

        Parameters
        ----------
        arrays : mapping
            Arrays by name, as stored with the record.
        design : DesignRecord, optional
            Design of the case.

        Returns
        -------
        Result
            The result itself.
        """
        object.__setattr__(self, "arrays", arrays)
        object.__setattr__(self, "plate_design", design)
        return self

    def to_rows(self) -> list[dict[str, Any]]:
        """Return the main table.

        Returns
        -------
        list of dict
            One dictionary of plain values per row, with the units in the names.
        """
        return rows_of(self, self.table, self.axes)

    @classmethod
    def heading(cls) -> list[str]:
        """Return the column names of the main table, which also hold for an empty one.

        Returns
        -------
        list of str
            Names with their units.
        """
        kind = part_of(cls, cls.table) if cls.table else cls
        inner = set(cls.axes[1:] if cls.table else cls.axes)
        own = [each.name or name for name, each in kind.declared.items() if each.table and set(each.along) <= inner]
        return [*cls.axes[:1], *own] if cls.table and cls.axes[0] not in own else own

    def array(self, name: str) -> np.ndarray:
        """Return a column as an array over the axes of the main table.

        Parameters
        ----------
        name : str
            Field of the result, or of the items of its main table.

        Returns
        -------
        ndarray
            Array of shape (axis, ...) over the axes of the main table, in the unit of the name; NaN for missing values.
        """
        items: list[Part] = getattr(self, self.table) if self.table else [self]
        values = [getattr(item, name) for item in items]
        along = items[0].declared[name].along if items else ()
        size = max((_length(item, along) for item in items), default=0)
        filled = [([np.nan] * size if along and not value else value) for value in values]
        return np.array(filled if self.table else filled[0], dtype=float)

    def to_dataframe(self) -> Any:
        """Return the main table as a pandas DataFrame.

        Returns
        -------
        DataFrame
            The rows of `to_rows`, with the units in the names of the columns.

        Raises
        ------
        ImportError
            Without pandas.
        """
        return outputs.frame(self.to_rows(), self.heading())

    def to_xarray(self) -> Any:
        """Return the main table as an xarray Dataset over its axes.

        Returns
        -------
        Dataset
            One variable per column, with its unit in the attribute `units`.

        Raises
        ------
        ImportError
            Without pandas and xarray (`pip install 'antinode[tables]'`).
        """
        rows = self.to_rows()
        held = [axis for axis in self.axes if rows and axis in rows[0]]
        return outputs.dataset(rows, held)

    def to_dict(self) -> dict[str, Any]:
        """Return the JSON document that `--json` writes.

        Returns
        -------
        dict
            The declared fields, with the case, the version, the options, the warnings and the seconds of each step.
        """
        about = self.origin
        if about is None:
            return {"schema": DOCUMENT_SCHEMA, "kind": self.question, **self.values()}
        head = {"case": about.case, "with_defaults": deepcopy(about.with_defaults), "version": about.version}
        more = {"options": dict(about.options), "warnings": list(about.warnings), "seconds": about.seconds}
        return {"schema": DOCUMENT_SCHEMA, "kind": self.question, **head, **self.values(), **more}

    @classmethod
    def from_document(cls, document: Mapping[str, Any]) -> Self:
        """Read the result from a document of `to_dict` or `--json`.

        Parameters
        ----------
        document : mapping
            The document.

        Returns
        -------
        Result
            The result, without the fields that exist only in memory.

        Raises
        ------
        pydantic.ValidationError
            For a damaged document.
        """
        read = cls.from_dict({name: document[name] for name in cls.declared if name in document})
        head = {name: document.get(name) for name in ("case", "with_defaults", "version")}
        more = {"options": document.get("options") or {}, "seconds": document.get("seconds") or {}}
        object.__setattr__(read, "origin", Origin(**head, **more, warnings=tuple(document.get("warnings") or ())))  # type: ignore[arg-type]
        return read

    def save(self, path: str | Path) -> Path:
        """Write the document as JSON, atomically; `antinode.open` reads it back.

        Parameters
        ----------
        path : str or Path
            File to write.

        Returns
        -------
        Path
            The written file.
        """
        from pipeline.records.outputs import write_file

        write_file(Path(path), (json.dumps(self.to_dict(), indent=1, allow_nan=False) + "\n").encode())
        return Path(path)

    def plot(self, ax: Axes | None = None) -> Axes:
        """Draw into matplotlib axes.

        Parameters
        ----------
        ax : Axes, optional
            Axes to draw in; by default those of a new figure, which also shows the thing itself where the result has a shape.

        Returns
        -------
        Axes
            The axes.
        """
        with style.style():
            if ax is None and self.has_shape:
                ax, shape = style.panels(3.6, 1, 2, width_ratios=SHARES)[1]
                self.illustrate(shape)
            drawn: Axes = style.panels(3.6)[1] if ax is None else ax
            self.draw(drawn)
        return drawn

    def as_figure(self) -> Any:
        """Return the drawing of `plot` as a separate matplotlib figure.

        Returns
        -------
        Figure
            The figure.
        """
        return self.plot().figure

    def __str__(self) -> str:
        return "\n".join(self.lines()) or repr(self)

    def _repr_html_(self) -> str:
        """Return the result in words, its picture and what moves of it, for a notebook."""
        out, words = io.BytesIO(), escape(repr(self))
        self.as_figure().savefig(out, format="png", dpi=110, bbox_inches="tight")
        data = base64.b64encode(out.getvalue()).decode()
        return f'<p>{words}</p><img alt="{words}" src="data:image/png;base64,{data}">{self._moving()}'

    def _moving(self) -> str:
        """Return the interactive part for a notebook, made by the function of the report that `moves` names."""
        return str(named(self.moves)(self)) if self.moves else ""


def _length(part: Part, along: Axis) -> int:
    """Return the number of entries of a part's columns along some axes."""
    known = [getattr(part, name) for name, each in part.declared.items() if along and each.along == along]
    return max((len(value) for value in known if value), default=0)
