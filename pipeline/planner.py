"""What a scene needs: model, mesh, degrees, window of frequencies; each choice with its reason.

`accuracy` picks the cheapest mesh that the calibration expects to meet it.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import sqrt

from geometry.hexmesh import HexSettings
from geometry.layout import Design
from pipeline import calibration
from solvers.analytic.plates import Strip, levy_hz, thin_plate_hz
from solvers.superelement.build import Recipe
from solvers.superelement.interface import Interface

WINDOW = (0.72, 1.35)  # of the exact thin-plate frequency: where the wanted mode of plates with pillars was found
ALONG = {
    4: 0.3,
    5: 0.4,
}  # degree along a side: the longest side over the wanted half-wavelength; the log checks each solve
FINER = 0.3  # the cell's fixed-interface modes go up to accuracy^-FINER; too few are noticed and raised
TETRAHEDRA = {0.03: 2.0, 0.01: 3.0, 0.003: 4.0}  # accuracy: elements across the smallest dimension


@dataclass(frozen=True)
class Rung:
    """Order, layers towards re-entrant edges and their shrink factor."""

    order: int
    layers: int
    factor: float


RUNGS = (  # by the unknowns they give a cell
    Rung(3, 1, 0.2),
    Rung(4, 1, 0.2),
    Rung(3, 2, 0.15),
    Rung(4, 2, 0.15),
    Rung(4, 3, 0.15),
)


def rung(part: str, accuracy: float) -> Rung:
    """The cheapest rung expected to meet the accuracy on a part (zone, pillar, cell); the finest where none is."""
    for row in RUNGS:
        expected = calibration.by_hexahedra(part, row.order, row.layers)
        if expected is not None and expected <= accuracy:
            return row
    return RUNGS[-1]


def half_wavelength_m(design: Design) -> float:
    """Half-wavelength of the wanted mode along the zone, L / N, m; the zone's width for rigid shapes."""
    return design.length_m / design.nodal_lines if design.nodal_lines > 1 else design.width_m


def zone_settings(design: Design, accuracy: float) -> HexSettings:
    """Elements of the bare strip: its clamped faces are singular edges."""
    row = rung("zone", accuracy)
    size = min(half_wavelength_m(design) * 2.0 / 3.0, design.width_m / 2.0)
    return HexSettings(row.order, size, row.layers, row.factor)


def pillar_settings(design: Design, accuracy: float) -> HexSettings:
    """Elements of the lone pillar: two along the section, graded towards the clamped foot."""
    assert design.pillar
    row = rung("pillar", accuracy)
    return HexSettings(row.order, design.pillar.base_m, row.layers, row.factor, _along(design))


def cell_settings(design: Design, accuracy: float) -> HexSettings:
    """Elements of plate and cells: two thicknesses wide, graded towards the pillars' feet."""
    row = rung("cell", accuracy)
    along = _along(design) if design.pillar else None
    return HexSettings(row.order, 2.0 * design.thickness_m, row.layers, row.factor, along)


def solid_plate_settings(design: Design, accuracy: float) -> HexSettings:
    """Elements of a whole plate: grading is dear there, since its lines run across the plate."""
    row = rung("cell", accuracy)
    layers = 0 if accuracy > 0.01 else row.layers
    return HexSettings(
        row.order, 2.0 * design.thickness_m, layers, row.factor, _along(design) if design.pillar else None
    )


def _along(design: Design) -> float:
    assert design.pillar
    return min(2.0 * design.pillar.base_m, design.pillar.height_m / 2.0)


def shear_cutoff_hz(design: Design) -> float:
    """First thickness-shear resonance c_t / (2 h), Hz: plate theory ends there."""
    return sqrt(design.material.shear_pa / design.material.density_kg_m3) / (2.0 * design.thickness_m)


def lattice_recipe(design: Design, accuracy: float) -> Recipe:
    """Reduction of the unit cell for its lowest bands: where a coarse cell starts to look for what the accuracy needs."""
    longest = max(design.pitch_x_m, design.pitch_y_m)
    top = 1.5 * shear_cutoff_hz(design) * 2.0 * design.thickness_m / max(2.0 * design.thickness_m, longest)
    top *= (0.01 / min(accuracy, 0.01)) ** FINER
    along = 4 if longest <= 2.5 * design.thickness_m else 6
    return Recipe(Interface(along, 3), top, cell_settings(design, accuracy))


def plate_recipe(design: Design, accuracy: float, high_hz: float) -> Recipe:
    """Reduction of a plate's pieces: nine times the highest frequency bounds the fixed-interface modes."""
    longest = max(design.pitch_x_m, design.pitch_y_m) if design.rows else 3.0 * design.thickness_m
    share = longest / half_wavelength_m(design)
    along = next((degree for degree, limit in ALONG.items() if share <= limit), 6)
    return Recipe(Interface(along, 3), 9.0 * high_hz, cell_settings(design, accuracy), 3.0 * design.thickness_m)


def tet_edge_m(smallest_m: float, accuracy: float) -> float:
    """Edge length of tetrahedra from the smallest dimension of the part."""
    across = next((n for limit, n in TETRAHEDRA.items() if accuracy >= limit), 5.0)
    return smallest_m / across


def tet_cell_edge_m(design: Design, accuracy: float) -> float:
    """Edge length in a unit cell, or in a joined plate's piece, with its pillar."""
    return tet_edge_m(_smallest_m(design), accuracy)


def tet_plate_edge_m(design: Design, accuracy: float) -> float:
    """Edge length in a plate meshed whole, which cannot afford more than 1 %."""
    return tet_edge_m(_smallest_m(design) if design.rows else design.thickness_m, max(accuracy, 0.01))


def _smallest_m(design: Design) -> float:
    return min(design.thickness_m, design.pillar.tip_m) if design.pillar else design.thickness_m


def wanted_window_hz(design: Design) -> tuple[float, float]:
    """Where to look for the wanted mode when the case does not say: about the zone's exact thin-plate frequency."""
    material = design.material
    strip = Strip(
        design.length_m,
        design.width_m,
        design.thickness_m,
        material.young_pa,
        material.density_kg_m3,
        material.poisson,
    )
    pinned = design.nodal_lines < 2  # a rigid shape along x: cylindrical bending across the zone
    estimate = thin_plate_hz(strip, strip.across_per_m) if pinned else levy_hz(strip, design.nodal_lines)
    return WINDOW[0] * estimate, WINDOW[1] * estimate
