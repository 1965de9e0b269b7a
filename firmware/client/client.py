"""Client for a board on the serial line: its port, requests, replies and their description for a reader."""

from __future__ import annotations

import math
import os
import secrets
import struct
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial
from importlib.util import find_spec
from typing import Any, NamedTuple, Protocol

from firmware.protocol import (
    BAUD,
    FAULTS,
    FRAME_MAX,
    KEPT,
    LOG_RECORDS,
    PAYLOAD_MAX,
    REPLY,
    REQUESTS,
    RESULT_TEXT,
    TABLE_TEXT,
    Captured,
    CapturedRequest,
    CaptureRequest,
    Chirp,
    Choose,
    Column,
    ColumnRequest,
    Health,
    Identity,
    Kind,
    LogRequest,
    Message,
    ProtocolError,
    Record,
    Reference,
    Result,
    Sine,
    SingleStatus,
    SixStart,
    SixStatus,
    Start,
    Status,
    Stream,
    UploadBegin,
    decode,
    encode,
    fault_names,
    nothing,
    one_byte,
    pack,
    parse,
    parse_captured,
    parse_identity,
    parse_log,
    parse_status,
)

ST_LINK = 0x0483  # USB vendor number of the debugger on a Nucleo

READ_BYTES = 256
BUSY_READS = 300  # consecutive full reads, 0.8 s of a line without a pause
BUSY_S = 2.0  # time-out for the reply on a line that carries other data
LASTING = {name for fault, text in FAULTS.items() if not text.clears for name in fault_names(fault)}
OTHER_VERSION = "image and client may have different versions"


class NotHere(RuntimeError):
    """A port or package is missing; the message says how to provide it."""


class SerialPort:
    """Serial port whose read returns the bytes received, after 20 ms at the latest.

    Raises
    ------
    NotHere
        If the port cannot be opened, or a package is missing.
    """

    def __init__(self, name: str) -> None:
        try:
            from serial import Serial
        except ImportError:
            raise NotHere("pyserial is not installed: pip install pyserial") from None
        if not find_spec("cobs"):
            raise NotHere("cobs (needed for the frames) is not installed: pip install cobs")
        name = the_board() if name == "auto" else name
        try:
            self.serial = Serial(name, BAUD, timeout=0.02, write_timeout=1.0)
        except (OSError, ValueError) as error:  # pyserial's SerialException is an OSError
            number = getattr(error, "errno", None)
            reason = os.strerror(number) if number else str(error)
            hint = "check that the board is plugged in, the name of the port, and that no other program uses it"
            raise NotHere(f"{name}: {reason}; {hint}") from None

    def write(self, data: bytes) -> object:
        """Send bytes to the board."""
        return self.serial.write(data)

    def read(self, size: int = 1) -> bytes:
        """Receive at most size bytes."""
        first: bytes = self.serial.read(1)
        waiting = min(self.serial.in_waiting, size - 1) if first else 0
        return first + self.serial.read(waiting) if waiting else first

    def close(self) -> None:
        """Close the port."""
        self.serial.close()


class Port(Protocol):
    """Interface of a serial port, as of pyserial's Serial with a time-out."""

    def write(self, data: bytes, /) -> object: ...
    def read(self, size: int = 1, /) -> bytes: ...


class BoardError(RuntimeError):
    """The board refused a request, did not answer, or violated the protocol."""


class Refused(BoardError):
    """The board understood a request and refused it."""


class _RefusedNow(Refused):
    """Refused only in the present state."""


class Level(NamedTuple):
    """Amplitude: a fraction of full scale, or in the unit "um"."""

    value: float
    unit: str = ""


class Client:
    """One board on a port; unanswered requests are repeated, which is safe for all of them.

    Attributes
    ----------
    drives : bool
        True if the board may be driving because of a request from here, and has not been stopped since.
    """

    def __init__(self, port: Port, attempts: int = 3, reads: int = 50) -> None:
        self.port, self.attempts, self.reads = port, attempts, reads
        self.sequence = secrets.randbelow(256)  # otherwise the first request might look like a repetition
        self.buffer = b""
        self.records: list[Record] = []
        self.drives = False

    def request(self, kind: Kind, payload: bytes = b"", parsed: Callable[[bytes], Any] = nothing) -> Any:
        """Send a request and return the parsed payload of its reply.

        Parameters
        ----------
        kind : Kind
        payload : bytes, optional
        parsed : callable, optional
            Parser of the reply's payload after the result byte.

        Raises
        ------
        BoardError
            If there is no reply, the board refuses, or the reply does not match this protocol version.
        """
        self.sequence = (self.sequence + 1) % 256
        frame = encode(Message(kind, self.sequence, payload))
        for _ in range(self.attempts):
            self.port.write(frame)
            reply = self._reply(kind)
            if reply is not None:
                try:
                    return self._accepted(kind, reply, parsed)
                except _RefusedNow as refused:
                    raise Refused(f"{refused}{self._why_not(kind)}") from None
        raise BoardError(f"no answer to {kind.name.lower()}")

    def set(self, request: object) -> None:
        """Send one of protocol.REQUESTS; a build's own ones go through start and pattern."""
        self.request(next(kind for kind, ones in REQUESTS.items() if type(request) in ones), pack(request))

    def share_of(self, level: Level) -> float:
        """Return a level as a fraction of the sensor's full scale. Raises ValueError if the table has no metres for it."""
        if not level.unit:
            return level.value
        metres = self.status().metres
        if not metres > 0.0:
            raise ValueError(
                f"{level.value:g} um: the board's table has no metres per volt; give a fraction of full scale"
            )
        share = 1e-6 * level.value / metres
        if share > 1.0:
            raise ValueError(f"{level.value:g} um: must be at most {1e6 * metres:.4g} um with the board's table")
        return share

    def status(self) -> SingleStatus | SixStatus:
        """Read the status, which also counts as contact with the host."""
        return self.request(Kind.STATUS, parsed=parse_status)

    def identity(self) -> Identity:
        """Read the identity of build and table."""
        return self.request(Kind.IDENTITY, parsed=parse_identity)

    def health(self) -> Health:
        """Read clock, longest interrupts, and the last unexpected exception since power-on."""
        return self.request(Kind.HEALTH, parsed=partial(parse, Health))

    def identify(self) -> None:
        """Measure the plate again, then rest; requires contact at least twice per second."""
        self._drive(Kind.IDENTIFY)

    def pattern(self, number: int, reference: float = 0.0) -> None:
        """Hold a pattern of the current shape of a six-channel board; requires contact as for start.

        Parameters
        ----------
        number : int
            Index of the pattern.
        reference : float, optional
            Amplitude as a fraction of the sensor's full scale; 0 selects half of the reachable one.
        """
        status = self.status()
        if not isinstance(status, SixStatus):
            raise Refused("pattern: this board runs the single-mode image")
        if status.state == "run":
            self.set(Choose(status.shape, number))
            if reference > 0.0:
                self.reference(reference)
        else:
            self._drive(Kind.START, pack(SixStart(number, reference)))

    def choose(self, shape: int) -> None:
        """Select another shape of a six-channel board, and with it another frequency; only when idle."""
        if shape != self.shape():
            self.set(Choose(shape, 0))

    def shape(self) -> int:
        """Read the index of the current shape of a six-channel board."""
        status = self.status()
        return status.choice[0] if isinstance(status, SixStatus) else 0

    def start(self, reference: float = 0.0, detuning_hz: float = 0.0) -> None:
        """Drive the target mode; requires contact at least twice per second.

        Parameters
        ----------
        reference : float, optional
            Amplitude as a fraction of the sensor's full scale; 0 selects the lowest useful level.
        detuning_hz : float, optional
            Offset of the drive from the resonance, in Hz.
        """
        self._drive(Kind.START, pack(Start(reference, detuning_hz)))

    def chirp(self, chirp: Chirp) -> None:
        """Drive a chirp and record its response, until stopped; requires contact at least twice per second."""
        self._drive(Kind.CHIRP, pack(chirp))

    def column(self, actuator: int) -> Column:
        """Return the measured responses to an actuator (six-channel build)."""
        return self.request(Kind.COLUMN, pack(ColumnRequest(actuator)), partial(parse, Column))

    def stop(self) -> None:
        """Return to rest."""
        self.request(Kind.STOP)
        self.drives = False

    def clear(self) -> None:
        """Leave the fault state."""
        self.request(Kind.CLEAR)

    def reference(self, level: float) -> None:
        """Change the amplitude while running, as a fraction of the sensor's full scale."""
        self.set(Reference(level))

    def sine(self, rate_hz: float, depth: float) -> None:
        """Modulate the amplitude sinusoidally between 1 and 1 - depth of the reference."""
        self.set(Sine(rate_hz, depth))

    def stream(self, every: int) -> None:
        """Start a texture from samples that follow, each lasting every windows."""
        self.set(Stream(every))

    def samples(self, factors: list[float]) -> int:
        """Add factors from 0 to 1 to the stream; return the number accepted."""
        codes = [round(min(max(factor, 0.0), 1.0) * 65535) for factor in factors[: PAYLOAD_MAX // 2]]
        return self.request(Kind.SAMPLES, struct.pack(f"<{len(codes)}H", *codes), one_byte)

    def log(self, every: int) -> None:
        """Start a log with one record per `every` windows, read by take_records; 0 stops it."""
        self.set(LogRequest(every))

    def capture(self, every: int) -> None:
        """Start a capture of all inputs and outputs, one row per `every` samples, until the board's memory is full."""
        self.set(CaptureRequest(every))

    def captured(self, start: int) -> Captured:
        """Read a part of the capture, from a word onwards."""
        return self.request(Kind.CAPTURED, pack(CapturedRequest(start)), parse_captured)

    def upload(self, table: bytes) -> None:
        """Write another mode table to the board's flash memory, with the outputs at rest."""
        self.set(UploadBegin(len(table)))
        piece = PAYLOAD_MAX - 4
        for offset in range(0, len(table), piece):
            self.request(Kind.UPLOAD_DATA, struct.pack("<I", offset) + table[offset : offset + piece])
        self.request(Kind.UPLOAD_END)

    def take_records(self) -> list[Record]:
        """Return the log records received since the last call, even if the board keeps sending. Raises BoardError."""
        for _ in range(BUSY_READS):
            data = self._read()
            for message in self._messages(data):
                self._keep(message)
            if len(data) < READ_BYTES:
                break
        taken, self.records = self.records, []
        return taken

    def _drive(self, kind: Kind, payload: bytes = b"") -> None:
        """Send a request that makes the board drive; even without an answer, it may have started."""
        before, self.drives = self.drives, True
        try:
            self.request(kind, payload)
        except Refused:
            self.drives = before
            raise

    def _why_not(self, kind: Kind) -> str:
        """State that forbids a request, and how to leave it."""
        try:
            status = None if kind is Kind.STATUS else self.status()
        except BoardError:
            status = None
        if status is None:
            return ""
        if status.state == "fault":
            lasting = sorted(LASTING.intersection(status.faults))
            way = f"cannot leave {' and '.join(lasting)}" if lasting else "leaves it"
            return f", fault {', '.join(status.faults)}: `clear` {way}"
        return f", {status.state}" + (": `stop` ends it" if status.state != "idle" else "")

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
            raise BoardError(f"{kind.name.lower()}: empty reply; {OTHER_VERSION}")
        result, more = reply.payload[0], reply.payload[1:]
        if result == Result.OK:
            with _in_words(kind):
                return parsed(more)
        raise (_RefusedNow if result == Result.NOT_NOW else Refused)(f"{kind.name.lower()}: {_refusal(result, more)}")


def the_board() -> str:
    """Return the name of the only serial port that belongs to a board's debugger.

    Raises
    ------
    NotHere
        If there is none.
    ValueError
        If there are several.
    """
    from serial.tools.list_ports import comports

    ports = list(comports())
    boards = [port.device for port in ports if port.vid == ST_LINK]
    if not boards:
        others = ", ".join(port.device for port in ports) or "none"
        raise NotHere(f"no board found (other serial ports: {others}): plug it in, or name its port")
    if len(boards) > 1:
        raise ValueError(f"several boards found: choose one of {', '.join(boards)} with --port")
    return boards[0]


def describe(status: SingleStatus | SixStatus) -> str:
    """Describe a status for a reader."""
    faults = f", faults: {', '.join(status.faults)}" if status.faults else ""
    if len(status.faults) > len(status.first) > 0:
        faults += f" (first {', '.join(status.first)})"
    if status.retries:
        faults += ", tries again"
    if status.gave_up:
        faults += f", {given_up(status)}"
    if status.eased:
        faults += ", drive limited to half after ten seconds at or near its limit"
    if status.limited:
        faults += ", drive at its limit, reference not reached"
    lines = _six_lines(status) if isinstance(status, SixStatus) else _single_lines(status)
    return "\n".join([f"state {status.state}{faults}", *lines])


def given_up(status: Status) -> str:
    """Say why a board gave its job up, and what to do."""
    return (
        f"gave up, because every retry ended with {', '.join(status.first)}: take the hand off the plate and start again, "
        "or check the sensor"
    )


def describe_identity(identity: Identity) -> str:
    """Describe an identity for a reader."""
    what = "modes" if identity.build == "single" else "shapes"
    table = f"{identity.count} {what}, design {identity.design.hex()}" if identity.count else "no valid mode table"
    return f"build {identity.build}, protocol {identity.protocol}, table version {identity.table_version}: {table}"


def describe_health(health: Health) -> str:
    """Describe the health of a board for a reader."""
    lines = [
        f"clock {health.core_hz / 1e6:g} MHz, consecutive watchdog resets {health.watchdog_resets}",
        f"longest fast interrupt {health.fast_cycles} cycles, slow {health.slow_cycles}, main loop {health.main_cycles}",
        f"unused stack {health.stack_unused} bytes",
        f"measured values {KEPT[health.kept] if health.kept < len(KEPT) else f'in the unknown state {health.kept}'}",
    ]
    if health.exception:
        place = f"at 0x{health.pc:08x}, called from 0x{health.lr:08x}, CFSR 0x{health.cfsr:08x}"
        lines.append(f"unexpected exception {health.exception} {place}")
    return "\n".join(lines)


def figure(value: float, digits: str) -> str:
    """Format a number; a value that is not finite becomes words."""
    return format(value, digits) if math.isfinite(value) else "not finite"


def amplitude(share: float, status: Status, digits: str = ".4g") -> str:
    """Format an amplitude in um, or as a fraction of full scale if the table has no metres per volt."""
    return f"{figure(1e6 * share * status.metres, digits)} um" if status.metres > 0.0 else figure(share, digits)


def _unless_metres(status: Status) -> str:
    """Words after amplitudes that are fractions of full scale."""
    return "" if status.metres > 0.0 else " of full scale"


@contextmanager
def _in_words(kind: Kind) -> Iterator[None]:
    """Turn a ProtocolError into a BoardError that names the request."""
    try:
        yield
    except ProtocolError as error:
        raise BoardError(f"{kind.name.lower()}: the board sent {error}; {OTHER_VERSION}") from None


def _refusal(result: int, more: bytes) -> str:
    if result not in list(Result):
        return f"refused for unknown reason {result}"
    text = RESULT_TEXT[Result(result)]
    if result != Result.TABLE_REFUSED or not more:
        return text
    return f"{text}: {TABLE_TEXT[more[0]] if more[0] < len(TABLE_TEXT) else f'unknown reason {more[0]}'}"


def _single_lines(status: SingleStatus) -> list[str]:
    gain = figure(abs(status.gain), ".5g") if status.identified else "unidentified"
    return [
        f"mode {figure(status.frequency_hz, '.3f')} Hz, tau {figure(status.tau_s * 1e3, '.4g')} ms, gain {gain}, "
        f"delay {figure(status.delay_s * 1e6, '.3g')} us, neighbours up to {figure(status.neighbour, '.3g')}",
        *([_sweep(status)] if status.motion else []),
        f"reference {amplitude(status.reference, status)}, measured {amplitude(abs(status.measured), status)}, "
        f"drive {figure(abs(status.drive), '.4g')}, offset {figure(status.offset, '.3g')} of full scale",
        f"worst fast interrupt {status.worst_cycles} cycles of 720",
    ]


def _sweep(status: SingleStatus | SixStatus) -> str:
    largest = amplitude(status.motion, status, ".3g") + _unless_metres(status)
    return f"measured at up to {largest}, misfit {figure(100.0 * status.misfit, '.2g')} %"


def _six_lines(status: SixStatus) -> list[str]:
    matrix = f"condition {figure(status.condition, '.3g')}" if status.identified else "not measured yet"
    sensors = ", ".join(amplitude(abs(z), status) for z in status.sensors) + _unless_metres(status)
    return [
        f"shape {status.choice[0]} at {figure(status.frequency_hz, '.3f')} Hz, matrix {matrix}, pattern {status.choice[1]}",
        *([_sweep(status)] if status.motion else []),
        f"reference {amplitude(status.reference, status)}, at most {amplitude(status.reachable, status)}; "
        f"sensors {sensors}",
        f"worst fast interrupt {status.worst_cycles} cycles of 4500",
    ]
