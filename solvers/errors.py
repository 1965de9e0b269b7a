"""Exceptions of the solvers, and the checks of numbers that all of them share."""

from __future__ import annotations

from math import isfinite, pi
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray


class SolverError(Exception):
    """Raised for a result that fails its checks; the message says which, by how much, and what to try.

    >>> from antinode import SolverError
    >>> try:
    ...     raise SolverError("residual 1e-3 of mode 4, must be below 1e-6: refine the mesh")
    ... except SolverError as fault:
    ...     print(fault)
    residual 1e-3 of mode 4, must be below 1e-6: refine the mesh
    """


class CountMismatch(SolverError):
    """Raised if the number of eigenvalues found differs from the inertia count."""


class SingularShift(SolverError):
    """Raised if a shift is an eigenvalue, also after it was moved."""


class TooLarge(SolverError):
    """Raised if a factorisation would not fit into memory."""


class OutOfMemory(TooLarge):
    """Raised if memory runs out during a computation."""


def check_above_zero(what: str, *values: float) -> None:
    """Raise SolverError unless every value is a finite number above 0.

    Parameters
    ----------
    what : str
        Name of the values for the message.
    *values : float
        Values in any unit.

    Raises
    ------
    SolverError
        Naming the first that is not.
    """
    for value in values:
        if not (isfinite(value) and value > 0.0):
            raise SolverError(f"{what} = {value:g}: must be a finite number above 0")


UNBOUNDED = 1e9  # an answer this many times its size far from a resonance means a resonance hit to nine digits
RESONANT = "the frequency is that of a lossless resonance: add a loss or move the frequency"


def solved(matrix: NDArray[Any], load: NDArray[Any], trouble: str = RESONANT) -> NDArray[np.complex128]:
    """Solve a complex system, or a stack of them.

    Parameters
    ----------
    matrix : ndarray, shape (..., n, n)
        The systems.
    load : ndarray, shape (..., n, m)
        Right-hand sides.
    trouble : str, optional
        Message for a singular system.

    Returns
    -------
    ndarray, shape (..., n, m)
        The solutions.

    Raises
    ------
    SolverError
        For a singular system.
    """
    try:
        return np.asarray(np.linalg.solve(matrix, load), dtype=np.complex128)
    except np.linalg.LinAlgError:
        raise SolverError(trouble) from None


def check_bounded(sizes: NDArray[np.float64], rad_s: NDArray[np.float64]) -> None:
    """Reject a solution that is rounding noise at a lossless resonance.

    Parameters
    ----------
    sizes : ndarray, shape (n,)
        Sizes of the solution, 1 far from a resonance.
    rad_s : ndarray, shape (n,)
        Angular frequencies, in rad/s.

    Raises
    ------
    SolverError
        Naming the frequency of the largest size beyond the bound.
    """
    if not np.all(sizes <= UNBOUNDED):
        worst = rad_s[int(np.argmax(np.nan_to_num(sizes, nan=np.inf)))]
        raise SolverError(f"{RESONANT} (near {worst / (2.0 * pi):.9g} Hz)")


def checked_frequencies(frequency: ArrayLike) -> NDArray[np.float64]:
    """Convert frequencies to an array.

    Parameters
    ----------
    frequency : array_like, any shape
        Frequencies in any unit.

    Returns
    -------
    ndarray, shape of frequency
        The same values.

    Raises
    ------
    SolverError
        Unless all are finite and above 0.
    """
    checked = np.asarray(frequency, dtype=float)
    if not np.all(np.isfinite(checked) & (checked > 0.0)):
        raise SolverError("frequencies must be finite and above 0")
    return checked
