"""Resumable sweeps of one plate over a grid of values, run by the batch engine in the caller's process."""

from __future__ import annotations

import csv
import io
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from html import escape
from math import nan, prod
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, TypeVar

from pydantic import ValidationError

from antinode.plate import Plate, key_of, log_of, plain, portable
from pipeline import paths
from pipeline.errors import CheckFailed, InputError
from pipeline.process import terminable
from pipeline.questions import registered
from pipeline.questions.result import Result
from pipeline.records import store
from pipeline.records.outputs import csv_bytes, dataset, frame, html_table, reading_table, write_file
from pipeline.records.part import DOCUMENT_SCHEMA, Frozen
from pipeline.records.record import first_fault
from pipeline.records.store import BadRecord
from pipeline.records.study import read_study

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from pipeline.batch.study_file import StudyFile

R = TypeVar("R", bound=Result)
NUMBERS = (int, float)
VERDICTS = {"yes": True, "no": False, "true": True, "false": False}
STUDY, TABLE = "study.toml", "table.csv"


class SweepTable(Frozen, Sequence[Mapping[str, Any]]):
    """Table of a sweep, a sequence of one mapping per case from the columns of table.csv to values.

    The swept keys come first, then the measures; None marks a measure that does not apply. The names of the columns give
    their units, and the documentation's page of columns describes each. Relative errors are fractions of 1; verdicts are
    True or False. `folder` holds the record, run.mess and arrays of every case, table.csv and study.toml.

    Parameters
    ----------
    rows : sequence of dict
        Values by column, one dictionary per case.
    folder : str or Path
        Folder of the study.
    swept : sequence of str
        The swept keys, such as array.rows.

    Examples
    --------
    >>> import antinode
    >>> table = antinode.SweepTable([{"array.rows": 1, "confinement_db": 8.6}], "sweep", ("array.rows",))
    >>> len(table), table[0]["confinement_db"], table.to_dict()["array.rows"]
    (1, 8.6, [1])
    """

    def __init__(self, rows: Sequence[dict[str, Any]], folder: str | Path, swept: Sequence[str] = ()) -> None:
        self._rows, self._folder, self._swept = tuple(rows), Path(folder), tuple(swept)

    @property
    def folder(self) -> Path:
        """Folder of the cases' records."""
        return self._folder

    @property
    def swept(self) -> tuple[str, ...]:
        """The keys that were swept, such as array.rows."""
        return self._swept

    def __getitem__(self, index: Any) -> Any:
        chosen = self._rows[index]
        return tuple(map(MappingProxyType, chosen)) if isinstance(index, slice) else MappingProxyType(chosen)

    def __len__(self) -> int:
        return len(self._rows)

    def __iter__(self) -> Iterator[Mapping[str, Any]]:
        return map(MappingProxyType, self._rows)

    @property
    def columns(self) -> tuple[str, ...]:
        """Names of the columns."""
        return tuple(self._rows[0]) if self._rows else ()

    def of(self, kind: type[R]) -> list[R | None]:
        """Return the full results of a kind.

        Parameters
        ----------
        kind : type
            Class of the result, such as antinode.Bands.

        Returns
        -------
        list
            One result per case, None for a case without one.

        Raises
        ------
        InputError
            If the folder holds no records.
        """
        try:
            stored = {case.case_id: case.record for case in read_study(self.folder).cases}
        except BadRecord as error:
            raise InputError(str(error)) from error
        return [stored[row["case"]].of(kind) for row in self._rows]

    def to_dataframe(self) -> Any:
        """Return the table as a pandas DataFrame.

        Returns
        -------
        DataFrame
            One row per case, with the units in the names of the columns.

        Raises
        ------
        ImportError
            Without pandas.
        """
        return frame(self._rows)

    def to_xarray(self) -> Any:
        """Return the table as an xarray Dataset over the swept keys, or over `case` if their values form no full grid.

        Returns
        -------
        Dataset
            One variable per column, with its unit in the attribute `units`.

        Raises
        ------
        ImportError
            Without pandas and xarray (`pip install 'antinode[tables]'`).
        """
        is_grid = len(self) == prod(len({str(row[key]) for row in self._rows}) for key in self.swept)
        return dataset(self._rows, self.swept if self.swept and is_grid else ("case",))

    def to_dict(self) -> dict[str, list[Any]]:
        """Return the columns as lists, by name.

        Returns
        -------
        dict
            Lists of one value per case, in the units of the columns' names.
        """
        return {name: [row[name] for row in self._rows] for name in self.columns}

    def save(self, path: str | Path) -> Path:
        """Write the table atomically as CSV with the columns of table.csv.

        Parameters
        ----------
        path : str or Path
            File to write.

        Returns
        -------
        Path
            The written file.
        """
        write_file(Path(path), csv_bytes(self.columns, [[*row.values()] for row in self._rows]))
        return Path(path)

    def plot(self, ax: Axes | None = None, *, column: str = "confinement_db", over: str | None = None) -> Axes:
        """Draw a column over a swept key, with one line for each combination of the other keys.

        Parameters
        ----------
        ax : Axes, optional
            Axes to draw in; new ones by default.
        column : str
            Column to draw, in the unit of its name.
        over : str, optional
            Swept key on the horizontal axis, the first by default.

        Returns
        -------
        Axes
            The axes.

        Raises
        ------
        InputError
            For a column that the table does not have.
        """
        from pipeline.plots import style

        over = over or (self.swept or ("case",))[0]
        if missing := {column, over} - set(self.columns):
            raise InputError(f"{', '.join(sorted(missing))}: no such column; choose from {', '.join(self.columns)}")
        lines: dict[str, list[tuple[Any, Any]]] = {}
        for row in self._rows:
            name = ", ".join(f"{key.partition('.')[2]} {row[key]}" for key in self.swept if key != over)
            lines.setdefault(name, []).append((row[over], nan if row[column] is None else row[column]))
        with style.style():
            drawn: Axes = style.panels(3.6)[1] if ax is None else ax
            for name, points in lines.items():
                drawn.plot(*zip(*points, strict=True), "o-", label=name)
            drawn.set(xlabel=over, ylabel=column)
            if len(lines) > 1:
                drawn.legend()
        return drawn

    def _repr_html_(self) -> str:
        """Table of the swept keys and main columns for a notebook; `columns` names all."""
        return f"<p>{escape(repr(self))}</p>{html_table(*self._main())}"

    def _main(self) -> tuple[Sequence[str], list[list[Any]]]:
        """Return names and rows of the swept keys and main columns; of all columns if none of these is there."""
        from pipeline.records.tables import MAIN

        shown = [name for name in self.columns if name in MAIN or name in self.swept] or self.columns
        return shown, [[row[name] for name in shown] for row in self._rows]

    def __str__(self) -> str:
        return f"{self!r}\n{reading_table(*self._main())}"

    def __repr__(self) -> str:
        return f"<antinode.SweepTable: {len(self)} cases, {len(self.columns)} columns, {self.folder}>"


def sweep(
    plate: Plate,
    *,
    measure: Sequence[str | type[Result]] = ("modes", "confinement"),
    folder: str | Path | None = None,
    jobs: int | None = None,
    zip: bool = False,
    progress: bool | None = None,
    **values: Iterable[Any],
) -> SweepTable:
    """Compute a plate over a grid of values; cases already stored in the folder are not computed again.

    Parameters
    ----------
    plate : Plate
        The plate to vary.
    measure : sequence of str or type
        Measures of a study by name, or results by class, such as antinode.Bands.
    folder : str or Path, optional
        Folder for records, table and study; results/NAME-sweep by default.
    jobs : int, optional
        Number of worker processes, one per core by default. They never run the caller's script.
    zip : bool
        Whether to pair the values instead of combining them in a full grid.
    progress : bool, optional
        Whether to report progress on standard error; by default in a terminal or a notebook.
    **values : iterable
        Keys as in `Plate.with_`, each with its values in the unit of the key.

    Returns
    -------
    SweepTable
        One row per case. The row of a case that failed, or whose process died, holds its diagnosis, and an
        `antinode.AntinodeWarning` names the case.

    Raises
    ------
    InputError
        For invalid values, before anything is computed.
    CheckFailed
        If every case failed.

    Examples
    --------
    >>> import antinode, tempfile
    >>> plate = antinode.load("examples/small.toml", accuracy=0.1, bands__points=2, bands__count=4)
    >>> table = antinode.sweep(
    ...     plate, measure=[antinode.Bands], folder=tempfile.mkdtemp(), jobs=1, pillar__height_mm=[6.0, 6.3]
    ... )
    >>> [row["pillar.height_mm"] for row in table], [len(bands.points) for bands in table.of(antinode.Bands)]
    ([6.0, 6.3], [7, 7])
    """
    from pipeline.batch import case_study, runner
    from pipeline.batch.runner import Progress
    from pipeline.questions import study as asked

    if not values:
        raise InputError("sweep: needs at least one key with its values, such as pitch_mm=[4, 5, 6]")
    lines = [
        f"{name} = {each!r}: must be a list of values, such as {name}=[{each!r}]"
        for name, each in values.items()
        if isinstance(each, str | bytes) or not isinstance(each, Iterable)
    ]
    if lines:
        raise InputError(lines)
    place = Path(folder) if folder is not None else paths.RESULTS / f"{plate.name}-sweep"
    place.mkdir(parents=True, exist_ok=True)
    study = _study(plate, place, [each if isinstance(each, str) else each.question for each in measure], zip, values)
    cases = case_study.jobs_of(study)  # every fault of every case, before anything is computed
    log = log_of(progress)
    with terminable():
        options, shown = runner.Options(jobs=jobs), Progress(log.quiet)
        outcome = runner.run_study(cases, case_study.computer(study), place, options, shown, study.about)
    asked.write_table(place)
    said = [f"case {end.case_id} failed: {end.diagnosis}" for end in outcome.failed]
    if len(said) == len(cases):
        raise CheckFailed(said)
    for line in said:
        log.warning("CASE_FAILED", line)
    return _stored(place, list(study.sweep))


def _study(plate: Plate, place: Path, measure: list[str], paired: bool, values: dict[str, Iterable[Any]]) -> StudyFile:
    """Write the files of the study to the folder, for the workers and for `antinode run`, and return it."""
    import tomli_w

    from pipeline.batch.study_file import study_of

    raw = portable(plate)
    name = re.sub(r"[^A-Za-z0-9._+-]", "-", place.name).strip("-.") or "sweep"
    swept = {key_of(name, raw): plain(list(each)) for name, each in values.items()}
    given = {"study": {"name": name, "case": "plate.toml", "measure": measure, "zip": paired}, "sweep": swept}
    for file, tables in (("plate.toml", raw), (STUDY, given)):
        write_file(place / file, tomli_w.dumps(tables).encode())
    return study_of(given, place / STUDY)


def _stored(place: Path, swept: Sequence[str]) -> SweepTable:
    """Return the table of the records in a folder."""
    from pipeline.questions import study as asked

    study = read_study(place)
    columns = asked.columns_of(study)
    rows = [{each.name: _known(each.cell(case.record)) for each in columns} for case in study.cases]
    return SweepTable(rows, place, swept)


def open(path: str | Path) -> Result | SweepTable:
    """Read a stored result, or the table of a study or a sweep.

    Parameters
    ----------
    path : str or Path
        JSON file written by `save` or `--json`, a study's folder, or its CSV table.

    Returns
    -------
    Result or SweepTable
        The result, of the class that the file names, or the table.

    Raises
    ------
    InputError
        If the path holds no result and no table.

    Examples
    --------
    >>> import antinode, tempfile
    >>> file = f"{tempfile.mkdtemp()}/sizes.json"
    >>> antinode.open(antinode.load("examples/small.toml").predesign().save(file)).zone_hz > 33e3
    True
    """
    file = Path(path) / TABLE if Path(path).is_dir() else Path(path)
    if file.suffix == ".csv":
        return read_table(file)
    try:
        document = store.read_json(Path(path))
    except store.BadRecord as error:
        raise InputError(f"{path}: cannot be read: {error}") from error
    store.refuse_earlier(path, document)
    kind = _kind(document) if isinstance(document, dict) else None
    if kind is None or document.get("schema") != DOCUMENT_SCHEMA:
        raise InputError(
            f"{path}: holds no result: must be a JSON document of modes, bands, attenuation, response, ..."
        )
    return _answer(path, registered()[kind].result, document)


def _answer(path: str | Path, kind: type[Result], document: dict[str, Any]) -> Result:
    try:
        return kind.from_document(document)
    except ValidationError as error:
        raise InputError(f"{path}: holds no result: {first_fault(error)}") from error


def _kind(document: dict[str, Any]) -> str | None:
    if document.get("kind") in registered():
        return str(document["kind"])
    for name, question in sorted(registered().items(), key=lambda each: -len(each[1].result.required())):
        if question.result.required() <= document.keys():
            return name
    return None


def read_table(file: Path, swept: Sequence[str] | None = None) -> SweepTable:
    """Read the CSV table of a study; swept: its keys (default: columns named TABLE.KEY). Raises InputError without one."""
    try:
        lines = csv.DictReader(io.StringIO(file.read_text(encoding="utf-8")))
        rows = [{name: cell if name == "case" else _value(cell) for name, cell in line.items()} for line in lines]
    except (OSError, ValueError, csv.Error) as error:
        raise InputError(f"{file}: cannot be read: {error}") from error
    names = list(rows[0]) if rows else []
    if "wanted_status" in names:
        raise InputError(f"{file}: {store.EARLIER}")
    if "case" not in names:
        raise InputError(f"{file}: holds no table of a study: the column `case` is missing")
    return SweepTable(rows, file.parent, [name for name in names if "." in name] if swept is None else swept)


def _value(cell: str | None) -> Any:
    """Convert a cell of a file to a value."""
    for kind in NUMBERS if cell else ():
        with suppress(ValueError):
            return kind(cell)  # type: ignore[arg-type]
    return _known(cell)


def _known(value: Any) -> Any:
    """Convert an empty text to None and verdicts to True or False; leave lists as they are."""
    if isinstance(value, str):
        return VERDICTS.get(value.lower(), value or None)
    return str(value) if isinstance(value, list) else value
