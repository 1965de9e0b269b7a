"""Talks to a board over its serial line; `python -m firmware.client --help` tells what it can be asked."""

from __future__ import annotations

import math
import secrets
import struct
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial
from typing import Any, Protocol

from firmware.protocol import (
    FRAME_MAX,
    KEPT,
    LOG_RECORDS,
    PAYLOAD_MAX,
    REPLY,
    RESULT_TEXT,
    TABLE_TEXT,
    Captured,
    Health,
    Identity,
    Kind,
    Message,
    ProtocolError,
    Record,
    Result,
    SingleStatus,
    SixStatus,
    decode,
    encode,
    nothing,
    one_byte,
    parse,
    parse_captured,
    parse_identity,
    parse_log,
    parse_status,
)

READ_BYTES = 256
BUSY_READS = 300  # full reads in a row, 0.8 s of a line that never rests
BUSY_S = 2.0  # how long a line that brings something else than the reply is heard


class Port(Protocol):
    """What is asked of a serial port: pyserial's Serial with a time-out has it."""

    def write(self, data: bytes, /) -> object: ...
    def read(self, size: int = 1, /) -> bytes: ...


class BoardError(RuntimeError):
    """The board refused, did not answer, or answered something that the protocol does not allow."""


class Refused(BoardError):
    """The board understood, and said no."""


class Client:
    """One board on a port. Requests are repeated when nothing comes back; all of them may be repeated safely.

    drives: it may be at work because of what was asked here, and has not been asked to rest since.
    """

    def __init__(self, port: Port, attempts: int = 3, reads: int = 50) -> None:
        self.port, self.attempts, self.reads = port, attempts, reads
        self.sequence = secrets.randbelow(256)  # else its first request might be taken for a repeated one
        self.buffer = b""
        self.records: list[Record] = []
        self.drives = False

    def request(self, kind: Kind, payload: bytes = b"", parsed: Callable[[bytes], Any] = nothing) -> Any:
        """What the reply's payload holds behind its result. Raises BoardError for none, a refusal, or another version's."""
        self.sequence = (self.sequence + 1) % 256
        frame = encode(Message(kind, self.sequence, payload))
        for _ in range(self.attempts):
            self.port.write(frame)
            reply = self._reply(kind)
            if reply is not None:
                return self._accepted(kind, reply, parsed)
        raise BoardError(f"no answer to {kind.name.lower()}")

    def status(self) -> SingleStatus | SixStatus:
        """What the board does now; also tells it that the host is alive."""
        return self.request(Kind.STATUS, parsed=parse_status)

    def identity(self) -> Identity:
        """Which build the board runs, and which table it has."""
        return self.request(Kind.IDENTITY, parsed=parse_identity)

    def health(self) -> Health:
        """Clock, longest interrupts, what was unexpected since power-on."""
        return self.request(Kind.HEALTH, parsed=partial(parse, Health))

    def identify(self) -> None:
        """Measures the plate again, then rests. From then on talk at least twice a second."""
        self._drive(Kind.IDENTIFY)

    def pattern(self, number: int, reference: float = 0.0) -> None:
        """Six channels: holds a pattern of the present shape; 0 asks for half of what is reachable. Talk on as after start."""
        status = self.status()
        if not isinstance(status, SixStatus):
            raise Refused("pattern: this board's image is the one for one mode")
        if status.state == "run":
            self.request(Kind.PATTERN, struct.pack("<II", status.choice[0], number))
            if reference > 0.0:
                self.reference(reference)
        else:
            self._drive(Kind.START, struct.pack("<If", number, reference))

    def choose(self, shape: int) -> None:
        """Six channels: another shape, which is another frequency; only when idle."""
        if shape != self.shape():
            self.request(Kind.PATTERN, struct.pack("<II", shape, 0))

    def shape(self) -> int:
        """Six channels: the present shape."""
        status = self.status()
        return status.choice[0] if isinstance(status, SixStatus) else 0

    def start(self, reference: float = 0.0, detuning_hz: float = 0.0) -> None:
        """Drives the target mode; 0 asks for the lowest useful level. From then on talk at least twice a second."""
        self._drive(Kind.START, struct.pack("<ff", reference, detuning_hz))

    def stop(self) -> None:
        """Back to rest."""
        self.request(Kind.STOP)
        self.drives = False

    def clear(self) -> None:
        """Leaves the fault state."""
        self.request(Kind.CLEAR)

    def reference(self, level: float) -> None:
        """A new amplitude while running, in full scales of the sensor."""
        self.request(Kind.REFERENCE, struct.pack("<f", level))

    def sine(self, rate_hz: float, depth: float) -> None:
        """A texture: the amplitude swings between 1 and 1 - depth of the reference."""
        self.request(Kind.SINE, struct.pack("<ff", rate_hz, depth))

    def stream(self, every: int) -> None:
        """A texture of samples that follow, each for so many windows."""
        self.request(Kind.STREAM, struct.pack("<I", every))

    def samples(self, factors: list[float]) -> int:
        """Adds factors from 0 to 1 to the stream; returns how many there was room for."""
        codes = [round(min(max(factor, 0.0), 1.0) * 65535) for factor in factors[: PAYLOAD_MAX // 2]]
        return self.request(Kind.SAMPLES, struct.pack(f"<{len(codes)}H", *codes), one_byte)

    def log(self, every: int) -> None:
        """A record each so many windows, to be taken by take_records; 0 ends it."""
        self.request(Kind.LOG, struct.pack("<I", every))

    def capture(self, every: int) -> None:
        """Inputs and outputs of all channels, from now on, each so many samples, as long as there is room."""
        self.request(Kind.CAPTURE, struct.pack("<I", every))

    def captured(self, start: int) -> Captured:
        """A part of the capture, from a word on."""
        return self.request(Kind.CAPTURED, struct.pack("<I", start), parse_captured)

    def upload(self, table: bytes) -> None:
        """Puts another mode table into the board's flash memory; the outputs rest meanwhile."""
        self.request(Kind.UPLOAD_BEGIN, struct.pack("<I", len(table)))
        piece = PAYLOAD_MAX - 4
        for offset in range(0, len(table), piece):
            self.request(Kind.UPLOAD_DATA, struct.pack("<I", offset) + table[offset : offset + piece])
        self.request(Kind.UPLOAD_END)

    def take_records(self) -> list[Record]:
        """The log's records that came since the last time; ends while the board sends on. Raises BoardError."""
        for _ in range(BUSY_READS):
            data = self._read()
            for message in self._messages(data):
                self._keep(message)
            if len(data) < READ_BYTES:
                break
        taken, self.records = self.records, []
        return taken

    def _drive(self, kind: Kind, payload: bytes = b"") -> None:
        """A request that makes the board move; one without an answer may have done so, too."""
        before, self.drives = self.drives, True
        try:
            self.request(kind, payload)
        except Refused:
            self.drives = before
            raise

    def _reply(self, kind: Kind) -> Message | None:
        silent, end = 0, time.monotonic() + BUSY_S
        while silent < self.reads:
            data, reply = self._read(), None
            if data and time.monotonic() > end:
                break
            silent += not data
            for message in self._messages(data):
                if message.kind == kind | REPLY and message.sequence == self.sequence:
                    reply = message
                self._keep(message)
            if reply is not None:
                return reply
        return None

    def _read(self) -> bytes:
        return self.port.read(READ_BYTES)

    def _messages(self, data: bytes) -> Iterator[Message]:
        *frames, last = (self.buffer + data).split(b"\0")
        self.buffer = last[-FRAME_MAX:]
        for frame in frames:
            message = decode(frame)
            if message is not None:
                yield message

    def _keep(self, message: Message) -> None:
        if message.kind == LOG_RECORDS:
            with _in_words(Kind.LOG):
                self.records += parse_log(message.payload)

    def _accepted(self, kind: Kind, reply: Message, parsed: Callable[[bytes], Any]) -> Any:
        if not reply.payload:
            raise BoardError(f"{kind.name.lower()}: an empty reply, {OTHER_VERSION}")
        result, more = reply.payload[0], reply.payload[1:]
        if result == Result.OK:
            with _in_words(kind):
                return parsed(more)
        raise Refused(f"{kind.name.lower()}: {_refusal(result, more)}")


OTHER_VERSION = "so the image may be of another version than this client"


@contextmanager
def _in_words(kind: Kind) -> Iterator[None]:
    """Turns what the protocol does not allow into words for the one who asked."""
    try:
        yield
    except ProtocolError as error:
        raise BoardError(f"{kind.name.lower()}: the board sent {error}, {OTHER_VERSION}") from None


def _refusal(result: int, more: bytes) -> str:
    if result not in list(Result):
        return f"refused for the unknown reason {result}"
    text = RESULT_TEXT[Result(result)]
    if result != Result.TABLE_REFUSED or not more:
        return text
    return f"{text}: {TABLE_TEXT[more[0]] if more[0] < len(TABLE_TEXT) else f'unknown reason {more[0]}'}"


def describe(status: SingleStatus | SixStatus) -> str:
    """A status for a reader."""
    faults = f", faults: {', '.join(status.faults)}" if status.faults else ""
    if len(status.faults) > len(status.first) > 0:
        faults += f" (first {', '.join(status.first)})"
    if status.limited:
        faults += ", drive at its limit, short of the reference"
    lines = _six_lines(status) if isinstance(status, SixStatus) else _single_lines(status)
    return "\n".join([f"state {status.state}{faults}", *lines])


def _single_lines(status: SingleStatus) -> list[str]:
    gain = figure(abs(status.gain), ".5g") if status.identified else "unidentified"
    return [
        f"mode {figure(status.frequency_hz, '.3f')} Hz, tau {figure(status.tau_s * 1e3, '.4g')} ms, gain {gain}, "
        f"delay {figure(status.delay_s * 1e6, '.3g')} us, neighbours up to {figure(status.neighbour, '.3g')}",
        f"reference {figure(status.reference, '.4g')}, measured {figure(abs(status.measured), '.4g')}, "
        f"drive {figure(abs(status.drive), '.4g')}, offset {figure(status.offset, '.3g')} of full scale",
        f"worst fast interrupt {status.worst_cycles} cycles of 720",
    ]


def _six_lines(status: SixStatus) -> list[str]:
    matrix = f"condition {figure(status.condition, '.3g')}" if status.identified else "not measured yet"
    sensors = ", ".join(figure(abs(z), ".4g") for z in status.sensors)
    return [
        f"shape {status.choice[0]} at {figure(status.frequency_hz, '.3f')} Hz, matrix {matrix}, pattern {status.choice[1]}",
        f"reference {figure(status.reference, '.4g')}, at most {figure(status.reachable, '.4g')}; "
        f"sensors {sensors} of full scale",
        f"worst fast interrupt {status.worst_cycles} cycles of 4500",
    ]


def describe_identity(identity: Identity) -> str:
    """An identity for a reader."""
    what = "modes" if identity.build == "single" else "shapes"
    table = f"{identity.count} {what}, design {identity.design.hex()}" if identity.count else "no sound mode table"
    return f"build {identity.build}, protocol {identity.protocol}, table version {identity.table_version}: {table}"


def describe_health(health: Health) -> str:
    """A health for a reader."""
    lines = [
        f"clock {health.core_hz / 1e6:g} MHz, resets by the watchdog in a row {health.watchdog_resets}",
        f"longest fast interrupt {health.fast_cycles} cycles, slow {health.slow_cycles}, main loop {health.main_cycles}",
        f"stack never used {health.stack_unused} bytes",
        f"measured values {KEPT[health.kept] if health.kept < len(KEPT) else f'in the unknown state {health.kept}'}",
    ]
    if health.exception:
        place = f"at 0x{health.pc:08x}, called from 0x{health.lr:08x}, CFSR 0x{health.cfsr:08x}"
        lines.append(f"unexpected exception {health.exception} {place}")
    return "\n".join(lines)


def figure(value: float, digits: str) -> str:
    """A number as text; one that the board could not compute is told in words."""
    return format(value, digits) if math.isfinite(value) else "not finite"
