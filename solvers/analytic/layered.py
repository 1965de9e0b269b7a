"""Waves of a plate of any layers and laws: exact along the plate, by polynomials of a high degree through each layer."""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from geometry.elements import ComplexArray, FloatArray, gauss_lobatto, lagrange
from geometry.materials import Stack
from solvers.analytic.beams import strained_omegas
from solvers.analytic.plates import Strip, thin_plate_hz

DEGREE = 12  # through each layer: five waves as long as the plate is thick to 1e-10


def layered_waves_hz(stack: Stack, along_per_m: float, across_per_m: float, count: int = 3) -> FloatArray:
    """Compute the lowest waves of an infinite plate at a wavevector; the first is the flexural one where waves are long.

    u = U(z) exp(i(kx x + ky y)): K = int B* C B dz with the strains B of the motions U, M = int rho U* U dz.

    Parameters
    ----------
    stack : Stack
        Layers of the plate.
    along_per_m, across_per_m : float
        Wavevector along x and y, in rad/m, not both 0.
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
    from scipy.linalg import cholesky  # slow to import, and only several layers need it

    unit, scale, density = stack.thickness_m, stack.mean.average.shear_pa, stack.mean.density_kg_m3
    wavevector = unit * np.array([along_per_m, across_per_m])
    nodes = DEGREE * len(stack.layers) + 1
    strains, mass, places = [], np.zeros((nodes, nodes)), np.zeros(nodes)  # of one component, from the plate's middle
    value, slope, weights = _functions()
    start = -0.5
    for number, (material, thickness) in enumerate(stack.layers):
        h, own = thickness / unit, slice(DEGREE * number, DEGREE * (number + 1) + 1)
        places[own] = start + h * (gauss_lobatto(DEGREE) + 1.0) / 2.0
        start += h
        heavy = h / 2.0 * weights
        mass[own, own] += material.density_kg_m3 / density * (value.T * heavy) @ value
        within = np.zeros((2, len(value), nodes))
        within[:, :, own] = value, 2.0 / h * slope
        root = cholesky(np.array(material.stiffness_pa) / scale)  # root' root = C
        parts = np.sqrt(heavy)[:, None, None] * (root @ _strains(wavevector, value @ places[own], *within))
        strains.append(parts.reshape(-1, parts.shape[-1]))
    omegas = strained_omegas(np.concatenate(strains), _mass(wavevector, places, mass), count)
    return np.asarray(omegas * np.sqrt(scale / density) / (2.0 * np.pi * unit))


def _strains(wavevector: FloatArray, z: FloatArray, value: FloatArray, slope: FloatArray) -> ComplexArray:
    """Strains xx, yy, zz, yz, xz, xy at z (q,) of three motions of the whole plate and of every node but the first, (q, 6, n).

    The first motion, u_z = 1 and u_x = -i kx z, has the strains of a curvature alone. In nodes' displacements they would be
    small differences of large strains, and in long waves nothing but rounding errors.
    """
    x, y = wavevector
    ix, iy, nodes = 1j * x, 1j * y, value.shape[1]
    out = np.zeros((len(z), 6, 3, nodes), dtype=complex)
    out[:, 0, 0], out[:, 5, 0], out[:, 4, 0] = ix * value, iy * value, slope
    out[:, 1, 1], out[:, 5, 1], out[:, 3, 1] = iy * value, ix * value, slope
    out[:, 2, 2], out[:, 3, 2], out[:, 4, 2] = slope, iy * value, ix * value
    whole = np.zeros((len(z), 6, 3), dtype=complex)
    whole[:, [0, 1, 5], 0] = np.outer(z, [x * x, y * y, 2.0 * x * y])
    whole[:, [0, 5], 1], whole[:, [1, 5], 2] = [ix, iy], [iy, ix]
    return np.concatenate([whole, out[..., 1:].reshape(len(z), 6, -1)], axis=2)


def _mass(wavevector: FloatArray, places: FloatArray, mass: FloatArray) -> ComplexArray:
    """Mass matrix of the motions of `_strains`, from that of one component's nodes at their places, (n, n)."""
    nodes = len(places)
    whole = np.zeros((3, nodes, 3), dtype=complex)
    whole[:2, :, 0], whole[2, :, 0] = -1j * np.outer(wavevector, places), 1.0
    whole[0, :, 1] = whole[1, :, 2] = 1.0
    alone = np.delete(np.eye(3 * nodes), np.arange(3) * nodes, axis=1)
    motions = np.concatenate([whole.reshape(-1, 3), alone], axis=1)
    return np.asarray(motions.conj().T @ np.kron(np.eye(3), mass) @ motions)


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
