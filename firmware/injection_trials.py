"""Trials of the fault injection: faults that are injected into a board of either build, and what must follow.

A board is an emulated image, or an application on this machine.
"""

from __future__ import annotations

import ctypes
from collections.abc import Callable, Iterator
from functools import partial
from typing import Any, NamedTuple

from firmware.injection_rig import SENSORS, Row, drawn
from firmware.protocol import FAULT, IDENTIFY, IDLE, RUN, fault_names

SAFE_S, FOLLOWED_S, STOPPED_S = 100e-6, 5e-3, 3e-3
WATCHED = 100  # ticks, at least two windows of either build

Break = Callable[[Any], object]


def _stop_samples(board: Any) -> None:
    board.fast_lost = True


def _lose_interrupt(board: Any) -> None:
    board.fast_lost = True
    board.tick()
    board.fast_lost = False


def _lower_supply(board: Any) -> None:
    board.word(0x40007004).value |= 1 << 2


def _damage(board: Any) -> None:
    board.app.fast.tick ^= 1 << 20


def _lose_slow_step(board: Any) -> None:
    """Suppress the slow step until the next one is due, when its absence first matters."""
    board.slow_stuck = True
    due = board.app.fast.window.count + 1
    while board.app.fast.window.count != due:
        board.tick()


def break_single(board: Any, how: str) -> None:
    """Replace the sensor signal of the single-mode board by that of a failed sensor."""
    shown, noise = board.adc.value / 2048.0 - 1.0, board.plate.plate.noise
    board.sense = {
        "dead": lambda: board.plate.random.gauss(0.0, noise),
        "stuck": lambda: shown,
        "reversed": lambda: -board.plate.sense(),
        "clipped": lambda: 2.0,
    }[how]


def break_one_of_six(board: Any, how: str) -> None:
    """Replace the signal of one sensor of the six-channel board, each in turn."""
    which = int(board.app.fast.tick) % len(board.samples)
    shown, noise = board.samples[which] / 2048.0 - 1.0, board.beam.beam.noise

    def sense() -> Any:
        levels = board.beam.sense()
        levels[which] = {
            "dead": board.beam.random.normal(0.0, noise),
            "stuck": shown,
            "reversed": -levels[which],
            "clipped": 2.0,
        }[how]
        return levels

    board.sense = sense


def sensor_kinds(broken: Callable[..., None]) -> dict[str, Break]:
    """Return the sensor failures of each kind."""
    return {f"sensor {how}": partial(broken, how=how) for how in SENSORS}


BOARD_KINDS: dict[str, Break] = {
    "samples cease": _stop_samples,
    "interrupt lost, timed from the next one": _lose_interrupt,
    "slow step lost, timed from when it is due": _lose_slow_step,
    "supply falls": _lower_supply,
    "clock dies": lambda board: board.interrupt_unexpectedly(),
    "tick damaged": _damage,
}


def _unsafe(board: Any, ticks: int) -> list[int]:
    """Return those of the next ticks in which an output is driven."""
    return [tick for tick in range(1, ticks + 1) if not (board.tick() or board.at_rest)]


class Ending(NamedTuple):
    """Outcome of one injection: at rest and latched, or amplitude held; ticks until the outputs were at rest."""

    latched: bool
    held: bool
    late: int


Trial = Callable[[Any, int], Ending]  # of a board and the number of the tick


def breaking(go_wrong: Break) -> Trial:
    """Make a trial of a fault during which the main loop is busy until the outputs must be at rest.

    The fault is latched if nothing is driven after the main loop resumes and the state is FAULT, or if the chip has
    halted.
    """

    def trial(board: Any, _: int) -> Ending:
        allowed = round(SAFE_S / board.sample_s)
        board.main_stuck = True
        go_wrong(board)
        last = max(_unsafe(board, 2 * allowed + 8), default=0)
        board.main_stuck = False
        stays = not _unsafe(board, WATCHED) and (board.hung or board.state == FAULT)
        return Ending(last <= allowed and bool(stays), False, last)

    return trial


def flipping(bits: list[int]) -> Trial:
    """Make a trial that flips a bit of the state, chosen by the number of the tick."""

    def trial(board: Any, moment: int) -> Ending:
        _flip(board, drawn(bits, moment))
        late = _late(board)
        return Ending(late is not None, late is None and _rests_when_stopped(board), late or 0)

    return trial


def image_rows(board: Any, trials: dict[str, Trial], seconds: float, stride: int) -> Iterator[Row]:
    """Run all trials on a driving emulated board every stride ticks, undoing each, and yield their rows."""
    endings: dict[str, list[Ending]] = {what: [] for what in trials}
    state = board.state
    for moment in range(0, round(seconds / board.sample_s), stride):
        board.run(stride * board.sample_s)
        if board.state != state:
            raise RuntimeError(f"the plate is no longer held: faults {', '.join(fault_names(board.faults))}")
        for what, trial in trials.items():
            with board.undone():
                endings[what].append(trial(board, moment))
    for what, each in endings.items():
        latched, held, late = (list(column) for column in zip(*each, strict=True))
        yield Row(what, len(each), sum(latched), sum(held), max(late) * board.sample_s, SAFE_S)


def _flip(board: Any, bit: int) -> None:
    byte = ctypes.c_uint8.from_address(board.pointer("app") + bit // 8)
    byte.value ^= 1 << bit % 8


def _rests_when_stopped(board: Any) -> bool:
    """True if the running job can be stopped."""
    ran = board.state in (RUN, IDENTIFY)
    board.app.base.supervisor.stopping = True
    board.run(STOPPED_S)
    return bool(ran and board.state == IDLE and board.at_rest)


def _late(board: Any) -> int | None:
    """Return the last tick at which an output is driven, or None if the board does not end in a fault."""
    last = tick = 0
    while tick < round(FOLLOWED_S / board.sample_s) and tick - last < WATCHED:
        tick += 1
        board.tick()
        last = last if board.at_rest else tick
    return last if board.state == FAULT and tick > last else None
