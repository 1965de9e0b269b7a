"""The serial protocol as the host speaks it: frames, requests and what the replies hold (firmware/core/an_link.h)."""

from __future__ import annotations

import struct
from dataclasses import dataclass
from enum import IntEnum

from firmware.table_format import crc32

PAYLOAD_MAX = 120
FRAME_MAX = PAYLOAD_MAX + 8  # kind, sequence, CRC-32, the stuffing's first code and the zero that ends a frame
REPLY = 0x80
LOG_RECORDS = 0xC0
BAUD = 921600
PROTOCOL = 2  # that this side speaks


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
FAULTS = (
    "table",
    "clock",
    "not finite",
    "sensor clipped",
    "sensor offset",
    "amplitude",
    "mismatch",
    "fast late",
    "slow late",
    "identify",
    "host silent",
    "flash",
    "break",
    "watchdog",
    "shaping",
    "supply",
    "memory",
)


@dataclass(frozen=True)
class Message:
    """One frame's content."""

    kind: int
    sequence: int
    payload: bytes = b""


def stuff(content: bytes) -> bytes:
    """Consistent overhead byte stuffing (COBS) of less than 254 bytes, with the zero that ends a frame."""
    return b"".join(bytes([len(part) + 1]) + part for part in content.split(b"\0")) + b"\0"


def unstuff(frame: bytes) -> bytes | None:
    """The content of a frame without its zero; None when its codes do not fit."""
    parts = []
    at = 0
    while at < len(frame):
        code = frame[at]
        if code == 0 or at + code > len(frame):
            return None
        parts.append(frame[at + 1 : at + code])
        at += code
    return b"\0".join(parts)


def encode(message: Message) -> bytes:
    """A message as it goes over the line."""
    body = bytes([message.kind, message.sequence]) + message.payload
    return stuff(body + struct.pack("<I", crc32(body)))


def decode(frame: bytes) -> Message | None:
    """The message in a frame without its zero; None when it is damaged."""
    content = unstuff(frame)
    if content is None or len(content) < 6 or struct.unpack("<I", content[-4:])[0] != crc32(content[:-4]):
        return None
    return Message(content[0], content[1], content[2:-4])


IDENTIFIED, LIMITED = 1, 8  # bits of a status' fourth byte
_STATUS = struct.Struct("<BBBBIIIII13f")


@dataclass(frozen=True)
class Status:
    """The state of the single-mode image. SI units; amplitudes in full scales; faults by name, first those found first.

    While it runs, frequency, tau and gain are as the board follows them. limited: the drive is at its limit, and the plate
    short of its reference.
    """

    state: str
    faults: tuple[str, ...]
    first: tuple[str, ...]
    windows: int
    starved: int
    worst_cycles: int
    frequency_hz: float
    detuning_hz: float
    tau_s: float
    gain: complex
    delay_s: float
    neighbour: float
    reference: float
    measured: complex
    drive: complex
    offset: float
    gain_identified: bool
    limited: bool


def parse_status(payload: bytes) -> Status:
    """A Status from a reply's payload behind its result. Raises ProtocolError when its length or its state is unknown."""
    _has_length(payload, _STATUS.size)
    state, _, _, flags, faults, first, windows, starved, cycles, *numbers = _STATUS.unpack(payload)
    frequency, detuning, tau, gain_re, gain_im, delay, neighbour, reference, u_d, u_q, v_d, v_q, offset = numbers
    return Status(
        state=_state(state),
        faults=fault_names(faults),
        first=fault_names(first),
        windows=windows,
        starved=starved,
        worst_cycles=cycles,
        frequency_hz=frequency,
        detuning_hz=detuning,
        tau_s=tau,
        gain=complex(gain_re, gain_im),
        delay_s=delay,
        neighbour=neighbour,
        reference=reference,
        measured=complex(u_d, u_q),
        drive=complex(v_d, v_q),
        offset=offset,
        gain_identified=bool(flags & IDENTIFIED),
        limited=bool(flags & LIMITED),
    )


_SIX_STATUS = struct.Struct("<BBBBIIIII16f")


@dataclass(frozen=True)
class SixStatus:
    """The state of the six-channel image; condition, of T, 0 while it is not known; reachable, the largest reference.

    first: the faults found first; limited: the drive is at its limit, and the plate short of its reference.
    """

    state: str
    faults: tuple[str, ...]
    first: tuple[str, ...]
    windows: int
    starved: int
    worst_cycles: int
    shape: int
    pattern: int
    identified: bool
    limited: bool
    frequency_hz: float
    condition: float
    reachable: float
    reference: float
    sensors: tuple[complex, ...]

    @property
    def measured(self) -> complex:
        """The sensor that moves most."""
        return max(self.sensors, key=abs)


def parse_any_status(payload: bytes) -> Status | SixStatus:
    """The state of either image, told apart by its length. Raises ProtocolError when it is neither's."""
    _has_length(payload, _STATUS.size, _SIX_STATUS.size)
    if len(payload) == _STATUS.size:
        return parse_status(payload)
    state, shape, pattern, flags, faults, first, windows, starved, cycles, *numbers = _SIX_STATUS.unpack(payload)
    frequency, condition, reachable, reference, *parts = numbers
    return SixStatus(
        state=_state(state),
        faults=fault_names(faults),
        first=fault_names(first),
        windows=windows,
        starved=starved,
        worst_cycles=cycles,
        shape=shape,
        pattern=pattern,
        identified=bool(flags & IDENTIFIED),
        limited=bool(flags & LIMITED),
        frequency_hz=frequency,
        condition=condition,
        reachable=reachable,
        reference=reference,
        sensors=tuple(complex(re, im) for re, im in zip(parts[::2], parts[1::2], strict=True)),
    )


def fault_names(bits: int) -> tuple[str, ...]:
    """The names of the faults whose bits are set; a bit without a name is told by its number."""
    named = dict(enumerate(FAULTS))
    return tuple(named.get(index, f"bit {index}") for index in range(bits.bit_length()) if bits >> index & 1)


def _state(number: int) -> str:
    if number >= len(STATES):
        raise ProtocolError(f"the state {number}, known 0 to {len(STATES) - 1}")
    return STATES[number]


def _has_length(payload: bytes, *allowed: int) -> None:
    if len(payload) not in allowed:
        raise ProtocolError(f"{len(payload)} bytes, expected {' or '.join(map(str, allowed))}")


_HEALTH = struct.Struct("<10I")


@dataclass(frozen=True)
class Health:
    """What the board tells of itself: resets by the watchdog in a row; number, address, return address and status word
    (CFSR) of the last interrupt that nobody expected, zeros when there was none; its clock, Hz; the longest fast and slow
    interrupt and main loop pass so far, cycles; bytes of the stack never used (0 in the first second)."""

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


def parse_health(payload: bytes) -> Health:
    """A Health from a reply's payload behind its result. Raises ProtocolError when the length differs."""
    _has_length(payload, _HEALTH.size)
    return Health(*_HEALTH.unpack(payload))


_RECORD = struct.Struct("<I5f")


@dataclass(frozen=True)
class Record:
    """One line of the log: window number, measured phasor, drive, reference."""

    window: int
    measured: complex
    drive: complex
    reference: float


def parse_log(payload: bytes) -> list[Record]:
    """The records of a log frame. Raises ProtocolError when its length is not that of whole records."""
    if len(payload) % _RECORD.size:
        raise ProtocolError(f"{len(payload)} bytes of log, expected a multiple of {_RECORD.size}")
    return [
        Record(window, complex(u_d, u_q), complex(v_d, v_q), reference)
        for window, u_d, u_q, v_d, v_q, reference in _RECORD.iter_unpack(payload)
    ]


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
    Kind.STATUS: (_STATUS.size, _SIX_STATUS.size),
    Kind.SAMPLES: (1,),
    Kind.HEALTH: (_HEALTH.size,),
}


def check_length(kind: Kind, payload: bytes) -> None:
    """Raises ProtocolError unless a granted request's reply has its length (behind its result; none for most kinds)."""
    _has_length(payload, *REPLY_BYTES.get(kind, (0,)))
