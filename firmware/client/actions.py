"""What the client does for each word of its command line."""

from __future__ import annotations

import argparse
import csv
import sys
import time
import wave
from collections import defaultdict
from collections.abc import Iterator
from contextlib import suppress
from itertools import pairwise
from math import log10
from pathlib import Path

import numpy as np

from firmware.client.client import BoardError, Client, figure
from firmware.mode_table import RATE_HZ
from firmware.protocol import PAYLOAD_MAX, Record, SingleStatus, SixStatus

LOOK_S = 0.1  # between two looks at the board, which also keep it from falling silent
DRIVING = ("identify", "run")
WINDOW_HZ = RATE_HZ["single"] / 50  # single build: windows of 50 samples
BAR, BAR_DB = 30, 60.0
STEPS = " ▁▂▃▄▅▆▇█"


def start(client: Client, text: argparse.Namespace) -> None:
    """Drives the target mode and holds it."""
    client.start(text.reference, text.detuning)
    keep_running(client, "start")


def pattern(client: Client, text: argparse.Namespace) -> None:
    """Holds a pattern of the present shape."""
    client.pattern(text.number, text.reference)
    keep_running(client, "pattern")


def identify(client: Client, text: argparse.Namespace) -> None:
    """Measures the plate, then rests."""
    client.identify()
    keep_running(client, "identify")


def without_fault(result: SingleStatus | SixStatus, action: str) -> None:
    """Raises BoardError when the board is in a fault."""
    if result.state == "fault":
        raise BoardError(f"{action}: ended in the fault {', '.join(result.faults)}")


def keep_running(client: Client, action: str) -> None:
    """Prints a line ten times a second and thereby keeps the board from stopping, until it rests; as without_fault."""
    while True:
        result = client.status()
        measured = figure(abs(result.measured), ".4f")
        print(f"{result.state}  reference {figure(result.reference, '.4f')}  measured {measured}", flush=True)
        if result.state not in DRIVING:
            client.drives = False
            return without_fault(result, action)
        time.sleep(LOOK_S)


def watch(client: Client, text: argparse.Namespace) -> str:
    """What the board measures as bars and as a plot over the last looks, on one place of a terminal or as lines, until a
    time or Ctrl-C."""
    height, traces = 0, defaultdict[str, str](str)
    for result in _looks(client, text.seconds):
        lines = _bars(result, traces)
        again = f"\x1b[{height}F\x1b[J" if height and sys.stdout.isatty() else ""
        print(again + "\n".join(lines), flush=True)
        height = len(lines)
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
        traces[name] = (traces[name] + STEPS[round(level(value) * (len(STEPS) - 1))])[-BAR:]
    bars = [f"{name:10} {bar(value)} {figure(value, '.4f'):>10} {traces[name]}" for name, value in values.items()]
    return [f"state {result.state}{faults}", *bars]


def level(share: float) -> float:
    """A share of full scale from 0 at -60 dB (or not a number) to 1 at 0 dB."""
    return min(max(1.0 + 20.0 * log10(share) / BAR_DB, 0.0), 1.0) if share > 0.0 else 0.0


def bar(share: float) -> str:
    """A share of full scale as a bar: empty at -60 dB, full at 0 dB."""
    filled = round(BAR * level(share))
    return "#" * filled + "." * (BAR - filled)


def log(client: Client, text: argparse.Namespace) -> str:
    """Writes a record each so many windows into a file of comma-separated values, until a time or Ctrl-C."""
    count = lost = 0
    last: Record | None = None
    client.log(text.every)
    try:
        with text.file.open("w", newline="") as file:
            rows = csv.writer(file)
            rows.writerow(["window", "measured_d", "measured_q", "drive_d", "drive_q", "reference"])
            for record in _records(client, text.seconds):
                lost += _missing(last, record, text.every)
                count, last = count + 1, record
                rows.writerow(_row(record))
    finally:
        with suppress(BoardError, OSError):
            client.log(0)
        print(f"{text.file}: {count} records" + (f", {lost} were lost: try a larger --every" if lost else ""))
    return ""


SAMPLE_HZ = {2: RATE_HZ["single"], 12: RATE_HZ["six"]}  # by the words in a row
CAPTURE_S = 2.0  # how long nothing may come beyond the time of a row


def capture(client: Client, text: argparse.Namespace) -> str:
    """Writes what the converters saw and were told, sample by sample, into a file of comma-separated values.

    Codes as they are: of the ADC, then of the DAC or of the timers' compare registers. Raises BoardError when it stands still.
    """
    client.capture(text.every)
    words: list[int] = []
    total, heard = 1, time.monotonic()
    while len(words) < total:
        part = client.captured(len(words))
        words, total, row_s = [*words, *part.words], part.total, text.every / SAMPLE_HZ[part.row]
        if part.words:
            heard = time.monotonic()
        elif time.monotonic() - heard > CAPTURE_S + row_s:
            raise BoardError(f"capture: stands at {len(words)} of {total} words: do samples still come?")
        elif len(words) < total:
            time.sleep(min(LOOK_S, row_s))
    _write_capture(text.file, words, part.row, row_s)
    return f"{text.file}: {len(words) // part.row} rows, one each {1e6 * row_s:g} us"


def _write_capture(file: Path, words: list[int], row: int, row_s: float) -> None:
    channels = range(1, row // 2 + 1)
    with file.open("w", newline="") as opened:
        rows = csv.writer(opened)
        rows.writerow(["time_s", *(f"input_{i}" for i in channels), *(f"output_{i}" for i in channels)])
        for index in range(len(words) // row):
            rows.writerow([f"{index * row_s:.9g}", *words[index * row : (index + 1) * row]])


def _records(client: Client, seconds: float | None) -> Iterator[Record]:
    """The log as it comes: read all the time, because a port keeps no more than 4096 bytes."""
    now = next_look = time.monotonic()
    end = None if seconds is None else now + seconds
    while end is None or now < end:
        if now >= next_look:
            client.status()
            next_look = now + LOOK_S
        yield from client.take_records()
        now = time.monotonic()


def _row(record: Record) -> list[object]:
    parts = (record.measured.real, record.measured.imag, record.drive.real, record.drive.imag, record.reference)
    return [record.window, *(figure(part, ".7g") for part in parts)]


def _missing(last: Record | None, record: Record, every: int) -> int:
    return max((record.window - last.window) % 2**32 // every - 1, 0) if last else 0


def stream(client: Client, text: argparse.Namespace) -> None:
    """Plays a sound file as the amplitude's envelope, then stops."""
    client.start(text.reference)
    while (before := client.status()).state == "identify":
        time.sleep(LOOK_S)
    without_fault(before, "stream")
    client.stream(text.every)
    late = _give(client, text.factors, text.every / WINDOW_HZ)
    without_fault(client.status(), "stream")
    client.stop()
    print(f"{len(text.factors)} samples at {WINDOW_HZ / text.every:g} Hz" + (f", {late} came late" if late else ""))


def _give(client: Client, factors: list[float], sample_s: float) -> int:
    """Keeps the board's store of samples filled, then waits until it is played; how many were missing meanwhile."""
    at, waits, before = 0, 0, None
    while at < len(factors):
        piece = factors[at : at + PIECE]
        taken = client.samples(piece)
        at, waits = at + taken, 0 if taken else waits + 1
        if waits > MAX_WAITS:
            raise BoardError(f"stream: the board takes no samples, {at} of {len(factors)} are played")
        if before is None:
            before = client.status().underruns  # those from before the first samples do not count
        if taken < len(piece):
            time.sleep(PIECE * sample_s)
    late = client.status().underruns - (before or 0)
    time.sleep(STORE * sample_s)
    return late


PIECE = PAYLOAD_MAX // 2  # samples in a request
STORE = 256  # samples that the board has room for
MAX_WAITS = 4 * STORE // PIECE  # for room: four times what a full store plays for


def factors_of(file: Path, rate_hz: float) -> list[float]:
    """A WAV file's first channel at another rate: -1 to 1 becomes 0 to 1, each sample the mean over its time.

    Raises ValueError for a file that is none, or that has no samples.
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
    if width > 1:  # signed: from the most negative one on
        codes[:, -1] = (codes[:, -1] + 128.0) % 256.0
    levels = codes @ 256.0 ** np.arange(width) / (256.0**width - 1.0)
    starts = np.arange(max(round(len(levels) * rate_hz / own_hz), 1) + 1) * own_hz / rate_hz
    return [float(levels[first : max(end, first + 1)].mean()) for first, end in pairwise(starts.astype(int).tolist())]
