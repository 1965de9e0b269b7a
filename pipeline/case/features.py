"""What few commands can honour: what a case says of it, and the line that refuses it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pipeline.quantity import MM

ZONES, LARGER, SUPPORTS, GROUPS, DEFECTS = "[[zone]]", "[plate] length_mm", "[[support]]", "[materials]", "[[defect]]"
OUTLINE = "[plate] file"
PLACES = "zone.centres_mm"  # of several zones on a larger plate
CELL, ATTACHED = "[cell] file", "[[cell.attached]]"
OBLIQUE = "array.a2_mm"  # of a lattice without rows as pitches give them
STRESS = "solve.temperature_C"  # of a plate whose supports hold its expansion
UNKNOWN = "expansion_per_K"  # of a layer that supports hold
OF_A_PLATE = (ZONES, PLACES, LARGER, OUTLINE, SUPPORTS, STRESS, UNKNOWN)  # of no consequence to a unit cell
OF_ROWS = (*OF_A_PLATE, OBLIQUE)  # of no consequence to a zone or a pillar alone


@dataclass(frozen=True)
class Feature:
    """Something in a case that changes an answer.

    given: the words of a `Case` for it, or '' where it has none. refusal: what a command that cannot honour it says.
    """

    given: Callable[[Any], str]
    refusal: str


FEATURES = {
    LARGER: Feature(
        lambda case: (
            f"plate.length_mm = {case.design.larger_m[0] / MM:g}"
            if case.design.larger_m and not case.design.outline and not case.design.others_m
            else ""
        ),
        "must be left out with plate.width_mm: {} supports a plate as long as its zone only"
        " (modes, response, touch, drift, tolerance and search support any)",
    ),
    OUTLINE: Feature(
        lambda case: f"plate.file = {Path(case.design.outline.file).name}" if case.design.outline else "",
        "{} supports rectangular plates only (modes supports any outline)",
    ),
    ZONES: Feature(
        lambda case: f"zone.count = {case.design.zones}" if case.design.zones > 1 else "",
        "must be 1: {} supports a single zone (antinode crosstalk supports several)",
    ),
    PLACES: Feature(
        lambda case: f"{PLACES} = {len(case.design.views)} centres" if case.design.others_m else "",
        "must be centre_mm of one: {} supports a single zone (modes, response, touch and crosstalk support several)",
    ),
    SUPPORTS: Feature(
        lambda case: SUPPORTS if case.design.supports else "",
        "must be left out: {} supports free plates only (modes, response, touch, crosstalk, tolerance, drift and search "
        "support any)",
    ),
    STRESS: Feature(
        lambda case: f"{STRESS} = {case.solve.temperature_C:g}" if case.design.is_stressed else "",
        "must be 20: {} leaves out the stress of a plate whose clamps or simply supported edges hold its expansion"
        " (modes, response, touch and drift have it; expansion_per_K = 0 is for a mount that expands with the plate)",
    ),
    UNKNOWN: Feature(
        lambda case: _of_unknown_expansion(case),
        "must be given: {} needs it for the stress of a plate whose supports hold its expansion"
        " (0 is for a mount that expands with the plate)",
    ),
    GROUPS: Feature(
        lambda case: GROUPS if case.group_materials and not case.design.cell_file else "",
        "{} cannot honour it: it is for groups of a mesh file (modes, bands, attenuation, broadband with --mesh-file)",
    ),
    CELL: Feature(
        lambda case: CELL if case.design.cell_file else "",
        "{} cannot honour it: it is the unit cell of bands, attenuation and broadband, or remove it",
    ),
    ATTACHED: Feature(
        lambda case: ATTACHED if case.design.attached else "",
        "{} cannot honour it: it is for the unit cell of bands and attenuation, or remove it",
    ),
    OBLIQUE: Feature(
        lambda case: f"{OBLIQUE} of an oblique lattice" if case.design.oblique_m else "",
        "{} supports rows in line or shifted by half a pitch only: set a2_mm to [0, q] or [p/2, q] (bands takes any lattice;"
        " attenuation, broadband and studies of them any with rows along x)",
    ),
    DEFECTS: Feature(
        lambda case: DEFECTS if case.defects else "",
        "{} cannot honour it: it is for cells of a supercell (bands with --supercell), or remove it",
    ),
}


def _of_unknown_expansion(case: Any) -> str:
    """Name the layers of a stressed plate whose expansion is not known; '' where all are."""
    layers = dict.fromkeys(material for material, _ in case.design.stack.layers if material.expansion_per_k is None)
    names = ", ".join(material.name for material in layers)
    return f"{UNKNOWN} of {names}" if names and case.design.is_stressed else ""


def refusals(case: Any, command: str, honours: tuple[str, ...]) -> list[str]:
    """Return a line for everything in a case that a command cannot honour."""
    given = {name: feature.given(case) for name, feature in FEATURES.items() if name not in honours}
    return [f"{words}: {FEATURES[name].refusal.format(command)}" for name, words in given.items() if words]
