"""Actions of the client's command line."""

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

LOOK_S = 0.1  # between two status requests, which also keep up the contact with the board
DRIVING = ("identify", "run")
WINDOW_HZ = RATE_HZ["single"] / 50  # single build: windows of 50 samples
BAR, BAR_DB = 30, 60.0
STEPS = " ▁▂▃▄▅▆▇█"


def start(client: Client, text: argparse.Namespace) -> None:
    """Drive the target mode and hold it."""
    client.start(text.reference, text.detuning)
    keep_running(client, "start")


def pattern(client: Client, text: argparse.Namespace) -> None:
    """Hold a pattern of the current shape."""
    client.pattern(text.number, text.reference)
    keep_running(client, "pattern")


def identify(client: Client, text: argparse.Namespace) -> None:
    """Measure the plate, then rest."""
    client.identify()
    keep_running(client, "identify")


def without_fault(result: SingleStatus | SixStatus, action: str) -> None:
    """Raise BoardError if the board is in the fault state."""
    if result.state == "fault":
        raise BoardError(f"{action}: ended with fault {', '.join(result.faults)}")


def keep_running(client: Client, action: str) -> None:
    """Print the status ten times per second, which keeps the board running, until it rests.

    Raises
    ------
    BoardError
        If the board ends in the fault state.
    """
    while True:
        result = client.status()
        measured = figure(abs(result.measured), ".4f")
        print(f"{result.state}  reference {figure(result.reference, '.4f')}  measured {measured}", flush=True)
        if result.state not in DRIVING:
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


SAMPLE_HZ = {2: RATE_HZ["single"], 12: RATE_HZ["six"]}  # by words per row
CAPTURE_S = 2.0  # time-out without new words, in addition to the duration of a row


def capture(client: Client, text: argparse.Namespace) -> str:
    """Write the raw converter codes, sample by sample, to a CSV file.

    Each row holds the ADC codes, then those of the DAC or of the timers' compare registers.

    Raises
    ------
    BoardError
        If the capture stalls.
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
            raise BoardError(f"capture: stalled at {len(words)} of {total} words: check that the board is sampling")
        elif len(words) < total:
            time.sleep(min(LOOK_S, row_s))
    _write_capture(text.file, words, part.row, row_s)
    return f"{text.file}: {len(words) // part.row} rows, one every {1e6 * row_s:g} us"


def _write_capture(file: Path, words: list[int], row: int, row_s: float) -> None:
    channels = range(1, row // 2 + 1)
    with file.open("w", newline="") as opened:
        rows = csv.writer(opened)
        rows.writerow(["time_s", *(f"input_{i}" for i in channels), *(f"output_{i}" for i in channels)])
        for index in range(len(words) // row):
            rows.writerow([f"{index * row_s:.9g}", *words[index * row : (index + 1) * row]])


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


def _row(record: Record) -> list[object]:
    parts = (record.measured.real, record.measured.imag, record.drive.real, record.drive.imag, record.reference)
    return [record.window, *(figure(part, ".7g") for part in parts)]


def _missing(last: Record | None, record: Record, every: int) -> int:
    return max((record.window - last.window) % 2**32 // every - 1, 0) if last else 0


def stream(client: Client, text: argparse.Namespace) -> None:
    """Play a sound file as the envelope of the amplitude, then stop."""
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
            time.sleep(PIECE * sample_s)
    late = client.status().underruns - (before or 0)
    time.sleep(STORE * sample_s)
    return late


PIECE = PAYLOAD_MAX // 2  # samples per request
STORE = 256  # capacity of the board's sample buffer
MAX_WAITS = 4 * STORE // PIECE  # four times the duration of a full buffer


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
