"""Decay per row across the zone's border: complex bands at the target wavenumber, and the transmission of the case's rows."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from math import nan, pi
from typing import Any

import numpy as np

from geometry.elements import BoolArray
from pipeline.case.model import Case
from pipeline.logs import Log
from pipeline.models.answer_parts import AttenuationPoint, Transmission, Wave
from pipeline.models.bands import sampled_cell
from pipeline.models.broadband import transmitted_shares, wavevectors
from pipeline.models.unit_cell import CLEAR, LatticeModel, bare_cell, lattice_model
from pipeline.planning import refinement
from pipeline.planning.model_choice import ModelChoice
from pipeline.quantity import frequency, with_bar
from pipeline.records.record import MeshRecord
from solvers.plates.column import level_bars
from solvers.superelement.lattice import Periodic, ReducedLattice
from solvers.threads import one_thread
from solvers.waves.branches import label_of
from solvers.waves.complex_bands import KeptRow, Row, RowStiffness, RowWaves, chain

# per row: above it, the cell's boundary polynomials do not resolve the wave, and no measurement could
STEEPEST_DB = 100.0
ROUNDING_DB = 1e-6
# largest change of a wavenumber, relative to it or to 1/pitch, with boundary functions of one degree less
CARRIED = 0.01


@one_thread()
def solve(
    case: Case, choice: ModelChoice, log: Log, band_hz: tuple[float, float], kx: float, points: int,
    meshes: list[MeshRecord], model: LatticeModel | None = None,
) -> dict[str, Any]:  # fmt: skip
    """Compute the complex bands of the case's row over a band of frequencies; columns of `AttenuationResult` by name.

    Parameters
    ----------
    case
        The case.
    choice
        Model and mesh of the cell.
    log
        Receives the progress.
    band_hz, points
        Range and number of the evenly spaced frequencies.
    kx
        Wavenumber along the zone, rad/m.
    meshes
        Receives the meshes of the cell.
    model
        Reduced cell of the case's bands, if there is one already.
    """
    (low, high), rows = band_hz, case.design.rows
    own: list[MeshRecord] = []
    cells = (
        _staggered(case, choice, log, high) if case.design.stagger else _in_line(case, choice, log, high, own, model)
    )
    meshes += own
    row, coarser, bare = Row(cells.row, kx), Row(cells.coarser, kx), _kept(KeptRow(cells.bare, kx))
    passed = rows if "y" in case.design.stack.mirrors else 0  # both half-plates are taken for mirror images
    if rows > passed:
        log.left_out("power through the rows", "the plate's material is not its own mirror image across them")
    with log.step(f"{points} frequencies"):
        samples = [_point(row, coarser, bare, passed, float(f)) for f in np.linspace(low, high, points)]
    expected = refinement.log_mesh_error(choice, case, log, cells.mesh_error)
    with log.step("error bars of the decay"):
        error = None if expected is None else expected + cells.reduction_error
        samples = _with_taken(row, bare, passed, _with_bars(row, coarser, samples, error), error)
    _log_converted(samples, kx, lambda tone: _through(row.waves(tone).stiffness, bare, passed, tone), error, log)
    return {
        "model": cells.name,
        "kx_per_m": kx,
        "pitch_y_m": case.design.pitch_y_m,
        "rows": rows,
        "expected_error": expected,
        "reduction_error": cells.reduction_error,
        "points": samples,
    }


@dataclass(frozen=True)
class _Cells:
    """A row, its copy with one degree less along the sides, the plate beside the row, and relative errors of its bands."""

    name: str
    row: Periodic
    coarser: Periodic
    bare: Periodic
    mesh_error: float | None
    reduction_error: float


def _in_line(
    case: Case, choice: ModelChoice, log: Log, high_hz: float, meshes: list[MeshRecord], model: LatticeModel | None
) -> _Cells:
    """Cell of the bands, reduced once for both uses, or again if its cut-off is too low for these frequencies."""
    if model is None or model.lattice.cell.dropped_hz < CLEAR * high_hz:
        corners = case.path(1).corners
        model = lattice_model(case, choice, corners, log, meshes, high_hz=high_hz)
    cell = model.lattice.cell
    row, bare = Periodic([cell]), Periodic([bare_cell(case, cell.interface, log)])
    return _Cells(model.name, row, _coarser(row), bare, model.mesh_error, model.reduction_error)


def _staggered(case: Case, choice: ModelChoice, log: Log, high_hz: float) -> _Cells:
    """Row of a staggered array, reduced like that of the bands."""
    assert choice.reduction
    reduction = replace(choice.reduction, top_hz=max(choice.reduction.top_hz, CLEAR * high_hz))
    path = case.path(1)
    choice, row, (by_mesh, truncated) = sampled_cell(case, replace(choice, reduction=reduction), path, log)
    assert isinstance(row, Periodic)
    bare = [replace(row.cells[1], loss=None)] * 2  # waves to and from the rows are told apart by their power
    return _Cells(choice.name, row, _coarser(row), Periodic(bare, row.shift), by_mesh, truncated)


def _coarser(row: Periodic) -> Periodic:
    """Row with boundary functions of one degree less along its sides."""
    face = row.cells[0].interface
    lower = replace(face, along=max(face.along - 1, 1))
    return Periodic([ReducedLattice(cell).up_to(lower, cell.dropped_hz).cell for cell in row.cells], row.shift)


_last: list[KeptRow] = []


def _kept(row: KeptRow) -> KeptRow:
    """Row of the last case with its waves, if it is the same: cases of one pitch in a study share it."""
    if not (_last and _last[0].same == row.same):
        _last[:] = [row]
    return _last[0]


def carried(waves: RowWaves, fewer: RowWaves) -> BoolArray:
    """Mask of the waves that the boundary functions resolve, (n,): those that propagate, or decay equally with fewer functions.

    Spurious steep waves of the functions themselves move with their degree. Each wave of the coarser row confirms one wave.
    """
    ours, theirs = waves.wavenumber_per_m, fewer.wavenumber_per_m
    off, turn = ours[:, None] - theirs, 2.0 * pi / waves.pitch_m  # wavenumbers 2 pi/pitch apart are the same
    off = off - turn * np.round(off.real / turn)
    # half the change of k^2, smooth where a band begins at k = 0
    squares = np.abs(off * (2.0 * ours[:, None] - off)) / 2.0
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
    return transmitted_shares(chain([one] * rows), bare, frequency_hz) if rows else None


def _with_bars(row: Row, coarser: Row, samples: list[AttenuationPoint], error: float | None) -> list[AttenuationPoint]:
    """Add the error of each decay for a relative `error` of the cell's bands."""
    tones, decays = np.array([[p.frequency_hz, nan if p.db_per_row is None else p.db_per_row] for p in samples]).T
    bars = level_bars(tones, decays, error, lambda tone: _least(_waves(row, coarser, tone, row.waves(tone))))
    return [
        replace(p, db_error=bar, waves=[_with_bar(wave, p.db_per_row, bar) for wave in p.waves])
        for p, bar in zip(samples, bars, strict=True)
    ]


def _with_bar(wave: Wave, least: float | None, bar: float | None) -> Wave:
    """Add the error of the decay to the least attenuated flexural wave; the others have none."""
    is_least = wave.polarisation == "flexural" and wave.db_per_row == least
    return replace(wave, db_error=bar) if is_least else wave


def _with_taken(
    row: Row, bare: Row, rows: int, samples: list[AttenuationPoint], error: float | None
) -> list[AttenuationPoint]:
    """Add the error of the power that a flexural wave loses at the rows."""

    def taken(tone: float) -> float | None:
        shares = _through(row.waves(tone).stiffness, bare, rows, tone)
        return shares.taken_db if shares else None

    tones, levels = np.array([[p.frequency_hz, p.taken_db] for p in samples]).T
    bars = level_bars(tones, levels, error, taken)
    return [replace(p, taken_error_db=bar) for p, bar in zip(samples, bars, strict=True)]


def _least(waves: Iterable[Wave]) -> float | None:
    return min((wave.db_per_row for wave in waves if wave.polarisation == "flexural"), default=None)


def _waves(row: Row, coarser: Row, frequency_hz: float, row_waves: RowWaves) -> list[Wave]:
    """Waves that the boundary functions resolve, up to the steepest decay."""
    known = carried(row_waves, coarser.waves(frequency_hz))
    return _described(row, row_waves, np.flatnonzero((row_waves.db_per_row <= STEEPEST_DB) & known))


def _described(row: Row, row_waves: RowWaves, kept: Any) -> list[Wave]:
    labels = label_of(row.periodic, row_waves.dofs[:, kept], wavevectors(row, row_waves, kept))
    waves = []
    for index, label in zip(kept, labels, strict=True):
        ky, db = row_waves.wavenumber_per_m[index], abs(float(row_waves.db_per_row[index]))
        db = 0.0 if db < ROUNDING_DB else db
        own = {"polarisation": label.name, "ky_re_per_m": ky.real, "ky_im_per_m": max(ky.imag, 0.0)}
        waves.append(Wave(**own, db_per_row=db, pillar_share=label.pillar_share))
    return waves


def _log_converted(
    points: list[AttenuationPoint],
    kx: float,
    through: Callable[[float], Transmission | None],
    error: float | None,
    log: Log,
) -> None:
    """Log the largest share of a flexural wave's power that passes as in-plane waves, with its error bar."""
    known = [(_converted(p.transmission), p.frequency_hz) for p in points if p.transmission]
    if not known:
        return
    most, tone = max(known)
    if most < 1e-9:
        log.info(
            f"in-plane conversion: none, since the plate's shear and longitudinal waves decay at kx = {kx:g} rad/m"
        )
        return
    ends = [] if error is None else [through(tone * (1.0 + sign * error)) for sign in (-1.0, 1.0)]
    moved = [abs(_converted(each) - most) for each in ends if each]
    bar = max(moved) if len(moved) == 2 else None
    share = with_bar(100.0 * most, None if bar is None else 100.0 * bar, "%")
    log.info(f"in-plane conversion: at most {share} of an incoming flexural wave's power, at {frequency(tone)}")


def _converted(shares: Transmission) -> float:
    return shares.shear + shares.longitudinal
