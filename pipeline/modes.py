"""Modes of a part: every mirror class asked for, merged, counted and measured."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from geometry.elements import FloatArray
from pipeline import calibration, error_model, foresight, omissions, part_models
from pipeline.asked import DEFAULT_COUNT, Request, model_high_hz, understood
from pipeline.case import Case
from pipeline.climb import MARGIN, climbed, refused, remeshed, warn
from pipeline.error_model import ErrorBar
from pipeline.errors import InputFault
from pipeline.logs import Log
from pipeline.part_models import PartModel
from pipeline.predesign import short_wave
from pipeline.ways import Way, way_of
from solvers.confinement import Confinement, measure, wanted_parity
from solvers.fem.eigen import Count, Modes, modes_in_band, modes_near
from solvers.mixing import mixing_db
from solvers.superelement.build import PlateModel
from solvers.superelement.plate_estimate import ModeErrors

__all__ = ["DEFAULT_COUNT", "ModeRow", "PartModes", "Request", "mode_rows", "solve_modes", "understood", "wanted_row"]


@dataclass(frozen=True)
class ModeRow:
    """One mode: where its vector is (class and column), and its measures (None where they have no meaning)."""

    frequency_hz: float
    residual: float
    parity: str | None
    column: int
    zone_share: float | None
    confinement_db: float | None
    mac: float | None
    extension_db: float | None = None


@dataclass(frozen=True)
class PartModes:
    """Modes of a part in ascending order, with the model and the vectors behind them.

    reduction_error and expected_error (by the mesh) are those of any mode, relative; `bar` is the wanted mode's.
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

    @property
    def highest_hz(self) -> float:
        """The highest frequency, 0 without modes."""
        return self.rows[-1].frequency_hz if self.rows else 0.0

    def json(self) -> dict[str, Any]:
        """The contract's fields, without times."""
        keys = ("frequency_hz", "residual", "parity", "zone_share", "confinement_db", "mac")
        return {
            "schema": 1,
            "model": self.model.name,
            "part": self.part,
            "dof": self.dof,
            "rigid_count": self.rigid_count,
            "modes": [{key: getattr(row, key) for key in keys} for row in self.rows],
            "count_check": {
                "low_hz": self.count.low_hz,
                "high_hz": self.count.high_hz,
                "expected": self.count.expected,
                "found": self.count.found,
            },
            "reduction_error": self.reduction_error,
            "expected_error": self.expected_error,
            "error_bar": self.bar.json() if self.bar else None,
        }


def solve_modes(case: Case, request: Request, log: Log) -> PartModes:
    """Solve a part's modes. Raises SolverError (not trusted), MeshError, InputFault (a class the part does not have)."""
    asked = understood(case, request)
    way = way_of(case, asked.part, model_high_hz(case, asked))
    foresight.announce(f"modes of the {asked.part}", foresight.of_modes(case, way, asked), log)
    if asked.part != "pillar" and (short := short_wave(case.design)):
        log.alarm("SHORT_WAVE", short)
    unpatched = omissions.no_patches(case.patches, ()) if asked.part == "plate" and case.patches else None
    omissions.told((*way.left_out, unpatched, omissions.other_classes(way.classes, asked.parity)), log)
    found, errors = _solved(case, asked, way, log)
    if higher := remeshed(way, found.highest_hz, case, log):
        (found, errors), way = _solved(case, asked, higher, log), higher
    judged = _judged(case, found, errors)
    finer = climbed(way, judged.modes, judged.degrees, case, log) if judged else None
    if finer:
        with refused(log):
            (found, errors), way = _solved(case, asked, finer, log), finer
            judged = _judged(case, found, errors)
    if judged:
        log.info(
            f"high by the reduction, as truncations tell: the wanted mode {judged.total:.2%}, "
            f"any mode {judged.worst:.2%} at most"
        )
        warn(judged.total, case, log)
    expected = error_model.told(way, case, log, found.highest_hz)
    bar = _bar(case, way, found, MARGIN * judged.total if judged else None)
    return replace(found, reduction_error=judged.worst if judged else None, expected_error=expected, bar=bar)


def _solved(case: Case, asked: Request, way: Way, log: Log) -> tuple[PartModes, dict[str | None, ModeErrors]]:
    """The modes by one way, and for a reduced body the errors by its reduction, class by class."""
    meshes: list[dict[str, Any]] = []
    model = part_models.built(case, way, log, meshes)
    solved: dict[str | None, Modes] = {}
    errors: dict[str | None, ModeErrors] = {}
    dof = 0
    for parity in _classes(model, asked.parity):
        with log.step(f"solve class {parity or 'whole'}"):
            pencil = model.pencil(parity)
            dof += pencil.dof
            solved[parity] = _solve(pencil, asked)
            if isinstance(model, PlateModel):
                errors[parity] = model.mode_errors(parity, pencil, solved[parity].vectors)
        log.info(f"class {parity or 'whole'}: {pencil.dof} unknowns, {len(solved[parity].frequency_hz)} modes")
    return _merged(case, asked, model, solved, dof, meshes), errors


@dataclass(frozen=True)
class _Judged:
    """How far the reduction may put modes too high, relative: the worst of all; the wanted one's by modes and by degrees."""

    worst: float
    modes: float
    degrees: float

    @property
    def total(self) -> float:
        return self.modes + self.degrees


def _judged(case: Case, found: PartModes, errors: dict[str | None, ModeErrors]) -> _Judged | None:
    """The reduction's estimate; None for a body that was not reduced. Without a wanted mode the worst one stands for it."""
    if not errors:
        return None
    every = np.hstack([np.vstack([each.modes, each.degrees]) for each in errors.values()])
    if not every.shape[1]:
        return _Judged(0.0, 0.0, 0.0)
    worst = every[:, int(np.argmax(every.sum(axis=0)))]
    index = wanted_row(found, case)
    row = found.rows[index] if index is not None else None
    own = (errors[row.parity].modes[row.column], errors[row.parity].degrees[row.column]) if row else worst
    return _Judged(float(worst.sum()), float(own[0]), float(own[1]))


def _bar(case: Case, way: Way, found: PartModes, reduction: float | None) -> ErrorBar | None:
    """What the wanted mode's frequency and confinement may be off by; None without one."""
    index = wanted_row(found, case)
    if index is None:
        return None
    row = found.rows[index]
    bar = ErrorBar(error_model.expected_error(way, case.design, row.frequency_hz), reduction)
    if bar.frequency is None or row.confinement_db is None:
        return bar
    kin = [each for each in found.rows if each.parity == row.parity]
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


def _solve(pencil: Any, asked: Request) -> Modes:
    if asked.band_hz:
        return modes_in_band(pencil, *asked.band_hz)
    assert asked.near_hz is not None and asked.count is not None
    return modes_near(pencil, asked.near_hz, asked.count)


def _merged(
    case: Case,
    asked: Request,
    model: PartModel,
    solved: dict[str | None, Modes],
    dof: int,
    meshes: list[dict[str, Any]],
) -> PartModes:
    rows = [row for parity, modes in solved.items() for row in _rows(case, asked.part, model, parity, modes)]
    rows.sort(key=lambda row: (row.frequency_hz, row.parity or ""))
    counts = [modes.count for modes in solved.values()]
    count = Count(
        max(c.low_hz for c in counts),
        min(c.high_hz for c in counts),
        sum(c.expected for c in counts),
        sum(c.found for c in counts),
    )
    if asked.count is not None and not asked.band_hz:
        rows, count = _nearest(rows, asked, count)
    return PartModes(
        asked.part,
        model,
        tuple(rows),
        {parity: modes.vectors for parity, modes in solved.items()},
        dof,
        sum(modes.rigid_count for modes in solved.values()),
        count,
        meshes,
    )


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


def _rows(case: Case, part: str, model: PartModel, parity: str | None, modes: Modes) -> list[ModeRow]:
    measures: Confinement | None = None
    if part != "pillar" and len(modes.frequency_hz):
        measures = measure(model.touch(parity, modes.vectors), case.design, parity)
    return mode_rows(modes, parity, measures)


def mode_rows(modes: Modes, parity: str | None, measures: Confinement | None) -> list[ModeRow]:
    """One row a mode; a measure that has no meaning, or none at all, is None."""

    def at(values: FloatArray | None, index: int) -> float | None:
        value = float(values[index]) if values is not None else math.nan
        return value if math.isfinite(value) else None

    return [
        ModeRow(
            float(frequency),
            float(modes.residual[i]),
            parity,
            i,
            at(measures.zone_share if measures else None, i),
            at(measures.confinement_db if measures else None, i),
            at(measures.mac if measures else None, i),
            at(measures.extension_db if measures else None, i),
        )
        for i, frequency in enumerate(modes.frequency_hz)
    ]


def wanted_row(found: PartModes, case: Case) -> int | None:
    """Index of the mode that looks most like the wanted one, weighted by its share inside the zone; None without modes."""
    parity = wanted_parity(case.design.nodal_lines)
    scores = [
        (row.mac or 0.0) * (1.0 if row.zone_share is None else row.zone_share) if row.parity in (None, parity) else 0.0
        for row in found.rows
    ]
    return int(np.argmax(scores)) if scores and max(scores) > 0.0 else None


def wanted_record(found: PartModes, index: int) -> dict[str, Any]:
    """The wanted mode's measures, its pillars' share of kinetic energy, and the modes that share its shape.

    Near the pillars' resonance the wanted shape is spread over several modes: the cluster lists those with at least a
    tenth of the best score, each with its share of their sum.
    """
    row = found.rows[index]
    score = [(r.mac or 0.0) * (1.0 if r.zone_share is None else r.zone_share) for r in found.rows]
    members = [i for i, s in enumerate(score) if s >= 0.1 * score[index]]
    total = sum(score[i] for i in members)
    vector = found.vectors[row.parity][:, [row.column]]
    return {
        "index": index,
        "frequency_hz": row.frequency_hz,
        "parity": row.parity,
        "mac": row.mac,
        "zone_share": row.zone_share,
        "confinement_db": row.confinement_db,
        "extension_db": row.extension_db,
        "frequency_error": found.bar.frequency if found.bar else None,
        "confinement_error_db": found.bar.confinement_db if found.bar else None,
        "pillar_energy_share": float(found.model.pillar_share(row.parity, vector)[0]),
        "cluster": [
            {"frequency_hz": found.rows[i].frequency_hz, "mac": found.rows[i].mac, "share": score[i] / total}
            for i in members
        ],
    }
