"""Sweeps: one plate over a grid of values, computed by the batch engine, resumable."""

from __future__ import annotations

import csv
import io
import os
import re
import subprocess
import sys
from collections.abc import Iterator, Mapping, Sequence
from math import nan, prod
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Any

from antinode.plate import Plate, is_watched, key_of
from antinode.tables import Frozen, plain
from pipeline.cli.main import DONE, INTERRUPTED, NOT_TRUSTED
from pipeline.errors import CheckFailed, InputError

if TYPE_CHECKING:
    from matplotlib.axes import Axes

NUMBERS = (int, float)
PERCENT = re.compile(r"-?[\d.]+%")  # as table.csv writes shares
VERDICTS = {"yes": True, "no": False, "true": True, "false": False}
STUDY, TABLE = "study.toml", "table.csv"


class SweepTable(Frozen, Sequence[Mapping[str, Any]]):
    """One row a case: swept keys and measures by their columns of table.csv; None where a measure has no meaning. Errors are
    shares of 1, verdicts are True or False.

    `folder` holds every case's record, run.mess and arrays, the table as table.csv, and the study as study.toml. Units
    stand in the columns' names; the page of columns in the documentation says what each one is.

    >>> import antinode
    >>> table = antinode.SweepTable([{"array.rows": 1, "confinement_db": 8.6}], "sweep", ("array.rows",))
    >>> len(table), table[0]["confinement_db"], table.to_dict()["array.rows"]
    (1, 8.6, [1])
    """

    def __init__(self, rows: Sequence[dict[str, Any]], folder: str | Path, swept: Sequence[str] = ()) -> None:
        self._rows, self._folder, self._swept = tuple(rows), Path(folder), tuple(swept)

    @property
    def folder(self) -> Path:
        """Where every case's record lies."""
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

    def to_dataframe(self) -> Any:
        """The table as a pandas DataFrame. Raises ImportError without pandas."""
        from pipeline.records.frames import frame

        return frame(self._rows)

    def to_xarray(self) -> Any:
        """The table as an xarray Dataset over the swept keys, or over `case` where they are no grid.

        Raises ImportError without pandas and xarray (`pip install 'antinode[tables]'`).
        """
        from pipeline.records.frames import dataset

        is_grid = len(self) == prod(len({str(row[key]) for row in self._rows}) for key in self.swept)
        return dataset(self._rows, self.swept if self.swept and is_grid else ("case",))

    def to_dict(self) -> dict[str, list[Any]]:
        """Columns as lists."""
        return {name: [row[name] for row in self._rows] for name in self.columns}

    def save(self, path: str | Path) -> Path:
        """Write the table as CSV with the columns of table.csv, whole or not at all."""
        from pipeline.records.outputs import csv_bytes, write_file

        write_file(Path(path), csv_bytes(self.columns, [[*row.values()] for row in self._rows]))
        return Path(path)

    def plot(self, ax: Axes | None = None, *, column: str = "confinement_db", over: str | None = None) -> Axes:
        """Draw a column over a swept key (default: the first), a line for each value of the others; return the axes.

        Raises InputError for a column that the table has not.
        """
        from pipeline.plots import style

        over = over or (self.swept or ("case",))[0]
        if missing := {column, over} - set(self.columns):
            raise InputError(f"{', '.join(sorted(missing))}: no such column; there are {', '.join(self.columns)}")
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
        """The swept keys and the columns that answer first, for a notebook; every column is in `columns`."""
        from html import escape

        from pipeline.records.frames import html_table
        from pipeline.report.text import MAIN

        shown = [name for name in self.columns if name in MAIN or name in self.swept] or self.columns
        rows = [[row[name] for name in shown] for row in self._rows]
        return f"<p>{escape(repr(self))}</p>{html_table(shown, rows)}"

    def __repr__(self) -> str:
        return f"<antinode.SweepTable: {len(self)} cases, {len(self.columns)} columns, {self.folder}>"


def sweep(
    plate: Plate,
    *,
    measure: Sequence[str] = ("modes", "confinement"),
    folder: str | Path | None = None,
    jobs: int | None = None,
    zip: bool = False,
    progress: bool | None = None,
    **values: Sequence[Any],
) -> SweepTable:
    """Compute a plate over a full grid of values (or pairs of them with zip) and return the table.

    Keywords are keys as in `Plate.with_`, each with its values. What the folder (default: results/NAME-sweep) holds from
    the same input and sources is not computed again. Raises InputError for values that cannot be, CheckFailed where a
    case failed: the others are kept in the folder.

    >>> import antinode, tempfile
    >>> plate = antinode.load("examples/small.toml", accuracy=0.1, bands__points=2, bands__count=4)
    >>> table = antinode.sweep(
    ...     plate, measure=["bands"], folder=tempfile.mkdtemp(), jobs=1, pillar__height_mm=[6.0, 6.3]
    ... )
    >>> [row["pillar.height_mm"] for row in table]
    [6, 6.3]
    """
    from pipeline import paths
    from pipeline.batch import case_study
    from pipeline.batch.study_file import load_study

    if not values:
        raise InputError("sweep: needs at least one key with its values, such as pitch_mm=[4, 5, 6]")
    place = Path(folder) if folder is not None else paths.RESULTS / f"{plate.name}-sweep"
    place.mkdir(parents=True, exist_ok=True)
    study = load_study(_written(plate, place, measure, zip, values))
    case_study.jobs_of(study)  # every fault of every case, before anything is computed
    quiet = not (is_watched() if progress is None else progress)
    failed = _computed(place, jobs, quiet)
    if failed:
        raise CheckFailed(failed)
    return read_table(place / TABLE, [key_of(name, plate.to_dict()) for name in values])


def _computed(place: Path, jobs: int | None, quiet: bool) -> list[str]:
    """Run the study in a process of its own, whose workers know nothing of the caller's script; failed cases, a line each."""
    from pipeline.paths import ROOT

    words = [sys.executable, "-m", "antinode.sweeps", str(place), str(jobs or 0), *(["--quiet"] if quiet else [])]
    paths = os.pathsep.join(filter(None, (str(ROOT), os.environ.get("PYTHONPATH"))))
    done = subprocess.run(words, stdout=subprocess.PIPE, text=True, env={**os.environ, "PYTHONPATH": paths})
    if done.returncode == INTERRUPTED:
        raise KeyboardInterrupt
    if done.returncode not in (DONE, NOT_TRUSTED):
        raise CheckFailed(
            f"the sweep in {place} ended with exit code {done.returncode}: what was finished is kept there"
        )
    return done.stdout.splitlines()


def main(words: Sequence[str]) -> int:
    """Run the study of a folder and write its table: `python -m antinode.sweeps FOLDER JOBS [--quiet]`."""
    from pipeline.batch import case_study, runner
    from pipeline.batch.progress import Progress
    from pipeline.batch.study_file import load_study
    from pipeline.measures import registry
    from pipeline.process import terminable

    place = Path(words[0])
    study = load_study(place / STUDY)
    options, progress = runner.Options(jobs=int(words[1]) or None), Progress("--quiet" in words)
    try:
        with terminable():
            jobs, compute = case_study.jobs_of(study), case_study.computer(study)
            outcome = runner.run_study(jobs, compute, place, options, progress, study.about)
            registry.write_table(place)
    except KeyboardInterrupt:
        return INTERRUPTED
    for end in outcome.failed:
        print(f"case {end.case_id} failed: {end.diagnosis}")
    return outcome.exit_code


def _written(plate: Plate, place: Path, measure: Sequence[str], paired: bool, values: dict[str, Sequence[Any]]) -> Path:
    """The case and the study as files in the folder, which `antinode run` takes as well."""
    from pipeline.case.overrides import toml_text
    from pipeline.records.outputs import write_file

    write_file(place / "plate.toml", case_text(plate).encode())
    name = re.sub(r"[^A-Za-z0-9._+-]", "-", place.name).strip("-.") or "sweep"
    head = {"name": name, "case": "plate.toml", "measure": list(measure)}
    keys = {key_of(name, plate.to_dict()): plain(list(each)) for name, each in values.items()}
    lines = ["[study]", *(f"{key} = {toml_text(value)}" for key, value in head.items()), "", "[sweep]"]
    lines += [f'"{key}" = {toml_text(each)}' for key, each in keys.items()] + (["zip = true"] if paired else [])
    write_file(place / STUDY, ("\n".join(lines) + "\n").encode())
    return place / STUDY


def case_text(plate: Plate) -> str:
    """A plate as the text of a case file; files that it names by their whole paths."""
    from pipeline.case.overrides import toml_text

    raw = plate.to_dict()
    tables = {key: value for key, value in raw.items() if isinstance(value, dict) and key != "material"}
    lines = [f"{key} = {toml_text(value)}" for key, value in raw.items() if key not in tables]
    for name, table in tables.items():
        lines += ["", f"[{name}]"]
        for key, value in table.items():
            known = plate.source.parent / value if key in ("file", "sweep", "map") and plate.source else value
            lines.append(f"{key} = {toml_text(str(Path(known).resolve()) if known is not value else value)}")
    return "\n".join(lines) + "\n"


def read_table(file: Path, swept: Sequence[str] | None = None) -> SweepTable:
    """The table of a study; swept: its keys (default: columns named TABLE.KEY). Raises InputError where there is none."""
    try:
        lines = csv.DictReader(io.StringIO(file.read_text(encoding="utf-8")))
        rows = [{name: cell if name == "case" else _value(cell) for name, cell in line.items()} for line in lines]
    except (OSError, ValueError, csv.Error) as error:
        raise InputError(f"{file}: cannot be read: {error}") from error
    names = list(rows[0]) if rows else []
    if "case" not in names:
        raise InputError(f"{file}: holds no table of a study: it has no column `case`")
    return SweepTable(rows, file.parent, [name for name in names if "." in name] if swept is None else swept)


def _value(cell: str | None) -> Any:
    if not cell:
        return None
    for kind in NUMBERS:
        try:
            return kind(cell)
        except ValueError:
            continue
    if PERCENT.fullmatch(cell):
        return round(float(cell[:-1]) / 100.0, 12)
    return VERDICTS.get(cell.lower(), cell)


if __name__ == "__main__":
    raise SystemExit(main(sys.argv[1:]))
