"""Actions of the client's command line, and the self-test: the first steps of docs/bring-up.md as pass or fail."""

from __future__ import annotations

import argparse
import csv
import sys
import time
import wave
from collections import defaultdict
from collections.abc import Callable, Iterator
from contextlib import suppress
from functools import partial
from itertools import pairwise
from math import log10
from pathlib import Path
from typing import NamedTuple

import numpy as np

from firmware.client.client import BoardError, Client, Refused, amplitude, figure, given_up
from firmware.mode_table import PERIOD, PIN_VOLTS, RATE_HZ
from firmware.protocol import PAYLOAD_MAX, PROTOCOL, Identity, Record, SingleStatus, SixStatus

CODE_MIDDLE, CODE_SWING = 2048, 2047  # of ADC and DAC at rest, and of the DAC's amplitude
FADE_S = 1.0  # twice the longest time from a stop to rest
LOOK_S = 0.1  # between two status requests, which also keep up the contact with the board
DRIVING = ("identify", "run")
WINDOW_HZ = RATE_HZ["single"] / PERIOD
BAR, BAR_DB = 30, 60.0
LOG_COLUMNS = ("window", "measured_d", "measured_q", "drive_d", "drive_q", "reference")
LEVELS = " ▁▂▃▄▅▆▇█"
SAMPLE_HZ = {2: RATE_HZ["single"], 12: RATE_HZ["six"]}  # by words per row
CAPTURE_S = 2.0  # time-out without new words, in addition to the duration of a row
PIECE = PAYLOAD_MAX // 2  # samples per request
STORE = 256  # capacity of the board's sample buffer
MAX_WAITS = 4 * STORE // PIECE  # four times the duration of a full buffer

REST_OFFSET = 0.01  # of full scale: 16 mV, tolerance of 1.65 V from two 1 % resistors
RATE_TOLERANCE = 0.02  # the host reads its clock up to 10 ms early or late in 1 s
RATE_S = 1.0
LOOPBACK_S = 15.0  # the sweep of a flat response takes up to 7.5 s
PERIOD_CYCLES = {"single": 720, "six": 4500}  # core cycles between two samples
NEVER_RIGHT = ("table", "clock", "flash", "supply", "watchdog")


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


def check_line(client: Client, identity: Identity) -> Iterator[Check]:
    """Check that the board answers, has a table, and has no fault that wiring cannot cause."""
    result = client.status()
    same = identity.protocol == PROTOCOL
    yield Check("answers", same, f"{identity.build} build, protocol {identity.protocol}, this client's {PROTOCOL}")
    yield Check("mode table", identity.count > 0, f"{identity.count} entries")
    wrong = [fault for fault in result.faults if fault in NEVER_RIGHT]
    yield Check("clock, flash, supply", not wrong, f"faults {', '.join(wrong)}" if wrong else "none of these faults")


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


class Check(NamedTuple):
    """Result of a check: name, pass or fail, and the observation."""

    name: str
    holds: bool
    seen: str


class Step(NamedTuple):
    """Checks for one wiring."""

    wiring: str
    builds: tuple[str, ...]
    checks: Callable[[Client, Identity], Iterator[Check]]


def check_cycles(client: Client, identity: Identity) -> Iterator[Check]:
    """Check that the longest fast interrupt so far takes at most half the time between two samples."""
    cycles, period = client.status().worst_cycles, PERIOD_CYCLES[identity.build]
    yield Check("fast interrupt", 0 < cycles <= period // 2, f"{cycles} cycles, allowed {period // 2} of {period}")


def check_break(client: Client, identity: Identity) -> Iterator[Check]:
    """Check that a break line without its comparator is a fault that cannot be cleared."""
    with suppress(Refused):
        client.clear()
    time.sleep(LOOK_S)
    result = client.status()
    yield Check(
        "break", result.faults == ("break",), f"state {result.state}, faults {', '.join(result.faults) or 'none'}"
    )


def check_held(client: Client, identity: Identity) -> Iterator[Check]:
    """Check that the board rests without a fault while both break lines are held low."""
    with suppress(Refused):
        client.clear()
    time.sleep(LOOK_S)
    result = client.status()
    yield Check("held", result.state == "idle", f"state {result.state}, faults {', '.join(result.faults) or 'none'}")


STEPS = {
    "line": Step("USB cable only; amplifier and sensor off", ("single", "six"), check_line),
    "rest": Step("1.65 V on PA0 (A0), from two 1 kOhm resistors to 3.3 V and ground", ("single",), check_rest),
    "loopback": Step("PA4 (A2) to PA0 (A0) through 10 kOhm, 10 kOhm from PA0 to 1.65 V", ("single",), check_loopback),
    "cycles": Step("no change", ("single", "six"), check_cycles),
    "break1": Step("bridges without supply; PB12 unplugged, PA6 held low by its comparator", ("six",), check_break),
    "break2": Step("PA6 unplugged, PB12 held low by its comparator", ("six",), check_break),
    "held": Step("PB12 and PA6 held low by their comparators, bridges without supply", ("six",), check_held),
}


class ChecksFailed(RuntimeError):
    """At least one check failed."""


def start(client: Client, text: argparse.Namespace) -> None:
    """Drive the target mode and hold it."""
    client.start(client.share_of(text.reference), text.detuning)
    keep_running(client, "start")


def pattern(client: Client, text: argparse.Namespace) -> None:
    """Hold a pattern of the current shape."""
    client.pattern(text.number, client.share_of(text.reference))
    keep_running(client, "pattern")


def stop(client: Client, text: argparse.Namespace) -> None:
    """Return to rest, and wait until the drives have faded out."""
    client.stop()
    end = time.monotonic() + FADE_S
    while client.status().state in DRIVING and time.monotonic() < end:
        time.sleep(LOOK_S)


def identify(client: Client, text: argparse.Namespace) -> None:
    """Measure the plate and load the values, then hold an amplitude, or rest."""
    reference = None if text.reference is None else client.share_of(text.reference)
    if isinstance(client.status(), SingleStatus):
        _identify_by_chirps(client, text.plot)
        begin = client.start
    else:
        _identify_matrix(client, text.plot)
        begin = partial(client.pattern, 0)
    if reference is not None:
        begin(reference)
        keep_running(client, "identify")


def _identify_matrix(client: Client, picture: Path | None) -> None:
    from firmware.client import matrix

    client.identify()
    keep_running(client, "identify")
    found = matrix.read(client)
    print(matrix.describe(found), flush=True)
    if picture:
        matrix.draw(picture, found)
    matrix.judge(found)


def _identify_by_chirps(client: Client, picture: Path | None) -> None:
    from firmware.client import identify as plate

    try:
        found = plate.identify(client)
    except plate.NotIdentified as error:
        if picture:
            plate.draw(picture, error.response, error.fitted)
        raise
    print(plate.describe(found), flush=True)
    if picture:
        plate.draw(picture, found.response, found.fit)


def without_fault(result: SingleStatus | SixStatus, action: str) -> None:
    """Raise BoardError if the board is in the fault state, or gave the job up."""
    if result.state == "fault":
        raise BoardError(f"{action}: ended with fault {', '.join(result.faults)}")
    if result.gave_up:
        raise BoardError(f"{action}: {given_up(result)}")


def keep_running(client: Client, action: str) -> None:
    """Print the status ten times per second, which keeps the board running, until it rests for good.

    Raises
    ------
    BoardError
        If the board ends in the fault state, or gives the job up.
    """
    while True:
        result = client.status()
        reference, measured = (amplitude(share, result, ".4f") for share in (result.reference, abs(result.measured)))
        print(f"{result.state}  reference {reference}  measured {measured}", flush=True)
        if result.state not in DRIVING and not result.retries:
            client.drives = False
            return without_fault(result, action)
        time.sleep(LOOK_S)


def watch(client: Client, text: argparse.Namespace) -> str:
    """Show the measured values as bars, with a plot of the recent ones, until a time has passed or Ctrl-C.

    A terminal is updated in place; other outputs get new lines.
    """
    height, traces = 0, defaultdict[str, str](str)
    for result in _looks(client, text.seconds):
        lines = _bars(result, traces)
        again = f"\x1b[{height}F\x1b[J" if height and sys.stdout.isatty() else ""
        print(again + "\n".join(lines), flush=True)
        height = len(lines)
    return ""


def level(share: float) -> float:
    """Map a fraction of full scale to 0 at -60 dB (also for NaN) and 1 at 0 dB."""
    return min(max(1.0 + 20.0 * log10(share) / BAR_DB, 0.0), 1.0) if share > 0.0 else 0.0


def bar(share: float) -> str:
    """Draw a fraction of full scale as a bar, empty at -60 dB and full at 0 dB."""
    filled = round(BAR * level(share))
    return "#" * filled + "." * (BAR - filled)


def log(client: Client, text: argparse.Namespace) -> str:
    """Write a record every text.every windows to a CSV file, until a time has passed or Ctrl-C."""
    count = lost = 0
    last: Record | None = None
    metres = client.status().metres
    client.records.clear()  # of an earlier log
    with text.file.open("w", newline="") as file:
        try:
            rows = csv.writer(file)
            rows.writerow([*LOG_COLUMNS, *(("measured_um", "reference_um") if metres > 0.0 else ())])
            client.log(text.every)
            for record in _records(client, text.seconds):
                lost += _missing(last, record, text.every)
                count, last = count + 1, record
                rows.writerow(_row(record, metres))
        finally:
            with suppress(BoardError, OSError):
                client.log(0)
            lacking = f", {lost} {'was' if lost == 1 else 'were'} lost: try a larger --every" if lost else ""
            print(f"{text.file}: {count} record{'' if count == 1 else 's'}{lacking}")
    return ""


def capture(client: Client, text: argparse.Namespace) -> str:
    """Write the raw converter codes, sample by sample, to a CSV file.

    Each row holds the ADC codes, then those of the DAC or of the timers' compare registers. Where the table has metres
    per volt, the inputs follow in um, and the DAC's output in V.

    Raises
    ------
    BoardError
        If the capture stalls.
    """
    metres = client.status().metres
    client.capture(text.every)
    words: list[int] = []
    total, heard = 1, time.monotonic()
    while len(words) < total:
        part = client.captured(len(words))
        words, total, row_s = [*words, *part.words], part.total, text.every / SAMPLE_HZ[part.row]
        if part.words:
            heard = time.monotonic()
        elif time.monotonic() - heard > CAPTURE_S + row_s:
            raise BoardError(f"capture: stalled at {len(words)} of {total} words: check that the board is sampling")
        elif len(words) < total:
            time.sleep(min(LOOK_S, row_s))
    _write_capture(text.file, words, part.row, row_s, metres)
    return f"{text.file}: {len(words) // part.row} rows, one every {1e6 * row_s:g} us"


def stream(client: Client, text: argparse.Namespace) -> None:
    """Play a sound file as the envelope of the amplitude, then stop."""
    client.start(client.share_of(text.reference))
    while (before := client.status()).state == "identify":
        time.sleep(LOOK_S)
    without_fault(before, "stream")
    client.stream(text.every)
    late = _give(client, text.factors, text.every / WINDOW_HZ)
    without_fault(client.status(), "stream")
    client.stop()
    print(f"{len(text.factors)} samples at {WINDOW_HZ / text.every:g} Hz" + (f", {late} came late" if late else ""))


def factors_of(file: Path, rate_hz: float) -> list[float]:
    """Resample the first channel of a WAV file to amplitude factors.

    Parameters
    ----------
    file : Path
        WAV file of any sample width, rate and number of channels.
    rate_hz : float
        Rate of the factors, in Hz.

    Returns
    -------
    list of float
        Factors from 0 (for -1 in the file) to 1, each the mean over its duration.

    Raises
    ------
    ValueError
        If the file is not a WAV file, or holds no samples.
    """
    try:
        with wave.open(str(file)) as sound:
            width, step = sound.getsampwidth(), sound.getnchannels() * sound.getsampwidth()
            own_hz, data = sound.getframerate(), sound.readframes(sound.getnframes())
    except (OSError, EOFError, wave.Error) as error:
        raise ValueError(f"{file}: {getattr(error, 'strerror', None) or str(error) or 'ends too early'}") from None
    codes = np.frombuffer(data[: len(data) // step * step], np.uint8).reshape(-1, step)[:, :width].astype(float)
    if not len(codes) or own_hz < 1:
        raise ValueError(f"{file}: no samples in it")
    if width > 1:  # signed: shift the most negative code to 0
        codes[:, -1] = (codes[:, -1] + 128.0) % 256.0
    levels = codes @ 256.0 ** np.arange(width) / (256.0**width - 1.0)
    starts = np.arange(max(round(len(levels) * rate_hz / own_hz), 1) + 1) * own_hz / rate_hz
    return [float(levels[first : max(end, first + 1)].mean()) for first, end in pairwise(starts.astype(int).tolist())]


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


def _looks(client: Client, seconds: float | None) -> Iterator[SingleStatus | SixStatus]:
    end = None if seconds is None else time.monotonic() + seconds
    while end is None or time.monotonic() < end:
        yield client.status()
        time.sleep(LOOK_S)


def _bars(result: SingleStatus | SixStatus, traces: dict[str, str]) -> list[str]:
    faults = f", faults: {', '.join(result.faults)}" if result.faults else ""
    values = {"reference": result.reference}
    if isinstance(result, SixStatus):
        values |= {f"sensor {number + 1}": abs(z) for number, z in enumerate(result.sensors)}
    else:
        values |= {"measured": abs(result.measured), "drive": abs(result.drive)}
    for name, value in values.items():
        traces[name] = (traces[name] + LEVELS[round(level(value) * (len(LEVELS) - 1))])[-BAR:]
    shown = {
        name: amplitude(value, result, ".4f") if name != "drive" else figure(value, ".4f")
        for name, value in values.items()
    }
    bars = [f"{name:10} {bar(value)} {shown[name]:>10} {traces[name]}" for name, value in values.items()]
    return [f"state {result.state}{faults}", *bars]


def _write_capture(file: Path, words: list[int], row: int, row_s: float, metres: float) -> None:
    channels = range(1, row // 2 + 1)
    physical = [f"input_{i}_um" for i in channels] + ["output_1_V"] * (row == 2) if metres > 0.0 else []
    with file.open("w", newline="") as opened:
        rows = csv.writer(opened)
        rows.writerow(["time_s", *(f"input_{i}" for i in channels), *(f"output_{i}" for i in channels), *physical])
        for index in range(len(words) // row):
            codes = words[index * row : (index + 1) * row]
            inputs = [1e6 * metres * (code - CODE_MIDDLE) / CODE_MIDDLE for code in codes[: row // 2]]
            values = [*inputs, PIN_VOLTS * (codes[-1] - CODE_MIDDLE) / CODE_SWING][: len(physical)]
            rows.writerow([f"{index * row_s:.9g}", *codes, *(f"{value:.6g}" for value in values)])


def _records(client: Client, seconds: float | None) -> Iterator[Record]:
    """Yield log records as they arrive; read continuously, because a port buffers at most 4096 bytes."""
    now = next_look = time.monotonic()
    end = None if seconds is None else now + seconds
    while end is None or now < end:
        if now >= next_look:
            client.status()
            next_look = now + LOOK_S
        yield from client.take_records()
        now = time.monotonic()


def _row(record: Record, metres: float) -> list[object]:
    parts = [record.measured.real, record.measured.imag, record.drive.real, record.drive.imag, record.reference]
    parts += [1e6 * metres * share for share in (abs(record.measured), record.reference)] if metres > 0.0 else []
    return [record.window, *(figure(part, ".7g") for part in parts)]


def _missing(last: Record | None, record: Record, every: int) -> int:
    return max((record.window - last.window) % 2**32 // every - 1, 0) if last else 0


def _give(client: Client, factors: list[float], sample_s: float) -> int:
    """Keep the board's sample buffer filled, wait until it has been played, and return the number of late samples."""
    at, waits, before = 0, 0, None
    while at < len(factors):
        piece = factors[at : at + PIECE]
        taken = client.samples(piece)
        at, waits = at + taken, 0 if taken else waits + 1
        if waits > MAX_WAITS:
            raise BoardError(f"stream: the board accepts no samples; {at} of {len(factors)} were played")
        if before is None:
            before = client.status().underruns  # underruns before the first samples do not count
        if taken < len(piece):
            _wait(client, PIECE * sample_s)
    late = client.status().underruns - (before or 0)
    _wait(client, STORE * sample_s)
    return late


def _wait(client: Client, seconds: float) -> None:
    """Wait, and keep up the contact with the board."""
    end = time.monotonic() + seconds
    while (left := end - time.monotonic()) > 0.0:
        time.sleep(min(LOOK_S, left))
        client.status()


def _ask(text: str) -> None:
    print(text, flush=True)
    if sys.stdin.isatty():
        input("Press Enter when ready. ")
