"""The published piezo unimorph: its materials, measures and section."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from geometry.materials import VACUUM_F_M, Material, PiezoMaterial
from tests.helpers.piezo_beam import Section, elastic_layer, laminate, piezo_layer

YOUNG_PA, D31, HELD_F_M = 66e9, -190e-12, 15.93e-9
STEEL_LIKE = Material.isotropic("substructure", 100e9, 7165.0, 0.0)


@dataclass(frozen=True)
class Uniaxial(PiezoMaterial):
    """A ceramic that a field shortens along x only."""

    @property
    def charge_m_v(self) -> np.ndarray:
        """d, strain per field, shape (3, 6), m/V."""
        d = np.zeros((3, 6))
        d[2, 0] = self.d31
        return d


# erturk2008: 100 x 20 mm, 0.5 mm of a metal under 0.4 mm of a ceramic; beam theory corresponds to Poisson's ratios of 0.
CERAMIC = Uniaxial(
    "published", 7800.0, 1 / YOUNG_PA, 0.0, 0.0, 1 / YOUNG_PA, 2 / YOUNG_PA, D31, 0.0, 0.0, 1e3,
    (HELD_F_M + D31**2 * YOUNG_PA) / VACUUM_F_M, "erturk2008",
)  # fmt: skip
LENGTH_M, WIDTH_M, METAL_M, CERAMIC_M = 100e-3, 20e-3, 0.5e-3, 0.4e-3


def published(stretch: bool) -> Section:
    layers = [elastic_layer(STEEL_LIKE, 0.0, METAL_M), piezo_layer(CERAMIC, METAL_M, METAL_M + CERAMIC_M)]
    return laminate(layers, WIDTH_M, stretch)
