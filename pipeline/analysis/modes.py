"""Modes of a part: every mirror class asked for, merged, counted and measured, and the wanted one among them."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from geometry.elements import FloatArray
from pipeline.analysis import wanted_search
from pipeline.analysis.mode_rows import ModeRow, mode_rows
from pipeline.analysis.predesign import short_wave
from pipeline.analysis.wanted_search import Wanted
from pipeline.case.model import Case
from pipeline.errors import InputFault
from pipeline.logs import Log
from pipeline.models import parts
from pipeline.models.parts import PartModel
from pipeline.planning import calibration, error_bar, foresight, simplifications
from pipeline.planning.error_bar import ErrorBar
from pipeline.planning.model_choice import Way, way_of
from pipeline.planning.refinement import MARGIN, climbed, refused, remeshed, rereduced, warn
from pipeline.planning.request import (
    DEFAULT_COUNT,
    MEASURED,
    Request,
    model_high_hz,
    symmetry_of,
    understood,
    wanted_window_hz,
    with_search,
)
from pipeline.planning.simplifications import khz
from solvers.fem.eigen import Count, Modes, SymmetricPencil, modes_in_band, modes_near
from solvers.measures.confinement import Confinement, measure, wanted_parity
from solvers.measures.mode_mixing import mixing_db
from solvers.superelement.build import PlateModel
from solvers.superelement.plate_error import ModeErrors

__all__ = ["DEFAULT_COUNT", "PartModes", "Request", "solve_modes", "understood"]
PASSES = 4  # meshed or reduced anew for what was found, at most


@dataclass(frozen=True)
class PartModes:
    """Modes of a part in ascending order, with the model and the vectors behind them.

    reduction_error and expected_error (by the mesh) are those of any mode, relative; `bar` is the wanted mode's. `wanted` is
    None where the question has no meaning: another symmetry class, a lone pillar, a mesh without touch face. more_in_mesh:
    how many more modes than were counted the meshes behind a reduced plate have at most up to the count's upper end.
    """

    part: str
    model: PartModel
    rows: tuple[ModeRow, ...]
    vectors: dict[str | None, FloatArray]
    dof: int
    rigid_count: int
    count: Count
    meshes: list[dict[str, Any]]
    reduction_error: float | None = None
    expected_error: float | None = None
    bar: ErrorBar | None = None
    wanted: Wanted | None = None
    more_in_mesh: int | None = None
    nearest_hz: float | None = None  # to a band that holds no mode

    @property
    def highest_hz(self) -> float:
        """The highest frequency found, the search for the wanted mode included; 0 without modes."""
        return max((row.frequency_hz for row in (*self.rows, *(self.wanted.rows if self.wanted else ()))), default=0.0)

    @property
    def whole_window(self) -> PartModes:
        """The same with every mode among which the wanted one was looked for, where all are of one symmetry class."""
        found = self.wanted
        if found is None or found.count is None or len(self.vectors) > 1:
            return self
        rows = sorted({row.column: row for row in (*self.rows, *found.rows)}.values(), key=lambda row: row.frequency_hz)
        return replace(self, rows=tuple(rows), count=found.count)

    def index(self, row: ModeRow | None) -> int | None:
        """Where a mode stands among `rows`; None for one that is not there."""
        places = (i for i, one in enumerate(self.rows) if row and (one.parity, one.column) == (row.parity, row.column))
        return next(places, None)

    @property
    def counts(self) -> str:
        """Whose eigenvalues the count by inertia counts."""
        return "reduced pencil" if isinstance(self.model, PlateModel) else "mesh"

    def json(self) -> dict[str, Any]:
        """The contract's fields, without times."""
        keys = ("frequency_hz", "residual", "parity", "zone_share", "confinement_db", "mac", "strength")
        return {
            "schema": 1,
            "model": self.model.name,
            "part": self.part,
            "dof": self.dof,
            "rigid_count": self.rigid_count,
            "modes": [
                {key: getattr(row, key) for key in keys} | {"symmetry": symmetry_of(row.parity)} for row in self.rows
            ],
            "count_check": {
                "low_hz": self.count.low_hz,
                "high_hz": self.count.high_hz,
                "expected": self.count.expected,
                "found": self.count.found,
                "counts": self.counts,
                "more_in_mesh_at_most": self.more_in_mesh,
            },
            "wanted": self.wanted.json() if self.wanted else None,
            "reduction_error": self.reduction_error,
            "expected_error": self.expected_error,
            "error_bar": self.bar.json() if self.bar else None,
        }


def solve_modes(case: Case, request: Request, log: Log) -> PartModes:
    """Solve a part's modes. Raises SolverError (not trusted), MeshError, InputFault (a class the part does not have)."""
    asked = understood(case, request)
    way = way_of(case, asked.part, model_high_hz(case, asked))
    foresight.announce(f"modes of the {asked.part}", foresight.of_modes(case, way, with_search(case, asked)), log)
    if asked.part != "pillar" and (short := short_wave(case.design)):
        log.alarm("SHORT_WAVE", short)
    unpatched = simplifications.no_patches(case.patches, ()) if asked.part == "plate" and case.patches else None
    simplifications.told((*way.left_out, unpatched, simplifications.other_classes(way.classes, asked.parity)), log)
    (found, errors), way = _within_reach(case, asked, way, log)
    _warn_of_nothing(found, asked, log)
    judged = _judged(found, errors)
    finer = climbed(way, judged.modes, judged.degrees, case, log) if judged else None
    if finer:
        with refused(log):
            (found, errors), way = _solved(case, asked, finer, log), finer
            judged = _judged(found, errors)
    if judged:
        log.info(
            f"high by the reduction, as what it leaves out tells: the wanted mode {judged.total:.2%}, "
            f"any mode {judged.worst:.2%} at most"
        )
        warn(judged.total, case, log)
    expected = error_bar.told(way, case, log, found.highest_hz)
    bar = _bar(case, way, found, MARGIN * judged.total if judged else None)
    return replace(found, reduction_error=judged.worst if judged else None, expected_error=expected, bar=bar)


def _warn_of_nothing(found: PartModes, asked: Request, log: Log) -> None:
    """An alarm for an empty answer, which says where the nearest mode is."""
    if found.rows or asked.band_hz is None:
        return
    low, high = asked.band_hz
    of_class = f" of class {asked.parity}" if asked.parity else ""
    nearest = "" if found.nearest_hz is None else f"; the nearest lies at about {found.nearest_hz:.4g} Hz"
    log.alarm("NO_MODES", f"no mode{of_class} of the {asked.part} lies between {low:.6g} and {high:.6g} Hz{nearest}")


def _within_reach(
    case: Case, asked: Request, way: Way, log: Log
) -> tuple[tuple[PartModes, dict[str | None, ModeErrors]], Way]:
    """The modes by a model that was made for frequencies as high as theirs: meshed or reduced anew until it is."""
    solved = _solved(case, asked, way, log)
    for _ in range(PASSES):
        highest = solved[0].highest_hz
        higher = remeshed(way, highest, case, log) or rereduced(way, highest, log)
        if higher is None:
            break
        solved, way = _solved(case, asked, higher, log), higher
    return solved, way


def _solved(case: Case, asked: Request, way: Way, log: Log) -> tuple[PartModes, dict[str | None, ModeErrors]]:
    """The modes by one way, the wanted one among them, and for a reduced body the errors by its reduction, class by class."""
    meshes: list[dict[str, Any]] = []
    model = parts.built(case, way, log, meshes)
    classes: dict[str | None, _Class] = {}
    wanted: Wanted | None = None
    for parity in _classes(model, asked.parity):
        one = classes[parity] = _Class(case, asked.part, model, parity, log)
        one.ask(asked)
        if parity in (None, wanted_parity(case.design.nodal_lines)):
            wanted = _wanted(case, asked, one)
        one.let_go()
    rows, count = _merged(asked, classes)
    found = PartModes(
        asked.part,
        model,
        tuple(rows),
        {parity: one.vectors for parity, one in classes.items()},
        sum(one.dof for one in classes.values()),
        sum(one.rigid_count for one in classes.values()),
        count,
        meshes,
        wanted=wanted,
        more_in_mesh=_more_in_mesh(model, classes, count),
        nearest_hz=_nearest_hz(asked, classes),
    )
    errors: dict[str | None, ModeErrors] = {}
    if isinstance(model, PlateModel):
        errors = {parity: model.mode_errors(parity, one.pencil, one.vectors) for parity, one in classes.items()}
    return found, errors


class _Class:
    """One symmetry class of a model: its pencil, and the modes that were solved for so far, as columns of `vectors`."""

    def __init__(self, case: Case, part: str, model: PartModel, parity: str | None, log: Log) -> None:
        self.case, self.part, self.model, self.parity, self.log = case, part, model, parity, log
        self.pencil: SymmetricPencil
        self.dof = 0
        self.vectors: FloatArray
        self.rows: tuple[ModeRow, ...] = ()
        self.rigid_count = 0
        self.nearest_hz: float | None = None
        self.count = Count(0.0, 0.0, 0, 0)

    def ask(self, asked: Request) -> None:
        """Solve what was asked for."""
        name = f"class {self.parity or 'whole'}"
        with self.log.step(f"solve {name}"):
            self.pencil = self.model.pencil(self.parity)
            self.dof = self.pencil.dof
            self.vectors = np.empty((self.dof, 0))
            found = _solve(self.pencil, asked)
            self.rows, self.count, self.rigid_count = self._kept(found), found.count, found.rigid_count
            if not self.rows and asked.band_hz:
                near = modes_near(self.pencil, sum(asked.band_hz) / 2.0, 1)
                self.nearest_hz = float(near.frequency_hz[0]) if len(near.frequency_hz) else None
        self.log.info(f"{name}: {self.dof} degrees of freedom, {len(self.rows)} modes")

    def let_go(self) -> None:
        """Forget the matrices of a mesh, which nothing asks again; those of a reduced plate are small."""
        if not isinstance(self.model, PlateModel):
            del self.pencil

    def between(self, low_hz: float, high_hz: float) -> tuple[tuple[ModeRow, ...], Count]:
        """Every mode between two frequencies, solved on top of what is known."""
        with self.log.step(f"look for the wanted mode from {khz(round(low_hz))} to {khz(round(high_hz))}"):
            found = modes_in_band(self.pencil, low_hz, high_hz)
            return self._kept(found), found.count

    def _kept(self, modes: Modes) -> tuple[ModeRow, ...]:
        first = self.vectors.shape[1]
        self.vectors = np.hstack([self.vectors, modes.vectors])
        measures: Confinement | None = None
        if self.part in MEASURED and len(modes.frequency_hz):
            measures = measure(self.model.touch(self.parity, modes.vectors), self.case.design, self.parity)
        return tuple(mode_rows(modes, self.parity, measures, first))


def _wanted(case: Case, asked: Request, one: _Class) -> Wanted | None:
    """The wanted mode among those of its class; None for a part that has none."""
    window = wanted_window_hz(case, asked)
    if window is None:
        return None
    if not asked.search:
        return wanted_search.look_among(one.rows, one.count)
    return wanted_search.look(window, one.count, one.rows, one.between)


def _nearest_hz(asked: Request, classes: dict[str | None, _Class]) -> float | None:
    """The mode nearest to the middle of a band that holds none."""
    tones = [one.nearest_hz for one in classes.values() if one.nearest_hz is not None]
    if any(one.rows for one in classes.values()) or not tones or not asked.band_hz:
        return None
    middle = sum(asked.band_hz) / 2.0
    return min(tones, key=lambda tone: abs(tone - middle))


def _more_in_mesh(model: PartModel, classes: dict[str | None, _Class], count: Count) -> int | None:
    """PartModes.more_in_mesh; 0 for a body that was not reduced."""
    if not isinstance(model, PlateModel):
        return 0
    total = 0
    for parity, one in classes.items():
        same = one.count.below is not None and one.count.high_hz == count.high_hz
        reduced = one.count.below + one.count.expected if same and one.count.below is not None else None
        more = model.more_below(parity, one.pencil, count.high_hz, reduced)
        if more is None:
            return None
        total += more
    return total


@dataclass(frozen=True)
class _Judged:
    """How far the reduction may put modes too high, relative: the worst of all; the wanted one's by modes and by degrees."""

    worst: float
    modes: float
    degrees: float

    @property
    def total(self) -> float:
        return self.modes + self.degrees


def _judged(found: PartModes, errors: dict[str | None, ModeErrors]) -> _Judged | None:
    """The reduction's estimate; None for a body that was not reduced and where no mode was found.

    Without a wanted mode the worst one stands for it.
    """
    every = [np.vstack([each.modes, each.degrees]) for each in errors.values() if len(each.modes)]
    if not every:
        return None
    both = np.hstack(every)
    worst = both[:, int(np.argmax(both.sum(axis=0)))]
    row = found.wanted.row if found.wanted else None
    own = (errors[row.parity].modes[row.column], errors[row.parity].degrees[row.column]) if row else worst
    return _Judged(float(worst.sum()), float(own[0]), float(own[1]))


def _bar(case: Case, way: Way, found: PartModes, reduction: float | None) -> ErrorBar | None:
    """What the wanted mode's frequency and confinement may be off by; None without one."""
    row = found.wanted.row if found.wanted else None
    if row is None or found.wanted is None:
        return None
    bar = ErrorBar(error_bar.expected_error(way, case.design, row.frequency_hz), reduction)
    if bar.frequency is None or row.confinement_db is None:
        return bar
    kin = list(found.wanted.rows)
    touch = found.model.touch(row.parity, found.vectors[row.parity][:, [each.column for each in kin]])
    tones = np.array([each.frequency_hz for each in kin])
    most, share = mixing_db(touch, tones, kin.index(row), case.design, bar.frequency), calibration.mixing()
    return replace(bar, confinement_db=None if most is None or share is None else share * most)


def _classes(model: PartModel, parity: str | None) -> tuple[str | None, ...]:
    if parity is None:
        return model.parities
    if parity not in model.parities:
        raise InputFault(f"parity {parity}: this model has no mirror classes; leave --parity out")
    return (parity,)


def _solve(pencil: SymmetricPencil, asked: Request) -> Modes:
    if asked.band_hz:
        return modes_in_band(pencil, *asked.band_hz)
    assert asked.near_hz is not None and asked.count is not None
    return modes_near(pencil, asked.near_hz, asked.count)


def _merged(asked: Request, classes: dict[str | None, _Class]) -> tuple[list[ModeRow], Count]:
    """The modes that were asked for over all classes in ascending order, and their count between common ends."""
    rows = [row for one in classes.values() for row in one.rows]
    rows.sort(key=lambda row: (row.frequency_hz, row.parity or ""))
    counts = [one.count for one in classes.values()]
    count = Count(
        max(c.low_hz for c in counts),
        min(c.high_hz for c in counts),
        sum(c.expected for c in counts),
        sum(c.found for c in counts),
    )
    return _nearest(rows, asked, count) if asked.count is not None and not asked.band_hz else (rows, count)


def _nearest(rows: list[ModeRow], asked: Request, count: Count) -> tuple[list[ModeRow], Count]:
    """The `count` modes nearest to the frequency over all classes, degenerate partners of the last one kept.

    Every class is complete in its own, wider interval, so the common one is complete too.
    """
    assert asked.near_hz is not None and asked.count is not None
    near = asked.near_hz
    ordered = sorted(rows, key=lambda row: abs(row.frequency_hz - near))
    size = min(asked.count, len(ordered))
    while size < len(ordered) and _same(ordered[size].frequency_hz, ordered[size - 1].frequency_hz):
        size += 1
    kept = ordered[:size]
    inner = abs(kept[-1].frequency_hz - near) if kept else 0.0
    outer = abs(ordered[size].frequency_hz - near) if size < len(ordered) else None
    reach = (inner + outer) / 2.0 if outer is not None else count.high_hz - near
    low, high = max(near - reach, 0.0), near + reach
    missing = count.expected - count.found
    return sorted(kept, key=lambda row: (row.frequency_hz, row.parity or "")), Count(low, high, size + missing, size)


def _same(first: float, second: float) -> bool:
    return abs(first - second) <= 1e-6 * max(first, second)


def wanted_record(found: PartModes) -> dict[str, Any]:
    """The wanted mode's measures and rivals, its pillars' share of kinetic energy, where it stands among the modes (`index`).

    Without a wanted mode, its status and window alone.
    """
    assert found.wanted
    row, document = found.wanted.row, found.wanted.json()
    if row is None:
        return document
    vector = found.vectors[row.parity][:, [row.column]]
    return document | {
        "index": found.index(row),
        "extension_db": row.extension_db,
        "frequency_error": found.bar.frequency if found.bar else None,
        "confinement_error_db": found.bar.confinement_db if found.bar else None,
        "pillar_energy_share": float(found.model.pillar_share(row.parity, vector)[0]),
    }
