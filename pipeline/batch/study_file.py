"""The study file: a case, its measures and the grid of swept values; and the names of studies.

Results of the checkout's studies are in its `results/`, those of any other study file in `results/` next to it, unless
ANTINODE_RESULTS or --results says otherwise. Other locations are noted in a file of the user's state folder.
"""

from __future__ import annotations

import hashlib
import itertools
import json
import os
import re
from collections import Counter
from dataclasses import dataclass
from math import prod
from pathlib import Path
from typing import Annotated, Any, NamedTuple

from pydantic import BaseModel, ConfigDict, Field

from pipeline import paths
from pipeline.case.reading import (
    Diagnostics,
    check_table,
    exclusive,
    is_file,
    nearest,
    nearest_file,
    read_toml,
    toml_text,
)
from pipeline.case.schema import known_keys, of_any_element
from pipeline.errors import InputError, reason
from pipeline.logs import flat
from pipeline.paths import STUDIES

MAX_ID_LENGTH = 120
RESERVED = "reference"  # results/reference contains the values for checks
MAX_CASES = 100_000
MAX_BYTES = 10_000_000  # limit of a study file, enough for the values of MAX_CASES cases


class Place(NamedTuple):
    """A study file and the folder of its results."""

    source: Path
    folder: Path


class StudyTable(BaseModel):
    model_config = ConfigDict(extra="forbid", strict=True)

    name: Annotated[str, Field(pattern=r"^[A-Za-z0-9][A-Za-z0-9._+-]{0,99}$")] | None = Field(
        default=None, description="1 to 100 letters, digits, dots, dashes or underscores"
    )
    case: str = Field(min_length=1, description="the path of a case file, from the study file's folder")
    measure: Annotated[list[str], Field(min_length=1)] = Field(default=["modes"], description="a list of measures")
    base_measure: list[str] = Field(default=[], description="a list of measures")
    zip: bool = Field(default=False, description="true or false")


@dataclass(frozen=True)
class StudyFile:
    """A study with defaults: sweep holds a tuple of values per dotted key; zip pairs them instead of a full grid.

    `measure` applies to every case of the sweep, `base_measure` to one more case, the unswept "base".
    """

    name: str
    source: Path
    case_path: Path
    measure: tuple[str, ...]
    sweep: dict[str, tuple[Any, ...]]
    zip: bool
    base_measure: tuple[str, ...] = ()

    @property
    def about(self) -> dict[str, Any]:
        """Return the description of the study for its report."""
        return {"name": self.name, "case": self.case_path.name, "measure": list(self.measure)}

    def cases(self) -> list[tuple[str, list[tuple[str, Any]]]]:
        """Return (case id, overrides by key) for every case, in the order of the file, the last key running fastest.

        An id such as "pitch_mm=4,rows=1" is unique, stable and safe as a folder's name; without a sweep it is "base".
        """
        keys = list(self.sweep)
        rows = zip(*self.sweep.values(), strict=True) if self.zip else itertools.product(*self.sweep.values())
        labels = _labels(keys)
        return [(_case_id(labels, values), list(zip(keys, values, strict=True))) for values in (rows if keys else [()])]


def folder_of(name: str, source: Path, given: str | None = None) -> Path:
    """Return the results folder of a study: below the given one, else its previous place, else by the rule above."""
    if given:
        return Path(given).resolve() / name
    if os.environ.get("ANTINODE_RESULTS") or _is_ours(source):
        return paths.RESULTS / name
    before = known_places().get(name)
    if before and before.source == source.resolve():
        return before.folder
    return source.resolve().parent / "results" / name


def stored_folder(name: str, source: Path, given: str | None = None) -> Path:
    """Return the folder from which to read a study's results: the one for writing, else the previous one."""
    place, before = folder_of(name, source, given), known_places().get(name)
    elsewhere = not given and not place.exists() and before and before.source == source.resolve()
    return before.folder if before and elsewhere else place


def known_places() -> dict[str, Place]:
    """Return studies with results elsewhere, by name, if their file and results still exist."""
    try:
        entries = json.loads(_file().read_text(encoding="utf-8"))
        places = {name: Place(Path(source), Path(folder)) for name, (source, folder) in entries.items()}
    except (OSError, ValueError, TypeError, AttributeError, RecursionError):
        return {}
    return {name: place for name, place in places.items() if place.source.is_file() and place.folder.is_dir()}


def remember_place(name: str, source: Path, folder: Path) -> str | None:
    """Note a study with results elsewhere; return a warning if the state folder cannot be written."""
    from pipeline.records.store import StoreError, write_atomic

    if folder.parent == paths.RESULTS and _is_ours(source):
        return None
    entries = known_places() | {name: Place(source.resolve(), folder.resolve())}
    text = json.dumps({key: [str(part) for part in place] for key, place in sorted(entries.items())}, indent=1)
    try:
        _file().parent.mkdir(parents=True, exist_ok=True)
        write_atomic(_file(), f"{text}\n".encode())
    except (OSError, StoreError) as error:
        return f"{_file()}: {reason(error)}: the study {name!r} can be found only by its file, not by its name"
    return None


def load_study(path_or_name: str | Path) -> StudyFile:
    """Load the study of a file, or of studies/NAME.toml of the checkout; InputError with one line per fault."""
    path = find_study(path_or_name)
    return study_of(read_toml(path, MAX_BYTES), path)


def study_of(raw: dict[str, Any], path: Path) -> StudyFile:
    """Build the study of a parsed file, with case paths relative to it; InputError as in load_study."""
    diagnostics = Diagnostics(str(path))
    if "study" not in raw and {"plate", "zone", "material"} & set(raw):
        raise InputError(f"{path}: a case file, but a study file with a [study] table is needed")
    for key in raw:
        if key not in ("study", "sweep"):
            diagnostics.unknown(key, raw[key], ["study", "sweep"])
    table = _read_study(raw, diagnostics)
    sweep, paired = _read_sweep(raw.get("sweep", {}), diagnostics, table.zip)
    _check_counts(sweep, paired, diagnostics)
    case_path = path.parent / (table.case or "")
    if table.case is not None and not is_file(case_path):
        diagnostics.add("study.case", table.case, f"no such file {case_path}{nearest_file(case_path)}")
    name = table.name or path.stem
    if name == RESERVED:
        diagnostics.add("study.name", name, "is reserved for the committed reference values; choose another name")
    diagnostics.stop()
    return StudyFile(name, path, case_path, tuple(table.measure), sweep, paired, tuple(table.base_measure or ()))


def find_study(path_or_name: str | Path) -> Path:
    """Resolve a path, or the bare name of a study of the checkout or of an earlier run, to a file."""
    path, text = Path(path_or_name), str(path_or_name)
    if is_file(path) or path.suffix == ".toml" or path.parent != Path():
        return path
    named, elsewhere = STUDIES / f"{text}.toml", known_places()
    if not is_file(named) and text in elsewhere:
        return elsewhere[text].source
    if not is_file(named):
        names = sorted({*elsewhere, *checkout_studies()})
        raise InputError(f"study {text!r}: no such file, and not one of {', '.join(names)}{nearest(text, names)}")
    return named


def checkout_studies() -> list[str]:
    """Return the names of the checkout's own studies."""
    return sorted(file.stem for file in STUDIES.glob("*.toml") if "[study]" in file.read_text(encoding="utf-8"))


def _is_ours(source: Path) -> bool:
    return (paths.IS_CHECKOUT and source.resolve().is_relative_to(paths.ROOT)) or source.parent == paths.STUDIES


def _file() -> Path:
    return Path(os.environ.get("XDG_STATE_HOME") or Path.home() / ".local" / "state") / "antinode" / "studies.json"


def _read_study(raw: dict[str, Any], diagnostics: Diagnostics) -> StudyTable:
    table, nothing = raw.get("study"), StudyTable.model_construct(**dict.fromkeys(StudyTable.model_fields))
    if table is None:
        diagnostics.missing("[study]", "must be a table with name, case and measure")
        return nothing
    if not isinstance(table, dict):
        diagnostics.add("study", table, "must be a table [study]")
        return nothing
    known = [f"study.{name}" for name in StudyTable.model_fields]
    for key, spare in (("measure", ["modes"]), ("base_measure", [])):
        measures = table.get(key)
        if isinstance(measures, list) and (measures or key == "measure"):
            _check_measures(key, measures, diagnostics)
            table = {**table, key: [name for name in measures if name in _names()] or spare}
    return check_table(StudyTable, table, "study.", known, diagnostics)[0]


def _names() -> list[str]:
    from pipeline.questions import study as asked  # loads the planner, hence only once there is a study to plan

    return asked.names()


def _check_measures(key: str, measures: list[Any], diagnostics: Diagnostics) -> None:
    for name in measures:
        if name not in _names():
            hint = nearest(name, _names()) if isinstance(name, str) else ""
            diagnostics.add(f"study.{key}", name, f"must be a list of {', '.join(_names())}{hint}")
    if not measures or len({str(name) for name in measures}) < len(measures):
        diagnostics.add(f"study.{key}", measures, "must name at least one measure, each once")


def _read_sweep(table: Any, diagnostics: Diagnostics, paired: bool) -> tuple[dict[str, tuple[Any, ...]], bool]:
    if not isinstance(table, dict):
        diagnostics.add("sweep", table, "must be a table [sweep] of lists")
        return {}, False
    lists = dict(flat(table))
    zipped = lists.pop("zip", False)
    if not isinstance(zipped, bool):
        diagnostics.add("sweep.zip", zipped, "must be true or false")
    paired = paired or zipped is True
    known = known_keys()
    for key, values in lists.items():
        if of_any_element(key) not in known:
            diagnostics.unknown(f'sweep."{key}"', values, known)
        elif not isinstance(values, list) or not values:
            diagnostics.add(f'sweep."{key}"', values, "must be a list of at least one value")
        elif not paired and len({toml_text(value) for value in values}) < len(values):
            diagnostics.add(f'sweep."{key}"', values, "must contain each value only once")
    for first, second in exclusive(lists.items(), paired):
        diagnostics.add(f'sweep."{second}"', lists[second], f"and {first} exclude each other: give only one of them")
    return {key: tuple(values) for key, values in lists.items() if isinstance(values, list) and values}, paired


def _check_counts(sweep: dict[str, tuple[Any, ...]], paired: bool, diagnostics: Diagnostics) -> None:
    lengths = {key: len(values) for key, values in sweep.items()}
    if paired and len(set(lengths.values())) > 1:
        counts = ", ".join(f"{key} has {count}" for key, count in lengths.items())
        diagnostics.add("sweep.zip", True, f"needs lists of equal length ({counts})")
    elif paired:
        rows = Counter(toml_text(list(row)) for row in zip(*sweep.values(), strict=True))
        for row in sorted(row for row, count in rows.items() if count > 1):
            diagnostics.add("sweep", row, "must contain each combination only once")
    total = max(lengths.values(), default=0) if paired else prod(lengths.values())
    if total > MAX_CASES:
        diagnostics.add("sweep", f"{total} cases", f"must be at most {MAX_CASES}")


def _labels(keys: list[str]) -> list[str]:
    leaves = [key.rpartition(".")[2] for key in keys]
    return [leaf if leaves.count(leaf) == 1 else key for key, leaf in zip(keys, leaves, strict=True)]


def _case_id(labels: list[str], values: tuple[Any, ...]) -> str:
    if not labels:
        return "base"
    exact, plain = (
        ",".join(f"{label}={text(value)}" for label, value in zip(labels, values, strict=True))
        for text in (toml_text, _plain)
    )
    readable = re.sub(r"[^A-Za-z0-9._+=,-]", "_", plain)
    if readable == exact.replace('"', "") and len(readable) <= MAX_ID_LENGTH:
        return readable
    return f"{readable[: MAX_ID_LENGTH - 9]}-{hashlib.sha256(exact.encode()).hexdigest()[:8]}"


def _plain(value: Any) -> str:
    if isinstance(value, (list, tuple)):
        return "_".join(_plain(item) for item in value)
    return value if isinstance(value, str) else toml_text(value)
