"""Errors, calibration and the output filter: first-order theory, known chains, circuits in time, and clear refusals."""

from __future__ import annotations

from dataclasses import replace
from math import pi, sqrt

import numpy as np
import pytest
from scipy.signal import StateSpace, lsim

from solvers.errors import SolverError
from solvers.shaping.modal_table import ModalTable, calibrate, common_phase, field_matrix, sensor_matrix
from solvers.shaping.voltages import Errors, LowPass, drive_voltages, filter_for, monte_carlo, quantiles
from solvers.thesis.shaped_beam import PatchedBeam, beam_table, charge_table, point_beam_table

BEAM = PatchedBeam()
MATRIX = sensor_matrix(beam_table(BEAM), 2400.0)
TARGET = np.array([1.0, -1.0, 0.5j, 0.0, 0.0, 0.2])
PLACES = beam_table(BEAM, points_m=np.array(BEAM.centres_m))
TRIALS = 4000


def spread_of_mean(values: np.ndarray) -> float:
    return float(np.std(values) / np.mean(values) / sqrt(len(values)))


@pytest.mark.parametrize("kind", ["noise", "gain", "phase_rad", "crosstalk"])
def test_small_errors_follow_first_order_theory(kind):
    size = 1e-4
    volts = np.linalg.solve(MATRIX, TARGET)
    power = np.linalg.norm(TARGET) ** 2
    neighbours = np.eye(6, k=1) + np.eye(6, k=-1)
    expected = {
        "noise": 6 * np.abs(MATRIX).max() ** 2 * np.linalg.norm(volts) ** 2 / power,
        "gain": 1.0,
        "phase_rad": 1.0,
        "crosstalk": (neighbours @ np.abs(TARGET) ** 2).sum() / power,
    }[kind]
    result = monte_carlo(MATRIX, TARGET, Errors(**{kind: size}, trials=TRIALS, seed=5))[1] ** 2
    assert np.mean(result) == pytest.approx(expected * size**2, rel=4.0 * spread_of_mean(result))


def test_trials_repeat_with_their_seed_and_vanish_without_errors():
    errors = [Errors(0.01, 0.05, 0.1, 0.02, 20, seed) for seed in (1, 1, 2)]
    first, again, other = (monte_carlo(MATRIX, TARGET, one)[0] for one in errors)
    assert (first == again).all() and (first != other).any()
    assert monte_carlo(MATRIX, TARGET, Errors(trials=3))[1].max() < 1e-12
    result = quantiles(np.arange(101.0))
    assert result == {"q05": 5.0, "median": 50.0, "q95": 95.0}
    with pytest.raises(SolverError, match="noise = -1: must be 0 or more"):
        Errors(noise=-1.0)
    with pytest.raises(SolverError, match="trials = 0"):
        Errors(trials=0)


def standing_wave(table: ModalTable, frequency_hz: float, gains: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """What laser and sensors show, 1 to 10 V on the second actuator; gains: of the chain that measures the sensors."""
    drives = np.linspace(1, 10, 8)[:, None]
    moved, heard = (matrix(table, frequency_hz)[:, 1] for matrix in (field_matrix, sensor_matrix))
    return drives * moved, drives * heard * gains


def test_calibration_finds_the_chain_that_was_put_in():
    frequency, own = float(PLACES.frequencies_hz[3]), np.exp(1j * np.array([0, 0.02, -0.02, 0.01, -0.01, 0]))
    gains = np.array([1.0, 0.8, 1.2, 1.0, 0.9, 1.1]) * np.exp(-0.4j) * own
    ideal = field_matrix(PLACES, frequency)[:, 1] / sensor_matrix(PLACES, frequency)[:, 1]
    assert calibrate(*standing_wave(PLACES, frequency, gains)) == pytest.approx(ideal / gains)
    plain, late = (calibrate(*standing_wave(PLACES, frequency, np.full(6, np.exp(-1j * x)))) for x in (0.0, 0.4))
    assert common_phase(late) - common_phase(plain) == pytest.approx(0.4)


def test_sensor_on_a_node_of_the_standing_wave_cannot_be_calibrated():
    beam = PatchedBeam(centres_m=(0.03, 0.075, 0.12))
    table = point_beam_table(beam, 6, points_m=np.array(beam.centres_m))
    table = replace(table, actuators=table.actuators[:, [1, 0, 2]], sensor_residual=None)
    with pytest.raises(SolverError, match="sensor 2 sits on a node of this wave"):
        calibrate(*standing_wave(table, float(table.frequencies_hz[1]), np.ones(3)))


def test_measurements_that_cannot_calibrate_are_refused():
    with pytest.raises(SolverError, match="measure two or more"):
        calibrate(np.ones((1, 2)), np.ones((1, 2)))
    with pytest.raises(SolverError, match=r"must be \(amplitudes, sensors\) alike"):
        calibrate(np.ones((3, 2)), np.ones((2, 2)))


@pytest.mark.slow
def test_filter_is_the_circuit_in_time_and_its_corner_is_in_hertz():
    low_pass = LowPass(28e-3, 3300.0, 5e-9)
    assert low_pass.corner_hz == pytest.approx(13451, rel=1e-4)
    frequency = 2400.0
    time = np.arange(0.0, 60 / frequency, 1e-7)
    rates = [[0, 1], [-1 / (28e-3 * 5e-9), -3300.0 / 28e-3]]
    circuit = StateSpace(rates, [[0], [1 / (28e-3 * 5e-9)]], [[1, 0]], [[0]])
    out = lsim(circuit, np.cos(2 * pi * frequency * time), time)[1]
    turned = np.exp(-2j * pi * frequency * time)
    last = time >= 40 / frequency
    assert 2 * np.mean(out[last] * turned[last]) == pytest.approx(low_pass.response(frequency), rel=1e-3)


def test_command_through_filter_and_compensation_arrives_unchanged():
    low_pass = filter_for(5e-9, 4500.0, 40e3)
    assert 4500.0 < low_pass.corner_hz < 40e3
    assert abs(low_pass.response(low_pass.corner_hz)) == pytest.approx(sqrt(0.5))
    assert low_pass.response(2400.0) * low_pass.compensation(2400.0) == pytest.approx(1.0)
    uncompensated = drive_voltages(MATRIX * low_pass.response(2400.0), TARGET).voltages
    direct = drive_voltages(MATRIX, TARGET).voltages
    assert uncompensated == pytest.approx(low_pass.compensation(2400.0) * direct)


def test_moving_patches_load_the_filter_by_their_own_admittance():
    low_pass = filter_for(BEAM.capacitance_f(BEAM.actuator_width_m), 4500.0, 40e3)
    still = low_pass.loaded_response(2400.0, np.diag(np.full(6, low_pass.capacitance_f)))
    assert still == pytest.approx(low_pass.response(2400.0) * np.eye(6))
    moving = sensor_matrix(charge_table(replace(BEAM, quality_factor=300.0)), 2128.7)
    loaded = low_pass.loaded_response(2128.7, moving)
    volts = loaded @ np.ones(6)
    current = 2j * pi * 2128.7 * moving @ volts
    dropped = (low_pass.resistance_ohm + 2j * pi * 2128.7 * low_pass.inductance_h) * current
    assert volts + dropped == pytest.approx(np.ones(6))  # Kirchhoff, branch by branch
    assert np.abs(loaded - low_pass.response(2128.7) * np.eye(6)).max() > 1e-3


def test_filters_that_cannot_be_are_refused():
    with pytest.raises(SolverError, match="inductance_h = 0: must be"):
        LowPass(0.0, 1.0, 1.0)
    with pytest.raises(SolverError, match="requires 0 < highest operating frequency < PWM frequency"):
        filter_for(5e-9, 50e3, 40e3)
    with pytest.raises(SolverError, match="frequency in Hz = 0"):
        LowPass(1.0, 1.0, 1.0).response(0.0)
