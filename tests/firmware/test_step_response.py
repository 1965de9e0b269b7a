"""The closed loop as the report shows it, and the plate it is joined to."""

from __future__ import annotations

import cmath
import math

import numpy as np
import pytest

from firmware.emulate import EmulationError, board_run
from firmware.emulate.plant import (
    Assumed,
    Plate,
    PlateSimulation,
    Resonance,
    _pole,
    _residue,
    hold,
    plate_from_table,
)
from firmware.mode_table import Mode, ModeTable, to_bytes

TRUE = 31437.3
TAU = 300.0 / math.pi / TRUE
DROOP = abs(hold(TRUE, 250e3))
KNOWN = Mode(TRUE, TAU, -0.8j * DROOP, 9.3e-6, frequency_identified=True)
TABLE = to_bytes(ModeTable(250e3, bytes(16), (KNOWN, Mode(TRUE + 700.0, TAU)), senses_displacement=True))


def response(plate: Plate, frequencies_hz: list[float]) -> list[complex]:
    """The exact steady response from the DAC's code to the ADC's sample, hold and dead time included."""
    result = []
    for frequency_hz in frequencies_hz:
        s = 2j * math.pi * frequency_hz
        total = complex(plate.feedthrough)
        for resonance in plate.resonances:
            pole, residue = _pole(resonance), _residue(resonance, plate.displacement)
            total += 0.5 * (residue / (s - pole) + residue.conjugate() / (s - pole.conjugate()))
        result.append(total * cmath.exp(-s * plate.delay_s) * hold(frequency_hz, plate.sample_rate_hz))
    return result


@pytest.mark.parametrize("displacement", [True, False])
def test_plate_in_time_is_the_plate_in_frequency(displacement: bool) -> None:
    resonances = (Resonance(TRUE, TAU, 0.8), Resonance(TRUE + 700.0, TAU, -0.3))
    plate = Plate(resonances, displacement, delay_s=9.7e-6)
    frequency_hz = TRUE + 40.0
    simulation, result = PlateSimulation(plate), []
    turn = 2.0 * math.pi * frequency_hz / plate.sample_rate_hz
    for n in range(round(12.0 * TAU * plate.sample_rate_hz)):
        result.append(simulation.sense())
        simulation.drive(math.cos(turn * n))
    n = np.arange(len(result) - 500, len(result))
    basis = np.stack([np.cos(turn * n), -np.sin(turn * n)], axis=1)
    re, im = np.linalg.lstsq(basis, np.array(result[-500:]), rcond=None)[0]
    assert complex(re, im) == pytest.approx(response(plate, [frequency_hz])[0], abs=2e-4)


def test_gain_of_a_resonance_is_its_peak() -> None:
    """|H(w0)| = gain, 90 degrees behind for displacement, in phase for velocity, the hold apart."""
    for displacement, phase in ((True, -1j), (False, 1.0)):
        plate = Plate((Resonance(TRUE, TAU, 0.8),), displacement)
        assert response(plate, [TRUE])[0] / hold(TRUE, 250e3) == pytest.approx(0.8 * phase, rel=1e-5)


def test_a_table_is_taken_at_its_word_and_its_gaps_are_assumed() -> None:
    plate = plate_from_table(TABLE, Assumed(other_gain=0.1, scale=1.0), noise=1e-3)
    known, other = plate.resonances
    assert known.gain == pytest.approx(0.8, rel=1e-6) and other.gain == 0.1
    assert known.frequency_hz == pytest.approx(TRUE, rel=1e-7) and plate.displacement
    assert plate.delay_s == pytest.approx(7.3e-6, rel=1e-6) and plate.noise == 1e-3


@pytest.fixture
def emulation(core) -> None:
    pytest.importorskip("unicorn", reason="unicorn is not installed: pip install unicorn")
    from firmware import build

    try:
        build.toolchain()
    except build.BuildError as missing:
        pytest.skip(str(missing))


@pytest.mark.slow
def test_step_response_of_the_table_s_own_plate(emulation) -> None:
    result = board_run(TABLE, plate_from_table(TABLE, Assumed(scale=1.0), noise=1e-3)).columns
    assert set(result) == {"time_s", "reference", "u_d", "u_q", "drive"}
    assert len({len(column) for column in result.values()}) == 1
    before, after = result["time_s"] < 0.0, result["time_s"] > 10e-3
    reference = 0.2 * 0.8 * DROOP
    assert result["reference"][after] == pytest.approx(reference, rel=1e-5)
    assert np.abs(result["u_d"][before]).max() < 0.02 * reference
    assert result["u_d"][after].mean() == pytest.approx(reference, rel=5e-3)
    assert np.abs(result["u_q"][after]).mean() < 0.01 * reference
    assert result["drive"][after].mean() == pytest.approx(0.2, rel=0.02)
    assert result["drive"].max() > 0.6  # the push that makes it fast


@pytest.mark.slow
def test_a_computed_gain_is_not_trusted_before_the_board_has_measured(emulation) -> None:
    """The plate is 0.2 % off the table: the image finds it, its own gain and delay, and is as fast as it should be."""
    tau_s = TAU / 3.0  # the sweep takes as long as the plate rings
    computed = Mode(TRUE, tau_s, -0.5j * DROOP, 2e-6)
    neighbour = Mode(TRUE + 2700.0, tau_s, 0.02j * DROOP, 2e-6)
    run = board_run(to_bytes(ModeTable(250e3, bytes(16), (computed, neighbour))))
    assert run.swept
    assert run.frequency_hz == pytest.approx(1.002 * TRUE, abs=0.1)
    assert run.tau_s == pytest.approx(tau_s, rel=5e-3)
    assert abs(run.gain) == pytest.approx(0.5 * abs(hold(1.002 * TRUE, 250e3)), rel=5e-3)
    assert run.delay_s == pytest.approx(2e-6, abs=5e-8)
    assert run.t95_s <= 2.0e-3


def test_signs_of_computed_gains_reach_the_plate() -> None:
    """A displacement sensor is 90 degrees behind: -j G is a positive mode, +j G one of opposite sign."""
    modes = (Mode(TRUE, TAU, -0.5j * DROOP), Mode(TRUE + 700.0, TAU, 0.3j * DROOP))
    gains = [one.gain for one in plate_from_table(to_bytes(ModeTable(250e3, bytes(16), modes))).resonances]
    assert gains[0] == pytest.approx(0.5, rel=1e-3) and gains[1] == pytest.approx(-0.3, rel=3e-3)


@pytest.mark.slow
def test_a_plate_the_table_does_not_fit_is_an_error_that_names_the_fault(emulation) -> None:
    wrong = plate_from_table(TABLE, Assumed(scale=1.1))
    with pytest.raises(EmulationError, match="identify"):
        board_run(TABLE, wrong, share=0.5, seconds=40e-3)


def test_a_damaged_table_is_refused() -> None:
    with pytest.raises(ValueError, match="damaged"):
        board_run(TABLE[:-1] + bytes([TABLE[-1] ^ 1]))
