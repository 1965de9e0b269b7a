"""What the numbers of a case may be, each limit with its reason: a solid that elasticity describes and a mesh can hold."""

from __future__ import annotations

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
"""Of the wanted mode along its zone."""
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
