"""Masses, springs and resonators on a unit cell: the tables [[cell.attached]] read, checked against the cell, and in SI."""

from __future__ import annotations

from typing import Any

from geometry.layout import Design
from geometry.supports import Support
from pipeline.case.limits import MAX_SUPPORTS
from pipeline.case.reading import Diagnostics, check_table, is_table
from pipeline.case.schema import ATTACHED_ALLOWED, AttachedTable, known_keys
from pipeline.quantity import GRAM, MM

DISC = 0.5  # of the plate's thickness: radius of the disc on which they act


def read_attached(tables: Any, design: Design, diagnostics: Diagnostics) -> tuple[Support, ...]:
    """Read what is attached to a cell, in SI.

    Parameters
    ----------
    tables : object
        Tables as in the file.
    design : Design
        The plate, whose cell carries them.
    diagnostics : Diagnostics
        Receives the faults.

    Returns
    -------
    tuple of Support
        Those that change anything: a mass on a spring without stiffness does not.
    """
    known, found = known_keys(), []
    if not isinstance(tables, list) or not 0 < len(tables) <= MAX_SUPPORTS or not all(map(is_table, tables)):
        diagnostics.add("cell.attached", tables, f"must be one to {MAX_SUPPORTS} {ATTACHED_ALLOWED}")
        return ()
    if design.stagger or design.oblique_m:
        diagnostics.missing("cell.attached", "needs a square or rectangular lattice")
    for number, content in enumerate(tables):
        key = f"cell.attached.{number}"
        table, bad = check_table(AttachedTable, content, f"{key}.", known, diagnostics)
        if bad:
            continue
        if table.mass_g is None and table.stiffness_N_per_m is None:
            diagnostics.missing(key, "must have mass_g, stiffness_N_per_m or both")
        if table.damping_Ns_per_m:
            what = "must be left out: waves of bands and attenuation are those of undamped springs"
            diagnostics.add(f"{key}.damping_Ns_per_m", table.damping_Ns_per_m, what)
        _check_place(design, table.at_mm, f"{key}.at_mm", diagnostics)
        at, radius = (MM * table.at_mm[0], MM * table.at_mm[1]), DISC * design.thickness_m
        mass, stiffness = GRAM * (table.mass_g or 0.0), table.stiffness_N_per_m
        if stiffness is None or stiffness > 0.0:
            kind = "mass" if stiffness is None else "spring"
            own = Support(kind, at_m=at, radius_m=radius, mass_kg=mass, stiffness_n_m=stiffness or 0.0)
            found += [own] if mass or stiffness else []
    return tuple(found)


def _check_place(design: Design, at_mm: list[float], key: str, diagnostics: Diagnostics) -> None:
    """Report a disc that does not lie within the cell, on the plate's bare back face."""
    radius = DISC * design.thickness_m
    halves, place = (design.pitch_x_m / 2.0, design.pitch_y_m / 2.0), [MM * each for each in at_mm]
    if any(abs(each) + radius > half * (1.0 + 1e-9) for each, half in zip(place, halves, strict=True)):
        reach = " and ".join(f"{(half - radius) / MM:g}" for half in halves)
        what = f"must be at most {reach} mm from the cell's centre: the disc, half the plate thick, lies in the cell"
        diagnostics.add(key, at_mm, what)
    elif design.pillar:
        foot = [each / 2.0 for each in design.pillar.reach_m]
        if all(abs(each) - radius < half for each, half in zip(place, foot, strict=True)):
            feet = " x ".join(f"{2.0 * half / MM:g}" for half in foot)
            what = f"must lie on bare plate: the pillar takes {feet} mm of it, and the disc has a radius of {radius / MM:g} mm"
            diagnostics.add(key, at_mm, what)
