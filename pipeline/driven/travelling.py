"""Two modes of the zone held a quarter period apart: a wave that travels inside it, its power, and the board's table for it."""

from __future__ import annotations

from dataclasses import dataclass, replace
from math import log, pi
from typing import Any

import numpy as np

from geometry.elements import BoolArray, ComplexArray, FloatArray
from geometry.layout import Design
from pipeline.case.model import Case
from pipeline.driven import shear
from pipeline.driven.shear import Driven
from pipeline.errors import InputError
from pipeline.logs import Log
from pipeline.models.patched_plate import forced_plate
from pipeline.planning import calibration
from pipeline.quantity import figure, frequency_with_bar, level_with_bar, with_bar
from pipeline.records.record import MeshRecord, PatternMode, ShearRecord, TravelRecord
from pipeline.units import KHZ, MM, UM
from solvers.driven.error_bars import Louder, Variation, frequency_errors, half_widths, is_known, mixings, sources
from solvers.driven.plate_table import motion_at, plate_table
from solvers.driven.power_flow import power_flow
from solvers.errors import SolverError
from solvers.measures.confinement import wanted_shape
from solvers.measures.levels import ratio_db
from solvers.piezo.forced import ForcedPlate
from solvers.piezo.height import height_error
from solvers.shaping.modal_table import ModalTable, field_matrix, sensor_matrix
from solvers.shaping.mode_pairs import ModePair, travelling_pair
from solvers.shaping.travelling_wave import best_travelling_drive, inner_window, travelling_wave_ratio
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
    case: Case, log: Log, band_hz: tuple[float, float] | None = None, others: float = 0.0,
    meshes: list[MeshRecord] | None = None,
) -> tuple[TravelRecord, Travelling]:  # fmt: skip
    """Hold the wanted mode and its neighbour with one nodal line more or less; the pair that runs best.

    InputError for a case without patches that listen and two that drive, or with fewer than two nodal lines; SolverError
    where the band does not hold both modes.
    """
    _check(case)
    forced = forced_plate(case, log, band_hz, [] if meshes is None else meshes)
    with log.step("two modes a quarter period apart"):
        wave = best_pair(forced, case.design, others)
        record = _record(wave, case.design, others)
    with log.step("error bars"):
        record, varied = _with_bars(record, forced, case.design, others)
    driven = _driven(wave, record)
    shear_record = shear.solve(case, forced, driven, record.wavenumber_per_m, log, varied)
    record = record.model_copy(update={"shear": shear_record}) if shear_record else record
    for line in lines(record):
        log.info(line)
    return record, wave


def _check(case: Case) -> None:
    case.require_plate(command="travel")
    case.require("patches", command="travel")
    patches = case.patches
    assert patches is not None
    said = []
    if case.design.nodal_lines < 2:
        said.append(f"zone.nodal_lines = {case.design.nodal_lines}: must be 2 or more, rigid shapes do not travel")
    if patches.circuit != "short":
        said.append(f"patches.circuit = {patches.circuit!r}: must be 'short', shaped patches are fed by voltages")
    if len(patches.drivers) < 2 or not patches.sensors:
        what = f"{len(patches.drivers)} drive and {len(patches.sensors)} listen"
        said.append(f"patches.sensors: {what}: two or more must drive and one or more listen")
    if said:
        raise InputError(f"{case.source or case.name}: {text}" for text in said)


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
            f"the band from {low:g} to {high:g} kHz does not hold the wanted mode and a neighbour with one nodal line more or "
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
    shape = wanted_shape(replace(design, nodal_lines=lines), table.points_m)
    per_point = design.material.density_kg_m3 * design.thickness_m * design.length_m * design.width_m / len(shape)
    return np.asarray(per_point * (table.field @ shape) ** 2 / (shape @ shape))


def _mode(table: ModalTable, design: Design, lines: int) -> int | None:
    share = share_of(table, design, lines)
    best = int(np.argmax(share))
    return best if share[best] >= MIN_SHARE else None


def _record(wave: Travelling, design: Design, others: float) -> TravelRecord:
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
    return TravelRecord(
        model=f"{plate.plate.name} with {len(plate.plate.patches)} patches",
        dof=sum(group.pencil.dof for group in plate.plate.groups),
        frequency_hz=tone,
        modes=[
            PatternMode(
                nodal_lines=_neighbours(design)[which],
                frequency_hz=float(wave.table.frequencies_hz[mode]),
                share=float(shares[which][mode]),
            )
            for which, mode in zip(own, pair.modes, strict=True)
        ],
        others=others,
        twr=pair.twr,
        alone_twr=pair.alone,
        best_twr=wave.twr(wave.drives["wave+"]),
        wavenumber_per_m=pair.wavenumber,
        window_m=(float(wave.table.points_m[wave.window, 0].min()), float(wave.table.points_m[wave.window, 0].max())),
        confinement_db=passive,
        drive_V_at_1um=per_um,
        drivers=list(wave.forced.drivers),
        volts=[(float(each.real), float(each.imag)) for each in volts],
        x_m=wave.line_m.tolist(),
        field_m=[(float(each.real), float(each.imag)) for each in field],
        patches_W=(flow.patches_w * per_um**2).tolist(),
        lost_W=flow.lost_w * per_um**2,
        flow_x_m=flow.x_m.tolist(),
        flow_W=(flow.flow_w * per_um**2).tolist(),
        standing_flow_W=(power_flow(stand, tone).flow_w * (UM / standing) ** 2).tolist(),
        inner_sections=max(len(flow.x_m) - 2, 0),
    )


FIGURES = {
    "twr": "twr_error",
    "alone_twr": "alone_twr_error",
    "best_twr": "best_twr_error",
    "wavenumber_per_m": "wavenumber_error_per_m",
    "confinement_db": "confinement_error_db",
    "drive_V_at_1um": "drive_error_V_at_1um",
    "lost_W": "lost_error_W",
}


LISTS = {"flow_W": "flow_error_W", "patches_W": "patches_error_W", "standing_flow_W": "standing_flow_error_W"}


def _driven(wave: Travelling, record: TravelRecord, each: Variation | Louder | None = None) -> Driven:
    return Driven(wave.all_volts(wave.drives["pair+"]) * record.drive_V_at_1um, record.frequency_hz, each)


def _with_bars(
    record: TravelRecord, forced: ForcedPlate, design: Design, others: float
) -> tuple[TravelRecord, list[tuple[Driven, ...]]]:
    """The record with the half-widths of its figures' bars, None where they are not known; how plates within the bars are
    driven, those of one source together, none where one of them has no such wave.
    """
    errors, share = frequency_errors(forced), calibration.mixing()
    if share is None or not is_known(errors):
        return record, []
    nominal, rows = _figures(record), motion_at(forced, _points(design)[0])
    tone, load = record.frequency_hz, height_error(forced, record.modes[0].frequency_hz)

    first_hz, second_hz = (mode.frequency_hz for mode in record.modes)
    varied: list[tuple[Variation | Louder, ...]] = [
        *sources(forced, errors, first_hz, share, load),
        *mixings(forced, errors, second_hz, share),
    ]
    driven: dict[int, Driven] = {}

    def again(each: Variation | Louder) -> FloatArray:
        known = [each.of_columns(basis, own) for basis, own in zip(forced.modes, rows, strict=True)]
        try:
            wave = best_pair(each.of(forced), design, others, known)
            moved = _record(wave, design, others)
            figures, driven[id(each)] = _figures(moved), _driven(wave, moved, each)
        except SolverError:
            figures = np.zeros(0)
        return figures if figures.shape == nominal.shape else np.full_like(nominal, np.nan)

    half = half_widths(nominal, varied, again)
    bars = [None if np.isnan(value) else float(value) for value in half]
    names = [name for name in FIGURES if getattr(record, name) is not None]
    update: dict[str, Any] = {FIGURES[name]: bar for name, bar in zip(names, bars, strict=False)}
    first, modes = len(names), bars[-5:-1]
    for name, error in [*LISTS.items(), ("field_m", "field_error_m")]:
        count = len(getattr(record, name))
        update[error], first = bars[first : first + count], first + count
    pairs = zip(record.modes, modes[::2], modes[1::2], strict=True)
    update["modes"] = [
        mode.model_copy(update={"frequency_error": _times(hz, 1.0 / mode.frequency_hz), "share_error": part})
        for mode, hz, part in pairs
    ]
    known = [tuple(driven[id(each)] for each in source if id(each) in driven) for source in varied]
    whole = all(len(some) == len(source) for some, source in zip(known, varied, strict=True))
    barred = record.model_copy(update=update | {"frequency_error": _times(bars[-1], 1.0 / tone)})
    return barred, known if whole else []


def _figures(record: TravelRecord) -> FloatArray:
    """Every figure that has a bar: those of FIGURES and LISTS, the field's size, both modes and the wave's frequency."""
    single = [getattr(record, name) for name in FIGURES]
    of_modes = [value for mode in record.modes for value in (mode.frequency_hz, mode.share)]
    known = [value for value in single if value is not None]
    lists = [value for name in LISTS for value in getattr(record, name)]
    sizes = np.abs(np.array(record.field_m) @ np.array([1.0, 1j])).tolist()
    return np.array(known + lists + sizes + of_modes + [record.frequency_hz])


def _neighbours(design: Design) -> tuple[int, ...]:
    return design.nodal_lines - 1, design.nodal_lines, design.nodal_lines + 1


def lines(record: TravelRecord) -> list[str]:
    """The result in words."""
    modes = " and ".join(f"(0, {mode.nodal_lines}) at {_mode_text(mode)}" for mode in record.modes)
    level = ""
    if record.confinement_db is not None:
        level = f"; {level_with_bar(record.confinement_db, record.confinement_error_db)} above the passive face"
    tone = frequency_with_bar(record.frequency_hz, record.frequency_error)
    own, alone, best = (
        with_bar(value, error)
        for value, error in (
            (record.twr, record.twr_error),
            (record.alone_twr, record.alone_twr_error),
            (record.best_twr, record.best_twr_error),
        )
    )
    half = pi / abs(record.wavenumber_per_m) / MM
    wave = with_bar(half, _times(record.wavenumber_error_per_m, half / abs(record.wavenumber_per_m)), "mm")
    drive = with_bar(record.drive_V_at_1um, record.drive_error_V_at_1um, "V")
    first, last = (end / MM for end in record.window_m)
    lost = with_bar(1e3 * record.lost_W, _times(record.lost_error_W, 1e3), "mW")
    return [
        f"modes {modes}, held a quarter period apart at {tone}",
        f"travelling-wave ratio {own} from {figure(first)} to {figure(last)} mm, "
        f"{alone} by the two shapes alone, {best} with any voltages; half a wave is {wave}{level}",
        f"{drive} for 1 um rms in the zone; then {lost} are lost in the plate, {_flow_text(record)}",
        *([_of_shear(record.shear)] if record.shear else []),
    ]


def _mode_text(mode: PatternMode) -> str:
    return frequency_with_bar(mode.frequency_hz, mode.frequency_error)


def _flow_text(record: TravelRecord) -> str:
    """The largest flow along the zone, or why none is known."""
    if not record.inner_sections:
        return "how much flows along it is unknown: patches straddle every section between the plate's ends"
    place = max(range(len(record.flow_W)), key=lambda i: abs(record.flow_W[i]))
    error = record.flow_error_W[place] if record.flow_error_W else None
    flow = with_bar(1e3 * record.flow_W[place], _times(error, 1e3), "mW")
    return f"{flow} flow through x = {figure(record.flow_x_m[place] / MM)} mm"


def _times(error: float | None, factor: float) -> float | None:
    return None if error is None else error * factor


def _of_shear(record: ShearRecord) -> str:
    """The finger on the wave in words."""
    ends = [
        (max((abs(each) for row in field for each in row if each is not None), default=None), error)
        for field, error in ((record.shear_low, record.shear_low_error), (record.shear_high, record.shear_high_error))
        if field
    ]
    limits = [with_bar(each, error) for each, error in ends if each is not None]
    drag = f"; it drags by {' to '.join(limits)} of the friction at rest at most" if limits else "; its drag is unknown"
    crests = with_bar(1e3 * record.fastest_m_s, _times(record.fastest_error_m_s, 1e3), "mm/s")
    return f"a finger ({record.fingertip}) at rest meets crests of {crests} along x{drag}"
