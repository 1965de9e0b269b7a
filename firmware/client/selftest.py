"""Self-test of a board: the first steps of docs/bring-up.md (line, rest, loop-back and cycles) as pass or fail."""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Callable, Iterator
from typing import NamedTuple

from firmware.client.actions import DRIVING, LOOK_S, WINDOW_HZ
from firmware.client.client import Client, Refused, figure
from firmware.protocol import PROTOCOL, Identity, SingleStatus, SixStatus

REST_OFFSET = 0.01  # of full scale: 16 mV, tolerance of 1.65 V from two 1 % resistors
RATE_TOLERANCE = 0.02  # the host reads its clock up to 10 ms early or late in 1 s
RATE_S = 1.0
LOOPBACK_S = 15.0  # the sweep of a flat response takes up to 7.5 s
PERIOD_CYCLES = {"single": 720, "six": 4500}  # core cycles between two samples
NEVER_RIGHT = ("table", "clock", "flash", "supply", "watchdog")


class Check(NamedTuple):
    """Result of a check: name, pass or fail, and the observation."""

    name: str
    holds: bool
    seen: str


class ChecksFailed(RuntimeError):
    """At least one check failed."""


def selftest(client: Client, text: argparse.Namespace) -> str:
    """Run the steps that apply to the build, asking for the wiring before each. Raises ChecksFailed."""
    identity = client.identity()
    steps = [name for name, step in STEPS.items() if identity.build in step.builds and text.step in (None, name)]
    failed = 0
    for name in steps:
        _ask(f"{name}: {STEPS[name].wiring}")
        for check in STEPS[name].checks(client, identity):
            print(f"{'pass' if check.holds else 'FAIL'}  {name}: {check.name}: {check.seen}", flush=True)
            failed += not check.holds
    if not steps:
        raise ChecksFailed(f"the step {text.step} does not apply to the {identity.build} build")
    if failed:
        raise ChecksFailed(
            f"{failed} check{'s' if failed > 1 else ''} failed: docs/bring-up.md lists the causes to look for"
        )
    return ""


def _ask(text: str) -> None:
    print(text, flush=True)
    if sys.stdin.isatty():
        input("Press Enter when ready. ")


def check_line(client: Client, identity: Identity) -> Iterator[Check]:
    """Check that the board answers, has a table, and has no fault that wiring cannot cause."""
    result = client.status()
    same = identity.protocol == PROTOCOL
    yield Check("answers", same, f"{identity.build} build, protocol {identity.protocol}, this client's {PROTOCOL}")
    yield Check("mode table", identity.count > 0, f"{identity.count} entries")
    wrong = [fault for fault in result.faults if fault in NEVER_RIGHT]
    yield Check("clock, flash, supply", not wrong, f"faults {', '.join(wrong)}" if wrong else "none of these faults")


def check_rest(client: Client, identity: Identity) -> Iterator[Check]:
    """Check that the board rests without a fault at 1.65 V on the sensor's pin, at the correct window rate."""
    try:
        if client.status().state == "fault":
            client.clear()
    except Refused as error:
        yield Check("fault cleared", False, str(error))
        return
    time.sleep(LOOK_S)
    result, began = client.status(), time.monotonic()
    if not isinstance(result, SingleStatus):
        yield Check("status", False, "reply of the six-channel build")
        return
    at_rest = result.state == "idle"
    yield Check(
        "rests", at_rest, f"state {result.state}" + (f", faults {', '.join(result.faults)}" if result.faults else "")
    )
    yield Check("offset", abs(result.offset) <= REST_OFFSET, f"{figure(result.offset, '.4f')}, allowed {REST_OFFSET:g}")
    time.sleep(RATE_S)
    rate = (client.status().windows - result.windows) % 2**32 / (time.monotonic() - began)
    yield Check(
        "windows", abs(rate / WINDOW_HZ - 1.0) <= RATE_TOLERANCE, f"{rate:.0f} per second, expected {WINDOW_HZ:.0f}"
    )


def check_loopback(client: Client, identity: Identity) -> Iterator[Check]:
    """Check that a sweep runs and rejects the flat response of the drive connected to the sensor's pin."""
    client.identify()
    states: list[SingleStatus | SixStatus] = [client.status()]
    end = time.monotonic() + LOOPBACK_S
    while states[-1].state in DRIVING and time.monotonic() < end:
        time.sleep(LOOK_S)
        states.append(client.status())
    last = states[-1]
    client.stop()
    yield Check("sweeps", states[0].state == "identify", f"state {states[0].state} at first")
    refused = last.faults == ("identify",)
    yield Check(
        "no resonance", refused, f"ended in {last.state}, faults {', '.join(last.faults) or 'none'}, expected identify"
    )


def check_cycles(client: Client, identity: Identity) -> Iterator[Check]:
    """Check that the longest fast interrupt so far takes at most half the time between two samples."""
    cycles, period = client.status().worst_cycles, PERIOD_CYCLES[identity.build]
    yield Check("fast interrupt", 0 < cycles <= period // 2, f"{cycles} cycles, allowed {period // 2} of {period}")


class Step(NamedTuple):
    """Checks for one wiring."""

    wiring: str
    builds: tuple[str, ...]
    checks: Callable[[Client, Identity], Iterator[Check]]


STEPS = {
    "line": Step("USB cable only; amplifier and sensor off", ("single", "six"), check_line),
    "rest": Step("1.65 V on PA0 (A0), from two 1 kOhm resistors to 3.3 V and ground", ("single",), check_rest),
    "loopback": Step("PA4 (A2) to PA0 (A0) through 10 kOhm, 10 kOhm from PA0 to 1.65 V", ("single",), check_loopback),
    "cycles": Step("no change", ("single", "six"), check_cycles),
}
