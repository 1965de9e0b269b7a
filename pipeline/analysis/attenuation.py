"""Decay per row across the zone's border: complex bands at the wanted wavenumber, and what the case's rows let through."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from math import nan, pi
from typing import Any

import numpy as np
from pydantic import Field

from geometry.elements import BoolArray
from pipeline.case.model import Case
from pipeline.errors import InputError
from pipeline.logs import Log
from pipeline.models.broadband import transmitted_shares, wavevectors
from pipeline.models.unit_cell import CLEAR, LatticeModel, bare_cell, lattice_model
from pipeline.planning import error_bar, foresight, simplifications
from pipeline.planning.model_choice import SOLID, cell_model_choice
from pipeline.planning.request import driven_band_hz
from pipeline.quantity import frequency, level_with_bar, with_bar
from pipeline.records.record import (
    AttenuationPoint,
    AttenuationRecord,
    MeshRecord,
    PredictionRecord,
    Transmission,
    WaveRecord,
)
from solvers.analytic.predesign import predesign
from solvers.measures.levels import CONFINED_DB
from solvers.superelement.interface import Interface
from solvers.threads import one_thread
from solvers.waves.brillouin import path_through
from solvers.waves.evanescent import KeptRow, Row, RowStiffness, RowWaves
from solvers.waves.level_errors import level_bars
from solvers.waves.polarisation import label_of
from solvers.waves.scattering import stacked

POINTS = 201
STEEPEST_DB = (
    100.0  # a row: beyond, the cell's boundary polynomials do not resolve the wave, and nobody could measure it
)
ROUNDING_DB = 1e-6
CARRIED = (
    0.01  # change of a wavenumber, relative to it or one a pitch, that boundary functions of one degree less may bring
)


class Attenuation(AttenuationRecord):
    """The record, and the meshes behind it."""

    meshes: list[MeshRecord] = Field([], exclude=True)


@one_thread()
def solve(
    case: Case,
    log: Log,
    band_hz: tuple[float, float] | None = None,
    kx_per_m: float | None = None,
    points: int = POINTS,
    model: LatticeModel | None = None,
) -> Attenuation:
    """Complex bands of the case. InputError for a wavenumber beyond the zone's edge or a case without pillar or pitch.

    model: the reduced cell of the case's bands, where there is one already.
    """
    case.require("plate", "array.pitch_mm", "pillar", command="attenuation")
    case.require_lattice("decay per row is")
    if kx_per_m is None:
        case.require("zone", command="attenuation without --kx")
    low, high = driven_band_hz(case, band_hz)
    choice = cell_model_choice(case, high)
    if case.solve.model == SOLID:
        raise InputError(f"{case.name}: solve.model = 'solid': must be auto or superelement for attenuation")
    simplifications.log_all((*choice.left_out, simplifications.waves_downwards(case.design)), log)
    kx = _checked_kx(case, case.kx_wanted_per_m if kx_per_m is None else kx_per_m)
    foresight.announce("attenuation across the rows", foresight.of_attenuation(case, choice, points), log)
    meshes: list[MeshRecord] = []
    if model is None or model.lattice.cell.dropped_hz < CLEAR * high:  # a cell of low bands alone leaves out too much
        path = path_through(case.bands.path, 1, case.design.pitch_x_m, case.design.pitch_y_m)
        corners = path.wavevectors[[segment.last for segment in path.segments]]
        model = lattice_model(case, choice, corners, log, meshes, high_hz=high)
    cell = model.lattice.cell  # the one that the bands use: reduced once for both
    row, coarser, bare = Row(cell, kx), _coarser(model, kx), _kept(KeptRow(bare_cell(case, cell.interface, log), kx))
    rows = case.design.rows
    with log.step(f"{points} frequencies"):
        samples = tuple(_point(row, coarser, bare, rows, float(f)) for f in np.linspace(low, high, points))
    expected = error_bar.log_mesh_error(choice, case, log, model.mesh_error)
    with log.step("error bars of the decay"):
        error = None if expected is None else expected + model.reduction_error
        samples = _with_taken(row, bare, rows, _with_bars(row, coarser, samples, error), error)
    _log_converted(samples, kx, lambda tone: _through(row.waves(tone).stiffness, bare, rows, tone), error, log)
    return Attenuation(
        model=model.name,
        kx_per_m=kx,
        pitch_y_m=case.design.pitch_y_m,
        rows=rows,
        expected_error=expected,
        reduction_error=model.reduction_error,
        points=samples,
        meshes=meshes,
    )


_last: list[KeptRow] = []


def _kept(row: KeptRow) -> KeptRow:
    """The last case's row where that is the same, with its waves: a study's cases of one pitch ask for the same ones."""
    if not (_last and _last[0].same == row.same):
        _last[:] = [row]
    return _last[0]


def _checked_kx(case: Case, kx: float) -> float:
    edge = pi / case.design.pitch_x_m
    if not (math.isfinite(kx) and abs(kx) <= edge * (1.0 + 1e-12)):
        text = f"--kx = {kx:g}: must lie between -pi/p and pi/p, {-edge:g} and {edge:g} rad/m here"
        raise InputError(text)
    return kx


def _coarser(model: LatticeModel, kx: float) -> Row:
    """The same row with boundary functions of one degree less along its sides."""
    cell = model.lattice.cell
    face = Interface(max(cell.interface.along - 1, 1), cell.interface.through)
    return Row(model.lattice.up_to(face, cell.dropped_hz).cell, kx)


def carried(waves: RowWaves, fewer: RowWaves) -> BoolArray:
    """Which waves the boundary functions carry, (n,): those that pass, and those that decay alike with fewer functions.

    Steep waves that come from the functions themselves move with their degree. A wave of the coarser row stands for one only.
    """
    ours, theirs = waves.wavenumber_per_m, fewer.wavenumber_per_m
    off, turn = ours[:, None] - theirs, 2.0 * pi / waves.pitch_m  # wavenumbers a reciprocal one apart are the same
    off = off - turn * np.round(off.real / turn)
    squares = (
        np.abs(off * (2.0 * ours[:, None] - off)) / 2.0
    )  # half the change of k^2, smooth where a band begins at k = 0
    apart = squares / np.maximum(np.abs(ours), 1.0 / waves.pitch_m)[:, None] ** 2
    out, free = waves.db_per_row <= ROUNDING_DB, np.ones(len(theirs), dtype=bool)
    for one, other in zip(*np.unravel_index(np.argsort(apart, axis=None, kind="stable"), apart.shape), strict=True):
        if apart[one, other] > CARRIED:
            break
        if free[other] and not out[one]:
            out[one], free[other] = True, False
    return np.asarray(out)


def _point(row: Row, coarser: Row, bare: Row, rows: int, frequency_hz: float) -> AttenuationPoint:
    row_waves = row.waves(frequency_hz)
    waves = _waves(row, coarser, frequency_hz, row_waves)
    transmission = _through(row_waves.stiffness, bare, rows, frequency_hz)
    return AttenuationPoint(frequency_hz=frequency_hz, waves=waves, db_per_row=_least(waves), transmission=transmission)


def _through(one: RowStiffness, bare: Row, rows: int, frequency_hz: float) -> Transmission | None:
    return transmitted_shares(stacked(one, rows), bare, frequency_hz) if rows else None


def _with_bars(
    row: Row, coarser: Row, samples: tuple[AttenuationPoint, ...], error: float | None
) -> tuple[AttenuationPoint, ...]:
    """The points with the half-widths of their decays' bars, where bands of the cell may be off by `error`, relative."""
    tones, decays = np.array([[p.frequency_hz, nan if p.db_per_row is None else p.db_per_row] for p in samples]).T
    bars = level_bars(tones, decays, error, lambda tone: _least(_waves(row, coarser, tone, row.waves(tone))))
    return tuple(
        p.model_copy(update={"db_error": bar, "waves": tuple(_with_bar(wave, p.db_per_row, bar) for wave in p.waves)})
        for p, bar in zip(samples, bars, strict=True)
    )


def _with_bar(wave: WaveRecord, least: float | None, bar: float | None) -> WaveRecord:
    """The least attenuated flexural wave with its decay's bar; no other has one."""
    is_least = wave.polarisation == "flexural" and wave.db_per_row == least
    return wave.model_copy(update={"db_error": bar}) if is_least else wave


def _with_taken(
    row: Row, bare: Row, rows: int, samples: tuple[AttenuationPoint, ...], error: float | None
) -> tuple[AttenuationPoint, ...]:
    """The points with the half-widths of the bars of what the rows take from a flexural wave's power."""

    def taken(tone: float) -> float | None:
        shares = _through(row.waves(tone).stiffness, bare, rows, tone)
        return shares.taken_db if shares else None

    tones, levels = np.array([[p.frequency_hz, p.taken_db] for p in samples]).T
    bars = level_bars(tones, levels, error, taken)
    return tuple(p.model_copy(update={"taken_error_db": bar}) for p, bar in zip(samples, bars, strict=True))


def _least(waves: Iterable[WaveRecord]) -> float | None:
    return min((wave.db_per_row for wave in waves if wave.polarisation == "flexural"), default=None)


def _waves(row: Row, coarser: Row, frequency_hz: float, row_waves: RowWaves) -> tuple[WaveRecord, ...]:
    """The waves that the boundary functions carry, up to the steepest decay."""
    known = carried(row_waves, coarser.waves(frequency_hz))
    return tuple(_described(row, row_waves, np.flatnonzero((row_waves.db_per_row <= STEEPEST_DB) & known)))


def _described(row: Row, row_waves: RowWaves, kept: Any) -> list[WaveRecord]:
    labels = label_of(row.cell, row_waves.dofs[:, kept], wavevectors(row, row_waves, kept))
    waves = []
    for index, label in zip(kept, labels, strict=True):
        ky, db = row_waves.wavenumber_per_m[index], abs(float(row_waves.db_per_row[index]))
        db = 0.0 if db < ROUNDING_DB else db
        own = {"polarisation": label.name, "ky_re_per_m": ky.real, "ky_im_per_m": max(ky.imag, 0.0)}
        waves.append(WaveRecord(**own, db_per_row=db, pillar_share=label.pillar_share))
    return waves


def prediction(
    attenuation: AttenuationRecord,
    frequency_hz: float,
    extension_db: float | None,
    extension_error_db: float | None = None,
) -> PredictionRecord:
    """Compare rows times decay per row at a frequency with the transmitted power and with the finite plate's level,
    dB.
    """
    per_row, error = attenuation.at(frequency_hz), attenuation.error_at(frequency_hz)
    nearest = min(attenuation.points, key=lambda point: abs(point.frequency_hz - frequency_hz))
    passes = nearest.transmission is not None and nearest.transmission.flexural > 0.0
    return PredictionRecord(
        frequency_hz=frequency_hz,
        db_per_row=per_row,
        db_error=error,
        rows_db=None if per_row is None else attenuation.rows * per_row,
        rows_error_db=None if error is None else attenuation.rows * error,
        transmission_db=nearest.taken_db if passes else None,
        transmission_error_db=nearest.taken_error_db if passes else None,
        zone_to_extension_db=extension_db,
        zone_to_extension_error_db=extension_error_db,
        rows_needed=math.ceil(CONFINED_DB / per_row) if per_row else None,
    )


def at_the_zone(case: Case, solved: AttenuationRecord) -> list[str]:
    """A sentence on what the rows do where thin-plate theory puts the wanted mode; none outside the band."""
    zone = predesign(case.design).zone
    answer = prediction(solved, zone.frequency_hz, None) if zone else None
    if answer is None or answer.db_per_row is None:
        return []
    khz = f"at {frequency(answer.frequency_hz)}, where thin-plate theory puts the wanted mode"
    transmitted = ""
    if answer.transmission_db is not None:
        taken = level_with_bar(answer.transmission_db, answer.transmission_error_db)
        transmitted = f"; the case's take {taken} from a flexural wave's power"
    if not answer.db_per_row:
        return [f"{khz}, a flexural wave passes endless rows undamped{transmitted}"]
    every = with_bar(answer.rows_db, answer.rows_error_db, "dB")
    total = f"{every} in {solved.rows}, {CONFINED_DB:g} dB in {answer.rows_needed}"
    return [f"{khz}: {with_bar(answer.db_per_row, answer.db_error, 'dB')} a row of endless rows, {total}{transmitted}"]


def _log_converted(
    points: tuple[AttenuationPoint, ...],
    kx: float,
    through: Callable[[float], Transmission | None],
    error: float | None,
    log: Log,
) -> None:
    """Say how much of a flexural wave's power passes as in-plane waves at most, its bar by the relative one of frequencies."""
    known = [(_converted(p.transmission), p.frequency_hz) for p in points if p.transmission]
    if not known:
        return
    most, tone = max(known)
    if most < 1e-9:
        log.info(
            f"at kx = {kx:g} rad/m shear and longitudinal waves of the plate decay: nothing is converted into them"
        )
        return
    ends = [] if error is None else [through(tone * (1.0 + sign * error)) for sign in (-1.0, 1.0)]
    moved = [abs(_converted(each) - most) for each in ends if each]
    bar = max(moved) if len(moved) == 2 else None
    share = with_bar(100.0 * most, None if bar is None else 100.0 * bar, "%")
    log.info(f"at most {share} of an incoming flexural wave's power passes as in-plane waves, at {frequency(tone)}")


def _converted(shares: Transmission) -> float:
    return shares.shear + shares.longitudinal
