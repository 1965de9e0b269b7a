"""Beams with the sections that tests use."""

from __future__ import annotations

from geometry.layout import Pillar
from geometry.materials import Material
from solvers.analytic.beams import Beam
from solvers.analytic.predesign import pillar_beam


def square_beam(length_m: float, side_m: float, young_pa: float, density_kg_m3: float, poisson: float) -> Beam:
    """A beam of square section."""
    return _beam("square", length_m, side_m, Material.isotropic("given", young_pa, density_kg_m3, poisson))


def round_beam(length_m: float, diameter_m: float, young_pa: float, density_kg_m3: float, poisson: float) -> Beam:
    """A beam of round section."""
    return _beam("round", length_m, diameter_m, Material.isotropic("given", young_pa, density_kg_m3, poisson))


def _beam(shape: str, length_m: float, width_m: float, material: Material) -> Beam:
    return pillar_beam(Pillar(shape, width_m, width_m, length_m, material))
