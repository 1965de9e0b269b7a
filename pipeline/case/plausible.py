"""What is allowed and most often meant otherwise: materials unlike any solid, waves too short for plate theory."""

from __future__ import annotations

from math import sqrt

from geometry.layout import SHORT, Design
from geometry.materials import Material
from pipeline.logs import Log
from pipeline.quantity import figure

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
    """Warn of a wanted mode whose half-wavelength is short beside the thickness; None where it is not."""
    if not design.is_short_wave:
        return None
    half = design.half_wavelength_m or design.width_m
    return (
        f"half a wave of the wanted (0, {design.nodal_lines}) mode is {figure(1e3 * half)} mm long, less than "
        f"{SHORT:g} thicknesses ({1e3 * design.thickness_m:g} mm each): plate theory, the pre-design and windows chosen by "
        "them mean little; lower zone.nodal_lines or plate.thickness_mm"
    )


def _doubt(material: Material) -> list[str]:
    speed = sqrt(material.average.young_pa / material.density_kg_m3)
    given = (
        f"{material.name}: young_GPa = {material.average.young_pa / 1e9:g}, density_kg_m3 = {material.density_kg_m3:g}"
    )
    if speed > FASTEST_M_S:
        why = f"sound in a rod would travel at {figure(speed / 1e3)} km/s, in diamond it does at 18 km/s"
    elif speed < SLOWEST_M_S:
        why = f"sound in a rod would travel at {figure(speed)} m/s, slower than in a soft gel"
    elif material.density_kg_m3 > HEAVIEST_KG_M3:
        why = "heavier than osmium (22 590 kg/m3)"
    else:
        return []
    return [f"{given}: {why}; check the units (GPa, kg/m3)"]
