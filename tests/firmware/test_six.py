"""Six channels on a clamped beam: the core on this machine, the image on the emulated board."""

from __future__ import annotations

import dataclasses
import struct

import numpy as np
import pytest

from firmware import six_lifts
from firmware.client.client import BoardError, Client, describe
from firmware.emulate.plant import Beam, BeamSimulation, _clamped_roots, measured_table
from firmware.injection import (
    BOARD_KINDS,
    SIX_WORDS,
    bits_of,
    break_one_of_six,
    breaking,
    flipping,
    image_rows,
    sensor_kinds,
)
from firmware.mode_table import VERSION, Mode, ModeTable, Pattern, Shape, to_bytes
from firmware.protocol import FAULT, IDENTIFY, IDLE, PROTOCOL, RUN, Fault, Kind, fault_names
from firmware.six_lifts import pressed

TIM1, TIM8 = 0x40010000, 0x40010400
BEAM = Beam(noise=1e-3)
QUICK = dataclasses.replace(BEAM, quality_factor=15.0)  # rings for a third of the time
PATTERNS = (
    Pattern("left", (1, 0.5, 0, 0, 0, 0)),
    Pattern("middle", (0, 0, 1, 1, 0, 0)),
    Pattern("right", (0, 0, 0, 0, 0.5, 1)),
    six_lifts.PATTERNS["travelling, even targets"],
)


def table(frequency_hz: float = 2400.0, matrix: np.ndarray | None = None, **changes) -> bytes:
    rows = None if matrix is None else tuple(tuple(row) for row in matrix.tolist())
    shape = dataclasses.replace(Shape(frequency_hz, BEAM.slowest_s, PATTERNS, rows), **changes)
    return to_bytes(ModeTable(40e3, bytes(range(16)), (), shapes=(shape,)))


def piloted(pattern: Pattern) -> np.ndarray:
    """Targets with the pilot of quiet sensors."""
    targets = np.array(pattern.targets, complex)
    targets[np.abs(targets) < 0.03] = 0.03j
    return targets


def seen_matrix(beam: Beam = BEAM) -> np.ndarray:
    """T as the firmware defines it: the hold's droop and half sample included, the sample of delay not."""
    turn = 2j * np.pi * 2400.0 / beam.sample_rate_hz
    return beam.matrix(2400.0) * (1.0 - np.exp(-turn)) / turn


@pytest.fixture
def hosted(core):
    from tests.helpers.hosted_boards import HostedSix

    return HostedSix


def test_beam_has_the_textbook_frequencies() -> None:
    """k_1 = 4.730, k_2 = 7.853, k_3 = 10.996 (clamped at both ends), w = (k/L)^2 sqrt(E h^2 / 12 rho)."""
    assert _clamped_roots(3) == pytest.approx([4.730041, 7.853205, 10.995608], abs=1e-6)
    assert BEAM.angular[3] / 2.0 / np.pi == pytest.approx(2111.0, abs=1.0)


def test_beam_in_time_is_the_beam_in_frequency() -> None:
    simulation = BeamSimulation(dataclasses.replace(BEAM, noise=0.0))
    turn = 2.0 * np.pi * 2400.0 / BEAM.sample_rate_hz
    drive = np.array([0.5, 0, 0, -0.3, 0, 0])
    result = []
    for n in range(int(12.0 * BEAM.slowest_s * BEAM.sample_rate_hz)):
        result.append(simulation.sense())
        simulation.drive(drive * np.cos(turn * n))
    n = np.arange(len(result) - 1000, len(result))
    phasors = 2.0 * np.mean(np.array(result[-1000:]) * np.exp(-1j * turn * n)[:, None], axis=0)
    assert np.abs(phasors - seen_matrix() @ drive).max() < 1e-3


def test_matrix_is_measured_one_actuator_at_a_time(hosted) -> None:
    board = hosted(table(tau_s=QUICK.slowest_s), QUICK)
    board.run(5e-3)
    assert board.identify() and board.state == IDENTIFY
    board.run_while(IDENTIFY, 15.0)
    board.run(5e-3)
    assert board.state == IDLE and board.app.identified and list(board.duties) == [board.middle] * 6
    assert board.lib.an_six_start(board.app, 0, 0.0) and board.state == RUN
    matrix = np.array([complex(z.re, z.im) for z in board.app.shaping.matrix]).reshape(6, 6)
    assert np.abs(matrix - seen_matrix(QUICK)).max() < 5e-3 * np.abs(seen_matrix(QUICK)).max()
    exact = np.linalg.norm(seen_matrix(QUICK)) * np.linalg.norm(np.linalg.inv(seen_matrix(QUICK)))
    assert board.app.shaping.condition == pytest.approx(exact, rel=0.03)


@pytest.mark.slow
@pytest.mark.parametrize("largest", [0.2, 3.0])
def test_the_plate_is_probed_as_hard_as_it_needs(hosted, largest: float) -> None:
    beam = dataclasses.replace(BEAM, largest=largest)
    board = hosted(table(), beam)
    board.run(5e-3)
    assert board.lib.an_six_start(board.app, 0, 0.1)
    board.run_while(IDENTIFY, 15.0)
    assert board.state == RUN
    matrix = np.array([complex(z.re, z.im) for z in board.app.shaping.matrix]).reshape(6, 6)
    assert np.abs(matrix - seen_matrix(beam)).max() < 0.01 * np.abs(seen_matrix(beam)).max()


def test_no_identification_takes_more_than_a_minute(hosted) -> None:
    """A table may state any decay: glances are those of a quality factor of 1000 at most, and a minute ends them."""
    board = hosted(table(tau_s=9.0), QUICK)
    board.run(5e-3)
    assert board.lib.an_six_start(board.app, 0, 0.1)
    board.run(5e-3)
    assert board.app.probed_s == pytest.approx(1.5 * 1000.0 / (np.pi * 2400.0), rel=0.03)
    board.app.probed_s = 59.9
    board.run_while(IDENTIFY, 1.0)
    assert board.faults == Fault.IDENTIFY and board.state == FAULT


def lively(off: float) -> Beam:
    """A beam of Q = 1000, four times as thick and at four times the frequency as the others; all modes off by a factor."""
    place = {"thickness_m": 4e-3, "frequency_hz": 9.6e3, "young_pa": 210e9 * off**2}
    return dataclasses.replace(BEAM, quality_factor=1000.0, modes=8, noise=1e-5, **place)


@pytest.mark.parametrize("off", [1.03, pytest.param(0.97, marks=pytest.mark.slow)])
def test_a_plate_that_decays_slowly_is_held_within_ten_seconds(hosted, off: float) -> None:
    """Its lowest mode decays within 0.34 s, those near the carrier within 0.03 s: a soft drive leaves the low ones at rest."""
    beam = lively(off)
    board = hosted(table(9.6e3, tau_s=beam.slowest_s), beam)
    board.run(5e-3)
    assert board.lib.an_six_start(board.app, 0, 0.0)
    took_s = board.run_while(IDENTIFY, 10.0)
    assert board.state == RUN and took_s < 1.15 * board.lib.an_six_least_s(board.app) < 10.0
    matrix, true = board.app.shaping.matrix, beam.structure.sampled_matrix(9.6e3)
    measured = np.array([complex(z.re, z.im) for z in matrix]).reshape(6, 6)
    assert np.abs(measured - true).max() < 0.01 * np.abs(true).max()
    assert 0.0 < board.app.misfit < 0.02 and board.app.motion > 0.04


def test_a_matrix_that_does_not_predict_all_actuators_together_is_never_used(hosted) -> None:
    """Here the plate changes while it is measured: a hand, or an amplifier that warms up."""
    board = hosted(table(tau_s=QUICK.slowest_s), QUICK)
    board.run(5e-3)
    assert board.lib.an_six_start(board.app, 0, 0.0)
    while board.app.probe < 3:
        board.run(5e-3)
    board.beam.push = 1.3 * board.beam.push
    board.run_while(IDENTIFY, 10.0)
    board.run(5e-3)
    assert board.state == FAULT and board.faults == Fault.IDENTIFY
    assert board.app.misfit > 0.1 and not board.app.identified and board.app.base.measured == 0


def field_of(board, at_m: np.ndarray) -> np.ndarray:
    return np.abs(BEAM.matrix(2400.0, at_m) @ board.drives)


@pytest.mark.slow
def test_confinement_left_middle_and_right_and_a_travelling_wave(hosted) -> None:
    """Seen along the whole beam, not at the sensors alone: three times as much inside as outside; a wave goes one way."""
    board = hosted(table(matrix=seen_matrix()), BEAM)
    board.run(5e-3)
    at_m = np.linspace(0.0, BEAM.length_m, 301)
    third = (3.0 * at_m / BEAM.length_m).astype(int).clip(0, 2)
    assert board.lib.an_six_start(board.app, 0, 0.0)
    for pattern, zone in ((0, 0), (1, 1), (2, 2), (3, None)):
        if pattern:
            assert board.lib.an_six_change(board.app, pattern)
        board.run(0.5)
        assert board.state == RUN, (pattern, board.faults)
        target = board.app.slow.reference * piloted(PATTERNS[pattern])
        assert np.abs(board.measured - target).max() < 0.02 * np.abs(target).max()
        field = field_of(board, at_m)
        if zone is not None:
            assert field[third == zone].max() > 3.0 * field[third != zone].max()
        else:
            inside = (at_m > BEAM.places_m[0]) & (at_m < BEAM.places_m[-1])
            assert field[inside].min() > 0.58 * field[inside].max()
    board.run(0.05)
    phases = np.unwrap(np.angle(board.measured))
    assert np.polyfit(BEAM.places_m, phases, 1)[0] == pytest.approx(-2.0 * np.pi / six_lifts.WAVELENGTH_M, rel=0.02)


def test_the_integrals_take_out_what_the_matrix_is_wrong_about(hosted) -> None:
    random = np.random.default_rng(1)
    wrong = seen_matrix() * (1.0 + 0.1 * (random.normal(size=(6, 6)) + 1j * random.normal(size=(6, 6))))
    board = hosted(table(matrix=wrong), BEAM)
    board.run(5e-3)
    assert board.lib.an_six_start(board.app, 1, 0.1)
    board.run(0.02)
    early = np.abs(board.measured - 0.1 * piloted(PATTERNS[1])).max()
    board.run(1.2)
    assert board.state == RUN
    assert np.abs(board.measured - 0.1 * piloted(PATTERNS[1])).max() < 0.002 < early


def test_references_beyond_the_drive_are_clipped(hosted) -> None:
    board = hosted(table(matrix=seen_matrix(), drive_limit=0.5), BEAM)
    board.run(5e-3)
    assert board.lib.an_six_start(board.app, 1, 1.0)
    inverse = np.linalg.inv(seen_matrix()) @ piloted(PATTERNS[1])
    assert board.app.reachable == pytest.approx(0.9 * 0.5 / np.abs(inverse).max(), rel=1e-3)
    assert board.app.slow.reference == board.app.reachable
    board.run(0.5)
    assert board.state == RUN and np.abs(board.drives).max() <= 0.5 * (1.0 + 1e-6)


def test_integrals_do_not_grow_while_the_drive_is_limited(hosted) -> None:
    """The matrix claims 1.6 times the true response: the loop asks for more than there is, for ever."""
    board = hosted(table(matrix=1.6 * seen_matrix()), BEAM)
    board.run(5e-3)
    assert board.lib.an_six_start(board.app, 1, 1.0)
    board.run(1.0)
    assert board.state == RUN and board.app.slow.limited
    assert np.abs(board.drives).max() == pytest.approx(1.0, abs=1e-3)
    assert np.abs([complex(z.re, z.im) for z in board.app.slow.integral]).max() < 0.5 * board.app.slow.reference


def test_a_matrix_that_cannot_be_inverted_is_a_fault(hosted) -> None:
    """Two sensors that show the same are one sensor."""
    board = hosted(table(tau_s=5e-3, drive_limit=0.5), BEAM)
    sense = board.sense

    def sensed() -> np.ndarray:
        levels = sense()
        levels[1] = levels[0]
        return levels

    board.sense = sensed
    board.run(5e-3)
    assert board.lib.an_six_start(board.app, 0, 0.0)
    board.run_while(IDENTIFY, 5.0)
    board.run(5e-3)
    assert board.state == FAULT and board.faults == Fault.SHAPING
    assert list(board.duties) == [board.middle] * 6


@pytest.mark.parametrize(
    ("frequency_hz", "accepted"), [(2400.0, True), (2600.0, True), (2110.8, False), (4404.0, False)]
)
def test_condition_decides_what_is_inverted(core, frequency_hz: float, accepted: bool) -> None:
    """On a resonance the rows of T are multiples of one mode's shape."""
    matrix = BEAM.matrix(frequency_hz)
    shaping = core.ffi.new("an_shaping *")
    core.lib.an_shaping_init(shaping, 6)
    for actuator in range(6):
        column = [{"re": z.real, "im": z.imag} for z in matrix[:, actuator].tolist()]
        core.lib.an_shaping_set(shaping, actuator, core.ffi.new("an_complex []", column), 2.0)
    assert core.lib.an_shaping_invert(shaping) == accepted
    exact = np.linalg.inv(2.0 * matrix)
    condition = np.linalg.norm(2.0 * matrix) * np.linalg.norm(exact)
    assert shaping.condition == pytest.approx(condition, rel=1e-3)
    inverse = np.array([complex(z.re, z.im) for z in shaping.inverse]).reshape(6, 6)
    assert np.abs(inverse - exact).max() < 1e-5 * condition * np.abs(exact).max()


def running(hosted, **changes):
    board = hosted(table(matrix=seen_matrix(), **changes), BEAM)
    board.run(5e-3)
    assert board.lib.an_six_start(board.app, 3, 0.15)
    board.run(0.4)
    assert board.state == RUN
    return board


def broken(board, channel: int, change):
    sense = board.sense

    def sensed() -> np.ndarray:
        levels = sense()
        levels[channel] = change(levels[channel])
        return levels

    board.sense = sensed


@pytest.mark.parametrize(
    ("change", "faults"),
    [
        (lambda level: 0.0, Fault.MISMATCH),
        (lambda level: 1.5, Fault.SENSOR_CLIPPED | Fault.SENSOR_OFFSET),
        (lambda level: level + 0.3, Fault.SENSOR_OFFSET),
    ],
)
def test_a_broken_sensor_rests_all_outputs(hosted, change, faults: int) -> None:
    board = running(hosted)
    broken(board, 4, change)
    board.run_while(RUN, 3.0)
    board.run(5e-3)
    assert board.state == FAULT and board.faults & faults and not board.faults & ~faults
    assert list(board.duties) == [board.middle] * 6


@pytest.mark.parametrize("sign", [0.0, -1.0], ids=["dead", "reversed"])
def test_an_outlier_of_the_noise_does_not_stop_the_check(hosted, sign: float) -> None:
    """Seven standard deviations in one sample of a working sensor, which fails half a millisecond later: found in 100 us."""
    board = hosted(measured_table(BEAM), BEAM)
    board.run(5e-3)
    assert board.lib.an_six_start(board.app, 0, 0.1)
    board.run(0.6)
    for channel in range(6):
        with board.undone():
            broken(board, channel, lambda level: level + 7.0 * BEAM.noise)
            board.tick()
            vars(board).pop("sense")
            board.run(0.5e-3)
            broken(board, channel, lambda level: sign * level)
            board.run(100e-6)
            assert board.fast.faults == Fault.MISMATCH, channel


@pytest.mark.slow
def test_a_plate_that_moves_again_is_driven_again(hosted) -> None:
    """A second after the fault and a check, at the same pattern and level; nobody clears it."""
    board = running(hosted)
    pattern, reference = board.app.pattern, board.app.target_reference
    broken(board, 4, lambda level: 0.0)
    assert board.run_while(RUN, 3.0) < 3.0 and board.faults == Fault.MISMATCH
    vars(board).pop("sense")
    board.run(0.9)
    assert board.state == FAULT and list(board.duties) == [board.middle] * 6
    board.run(0.1 + 8.0 * BEAM.slowest_s)
    assert board.state == RUN and board.faults == 0
    assert (board.app.pattern, board.app.target_reference) == (pattern, reference)


@pytest.mark.slow
@pytest.mark.parametrize("sign", [0.0, -1.0], ids=["dead", "reversed"])
def test_a_retry_without_a_sensor_moves_the_plate_no_further(hosted, sign: float) -> None:
    """It ends as the mismatch that it is, at the low level of the check, and T stays."""
    board = running(hosted)
    broken(board, 4, lambda level: sign * level)
    board.run_while(RUN, 3.0)
    board.run_while(FAULT, 1.1)
    board.run(5e-3)
    assert board.state == IDENTIFY and board.app.checking
    largest = 0.0
    while board.state == IDENTIFY:
        board.tick()
        largest = max(largest, np.abs(board.beam.motion).max())
    assert board.state == FAULT and board.faults == Fault.MISMATCH
    assert largest < 0.11 and board.app.base.measured == 0 and board.app.identified == 1


@pytest.mark.parametrize("channel", [0, 4])
@pytest.mark.parametrize("sensor", ["dead", "reversed"])
def test_a_sensor_that_is_to_show_nothing_is_noticed(hosted, sensor: str, channel: int) -> None:
    """A reversed one within 20 time constants, before its place moves half as much as the pattern; a dead one within 40."""
    board = hosted(table(matrix=seen_matrix(QUICK), tau_s=QUICK.slowest_s), QUICK)
    board.run(5e-3)
    assert board.lib.an_six_start(board.app, 1, 0.1)
    board.run(0.3)
    place, quick = np.array([QUICK.places_m[channel]]), QUICK.slowest_s
    broken(board, channel, lambda level: -level if sensor == "reversed" else 0.0)
    largest, waited = 0.0, 0.0
    while board.state == RUN and waited < 60.0 * quick:
        board.run(0.5 * quick)
        waited += 0.5 * quick
        largest = (
            max(largest, np.abs(QUICK.matrix(2400.0, place) @ board.drives).max()) if board.state == RUN else largest
        )
    assert board.state == FAULT and board.faults == Fault.MISMATCH
    assert waited < (20.0 if sensor == "reversed" else 40.0) * quick and largest < 0.05


@pytest.mark.parametrize("reference", [0.02, 0.1])
def test_bridges_that_drive_nothing_are_noticed(hosted, reference: float) -> None:
    """Their supply is off, while their comparators hold the break lines low."""
    board = hosted(table(matrix=seen_matrix(QUICK), tau_s=QUICK.slowest_s), QUICK)
    board.run(5e-3)
    assert board.lib.an_six_start(board.app, 0, reference)
    board.run(0.2)
    board.beam.drive = lambda levels, own=board.beam.drive: own(0.0 * levels)
    assert board.run_while(RUN, 40.0 * QUICK.slowest_s) < 40.0 * QUICK.slowest_s and board.faults == Fault.MISMATCH


@pytest.mark.slow
@pytest.mark.parametrize("wrong", ["nothing", "another plate", "a dead sensor", "a reversed sensor", "a dead bridge"])
def test_a_matrix_from_the_table_is_checked_before_it_is_used(hosted, wrong: str) -> None:
    """All sensors at a tenth of what is reached; what differs is measured again."""
    other = dataclasses.replace(QUICK, frequency_hz=2400.0, length_m=1.15 * QUICK.length_m)
    matrix = seen_matrix(other if wrong == "another plate" else QUICK)
    board = hosted(table(matrix=matrix, tau_s=QUICK.slowest_s), QUICK, confirmed=False)
    if "sensor" in wrong:
        broken(board, 3, lambda level: -level if "reversed" in wrong else 0.0)
    if "bridge" in wrong:
        working = np.array([1.0, 1.0, 0.0, 1.0, 1.0, 1.0])
        board.beam.drive = lambda levels, own=board.beam.drive: own(working * levels)
    board.run(5e-3)
    assert board.lib.an_six_start(board.app, 0, 0.05) and board.state == IDENTIFY and board.app.checking
    checked = board.run_while(IDENTIFY, 15.0)
    board.run(5e-3)
    if wrong == "nothing":
        assert board.state == RUN and checked < 10.0 * QUICK.slowest_s and board.app.base.measured == 0
    elif "dead" in wrong:
        assert board.state == FAULT and board.faults == Fault.SHAPING
    else:
        assert board.state == RUN and board.app.base.measured == 1 and board.app.base.confirmed


@pytest.mark.parametrize("reference", [0.004, 0.03])
@pytest.mark.parametrize("channel", [0, 3, 5])
def test_a_dead_sensor_is_noticed_however_little_is_target(hosted, reference: float, channel: int) -> None:
    """Of a plate that answers weakly the drive reaches its limit, and its integrals stop, long before a tenth of full scale."""
    weak = dataclasses.replace(QUICK, largest=0.05)
    board = hosted(table(matrix=seen_matrix(weak), tau_s=weak.slowest_s), weak)
    board.run(5e-3)
    assert board.lib.an_six_start(board.app, 3, reference)
    board.run(0.1)
    assert board.state == RUN
    broken(board, channel, lambda level: 0.0)
    board.run_while(RUN, 2.0)
    assert board.state == FAULT and board.faults == Fault.MISMATCH


@pytest.mark.parametrize(("share", "eased"), [(0.98, True), (0.9, False)])
def test_a_drive_just_below_its_limit_is_bounded_like_full_drive(hosted, share: float, eased: bool) -> None:
    """A finger that needs so much of it heats the patches as much; the largest reference alone lasts."""
    board = hosted(table(matrix=seen_matrix(), drive_limit=0.5), BEAM)
    board.run(5e-3)
    assert board.lib.an_six_start(board.app, 0, 1.0)
    board.run(0.2)
    board.app.slow.reference *= share / 0.9
    board.run(0.2)
    assert board.state == RUN and not board.app.slow.limited
    board.app.base.full_s += 9.9
    board.run(0.2)
    assert board.state == RUN and board.app.base.eased == eased


@pytest.mark.parametrize("name", six_lifts.PATTERNS)
@pytest.mark.parametrize("finger", [0.0, 1.0])
def test_an_eased_drive_holds_half_the_motion_and_takes_it_up_again(hosted, name: str, finger: float) -> None:
    """Limit and targets fade together, or the sensors would differ from their targets."""
    board = hosted(measured_table(BEAM, six_lifts.PATTERNS[name]), BEAM)
    board.run(5e-3)
    assert board.lib.an_six_start(board.app, 0, 1.0)
    board.run(0.2)
    board.beam.become(pressed(BEAM.structure, finger))
    board.run(0.5)
    before = np.abs(board.measured).max()
    for full_s, share in ((9.999, 0.5), (0.0, 1.0)):
        board.app.base.full_s, board.app.base.eased = full_s, full_s > 0.0
        board.run(0.3)
        assert board.state == RUN, fault_names(board.faults)
        assert np.abs(board.measured).max() == pytest.approx(share * before, rel=0.2)
        assert np.abs(board.drives).max() < 1.01 * share * board.app.shape.drive_limit


def warmed(structure, share: float):
    """By 10 K of aluminium: 0.24 % of each frequency."""
    return dataclasses.replace(structure, angular=structure.angular * (1.0 - 0.0024 * share))


@pytest.mark.parametrize("lift_s", [2e-3, 50e-3])
def test_no_lift_overshoots_by_more_than_a_fifth(hosted, lift_s: float) -> None:
    """At the largest reference; the integrals have adapted to the finger before."""
    board = hosted(table(matrix=seen_matrix()), BEAM)
    board.run(5e-3)
    assert board.lib.an_six_start(board.app, 0, 1.0)
    board.run(0.2)
    board.beam.become(pressed(BEAM.structure, 1.0))
    board.run(0.5)
    assert np.abs(board.measured).max() == pytest.approx(board.app.slow.reference, rel=0.05)
    peak = 0.0
    for i in range(1, 81):
        board.beam.become(pressed(BEAM.structure, max(1.0 - i * 1e-3 / lift_s, 0.0)))
        board.run(1e-3)
        peak = max(peak, np.abs(board.measured).max())
    assert board.state == RUN and peak < 1.2 * board.app.slow.reference


@pytest.mark.parametrize("lift_s", [2e-3, *(pytest.param(lift_s, marks=pytest.mark.slow) for lift_s in (5e-3, 50e-3))])
@pytest.mark.parametrize("name", six_lifts.PATTERNS)
def test_a_finger_that_rests_on_a_pattern_is_no_fault_nor_is_its_lift(hosted, name: str, lift_s: float) -> None:
    """Up to 1.2 times the reference, or within 1.15 of the least possible, in the worst case over a window's moments."""
    pattern = six_lifts.PATTERNS[name]
    own, least = zip(*six_lifts.peaks(pattern, lift_s), strict=True)
    assert max(own) < max(1.2, 1.15 * max(least))
    board = six_lifts.touched(pattern)
    for change_s in (0.0, 0.5):
        if change_s:
            six_lifts.lifted(board, lift_s)
        board.run(change_s)
        assert board.state == RUN and np.abs(board.measured - 0.1 * piloted(pattern)).max() < 0.03 * 0.1


@pytest.mark.slow
@pytest.mark.parametrize("change", [pressed, warmed])
def test_neither_a_finger_nor_warmth_is_a_fault(hosted, change) -> None:
    """Within 50 ms; the integrals bring every sensor back to where it is target."""
    board = hosted(table(matrix=seen_matrix()), BEAM)
    board.run(5e-3)
    assert board.lib.an_six_start(board.app, 0, 0.1)
    board.run(0.2)
    for i in range(1, 11):
        board.beam.become(change(BEAM.structure, i / 10))
        board.run(5e-3)
    early = np.abs(board.measured - 0.1 * piloted(PATTERNS[0])).max()
    board.run(0.8)
    assert board.state == RUN, board.faults
    assert np.abs(board.measured - 0.1 * piloted(PATTERNS[0])).max() < 0.03 * 0.1
    assert early > 0.03 * 0.1 or change is warmed


def test_a_sensor_at_the_rail_is_seen_in_the_next_window(hosted) -> None:
    board = running(hosted)
    broken(board, 2, lambda level: 1.5)
    board.run(3e-3)
    assert board.state == FAULT and board.faults & Fault.SENSOR_CLIPPED


def test_too_much_motion_at_one_sensor_trips(hosted) -> None:
    board = running(hosted)
    broken(board, 2, lambda level: 0.95 / 0.15 * level)
    board.run(5e-3)
    assert board.state == FAULT and board.faults & Fault.AMPLITUDE


def test_a_trip_silences_the_drives_without_waiting_for_the_main_loop(hosted) -> None:
    board = running(hosted)
    period = board.app.window + board.lib.AN_SIX_GAP
    board.samples[3] = 4095
    history = []
    for _ in range(2 * period + board.lib.AN_SIX_GAP):
        board.lib.an_six_tick(board.fast, board.samples, board.duties)
        history.append(list(board.duties))
        if board.fast.tick == 0:
            board.lib.an_six_window_end(board.app)
    assert board.app.slow.hand.trips and board.state == RUN
    assert history[-period:] == [[board.middle] * 6] * period


def test_a_late_slow_step_rests_all_outputs(hosted) -> None:
    board = running(hosted)
    for _ in range(60):
        board.lib.an_six_tick(board.fast, board.samples, board.duties)
    assert board.fast.faults == Fault.SLOW_LATE and list(board.duties) == [board.middle] * 6


@pytest.mark.parametrize("value", [float("nan"), float("inf"), 1e30])
def test_no_drive_that_is_not_a_number_reaches_the_bridges(hosted, value: float) -> None:
    board = running(hosted)
    drive = board.fast.drive[board.fast.acting][2]
    drive.re = drive.im = value
    board.lib.an_six_tick(board.fast, board.samples, board.duties)
    assert board.fast.faults == Fault.NOT_FINITE and board.duties[2] == board.middle


def test_tables_without_shapes_are_refused(hosted) -> None:
    board = hosted(to_bytes(ModeTable(40e3, bytes(16), (Mode(3e3, 3e-3),))), BEAM)
    assert board.state == FAULT and board.faults == Fault.TABLE
    assert not board.lib.an_six_start(board.app, 0, 0.1) and not board.clear()


@pytest.fixture
def make_six(make_image, core):
    pytest.importorskip("unicorn", reason="unicorn is not installed: pip install unicorn")
    from firmware.emulate.images import EmulatedSix

    def make(data: bytes, **options):
        board = EmulatedSix(make_image(data, "six").elf, BEAM, **options)
        board.run(5e-3)
        board.app.base.confirmed = True
        return board

    return make


@pytest.mark.slow
def test_image_fits(make_image) -> None:
    image = make_image(table(), "six")
    assert image.flash_bytes <= 32 * 1024 and image.ram_bytes <= 16 * 1024


@pytest.mark.slow
def test_timers_make_40_khz_with_dead_time_and_trigger_the_scan(make_six) -> None:
    board = make_six(table())
    for timer in (0x40010000, 0x40010400):
        assert board.word(timer).value & 0xE0 == 0xA0  # centre-aligned, preloaded
        assert 180e6 / (2 * board.word(timer + 0x2C).value) == 40e3
        assert board.word(timer + 0x30).value == 1
        assert board.word(timer + 0x20).value == 0x555  # three pairs
        assert 100e-9 < (board.word(timer + 0x44).value & 0x7F) / 180e6 < 1e-6
        assert board.word(timer + 0x44).value >> 12 & 3 == 3 and not board.word(timer + 0x44).value >> 14 & 1
    assert board.word(0x40010404).value >> 4 & 7 == 7  # TIM8's fourth channel goes out as the trigger
    lead_s = (board.word(0x4001042C).value - board.word(0x40010440).value) / 180e6
    assert lead_s == pytest.approx(6 * 1.2e-6 / 2, rel=1e-3)  # so that the counter's end is the middle of the scan
    assert board.word(0x40012008).value >> 24 & 0x3F == 0b011110  # rising edge of TIM8_TRGO
    assert board.word(0x40026414).value in (6, 12)  # one scan or two are left to come
    assert not board.driving


def test_a_halted_core_halts_what_runs_by_itself_and_an_overflowing_stack_faults(make_six) -> None:
    """RM0390, debug freeze registers; dead time and polarities locked; the stack lies below all data, at the RAM's start."""
    board = make_six(table())
    assert board.word(0xE0042004).value & 1  # the clock goes on in sleep, for the probe
    assert (
        board.word(0xE0042008).value == 1 << 12 | 1 << 0 and board.word(0xE004200C).value == 3
    )  # IWDG, TIM2; TIM1, TIM8
    assert board.word(0xE000ED08).value == 0x08000000  # the vectors
    assert all(board.word(timer + 0x44).value >> 8 & 3 == 2 for timer in (TIM1, TIM8))
    assert board.symbol("stack_end") == 0x20000000 and board.symbol("stack_top") <= board.symbol("data_start")


@pytest.mark.slow
def test_pattern_over_the_line_on_the_emulated_board(make_six, core) -> None:
    from firmware.emulate.images import EmulatedPort
    from tests.helpers.board_probes import hear_earlier

    board = make_six(table(matrix=seen_matrix()))
    client = Client(EmulatedPort(board))
    assert client.request(Kind.IDENTITY, parsed=bytes)[:4] == bytes([PROTOCOL, 6, VERSION, 1])
    client.request(Kind.START, struct.pack("<If", 1, 0.15))
    for _ in range(2):
        board.run(0.2)
        client.status()
    assert board.driving and board.state == RUN
    assert np.abs(board.measured - 0.15 * np.array(PATTERNS[1].targets)).max() < 0.005
    status = client.status()
    assert status.state == "run" and status.pattern == 1 and status.frequency_hz == pytest.approx(2400.0, abs=1e-3)
    assert [abs(z) for z in status.sensors] == pytest.approx([0, 0, 0.15, 0.15, 0, 0], abs=0.005)
    assert status.measured in status.sensors[2:4] and status.reachable > status.reference == pytest.approx(0.15)
    assert "matrix condition 1" in describe(status) and "pattern 1" in describe(status)
    client.pattern(2)
    assert client.status().pattern == 2
    with pytest.raises(BoardError, match="out of range"):
        client.request(Kind.PATTERN, struct.pack("<II", 0, 4))
    with pytest.raises(BoardError, match="present state"):
        client.upload(table())
    client.stop()
    board.run(0.15)
    assert board.state == IDLE and not board.driving
    client.choose(0)
    with pytest.raises(BoardError, match="out of range"):
        client.choose(1)
    client.request(Kind.START, struct.pack("<If", 1, 0.15))
    board.run(10e-3)
    hear_earlier(board, 0.44, (board.app.window + core.lib.AN_SIX_GAP) / 40e3)
    board.run(10e-3)
    assert board.state == RUN
    board.run(60e-3)
    assert board.state == FAULT and board.faults == Fault.HOST_SILENT and not board.driving


@pytest.mark.parametrize(("timer", "held_s"), [(TIM1, 0.0), (TIM8, 0.0), (TIM8, 2e-3)])
def test_a_pulled_break_opens_all_switches_until_somebody_clears_it(make_six, timer: int, held_s: float) -> None:
    """Looked at in every tick: both timers' gates open within one, and none closes before the fault is cleared."""
    board = driving(make_six)
    board.pull_break(timer, 1 + round(held_s / board.sample_s))
    for tick in range(800):
        assert board.at_rest, tick
        board.tick()
    assert board.state == FAULT and board.faults == Fault.BREAK
    assert board.clear()
    board.run(5e-3)
    assert board.state == IDLE and board.at_rest
    assert board.call("an_six_start", board.symbol("app"), 1, 0.15) == 1
    board.run(5e-3)
    assert board.driving
    board.pull_break(timer)
    assert board.at_rest


def test_a_line_that_stays_pulled_cannot_be_cleared(make_six) -> None:
    board = driving(make_six)
    board.pull_break(TIM1, 10**6)
    board.run(5e-3)
    assert board.clear()
    board.run(5e-3)
    assert board.state == FAULT and board.faults == Fault.BREAK and board.at_rest


@pytest.mark.parametrize("timer", [TIM1, TIM8])
def test_a_broken_wire_is_a_break(make_six, timer: int) -> None:
    """Nothing holds the line low any more; once it is held again, the fault can be cleared."""
    board = driving(make_six)
    board.unwired[timer] = True
    board.tick()
    assert board.at_rest
    board.run(5e-3)
    assert board.state == FAULT and board.faults == Fault.BREAK
    board.unwired[timer] = False
    board.run(5e-3)
    assert board.at_rest and board.clear()
    board.run(5e-3)
    assert board.state == IDLE


def driving(make_six):
    board = make_six(table(matrix=seen_matrix()))
    assert board.call("an_six_start", board.symbol("app"), 1, 0.15) == 1
    board.run(20e-3)
    assert board.driving
    return board


def test_a_low_supply_and_a_lost_scan_open_the_gates(make_six) -> None:
    for address, bits, fault in ((0x40007004, 1 << 2, Fault.SUPPLY), (0x40012000, 1 << 5, Fault.FAST_LATE)):
        board = make_six(table(matrix=seen_matrix()))
        assert board.call("an_six_start", board.symbol("app"), 1, 0.15) == 1
        board.run(20e-3)
        assert board.driving
        board.word(address).value |= bits
        board.run(5e-3)
        assert board.state == FAULT and board.faults == fault and not board.driving


def test_a_fault_opens_the_gates_in_the_interrupt_that_finds_it(make_six) -> None:
    """The main loop may be busy: neither the fast nor the slow interrupt waits for it."""
    board = make_six(table(matrix=seen_matrix()))
    assert board.call("an_six_start", board.symbol("app"), 1, 0.15) == 1
    board.run(20e-3)
    board.main_stuck = True
    board.word(0x40012000).value |= 1 << 5
    board.tick()
    assert not board.driving
    board.app.fast.faults = 0
    for gate in board.gates:
        gate.value |= 1 << 15
    board.sense = lambda: np.full(6, 1.5)
    board.run(4e-3)
    assert board.app.slow.hand.trips and not board.driving


def test_a_table_goes_up_and_is_used(make_six) -> None:
    from firmware.emulate.images import EmulatedPort

    board = make_six(table(matrix=seen_matrix()))
    client = Client(EmulatedPort(board))
    other = table(2600.0)
    client.upload(other)
    assert bytes(board.sector[: len(other)]) == other and board.resets == 0
    assert set(board.stalls) == {False}
    client.status()
    assert board.app.shape.frequency_hz == 2600.0 and board.state == IDLE and not board.app.identified


def test_a_dead_crystal_keeps_the_gates_open_for_good(make_six) -> None:
    board = make_six(table(matrix=seen_matrix()), dead_crystal=True)
    assert board.state == FAULT and board.faults == Fault.CLOCK and not board.driving
    assert not board.clear()
    assert board.call("an_six_start", board.symbol("app"), 1, 0.15) == 0


def test_flash_memory_that_does_not_take_a_table_is_a_fault(make_six) -> None:
    from firmware.emulate.images import EmulatedPort

    board = make_six(table(matrix=seen_matrix()))
    client = Client(EmulatedPort(board))
    board.flash.broken = True
    with pytest.raises(BoardError, match="could not be stored"):
        client.upload(table(2600.0))
    assert set(client.status().faults) == {"flash", "table"} and not board.driving


def test_a_slow_step_that_hangs_opens_the_gates_and_then_resets_the_chip(make_six) -> None:
    board = make_six(table(matrix=seen_matrix()))
    assert board.call("an_six_start", board.symbol("app"), 1, 0.15) == 1
    board.run(20e-3)
    board.slow_stuck = True
    board.run(3e-3)
    assert not board.driving
    board.run(12e-3)
    assert board.resets == 1 and board.app.base.supervisor.first == Fault.WATCHDOG


@pytest.mark.slow
def test_instructions_a_tick_and_host_and_cortex_m4_alike(make_six, hosted, core) -> None:
    from tests.helpers.board_probes import count_instructions

    data = table(matrix=seen_matrix())
    board, twin = make_six(data), hosted(data, BEAM)
    twin.run(5e-3)
    board.history, twin.history = [], []
    assert board.call("an_six_start", board.symbol("app"), 3, 0.15) == 1
    assert twin.lib.an_six_start(twin.app, 3, 0.15)
    for each in (board, twin):
        each.run(0.1)
    fast = count_instructions(board, lambda: board.run(10e-3), "an_six_tick")["an_six_tick"]
    twin.run(10e-3)
    assert max(fast) <= 300, fast
    assert board.history[1:] == twin.history[: len(board.history) - 1]
    alike = core.ffi.offsetof("an_six", "probed_s") + 4  # what follows holds a pointer
    assert bytes(core.ffi.buffer(board.app, alike)) == bytes(core.ffi.buffer(twin.app, alike))


def test_no_code_is_translated_twice(make_six) -> None:
    from tests.helpers.board_probes import count_translations

    board = driving(make_six)
    board.run(30e-3)
    assert count_translations(board, 5e-3) == 0


def test_tones_too_low_for_the_watchdog_are_refused(hosted) -> None:
    """A window of two periods must end well before a watchdog at its fastest, 97 cycles of 4 at 47 kHz."""
    low = hosted(table(349.0), BEAM)
    assert low.state == FAULT and low.faults == Fault.TABLE
    lowest = hosted(table(350.0), BEAM)
    assert lowest.state == IDLE
    assert (lowest.app.window + lowest.lib.AN_SIX_GAP) / 40e3 < 0.75 * 97 * 4 / 47e3


def test_the_lowest_tone_lives_with_the_fastest_watchdog(make_six) -> None:
    board = make_six(table(350.0, np.eye(6) * 0.5), lsi_hz=47e3)
    assert board.call("an_six_start", board.symbol("app"), 1, 0.1) == 1
    board.run(0.1)
    assert board.resets == 0


def test_a_table_that_resets_the_board_is_left_alone_at_the_fourth_start(make_six) -> None:
    """Whatever hangs the board: the line comes back, and takes another table."""
    from firmware.emulate.images import EmulatedPort

    board = make_six(table(matrix=seen_matrix()))
    for count in range(3):
        board.slow_stuck = True
        assert board.run_until(lambda seen=count: board.resets > seen, 0.05)
        board.slow_stuck = False
    board.run(5e-3)
    client = Client(EmulatedPort(board))
    assert set(client.status().faults) == {"table", "watchdog"}
    assert client.health().watchdog_resets == 3
    client.upload(table(2600.0))
    assert client.status().faults == ("watchdog",)
    client.clear()
    board.run(5e-3)
    assert client.status().state == "idle" and board.app.shape.frequency_hz == 2600.0


def test_a_scan_that_overran_is_set_going_again(make_six) -> None:
    """After an overrun the DMA stream takes no more samples until it is set up anew: no interrupt would ever come."""
    from tests.helpers.board_probes import overrun

    board = driving(make_six)
    overrun(board)
    board.run(100e-6)
    assert board.at_rest
    board.run(10e-3)
    assert board.resets == 0
    assert board.state == FAULT and board.faults == Fault.FAST_LATE
    assert board.clear()
    board.run(5e-3)
    assert board.state == IDLE


def test_a_new_pattern_keeps_the_reference(hosted) -> None:
    board = running(hosted)
    board.lib.an_six_set_reference(board.app, 0.05)
    assert board.lib.an_six_change(board.app, 1)
    assert board.app.slow.reference == pytest.approx(0.05)


GO_WRONG = BOARD_KINDS | {"break": lambda board: board.pull_break()}


@pytest.mark.parametrize("what", GO_WRONG)
def test_the_gates_open_within_100_us_of_what_an_interrupt_can_see(make_six, what: str) -> None:
    """At each of five ticks of a window; main loop and slow step may be busy."""
    board = driving(make_six)
    (row,) = image_rows(board, {what: breaking(GO_WRONG[what])}, 5 * 7 * board.sample_s, 7)
    assert row.moments == 5 and row.is_sound, row.text


@pytest.mark.slow
def test_the_gates_open_within_100_us_of_a_sensor_that_fails(make_six) -> None:
    """Any of the six, each kind of failure, at each of twelve ticks of a window; what else rings has rung out."""
    board = make_six(table(matrix=seen_matrix()))
    assert board.call("an_six_start", board.symbol("app"), 3, 0.15) == 1
    board.run(0.2)
    trials = {what: breaking(go_wrong) for what, go_wrong in sensor_kinds(break_one_of_six).items()}
    for row in image_rows(board, trials, 12 * 17 * board.sample_s, 17):
        assert row.moments == 12 and row.is_sound, row.text


@pytest.mark.parametrize("frequency_hz", [1360.0, 3400.0])
def test_patterns_that_change_textures_and_knocks_are_no_failing_sensors(hosted, frequency_hz: float) -> None:
    """A knock is a jump of every mode's motion, as large as what is driven."""
    beam = dataclasses.replace(BEAM, frequency_hz=frequency_hz)
    board = hosted(measured_table(beam), beam)
    assert board.lib.an_six_start(board.app, 0, 0.1)
    random = np.random.default_rng(1)
    for turn in range(8):
        board.run(20e-3)
        board.lib.an_six_change(board.app, turn % 2)
        board.lib.an_six_set_reference(board.app, random.uniform(0.02, 0.1))
        kick = random.normal(0.0, 0.02, board.beam.state.shape) / np.arange(1, len(board.beam.state) + 1)
        board.beam.state = board.beam.state + kick / np.abs(board.beam.pull).max()
    assert board.state == RUN, hex(board.faults)


def test_samples_that_come_back_after_a_standstill_find_a_latched_fault(make_six) -> None:
    board = driving(make_six)
    board.fast_lost = True
    board.run(500e-6)
    board.fast_lost = False
    board.run(10e-3)
    assert board.resets == 0 and board.at_rest
    assert board.state == FAULT and board.app.base.supervisor.first == Fault.FAST_LATE


def test_no_flipped_bit_leaves_the_image_a_job_that_cannot_be_ended(make_six, core) -> None:
    board = driving(make_six)
    flips = {"flipped bit": flipping(bits_of(core.ffi, "an_six", SIX_WORDS))}
    (row,) = image_rows(board, flips, 12 * 7 * board.sample_s, 7)
    assert row.moments == 12 and row.is_sound, row.text
    assert row.latched and row.held


def test_a_stop_is_no_failing_sensor(make_six) -> None:
    """The gates open at once, up to a window before the loop rests: what the beam shows then is its own."""
    board = make_six(measured_table(BEAM))
    assert board.start(0, 0.1)
    board.run(0.2)
    for _ in range(8):
        board.run(7 * board.sample_s)
        with board.undone():
            board.app.base.supervisor.stopping = True
            board.run(5e-3)
            assert board.at_rest and board.state == IDLE and board.faults == 0


def middle_held(hosted):
    """The middle pattern is a small difference of the slow modes' large motions."""
    board = hosted(table(matrix=seen_matrix()), BEAM)
    board.run(5e-3)
    assert board.lib.an_six_start(board.app, 1, 0.9)
    board.run(0.3)
    assert board.state == RUN
    return board


def largest_motion(board, seconds: float) -> float:
    largest = 0.0
    for _ in range(round(seconds * board.sample_rate_hz)):
        board.tick()
        largest = max(largest, np.abs(board.beam.sense()).max())
    return largest


def test_a_stop_fades_the_pattern_out(hosted) -> None:
    """Gates that open at once let the plate ring to four times its level."""
    board = middle_held(hosted)
    level = largest_motion(board, 5e-3)
    board.stop()
    assert largest_motion(board, 0.3) < 1.3 * level
    assert board.state == IDLE and board.faults == 0 and list(board.duties) == [board.middle] * 6
    assert np.abs(board.measured).max() < 0.05 * level


def test_a_stop_never_waits_longer_than_half_a_second(hosted) -> None:
    """Nor for a plate that, by its table, decays within seconds."""
    board = hosted(table(matrix=seen_matrix(), tau_s=8.0), BEAM)
    board.run(5e-3)
    assert board.lib.an_six_start(board.app, 1, 0.3)
    board.run(0.1)
    board.stop()
    assert 0.45 < board.run_while(RUN, 1.0) < 0.51


def test_a_plate_that_a_fault_lets_ring_beyond_the_sensors_has_no_other_fault(hosted) -> None:
    """The gates open at once, which sets the slow modes free."""
    board = middle_held(hosted)
    board.fast.faults |= Fault.BREAK
    assert largest_motion(board, 20e-3) > 1.0 and board.faults == Fault.BREAK
    board.run(9.0 * BEAM.slowest_s)
    assert board.clear()
    board.run(5e-3)
    assert board.state == IDLE and board.faults == 0
    broken(board, 2, lambda level: 1.5)
    board.run(3e-3)
    assert board.state == FAULT and board.faults == Fault.SENSOR_CLIPPED


def test_no_damaged_count_lets_a_clipped_sensor_drive(hosted) -> None:
    board = running(hosted)
    broken(board, 2, lambda level: 1.5)
    board.app.slow.ringing = 2**31
    board.run(1e-4)
    assert board.fast.faults & Fault.SENSOR_CLIPPED


def test_an_index_that_was_damaged_leads_nowhere(hosted) -> None:
    """Of the banks and channels that the interrupts go through: mended and told within a sample."""
    board = running(hosted)
    fast, slow = board.app.fast, board.app.slow
    places = (
        (fast, "acting"),
        (fast, "growing"),
        (fast.command, "bank"),
        (fast.window, "bank"),
        (board.app, "channels"),
        (slow.jobs[0], "channels"),
        (slow.jobs[1], "channels"),
    )
    for where, name in places:
        fast.faults = 0
        setattr(where, name, 7)
        board.lib.an_six_tick(board.fast, board.samples, board.duties)
        assert name != "acting" or list(board.duties) == [board.middle] * 6
        assert board.lib.an_six_check(board.app) == Fault.MEMORY, name
        assert getattr(where, name) <= 6 and board.lib.an_six_check(board.app) == 0, name


DAMAGED = (
    "fast.end",
    "fast.growing",
    "fast.phase",
    "fast.step",
    "fast.tick",
    "slow.hand.active",
    "slow.hand.posted",
    "slow.mismatched",
)


@pytest.mark.parametrize("word", DAMAGED)
def test_what_acts_is_compared_with_what_was_commanded(hosted, word: str) -> None:
    """The next sample's look does: every bit of the tick and of the bank in use, the others' from the first that harms."""
    board = running(hosted)
    while board.fast.tick < 10:
        board.tick()
    saved = bytes(board.ffi.buffer(board.app))
    *path, name = word.split(".")
    where = board.app
    for part in path:
        where = getattr(where, part)

    def faults() -> int:
        board.lib.an_six_tick(board.fast, board.samples, board.duties)
        return board.lib.an_six_check(board.app) | board.lib.an_six_look(board.app, board.samples)

    assert faults() == 0
    first = {"fast.end": 5, "fast.growing": 0, "fast.tick": 0, "slow.mismatched": 11}.get(word, 10)
    for bit in range(first, 32):
        board.ffi.buffer(board.app)[:] = saved
        setattr(where, name, getattr(where, name) ^ 1 << bit)
        assert faults() & Fault.MEMORY, bit
