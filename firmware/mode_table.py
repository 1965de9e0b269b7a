"""Mode table: contents, allowed values, and byte layout for the exporter, the image and the emulated board.

All amplitudes are fractions of full scale at the converter's pins (1 = the largest swing about mid-scale), so that a gain is
the ratio of sensor to drive. The layout is little-endian and packed, with every member at a multiple of its own size:

    header | mode x mode_count | shape x shape_count | CRC-32 (zlib) of everything before it

`python -m firmware.wire` writes the same layout and bounds for the reader in C, core/an_wire.h.
"""

from __future__ import annotations

import cmath
import math
import zlib
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

MAGIC = b"ANTM"
VERSION = 2
CHANNELS = 6
PATTERNS = 8
MAX_MODES = 16
MAX_SHAPES = 2
PIN_VOLTS = 1.65  # full scale at the converter's pins
RATE_HZ = {"single": 250e3, "six": 40e3}  # of the builds
PERIOD, WINDOW = (
    50,
    46,
)  # samples from one window of the single build to the next, and those measured: AN_PERIOD, AN_WINDOW
MIN_MODE_HZ = 2000.0  # lower limit of the single-mode build: a window must hold enough of a period
MIN_SHAPE_HZ = 350.0  # lower limit of the six-channel build: two periods must not exceed its watchdog's time

HEADER = np.dtype(
    [
        ("magic", "V4"),
        ("version", "<u2"),
        ("header_bytes", "<u2"),
        ("total_bytes", "<u4"),
        ("mode_count", "<u2"),
        ("mode_bytes", "<u2"),
        ("shape_count", "<u2"),
        ("shape_bytes", "<u2"),
        ("actuator_count", "u1"),
        ("sensor_count", "u1"),
        ("target", "<u2"),
        ("sample_rate_hz", "<f4"),
        ("flags", "<u4"),
        ("sensor_volts", "<f4"),
        ("design_hash", "V16"),
    ]
)
MODE = np.dtype(
    [
        ("frequency_hz", "<f4"),
        ("tau_s", "<f4"),
        ("gain", "<c8"),
        ("delay_s", "<f4"),
        ("drive_limit", "<f4"),
        ("amplitude_limit", "<f4"),
        ("metres_per_volt", "<f4"),
        ("flags", "<u4"),
        ("actuator_weights", "<c8", CHANNELS),
        ("sensor_weights", "<c8", CHANNELS),
    ]
)
SHAPE = np.dtype(
    [
        ("frequency_hz", "<f4"),
        ("tau_s", "<f4"),
        ("drive_limit", "<f4"),
        ("metres_per_volt", "<f4"),
        ("flags", "<u2"),
        ("pattern_count", "<u2"),
        ("names", "V8", PATTERNS),
        ("matrix", "<c8", (CHANNELS, CHANNELS)),
        ("targets", "<c8", (PATTERNS, CHANNELS)),
    ]
)
CRC_BYTES = 4
MAX_BYTES = HEADER.itemsize + MAX_MODES * MODE.itemsize + MAX_SHAPES * SHAPE.itemsize + CRC_BYTES

SENSES_DISPLACEMENT = 1  # header flag: the sensors follow displacement, 90 degrees behind velocity
GAIN_IDENTIFIED, TAU_IDENTIFIED, FREQUENCY_IDENTIFIED = 1, 2, 4  # mode flags
MATRIX_IDENTIFIED = 1  # shape flag

FREQUENCY_LOW_HZ = 20.0
FREQUENCY_HIGH = 0.4  # of the sample rate
GAIN = (1e-6, 1e3)
# Allowed ranges of the numbers in header, modes and shapes, by name.
ALLOWED = {
    "actuator_count": (1, CHANNELS),
    "sensor_count": (1, CHANNELS),
    "sample_rate_hz": (1e3, 1e6),
    "sensor_volts": (1e-3, 1e3),
    "tau_s": (1e-6, 10.0),
    "delay_s": (0.0, 1e-3),
    "drive_limit": (1e-3, 1.0),
    "amplitude_limit": (1e-3, 1.0),
    "metres_per_volt": (0.0, 1.0),
}
WEIGHT_HIGH = 1.0
MATRIX_HIGH = 1e3


class TableError(ValueError):
    """The mode table is damaged, has an unsupported version, or holds a value out of range; the message is one line."""


@dataclass(frozen=True)
class Mode:
    """Resonance as seen by the controller: H = gain exp(-j w delay) / (1 + j tau (w - w0)), w0 = 2 pi frequency.

    Attributes
    ----------
    frequency_hz, tau_s : float
        Resonance frequency in Hz and time constant of the amplitude in s.
    gain : complex or None
        Sensor over drive at resonance; None if neither computed nor measured.
    delay_s : float
        Dead time from the DAC's update to the ADC's sample, in addition to the phase of the mode, in s.
    drive_limit, amplitude_limit : float
        Fractions of full scale.
    actuator_weights, sensor_weights : tuple of complex
        One weight per actuator and sensor, relative to the largest.
    tau_identified, frequency_identified : bool
        Whether the value was measured, as opposed to assumed or computed.
    metres_per_volt : float
        Amplitude of the rms displacement in the zone per volt of amplitude at the sensor patch; 0 if unknown.
    """

    frequency_hz: float
    tau_s: float
    gain: complex | None = None
    delay_s: float = 0.0
    drive_limit: float = 1.0
    amplitude_limit: float = 0.8
    actuator_weights: tuple[complex, ...] = (1.0 + 0.0j,)
    sensor_weights: tuple[complex, ...] = (1.0 + 0.0j,)
    tau_identified: bool = False
    frequency_identified: bool = False
    metres_per_volt: float = 0.0

    @classmethod
    def from_quality_factor(cls, frequency_hz: float, quality_factor: float, **rest: Any) -> Mode:
        """Make a mode with the time constant of an assumed quality factor: tau = Q / (pi f)."""
        return cls(frequency_hz, quality_factor / (math.pi * frequency_hz), **rest)

    @property
    def quality_factor(self) -> float:
        """Quality factor Q = pi f tau."""
        return math.pi * self.frequency_hz * self.tau_s


@dataclass(frozen=True)
class Pattern:
    """Pattern of a six-channel plate: one complex target per sensor, relative to the largest."""

    name: str
    targets: tuple[complex, ...]


@dataclass(frozen=True)
class Shape:
    """Patterns at one excitation frequency: sensors = matrix @ drives.

    Attributes
    ----------
    frequency_hz, tau_s : float
        Excitation frequency in Hz and longest time constant of the plate in s.
    patterns : tuple of Pattern
    matrix : tuple of tuple of complex, shape (sensors, actuators), or None
        Full scale over full scale; None if not identified.
    drive_limit : float
        Fraction of full scale.
    metres_per_volt : float
        Displacement per volt of amplitude at a patch, in m/V: under a calibrated sensor (volts of the first one), or rms of a
        wave in the zone (volts of the largest one); 0 if unknown.
    """

    frequency_hz: float
    tau_s: float
    patterns: tuple[Pattern, ...]
    matrix: tuple[tuple[complex, ...], ...] | None = None
    drive_limit: float = 1.0
    metres_per_volt: float = 0.0


@dataclass(frozen=True)
class ModeTable:
    """Contents of a mode table: modes, shapes and their origin.

    Attributes
    ----------
    sample_rate_hz : float
    design_hash : bytes
        16 bytes that identify the design and the code that made the table.
    modes : tuple of Mode
    target : int
        Index of the mode to be controlled.
    shapes : tuple of Shape
    senses_displacement : bool
        Whether the sensors follow displacement (or strain) rather than velocity.
    sensor_volts : float
        Voltage at a sensor patch for full scale at the pin, in V: 1.65 over the gain of the conditioner.
    """

    sample_rate_hz: float
    design_hash: bytes
    modes: tuple[Mode, ...] = ()
    target: int = 0
    shapes: tuple[Shape, ...] = ()
    senses_displacement: bool = True
    sensor_volts: float = PIN_VOLTS

    @property
    def channel_counts(self) -> tuple[int, int]:
        """Numbers of actuators and sensors, the same for all modes and shapes. Raises TableError."""
        counts = {(len(mode.actuator_weights), len(mode.sensor_weights)) for mode in self.modes}
        for shape in self.shapes:
            counts |= {(len(pattern.targets), len(pattern.targets)) for pattern in shape.patterns}
            counts |= {(len(row), len(shape.matrix or ())) for row in shape.matrix or ()}
        if len(counts) != 1:
            raise TableError(f"table: (actuators, sensors) differ from entry to entry: {sorted(counts)}")
        (found,) = counts
        if not all(1 <= count <= CHANNELS for count in found):
            raise TableError(f"table: (actuators, sensors) is {found}, allowed 1 to {CHANNELS} each")
        return found


@np.errstate(over="ignore", invalid="ignore")  # values that do not fit are rejected below
def to_bytes(table: ModeTable) -> bytes:
    """Encode a table as a file: little-endian, versioned, with lengths and a CRC-32 (zlib) at the end.

    Raises
    ------
    TableError
        If a value is out of range.
    """
    if len(table.design_hash) != 16:
        raise TableError(f"table: design_hash has {len(table.design_hash)} bytes, allowed 16")
    _check_counts(len(table.modes), len(table.shapes), table.target)
    header, modes, shapes = np.zeros(1, HEADER), np.zeros(len(table.modes), MODE), np.zeros(len(table.shapes), SHAPE)
    sizes = HEADER.itemsize, HEADER.itemsize + modes.nbytes + shapes.nbytes + CRC_BYTES
    header[0] = (
        *(MAGIC, VERSION, *sizes, len(modes), MODE.itemsize, len(shapes), SHAPE.itemsize, *table.channel_counts),
        *(table.target, table.sample_rate_hz, SENSES_DISPLACEMENT * table.senses_displacement, table.sensor_volts),
        table.design_hash,
    )
    for row, mode in zip(modes, table.modes, strict=True):
        _pack_mode(row, mode)
    for index, (row, shape) in enumerate(zip(shapes, table.shapes, strict=True)):
        _check_names(f"shape {index}", len(shape.patterns), [pattern.name for pattern in shape.patterns])
        _pack_shape(row, shape)
    _check_values(header[0], modes, shapes)
    return seal(header.tobytes() + modes.tobytes() + shapes.tobytes())


@np.errstate(invalid="ignore")
def from_bytes(data: bytes) -> ModeTable:
    """Decode the contents of a table file.

    Raises
    ------
    TableError
        If magic number, version, length or CRC is wrong, or a value is out of range.
    """
    header = _whole_header(data)
    modes = np.frombuffer(data, MODE, int(header["mode_count"]), HEADER.itemsize)
    shapes = np.frombuffer(data, SHAPE, int(header["shape_count"]), HEADER.itemsize + modes.nbytes)
    _check_values(header, modes, shapes)
    channels = int(header["actuator_count"]), int(header["sensor_count"])
    return ModeTable(
        sample_rate_hz=float(header["sample_rate_hz"]),
        design_hash=header["design_hash"].tobytes(),
        modes=tuple(_unpack_mode(row, *channels) for row in modes),
        target=int(header["target"]),
        shapes=tuple(_unpack_shape(row, *channels) for row in shapes),
        senses_displacement=bool(header["flags"] & SENSES_DISPLACEMENT),
        sensor_volts=float(header["sensor_volts"]),
    )


def crc32(data: bytes) -> int:
    """CRC-32 as in zlib, Ethernet and PNG: crc32(b"123456789") = 0xCBF43926."""
    return zlib.crc32(data)


def seal(body: bytes) -> bytes:
    """Append the CRC-32 to a body."""
    return body + crc32(body).to_bytes(CRC_BYTES, "little")


def _whole_header(data: bytes) -> Any:
    """Read the header of a table, checking version, lengths and CRC. Raises TableError."""
    if data[:4] != MAGIC:
        raise TableError(f"mode table: starts with {data[:4]!r}, not with {MAGIC!r}: another kind of file")
    if len(data) < HEADER.itemsize + CRC_BYTES:
        raise TableError(f"mode table: truncated, {len(data)} bytes do not hold a header")
    header = np.frombuffer(data, HEADER, 1)[0]
    if header["version"] != VERSION:
        raise TableError(
            f"mode table: version {header['version']} is not supported, this program reads {VERSION}: export it again"
        )
    if header["total_bytes"] != len(data):
        raise TableError(f"mode table: truncated or padded, {len(data)} bytes instead of {header['total_bytes']}")
    stated, result = int.from_bytes(data[-CRC_BYTES:], "little"), crc32(data[:-CRC_BYTES])
    if stated != result:
        raise TableError(f"mode table: damaged, its CRC-32 is {result:08x} instead of {stated:08x}")
    sizes = tuple(int(header[f"{name}_bytes"]) for name in ("header", "mode", "shape"))
    if sizes != (HEADER.itemsize, MODE.itemsize, SHAPE.itemsize):
        expected = (HEADER.itemsize, MODE.itemsize, SHAPE.itemsize)
        raise TableError(f"mode table: record lengths are {sizes}, allowed {expected}")
    modes, shapes = int(header["mode_count"]), int(header["shape_count"])
    if len(data) != HEADER.itemsize + modes * MODE.itemsize + shapes * SHAPE.itemsize + CRC_BYTES:
        raise TableError(f"mode table: {len(data)} bytes do not hold {modes} modes and {shapes} shapes")
    return header


def _check_counts(modes: int, shapes: int, target: int) -> None:
    if modes > MAX_MODES or shapes > MAX_SHAPES:
        raise TableError(f"table: {modes} modes and {shapes} shapes, allowed at most {MAX_MODES} and {MAX_SHAPES}")
    if not modes + shapes:
        raise TableError("table: holds neither a mode nor a shape")
    if not 0 <= target < max(modes, 1):
        raise TableError(f"table: target is {target}, allowed 0 to {max(modes, 1) - 1}")


def _check_values(header: Any, modes: NDArray[np.void], shapes: NDArray[np.void]) -> None:
    """Raise TableError for the first value out of range, with its place and the allowed range."""
    _check_counts(len(modes), len(shapes), int(header["target"]))
    _check_numbers("table", header, ALLOWED)
    _known_flags("mode table", header, SENSES_DISPLACEMENT)
    actuators, sensors = int(header["actuator_count"]), int(header["sensor_count"])
    if len(shapes) and actuators != sensors:
        raise TableError(f"table: {actuators} actuators and {sensors} sensors, a shape needs equal numbers")
    allowed = ALLOWED | {"frequency_hz": (FREQUENCY_LOW_HZ, FREQUENCY_HIGH * float(header["sample_rate_hz"]))}
    for index, mode in enumerate(modes):
        where = f"mode {index}"
        _check_numbers(where, mode, allowed)
        _known_flags(where, mode, GAIN_IDENTIFIED | TAU_IDENTIFIED | FREQUENCY_IDENTIFIED)
        _check_gain(where, mode)
        _check_parts(where, mode, "actuator_weights", WEIGHT_HIGH, actuators)
        _check_parts(where, mode, "sensor_weights", WEIGHT_HIGH, sensors)
    for index, shape in enumerate(shapes):
        where, count = f"shape {index}", int(shape["pattern_count"])
        _check_numbers(where, shape, allowed)
        _known_flags(where, shape, MATRIX_IDENTIFIED)
        _check_names(where, count, _names(shape))
        if any(shape["names"][count:].tobytes()):
            raise TableError(f"{where}: a pattern beyond the {count} in use has a name")
        identified = bool(shape["flags"] & MATRIX_IDENTIFIED)
        _check_parts(where, shape, "matrix", MATRIX_HIGH, sensors * identified, actuators * identified)
        _check_parts(where, shape, "targets", WEIGHT_HIGH, count, sensors)


def _check_numbers(where: str, row: Any, allowed: dict[str, tuple[float, float]]) -> None:
    for name in set(allowed).intersection(row.dtype.names):
        _check_within(where, name, row[name], *allowed[name])


def _check_within(where: str, name: str, value: Any, low: float, high: float) -> None:
    if not np.float32(low) <= value <= np.float32(high):
        raise TableError(f"{where}: {name} is {value:g}, allowed {low:g} to {high:g}")


def _check_gain(where: str, mode: Any) -> None:
    if mode["flags"] & GAIN_IDENTIFIED:
        _check_within(where, "gain (larger of its parts)", _larger_part(mode["gain"]), *GAIN)
    elif mode["gain"] != 0:
        raise TableError(f"{where}: a gain is given but marked unidentified")


def _larger_part(values: Any) -> Any:
    return np.maximum(np.abs(values.real), np.abs(values.imag))


def _check_parts(where: str, row: Any, name: str, high: float, *in_use: int) -> None:
    """Check that the parts of elements in use are at most high in magnitude, and that the other elements are zero."""
    values = row[name]
    used = np.zeros(values.shape, bool)
    used[tuple(map(slice, in_use))] = True
    wrong = values[used & ~(_larger_part(values) <= high)]
    if wrong.size:
        raise TableError(f"{where}: {name} holds {wrong[0]}, allowed parts of at most {high:g}")
    if values[~used].any():
        raise TableError(f"{where}: {name}: an element beyond those in use is not zero")


def _check_names(where: str, count: int, names: list[str]) -> None:
    if not 1 <= count <= PATTERNS:
        raise TableError(f"{where}: {count} patterns, allowed 1 to {PATTERNS}")
    for name in names:
        if not (name.isascii() and name.isprintable() and 1 <= len(name) <= 8):
            raise TableError(f"{where}: pattern name {name!r}, allowed 1 to 8 printable ASCII characters")


def _known_flags(where: str, row: Any, known: int) -> None:
    if int(row["flags"]) & ~known:
        raise TableError(f"{where}: flags are {row['flags']:#x}, allowed bits {known:#x}")


MODE_NUMBERS, SHAPE_NUMBERS = (
    [name for name in layout.names or () if layout[name] == np.dtype("<f4")] for layout in (MODE, SHAPE)
)


def _pack_mode(row: Any, mode: Mode) -> None:
    for name in MODE_NUMBERS:
        row[name] = getattr(mode, name)
    row["gain"] = mode.gain or 0.0
    row["flags"] = (
        GAIN_IDENTIFIED * (mode.gain is not None)
        | TAU_IDENTIFIED * mode.tau_identified
        | FREQUENCY_IDENTIFIED * mode.frequency_identified
    )
    row["actuator_weights"][: len(mode.actuator_weights)] = mode.actuator_weights
    row["sensor_weights"][: len(mode.sensor_weights)] = mode.sensor_weights


def _unpack_mode(row: Any, actuators: int, sensors: int) -> Mode:
    flags = int(row["flags"])
    return Mode(
        **{name: float(row[name]) for name in MODE_NUMBERS},
        gain=complex(row["gain"]) if flags & GAIN_IDENTIFIED else None,
        actuator_weights=tuple(row["actuator_weights"][:actuators].tolist()),
        sensor_weights=tuple(row["sensor_weights"][:sensors].tolist()),
        tau_identified=bool(flags & TAU_IDENTIFIED),
        frequency_identified=bool(flags & FREQUENCY_IDENTIFIED),
    )


def _pack_shape(row: Any, shape: Shape) -> None:
    for name in SHAPE_NUMBERS:
        row[name] = getattr(shape, name)
    row["flags"], row["pattern_count"] = MATRIX_IDENTIFIED * bool(shape.matrix), len(shape.patterns)
    matrix = np.array(shape.matrix or np.zeros((0, 0)))
    row["matrix"][: matrix.shape[0], : matrix.shape[1]] = matrix
    for i, pattern in enumerate(shape.patterns):
        row["names"][i] = np.void(pattern.name.encode("ascii").ljust(8, b"\0"))
        row["targets"][i, : len(pattern.targets)] = pattern.targets


def _names(row: Any) -> list[str]:
    return [name.tobytes().rstrip(b"\0").decode("latin-1") for name in row["names"][: row["pattern_count"]]]


def _unpack_shape(row: Any, actuators: int, sensors: int) -> Shape:
    named_targets = zip(_names(row), map(tuple, row["targets"][:, :sensors].tolist()), strict=False)
    matrix = tuple(map(tuple, row["matrix"][:sensors, :actuators].tolist()))
    return Shape(
        **{name: float(row[name]) for name in SHAPE_NUMBERS},
        patterns=tuple(Pattern(name, targets) for name, targets in named_targets),
        matrix=matrix if row["flags"] & MATRIX_IDENTIFIED else None,
    )


def hold(frequency_hz: float, sample_rate_hz: float) -> complex:
    """Frequency response of a zero-order hold: sin(x)/x with a delay of half a sample.

    Parameters
    ----------
    frequency_hz, sample_rate_hz : float

    Returns
    -------
    complex
        Ratio of the held signal at this frequency to the sampled sinusoid.
    """
    turn = 2j * math.pi * frequency_hz / sample_rate_hz
    return (1.0 - cmath.exp(-turn)) / turn


def refusal(table: ModeTable, build: str) -> str:
    """Return the reason why a build ("single" or "six") cannot use a valid table, or an empty string."""
    played, what = (table.modes[table.target :][:1], "mode") if build == "single" else (table.shapes, "shape")
    if not played or table.sample_rate_hz != RATE_HZ[build]:
        return f"no {what} at {RATE_HZ[build]:g} samples per second"
    lowest = min(np.float32(one.frequency_hz) for one in played)
    least = MIN_MODE_HZ if build == "single" else MIN_SHAPE_HZ
    return "" if lowest >= least else f"a {what} at {lowest:g} Hz, the {build} build requires at least {least:g} Hz"


def why_not_played(table: ModeTable) -> str:
    """Return the reasons why neither build can use a valid table, or an empty string."""
    reasons = [refusal(table, build) for build in RATE_HZ]
    return "" if "" in reasons else ", ".join(reasons)


def header_text(data: bytes) -> str:
    """Write a table as a C header."""
    rows = [", ".join(f"0x{byte:02x}" for byte in data[at : at + 16]) for at in range(0, len(data), 16)]
    body = ",\n    ".join(rows)
    return f"""/* Mode table, generated: do not edit. */
#ifndef ANTINODE_MODE_TABLE_H
#define ANTINODE_MODE_TABLE_H

#include <stdint.h>

#ifndef ANTINODE_TABLE_PLACE
#define ANTINODE_TABLE_PLACE
#endif

ANTINODE_TABLE_PLACE const uint8_t antinode_mode_table[{len(data)}] = {{
    {body}
}};

#endif
"""


def header_bytes(text: str) -> bytes:
    """Read the table from a C header written by header_text. Raises TableError if there is none."""
    start, end = text.find("{"), text.find("}")
    try:
        if start < 0 or end < start:
            raise ValueError
        return bytes(int(item, 16) for item in text[start + 1 : end].split(","))
    except ValueError:
        raise TableError("no array of bytes between braces") from None


def describe(table: ModeTable) -> str:
    """Describe a table for a reader, with one line per mode and shape."""
    actuators, sensors = table.channel_counts
    lines = [
        f"mode table, version {VERSION}, design {table.design_hash.hex()}",
        f"sample rate {table.sample_rate_hz:.10g} Hz, {actuators} actuator(s), {sensors} sensor(s) that follow "
        + ("displacement" if table.senses_displacement else "velocity")
        + f", full scale {table.sensor_volts:.4g} V at the patch",
    ]
    if refused := why_not_played(table):
        lines.append(f"not usable on any board: {refused}")
    lines += [_describe_mode(index, mode, target=index == table.target) for index, mode in enumerate(table.modes)]
    for index, shape in enumerate(table.shapes):
        matrix = "unidentified" if shape.matrix is None else "identified"
        names = ", ".join(pattern.name for pattern in shape.patterns)
        lines.append(
            f"shape {index}: {shape.frequency_hz:.3f} Hz, matrix {matrix}, patterns {names}"
            + _metres(shape.metres_per_volt)
        )
    return "\n".join(lines)


def _describe_mode(index: int, mode: Mode, target: bool) -> str:
    frequency = "measured" if mode.frequency_identified else "computed"
    tau = "identified" if mode.tau_identified else "assumed"
    gain = "unidentified: found by a sweep before the drive is used"
    if mode.gain is not None:
        gain = f"{abs(mode.gain):.6g} at {math.degrees(cmath.phase(mode.gain)):.2f} deg"
    mark = " (target)" if target else ""
    return (
        f"mode {index}{mark}: {mode.frequency_hz:.3f} Hz ({frequency}), tau {mode.tau_s * 1e3:.4g} ms, "
        f"Q {mode.quality_factor:.4g} ({tau}), gain {gain}, delay {mode.delay_s * 1e6:.3g} us, "
        f"drive at most {mode.drive_limit:.3g}, amplitude at most {mode.amplitude_limit:.3g} of full scale"
        + _metres(mode.metres_per_volt)
    )


def _metres(per_volt: float) -> str:
    return f", {1e6 * per_volt:.4g} um/V" if per_volt else ""
