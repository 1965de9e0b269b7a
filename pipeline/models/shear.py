"""What a travelling wave drags a resting finger by, at every place of the touch face."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import pi
from typing import NamedTuple

import numpy as np

from geometry.elements import ComplexArray, FloatArray, IntArray
from pipeline.case.model import Case, Touch
from pipeline.logs import Log
from pipeline.models.touch_states import contacts_at, missing_at_ends
from pipeline.models.travel_parts import ShearRecord
from pipeline.quantity import GIB, MM, figure
from solvers.driven.curve_bars import Contacts
from solvers.driven.error_bars import Louder, Variation, half_widths
from solvers.machine import room_bytes
from solvers.piezo.forced import ForcedPlate
from solvers.piezo.responses import face_motion
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

Field = list[list[float | None]]


class Driven(NamedTuple):
    """How the patches hold a wave: volts (patches,) in V and the frequency, of the plate or of one within its bars."""

    volts: ComplexArray
    frequency_hz: float
    each: Variation | Louder | None = None


@one_thread()
def solve(
    case: Case, forced: ForcedPlate, driven: Driven, wavenumber_per_m: float, log: Log,
    varied: Sequence[tuple[Driven, ...]] = (),
) -> ShearRecord | None:  # fmt: skip
    """The case's finger at every place while the patches hold a wave. None without [touch], or without memory.

    varied: how plates within the bars are driven, those of one source together; without them there are no bars.
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
            "the finger on the wave", f"{figure(needed / GIB)} GiB are needed, {figure(room / GIB)} GiB are free"
        )
        return None
    with log.step("the finger on the wave"):
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


def _with_bars(
    record: ShearRecord, case: Case, places: Places, driven: Driven, varied: Sequence[tuple[Driven, ...]]
) -> ShearRecord:
    """The record with the half-widths of the bars of its largest crest and shears, each at its own place."""
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


@dataclass(frozen=True, eq=False)
class _Spots:
    """The finger at three places: of the fastest crest and of the largest net shear at least and at most.

    rows: u_x at them per unit of the columns of the groups that are driven, (3, columns) each.
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
        """Crest speed, net shear at least and at most, (3,); NaN where one is not known."""
        touched, points = self.places.touched, self.places.points
        tone, root, free = driven.frequency_hz, np.sqrt(points.weights), touched.free
        contacts, at = self._contacts(driven.each), touched.plate.scale.eigenvalue(tone)
        stiffness = factor * touched.finger.dynamic_stiffness(tone)
        before, motion = (
            (contacts.motions(at, *how).answers @ driven.volts[touched.drivers])[:, : len(root)]
            for how in ((), (stiffness or None, missing_m_n))
        )
        other = (driven.each.of(free) if driven.each else free).driven_by(driven.volts)
        fed, pairs = other.volts(at), zip(free.modes, other.modes, self.rows, strict=True)
        along = np.sum(
            [
                (driven.each.of_columns(own, row) if driven.each else row) @ basis.amplitudes(at, other.loss, fed)
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
        """Of a plate within the bars: other eigenvalues, modes mixed, louder patches."""
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


def _motion(case: Case, forced: ForcedPlate, mapped: TouchMap) -> CrestMotion:
    """The free plate's own motion along x, and (h/2) dw/dx of what the finger changes."""
    places = np.stack(np.meshgrid(mapped.x_m, mapped.y_m, indexing="ij"), axis=-1)
    along = forced.motion_by(lambda group: face_motion(group, places.reshape(-1, 2), 0), mapped.frequency_hz)
    free = along.reshape(mapped.under.shape)
    along = free + case.design.thickness_m / 2.0 * mapped.slope_change
    return crest_motion(along, mapped.under, mapped.frequency_hz)


def _why_not(touch: Touch, wavenumber_per_m: float) -> str | None:
    """Why nothing is said of the shear; None where the relations can be asked."""
    if touch.force_n is None or touch.gap_m is None:
        return "touch.gap_um and touch.force_N are not given"
    if 2.0 * touch.radius_m * wavenumber_per_m > MAX_WAVE_SHARE * 2.0 * pi:
        half = pi / wavenumber_per_m / MM
        return f"the contact is {2.0 * touch.radius_m / MM:g} mm wide, more than half a wave of {figure(half)} mm"
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
