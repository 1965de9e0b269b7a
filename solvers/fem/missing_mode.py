"""Upper bound of the part of a load that any single missing mode may have, from a few solves.

A load p has strengths s_r = (phi_r'p)^2. With t = 1 / (lambda - shift) and every q(t) = c + t r(t) that is 1 at a mode's own t,
that mode's strength is at most sum s q^2 over all modes that are not known, whose sum of s is given. r has the orthonormal
polynomials of Lanczos from (K - shift M)^-1 p, the known modes projected out, as its basis: the least sum is 1 / a'G^-1 a, a
the basis at t and G its Gram matrix. It is largest where the polynomial a'G^-1 a is least (golub2010).
"""

from __future__ import annotations

import numpy as np
from numpy.polynomial import Chebyshev

from geometry.elements import FloatArray
from solvers.fem.block_lanczos import Operator
from solvers.fem.eigen import PlainPencil, Shared, factor_near

SOLVES = 6  # more do not help: they only find modes across the thickness, which no sum of strengths covers
SPARE = 1e-6  # of the missing strength, added: few modes have a singular Gram matrix
ENDED = 1e-10  # of a vector left: every mode that the load moves is in the basis


def largest_outside(
    pencil: PlainPencil, shared: Shared, load: FloatArray, vectors: FloatArray, reach: tuple[float, float]
) -> float:
    """Bound the strength of any one mode outside an interval, where all strengths together are at most 1.

    Parameters
    ----------
    pencil : PlainPencil
        Scaled K and M, (dof, dof).
    shared : Shared
        Its stored factor is used if its shift lies within the interval.
    load : ndarray, shape (dof,)
        p, scaled so that (phi' p)^2 is a strength.
    vectors : ndarray, shape (dof, k)
        All M-orthonormal modes within the interval.
    reach : tuple of float
        The interval, as scaled eigenvalues.

    Returns
    -------
    float
        Dimensionless; the rest of the strengths if the bound is no tighter.
    """
    missing = max(0.0, 1.0 - float(np.square(vectors.T @ load).sum()))
    kept = shared.near if shared.near and reach[0] < shared.near[1] < reach[1] else None
    factor, shift = kept or factor_near(pencil, 0.5 * (reach[0] + reach[1]), shared.factorise)
    alpha, beta, shares = _lanczos(pencil, pencil.without(factor.solve, vectors), load)
    if kept is None:
        factor.free()
    gram = np.eye(len(shares) + 1)
    gram[0, 0], gram[0, 1:], gram[1:, 0] = missing * (1.0 + SPARE), shares, shares
    if np.linalg.eigvalsh(gram)[0] <= 0.0:
        return missing
    inverse = np.linalg.inv(gram)

    def christoffel(at: FloatArray) -> FloatArray:
        basis = np.vstack([np.ones_like(at), at * _polynomials(at, alpha, beta)])
        return np.asarray(np.einsum("it,ij,jt->t", basis, inverse, basis))

    ends = [(0.0, 1.0 / (reach[1] - shift))]
    if reach[0] > 0.0:
        ends.append((1.0 / (reach[0] - shift), -1.0 / shift))
    return min(missing, 1.0 / min(_least(christoffel, pair, 2 * len(shares)) for pair in ends))


def _lanczos(pencil: PlainPencil, solve: Operator, load: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Coefficients alpha, beta of the recurrence of the polynomials, and p'v of the basis v, (m,) each."""
    basis: list[FloatArray] = []
    images: list[FloatArray] = []
    alpha: list[float] = []
    beta: list[float] = []
    for _ in range(SOLVES):
        vector = solve(images[-1] if images else load)
        if images:
            alpha.append(float(images[-1] @ vector))
            for _ in range(2):
                vector = vector - np.array(basis).T @ (np.array(images) @ vector)
        image = pencil.apply_mass(vector)
        length = float(np.sqrt(vector @ image))
        if not length > ENDED * (beta[0] if beta else 0.0):
            break
        beta.append(length)
        basis.append(vector / length)
        images.append(image / length)
    return np.array(alpha), np.array(beta), np.array(basis).reshape(len(basis), -1) @ load


def _polynomials(at: FloatArray, alpha: FloatArray, beta: FloatArray) -> FloatArray:
    """The orthonormal polynomials, (m, n), at places (n,)."""
    out = np.zeros((len(beta) + 1, len(at)))
    before = np.ones_like(at)
    for row, size in enumerate(beta):
        out[row + 1] = before / size
        if row < len(alpha):
            before = (at - alpha[row]) * out[row + 1] - size * out[row]
    return out[1:]


def _least(function: Operator, ends: tuple[float, float], degree: int) -> float:
    """The least value of a polynomial between two ends."""
    fitted = Chebyshev.interpolate(function, degree, ends)
    turns = fitted.deriv().roots()
    inside = turns.real[
        (np.abs(turns.imag) < 1e-6 * np.ptp(ends)) & (turns.real > min(ends)) & (turns.real < max(ends))
    ]
    return float(function(np.array([*ends, *inside])).min())
