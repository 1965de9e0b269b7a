"""The reader in the firmware accepts and refuses exactly what the exporter's does."""

from __future__ import annotations

import dataclasses
import struct

import numpy as np
import pytest

from firmware import mode_table as layout
from firmware import wire
from firmware.mode_table import Mode, ModeTable, Pattern, Shape, TableError, from_bytes, to_bytes

SIX = (0.5 + 0j, 0.5 - 0.25j, 0.5 - 0.5j, 0.5 - 0.75j, 0.125j, -1.0 + 0j)
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
        Mode(31404.5, 0.0029296875, None, 2.0**-18, 0.75, 0.5, SIX, SIX, metres_per_volt=2.0**-20),
        Mode(31e3, 0.0039, 0.5 - 0.75j, 0.0, 1, 1, SIX, SIX),
    ),
    target=1,
    shapes=(SHAPE, dataclasses.replace(SHAPE, matrix=None, metres_per_volt=2.0**-19)),
    sensor_volts=0.5,
)
SMALL = ModeTable(250e3, bytes(16), (Mode(31404.5, 0.003),))


def opened(core, data: bytes) -> int:
    table = core.ffi.new("an_table *")
    return core.lib.an_table_open(table, core.ffi.from_buffer("uint8_t[]", data) if data else core.ffi.NULL, len(data))


def test_sizes_and_versions_are_those_of_the_exporter(core) -> None:
    lib = core.lib
    for name, row in wire.ROWS.items():
        kind = core.ffi.typeof(f"an_{name}_row")
        assert core.ffi.sizeof(kind) == row.itemsize
        assert {field: member.offset for field, member in kind.fields} == {
            field: offset for field, (_, offset) in row.fields.items()
        }
    assert lib.AN_TABLE_MAX_BYTES == layout.MAX_BYTES
    assert lib.AN_TABLE_VERSION == layout.VERSION
    assert lib.AN_CHANNELS == layout.CHANNELS
    assert lib.AN_PATTERNS == layout.PATTERNS


def test_every_value_is_read_where_it_was_written(core) -> None:
    data = to_bytes(TABLE)
    table, mode, head = core.ffi.new("an_table *"), core.ffi.new("an_mode *"), core.ffi.new("an_shape_head *")
    buffer = core.ffi.from_buffer("uint8_t[]", data)
    assert core.lib.an_table_open(table, buffer, len(data)) == core.lib.AN_TABLE_OK
    assert (table.mode_count, table.shape_count, table.target, table.sample_rate_hz) == (2, 2, 1, 250e3)
    assert core.lib.an_table_mode(table, 0, mode) == 0
    assert (mode.frequency_hz, mode.tau_s, mode.delay_s) == (31404.5, 0.0029296875, 2.0**-18)
    assert (mode.drive_limit, mode.amplitude_limit, mode.metres) == (0.75, 0.5, 2.0**-21)
    core.lib.an_table_shape(table, 1, head)
    assert head.metres == 2.0**-20
    assert core.lib.an_table_mode(table, 1, mode) == core.lib.AN_GAIN_IDENTIFIED
    assert complex(mode.gain.re, mode.gain.im) == 0.5 - 0.75j
    core.lib.an_table_shape(table, 0, head)
    assert (head.frequency_hz, head.tau_s, head.flags, head.pattern_count) == (2400.0, 0.03125, 1, 2)
    for i in range(6):
        for j in range(6):
            z = core.lib.an_table_matrix(table, 0, i, j)
            assert complex(z.re, z.im) == SHAPE.matrix[i][j]
        z = core.lib.an_table_target(table, 0, 1, i)
        assert complex(z.re, z.im) == SIX[::-1][i]


def test_crc_is_the_one_of_zlib(core) -> None:
    assert core.lib.an_crc32(b"123456789", 9) == 0xCBF43926
    data = bytes(range(256)) * 3
    assert core.lib.an_crc32(data, len(data)) == layout.crc32(data)


def test_every_flipped_bit_is_refused(core) -> None:
    data = bytearray(to_bytes(TABLE))
    table, buffer = core.ffi.new("an_table *"), core.ffi.from_buffer("uint8_t[]", data)
    for bit in range(8 * len(data)):
        data[bit // 8] ^= 1 << bit % 8
        assert core.lib.an_table_open(table, buffer, len(data)) != core.lib.AN_TABLE_OK, bit
        data[bit // 8] ^= 1 << bit % 8
    assert core.lib.an_table_open(table, buffer, len(data)) == core.lib.AN_TABLE_OK


def test_every_truncation_is_refused_and_the_rest_of_a_sector_is_not_looked_at(core) -> None:
    data = to_bytes(TABLE)
    for length in range(len(data)):
        assert opened(core, bytes(data[:length])) != core.lib.AN_TABLE_OK
    assert opened(core, data + b"\xff" * 100) == core.lib.AN_TABLE_OK


def test_refusals_are_told_apart(core) -> None:
    data, lib = to_bytes(SMALL), core.lib
    assert opened(core, b"") == lib.AN_TABLE_TRUNCATED
    assert opened(core, b"\xff" * 500) == lib.AN_TABLE_MAGIC
    assert opened(core, data[:4] + b"\x01\x00" + data[6:]) == lib.AN_TABLE_WRONG_VERSION
    assert opened(core, data[:-1]) == lib.AN_TABLE_TRUNCATED
    assert opened(core, data[:12] + b"\x02" + data[13:]) == lib.AN_TABLE_LENGTH
    assert opened(core, data[:60] + bytes([data[60] ^ 1]) + data[61:]) == lib.AN_TABLE_DAMAGED
    assert opened(core, layout.seal(data[:52] + struct.pack("<f", -1.0) + data[56:-4])) == lib.AN_TABLE_RANGE


def header(**changes: int) -> bytes:
    """A small table whose header says otherwise, sealed."""
    body = bytearray(to_bytes(SMALL)[:-4])
    for name, value in changes.items():
        kind, at = wire.ROWS["header"].fields[name]
        body[at : at + kind.itemsize] = value.to_bytes(kind.itemsize, "little")
    return layout.seal(bytes(body))


@pytest.mark.parametrize(
    "change",
    [
        {"actuator_count": 0},
        {"actuator_count": 7},
        {"sensor_count": 0},
        {"sensor_count": 7},
        {"target": 1},
        {"flags": 2},
    ],
)
def test_a_header_out_of_range_is_refused(core, change: dict[str, int]) -> None:
    assert opened(core, header()) == core.lib.AN_TABLE_OK
    assert opened(core, header(**change)) == core.lib.AN_TABLE_RANGE


def test_a_table_of_nothing_is_refused(core) -> None:
    row = wire.ROWS["mode"].itemsize
    body = bytearray(header(mode_count=0, total_bytes=len(to_bytes(SMALL)) - row)[:-4])
    assert opened(core, layout.seal(bytes(body[:-row]))) == core.lib.AN_TABLE_RANGE


def with_channels(actuators: int, sensors: int, row: int = 0) -> bytes:
    """A shape's table of fewer channels, all of its numbers zero but for one of the matrix's rows."""
    shape = Shape(2400.0, 0.03125, (Pattern("left", (0.0,) * 6),), matrix=((0.0,) * 6,) * 6)
    body = bytearray(to_bytes(ModeTable(40e3, bytes(16), (), shapes=(shape,)))[:-4])
    fields = wire.ROWS["header"].fields
    body[fields["actuator_count"][1]], body[fields["sensor_count"][1]] = actuators, sensors
    at = wire.ROWS["header"].itemsize + wire.ROWS["shape"].fields["matrix"][1] + 48 * row
    body[at : at + 4] = struct.pack("<f", 0.5)
    return layout.seal(bytes(body))


def test_a_shape_has_as_many_actuators_as_sensors_and_zeros_beyond(core) -> None:
    lib = core.lib
    assert [opened(core, with_channels(*case)) for case in ((6, 6), (4, 4), (4, 4, 3), (4, 6), (6, 4), (4, 4, 4))] == [
        lib.AN_TABLE_OK, lib.AN_TABLE_OK, lib.AN_TABLE_OK, lib.AN_TABLE_RANGE, lib.AN_TABLE_RANGE, lib.AN_TABLE_RANGE
    ]  # fmt: skip


SPECIAL = [struct.pack("<f", x) for x in (0.0, -1.0, 1.0, 1e-30, 1e30, float("nan"), float("inf"), -float("inf"))]


@pytest.mark.parametrize("seed", range(4))
def test_both_readers_agree_on_tables_whose_crc_fits(core, seed: int) -> None:
    """Damage that a CRC cannot see: one to three words overwritten before the CRC is made."""
    random = np.random.default_rng(seed)
    clean = to_bytes(TABLE)[:-4]
    accepted = 0
    for _ in range(1500):
        body = bytearray(clean)
        for _ in range(random.integers(1, 4)):
            at = int(random.integers(0, len(body) // 4)) * 4
            word = random.bytes(4) if random.random() < 0.5 else SPECIAL[random.integers(len(SPECIAL))]
            body[at : at + 4] = word
        data = layout.seal(bytes(body))
        try:
            from_bytes(data)
            expected = True
        except TableError:
            expected = False
        accepted += expected
        assert (opened(core, data) == core.lib.AN_TABLE_OK) == expected, bytes(body).hex()
    assert 0 < accepted < 1500
