"""What is attached to a plate: piezo patches ([patches]) and a fingertip ([touch]), their places and sizes."""

from __future__ import annotations

from dataclasses import dataclass
from math import inf
from typing import Any

import numpy as np
from numpy.typing import NDArray

from geometry.elements import FloatArray
from geometry.fingertips import FINGERTIPS, Fingertip
from geometry.layout import Design, Patches, antinode_places
from geometry.materials import PIEZO_MATERIALS
from pipeline.case.diagnostics import Diagnostics, nearest
from pipeline.case.reading import CaseValues
from pipeline.case.schema import Tables
from pipeline.units import GRAM, MM, UM
from solvers.analytic.beams import antinodes, free_free_mode

MAX_LISTED = 3  # patches or pairs of them that are named
TOUCHING = 1e-9  # relative to the patch: boxes that share an edge do not overlap


def read_patches(values: CaseValues, design: Design) -> Patches | None:
    """The patches in SI, or None without the table; what does not fit is added to the faults."""
    table, diagnostics = values.tables.patches, values.diagnostics
    if "patches" not in values.tables.present or diagnostics.touch("patches"):
        return None
    name, allowed = table.material, ", ".join(PIEZO_MATERIALS)
    if name not in PIEZO_MATERIALS:
        diagnostics.add("patches.material", name, f"must be one of {allowed}{nearest(name, PIEZO_MATERIALS)}")
    x, y, z = (MM * side for side in table.size_mm)
    centres, lengths = _places(table.centres_mm, design, (x, y, z))
    if behind := table.behind_mm:
        across = design.half_span_m - design.extension_m + MM * behind
        centres += tuple((place, side * across) for side in (-1.0, 1.0) for place, _ in centres)
        lengths *= 3
    sensors = tuple(table.sensors)
    if not table.centres_mm and design.zones > 1:  # the same patches in every zone
        inner = len(centres) // (3 if table.behind_mm else 1)
        centres = tuple((x, float(mid)) for mid in design.zone_centres_m for x, _ in centres[:inner]) + centres[inner:]
        lengths = lengths[:inner] * design.zones + lengths[inner:]
        sensors = tuple(inner * zone + number for zone in range(design.zones) for number in sensors)
    patches = Patches(
        material=PIEZO_MATERIALS.get(name, PIEZO_MATERIALS["pz26"]),
        size_m=(x, y, z),
        face=table.face,
        at="centres" if table.centres_mm else "antinodes",
        centres_m=centres,
        lengths_m=lengths,
        sensors=sensors,
        drive_v=float(table.drive_V),
        circuit=table.circuit,
    )
    _check_sensors(patches, diagnostics)
    if "zone" in values.tables.present:
        _check_places(patches, design, values.tables, diagnostics)
    return patches


def _places(
    centres_mm: list[list[float]] | None, design: Design, size_m: tuple[float, float, float]
) -> tuple[tuple[tuple[float, float], ...], tuple[float, ...]]:
    if centres_mm:
        return tuple((MM * x, MM * y) for x, y in centres_mm), (size_m[0],) * len(centres_mm)
    lines, length = design.nodal_lines, design.length_m
    inner = (0.0,) if lines == 0 else tuple((s - 0.5) * length for s in antinodes(free_free_mode(lines)))
    return antinode_places(inner, length, size_m, ends=lines > 0)


def _check_sensors(patches: Patches, diagnostics: Diagnostics) -> None:
    wrong = [number for number in patches.sensors if number >= patches.count]
    if wrong:
        diagnostics.add(
            "patches.sensors", list(patches.sensors), f"no such patch: must be numbers from 0 to {patches.count - 1}"
        )
    elif not patches.drivers:
        diagnostics.add("patches.sensors", list(patches.sensors), "every patch listens: at least one must drive")


def _check_places(patches: Patches, design: Design, file: Tables, diagnostics: Diagnostics) -> None:
    boxes, size = patches.boxes_m(), file.patches.size_mm
    slack = TOUCHING * max(patches.size_m)
    half_x, half_y = design.length_m / 2.0 + slack, design.half_span_m + slack
    width_mm, length_mm = 2.0 * design.half_span_m / MM, design.length_m / MM
    if patches.size_m[1] > 2.0 * half_y or patches.size_m[0] > 2.0 * half_x:
        diagnostics.add("patches.size_mm", size, f"wider than the plate, which is {length_mm:g} x {width_mm:g} mm")
        return
    given = [f"patches.{name}" for name in ("centres_mm", "behind_mm") if getattr(file.patches, name)]
    key = [*given, "patches.size_mm"][0]
    value = file.get(key)
    outside = (np.abs(boxes[:, :2]) > half_x).any(axis=1) | (np.abs(boxes[:, 2:]) > half_y).any(axis=1)
    for number in np.flatnonzero(outside)[:MAX_LISTED]:
        diagnostics.add(
            key, value, f"patch {number} reaches beyond the plate, which is {length_mm:g} x {width_mm:g} mm"
        )
    for i, j in _first_overlaps(boxes, slack):
        diagnostics.add(key, value, f"patches {i} and {j} overlap")
    if patches.face == "back" or file.pillar.faces == "both":
        _check_pillars(patches, design, key, value, diagnostics, slack)
    if min(patches.lengths_m, default=inf) <= 0.0:
        diagnostics.add(key, value, "no room for the end patches: must be shorter along x")


def _check_pillars(
    patches: Patches, design: Design, key: str, value: object, diagnostics: Diagnostics, slack: float
) -> None:
    x0, x1, y0, y1 = patches.boxes_m().T
    hit = np.zeros(len(x0), dtype=bool)
    for stand in design.standing():
        half = stand.pillar.widest_m / 2.0
        x, y = (np.sort(places) for places in stand.centres.T)
        hit |= _holds(x, x0 - half + slack, x1 + half - slack) & _holds(y, y0 - half + slack, y1 + half - slack)
    if hit.any():
        diagnostics.add(key, value, f"patch {np.flatnonzero(hit)[0]} on the {patches.face} overlaps a pillar's foot")


def _holds(ascending: FloatArray, low: FloatArray, high: FloatArray) -> NDArray[np.bool_]:
    """For each open interval, (n,), whether one of the ascending numbers lies in it."""
    first = np.searchsorted(ascending, low, side="right")
    return np.asarray(np.append(ascending, np.inf)[first] < high)


def _first_overlaps(boxes_m: FloatArray, slack: float) -> list[tuple[int, int]]:
    """The first MAX_TOLD pairs i < j of footprints x0, x1, y0, y1 that share more than an edge."""
    overlaps: list[tuple[int, int]] = []
    for i, (x0, x1, y0, y1) in enumerate(boxes_m):
        later = boxes_m[i + 1 :]
        apart = (x1 <= later[:, 0] + slack) | (later[:, 1] <= x0 + slack)
        apart |= (y1 <= later[:, 2] + slack) | (later[:, 3] <= y0 + slack)
        overlaps += [(i, i + 1 + int(j)) for j in np.flatnonzero(~apart)[:MAX_LISTED]]
        if len(overlaps) >= MAX_LISTED:
            break
    return overlaps[:MAX_LISTED]


@dataclass(frozen=True)
class Touch:
    """A finger's contact in SI; force_n and gap_m (low, high) are None where nothing is said of friction.

    limit_v: the amplifier's largest voltage, None where it is not given.
    """

    tip: Fingertip
    at_m: tuple[float, float]
    radius_m: float
    force_n: float | None
    gap_m: tuple[float, float] | None
    limit_v: float | None


def read_touch(values: CaseValues, design: Design) -> Touch | None:
    """The contact, or None without the table; what does not fit is added to the faults."""
    table, diagnostics = values.tables.touch, values.diagnostics
    if "touch" not in values.tables.present or diagnostics.touch("touch"):
        return None
    gap, force, limit = table.gap_um, table.force_N, table.limit_V
    if gap and gap[0] > gap[1]:
        diagnostics.add("touch.gap_um", gap, "must be [low, high] with low <= high")
    if (gap is None) != (force is None):
        given, other = ("gap_um", "force_N") if gap else ("force_N", "gap_um")
        diagnostics.add(f"touch.{given}", gap or force, f"needs touch.{other}: friction follows from both")
    at, radius = table.at_mm, MM * table.radius_mm
    place = (MM * at[0], MM * at[1]) if at else (_middle_antinode_m(design), 0.0)
    if "zone" in values.tables.present and (
        abs(place[0]) + radius > design.length_m / 2.0 or abs(place[1]) + radius > design.half_span_m
    ):
        size = f"{design.length_m / MM:g} x {2.0 * design.half_span_m / MM:g} mm"
        key = "at_mm" if at else "radius_mm"
        diagnostics.add(f"touch.{key}", at or table.radius_mm, f"the contact reaches beyond the plate, which is {size}")
    elif "zone" in values.tables.present and abs(place[1]) + radius > design.bare_touch_m:
        room = (
            f"the contact reaches the pillars on the touch face, which begin at |y| = {design.bare_touch_m / MM:g} mm"
        )
        diagnostics.add("touch.at_mm", at or list(place), room)
    return Touch(
        tip=_fingertip(values),
        at_m=place,
        radius_m=radius,
        force_n=None if force is None else float(force),
        gap_m=(UM * gap[0], UM * gap[1]) if gap else None,
        limit_v=None if limit is None else float(limit),
    )


def _fingertip(values: CaseValues) -> Fingertip:
    given: Any = values.tables.touch.impedance  # a table as the dictionary that it is in the file
    if isinstance(given, str):
        if given not in FINGERTIPS:
            known = f"must be one of {', '.join(FINGERTIPS)} or a table{nearest(given, FINGERTIPS)}"
            values.diagnostics.add("touch.impedance", given, known)
        return FINGERTIPS.get(given, Fingertip("unknown"))
    stiffness, damping, mass = (float(given.get(name, 0.0)) for name in ("stiffness_N_m", "damping_N_s_m", "mass_g"))
    return Fingertip("given", stiffness, damping, GRAM * mass)


def _middle_antinode_m(design: Design) -> float:
    """x of the target mode's antinode nearest the plate's centre; the centre for a rigid motion."""
    lines = design.nodal_lines
    if lines < 2:
        return 0.0
    places = [round((share - 0.5) * design.length_m, 12) + 0.0 for share in antinodes(free_free_mode(lines))]
    return min(places, key=lambda x: (round(abs(x), 9), -x))
