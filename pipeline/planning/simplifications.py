"""Simplifications: named rules that skip work and give a reason, or return None if that would change the result.

The functions that mesh and solve call these rules; a plan lists their results.
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass
from itertools import pairwise
from typing import TYPE_CHECKING

from geometry.hex.oblique import fits
from geometry.hex.panels import has_room
from geometry.lattice import labels_of
from geometry.layout import SAME_M, Design, Patches, mirrored_axes
from geometry.tiling import row_panels, tightest_panels

if TYPE_CHECKING:
    from pipeline.case.model import Case
    from pipeline.logs import Log

CLASSES = ("SS", "SA", "AS", "AA")
WHY_BOXES = {
    "zone": "the zone is a box",
    "pillar": "the pillar is made of boxes",
    "cell": "the cell is made of boxes",
    "plate": "the scene is made of boxes",
}
WHY_CURVED = "hexahedra follow the pillars and the plate around their feet"


@dataclass(frozen=True)
class Simplification:
    """Rule that applies, the work it leaves out, and the reason why the result stays the same."""

    rule: str
    what: str
    why: str

    def log(self, log: Log) -> None:
        """Write it to a log."""
        log.left_out(self.what, self.why)


def log_all(simplifications: Collection[Simplification | None], log: Log) -> None:
    """Log the simplifications that apply."""
    for simplification in simplifications:
        if simplification:
            simplification.log(log)


def is_scattered(case: Case) -> bool:
    """Whether the pillars differ from one another: the case has a [tolerance] that is not all zeros."""
    given = case.tolerance
    return given is not None and any((given.height_m, given.side_m, given.position_m, given.stiffness))


# -- the scene ---------------------------------------------------------------------------------------------------------


def no_pillars(design: Design, part: str) -> Simplification | None:
    """Leave out pillars and their cells where the part has none."""
    if part == "cell":
        return None if design.pillar else Simplification("no_pillars", "pillars", "the case has none: the cell is bare")
    if part == "plate" and not (design.rows and design.pillar):
        return Simplification("no_pillars", "pillars", "the plate has no rows")
    return None


def hexahedra(case: Case, part: str) -> Simplification | None:
    """Leave out CAD and tetrahedra where structured hexahedra follow every face and the case does not ask for
    tetrahedra.
    """
    design = case.design
    from_file = {"plate": design.outline, "cell": design.cell_file}.get(part)
    if case.solve.mesh == "tet" or from_file:
        return None
    if part in ("cell", "plate") and design.oblique_m and design.pillar:
        vectors, pillars = design.oblique_m, design.kinds if part == "plate" else (design.pillar,)
        fit = all(fits(vectors, pillar) for pillar in pillars)
        return Simplification("oblique", "CAD and tetrahedra", WHY_CURVED) if fit else None
    shaped = {"zone": False, "pillar": True, "cell": True, "plate": bool(design.rows)}[part]
    if not shaped or all(pillar.is_made_of_boxes for pillar in design.kinds):
        return Simplification("boxes", "CAD and tetrahedra", WHY_BOXES[part])
    joined = part in ("cell", "plate") and case.solve.model != "solid"
    if joined and all(pillar.takes_hexahedra for pillar in design.kinds) and _has_room(design, part):
        return Simplification("curved", "CAD and tetrahedra", WHY_CURVED)
    return None


def _has_room(design: Design, part: str) -> bool:
    """Whether hexahedra have room about every foot of the cell or the plate."""
    pillar = design.pillar
    if pillar is None:
        return True
    panels = row_panels(design)[:1] if part == "cell" else tightest_panels(design)
    return all(has_room(panel, panel.pillar or pillar) for panel in panels)


def mirror_images(design: Design, part: str, scattered: bool = False) -> Simplification | None:
    """Solve a quarter of a part that is its own mirror image along x and y; not with scattered pillars or asymmetric
    ones.
    """
    allowed = not scattered and _own_image(design, part)
    what = f"three quarters of the {part}"
    return Simplification("mirror_images", what, "it is its own mirror image along x and y") if allowed else None


def _own_image(design: Design, part: str) -> bool:
    if part == "zone":
        return {"x", "y"} <= {*design.stack.mirrors}
    if part == "plate":
        return design.is_mirrored
    return design.pillar is None or design.pillar.is_symmetric


def alike_cells(design: Design, scattered: bool = False) -> Simplification | None:
    """Reduce equal cells once; not where every pillar differs."""
    if scattered or not (design.rows and design.pillar):
        return None
    return Simplification("alike_cells", "repeated reductions", "equal cells are reduced once and cached")


def bare_functions(design: Design, further: int) -> Simplification | None:
    """Give bare panels of a larger plate only the boundary functions that their waves need.

    Not where the plate is thick for its waves (`further` degrees through the thickness) or stressed by its supports.
    """
    if not design.larger_m or design.outline or further or design.is_stressed:
        return None
    what = "boundary functions of bare panels that their waves do without"
    return Simplification("bare_functions", what, "what they would change is below the accuracy, and in the bars")


# -- the request -------------------------------------------------------------------------------------------------------


def no_supports(design: Design) -> Simplification | None:
    """Leave out the plate's supports from a part."""
    if not design.supports:
        return None
    return Simplification("no_supports", "the supports", "they are the plate's; the part has clamps of its own")


def other_classes(known: Collection[str | None], query: str | None) -> Simplification | None:
    """Leave out symmetry classes that were not requested."""
    if query is None or query not in known or len(known) < 2:
        return None
    return Simplification("other_classes", f"symmetry classes other than {query}", "not requested")


def other_frequencies(band_hz: tuple[float, float] | None, near_hz: float | None, count: int | None) -> Simplification:
    """Leave out modes outside the window."""
    if band_hz:
        what = f"modes below {khz(band_hz[0])} and above {khz(band_hz[1])}"
    else:
        what = f"modes beyond the {count} " + (f"nearest {khz(near_hz)}" if near_hz else "lowest")
    return Simplification("other_frequencies", what, "not requested; an inertia count proves the window complete")


def no_patches(patches: Patches | None, driven: bool = False) -> Simplification | None:
    """Leave out piezo patches if the case has none or no measure drives them."""
    if patches is None:
        return Simplification(
            "no_patches", "piezo patches and their electrical degrees of freedom", "the case has none"
        )
    if not driven:
        why = "they act in the response only; these modes are those of the bare plate"
        return Simplification("no_patches", "piezo patches", why)
    return None


def no_response() -> Simplification:
    """Leave out damping, which only a forced response has."""
    return Simplification("no_response", "damping", "no response is requested")


def material_loss(design: Design, quality: float | None) -> Simplification | None:
    """Leave out the loss factors of the materials where one quality factor stands for all losses."""
    if quality is None or all(material.loss_factor is None for material in design.materials):
        return None
    why = f"damping.quality = {quality:g} stands for all losses"
    return Simplification("material_loss", "loss factors of the materials", why)


def alike_drift(design: Design) -> Simplification | None:
    """Solve one temperature where all materials change alike, and at any frequency, and nothing holds the plate."""
    coefficients = {(material.softening_per_k, material.expansion_per_k) for material in design.materials}
    own = design.holds_expansion or any(material.spectrum for material in design.materials)
    if len(coefficients) > 1 or own:
        return None
    return Simplification("alike_drift", "the plate at other temperatures", "all its materials change alike: it scales")


def no_plate_modes() -> Simplification:
    """Leave out the finite plate's modes."""
    return Simplification("no_plate_modes", "modes of the plate", "no measure needs them")


def no_lone_pillar(design: Design) -> Simplification | None:
    """Leave out the isolated pillar if there is none, or if the pillars differ between rows."""
    if design.pillar is None:
        return Simplification("no_lone_pillar", "modes of the pillar", "the case has no pillar")
    if design.is_graded:
        return Simplification("no_lone_pillar", "modes of the pillar", "the rows differ: no pillar represents them all")
    return None


def no_figures(drawn: bool = False) -> Simplification | None:
    """Leave out rendering: figures are drawn from stored results, for a page or for --out."""
    return None if drawn else Simplification("no_figures", "rendering", "figures are drawn when a page needs them")


def no_lattice(design: Design, measure: str) -> Simplification | None:
    """Leave out bands without a pitch, attenuation without a pitch or pillars, and both if the rows differ."""
    if design.is_graded:
        return Simplification("no_lattice", measure, "the rows differ: no unit cell represents them all")
    no_pitch = design.pitch_x_m != design.pitch_x_m
    if measure == "bands" and no_pitch:
        return Simplification("no_lattice", "bands", "the case has no pitch")
    if measure == "attenuation" and (no_pitch or design.pillar is None):
        return Simplification("no_lattice", "attenuation", "the case has no pillars or no pitch")
    return None


# -- symmetry of patches and of the wavevectors ------------------------------------------------------------------------


def patch_mirrors(patches: Patches) -> tuple[bool, bool]:
    """Whether the patches are symmetric in x and in y, so that symmetry classes stay separate."""
    return mirrored_axes(patches.boxes_m())


def patch_groups(patches: Patches) -> list[tuple[str, ...]]:
    """Groups of symmetry classes to solve together: each axis in which the patches are asymmetric couples two."""
    kept = patch_mirrors(patches)
    groups: dict[tuple[str, ...], list[str]] = {}
    for symmetry in CLASSES:
        groups.setdefault(tuple(mark if kept[axis] else "" for axis, mark in enumerate(symmetry)), []).append(symmetry)
    return [tuple(group) for group in groups.values()]


def undriven_classes(patches: Patches) -> Simplification | None:
    """Leave out classes antisymmetric in an axis on which every patch is centred: no patch drives or senses them."""
    classes = undriven(patches)
    if not classes:
        return None
    return Simplification("undriven_classes", "symmetry classes " + ", ".join(classes), "the patches do not drive them")


def undriven(patches: Patches) -> list[str]:
    """Classes that `undriven_classes` leaves out."""
    centred = [max(abs(centre[axis]) for centre in patches.centres_m) < SAME_M for axis in (0, 1)]
    return [each for each in CLASSES if any(centred[axis] and each[axis] == "A" for axis in (0, 1))]


def off_path(design: Design, path: str, grid: int = 0) -> Simplification | None:
    """Leave out wavevectors off a path along the whole border of the irreducible Brillouin zone.

    With rare exceptions, band edges lie on this border. The rule does not apply to a cell without mirror planes, to an
    oblique path, to one that misses a side, or if a grid is requested.
    """
    border = design.lattice.border(design.zone_mirrors)
    walked, sides = ({frozenset(pair) for pair in pairwise(labels_of(each))} for each in (path, border))
    if grid or not border or not sides <= walked:
        return None
    return Simplification("off_path", "wavevectors off the path", f"{path} bounds the irreducible Brillouin zone")


def waves_downwards(design: Design) -> Simplification | None:
    """Leave out waves towards -y: for a symmetric row they are mirror images of those towards +y."""
    if "y" not in design.cell_mirrors:
        return None
    return Simplification("waves_downwards", "waves towards -y", "the rows are symmetric: waves come in pairs k, -k")


def khz(frequency_hz: float) -> str:
    """Write a frequency in kHz."""
    return f"{frequency_hz / 1e3:g} kHz"
