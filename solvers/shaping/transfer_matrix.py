"""The actuator-sensor matrix T(omega): how well it can be inverted, and at which frequencies.

coupling = ||I - ORT||_2/(N - 1), ORT_ij = |t_i . conj t_j|/(|t_i||t_j|) over the rows of T: 0 for orthogonal rows, 1 when all
are parallel. Two equal rows of six give only 0.2 while T is singular, so the condition number always stands beside it.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from geometry.elements import ComplexArray, FloatArray
from solvers.errors import SolverError

UNDRIVEN = 1e-9  # of the largest row: a sensor below it hears nothing


@dataclass(frozen=True)
class Conditioning:
    """Of one T: condition number sigma_1/sigma_N (inf when singular), coupling and independence = 1 - coupling."""

    condition: float
    coupling: float

    @property
    def independence(self) -> float:
        """1 - coupling: 1 for orthogonal rows, 0 when all are parallel."""
        return 1.0 - self.coupling


def orthogonality(matrix: ComplexArray) -> FloatArray:
    """ORT, shape (s, s), from T (s, a); no scaling of a row changes it. SolverError for a row of zeros."""
    matrix = np.asarray(matrix, dtype=complex)
    size = np.linalg.norm(matrix, axis=1)
    largest = float(size.max(initial=0.0))
    undriven = np.flatnonzero(size <= UNDRIVEN * largest) if largest > 0.0 else np.arange(len(size))
    if undriven.size:
        raise SolverError(
            f"sensor {undriven[0] + 1} answers no actuator (its row of T is {size[undriven[0]]:.3g} against {largest:.3g}): "
            "it sits on a node of every mode that is excited; move it or change the frequency"
        )
    rows = matrix / size[:, None]
    return np.minimum(np.abs(rows @ rows.conj().T), 1.0)


def coupling_index(matrix: ComplexArray) -> float:
    """||I - ORT||_2/(N - 1), 0 (orthogonal rows) to 1 (all parallel); SolverError below two rows or for an undriven row."""
    if len(matrix) < 2:
        raise SolverError("the coupling index compares sensors: it needs two or more")
    modal_overlap = orthogonality(matrix)
    return float(np.linalg.norm(np.eye(len(modal_overlap)) - modal_overlap, 2) / (len(modal_overlap) - 1))


def conditioning(matrix: ComplexArray) -> Conditioning:
    """Condition number and coupling index of T; errors as coupling_index."""
    singular = np.linalg.svd(matrix, compute_uv=False)
    coupling = coupling_index(matrix)
    return Conditioning(float(singular[0] / singular[-1]) if singular[-1] > 0.0 else np.inf, coupling)


@dataclass(frozen=True)
class Scan:
    """T over n frequencies: condition (n,), coupling (n,)."""

    frequencies_hz: FloatArray
    condition: FloatArray
    coupling: FloatArray


def scan(matrix_at: Callable[[float], ComplexArray], frequencies_hz: FloatArray) -> Scan:
    """Conditioning of T, given as a function of the frequency in Hz, at each frequency; errors as its and coupling_index."""
    couplings = [conditioning(matrix_at(float(f))) for f in frequencies_hz]
    return Scan(
        np.asarray(frequencies_hz, dtype=float),
        np.array([one.condition for one in couplings]),
        np.array([one.coupling for one in couplings]),
    )


def operating_frequencies(of: Scan, count: int = 3) -> FloatArray:
    """The best frequencies to invert T at, Hz: least condition numbers among the local minima of a scan, best first.

    SolverError when the scan has none between its ends.
    """
    inner = of.condition[1:-1]
    lows = 1 + np.flatnonzero((inner < of.condition[:-2]) & (inner <= of.condition[2:]))
    if not lows.size:
        raise SolverError("no frequency between the ends of the scan conditions T best; scan a wider band")
    best = lows[np.argsort(of.condition[lows], kind="stable")][:count]
    return np.asarray(of.frequencies_hz[best])
