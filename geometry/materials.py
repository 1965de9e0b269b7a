"""Elastic constants in SI, a source beside every value."""

from __future__ import annotations

from dataclasses import dataclass

from geometry.errors import GeometryError


@dataclass(frozen=True)
class Material:
    """An isotropic linear elastic solid.

    Units: young_pa in Pa, density_kg_m3 in kg/m3, poisson without unit, between -1 and 0.5 with both excluded (a
    displacement element cannot hold the volume). Raises GeometryError for anything else.
    """

    name: str
    young_pa: float
    density_kg_m3: float
    poisson: float
    source: str = "given in the case file"

    def __post_init__(self) -> None:
        if not (self.young_pa > 0.0 and self.density_kg_m3 > 0.0 and -1.0 < self.poisson < 0.5):
            raise GeometryError(
                f"material {self.name}: E = {self.young_pa:g} Pa, density = {self.density_kg_m3:g} kg/m3, "
                f"nu = {self.poisson:g}: E and density must be above 0, nu between -1 and 0.5, both excluded"
            )

    @property
    def shear_pa(self) -> float:
        """Shear modulus G = E / (2 (1 + nu)), Pa."""
        return self.young_pa / (2.0 * (1.0 + self.poisson))

    @property
    def lame_pa(self) -> float:
        """First Lame constant lambda = E nu / ((1 + nu)(1 - 2 nu)), Pa."""
        return self.young_pa * self.poisson / ((1.0 + self.poisson) * (1.0 - 2.0 * self.poisson))


MATERIALS: dict[str, Material] = {
    material.name: material
    for material in (
        Material("aluminium", 70e9, 2700.0, 0.34, "thesis, table 2.1"),
        Material(
            "AlSi7Mg0.6",
            70e9,
            2670.0,
            0.33,
            "typical laser powder-bed data sheet: E 65-75 GPa by build direction and heat treatment; mid value",
        ),
        Material("steel", 210e9, 7850.0, 0.30, "EN 1993-1-1, 3.2.6 (E, nu); EN 1991-1-1, table A.4 (density)"),
        Material("glass", 70e9, 2500.0, 0.22, "soda-lime silicate, EN 572-1 (E, density); handbook nu 0.20-0.23"),
        Material("brass", 105e9, 8500.0, 0.34, "handbook value for CuZn37"),
        Material("pmma", 3.0e9, 1180.0, 0.37, "handbook value, room temperature, static"),
        Material("titanium", 114e9, 4430.0, 0.34, "Ti-6Al-4V, handbook value"),
    )
}
