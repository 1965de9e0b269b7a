"""The first steps of docs/bring-up.md as checks that pass or fail: line, rest, loop-back and cycles."""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Callable, Iterator
from typing import NamedTuple

from firmware.client.actions import DRIVING, LOOK_S, WINDOW_HZ
from firmware.client.client import Client, Refused, figure
from firmware.protocol import PROTOCOL, Identity, SingleStatus, SixStatus

REST_OFFSET = 0.01  # of full scale: 16 mV, what two resistors of 1 % make of 1.65 V
RATE_TOLERANCE = 0.02  # the host's clock is read 10 ms early or late in 1 s
RATE_S = 1.0
LOOPBACK_S = 15.0  # the sweep of a flat response takes up to 7.5 s
PERIOD_CYCLES = {"single": 720, "six": 4500}  # of the core between two samples
NEVER_RIGHT = ("table", "clock", "flash", "supply", "watchdog")


class Check(NamedTuple):
    """What was looked at, whether it holds, and what was seen."""

    name: str
    holds: bool
    seen: str


class ChecksFailed(RuntimeError):
    """Not every check holds."""


def selftest(client: Client, text: argparse.Namespace) -> str:
    """Runs the steps that the build has, asking for the wiring before each. Raises ChecksFailed."""
    identity = client.identity()
    steps = [name for name, step in STEPS.items() if identity.build in step.builds and text.step in (None, name)]
    failed = 0
    for name in steps:
        _ask(f"{name}: {STEPS[name].wiring}")
        for check in STEPS[name].checks(client, identity):
            print(f"{'pass' if check.holds else 'FAIL'}  {name}: {check.name}: {check.seen}", flush=True)
            failed += not check.holds
    if not steps:
        raise ChecksFailed(f"the step {text.step} is not for the {identity.build} build")
    if failed:
        raise ChecksFailed(
            f"{failed} check{'s do' if failed > 1 else ' does'} not hold: docs/bring-up.md has what to look at"
        )
    return ""


def _ask(text: str) -> None:
    print(text, flush=True)
    if sys.stdin.isatty():
        input("Enter when it is so. ")


def check_line(client: Client, identity: Identity) -> Iterator[Check]:
    """The board answers, has a table, and nothing is wrong that no wiring can mend."""
    result = client.status()
    same = identity.protocol == PROTOCOL
    yield Check("answers", same, f"{identity.build} build, protocol {identity.protocol}, this client's {PROTOCOL}")
    yield Check("mode table", identity.count > 0, f"{identity.count} entries")
    wrong = [fault for fault in result.faults if fault in NEVER_RIGHT]
    yield Check("clock, flash, supply", not wrong, f"faults {', '.join(wrong)}" if wrong else "no fault of these")


def check_rest(client: Client, identity: Identity) -> Iterator[Check]:
    """At 1.65 V on the sensor's pin the board rests without a fault, and its windows come at their rate."""
    try:
        if client.status().state == "fault":
            client.clear()
    except Refused as error:
        yield Check("fault cleared", False, str(error))
        return
    time.sleep(LOOK_S)
    result, began = client.status(), time.monotonic()
    if not isinstance(result, SingleStatus):
        yield Check("status", False, "that of the six-channel build")
        return
    at_rest = result.state == "idle"
    yield Check(
        "rests", at_rest, f"state {result.state}" + (f", faults {', '.join(result.faults)}" if result.faults else "")
    )
    yield Check("offset", abs(result.offset) <= REST_OFFSET, f"{figure(result.offset, '.4f')}, allowed {REST_OFFSET:g}")
    time.sleep(RATE_S)
    rate = (client.status().windows - result.windows) % 2**32 / (time.monotonic() - began)
    yield Check(
        "windows", abs(rate / WINDOW_HZ - 1.0) <= RATE_TOLERANCE, f"{rate:.0f} a second, expected {WINDOW_HZ:.0f}"
    )


def check_loopback(client: Client, identity: Identity) -> Iterator[Check]:
    """The drive seen by the sensor's pin is no resonance: the sweep runs, then refuses it."""
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
    """The longest fast interrupt so far leaves half of the time between two samples."""
    cycles, period = client.status().worst_cycles, PERIOD_CYCLES[identity.build]
    yield Check("fast interrupt", 0 < cycles <= period // 2, f"{cycles} cycles, allowed {period // 2} of {period}")


class Step(NamedTuple):
    """Checks that one wiring allows."""

    wiring: str
    builds: tuple[str, ...]
    checks: Callable[[Client, Identity], Iterator[Check]]


STEPS = {
    "line": Step("the USB cable alone; amplifier and sensor off", ("single", "six"), check_line),
    "rest": Step("1.65 V on PA0 (A0), by two resistors of 1 kOhm from 3.3 V and ground", ("single",), check_rest),
    "loopback": Step("PA4 (A2) by 10 kOhm to PA0 (A0), 10 kOhm from PA0 to 1.65 V", ("single",), check_loopback),
    "cycles": Step("as it is", ("single", "six"), check_cycles),
}
