"""A finger on a case's driven plate: the wanted mode under it, amplitude and friction, the loop's drive, the patches' power."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from itertools import chain
from math import sqrt

import numpy as np

from geometry.elements import ComplexArray
from geometry.fingertips import Fingertip
from pipeline.case.model import Case
from pipeline.logs import Log
from pipeline.models.patched_plate import forced_plate
from pipeline.models.touch_bars import with_bars, with_map_bars
from pipeline.models.touch_states import Session, friction_ratio, loop_of, states_of
from pipeline.planning import calibration
from pipeline.quantity import figure, frequency, frequency_with_bar, interval, level_with_bar, signed, with_bar
from pipeline.records.record import (
    LoadedModeRecord,
    LoopRecord,
    MeshRecord,
    TouchMapRecord,
    TouchRecord,
    TouchStateRecord,
)
from pipeline.units import GIB, KHZ, MM, UM
from solvers.errors import SolverError
from solvers.fem.factor.memory import room_bytes
from solvers.piezo.circuit import driven_hz
from solvers.piezo.forced import ForcedPlate
from solvers.piezo.peaks import near_hz
from solvers.threads import one_thread
from solvers.touch.loaded_mode import loaded_mode
from solvers.touch.touch_map import Places, TouchMap, lattice, needed_bytes
from solvers.touch.touched_plate import Finger, TouchedPlate


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
        loop = loop_of(session)
        states = states_of(session, mode.frequency_hz if mode else None, loop)
    if mode is None:
        session.unknown[_lost(session)] = None
    record = _record(
        session, LoadedModeRecord.of(mode) if mode else None, states, loop, _map(session, loop, log, mapped)
    )
    with log.step("error bars"):
        record = with_bars(record, session, mode, calibration.mixing())
    for line in lines(record):
        log.info(line)
    for reason in record.unknown:
        log.warning("NOT_TOLD", reason)
    return record


def _lost(session: Session) -> str:
    """Why nothing is said of the wanted mode under the finger."""
    low, high = (share * end for share, end in zip(session.touched.margin, session.touched.band_hz, strict=True))
    known = interval(low, high)
    return (
        f"the wanted mode under the finger: the finger moves it out of the range whose modes are known, {known}; "
        "widen --band"
    )


def _session(case: Case, forced: ForcedPlate, log: Log) -> Session:
    touch = case.touch
    assert touch is not None
    low, high = forced.band_hz
    tone = driven_hz(forced)
    if tone is None or not low <= tone <= high:
        where = "no mode of the plate has its shape" if tone is None else f"it lies at {frequency(tone)}"
        raise SolverError(
            f"the band from {low / KHZ:g} to {high / KHZ:g} kHz does not hold the wanted mode to touch: {where}"
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
        lack = f"{len(points.points_m)} points of its contacts need {takes}, {free} are free"
        log.left_out("the map of the touch face", lack if mapped else "not asked for")
        return None
    with log.step(f"the finger at {' x '.join(str(len(each)) for each in points.places)} places"):
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
    place = f"({figure(record.at_m[0] / MM, 0.0)}, {figure(record.at_m[1] / MM, 0.0)}) mm"
    return (
        f"fingertip {record.fingertip}: {figure(real)} {'-' if imaginary < 0.0 else '+'} {figure(abs(imaginary))}i N s/m "
        f"on a radius of {record.radius_m / MM:g} mm at {place}"
    )


def _of_mode(record: TouchRecord) -> Iterator[str]:
    if mode := record.mode:
        before = frequency_with_bar(mode.free_hz, mode.free_error)
        under = frequency_with_bar(mode.frequency_hz, mode.frequency_error)
        shift = signed(with_bar(mode.shift_hz, mode.shift_error_hz, "Hz"))
        quality = "none" if mode.quality_factor is None else with_bar(mode.quality_factor, mode.quality_error)
        share = with_bar(100.0 * mode.share, _times(mode.share_error, 100.0), "%")
        mixed = " and is mixed with its neighbours" if mode.share < 0.5 else ""
        yield (
            f"wanted mode from {before} to {under} ({shift}), quality factor from {record.quality_factor_given:g} to "
            f"{quality}, by its complex eigenvalue f^2 (1 + i/Q); it keeps {share} of its shape{mixed}"
        )


def _of_state(state: TouchStateRecord) -> str:
    level = ""
    if state.confinement_db is not None:
        level = f", {level_with_bar(state.confinement_db, state.confinement_error_db)} above the passive face"
    ends = ((state.friction_low, state.friction_low_error), (state.friction_high, state.friction_high_error))
    ratios = ["unknown" if each is None else with_bar(each, error) for each, error in ends]
    friction = f"; friction {' to '.join(ratios)} of that at rest" if set(ratios) != {"unknown"} else ""
    drawn = ""
    if state.drawn_mW_at_1um is not None and state.drive_V_at_1um is not None:
        power = with_bar(state.drawn_mW_at_1um, state.drawn_error_mW_at_1um, "mW")
        drawn = f"; {power} and {with_bar(state.drive_V_at_1um, state.drive_error_V_at_1um, 'V')} at 1 um"
    tone = frequency_with_bar(state.frequency_hz, state.frequency_error)
    drive = with_bar(state.drive_V, state.drive_error_V if state.state == "held" else None, "V")
    motion = with_bar(state.finger_m / UM, _times(state.finger_error_m, 1.0 / UM), "um")
    return f"{state.state} at {tone} and {drive}: {motion} at the finger{level}{friction}{drawn}"


def _of_loop(record: TouchRecord) -> Iterator[str]:
    if loop := record.loop:
        limit = "no limit is given" if loop.limit_V is None else f"the limit is {loop.limit_V:g} V"
        verdict = ": the amplifier saturates" if loop.saturates else ""
        needed, sensor = (
            with_bar(*each, "V")
            for each in ((loop.needed_V, loop.needed_error_V), (loop.sensor_V, loop.sensor_error_V))
        )
        yield f"closed loop: {needed} hold the sensor's amplitude of {sensor}, {limit}{verdict}"


def _times(error: float | None, factor: float) -> float | None:
    return None if error is None else error * factor
