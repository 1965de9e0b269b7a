"""Serial protocol: frames, requests and replies, with their units and limits.

`python -m firmware.wire` writes the same layouts for the firmware, core/an_wire.h, and for the docs.
"""

from __future__ import annotations

import struct
from dataclasses import dataclass
from enum import IntEnum, IntFlag
from typing import Annotated, Any, NamedTuple, TypeVar, get_type_hints

import numpy as np

from firmware.mode_table import ALLOWED, CHANNELS, FREQUENCY_HIGH, GAIN, MAX_BYTES, MIN_MODE_HZ, RATE_HZ, crc32

PAYLOAD_MAX = 120
FRAME_MAX = PAYLOAD_MAX + 8  # kind, sequence, CRC-32, the first COBS code and the final zero
REPLY = 0x80
LOG_RECORDS = 0xC0
BAUD = 921600
CHIRP_ROWS = 1024  # steps of a chirp that the board records
PROTOCOL = 7  # version


class ProtocolError(ValueError):
    """Received bytes violate the protocol: a wrong length or an undefined number."""


class Kind(IntEnum):
    """Kinds of request."""

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
    CHIRP = 19
    MEASURED = 20
    COLUMN = 21


class Result(IntEnum):
    """Result of a request."""

    OK = 0
    UNKNOWN = 1
    BAD_VALUE = 2
    NOT_NOW = 3
    TABLE_REFUSED = 4
    STORE_FAILED = 5


RESULT_TEXT = {
    Result.UNKNOWN: "this image does not support the request",
    Result.BAD_VALUE: "a value is out of range",
    Result.NOT_NOW: "refused in the present state",
    Result.TABLE_REFUSED: "the table was refused",
    Result.STORE_FAILED: "the table could not be stored",
}
TABLE_RESULTS = {
    "OK": "sound",
    "TRUNCATED": "truncated",
    "MAGIC": "not a mode table",
    "WRONG_VERSION": "of another version",
    "LENGTH": "of a wrong length",
    "DAMAGED": "damaged",
    "RANGE": "out of range",
    "OTHER_BUILD": "for the other build or another sample rate",
}
TABLE_TEXT = tuple(TABLE_RESULTS.values())
STATES = ("idle", "identify", "run", "fault")
IDLE, IDENTIFY, RUN, FAULT = range(len(STATES))


class Fault(IntFlag):
    """Faults, one bit each. Each is latched until cleared and sets the outputs to their safe state."""

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


class FaultText(NamedTuple):
    """What a fault means, what to check, and whether `clear` leaves it."""

    cause: str
    check: str
    clears: bool = True

    @property
    def meaning(self) -> str:
        """The cause, with a note if `clear` does not leave it."""
        return self.cause if self.clears else f"{self.cause} (not clearable)"


FAULTS = {
    Fault.TABLE: FaultText("no valid mode table", "`antinode doctor table FILE`, upload another", clears=False),
    Fault.CLOCK: FaultText(
        "crystal, PLL or overdrive did not start; the chip runs from its own oscillator, 1 % accurate, "
        "to keep the serial line",
        "the 8 MHz",
        clears=False,
    ),
    Fault.NOT_FINITE: FaultText("a NaN or overflow was about to reach an output", "report it with the table"),
    Fault.SENSOR_CLIPPED: FaultText(
        "more than two samples of a window (six channels: of two) at the ends of the converter",
        "conditioner gain, lower reference",
    ),
    Fault.SENSOR_OFFSET: FaultText("rest level a quarter of full scale from the middle", "bias of the conditioner"),
    Fault.AMPLITUDE: FaultText("more motion than the table allows", "reference, table"),
    Fault.MISMATCH: FaultText(
        "sensor dead, stuck or reversed; drive without motion, motion without drive, or a limit cycle",
        "sensor wire, polarity, conditioner; an unidentified filter or neighbour: `identify`",
    ),
    Fault.FAST_LATE: FaultText("a sample was lost, or the samples stopped", "cycles; code built without optimisation"),
    Fault.SLOW_LATE: FaultText("the slow step missed its deadline", "cycles; code built without optimisation"),
    Fault.IDENTIFY: FaultText(
        "no resonance within 4 % of the computed frequency, or two too close together; six channels: decay so slow that "
        "the dwells take over a minute",
        "wiring, amplifier on?, table",
    ),
    Fault.HOST_SILENT: FaultText("the host that started it stopped talking", "cable, client"),
    Fault.FLASH: FaultText("the table's sector could not be written", "upload again"),
    Fault.BREAK: FaultText("the power stage let its line go, or a wire is broken", "load, dead time, wire"),
    Fault.WATCHDOG: FaultText(
        "a task hung and the chip was reset", "`health` gives the address of an exception; report it"
    ),
    Fault.SHAPING: FaultText(
        "the six-channel matrix cannot be inverted (condition above 100)", "another frequency, off resonance"
    ),
    Fault.SUPPLY: FaultText("below 2.9 V", "supply"),
    Fault.MEMORY: FaultText("a word of the program's state contradicts another", "report it"),
}


@dataclass(frozen=True)
class Message:
    """Content of a frame."""

    kind: int
    sequence: int
    payload: bytes = b""


def encode(message: Message) -> bytes:
    """Encode a message as a frame."""
    from cobs import cobs

    body = bytes([message.kind, message.sequence]) + message.payload
    return cobs.encode(body + struct.pack("<I", crc32(body))) + b"\0"


def decode(frame: bytes) -> Message | None:
    """Decode a frame without its final zero; return None if it is damaged."""
    from cobs import cobs

    try:
        content = cobs.decode(frame)
    except cobs.DecodeError:
        return None
    if len(content) < 6 or struct.unpack("<I", content[-4:])[0] != crc32(content[:-4]):
        return None
    return Message(content[0], content[1], content[2:-4])


U1 = Annotated[int, "u1"]
U4 = Annotated[int, "<u4"]
F4 = Annotated[float, "<f4"]
C8 = Annotated[complex, "<c8"]


class Range(NamedTuple):
    """Allowed values of a member of a request, and their unit."""

    low: float
    high: float
    unit: str = ""


SHARE = Range(0.0, 1.0, "of full scale")
EVERY = Range(1, 50000)  # windows, or samples
ANY = Range(0, 2**32 - 1)


# The classes below have the layout of requests and replies, member by member, in SI units; amplitudes are fractions of
# full scale.
@dataclass(frozen=True)
class Start:
    """Drive the target mode; reference 0: the lowest useful level."""

    reference: Annotated[float, "<f4", SHARE]
    detuning_hz: Annotated[float, "<f4", Range(-500.0, 500.0, "Hz")] = 0.0


@dataclass(frozen=True)
class SixStart:
    """Hold a pattern of the current shape; reference 0: half of the reachable one."""

    pattern: Annotated[int, "<u4", ANY]
    reference: Annotated[float, "<f4", SHARE] = 0.0


@dataclass(frozen=True)
class Reference:
    """Change the amplitude while running."""

    reference: Annotated[float, "<f4", SHARE]


@dataclass(frozen=True)
class Sine:
    """Modulate the amplitude between 1 and 1 - depth of the reference; up to a tenth of the window rate."""

    rate_hz: Annotated[float, "<f4", Range(0.0, 500.0, "Hz")]
    depth: Annotated[float, "<f4", Range(0.0, 1.0)]


@dataclass(frozen=True)
class Stream:
    """Start a texture from samples that follow, each lasting some windows."""

    every: Annotated[int, "<u4", EVERY]


@dataclass(frozen=True)
class LogRequest:
    """Start a log with one record per some windows; 0: stop it."""

    every: Annotated[int, "<u4", Range(0, 2**32 - 1)]


@dataclass(frozen=True)
class UploadBegin:
    """Begin the upload of a mode table."""

    total_bytes: Annotated[int, "<u4", Range(1, MAX_BYTES, "bytes")]


@dataclass(frozen=True)
class Choose:
    """Change to another pattern while running, or to another shape at rest."""

    shape: Annotated[int, "<u4", ANY]
    pattern: Annotated[int, "<u4", ANY]


@dataclass(frozen=True)
class CaptureRequest:
    """Record inputs and outputs of all channels, one row per some samples."""

    every: Annotated[int, "<u4", EVERY]


@dataclass(frozen=True)
class CapturedRequest:
    """Return recorded words from one onwards."""

    first: Annotated[int, "<u4", ANY]


@dataclass(frozen=True)
class Chirp:
    """Drive a periodic chirp about a carrier, and record its response in place of a capture.

    Each step lasts some windows. The drive's phase is 0 at the first step of a period; from one step to the next it
    advances by `advance`, which itself grows by `growth` (2^32 per turn). Recording begins after the steps to settle.
    """

    frequency_hz: Annotated[float, "<f4", Range(MIN_MODE_HZ, FREQUENCY_HIGH * RATE_HZ["single"], "Hz")]
    level: Annotated[float, "<f4", Range(0.0, 1.0, "of the drive limit")]
    advance: Annotated[int, "<u4", ANY]
    growth: Annotated[int, "<u4", ANY]
    steps: Annotated[int, "<u4", Range(1, CHIRP_ROWS)]
    every: Annotated[int, "<u4", EVERY]
    settle: Annotated[int, "<u4", Range(1, CHIRP_ROWS)]


@dataclass(frozen=True)
class Measured:
    """Take over a measured mode, as the board's own identification does; the next start checks it."""

    frequency_hz: Annotated[float, "<f4", Range(MIN_MODE_HZ, FREQUENCY_HIGH * RATE_HZ["single"], "Hz")]
    tau_s: Annotated[float, "<f4", Range(*ALLOWED["tau_s"], "s")]
    gain: Annotated[complex, "<c8", Range(*GAIN)]
    delay_s: Annotated[float, "<f4", Range(*ALLOWED["delay_s"], "s")]
    neighbour: Annotated[float, "<f4", Range(0.0, GAIN[1])]
    motion: Annotated[float, "<f4", SHARE]
    misfit: Annotated[float, "<f4", Range(0.0, 1.0)]


@dataclass(frozen=True)
class ColumnRequest:
    """Return the measured responses of all sensors to one actuator; not before they have been measured."""

    actuator: Annotated[int, "<u4", Range(0, CHANNELS - 1)]


REQUESTS: dict[Kind, tuple[type, ...]] = {
    Kind.START: (Start, SixStart),
    Kind.REFERENCE: (Reference,),
    Kind.SINE: (Sine,),
    Kind.STREAM: (Stream,),
    Kind.LOG: (LogRequest,),
    Kind.UPLOAD_BEGIN: (UploadBegin,),
    Kind.PATTERN: (Choose,),
    Kind.CAPTURE: (CaptureRequest,),
    Kind.CAPTURED: (CapturedRequest,),
    Kind.CHIRP: (Chirp,),
    Kind.MEASURED: (Measured,),
    Kind.COLUMN: (ColumnRequest,),
}  # with a payload of fixed length; UPLOAD_DATA has an offset (u4) and bytes, SAMPLES factors (u2, 65535 = 1)


class Flag(IntFlag):
    """Flags of a status."""

    GAIN_IDENTIFIED = 1
    TAU_IDENTIFIED = 2
    FREQUENCY_IDENTIFIED = 4
    LIMITED = 8
    RETRIES = 16
    EASED = 32
    DISPLACEMENT = 64  # the sensor follows displacement, not velocity
    GAVE_UP = 128


@dataclass(frozen=True)
class Status:
    """Status common to both builds.

    choice holds the indices of shape and pattern (six-channel build); underruns counts late samples of a stream; metres
    is the motion at full scale of the sensor (0: the table does not give it).
    """

    state_number: U1
    choice: Annotated[list[int], "u1", 2]
    flags: U1
    fault_bits: U4
    first_bits: U4
    windows: U4
    underruns: U4
    worst_cycles: U4
    frequency_hz: F4
    metres: F4

    @property
    def state(self) -> str:
        """Name of the state."""
        return STATES[self.state_number]

    @property
    def faults(self) -> tuple[str, ...]:
        """Names of the latched faults."""
        return fault_names(self.fault_bits)

    @property
    def first(self) -> tuple[str, ...]:
        """Names of the faults that were found first."""
        return fault_names(self.first_bits)

    @property
    def identified(self) -> bool:
        """True if the mode or the matrix has been measured."""
        return bool(self.flags & Flag.GAIN_IDENTIFIED)

    @property
    def limited(self) -> bool:
        """True if the drive is at its limit and the plate does not reach the reference."""
        return bool(self.flags & Flag.LIMITED)

    @property
    def retries(self) -> bool:
        """True in the fault state if the board will clear the fault and try again by itself."""
        return bool(self.flags & Flag.RETRIES)

    @property
    def gave_up(self) -> bool:
        """True at rest if the last job was given up because `first` came back after each retry."""
        return bool(self.flags & Flag.GAVE_UP)

    @property
    def eased(self) -> bool:
        """True if the drive is limited to half after ten seconds at or near its limit."""
        return bool(self.flags & Flag.EASED)


@dataclass(frozen=True)
class SingleStatus(Status):
    """Status of the single-mode build; while it runs, frequency, tau and gain are the tracked ones.

    motion is the largest response in the last sweep of the resonance (0: the board has not measured it), misfit the rms
    deviation of the fitted resonance relative to the response.
    """

    detuning_hz: F4
    tau_s: F4
    gain: C8
    delay_s: F4
    neighbour: F4
    motion: F4
    misfit: F4
    reference: F4
    measured: C8
    drive: C8
    offset: F4


@dataclass(frozen=True)
class SixStatus(Status):
    """Status of the six-channel build: condition number of T (0: unknown), largest reference, and sensors.

    motion is the largest response while T was measured (0: the board has not measured it), misfit the largest error of a
    sensor when all actuators drove together as T predicts.
    """

    condition: F4
    reachable: F4
    motion: F4
    misfit: F4
    reference: F4
    sensors: Annotated[list[complex], "<c8", 6]

    @property
    def shape(self) -> int:
        """Index of the current shape."""
        return self.choice[0]

    @property
    def pattern(self) -> int:
        """Index of the current pattern."""
        return self.choice[1]

    @property
    def measured(self) -> complex:
        """Phasor of the sensor with the largest amplitude."""
        return max(self.sensors, key=abs)


@dataclass(frozen=True)
class Column:
    """Column of T: responses of all sensors to one actuator, and their squared coherence (0: not measured by this board).

    seconds is the duration of the measurement's dwells, least_s the least possible one; integral is the share of an error
    that the loop's integral takes per window, passed the time between two windows in the table's time constants.
    """

    responses: Annotated[list[complex], "c8", CHANNELS]
    coherence: Annotated[list[float], "f4", CHANNELS]
    seconds: F4
    least_s: F4
    integral: F4
    passed: F4


@dataclass(frozen=True)
class Health:
    """Health of the board.

    Attributes
    ----------
    watchdog_resets : int
        Consecutive resets by the watchdog.
    exception, pc, lr, cfsr : int
        Number, address, return address and status word (CFSR) of the last unexpected exception; zero if there was none.
    core_hz : int
        Frequency of the core clock, in Hz.
    fast_cycles, slow_cycles, main_cycles : int
        Longest fast interrupt, slow interrupt and main-loop pass so far, in core cycles.
    stack_unused : int
        Bytes of the stack never used (0 during the first second).
    kept : int
        Index into KEPT: what became of values measured before a reset.
    """

    watchdog_resets: U4
    exception: U4
    pc: U4
    lr: U4
    cfsr: U4
    core_hz: U4
    fast_cycles: U4
    slow_cycles: U4
    main_cycles: U4
    stack_unused: U4
    kept: U4


KEEP_STATES = {
    "NONE": "not kept: this board has no backup memory",
    "EMPTY": "none kept from before the last reset",
    "REFUSED": "not used: they were measured with another table or build",
    "READ": "in use again, from before the last reset",
    "WRITTEN": "kept for the next reset",
}
KEPT = tuple(KEEP_STATES.values())


@dataclass(frozen=True)
class Record:
    """Record of the log: window number, measured phasor, drive, reference."""

    window: U4
    measured: C8
    drive: C8
    reference: F4


BUILDS = {1: "single", 6: "six"}


@dataclass(frozen=True)
class Identity:
    """Identity of a board: protocol version, build, table version, number of modes or shapes, and hash of the design.

    The limits are those of the table's target mode. They, count and design are zero if the board has no valid table.
    """

    protocol: U1
    build_number: U1
    table_version: U1
    count: U1
    design: Annotated[bytes, "V16"]
    drive_limit: F4
    amplitude_limit: F4

    @property
    def build(self) -> str:
        """ "single" or "six"."""
        return BUILDS[self.build_number]


@dataclass(frozen=True)
class Captured:
    """Part of a capture: words so far, words in total, words per row (inputs, then outputs), and some of the words."""

    used: int
    total: int
    row: int
    words: tuple[int, ...]


Read = TypeVar("Read", Status, SingleStatus, SixStatus, Column, Health, Record, Identity)


def layout(kind: type) -> np.dtype[Any]:
    """Return the packed layout of a class of requests or replies."""
    members = get_type_hints(kind, include_extras=True).items()
    return np.dtype([(name, *(part for part in one.__metadata__ if type(part) is not Range)) for name, one in members])


def limits(kind: type, name: str) -> Range:
    """Return the allowed range of a member of a request."""
    annotated = get_type_hints(kind, include_extras=True)[name]
    return next(part for part in annotated.__metadata__ if type(part) is Range)


def pack(request: object) -> bytes:
    """Return the payload of a request."""
    members = layout(type(request))
    return np.array([tuple(getattr(request, name) for name in members.names or ())], members).tobytes()


def parse(kind: type[Read], payload: bytes) -> Read:
    """Parse the payload of a reply after its result byte. Raises ProtocolError if its length is wrong."""
    members = layout(kind)
    check_length(payload, members.itemsize)
    return kind(*(each.tolist() for each in np.frombuffer(payload, members)[0]))


def parse_status(payload: bytes) -> SingleStatus | SixStatus:
    """Parse the status of either build, distinguished by its length. Raises ProtocolError if invalid."""
    single, six = (layout(kind).itemsize for kind in (SingleStatus, SixStatus))
    check_length(payload, single, six)
    status = parse(SixStatus, payload) if len(payload) == six else parse(SingleStatus, payload)
    if status.state_number >= len(STATES):
        raise ProtocolError(f"the unknown state {status.state_number} (known: 0 to {len(STATES) - 1})")
    return status


def parse_identity(payload: bytes) -> Identity:
    """Parse an identity. Raises ProtocolError for a wrong length or an unknown build."""
    identity = parse(Identity, payload)
    if identity.build_number not in BUILDS:
        raise ProtocolError(f"the unknown build {identity.build_number} (known: {' and '.join(map(str, BUILDS))})")
    return identity


def parse_log(payload: bytes) -> list[Record]:
    """Parse the records of a log frame. Raises ProtocolError if its length is not that of whole records."""
    members = layout(Record)
    if len(payload) % members.itemsize:
        raise ProtocolError(f"{len(payload)} bytes of log, expected a multiple of {members.itemsize}")
    return [Record(*row) for row in np.frombuffer(payload, members).tolist()]


def parse_captured(payload: bytes) -> Captured:
    """Parse a part of a capture after the result byte. Raises ProtocolError for an invalid length or count."""
    if len(payload) < 5 or len(payload) % 2 == 0:
        raise ProtocolError(f"{len(payload)} bytes, expected 5 and an even number more")
    used, total, row = struct.unpack_from("<HHB", payload)
    if row not in (2, 12) or total % row or not 0 <= used <= total:
        raise ProtocolError(f"{used} of {total} words in rows of {row}")
    return Captured(used, total, row, tuple(np.frombuffer(payload, "<u2", offset=5).tolist()))


def check_length(payload: bytes, *allowed: int) -> None:
    """Raise ProtocolError unless a payload has one of the allowed lengths."""
    if len(payload) not in allowed:
        raise ProtocolError(f"{len(payload)} bytes, expected {' or '.join(map(str, allowed))}")


def nothing(payload: bytes) -> None:
    """Parse a reply without data."""
    check_length(payload, 0)


def one_byte(payload: bytes) -> int:
    """Parse a reply that holds a count."""
    check_length(payload, 1)
    return payload[0]


def fault_names(bits: int) -> tuple[str, ...]:
    """Return the names of the faults whose bits are set; an undefined bit appears with its number."""
    named = {one.value.bit_length() - 1: one.name.lower().replace("_", " ") for one in Fault if one.name}
    return tuple(named.get(index, f"bit {index}") for index in range(bits.bit_length()) if bits >> index & 1)
