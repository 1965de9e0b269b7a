"""How a mode table lies in memory: one description for the exporter, the image and the emulated board.

Little-endian, packed, every member on a multiple of its own size:

    header | mode x mode_count | shape x shape_count | CRC-32 (zlib) of everything before it

firmware/core/an_table.h states the same offsets for the C reader; a test compares the two.
"""

from __future__ import annotations

import struct
import zlib

MAGIC = b"ANTM"
VERSION = 1
CHANNELS = 6
PATTERNS = 8
MAX_MODES = 16
MAX_SHAPES = 2
MIN_SHAPE_HZ = 350.0  # the six-channel board refuses lower tones: two of their periods are too long for its watchdog

HEADER = struct.Struct("<4sHHIHHHHBBHfI16s")
HEADER_FIELDS = (
    "magic",
    "version",
    "header_bytes",
    "total_bytes",
    "mode_count",
    "mode_bytes",
    "shape_count",
    "shape_bytes",
    "actuator_count",
    "sensor_count",
    "wanted",
    "sample_rate_hz",
    "flags",
    "design_hash",
)
MODE = struct.Struct(f"<fffffffI{2 * CHANNELS}f{2 * CHANNELS}f")
MODE_FIELDS = (
    "frequency_hz",
    "tau_s",
    "gain_re",
    "gain_im",
    "delay_s",
    "drive_limit",
    "amplitude_limit",
    "flags",
)
SHAPE = struct.Struct(f"<fffHH{PATTERNS * 8}s{2 * CHANNELS**2}f{2 * PATTERNS * CHANNELS}f")
SHAPE_FIELDS = ("frequency_hz", "tau_s", "drive_limit", "flags", "pattern_count", "names")
CRC = struct.Struct("<I")

SENSES_DISPLACEMENT = 1  # header flag: the sensors follow displacement, 90 degrees behind velocity
GAIN_IDENTIFIED = 1  # mode flags
TAU_IDENTIFIED = 2
FREQUENCY_IDENTIFIED = 4
MATRIX_IDENTIFIED = 1  # shape flag

MAX_BYTES = HEADER.size + MAX_MODES * MODE.size + MAX_SHAPES * SHAPE.size + CRC.size


def crc32(data: bytes) -> int:
    """CRC-32 as zlib, Ethernet and PNG compute it: crc32(b"123456789") = 0xCBF43926."""
    return zlib.crc32(data) & 0xFFFFFFFF


def seal(body: bytes) -> bytes:
    """The body with its CRC-32 behind it."""
    return body + CRC.pack(crc32(body))


def verify(data: bytes) -> None:
    """Raises ValueError unless the bytes are a whole, undamaged table of this version; values are not looked at."""
    if data[:4] != MAGIC:
        raise ValueError("not a mode table")
    if len(data) < HEADER.size + CRC.size or HEADER.unpack_from(data)[3] != len(data):
        raise ValueError("truncated or padded")
    if HEADER.unpack_from(data)[1] != VERSION:
        raise ValueError(f"version {HEADER.unpack_from(data)[1]} is refused, allowed {VERSION}")
    if seal(data[: -CRC.size]) != data:
        raise ValueError("damaged: the CRC-32 does not fit")


def with_drive_limit(data: bytes, limit: float) -> bytes:
    """The same table with another drive limit, 0.001 to 1 of full scale, in all modes and shapes. Raises ValueError."""
    verify(data)
    if not 1e-3 <= limit <= 1.0:
        raise ValueError(f"drive limit {limit:g}, allowed 0.001 to 1")
    header, body = dict(zip(HEADER_FIELDS, HEADER.unpack_from(data), strict=True)), bytearray(data[: -CRC.size])
    modes_end = HEADER.size + header["mode_count"] * MODE.size
    for at in range(HEADER.size, modes_end, MODE.size):
        struct.pack_into("<f", body, at + 4 * MODE_FIELDS.index("drive_limit"), limit)
    for at in range(modes_end, len(body), SHAPE.size):
        struct.pack_into("<f", body, at + 4 * SHAPE_FIELDS.index("drive_limit"), limit)
    return seal(bytes(body))


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
    if start < 0 or end < start:
        raise ValueError("no array of bytes between braces")
    return bytes(int(item, 16) for item in text[start + 1 : end].split(","))
