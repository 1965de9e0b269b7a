"""The turning frame, its PI and the drive's limit against time stepping of the mode itself."""

from __future__ import annotations

from math import inf, log, pi

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from solvers.control.loop import ModePlant, _sampled_gains, feasibility, pi_gains
from solvers.errors import SolverError

MASS, QUALITY, FORCE = 2e-3, 200.0, 1.5
OMEGA0 = 2 * pi * 31e3
DAMPING, STIFFNESS = MASS * OMEGA0 / QUALITY, MASS * OMEGA0**2
PLANT = ModePlant(31e3, 2 * MASS / DAMPING, FORCE / DAMPING)  # M w'' + D w' + K w = N v: tau = 2 M/D, G = N/D


def envelope_response(detuning_rad_s) -> np.ndarray:
    """Steady U/V of the turning frame."""
    return PLANT.gain / (1 + 1j * PLANT.tau_s * np.asarray(detuning_rad_s))


def envelope_step(time_s, detuning_rad_s: float = 0.0, drive: float = 1.0) -> np.ndarray:
    """U(t) after the drive was switched on: G V/(1 + j tau d) (1 - e^{-(1/tau + j d) t})."""
    pole = 1 / PLANT.tau_s + 1j * detuning_rad_s
    return drive * envelope_response(detuning_rad_s) * (1 - np.exp(-pole * np.asarray(time_s)))


def test_modal_constants():
    assert PLANT.quality_factor == pytest.approx(QUALITY)
    assert PLANT.bandwidth_rad_s == pytest.approx(OMEGA0 / QUALITY)
    assert ModePlant.from_quality_factor(31e3, QUALITY, PLANT.gain).tau_s == pytest.approx(PLANT.tau_s)


def test_velocity_response_is_the_second_order_equations():
    omega = OMEGA0 * np.linspace(0.8, 1.2, 41)
    expected = 1j * omega * FORCE / (STIFFNESS - MASS * omega**2 + 1j * omega * DAMPING)
    assert PLANT.response(omega) == pytest.approx(expected, rel=1e-10)
    far = np.array([-3.0, 0.5, 2.0]) * PLANT.bandwidth_rad_s
    assert envelope_response(far) == pytest.approx(PLANT.response(OMEGA0 + far), rel=2.0 * 3.0 / QUALITY)


@pytest.mark.parametrize("detuning_hz", [-250.0, 0.0, 120.0])
def test_envelope_against_the_modes_own_motion(detuning_hz):
    """solve_ivp of M w'' + D w' + K w = N cos(omega t); the frame's model leaves out terms of order 1/Q."""
    omega = OMEGA0 + 2 * pi * detuning_hz
    times = np.arange(0, 160 * 32) * 2 * pi / omega / 32

    def rate(t, state):
        return [state[1], (FORCE * np.cos(omega * t) - DAMPING * state[1] - STIFFNESS * state[0]) / MASS]

    speed = solve_ivp(rate, (0, times[-1]), [0, 0], "DOP853", times, rtol=1e-9, atol=1e-12).y[1]
    turned = (2 * speed * np.exp(-1j * omega * times)).reshape(-1, 32).mean(axis=1)
    middles = times.reshape(-1, 32).mean(axis=1)
    expected = envelope_step(middles, 2 * pi * detuning_hz)
    assert np.abs(turned - expected).max() < 2.0 / QUALITY * abs(PLANT.gain)
    if detuning_hz:
        assert np.abs(turned - expected.conj()).max() > 20.0 / QUALITY * abs(PLANT.gain)


def closed(response: float, detuning: float, proportional: float | None = None) -> tuple[np.ndarray, np.ndarray]:
    """U and V after a unit step of the reference: the frame's equation with the PI, integrated."""
    gains = pi_gains(PLANT, response)
    kp = gains.proportional if proportional is None else proportional
    gain = PLANT.gain.real

    def drive(u, integral):
        return kp * (1 - u) + integral + 1j * PLANT.tau_s * detuning / gain * u  # decoupled

    def rate(t, state):
        u, integral = state
        pushed = gain * drive(u, integral) - (1 + 1j * PLANT.tau_s * detuning) * u
        return [pushed / PLANT.tau_s, gains.integral_per_s * (1 - u)]

    times = np.linspace(0, 8 * response, 2001)
    u, integral = solve_ivp(rate, (0, times[-1]), [0j, 0j], "RK45", times, rtol=1e-9, atol=1e-12).y
    return times, np.stack([u, drive(u, integral)])


@pytest.mark.parametrize("detuning", [0.0, 2000.0])
def test_pi_makes_a_first_order_loop(detuning):
    response = PLANT.tau_s / 5
    times, (u, drive) = closed(response, detuning)
    assert u == pytest.approx(1 - np.exp(-times / response), abs=1e-6)
    assert times[np.argmax(np.abs(u) >= 0.95)] == pytest.approx(response * log(20), rel=2e-3)
    limits = feasibility(PLANT, 1.0, response, 1.0, detuning)
    assert np.abs(drive).max() == pytest.approx(limits.peak_drive, rel=1e-4)
    assert abs(drive[-1]) == pytest.approx(limits.steady_drive, rel=1e-2)


def test_the_printed_proportional_gain_overshoots():
    """(2.40) as printed: K_p = tau_d K_i = 1/G."""
    _, (u, _) = closed(PLANT.tau_s / 5, 0.0, 1 / PLANT.gain.real)
    assert np.abs(u).max() > 1.2


def test_open_and_closed_loop_of_the_pi():
    response = PLANT.tau_s / 4
    omega = np.geomspace(10, 1e5, 30)
    loop, closed_loop = pi_gains(PLANT, response).closed_loop(PLANT, omega)
    assert loop == pytest.approx(1 / (1j * omega * response), rel=1e-10)
    assert closed_loop == pytest.approx(1 / (1 + 1j * omega * response), rel=1e-10)


def test_full_drive_bounds_the_time():
    limit, reference = 0.7, 0.4 * abs(PLANT.gain) * 0.7
    bound = feasibility(PLANT, reference, 1e-3, limit).least_time_s
    assert abs(envelope_step(bound, drive=limit)) == pytest.approx(0.95 * reference, rel=1e-9)
    detuned = envelope_step(np.linspace(0, bound, 200), 1500.0, limit)
    assert np.abs(detuned).max() < 0.95 * reference
    turning = solve_ivp(  # a drive that turns with the mode reaches it in the same time, detuned or not
        lambda t, u: [(PLANT.gain * limit * np.exp(-1500j * t) - (1 + 1500j * PLANT.tau_s) * u[0]) / PLANT.tau_s],
        (0, bound), [0j], rtol=1e-9, atol=1e-12,
    ).y[0, -1]  # fmt: skip
    assert abs(turning) == pytest.approx(0.95 * reference, rel=1e-5)


def test_what_cannot_be_held_has_no_time():
    reach = abs(PLANT.gain)
    assert feasibility(PLANT, 1.01 * reach, 1e-3, 1.0).least_time_s == inf
    assert feasibility(PLANT, 0.9 * reach, 1e-3, 1.0, 4 / PLANT.tau_s).least_time_s == inf
    clamped = feasibility(PLANT, 0.1 * reach, PLANT.tau_s / 4, 1.0)
    assert clamped.feasible and clamped.largest_reference == pytest.approx(reach / 4)
    assert not feasibility(PLANT, 0.26 * reach, PLANT.tau_s / 4, 1.0).feasible


def test_sampled_gains_place_their_poles():
    """The plant's own pole a, which is cancelled, and p."""
    period, response = 2e-4, 5e-4
    gains, size = _sampled_gains(PLANT, response, period), abs(PLANT.gain)
    a, p = np.exp(-period / PLANT.tau_s), np.exp(-period / response)
    loop = np.array([[a - (1 - a) * size * gains.proportional, (1 - a) * size], [-gains.integral, 1]])
    assert np.sort(np.linalg.eigvals(loop)) == pytest.approx(np.sort([a, p]))


def test_neighbours_bound_the_proportional_gain():
    free = _sampled_gains(PLANT, 5e-4, 2e-4)
    clamped = _sampled_gains(PLANT, 5e-4, 2e-4, 0.5 * free.proportional)
    assert clamped.bounded and not free.bounded and clamped.proportional == pytest.approx(0.5 * free.proportional)
    assert clamped.integral / clamped.proportional == pytest.approx(free.integral / free.proportional)
    assert _sampled_gains(PLANT, 5e-4, 2e-4, 1e-9).proportional == pytest.approx(0.1 / abs(PLANT.gain))


@pytest.mark.parametrize(
    ("call", "expected"),
    [
        (lambda: ModePlant(0.0, 1e-3, 1.0), "above 0"),
        (lambda: ModePlant(1e3, -1.0, 1.0), "above 0"),
        (lambda: ModePlant(1e3, 1e-3, 0.0), "other than 0"),
        (lambda: ModePlant(1e3, 1e-4, 1.0), "no oscillation"),
        (lambda: ModePlant.from_quality_factor(-1.0, 300.0, 1.0), "above 0"),
        (lambda: ModePlant.from_quality_factor(1e3, inf, 1.0), "without losses"),
        (lambda: PLANT.response(0.0), "above 0"),
        (lambda: pi_gains(PLANT, 0.0), "above 0"),
        (lambda: feasibility(PLANT, 0.0, 1e-3, 1.0), "above 0"),
    ],
)
def test_refused(call, expected):
    with pytest.raises(SolverError, match=expected):
        call()
