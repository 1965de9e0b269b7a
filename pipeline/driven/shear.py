"""What a travelling wave drags a resting finger by, at every place of the touch face."""

from __future__ import annotations

from math import pi

import numpy as np

from geometry.elements import ComplexArray, FloatArray
from pipeline.case.model import Case
from pipeline.case.touch import Touch
from pipeline.logs import Log
from pipeline.records.record import ShearRecord
from pipeline.units import GIB, MM
from solvers.fem.factor.memory import room_bytes
from solvers.piezo.forced import ForcedPlate
from solvers.threads import one_thread
from solvers.touch.shear import MAX_WAVE_SHARE, CrestMotion, crest_motion, drive_share, motion_along
from solvers.touch.squeeze_film import OutOfValidity, SqueezeFilm
from solvers.touch.touch_map import TouchMap, lattice, needed_bytes, touch_map
from solvers.touch.touched_plate import Finger, TouchedPlate

Field = list[list[float | None]]


@one_thread()
def solve(
    case: Case, forced: ForcedPlate, volts: ComplexArray, frequency_hz: float, wavenumber_per_m: float, log: Log
) -> ShearRecord | None:
    """The case's finger at every place while the patches hold a wave; volts in V. None without [touch], or without memory."""
    touch = case.touch
    if touch is None:
        return None
    touched = TouchedPlate(forced, Finger(touch.tip, touch.at_m, touch.radius_m)).driven_by(volts)
    points = lattice(case.design, touched)
    needed, room = needed_bytes(touched, points), room_bytes()
    if needed > room:
        log.left_out("the finger on the wave", f"{needed / GIB:.1f} GiB are needed, {room / GIB:.1f} GiB are free")
        return None
    with log.step("the finger on the wave"):
        mapped = touch_map(touched, points, frequency_hz)
        motion = _motion(case, forced.driven_by(volts), mapped)
    why = _why_not(touch, abs(wavenumber_per_m))
    low, high, missed = (None, None, None) if why else _shear(touch, mapped.touched_m, motion, frequency_hz)
    unknown = [f"net shear: {reason}" for reason in (why, missed and f"at some places {missed}") if reason]
    for reason in unknown:
        log.warning("NOT_TOLD", reason)
    return ShearRecord(
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


def _motion(case: Case, forced: ForcedPlate, mapped: TouchMap) -> CrestMotion:
    """The free plate's own motion along x, and (h/2) dw/dx of what the finger changes."""
    places = np.stack(np.meshgrid(mapped.x_m, mapped.y_m, indexing="ij"), axis=-1)
    free = motion_along(forced, places.reshape(-1, 2), mapped.frequency_hz).reshape(mapped.under.shape)
    along = free + case.design.thickness_m / 2.0 * mapped.slope_change
    return crest_motion(along, mapped.under, mapped.frequency_hz)


def _why_not(touch: Touch, wavenumber_per_m: float) -> str | None:
    """Why nothing is said of the shear; None where the relations can be asked."""
    if touch.force_n is None or touch.gap_m is None:
        return "touch.gap_um and touch.force_N are not given"
    if 2.0 * touch.radius_m * wavenumber_per_m > MAX_WAVE_SHARE * 2.0 * pi:
        half = pi / wavenumber_per_m / MM
        return f"the contact is {2.0 * touch.radius_m / MM:g} mm wide, more than half a wave of {half:.3g} mm"
    return None


def _shear(
    touch: Touch, amplitude_m: FloatArray, motion: CrestMotion, frequency_hz: float
) -> tuple[Field, Field, str | None]:
    """Net shear over the friction at rest, signed, at least and at most; and why it is left out at the first such place.

    At least: the skin's elastic part alone presses in phase with the crests; at most: all of its impedance does.
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
    """What the film of air leaves of the friction, at least and at most over the gaps. Raises OutOfValidity."""
    assert touch.gap_m is not None and touch.force_n is not None
    films = [SqueezeFilm(gap, touch.radius_m, touch.force_n) for gap in touch.gap_m]
    return sorted(film.friction_ratio(amplitude_m, frequency_hz) for film in films)
