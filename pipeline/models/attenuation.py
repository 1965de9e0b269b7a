"""Decay per row across the zone's border: complex bands at the target wavenumber, and the transmission of the case's rows."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from math import nan, pi, sqrt
from typing import Any

import numpy as np

from geometry.elements import BoolArray
from geometry.materials import Material
from pipeline.case.limits import FREQUENCY_KHZ
from pipeline.case.model import Case
from pipeline.logs import Log
from pipeline.models import own_frequency
from pipeline.models.answer_parts import AttenuationPoint, Transmission, Wave
from pipeline.models.bands import sampled_cell
from pipeline.models.broadband import transmitted_shares, wavevectors
from pipeline.models.unit_cell import CLEAR, LatticeModel, bare_cell, lattice_model
from pipeline.planning import refinement
from pipeline.planning.model_choice import ModelChoice
from pipeline.quantity import KHZ, frequency, several, with_bar
from pipeline.records.record import MeshRecord
from solvers.plates.column import level_bars
from solvers.superelement.cell import ResidualModes
from solvers.superelement.lattice import Periodic, ReducedLattice
from solvers.superelement.moduli import Moduli
from solvers.threads import one_thread
from solvers.waves.branches import label_of
from solvers.waves.complex_bands import KeptRow, Row, RowStiffness, RowWaves, chain

# per row: above it, the cell's boundary polynomials do not resolve the wave, and no measurement could
STEEPEST_DB = 100.0
ROUNDING_DB = 1e-6
# largest change of a wavenumber, relative to it or to 1/pitch, with boundary functions of one degree less
CARRIED = 0.01
MODULI_SHARE = (
    0.1  # of the accuracy: what a reduction may miss of moduli at other frequencies before another one is made
)
MAX_PIECES = 8  # reductions of a band; beyond them the error bar grows


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
    own: list[MeshRecord] = []
    scene = _Scene(_pieces(case, choice, log, band_hz, kx, own, model))
    meshes += own
    expected = refinement.log_mesh_error(choice, case, log, scene.mesh_error)
    return _answered(case, scene, log, band_hz, kx, points, expected)


@one_thread()
def solve_own(
    case: Case, model: LatticeModel, log: Log, band_hz: tuple[float, float], kx: float, points: int
) -> dict[str, Any]:
    """Compute the complex bands of rows of an own cell, like `solve`.

    Parameters
    ----------
    case
        The case, with the plate next to the rows.
    model
        The reduced cell, whose sides are faces of that plate.
    log
        Receives the progress.
    band_hz, points
        Range and number of the evenly spaced frequencies.
    kx
        Wavenumber along the zone, rad/m.
    """
    about = sqrt(max(band_hz[0], 1.0) * band_hz[1])
    scene = _Scene([_rows_of(case, kx, about, _of_model(case, model, log, False), None)])
    return _answered(case, scene, log, band_hz, kx, points, scene.mesh_error)


def _answered(
    case: Case, scene: _Scene, log: Log, band_hz: tuple[float, float], kx: float, points: int, expected: float | None
) -> dict[str, Any]:
    """Waves of a scene over a band; expected: discretisation error of its cells' bands."""
    (low, high), rows = band_hz, case.design.rows
    if "y" not in case.design.stack.mirrors:  # both half-plates are taken for mirror images
        if rows:
            log.left_out("power through the rows", "the plate's material is not its own mirror image across them")
    else:
        scene = replace(scene, rows=rows)
    with log.step(f"{points} frequencies"):
        samples = [scene.point(float(f)) for f in np.linspace(low, high, points)]
    with log.step("error bars of the decay"):
        error = None if expected is None else expected + scene.reduction_error
        samples = _with_taken(scene, _with_bars(scene, samples, error), error)
    _log_converted(samples, kx, scene.through, error, log)
    return {
        "model": scene.pieces[0].name,
        "kx_per_m": kx,
        "pitch_y_m": case.design.lattice.a2_m[1],
        "rows": rows,
        "expected_error": expected,
        "reduction_error": scene.reduction_error,
        "points": samples,
    }


@dataclass(frozen=True)
class _Piece:
    """Row about a frequency, its copy with one degree less along the sides, the plate next to it, and errors of its bands.

    Relative errors; that of the reduction includes what its basis misses of moduli at other frequencies.
    """

    name: str
    row: Row
    coarser: Row
    bare: Row
    mesh_error: float | None
    reduction_error: float
    about_hz: float


@dataclass(frozen=True)
class _Scene:
    """Pieces of a band of frequencies, each with the rows of its own reduction, and the number of rows that power passes."""

    pieces: list[_Piece]
    rows: int = 0

    def at(self, tone: float) -> _Piece:
        """The piece nearest to a frequency."""
        return min(self.pieces, key=lambda piece: abs(np.log(tone / piece.about_hz)))

    @property
    def mesh_error(self) -> float | None:
        """Largest discretisation error of a piece; None without an estimate."""
        known = [piece.mesh_error for piece in self.pieces if piece.mesh_error is not None]
        return max(known) if len(known) == len(self.pieces) else None

    @property
    def reduction_error(self) -> float:
        """Largest truncation error of a piece."""
        return max(piece.reduction_error for piece in self.pieces)

    def least(self, tone: float) -> float | None:
        """Decay of the least attenuated flexural wave at a frequency, dB."""
        piece = self.at(tone)
        return _least(_waves(piece.row, piece.coarser, tone, piece.row.waves(tone)))

    def through(self, tone: float) -> Transmission | None:
        """Power through the rows at a frequency."""
        return self._passed(self.at(tone).row.waves(tone).stiffness, tone)

    def point(self, tone: float) -> AttenuationPoint:
        """Waves and power at a frequency."""
        piece = self.at(tone)
        row_waves = piece.row.waves(tone)
        waves = _waves(piece.row, piece.coarser, tone, row_waves)
        transmission = self._passed(row_waves.stiffness, tone)
        return AttenuationPoint(frequency_hz=tone, waves=waves, db_per_row=_least(waves), transmission=transmission)

    def _passed(self, one: RowStiffness, tone: float) -> Transmission | None:
        return transmitted_shares(chain([one] * self.rows), self.at(tone).bare, tone) if self.rows else None


def _pieces(
    case: Case, choice: ModelChoice, log: Log, band_hz: tuple[float, float], kx: float, meshes: list[MeshRecord],
    model: LatticeModel | None,
) -> list[_Piece]:  # fmt: skip
    """Rows of a band: one reduction where moduli are constant, else as many as its basis needs to follow them."""
    low, high = band_hz
    if not own_frequency.is_open(case, "cell"):
        return [_piece(case, choice, log, band_hz, kx, meshes, model, sqrt(max(low, 1.0) * high), None)]
    materials = case.design.materials
    for line in own_frequency.of_part(case, "cell").beyond(np.array(band_hz)):
        log.warning("MATERIAL", line)
    tones = np.geomspace(max(low, KHZ * FREQUENCY_KHZ[0]), high, 2 * MAX_PIECES + 1)
    for count in range(1, MAX_PIECES + 1):
        ends = np.geomspace(tones[0], high, count + 1)
        about = np.sqrt(ends[:-1] * ends[1:]).tolist()
        missed = [
            max(_missed(materials, each, tone) for tone in pair)
            for each, *pair in zip(about, ends, ends[1:], strict=False)
        ]
        if max(missed) <= MODULI_SHARE * case.solve.accuracy:
            break
    log.info(
        f"moduli depend on the frequency: {several(count, 'reduction')} with those at {', '.join(map(frequency, about))}"
    )
    out = []
    for each, extra in zip(about, missed, strict=True):
        tuned = own_frequency.taken_at(case, each)
        out.append(_piece(tuned, choice, log, band_hz, kx, meshes, None, each, extra))
    return out


def _missed(materials: Sequence[Material], about_hz: float, tone: float) -> float:
    """What a basis with the moduli at one frequency overestimates of a frequency with those at another, relative."""
    return (
        Moduli(tuple(each.at_hz(about_hz) for each in materials)).missed(tone)
        / 2.0
        * float(ResidualModes(CLEAR**2).growth(1.0))
    )


def _piece(
    case: Case, choice: ModelChoice, log: Log, band_hz: tuple[float, float], kx: float, meshes: list[MeshRecord],
    model: LatticeModel | None, about_hz: float, missed: float | None,
) -> _Piece:  # fmt: skip
    """Rows of one reduction; missed: what its basis misses of other moduli, None where they are constant."""
    make = _staggered if case.design.stagger else _in_line
    return _rows_of(case, kx, about_hz, make(case, choice, log, band_hz[1], meshes, model, missed is not None), missed)


Made = tuple[str, Periodic, Periodic, float | None, float]  # model, row, bare plate, and errors of the bands


def _rows_of(case: Case, kx: float, about_hz: float, made: Made, missed: float | None) -> _Piece:
    """Rows of cells at a wavenumber."""
    parted = missed is not None
    name, row, bare, by_mesh, truncated = made
    plate = tuple(dict.fromkeys(layer.material for layer in case.design.stack.layers))
    standing = case.design.materials
    own, beside = (
        (Moduli(standing, case.is_lossy), Moduli(standing if case.design.stagger else plate))
        if parted
        else (None, None)
    )
    return _Piece(
        name,
        Row(row, kx, own),
        Row(_coarser(row), kx, own),
        _kept(KeptRow(bare, kx, beside)),
        by_mesh,
        truncated + (missed or 0.0),
        about_hz,
    )


def _in_line(
    case: Case, choice: ModelChoice, log: Log, high_hz: float, meshes: list[MeshRecord], model: LatticeModel | None,
    parted: bool,
) -> Made:  # fmt: skip
    """Cell of the bands, reduced once for both uses, or again if its cut-off is too low for these frequencies."""
    if model is None or model.lattice.cell.dropped_hz < CLEAR * high_hz or not _is_row(case, model):
        corners = case.path(1).corners
        model = lattice_model(case, choice, corners, log, meshes, high_hz=high_hz, parted=parted)
    return _of_model(case, model, log, parted)


def _is_row(case: Case, model: LatticeModel) -> bool:
    """Whether the sides of a reduced cell are those of the case's own: `bands` may have another one of its lattice."""
    return bool(np.allclose(model.lattice.cell.vectors_m, case.design.lattice.vectors_m))


def _of_model(case: Case, model: LatticeModel, log: Log, parted: bool) -> Made:
    """A reduced cell, and bare plate with its boundary functions."""
    cell = model.lattice.cell
    row, bare = Periodic([cell]), Periodic([bare_cell(case, cell.interface, log, parted)])
    return model.name, row, bare, model.mesh_error, model.reduction_error


def _staggered(
    case: Case, choice: ModelChoice, log: Log, high_hz: float, meshes: list[MeshRecord], model: LatticeModel | None,
    parted: bool,
) -> Made:  # fmt: skip
    """Row of a staggered array, reduced like that of the bands."""
    assert choice.reduction
    reduction = replace(choice.reduction, top_hz=max(choice.reduction.top_hz, CLEAR * high_hz))
    path = case.path(1)
    choice, row, (by_mesh, truncated) = sampled_cell(case, replace(choice, reduction=reduction), path, log, parted)
    assert isinstance(row, Periodic)
    bare = [replace(row.cells[1], loss=None)] * 2  # waves to and from the rows are told apart by their power
    return choice.name, row, Periodic(bare, row.shift), by_mesh, truncated


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


def _with_bars(scene: _Scene, samples: list[AttenuationPoint], error: float | None) -> list[AttenuationPoint]:
    """Add the error of each decay for a relative `error` of the cell's bands."""
    tones, decays = np.array([[p.frequency_hz, nan if p.db_per_row is None else p.db_per_row] for p in samples]).T
    bars = level_bars(tones, decays, error, scene.least)
    return [
        replace(p, db_error=bar, waves=[_with_bar(wave, p.db_per_row, bar) for wave in p.waves])
        for p, bar in zip(samples, bars, strict=True)
    ]


def _with_bar(wave: Wave, least: float | None, bar: float | None) -> Wave:
    """Add the error of the decay to the least attenuated flexural wave; the others have none."""
    is_least = wave.polarisation == "flexural" and wave.db_per_row == least
    return replace(wave, db_error=bar) if is_least else wave


def _with_taken(scene: _Scene, samples: list[AttenuationPoint], error: float | None) -> list[AttenuationPoint]:
    """Add the error of the power that a flexural wave loses at the rows."""

    def taken(tone: float) -> float | None:
        shares = scene.through(tone)
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
