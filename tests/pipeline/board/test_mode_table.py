"""The mode table: what goes in comes out, and nothing damaged or out of range comes in."""

from __future__ import annotations

import dataclasses
import math
import re
import struct

import pytest

from firmware import mode_table as layout
from firmware.mode_table import (
    Mode,
    ModeTable,
    Pattern,
    Shape,
    TableError,
    describe,
    from_bytes,
    to_bytes,
)

SIX = tuple(complex(0.5, -0.25 * (i % 3)) for i in range(6))
SHAPE = Shape(
    2400.0,
    0.03125,
    (Pattern("left", SIX), Pattern("wave", SIX[::-1])),
    matrix=tuple(tuple(complex(i == j, 0.125 * i) for j in range(6)) for i in range(6)),
)
TABLE = ModeTable(
    250e3,
    bytes(range(16)),
    (
        Mode(31404.5, 0.003, None, 2.0**-18, 0.75, 0.5, SIX, SIX),
        Mode(31000.25, 0.0029296875, 0.5 - 0.75j, 2.0**-19, 1.0, 0.5, SIX, SIX, True, True),
    ),
    target=1,
    shapes=(SHAPE, dataclasses.replace(SHAPE, matrix=None)),
    senses_displacement=False,
    sensor_volts=0.5,
)


def in_single_precision(value: float) -> float:
    return struct.unpack("<f", struct.pack("<f", value))[0]


def test_a_table_comes_back_in_single_precision() -> None:
    expected = dataclasses.replace(
        TABLE, modes=(dataclasses.replace(TABLE.modes[0], tau_s=in_single_precision(0.003)), TABLE.modes[1])
    )
    assert from_bytes(to_bytes(TABLE)) == expected


def test_the_bytes_are_little_endian_and_where_the_layout_says() -> None:
    data = to_bytes(TABLE)
    assert data[:8] == b"ANTM" + bytes([2, 0, 52, 0])
    assert int.from_bytes(data[8:12], "little") == len(data) == 52 + 2 * 132 + 2 * 756 + 4
    assert struct.unpack_from("<f", data, 52)[0] == 31404.5
    assert data[-4:] == struct.pack("<I", layout.crc32(data[:-4]))


def test_crc_is_the_one_of_zlib_and_ethernet() -> None:
    assert layout.crc32(b"123456789") == 0xCBF43926


def test_header_holds_the_same_bytes() -> None:
    text = layout.header_text(to_bytes(TABLE))
    body = re.search(r"\{(.*?)\}", text, re.S)
    assert body is not None
    assert bytes(int(item, 16) for item in body[1].split(",")) == to_bytes(TABLE)
    assert layout.header_bytes(text) == to_bytes(TABLE)


def test_every_flipped_bit_is_refused() -> None:
    data = bytearray(to_bytes(TABLE))
    for bit in range(8 * len(data)):
        data[bit // 8] ^= 1 << bit % 8
        with pytest.raises(TableError):
            from_bytes(bytes(data))
        data[bit // 8] ^= 1 << bit % 8


def test_every_truncation_and_extension_is_refused() -> None:
    data = to_bytes(TABLE)
    for length in range(len(data)):
        with pytest.raises(TableError):
            from_bytes(data[:length])
    with pytest.raises(TableError, match="truncated or padded"):
        from_bytes(data + b"\0")


def resealed(at: int, value: bytes) -> bytes:
    body = bytearray(to_bytes(TABLE)[:-4])
    body[at : at + len(value)] = value
    return layout.seal(bytes(body))


@pytest.mark.parametrize(
    ("at", "value", "words"),
    [
        (0, b"ELF!", "another kind of file"),
        (4, struct.pack("<H", 1), "version 1 is not supported, this program reads 2: export it again"),
        (4, struct.pack("<H", 0), "version 0 is not supported"),
        (6, struct.pack("<H", 48), "record lengths"),
        (12, struct.pack("<H", 3), "do not hold 3 modes"),
        (20, b"\x07", "actuator_count is 7"),
        (22, struct.pack("<H", 2), "target is 2, allowed 0 to 1"),
        (24, struct.pack("<f", math.nan), "sample_rate_hz is nan"),
        (28, struct.pack("<I", 2), "flags are 0x2"),
        (52, struct.pack("<f", -1.0), "mode 0: frequency_hz is -1"),
        (52, struct.pack("<f", 100001.0), "mode 0: frequency_hz is 100001"),
        (56, struct.pack("<f", math.inf), "mode 0: tau_s is inf"),
        (60, struct.pack("<f", 1.0), "mode 0: a gain is given but marked unidentified"),
        (68, struct.pack("<f", -1e-6), "mode 0: delay_s is -1e-06"),
        (72, struct.pack("<f", 1.5), "mode 0: drive_limit is 1.5"),
        (80, struct.pack("<f", -1e-9), "mode 0: metres_per_volt is -1e-09"),
        (32, struct.pack("<f", 0.0), "sensor_volts is 0"),
        (84, struct.pack("<I", 9), "mode 0: flags are 0x9"),
        (88, struct.pack("<f", math.nan), "mode 0: actuator_weights"),
        (132 + 56, struct.pack("<f", 0.0), "mode 1: tau_s is 0"),
        (316 + 18, struct.pack("<H", 9), "shape 0: 9 patterns"),
        (316 + 20, b"\xe9", "pattern name"),
        (316 + 84, struct.pack("<f", 2e3), "shape 0: matrix"),
    ],
)
def test_a_value_out_of_range_is_refused_in_one_line_though_the_crc_fits(at: int, value: bytes, words: str) -> None:
    with pytest.raises(TableError, match=re.escape(words)) as raised:
        from_bytes(resealed(at, value))
    assert "\n" not in str(raised.value)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"target": 2}, "target is 2"),
        ({"design_hash": b"short"}, "5 bytes, allowed 16"),
        ({"modes": (), "shapes": ()}, "neither a mode nor a shape"),
        ({"modes": TABLE.modes * 9}, "18 modes"),
        ({"modes": (Mode(31e3, 1e40),), "target": 0, "shapes": ()}, "tau_s is inf"),
        ({"modes": (Mode(31e3, 3e-3, gain=0j),), "target": 0, "shapes": ()}, "gain (larger of its parts) is 0"),
        ({"modes": (Mode(31e3, 3e-3), Mode(31e3, 3e-3, actuator_weights=(1, 1)))}, "differ from entry to entry"),
    ],
)
def test_a_table_out_of_range_is_not_written(change: dict, words: str) -> None:
    with pytest.raises(TableError, match=re.escape(words)):
        to_bytes(dataclasses.replace(TABLE, **change))


def test_quality_and_time_constant_are_one_number() -> None:
    mode = Mode.from_quality_factor(31400.0, 300.0, delay_s=2e-6)
    assert mode.tau_s == pytest.approx(2.0 * 300.0 / (2.0 * math.pi * 31400.0), rel=1e-15)
    assert mode.quality_factor == pytest.approx(300.0, rel=1e-15)
    assert mode.gain is None and not mode.tau_identified


def test_description_tells_assumed_from_identified() -> None:
    lines = describe(TABLE).splitlines()
    unknown, known = (next(line for line in lines if line.startswith(f"mode {i}")) for i in (0, 1))
    assert "gain unidentified" in unknown and "(assumed)" in unknown and "(computed)" in unknown
    assert "gain 0.901388 at -56.31 deg" in known and "(identified)" in known and "(measured)" in known
    assert "(target)" in known and "(target)" not in unknown
    assert "velocity" in lines[1]
