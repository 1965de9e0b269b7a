"""Two modes of the zone held a quarter period apart: a wave that travels inside it, its power, and the board's table for it."""

from __future__ import annotations

from dataclasses import dataclass, replace
from math import log, pi
from typing import Any

import numpy as np

from geometry.elements import BoolArray, ComplexArray, FloatArray
from geometry.layout import Design
from pipeline.case.model import Case
from pipeline.logs import Log
from pipeline.models import shear
from pipeline.models.forced import forced_plate
from pipeline.models.shear import Driven
from pipeline.models.travel_parts import PatternMode
from pipeline.records.record import MeshRecord
from pipeline.units import KHZ, UM
from solvers.accuracy import calibration
from solvers.driven.error_bars import Louder, Variation, frequency_errors, half_widths, is_known, mixings, sources
from solvers.driven.several_patches import motion_at, plate_table, power_flow
from solvers.errors import SolverError
from solvers.measures.confinement import ratio_db, target_shape
from solvers.piezo.forced import ForcedPlate
from solvers.piezo.peak_errors import height_error
from solvers.shaping.modal_table import ModalTable, field_matrix, sensor_matrix
from solvers.shaping.travelling_wave import (
    ModePair,
    best_travelling_drive,
    inner_window,
    travelling_pair,
    travelling_wave_ratio,
)
from solvers.threads import one_thread

ALONG, ACROSS = 61, 5  # points over the zone: an odd number across has its centre line
MIN_SHARE = 0.1  # of a mode's mass that moves in the shape asked for
NEAR_FIELD = 0.1  # what is left of the ends' near field, e^{-kx}, where the wave is judged
MAX_WINDOW = 0.3  # of the length, at each end, that is left out at most


@dataclass(frozen=True)
class Travelling:
    """The pair held on the plate, and what the table for the board is made from: patterns by name, volts of the drivers."""

    forced: ForcedPlate
    table: ModalTable
    pair: ModePair
    window: BoolArray
    line: BoolArray
    drives: dict[str, ComplexArray]

    @property
    def line_m(self) -> FloatArray:
        """Places along the zone's centre line, m."""
        return np.asarray(self.table.points_m[self.line, 0])

    def field(self, volts: ComplexArray) -> ComplexArray:
        """u_z along the centre line for voltages of the drivers, m."""
        return np.asarray(field_matrix(self.table, self.pair.frequency_hz)[self.line] @ volts)

    def twr(self, volts: ComplexArray) -> float:
        """Travelling-wave ratio within the window."""
        return travelling_wave_ratio(self.field(volts)[self.window[self.line]])

    @property
    def matrix(self) -> ComplexArray:
        """Volts of the sensors per volt of each driver, (sensors, drivers)."""
        return sensor_matrix(self.table, self.pair.frequency_hz)

    def all_volts(self, volts: ComplexArray) -> ComplexArray:
        """Voltages of every patch as `ForcedPlate.driven_by` takes them."""
        every = np.zeros(len(self.forced.plate.patches), dtype=complex)
        every[self.forced.drivers] = volts
        return every


@one_thread()
def solve(
    case: Case, log: Log, band_hz: tuple[float, float] | None, others: float, meshes: list[MeshRecord]
) -> tuple[dict[str, Any], Travelling]:
    """Hold the target mode and its neighbour with one nodal line more or less; the pair that runs best.

    Returns columns of `TravelResult` by name, and what they are made from. SolverError where the band does not hold both modes.
    """
    forced = forced_plate(case, log, band_hz, meshes)
    with log.step("two modes a quarter period apart"):
        wave = best_pair(forced, case.design, others)
        values = _values(wave, case.design)
    with log.step("error bars"):
        bars, varied = _bars(values, forced, case.design, others)
    felt = shear.solve(case, forced, _driven(wave, values), values["wavenumber_per_m"], log, varied)
    return {**values, **bars, "shear": felt}, wave


def best_pair(forced: ForcedPlate, design: Design, others: float, rows: list[FloatArray] | None = None) -> Travelling:
    """The better of the pairs (N, N - 1) and (N, N + 1) among the plate's own modes, and further drives for the board."""
    points, line = _points(design)
    middle = 0.5 * sum(forced.band_hz)
    known = motion_at(forced, points) if rows is None else rows
    table = plate_table(forced, points, middle, known)
    own = _mode(table, design, design.nodal_lines)
    window = line & inner_window(points, *_window(design))
    candidates: list[tuple[float, ModalTable, ModePair]] = []
    for neighbour in (design.nodal_lines - 1, design.nodal_lines + 1):
        other = _mode(table, design, neighbour)
        if own is None or other is None or other == own:
            continue
        tone = float(np.sqrt(table.frequencies_hz[own] * table.frequencies_hz[other]))
        at = plate_table(forced, points, tone, known)
        pair = travelling_pair(at, (own, other), window, others)
        candidates.append((pair.twr, at, pair))
    if not candidates:
        low, high = (end / KHZ for end in forced.band_hz)
        raise SolverError(
            f"the band from {low:g} to {high:g} kHz does not hold the target mode and a neighbour with one nodal line more or "
            "less: widen it"
        )
    _, best, pair = max(candidates, key=lambda each: each[0])
    volts = pair.drive.voltages
    field = field_matrix(best, pair.frequency_hz)[window]
    reach = best_travelling_drive(field, points[window, 0], pi / (design.half_wavelength_m or design.width_m))[0]
    back = best_travelling_drive(field, -points[window, 0], pi / (design.half_wavelength_m or design.width_m))[0]
    drives = {"pair+": volts, "pair-": _reversed(best, pair, window, others), "wave+": reach, "wave-": back}
    unit = {name: np.asarray(each / np.abs(each).max()) for name, each in drives.items()}
    return Travelling(forced, best, pair, window, line, unit)


def _reversed(table: ModalTable, pair: ModePair, window: BoolArray, others: float) -> ComplexArray:
    """The same pair towards -x: its places turned round."""
    turned = replace(table, points_m=table.points_m * np.array([-1.0, 1.0]))
    return travelling_pair(turned, pair.modes, window, others).drive.voltages


def _points(design: Design) -> tuple[FloatArray, BoolArray]:
    """Points over the zone (p, 2), m, and which of them are on its centre line."""
    half = design.length_m / 2.0
    step = 2.0 * half / ALONG
    x = np.linspace(-half + step / 2.0, half - step / 2.0, ALONG)
    y = design.width_m * (np.arange(ACROSS) - ACROSS // 2) / (ACROSS + 1.0)
    grid = np.stack(np.meshgrid(x, y, indexing="ij"), axis=-1).reshape(-1, 2)
    return grid, grid[:, 1] == 0.0


def _window(design: Design) -> tuple[float, float]:
    """From where to where the wave is judged, m: free of the ends' near field."""
    k = pi / (design.half_wavelength_m or design.width_m)
    margin = min(-log(NEAR_FIELD) / k, MAX_WINDOW * design.length_m)
    return margin - design.length_m / 2.0, design.length_m / 2.0 - margin


def share_of(table: ModalTable, design: Design, lines: int) -> FloatArray:
    """Share of each mode's mass that moves as the zone's shape with so many nodal lines, (modes,)."""
    shape = target_shape(replace(design, nodal_lines=lines), table.points_m)
    per_point = design.stack.mass_kg_m2 * design.length_m * design.width_m / len(shape)
    return np.asarray(per_point * (table.field @ shape) ** 2 / (shape @ shape))


def _mode(table: ModalTable, design: Design, lines: int) -> int | None:
    share = share_of(table, design, lines)
    best = int(np.argmax(share))
    return best if share[best] >= MIN_SHARE else None


def _values(wave: Travelling, design: Design) -> dict[str, Any]:
    """Return the columns of a wave without their bars; figures of power and field for 1 um rms in the zone."""
    pair, volts, tone = wave.pair, wave.drives["pair+"], wave.pair.frequency_hz
    plate = wave.forced.driven_by(wave.all_volts(volts))
    curve, flow = plate.curve(np.array([tone])), power_flow(plate, tone)
    zone = float(curve.zone_rms_m_per_v[0])
    per_um = UM / zone
    passive = None if curve.passive_rms_m_per_v is None else float(ratio_db(zone, curve.passive_rms_m_per_v[0]))
    field = wave.field(volts) * per_um
    stand = wave.forced.driven_by(wave.forced.signs.astype(np.complex128))
    standing = float(stand.curve(np.array([tone])).zone_rms_m_per_v[0])
    shares = [share_of(wave.table, design, lines) for lines in _neighbours(design)]
    own = [int(np.argmax([share[mode] for share in shares])) for mode in pair.modes]
    return {
        "model": f"{plate.plate.name} with {len(plate.plate.patches)} patches",
        "dof": sum(group.pencil.dof for group in plate.plate.groups),
        "frequency_hz": tone,
        "modes": [
            PatternMode(
                nodal_lines=_neighbours(design)[which],
                frequency_hz=float(wave.table.frequencies_hz[mode]),
                share=float(shares[which][mode]),
            )
            for which, mode in zip(own, pair.modes, strict=True)
        ],
        "twr": pair.twr,
        "alone_twr": pair.alone,
        "best_twr": wave.twr(wave.drives["wave+"]),
        "wavenumber_per_m": pair.wavenumber,
        "window_m": [float(end(wave.table.points_m[wave.window, 0])) for end in (np.min, np.max)],
        "confinement_db": passive,
        "drive_V_at_1um": per_um,
        "drivers": list(wave.forced.drivers),
        "volts": volts.tolist(),
        "x_m": wave.line_m,
        "field_m": field,
        "patches_W": (flow.patches_w * per_um**2).tolist(),
        "lost_W": flow.lost_w * per_um**2,
        "flow_x_m": flow.x_m.tolist(),
        "flow_W": (flow.flow_w * per_um**2).tolist(),
        "standing_flow_W": (power_flow(stand, tone).flow_w * (UM / standing) ** 2).tolist(),
        "inner_sections": max(len(flow.x_m) - 2, 0),
    }


FIGURES = {
    "twr": "twr_error",
    "alone_twr": "alone_twr_error",
    "best_twr": "best_twr_error",
    "wavenumber_per_m": "wavenumber_error_per_m",
    "confinement_db": "confinement_error_db",
    "drive_V_at_1um": "drive_error_V_at_1um",
    "lost_W": "lost_error_W",
}


LISTS = {
    "flow_W": "flow_error_W",
    "patches_W": "patches_error_W",
    "standing_flow_W": "standing_flow_error_W",
    "field_m": "field_error_m",
}


def _driven(wave: Travelling, values: dict[str, Any], each: Variation | Louder | None = None) -> Driven:
    return Driven(wave.all_volts(wave.drives["pair+"]) * values["drive_V_at_1um"], values["frequency_hz"], each)


def _bars(
    values: dict[str, Any], forced: ForcedPlate, design: Design, others: float
) -> tuple[dict[str, Any], list[tuple[Driven, ...]]]:
    """Return the columns with half-widths of bars, and how plates within the bars are driven.

    Plates of one source together; nothing where the bars are not known, no plates where one of them has no such wave.
    """
    errors, share = frequency_errors(forced), calibration.mixing()
    if share is None or not is_known(errors):
        return {}, []
    nominal, rows = _figures(values), motion_at(forced, _points(design)[0])
    tone, modes = values["frequency_hz"], values["modes"]
    load = height_error(forced, modes[0].frequency_hz)
    varied: list[tuple[Variation | Louder, ...]] = [
        *sources(forced, errors, modes[0].frequency_hz, share, load),
        *mixings(forced, errors, modes[1].frequency_hz, share),
    ]
    driven: dict[int, Driven] = {}

    def again(each: Variation | Louder) -> FloatArray:
        known = [each.of_columns(basis, own) for basis, own in zip(forced.modes, rows, strict=True)]
        try:
            wave = best_pair(each.of(forced), design, others, known)
            moved = _values(wave, design)
            figures, driven[id(each)] = _figures(moved), _driven(wave, moved, each)
        except SolverError:
            figures = np.zeros(0)
        return figures if figures.shape == nominal.shape else np.full_like(nominal, np.nan)

    half = half_widths(nominal, varied, again)
    names = [name for name in FIGURES if values[name] is not None]
    bars: dict[str, Any] = {FIGURES[name]: float(bar) for name, bar in zip(names, half, strict=False)}
    first = len(names)
    for name, error in LISTS.items():
        bars[error] = half[first : (first := first + len(values[name]))]
    bars["modes"] = [
        replace(mode, frequency_error=float(hz) / mode.frequency_hz, share_error=float(part))
        for mode, hz, part in zip(modes, half[first:-1:2], half[first + 1 : -1 : 2], strict=True)
    ]
    known = [tuple(driven[id(each)] for each in source if id(each) in driven) for source in varied]
    whole = all(len(some) == len(source) for some, source in zip(known, varied, strict=True))
    return bars | {"frequency_error": float(half[-1]) / tone}, known if whole else []


def _figures(values: dict[str, Any]) -> FloatArray:
    """Return every figure that has a bar: those of FIGURES and LISTS, of the field its size, both modes, the frequency."""
    known = [values[name] for name in FIGURES if values[name] is not None]
    lists = [np.abs(values[name]) if name == "field_m" else values[name] for name in LISTS]
    of_modes = [value for mode in values["modes"] for value in (mode.frequency_hz, mode.share)]
    return np.concatenate([known, *lists, of_modes, [values["frequency_hz"]]])


def _neighbours(design: Design) -> tuple[int, ...]:
    return design.nodal_lines - 1, design.nodal_lines, design.nodal_lines + 1
