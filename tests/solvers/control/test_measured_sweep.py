"""A measured resonance: frequency and losses of a known mode, with noise, neighbours and no circle at all."""

from __future__ import annotations

import numpy as np
import pytest

from solvers.control.identification import (
    Sensor,
    Sweep,
    half_power_points,
    half_power_quality_factor,
    noisy,
    resonance,
    sweep_of,
)
from solvers.control.loop import ModePlant

F0, Q = 32e3, 250.0
MODE = ModePlant.from_quality_factor(F0, Q, 0.8)
WIDTH = F0 / Q
TONES = np.linspace(F0 - 10 * WIDTH, F0 + 10 * WIDTH, 401)


@pytest.mark.parametrize("sensor", ["velocity", "displacement"])
@pytest.mark.parametrize("noise", [0.0, 0.01])
def test_a_mode_is_found_within_what_its_noise_leaves_open(sensor: Sensor, noise: float) -> None:
    """About 35 points carry the fit: five standard deviations of noise/sqrt(points) in Q, of half that width in f."""
    result = resonance(noisy(sweep_of([MODE], TONES, sensor), noise * 0.8), sensor)
    reach = 5.0 * noise / np.sqrt(35.0) + 1e-6
    assert result.circle is not None and result.trouble is None
    assert result.quality_factor == pytest.approx(Q, rel=2.0 * reach)
    assert result.frequency_hz == pytest.approx(F0, abs=WIDTH * reach)


def test_bars_by_scatter_hold_what_noise_moves() -> None:
    """Two standard deviations: 95 % of draws of any normal noise, 13 of 20 in all but six of a million such tests."""
    sweep = sweep_of([MODE], TONES[180:221])
    drawn = [resonance(noisy(sweep, 0.008, seed), "velocity").circle for seed in range(1, 21)]
    errors = [(abs(each.plant.frequency_hz / F0 - 1.0), each.frequency_error) for each in drawn if each]
    losses = [(abs(each.plant.quality_factor / Q - 1.0), each.quality_error) for each in drawn if each]
    for pairs in (errors, losses):
        assert len(pairs) == 20 and all(bar is not None and bar > 0.0 for _, bar in pairs)
        off, bars = np.array(pairs, dtype=float).T
        assert (off <= bars).sum() >= 13 and bars.max() < 4.0 * np.sqrt(np.mean(off**2))
    clean = resonance(sweep, "velocity").circle
    assert clean and clean.quality_error is not None and clean.quality_error < 1e-6


def test_neighbours_far_away_do_not_move_it() -> None:
    others = [
        ModePlant.from_quality_factor(F0 - 12 * WIDTH, Q, 0.5),
        ModePlant.from_quality_factor(F0 + 15 * WIDTH, Q, 0.4),
    ]
    result = resonance(sweep_of([MODE, *others], TONES), "velocity")
    assert result.frequency_hz == pytest.approx(F0, abs=0.03 * WIDTH)
    assert result.quality_factor == pytest.approx(
        Q, rel=0.05
    )  # their tails are constant to 1/12 of their own sizes over the fit


def test_half_power_and_circle_agree_on_a_clean_curve() -> None:
    result = resonance(sweep_of([MODE], TONES), "velocity")
    assert result.half_power_quality_factor == pytest.approx(Q, rel=0.005)
    assert result.peak_hz == pytest.approx(F0, abs=TONES[1] - TONES[0])


def test_where_there_is_no_circle_the_peak_is_told_and_why() -> None:
    flat = Sweep(TONES, np.linspace(1.0, 2.0, len(TONES)).astype(complex))
    result = resonance(flat, "velocity")
    assert result.circle is None and result.trouble
    assert result.frequency_hz == result.peak_hz == TONES[-1]
    assert result.quality_factor is None and result.frequency_error is None  # the maximum may lie beyond the end


def test_without_a_circle_the_maximum_lies_between_the_neighbours_of_the_highest_point() -> None:
    tone = np.array([10.0, 20.0, 30.0, 50.0, 60.0, 70.0, 80.0, 90.0])
    values = np.array([1.0, 1.1, 3.0, 1.2, 1.0, 1.1, 1.0, 1.1]).astype(complex)
    result = resonance(Sweep(tone, values), "velocity")
    assert result.circle is None and result.frequency_hz == 30.0
    assert result.frequency_error == pytest.approx(20.0 / 30.0)


def test_a_sweep_too_coarse_for_the_floor_takes_its_neighbours_along() -> None:
    coarse = np.linspace(F0 - 4 * WIDTH, F0 + 4 * WIDTH, 17)  # five of them above the floor
    result = resonance(sweep_of([MODE], coarse), "velocity")
    assert result.quality_factor == pytest.approx(Q, rel=1e-4)
    assert result.high_hz - result.low_hz >= 7 * (coarse[1] - coarse[0]) * 0.999


@pytest.mark.parametrize("peak", [0, 8])
def test_a_curve_that_falls_on_one_side_alone_has_no_half_power_width(peak: int) -> None:
    tone = np.linspace(1e3, 2e3, 9)
    falling = np.array([9.0, 5.0, 3.0, 2.0, 1.5, 1.2, 1.1, 1.0, 0.9])
    assert half_power_quality_factor(tone, falling if peak == 0 else falling[::-1], peak) is None
    both = np.array([1.0, 2.0, 9.0, 2.0, 1.0])
    assert half_power_points(tone[:5], both, 2) is not None
    assert half_power_points(tone[:5], np.array([7.0, 8.0, 9.0, 2.0, 1.0]), 2) is None
