"""Decay per row across the zone's border: complex bands at the wanted wavenumber, and what the case's rows let through."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from math import pi
from typing import Any

import numpy as np

from geometry.elements import IntArray
from pipeline.case.model import Case
from pipeline.errors import InputError
from pipeline.logs import Log
from pipeline.models.unit_cell import bare_cell, lattice_model
from pipeline.planning import error_bar, foresight, simplifications
from pipeline.planning.model_choice import SOLID, cell_model_choice
from pipeline.planning.request import driven_band_hz
from solvers.threads import one_thread
from solvers.waves.brillouin import path_through
from solvers.waves.evanescent import Row, RowWaves
from solvers.waves.polarisation import label_of
from solvers.waves.scattering import scatter, stacked

POINTS = 201
STEEPEST_DB = (
    100.0  # a row: beyond, the cell's boundary polynomials do not resolve the wave, and nobody could measure it
)
HELD_DB = 10.0
ROUNDING_DB = 1e-6


@dataclass(frozen=True)
class Wave:
    """One Bloch wave across the rows: its polarisation and complex wavenumber ky."""

    polarisation: str
    ky_re_per_m: float
    ky_im_per_m: float
    db_per_row: float
    pillar_share: float


@dataclass(frozen=True)
class Transmission:
    """Shares of an incoming flexural wave's power after the case's rows, by polarisation."""

    reflected: float
    flexural: float
    shear: float
    longitudinal: float


@dataclass(frozen=True)
class Point:
    """All waves at one frequency, the decay of the least attenuated flexural wave, and the power that the case's rows
    transmit.
    """

    frequency_hz: float
    waves: tuple[Wave, ...]
    db_per_row: float | None
    transmission: Transmission | None


@dataclass(frozen=True)
class Attenuation:
    """Complex bands over frequency at one wavenumber along the zone; errors are those of the cell's bands, relative."""

    model: str
    kx_per_m: float
    rows: int
    pitch_y_m: float
    points: tuple[Point, ...]
    meshes: list[dict[str, Any]] = field(default_factory=list)
    expected_error: float | None = None
    reduction_error: float | None = None

    def json(self) -> dict[str, Any]:
        """Return the fields of the contract and the transmission, without times."""
        return {
            "schema": 1,
            "model": self.model,
            "kx_per_m": self.kx_per_m,
            "pitch_y_m": self.pitch_y_m,
            "rows": self.rows,
            "expected_error": self.expected_error,
            "reduction_error": self.reduction_error,
            "points": [
                {
                    "frequency_hz": point.frequency_hz,
                    "waves": [vars(wave) for wave in point.waves],
                    "db_per_row": point.db_per_row,
                    "through_rows": vars(point.transmission) if point.transmission else None,
                }
                for point in self.points
            ],
        }

    def at(self, frequency_hz: float) -> float | None:
        """Decay per row of the least attenuated flexural wave at a frequency, interpolated; None outside the band."""
        known = [(p.frequency_hz, p.db_per_row) for p in self.points if p.db_per_row is not None]
        if not known or not known[0][0] <= frequency_hz <= known[-1][0]:
            return None
        return float(np.interp(frequency_hz, *np.array(known).T))


def solve(
    case: Case,
    log: Log,
    band_hz: tuple[float, float] | None = None,
    kx_per_m: float | None = None,
    points: int = POINTS,
) -> Attenuation:
    """Complex bands of the case. InputError for a wavenumber beyond the zone's edge or a case without pillar or pitch."""
    case.require("plate", "array.pitch_mm", "pillar", command="attenuation")
    if kx_per_m is None:
        case.require("zone", command="attenuation without --kx")
    choice = cell_model_choice(case)
    if case.solve.model == SOLID:
        raise InputError(f"{case.name}: solve.model = 'solid': must be auto or superelement for attenuation")
    simplifications.log_all((*choice.left_out, simplifications.waves_downwards(case.design)), log)
    kx = _checked_kx(case, case.kx_wanted_per_m if kx_per_m is None else kx_per_m)
    low, high = driven_band_hz(case, band_hz)
    foresight.announce("attenuation across the rows", foresight.of_attenuation(case, choice, points), log)
    meshes: list[dict[str, Any]] = []
    path = path_through(case.bands.path, 1, case.design.pitch_x_m, case.design.pitch_y_m)
    model = lattice_model(case, choice, path.wavevectors[[segment.last for segment in path.segments]], log, meshes)
    cell = model.lattice.cell  # the one that the bands use: reduced once for both
    row, bare = Row(cell, kx), Row(bare_cell(case, cell.interface, log), kx)
    rows = case.design.rows
    with log.step(f"{points} frequencies"), one_thread():
        samples = tuple(_point(row, bare, rows, float(f)) for f in np.linspace(low, high, points))
    _log_summary(samples, kx, log)
    expected = error_bar.log_expected(choice, case, log, high)
    return Attenuation(model.name, kx, rows, case.design.pitch_y_m, samples, meshes, expected, model.reduction_error)


def _checked_kx(case: Case, kx: float) -> float:
    edge = pi / case.design.pitch_x_m
    if not (math.isfinite(kx) and abs(kx) <= edge * (1.0 + 1e-12)):
        text = f"--kx = {kx:g}: must lie between -pi/p and pi/p, {-edge:.1f} and {edge:.1f} rad/m here"
        raise InputError(text)
    return kx


def _point(row: Row, bare: Row, rows: int, frequency_hz: float) -> Point:
    row_waves = row.waves(frequency_hz)
    kept = np.flatnonzero(row_waves.db_per_row <= STEEPEST_DB)
    waves = tuple(_described(row, row_waves, kept))
    flexural = [wave.db_per_row for wave in waves if wave.polarisation == "flexural"]
    transmission = _transmission(row, bare, rows, frequency_hz) if rows else None
    return Point(frequency_hz, waves, min(flexural, default=None), transmission)


def _wavevectors(row: Row, row_waves: RowWaves, kept: IntArray) -> Any:
    ky = row_waves.wavenumber_per_m[kept]
    return np.vstack([np.full(len(ky), row.kx, dtype=complex), ky])


def _described(row: Row, row_waves: RowWaves, kept: Any) -> list[Wave]:
    labels = label_of(row.cell, row_waves.dofs[:, kept], _wavevectors(row, row_waves, kept))
    waves = []
    for index, label in zip(kept, labels, strict=True):
        ky, db = row_waves.wavenumber_per_m[index], abs(float(row_waves.db_per_row[index]))
        db = 0.0 if db < ROUNDING_DB else db
        waves.append(Wave(label.name, float(ky.real), max(float(ky.imag), 0.0), db, float(label.pillar_share)))
    return waves


def _transmission(row: Row, bare: Row, rows: int, frequency_hz: float) -> Transmission | None:
    """Shares of the incoming flexural wave's power by polarisation; None where the bare plate carries no such wave at
    this kx.
    """
    half = bare.waves(frequency_hz)
    going = np.flatnonzero(half.flux > 0.0)
    if not len(going):
        return None
    labels = [label.name for label in label_of(bare.cell, half.dofs[:, going], _wavevectors(bare, half, going))]
    if "flexural" not in labels:
        return None
    incoming = int(going[labels.index("flexural")])
    stiffness, _ = row.condensed(frequency_hz)
    scattered = scatter(stacked(stiffness, rows), half, bare.mirror_sign, incoming)
    transmitted = dict.fromkeys(("flexural", "shear", "longitudinal"), 0.0)
    for name, share in zip(labels, scattered.transmitted, strict=True):
        transmitted[name] += float(share)
    return Transmission(float(scattered.reflected.sum()), **transmitted)


def prediction(attenuation: Attenuation, frequency_hz: float, extension_db: float | None) -> dict[str, Any]:
    """Compare rows times decay per row at a frequency with the transmitted power and with the finite plate's level,
    dB.
    """
    per_row = attenuation.at(frequency_hz)
    nearest = min(attenuation.points, key=lambda point: abs(point.frequency_hz - frequency_hz))
    passed = nearest.transmission.flexural if nearest.transmission else None
    return {
        "frequency_hz": frequency_hz,
        "db_per_row": per_row,
        "rows_db": None if per_row is None else attenuation.rows * per_row,
        "through_db": -10.0 * math.log10(passed) if passed else None,
        "zone_to_extension_db": extension_db,
        "rows_for_10_db": math.ceil(HELD_DB / per_row) if per_row else None,
    }


def _log_summary(points: tuple[Point, ...], kx: float, log: Log) -> None:
    converted = [p.transmission.shear + p.transmission.longitudinal for p in points if p.transmission]
    if converted and max(converted) < 1e-9:
        log.info(
            f"at kx = {kx:.1f} rad/m shear and longitudinal waves of the plate decay: nothing is converted into them"
        )
    elif converted:
        log.info(
            f"at most {100.0 * max(converted):.2g} % of an incoming flexural wave's power passes as in-plane waves"
        )
