"""Bandwidth of the rows: their transmission, and the confinement of a driven zone, over frequency."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from functools import partial
from itertools import pairwise
from typing import Any

import numpy as np

from geometry.elements import ComplexArray, FloatArray, IntArray
from geometry.layout import SAME_M, Design
from geometry.tiling import INNERMOST, Panel, lattice_panel
from pipeline.case.model import Case
from pipeline.errors import InputError
from pipeline.logs import Log
from pipeline.models.answer_parts import BroadbandPoint, Transmission
from pipeline.models.cell_cache import CellCache
from pipeline.models.plate_cell import OwnRows
from pipeline.planning import mesh_rules
from pipeline.planning.model_choice import by_rows, check_stagger, driven_band_hz
from pipeline.planning.refinement import MARGIN
from pipeline.planning.simplifications import hexahedra
from pipeline.quantity import MM
from solvers.accuracy import calibration
from solvers.measures.confinement import CONFINED_DB
from solvers.measures.target_mode import verdict
from solvers.plates.assembled import Reductions
from solvers.plates.column import Column, Driven, level_bars
from solvers.superelement.lattice import Periodic
from solvers.threads import one_thread
from solvers.waves.branches import label_of
from solvers.waves.complex_bands import Row, RowStiffness, RowWaves, chain, scatter

POINTS = 201
Stretch = tuple[float, float]


def broadband(
    case: Case,
    log: Log,
    band_hz: Stretch | None = None,
    points: int = POINTS,
    accuracy: float | None = None,
    with_bars: bool = True,
    own: OwnRows | None = None,
) -> dict[str, Any]:
    """Solve one column of the case's cells at the target wavenumber over frequency; columns of `BroadbandResult` by name.

    own: a cell in the place of the case's, and the relative discretisation error of its bands. Raises InputError for a case
    without zone, pillar or rows, and for any model other than reduced hexahedra.
    """
    design = own.design if own else checked(case)
    low, high = driven_band_hz(case, band_hz)
    column, rows, bare, name = _model(design, accuracy or case.solve.accuracy, high, case.target_kx_per_m, log, own)
    tones = np.linspace(low, high, points)
    with log.step(f"{points} frequencies"), one_thread():
        driven = column.driven(tones, case.one_quality_factor("broadband"))
        transmitted = [_through(rows, bare, float(tone)) for tone in tones]
        errors = _mode_bars(driven) if with_bars else np.full(len(driven.modes.frequency_hz), np.nan)
        if own:
            errors = errors + (np.nan if own.mesh_error is None else own.mesh_error)
        widest = _widest(driven.modes.frequency_hz, errors, low, high)
        bars = _level_bars(driven, errors, points)
        taken = np.array([each.taken_db if each else np.nan for each in transmitted])
        taken_bars = level_bars(tones, taken, widest, lambda tone: _taken_db(rows, bare, tone))
    columns = tones.tolist(), driven.confinement_db.tolist(), transmitted, bars, taken_bars
    samples = [
        BroadbandPoint(
            frequency_hz=tone, confinement_db=level, transmission=shares, confinement_error_db=bar, taken_error_db=lost
        )
        for tone, level, shares, bar, lost in zip(*columns, strict=True)
    ]
    target_hz, target_db, target_error, target_bar = _target(driven, errors, mesh_rules.target_window_hz(design))
    confined = stretches(tones, driven.confinement_db)
    stopped = stretches(tones, np.array([sample.taken_db for sample in samples]))
    errors_of = partial(end_errors, samples, widest)
    return {
        "model": name,
        "kx_per_m": case.target_kx_per_m,
        "rows": design.rows,
        "target_hz": target_hz,
        "target_db": target_db,
        "target_error": target_error,
        "target_error_db": target_bar,
        "frequency_error": widest,
        "confined_hz": _about(confined, target_hz),
        "stopped_hz": _about(stopped, target_hz),
        "confined": confined,
        "stopped": stopped,
        "confined_error": list(map(errors_of, confined)),
        "stopped_error": list(map(errors_of, stopped)),
        "points": samples,
    }


def end_errors(
    points: Sequence[BroadbandPoint], error: float | None, ends_hz: Sequence[float]
) -> tuple[float | None, float | None]:
    """Return the relative errors of an interval's ends: half a step plus the error of the column."""
    step = (points[-1].frequency_hz - points[0].frequency_hz) / max(len(points) - 1, 1)
    low, high = (None if error is None else error + step / (2.0 * end) for end in ends_hz)
    return low, high


def checked(case: Case) -> Design:
    """Return the design of a case whose rows stop a band; InputError like `broadband`."""
    case.require("plate", "zone", "pillar", "array.pitch_mm", "array.rows", command="broadband")
    case = of_rows(case)
    design = case.design
    said = list(_without_room(design))
    if not design.is_mirrored:
        said.append("broadband needs a plate that is its own mirror image along x and y: turn the material's axes back")
    if not hexahedra(case, "plate"):
        said.append(
            "broadband needs pillars that hexahedra can follow, with room around their feet, and solve.mesh auto or hex"
        )
    check_rows(case, said)
    if design.is_staggered:
        check_stagger(case)
    return design


def of_rows(case: Case) -> Case:
    """Return the case with cells of its rows along x, oblique ones only where rows are several; errors like `by_rows`."""
    case = by_rows(case)
    if not case.design.oblique_m or case.design.rows > 1:
        return case
    return replace(case, design=replace(case.design, oblique_m=None))  # a single row has no next one


def _without_room(design: Design) -> Iterator[str]:
    """Yield the faults of a plate on which oblique cells, with their pillars in the middle, would be cut short."""
    if not (design.oblique_m and design.rows and design.pillar):
        return
    starts, ends = design.row_centres()[[0, -1]] + np.array([-0.5, 0.5]) * design.pitch_y_m
    lacking, beyond = INNERMOST * design.width_m / 2.0 - starts, ends - design.half_span_m
    what = "for oblique cells, whose pillars are in their middle"
    if lacking >= 0.0:  # a wider zone moves its first row outwards
        least = design.width_m + 2.0 * lacking / (1.0 - INNERMOST)
        yield f"zone.width_mm = {design.width_m / MM:g}: must be above {least / MM:g} {what}"
    if beyond > SAME_M:
        least = design.extension_m + beyond
        yield f"array.extension_mm = {design.extension_m / MM:g}: must be at least {least / MM:g} {what}"


def check_rows(case: Case, more: Sequence[str] = ()) -> None:
    """Raise InputError for a case without rows, or whose plate a column of cells cannot stand for, and for further faults."""
    case.require_plate("broadband")
    case.one_quality_factor("broadband")
    said = []
    if not case.design.rows:
        said.append("array.rows = 0: must be 1 or more, a bare plate stops no waves")
    if case.solve.model not in ("auto", "superelement"):
        said.append(f"solve.model = {case.solve.model!r}: must be auto or superelement for broadband")
    if said or more:
        raise InputError(f"{case.source or case.name}: {text}" for text in (*said, *more))


def _model(
    design: Design, accuracy: float, high_hz: float, kx: float, log: Log, own: OwnRows | None
) -> tuple[Column, list[Row], Row, str]:
    """Build the column, its rows in an infinite plate, the bare plate next to them; returns them with the model's name."""
    top_hz = max(high_hz, mesh_rules.target_window_hz(design)[1])
    reduction = mesh_rules.plate_reduction(design, accuracy, top_hz)
    reductions = Reductions(design.stack, design.pillar, reduction, CellCache())
    if own:
        reductions = own.reductions(reduction)
        reduction = reductions.reduction
    count = 1 + design.is_staggered
    with log.step("reduce cells"):
        column = Column(design, reductions, kx, joined=own is not None)
        rows = [
            Row(Periodic([reductions.cell(each) for each in _attached(strip)]), kx)
            if any(p.free for p in strip)
            else row
            for strip, row in zip(column.strips, column.rows, strict=True)
            if any(panel.foot for panel in strip)
        ]
        panel = reductions.cell(lattice_panel(replace(design, pillar=None, oblique_m=None), count))
        bare = Row(Periodic([panel] * count), kx)
    log.info(
        f"column: {len(column.placed_cells)} cells across half the plate, {column.dof} degrees of freedom; "
        f"{reductions.fresh} reduced, the others loaded from the cache"
    )
    own_name = f", own cell {own.body.mesh.kind}{own.body.mesh.order}" if own else ""
    return column, rows, bare, f"column of superelements hex{reduction.hexahedra.order}{own_name}"


def _attached(strip: tuple[Panel, ...]) -> list[Panel]:
    """Panels of a row at the plate's edge, extended to a continuing plate symmetrically about the feet.

    The transmission of a row does not depend on how much bare plate its panels include.
    """
    feet = next(panel for panel in strip if panel.free)
    assert feet.foot
    low, high, middle = feet.low[1], feet.high[1], feet.foot[1]
    low, high = (low, 2.0 * middle - low) if "y+" in feet.free else (2.0 * middle - high, high)
    halved = () if feet.edges_m else (0, 1)
    return [replace(p, low=(p.low[0], low), high=(p.high[0], high), halved=halved, free=()) for p in strip]


def _through(rows: Sequence[Row], bare: Row, frequency_hz: float) -> Transmission | None:
    return transmitted_shares(chain(row.condensed(frequency_hz)[0] for row in rows), bare, frequency_hz)


def wavevectors(row: Row, waves: RowWaves, kept: IntArray) -> ComplexArray:
    """Wavevectors (2, n) of some of a row's waves, complex across the rows, rad/m."""
    ky = waves.wavenumber_per_m[kept]
    return np.vstack([np.full(len(ky), row.kx, dtype=complex), ky])


def transmitted_shares(stack: RowStiffness, bare: Row, frequency_hz: float) -> Transmission | None:
    """Shares of the incoming flexural wave's power by polarisation; None if the bare plate has no such wave at this kx."""
    half = bare.waves(frequency_hz)
    going = np.flatnonzero(half.flux > 0.0)
    if not len(going):
        return None
    labels = [label.name for label in label_of(bare.periodic, half.dofs[:, going], wavevectors(bare, half, going))]
    if "flexural" not in labels:
        return None
    incoming = int(going[labels.index("flexural")])
    scattered = scatter(stack, half, bare.mirror_sign, incoming)
    transmitted = dict.fromkeys(("flexural", "shear", "longitudinal"), 0.0)
    for name, share in zip(labels, scattered.transmitted, strict=True):
        transmitted[name] += float(share)
    return Transmission(reflected=float(scattered.reflected.sum()), **transmitted)


def _mode_bars(driven: Driven) -> FloatArray:
    """Relative errors (k,) of the column's modes from discretisation and truncation; NaN where unknown."""
    errors = driven.errors()
    return np.asarray(errors.mesh + MARGIN * errors.total)


def _widest(frequency_hz: FloatArray, errors: FloatArray, low_hz: float, high_hz: float) -> float | None:
    """Largest relative error of the modes in a band and of its neighbours on either side; None if one is unknown."""
    first, last = np.searchsorted(frequency_hz, [low_hz, high_hz])
    near = errors[max(int(first) - 1, 0) : int(last) + 1]
    return float(near.max()) if len(near) and np.isfinite(near).all() else None


def _level_bars(driven: Driven, errors: FloatArray, points: int) -> list[float | None]:
    """Errors of the forced motion's levels, dB; None without an estimate."""
    mixed = calibration.mixing()
    if mixed is None or np.isnan(errors).any():
        return [None] * points
    bars = driven.bar_db(errors, mixed).tolist()
    return [None if np.isnan(level) else bar for bar, level in zip(bars, driven.confinement_db, strict=True)]


def _taken_db(rows: Sequence[Row], bare: Row, frequency_hz: float) -> float | None:
    shares = _through(rows, bare, frequency_hz)
    return shares.taken_db if shares else None


def _target(driven: Driven, errors: FloatArray, window_hz: Stretch) -> tuple[float | None, ...]:
    """Frequency and confinement of the column's target mode, found as in `antinode search`, and both errors."""
    tones, level, share = driven.modes.frequency_hz, driven.modes.confinement, calibration.mixing()
    inside = np.flatnonzero((tones >= window_hz[0]) & (tones <= window_hz[1]))
    at = verdict(level.strength[inside], level.zone_share[inside], level.mac[inside]).index
    if at is None:
        return None, None, None, None
    own = int(inside[at])
    error = float(errors[own]) if np.isfinite(errors[own]) else None
    bar = None if error is None or share is None else share * driven.mixing_db(own, error)
    return float(tones[own]), float(level.confinement_db[own]), error, bar


def stretches(frequency_hz: FloatArray, level_db: FloatArray, least_db: float = CONFINED_DB) -> list[Stretch]:
    """Intervals in which a level is at least `least_db`, Hz; their ends are interpolated between points."""
    stretches: list[Stretch] = []
    level = np.nan_to_num(level_db, nan=-1e3, posinf=1e3)
    for (start, stop), (left, right) in zip(pairwise(frequency_hz.tolist()), pairwise(level.tolist()), strict=True):
        if max(left, right) < least_db:
            continue
        cross = start + (stop - start) * (least_db - left) / (right - left) if left != right else start
        low, high = (start if left >= least_db else cross), (stop if right >= least_db else cross)
        stretches = (
            [*stretches[:-1], (stretches[-1][0], high)]
            if stretches and stretches[-1][1] == low
            else [*stretches, (low, high)]
        )
    return stretches


def _about(confined: list[Stretch], frequency_hz: float | None) -> Stretch | None:
    """Interval that contains a frequency, or None."""
    return next((each for each in confined if frequency_hz and each[0] <= frequency_hz <= each[1]), None)
