"""What the numbers of a case may be, each limit with its reason: a solid that elasticity describes and a mesh can hold."""

from __future__ import annotations

from math import sqrt
from typing import TYPE_CHECKING

from pipeline.quantity import figure

if TYPE_CHECKING:
    from geometry.layout import Design
    from geometry.materials import Material
    from pipeline.logs import Log

Range = tuple[float, float]

LENGTH_MM: Range = (1e-3, 1e4)
"""A micrometre is a grain or less of a metal, which is no homogeneous solid there; ten metres are no touch plate."""
DEVIATION_MM: Range = (1e-6, 1e4)
"""A standard deviation of a nanometre is below what any surface is measured to."""
YOUNG_GPA: Range = (1e-9, 2000.0)
"""From 1 Pa, softer than any gel that keeps its shape, to beyond diamond (about 1200 GPa)."""
DENSITY_KG_M3: Range = (1.0, 1e5)
"""From an aerogel to four times osmium (22 590 kg/m3)."""
POISSON_MARGIN = 1e-6
"""Nearer to -1 or 0.5 shear and bulk modulus lie more than 2.5e5 apart, and their sum loses the smaller one's digits."""
FREQUENCY_KHZ: Range = (1e-6, 1e6)
"""A millihertz is quasi-static; at a gigahertz sound in a metal is some micrometres long, as its grains are."""
ACCURACY: Range = (1e-6, 0.1)
"""Rounding alone takes this share of a thin plate's frequency: no mesh is better."""
QUALITY: Range = (0.5, 1e12)
"""At 0.5 nothing resonates; the best of all mechanical resonators reach some 1e10."""
VOLTS: Range = (1e-9, 1e6)
"""From below the noise of any amplifier to beyond the breakdown of a millimetre of ceramic."""
IMPEDANCE: Range = (0.0, 1e9)
"""Stiffness (N/m), damping (N s/m) and mass (g) of a fingertip, up to what is rigid beside any plate."""
FORCE_N: Range = (1e-3, 100.0)
"""From a contact that is hardly felt to more than a hand presses."""
GAP_UM: Range = (0.7, 100.0)
"""Ten free paths of air's molecules, below which a film is no continuum, to more than any squeeze film of a finger."""

MAX_WAVENUMBER = 3e6
"""rad/m: pi over the shortest length of a case."""
MAX_NODAL_LINES = 1000
"""Of the target mode along its zone."""
MAX_ZONES = 20
"""Each is a plate more to assemble."""
MAX_PATCHES = 2000
"""Each patch drives a column of the forced response and has two wires of its own."""
MAX_PATH = 20
"""Letters of a wavevector path: all of a rectangle's segments, each walked more than once."""
MAX_SEED = 2**64 - 1
MAX_MODES = 10_000
MAX_SAMPLES = 10_000
MAX_FREQUENCIES = 100_000
"""Of a response or an attenuation: each is one more solve and one more line of the document."""

MAX_EVALUATIONS = 10_000
"""Plates that a search may spend: each takes seconds."""
MAX_JOBS = 1000
"""Worker processes of one machine."""

MAX_SLENDERNESS = 1000.0
"""Height over side of a pillar, and side over height: rounding takes eps (h/a)^4 of a bending eigenvalue, 2e-4 here."""
MAX_PILLARS = 1_000_000
"""Each adds at least a hundred degrees of freedom: beyond, no factorisation fits any machine."""
MIN_GAP = 1e-4
"""Of the footprint, between two pillars: an element there is as wide as the gap and as long as the foot."""
MAX_CONTRAST = 1e8
"""Ratio of the Young's moduli of plate and pillar that the study `extremes` has shown to be solved right."""


def span(limits: Range) -> str:
    """The limits in words."""
    return f"from {limits[0]:g} to {limits[1]:g}"


# -- doubts ------------------------------------------------------------------------------------------------------------
# What is allowed and most often meant otherwise: materials unlike any solid, waves too short for plate theory.

FASTEST_M_S, SLOWEST_M_S = 20e3, 1.0
"""Of sqrt(E/rho): diamond reaches 18 km/s, beryllium 13; a soft gel (1 kPa) reaches 1 m/s."""
HEAVIEST_KG_M3 = 25e3
"""Osmium, the heaviest, has 22 590."""


def doubts(design: Design) -> list[str]:
    """One line for each material of a design that is unlike any solid."""
    tips = [pillar.tip.material for pillar in design.kinds if pillar.tip]
    materials = dict.fromkeys([*design.stack.regions.values(), *(pillar.material for pillar in design.kinds), *tips])
    return [line for material in materials for line in _doubt(material)]


def warn_of_doubts(design: Design, log: Log) -> None:
    """A warning for each of them: whoever reads a case for a computation says so."""
    for doubt in doubts(design):
        log.warning("MATERIAL", doubt)


def short_wave(design: Design) -> str | None:
    """Warn of a target mode whose half-wavelength is short beside the thickness; None where it is not."""
    from geometry.layout import SHORT

    if not design.is_short_wave:
        return None
    half = design.half_wavelength_m or design.width_m
    return (
        f"half a wave of the target (0, {design.nodal_lines}) mode is {figure(1e3 * half)} mm long, less than "
        f"{SHORT:g} thicknesses ({1e3 * design.thickness_m:g} mm each): plate theory, the pre-design and windows chosen by "
        "them mean little; lower zone.nodal_lines or plate.thickness_mm"
    )


def _doubt(material: Material) -> list[str]:
    young = material.average.young_pa
    speed = sqrt(young / material.density_kg_m3)
    given = f"{material.name}: young_GPa = {young / 1e9:g}, density_kg_m3 = {material.density_kg_m3:g}"
    if speed > FASTEST_M_S:
        why = f"sound in a rod would travel at {figure(speed / 1e3)} km/s, in diamond it does at 18 km/s"
    elif speed < SLOWEST_M_S:
        why = f"sound in a rod would travel at {figure(speed)} m/s, slower than in a soft gel"
    elif material.density_kg_m3 > HEAVIEST_KG_M3:
        why = "heavier than osmium (22 590 kg/m3)"
    else:
        return []
    return [f"{given}: {why}; check the units (GPa, kg/m3)"]
