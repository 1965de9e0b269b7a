"""Rows of `python -m firmware.injection` that firmware.injection_jobs has for one mode, for six channels on this machine.

A finger leaves a held pattern, or all modes begin to soften or stiffen; a sensor fails during a retry; a hand stays
through all retries; faults, clipped sensors and flipped bits come while the matrix is measured. The beam rings for a
third of the time of the standard one.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np

from firmware.emulate.plant import Beam, measured_table
from firmware.host.hosted import HostedSix
from firmware.injection_jobs import LIFT_STEPS, LIFTED_MOST, LIFTED_S, NEAR, STIFFER
from firmware.injection_rig import FLIPPED_FURTHER, FURTHER, SIX_WORDS, TRIPS, Row, bits_of
from firmware.injection_trials import Trial, break_one_of_six, breaking, flipping, image_rows
from firmware.mode_table import ModeTable, Pattern, Shape, to_bytes
from firmware.protocol import FAULT, IDENTIFY, IDLE, RUN, fault_names
from firmware.six_lifts import REFERENCE, pressed, require_held, started

BEAM = Beam(noise=1e-3, quality_factor=15.0)
STRIDE = 17
FOLLOWED, TRIED = 12.0, 60.0  # time constants: a change, a try under a hand
HEAVY, RINGING = 100.0, 60.0  # times the damping, of a beam of a quality factor that leaves every mode a frequency
FOUND = 8.0  # time constants until the check of a retry has found a failed sensor


def held(beam: Beam = BEAM) -> HostedSix:
    """Make a board that holds the same amplitude at all sensors. Raises NoCompiler."""
    board = started(measured_table(beam), beam)
    board.run(FOLLOWED * beam.slowest_s)
    require_held(board)
    return board


def _follow(board: HostedSix, seconds: float) -> tuple[float, float]:
    """Advance by a time, and return the largest motion of a sensor's place over the level, and the largest drive."""
    moved = drive = 0.0
    for _ in range(round(seconds * board.sample_rate_hz)):
        board.tick()
        if board.fast.tick == 0:
            drive = max(drive, float(abs(board.drives).max()))
        moved = max(moved, float(abs(board.beam.motion).max()))
    return moved / REFERENCE, drive


def _moments(board: HostedSix, moments: int, stride: int) -> Iterator[None]:
    for _ in range(moments):
        board.run(stride * board.sample_s)
        with board.undone():
            yield


def _held_row(what: str, board: HostedSix, moments: int, stride: int, most: float, change: Callable[[], float]) -> Row:
    """Row of a change after which every sensor is at its target again, with at most `most` times its motion."""
    kept, largest, drive = 0, 0.0, 0.0
    _, own = _follow(board, 5e-3)
    for _ in _moments(board, moments, stride):
        peak = change()
        after, driven = _follow(board, FOLLOWED * BEAM.slowest_s)
        peak = max(peak, after)
        kept += board.state == RUN and peak <= most and bool(abs(board.measured - REFERENCE).max() < NEAR * REFERENCE)
        largest, drive = max(largest, peak), max(drive, driven)
    return Row(f"six channels: {what}", moments, 0, kept, 0.0, 0.0, (drive, own, largest))


def lift_row(moments: int, stride: int) -> Row:
    """Row of a finger that lifts."""
    board = held()
    board.beam.become(pressed(BEAM.structure))
    board.run(FOLLOWED * BEAM.slowest_s)

    def lift() -> float:
        peak = 0.0
        for step in range(1, LIFT_STEPS + 1):
            board.beam.become(pressed(BEAM.structure, 1.0 - step / LIFT_STEPS))
            peak = max(peak, _follow(board, LIFTED_S / LIFT_STEPS)[0])
        return peak

    return _held_row("a finger lifts within 10 ms", board, moments, stride, LIFTED_MOST, lift)


def softening_row(name: str, half_bandwidths: float, moments: int, stride: int) -> Row:
    """Row of modes whose frequencies begin to shift with their amplitudes, by as much at the held level."""
    board = held()
    rate = board.beam.beam.angular / (2.0 * BEAM.quality_factor)
    sizes = np.zeros(len(rate))
    for _ in range(200):
        board.tick()
        sizes += abs(board.beam.state) / 200.0

    def soften() -> float:
        board.beam.softening = half_bandwidths * rate / board.sample_rate_hz / sizes
        return 0.0

    return _held_row(f"plate {name} by a half-bandwidth", board, moments, stride, FLIPPED_FURTHER, soften)


def _wait(board: HostedSix) -> None:
    """Skip the rest of the wait for a retry, once the beam has rung down."""
    board.run(FOLLOWED * BEAM.slowest_s)
    retry = board.app.base.retry
    retry.since = (retry.since - round(10.0 * board.sample_rate_hz / board.fast.end)) % 2**32
    while board.state == FAULT or retry.due:
        board.run(1e-3)


def retrying() -> HostedSix:
    """Make a board whose retry has just begun, its sensor working again."""
    board = held()
    with_sensor = board.sense
    break_one_of_six(board, "dead")
    while board.state == RUN:
        board.tick()
    board.run(5e-3)
    board.sense = with_sensor  # type: ignore[method-assign]
    _wait(board)
    return board


def retry_rows(moments: int, stride: int) -> Iterator[Row]:
    """Yield rows of sensors that fail during a retry, and of a hand that stays."""
    for how in ("dead", "stuck", "reversed"):
        yield retry_row(how, moments, stride)
    yield hand_row(max(moments // 20, 1), stride)


def retry_row(how: str, moments: int, stride: int) -> Row:
    """Row of a sensor that fails while a retry checks the plate."""
    board, found_s = retrying(), FOUND * BEAM.slowest_s
    latched, late, moved, drive = 0, 0.0, 0.0, 0.0
    for _ in _moments(board, moments, stride):
        break_one_of_six(board, how)
        ticks = 0
        while not (board.fast.faults and board.at_rest) and ticks < found_s * board.sample_rate_hz:
            peak, driven = _follow(board, board.sample_s)
            moved, drive, ticks = max(moved, peak), max(drive, driven), ticks + 1
        board.run(5e-3)
        latched += board.state == FAULT and board.at_rest and moved <= FURTHER
        late = max(late, ticks * board.sample_s)
    what = f"six channels: sensor {how}, during a retry"
    return Row(what, moments, latched, 0, late, found_s, (drive, drive, moved))


def hand_row(moments: int, stride: int) -> Row:
    """Row of a hand that stays until the board gives up; the waits are skipped."""
    beam = replace(BEAM, quality_factor=RINGING)
    board = held(beam)
    longest, ended = 0.0, 0
    for _ in _moments(board, moments, stride):
        board.beam.become(replace(beam.structure, quality_factor=RINGING / HEAVY))
        tried = 0.0
        while board.state != IDLE and tried < 4.0 * TRIED * BEAM.slowest_s:
            tried += board.run_while(RUN, 1.0) + board.run_while(IDENTIFY, 1.0)
            board.run(5e-3)
            if board.state == FAULT:
                _wait(board)
        longest = max(longest, tried)
        ended += board.state == IDLE and board.at_rest and board.app.base.retry.gave_up != 0
    what = "six channels: a hand of 100 times the damping stays (given up; longest drive of all tries)"
    return Row(what, moments, ended, 0, longest, 4.0 * TRIED * BEAM.slowest_s)


def measuring() -> HostedSix:
    """Make a board that measures its matrix."""
    shape = Shape(BEAM.frequency_hz, BEAM.slowest_s, (Pattern("all", (1.0,) * 6),))
    board = started(to_bytes(ModeTable(BEAM.sample_rate_hz, bytes(16), shapes=(shape,))), BEAM)
    board.run(60e-3)
    return board


def _trip(fault: int, board: Any) -> None:
    board.fast.faults |= fault


def measuring_rows(seconds: float, stride: int) -> Iterator[Row]:
    """Yield rows of faults, clipped sensors and flipped bits while the matrix is measured."""
    board = measuring()
    kinds: dict[str, Trial] = {fault_names(fault)[0]: breaking(partial(_trip, int(fault))) for fault in TRIPS}
    kinds["sensor clipped"] = breaking(partial(break_one_of_six, how="clipped"))
    kinds["flipped bit"] = flipping(bits_of(board.ffi, "an_six", SIX_WORDS))
    trials = {f"six channels: {what}, while T is measured": trial for what, trial in kinds.items()}
    yield from image_rows(board, trials, seconds, stride)


def rows(seconds: float) -> Iterator[Row]:
    """Yield all rows; moments follow from the length of the run."""
    moments = max(round(seconds * 40), 2)
    yield lift_row(moments, STRIDE)
    for name, half_bandwidths in STIFFER:
        yield softening_row(name, half_bandwidths, moments, STRIDE)
    yield from retry_rows(moments, STRIDE)
    yield from measuring_rows(min(seconds, 0.2), STRIDE)
