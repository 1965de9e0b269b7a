"""What the modes left out of a cell do to it: against their own sum, and against exact eigenvalues of small problems."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import brentq

from solvers.superelement.cell import KNOWN, ResidualModes

LEFT_OUT = np.array([1.0, 1.7, 2.9, 6.0])  # eigenvalues
RESIDUAL = ResidualModes(LEFT_OUT[0])


def couplings(seed: int, waves: int = 6) -> np.ndarray:
    """What each mode left out takes part in the motion of waves, (modes, waves)."""
    return 0.15 * np.random.default_rng(seed).standard_normal((len(LEFT_OUT), waves))


def exact(alone: np.ndarray, coupled: np.ndarray) -> np.ndarray:
    """Eigenvalues of waves and modes left out together: stiffness diag(l, L), mass coupled by P as Craig and Bampton's is."""
    waves = len(alone)
    mass = np.eye(waves + len(LEFT_OUT))
    mass[waves:, :waves] = coupled
    mass[:waves, waves:] = coupled.T
    values = np.linalg.eigvals(np.linalg.solve(mass, np.diag(np.concatenate([alone, LEFT_OUT]))))
    return np.sort(values.real)[:waves]


@pytest.mark.parametrize("seed", range(20))
def test_waves_with_the_modes_left_out_lie_within_their_bars(seed: int) -> None:
    alone = np.sort(np.random.default_rng(100 + seed).uniform(0.01, 0.6, 6))
    parts = couplings(seed)
    flexibility = parts.T @ (parts / LEFT_OUT[:, None])
    estimate, turn = RESIDUAL.coupled(alone, flexibility)
    energy, own = ((turn * (part @ turn)).sum(axis=0) for part in (np.diag(alone), flexibility))
    truth, bars = exact(alone, parts), RESIDUAL.bar(estimate, energy, own)
    below = truth < KNOWN
    error = np.abs(np.sqrt(estimate / truth) - 1.0)[below]
    assert (error <= bars[below]).all()
    assert error.max() < 0.5 * np.abs(np.sqrt(alone / truth) - 1.0)[below].max()  # and most of the rise is taken


@pytest.mark.parametrize("apart", [0.0, 1e-9, 1e-3, 0.3])
def test_the_chord_is_right_for_each_of_two_waves(apart: float) -> None:
    """det(diag(l) - m - h(m) E) = 0, whose roots are found one by one; the chord is wrong to the third order of the rise."""
    alone, flexibility = np.array([0.1, 0.1 + apart]), np.array([[0.3, 0.1], [0.1, 0.4]])

    def lowest(m: float, which: int) -> float:
        matrix = np.diag(alone) - float(RESIDUAL.softening(m)) * flexibility
        return float(np.linalg.eigvalsh(matrix)[which] - m)

    truth = [brentq(lowest, 1e-6, 0.49, args=(which,), xtol=1e-14) for which in (0, 1)]
    rise = float(np.abs(alone / truth - 1.0).max())
    assert rise > 1e-2
    assert RESIDUAL.coupled(alone, flexibility)[0] == pytest.approx(truth, rel=rise**3)


def test_rigid_motions_that_rounding_leaves_below_zero_stay_there() -> None:
    """At the zone's middle three eigenvalues vanish but for rounding, of either sign; the others are not disturbed."""
    alone = np.array([-3e-9, -1e-9, 0.0, 0.1])
    flexibility = np.diag([0.2, 0.3, 0.3, 0.4])
    estimate, turn = RESIDUAL.coupled(alone, flexibility)
    assert np.isfinite(turn).all() and np.abs(estimate[:3]).max() < 1e-8
    assert estimate[3] == pytest.approx(RESIDUAL.coupled(alone[3:], flexibility[3:, 3:])[0][0], rel=1e-9)


def test_beyond_half_the_lowest_eigenvalue_left_out_the_correction_grows_no_further() -> None:
    assert RESIDUAL.softening(0.25) == pytest.approx(0.25**2 * (1.0 + 4.0 / 3.0) / 2.0)
    assert RESIDUAL.softening(0.9) == RESIDUAL.softening(2.0) == pytest.approx(0.375)
    assert np.isinf(RESIDUAL.growth(1.0)) and RESIDUAL.slope(0.9) == 0.0
    for value in (0.1, 0.45):
        slope = (RESIDUAL.softening(value + 1e-6) - RESIDUAL.softening(value - 1e-6)) / 2e-6
        assert RESIDUAL.slope(value) == pytest.approx(float(slope), rel=1e-6)


def test_bounds_are_the_roots_of_what_they_bound() -> None:
    values = np.array([0.0, 0.3, 1.0, 3.0])
    lower, upper = RESIDUAL.bounds(values, np.full(4, 0.2))
    for value, low, high in zip(values, lower, upper, strict=True):
        assert low == pytest.approx(value - 0.2 * low**2 / (1.0 - low)) and low < 1.0
        assert high == pytest.approx(value - 0.2 * high**2)


def test_the_waves_of_two_close_bands_may_change_places_within_their_bars() -> None:
    """The first, whose bounds are wide, may come to lie above the second, which hardly moves: either may be the other then."""
    energy, own = np.array([0.5, 0.375]), np.array([0.8, 1e-9])
    estimate = np.array([0.36, 0.375])
    lower, upper = RESIDUAL.bounds(energy, own)
    assert lower[0] < estimate[0] < estimate[1] < upper[0]
    assert RESIDUAL.bar(estimate, energy, own)[1] > 1e-3
    assert RESIDUAL.bar(np.array([0.36, 0.9]), np.array([0.5, 0.9]), own)[1] < 1e-6
