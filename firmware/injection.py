"""Lets go wrong what can while a plate is held, and tells how soon the outputs rest: `python -m firmware.injection`.

On the rig of firmware.closed_loop, at every tick of a second: faults that interrupts find, broken sensors (also while the level
swings between nothing and full), and at each tick one flipped bit of the words of the state, drawn by the tick's number. On
the emulated board, with the unmodified images of both builds, the interrupts themselves, the sensors and the flipped bits, at
every 101st tick of a second (six channels: every 17th): numbers without a common divisor with the ticks of a window and of a
look of the guard, so that each of their phases is met. --stride and --image-stride change that; --write puts the table into
docs/bring-up.md. It takes some ten minutes of one processor.
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

from firmware.build import BuildError, build
from firmware.closed_loop import GAIN, SingleRig, held_plate, write_into_page
from firmware.host import NoCompiler, load
from firmware.protocol import FAULT, IDLE, RUN, Fault, fault_names

TRIPS = (Fault.CLOCK, Fault.FAST_LATE, Fault.BREAK, Fault.SUPPLY)
SENSORS = ("clipped", "dead", "stuck", "reversed")
SOON, LATCHED, HORIZON = 25, 200, 10000  # ticks of 4 us: 100 us (RIG_SOON)
LATER = {"dead": 1250, "stuck": 1250, "reversed": 500}  # while the level swings: 5 ms, 2 ms
LEVEL, SWING_HZ = 0.15, 100.0
# The plate may move so many times as far as in the sound run: what that one's drive adds in 100 us; until the drive that moves
# nothing exceeds what noise and a heavy hand hide; until the loop has followed a turned phase.
FURTHER, HIDDEN_FURTHER, FLIPPED_FURTHER = 1.05, 2.0, 1.3
SWINGS = {"level swings": (LEVEL, FURTHER), "low level swings": (LEVEL / 3.0, HIDDEN_FURTHER)}
SAFE_S, FOLLOWED_S, STOPPED_S = 100e-6, 5e-3, 3e-3
WATCHED = 100  # ticks, two windows and more of either build
SHARED = [
    "base.supervisor.state",
    "base.supervisor.inverse",
    "base.supervisor.faults",
    "slow.hand.active",
    "slow.hand.posted",
    "slow.hand.trips",
    "slow.waited",
    "slow.finished",
    "fast.tick",
    "fast.phase",
    "fast.step",
    "fast.faults",
    "fast.window.count",
    "fast.command.count",
    "fast.command.step",
    "probing",
]
WORDS = [*SHARED, "slow.tracking", "slow.noted", "track.read"]
SIX_WORDS = [
    *SHARED,
    "slow.limited",
    "slow.mismatched",
    "slow.ringing",
    "fast.acting",
    "fast.growing",
    "fast.end",
    "fast.window.bank",
    "fast.command.bank",
    "fast.command.window",
    "channels",
    "probe",
]
HEAD = (
    "| what goes wrong | moments | at rest and latched | held as before | longest, us | allowed, us "
    "| most drive, of `drive_limit` (sound run) | most motion, of the sound run's |"
)


class Row(NamedTuple):
    """Of the table: moments, how many ended at rest and latched, and held as before; longest time to rest and allowed, s.

    On the rig also the largest drive from then on and that of the run without the fault, over drive_limit; and the largest
    motion over that run's.
    """

    what: str
    moments: int
    latched: int
    held: int
    longest_s: float
    allowed_s: float
    extent: tuple[float, float, float] | None = None

    @property
    def is_sound(self) -> bool:
        """True when no moment ended otherwise, and none too late."""
        return self.latched + self.held == self.moments and self.longest_s <= self.allowed_s

    @property
    def text(self) -> str:
        """As a row of Markdown."""
        late = "" if self.is_sound else f" (NOT SAFE: {self.moments - self.latched - self.held})"
        times = f"{1e6 * self.longest_s:.0f} | {1e6 * self.allowed_s:.0f}"
        extent = "{:.2f} ({:.2f}) | {:.2f}".format(*self.extent) if self.extent else "|"
        return f"| {self.what} | {self.moments} | {self.latched} | {self.held}{late} | {times} | {extent} |"


def held(level: float = LEVEL, swings: bool = False) -> SingleRig:
    """A rig that holds a plate, or lets its level swing between nothing and full. Raises NoCompiler."""
    rig = SingleRig(*held_plate(300.0, noise=1e-3))
    rig.run(5e-3)
    rig.start(level)
    if swings:
        texture = rig.ffi.addressof(rig.app.base, "texture")
        rig.lib.an_texture_sine(texture, SWING_HZ, 1.0, rig.sample_rate_hz / rig.lib.AN_PERIOD)
    rig.run(50e-3)
    if rig.state != RUN:
        raise RuntimeError("the plate is not held")
    return rig


def bits_of(ffi: Any, application: str, words: list[str]) -> list[int]:
    """The places of all bits of some 32-bit words of an application's state."""
    starts = [ffi.offsetof(application, *word.split(".")) for word in words]
    return [8 * start + bit for start in starts for bit in range(32)]


def drawn(bits: list[int], moment: int) -> int:
    """One of them by the moment's number, as rig_inject draws."""
    return bits[(moment * 2654435761 % 2**32 >> 8) % len(bits)]


def inject(
    rig: SingleRig, kind: int, details: list[int], seconds: float, stride: int, most: int, further: float
) -> Any:
    """A rig_outcome: something goes wrong at each so-many-th tick."""
    given = rig.ffi.new("uint32_t []", details)
    ticks = round(seconds * rig.sample_rate_hz)
    trial = rig.ffi.new("rig_trial *", [kind, given, len(details), ticks, stride, most, LATCHED, further])
    return rig.lib.rig_inject(rig.rig, trial)


def rig_rows(seconds: float, stride: int) -> Iterator[Row]:
    """What the rig shows."""
    lib = held().lib
    kinds = [(fault_names(fault)[0], lib.RIG_TRIP, int(fault)) for fault in TRIPS]
    kinds += [(f"sensor {name}", lib.RIG_SENSOR, getattr(lib, f"RIG_{name.upper()}")) for name in SENSORS]
    for name, kind, detail in kinds:
        rig = held()
        yield _row(name, rig, inject(rig, kind, [detail], seconds, stride, SOON, FURTHER), SOON)
    for swing, (level, further) in SWINGS.items():
        for how, most in LATER.items():
            rig = held(level, swings=True)
            detail = getattr(lib, f"RIG_{how.upper()}")
            result = inject(rig, lib.RIG_SENSOR, [detail], seconds, stride, most, further)
            soon = 100.0 * result.soon / max(result.latched, 1)
            yield _row(f"sensor {how}, {swing} ({soon:.1f} % within 100 us)", rig, result, most)
    rig = held()
    bits = bits_of(rig.ffi, "an_single", WORDS)
    result = inject(rig, rig.lib.RIG_FLIP, bits, seconds, stride, HORIZON, FLIPPED_FURTHER)
    yield _row("flipped bit", rig, result, SOON)


def _row(what: str, rig: SingleRig, result: Any, most: int) -> Row:
    moments = result.latched + result.held + result.unsafe
    times = result.longest / rig.sample_rate_hz, most / rig.sample_rate_hz
    extent = result.broken.drive, result.sound.drive, result.broken.motion / result.sound.motion
    return Row(what, moments, result.latched, result.held, *times, extent)


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
    """Until its next one is due: before, nothing is amiss."""
    board.slow_stuck = True
    due = board.app.fast.window.count + 1
    while board.app.fast.window.count != due:
        board.tick()


def break_single(board: Any, how: str) -> None:
    """One mode: what reaches the converter is from now on that of a broken sensor."""
    shown, noise = board.adc.value / 2048.0 - 1.0, board.plate.plate.noise
    board.sense = {
        "dead": lambda: board.plate.random.gauss(0.0, noise),
        "stuck": lambda: shown,
        "reversed": lambda: -board.plate.sense(),
        "clipped": lambda: 2.0,
    }[how]


def break_one_of_six(board: Any, how: str) -> None:
    """Six channels: one sensor, each in turn."""
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
    """A broken sensor of each kind."""
    return {f"sensor {how}": partial(broken, how=how) for how in SENSORS}


BOARD_KINDS: dict[str, Break] = {
    "samples cease": _stop_samples,
    "an interrupt lost, from the next one": _lose_interrupt,
    "slow step lost, from being due": _lose_slow_step,
    "supply falls": _lower_supply,
    "clock dies": lambda board: board.interrupt_unexpectedly(),
    "tick damaged": _damage,
}


def _unsafe(board: Any, ticks: int) -> list[int]:
    """Of the next ticks, those that something is driven in."""
    return [tick for tick in range(1, ticks + 1) if not (board.tick() or board.at_rest)]


class Ending(NamedTuple):
    """Of one moment: whether it ended at rest and latched, or held as before; ticks until the outputs rested."""

    latched: bool
    held: bool
    late: int


Trial = Callable[[Any, int], Ending]  # of a board, at the moment of a number


def breaking(go_wrong: Break) -> Trial:
    """Something goes wrong, the main loop busy until the outputs have to rest.

    Latched: nothing is driven afterwards, when the main loop goes on, and its state is the fault; or the chip stands still.
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
    """A bit of the state is flipped, drawn by the moment's number."""

    def trial(board: Any, moment: int) -> Ending:
        _flip(board, drawn(bits, moment))
        late = _late(board)
        return Ending(late is not None, late is None and _rests_when_stopped(board), late or 0)

    return trial


def image_rows(board: Any, trials: dict[str, Trial], seconds: float, stride: int) -> Iterator[Row]:
    """An emulated board that drives; at each so-many-th tick each of the trials, undone afterwards."""
    endings: dict[str, list[Ending]] = {what: [] for what in trials}
    for moment in range(0, round(seconds / board.sample_s), stride):
        board.run(stride * board.sample_s)
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
    """True when the job that runs can be ended."""
    ran = board.state == RUN
    board.app.base.supervisor.stopping = True
    board.run(STOPPED_S)
    return bool(ran and board.state == IDLE and board.at_rest)


def _late(board: Any) -> int | None:
    """Ticks until the last at which something is driven; none, when that ends in no fault."""
    last = tick = 0
    while tick < round(FOLLOWED_S / board.sample_s) and tick - last < WATCHED:
        tick += 1
        board.tick()
        last = last if board.at_rest else tick
    return last if board.state == FAULT and tick > last else None


def board_rows(seconds: float, single_stride: int, six_stride: int) -> Iterator[Row]:
    """What the images of both builds show. Raises BuildError."""
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
    ffi, _ = load()
    single_kinds = BOARD_KINDS | sensor_kinds(break_single)
    six_kinds = BOARD_KINDS | sensor_kinds(break_one_of_six) | {"break pulled": lambda one: one.pull_break()}
    for name, board, stride, kinds, bits in (
        ("one mode", single, single_stride, single_kinds, bits_of(ffi, "an_single", WORDS)),
        ("six channels", six, six_stride, six_kinds, bits_of(ffi, "an_six", SIX_WORDS)),
    ):
        board.run(0.3)
        trials = {f"image, {name}: {what}": breaking(go_wrong) for what, go_wrong in kinds.items()}
        trials[f"image, {name}: flipped bit"] = flipping(bits)
        yield from image_rows(board, trials, seconds, stride)


def main(arguments: list[str] | None = None) -> int:
    """The command line; returns the exit code."""
    parser = argparse.ArgumentParser(prog="python -m firmware.injection", description=__doc__)
    parser.add_argument("--seconds", type=float, default=1.0, help="length of the run")
    parser.add_argument("--stride", type=int, default=1, help="ticks between two moments on the rig")
    parser.add_argument(
        "--image-stride", type=int, nargs=2, default=(101, 17), metavar=("ONE", "SIX"), help="on the images"
    )
    parser.add_argument("--image-seconds", type=float, default=1.0, help="length of the run on the images")
    parser.add_argument("--write", action="store_true", help="put the table into docs/bring-up.md")
    chosen = parser.parse_args(arguments)
    rows: list[Row] = []
    lines = [HEAD, "|---" * 8 + "|"]
    print("\n".join(lines))
    try:
        for result in (rig_rows(chosen.seconds, chosen.stride), board_rows(chosen.image_seconds, *chosen.image_stride)):
            for row in result:
                print(row.text, flush=True)
                rows.append(row)
    except (NoCompiler, BuildError) as missing:
        print(f"injection: {missing}", file=sys.stderr)
        return 5
    if chosen.write:
        write_into_page("python -m firmware.injection --write", "\n".join([*lines, *(row.text for row in rows)]))
    return 0 if all(row.is_sound for row in rows) else 4


if __name__ == "__main__":
    sys.exit(main())
