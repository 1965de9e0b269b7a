"""Frames: both ends agree, and nothing damaged gets through."""

from __future__ import annotations

import struct

import numpy as np
import pytest
from cobs import cobs
from hypothesis import given
from hypothesis import strategies as st

from firmware import protocol, wire
from firmware.mode_table import crc32
from firmware.protocol import Fault, Kind, Message, decode, encode

payloads = st.binary(max_size=protocol.PAYLOAD_MAX)


class Reader:
    def __init__(self, core) -> None:
        self.core = core
        self.reader, self.message = core.ffi.new("an_frame_reader *"), core.ffi.new("an_message *")
        core.lib.an_frame_reader_init(self.reader)

    def feed(self, data: bytes) -> list[Message]:
        result = []
        for byte in data:
            if self.core.lib.an_frame_feed(self.reader, byte, self.message):
                content = bytes(self.message.payload)[: self.message.length]
                result.append(Message(self.message.kind, self.message.sequence, content))
        return result


def written(core, message: Message) -> bytes:
    out = core.ffi.new("uint8_t []", core.lib.AN_FRAME_BYTES)
    body = {
        "kind": message.kind,
        "sequence": message.sequence,
        "payload": message.payload,
        "length": len(message.payload),
    }
    length = core.lib.an_frame_write(out, core.ffi.new("an_message *", body))
    return bytes(out)[:length]


def test_header_and_page_are_written_from_the_definitions() -> None:
    """`python -m firmware.wire` writes both."""
    assert wire.HEADER.read_text() == wire.header()
    page = wire.PAGE.read_text()
    assert page == wire.with_tables(page)


@pytest.mark.parametrize("kind", wire.REPLIES, ids=lambda kind: kind.__name__)
def test_replies_have_the_structure_of_the_firmware(core, kind: type) -> None:
    """Each member at the same offset, in Python and in C."""

    def offsets(given, start: int = 0) -> dict[str, int]:
        found: dict[str, int] = {}
        for name, member in given.fields:
            found |= offsets(member.type, member.offset) if name == "head" else {name: start + member.offset}
        return found

    row = protocol.layout(kind)
    structure = core.ffi.typeof(f"an_{wire.snake(kind.__name__)}")
    assert core.ffi.sizeof(structure) == row.itemsize
    assert offsets(structure) == {name: offset for name, (_, offset) in row.fields.items()}


def test_every_fault_and_request_is_explained(core) -> None:
    assert list(protocol.FAULTS) == list(Fault) and len(Fault) == core.lib.AN_FAULT_COUNT
    for ones in protocol.REQUESTS.values():
        assert len({protocol.layout(one).itemsize for one in ones}) == 1  # the firmware checks one length
        for one in ones:
            assert set(protocol.layout(one).names) == {name for name, _ in wire._ranges(one)}


@given(kind=st.integers(0, 255), sequence=st.integers(0, 255), payload=payloads)
def test_both_ends_write_and_read_the_same(core, kind: int, sequence: int, payload: bytes) -> None:
    message = Message(kind, sequence, payload)
    frame = encode(message)
    assert frame == written(core, message)
    assert frame.count(0) == 1 and frame[-1] == 0
    assert Reader(core).feed(frame) == [message]
    assert decode(frame[:-1]) == message


def test_a_message_too_long_is_not_written(core) -> None:
    out = core.ffi.new("uint8_t []", core.lib.AN_FRAME_BYTES)
    assert core.lib.an_frame_write(out, core.ffi.new("an_message *", {"length": protocol.PAYLOAD_MAX + 1})) == 0


@pytest.mark.parametrize("length", [0, 1, protocol.PAYLOAD_MAX + 3])
def test_what_is_shorter_or_longer_than_a_message_is_refused(core, length: int) -> None:
    """Though its check sum fits: at most 120 bytes of payload, at least a kind and a number."""
    body = bytes([7] * length)
    frame = cobs.encode(body + struct.pack("<I", crc32(body))) + b"\0"
    reader = Reader(core)
    assert reader.feed(frame) == [] and reader.reader.refused == 1


def test_a_zero_that_damage_left_in_the_buffer_does_not_stop_the_reader(core) -> None:
    """No byte of the line is stored as zero, and a distance of zero would lead nowhere."""
    reader = Reader(core)
    frame = encode(MESSAGES[0])
    assert reader.feed(frame[:-1]) == []
    reader.reader.bytes[0] = 0
    assert reader.feed(b"\0") == [] and reader.reader.refused == 1


MESSAGES = [
    Message(Kind.START, 7, b"\x00\x00\x00\x3e\x00\x00\x96\x43"),
    Message(Kind.STOP, 0),
    Message(Kind.UPLOAD_DATA, 255, bytes(range(120))),
    Message(Kind.SAMPLES, 1, bytes(120)),
]


@pytest.mark.parametrize("message", MESSAGES)
def test_every_flipped_bit_is_refused(core, message: Message) -> None:
    """And costs at most the frame behind it, whose beginning it may have joined."""
    frame, follower = encode(message), encode(Message(Kind.STATUS, 9))
    for bit in range(8 * len(frame)):
        damaged = bytearray(frame)
        damaged[bit // 8] ^= 1 << bit % 8
        result = Reader(core).feed(bytes(damaged) + follower + follower)
        assert message not in result
        assert set(result) <= {Message(Kind.STATUS, 9)} and result


@pytest.mark.parametrize("message", MESSAGES)
def test_every_truncation_is_refused(core, message: Message) -> None:
    frame = encode(message)
    for length in range(len(frame) - 1):
        reader = Reader(core)
        assert reader.feed(frame[:length] + b"\0") == []
        assert reader.feed(frame) == [message]


def test_noise_is_survived(core) -> None:
    random = np.random.default_rng(5)
    reader = Reader(core)
    for _ in range(200):
        assert reader.feed(random.integers(0, 256, 500, dtype=np.uint8).tobytes()) == []
    assert reader.reader.refused > 100
    assert reader.feed(b"\0" + encode(MESSAGES[0])) == [MESSAGES[0]]
