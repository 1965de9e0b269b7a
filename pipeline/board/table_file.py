"""The mode table as the firmware reads it: a binary file, a C header of the same bytes, and a description.

The byte layout is that of firmware.table_format.
"""

from __future__ import annotations

import math

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


def to_bytes(table: ModeTable) -> bytes:
    """The table as a file: little-endian, versioned, lengths given, CRC-32 (zlib) behind. Raises TableError."""
    check(table)
    actuators, sensors = channel_counts(table)
    total = _total_bytes(len(table.modes), len(table.shapes))
    header = layout.HEADER.pack(
        layout.MAGIC,
        table.version,
        layout.HEADER.size,
        total,
        len(table.modes),
        layout.MODE.size,
        len(table.shapes),
        layout.SHAPE.size,
        actuators,
        sensors,
        table.wanted,
        table.sample_rate_hz,
        layout.SENSES_DISPLACEMENT if table.senses_displacement else 0,
        table.design_hash,
    )
    return layout.seal(header + b"".join(map(_pack_mode, table.modes)) + b"".join(map(_pack_shape, table.shapes)))


def from_bytes(data: bytes) -> ModeTable:
    """The table held by a file. Raises TableError: wrong magic, version, length, CRC, or a value out of range."""
    header = _read_header(data)
    actuators, sensors = header["actuator_count"], header["sensor_count"]
    modes_at = layout.HEADER.size
    shapes_at = modes_at + header["mode_count"] * layout.MODE.size
    table = ModeTable(
        sample_rate_hz=header["sample_rate_hz"],
        design_hash=header["design_hash"],
        modes=tuple(
            _unpack_mode(data, modes_at + i * layout.MODE.size, f"mode {i}", actuators, sensors)
            for i in range(header["mode_count"])
        ),
        wanted=header["wanted"],
        shapes=tuple(
            _unpack_shape(data, shapes_at + i * layout.SHAPE.size, f"shape {i}", actuators, sensors)
            for i in range(header["shape_count"])
        ),
        senses_displacement=bool(header["flags"] & layout.SENSES_DISPLACEMENT),
        version=header["version"],
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


def _total_bytes(mode_count: int, shape_count: int) -> int:
    return layout.HEADER.size + mode_count * layout.MODE.size + shape_count * layout.SHAPE.size + layout.CRC.size


def _parts(values: tuple[complex, ...], room: int) -> list[float]:
    padded = [*values, *[0j] * (room - len(values))]
    return [part for value in padded for part in (value.real, value.imag)]


def _complexes(parts: tuple[float, ...], count: int, where: str) -> tuple[complex, ...]:
    if any(part != 0.0 for part in parts[2 * count :]):
        raise TableError(f"{where}: a channel beyond the {count} in use is not zero")
    return tuple(complex(parts[2 * i], parts[2 * i + 1]) for i in range(count))


def _pack_mode(mode: Mode) -> bytes:
    flags = (
        layout.GAIN_IDENTIFIED * (mode.gain is not None)
        | layout.TAU_IDENTIFIED * mode.tau_identified
        | layout.FREQUENCY_IDENTIFIED * mode.frequency_identified
    )
    gain = mode.gain if mode.gain is not None else 0j
    return layout.MODE.pack(
        mode.frequency_hz,
        mode.tau_s,
        gain.real,
        gain.imag,
        mode.delay_s,
        mode.drive_limit,
        mode.amplitude_limit,
        flags,
        *_parts(mode.actuator_weights, layout.CHANNELS),
        *_parts(mode.sensor_weights, layout.CHANNELS),
    )


def _unpack_mode(data: bytes, at: int, where: str, actuators: int, sensors: int) -> Mode:
    values = layout.MODE.unpack_from(data, at)
    head = dict(zip(layout.MODE_FIELDS, values, strict=False))
    weights = values[len(layout.MODE_FIELDS) :]
    known = layout.GAIN_IDENTIFIED | layout.TAU_IDENTIFIED | layout.FREQUENCY_IDENTIFIED
    _known_flags(where, head["flags"], known)
    identified = bool(head["flags"] & layout.GAIN_IDENTIFIED)
    gain = complex(head["gain_re"], head["gain_im"])
    if not identified and gain != 0:
        raise TableError(f"{where}: a gain is given but marked unidentified")
    return Mode(
        frequency_hz=head["frequency_hz"],
        tau_s=head["tau_s"],
        gain=gain if identified else None,
        delay_s=head["delay_s"],
        drive_limit=head["drive_limit"],
        amplitude_limit=head["amplitude_limit"],
        actuator_weights=_complexes(weights[: 2 * layout.CHANNELS], actuators, where),
        sensor_weights=_complexes(weights[2 * layout.CHANNELS :], sensors, where),
        tau_identified=bool(head["flags"] & layout.TAU_IDENTIFIED),
        frequency_identified=bool(head["flags"] & layout.FREQUENCY_IDENTIFIED),
    )


def _pack_shape(shape: Shape) -> bytes:
    names = b"".join(pattern.name.encode("ascii").ljust(8, b"\0") for pattern in shape.patterns)
    rows = list(shape.matrix or ()) + [()] * (layout.CHANNELS - len(shape.matrix or ()))
    targets = [pattern.targets for pattern in shape.patterns]
    targets += [()] * (layout.PATTERNS - len(targets))
    return layout.SHAPE.pack(
        shape.frequency_hz,
        shape.tau_s,
        shape.drive_limit,
        layout.MATRIX_IDENTIFIED * (shape.matrix is not None),
        len(shape.patterns),
        names,
        *[part for row in rows for part in _parts(row, layout.CHANNELS)],
        *[part for target in targets for part in _parts(target, layout.CHANNELS)],
    )


def _unpack_shape(data: bytes, at: int, where: str, actuators: int, sensors: int) -> Shape:
    values = layout.SHAPE.unpack_from(data, at)
    head = dict(zip(layout.SHAPE_FIELDS, values, strict=False))
    _known_flags(where, head["flags"], layout.MATRIX_IDENTIFIED)
    count = head["pattern_count"]
    if not 1 <= count <= layout.PATTERNS:
        raise TableError(f"{where}: {count} patterns, allowed 1 to {layout.PATTERNS}")
    if any(head["names"][8 * count :]):
        raise TableError(f"{where}: a pattern beyond the {count} in use has a name")
    width = 2 * layout.CHANNELS
    parts = values[len(layout.SHAPE_FIELDS) :]
    rows = [parts[i * width : (i + 1) * width] for i in range(layout.CHANNELS + layout.PATTERNS)]
    matrix_rows, target_rows = rows[: layout.CHANNELS], rows[layout.CHANNELS :]
    if not head["flags"] & layout.MATRIX_IDENTIFIED:
        actuators_in_use, rows_in_use = 0, 0
    else:
        actuators_in_use, rows_in_use = actuators, sensors
    matrix = [_complexes(row, actuators_in_use if i < rows_in_use else 0, where) for i, row in enumerate(matrix_rows)]
    targets = [_complexes(row, sensors if i < count else 0, where) for i, row in enumerate(target_rows)]
    names = [head["names"][8 * i : 8 * i + 8].rstrip(b"\0").decode("latin-1") for i in range(count)]
    return Shape(
        frequency_hz=head["frequency_hz"],
        tau_s=head["tau_s"],
        patterns=tuple(Pattern(name, target) for name, target in zip(names, targets, strict=False)),
        matrix=tuple(matrix[:rows_in_use]) if rows_in_use else None,
        drive_limit=head["drive_limit"],
    )


def _known_flags(where: str, flags: int, known: int) -> None:
    if flags & ~known:
        raise TableError(f"{where}: flags are {flags:#x}, allowed bits {known:#x}")


def _read_header(data: bytes) -> dict:
    if len(data) < layout.HEADER.size + layout.CRC.size:
        raise TableError(f"mode table: truncated, {len(data)} bytes do not hold a header")
    if data[:4] != layout.MAGIC:
        raise TableError(f"mode table: starts with {data[:4]!r}, not with {layout.MAGIC!r}: another kind of file")
    header = dict(zip(layout.HEADER_FIELDS, layout.HEADER.unpack_from(data), strict=True))
    if header["version"] != layout.VERSION:
        raise TableError(f"mode table: version {header['version']} is refused, this program reads {layout.VERSION}")
    if header["total_bytes"] != len(data):
        raise TableError(f"mode table: truncated or padded, {len(data)} bytes where it states {header['total_bytes']}")
    (stated,) = layout.CRC.unpack_from(data, len(data) - layout.CRC.size)
    checksum = layout.crc32(data[: -layout.CRC.size])
    if stated != checksum:
        raise TableError(f"mode table: damaged, its CRC-32 is {checksum:08x} where it states {stated:08x}")
    _check_lengths(header)
    return header


def _check_lengths(header: dict) -> None:
    sizes = (header["header_bytes"], header["mode_bytes"], header["shape_bytes"])
    expected = (layout.HEADER.size, layout.MODE.size, layout.SHAPE.size)
    if sizes != expected:
        raise TableError(f"mode table: record lengths are {sizes}, allowed {expected}")
    if header["total_bytes"] != _total_bytes(header["mode_count"], header["shape_count"]):
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
