"""The [touch] table: a fingertip, its place on the touch face, and what is known of the contact."""

from __future__ import annotations

from dataclasses import dataclass

from geometry.fingertips import FINGERTIPS, Fingertip
from geometry.layout import Design
from pipeline.case.diagnostics import nearest
from pipeline.case.reader import CaseValues
from pipeline.units import GRAM, MM, UM
from solvers.analytic.beams import antinodes, free_free_mode


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
    good, diagnostics = values.good, values.diagnostics
    if "touch" not in good or diagnostics.touch("touch"):
        return None
    gap, force, limit = (good[f"touch.{name}"] for name in ("gap_um", "force_N", "limit_V"))
    if gap and gap[0] > gap[1]:
        diagnostics.add("touch.gap_um", gap, "must be [low, high] with low <= high")
    if (gap is None) != (force is None):
        given, other = ("gap_um", "force_N") if gap else ("force_N", "gap_um")
        diagnostics.add(f"touch.{given}", gap or force, f"needs touch.{other}: friction follows from both")
    at, radius = good["touch.at_mm"], MM * good["touch.radius_mm"]
    place = (MM * at[0], MM * at[1]) if at else (_middle_antinode_m(design), 0.0)
    if "zone" in good and (
        abs(place[0]) + radius > design.length_m / 2.0 or abs(place[1]) + radius > design.half_span_m
    ):
        size = f"{design.length_m / MM:g} x {2.0 * design.half_span_m / MM:g} mm"
        key = "at_mm" if at else "radius_mm"
        diagnostics.add(
            f"touch.{key}", at or good["touch.radius_mm"], f"the contact reaches beyond the plate, which is {size}"
        )
    elif "zone" in good and abs(place[1]) + radius > design.bare_touch_m:
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
    given = values.good["touch.impedance"]
    if isinstance(given, str):
        if given not in FINGERTIPS:
            known = f"must be one of {', '.join(FINGERTIPS)} or a table{nearest(given, FINGERTIPS)}"
            values.diagnostics.add("touch.impedance", given, known)
        return FINGERTIPS.get(given, Fingertip("unknown"))
    stiffness, damping, mass = (float(given.get(name, 0.0)) for name in ("stiffness_N_m", "damping_N_s_m", "mass_g"))
    return Fingertip("given", stiffness, damping, GRAM * mass)


def _middle_antinode_m(design: Design) -> float:
    """x of the wanted mode's antinode nearest the plate's centre; the centre for a rigid motion."""
    lines = design.nodal_lines
    if lines < 2:
        return 0.0
    places = [round((share - 0.5) * design.length_m, 12) + 0.0 for share in antinodes(free_free_mode(lines))]
    return min(places, key=lambda x: (round(abs(x), 9), -x))
