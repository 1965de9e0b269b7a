"""Finite elements of a layered beam: cubic deflection, quadratic extension, and the coupling of a one-sided layer.

Strain u' - z w'': the energy is 1/2 integral of EA u'^2 - 2 ES u' w'' + EI w''^2, mass rho A for the deflection alone
(Euler-Bernoulli; extension follows without inertia).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.polynomial import legendre

from geometry.elements import FloatArray


@dataclass(frozen=True)
class Sections:
    """One value per element: EA (N), ES (N m), EI (N m2) about the beam's middle plane, rho A (kg/m)."""

    stretching: FloatArray
    coupling: FloatArray
    bending: FloatArray
    mass: FloatArray


@dataclass(frozen=True)
class BeamMatrices:
    """K over (u, w) and M over w. nodes_m (n + 1,); u has 2 n + 1 degrees of freedom, w has (w, w') at each node.

    stretching (u, u), coupling (u, w), bending (w, w), mass (w, w).
    """

    nodes_m: FloatArray
    stretching: FloatArray
    coupling: FloatArray
    bending: FloatArray
    mass: FloatArray


def hermite(s: FloatArray, length_m: FloatArray | float, derivative: int = 0) -> FloatArray:
    """Cubic shape functions of (w1, w1', w2, w2') and their derivatives over x at s = x/length in [0, 1], (..., 4)."""
    cubic = np.polynomial.Polynomial
    shapes = [cubic([1, 0, -3, 2]), cubic([0, 1, -2, 1]), cubic([0, 0, 3, -2]), cubic([0, 0, -1, 1])]
    columns = [(shape.deriv(derivative) if derivative else shape)(s) for shape in shapes]
    length = np.asarray(length_m)
    for column in (1, 3):
        columns[column] = columns[column] * length
    return np.asarray(np.stack(columns, axis=-1) / np.asarray(length**derivative)[..., None])


def assemble_beam(nodes_m: FloatArray, sections: Sections) -> BeamMatrices:
    """Element matrices by a Gauss rule that is exact for them, summed over the nodes."""
    count = len(nodes_m) - 1
    points, weights = legendre.leggauss(4)
    s = (points + 1.0) / 2.0
    stretching, coupling = np.zeros((2 * count + 1,) * 2), np.zeros((2 * count + 1, 2 * count + 2))
    bending, mass = np.zeros((2 * count + 2,) * 2), np.zeros((2 * count + 2,) * 2)
    for e, length in enumerate(np.diff(nodes_m)):
        weight = weights * length / 2.0
        slope = np.stack([4.0 * s - 3.0, 4.0 - 8.0 * s, 4.0 * s - 1.0], axis=-1) / length
        value, curve = hermite(s, float(length)), hermite(s, float(length), 2)
        axial, lateral = slice(2 * e, 2 * e + 3), slice(2 * e, 2 * e + 4)
        stretching[axial, axial] += sections.stretching[e] * slope.T @ (weight[:, None] * slope)
        coupling[axial, lateral] -= sections.coupling[e] * slope.T @ (weight[:, None] * curve)
        bending[lateral, lateral] += sections.bending[e] * curve.T @ (weight[:, None] * curve)
        mass[lateral, lateral] += sections.mass[e] * value.T @ (weight[:, None] * value)
    return BeamMatrices(nodes_m, stretching, coupling, bending, mass)


def deflection_rows(nodes_m: FloatArray, points_m: FloatArray) -> FloatArray:
    """Rows that give w at points from the nodal (w, w'), shape (points, 2 n + 2)."""
    element = np.clip(np.searchsorted(nodes_m, points_m, side="right") - 1, 0, len(nodes_m) - 2)
    length = np.diff(nodes_m)[element]
    values = hermite((points_m - nodes_m[element]) / length, length)
    rows = np.zeros((len(points_m), 2 * len(nodes_m)))
    rows[np.arange(len(points_m))[:, None], 2 * element[:, None] + np.arange(4)] = values
    return rows
