"""What a look takes for a sensor that failed, and what it does not: signals of known kind, sample by sample."""

from __future__ import annotations

import math
from collections.abc import Callable

import pytest

from firmware.emulate.plant import adc_code

RATE_HZ, TONE_HZ, SIZE = 250e3, 31437.3, 0.1
FAILS_AT = 1003
Signal = Callable[[int], float]


def tone(n: int, frequency_hz: float = TONE_HZ) -> float:
    return SIZE * math.cos(2.0 * math.pi * frequency_hz / RATE_HZ * n)


def detection_sample(
    core, signal: Signal, frequency_hz: float = TONE_HZ, samples: int = 4000, pushed: float = 0.0
) -> int | None:
    """The sample after which a look finds a failed sensor.

    pushed is what the drive adds between two looks, relative to the tone; without it, only a plate that rings on is sound.
    """
    ffi, lib = core
    fast, plan, watch, mode = (ffi.new(f"{name} *") for name in ("an_fast", "an_watch_plan", "an_watch", "an_mode"))
    step = lib.an_dds_step(frequency_hz, RATE_HZ)
    lib.an_fast_init(fast, step)
    mode.gain.re, mode.tau_s, mode.frequency_hz = 0.8, 3e-3, frequency_hz
    lib.an_watch_prepare(plan, mode, {"re": 1.0, "im": 0.0}, step, RATE_HZ)
    if not plan.decides:
        return None
    for n in range(samples):
        fast.command.count = fast.window.count
        lib.an_fast_tick(fast, adc_code(signal(n)))
        if n < FAILS_AT:
            drive = pushed * complex(watch.seen[0].re, watch.seen[0].im) / complex(plan.push.re, plan.push.im)
        fast.drive.re, fast.drive.im = drive.real, drive.imag
        if n % lib.AN_WATCH_TICKS == 0 and lib.an_watch_look(watch, plan, fast, 0.0):
            return n
        fast.drive.re = fast.drive.im = 0.0
    return None


FAILURES: dict[str, Signal] = {
    "dead": lambda n: 0.0,
    "stuck": lambda n: tone(FAILS_AT),
    "reversed": lambda n: -tone(n),
}


@pytest.mark.parametrize("at", range(FAILS_AT, FAILS_AT + 10))
@pytest.mark.parametrize("what", FAILURES)
def test_a_failure_at_any_sample_between_two_looks_is_found_in_time(core, what: str, at: int) -> None:
    detected = detection_sample(core, lambda n: tone(n) if n < at else FAILURES[what](n))
    assert detected is not None and 0 <= detected - at <= 20


@pytest.mark.parametrize(
    "signal",
    [
        lambda n: tone(n) * math.exp(-max(n - FAILS_AT, 0) * 4e-6 / 0.2e-3),  # Q of 20, let go
        lambda n: tone(n) + tone(n, TONE_HZ + 2743.0),  # beats pass through zero within few samples
        lambda n: tone(n) + tone(n, TONE_HZ - 1427.0),
        lambda n: tone(n) + (5.0 * SIZE * math.sin(2.0 * math.pi * 2e3 * 4e-6 * n) if n > FAILS_AT else 0.0),  # a knock
        lambda n: tone(n) + (3.0 * SIZE if n == FAILS_AT else 0.0),  # a spark
        lambda n: 0.01 * SIZE * (-1) ** (n * n % 7),  # next to nothing
    ],
    ids=["damped", "far beat", "near beat", "knock", "spark", "noise"],
)
def test_what_a_plate_may_do_is_no_failure(core, signal: Signal) -> None:
    assert detection_sample(core, signal) is None


@pytest.mark.parametrize(("pushed", "fails"), [(0.0, True), (2.0, True), (-2.0, False)])
def test_a_plate_that_its_drive_may_have_turned_round_is_no_reversed_sensor(core, pushed: float, fails: bool) -> None:
    detected = detection_sample(core, lambda n: tone(n) if n < FAILS_AT else -tone(n), pushed=pushed)
    assert (detected is not None) == fails


@pytest.mark.parametrize("low_hz", [8e3, 12e3])
def test_of_a_tone_too_low_for_a_look_nothing_is_decided(core, low_hz: float) -> None:
    """Neither its cosine nor its sine, or the cosine alone."""
    assert detection_sample(core, lambda n: 0.0 if n > FAILS_AT else tone(n, low_hz), low_hz) is None
