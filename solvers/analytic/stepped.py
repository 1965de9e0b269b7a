"""Bending of a chain of beams one on top of the other: stepped rods, necks under heavy caps, glued pillars."""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache
from math import pi

import numpy as np
from numpy.polynomial import legendre
from numpy.polynomial.legendre import leggauss

from geometry.elements import FloatArray
from solvers.analytic.beams import Beam, strained_omegas

ENOUGH = 6  # polynomials of a beam beyond two a frequency
RIGID = 1e10  # times the shear stiffness, and over it the rotary inertia: none of them


def chain_frequencies_hz(beams: Sequence[Beam], count: int, rigid_shear: bool = False) -> FloatArray:
    """Compute the first bending frequencies of a chain of Timoshenko beams, its lower end clamped, its upper end free.

    Minimises integral of EI psi'^2 + kappa G A (w' - psi)^2 over integral of rho A w^2 + rho I psi^2 over polynomials of each
    beam that continue from one to the next: frequencies converge from above.

    Parameters
    ----------
    beams : sequence of Beam
        From the clamped end, each uniform or tapered; bodies on their ends are left out.
    count : int
        Number of frequencies.
    rigid_shear : bool, optional
        Leave out shear and rotary inertia (Euler-Bernoulli).

    Returns
    -------
    ndarray, shape (count,)
        In Hz.

    References
    ----------
    .. [1] timoshenko1921 (docs/references.bib)
    """
    degree, length = 2 * count + ENOUGH, sum(beam.length_m for beam in beams)
    own = degree + 1
    size = 2 * (len(beams) * degree + 1)
    strains, mass = [], np.zeros((size, size))
    for number, beam in enumerate(beams):
        places = np.concatenate([own_places + number * degree for own_places in (_order(own), size // 2 + _order(own))])
        strained, heavy = _matrices(beam, degree, length, rigid_shear)
        strains.append(np.zeros((len(strained), size)))
        strains[-1][:, places] = strained
        mass[np.ix_(places, places)] += heavy
    free = np.setdiff1d(np.arange(size), [0, size // 2])
    return strained_omegas(np.concatenate(strains)[:, free], mass[np.ix_(free, free)], count) / (2.0 * pi)


def _order(count: int) -> np.ndarray:
    """Places of a beam's polynomials along the chain: its lower end's, its own, its upper end's."""
    return np.concatenate([[0, count - 1], np.arange(1, count - 1)])


@lru_cache(maxsize=8)
def _polynomials(degree: int, points: int) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Places and weights of a quadrature of [0, 1], and (value, slope) (2, points, degree + 1) of both ends' linear functions
    and of integrated Legendre polynomials, zero at both ends.
    """
    x, weights = leggauss(points)
    rows = np.zeros((degree + 1, degree + 1))
    rows[0, :2], rows[1, :2] = (0.5, -0.5), (0.5, 0.5)
    for k in range(1, degree):
        rows[k + 1, [k + 1, k - 1]] = np.array([1.0, -1.0]) / np.sqrt(2.0 * (2.0 * k + 1.0))
    value = legendre.legval(x, rows.T).T
    slope = 2.0 * legendre.legval(x, legendre.legder(rows.T)).T
    return (x + 1.0) / 2.0, weights / 2.0, np.array([value, slope])


def _matrices(beam: Beam, degree: int, unit_m: float, rigid_shear: bool) -> tuple[FloatArray, FloatArray]:
    """Strains, whose squares are the energy, and M over [w / unit_m, psi], (2 points, 2 n) and (2 n, 2 n)."""
    s, weights, (value, slope) = _polynomials(degree, degree + ENOUGH)
    ratio = np.ones_like(s) if beam.width_ratio is None else beam.width_ratio(s)
    length, weights = beam.length_m, weights * beam.length_m
    area, about = weights * ratio**2, weights * ratio**4
    shear = beam.shear_n * (RIGID if rigid_shear else 1.0)
    rotary = beam.rotary_kg_m / (RIGID if rigid_shear else 1.0)
    slid = np.hstack([unit_m / length * slope, -value])
    turned = np.hstack([np.zeros_like(slope), slope / length])
    moved, tilted = (np.hstack(pair) for pair in ((unit_m * value, 0.0 * value), (0.0 * value, value)))
    strains = np.sqrt(np.concatenate([shear * area, beam.bending_n_m2 * about]))[:, None] * np.vstack([slid, turned])
    mass = beam.mass_kg_m * moved.T @ (area[:, None] * moved) + rotary * tilted.T @ (about[:, None] * tilted)
    return np.asarray(strains), np.asarray(mass)
