"""Masses, springs and resonators on a unit cell: the tables [[cell.attached]] read, checked against the cell, and in SI."""

from __future__ import annotations

from typing import Any

from geometry.lattice import Vectors, place_in_cell, shortest_vectors
from geometry.layout import Design
from geometry.supports import Support
from pipeline.case.limits import MAX_SUPPORTS
from pipeline.case.reading import Diagnostics, check_table, is_table
from pipeline.case.schema import ATTACHED_ALLOWED, AttachedTable, known_keys
from pipeline.errors import InputError
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
        at, radius = _placed(design, table.at_mm, f"{key}.at_mm", diagnostics), DISC * design.thickness_m
        mass, stiffness = GRAM * (table.mass_g or 0.0), table.stiffness_N_per_m
        if stiffness is None or stiffness > 0.0:
            kind = "mass" if stiffness is None else "spring"
            own = Support(kind, at_m=at, radius_m=radius, mass_kg=mass, stiffness_n_m=stiffness or 0.0)
            found += [own] if mass or stiffness else []
    return tuple(found)


def image_in(vectors: Vectors, own: Support) -> tuple[float, float]:
    """Find what is attached to a cell in another cell of its lattice.

    Parameters
    ----------
    vectors : tuple of tuple
        Vectors (x, y) along the sides of the other cell in m.
    own : Support
        On a disc.

    Returns
    -------
    tuple of float
        Middle (x, y) of the disc in m.

    Raises
    ------
    InputError
        For a disc that crosses a side.
    """
    image = place_in_cell(vectors, own.at_m, own.radius_m)
    if image is None:
        at = ", ".join(f"{each / MM:g}" for each in own.at_m)
        raise InputError(f"[[cell.attached]]: at_mm = [{at}]: {_crosses(vectors, own.radius_m)}")
    return image


def _crosses(vectors: Vectors, radius: float) -> str:
    """Say what a disc must not do."""
    sides = " and ".join("[{:g}, {:g}]".format(*(each / MM for each in vector)) for vector in vectors)
    return f"must not cross a side of the cell along {sides} mm: the disc, half the plate thick, has radius {radius / MM:g} mm"


def _placed(design: Design, at_mm: list[float], key: str, diagnostics: Diagnostics) -> tuple[float, float]:
    """Place of a disc in the cell, in m; report one that does not lie within it, on the plate's bare back face."""
    radius, place = DISC * design.thickness_m, (MM * at_mm[0], MM * at_mm[1])
    if design.stagger or design.oblique_m:
        vectors = shortest_vectors(*design.lattice.vectors_m)
        image = place_in_cell(vectors, place, radius)
        if image is None:
            diagnostics.add(key, at_mm, _crosses(vectors, radius))
            return place
        place = image
    else:
        halves = design.pitch_x_m / 2.0, design.pitch_y_m / 2.0
        if any(abs(each) + radius > half * (1.0 + 1e-9) for each, half in zip(place, halves, strict=True)):
            reach = " and ".join(f"{(half - radius) / MM:g}" for half in halves)
            what = (
                f"must be at most {reach} mm from the cell's centre: the disc, half the plate thick, lies in the cell"
            )
            diagnostics.add(key, at_mm, what)
            return place
    if design.pillar:
        foot = [each / 2.0 for each in design.pillar.reach_m]
        if all(abs(each) - radius < half for each, half in zip(place, foot, strict=True)):
            feet = " x ".join(f"{2.0 * half / MM:g}" for half in foot)
            what = f"must lie on bare plate: the pillar takes {feet} mm of it, and the disc has a radius of {radius / MM:g} mm"
            diagnostics.add(key, at_mm, what)
    return place
