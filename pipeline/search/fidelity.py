"""One design judged by one model: from a strip in milliseconds to the joined plate; what was judged once is kept on disk."""

from __future__ import annotations

import hashlib
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import asdict, dataclass, replace
from math import ceil, floor
from pathlib import Path
from typing import Any

from pipeline.case.model import Case
from pipeline.errors import InputFault
from pipeline.paths import RESULTS
from pipeline.planning import mesh_rules
from pipeline.planning.request import of_case, understood
from pipeline.records import fingerprint, store

STRIP, COLUMN, PLATE, SOLID = "strip", "column", "plate", "solid"
MODELS = {
    STRIP: "thin strip across the plate, pillars as beams on lines",
    COLUMN: "one column of reduced cells at the wanted wavenumber",
    PLATE: "plate joined from reduced cells",
    SOLID: "the whole plate as one solid mesh",
}
SLACK = {STRIP: 0.1, COLUMN: 0.02, PLATE: 0.0, SOLID: 0.0}  # how far a rung's frequency may be off, for the limits
COLUMN_ACCURACY = 0.01  # a coarser mesh than this ranks designs no faster
AROUND = 0.07  # of the column's frequency: where the plate's wanted mode is looked for
SOLID_ACCURACY = 0.04  # a finer whole plate does not fit into the memory of a desktop
NEAREST = 30  # modes of the solid about it
GRID_HZ = 2500.0  # windows begin and end on it, so that neighbours in the search share their bare cells


@dataclass(frozen=True)
class Judged:
    """The wanted mode of one design by one rung; None where it has none, and then why.

    frequency_error (relative) and confinement_error_db are what plates are expected to be off by; `alarms` holds (id, text)
    of its solve.
    """

    rung: str
    frequency_hz: float | None
    confinement_db: float | None
    extension_db: float | None
    mac: float | None
    why_not: str = ""
    frequency_error: float | None = None
    confinement_error_db: float | None = None
    alarms: tuple[tuple[str, str], ...] = ()


def by_strip(case: Case, softness: float) -> Judged:
    """The wanted mode of a case by a strip, whose pillars' feet give way by `softness` times a half-space's compliance."""
    from solvers.errors import SolverError
    from solvers.resonators.strip import strip_modes

    try:
        found = strip_modes(case.design, *mesh_rules.wanted_window_hz(case.design), softness)
    except SolverError as fault:
        return Judged(STRIP, None, None, None, None, str(fault))
    return _of_held(STRIP, found.frequency_hz, found.held)


def judge(case: Case, rung: str, near_hz: float | None = None, shelf: EvaluationShelf | None = None) -> Judged:
    """The wanted mode by a computed rung, near a frequency where one is known; from the shelf when it stands there."""
    question = {"case": case.as_understood(), "rung": rung, "near_hz": near_hz}
    kept = shelf.get(question) if shelf else None
    if kept is not None:
        return kept
    found = _solved(case, rung, near_hz)
    if shelf:
        shelf.put(question, found)
    return found


def _solved(case: Case, rung: str, near_hz: float | None) -> Judged:
    from geometry.errors import GeometryError, MeshError
    from solvers.errors import SolverError

    solve = {COLUMN: _by_column, PLATE: _by_plate, SOLID: _by_plate}[rung]
    try:
        return solve(case, rung, near_hz)
    except (SolverError, MeshError, GeometryError, InputFault) as fault:
        return Judged(rung, None, None, None, None, " ".join(str(fault).split()))


def _by_column(case: Case, rung: str, near_hz: float | None) -> Judged:
    from pipeline.models.cell_cache import CellShelf
    from solvers.superelement.build import Reductions
    from solvers.waves.column import Column

    design = case.design
    low, high = mesh_rules.wanted_window_hz(design)
    recipe = mesh_rules.plate_recipe(design, max(COLUMN_ACCURACY, case.solve.accuracy), _outwards(low, high)[1])
    reductions = Reductions(design.thickness_m, design.material, design.pillar, recipe, CellShelf())
    found = Column(design, reductions, case.kx_wanted_per_m).modes(low, high)
    return _of_held(rung, found.frequency_hz, found.held)


def _of_held(rung: str, frequency_hz: Any, held: Any) -> Judged:
    if not len(frequency_hz):
        return Judged(rung, None, None, None, None, "no mode of the wanted parity in the window")
    at = held.wanted.index
    if at is None:
        return Judged(rung, None, None, None, None, "no mode of the wanted shape in the window")
    confinement, extension, mac = (
        None if value != value else float(value)
        for value in (held.confinement_db[at], held.extension_db[at], held.mac[at])
    )
    return Judged(rung, float(frequency_hz[at]), confinement, extension, mac)


def _by_plate(case: Case, rung: str, near_hz: float | None) -> Judged:
    """Joined or solid; without a frequency to look near, in the window that the case itself has."""
    from pipeline.analysis import modes

    solve = replace(case.solve, model="auto")
    if rung == SOLID:
        solve = replace(case.solve, model="solid", accuracy=max(SOLID_ACCURACY, case.solve.accuracy))
    case = replace(case, solve=solve)
    band = _outwards(near_hz * (1.0 - AROUND), near_hz * (1.0 + AROUND)) if near_hz else None
    request = modes.Request("plate", band_hz=band, parity=case.parity_wanted, search=False)
    if band is None:
        request = of_case(case)
    elif rung == SOLID:  # a whole mesh pays for every mode
        request = modes.Request("plate", near_hz=near_hz, count=NEAREST, parity=case.parity_wanted, search=False)
    log = SilentLog()
    found = modes.solve_modes(case, request, log)
    row, bar = found.wanted.row if found.wanted else None, found.bar
    if row is None:
        return Judged(rung, None, None, None, None, "no mode of the wanted shape in the window")
    held = (row.frequency_hz, row.confinement_db, row.extension_db, row.mac)
    errors = (bar.frequency, bar.confinement_db) if bar else (None, None)
    return Judged(rung, *held, "", *errors, tuple(log.alarms))


def window_around(case: Case, near_hz: float | None) -> tuple[str, ...]:
    """The --set that widens a case's window until a frequency lies well inside; () when it does already."""
    asked = understood(case, of_case(case))
    if near_hz is None or (asked.band_hz and asked.band_hz[0] <= near_hz * 0.97 and near_hz * 1.03 <= asked.band_hz[1]):
        return ()
    low, high = _outwards(near_hz * (1.0 - AROUND), near_hz * (1.0 + AROUND))
    if asked.band_hz:
        low, high = min(low, asked.band_hz[0]), max(high, asked.band_hz[1])
    return (f"solve.band_kHz=[{low / 1e3!r},{high / 1e3!r}]",)


def _outwards(low: float, high: float) -> tuple[float, float]:
    return GRID_HZ * floor(low / GRID_HZ), GRID_HZ * ceil(high / GRID_HZ)


class SilentLog:
    """A log that nobody reads: a search tells what it found, not how each design was solved; alarms are kept."""

    def __init__(self) -> None:
        self.alarms: list[tuple[str, str]] = []

    def info(self, text: str, id: str = "") -> None:
        """Not told."""

    def alarm(self, id: str, text: str) -> None:
        """Kept: a design near a limit is judged like any other, those of the best one are told at the end."""
        self.alarms.append((id, text))

    def left_out(self, what: str, why: str) -> None:
        """Not told."""

    @contextmanager
    def step(self, name: str) -> Iterator[None]:
        """Not timed."""
        yield


class EvaluationShelf:
    """Judged designs as small JSON files under the hash of question and computing sources; a torn file counts as absent."""

    def __init__(self, folder: Path = RESULTS / ".search") -> None:
        self.folder = folder
        self.reused = 0

    def get(self, question: dict[str, Any]) -> Judged | None:
        """What was judged before by the same code, or None."""
        with suppress(store.BadRecord, TypeError, KeyError, ValueError):
            plain = store.read_json(self._path(question))
            found = Judged(**plain | {"alarms": tuple((id, text) for id, text in plain["alarms"])})
            self.reused += 1
            return found
        return None

    def put(self, question: dict[str, Any], judged: Judged) -> None:
        """Keep one; a full disk costs the next run time, not this one its result."""
        with suppress(store.StoreError, OSError):
            self.folder.mkdir(parents=True, exist_ok=True)
            store.write_json(self._path(question), asdict(judged))

    def _path(self, question: dict[str, Any]) -> Path:
        salted = {"question": question, "code": fingerprint.current().code_hash}
        return self.folder / f"{hashlib.sha256(fingerprint.canonical_json(salted).encode()).hexdigest()[:32]}.json"
