"""Several equal zones anywhere on a larger plate: what they exclude, and whether their rows fit each other."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import combinations
from typing import Any

import numpy as np

from geometry.elements import FloatArray
from geometry.layout import PLACES, ROUNDING, Design
from pipeline.case.schema import Tables
from pipeline.quantity import MM

KEY = "zone.centres_mm"
SAME_M = 1e-9
Diagnostic = tuple[str, Any, str]


def check_several(file: Tables) -> Iterator[Diagnostic]:
    """Check that a file with the centres of several zones has only what they can share."""
    alone = "applies to a single zone only: rows of several zones are alike"
    for name in ("heights_mm", "sides_mm", "pitches_y_mm"):
        if values := getattr(file.array, name):
            yield f"array.{name}", values, alone
    if file.array.stagger:
        yield "array.stagger", True, "applies to a single zone only: rows of several zones are aligned"
    if file.plate.file:
        yield "plate.file", file.plate.file, "must be left out: several zones need a rectangular plate"
    if file.patches.behind_mm:
        yield "patches.behind_mm", file.patches.behind_mm, "applies to a single zone only: give patches.centres_mm"


def check_placed(design: Design) -> Iterator[Diagnostic]:
    """Find the first fault of zones whose areas or rows overlap, or whose pillars share no grid of lines along x and y."""
    views = design.views
    named = list(enumerate(views, start=1))
    text = next(filter(None, (_apart(first, other) for first, other in combinations(named, 2))), "")
    if text:
        yield KEY, [[round(place / MM, 9) for place in view.centre_m] for view in views], text


Named = tuple[int, Design]


def _apart(first: Named, other: Named) -> str:
    """Say what two zones have in each other's way; nothing where they have not."""
    (number, one), (second, two) = first, other
    size = np.array([one.length_m, one.width_m])
    away = np.abs(np.subtract(one.centre_m, two.centre_m))
    if (away < size * (1.0 - ROUNDING)).all():
        least = f"{size[0] / MM:g} mm apart along x or {size[1] / MM:g} mm along y"
        return f"zones {number} and {second} overlap: must be at least {least}"
    feet = [view.lone.pillar_centres() for view in (one, two)]
    for (free, view), (name, standing), own in ((first, other, feet[1]), (other, first, feet[0])):
        reach = np.abs(own - view.centre_m) - (size + standing.footprint_m) / 2.0
        if (reach < -SAME_M).all(axis=1).any():
            return f"pillars of zone {name} would stand on zone {free}: must leave it free"
    for axis, lines, pitch in ((0, "columns", one.pitch_x_m), (1, "rows", one.pitch_y_m)):
        own, theirs = (np.unique(each[:, axis].round(PLACES)) for each in feet)
        if np.isfinite(near := _nearest(own, theirs, pitch)):
            x, shifts = "xy"[axis], _shifts(own, theirs, pitch)
            places = " or ".join(f"{x} = {(two.centre_m[axis] + shift) / MM:g}" for shift in shifts)
            return (
                f"{lines} of zones {number} and {second} are {near / MM:g} mm apart along {x}: must be in line or at least "
                f"{pitch / MM:g} mm, the pitch, apart, as with zone {second} at {places}"
            )
    return ""


def _nearest(own: FloatArray, theirs: FloatArray, pitch: float) -> float:
    """Least distance of two lines that are neither in line nor a pitch apart; infinite without any."""
    apart = np.abs(np.subtract.outer(own, theirs))
    near = apart[(apart > SAME_M) & (apart < pitch * (1.0 - ROUNDING))]
    return float(near.min(initial=np.inf))


def _shifts(own: FloatArray, theirs: FloatArray, pitch: float) -> list[float]:
    """Smallest shifts of the second lines down and up that leave them in line or a pitch apart."""
    every = np.unique(np.add.outer(np.subtract.outer(own, theirs).ravel(), [-pitch, 0.0, pitch]).round(PLACES))
    down, up = every[every < 0.0][::-1], every[every > 0.0]
    found = (next((s for s in side if not np.isfinite(_nearest(own, theirs + s, pitch))), None) for side in (down, up))
    return [float(shift) for shift in found if shift is not None]
