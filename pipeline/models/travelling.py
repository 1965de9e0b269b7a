"""Waves that travel inside the zone, their power, and the shear that they exert on a finger."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import log, pi
from typing import Any, NamedTuple

import numpy as np

from geometry.elements import BoolArray, ComplexArray, FloatArray, IntArray
from geometry.layout import Design
from pipeline.case.model import Case, Touch
from pipeline.logs import Log
from pipeline.models.answer_parts import PatternMode, ShearRecord
from pipeline.models.forced import forced_plate
from pipeline.models.touch import contacts_at, missing_at_ends
from pipeline.quantity import GIB, KHZ, MM, UM, figure, several
from pipeline.records.record import MeshRecord
from solvers.accuracy import calibration
from solvers.driven.curve_bars import Contacts
from solvers.driven.error_bars import Louder, Variation, frequency_errors, half_widths, is_known, mixings, sources
from solvers.driven.several_patches import Strains, motion_at, plate_table, power_flow, strains_of
from solvers.errors import SolverError
from solvers.machine import room_bytes
from solvers.measures.confinement import ratio_db, target_shape
from solvers.piezo.forced import ForcedPlate
from solvers.piezo.responses import face_motion, height_error
from solvers.shaping.modal_table import ModalTable, field_matrix, sensor_matrix
from solvers.shaping.travelling_wave import (
    ModePair,
    best_travelling_drive,
    inner_window,
    travelling_pair,
    travelling_wave_ratio,
)
from solvers.threads import one_thread
from solvers.touch.effects import (
    MAX_WAVE_SHARE,
    CrestMotion,
    OutOfValidity,
    Places,
    SqueezeFilm,
    TouchMap,
    crest_motion,
    drive_share,
    lattice,
    needed_bytes,
)
from solvers.touch.touched_plate import Finger, TouchedPlate

ALONG, ACROSS = 61, 5  # points over the zone: an odd number across has its centre line
MIN_SHARE = 0.1  # of a mode's mass that moves in the required shape
NEAR_FIELD = 0.1  # of the near field of the ends, e^{-kx}, at the limits of the window
MAX_WINDOW = 0.3  # of the length: largest margin outside the window at each end

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

Field = list[list[float | None]]


@dataclass(frozen=True)
class Travelling:
    """The pair of modes driven on the plate, and the patterns of the board's table: voltages of the drivers by name."""

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
        """Voltages of every patch in the form of `ForcedPlate.driven_by`."""
        every = np.zeros(len(self.forced.plate.patches), dtype=complex)
        every[self.forced.drivers] = volts
        return every


class Driven(NamedTuple):
    """Drive of a wave: voltages (patches,) in V and the frequency, for the plate or a variation within its error bars."""

    volts: ComplexArray
    frequency_hz: float
    each: Variation | Louder | None = None


@dataclass(frozen=True, eq=False)
class _Spots:
    """Finger at three places: those of the fastest crest and of the largest lower and upper bounds of the net shear.

    rows: u_x at them per unit of the columns of the driven groups, (3, columns) each.
    """

    case: Case
    places: Places
    numbers: IntArray
    contacts: Contacts
    rows: list[FloatArray]

    @classmethod
    def of(cls, case: Case, places: Places, numbers: IntArray) -> _Spots:
        i, j = np.divmod(numbers, places.shape[1])
        x, y = (places.points.spacing_m * each for each in places.points.places)
        at_m = np.column_stack([x[i], y[j]])
        rows = [face_motion(basis.group, at_m, 0) @ basis.columns for basis in places.touched.free.modes]
        return cls(case, places, numbers, contacts_at(places, numbers), rows)

    def figures(self, driven: Driven, factor: float = 1.0, missing_m_n: float = 0.0) -> FloatArray:
        """Crest speed, and lower and upper bounds of the net shear, (3,); NaN where unknown."""
        touched, points = self.places.touched, self.places.points
        tone, root, free = driven.frequency_hz, np.sqrt(points.weights), touched.free
        contacts, at = self._contacts(driven.each), touched.plate.scale.eigenvalue(tone)
        stiffness = factor * touched.finger.dynamic_stiffness(tone)
        before, motion = (
            (contacts.answers(at, *how) @ driven.volts[touched.drivers])[:, : len(root)]
            for how in ((), (stiffness or None, missing_m_n))
        )
        other = (driven.each.of(free) if driven.each else free).driven_by(driven.volts)
        fed, pairs = other.volts(at), zip(free.modes, other.modes, self.rows, strict=True)
        along = np.sum(
            [
                (driven.each.of_columns(own, row) if driven.each else row) @ basis.amplitudes(at, fed)
                for own, basis, row in pairs
            ],
            axis=0,
        )
        slope = ((motion - before) / root) @ points.slope_weights
        crest = crest_motion((along + self.case.design.thickness_m / 2.0 * slope)[None], (motion @ root)[None], tone)
        touch, speed = self.case.touch, float(crest.crest_m_s[0, 0])
        assert touch is not None
        if touch.force_n is None or touch.gap_m is None:
            return np.array([speed, np.nan, np.nan])
        low, high, _ = _shear(touch, np.linalg.norm(motion, axis=1)[None], crest, tone)
        return np.array([speed, low[0][1], high[0][2]], dtype=float)

    def _contacts(self, each: Variation | Louder | None) -> Contacts:
        """Contacts of a plate varied within its error bars: other eigenvalues, mixed modes, stronger patches."""
        if each is None:
            return self.contacts
        gains, value, first = self.contacts.gains.copy(), self.contacts.value.copy(), 0
        patches = len(self.contacts.capacitance_f)
        for basis in self.places.touched.free.all_modes:
            own = slice(first, first := first + len(basis.eigenvalue))
            other = each.of_basis(basis)
            value[own] = other.eigenvalue
            gains[:, own, :patches] = other.gain[:, :patches]
            gains[:, own, patches:] = each.of_columns(basis, gains[:, own, patches:].swapaxes(1, 2)).swapaxes(1, 2)
        return replace(self.contacts, gains=gains, value=value)


@one_thread()
def solve_travelling(
    case: Case, log: Log, band_hz: tuple[float, float] | None, others: float, meshes: list[MeshRecord]
) -> tuple[dict[str, Any], Travelling]:
    """Drive the target mode with its neighbour of one nodal line more or less, whichever gives the better travelling wave.

    Returns columns of `TravelResult` by name, and the wave itself. Raises SolverError if the band lacks one of the modes.
    """
    forced = forced_plate(case, log, band_hz, meshes)
    with log.step("two modes a quarter period apart"):
        wave = best_pair(forced, case.design, others)
        strains = strains_of(forced)
        values = _values(wave, case.design, strains)
    with log.step("error bars"):
        bars, varied = _bars(values, forced, case.design, others, strains)
    felt = solve_shear(case, forced, _driven(wave, values), values["wavenumber_per_m"], log, varied)
    return {**values, **bars, "shear": felt}, wave


def best_pair(forced: ForcedPlate, design: Design, others: float, rows: list[FloatArray] | None = None) -> Travelling:
    """Find the better of the mode pairs (N, N - 1) and (N, N + 1) of the plate, and further drives for the board."""
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
            f"the band from {low:g} to {high:g} kHz does not contain the target mode and a neighbour with one nodal line more "
            "or less: widen the band"
        )
    _, best, pair = max(candidates, key=lambda each: each[0])
    volts = pair.drive.voltages
    field = field_matrix(best, pair.frequency_hz)[window]
    reach = best_travelling_drive(field, points[window, 0], pi / (design.half_wavelength_m or design.width_m))[0]
    back = best_travelling_drive(field, -points[window, 0], pi / (design.half_wavelength_m or design.width_m))[0]
    drives = {"pair+": volts, "pair-": _reversed(best, pair, window, others), "wave+": reach, "wave-": back}
    unit = {name: np.asarray(each / np.abs(each).max()) for name, each in drives.items()}
    return Travelling(forced, best, pair, window, line, unit)


def share_of(table: ModalTable, design: Design, lines: int) -> FloatArray:
    """Share of each mode's mass that moves in the zone's shape with `lines` nodal lines, (modes,)."""
    shape = target_shape(replace(design, nodal_lines=lines), table.points_m)
    per_point = design.stack.mass_kg_m2 * design.length_m * design.width_m / len(shape)
    return np.asarray(per_point * (table.field @ shape) ** 2 / (shape @ shape))


@one_thread()
def solve_shear(
    case: Case, forced: ForcedPlate, driven: Driven, wavenumber_per_m: float, log: Log,
    varied: Sequence[tuple[Driven, ...]] = (),
) -> ShearRecord | None:  # fmt: skip
    """Place the case's finger at every point of a driven wave; None without [touch] or with too little memory.

    varied: drives of plates varied within their error bars, grouped by source; without them there are no error bars.
    """
    touch = case.touch
    if touch is None:
        return None
    volts, frequency_hz, _ = driven
    touched = TouchedPlate(forced, Finger(touch.tip, touch.at_m, touch.radius_m)).driven_by(volts)
    points = lattice(case.design, touched)
    needed, room = needed_bytes(touched, points), room_bytes()
    if needed > room:
        log.left_out(
            "the finger on the wave", f"it needs {figure(needed / GIB)} GiB, but only {figure(room / GIB)} GiB is free"
        )
        return None
    with log.step("place the finger on the wave"):
        places = Places.of(touched, points, frequency_hz)
        mapped = places.map()
        motion = _motion(case, forced.driven_by(volts), mapped)
    why = _why_not(touch, abs(wavenumber_per_m))
    low, high, missed = (None, None, None) if why else _shear(touch, mapped.touched_m, motion, frequency_hz)
    unknown = [f"net shear: {reason}" for reason in (why, missed and f"at some places {missed}") if reason]
    for reason in unknown:
        log.warning("NOT_TOLD", reason)
    record = ShearRecord(
        fingertip=touch.tip.name,
        radius_m=touch.radius_m,
        force_N=touch.force_n,
        x_m=mapped.x_m.tolist(),
        y_m=mapped.y_m.tolist(),
        touched_m=mapped.touched_m.tolist(),
        crest_m_s=motion.crest_m_s.tolist(),
        shear_low=low,
        shear_high=high,
        unknown=unknown,
    )
    return _with_bars(record, case, places, driven, varied) if varied else record


def _reversed(table: ModalTable, pair: ModePair, window: BoolArray, others: float) -> ComplexArray:
    """Voltages of the pair towards -x, found from its mirrored places."""
    turned = replace(table, points_m=table.points_m * np.array([-1.0, 1.0]))
    return travelling_pair(turned, pair.modes, window, others).drive.voltages


def _points(design: Design) -> tuple[FloatArray, BoolArray]:
    """Points over the zone (p, 2), m, and the mask of those on its centre line."""
    half = design.length_m / 2.0
    step = 2.0 * half / ALONG
    x = np.linspace(-half + step / 2.0, half - step / 2.0, ALONG)
    y = design.width_m * (np.arange(ACROSS) - ACROSS // 2) / (ACROSS + 1.0)
    grid = np.stack(np.meshgrid(x, y, indexing="ij"), axis=-1).reshape(-1, 2)
    return grid, grid[:, 1] == 0.0


def _window(design: Design) -> tuple[float, float]:
    """Limits along x of the evaluated wave, m: outside the near field of the ends."""
    k = pi / (design.half_wavelength_m or design.width_m)
    margin = min(-log(NEAR_FIELD) / k, MAX_WINDOW * design.length_m)
    return margin - design.length_m / 2.0, design.length_m / 2.0 - margin


def _mode(table: ModalTable, design: Design, lines: int) -> int | None:
    share = share_of(table, design, lines)
    best = int(np.argmax(share))
    return best if share[best] >= MIN_SHARE else None


def _values(wave: Travelling, design: Design, strains: Strains) -> dict[str, Any]:
    """Return the columns of a wave without their errors; power and field are for 1 um rms in the zone.

    strains: of the wave's plate, or of the one of which it is a variation within its error bars.
    """
    pair, volts, tone = wave.pair, wave.drives["pair+"], wave.pair.frequency_hz
    plate = wave.forced.driven_by(wave.all_volts(volts))
    curve, flow = plate.curve(np.array([tone])), power_flow(plate, tone, strains)
    zone = float(curve.zone_rms_m_per_v[0])
    per_um = UM / zone
    passive = None if curve.passive_rms_m_per_v is None else float(ratio_db(zone, curve.passive_rms_m_per_v[0]))
    field = wave.field(volts) * per_um
    stand = wave.forced.driven_by(wave.forced.signs.astype(np.complex128))
    standing = float(stand.curve(np.array([tone])).zone_rms_m_per_v[0])
    shares = [share_of(wave.table, design, lines) for lines in _neighbours(design)]
    own = [int(np.argmax([share[mode] for share in shares])) for mode in pair.modes]
    return {
        "model": f"{plate.plate.name} with {several(len(plate.plate.patches), 'patch')}",
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
        "standing_flow_W": (power_flow(stand, tone, strains).flow_w * (UM / standing) ** 2).tolist(),
        "inner_sections": max(len(flow.x_m) - 2, 0),
    }


def _driven(wave: Travelling, values: dict[str, Any], each: Variation | Louder | None = None) -> Driven:
    return Driven(wave.all_volts(wave.drives["pair+"]) * values["drive_V_at_1um"], values["frequency_hz"], each)


def _bars(
    values: dict[str, Any], forced: ForcedPlate, design: Design, others: float, strains: Strains
) -> tuple[dict[str, Any], list[tuple[Driven, ...]]]:
    """Return the columns of errors, and the drives of plates varied within their error bars, grouped by source.

    There are no columns if the errors are unknown, and no drives if one of the plates has no such wave.
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
            moved = _values(wave, design, replace(strains, turned=each.of_columns))
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
    """Return every figure with an error bar: FIGURES, LISTS (the field by its magnitude), both modes, the frequency."""
    known = [values[name] for name in FIGURES if values[name] is not None]
    lists = [np.abs(values[name]) if name == "field_m" else values[name] for name in LISTS]
    of_modes = [value for mode in values["modes"] for value in (mode.frequency_hz, mode.share)]
    return np.concatenate([known, *lists, of_modes, [values["frequency_hz"]]])


def _neighbours(design: Design) -> tuple[int, ...]:
    return design.nodal_lines - 1, design.nodal_lines, design.nodal_lines + 1


def _with_bars(
    record: ShearRecord, case: Case, places: Places, driven: Driven, varied: Sequence[tuple[Driven, ...]]
) -> ShearRecord:
    """Add the errors of the largest crest speed and shears, each at its own place."""
    fields = [record.crest_m_s, record.shear_low, record.shear_high]
    sizes = [None if each is None else np.nan_to_num(np.abs(np.array(each, dtype=float))) for each in fields]
    spots = [0 if size is None else int(np.argmax(size)) for size in sizes]
    finger, missing = _Spots.of(case, places, np.array(spots)), missing_at_ends(places)
    if missing is None:
        return record
    nominal, by_rule = finger.figures(driven), places.rule_error
    half = half_widths(nominal, varied, finger.figures)
    for more in ((1.0 + by_rule, 0.0), (1.0, missing)):
        half = half + np.abs(finger.figures(driven, *more) - nominal)
    fastest, low, high = (half + by_rule * np.abs(nominal)).tolist()
    return replace(record, fastest_error_m_s=fastest, shear_low_error=low, shear_high_error=high)


def _motion(case: Case, forced: ForcedPlate, mapped: TouchMap) -> CrestMotion:
    """Motion of the free plate along x, plus (h/2) dw/dx of the change due to the finger."""
    places = np.stack(np.meshgrid(mapped.x_m, mapped.y_m, indexing="ij"), axis=-1)
    along = forced.motion_by(lambda group: face_motion(group, places.reshape(-1, 2), 0), mapped.frequency_hz)
    free = along.reshape(mapped.under.shape)
    along = free + case.design.thickness_m / 2.0 * mapped.slope_change
    return crest_motion(along, mapped.under, mapped.frequency_hz)


def _why_not(touch: Touch, wavenumber_per_m: float) -> str | None:
    """Reason why the shear is unknown; None if the relations apply."""
    if touch.force_n is None or touch.gap_m is None:
        return "touch.gap_um and touch.force_N are not given"
    if 2.0 * touch.radius_m * wavenumber_per_m > MAX_WAVE_SHARE * 2.0 * pi:
        half = pi / wavenumber_per_m / MM
        return (
            f"the contact is {2.0 * touch.radius_m / MM:g} mm wide, more than the half-wavelength of {figure(half)} mm"
        )
    return None


def _shear(
    touch: Touch, amplitude_m: FloatArray, motion: CrestMotion, frequency_hz: float
) -> tuple[Field, Field, str | None]:
    """Lower and upper bounds of the net shear over the friction at rest, signed, and the reason at the first missing place.

    Lower bound: only the elastic part of the skin presses in phase with the crests; upper bound: all of its impedance does.
    """
    assert touch.force_n is not None
    impedance, omega = touch.tip.impedance_n_s_m(frequency_hz, pi * touch.radius_m**2), 2.0 * pi * frequency_hz
    layers_n_m = max(0.0, -omega * impedance.imag), omega * abs(impedance)
    fields: tuple[Field, Field] = tuple([[None] * amplitude_m.shape[1] for _ in amplitude_m] for _ in range(2))  # type: ignore[assignment]
    missed = None
    for i, j in np.ndindex(amplitude_m.shape):
        amplitude, sign = float(amplitude_m[i, j]), float(np.sign(motion.crest_m_s[i, j]))
        try:
            left = _left(touch, amplitude, frequency_hz)
        except OutOfValidity as reason:
            missed = missed or str(reason)
            continue
        for field, share, layer in zip(fields, left, layers_n_m, strict=True):
            dragged = drive_share(layer * amplitude / touch.force_n, motion.lag(i, j))
            field[i][j] = sign * share * dragged + 0.0
    return *fields, missed


def _left(touch: Touch, amplitude_m: float, frequency_hz: float) -> list[float]:
    """Smallest and largest friction on the air film over the gaps, relative to that at rest. Raises OutOfValidity."""
    assert touch.gap_m is not None and touch.force_n is not None
    films = [SqueezeFilm(gap, touch.radius_m, touch.force_n) for gap in touch.gap_m]
    return sorted(film.friction_ratio(amplitude_m, frequency_hz) for film in films)
