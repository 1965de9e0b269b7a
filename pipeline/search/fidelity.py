"""Evaluation of one design by one model, from a strip in milliseconds to the assembled plate, with a disk cache."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable
from dataclasses import replace
from math import ceil, floor, inf
from pathlib import Path
from typing import Any

from geometry.errors import GeometryError, MeshError
from geometry.layout import Design
from pipeline.case.model import Case
from pipeline.errors import InputError
from pipeline.logs import WarningLog
from pipeline.models import forced, modes, parametric
from pipeline.models.answer_parts import worst_of
from pipeline.models.broadband import broadband
from pipeline.models.cell_cache import Cache, CellCache
from pipeline.models.live_column import LiveCell, live_modes
from pipeline.paths import RESULTS
from pipeline.planning import mesh_rules
from pipeline.planning.model_choice import check_stagger, of_case, with_defaults
from pipeline.planning.plan import modes_step
from pipeline.quantity import KHZ, MM
from pipeline.records import store
from pipeline.search.terms import COLUMN, PLATE, SOLID, STRIP, FidelityResult, Window
from solvers.analytic.predesign import free_kx_per_m
from solvers.errors import SolverError
from solvers.measures.confinement import DrivenZones, measure_profile
from solvers.plates.assembled import Reductions
from solvers.plates.column import Column
from solvers.plates.strip import strip_modes, strip_zones

MODELS = {
    STRIP: "thin strip across the plate, pillars as beams on lines",
    COLUMN: "one column of reduced cells at the wavenumber between free ends",
    PLATE: "plate assembled from reduced cells",
    SOLID: "the whole plate as one solid mesh",
}
SLACK = {STRIP: 0.1, COLUMN: 0.02, PLATE: 0.0, SOLID: 0.0}  # least relative error of each model's frequency
# a column omits the free ends, which shift the N - 1/2 half-waves of a zone: the relative frequency error is ENDS over this
# number, the level error the level over it plus LEVEL_DB. `python -m studies.live plates` checks both with assembled plates
ENDS, LEVEL_DB = 0.26, 1.0
COLUMN_ACCURACY = 0.01  # a coarser mesh ranks designs no faster
AROUND = 0.07  # of the column's frequency: half-width of the search window for the plate's target mode
SOLID_ACCURACY = 0.04  # a finer whole plate does not fit into the memory of a desktop computer
NEAREST = 30  # modes of the solid around this frequency
PEAKS = 2  # frequencies over a band of several zones: peaks are found without them
BAND_POINTS = 101  # frequencies over the target mode's window that locate the ends of a band
GRID_HZ = 2500.0  # windows begin and end on this grid, so that neighbours in the search share their bare cells


def frequency_slack(fidelity: str, nodal_lines: int) -> float:
    """Relative error of a model's target frequency compared with the plate's, for the nodal lines along the zone."""
    return max(SLACK[fidelity], ENDS / _half_waves(nodal_lines)) if fidelity in (STRIP, COLUMN) else SLACK[fidelity]


def column_level_error_db(level_db: float | None, nodal_lines: int) -> float | None:
    """Error of a column's confinement compared with the plate's, dB; None if it has none."""
    return None if level_db is None else LEVEL_DB + abs(level_db) / _half_waves(nodal_lines)


def _half_waves(nodal_lines: int) -> float:
    """Number of half-waves along the zone; rigid shapes count as the longest shape that bends."""
    return max(nodal_lines, 2) - 0.5


def worst(case: Case, height_m: float, evaluated: Callable[[Case], FidelityResult]) -> FidelityResult:
    """Evaluate a design; worst_db is its least confinement with all pillars as designed, too low or too high.

    worst_db is None if one of the three plates has no target mode.
    """
    results = [evaluated(_taller(case, change)) for change in (0.0, -height_m, height_m)]
    levels = [each.confinement_db for each in results if each.confinement_db is not None]
    if len(levels) < len(results):
        return results[0]
    errors = [each.confinement_error_db for each in results if each.confinement_error_db is not None]
    bar = _error_of_least(levels, errors) if len(errors) == len(levels) else None
    return replace(results[0], worst_db=min(levels), worst_error_db=bar)


def _error_of_least(values: list[float], errors: list[float]) -> float:
    """Error of the least of some values, each of which varies within its own error."""
    low, high = (min(value + sign * error for value, error in zip(values, errors, strict=True)) for sign in (-1, 1))
    return max(min(values) - low, high - min(values))


def _taller(case: Case, change_m: float) -> Case:
    """Change the height of every pillar by the same amount."""
    if not change_m:
        return case
    design = case.design
    first, *others = (
        replace(pillar, height_m=pillar.height_m + change_m) for pillar in (design.pillar, *design.graded) if pillar
    )
    return replace(case, design=replace(design, pillar=first, graded=tuple(others)))


def by_strip(case: Case, softness: float) -> FidelityResult:
    """Estimate the target mode from a strip whose pillars' feet have `softness` times the compliance of a half-space."""
    design = case.design.unsupported
    try:
        solved = strip_modes(design.one_zone, *mesh_rules.target_window_hz(design), softness)
        alone = _of_profile(STRIP, solved.frequency_hz, solved.confinement)
        if design.zones == 1 or alone.frequency_hz is None:
            return alone
        return _of_zones(
            alone, strip_zones(design, *_about(alone.frequency_hz), case.one_quality_factor("search"), softness), design
        )
    except SolverError as error:
        return FidelityResult(fidelity=STRIP, why_not=str(error))


def evaluate(
    case: Case, fidelity: str, near_hz: float | None = None, cache: EvaluationCache | None = None, banded: bool = False
) -> FidelityResult:
    """Compute the target mode with one model, near a frequency if one is known, or load it from the cache.

    banded: adds the width of the band around it in which the rows attenuate a wave by 10 dB or more, 0 if there is none.
    """
    question: dict[str, Any] = {"case": case.to_dict(), "fidelity": fidelity, "near_hz": near_hz}
    if banded:
        question["banded"] = True
    if fidelity == COLUMN and kept_cell(case):
        question["cell"] = "parametric"
    stored = cache.get(question) if cache else None
    if stored is not None:
        return stored
    solved = _solved(case, fidelity, near_hz, banded)
    if cache:
        cache.put(question, solved)
    return solved


def _stopped_khz(case: Case, fidelity: str, frequency_hz: float) -> float:
    """Width of the band around a frequency in which the rows attenuate a flexural wave by 10 dB or more, kHz."""
    accuracy = max(COLUMN_ACCURACY, case.solve.accuracy) if fidelity == COLUMN else case.solve.accuracy
    window = mesh_rules.target_window_hz(case.design)
    broad = broadband(case, WarningLog(), window, BAND_POINTS, accuracy, with_bars=False)
    return sum(high - low for low, high in broad["stopped"] if low <= frequency_hz <= high) / KHZ


def kept_cell(case: Case) -> Any:
    """Return the parametric cell that an explorer has cached, or None."""
    return parametric.kept_cell(case) if case.design.zones == 1 else None


def _solved(case: Case, fidelity: str, near_hz: float | None, banded: bool) -> FidelityResult:
    solve = {COLUMN: _by_column, PLATE: _by_plate, SOLID: _by_plate}[fidelity]
    if fidelity == PLATE and case.design.zones > 1:
        solve = _by_zones
    try:
        solved = solve(case, fidelity, near_hz)
        if banded and solved.frequency_hz is not None:
            solved = replace(solved, band_khz=_stopped_khz(case, fidelity, solved.frequency_hz))
        return solved
    except (SolverError, MeshError, GeometryError, InputError) as error:
        return FidelityResult(fidelity=fidelity, why_not=" ".join(str(error).split()))


def _by_column(case: Case, fidelity: str, near_hz: float | None) -> FidelityResult:
    design = case.design.unsupported
    if design.is_staggered:
        check_stagger(case)
    low, high = mesh_rules.target_window_hz(design)
    cell, kx = kept_cell(case), free_kx_per_m(design)
    if cell is not None:
        frequency_hz, profile = live_modes(case, LiveCell(cell), {}, (low, high))
        return _of_profile(fidelity, frequency_hz, measure_profile(profile, design))
    reduction = mesh_rules.plate_reduction(design, max(COLUMN_ACCURACY, case.solve.accuracy), _outwards(low, high)[1])
    reductions = Reductions(design.stack, design.pillar, reduction, CellCache())
    solved = Column(design.one_zone, reductions, kx).modes(low, high)
    alone = _of_profile(fidelity, solved.frequency_hz, solved.confinement)
    if design.zones == 1 or alone.frequency_hz is None:
        return alone
    both = Column(design, reductions, kx)
    return _of_zones(alone, both.zones(*_about(alone.frequency_hz), case.one_quality_factor("search")), design)


def _of_zones(alone: FidelityResult, driven: DrivenZones, design: Design) -> FidelityResult:
    """Extend the result of a single zone by those of several zones driven in turn around its frequency."""
    return replace(
        alone,
        frequency_hz=float(driven.peak_hz.min()),
        confinement_db=driven.confinement_db,
        extension_db=None,
        mac=float(driven.mac.min()),
        isolation_db=driven.isolation_db,
        gap_mm=design.zone_gap_m / MM,
    )


def _by_zones(case: Case, fidelity: str, near_hz: float | None) -> FidelityResult:
    """Drive every zone of the assembled plate around a frequency, or in the case's own window."""
    log = WarningLog()
    band_hz = of_case(case).band_hz if near_hz is None else _outwards(*_about(near_hz))
    zones = forced.solve(case, log, band_hz, PEAKS, [])["zones"]
    lowest = min(zones, key=lambda zone: zone.peak_hz)
    loudest = max(zones, key=lambda zone: -inf if zone.passive_db is None else zone.passive_db)
    level, level_error = worst_of(zones)
    return FidelityResult(
        fidelity=fidelity,
        frequency_hz=lowest.peak_hz,
        confinement_db=None if loudest.passive_db is None else -loudest.passive_db,
        mac=min((zone.mac for zone in zones if zone.mac is not None), default=None),
        frequency_error=lowest.peak_error,
        confinement_error_db=loudest.passive_error_db,
        warnings=log.warnings,
        isolation_db=None if level is None else -level,
        isolation_error_db=level_error,
        gap_mm=case.design.zone_gap_m / MM,
    )


def _of_profile(fidelity: str, frequency_hz: Any, level: Any) -> FidelityResult:
    if not len(frequency_hz):
        return FidelityResult(fidelity=fidelity, why_not="no mode of the target symmetry in the window")
    at = level.target.index
    if at is None:
        return FidelityResult(fidelity=fidelity, why_not="no mode of the target shape in the window")
    names = ("confinement_db", "extension_db", "mac")
    return FidelityResult(
        fidelity=fidelity, frequency_hz=frequency_hz[at], **{name: getattr(level, name)[at] for name in names}
    )


def _by_plate(case: Case, fidelity: str, near_hz: float | None) -> FidelityResult:
    """Solve the assembled plate like `antinode modes`, or the solid around a frequency."""
    solve = case.solve.but(model="auto")
    if fidelity == SOLID:
        solve = case.solve.but(model="solid", accuracy=max(SOLID_ACCURACY, case.solve.accuracy))
    case = replace(case, solve=solve)
    request = of_case(case)
    if near_hz and fidelity == SOLID:  # a whole mesh pays for every mode
        request = modes.Request("plate", near_hz=near_hz, count=NEAREST, symmetry=case.target_symmetry, search=False)
    log = WarningLog()
    spared = fidelity == PLATE and case.design.larger_m  # as `antinode modes` plans them
    part_modes = modes.solve_modes(case, request, log, modes_step(case, request).choice if spared else None)
    row = part_modes.target_row
    if row is None:
        return FidelityResult(fidelity=fidelity, why_not="no mode of the target shape in the window")
    return FidelityResult.of(row, fidelity=fidelity, frequency_error=row.error, warnings=log.warnings)


def window_around(case: Case, near_hz: float | None) -> Window | None:
    """Widen a case's window until a frequency lies well inside, kHz; None if it does already."""
    query = with_defaults(case, of_case(case))
    if near_hz is None or (query.band_hz and query.band_hz[0] <= near_hz * 0.97 and near_hz * 1.03 <= query.band_hz[1]):
        return None
    low, high = _outwards(*_about(near_hz))
    if query.band_hz:
        low, high = min(low, query.band_hz[0]), max(high, query.band_hz[1])
    return low / KHZ, high / KHZ


def _about(near_hz: float) -> tuple[float, float]:
    return near_hz * (1.0 - AROUND), near_hz * (1.0 + AROUND)


def _outwards(low: float, high: float) -> tuple[float, float]:
    return GRID_HZ * floor(low / GRID_HZ), GRID_HZ * ceil(high / GRID_HZ)


class EvaluationCache:
    """Evaluations as JSON under the hash of their question and of the computing sources."""

    def __init__(self, folder: Path = RESULTS / ".search") -> None:
        self._files = Cache(folder)

    def get(self, question: dict[str, Any]) -> FidelityResult | None:
        """Return the evaluation made before by the same code, or None."""
        content = self._files.read(self._name(question))
        return None if content is None else FidelityResult(**json.loads(content))

    def put(self, question: dict[str, Any], result: FidelityResult) -> None:
        """Keep an evaluation; if the disk is full, it is computed again in the next run."""
        self._files.write(self._name(question), json.dumps(result.values() | {"warnings": result.warnings}).encode())

    def _name(self, question: dict[str, Any]) -> str:
        salted = {"question": question, "code": store.current_fingerprint().code_hash}
        return hashlib.sha256(store.canonical_json(salted).encode()).hexdigest()[:32]
