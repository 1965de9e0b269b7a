"""The mode table as the firmware reads it: a binary file, a C header of the same bytes, and a description.

The byte layout is that of firmware.table_format.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from firmware import table_format as layout
from pipeline.board.table import GAIN, Mode, ModeTable, Pattern, Shape, TableError, channel_counts, check

__all__ = [
    "GAIN",
    "Mode",
    "ModeTable",
    "Pattern",
    "Shape",
    "TableError",
    "check",
    "describe",
    "from_bytes",
    "to_bytes",
    "to_header",
]

MODE_NUMBERS = ("frequency_hz", "tau_s", "delay_s", "drive_limit", "amplitude_limit")


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


def describe(table: ModeTable) -> str:
    """What a table holds, for a reader: one line for each mode, shape and pattern."""
    actuators, sensors = channel_counts(table)
    lines = [
        f"mode table, version {table.version}, design {table.design_hash.hex()}",
        f"sample rate {table.sample_rate_hz:.10g} Hz, {actuators} actuator(s), {sensors} sensor(s) that follow "
        + ("displacement" if table.senses_displacement else "velocity"),
    ]
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
        f"mode {index}{mark}: {mode.frequency_hz:.3f} Hz ({frequency}), tau {mode.tau_s * 1e3:.4g} ms, "
        f"Q {mode.quality:.4g} ({tau}), gain {gain}, delay {mode.delay_s * 1e6:.3g} us, "
        f"drive at most {mode.drive_limit:.3g}, amplitude at most {mode.amplitude_limit:.3g} of full scale"
    )
