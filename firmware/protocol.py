"""The serial protocol as the host speaks it: frames, requests and what the replies hold (firmware/core/an_link.h)."""

from __future__ import annotations

import struct
from dataclasses import dataclass, fields
from enum import IntEnum, IntFlag
from typing import Any

import numpy as np

from firmware.mode_table import crc32

PAYLOAD_MAX = 120
FRAME_MAX = PAYLOAD_MAX + 8  # kind, sequence, CRC-32, the stuffing's first code and the zero that ends a frame
REPLY = 0x80
LOG_RECORDS = 0xC0
BAUD = 921600
PROTOCOL = 3  # that this side speaks


class ProtocolError(ValueError):
    """Bytes that the protocol does not allow: of a wrong length, or a number that has no name."""


class Kind(IntEnum):
    """What a host may ask."""

    IDENTITY = 1
    STATUS = 2
    START = 3
    STOP = 4
    CLEAR = 5
    REFERENCE = 6
    SINE = 7
    STREAM = 8
    SAMPLES = 9
    LOG = 10
    UPLOAD_BEGIN = 11
    UPLOAD_DATA = 12
    UPLOAD_END = 13
    PATTERN = 14
    IDENTIFY = 15
    HEALTH = 16
    CAPTURE = 17
    CAPTURED = 18


class Result(IntEnum):
    """How a request was received."""

    OK = 0
    UNKNOWN = 1
    BAD_VALUE = 2
    NOT_NOW = 3
    TABLE_REFUSED = 4
    STORE_FAILED = 5


RESULT_TEXT = {
    Result.UNKNOWN: "this image does not know the request",
    Result.BAD_VALUE: "a value is out of range",
    Result.NOT_NOW: "refused in the present state",
    Result.TABLE_REFUSED: "the table was refused",
    Result.STORE_FAILED: "the table could not be stored",
}
TABLE_TEXT = (
    "sound",
    "truncated",
    "not a mode table",
    "of another version",
    "of a wrong length",
    "damaged",
    "out of range",
    "for the other build or another sample rate",
)
STATES = ("idle", "identify", "run", "fault")
IDLE, IDENTIFY, RUN, FAULT = range(len(STATES))


class Fault(IntFlag):
    """What is latched (firmware/core/an_faults.h)."""

    TABLE = 1 << 0
    CLOCK = 1 << 1
    NOT_FINITE = 1 << 2
    SENSOR_CLIPPED = 1 << 3
    SENSOR_OFFSET = 1 << 4
    AMPLITUDE = 1 << 5
    MISMATCH = 1 << 6
    FAST_LATE = 1 << 7
    SLOW_LATE = 1 << 8
    IDENTIFY = 1 << 9
    HOST_SILENT = 1 << 10
    FLASH = 1 << 11
    BREAK = 1 << 12
    WATCHDOG = 1 << 13
    SHAPING = 1 << 14
    SUPPLY = 1 << 15
    MEMORY = 1 << 16


@dataclass(frozen=True)
class Message:
    """One frame's content."""

    kind: int
    sequence: int
    payload: bytes = b""


def encode(message: Message) -> bytes:
    """A message as it goes over the line."""
    from cobs import cobs

    body = bytes([message.kind, message.sequence]) + message.payload
    return cobs.encode(body + struct.pack("<I", crc32(body))) + b"\0"


def decode(frame: bytes) -> Message | None:
    """The message in a frame without its zero; None when it is damaged."""
    from cobs import cobs

    try:
        content = cobs.decode(frame)
    except cobs.DecodeError:
        return None
    if len(content) < 6 or struct.unpack("<I", content[-4:])[0] != crc32(content[:-4]):
        return None
    return Message(content[0], content[1], content[2:-4])


IDENTIFIED, LIMITED = 1, 8  # bits of a status' fourth byte


@dataclass(frozen=True, kw_only=True)
class Status:
    """The state of either image. SI units; amplitudes in full scales; faults by name, first those found first.

    limited: the drive is at its limit, and the plate short of its reference; underruns, samples of a stream that came late.
    """

    state: str
    faults: tuple[str, ...]
    first: tuple[str, ...]
    windows: int
    underruns: int
    worst_cycles: int
    identified: bool
    limited: bool
    frequency_hz: float
    reference: float


@dataclass(frozen=True, kw_only=True)
class SingleStatus(Status):
    """Of the single-mode image. While it runs, frequency, tau and gain are as the board follows them."""

    detuning_hz: float
    tau_s: float
    gain: complex
    delay_s: float
    neighbour: float
    measured: complex
    drive: complex
    offset: float


@dataclass(frozen=True, kw_only=True)
class SixStatus(Status):
    """Of the six-channel image; condition, of T, 0 while it is not known; reachable, the largest reference."""

    shape: int
    pattern: int
    condition: float
    reachable: float
    sensors: tuple[complex, ...]

    @property
    def measured(self) -> complex:
        """The sensor that moves most."""
        return max(self.sensors, key=abs)


def _layout(text: str) -> np.dtype[Any]:
    """Little-endian members without gaps: "name kind" or "name kind count", a line each."""
    rows = [line.split() for line in text.strip().splitlines()]
    return np.dtype([(name, f"<{kind}", *((int(count[0]),) if count else ())) for name, kind, *count in rows])


_COUNTS = """
    faults u4
    first u4
    windows u4
    underruns u4
    worst_cycles u4
    frequency_hz f4
"""
_SINGLE = _layout(f"""
    state u1
    _stage u1
    _texture u1
    flags u1
    {_COUNTS.strip()}
    detuning_hz f4
    tau_s f4
    gain c8
    delay_s f4
    neighbour f4
    reference f4
    measured c8
    drive c8
    offset f4
""")
_SIX = _layout(f"""
    state u1
    shape u1
    pattern u1
    flags u1
    {_COUNTS.strip()}
    condition f4
    reachable f4
    reference f4
    sensors c8 6
""")


def _values(payload: bytes, layout: np.dtype[Any]) -> dict[str, Any]:
    """The members of a payload by name; those whose name begins with _ are nobody's business."""
    _has_length(payload, layout.itemsize)
    row = np.frombuffer(payload, layout)[0]
    result = {name: row[name].tolist() for name in layout.names or ()}
    return {name: value for name, value in result.items() if not name.startswith("_")}


def parse_status(payload: bytes) -> SingleStatus | SixStatus:
    """A status from a reply's payload behind its result, of either image, told apart by its length.

    Raises ProtocolError when it is neither's, or its state is unknown.
    """
    _has_length(payload, _SINGLE.itemsize, _SIX.itemsize)
    six = len(payload) == _SIX.itemsize
    values = _values(payload, _SIX if six else _SINGLE)
    flags = values.pop("flags")
    if values["state"] >= len(STATES):
        raise ProtocolError(f"the state {values['state']}, known 0 to {len(STATES) - 1}")
    values |= {
        "state": STATES[values["state"]],
        "identified": bool(flags & IDENTIFIED),
        "limited": bool(flags & LIMITED),
    }
    values |= {name: fault_names(values[name]) for name in ("faults", "first")}
    return SixStatus(**values | {"sensors": tuple(values["sensors"])}) if six else SingleStatus(**values)


def fault_names(bits: int) -> tuple[str, ...]:
    """The names of the faults whose bits are set; a bit without a name is told by its number."""
    named = {one.value.bit_length() - 1: one.name.lower().replace("_", " ") for one in Fault if one.name}
    return tuple(named.get(index, f"bit {index}") for index in range(bits.bit_length()) if bits >> index & 1)


def _has_length(payload: bytes, *allowed: int) -> None:
    if len(payload) not in allowed:
        visible = [*map(str, allowed[:2]), *(["more"] if len(allowed) > 2 else [])]
        raise ProtocolError(f"{len(payload)} bytes, expected {' or '.join(visible)}")


@dataclass(frozen=True)
class Health:
    """What the board tells of itself: resets by the watchdog in a row; number, address, return address and status word
    (CFSR) of the last interrupt that nobody expected, zeros when there was none; its clock, Hz; the longest fast and slow
    interrupt and main loop pass so far, cycles; bytes of the stack never used (0 in the first second); kept, what became
    of values measured before a reset (KEPT)."""

    watchdog_resets: int
    exception: int
    pc: int
    lr: int
    cfsr: int
    core_hz: int
    fast_cycles: int
    slow_cycles: int
    main_cycles: int
    stack_unused: int
    kept: int


KEPT = (
    "not kept: this board has no backup memory",
    "none kept from before the last reset",
    "not used: they were measured with another table or build",
    "in use again, from before the last reset",
    "kept for the next reset",
)
_HEALTH = np.dtype([(field.name, "<u4") for field in fields(Health)])


def parse_health(payload: bytes) -> Health:
    """A Health from a reply's payload behind its result. Raises ProtocolError when the length differs."""
    return Health(**_values(payload, _HEALTH))


@dataclass(frozen=True)
class Record:
    """One line of the log: window number, measured phasor, drive, reference."""

    window: int
    measured: complex
    drive: complex
    reference: float


_RECORD = _layout("window u4\nmeasured c8\ndrive c8\nreference f4")


def parse_log(payload: bytes) -> list[Record]:
    """The records of a log frame. Raises ProtocolError when its length is not that of whole records."""
    if len(payload) % _RECORD.itemsize:
        raise ProtocolError(f"{len(payload)} bytes of log, expected a multiple of {_RECORD.itemsize}")
    return [Record(*row) for row in np.frombuffer(payload, _RECORD).tolist()]


@dataclass(frozen=True)
class Captured:
    """Of a capture: words so far, words in the end, words in a row (inputs, then outputs), and some of them."""

    used: int
    total: int
    row: int
    words: tuple[int, ...]


_CAPTURED = struct.Struct("<HHB")


def parse_captured(payload: bytes) -> Captured:
    """A Captured from a reply's payload behind its result. Raises ProtocolError when the length cannot be, or the counts."""
    if len(payload) < _CAPTURED.size or (len(payload) - _CAPTURED.size) % 2:
        raise ProtocolError(f"{len(payload)} bytes, expected {_CAPTURED.size} and an even number more")
    used, total, row = _CAPTURED.unpack_from(payload)
    if row not in (2, 12) or total % row or not 0 <= used <= total:
        raise ProtocolError(f"{used} of {total} words in rows of {row}")
    return Captured(used, total, row, tuple(np.frombuffer(payload, "<u2", offset=_CAPTURED.size).tolist()))


@dataclass(frozen=True)
class Identity:
    """What runs on a board: protocol version, build ("single" or "six"), table version, its modes or shapes, its design's hash.

    count and design are 0 and zeros while the board has no sound table.
    """

    protocol: int
    build: str
    table_version: int
    count: int
    design: bytes


BUILDS = {1: "single", 6: "six"}
_IDENTITY = struct.Struct("<BBBB16s")


def parse_identity(payload: bytes) -> Identity:
    """An Identity from a reply's payload behind its result. Raises ProtocolError when its length or its build is unknown."""
    _has_length(payload, _IDENTITY.size)
    protocol, build, table_version, count, design = _IDENTITY.unpack(payload)
    if build not in BUILDS:
        raise ProtocolError(f"the build {build}, known {' and '.join(map(str, BUILDS))}")
    return Identity(protocol, BUILDS[build], table_version, count, design)


REPLY_BYTES = {
    Kind.IDENTITY: (_IDENTITY.size,),
    Kind.STATUS: (_SINGLE.itemsize, _SIX.itemsize),
    Kind.SAMPLES: (1,),
    Kind.HEALTH: (_HEALTH.itemsize,),
    Kind.CAPTURED: tuple(range(_CAPTURED.size, PAYLOAD_MAX, 2)),
}


def check_length(kind: Kind, payload: bytes) -> None:
    """Raises ProtocolError unless a granted request's reply has its length (behind its result; none for most kinds)."""
    _has_length(payload, *REPLY_BYTES.get(kind, (0,)))
