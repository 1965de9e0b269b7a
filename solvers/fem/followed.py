"""Eigenpairs of a pencil from those of one that differs little: Rayleigh-Ritz, and block inverse iteration.

A factor of K - s M takes the residual K x - l M x to what x lacks, most of all of modes far from s. Where motions span all but
a little of the modes sought, a block of solves or two do what takes Lanczos several times as many (parlett1998, chapters 11
and 14). Their number stays, so that no Ritz value lies between the modes by chance.
"""

from __future__ import annotations

from typing import Any, Protocol

import numpy as np
from scipy.linalg import LinAlgError, eigh

from geometry.elements import FloatArray
from solvers.fem.block_lanczos import Operator

STEPS = 3  # blocks of solves at most; one is always made


class Matrices(Protocol):
    """K and M, sparse, (dof, dof) each."""

    @property
    def stiffness(self) -> Any: ...
    @property
    def mass(self) -> Any: ...


def followed(
    pencil: Matrices, guess: FloatArray, solve: Operator, interval: tuple[float, float], residual: float
) -> tuple[FloatArray, FloatArray]:
    """Compute the eigenpairs within an interval from as many motions close to them.

    Parameters
    ----------
    pencil : Matrices
        Scaled K and M.
    guess : ndarray, shape (dof, k)
        Independent motions, such as the modes of a pencil that differs little.
    solve : callable
        Applies (K - s M)^-1 to blocks (dof, n), s within the interval.
    interval : tuple of float
        Scaled eigenvalues.
    residual : float
        |K x - l M x| over |x| that is small enough.

    Returns
    -------
    values : ndarray, shape (n,)
        Rayleigh quotients within the interval, ascending; none is promised to be there.
    vectors : ndarray, shape (dof, n)
        M-orthonormal.
    """
    vectors = guess
    for step in range(STEPS + 1):
        stiff, heavy = pencil.stiffness @ vectors, pencil.mass @ vectors
        try:
            values, mix = eigh(vectors.T @ stiff, vectors.T @ heavy)
        except LinAlgError:  # dependent motions
            return np.empty(0), guess[:, :0]
        vectors = vectors @ mix
        left = stiff @ mix - (heavy @ mix) * values
        rough = np.linalg.norm(left, axis=0) > residual * np.linalg.norm(vectors, axis=0)
        if step == STEPS or (step and not rough.any()):
            break
        vectors = vectors - solve(left)
    inside = (values >= interval[0]) & (values <= interval[1])
    return values[inside], vectors[:, inside]
