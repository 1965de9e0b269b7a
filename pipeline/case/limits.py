"""Limits of the numbers in a case, each with its reason, and parsing of frequencies and bands as typed."""

from __future__ import annotations

import re
from collections.abc import Iterable
from math import inf, nan, sqrt
from typing import TYPE_CHECKING

from pipeline.errors import InputError
from pipeline.quantity import KHZ, MM, MS, US, figure

if TYPE_CHECKING:
    from geometry.layout import Design
    from geometry.materials import Material
    from pipeline.logs import Log

Range = tuple[float, float]
LENGTH_MM: Range = (1e-6, 1e7)
"""From a nanometre: places closer than a picometre count as one. Elasticity has no length of its own."""
USUAL_MM: Range = (1e-3, 1e4)
"""Below a micrometre, a grain of metal, a solid is not homogeneous; beyond ten metres nothing is a touch plate."""
DEVIATION_MM: Range = (1e-9, 1e7)
"""A thousandth of the shortest length."""
STIFFNESS_PERCENT: Range = (0.0, 10.0)
"""Three standard deviations are 30 %, what a parabola between three reductions follows within a percent of the change."""
YOUNG_GPA: Range = (1e-9, 2000.0)
"""From 1 Pa, softer than any gel that keeps its shape, to more than diamond (about 1200 GPa)."""
DENSITY_KG_M3: Range = (1.0, 1e5)
"""From an aerogel to four times osmium (22 590 kg/m3)."""
POISSON_MARGIN = 1e-6
"""Closer to -1 or 0.5, shear and bulk modulus differ by more than 2.5e5, and their sum loses digits of the smaller."""
POISSON_RATIO: Range = (-100.0, 100.0)
"""Of an orthotropic law each is limited by the ratio of two moduli alone."""
LOSS_FACTOR: Range = (0.0, 10.0)
"""Imaginary over real part of a modulus: rubber at its glass transition reaches 2 or 3."""
RELAXATION_S: Range = (1e-15, 1e15)
"""Time of a fractional Zener law: far outside it, it is one of its two moduli at any frequency."""
ORDER: Range = (0.01, 1.0)
"""Of its derivative: 1 is Zener's own; polymers have 0.2 to 0.7."""
MAX_SPECTRUM = 200
"""Rows of a modulus over frequency."""
PER_KELVIN: Range = (-0.1, 0.1)
"""Relative change of a modulus per kelvin: near its glass transition a polymer loses some percent per kelvin."""
EXPANSION_PER_K: Range = (-1e-3, 1e-3)
"""Silicones reach 3e-4 per kelvin."""
TEMPERATURE_C: Range = (-273.15, 3000.0)
ANGLE_DEG: Range = (-360.0, 360.0)
FREQUENCY_KHZ: Range = (1e-9, 1e10)
"""Of bodies from a nanometre to ten kilometres."""
ACCURACY: Range = (1e-6, 0.1)
"""Relative round-off error of a thin plate's frequency, which no mesh improves."""
QUALITY: Range = (0.5, 1e12)
"""At 0.5 nothing resonates; the best mechanical resonators reach some 1e10."""
VOLTS: Range = (1e-9, 1e6)
"""From below the noise of any amplifier to above the breakdown voltage of a millimetre of ceramic."""
IMPEDANCE: Range = (0.0, 1e9)
"""Stiffness (N/m), damping (N s/m) and mass (g) of a fingertip, up to one that is rigid compared with any plate."""
FORCE_N: Range = (1e-3, 100.0)
"""From a barely perceptible contact to more than a hand can press."""
GAP_UM: Range = (0.7, 100.0)
"""From ten mean free paths in air, below which a film is not a continuum, to more than any squeeze film of a finger."""
MAX_WAVENUMBER = 3e9
"""rad/m: pi over the shortest length of a case."""
MAX_NODAL_LINES = 1000
"""Nodal lines of the target mode along its zone."""
MAX_ZONES = 20
"""Each is one more plate to assemble."""
MAX_PATCHES = 2000
MAX_SUPPORTS = 100
STIFFNESS_N_M: Range = (0.0, 1e15)
DAMPING_NS_M: Range = (0.0, 1e9)
MASS_G: Range = (0.0, 1e9)
"""Each patch adds a column to the forced response and two wires to the plate."""
MAX_PATH = 20
"""Letters of a wavevector path: enough to visit all segments of a rectangle more than once."""
MAX_SEED = 2**64 - 1
MAX_MODES = 10_000
MAX_SAMPLES = 10_000
MAX_FREQUENCIES = 100_000
"""Frequencies of a response or an attenuation: each is one more solve and one more line of the document."""
MAX_EVALUATIONS = 10_000
"""Plates that a search may assemble: each takes seconds."""
MAX_JOBS = 1000
"""Worker processes of one machine."""
FLUID_KG_M3: Range = (0.01, 100.0)  # a gas: a liquid's mass would lower the frequencies
SOUND_M_S: Range = (50.0, 5000.0)
MAX_SLENDERNESS = 1000.0
"""Pillar height / side, and side / height: the round-off error of a bending eigenvalue is eps (h/a)^4, here 2e-4."""
MAX_PILLARS = 1_000_000
"""Each adds at least a hundred degrees of freedom: beyond this no machine can hold the factorisation."""
MIN_LAYER = 1e-3
"""A layer's thickness relative to the plate's: its elements are as wide as the plate is thick, and so slender at most."""
MAX_LAYERS = 20
"""Each has elements and boundary functions of its own."""
MIN_GAP = 2.5e-4
"""Gap between two pillars relative to the footprint: an element there is as wide as the gap and as long as the foot.
Half of it lies between a pillar and its cell's side; a wall within solvers.waves.bloch.OUTMOST would pass for that side.
"""
MAX_CONTRAST = 1e8
"""Ratio of the Young's moduli of plate and pillar up to which the study `extremes` verified the solver."""
FASTEST_M_S, SLOWEST_M_S = 20e3, 1.0
"""Limits of sqrt(E/rho): diamond reaches 18 km/s, beryllium 13; a soft gel (1 kPa) reaches 1 m/s."""
HEAVIEST_KG_M3 = 25e3
"""Osmium, the heaviest, has 22 590."""

SECONDS = {"ms": MS, "us": US, "s": 1.0}
MAX_DURATION_S = 1.0  # limit of a loop's times: a slower loop cannot control a vibration
HERTZ = {"hz": 1.0, "khz": KHZ, "mhz": 1e6}
FREQUENCY = re.compile(r"\s*([+-]?(?:[0-9]+\.?[0-9]*|\.[0-9]+)(?:[eE][+-]?[0-9]+)?)\s*([A-Za-z]*)\s*")


def span(limits: Range) -> str:
    """Return the limits in words."""
    return f"from {limits[0]:g} to {limits[1]:g}"


def doubts(design: Design) -> list[str]:
    """Yield a line for each material of a design with implausible constants, or without those of its temperature."""
    return [line for material in design.materials for line in _doubt(material)]


def warn_of_doubts(design: Design, log: Log) -> None:
    """Log a warning for each implausible material and for an unusual size, when a case is read for a computation."""
    for doubt in doubts(design):
        log.warning("MATERIAL", doubt)
    if size := unusual_size(design):
        log.warning("SIZE", size)


def unusual_size(design: Design) -> str | None:
    """Return a warning if a length of a design is unreasonable for a touch plate, else None."""
    pillars = [length for pillar in design.kinds for length in (pillar.base_m, pillar.tip_m, pillar.height_m)]
    whole = [design.length_m, design.width_m, design.thickness_m, design.pitch_x_m, design.pitch_y_m]
    known = [length / MM for length in (*whole, *pillars) if length > 0.0]  # not those that are not given
    odd = [length for length in known if not USUAL_MM[0] <= length <= USUAL_MM[1]]
    if not odd:
        return None
    why = (
        "a solid is not homogeneous at the size of its grains" if min(odd) < USUAL_MM[0] else "nothing is a touch plate"
    )
    return f"a length is {figure(odd[0])} mm, not {span(USUAL_MM)}: {why} there; check the units (mm)"


def warn_of_moduli(materials: Iterable[Material], log: Log) -> None:
    """Log the frequency at which a command takes moduli that depend on it."""
    for material in materials:
        if material.spectrum:
            taken = f"its moduli are those at {material.taken_hz:g} Hz: solve.moduli_kHz sets another frequency"
            log.warning("MODULI", f"{material.name}: {taken}")


def short_wave(design: Design) -> str | None:
    """Return a warning if the target mode's half-wavelength is short relative to the thickness, else None."""
    from geometry.layout import SHORT

    if not design.is_short_wave:
        return None
    half = design.half_wavelength_m or design.width_m
    return (
        f"the half-wavelength of the target mode (0, {design.nodal_lines}) is {figure(1e3 * half)} mm, less than "
        f"{SHORT:g} times the thickness of {1e3 * design.thickness_m:g} mm: plate theory, the pre-design and windows "
        "derived from them are unreliable; lower zone.nodal_lines or plate.thickness_mm"
    )


ALLOWED = f"a frequency above 0 with its unit Hz, kHz or MHz, such as 32kHz, {span(FREQUENCY_KHZ)} kHz"


def parse_frequency(text: str, what: str = "frequency") -> float:
    """Parse Hz from "32kHz", "32 kHz" or "0.032MHz"; InputError names `what`, and both readings of a bare number.

    A bare number has two readings because the keys of a case file are in kHz and the fields of a document in Hz. A bare
    0 would be the same in both, but a frequency must be above 0.
    """
    match = FREQUENCY.fullmatch(text)
    number, unit = match.groups() if match else ("nan", "")
    value = float(number) * HERTZ.get(unit.lower(), 1.0 if not unit else nan)
    if not unit and 0.0 < value < inf:
        raise InputError(f"{what} = {text!r}: {number} could mean {number} Hz or {number} kHz: write the unit")
    if not FREQUENCY_KHZ[0] <= value / KHZ <= FREQUENCY_KHZ[1]:
        raise InputError(f"{what} = {text!r}: must be {ALLOWED}")
    return value


def parse_seconds(text: str, what: str = "time") -> float:
    """Parse seconds from "2ms", "4us" or "0.002s"; InputError names `what` otherwise, or below 0."""
    unit = next((unit for unit in SECONDS if text.strip().endswith(unit)), None)
    try:
        value = float(text.strip().removesuffix(unit)) * SECONDS[unit] if unit else nan
    except ValueError:
        value = nan
    if 0.0 <= value <= MAX_DURATION_S:
        return value
    limit = f"must be a time of 0 or more in s, ms or us, such as 4us, and at most {MAX_DURATION_S:g} s"
    raise InputError(f"{what} = {text!r}: {limit}")


def parse_band(text: str, what: str = "band") -> tuple[float, float]:
    """Parse (low, high) in Hz from "30kHz:34kHz"; InputError for a wrong end or an empty or reversed band."""
    ends = text.split(":")
    if len(ends) != 2:
        raise InputError(f"{what} = {text!r}: must be two frequencies with a colon between them, such as 30kHz:34kHz")
    _refuse_bare(ends, text, what)
    low, high = (parse_frequency(end, f"{what} {side} end") for end, side in zip(ends, ("low", "high"), strict=True))
    if not low < high:
        raise InputError(f"{what} = {text!r}: the low end must lie below the high end")
    return low, high


WITHIN = 0.01  # of a requested frequency: how near a target mode has to come


def parse_target(text: str, what: str = "target") -> tuple[float, float]:
    """Parse a band, or a single frequency as the band WITHIN of it, in Hz."""
    if ":" in text:
        return parse_band(text, what)
    middle = parse_frequency(text, what)
    return middle * (1.0 - WITHIN), middle * (1.0 + WITHIN)


def _doubt(material: Material) -> list[str]:
    return [*_implausible(material), *_at_another_temperature(material), *beyond_spectrum(material, material.taken_hz)]


def beyond_spectrum(material: Material, tone: float | None) -> list[str]:
    """Return a line for a frequency, Hz, at which the spectrum of a material does not hold."""
    if tone is None or not material.spectrum:
        return []
    low, high = material.spectrum.ends_hz
    if low <= tone <= high:
        return []
    ends = f"{figure(low)} to {figure(high)} Hz"
    return [f"{material.name}: young_GPa_at holds from {ends}: at {figure(tone)} Hz its nearest end is taken"]


def _at_another_temperature(material: Material) -> list[str]:
    from geometry.materials import USUAL_C

    if material.temperature_c == USUAL_C or material.softening_per_k is not None:
        return []
    return [
        f"{material.name}: dE_dT_per_K is not known: its stiffness is that of {USUAL_C:g} C, not of solve.temperature_C = "
        f"{material.temperature_c:g}"
    ]


def _implausible(material: Material) -> list[str]:
    young = material.average.young_pa
    speed = sqrt(young / material.density_kg_m3)
    given = f"{material.name}: young_GPa = {young / 1e9:g}, density_kg_m3 = {material.density_kg_m3:g}"
    if speed > FASTEST_M_S:
        why = f"sound in a rod would travel at {figure(speed / 1e3)} km/s, faster than the 18 km/s of diamond"
    elif speed < SLOWEST_M_S:
        why = f"sound in a rod would travel at {figure(speed)} m/s, slower than in a soft gel"
    elif material.density_kg_m3 > HEAVIEST_KG_M3:
        why = "heavier than osmium (22 590 kg/m3)"
    else:
        return []
    return [f"{given}: {why}; check the units (GPa, kg/m3)"]


def _refuse_bare(ends: list[str], text: str, what: str) -> None:
    """Return an InputError with both readings of a band whose ends are bare numbers above 0."""
    bare = [match.group(1) for end in ends if (match := FREQUENCY.fullmatch(end)) and not match.group(2)]
    if len(bare) == 2 and all(0.0 < float(number) < inf for number in bare):
        readings = " or ".join(f"{bare[0]} {unit} to {bare[1]} {unit}" for unit in ("Hz", "kHz"))
        raise InputError(f"{what} = {text!r}: {':'.join(bare)} could mean {readings}: write the unit")
