"""Laws that differ along x, y and z."""

from __future__ import annotations

import numpy as np

from geometry.materials import Material

SPRUCE = {"young": (11e9, 0.9e9, 0.5e9), "poisson": (0.37, 0.42, 0.47), "shear": (0.06e9, 0.7e9, 0.75e9)}
"""E along x, y, z; nu_xy, nu_xz, nu_yz; G_yz, G_xz, G_xy: Pa."""

FIBRES = {"young": (40e9, 8e9, 8e9), "poisson": (0.27, 0.27, 0.4), "shear": (2.5e9, 4e9, 4e9)}
"""Glass fibres along x in epoxy."""


def orthotropic(
    young: tuple[float, ...], poisson: tuple[float, ...], shear: tuple[float, ...], density_kg_m3: float = 450.0
) -> Material:
    """A law of nine constants with its axes along x, y and z."""
    compliance = np.diag([1.0 / each for each in (*young, *shear)])
    for (i, j), ratio in zip(((0, 1), (0, 2), (1, 2)), poisson, strict=True):
        compliance[i, j] = compliance[j, i] = -ratio / young[i]
    stiffness = np.linalg.inv(compliance)
    return Material("wood", density_kg_m3, tuple(map(tuple, ((stiffness + stiffness.T) / 2.0).tolist())))
