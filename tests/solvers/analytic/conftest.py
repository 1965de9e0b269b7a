"""Cubic Hermite finite elements for Euler-Bernoulli beams: the independent route of the beam tests."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.linalg import eigh

FIXED = {"clamped": (0, 1), "pinned": (0,), "sliding": (1,), "free": ()}


def hermite_omegas(left: str, right: str, elements: int = 40, ratio=lambda s: 1.0) -> np.ndarray:
    """Dimensionless omega sqrt(rho A L^4/EI), rigid-body modes included; ratio(s) scales a square section's width."""
    h = 1.0 / elements
    k = np.array([[12, 6 * h, -12, 6 * h], [6 * h, 4 * h * h, -6 * h, 2 * h * h],
                  [-12, -6 * h, 12, -6 * h], [6 * h, 2 * h * h, -6 * h, 4 * h * h]]) / h**3  # fmt: skip
    m = np.array([[156, 22 * h, 54, -13 * h], [22 * h, 4 * h * h, 13 * h, -3 * h * h],
                  [54, 13 * h, 156, -22 * h], [-13 * h, -3 * h * h, -22 * h, 4 * h * h]]) * h / 420  # fmt: skip
    size = 2 * (elements + 1)
    stiffness, mass = np.zeros((size, size)), np.zeros((size, size))
    for e in range(elements):
        width = ratio((e + 0.5) * h)
        span = slice(2 * e, 2 * e + 4)
        stiffness[span, span] += width**4 * k
        mass[span, span] += width**2 * m
    clamped = [*FIXED[left], *(size - 2 + n for n in FIXED[right])]
    free = np.setdiff1d(np.arange(size), clamped)
    values = eigh(stiffness[np.ix_(free, free)], mass[np.ix_(free, free)], eigvals_only=True)
    return np.sqrt(np.abs(values))


@pytest.fixture(name="hermite_omegas")
def _hermite_omegas():
    return hermite_omegas
