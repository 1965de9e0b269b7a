"""Fault injection in a closed loop, and the time until the outputs are at rest: `python -m firmware.injection`.

On the rig of firmware.closed_loop, faults are injected at every tick of one second: faults found by interrupts, failed
sensors (also while the level is modulated between zero and full), and one flipped bit of the state, chosen by the
number of the tick. firmware.injection_jobs adds lifts, softening plates, retries and chirps.
On the emulated board, with the unmodified images of both builds, they are lost interrupts, failed
sensors and flipped bits, at every 101st tick of one second (six channels: every 17th). These numbers are coprime to the
ticks of a window and of a check of the guard, so that every phase of both occurs. --stride and --image-stride change
them; docs/board/safety.md summarises the rows. A run takes some ten minutes on one processor.
"""

from __future__ import annotations

import argparse
import ctypes
import sys
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, NamedTuple

from firmware import injection_jobs
from firmware.build import BuildError, build
from firmware.closed_loop import GAIN, held_plate
from firmware.host import NoCompiler, load
from firmware.injection_rig import HEAD, SENSORS, SIX_WORDS, WORDS, Row, bits_of, drawn, rig_rows
from firmware.protocol import FAULT, IDLE, RUN, fault_names

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
    for moment in range(0, round(seconds / board.sample_s), stride):
        board.run(stride * board.sample_s)
        if board.state != RUN:
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
    ran = board.state == RUN
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


def _runs(board: Any) -> bool:
    return bool(board.state == RUN)


def held_images() -> tuple[Any, Any]:
    """Make emulated boards of both builds that hold their plates. Raises BuildError."""
    from firmware.emulate.images import EmulatedSingle, EmulatedSix
    from firmware.emulate.plant import Beam, measured_table

    with TemporaryDirectory() as folder:
        table, plate = held_plate(300.0, noise=1e-3)
        single = EmulatedSingle(build(table, Path(folder)).elf, plate)
        beam = Beam(noise=1e-3)
        six = EmulatedSix(build(measured_table(beam), Path(folder), "six").elf, beam)
    single.run(2e-3)
    single.start(0.15 * GAIN)
    six.run(5e-3)
    six.start(0, 0.1)
    for board in (single, six):
        board.run_until(partial(_runs, board), 5.0)  # after the check of a first start
        board.run(0.3)
    return single, six


def board_rows(seconds: float, single_stride: int, six_stride: int) -> Iterator[Row]:
    """Yield the rows measured on the images of both builds. Raises BuildError."""
    single, six = held_images()
    ffi, _ = load()
    single_kinds = BOARD_KINDS | sensor_kinds(break_single)
    six_kinds = BOARD_KINDS | sensor_kinds(break_one_of_six) | {"break pulled": lambda one: one.pull_break()}
    for name, board, stride, kinds, bits in (
        ("one mode", single, single_stride, single_kinds, bits_of(ffi, "an_single", WORDS)),
        ("six channels", six, six_stride, six_kinds, bits_of(ffi, "an_six", SIX_WORDS)),
    ):
        trials = {f"image, {name}: {what}": breaking(go_wrong) for what, go_wrong in kinds.items()}
        trials[f"image, {name}: flipped bit"] = flipping(bits)
        yield from image_rows(board, trials, seconds, stride)


def main(arguments: list[str] | None = None) -> int:
    """Run the command line and return the exit code."""
    parser = argparse.ArgumentParser(prog="python -m firmware.injection", description=__doc__)
    parser.add_argument("--seconds", type=float, default=1.0, help="length of the run, s")
    parser.add_argument("--stride", type=int, default=1, help="ticks between two injections on the rig")
    parser.add_argument(
        "--image-stride",
        type=int,
        nargs=2,
        default=(101, 17),
        metavar=("ONE", "SIX"),
        help="ticks between two injections on the images",
    )
    parser.add_argument("--image-seconds", type=float, default=1.0, help="length of the run on the images, s")
    chosen = parser.parse_args(arguments)
    rows: list[Row] = []
    print(f"{HEAD}\n{'|---' * 5}|")
    try:
        for result in (
            rig_rows(chosen.seconds, chosen.stride),
            injection_jobs.rows(chosen.seconds, chosen.stride),
            board_rows(chosen.image_seconds, *chosen.image_stride),
        ):
            for one in result:
                print(one.text, flush=True)
                rows.append(one)
    except (NoCompiler, BuildError) as missing:
        print(f"injection: {missing}", file=sys.stderr)
        return 5
    return 0 if all(one.is_sound for one in rows) else 4


if __name__ == "__main__":
    sys.exit(main())
