"""Rayleigh-Ritz for Timoshenko beams, tapered ones included: Legendre series for deflection and shear angle.

With the shear angle over the flexibility as second unknown the matrices stay well scaled for any slenderness.
"""

from __future__ import annotations

from dataclasses import replace
from math import inf, pi

import numpy as np
from numpy.polynomial import legendre
from scipy.linalg import eigh, null_space

from geometry.elements import FloatArray
from solvers.analytic.beams import End, check_ends, rigid_count
from solvers.analytic.section import Beam, check_beam

ENOUGH = 14  # polynomial degree beyond twice the mode number; the series converges exponentially


def ritz_frequencies_hz(beam: Beam, left: End, right: End, count: int, rigid_shear: bool = False) -> FloatArray:
    """The first `count` elastic frequencies from above, Hz; for uniform beams exact_omegas is exact.

    Minimises integral of EI psi'^2 + kappa G A (w' - psi)^2 over integral of rho A w^2 + rho I psi^2, to which a body on the
    right end adds M (w + d psi)^2 + J psi^2 there; rigid_shear leaves the beam's shear and rotary inertia out
    (Euler-Bernoulli). SolverError as exact_omegas.
    """
    check_ends(left, right)
    check_beam(beam, count)
    if rigid_shear:
        beam = replace(beam, shear_n=inf, rotary_kg_m=0.0)
    return ritz_omegas(beam, left, right, count) * beam.unit_rad_s / (2.0 * pi)


def ritz_omegas(beam: Beam, left: End, right: End, count: int) -> FloatArray:
    """Dimensionless elastic frequencies omega sqrt(rho A L^4/EI), shape (count,)."""
    degree = 2 * count + ENOUGH
    stiffness, mass = _matrices(beam, degree)
    basis = null_space(_constraints(beam, left, right, degree))
    values = eigh(basis.T @ stiffness @ basis, basis.T @ mass @ basis, eigvals_only=True)
    rigid = rigid_count(left, right)
    return np.sqrt(np.abs(values[rigid : rigid + count]))


def _rows(points: FloatArray, beam: Beam, degree: int) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """w, psi, psi' and g at the points as rows over (w, g) coefficients; psi = w' - flexibility g."""
    value: FloatArray = np.asarray(legendre.legvander(points, degree), dtype=np.float64)
    series = np.eye(degree + 1)
    slope: FloatArray = np.asarray(2.0 * legendre.legval(points, legendre.legder(series)).T, dtype=np.float64)
    curve: FloatArray = np.asarray(4.0 * legendre.legval(points, legendre.legder(series, 2)).T, dtype=np.float64)
    zero, flex = np.zeros_like(value), beam.flexibility
    if flex == 0.0:
        return value, slope, curve, zero
    return (
        np.hstack([value, zero]),
        np.hstack([slope, -flex * value]),
        np.hstack([curve, -flex * slope]),
        np.hstack([zero, value]),
    )


def _matrices(beam: Beam, degree: int) -> tuple[FloatArray, FloatArray]:
    points, weights = legendre.leggauss(degree + 12)
    ratio = np.ones_like(points) if beam.width_ratio is None else beam.width_ratio((points + 1.0) / 2.0)
    deflection, rotation, bending, shear = _rows(points, beam, degree)
    stiffness = _gram(bending, weights * ratio**4) + _gram(shear, weights * ratio**2 * beam.flexibility)
    mass = _gram(deflection, weights * ratio**2) + _gram(rotation, weights * ratio**4 * beam.rotation)
    heavy, turned, arm = beam.end_shares
    deflection, rotation, _, _ = _rows(np.array([1.0]), beam, degree)
    at_end = _gram(deflection + arm * rotation, np.array([heavy])) + _gram(rotation, np.array([turned]))
    return stiffness / 2.0, mass / 2.0 + at_end


def _gram(rows: FloatArray, weights: FloatArray) -> FloatArray:
    return np.asarray(rows.T @ (weights[:, None] * rows))


def _constraints(beam: Beam, left: str, right: str, degree: int) -> FloatArray:
    """Rows that hold w (clamped, pinned) and psi (clamped, sliding) at the ends; the energy gives the rest."""
    rows = [np.zeros((degree + 1) * (1 if beam.flexibility == 0.0 else 2))]
    for end, at in ((left, -1.0), (right, 1.0)):
        deflection, rotation, _, _ = (row[0] for row in _rows(np.array([at]), beam, degree))
        rows += [deflection] if end in ("clamped", "pinned") else []
        rows += [rotation] if end in ("clamped", "sliding") else []
    return np.stack(rows)
