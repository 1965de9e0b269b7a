"""Table of a study (table.csv): one row per case, byte-identical between runs, and sweeps as lines of cases.

It therefore omits times and results on pytetwild meshes, which differ from run to run; the page shows those.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np

from pipeline import quantity
from pipeline.quantity import KHZ
from pipeline.records.outputs import csv_bytes
from pipeline.records.record import STATUSES, Record
from pipeline.records.study import StoredCase, StoredStudy
from solvers.measures.correlation import Shapes, follow

UNITS = {"mm": "mm", "kHz": "kHz", "GPa": "GPa", "kg": "kg", "deg": "°"}


def axis_label(key: str) -> str:
    """Return a swept key in words: array.pitch_mm -> array pitch (mm)."""
    words = key.replace(".", " ").split("_")
    unit = UNITS.get(words[-1])
    text = " ".join(words[:-1] if unit else words)
    return f"{text} ({unit})" if unit else text


def swept(cases: list[StoredCase]) -> list[StoredCase]:
    """Return the cases without the one that a study computes in addition to its sweep."""
    return [case for case in cases if case.sweep]


def main_key(study: StoredStudy, cases: list[StoredCase]) -> str | None:
    """Return the numeric key with the most values over these cases; None if none has two."""
    keys = numeric_keys(study, cases)
    return keys[0] if keys else None


def numeric_keys(study: StoredStudy, cases: list[StoredCase]) -> list[str]:
    """Return the numeric keys with at least two values over these cases, the most varied first."""
    cases = swept(cases)
    numeric = [key for key in study.swept if all(_is_number(case.sweep.get(key)) for case in cases)]
    varied = {key: len({case.sweep[key] for case in cases}) for key in numeric}
    return sorted((key for key in numeric if varied[key] > 1), key=lambda key: -varied[key])


def lines_along(study: StoredStudy, cases: list[StoredCase], key: str) -> dict[str, list[StoredCase]]:
    """Group cases by the values of the other keys in words ('' if no other varies), in ascending order of a key."""
    cases = swept(cases)
    others = [name for name in study.swept if name != key and len({str(case.sweep.get(name)) for case in cases}) > 1]
    lines: dict[str, list[StoredCase]] = {}
    for case in sorted(cases, key=lambda case: case.sweep[key]):
        name = ", ".join(f"{axis_label(other)} = {case.sweep.get(other)}" for other in others)
        lines.setdefault(name, []).append(case)
    return dict(sorted(lines.items()))


def _is_number(value: Any) -> bool:
    return isinstance(value, (int, float)) and not isinstance(value, bool)


Line = list[tuple[StoredCase, Any, Any]]


@dataclass(frozen=True)
class Tracked:
    """One case of a line: frequency of the tracked mode (None if lost), MAC with the previous case, tracking status.

    tracking: "start" (clearest target mode), "kept", "crossed" (kept, but another mode is closer to the target shape),
    "lost".
    """

    frequency_hz: float | None
    mac: float | None
    tracking: str


def along_sweep(study: StoredStudy) -> dict[str, Tracked]:
    """Track every case of a sweep, by id; {} if no numeric key is swept or no shapes are stored."""
    cases = [case for case in study.cases if case.record.held("shapes")]
    key = main_key(study, cases) if len(cases) > 1 else None
    tracked: dict[str, Tracked] = {}
    for line in lines_along(study, cases, key).values() if key else ():
        known = ((case, case.record.target, case.record.held("shapes")) for case in line)
        tracked |= _line([(case, target, shapes) for case, target, shapes in known if target and shapes])
    return tracked


def _line(line: Line) -> dict[str, Tracked]:
    """Track from the case with the clearest target mode to both ends of the line."""
    start = max(range(len(line)), key=lambda i: line[i][1].share or 0.0)
    first, target, shapes = line[start]
    tracked = {first.case_id: Tracked(target.frequency_hz, None, "start")}
    for choice in (line[start:], line[start::-1]):
        plates = [Shapes(*map(np.array, (s.frequency_hz, s.share, s.coefficients))) for _, _, s in choice]
        steps = follow(plates, shapes.target)
        for number, (case, _, stored) in enumerate(choice[1:]):
            step = steps[number] if number < len(steps) else None
            if step is None or step.row is None or not step.kept:
                tracked[case.case_id] = Tracked(None, step.mac if step else None, "lost")
            else:
                tracking = "kept" if step.row == stored.target else "crossed"
                tracked[case.case_id] = Tracked(stored.frequency_hz[step.row], step.mac, tracking)
    return tracked


TABLE = "table.csv"
# main columns, next to the swept keys
MAIN = (
    "case",
    "status",
    "target_hz",
    "confinement_db",
    "confined",
    "target_peak_db",
    "target_peak_nm_per_v",
    "db_per_row",
    "tracking",
)
KILOHERTZ = quantity.Unit("kHz", KHZ)
FILE_DIGITS = 10  # significant digits: far finer than any error bar, and reproducible between runs
TRACKED = (  # columns along a sweep: name, heading, field of a tracked mode, unit
    ("tracked_hz", "tracked mode", "frequency_hz", "Hz"),
    ("tracked_mac", "MAC with the previous case", "mac", ""),
    ("tracking", "tracking along the sweep", "tracking", None),
)


@dataclass(frozen=True)
class Column:
    """Column: name in the file, heading and unit for readers, value (None: no cell), error bar.

    unit: None for words, '' for numbers without one. bar: error bar (half-width), relative for a frequency, else in the
    unit. is_difference: of frequencies, with an error bar in Hz; is_signed: written with its sign.
    """

    name: str
    heading: str
    value: Callable[[Record], Any]
    unit: str | None = None
    bar: Callable[[Record], float | None] | None = None
    is_difference: bool = False
    is_signed: bool = False

    def text(self, record: Record, unit: quantity.Unit = quantity.HZ) -> str:
        """Format a cell for readers: '' without a value; a frequency in a readable unit."""
        value, bar = self.value(record), self.bar(record) if self.bar else None
        if not isinstance(value, float) or self.unit is None:
            return "" if value is None else str(value)
        if self.is_frequency:
            return quantity.frequency_figure(value, bar, unit)
        if self.unit == "%":
            return quantity.percent(value).removesuffix(" %")
        text = quantity.level_figure(value, bar) if self.unit == "dB" else quantity.figure(value, bar)
        return quantity.signed(text) if self.is_signed else text

    @property
    def is_number(self) -> bool:
        """Whether it contains numbers."""
        return self.unit is not None

    @property
    def is_main(self) -> bool:
        """Whether a page shows it by default."""
        return self.name in MAIN or "." in self.name

    @property
    def shown_unit(self) -> str:
        """Unit in a page, where frequencies are in kHz."""
        return KILOHERTZ.symbol if self.is_frequency else self.unit or ""

    def shown(self, record: Record) -> str:
        """Return the text of a cell in a page."""
        return self.text(record, KILOHERTZ)

    def style(self, text: str) -> str:
        """Return the CSS classes of a cell in a page."""
        own = {"diagnosis": "long", "status": f"status-{text}", "confined": text}.get(self.name, "")
        return " ".join(filter(None, ("number" if self.is_number else own, "" if self.is_main else "more")))

    @property
    def is_frequency(self) -> bool:
        """Whether it contains frequencies, not differences of them."""
        return self.unit == "Hz" and not self.is_difference

    def cell(self, record: Record) -> Any:
        """Return a cell of the file: its value, floats rounded to digits that round-off does not reach."""
        value = self.value(record)
        return float(f"{value:.{FILE_DIGITS}g}") if isinstance(value, float) else value


def columns_of(study: StoredStudy, measured: Sequence[Column]) -> list[Column]:
    """Return the columns of a study's table: id, swept keys, status, measures of any case, diagnosis."""
    swept = [Column(key, key, lambda record, key=key: record.sweep.get(key)) for key in study.swept]  # type: ignore[misc]
    known = (*measured, *_tracked(study))
    return [
        Column("case", "case", lambda record: record.case_id),
        *swept,
        Column("status", "status", lambda record: record.status),
        *(column for column in known if any(column.value(case.record) is not None for case in study.cases)),
        Column("diagnosis", "diagnosis", lambda record: record.diagnosis),
    ]


def _tracked(study: StoredStudy) -> tuple[Column, ...]:
    """Return the columns of the mode tracked along the sweep from the clearest target mode."""
    peak = along_sweep(study)

    def figure(key: str) -> Callable[[Record], Any]:
        return lambda record: getattr(peak.get(record.case_id), key, None)

    return tuple(Column(name, heading, figure(key), unit) for name, heading, key, unit in TRACKED)


def without_effect(study: StoredStudy, columns: Sequence[Column]) -> list[str]:
    """Return swept keys without effect: cases that differ in one of them alone have equal results."""
    swept = study.swept
    plain = {"case", "status", "diagnosis", *swept, *(name for name, *_ in TRACKED)}
    measured = [column for column in columns if column.name not in plain]
    answered = [case.record for case in study.cases if case.record.status in STATUSES]
    figures = {id(record): [column.text(record) for column in measured] for record in answered}
    keys = []
    for key in swept:
        alike: dict[str, list[Record]] = {}
        for record in answered:
            others = repr([record.sweep.get(other) for other in swept if other != key])
            alike.setdefault(others, []).append(record)
        pairs = [(one, other) for group in alike.values() for one, other in pairwise(group)]
        if measured and pairs and all(figures[id(one)] == figures[id(other)] for one, other in pairs):
            keys.append(key)
    return keys


def table_bytes(study: StoredStudy, columns: Sequence[Column]) -> bytes:
    """Return the table as CSV."""
    rows = ([column.cell(case.record) for column in columns] for case in study.cases)
    return csv_bytes([column.name for column in columns], rows)
