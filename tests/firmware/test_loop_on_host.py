"""The whole single-mode application, on this machine, against a simulated plate: identify, run, step, detune, fail."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest

from firmware.emulate.plant import Plate, Resonance
from firmware.mode_table import Mode, ModeTable, hold, to_bytes
from firmware.protocol import FAULT, IDENTIFY, IDLE, RUN, Fault

GUESS, TRUE, QUALITY, GAIN = 31400.0, 31437.3, 300.0, 0.8
TAU = QUALITY / math.pi / TRUE
PLATE = Plate(
    (
        Resonance(TRUE, TAU, GAIN),
        Resonance(TRUE - 800.0, TAU, 0.03),
        Resonance(TRUE + 1100.0, TAU, -0.04),
    ),
    delay_s=7.3e-6,
    noise=1e-3,
    offset=0.03,
)
DROOP = abs(hold(TRUE, 250e3))
PERIOD, HALF_WINDOW = 200e-6, 92e-6


def table(**changes) -> bytes:
    mode = Mode.from_quality_factor(GUESS, 260.0, delay_s=2e-6)
    return to_bytes(ModeTable(250e3, bytes(16), (replace(mode, **changes),)))


def known_table(**changes) -> bytes:
    exact = {"frequency_hz": TRUE, "tau_s": TAU, "gain": -1j * GAIN * DROOP, "delay_s": 9.3e-6}
    return table(**({"frequency_identified": True} | exact | changes))


@pytest.fixture
def hosted(core):
    from tests.helpers.hosted_boards import HostedSingle

    return HostedSingle


@pytest.fixture
def swept(core):
    """A plate in C, a hundred times as quick: for what takes seconds of the board's time; identified when it comes back."""
    from tests.helpers.hosted_boards import Rig

    def make(data: bytes, plate: Plate, seconds: float, reference: float = 0.0) -> Rig:
        board = Rig(data, plate)
        board.run(2e-3)
        assert board.state == IDLE and board.rig.code == 2048
        assert board.start(reference)
        assert board.state == IDENTIFY
        board.run_while(IDENTIFY, seconds)
        return board

    return make


def gain_of(board) -> complex:
    return complex(board.app.mode.gain.re, board.app.mode.gain.im)


@pytest.fixture
def settled(hosted):
    """Running at rest: reference zero, ringing gone."""

    def make(plate: Plate = PLATE, data: bytes | None = None, detuning_hz: float = 0.0):
        board = hosted(data or known_table(), plate)
        board.run(1e-3)
        assert board.start(0.1, detuning_hz)
        board.lib.an_single_set_reference(board.app, 0.0)
        board.run(2e-3)
        assert board.state == board.lib.AN_STATE_RUN
        board.reports.clear()
        return board

    return make


def test_unidentified_gain_is_swept_before_the_loop_closes(swept) -> None:
    board = swept(table(), PLATE, 3.0)
    assert board.state == RUN
    mode = board.app.mode
    assert board.lib.an_dds_frequency(board.app.centre, 250e3) == pytest.approx(TRUE, abs=0.1)
    assert mode.tau_s == pytest.approx(TAU, rel=5e-3)
    assert abs(gain_of(board)) == pytest.approx(GAIN * DROOP, rel=5e-3)
    assert mode.delay_s == pytest.approx(9.3e-6, abs=5e-8)
    assert gain_of(board).real == pytest.approx(0.0, abs=1e-3)
    measured = board.windows(20e-3)["measured"]
    assert board.state == RUN
    assert measured[-1] == pytest.approx(0.2 * GAIN * DROOP, rel=0.02)


@pytest.mark.parametrize("flags", [{"gain": -0.5j}, {"frequency_identified": True, "tau_identified": True}])
def test_what_was_only_computed_is_measured_first(hosted, flags: dict) -> None:
    board = hosted(table(**flags), PLATE)
    board.run(1e-3)
    assert board.start() and board.state == IDENTIFY


@pytest.mark.parametrize("gains", [(0.48, -0.6), (-0.7, 0.3)])
def test_strong_neighbours_slow_the_loop_instead_of_upsetting_it(swept, gains: tuple[float, float]) -> None:
    neighbours = (Resonance(TRUE - 700.0, TAU, gains[0]), Resonance(TRUE + 900.0, TAU, gains[1]))
    board = swept(table(), replace(PLATE, resonances=(PLATE.resonances[0], *neighbours)), 4.0, 0.1)
    assert board.app.neighbour == pytest.approx(max(map(abs, gains)) * DROOP, rel=0.15)
    measured = board.windows(0.2)["measured"]
    assert board.state == RUN
    assert measured[-1] == pytest.approx(0.1, rel=0.03)


def step_response(board, reference: float, seconds: float = 20e-3) -> list[float]:
    board.lib.an_single_set_reference(board.app, reference)
    board.run(seconds)
    return [abs(measured) for measured, _, _ in board.reports]


@pytest.mark.parametrize("detuning_hz", [0.0, 300.0, -300.0])
def test_a_small_step_is_fast_and_does_not_overshoot(settled, detuning_hz: float) -> None:
    plate = replace(PLATE, resonances=PLATE.resonances[:1], noise=0.0)
    share = 0.2 / abs(1 + 2j * math.pi * detuning_hz * TAU)
    reference = share * GAIN * DROOP
    size = step_response(settled(plate, detuning_hz=detuning_hz), reference)
    first = next(i for i, value in enumerate(size) if value >= 0.95 * reference)
    assert (first + 1) * PERIOD - HALF_WINDOW <= 2.0e-3  # from the change of the reference to the middle of the window
    assert max(size) <= 1.02 * reference
    assert size[-1] == pytest.approx(reference, rel=2e-3)


def test_recovery_from_saturation_is_near_the_bound(settled) -> None:
    reference = 0.6 * GAIN * DROOP
    size = step_response(settled(replace(PLATE, noise=0.0)), reference)
    bound = -TAU * math.log(1.0 - 0.95 * 0.6)
    settled_at = max(i for i, value in enumerate(size) if abs(value - reference) > 0.05 * reference) + 1
    assert settled_at * PERIOD <= 1.5 * bound


def trip(board, seconds: float = 0.1) -> int:
    board.run_while(board.lib.AN_STATE_RUN, seconds)
    assert board.state == board.lib.AN_STATE_FAULT
    board.run(1e-3)
    assert board.code == board.lib.AN_DAC_MIDDLE
    return board.faults


def test_a_lost_sensor_trips(settled) -> None:
    board = settled()
    step_response(board, 0.12)
    board.sense = lambda: 0.0
    assert trip(board) == Fault.MISMATCH


def test_a_reversed_sensor_trips(settled) -> None:
    board = settled(data=known_table(gain=1j * GAIN * DROOP))
    board.lib.an_single_set_reference(board.app, 0.12)
    assert trip(board) == Fault.MISMATCH


def test_a_sensor_at_the_rail_trips_at_once(settled) -> None:
    board = settled()
    board.sense = lambda: 2.0
    assert trip(board, 1e-3) == Fault.SENSOR_CLIPPED | Fault.SENSOR_OFFSET


def test_a_trip_silences_the_drive_without_waiting_for_the_main_loop(settled) -> None:
    board = settled()
    board.lib.an_single_set_reference(board.app, 0.12)
    board.run(10e-3)
    codes = []
    for _ in range(2 * board.lib.AN_PERIOD + board.lib.AN_GAP):
        codes.append(board.lib.an_fast_tick(board.fast, 4095))
        if board.fast.tick == 0:
            board.lib.an_single_slow(board.app)
    assert board.slow.hand.trips and board.state == board.lib.AN_STATE_RUN
    assert set(codes[-board.lib.AN_PERIOD :]) == {board.lib.AN_DAC_MIDDLE}


def test_a_fault_of_the_fast_tick_silences_the_drive_without_the_main_loop(settled) -> None:
    board = settled()
    board.lib.an_single_set_reference(board.app, 0.12)
    board.run(10e-3)
    board.fast.faults = Fault.FAST_LATE
    codes = []
    for _ in range(2 * board.lib.AN_PERIOD + board.lib.AN_GAP):
        codes.append(board.lib.an_fast_tick(board.fast, 2048))
        if board.fast.tick == 0:
            board.lib.an_single_slow(board.app)
    assert set(codes[-board.lib.AN_PERIOD :]) == {board.lib.AN_DAC_MIDDLE}


def test_a_fault_of_the_main_loop_rests_the_output_with_the_next_sample(settled) -> None:
    """At any tick of a window: a silent host, a mismatch and a failed measurement do not wait for its end."""
    board = settled()
    board.lib.an_single_set_reference(board.app, 0.12)
    for ticks in (500, 3, 17):
        for _ in range(ticks):
            board.tick()
        board.lib.an_application_fail(board.base, board.build, Fault.HOST_SILENT)
        for _ in range(2 * board.lib.AN_PERIOD):
            board.tick()
            assert board.code == board.lib.AN_DAC_MIDDLE
        assert board.state == board.lib.AN_STATE_FAULT and board.faults == Fault.HOST_SILENT
        assert board.clear()
        board.run(1e-3)
        assert board.start(0.12)
        board.run(5e-3)


def test_an_offset_alone_trips(settled) -> None:
    board = settled(replace(PLATE, noise=0.0))
    board.sense = lambda: 0.3
    assert trip(board, 1e-3) == Fault.SENSOR_OFFSET


def test_too_much_motion_trips(settled) -> None:
    board = settled(data=known_table(amplitude_limit=0.3))
    sense = board.sense
    board.lib.an_single_set_reference(board.app, 0.25)
    board.run(10e-3)
    board.sense = lambda: 1.6 * sense()
    assert trip(board, 5e-3) & Fault.AMPLITUDE


def test_a_slow_step_that_does_not_end_in_its_gap_trips(settled) -> None:
    board = settled()
    board.lib.an_single_set_reference(board.app, 0.12)
    board.run(10e-3)
    codes = [board.lib.an_fast_tick(board.fast, 2048) for _ in range(60)]
    assert board.fast.faults == Fault.SLOW_LATE
    assert codes[-1] == 2048
    board.lib.an_single_slow(board.app)
    assert board.lib.an_single_check(board.app) == 0  # late is not damaged
    board.poll()
    assert board.faults == Fault.SLOW_LATE


@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf, 1e30])
def test_no_drive_that_is_not_a_number_reaches_the_converter(settled, value: float) -> None:
    board = settled()
    board.fast.drive.re = value
    board.fast.drive.im = value
    assert board.lib.an_fast_tick(board.fast, 2048) == 2048
    assert board.fast.faults == Fault.NOT_FINITE


def test_no_state_that_is_not_a_number_reaches_the_converter(settled) -> None:
    board = settled()
    board.slow.pi.integral.re = math.nan
    assert trip(board, 1e-3) & Fault.NOT_FINITE


def test_a_fault_is_latched_until_cleared(settled) -> None:
    board = settled()
    sense = board.sense
    board.sense = lambda: 2.0
    trip(board, 1e-3)
    board.sense = sense
    board.run(5e-3)
    assert board.state == board.lib.AN_STATE_FAULT
    assert not board.start(0.1)
    assert board.clear()
    board.run(1e-3)
    assert board.state == board.lib.AN_STATE_IDLE and board.faults == 0
    assert board.start(0.1)


def test_a_fault_that_persists_comes_back_after_clearing(settled) -> None:
    board = settled()
    board.sense = lambda: 2.0
    trip(board, 1e-3)
    assert board.clear()
    board.run(1e-3)
    assert board.state == board.lib.AN_STATE_FAULT


@pytest.mark.parametrize("data", [b"\xff" * 4096, to_bytes(ModeTable(200e3, bytes(16), (Mode(31e3, 3e-3),)))])
def test_without_a_sound_table_nothing_starts_or_clears(hosted, data: bytes) -> None:
    board = hosted(data, PLATE)
    board.run(1e-3)
    assert board.state == board.lib.AN_STATE_FAULT and board.faults == Fault.TABLE
    assert not board.clear() and not board.start(0.1)
    assert board.code == 2048


def test_faults_of_the_board_are_kept(hosted) -> None:
    board = hosted(known_table(), PLATE, faults=Fault.CLOCK)
    assert board.state == board.lib.AN_STATE_FAULT
    assert not board.clear()


def test_stop_rests_within_two_windows(settled) -> None:
    board = settled()
    step_response(board, 0.12)
    board.stop()
    board.run(3 * PERIOD)
    assert board.state == board.lib.AN_STATE_IDLE and board.code == 2048


def test_a_plate_without_resonance_fails_to_identify(swept) -> None:
    board = swept(table(), replace(PLATE, resonances=(Resonance(60e3, 1e-4, 0.3),)), 6.0)
    assert board.state == FAULT and board.faults == Fault.IDENTIFY


def test_noise_is_not_taken_for_a_resonance(swept) -> None:
    board = swept(table(), replace(PLATE, resonances=(Resonance(TRUE, TAU, 1e-4),), noise=0.05), 8.0)
    assert board.state == FAULT and board.faults == Fault.IDENTIFY


@pytest.mark.parametrize("half_gap_hz", [30.0, 50.0, 80.0])
def test_two_resonances_in_one_are_not_vouched_for(swept, half_gap_hz: float) -> None:
    pair = tuple(Resonance(TRUE + side * half_gap_hz, TAU, 0.4) for side in (-1.0, 1.0))
    board = swept(table(), replace(PLATE, resonances=pair), 8.0)
    assert board.state == FAULT and board.faults == Fault.IDENTIFY


@pytest.mark.parametrize("quality_factor", [100.0, 900.0])
def test_a_badly_guessed_quality_is_found_and_the_sweep_repeated(swept, quality_factor: float) -> None:
    board = swept(table(tau_s=quality_factor / math.pi / GUESS), PLATE, 12.0)
    assert board.state == RUN
    assert board.app.mode.tau_s == pytest.approx(TAU, rel=5e-3)
    assert abs(gain_of(board)) == pytest.approx(GAIN * DROOP, rel=5e-3)


def test_a_very_responsive_plate_is_probed_with_less(swept) -> None:
    board = swept(table(), replace(PLATE, resonances=(Resonance(TRUE, TAU, 60.0),)), 4.0)
    assert board.state == RUN
    assert abs(gain_of(board)) == pytest.approx(60.0 * DROOP, rel=0.02)


def test_values_out_of_range_do_not_start(hosted) -> None:
    board = hosted(known_table(), PLATE)
    board.run(1e-3)
    for reference, detuning_hz in ((-0.1, 0), (1.1, 0), (math.nan, 0), (0.1, 501), (0.1, math.nan)):
        assert not board.start(reference, detuning_hz)
    assert board.state == board.lib.AN_STATE_IDLE
