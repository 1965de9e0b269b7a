"""The mode table: what it holds, what its values may be, and the file that the firmware reads.

All amplitudes are fractions of full scale at the converter's pins (1 = the largest swing about mid-scale), so that a gain is
a plain ratio, sensor over drive. The byte layout is that of firmware.table_format.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

from firmware import table_format as layout
from pipeline.units import MS, US

MODE_NUMBERS = ("frequency_hz", "tau_s", "delay_s", "drive_limit", "amplitude_limit")
FREQUENCY_LOW_HZ = 20.0
FREQUENCY_HIGH = 0.4  # of the sample rate
RATE_HZ = (1e3, 1e6)
GAIN = (1e-6, 1e3)
# What the numbers of modes and shapes may be, by their names.
ALLOWED = {"tau_s": (1e-6, 10.0), "delay_s": (0.0, 1e-3), "drive_limit": (1e-3, 1.0), "amplitude_limit": (1e-3, 1.0)}
WEIGHT_HIGH = 1.0
MATRIX_HIGH = 1e3


class TableError(ValueError):
    """A mode table that is damaged, of a refused version, or holds a value out of range; one line says which."""


@dataclass(frozen=True)
class Mode:
    """One resonance as the controller sees it: H = gain exp(-j w delay) / (1 + j tau (w - w0)), w0 = 2 pi frequency.

    frequency_hz in Hz; tau_s, the decay time of the amplitude, in s; gain None while nothing has computed or measured
    it; delay_s, the dead time from the DAC's update to the ADC's sample beyond the mode's own phase, in s; drive_limit
    and amplitude_limit as fractions of full scale; weights relative to the largest, one for each actuator and sensor.
    The two flags tell a measured tau or frequency from an assumed or computed one.
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

    @classmethod
    def from_quality_factor(cls, frequency_hz: float, quality_factor: float, **rest: object) -> Mode:
        """A mode whose time constant follows from an assumed quality factor: tau = Q / (pi f)."""
        return cls(frequency_hz, quality_factor / (math.pi * frequency_hz), **rest)  # type: ignore[arg-type]

    @property
    def quality_factor(self) -> float:
        """Quality factor Q = pi f tau."""
        return math.pi * self.frequency_hz * self.tau_s


@dataclass(frozen=True)
class Pattern:
    """A wanted motion of a six-channel plate: one complex sensor target per sensor, relative to the largest."""

    name: str
    targets: tuple[complex, ...]


@dataclass(frozen=True)
class Shape:
    """Shaping at one frequency: sensors = matrix @ drives, row by row, and the patterns to be reached.

    frequency_hz in Hz; tau_s, the plate's slowest decay time, in s; matrix (sensors, actuators) as full scale over full
    scale, None while it has not been identified.
    """

    frequency_hz: float
    tau_s: float
    patterns: tuple[Pattern, ...]
    matrix: tuple[tuple[complex, ...], ...] | None = None
    drive_limit: float = 1.0


@dataclass(frozen=True)
class ModeTable:
    """Everything the firmware reads: modes, shaping, and where they come from.

    sample_rate_hz in Hz; design_hash, 16 bytes that name the design and code which made the table; wanted, the index of
    the mode to be controlled; senses_displacement tells a strain-like sensor from a velocity-like one.
    """

    sample_rate_hz: float
    design_hash: bytes
    modes: tuple[Mode, ...]
    wanted: int = 0
    shapes: tuple[Shape, ...] = ()
    senses_displacement: bool = True
    version: int = layout.VERSION


def check(table: ModeTable) -> None:
    """Raises TableError for the first value out of range, naming where it stands and what is allowed."""
    if table.version != layout.VERSION:
        raise TableError(f"mode table: version {table.version} is refused, this program reads {layout.VERSION}")
    _check_counts(table)
    _within("table", "sample_rate_hz", table.sample_rate_hz, *RATE_HZ)
    for index, mode in enumerate(table.modes):
        _check_mode(f"mode {index}", mode, table.sample_rate_hz)
    for index, shape in enumerate(table.shapes):
        _check_shape(f"shape {index}", shape, table.sample_rate_hz)


def _check_counts(table: ModeTable) -> None:
    if len(table.design_hash) != 16:
        raise TableError(f"table: design_hash has {len(table.design_hash)} bytes, allowed 16")
    if not 0 <= len(table.modes) <= layout.MAX_MODES or not 0 <= len(table.shapes) <= layout.MAX_SHAPES:
        raise TableError(
            f"table: {len(table.modes)} modes and {len(table.shapes)} shapes, "
            f"allowed at most {layout.MAX_MODES} and {layout.MAX_SHAPES}"
        )
    if not table.modes and not table.shapes:
        raise TableError("table: holds neither a mode nor a shape")
    if not 0 <= table.wanted < max(len(table.modes), 1):
        raise TableError(f"table: wanted is {table.wanted}, allowed 0 to {max(len(table.modes), 1) - 1}")
    counts = set(_all_channel_counts(table))
    if len(counts) != 1:
        raise TableError(f"table: (actuators, sensors) differ from entry to entry: {sorted(counts)}")
    if not all(1 <= count <= layout.CHANNELS for count in next(iter(counts))):
        raise TableError(f"table: (actuators, sensors) is {counts.pop()}, allowed 1 to {layout.CHANNELS} each")


def _check_numbers(where: str, entry: Mode | Shape, rate_hz: float) -> None:
    _within(where, "frequency_hz", entry.frequency_hz, FREQUENCY_LOW_HZ, FREQUENCY_HIGH * rate_hz)
    for name, (low, high) in ALLOWED.items():
        if hasattr(entry, name):
            _within(where, name, getattr(entry, name), low, high)


def _check_mode(where: str, mode: Mode, rate_hz: float) -> None:
    _check_numbers(where, mode, rate_hz)
    if mode.gain is not None:
        largest = max(abs(mode.gain.real), abs(mode.gain.imag)) if _finite(mode.gain) else math.nan
        _within(where, "gain (larger of its parts)", largest, *GAIN)
    _parts_within(where, "actuator_weights", mode.actuator_weights, WEIGHT_HIGH)
    _parts_within(where, "sensor_weights", mode.sensor_weights, WEIGHT_HIGH)


def _check_shape(where: str, shape: Shape, rate_hz: float) -> None:
    _check_numbers(where, shape, rate_hz)
    if not 1 <= len(shape.patterns) <= layout.PATTERNS:
        raise TableError(f"{where}: {len(shape.patterns)} patterns, allowed 1 to {layout.PATTERNS}")
    for pattern in shape.patterns:
        if not (pattern.name.isascii() and pattern.name.isprintable() and 1 <= len(pattern.name) <= 8):
            raise TableError(f"{where}: pattern name {pattern.name!r}, allowed 1 to 8 printable ASCII characters")
        _parts_within(where, f"pattern {pattern.name}", pattern.targets, WEIGHT_HIGH)
    for row in shape.matrix or ():
        _parts_within(where, "matrix", row, MATRIX_HIGH)
        if len(row) != len(shape.matrix[0] if shape.matrix else row):
            raise TableError(f"{where}: matrix rows differ in length")


def _finite(value: complex) -> bool:
    return math.isfinite(value.real) and math.isfinite(value.imag)


def _within(where: str, name: str, value: float, low: float, high: float) -> None:
    low32, high32 = _as_float32(low), _as_float32(high)
    if not low32 <= _as_float32(value) <= high32:
        raise TableError(f"{where}: {name} is {value:g}, allowed {low:g} to {high:g}")


def _parts_within(where: str, name: str, values: tuple[complex, ...], high: float) -> None:
    for value in values:
        if not (_finite(value) and max(abs(value.real), abs(value.imag)) <= high):
            raise TableError(f"{where}: {name} holds {value}, allowed parts of at most {high:g}")


def _as_float32(value: float) -> float:
    with np.errstate(over="ignore"):
        return float(np.float32(value))


def _all_channel_counts(table: ModeTable) -> Iterator[tuple[int, int]]:
    for mode in table.modes:
        yield len(mode.actuator_weights), len(mode.sensor_weights)
    for shape in table.shapes:
        sensors = len(shape.patterns[0].targets) if shape.patterns else 0
        for pattern in shape.patterns:
            yield sensors, len(pattern.targets)
        if shape.matrix is not None:
            yield len(shape.matrix[0]) if shape.matrix else 0, len(shape.matrix)


def channel_counts(table: ModeTable) -> tuple[int, int]:
    return next(_all_channel_counts(table))


def to_bytes(table: ModeTable) -> bytes:
    """The table as a file: little-endian, versioned, lengths given, CRC-32 (zlib) behind. Raises TableError."""
    check(table)
    actuators, sensors = channel_counts(table)
    modes, shapes = np.zeros(len(table.modes), layout.MODE), np.zeros(len(table.shapes), layout.SHAPE)
    for row, mode in zip(modes, table.modes, strict=True):
        _pack_mode(row, mode)
    for row, shape in zip(shapes, table.shapes, strict=True):
        _pack_shape(row, shape)
    return layout.assemble(
        modes,
        shapes,
        version=table.version,
        actuator_count=actuators,
        sensor_count=sensors,
        wanted=table.wanted,
        sample_rate_hz=table.sample_rate_hz,
        flags=layout.SENSES_DISPLACEMENT if table.senses_displacement else 0,
        design_hash=np.void(table.design_hash),
    )


def from_bytes(data: bytes) -> ModeTable:
    """The table held by a file. Raises TableError: wrong magic, version, length, CRC, or a value out of range."""
    _check_frame(data)
    header, modes, shapes = layout.parse(data)
    actuators, sensors = int(header["actuator_count"]), int(header["sensor_count"])
    table = ModeTable(
        sample_rate_hz=float(header["sample_rate_hz"]),
        design_hash=header["design_hash"].tobytes(),
        modes=tuple(_unpack_mode(row, f"mode {i}", actuators, sensors) for i, row in enumerate(modes)),
        wanted=int(header["wanted"]),
        shapes=tuple(_unpack_shape(row, f"shape {i}", actuators, sensors) for i, row in enumerate(shapes)),
        senses_displacement=bool(header["flags"] & layout.SENSES_DISPLACEMENT),
        version=int(header["version"]),
    )
    check(table)
    return table


def to_header(table: ModeTable) -> str:
    """A C header that holds the very bytes of to_bytes. Raises TableError."""
    return layout.header_text(to_bytes(table))


def why_not_played(table: ModeTable) -> str:
    """Why neither build takes a table; empty when one does. Raises TableError."""
    data = to_bytes(table)
    reasons = [layout.refusal(data, build) for build in layout.RATE_HZ]
    return "" if "" in reasons else ", ".join(reasons)


def describe(table: ModeTable) -> str:
    """What a table holds, for a reader: one line for each mode, shape and pattern."""
    actuators, sensors = channel_counts(table)
    lines = [
        f"mode table, version {table.version}, design {table.design_hash.hex()}",
        f"sample rate {table.sample_rate_hz:.10g} Hz, {actuators} actuator(s), {sensors} sensor(s) that follow "
        + ("displacement" if table.senses_displacement else "velocity"),
    ]
    refusal = why_not_played(table)
    lines += [f"no board plays it: {refusal}"] if refusal else []
    for index, mode in enumerate(table.modes):
        lines.append(_describe_mode(index, mode, wanted=index == table.wanted))
    for index, shape in enumerate(table.shapes):
        matrix = "unidentified" if shape.matrix is None else "identified"
        names = ", ".join(pattern.name for pattern in shape.patterns)
        lines.append(f"shape {index}: {shape.frequency_hz:.3f} Hz, matrix {matrix}, patterns {names}")
    return "\n".join(lines)


def _in_use(values: Any, count: int, where: str) -> tuple[complex, ...]:
    """The first channels of a row, or TableError when the others are not zero."""
    if any(part != 0.0 for z in values[count:].tolist() for part in (z.real, z.imag)):
        raise TableError(f"{where}: a channel beyond the {count} in use is not zero")
    return tuple(values[:count].tolist())


def _pack_mode(row: Any, mode: Mode) -> None:
    for name in MODE_NUMBERS:
        row[name] = getattr(mode, name)
    row["gain"] = mode.gain if mode.gain is not None else 0j
    row["flags"] = (
        layout.GAIN_IDENTIFIED * (mode.gain is not None)
        | layout.TAU_IDENTIFIED * mode.tau_identified
        | layout.FREQUENCY_IDENTIFIED * mode.frequency_identified
    )
    row["actuator_weights"][: len(mode.actuator_weights)] = mode.actuator_weights
    row["sensor_weights"][: len(mode.sensor_weights)] = mode.sensor_weights


def _unpack_mode(row: Any, where: str, actuators: int, sensors: int) -> Mode:
    flags, gain = int(row["flags"]), complex(row["gain"])
    _known_flags(where, flags, layout.GAIN_IDENTIFIED | layout.TAU_IDENTIFIED | layout.FREQUENCY_IDENTIFIED)
    identified = bool(flags & layout.GAIN_IDENTIFIED)
    if not identified and gain != 0:
        raise TableError(f"{where}: a gain is given but marked unidentified")
    return Mode(
        **{name: float(row[name]) for name in MODE_NUMBERS},
        gain=gain if identified else None,
        actuator_weights=_in_use(row["actuator_weights"], actuators, where),
        sensor_weights=_in_use(row["sensor_weights"], sensors, where),
        tau_identified=bool(flags & layout.TAU_IDENTIFIED),
        frequency_identified=bool(flags & layout.FREQUENCY_IDENTIFIED),
    )


def _pack_shape(row: Any, shape: Shape) -> None:
    row["frequency_hz"], row["tau_s"], row["drive_limit"] = shape.frequency_hz, shape.tau_s, shape.drive_limit
    row["flags"], row["pattern_count"] = layout.MATRIX_IDENTIFIED * (shape.matrix is not None), len(shape.patterns)
    for i, line in enumerate(shape.matrix or ()):
        row["matrix"][i, : len(line)] = line
    for i, pattern in enumerate(shape.patterns):
        row["names"][i] = np.void(pattern.name.encode("ascii").ljust(8, b"\0"))
        row["targets"][i, : len(pattern.targets)] = pattern.targets


def _unpack_shape(row: Any, where: str, actuators: int, sensors: int) -> Shape:
    flags, count = int(row["flags"]), int(row["pattern_count"])
    _known_flags(where, flags, layout.MATRIX_IDENTIFIED)
    if not 1 <= count <= layout.PATTERNS:
        raise TableError(f"{where}: {count} patterns, allowed 1 to {layout.PATTERNS}")
    if any(row["names"][count:].tobytes()):
        raise TableError(f"{where}: a pattern beyond the {count} in use has a name")
    columns, lines = (actuators, sensors) if flags & layout.MATRIX_IDENTIFIED else (0, 0)
    matrix = [_in_use(line, columns if i < lines else 0, where) for i, line in enumerate(row["matrix"])]
    targets = [_in_use(line, sensors if i < count else 0, where) for i, line in enumerate(row["targets"])]
    names = [name.tobytes().rstrip(b"\0").decode("latin-1") for name in row["names"][:count]]
    return Shape(
        frequency_hz=float(row["frequency_hz"]),
        tau_s=float(row["tau_s"]),
        patterns=tuple(Pattern(name, target) for name, target in zip(names, targets, strict=False)),
        matrix=tuple(matrix[:lines]) if lines else None,
        drive_limit=float(row["drive_limit"]),
    )


def _known_flags(where: str, flags: int, known: int) -> None:
    if flags & ~known:
        raise TableError(f"{where}: flags are {flags:#x}, allowed bits {known:#x}")


def _check_frame(data: bytes) -> None:
    if len(data) < layout.HEADER.itemsize + layout.CRC.size:
        raise TableError(f"mode table: truncated, {len(data)} bytes do not hold a header")
    if data[:4] != layout.MAGIC:
        raise TableError(f"mode table: starts with {data[:4]!r}, not with {layout.MAGIC!r}: another kind of file")
    header = layout.read_header(data)
    if header["version"] != layout.VERSION:
        raise TableError(f"mode table: version {header['version']} is refused, this program reads {layout.VERSION}")
    if header["total_bytes"] != len(data):
        raise TableError(f"mode table: truncated or padded, {len(data)} bytes where it states {header['total_bytes']}")
    (stated,) = layout.CRC.unpack_from(data, len(data) - layout.CRC.size)
    result = layout.crc32(data[: -layout.CRC.size])
    if stated != result:
        raise TableError(f"mode table: damaged, its CRC-32 is {result:08x} where it states {stated:08x}")
    _check_lengths({name: header[name].item() for name in header.dtype.names})


def _check_lengths(header: dict[str, Any]) -> None:
    sizes = (header["header_bytes"], header["mode_bytes"], header["shape_bytes"])
    expected = (layout.HEADER.itemsize, layout.MODE.itemsize, layout.SHAPE.itemsize)
    if sizes != expected:
        raise TableError(f"mode table: record lengths are {sizes}, allowed {expected}")
    records = header["mode_count"] * layout.MODE.itemsize + header["shape_count"] * layout.SHAPE.itemsize
    if header["total_bytes"] != layout.HEADER.itemsize + records + layout.CRC.size:
        raise TableError(
            f"mode table: {header['total_bytes']} bytes do not hold {header['mode_count']} modes "
            f"and {header['shape_count']} shapes"
        )
    for side in ("actuator_count", "sensor_count"):
        if not 1 <= header[side] <= layout.CHANNELS:
            raise TableError(f"mode table: {side} is {header[side]}, allowed 1 to {layout.CHANNELS}")
    _known_flags("mode table", header["flags"], layout.SENSES_DISPLACEMENT)


def _describe_mode(index: int, mode: Mode, wanted: bool) -> str:
    frequency = "measured" if mode.frequency_identified else "computed"
    tau = "identified" if mode.tau_identified else "assumed"
    gain = "unidentified: found by a sweep before the drive is used"
    if mode.gain is not None:
        gain = f"{abs(mode.gain):.6g} at {math.degrees(math.atan2(mode.gain.imag, mode.gain.real)):.2f} deg"
    mark = " (wanted)" if wanted else ""
    return (
        f"mode {index}{mark}: {mode.frequency_hz:.3f} Hz ({frequency}), tau {mode.tau_s / MS:.4g} ms, "
        f"Q {mode.quality_factor:.4g} ({tau}), gain {gain}, delay {mode.delay_s / US:.3g} us, "
        f"drive at most {mode.drive_limit:.3g}, amplitude at most {mode.amplitude_limit:.3g} of full scale"
    )
