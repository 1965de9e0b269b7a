"""How a mode table lies in memory: one description for the exporter, the image and the emulated board.

Little-endian, packed, every member on a multiple of its own size:

    header | mode x mode_count | shape x shape_count | CRC-32 (zlib) of everything before it

firmware/core/an_table.h states the same offsets for the C reader; a test compares the two.
"""

from __future__ import annotations

import struct
import zlib
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

MAGIC = b"ANTM"
VERSION = 1
CHANNELS = 6
PATTERNS = 8
MAX_MODES = 16
MAX_SHAPES = 2
RATE_HZ = {"single": 250e3, "six": 40e3}  # of the builds
MIN_MODE_HZ = 2000.0  # the single-mode board refuses lower ones: too little of a period is in a window
MIN_SHAPE_HZ = 350.0  # the six-channel board refuses lower tones: two of their periods are too long for its watchdog

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
        ("wanted", "<u2"),
        ("sample_rate_hz", "<f4"),
        ("flags", "<u4"),
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
        ("flags", "<u2"),
        ("pattern_count", "<u2"),
        ("names", "V8", PATTERNS),
        ("matrix", "<c8", (CHANNELS, CHANNELS)),
        ("targets", "<c8", (PATTERNS, CHANNELS)),
    ]
)
CRC = struct.Struct("<I")

SENSES_DISPLACEMENT = 1  # header flag: the sensors follow displacement, 90 degrees behind velocity
GAIN_IDENTIFIED = 1  # mode flags
TAU_IDENTIFIED = 2
FREQUENCY_IDENTIFIED = 4
MATRIX_IDENTIFIED = 1  # shape flag

MAX_BYTES = HEADER.itemsize + MAX_MODES * MODE.itemsize + MAX_SHAPES * SHAPE.itemsize + CRC.size


def crc32(data: bytes) -> int:
    """CRC-32 as zlib, Ethernet and PNG compute it: crc32(b"123456789") = 0xCBF43926."""
    return zlib.crc32(data) & 0xFFFFFFFF


def seal(body: bytes) -> bytes:
    """The body with its CRC-32 behind it."""
    return body + CRC.pack(crc32(body))


class Parts(NamedTuple):
    """A table's header (a record of HEADER), modes and shapes (arrays of MODE and SHAPE)."""

    header: Any
    modes: NDArray[np.void]
    shapes: NDArray[np.void]


def assemble(modes: NDArray[np.void], shapes: NDArray[np.void], **header: Any) -> bytes:
    """A whole table; of the header what lengths and counts do not tell is given."""
    body = np.zeros(1, HEADER)
    body["magic"], body["version"], body["header_bytes"] = np.void(MAGIC), VERSION, HEADER.itemsize
    body["mode_count"], body["mode_bytes"] = len(modes), MODE.itemsize
    body["shape_count"], body["shape_bytes"] = len(shapes), SHAPE.itemsize
    body["total_bytes"] = HEADER.itemsize + modes.nbytes + shapes.nbytes + CRC.size
    for name, value in header.items():
        body[name] = value
    return seal(body.tobytes() + modes.tobytes() + shapes.tobytes())


def read_header(data: bytes) -> Any:
    """The record that a table begins with; nothing of it is looked at but that there are enough bytes."""
    return np.frombuffer(data, HEADER, 1)[0]


def parse(data: bytes) -> Parts:
    """The parts of a table that verify has accepted."""
    header = read_header(data)
    shapes_at = HEADER.itemsize + int(header["mode_count"]) * MODE.itemsize
    modes = np.frombuffer(data, MODE, int(header["mode_count"]), HEADER.itemsize)
    return Parts(header, modes, np.frombuffer(data, SHAPE, int(header["shape_count"]), shapes_at))


def verify(data: bytes) -> None:
    """Raises ValueError unless the bytes are a whole, undamaged table of this version; values are not looked at."""
    if data[:4] != MAGIC:
        raise ValueError("not a mode table")
    if len(data) < HEADER.itemsize + CRC.size or read_header(data)["total_bytes"] != len(data):
        raise ValueError("truncated or padded")
    if read_header(data)["version"] != VERSION:
        raise ValueError(f"version {read_header(data)['version']} is refused, allowed {VERSION}")
    if seal(data[: -CRC.size]) != data:
        raise ValueError("damaged: the CRC-32 does not fit")


def refusal(data: bytes, build: str) -> str:
    """Why a build ("single" or "six") does not take a sound table; empty when it does."""
    header, modes, shapes = parse(data)
    played, what = (modes[header["wanted"] :][:1], "mode") if build == "single" else (shapes, "shape")
    if not len(played) or header["sample_rate_hz"] != RATE_HZ[build]:
        return f"no {what} at {RATE_HZ[build]:g} samples a second"
    lowest, least = played["frequency_hz"].min(), MIN_MODE_HZ if build == "single" else MIN_SHAPE_HZ
    return "" if lowest >= least else f"a {what} of {lowest:g} Hz, the {build} build takes {least:g} Hz and more"


def with_drive_limit(data: bytes, limit: float) -> bytes:
    """The same table with another drive limit, 0.001 to 1 of full scale, in all modes and shapes. Raises ValueError."""
    verify(data)
    if not 1e-3 <= limit <= 1.0:
        raise ValueError(f"drive limit {limit:g}, allowed 0.001 to 1")
    header, modes, shapes = parse(data)
    modes, shapes = modes.copy(), shapes.copy()
    modes["drive_limit"] = shapes["drive_limit"] = limit
    return seal(header.tobytes() + modes.tobytes() + shapes.tobytes())


def header_text(data: bytes) -> str:
    """A C header that holds the given table, byte for byte."""
    rows = [", ".join(f"0x{byte:02x}" for byte in data[at : at + 16]) for at in range(0, len(data), 16)]
    body = ",\n    ".join(rows)
    return f"""/* A mode table, made by a program: do not edit. */
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
    """The table inside a C header written by header_text. Raises ValueError when there is none."""
    start, end = text.find("{"), text.find("}")
    try:
        if start < 0 or end < start:
            raise ValueError
        return bytes(int(item, 16) for item in text[start + 1 : end].split(","))
    except ValueError:
        raise ValueError("no array of bytes between braces") from None
