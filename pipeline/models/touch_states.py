"""States of a driven plate under a finger: constant voltage, retuned, held by the loop, shaped voltages; friction and power."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from pipeline.case.attachments import Touch
from pipeline.case.model import Case
from pipeline.models.touch_parts import LoopRecord, TouchStateRecord
from pipeline.units import UM
from solvers.driven.forms import contrast_volts
from solvers.measures.confinement import ratio_db
from solvers.touch.friction import OutOfValidity, SqueezeFilm
from solvers.touch.touched_plate import Power, TouchedPlate, power


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
