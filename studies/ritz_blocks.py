"""Rayleigh-Ritz frequencies of a free rectangular block of any proportions, by exact linear elasticity.

Displacements are products of Legendre polynomials in x, y and z; the eight parities do not mix. Frequencies converge from
above, fast, since stresses are bounded at the edges of a free block (visscher1991).
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import product

import numpy as np
from numpy.polynomial import legendre
from scipy.linalg import eigh

from geometry.elements import FloatArray, IntArray
from geometry.materials import Material

RIGID = 1e-6  # of the largest eigenvalue's root: six motions have no stiffness but for rounding
SIGNS = {"S": 0, "A": 1}  # the parity of u_z
Parity = tuple[int, int, int]


@dataclass(frozen=True)
class _Axis:
    """Integrals over one edge of products of normalised Legendre polynomials f and their slopes, (degree + 1)^2 each."""

    slopes: FloatArray
    mixed: FloatArray  # f'_i f_j


def free_block_hz(
    material: Material, size_m: tuple[float, float, float], high_hz: float, degrees: tuple[int, int, int] = (10, 10, 10)
) -> dict[str, FloatArray]:
    """Natural frequencies of a free block up to `high_hz`, by symmetry class.

    K a = (2 pi f)^2 M a with K from the strain energy of polynomials up to `degrees` along x, y and z.

    Parameters
    ----------
    material : Material
        Of axes along the edges.
    size_m : tuple of float
        Edges along x, y and z in m.
    high_hz : float
        Highest frequency in Hz.
    degrees : tuple of int
        Highest degree of the polynomials along x, y and z.

    Returns
    -------
    dict of str to ndarray
        Frequencies in Hz, ascending, (n,) each, by class: SS, SA, AS or AA for u_z even (S) or odd (A) in x, then in y.
        Rigid-body motions are left out.

    References
    ----------
    visscher1991
    """
    axes = [_axis(degree, length) for degree, length in zip(degrees, size_m, strict=True)]
    out = {}
    for name in map("".join, product("SA", repeat=2)):
        both = [_class_hz(material, axes, (SIGNS[name[0]], SIGNS[name[1]], odd)) for odd in (0, 1)]
        every = np.sort(np.concatenate(both))
        out[name] = every[every <= high_hz]
    return out


def _axis(degree: int, length_m: float) -> _Axis:
    points, weights = legendre.leggauss(degree + 1)
    scale = np.sqrt((2.0 * np.arange(degree + 1) + 1.0) / length_m)
    value = legendre.legvander(points, degree) * scale
    slope = legendre.legval(points, legendre.legder(np.eye(degree + 1))).T * scale * (2.0 / length_m)
    heavy = (length_m / 2.0 * weights)[:, None]
    return _Axis(slope.T @ (heavy * slope), slope.T @ (heavy * value))


def _class_hz(material: Material, axes: list[_Axis], parity: Parity) -> FloatArray:
    """Frequencies above 0 of the motions whose u_z has these parities along x, y and z: u_x is odd in x where u_z is even."""
    kept = [
        [np.arange((each + (axis != 2) * (axis == component) + (axis == 2) * (component != 2)) % 2, len(one.slopes), 2)
         for axis, (one, each) in enumerate(zip(axes, parity, strict=True))]
        for component in range(3)
    ]  # fmt: skip
    blocks = [[_block(material, axes, kept, i, j) for j in range(3)] for i in range(3)]
    values = eigh(np.block(blocks) / material.density_kg_m3, eigvals_only=True)
    omega = np.sqrt(np.maximum(values, 0.0))
    return np.asarray(omega[omega > RIGID * omega[-1]] / (2.0 * np.pi))


def _block(material: Material, axes: list[_Axis], kept: list[list[IntArray]], i: int, j: int) -> FloatArray:
    """Stiffness between the displacements i and j: C_ikjl d_k u_i d_l u_j."""
    law = material.tensor_pa[i, :, j]
    return np.asarray(
        sum(law[left, right] * _product(axes, kept, i, j, left, right) for left, right in np.argwhere(law))
    )


def _product(axes: list[_Axis], kept: list[list[IntArray]], i: int, j: int, left: int, right: int) -> FloatArray:
    """Integral of d_left f d_right g over the block, f and g the functions of the displacements i and j."""
    out: FloatArray = np.ones((1, 1))
    for axis, one in enumerate(axes):
        same = np.eye(len(one.slopes))
        kinds = {(1, 1): one.slopes, (1, 0): one.mixed, (0, 1): one.mixed.T, (0, 0): same}
        matrix = kinds[left == axis, right == axis]
        out = np.asarray(np.kron(out, matrix[np.ix_(kept[i][axis], kept[j][axis])]))
    return np.asarray(out)
