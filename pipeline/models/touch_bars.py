"""Error bars of what a finger does (mesh, reduction, bonding, integrals over the contact), and the frame of its touch face."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace
from math import pi, sqrt
from typing import Any

import numpy as np

from geometry.elements import ComplexArray, FloatArray, IntArray
from geometry.layout import Design
from geometry.mesh import AnyMesh
from pipeline.errors import InputError
from pipeline.models.touch_parts import LoadedModeRecord, LoopRecord, TouchMapRecord, TouchStateRecord
from pipeline.models.touch_states import Session, friction_ratio, loop_of, states_of
from pipeline.units import MM
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
from solvers.fem.surface import Frame
from solvers.piezo.patched_plate import PatchedPlate
from solvers.piezo.peak_errors import height_error
from solvers.touch import touched_plate
from solvers.touch.loaded_mode import LoadedMode, loaded_mode
from solvers.touch.touch_map import Places
from solvers.touch.touched_plate import Finger, TouchedPlate, integration_error, missing_flexibility

STATE = {
    "drive_V": "drive_error_V",
    "finger_m": "finger_error_m",
    "zone_rms_m": "zone_rms_error_m",
    "passive_rms_m": "passive_rms_error_m",
    "confinement_db": "confinement_error_db",
    "sensor_V": "sensor_error_V",
    "friction_low": "friction_low_error",
    "friction_high": "friction_high_error",
    "patches_W": "patches_error_W",
    "plate_W": "plate_error_W",
    "finger_W": "finger_error_W",
    "drawn_W": "drawn_error_W",
    "drawn_mW_at_1um": "drawn_error_mW_at_1um",
    "drive_V_at_1um": "drive_error_V_at_1um",
}
MODE = {
    "frequency_hz": "frequency_error",
    "shift_hz": "shift_error_hz",
    "quality_factor": "quality_error",
    "added_loss": "added_loss_error",
    "share": "share_error",
}
LOOP = {"sensor_V": "sensor_error_V", "needed_V": "needed_error_V"}
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
    own = frequency_error(session.touched, session.free.free.wanted_hz() or session.peak_hz, errors)
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

    tone = session.free.free.wanted_hz() or session.peak_hz
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


FLAT = 1e-3  # of the length: how far the face's nodes may lie off a plane
FITS = 0.01  # relative: how far the face may be from the zone's length
IN_PLACE = 1e-6  # of the length, and of a right angle: below it the file's own axes serve


def touch_frame(mesh: AnyMesh, design: Design, file: str, is_held: bool = False) -> Frame | None:
    """Return the frame of the face `touch`: z into the body, x along the zone's length, the origin at its middle.

    Parameters
    ----------
    mesh : Mesh or MixedMesh
    design : Design
        Its zone: length along x, width along y, in m.
    file : str
        Name of the mesh's file for messages.
    is_held : bool
        Whether groups are at rest: the face may then be what mirror planes x = 0 and y = 0 leave of it, in place.

    Returns
    -------
    Frame or None
        None where the file's own axes are that frame.

    Raises
    ------
    InputError
        For a face that is not flat, or whose smallest rectangle does not hold the zone.
    """
    points = mesh.nodes[mesh.nodes_of("touch")]
    if is_held and _is_cut_by_mirrors(points, design):
        return None
    middle = points.mean(axis=0)
    _, _, axes = np.linalg.svd(points - middle, full_matrices=False)
    off = float(np.abs((points - middle) @ axes[2]).max())
    if off > FLAT * design.length_m:
        raise _unfit(file, f"is not flat: its nodes lie up to {off / MM:g} mm off a plane")
    along_z = axes[2] * np.sign((_inside(mesh) - middle) @ axes[2])
    sides, ends = _rectangle((points - middle) @ axes[:2].T)
    spans = ends[1] - ends[0]
    along = _of_the_length(spans, sides @ axes[:2], design, file)
    origin = middle + (ends.mean(axis=0) @ sides) @ axes[:2]
    along_x = sides[along] @ axes[:2]
    along_x = along_x * (1.0 if along_x[np.argmax(np.abs(along_x))] > 0.0 else -1.0)
    return _unless_in_place(Frame(origin, np.array([along_x, np.cross(along_z, along_x), along_z])), design)


def _is_cut_by_mirrors(points: FloatArray, design: Design) -> bool:
    """Whether points (n, 3) cover a half or a quarter of the zone where the file's axes have it."""
    near, (low, high) = FITS * design.length_m, (points.min(axis=0), points.max(axis=0))
    half, wide = design.length_m / 2.0, (1.0 - FITS) * design.width_m / 2.0
    at_x = any(
        np.abs(np.array([low[0], high[0]]) - ends).max() <= near for ends in ((-half, 0.0), (0.0, half), (-half, half))
    )
    at_y = (abs(low[1]) <= near or low[1] <= -wide) and (abs(high[1]) <= near or high[1] >= wide)
    return bool(high[2] - low[2] <= FLAT * design.length_m and at_x and at_y and high[1] - low[1] >= wide)


def _inside(mesh: AnyMesh) -> FloatArray:
    """Mean of the nodes of all elements behind the face, (3,)."""
    on = np.zeros(len(mesh.nodes), dtype=bool)
    on[mesh.nodes_of("touch")] = True
    behind = [block.cells[on[block.cells].sum(axis=1) >= 3].ravel() for block in mesh.blocks]
    return np.asarray(mesh.nodes[np.concatenate(behind)].mean(axis=0))


def _rectangle(points: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Directions of the sides (2, 2), and low and high ends along them (2, 2), of the smallest rectangle about points.

    One of its sides lies on the points' convex hull (freeman1975).
    """
    from scipy.spatial import ConvexHull

    outline = points[ConvexHull(points).vertices]
    edges = np.roll(outline, -1, axis=0) - outline
    angles = np.unique(np.arctan2(edges[:, 1], edges[:, 0]) % (pi / 2.0))
    turns = np.array([[np.cos(angles), np.sin(angles)], [-np.sin(angles), np.cos(angles)]]).transpose(2, 0, 1)
    seen = np.einsum("ist,pt->ips", turns, outline)
    ends = np.stack([seen.min(axis=1), seen.max(axis=1)], axis=1)
    best = int(np.argmin((ends[:, 1] - ends[:, 0]).prod(axis=1)))
    return turns[best], ends[best]


def _of_the_length(spans: FloatArray, directions: FloatArray, design: Design, file: str) -> int:
    """Which side has the zone's length; of two the one nearer to the file's x. InputError for none."""
    fitting = np.flatnonzero(np.abs(spans / design.length_m - 1.0) <= FITS)
    whole = [side for side in fitting if spans[1 - side] >= (1.0 - FITS) * design.width_m]
    if not whole:
        size = " x ".join(f"{span / MM:g}" for span in sorted(spans, reverse=True))
        raise _unfit(file, f"is {size} mm", design)
    return int(max(whole, key=lambda side: abs(directions[side, 0])))


def _unless_in_place(frame: Frame, design: Design) -> Frame | None:
    """None for the file's own axes; a plane z = const off 0 leaves x and y as they are."""
    moved = np.abs(frame.origin_m[:2]).max() > IN_PLACE * design.length_m
    turned = np.abs(frame.axes - np.eye(3)).max() > IN_PLACE
    return frame if moved or turned else None


def _unfit(file: str, what: str, design: Design | None = None) -> InputError:
    zone = "" if design is None else f" of {design.length_m / MM:g} mm (zone.length_mm) within 1 %"
    wide = "" if design is None else f" and at least {design.width_m / MM:g} mm wide (zone.width_mm)"
    allowed = f"must be a plane face{zone}{wide}, or have another name: then nothing is measured on it"
    return InputError(f"{file}: group TOUCH {what}: {allowed}")
