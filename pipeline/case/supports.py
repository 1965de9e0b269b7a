"""Supports of the plate: the tables [[support]] read, checked against the plate, and in SI."""

from __future__ import annotations

from collections.abc import Container, Iterator
from itertools import pairwise
from math import hypot, pi
from typing import Any

import numpy as np

from geometry.layout import Design, Patches
from geometry.supports import Support
from geometry.tiling import tile
from pipeline.case.limits import MAX_SUPPORTS
from pipeline.case.reading import Diagnostics, check_table, is_table
from pipeline.case.schema import SUPPORTS_ALLOWED, SupportTable, known_keys
from pipeline.quantity import GRAM, MM, figure

ALLOWED = {  # keys of each kind besides edge, or at_mm and radius_mm; the first is needed, of a spring one of both
    "clamp": (),
    "simple": (),
    "foam": ("stiffness_N_per_m2", "damping_Ns_per_m"),
    "spring": ("stiffness_N_per_m", "damping_Ns_per_m"),
    "mass": ("mass_g",),
}
ACTS = ("stiffness_N_per_m", "stiffness_N_per_m2", "damping_Ns_per_m", "mass_g")
NEAR = 1e-9  # relative: rounding of places
FLUSH = 1e-3  # of the plate's thickness: a narrower strip before an edge cannot be meshed
# stiffness of a spring on a disc in E r: a punch of 2 E r dents the plate by half a per cent of what this one yields, and the
# panels' functions show little of the dent
SOFT = 0.01
GAP = 0.1  # of the radius of a held disc: room that elements about its rim take


def faults_of(table: SupportTable, named: str) -> Iterator[tuple[str, Any, str]]:
    """Yield key, value and requirement of each fault of one support."""
    kind, allowed = table.kind, ALLOWED[table.kind]
    if (table.edge is None) == (table.at_mm is None):
        yield named, kind, "must have either edge, or at_mm with radius_mm"
    elif (table.radius_mm is None) != (table.at_mm is None):
        yield f"{named}.radius_mm", table.radius_mm, "must be given with at_mm, and only with it"
    for key in ACTS:
        value = getattr(table, key)
        if value is not None and key not in allowed:
            takes = f"takes {' and '.join(allowed)}" if allowed else "takes neither stiffness, damping nor mass"
            yield f"{named}.{key}", value, f"must be left out: a {kind} {takes}"
    if allowed and all(getattr(table, key) is None for key in (allowed if kind == "spring" else allowed[:1])):
        yield named, kind, f"must have {' or '.join(allowed if kind == 'spring' else allowed[:1])}"


def read_supports(tables: Any, diagnostics: Diagnostics) -> tuple[Support, ...]:
    """Read the supports, in SI; () for faulty ones, whose faults are added to the diagnostics."""
    known, before = known_keys(), len(diagnostics.lines)
    if not isinstance(tables, list) or not len(tables) <= MAX_SUPPORTS or not all(map(is_table, tables)):
        diagnostics.add("support", tables, f"must be at most {MAX_SUPPORTS} {SUPPORTS_ALLOWED}")
        return ()
    read = []
    for number, content in enumerate(tables):
        table, bad = check_table(SupportTable, content, f"support.{number}.", known, diagnostics)
        if not bad:
            for fault in faults_of(table, f"support.{number}"):
                diagnostics.add(*fault)
        read.append(table)
    edges = [(table.edge, number) for number, table in enumerate(read) if table.edge]
    for (edge, first), (other, second) in pairwise(sorted(edges)):
        if edge == other:
            diagnostics.add(f"support.{second}.edge", edge, f"has support.{first} already: an edge takes one support")
    return tuple(map(_in_si, read)) if len(diagnostics.lines) == before else ()


def _in_si(table: SupportTable) -> Support:
    """Return a support in SI."""
    at = table.at_mm or (0.0, 0.0)
    return Support(
        table.kind,
        table.edge or "",
        (MM * at[0], MM * at[1]),
        MM * (table.radius_mm or 0.0),
        table.stiffness_N_per_m or 0.0,
        table.stiffness_N_per_m2 or 0.0,
        table.damping_Ns_per_m or 0.0,
        GRAM * (table.mass_g or 0.0),
    )


def check_places(design: Design, diagnostics: Diagnostics) -> None:
    """Report discs off the plate or beside pillars, foam on them, and held ones that are too near to another."""
    flush, away = _flush_edges(design), set[int]()
    for number, support in enumerate(design.supports):
        if support.edge:
            if support.edge[0] in flush:
                what = "pillars stand flush with this edge, which leaves its face no room for a support"
                diagnostics.add(f"support.{number}.edge", support.edge, what)
            continue
        at, radius = [place / MM for place in support.at_m], support.radius_m
        key = f"support.{number}.at_mm"
        held = bool(support.held_axes)
        gap, words = (GAP * radius, f" with {GAP * radius / MM:g} mm around it") if held else (0.0, "")
        ends = design.plate_m[0] / 2.0 - gap, design.plate_m[1] / 2.0 - gap
        most = min(design.plate_m) / 2.0 / (1.0 + GAP * held)
        if radius > most * (1.0 + NEAR):
            away.add(number)
            diagnostics.add(f"support.{number}.radius_mm", radius / MM, f"must be at most {most / MM:g} on this plate")
        elif any(abs(place) + radius > end * (1.0 + 1e-12) for place, end in zip(support.at_m, ends, strict=True)):
            reach = " and ".join(
                f"{axis} from {-end / MM:g} to {end / MM:g}" for axis, end in zip("xy", ends, strict=True)
            )
            away.add(number)
            diagnostics.add(key, at, f"the disc must lie on the plate, {reach} mm")
        elif support.kind == "foam":
            what = "must be clamp, simple, spring or mass on a disc: foam is for edges"
            diagnostics.add(f"support.{number}.kind", support.kind, what)
        elif support.stiffness_n_m > (most := SOFT * design.stack.back.average.young_pa * radius):
            what = f'must be at most {most:g} on this disc, whose dent is left out (kind = "simple" holds it)'
            diagnostics.add(f"support.{number}.stiffness_N_per_m", support.stiffness_n_m, what)
        elif _meets_pillars(design, support, gap):
            what = f"the disc{words} must lie on bare plate: it meets the panel of a pillar, at most a pitch wide"
            diagnostics.add(key, at, what)
        else:
            _check_apart(design, number, away, diagnostics)


def dents(design: Design, frequency_hz: float) -> Iterator[str]:
    """Say which dampers on discs move their disc about as much by its dent as by the plate's motion.

    Parameters
    ----------
    design : Design
        The plate with its supports.
    frequency_hz : float
        Frequency f in Hz, at which a damper c is as stiff as a spring of 2 pi f c.

    Yields
    ------
    str
        One line for each damper that is stiffer than a spring may be.
    """
    soft = SOFT * design.stack.back.average.young_pa / (2.0 * pi * frequency_hz)
    for number, support in enumerate(design.supports):
        if not support.edge and support.damping_n_s_m > (most := soft * support.radius_m):
            yield (
                f"support.{number}.damping_Ns_per_m = {support.damping_n_s_m:g}: the dent of its disc is left out, and motions "
                f"near it are too small: at most {figure(most)} N s/m hardly dent it"
            )


def _check_apart(design: Design, number: int, away: Container[int], diagnostics: Diagnostics) -> None:
    """Report a disc less than a thickness from one before it that lies on the plate, if either is held."""
    support, room = design.supports[number], design.thickness_m
    for first, other in enumerate(design.supports[:number]):
        apart = hypot(*(a - b for a, b in zip(support.at_m, other.at_m, strict=True)))
        is_near = apart < (support.radius_m + other.radius_m + room) * (1.0 - NEAR)
        if is_near and first not in away and not other.edge and (support.held_axes or other.held_axes):
            what = (
                f"must leave {room / MM:g} mm, the plate's thickness, between the rims of support.{first} and its own"
            )
            diagnostics.add(f"support.{number}.at_mm", [place / MM for place in support.at_m], what)


def check_beside_patches(design: Design, patches: Patches | None, diagnostics: Diagnostics) -> None:
    """Report held discs beneath a patch on the back face, or less than a thickness from it."""
    for number, support in enumerate(design.supports):
        if patches is None or patches.face != "back" or support.edge or not support.held_axes:
            continue
        boxes, at = patches.boxes_m().reshape(-1, 2, 2), np.array(support.at_m)
        away = np.hypot(*np.maximum(np.maximum(boxes[..., 0] - at, at - boxes[..., 1]), 0.0).T)
        near = np.flatnonzero(away < (support.radius_m + design.thickness_m) * (1.0 - NEAR))
        if len(near):
            what = f"must lie {design.thickness_m / MM:g} mm, the plate's thickness, off the patches: patch {near[0]} is nearer"
            diagnostics.add(f"support.{number}.at_mm", [place / MM for place in support.at_m], what)


def _flush_edges(design: Design) -> str:
    """Axes normal to edges with which pillars stand flush."""
    if not design.rows:
        return ""
    columns = max(design.column_centres(number)[-1] for number in {*design.row_numbers})
    foot = design.footprint_m / 2.0
    room = {"x": design.length_m / 2.0 - columns - foot, "y": design.extension_m}
    if design.larger_m:  # rows keep off the edges of a larger plate by half a pitch or more, or stand flush with them
        (half_x, half_y), reach = (size / 2.0 for size in design.plate_m), design.reach_m
        room = {"x": half_x - max(-reach[0], reach[1]), "y": half_y - max(-reach[2], reach[3])}
    return "".join(axis for axis, left in room.items() if left < FLUSH * design.thickness_m)


def _meets_pillars(design: Design, support: Support, gap_m: float) -> bool:
    """Whether a disc, or the square about a held one, meets a panel with a pillar, whose back face is not free."""
    span = hypot if not gap_m else max
    tiling = tile(design, design.plate_m[0])
    for i, j in tiling.feet:
        panel = tiling.panel(i, j)
        away = [
            max(low - at, at - high, 0.0) for low, at, high in zip(panel.low, support.at_m, panel.high, strict=True)
        ]
        if span(*away) < support.radius_m + gap_m:
            return True
    return False
