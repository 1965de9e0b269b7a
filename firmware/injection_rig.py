"""Fault injection on the rig of firmware.closed_loop: rows of the table that `python -m firmware.injection` prints."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, NamedTuple

from firmware.closed_loop import SingleRig, held_plate
from firmware.protocol import RUN, Fault, fault_names

TRIPS = (Fault.CLOCK, Fault.FAST_LATE, Fault.BREAK, Fault.SUPPLY)
SENSORS = ("clipped", "dead", "stuck", "reversed")
SOON, LATCHED, HORIZON = 25, 200, 10000  # ticks of 4 us: 100 us (RIG_SOON)
LATER = {"dead": 1250, "stuck": 1250, "reversed": 500}  # while the level is modulated: 5 ms, 2 ms
LEVEL, SWING_HZ = 0.15, 100.0
# Largest motion over that of the run without a fault: what its drive adds within 100 us; until a drive without effect
# exceeds what noise and a heavy hand can hide; until the loop has followed a phase jump.
FURTHER, HIDDEN_FURTHER, FLIPPED_FURTHER = 1.05, 2.0, 1.3
SWINGS = {"level swings": (LEVEL, FURTHER), "low level swings": (LEVEL / 3.0, HIDDEN_FURTHER)}
SHARED = [
    "base.supervisor.state",
    "base.supervisor.inverse",
    "base.supervisor.faults",
    "slow.hand.active",
    "slow.hand.posted",
    "slow.hand.trips",
    "slow.dwell.waited",
    "slow.dwell.finished",
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
    "| fault | at rest and latched / amplitude held | longest time to rest / allowed, us "
    "| peak drive / without fault, over `drive_limit` | peak motion over that without fault |"
)


class Row(NamedTuple):
    """Row of the table: injections, how many ended at rest and latched or held, and times to rest in s.

    On the rig, extent holds the peak drive with and without the fault, over drive_limit, and the peak motion over that
    without the fault.
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
        """True if every injection ended in one of the two ways, and in time."""
        return self.latched + self.held == self.moments and self.longest_s <= self.allowed_s

    @property
    def text(self) -> str:
        """Row in Markdown."""
        late = "" if self.is_sound else f" (NOT SAFE: {self.moments - self.latched - self.held})"
        times = f"{1e6 * self.longest_s:.0f}/{1e6 * self.allowed_s:.0f}"
        extent = "{:.2f}/{:.2f} | {:.2f}".format(*self.extent) if self.extent else "|"
        return f"| {self.what} | {self.latched}/{self.held}{late} | {times} | {extent} |"


def held(level: float = LEVEL, swings: bool = False) -> SingleRig:
    """Make a rig in closed loop, with the level constant or modulated between zero and full. Raises NoCompiler."""
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
    """Return the bit offsets of some 32-bit words of an application's state."""
    starts = [ffi.offsetof(application, *word.split(".")) for word in words]
    return [8 * start + bit for start in starts for bit in range(32)]


def drawn(bits: list[int], moment: int) -> int:
    """Choose one bit by the number of the tick, as rig_inject does."""
    return bits[(moment * 2654435761 % 2**32 >> 8) % len(bits)]


def inject(
    rig: SingleRig, kind: int, details: list[int], seconds: float, stride: int, most: int, further: float
) -> Any:
    """Inject a fault every stride ticks.

    Parameters
    ----------
    rig : SingleRig
    kind : int
        RIG_SENSOR, RIG_TRIP or RIG_FLIP.
    details : list of int
        Sensor failures, fault bits or bit offsets to choose from.
    seconds : float
        Length of the run, in s.
    stride : int
        Ticks between two injections.
    most : int
        Ticks until the output must be at rest.
    further : float
        Largest motion over that without a fault.

    Returns
    -------
    rig_outcome
        Structure of firmware/host/rig.h.
    """
    given = rig.ffi.new("uint32_t []", details)
    ticks = round(seconds * rig.sample_rate_hz)
    trial = rig.ffi.new("rig_trial *", [kind, given, len(details), ticks, stride, most, LATCHED, further])
    return rig.lib.rig_inject(rig.rig, trial)


def rig_rows(seconds: float, stride: int) -> Iterator[Row]:
    """Yield the rows measured on the rig."""
    lib = held().lib
    kinds = [(fault_names(fault)[0], lib.RIG_TRIP, int(fault)) for fault in TRIPS]
    kinds += [(f"sensor {name}", lib.RIG_SENSOR, getattr(lib, f"RIG_{name.upper()}")) for name in SENSORS]
    for name, kind, detail in kinds:
        rig = held()
        yield row(name, rig, inject(rig, kind, [detail], seconds, stride, SOON, FURTHER), SOON)
    for swing, (level, further) in SWINGS.items():
        for how, most in LATER.items():
            rig = held(level, swings=True)
            detail = getattr(lib, f"RIG_{how.upper()}")
            result = inject(rig, lib.RIG_SENSOR, [detail], seconds, stride, most, further)
            soon = 100.0 * result.soon / max(result.latched, 1)
            yield row(f"sensor {how}, {swing} ({soon:.1f} % within 100 us)", rig, result, most)
    rig = held()
    bits = bits_of(rig.ffi, "an_single", WORDS)
    result = inject(rig, rig.lib.RIG_FLIP, bits, seconds, stride, HORIZON, FLIPPED_FURTHER)
    yield row("flipped bit", rig, result, SOON)


def row(what: str, rig: SingleRig, result: Any, most: int) -> Row:
    """Make a row of what rig_inject has found."""
    moments = result.latched + result.held + result.unsafe
    times = result.longest / rig.sample_rate_hz, most / rig.sample_rate_hz
    extent = result.broken.drive, result.sound.drive, result.broken.motion / result.sound.motion
    return Row(what, moments, result.latched, result.held, *times, extent)
