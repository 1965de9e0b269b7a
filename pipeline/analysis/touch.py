"""A finger on a case's driven plate: the wanted mode under it, amplitude and friction, the loop's drive, the patches' power."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from itertools import chain
from math import sqrt

import numpy as np

from geometry.elements import ComplexArray
from geometry.fingertips import Fingertip
from pipeline.analysis.response import driven_hz
from pipeline.case.model import Case
from pipeline.case.touch import Touch
from pipeline.logs import Log
from pipeline.models.patched_plate import forced_plate
from pipeline.records.record import (
    LoadedModeRecord,
    LoopRecord,
    MeshRecord,
    TouchMapRecord,
    TouchRecord,
    TouchStateRecord,
)
from pipeline.units import GIB, KHZ, MM, UM
from solvers.driven.contrast import contrast_volts
from solvers.errors import SolverError
from solvers.fem.factor.memory import room_bytes
from solvers.measures.levels import ratio_db
from solvers.piezo.forced import ForcedPlate
from solvers.piezo.peaks import near_hz
from solvers.threads import one_thread
from solvers.touch.energy import Power, power
from solvers.touch.loaded_mode import loaded_mode
from solvers.touch.squeeze_film import OutOfValidity, SqueezeFilm
from solvers.touch.touch_map import TouchMap, lattice, needed_bytes, touch_map
from solvers.touch.touched_plate import Finger, TouchedPlate


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


@one_thread()
def solve(
    case: Case, log: Log, band_hz: tuple[float, float] | None = None, mapped: bool = True,
    forced: ForcedPlate | None = None, meshes: list[MeshRecord] | None = None,
) -> TouchRecord:  # fmt: skip
    """Put the case's finger on its plate. Raises InputError for a case without patches or [touch], SolverError where the band
    holds no wanted mode.
    """
    case.require_plate(command="touch")
    case.require("patches", "touch", command="touch")
    session = _session(case, forced or forced_plate(case, log, band_hz, [] if meshes is None else meshes), log)
    with log.step("the finger's states"):
        mode = loaded_mode(session.touched)
        loop = _loop(session)
        states = _states(session, mode.frequency_hz if mode else None, loop)
    if mode is None:
        session.unknown["the wanted mode under the finger: no mode about the band holds it"] = None
    record = _record(
        session, LoadedModeRecord.of(mode) if mode else None, states, loop, _map(session, loop, log, mapped)
    )
    for line in lines(record):
        log.info(line)
    for reason in record.unknown:
        log.warning("NOT_TOLD", reason)
    return record


def _session(case: Case, forced: ForcedPlate, log: Log) -> Session:
    touch = case.touch
    assert touch is not None
    low, high = forced.band_hz
    tone = driven_hz(forced)
    if tone is None or not low <= tone <= high:
        where = "no mode of the plate has its shape" if tone is None else f"it lies at {tone:.1f} Hz"
        raise SolverError(f"the band from {low:.0f} to {high:.0f} Hz does not hold the wanted mode to touch: {where}")
    with log.step("modes that the finger moves"):
        finger = Finger(touch.tip, touch.at_m, touch.radius_m)
        free = TouchedPlate(forced, Finger(Fingertip("none"), touch.at_m, touch.radius_m))
        return Session(case, touch, free, TouchedPlate(forced, finger), near_hz(forced, tone))


def _states(session: Session, loaded_hz: float | None, loop: LoopRecord | None) -> list[TouchStateRecord]:
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
        state=name,  # type: ignore[arg-type]
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
    low, high = (_ratio(session, gap, amplitude_m, frequency_hz, warn=True) for gap in gaps)
    return low, high


def _ratio(session: Session, gap_m: float, amplitude_m: float, frequency_hz: float, warn: bool = False) -> float | None:
    force = session.touch.force_n
    assert force is not None
    try:
        return SqueezeFilm(gap_m, session.touch.radius_m, force).friction_ratio(amplitude_m, frequency_hz)
    except OutOfValidity as reason:
        if warn:
            session.unknown[f"friction: {reason}"] = None
        return None


def _loop(session: Session) -> LoopRecord | None:
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


def _map(session: Session, loop: LoopRecord | None, log: Log, mapped: bool) -> TouchMapRecord | None:
    points = lattice(session.case.design, session.touched)
    needed, room = needed_bytes(session.touched, points), room_bytes()
    if not mapped or needed > room:
        lack = (
            f"{len(points.points_m)} points of its contacts need {needed / GIB:.1f} GiB, {room / GIB:.1f} GiB are free"
        )
        log.left_out("the map of the touch face", lack if mapped else "not asked for")
        return None
    with log.step(f"the finger at {(len(points.along) - 4) * (len(points.across) - 4)} places"):
        return _map_record(session, loop, touch_map(session.touched, points, session.peak_hz))


def _map_record(session: Session, loop: LoopRecord | None, mapped: TouchMap) -> TouchMapRecord:
    volts, gaps = session.drive_v, session.touch.gap_m
    friction = None
    if gaps:
        gap, tone = sqrt(gaps[0] * gaps[1]), mapped.frequency_hz
        friction = [[_ratio(session, gap, volts * float(a), tone) for a in row] for row in mapped.touched_m]
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


def _record(
    session: Session, mode: LoadedModeRecord | None, states: list[TouchStateRecord], loop: LoopRecord | None,
    places: TouchMapRecord | None,
) -> TouchRecord:  # fmt: skip
    touch, plate, finger = session.touch, session.touched.plate, session.touched.finger
    impedance = touch.tip.impedance_n_s_m(session.peak_hz, finger.area_m2)
    return TouchRecord(
        model=f"{plate.name} with {len(plate.patches)} patches",
        dof=sum(group.pencil.dof for group in plate.everything),
        fingertip=touch.tip.name,
        source=touch.tip.source,
        at_m=touch.at_m,
        radius_m=touch.radius_m,
        impedance_N_s_m=(impedance.real, impedance.imag),
        force_N=touch.force_n,
        gap_m=touch.gap_m,
        quality_factor_given=session.case.quality_factor,
        mode=mode,
        states=states,
        loop=loop,
        map=places,
        unknown=list(session.unknown),
    )


def lines(record: TouchRecord) -> list[str]:
    """The result in words."""
    return [_of_finger(record), *chain(_of_mode(record), map(_of_state, record.states), _of_loop(record))]


def _of_finger(record: TouchRecord) -> str:
    real, imaginary = record.impedance_N_s_m
    place = f"({record.at_m[0] / MM:.1f}, {record.at_m[1] / MM:.1f}) mm"
    return (
        f"fingertip {record.fingertip}: {real:.3g} {'-' if imaginary < 0.0 else '+'} {abs(imaginary):.3g}i N s/m "
        f"on a radius of {record.radius_m / MM:g} mm at {place}"
    )


def _of_mode(record: TouchRecord) -> Iterator[str]:
    if mode := record.mode:
        quality_factor = "none" if mode.quality_factor is None else f"{mode.quality_factor:.1f}"
        mixed = " and is mixed with its neighbours" if mode.share < 0.5 else ""
        yield (
            f"wanted mode from {mode.free_hz / KHZ:.3f} to {mode.frequency_hz / KHZ:.3f} kHz ({mode.shift_hz:+.0f} Hz), "
            f"quality factor from {record.quality_factor_given:.0f} to {quality_factor}; "
            f"it keeps {mode.share:.0%} of its shape{mixed}"
        )


def _of_state(state: TouchStateRecord) -> str:
    level = "" if state.confinement_db is None else f", {state.confinement_db:.1f} dB above the passive face"
    ratios = ["unknown" if each is None else f"{each:.2f}" for each in (state.friction_low, state.friction_high)]
    friction = f"; friction {' to '.join(ratios)} of that at rest" if set(ratios) != {"unknown"} else ""
    drawn = (
        ""
        if state.drawn_mW_at_1um is None
        else f"; {state.drawn_mW_at_1um:.3g} mW and {state.drive_V_at_1um:.3g} V at 1 um"
    )
    return (
        f"{state.state} at {state.frequency_hz / KHZ:.3f} kHz and {state.drive_V:.3g} V: {state.finger_m / UM:.4f} um at the "
        f"finger{level}{friction}{drawn}"
    )


def _of_loop(record: TouchRecord) -> Iterator[str]:
    if loop := record.loop:
        limit = "no limit is given" if loop.limit_V is None else f"the limit is {loop.limit_V:g} V"
        verdict = ": the amplifier saturates" if loop.saturates else ""
        yield f"closed loop: {loop.needed_V:.3g} V hold the sensor's amplitude of {loop.sensor_V:.3g} V, {limit}{verdict}"
