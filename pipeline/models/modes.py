"""Modes of a part: every requested symmetry class solved, merged, counted and measured, and the target mode among them."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property, partial
from math import inf, nan
from typing import Any

import numpy as np

from geometry.elements import FloatArray
from geometry.layout import Design
from geometry.supports import has_dampers
from pipeline.case.limits import short_wave
from pipeline.case.model import Case
from pipeline.errors import InputError
from pipeline.logs import Log
from pipeline.models import own_frequency, parts
from pipeline.models.answer_parts import ALONG, CountRecord, TargetRecord, ZoneTarget
from pipeline.models.parts import CoarseModes, MeshErrorSource, PartModel, coarse_modes
from pipeline.models.target import (
    ModeRow,
    Target,
    joined,
    look,
    look_about,
    look_among,
    measured,
    mode_rows,
    verdict_text,
)
from pipeline.planning import refinement, resource_estimate, simplifications
from pipeline.planning.model_choice import (
    DEFAULT_COUNT,
    MEASURED,
    Expected,
    ModelChoice,
    Request,
    model_choice_of,
    model_high_hz,
    target_window_hz,
    with_defaults,
    with_search,
)
from pipeline.planning.refinement import (
    MARGIN,
    ErrorEstimate,
    on_finer_meshes,
    raise_cutoff,
    refine_mesh,
    refine_reduction,
    step_by_step,
    warn,
)
from pipeline.planning.resources import ResourceEstimate
from pipeline.planning.simplifications import khz
from pipeline.quantity import frequency, interval, percent, several
from pipeline.quantity import level as level_text
from pipeline.records.record import MeshRecord
from solvers.accuracy import calibration
from solvers.accuracy.mesh import largest
from solvers.accuracy.reduction import ModeErrors, by_modes, mode_errors, more_below
from solvers.fem.eigen import Count, Modes, PlainPencil, Shared, modes_in_band, modes_near
from solvers.fem.factor import Factoriser, parallel_map
from solvers.fem.missing_mode import largest_outside
from solvers.fem.solid import Pencil
from solvers.measures.confinement import (
    Confinement,
    Overlaps,
    Pair,
    Weighed,
    mixed_energy,
    mixed_shares,
    share_error,
    strength_force,
    target_symmetry,
)
from solvers.measures.loss import loss_factors, of_discarded, quality_and_bar
from solvers.measures.radiation import air_loss_factors
from solvers.plates.assembled import PlateModel
from solvers.plates.released import Released, released
from solvers.threads import one_thread

__all__ = ["DEFAULT_COUNT", "Expected", "PartModes", "Request", "solve_modes", "with_defaults"]
TUNINGS = 6  # most solutions for moduli that depend on the frequency
DEEPER = 3  # most refinements of a reduction: all but the first raise the degree through the thickness
ROUNDED = 0.01  # of the rest of a bar: rounding beyond it is a part of the bar
PASSES = 4  # most times that a part is meshed or reduced again for the frequencies found
# a band of a body meshed whole is searched beyond its end by this multiple of its modes' relative correction, which is limited
BEYOND_END, LARGEST = 1.5, 1.0 / 3.0


@dataclass(frozen=True)
class PartModes:
    """Modes of a part in ascending order, with the model and the eigenvectors behind them.

    reduction_error and expected_error (discretisation) are the largest of any mode, relative; `errors` holds those of each
    class's columns, None if none were requested. `target` is None if there can be none: another symmetry class, an isolated
    pillar, a mesh without touch face. more_in_mesh: upper bound on the further modes that the full meshes of a reduced plate
    have up to the end of the count.
    """

    part: str
    model: PartModel
    rows: tuple[ModeRow, ...]
    vectors: dict[str | None, FloatArray]
    dof: int
    rigid_count: int
    count: Count
    meshes: list[MeshRecord]
    reduction_error: float | None = None
    expected_error: float | None = None
    errors: dict[str | None, ModeErrors] | None = None
    target: Target | None = None
    more_in_mesh: int | None = None
    nearest_hz: float | None = None  # nearest mode to a band without modes
    overlaps: dict[str | None, Pair | None] = field(
        default_factory=dict
    )  # of each class's columns, where they are known

    @property
    def target_row(self) -> ModeRow | None:
        """The target mode, or None."""
        return self.target.row if self.target else None

    def each(self, change: Callable[[ModeRow], ModeRow]) -> PartModes:
        """Apply a function to every mode; the result is in ascending order."""
        target = self.target and self.target.each(change)
        return replace(self, rows=tuple(sorted(map(change, self.rows), key=_place)), target=target)

    def all_rows(self, searched: bool) -> tuple[ModeRow, ...]:
        """The rows, and those that a search for the target mode examined; other modes that were solved are not used."""
        return (*self.rows, *(self.target.rows if self.target and searched else ()))

    @property
    def whole_window(self) -> PartModes:
        """Return the modes joined with all that the search for the target mode examined, if all are of one class."""
        part_modes = self.target
        if part_modes is None or part_modes.count is None or len(self.vectors) > 1:
            return self
        rows = sorted(
            {row.column: row for row in (*self.rows, *part_modes.rows)}.values(), key=lambda row: row.frequency_hz
        )
        low, high = min(self.count.low_hz, part_modes.low_hz), max(self.count.high_hz, part_modes.high_hz)
        below = self.count.below if low == self.count.low_hz else None
        return replace(self, rows=tuple(rows), count=Count(low, high, len(rows), len(rows), below))

    def mesh_error(self, row: ModeRow) -> float | None:
        """Discretisation error of a frequency, relative; None without an estimate."""
        own = (self.errors or {}).get(row.symmetry)
        return None if own is None or np.isnan(own.mesh[row.column]) else float(own.mesh[row.column])

    def index(self, row: ModeRow | None) -> int | None:
        """Return the place of a mode among `rows`; None if it is not there."""
        places = (
            i for i, one in enumerate(self.rows) if row and (one.symmetry, one.column) == (row.symmetry, row.column)
        )
        return next(places, None)

    @property
    def counts(self) -> str:
        """Name of the matrices whose eigenvalues are counted."""
        return "reduced pencil" if isinstance(self.model, PlateModel) else "mesh"

    @property
    def count_check(self) -> CountRecord:
        """Inertia count and the number of modes found."""
        return CountRecord.of(self.count, counts=self.counts, more_in_mesh_at_most=self.more_in_mesh)

    def target_part(self) -> TargetRecord | None:
        """Target mode with its error bar, its place among the modes and the pillars' share of its kinetic energy."""
        row = self.target_row
        if self.target is None or row is None:
            return self.target.record() if self.target else None
        share, error = self._pillar_share(row) if self.part == "plate" else (None, None)
        return self.target.record(
            index=self.index(row),
            frequency_error=row.error,
            pillar_energy_share=share,
            pillar_energy_share_error=error,
        )

    def _pillar_share(self, row: ModeRow) -> tuple[float, float | None]:
        """Pillars' share of the target mode's kinetic energy, and its error from neighbours that mix into the mode."""
        assert self.target is not None
        own, mixing = partial(self.model.pillar_share, row.symmetry), calibration.mixing()
        vectors, siblings = self.vectors[row.symmetry], list(self.target.rows)
        half = row.error
        if half is None or mixing is None or row not in siblings:
            return float(own(vectors[:, [row.column]])[0]), None
        place = siblings.index(row)
        mixed = mixing * mixed_shares(np.array([each.frequency_hz for each in siblings]), place, half)
        return mixed_energy(own, vectors[:, [each.column for each in siblings]], place, mixed)


@one_thread()
def solve_modes(case: Case, request: Request, log: Log, choice: ModelChoice | None = None) -> PartModes:
    """Solve a part's modes.

    Parameters
    ----------
    case
        The case.
    request
        The modes to solve.
    log
        Receives the progress.
    choice
        Model and mesh of a plan that was logged; None to choose and log them here.

    Raises
    ------
    SolverError
        For modes that fail their checks.
    MeshError
        For a part that cannot be meshed.
    InputError
        For a symmetry class that the part does not have.
    """
    if own_frequency.is_open(case, request.part):
        return _at_own_frequencies(case, request, log, choice)
    query = with_defaults(case, request)
    if choice is None:
        choice = model_choice_of(case, query.part, model_high_hz(case, query))
        resource_estimate.log_estimate(
            f"modes of the {query.part}", resource_estimate.of_modes(case, choice, with_search(case, query)), log
        )
        unpatched = simplifications.no_patches(case.patches) if query.part == "plate" and case.patches else None
        others = simplifications.other_classes(choice.classes, query.symmetry)
        simplifications.log_all((*choice.left_out, unpatched, others), log)
    if query.part != "pillar" and (short := short_wave(case.design)):
        log.warning("SHORT_WAVE", short)
    part_modes, choice = _within_reach(case, query, choice, log)
    _warn_of_nothing(part_modes, query, log)
    solve = partial(_solved, case, query, log=log)

    def demand(finer: ModelChoice) -> ResourceEstimate:
        return resource_estimate.of_modes(case, finer, with_search(case, query))

    def deeper(choice: ModelChoice, solved: PartModes, taken: int) -> ModelChoice | None:
        estimate = _error_estimate(solved)
        finer = refine_reduction(choice, estimate, case, log) if estimate else None
        if finer is None or (taken and not _is_deeper(finer, choice)):
            return None
        return finer if resource_estimate.fits(demand(finer), log) else None

    choice, part_modes = on_finer_meshes(
        step_by_step((choice, part_modes), deeper, solve, DEEPER, log),
        lambda solved: (_decisive(solved), 0.0),
        solve,
        demand,
        case,
        log,
    )
    estimate = _error_estimate(part_modes)
    if estimate:
        log.info(
            f"truncation error: {percent(estimate.total)} of the target mode, at most {percent(estimate.worst)} of any mode "
            "(estimated from the discarded modes)"
        )
        warn(estimate.total, case, log)
    expected = refinement.log_mesh_error(choice, case, log, _by_the_mesh(part_modes, part_modes.all_rows(query.search)))
    return replace(
        with_quality(case, _with_level_bars(case, _with_errors(part_modes))),
        reduction_error=estimate.worst if estimate else None,
        expected_error=expected,
    )


def _at_own_frequencies(case: Case, request: Request, log: Log, choice: ModelChoice | None) -> PartModes:
    """Solve modes with the moduli at the frequency of the target mode, or of the middle one, and enclose the others."""
    query, first = with_defaults(case, request), own_frequency.of_part(case, request.part)
    tone = next(each.taken_hz for each in first.materials if each.taken_hz is not None)
    tone = float(np.mean(query.band_hz)) if query.band_hz else query.near_hz or tone
    for _ in range(TUNINGS):
        tuned = own_frequency.taken_at(case, tone)
        solved, own = solve_modes(tuned, request, log, choice), own_frequency.of_part(tuned, request.part)
        row = solved.target_row or (solved.rows[len(solved.rows) // 2] if solved.rows else None)
        found = float(own.centred(np.array([row.frequency_hz]))[0][0]) if row else tone
        if own.stiffer(found) <= own_frequency.SETTLED:
            break
        log.info(f"moduli at {frequency(tone)} give a mode at {frequency(found)}: solved again with those there")
        tone = found
    solved = solved.each(lambda row: _own(row, own))
    for line in own.beyond(np.array([row.frequency_hz for row in solved.rows])):
        log.warning("MATERIAL", line)
    return solved


def _own(row: ModeRow, own: own_frequency.OwnFrequency) -> ModeRow:
    """A mode with the moduli at its own frequency; its bar holds what they leave open."""
    (middle,), (half,) = (each.tolist() for each in own.centred(np.array([row.frequency_hz])))
    changed: dict[str, Any] = {"frequency_hz": middle}
    if row.computed_hz is not None:
        changed["computed_hz"] = middle / row.frequency_hz * row.computed_hz
    if row.error is not None and half > 0.0:
        changed |= {"error": row.error + half, "error_parts": row.error_parts | {"moduli": half}}
    if row.quality_factor is not None and row.quality_error is not None:
        wider = row.quality_error + row.quality_factor * (own.lossier(middle) + own.stiffer(middle))
        changed["quality_error"] = wider if wider < row.quality_factor else None
    return replace(row, **changed)


def _is_deeper(finer: ModelChoice, choice: ModelChoice) -> bool:
    """Whether a finer reduction has a higher degree through the thickness."""
    own, other = choice.reduction, finer.reduction
    return own is not None and other is not None and other.interface.through > own.interface.through


def _decisive(part_modes: PartModes) -> float | None:
    """Discretisation error that has to meet the accuracy: that of a plate's target mode, else the largest."""
    row = part_modes.target_row if isinstance(part_modes.model, PlateModel) else None
    rows = (row,) if row else part_modes.rows
    return _by_the_mesh(part_modes, rows)


def _by_the_mesh(part_modes: PartModes, rows: Sequence[ModeRow]) -> float | None:
    """Largest discretisation error of some modes, relative; None without an estimate."""
    return largest(np.array([part_modes.mesh_error(row) for row in rows], dtype=float))


def _with_both(part_modes: PartModes) -> PartModes:
    """Add the frequencies of the finest mesh to the best ones.

    A plate's reduced matrices already include the correction; the frequencies of a body meshed whole are corrected here.
    """

    def with_both(row: ModeRow) -> ModeRow:
        own = (part_modes.errors or {}).get(row.symmetry)
        taken = float(own.taken[row.column]) if own else 0.0
        if isinstance(part_modes.model, PlateModel):
            return replace(row, computed_hz=row.frequency_hz * (1.0 + taken))
        return replace(row, computed_hz=row.frequency_hz, frequency_hz=row.frequency_hz * (1.0 - taken))

    return part_modes.each(with_both)


def _cut(part_modes: PartModes, band_hz: tuple[float, float] | None) -> PartModes:
    """Leave out the modes of a body meshed whole that their correction takes out of a band, on both sides of the count."""
    if band_hz is None or isinstance(part_modes.model, PlateModel):
        return part_modes
    rows, count = _inside(part_modes.rows, part_modes.count, band_hz, lambda row: row.frequency_hz)
    nearest = part_modes.nearest_hz
    if part_modes.rows and not rows:
        middle = sum(band_hz) / 2.0
        nearest = min((row.frequency_hz for row in part_modes.rows), key=lambda tone: abs(tone - middle))
    return replace(part_modes, rows=rows, count=count, nearest_hz=nearest)


def _inside(
    rows: tuple[ModeRow, ...], count: Count, band_hz: tuple[float, float], corrected: Callable[[ModeRow], float]
) -> tuple[tuple[ModeRow, ...], Count]:
    """Modes whose corrected frequency lies in a band, and the count without the others."""
    low, high = band_hz
    inside = tuple(row for row in rows if low <= corrected(row) <= high)
    out = len(rows) - len(inside)
    return inside, replace(count, high_hz=high, expected=count.expected - out, found=count.found - out)


def _with_errors(part_modes: PartModes) -> PartModes:
    """Add the error of each frequency: the estimated discretisation and truncation errors, and rounding where it counts."""

    def with_error(row: ModeRow) -> ModeRow:
        mesh, own = part_modes.mesh_error(row), (part_modes.errors or {}).get(row.symmetry)
        if mesh is None or own is None:
            return replace(row, error=None)
        parts = {"mesh": mesh, "truncation": MARGIN * float(own.total[row.column])}
        if row.rounding > ROUNDED * sum(parts.values()):
            parts["rounding"] = row.rounding
        return replace(row, error=sum(parts.values()), error_parts=parts)

    return part_modes.each(with_error)


def shape_error(part_modes: PartModes, row: ModeRow) -> float | None:
    """Relative error of the stiffness behind a mode's shape, halved; None where that of its frequency is unknown.

    Reduced panels are corrected before they are solved. The shape of a body solved whole is that of its mesh: what is taken
    off its frequency afterwards still mixes its neighbours into it.
    """
    if row.error is None or isinstance(part_modes.model, PlateModel) or row.computed_hz is None:
        return row.error
    return row.error + abs(row.computed_hz / row.frequency_hz - 1.0)


def _with_level_bars(case: Case, part_modes: PartModes) -> PartModes:
    """Add the error of each level; that of the target mode comes from its search."""
    share = calibration.mixing()
    known = {(row.symmetry, row.column): row for row in (*part_modes.all_rows(True), *_beyond(part_modes))}
    if share is None or all(row.confinement_db is None for row in known.values()):
        return part_modes
    bars: dict[tuple[str | None, int], dict[str, Any]] = {}
    for symmetry in {key[0] for key in known}:
        rows = sorted((row for key, row in known.items() if key[0] == symmetry), key=_place)
        if len(rows) > 1 and (overlaps := _overlaps(case, part_modes, rows)[0]):
            ends = _ends(part_modes)
            errors = [shape_error(part_modes, row) for row in rows]
            bars |= {
                (symmetry, row.column): _measure_bars(rows, i, overlaps, ends, share, errors[i])
                for i, row in enumerate(rows)
            }
    own = part_modes.target_row
    if own:
        error = shape_error(part_modes, own)
        levels = (None, None) if error is None else level_bars_db(case, part_modes, error)
        level: dict[str, Any] = dict(zip(("confinement_error_db", "extension_error_db"), levels, strict=True))
        bars[own.symmetry, own.column] = bars.get((own.symmetry, own.column), {}) | level

    def with_bar(row: ModeRow) -> ModeRow:
        own = bars.get((row.symmetry, row.column), {})
        share_bar = share_error(row.zone_share, own.get("confinement_error_db"))
        return replace(row, **own, zone_share_error=share_bar)

    return part_modes.each(with_bar)


def with_quality(case: Case, part_modes: PartModes) -> PartModes:
    """Add the quality factor of each mode where the materials give the loss, and that by radiation where there is air.

    Parameters
    ----------
    case
        The case with its materials.
    part_modes
        Modes with their error bars.

    Returns
    -------
    PartModes
        The same modes; with quality factors if the case takes them from the materials or has air.
    """
    air = case.air if part_modes.part != "pillar" else None
    dampers = part_modes.part == "plate" and has_dampers(case.design.supports)
    if not case.is_lossy and air is None and not dampers:
        return part_modes
    known = {(row.symmetry, row.column): row for row in (*part_modes.all_rows(True), *_beyond(part_modes))}
    lost = [material.lost for material in case.design.materials] if case.is_lossy else [0.0]
    most, least = max(lost), min(lost)
    quality: dict[tuple[str | None, int], dict[str, Any]] = {}
    for symmetry in {key[0] for key in known}:
        rows = sorted((row for key, row in known.items() if key[0] == symmetry), key=_place)
        model, vectors = part_modes.model, part_modes.vectors[symmetry][:, [row.column for row in rows]]
        corrected = not isinstance(model, PlateModel)
        solved_hz = np.array([row.computed_hz if corrected and row.computed_hz else row.frequency_hz for row in rows])
        radiated, touch = np.zeros(len(rows)), model.touch(symmetry, vectors) if air else None
        if air and touch:
            radiated = air_loss_factors(touch, symmetry, solved_hz, air)
        own, damped = np.full((2, len(rows)), np.nan), np.zeros(len(rows))
        if dampers and isinstance(model, PlateModel):
            taken = np.diag(model.assembled(symmetry).damping(vectors))
            damped = taken / np.sqrt(model.scale.eigenvalue(solved_hz))
        if case.is_lossy:
            value = model.scale.eigenvalue(solved_hz)
            own = np.array(loss_factors(value, model.lost(symmetry, vectors)))
            own[1] = np.abs(own[1])
            if isinstance(model, PlateModel):
                own[1] += of_discarded(most, least, 2.0 * by_modes(model.assembled(symmetry), value, vectors), own[0])
        known_q = 1.0 / case.quality_factor if dampers and case.quality_factor else nan
        for row, factor, change, sound, spent in zip(
            rows, *own.tolist(), radiated.tolist(), damped.tolist(), strict=True
        ):
            own_q = quality_and_bar(factor, most, row.error, change, sound + spent) if case.is_lossy else (None, None)
            if known_q > 0.0:
                own_q = 1.0 / (known_q + spent), None
            quality[symmetry, row.column] = dict(zip(("quality_factor", "quality_error"), own_q, strict=True))
            quality[symmetry, row.column]["air_quality_factor"] = 1.0 / sound if sound > 0.0 else None
    return part_modes.each(lambda row: replace(row, **quality.get((row.symmetry, row.column), {})))


def _beyond(part_modes: PartModes) -> tuple[ModeRow, ...]:
    return part_modes.target.beyond if part_modes.target else ()


def _measure_bars(
    rows: list[ModeRow], index: int, overlaps: Overlaps, ends_hz: tuple[float, ...], share: float, error: float | None
) -> dict[str, float | None]:
    """Errors of the level, MAC and strength of a mode from the `share` of its neighbours that mixes into it by an error."""
    tones = np.array([row.frequency_hz for row in rows])
    if not error:
        return {}
    level = share * overlaps.mixing_db(tones, index, error, ends_hz)
    mac, strength = (
        None if np.isnan(bar) else bar for bar in overlaps.mixing_shape(tones, index, error, ends_hz, share)
    )
    return {"confinement_error_db": level, "mac_error": mac, "strength_error": strength}


def _ends(part_modes: PartModes) -> tuple[float, ...]:
    """Ends of the interval in which all modes are known, Hz; the next mode may lie just outside."""
    ends = part_modes.count.low_hz, part_modes.count.high_hz
    return tuple(end for end in ends if end > 0.0)


def _warn_of_nothing(part_modes: PartModes, query: Request, log: Log) -> None:
    """Warn if the band holds no mode, and report the nearest one."""
    if part_modes.rows or query.band_hz is None:
        return
    of_class = f" of class {query.symmetry}" if query.symmetry else ""
    nearest = "" if part_modes.nearest_hz is None else f"; the nearest lies at about {frequency(part_modes.nearest_hz)}"
    log.warning(
        "NO_MODES",
        f"no mode{of_class} of the {query.part} lies between {interval(*query.band_hz, 0.0, 0.0, to=' and ')}{nearest}",
    )


def _within_reach(case: Case, query: Request, choice: ModelChoice, log: Log) -> tuple[PartModes, ModelChoice]:
    """Solve the modes, and refine mesh and reduction until they suit frequencies as high as the modes found."""
    coarse = coarse_modes(case, query, choice)
    choice = (coarse and refine_mesh(choice, coarse.highest_hz, case, log)) or choice
    solved = _solved(case, query, choice, log, coarse)
    for _ in range(PASSES):
        highest = max((row.frequency_hz for row in solved.all_rows(query.search)), default=0.0)
        error = _decisive(solved)
        met = error is not None and error <= case.solve.accuracy  # takes precedence over the calibration
        higher = (not met and refine_mesh(choice, highest, case, log)) or raise_cutoff(choice, highest, case, log)
        if higher is None:
            break
        solved, choice = _solved(case, query, higher, log, coarse), higher
    return solved, choice


def _solved(case: Case, query: Request, choice: ModelChoice, log: Log, coarse: CoarseModes | None = None) -> PartModes:
    """Solve the modes for one model choice, with the target mode among them and the errors class by class.

    The counts of a coarse mesh avoid solving modes that nearer ones of another class would exclude.
    """
    meshes: list[MeshRecord] = []
    model = parts.built(case, choice, log, meshes)
    coarser = parts.mesh_error_source(case, choice, model)
    demand = resource_estimate.of_modes(case, choice, with_search(case, query))

    def solved(symmetry: str | None, count: int | None = query.count) -> _Class:
        one = _Class(case, query.part, model, symmetry, log, coarser)
        one.ask(replace(query, count=count))
        if symmetry in (None, target_symmetry(case.design.nodal_lines)):
            one.target = _target(case, query, one)
        one.shared.near = None  # it bounded the modes not found
        one.errors = one.estimated()
        if query.band_hz:
            one.more_below(one.count.high_hz)  # in parallel with the other classes
        if query.band_hz or not isinstance(model, PlateModel):
            one.let_go()
        return one

    def few(symmetry: str | None) -> _Class:
        return solved(symmetry, coarse.counts[symmetry] if coarse else query.count)

    each = parallel_map(few, _classes(model, query.symmetry), demand.cost.peak.bytes)
    if coarse:
        farthest = _farthest(query, each)
        each = [one if _reach(query.near_hz, one.count) > farthest else solved(one.symmetry) for one in each]
    classes = {one.symmetry: one for one in each}
    rows, count = _merged(query, classes)
    part_modes = PartModes(
        query.part,
        model,
        tuple(rows),
        {symmetry: one.vectors for symmetry, one in classes.items()},
        sum(one.dof for one in classes.values()),
        sum(one.rigid_count for one in classes.values()),
        count,
        meshes,
        target=next((one.target for one in each if one.target), None),
        more_in_mesh=_more_in_mesh(classes, count),
        nearest_hz=_nearest_hz(query, classes),
        errors={one.symmetry: one.errors for one in each if one.errors},
        overlaps={one.symmetry: one.overlaps for one in each},
    )
    return _cut(_with_both(part_modes), query.band_hz)


class _Class:
    """One symmetry class of a model: its pencil and the modes solved so far, as columns of `vectors`."""

    def __init__(
        self,
        case: Case,
        part: str,
        model: PartModel,
        symmetry: str | None,
        log: Log,
        coarser: MeshErrorSource | None = None,
    ) -> None:
        self.case, self.part, self.model, self.symmetry, self.log = case, part, model, symmetry, log
        self.coarser = coarser
        self.dof = 0
        self.vectors: FloatArray
        self.tones = np.empty(0)  # of the columns, Hz
        self.rows: tuple[ModeRow, ...] = ()
        self.rigid_count = 0
        self.nearest_hz: float | None = None
        self.count = Count(0.0, 0.0, 0, 0)
        factorise = model.assembled(symmetry).factorise if isinstance(model, PlateModel) else Factoriser()
        self.shared = Shared(factorise, keeps=isinstance(model, PlateModel))
        self.target: Target | None = None
        self.errors: ModeErrors | None = None
        self.overlaps: Pair | None = None  # of all columns, where they were measured together
        self._more: dict[float, int | None] = {}

    @cached_property
    def pencil(self) -> PlainPencil:
        """K and M, made again if they are needed after `let_go`."""
        return self.model.pencil(self.symmetry)

    def let_go(self) -> None:
        """Release K and M, whose memory the next class takes."""
        del self.pencil

    def ask(self, query: Request) -> None:
        """Solve the modes of the request."""
        name = f"class {self.symmetry or 'whole'}"
        with self.log.step(f"solve {name}"):
            self.dof = self.pencil.dof
            self.vectors = np.empty((self.dof, 0))
            solution = self._solve(query)
            self.rows, self.count, self.rigid_count = self._kept(solution), solution.count, solution.rigid_count
            if not self.rows and query.band_hz:
                near = modes_near(self.pencil, sum(query.band_hz) / 2.0, 1, self.shared)
                self.nearest_hz = float(near.frequency_hz[0]) if len(near.frequency_hz) else None
        if query.band_hz and self.coarser:
            self._complete(query.band_hz[1])
        self.log.info(f"{name}: {self.dof} degrees of freedom, {several(len(self.rows), 'mode')}")

    def _complete(self, high_hz: float) -> None:
        """Solve beyond the end of a band what the mesh of a whole body puts above it, and its correction may not.

        The correction of the modes below the end, or of the nearest one, is an estimate for those above it.
        """
        while True:
            self.errors = self.estimated()
            taken = max(map(self.taken, self.rows)) if self.rows else self._nearest_taken(high_hz)
            taken = min(taken, LARGEST)
            if taken <= 0.0 or high_hz <= self.count.high_hz * (1.0 - taken):
                return
            end = high_hz / (1.0 - BEYOND_END * taken)
            with self.log.step(f"modes that the mesh puts above the band, up to {khz(round(end))}"):
                solution = modes_in_band(self.pencil, self.count.high_hz, end, self.shared)
                self.rows, self.count = (*self.rows, *self._kept(solution)), joined(self.count, solution.count)

    def taken(self, row: ModeRow) -> float:
        """Relative correction of a mode's frequency on the mesh of a whole body, downwards."""
        return float(self.errors.taken[row.column]) if self.errors else 0.0

    def _nearest_taken(self, near_hz: float) -> float:
        """Relative correction of the mode nearest to a frequency, which is not kept."""
        near = modes_near(self.pencil, near_hz, 1, self.shared)
        return float(self._of_mesh(near.vectors, near.frequency_hz)[0].max(initial=0.0))

    def estimated(self) -> ModeErrors | None:
        """Estimate the errors of the modes from a plate's cells or from a mesh error source; None without one."""
        if isinstance(self.model, PlateModel):
            return mode_errors(self.model.assembled(self.symmetry), self.pencil, self.vectors)
        if self.errors and len(self.errors.taken) == self.vectors.shape[1]:
            return self.errors
        if self.coarser is None:
            return None
        none = np.zeros(self.vectors.shape[1])
        with self.log.step(f"discretisation error, class {self.symmetry or 'whole'}"):
            return ModeErrors(none, none, none, *self._of_mesh(self.vectors, self.tones))

    def estimated_of(self, columns: Sequence[int]) -> ModeErrors:
        """Estimate the errors of some of a plate's modes; NaN for the others."""
        assert isinstance(self.model, PlateModel)
        own = mode_errors(self.model.assembled(self.symmetry), self.pencil, self.vectors[:, columns])
        errors = np.full((5, self.vectors.shape[1]), nan)
        errors[:, columns] = own.modes, own.degrees, own.through, own.taken, own.mesh
        return ModeErrors(*errors)

    def _of_mesh(self, vectors: FloatArray, tones: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Relative correction and error bar (half-width) of modes of a body meshed whole."""
        assert self.coarser and isinstance(self.pencil, Pencil)
        if not len(tones):
            return np.empty(0), np.empty(0)
        values = np.array([self.pencil.scale.eigenvalue(tone) for tone in tones])
        return self.coarser.errors(self.symmetry, self.pencil, vectors, values)

    def more_below(self, edge_hz: float) -> int | None:
        """Upper bound on the modes below a frequency that the reduced plate lacks; None without a bound."""
        if not isinstance(self.model, PlateModel):
            return 0
        if edge_hz not in self._more:
            known = self.count.below if self.count.high_hz == edge_hz else None
            reduced = None if known is None else known + self.count.expected
            off = MARGIN * float(self.errors.by_degrees.max(initial=0.0)) if self.errors else 0.0
            plate = self.model.assembled(self.symmetry)
            self._more[edge_hz] = more_below(plate, self.pencil, edge_hz, reduced, self.shared.factorise, off)
        return self._more[edge_hz]

    def between(self, low_hz: float, high_hz: float) -> tuple[tuple[ModeRow, ...], Count]:
        """Return all modes between two frequencies, reusing those already solved."""
        with self.log.step(f"search for the target mode from {khz(round(low_hz))} to {khz(round(high_hz))}"):
            solution = modes_in_band(self.pencil, low_hz, high_hz, self.shared)
            return self._kept(solution), solution.count

    def largest_outside(self, rows: Sequence[ModeRow], reach_hz: tuple[float, float]) -> float:
        """Upper bound on the strength of any mode of an assembled plate outside an interval whose modes are known."""
        assert isinstance(self.model, PlateModel)
        plate = self.model.assembled(self.symmetry)
        force = strength_force(plate.touch(self.vectors[:, :0]), self.case.design, self.symmetry or None)
        low, high = (self.pencil.scale.eigenvalue(end) for end in reach_hz)
        if self.shared.near and abs(2.0 * self.shared.near[1] / (low + high) - 1.0) > 1e-9:
            self.shared.near = None  # of a part of the interval: the bound would be looser
        vectors = self.vectors[:, [row.column for row in rows]]
        return largest_outside(self.pencil, self.shared, plate.work(force), vectors, (low, high))

    def _solve(self, query: Request) -> Modes:
        if query.band_hz:
            return modes_in_band(self.pencil, *query.band_hz, self.shared)
        assert query.near_hz is not None and query.count is not None
        return modes_near(self.pencil, query.near_hz, query.count, self.shared)

    def _kept(self, modes: Modes) -> tuple[ModeRow, ...]:
        first = self.vectors.shape[1]
        self.vectors = np.hstack([self.vectors, modes.vectors])
        self.tones = np.concatenate([self.tones, modes.frequency_hz])
        measures: Confinement | None = None
        if self.part in MEASURED and len(modes.frequency_hz):
            weighed = _weighed(self.case, self.model, self.symmetry, modes.vectors)
            measures, self.overlaps = weighed.measures, None if first else weighed.overlaps
        return tuple(mode_rows(modes, self.symmetry, measures, first))


def _target(case: Case, query: Request, one: _Class, span: Released | None = None) -> Target | None:
    """Find the target mode among those of its class, in a released plate's interval if given; None for a part without one."""
    window = target_window_hz(case, query)
    if window is None:
        return None
    if span:
        window = span.within(window)
    if query.expected:
        return look_about(query.expected, one.count, one.rows, one.between)
    if not query.search:
        if query.band_hz is None or not one.errors:
            return look_among(one.rows, one.count)
        return look_among(
            *_inside(one.rows, one.count, query.band_hz, lambda row: row.frequency_hz * (1.0 - one.taken(row)))
        )
    bound = one.largest_outside if isinstance(one.model, PlateModel) else None
    return look(window, one.count, one.rows, one.between, bound)


def _nearest_hz(query: Request, classes: dict[str | None, _Class]) -> float | None:
    """Frequency of the mode nearest to the middle of a band that holds none."""
    tones = [one.nearest_hz for one in classes.values() if one.nearest_hz is not None]
    if any(one.rows for one in classes.values()) or not tones or not query.band_hz:
        return None
    middle = sum(query.band_hz) / 2.0
    return min(tones, key=lambda tone: abs(tone - middle))


def _more_in_mesh(classes: dict[str | None, _Class], count: Count) -> int | None:
    """Bound the number of modes that the full meshes have and the reduced model lacks; 0 without a reduction."""
    more = [one.more_below(count.high_hz) for one in classes.values()]
    return None if None in more else sum(each or 0 for each in more)


def _error_estimate(part_modes: PartModes) -> ErrorEstimate | None:
    """Estimate the truncation errors of a plate of reduced cells; None without a reduction or without modes.

    Without a target mode, the worst mode takes its place.
    """
    errors = part_modes.errors or {}
    every = [np.vstack([each.modes, each.degrees, each.through]) for each in errors.values() if len(each.modes)]
    if not every or not isinstance(part_modes.model, PlateModel):
        return None
    together = np.hstack(every)
    worst = together[:, int(np.argmax(together.sum(axis=0)))]
    row = part_modes.target_row
    own = errors[row.symmetry] if row else None
    mine = (own.modes, own.degrees, own.through) if row and own else worst[:, None]
    column = row.column if row and own else 0
    return ErrorEstimate(float(worst.sum()), *(float(each[column]) for each in mine))


def level_bars_db(case: Case, part_modes: PartModes, error: float) -> tuple[float | None, float | None]:
    """Errors of the target mode's confinement and of its level over the plate beyond the rows, dB.

    A relative `error` of the frequencies mixes neighbouring modes into the target mode. None without a target mode or part.
    """
    row = part_modes.target_row
    if row is None or part_modes.target is None or row.confinement_db is None:
        return None, None
    siblings = list(part_modes.target.rows)
    tones = np.array([each.frequency_hz for each in siblings])
    share, place = calibration.mixing(), siblings.index(row)
    parts = _overlaps(case, part_modes, siblings)
    bars = [None if part is None or share is None else share * part.mixing_db(tones, place, error) for part in parts]
    return bars[0], bars[1]


def _overlaps(case: Case, part_modes: PartModes, rows: Sequence[ModeRow]) -> Pair:
    """Overlaps of some modes of one class, with the passive face and with the plate beyond the rows."""
    symmetry, columns = rows[0].symmetry, [row.column for row in rows]
    if known := part_modes.overlaps.get(symmetry):
        return known[0] and known[0].among(columns), known[1] and known[1].among(columns)
    return _weighed(case, part_modes.model, symmetry, part_modes.vectors[symmetry][:, columns]).overlaps


def _weighed(case: Case, model: PartModel, symmetry: str | None, vectors: FloatArray) -> Weighed:
    """Integrals of modes (dof, k) over the parts of the touch face."""
    if isinstance(model, PlateModel):
        return Weighed.over(model.assembled(symmetry).touch_parts(vectors), case.design, symmetry)
    return Weighed.over([model.touch(symmetry, vectors)], case.design, symmetry)


def _classes(model: PartModel, symmetry: str | None) -> tuple[str | None, ...]:
    if symmetry is None:
        return model.symmetries
    if symmetry not in model.symmetries:
        raise InputError(f"--symmetry {symmetry}: this model has no symmetry classes; omit --symmetry")
    return (symmetry,)


def _merged(query: Request, classes: dict[str | None, _Class]) -> tuple[list[ModeRow], Count]:
    """Merge the modes of all classes in ascending order, with their count between common ends."""
    rows = [row for one in classes.values() for row in one.rows]
    rows.sort(key=_place)
    counts = [one.count for one in classes.values()]
    count = Count(
        max(c.low_hz for c in counts),
        min(c.high_hz for c in counts),
        sum(c.expected for c in counts),
        sum(c.found for c in counts),
        counts[0].below if len(counts) == 1 else None,
    )
    return _nearest(rows, query, count) if query.count is not None and not query.band_hz else (rows, count)


def _farthest(query: Request, classes: list[_Class]) -> float:
    """Distance of the last of the `count` modes nearest to a frequency, Hz; infinite if there are fewer."""
    assert query.near_hz is not None and query.count is not None
    away = sorted(abs(row.frequency_hz - query.near_hz) for one in classes for row in one.rows)
    return away[query.count - 1] if len(away) >= query.count else inf


def _reach(near_hz: float | None, count: Count) -> float:
    """Distance from a frequency up to which all modes are known, Hz; below the start of the count lie rigid-body modes only."""
    assert near_hz is not None
    above = count.high_hz - near_hz
    return min(above, near_hz - count.low_hz) if 0.0 < count.low_hz < near_hz else above


def _nearest(rows: list[ModeRow], query: Request, count: Count) -> tuple[list[ModeRow], Count]:
    """Keep the `count` modes nearest to the frequency over all classes, and degenerate partners of the last one.

    Every class is complete in its own interval, so the common interval is complete, too.
    """
    assert query.near_hz is not None and query.count is not None
    near = query.near_hz
    ordered = sorted(rows, key=lambda row: abs(row.frequency_hz - near))
    size = min(query.count, len(ordered))
    while size < len(ordered) and _same(ordered[size].frequency_hz, ordered[size - 1].frequency_hz):
        size += 1
    kept = ordered[:size]
    inner = abs(kept[-1].frequency_hz - near) if kept else 0.0
    outer = abs(ordered[size].frequency_hz - near) if size < len(ordered) else None
    known = _reach(near, count)
    reach = min((inner + outer) / 2.0, known) if outer is not None else known
    low, high = max(near - reach, 0.0), near + reach
    missing = count.expected - count.found
    return sorted(kept, key=_place), Count(low, high, size + missing, size)


def _place(row: ModeRow) -> tuple[float, str]:
    return row.frequency_hz, row.symmetry or ""


def _same(first: float, second: float) -> bool:
    return abs(first - second) <= 1e-6 * max(first, second)


@one_thread()
def without_supports(case: Case, request: Request, solved: PartModes, log: Log) -> PartModes | None:
    """Solve the target mode of a solved plate without its supports, with the same reductions.

    None for a plate without supports, and where the request does not look for the target mode.
    """
    if not isinstance(solved.model, PlateModel) or not case.design.supports or solved.target is None:
        return None
    free = replace(case, design=case.design.unsupported)
    query, symmetry = with_defaults(free, request), free.target_symmetry
    with log.step("target mode without the supports"):
        one, span = _released(case, free, solved, log)
        if one is None:
            one = _Class(free, "plate", PlateModel(free.design, solved.model.reductions), symmetry, log)
        one.ask(replace(query, band_hz=span.ends_hz) if span else query)
        target = _target(free, query, one, span)
        one.shared.near = None
        rows = (target.row, *target.rivals) if target and target.row else ()
        errors = one.estimated_of([row.column for row in rows])
    part_modes = PartModes(
        "plate", one.model, one.rows, {symmetry: one.vectors}, one.dof, one.rigid_count, one.count, [],
        target=target, errors={symmetry: errors}, overlaps={symmetry: one.overlaps},
    )  # fmt: skip
    return _with_level_bars(free, _with_errors(_with_both(part_modes)))


def _released(case: Case, free: Case, solved: PartModes, log: Log) -> tuple[_Class | None, Released | None]:
    """The class of a solved plate without soft supports, which begins with its modes, and the interval that these span.

    None where supports are not soft, or change the plate's symmetry: it is solved again.
    """
    symmetry, model = case.target_symmetry, solved.model
    alike = free.target_symmetry == symmetry and set(solved.vectors) == {symmetry}
    if not alike or not isinstance(model, PlateModel) or own_frequency.is_open(case, "plate"):
        return None, None
    loose = model.released(symmetry)
    tones = np.array([row.frequency_hz for row in solved.rows])
    span = released(model.assembled(symmetry), solved.count, tones) if loose and len(tones) else None
    if span is None or loose is None:
        return None, None
    one = _Class(free, "plate", loose, symmetry, log)
    one.shared.guess = solved.vectors[symmetry][:, [row.column for row in solved.rows]]
    one.shared.counts |= span.counts
    return one, span


@one_thread()
def of_other_zones(case: Case, solved: PartModes) -> list[ZoneTarget]:
    """Find the target modes of the further zones of a larger plate among the modes solved for the first one."""
    if solved.part != "plate" or not case.design.others_m:
        return []
    return [
        _of_zone(replace(case, design=view), solved, number)
        for number, view in enumerate(case.design.views, start=1)
        if number > 1
    ]


def _of_zone(case: Case, solved: PartModes, number: int) -> ZoneTarget:
    """The target mode of the zone in the middle of a view of the plate."""
    known = solved.whole_window
    columns = [row.column for row in known.rows]
    measures = _weighed(case, solved.model, None, solved.vectors[None][:, columns]).measures
    rows = tuple(measured(row, measures, place) for place, row in enumerate(known.rows))
    seen = replace(known, rows=rows, target=look_among(rows, known.count), overlaps={})
    record = _with_level_bars(case, seen).target_part()
    assert record is not None
    return ZoneTarget(
        zone=number, centre_m=case.design.centre_m,
        target=replace(record, index=solved.index(seen.target_row), shape=ALONG[case.design.held_ends]),
    )  # fmt: skip


def target_lines(part_modes: PartModes, design: Design) -> list[str]:
    """Describe the target mode, its error bar, and the count."""
    said = verdict_text(part_modes.target, design) if part_modes.target else []
    row = part_modes.target_row
    if row and part_modes.index(row) is None:
        said.append("It lies outside the modes listed above.")
    if row and part_modes.errors is not None:
        level = (
            ""
            if row.confinement_error_db is None
            else f", ±{level_text(*(row.confinement_error_db,) * 2)} in confinement"
        )
        known = "unknown" if row.error is None else f"±{percent(row.error)} in frequency{level}"
        said.append(f"error bars of the target mode: {known}")
    return [*said, count_text(part_modes)]


def count_text(part_modes: PartModes) -> str:
    """Describe the inertia count and what it proves."""
    check, more = part_modes.count, part_modes.more_in_mesh
    counted = f"{check.expected}, found: {check.found}"
    if part_modes.counts == "mesh":
        return f"inertia count of the mesh: {counted}"
    text = f"inertia count of the reduced model: {counted}; the full meshes"
    if more is None:
        return f"{text} may have any number of further modes"
    further = f"have at most {several(more, 'further mode')}" if more else "have no further modes"
    return f"{text} {further} up to {frequency(check.high_hz)}"
