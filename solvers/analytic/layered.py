"""Waves of a plate of any layers and laws: exact along the plate, by polynomials of a high degree through each layer."""

from __future__ import annotations

from collections.abc import Callable
from functools import lru_cache, partial

import numpy as np

from geometry.elements import ComplexArray, FloatArray, gauss_lobatto, lagrange
from geometry.materials import Stack
from solvers.analytic.plates import Strip, thin_plate_hz

DEGREE = 12  # through each layer: five waves as long as the plate is thick to 1e-10


def layered_waves_hz(stack: Stack, along_per_m: float, across_per_m: float, count: int = 3) -> FloatArray:
    """Compute the lowest waves of an infinite plate at a wavevector; the first is the flexural one where waves are long.

    u = U(z) exp(i(kx x + ky y)): K_ik = int C_ijkl (D_j N)* (D_l N) dz with D = (i kx, i ky, d/dz), M = int rho N N dz.

    Parameters
    ----------
    stack : Stack
        Layers of the plate.
    along_per_m, across_per_m : float
        Wavevector along x and y, in rad/m.
    count : int, optional
        Number of waves.

    Returns
    -------
    ndarray, shape (count,)
        Frequencies in Hz, ascending.

    References
    ----------
    .. [1] lamb1917 (docs/references.bib)
    """
    from scipy.linalg import eigh  # slow to import, and only several layers need it

    unit, wavevector = stack.thickness_m, stack.thickness_m * np.array([along_per_m, across_per_m])
    scale, density = stack.mean.average.shear_pa, stack.mean.density_kg_m3
    size = 3 * (DEGREE * len(stack.layers) + 1)
    stiffness, mass = np.zeros((size, size), dtype=complex), np.zeros((size, size))
    value, slope, weights = _functions()
    strained: list[Callable[[ComplexArray], float]] = []
    for number, (material, thickness) in enumerate(stack.layers):
        h = thickness / unit
        parts = [1j * wavevector[0] * value, 1j * wavevector[1] * value, 2.0 / h * slope]
        law, heavy = material.tensor_pa / scale, h / 2.0 * weights
        own = sum(
            np.einsum("q,qa,qb,ik->aibk", heavy, parts[j].conj(), parts[m], law[:, j, :, m])
            for j in range(3)
            for m in range(3)
        )
        first = 3 * DEGREE * number
        place = np.ix_(*2 * [np.arange(first, first + 3 * (DEGREE + 1))])
        stiffness[place] += np.asarray(own).reshape(len(place[0]), -1)
        inertia = material.density_kg_m3 / density * (value.T * heavy) @ value
        mass[place] += np.kron(inertia, np.eye(3))
        strained.append(partial(_energy, law, heavy, np.array(parts), slice(first, first + 3 * (DEGREE + 1))))
    _, waves = eigh(stiffness, mass, subset_by_index=(0, count - 1))
    # eigenvalues of long waves drown in the stiffness's rounding errors; their strains, and the energy of these, do not
    values = [sum(energy(wave) for energy in strained) / (wave.conj() @ mass @ wave).real for wave in waves.T]
    return np.asarray(np.sqrt(np.array(values) * scale / density) / (2.0 * np.pi * unit))


def _energy(law: FloatArray, weights: FloatArray, derivatives: ComplexArray, place: slice, wave: ComplexArray) -> float:
    """Twice the strain energy of a wave in a layer, from its strains at the quadrature points."""
    gradient = np.einsum("jqa,ai->qij", derivatives, wave[place].reshape(-1, 3))
    strain = (gradient + gradient.swapaxes(1, 2)) / 2.0
    return float(np.einsum("q,qij,ijkl,qkl->", weights, strain.conj(), law, strain, optimize=True).real)


@lru_cache(maxsize=256)
def sheared(strip: Strip, along_per_m: float, across_per_m: float) -> float:
    """Compute the frequency of a plate's flexural wave over that of its laminate without shear.

    Parameters
    ----------
    strip : Strip
        Layers of the plate.
    along_per_m, across_per_m : float
        Wavevector along x and y, in rad/m.

    Returns
    -------
    float
        Dimensionless, at most about 1; 1 for one layer, whose theories count shear themselves.
    """
    if len(strip.stack.layers) == 1:
        return 1.0
    wave = along_per_m, across_per_m
    return float(layered_waves_hz(strip.stack, *wave, 1)[0]) / thin_plate_hz(strip, *wave)


@lru_cache(maxsize=1)
def _functions() -> tuple[FloatArray, FloatArray, FloatArray]:
    """Lagrange polynomials and their slopes at the Gauss points of [-1, 1], (q, DEGREE + 1) each, and the weights (q,)."""
    points, weights = np.polynomial.legendre.leggauss(DEGREE + 1)
    value, slope = lagrange(gauss_lobatto(DEGREE), points)
    return value, slope, weights
