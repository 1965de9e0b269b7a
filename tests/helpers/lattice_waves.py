"""Exact waves of a bare plate treated as a lattice: folded Lamb and horizontally polarised shear waves."""

from __future__ import annotations

from math import pi

import numpy as np

from geometry.elements import FloatArray
from geometry.lattice import Lattice
from geometry.materials import Material
from solvers.analytic.plates import lamb_hz
from solvers.errors import SolverError


def shear_hz(wavenumber_per_m: float, material: Material) -> float:
    """Lowest horizontally polarised shear wave SH0, f = k c_t / (2 pi), Hz."""
    return wavenumber_per_m * material.shear_m_s / (2.0 * pi)


def folded_hz(
    wavevector: FloatArray, lattice: Lattice, thickness_m: float, material: Material, count: int
) -> FloatArray:
    """The `count` lowest waves of the bare plate treated as a lattice: A0, S0 and SH0 at k + G, Hz.

    SolverError above 0.9 of the first thickness-shear cut-off, where higher waves would have to be counted.
    """
    frequencies: list[float] = []
    for m in range(-3, 4):
        for n in range(-3, 4):
            k = float(np.hypot(*(wavevector + np.array([m, n]) @ lattice.reciprocal_per_m)))
            if k < 1e-9:
                frequencies += [0.0, 0.0, 0.0]
                continue
            frequencies += [lamb_hz(k, thickness_m, material, s) for s in (False, True)] + [shear_hz(k, material)]
    lowest = np.sort(frequencies)[:count]
    if lowest[-1] >= 0.9 * material.shear_m_s / (2.0 * thickness_m):
        raise SolverError(f"{count} waves reach above the thickness-shear cut-off: ask for fewer")
    return np.asarray(lowest)
