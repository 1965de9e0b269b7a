"""Rows of `python -m firmware.injection` without a fault of the board: lifts, plates that soften, retries, chirps.

On the rig. A finger lifts, or a plate begins to soften or stiffen, at many moments of a held level; a sensor fails while a
retry brings the plate up; a hand stays through all retries; faults, clipped sensors and flipped bits come during a chirp.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace
from typing import Any

from firmware import injection_rig
from firmware.closed_loop import SingleRig, held_plate
from firmware.injection_rig import FURTHER, LATER, LEVEL, SOON, TRIPS, Row
from firmware.protocol import FAULT, IDENTIFY, IDLE, RUN, Chirp, fault_names, pack

LIFTED_S, LIFT_STEPS, LIFTED_MOST = 10e-3, 20, 1.2  # time, and largest motion over the reference
DAMPED, HEAVY = 6.0, 100.0  # times the damping: a finger, and a hand
FOLLOWED_S, NEAR = 0.1, 0.05  # until the level is held again within this share
STIFFER = (("softens", 1.0), ("stiffens", -1.0))  # by a half-bandwidth at the held level
RETRIES_S, TRIES_S = 12.0, 4 * 30e-3  # a hand stays; longest drive of all tries together
RESTED_S = 2e-3
CHIRP_STEPS = 512


def touched(times: float) -> Any:
    """Plate of `held`, damped more."""
    _, plate = held_plate(300.0, noise=1e-3)
    own = plate.resonances[0]
    return replace(plate, resonances=(replace(own, tau_s=own.tau_s / times, gain=own.gain / times),))


def _each(rig: SingleRig, moments: int, stride: int) -> Iterator[None]:
    """Advance by a stride before each trial, and undo the trial after it."""
    for _ in range(moments):
        rig.lib.rig_run(rig.rig, stride, rig.ffi.NULL, 0)
        before, plate = bytes(rig.ffi.buffer(rig.rig)), rig.plate
        yield
        rig.ffi.buffer(rig.rig)[:], rig.plate = before, plate


def _held_row(what: str, rig: SingleRig, moments: int, stride: int, most: float, change: Callable[[], float]) -> Row:
    """Row of a change after which the level is held, with at most `most` times its motion."""
    kept, largest, drive, own = 0, 0.0, 0.0, abs(rig.windows(5e-3)["drive"]).max()
    for _ in _each(rig, moments, stride):
        peak = change()
        seen = rig.windows(FOLLOWED_S)
        peak = max(peak, float(seen["motion"].max())) / LEVEL
        last = float(abs(seen["measured"][-50:]).mean()) / LEVEL
        kept += rig.state == RUN and peak <= most and abs(last - 1.0) < NEAR
        largest, drive = max(largest, peak), max(drive, float(abs(seen["drive"]).max()))
    return Row(what, moments, 0, kept, 0.0, 0.0, (drive, float(own), largest))


def lift_row(moments: int, stride: int) -> Row:
    """Row of a finger that lifts."""
    rig = injection_rig.held()
    steps = [touched(1.0 + (DAMPED - 1.0) * (1.0 - i / LIFT_STEPS)) for i in range(LIFT_STEPS + 1)]
    ramp = rig.coefficients(steps)
    rig.use(ramp[0])
    rig.run(0.2)

    def lift() -> float:
        peak = 0.0
        for step in ramp[1:]:
            rig.use(step)
            peak = max(peak, float(rig.windows(LIFTED_S / LIFT_STEPS)["motion"].max()))
        return peak

    return _held_row("a finger lifts within 10 ms", rig, moments, stride, LIFTED_MOST, lift)


def softening_row(name: str, half_bandwidths: float, moments: int, stride: int) -> Row:
    """Row of a plate whose resonance begins to shift with its amplitude."""
    rig = injection_rig.held()
    rate = 1.0 / rig.plate.resonances[0].tau_s  # half-bandwidth in rad/s

    def soften() -> float:
        rig.rig.plate.softening = half_bandwidths * rate / rig.sample_rate_hz / LEVEL
        return 0.0

    return _held_row(f"plate {name} by a half-bandwidth", rig, moments, stride, injection_rig.FLIPPED_FURTHER, soften)


def _retrying() -> SingleRig:
    """Make a rig whose retry has just begun, the hand having left."""
    rig = injection_rig.held()
    free = rig.plate
    rig.set_plate(touched(HEAVY))
    while rig.state == RUN:
        rig.run(1e-3)
    rig.set_plate(free)
    while rig.state == FAULT:
        rig.run(1e-3)
    return rig


def retry_rows(seconds: float, stride: int) -> Iterator[Row]:
    """Yield rows of sensors that fail while a retry brings the plate up, and of a hand that stays."""
    for how, most in LATER.items():
        rig = _retrying()
        detail = getattr(rig.lib, f"RIG_{how.upper()}")
        result = injection_rig.inject(rig, rig.lib.RIG_SENSOR, [detail], seconds, stride, most, FURTHER)
        yield injection_rig.row(f"sensor {how}, during a retry", rig, result, most)
    rig = injection_rig.held()
    longest, ended = 0.0, 0
    for _ in _each(rig, 5, 37):
        rig.set_plate(touched(HEAVY))
        states = rig.windows(RETRIES_S)["state"]
        longest = max(longest, float((states == RUN).sum()) * rig.lib.AN_PERIOD / rig.sample_rate_hz)
        at_rest = rig.state == IDLE and rig.faults == 0 and rig.rig.code == rig.lib.AN_DAC_MIDDLE
        ended += at_rest and rig.app.base.retry.gave_up != 0
    yield Row(
        "a hand of 100 times the damping stays (given up; longest drive of all tries)", 5, ended, 0, longest, TRIES_S
    )


def chirping() -> SingleRig:
    """Make a rig that drives a chirp for longer than any trial."""
    rig = SingleRig(*held_plate(300.0, noise=1e-3))
    rig.run(5e-3)
    growth = 2**32 // CHIRP_STEPS
    chirp = Chirp(rig.app.mode.frequency_hz, 0.1, 2**31, growth, CHIRP_STEPS, 4, CHIRP_STEPS)
    plan = rig.ffi.new("an_chirp_request *")
    rig.ffi.buffer(plan)[:] = pack(chirp)
    if not rig.lib.an_single_chirp(rig.pointer, plan):
        raise RuntimeError("the chirp is refused")
    rig.run(50e-3)
    return rig


def chirp_rows(seconds: float, stride: int) -> Iterator[Row]:
    """Yield rows of faults, clipped sensors and flipped bits during a chirp."""
    lib = chirping().lib
    kinds = [(fault_names(fault)[0], lib.RIG_TRIP, int(fault)) for fault in TRIPS]
    for name, kind, detail in (*kinds, ("sensor clipped", lib.RIG_SENSOR, lib.RIG_CLIPPED)):
        rig = chirping()
        result = injection_rig.inject(rig, kind, [detail], seconds, stride, SOON, injection_rig.FLIPPED_FURTHER)
        yield injection_rig.row(f"{name}, during a chirp", rig, result, SOON)
    yield _flips(chirping(), round(seconds * 250e3) // stride, stride)


def _flips(rig: SingleRig, moments: int, stride: int) -> Row:
    """Flip bits of state words: the chirp goes on and can be stopped, or a fault sets the output to rest in time."""
    bits = injection_rig.bits_of(rig.ffi, "an_single", [*injection_rig.WORDS, "slow.chirp.begun", "slow.chirp.index"])
    latched = kept = 0
    longest = 0
    for moment, _ in enumerate(_each(rig, moments, stride)):
        bit = injection_rig.drawn(bits, moment)
        app = rig.ffi.cast("uint8_t *", rig.pointer)
        app[bit // 8] ^= 1 << bit % 8
        late = _late(rig)
        rig.lib.an_application_stop(rig.ffi.addressof(rig.app, "base"))
        rig.run(RESTED_S)
        at_rest = rig.rig.code == rig.lib.AN_DAC_MIDDLE
        latched += rig.state == FAULT and at_rest
        kept += rig.state == IDLE and at_rest
        longest = max(longest, late if rig.state == FAULT else 0)
    return Row(
        "flipped bit, during a chirp", moments, latched, kept, longest / rig.sample_rate_hz, SOON / rig.sample_rate_hz
    )


def _late(rig: SingleRig) -> int:
    """Return the last tick of some windows at which the output is driven while a fault is known."""
    last = 0
    for tick in range(1, 151):
        rig.lib.rig_run(rig.rig, 1, rig.ffi.NULL, 0)
        last = last if rig.rig.code == rig.lib.AN_DAC_MIDDLE else tick
    return last if rig.state != IDENTIFY else 0


def rows(seconds: float, stride: int) -> Iterator[Row]:
    """Yield all rows; moments follow from the length of the run and the stride, as those of injection_rig.rig_rows."""
    moments, apart = max(round(seconds * 500), 5), 199
    yield lift_row(moments, apart)
    for name, half_bandwidths in STIFFER:
        yield softening_row(name, half_bandwidths, moments, apart)
    yield from retry_rows(min(seconds, 0.05), stride)
    yield from chirp_rows(min(seconds, 0.2), max(stride, 7))
