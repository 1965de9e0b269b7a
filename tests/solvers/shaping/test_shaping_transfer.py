"""Modal tables, T and its inversion: time stepping, exact limits, optimality, and clear refusals."""

from __future__ import annotations

from dataclasses import replace
from math import inf, pi

import numpy as np
import pytest
from scipy.signal import StateSpace, lsim

from solvers.errors import SolverError
from solvers.shaping.modal_table import (
    ModalTable,
    Scan,
    conditioning,
    coupling_index,
    field_matrix,
    operating_frequencies,
    orthogonality,
    scan,
    sensor_matrix,
)
from solvers.shaping.voltages import drive_voltages
from solvers.thesis.shaped_beam import PatchedBeam, point_beam_table

RANDOM = np.random.default_rng(7)


def small_table(quality_factor: float = 30.0) -> ModalTable:
    """Three modes, two actuators, two sensors, a static residual."""
    return ModalTable(
        np.array([300.0, 700.0, 1100.0]), np.full(3, quality_factor), RANDOM.normal(size=(3, 2)), RANDOM.normal(size=(3, 2)),
        RANDOM.normal(size=(3, 4)), np.arange(4.0)[:, None], RANDOM.normal(size=(2, 2)) * 1e-7,
    )  # fmt: skip


def matrix_of(size: int = 4) -> np.ndarray:
    return RANDOM.normal(size=(size, size)) + 1j * RANDOM.normal(size=(size, size))


def test_phasors_are_the_steady_state_of_the_modes_in_time():
    table, frequency = small_table(), 520.0
    volts = np.array([1.0 - 0.5j, 0.3 + 2.0j])
    omega = 2 * pi * frequency
    time = np.arange(0.0, 300 / frequency, 1 / (frequency * 200))
    drive = np.real(volts * np.exp(1j * omega * time)[:, None])
    signals = drive @ table.sensor_residual.T
    for mode, own in enumerate(table.angular):
        plant = StateSpace(
            [[0, 1], [-(own**2), -own / table.quality_factor[mode]]], np.vstack([np.zeros(2), table.actuators[mode]]), [[1, 0]],
            np.zeros((1, 2)),
        )  # fmt: skip
        signals = signals + lsim(plant, drive, time)[1][:, None] * table.sensors[mode]
    settled = slice(-20 * 200, None)
    result = 2.0 * np.mean(signals[settled] * np.exp(-1j * omega * time[settled])[:, None], axis=0)
    assert result == pytest.approx(sensor_matrix(table, frequency) @ volts, rel=1e-3)


def test_the_field_has_the_static_answer_of_the_modes_that_are_left_out():
    table = small_table()
    rest = RANDOM.normal(size=(4, 2)) * 1e-7
    more = field_matrix(replace(table, field_residual=rest), 520.0) - field_matrix(table, 520.0)
    assert more == pytest.approx(rest, rel=1e-6)


def test_frequencies_and_resonances_that_have_no_answer():
    for wrong in (0.0, -5.0, float("nan")):
        with pytest.raises(SolverError, match="must be a finite number above 0"):
            sensor_matrix(small_table(), wrong)
    with pytest.raises(SolverError, match="frequency of mode 2, which has no loss"):
        field_matrix(small_table(inf), 700.0)
    assert np.isfinite(field_matrix(small_table(inf), 700.001)).all()
    assert np.isfinite(field_matrix(small_table(), 700.0)).all()


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"actuators": np.zeros((3, 0))}, "list of actuators is empty"),
        ({"sensors": np.zeros((3, 0))}, "list of sensors is empty"),
        ({"quality_factor": np.zeros(3)}, "quality factors must be above 0"),
        ({"frequencies_hz": np.array([-1.0, 2.0, 3.0])}, "not below 0"),
        ({"field": np.zeros((3, 5))}, r"field has shape \(3, 5\), must be \(3, 4\)"),
        ({"sensors": np.full((3, 2), np.nan)}, "sensors holds a value that is not finite"),
        ({"frequencies_hz": np.zeros(0)}, "no mode"),
    ],
)
def test_tables_that_cannot_be_are_refused(change, message):
    with pytest.raises(SolverError, match=message):
        replace(small_table(), **change)


def test_coupling_runs_from_orthogonal_to_parallel_rows_whatever_their_size():
    unitary = np.linalg.qr(matrix_of(6))[0]
    assert coupling_index(unitary) < 1e-12
    parallel = np.outer(RANDOM.normal(size=6), matrix_of(6)[0])
    assert coupling_index(parallel) == pytest.approx(1.0)
    matrix = matrix_of(6)
    assert coupling_index(np.diag([1e-3, 1, 2j, 50, 1, 1]) @ matrix) == pytest.approx(coupling_index(matrix))


def test_printed_normalisation_depends_on_the_size_of_the_signals():
    """(3.43) and the products of its rows grow a hundredfold when T grows tenfold; ORT does not."""

    def printed(matrix: np.ndarray) -> np.ndarray:
        rows = matrix @ matrix.conj().T / np.linalg.norm(matrix, 2)
        return np.abs(rows @ rows.conj().T)

    matrix = matrix_of(6)
    assert printed(10 * matrix) == pytest.approx(100 * printed(matrix))
    assert orthogonality(10 * matrix) == pytest.approx(orthogonality(matrix))


def test_two_equal_rows_of_six_couple_little_and_are_singular():
    matrix = np.linalg.qr(matrix_of(6))[0]
    matrix[1] = matrix[0]
    result = conditioning(matrix)
    assert result.coupling == pytest.approx(0.2)
    assert result.condition > 1e12
    with pytest.raises(SolverError, match="sensors 1 and 2 are the most alike"):
        drive_voltages(matrix, np.ones(6))


def test_rows_become_parallel_on_a_resonance_as_losses_vanish():
    result = []
    for quality_factor in (1e3, 1e5):
        table = point_beam_table(PatchedBeam(quality_factor=quality_factor), 12)
        result.append(1.0 - coupling_index(sensor_matrix(table, float(table.frequencies_hz[3]))))
    assert result[1] < 1e-2 * result[0] < 1e-4


def test_sensor_on_a_node_is_named():
    matrix = matrix_of(3)
    matrix[1] = 0.0
    for refuse in (coupling_index, conditioning):
        with pytest.raises(SolverError, match=r"sensor 2 answers to no actuator .* sits on a node"):
            refuse(matrix)
    beam = PatchedBeam(centres_m=(0.03, 0.075))
    table = point_beam_table(beam, 4)  # the middle is a node of modes 2 and 4
    odd = ModalTable(
        table.frequencies_hz[[1, 3]], table.quality_factor[:2], table.actuators[[1, 3]], table.sensors[[1, 3]],
        table.field[[1, 3]], table.points_m,
    )  # fmt: skip
    with pytest.raises(SolverError, match="sensor 2 answers to no actuator"):
        conditioning(sensor_matrix(odd, 1000.0))


def test_operating_frequencies_are_the_minima_of_the_condition_number():
    table = point_beam_table(PatchedBeam(), 12)
    grid = np.linspace(500.0, 4000.0, 351)
    result = scan(lambda frequency: sensor_matrix(table, frequency), grid)
    best = operating_frequencies(result, 2)
    assert result.condition[grid == best[0]] == result.condition[1:-1].min()
    for frequency in best:
        here, beside = (np.linalg.cond(sensor_matrix(table, frequency + d)) for d in (0.0, 10.0))
        assert here < beside
    with pytest.raises(SolverError, match="wider band"):
        operating_frequencies(Scan(grid[:3], np.array([1.0, 2.0, 3.0]), np.zeros(3)))


def test_inverse_reaches_the_target():
    matrix, target = matrix_of(), matrix_of()[0]
    exact = drive_voltages(matrix, target)
    assert matrix @ exact.voltages == pytest.approx(target) and exact.error < 1e-12


@pytest.mark.slow
def test_limited_voltages_are_the_constrained_minimum():
    for _ in range(5):
        matrix, target = matrix_of(5), matrix_of(5)[0]
        free = np.abs(drive_voltages(matrix, target).voltages).max()
        result = drive_voltages(matrix, target, limit_v=0.4 * free)
        assert np.abs(result.voltages).max() == pytest.approx(0.4 * free)
        voltages, step = np.zeros(5, complex), 1.0 / np.linalg.norm(matrix, 2) ** 2
        for _ in range(40_000):  # projected gradient: slow, and sure for a convex problem
            voltages = voltages - step * matrix.conj().T @ (matrix @ voltages - target)
            voltages = voltages / np.maximum(np.abs(voltages) / (0.4 * free), 1.0)
        expected = np.linalg.norm(matrix @ voltages - target)
        assert np.linalg.norm(matrix @ result.voltages - target) == pytest.approx(expected, rel=1e-5)
        assert result.error == pytest.approx(expected / np.linalg.norm(target), rel=1e-5)


def test_one_actuator_is_clipped_along_its_own_phase():
    result = drive_voltages(np.array([[2.0j]]), np.array([3.0 + 0j]), limit_v=1.0)
    assert result.voltages == pytest.approx([-1.0j])
    assert result.error == pytest.approx(1.0 / 3.0)


def test_limits_are_reached_in_any_unit():
    matrix, target = matrix_of(), matrix_of()[0]
    one = drive_voltages(matrix, target, limit_v=0.2).voltages
    scaled = drive_voltages(1e-9 * matrix, 3e-7 * target, limit_v=60.0).voltages
    assert scaled == pytest.approx(300.0 * one, rel=1e-4)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ((np.zeros((0, 0)), np.zeros(0)), "list of actuators or of sensors is empty"),
        ((np.eye(2), np.ones(3)), r"shape \(3,\), must be \(2,\)"),
        ((np.eye(2), np.zeros(2)), "zero everywhere"),
        ((np.eye(2), np.ones(2), 0.0), "must be above 0"),
        ((np.array([[np.inf]]), np.ones(1)), "not finite"),
        ((np.zeros((2, 2)), np.ones(2)), "answers to no actuator"),
    ],
)
def test_inversions_that_cannot_be_are_refused(arguments, message):
    with pytest.raises(SolverError, match=message):
        drive_voltages(*arguments)
