"""What errors of measurement do to a shaped pattern: Monte Carlo over noise, gain, phase and crosstalk.

The controller knows S T + N, S = diag((1 + g) e^{i p}) X what its sensors really do, N the noise of the identification; it
applies V = (S T + N)^-1 W and the structure answers T V. Each error small and alone, s sensors: noise of sigma an entry gives
E|T V - W|^2 = s sigma^2 |V|^2, gain and phase give (sigma_g^2 + sigma_p^2)|W|^2.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from geometry.elements import ComplexArray, FloatArray
from solvers.errors import SolverError
from solvers.shaping.inversion import drive_voltages


@dataclass(frozen=True)
class Errors:
    """Standard deviations, and how often they are drawn from which seed: the same one gives the same numbers.

    noise: of each entry of T as a share of its largest one (complex, rms); gain: relative; phase_rad; crosstalk: of the share
    (complex, rms) a sensor hears of each neighbour. All 0 or more; trials 1 or more.
    """

    noise: float = 0.0
    gain: float = 0.0
    phase_rad: float = 0.0
    crosstalk: float = 0.0
    trials: int = 400
    seed: int = 1

    def __post_init__(self) -> None:
        for name in ("noise", "gain", "phase_rad", "crosstalk"):
            value = getattr(self, name)
            if not (np.isfinite(value) and value >= 0.0):
                raise SolverError(f"errors: {name} = {value:g}: must be 0 or more")
        if self.trials < 1:
            raise SolverError(f"trials = {self.trials}: must be 1 or more")


@dataclass(frozen=True)
class Spread:
    """voltages (n, a) of n trials, and error (n,) = |T V - W|/|W|."""

    voltages: ComplexArray
    error: FloatArray


def monte_carlo(matrix: ComplexArray, target: ComplexArray, errors: Errors) -> Spread:
    """Voltages and pattern errors of seeded trials; SolverError as drive_voltages."""
    random = np.random.default_rng(errors.seed)
    known = [_misjudged(np.asarray(matrix, dtype=complex), errors, random) for _ in range(errors.trials)]
    voltages = np.stack([drive_voltages(one, target).voltages for one in known])
    missed = np.linalg.norm(voltages @ np.asarray(matrix).T - target, axis=1)
    return Spread(voltages, missed / float(np.linalg.norm(target)))


def quantiles(values: FloatArray) -> dict[str, Any]:
    """The 5, 50 and 95 % quantiles of trials."""
    low, middle, high = np.quantile(values, [0.05, 0.5, 0.95])
    return {"q05": float(low), "median": float(middle), "q95": float(high)}


def _misjudged(matrix: ComplexArray, errors: Errors, random: np.random.Generator) -> ComplexArray:
    size = len(matrix)
    gains = (1.0 + errors.gain * random.standard_normal(size)) * np.exp(
        1j * errors.phase_rad * random.standard_normal(size)
    )
    neighbours = np.eye(size, k=1) + np.eye(size, k=-1)
    heard = np.eye(size) + errors.crosstalk * neighbours * unit_phasors(random, (size, size))
    noise = errors.noise * float(np.abs(matrix).max()) * unit_phasors(random, matrix.shape)
    return np.asarray(gains[:, None] * (heard @ matrix) + noise)


def unit_phasors(random: np.random.Generator, shape: tuple[int, ...]) -> ComplexArray:
    """Normally distributed phasors of rms 1."""
    return np.asarray((random.standard_normal(shape) + 1j * random.standard_normal(shape)) / np.sqrt(2.0))
