"""Waves of an infinite plate of any layers and laws by Chebyshev collocation through each layer, without finite elements."""

from __future__ import annotations

from itertools import product

import numpy as np
from scipy.linalg import eig

from geometry.elements import FloatArray
from geometry.materials import Stack


def collocated_waves_hz(stack: Stack, along_per_m: float, across_per_m: float, points: int = 20) -> FloatArray:
    """Frequencies of the waves u(z) exp(i k.x) below a tenth of the highest that so many points could follow, ascending."""
    unit, law, density = stack.thickness_m, stack.mean.average.shear_pa, stack.mean.density_kg_m3
    size = 3 * points
    total = size * len(stack.layers)
    a, b = np.zeros((total, total), dtype=complex), np.zeros((total, total), dtype=complex)
    tractions, values = [], []
    for number, (material, thickness) in enumerate(stack.layers):
        slope = chebyshev_slope(points) * (2.0 * unit / thickness)
        one, c = np.eye(points), material.tensor_pa / law
        by = [1j * along_per_m * unit * one, 1j * across_per_m * unit * one, slope]
        inner = sum(np.kron(c[:, j, :, m], by[j] @ by[m]) for j, m in product(range(3), repeat=2))
        traction = sum(np.kron(c[:, 2, :, m], by[m]) for m in range(3))
        place = slice(size * number, size * (number + 1))
        a[place, place] = inner
        b[place, place] = -material.density_kg_m3 / density * np.eye(size)
        tractions.append(_spread(np.asarray(traction), number, total))
        values.append(_spread(np.eye(size), number, total))
    low, high = np.arange(3) * points, np.arange(3) * points + points - 1
    a[low], a[total - size + high] = tractions[0][low], tractions[-1][high]
    b[low], b[total - size + high] = 0.0, 0.0
    for number in range(len(stack.layers) - 1):
        below, above = size * number + high, size * (number + 1) + low
        a[below] = tractions[number][high] - tractions[number + 1][low]
        a[above] = values[number][high] - values[number + 1][low]
        b[below], b[above] = 0.0, 0.0
    found = eig(a, b, right=False)
    found = found[np.isfinite(found)]
    square = np.sort(found[np.abs(found.imag) < 1e-6 * (1.0 + np.abs(found))].real)
    omega = np.sqrt(square[square > 1e-9] * law / density) / unit
    return np.asarray(omega / (2.0 * np.pi))


def folded_waves_hz(stack: Stack, pitch_m: float, wavevector: FloatArray, count: int, reach: int = 3) -> FloatArray:
    """The lowest waves of a plate at a wavevector (2,) and at those of a square lattice's images."""
    images = 2.0 * np.pi / pitch_m * np.array(list(product(range(-reach, reach + 1), repeat=2)))
    every = np.concatenate([collocated_waves_hz(stack, *(wavevector + each))[:6] for each in images])
    return np.asarray(np.sort(every)[:count])


def chebyshev_slope(points: int) -> FloatArray:
    """Differentiation matrix at Chebyshev's points of [-1, 1], ascending."""
    n = points - 1
    x = -np.cos(np.pi * np.arange(points) / n)
    weight = np.where((np.arange(points) == 0) | (np.arange(points) == n), 2.0, 1.0) * (-1.0) ** np.arange(points)
    matrix = np.outer(weight, 1.0 / weight) / (x[:, None] - x[None, :] + np.eye(points))
    return np.asarray(matrix - np.diag(matrix.sum(axis=1)))


def _spread(rows: FloatArray, number: int, total: int) -> FloatArray:
    """Rows of one layer among the unknowns of all of them."""
    out = np.zeros((len(rows), total), dtype=complex)
    out[:, rows.shape[1] * number : rows.shape[1] * (number + 1)] = rows
    return out
