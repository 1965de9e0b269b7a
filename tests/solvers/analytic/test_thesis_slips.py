"""The rotating-frame model, its PI, its circle and its demodulator against time integration of the mode itself."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.signal import StateSpace, lsim

MASS, QUALITY, FORCE = 2e-3, 300.0, 1.5
OMEGA0 = 2 * np.pi * 32e3
DAMPING, STIFFNESS = MASS * OMEGA0 / QUALITY, MASS * OMEGA0**2
TAU, GAIN = 2 * MASS / DAMPING, FORCE / DAMPING


def velocity_envelope(detuning: float, end: float) -> tuple[np.ndarray, np.ndarray]:
    """U(t) after a step of V = 1 at t = 0, from the full second-order equation at 64 samples a period."""
    omega = OMEGA0 + detuning
    time = np.arange(0.0, end, 2 * np.pi / omega / 64)
    mode = StateSpace([[0, 1], [-STIFFNESS / MASS, -DAMPING / MASS]], [[0], [FORCE / MASS]], [[0, 1]], [[0]])
    _, speed, _ = lsim(mode, np.cos(omega * time), time)
    turned = 2.0 * speed * np.exp(-1j * omega * time)
    periods = turned[: turned.size // 64 * 64].reshape(-1, 64).mean(axis=1)
    return (np.arange(periods.size) + 0.5) * 64 * (time[1] - time[0]), periods


@pytest.mark.parametrize("detuning", [-1500.0, 0.0, 900.0])
def test_baseband_model_with_its_sign_of_detuning(detuning):
    time, result = velocity_envelope(detuning, 4 * TAU)
    pole = (DAMPING + 2j * MASS * detuning) / (2 * MASS)
    expected = FORCE / (2 * MASS * pole) * (1.0 - np.exp(-pole * time))
    assert result == pytest.approx(expected, abs=0.01 * GAIN)  # 1/Q and the ripple of one period
    if detuning:
        assert np.abs(result - expected.conj()).max() > 0.1 * GAIN


def test_pole_compensation_takes_the_plants_time_constant():
    """K_p = tau K_i: first order, 95 % after three wanted time constants; K_p = tau_d K_i overshoots."""
    wanted = TAU / 5
    time = np.linspace(0.0, 8 * wanted, 4001)
    answers = []
    for proportional in (TAU / (wanted * GAIN), 1.0 / GAIN):
        integral = 1.0 / (wanted * GAIN)
        loop = StateSpace(
            [[-(1 + GAIN * proportional) / TAU, GAIN * integral / TAU], [-1, 0]],
            [[GAIN * proportional / TAU], [1]],
            [[1, 0]],
            [[0]],
        )
        answers.append(lsim(loop, np.ones_like(time), time)[1])
    reached = time[np.argmax(answers[0] >= 0.95)]
    assert reached == pytest.approx(wanted * np.log(20.0), rel=1e-3)
    assert answers[0].max() <= 1.0 + 1e-9 and answers[1].max() > 1.2


def test_circle_and_time_constant_from_the_extremes_of_u_q():
    detuning = np.linspace(-2000.0, 2000.0, 400_001)
    omega = OMEGA0 + detuning
    u = 1j * omega * FORCE / (STIFFNESS - MASS * omega**2 + 1j * DAMPING * omega)
    radius = GAIN / 2
    assert u.imag**2 + (u.real - radius) ** 2 == pytest.approx(np.full(u.size, radius**2), rel=1e-9)
    distance = abs(omega[np.argmax(u.imag)] - omega[np.argmin(u.imag)])
    assert 2.0 / distance == pytest.approx(TAU, rel=1e-4)
    inside = omega[np.abs(u) >= np.abs(u).max() / np.sqrt(2)]
    assert inside[-1] - inside[0] == pytest.approx(distance, rel=1e-4)


def test_demodulator_and_its_leak():
    w_d, w_q, rate = 0.7, -0.4, 250e3

    def demodulated(frequency: float, samples: int) -> complex:
        phase = 2 * np.pi * frequency * np.arange(samples) / rate
        w = w_d * np.cos(phase) - w_q * np.sin(phase)
        return 2.0 / samples * complex(np.sum(w * np.cos(phase)), -np.sum(w * np.sin(phase)))

    assert demodulated(31_250.0, 8) == pytest.approx(complex(w_d, w_q), abs=1e-12)
    leaks = [abs(demodulated(f, 8) - complex(w_d, w_q)) / abs(complex(w_d, w_q)) for f in (31_000.0, 32_000.0)]
    assert all(0.005 < leak < 0.04 for leak in leaks)
    time = np.linspace(0.0, 1e-4, 7)
    omega = 2 * np.pi * 32e3
    speed = -omega * w_d * np.sin(omega * time) - omega * w_q * np.cos(omega * time)
    u_d, u_q = -omega * w_q, omega * w_d
    assert speed == pytest.approx(u_d * np.cos(omega * time) - u_q * np.sin(omega * time))
