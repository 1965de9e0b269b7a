"""Circle and phase fit: what was put into a sweep comes out, and the thesis' two misreadings do not."""

from __future__ import annotations

from math import pi

import numpy as np
import pytest

from solvers.control.identification import Sweep, _fit_circle, _fit_phase, identify, noisy, sweep_of
from solvers.control.loop import ModePlant
from solvers.errors import SolverError

PLANT = ModePlant.from_quality_factor(31_400.0, 300.0, 0.8)
SPAN = np.linspace(31_150.0, 31_650.0, 101)


def test_circle_through_exact_points_and_noisy_ones():
    angles = np.linspace(-2.0, 2.5, 40)
    points = 3.0 - 2.0j + 0.7 * np.exp(1j * angles)
    result = _fit_circle(points)
    assert result.centre == pytest.approx(3.0 - 2.0j, abs=1e-10) and result.radius == pytest.approx(0.7, rel=1e-10)
    assert result.misfit < 1e-9
    rng = np.random.default_rng(3)
    noise = 0.01
    many = [_fit_circle(points + noise * (rng.normal(size=40) + 1j * rng.normal(size=40))).radius for _ in range(200)]
    assert np.mean(many) == pytest.approx(0.7, abs=4 * np.std(many) / np.sqrt(200) + noise**2 / 0.7)


def test_phase_fit_is_exact_on_its_own_curve():
    omega, omega0, tau = 2 * pi * SPAN, 2 * pi * 31_387.0, 3e-3
    angles = 0.4 - 2 * np.arctan(tau * (omega**2 - omega0**2) / (2 * omega))
    assert _fit_phase(SPAN, angles) == pytest.approx((31_387.0, 3e-3, 0.4), rel=1e-9)


@pytest.mark.parametrize("sensor", ["velocity", "displacement"])
@pytest.mark.parametrize("delay", [0.0, 2e-6, 13e-6])
def test_one_mode_comes_out(sensor, delay):
    """Displacement over velocity's circle is off by the background alone: feed-through times the span's width."""
    result = identify(sweep_of((PLANT,), SPAN, sensor, delay, 0.002j), sensor, 0.8 * delay + 0.5e-6)
    tilt = 1e-9 if sensor == "velocity" else 0.002 * 250.0 / 31_400.0 / 0.8
    assert result.plant.frequency_hz == pytest.approx(PLANT.frequency_hz, abs=0.01 + 1e3 * tilt)
    assert result.plant.tau_s == pytest.approx(PLANT.tau_s, rel=1e-7 + 3 * tilt)
    assert result.plant.gain == pytest.approx(0.8 if sensor == "velocity" else -0.8j, rel=1e-7 + 3 * tilt)
    assert result.delay_s == pytest.approx(delay, abs=1e-11 + 3 * tilt / PLANT.omega_rad_s)
    assert result.circle.radius == pytest.approx(0.4, rel=1e-7 + 3 * tilt)


def test_negative_gain_keeps_its_sign_when_the_delay_is_known():
    turned = ModePlant(PLANT.frequency_hz, PLANT.tau_s, -0.8)
    result = identify(sweep_of((turned,), SPAN, "velocity", 5e-6), "velocity", 4e-6)
    assert result.plant.gain == pytest.approx(-0.8, rel=1e-7) and result.delay_s == pytest.approx(5e-6, abs=1e-11)


def test_noise_scatters_as_it_should():
    """Cramer and Rao's order: sigma_f about noise/gain half-widths over sqrt(points); many trials stay near it."""
    noise = 1e-3
    result = [
        identify(noisy(sweep_of((PLANT,), SPAN, "velocity", 5e-6), noise, seed), "velocity", 5e-6) for seed in range(40)
    ]
    frequencies = np.array([one.plant.frequency_hz for one in result])
    width = PLANT.bandwidth_rad_s / (2 * pi)
    assert abs(frequencies.mean() - PLANT.frequency_hz) < 4 * frequencies.std() / np.sqrt(40)
    assert frequencies.std() < width * noise / 0.8
    taus = np.array([one.plant.tau_s for one in result]) / PLANT.tau_s
    assert taus.std() < 5e-3 and abs(taus.mean() - 1) < 4 * taus.std() / np.sqrt(40)


def test_ignored_delay_spoils_gain_only_slightly_and_neighbours_less_than_they_are():
    known = identify(sweep_of((PLANT,), SPAN, "velocity", 10e-6), "velocity", 9e-6).plant
    assert abs(known.gain) == pytest.approx(0.8, rel=1e-7)
    tilted = _fit_circle(sweep_of((PLANT,), SPAN, "velocity", 10e-6).response)
    assert 1e-3 < abs(2 * tilted.radius / 0.8 - 1) < 1e-2
    others = (
        ModePlant.from_quality_factor(30_600.0, 300.0, 0.03),
        ModePlant.from_quality_factor(32_500.0, 300.0, -0.04),
    )
    result = identify(sweep_of((PLANT, *others), SPAN, "velocity", 10e-6), "velocity", 9e-6).plant
    assert result.frequency_hz == pytest.approx(31_400.0, abs=0.1) and result.tau_s == pytest.approx(
        PLANT.tau_s, rel=5e-3
    )
    assert abs(result.gain) == pytest.approx(0.8, rel=5e-3)


def test_radius_is_no_bandwidth():
    """(2.44) printed: 1/R. Twice the drive would halve that 'time constant'; the true one stays."""
    once, twice = (identify(Sweep(SPAN, scale * PLANT.response(2 * pi * SPAN))) for scale in (1.0, 2.0))
    assert twice.circle.radius == pytest.approx(2 * once.circle.radius)
    assert twice.plant.tau_s == pytest.approx(once.plant.tau_s) == pytest.approx(PLANT.tau_s)
    quadrature = PLANT.response(2 * pi * np.linspace(31_150.0, 31_650.0, 50_001)).imag
    apart = abs(int(np.argmax(quadrature)) - int(np.argmin(quadrature))) * 0.01 * 2 * pi
    assert 2 / apart == pytest.approx(PLANT.tau_s, rel=1e-3)


@pytest.mark.parametrize(
    ("call", "expected"),
    [
        (lambda: _fit_circle(np.array([0, 1, 2j])), "at least 4"),
        (lambda: _fit_circle(np.linspace(0, 1, 9) * (1 + 2j)), "on a line"),
        (lambda: _fit_circle(np.ones(9, dtype=complex)), "one point"),
        (lambda: Sweep(SPAN[:3], np.ones(3, dtype=complex)), "at least 8"),
        (lambda: Sweep(SPAN[::-1], np.ones(101, dtype=complex)), "ascending"),
        (lambda: identify(sweep_of((PLANT,), SPAN + 3000.0)), "degrees of the circle|no circle"),
        (lambda: identify(Sweep(SPAN, np.random.default_rng(1).normal(size=101) + 0j)), "no circle|on a line"),
        (lambda: identify(sweep_of((PLANT,), SPAN), "strain"), "velocity or displacement"),
    ],
)
def test_refused(call, expected):
    with pytest.raises(SolverError, match=expected):
        call()
