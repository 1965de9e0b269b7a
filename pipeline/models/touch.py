"""Fingertip on the driven plate: states, loads and friction at one place, and the map of all places.

Error bars include discretisation, reduction, bonding and the integrals over the contact.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace
from math import sqrt
from typing import Any

import numpy as np

from geometry.elements import ComplexArray, FloatArray, IntArray
from geometry.fingertips import Fingertip
from pipeline.case.model import Case, Touch
from pipeline.logs import Log
from pipeline.models.answer_parts import LoadedModeRecord, LoopRecord, TouchMapRecord, TouchStateRecord
from pipeline.models.forced import forced_plate
from pipeline.quantity import GIB, KHZ, UM, figure, frequency, interval, several
from pipeline.records.part import Part
from pipeline.records.record import MeshRecord
from solvers.accuracy import calibration
from solvers.driven.curve_bars import AT_ONCE, Contacts, Doubts, Motions, doubts, peak_half_widths
from solvers.driven.error_bars import (
    Louder,
    Variation,
    frequency_error,
    frequency_errors,
    half_widths,
    louder,
    variations,
)
from solvers.driven.forms import contrast_volts
from solvers.errors import SolverError
from solvers.machine import room_bytes
from solvers.measures.confinement import ratio_db
from solvers.piezo.forced import ForcedPlate
from solvers.piezo.patched_plate import PatchedPlate
from solvers.piezo.responses import driven_hz, height_error, near_hz
from solvers.threads import one_thread
from solvers.touch import touched_plate
from solvers.touch.effects import (
    LoadedMode,
    OutOfValidity,
    Places,
    SqueezeFilm,
    TouchMap,
    lattice,
    loaded_mode,
    needed_bytes,
)
from solvers.touch.touched_plate import Finger, Power, TouchedPlate, integration_error, missing_flexibility, power

PER_LOAD = ("finger_m", "zone_rms_m", "passive_rms_m", "sensor_V")  # errors unknown if that of the loads is
LOWER = 2  # highest polynomial degrees over the contact that are omitted to estimate the effect of further ones
Figures = dict[tuple[str, str], float]


@dataclass(frozen=True)
class Session:
    """Plate of a case, free and touched, at the free plate's peak; `unknown` collects the reasons for missing figures."""

    case: Case
    touch: Touch
    free: TouchedPlate
    touched: TouchedPlate
    peak_hz: float
    unknown: dict[str, None] = field(default_factory=dict)

    @property
    def drive_v(self) -> float:
        """Drive voltage of the case, V."""
        assert self.case.patches is not None
        return self.case.patches.drive_v

    @property
    def loss_tangent(self) -> float | None:
        """Dielectric loss tangent of the patches."""
        assert self.case.patches is not None
        return self.case.patches.material.loss_tangent


def states_of(session: Session, loaded_hz: float | None, loop: LoopRecord | None) -> list[TouchStateRecord]:
    """Compute the states: free, touched, retuned to the loaded mode, held by the loop, and shaped for contrast."""
    volts, peak = session.drive_v, session.peak_hz
    states = [
        _state(session, session.free, "free", peak, volts),
        _state(session, session.touched, "touched", peak, volts),
    ]
    if loaded_hz:
        states.append(_state(session, session.touched, "retuned", loaded_hz, volts))
    if loop:
        needed = min(loop.needed_V, loop.limit_V or loop.needed_V)
        states.append(_state(session, session.touched, "held", peak, needed))
    shaped = contrast_volts(session.free, peak)
    if shaped is None:
        session.unknown["shaped drive: needs two actuators driven by a voltage, and a passive face"] = None
    else:
        states.append(_state(session, session.touched.driven_by(shaped), "shaped", peak, volts))
    return states


def friction_ratio(
    session: Session, gap_m: float, amplitude_m: float, frequency_hz: float, warn: bool = False
) -> float | None:
    """Friction over that at rest for a gap; None outside the range of the relation, with the reason kept if `warn`."""
    force = session.touch.force_n
    assert force is not None
    try:
        return SqueezeFilm(gap_m, session.touch.radius_m, force).friction_ratio(amplitude_m, frequency_hz)
    except OutOfValidity as reason:
        if warn:
            session.unknown[f"friction: {reason}"] = None
        return None


def loop_of(session: Session) -> LoopRecord | None:
    """Drive that keeps the first sensor's amplitude at the free plate's peak, where the controller's oscillator stays."""
    if not session.free.sensors:
        session.unknown["closed loop: needs a sensor patch to measure the amplitude"] = None
        return None
    free, touched = (
        float(abs(plate.curve(np.array([session.peak_hz])).sensor_v_per_v[0, 0]))
        for plate in (session.free, session.touched)
    )
    needed, limit = session.drive_v * free / touched, session.touch.limit_v
    saturates = None if limit is None else needed > limit
    return LoopRecord(sensor_V=session.drive_v * free, needed_V=needed, limit_V=limit, saturates=saturates)


def _bars_of(part: type[Part], *others: str) -> dict[str, str]:
    """Map the fields of a part that have an error bar to the fields that hold it, except `others`."""
    return {name: each.error for name, each in part.declared.items() if each.error and name not in others}


STATE = _bars_of(TouchStateRecord, "frequency_hz")


MODE = _bars_of(LoadedModeRecord, "free_hz")


LOOP = _bars_of(LoopRecord)


def with_bars(
    mode: LoadedModeRecord | None, states: list[TouchStateRecord], loop: LoopRecord | None, session: Session,
    solved: LoadedMode | None, share: float | None,
) -> dict[str, Any]:  # fmt: skip
    """Return mode, states and loop by name with the errors of their figures; None where unknown."""
    nominal = _figures(session, solved)
    errors = frequency_errors(session.touched)
    half = _half_widths(session, solved, nominal, errors, share)
    own = frequency_error(session.touched, session.free.free.target_hz() or session.peak_hz, errors)
    bars = dict(zip(nominal, half.tolist(), strict=True))

    def known(part: str, names: dict[str, str]) -> dict[str, Any]:
        return {error: bars.get((part, figure)) for figure, error in names.items()}

    if mode:
        mode = replace(mode, **known("mode", MODE), free_error=own)
        mode = replace(mode, frequency_error=mode.frequency_error and mode.frequency_error / mode.frequency_hz)
    tuned = mode.frequency_error if mode else None
    states = [
        replace(each, **known(each.state, STATE), frequency_error=tuned if each.state == "retuned" else own)
        for each in states
    ]
    return {"mode": mode, "states": states, "loop": loop and replace(loop, **known("loop", LOOP))}


def with_map_bars(record: TouchMapRecord, session: Session, places: Places, share: float | None) -> TouchMapRecord:
    """Add the errors of its figures to the map, if they are known."""
    free = session.free.free
    known = doubts(free, share, free.all_modes)
    missing = missing_at_ends(places)
    if known is None or missing is None or free.circuit != "short":
        return record
    nx, ny = places.shape
    parts = [_of_places(places, number, known, missing) for number in _some(nx * ny)]
    first, second, needed = session.drive_v * np.concatenate(parts, axis=1).reshape(3, nx, ny)
    update: dict[str, Any] = {"free_error_m": first.tolist(), "touched_error_m": second.tolist()}
    if record.needed_V is not None:
        update["needed_error_V"] = needed.tolist()
    if record.friction is not None:
        update["friction_error"] = _friction_errors(session, record, second)
    return replace(record, **update)


def contacts_at(places: Places, numbers: IntArray) -> Contacts:
    """Receptances between the patches and the contact points at some places; loads are scaled by the roots of the weights."""
    touched, plate = places.touched, places.touched.plate
    loads, scaled = places.loads(numbers)
    return Contacts.of(
        scaled[:, None] * places.receptance(loads, loads) * scaled,
        plate.scale.eigenvalue(places.frequency_hz),
        gains=places.gains(loads) * scaled,
        value=np.concatenate([basis.eigenvalue for basis in touched.free.all_modes]),
        loss=np.concatenate([basis.loss for basis in touched.free.all_modes]),
        unit=plate.stiffness_unit,
        capacitance_f=plate.capacitance_f,
        drivers=touched.drivers,
        sensors=touched.sensors,
    )


def missing_at_ends(places: Places) -> float | None:
    """Largest flexibility under a finger that the reduced panels lack, m/N; None if one is unknown.

    It is evaluated at the finger's own place and at the corner of the map, which is close to two free sides.
    """
    touched, finger = places.touched, places.touched.finger
    if finger.tip.is_nothing:
        return 0.0
    x, y = (float(each[-1]) * places.points.spacing_m for each in places.points.places)
    found = [_missing(touched, replace(finger, at_m=at)) for at in (finger.at_m, (x, y))]
    known = [float(np.linalg.norm(each, 2)) for each in found if each is not None]
    return max(known) if len(known) == len(found) else None


@one_thread()
def solve(
    case: Case, log: Log, band_hz: tuple[float, float] | None, mapped: bool, forced: ForcedPlate | None,
    meshes: list[MeshRecord],
) -> dict[str, Any]:  # fmt: skip
    """Place the case's finger on its plate, or on `forced` if it is solved already; returns columns of `TouchResult` by name.

    Raises SolverError if the band contains no target mode.
    """
    session = _session(case, forced or forced_plate(case, log, band_hz, meshes, own_moduli=True), log)
    with log.step("the finger's states"):
        mode = loaded_mode(session.touched)
        loop = loop_of(session)
        states = states_of(session, mode.frequency_hz if mode else None, loop)
    if mode is None:
        session.unknown[_lost(session)] = None
    places = _map(session, loop, log, mapped)
    with log.step("error bars"):
        part = LoadedModeRecord.of(mode) if mode else None
        bars = with_bars(part, states, loop, session, mode, calibration.mixing())
    error = bars["states"][0].frequency_error
    return {**_about(session), **bars, "map": places and replace(places, frequency_error=error)}


def _state(session: Session, plate: TouchedPlate, name: str, frequency_hz: float, volts: float) -> TouchStateRecord:
    curve, flow = plate.curve(np.array([frequency_hz])), power(plate, frequency_hz, session.loss_tangent)
    zone, passive = float(curve.zone_rms_m_per_v[0]), curve.passive_rms_m_per_v
    friction = (None, None) if plate is session.free else _friction(session, volts * flow.finger_m, frequency_hz)
    return TouchStateRecord(
        state=name,
        frequency_hz=frequency_hz,
        drive_V=volts,
        finger_m=volts * flow.finger_m,
        zone_rms_m=volts * zone,
        passive_rms_m=None if passive is None else volts * float(passive[0]),
        confinement_db=None if passive is None else float(ratio_db(zone, float(passive[0]))),
        sensor_V=volts * float(abs(curve.sensor_v_per_v[0, 0])) if plate.sensors else None,
        friction_low=friction[0],
        friction_high=friction[1],
        patches_W=volts**2 * flow.patches_w,
        plate_W=volts**2 * flow.plate_w,
        finger_W=volts**2 * flow.finger_w,
        dielectric_W=_scaled(flow.dielectric_w, volts**2),
        drawn_W=_scaled(flow.drawn_w, volts**2),
        apparent_VA=volts**2 * flow.apparent_va,
        drawn_mW_at_1um=_milliwatts_at_1_um(flow),
        drive_V_at_1um=UM / flow.finger_m if flow.finger_m > 0.0 else None,
    )


def _scaled(figure: float | None, factor: float) -> float | None:
    return None if figure is None else factor * figure


def _milliwatts_at_1_um(flow: Power) -> float | None:
    """Power drawn at an amplitude of 1 um under the finger."""
    return 1e3 * flow.drawn_w * (UM / flow.finger_m) ** 2 if flow.drawn_w is not None and flow.finger_m > 0.0 else None


def _friction(session: Session, amplitude_m: float, frequency_hz: float) -> tuple[float | None, float | None]:
    """Friction over that at rest for the smallest and the largest gap; an unknown value adds its reason."""
    gaps = session.touch.gap_m
    if not gaps:
        session.unknown["friction: touch.gap_um and touch.force_N are not given"] = None
        return None, None
    low, high = (friction_ratio(session, gap, amplitude_m, frequency_hz, warn=True) for gap in gaps)
    return low, high


def _figures(session: Session, mode: LoadedMode | None) -> Figures:
    """Every figure that has an error bar, by the part of the record and its name."""
    loop = loop_of(session)
    figures: Figures = {}
    for state in states_of(session, mode.frequency_hz if mode else None, loop):
        figures |= _values(state.state, state, STATE)
    return figures | _values("mode", mode, MODE) | _values("loop", loop, LOOP)


def _values(part: str, of: TouchStateRecord | LoadedMode | LoopRecord | None, names: dict[str, str]) -> Figures:
    known = {name: getattr(of, name) for name in names} if of else {}
    return {(part, name): float(value) for name, value in known.items() if value is not None}


def _half_widths(
    session: Session, mode: LoadedMode | None, nominal: Figures, errors: list[FloatArray], share: float | None
) -> FloatArray:
    values = np.array(list(nominal.values()))
    if share is None or not all(np.isfinite(each).all() for each in errors):
        return np.full_like(values, np.nan)

    def again(changed: Session, slopes: bool = True) -> FloatArray:
        start = None if mode is None else loaded_mode(changed.touched, mode, slopes)
        found = _figures(changed, start)
        return np.array([found.get(key, np.nan) for key in nominal])

    def varied(each: Variation | Louder) -> FloatArray:
        return again(_driven_session(session, each))

    tone = session.free.free.target_hz() or session.peak_hz
    half = half_widths(values, variations(session.touched, errors, tone, share), varied)
    load = height_error(session.free.free, session.peak_hz)
    if load is not None:
        half = np.hypot(half, half_widths(values, louder(session.free, load), varied))
    else:
        half[[name in PER_LOAD for _, name in nominal]] = np.nan
    return half + _of_contact(session, nominal, again)


def _driven_session(session: Session, each: Variation | Louder) -> Session:
    free, touched = each.of(session.free), each.of(session.touched)
    return replace(session, free=free, touched=touched, peak_hz=session.peak_hz * each.own, unknown={})


def _of_contact(session: Session, nominal: Figures, again: Callable[..., FloatArray]) -> FloatArray:
    """Errors due to polynomials above the finger's degree, the points of the disc, and modes outside the band."""
    finger, values = session.touched.finger, np.array(list(nominal.values()))
    if finger.tip.is_nothing:
        return np.zeros_like(values)
    bare = replace(session, unknown={})
    lesser = [
        again(replace(bare, free=session.free.lesser(lower), touched=session.touched.lesser(lower)))
        for lower in range(finger.degree - LOWER, finger.degree)
    ]
    reach = finger.radius_m * finger.wavenumber_per_m(session.case.design, session.touched.band_hz[1])
    settled = touched_plate.left_beyond(reach, finger.degree) <= touched_plate.ENOUGH
    beyond = (1.0 if settled else finger.degree / 2.0) * np.max(np.abs(lesser - values), axis=0)
    error = 2.0 * integration_error(session.touched, session.peak_hz)
    by_rule = np.abs(again(replace(bare, touched=session.touched.stiffer(1.0 + error))) - values)
    motion = np.array([error if name in PER_LOAD else 0.0 for _, name in nominal]) * np.abs(values)
    rest = np.abs(again(bare, False) - values)
    missing = _missing(session.touched, finger)
    softer = values * np.nan if missing is None else again(replace(bare, touched=session.touched.softer(missing)))
    return np.asarray(beyond + by_rule + motion + rest + np.abs(softer - values))


def _of_places(places: Places, numbers: IntArray, known: Doubts, missing: float) -> FloatArray:
    """Errors (3, t), per volt, of the motion under the contacts, free and touched, and of the sensor voltage ratio."""
    touched, finger, plate = places.touched, places.touched.finger, places.touched.plate
    contacts, at = contacts_at(places, numbers), plate.scale.eigenvalue(places.frequency_hz)
    points = len(places.points.weights)

    def motions(eigenvalue: float, factor: float = 1.0, softer: float = 0.0) -> list[Motions]:
        stiffness = factor * finger.dynamic_stiffness(float(plate.scale.frequency(np.asarray(eigenvalue))))
        under = contacts.motions(eigenvalue, stiffness or None, softer)
        return [contacts.motions(eigenvalue), under]

    def figures(free: ComplexArray, under: ComplexArray) -> FloatArray:
        moved = [np.linalg.norm(each[..., :points], axis=-1) for each in (free, under)]
        heard = [np.abs(each[..., points]) if touched.sensors else np.ones_like(moved[0]) for each in (free, under)]
        return np.array([*moved, heard[0] / heard[1]])

    def of(each: list[Motions]) -> FloatArray:
        fed = np.broadcast_to(volts, (len(numbers), len(volts)))
        return figures(*(one.fed(fed).answers[:, None, None, :, 0] for one in each))[..., 0, 0]

    volts = touched.signs[touched.drivers].astype(complex)
    half, nominal = peak_half_widths(known, motions, at, volts, figures), of(motions(at))
    by_rule = places.rule_error
    stiffer, softer = (np.abs(of(motions(at, *more)) - nominal) for more in ((1.0 + by_rule, 0.0), (1.0, missing)))
    return np.asarray(half + stiffer + softer + by_rule * nominal * np.array([[1.0], [1.0], [0.0]]))


def _some(count: int) -> Iterator[IntArray]:
    return (np.arange(first, min(first + AT_ONCE, count)) for first in range(0, count, AT_ONCE))


def _friction_errors(session: Session, record: TouchMapRecord, half_m: FloatArray) -> list[list[float | None]]:
    """Errors of the friction from those of the amplitude; None where the relations do not hold at the ends."""
    assert session.touch.gap_m is not None and record.friction is not None
    gap = sqrt(session.touch.gap_m[0] * session.touch.gap_m[1])

    def error(own: float | None, amplitude: float, half: float) -> float | None:
        ends = [
            friction_ratio(session, gap, max(amplitude + sign * half, 0.0), record.frequency_hz) for sign in (1.0, -1.0)
        ]
        known = [abs(each - own) for each in ends if each is not None and own is not None]
        return max(known) if len(known) == len(ends) else None

    rows = zip(record.friction, record.touched_m, half_m.tolist(), strict=True)
    return [[error(*each) for each in zip(*row, strict=True)] for row in rows]


def _missing(touched: TouchedPlate, finger: Finger) -> FloatArray | None:
    """Flexibility under a finger that the reduced panels lack; None if it is unknown."""
    plate = touched.plate
    if not isinstance(plate, PatchedPlate) or plate.beneath is None:
        return None
    return missing_flexibility(plate.whole, plate.beneath, finger)


def _lost(session: Session) -> str:
    """Explain why the target mode under the finger is unknown."""
    known = interval(*(share * end for share, end in zip(session.touched.margin, session.touched.band_hz, strict=True)))
    return f"target mode under the finger: the finger shifts it out of the range of known modes, {known}; widen --band"


def _session(case: Case, forced: ForcedPlate, log: Log) -> Session:
    touch = case.touch
    assert touch is not None
    low, high = forced.band_hz
    tone = driven_hz(forced)
    if tone is None or not low <= tone <= high:
        where = "no mode of the plate has its shape" if tone is None else f"it lies at {frequency(tone)}"
        raise SolverError(
            f"the band from {low / KHZ:g} to {high / KHZ:g} kHz does not contain the target mode: {where}"
        )
    with log.step("modes that the finger moves"):
        finger = Finger(touch.tip, touch.at_m, touch.radius_m).following(case.design, high)
        free = TouchedPlate(forced, replace(finger, tip=Fingertip("none")))
        return Session(case, touch, free, TouchedPlate(forced, finger), near_hz(forced, tone))


def _map(session: Session, loop: LoopRecord | None, log: Log, mapped: bool) -> TouchMapRecord | None:
    points = lattice(session.case.design, session.touched)
    needed, room = needed_bytes(session.touched, points), room_bytes()
    if not mapped or needed > room:
        takes, free = (f"{figure(each / GIB)} GiB" for each in (needed, room))
        lack = f"its {len(points.points_m)} contact points need {takes}, but only {free} is free"
        log.left_out("the map of the touch face", lack if mapped else "not requested")
        return None
    with log.step(f"place the finger at {' x '.join(str(len(each)) for each in points.places)} points"):
        places = Places.of(session.touched, points, session.peak_hz)
        return with_map_bars(_map_record(session, loop, places.map()), session, places, calibration.mixing())


def _map_record(session: Session, loop: LoopRecord | None, mapped: TouchMap) -> TouchMapRecord:
    volts, gaps = session.drive_v, session.touch.gap_m
    friction = None
    if gaps:
        gap, tone = sqrt(gaps[0] * gaps[1]), mapped.frequency_hz
        friction = [[friction_ratio(session, gap, volts * float(a), tone) for a in row] for row in mapped.touched_m]
    return TouchMapRecord(
        frequency_hz=mapped.frequency_hz,
        x_m=mapped.x_m.tolist(),
        y_m=mapped.y_m.tolist(),
        displacement_m=(volts * _in_phase(mapped.field)).tolist(),
        free_m=(volts * mapped.free_m).tolist(),
        touched_m=(volts * mapped.touched_m).tolist(),
        friction=friction,
        needed_V=(loop.sensor_V / np.abs(mapped.sensor_v[:, :, 0])).tolist() if loop else None,
    )


def _in_phase(field: ComplexArray) -> ComplexArray:
    """Real part in the phase of the largest value."""
    return np.asarray((field * np.exp(-1j * np.angle(field.flat[int(np.argmax(np.abs(field)))]))).real)


def _about(session: Session) -> dict[str, Any]:
    """Return the properties of the finger, and the reasons for missing figures."""
    touch, plate, finger = session.touch, session.touched.plate, session.touched.finger
    return {
        "model": f"{plate.name} with {several(len(plate.patches), 'patch')}",
        "dof": sum(group.pencil.dof for group in plate.everything),
        "fingertip": touch.tip.name,
        "source": touch.tip.source,
        "at_m": touch.at_m,
        "radius_m": touch.radius_m,
        "impedance_N_s_m": touch.tip.impedance_n_s_m(session.peak_hz, finger.area_m2),
        "force_N": touch.force_n,
        "gap_m": touch.gap_m,
        "quality_factor_given": 1.0 / session.touched.loss,
        "unknown": list(session.unknown),
    }
