"""States of a driven plate under a finger: constant voltage, retuned, held by the loop, shaped voltages; friction and power.

Their error bars are by mesh, reduction, bonding and the integrals over the contact.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace
from math import sqrt
from typing import Any

import numpy as np

from geometry.elements import ComplexArray, FloatArray, IntArray
from pipeline.case.attachments import Touch
from pipeline.case.model import Case
from pipeline.models.touch_parts import LoadedModeRecord, LoopRecord, TouchMapRecord, TouchStateRecord
from pipeline.records.part import Part
from pipeline.units import UM
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
from solvers.measures.confinement import ratio_db
from solvers.piezo.patched_plate import PatchedPlate
from solvers.piezo.peak_errors import height_error
from solvers.touch import touched_plate
from solvers.touch.friction import OutOfValidity, SqueezeFilm
from solvers.touch.loaded_mode import LoadedMode, loaded_mode
from solvers.touch.touch_map import Places
from solvers.touch.touched_plate import Finger, Power, TouchedPlate, integration_error, missing_flexibility, power


@dataclass(frozen=True)
class Session:
    """The plate of a case, free and touched, at the free plate's peak; `unknown` collects why figures are left out."""

    case: Case
    touch: Touch
    free: TouchedPlate
    touched: TouchedPlate
    peak_hz: float
    unknown: dict[str, None] = field(default_factory=dict)

    @property
    def drive_v(self) -> float:
        """The case's drive."""
        assert self.case.patches is not None
        return self.case.patches.drive_v

    @property
    def loss_tangent(self) -> float | None:
        """Of the patches' dielectric."""
        assert self.case.patches is not None
        return self.case.patches.material.loss_tangent


def states_of(session: Session, loaded_hz: float | None, loop: LoopRecord | None) -> list[TouchStateRecord]:
    """Free and touched at constant voltage, retuned to the loaded mode, held by the loop, with voltages shaped for contrast."""
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
        session.unknown["shaped drive: it needs two driving patches fed by a voltage, and a passive face"] = None
    else:
        states.append(_state(session, session.touched.driven_by(shaped), "shaped", peak, volts))
    return states


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
    """mu over mu at rest at the low and at the high gap; what is unknown leaves its reason."""
    gaps = session.touch.gap_m
    if not gaps:
        session.unknown["friction: touch.gap_um and touch.force_N are not given"] = None
        return None, None
    low, high = (friction_ratio(session, gap, amplitude_m, frequency_hz, warn=True) for gap in gaps)
    return low, high


def friction_ratio(
    session: Session, gap_m: float, amplitude_m: float, frequency_hz: float, warn: bool = False
) -> float | None:
    """mu over mu at rest at a gap; None where the relation says nothing, which `warn` keeps the reason of."""
    force = session.touch.force_n
    assert force is not None
    try:
        return SqueezeFilm(gap_m, session.touch.radius_m, force).friction_ratio(amplitude_m, frequency_hz)
    except OutOfValidity as reason:
        if warn:
            session.unknown[f"friction: {reason}"] = None
        return None


def loop_of(session: Session) -> LoopRecord | None:
    """At the free plate's peak, where the controller's oscillator stays, the drive that keeps the first sensor's amplitude."""
    if not session.free.sensors:
        session.unknown["closed loop: no patch listens, so that none tells the amplitude"] = None
        return None
    free, touched = (
        float(abs(plate.curve(np.array([session.peak_hz])).sensor_v_per_v[0, 0]))
        for plate in (session.free, session.touched)
    )
    needed, limit = session.drive_v * free / touched, session.touch.limit_v
    saturates = None if limit is None else needed > limit
    return LoopRecord(sensor_V=session.drive_v * free, needed_V=needed, limit_V=limit, saturates=saturates)


# -- error bars --------------------------------------------------------------------------------------------------------


def _bars_of(part: type[Part], *others: str) -> dict[str, str]:
    """Return the fields of a part that have an error bar, with the fields that hold it, without those set apart."""
    return {name: each.error for name, each in part.declared.items() if each.error and name not in others}


STATE = _bars_of(TouchStateRecord, "frequency_hz")
MODE = _bars_of(LoadedModeRecord, "free_hz")
LOOP = _bars_of(LoopRecord)
PER_LOAD = ("finger_m", "zone_rms_m", "passive_rms_m", "sensor_V")  # unknown where the loads' own error is
LOWER = 2  # degrees of the polynomials over the contact that are left out, at most, to show what further ones bring
Figures = dict[tuple[str, str], float]


def with_bars(
    mode: LoadedModeRecord | None, states: list[TouchStateRecord], loop: LoopRecord | None, session: Session,
    solved: LoadedMode | None, share: float | None,
) -> dict[str, Any]:  # fmt: skip
    """Return mode, states and loop by name with the half-widths of their figures' bars; None where they are not known."""
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


def _figures(session: Session, mode: LoadedMode | None) -> Figures:
    """Every figure that has a bar, by the part of the record and its name."""
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
        return again(_session(session, each))

    tone = session.free.free.target_hz() or session.peak_hz
    half = half_widths(values, variations(session.touched, errors, tone, share), varied)
    load = height_error(session.free.free, session.peak_hz)
    if load is not None:
        half = np.hypot(half, half_widths(values, louder(session.free, load), varied))
    else:
        half[[name in PER_LOAD for _, name in nominal]] = np.nan
    return half + _of_contact(session, nominal, again)


def _session(session: Session, each: Variation | Louder) -> Session:
    free, touched = each.of(session.free), each.of(session.touched)
    return replace(session, free=free, touched=touched, peak_hz=session.peak_hz * each.own, unknown={})


def _of_contact(session: Session, nominal: Figures, again: Callable[..., FloatArray]) -> FloatArray:
    """What polynomials beyond the finger's degree, the disk's own points, and modes beyond the band are worth."""
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


def with_map_bars(record: TouchMapRecord, session: Session, places: Places, share: float | None) -> TouchMapRecord:
    """The map with the half-widths of its figures' bars; without them where they are not known."""
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


def _of_places(places: Places, numbers: IntArray, known: Doubts, missing: float) -> FloatArray:
    """Half-widths (3, t) of motion under the contacts, free and touched, and of the free sensor's voltage over the touched
    plate's, per volt.
    """
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


def contacts_at(places: Places, numbers: IntArray) -> Contacts:
    """The plate seen from its patches and the points of the contacts at some places, loads scaled by the roots of weights."""
    touched, plate = places.touched, places.touched.plate
    loads, scaled = places.loads(numbers)
    return Contacts.of(
        scaled[:, None] * places.receptance[loads[:, :, None], loads[:, None]] * scaled,
        plate.scale.eigenvalue(places.frequency_hz),
        gains=(places.gains[:, loads] * scaled).swapaxes(0, 1),
        value=np.concatenate([basis.eigenvalue for basis in touched.free.all_modes]),
        loss=touched.loss,
        unit=plate.stiffness_unit,
        capacitance_f=plate.capacitance_f,
        drivers=touched.drivers,
        sensors=touched.sensors,
    )


def _some(count: int) -> Iterator[IntArray]:
    return (np.arange(first, min(first + AT_ONCE, count)) for first in range(0, count, AT_ONCE))


def missing_at_ends(places: Places) -> float | None:
    """The largest flexibility under a finger that the reduced panels lack, m/N: at its own place, or at the map's corner, where
    two free sides are near; None where one is not known.
    """
    touched, finger = places.touched, places.touched.finger
    if finger.tip.is_nothing:
        return 0.0
    x, y = (float(each[-1]) * places.points.spacing_m for each in places.points.places)
    found = [_missing(touched, replace(finger, at_m=at)) for at in (finger.at_m, (x, y))]
    known = [float(np.linalg.norm(each, 2)) for each in found if each is not None]
    return max(known) if len(known) == len(found) else None


def _friction_errors(session: Session, record: TouchMapRecord, half_m: FloatArray) -> list[list[float | None]]:
    """What an amplitude at either end of its bar makes of the friction; None where the relations say nothing there."""
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
    """The flexibility under a finger that the reduced panels lack; None where it is not known."""
    plate = touched.plate
    if not isinstance(plate, PatchedPlate) or plate.beneath is None:
        return None
    return missing_flexibility(plate.whole, plate.beneath, finger)
