"""A finger on a case's driven plate: the target mode under it, the states of the drive, and the same finger at every place."""

from __future__ import annotations

from dataclasses import replace
from math import sqrt
from typing import Any

import numpy as np

from geometry.elements import ComplexArray
from geometry.fingertips import Fingertip
from pipeline.case.model import Case
from pipeline.logs import Log
from pipeline.models.forced import forced_plate
from pipeline.models.touch_parts import LoadedModeRecord, LoopRecord, TouchMapRecord
from pipeline.models.touch_states import Session, friction_ratio, loop_of, states_of, with_bars, with_map_bars
from pipeline.quantity import figure, frequency, interval
from pipeline.records.record import MeshRecord
from pipeline.units import GIB, KHZ
from solvers.accuracy import calibration
from solvers.errors import SolverError
from solvers.machine import room_bytes
from solvers.piezo.forced import ForcedPlate
from solvers.piezo.responses import driven_hz, near_hz
from solvers.threads import one_thread
from solvers.touch.loaded_mode import loaded_mode
from solvers.touch.touch_map import Places, TouchMap, lattice, needed_bytes
from solvers.touch.touched_plate import Finger, TouchedPlate


@one_thread()
def solve(
    case: Case, log: Log, band_hz: tuple[float, float] | None, mapped: bool, forced: ForcedPlate | None,
    meshes: list[MeshRecord],
) -> dict[str, Any]:  # fmt: skip
    """Put the case's finger on its plate, `forced` where that is solved already; returns columns of `TouchResult` by name.

    SolverError where the band holds no target mode.
    """
    session = _session(case, forced or forced_plate(case, log, band_hz, meshes), log)
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


def _lost(session: Session) -> str:
    """Return why nothing is said of the target mode under the finger."""
    known = interval(*(share * end for share, end in zip(session.touched.margin, session.touched.band_hz, strict=True)))
    return (
        f"the target mode under the finger: the finger moves it out of the range whose modes are known, {known}; "
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
            f"the band from {low / KHZ:g} to {high / KHZ:g} kHz does not hold the target mode to touch: {where}"
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


def _about(session: Session) -> dict[str, Any]:
    """Return what the finger is, and why figures are missing."""
    touch, plate, finger = session.touch, session.touched.plate, session.touched.finger
    return {
        "model": f"{plate.name} with {len(plate.patches)} patches",
        "dof": sum(group.pencil.dof for group in plate.everything),
        "fingertip": touch.tip.name,
        "source": touch.tip.source,
        "at_m": touch.at_m,
        "radius_m": touch.radius_m,
        "impedance_N_s_m": touch.tip.impedance_n_s_m(session.peak_hz, finger.area_m2),
        "force_N": touch.force_n,
        "gap_m": touch.gap_m,
        "quality_factor_given": session.case.quality_factor,
        "unknown": list(session.unknown),
    }
