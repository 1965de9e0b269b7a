"""Integrals over a finger's disk: means against Zernike polynomials, and rules of points on a square lattice.

Zernike polynomials Z_j are orthonormal in the mean over the disk: with c_j the mean of u Z_j, the mean of |u|^2 is sum |c_j|^2
as soon as their degree follows u. A wave number k on a radius R leaves (k R/2)^(n+1)/(n+1)! beyond degree n, the leading term
of the Bessel function J_(n+1)(k R) in the expansion of a plane wave (noll1976).
"""

from __future__ import annotations

from functools import cache
from itertools import product
from math import factorial, gamma, pi

import numpy as np
from scipy.special import eval_jacobi, roots_legendre

from geometry.elements import FloatArray, IntArray

ENOUGH = 1e-3  # of the motion, what the degree may miss: a frequency or a loss then misses its square
DEGREES = (4, 16)  # at least and at most
STEPS = (2, 6)  # of a map's lattice over a radius, at least and at most
RULE_ENOUGH = 1e-2  # of a map's mean over a contact
EDGE = 0.1  # of a lattice's spacing: from its outermost points to the disk's rim
LEAST = 0.1  # of an even share: the smallest weight of a rule


def degree_of(wavenumber_radius: float, enough: float = ENOUGH) -> int:
    """Degree of the polynomials that follow waves k on a radius R within `enough`, for k R; bounded by DEGREES."""
    low, high = DEGREES
    return next((n for n in range(low, high) if left_beyond(wavenumber_radius, n) <= enough), high)


def left_beyond(wavenumber_radius: float, degree: int) -> float:
    """Share of a plane wave that polynomials up to a degree miss over the disk."""
    return (wavenumber_radius / 2.0) ** (degree + 1) / factorial(degree + 1)


def zernike(degree: int, points: FloatArray) -> FloatArray:
    """Zernike polynomials up to a degree at points (p, 2) of the unit disk, by ascending degree, (m, p)."""
    radius, angle = np.hypot(*points.T), np.arctan2(points[:, 1], points[:, 0])
    rows = []
    for n in range(degree + 1):
        for m in range(-n, n + 1, 2):
            radial = radius ** abs(m) * eval_jacobi((n - abs(m)) // 2, 0, abs(m), 2.0 * radius**2 - 1.0)
            turn = np.cos(m * angle) if m >= 0 else np.sin(-m * angle)
            rows.append(np.sqrt((n + 1.0) * (2.0 if m else 1.0)) * radial * turn)
    return np.array(rows)


def count_of(degree: int) -> int:
    """Number of the polynomials up to a degree."""
    return (degree + 1) * (degree + 2) // 2


@cache
def means(degree: int, finer: int = 0) -> tuple[FloatArray, FloatArray]:
    """Points (p, 2) of the unit disk and the weights (m, p) that give the means of u Z_j from u at them.

    A Gauss rule along the squared radius times even angles, exact to three times the degree and more. A mesh's field has kinks:
    `finer` further points along each show what they leave.
    """
    along, around = max(24, 2 * degree) + finer, max(72, 4 * degree + 1) + finer
    nodes, shares = roots_legendre(along)
    radius, angle = np.sqrt((nodes + 1.0) / 2.0), 2.0 * pi * (np.arange(around) + 0.5) / around
    points = np.stack([np.outer(radius, turn(angle)) for turn in (np.cos, np.sin)], axis=-1).reshape(-1, 2)
    weights = np.repeat(shares / 2.0 / around, around)
    return points, zernike(degree, points) * weights


@cache
def lattice_rule(steps: int) -> tuple[IntArray, FloatArray, float]:
    """Lattice steps (p, 2) over a disk, weights (p,) of the mean at them, the spacing over the radius.

    All points of the disk, with the weights nearest to even ones that are exact to the highest degree which leaves each above
    LEAST of an even share.
    """
    each = range(-steps, steps + 1)
    places = np.array([(i, j) for i, j in product(each, each) if i * i + j * j <= steps * steps])
    spacing = 1.0 / (steps + EDGE)
    for degree in range(2 * steps - 1, 0, -2):
        weights = _weights(places * spacing, degree)
        if weights.min() * len(places) >= LEAST:
            break
    return places, weights, spacing


def steps_of(wavenumber_radius: float) -> int:
    """Steps of the lattice over a radius for the mean of a product of two waves, bounded by STEPS."""
    low, high = STEPS
    needed = (n for n in range(low, high) if left_beyond(2.0 * wavenumber_radius, 2 * n - 1) <= RULE_ENOUGH)
    return next(needed, high)


def _weights(points: FloatArray, degree: int) -> FloatArray:
    """Weights (p,) nearest to even ones whose means of even powers up to a degree are the disk's."""
    powers = [(a, b) for a in range(0, degree + 1, 2) for b in range(0, degree + 1 - a, 2)]
    values = np.array([points[:, 0] ** a * points[:, 1] ** b for a, b in powers])
    even = np.full(len(points), 1.0 / len(points))
    exact = np.array([_mean(a, b) for a, b in powers])
    return np.asarray(even + np.linalg.lstsq(values, exact - values @ even, rcond=None)[0])


def _mean(a: int, b: int) -> float:
    """Mean of x^a y^b over the unit disk, for even powers."""
    return 2.0 * gamma((a + 1) / 2) * gamma((b + 1) / 2) / (pi * (a + b + 2) * gamma((a + b) / 2 + 1))
