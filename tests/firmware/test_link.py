"""The protocol's end in the firmware, on this machine: any request in any order, and nothing but sound answers."""

from __future__ import annotations

import math
import struct

import numpy as np
import pytest

from firmware.protocol import PAYLOAD_MAX, Kind, Message, decode, encode
from pipeline.mode_table import Mode, ModeTable, Pattern, Shape, to_bytes

SINGLE = to_bytes(ModeTable(250e3, bytes(range(16)), (Mode(31e3, 3e-3, 0.5 - 0.5j),)))
SIX = to_bytes(ModeTable(40e3, bytes(16), (), shapes=(Shape(2400.0, 5e-3, (Pattern("all", (1,) * 6),)),)))
SPECIAL = [0.0, -0.0, 1.0, -1.0, 1e-30, 1e30, math.inf, -math.inf, math.nan, 0.1, 100.0]


class Linked:
    """An application of either build behind its link, stepped by hand."""

    def __init__(self, core, name: str, table: bytes, rate_hz: float) -> None:
        self.ffi, self.lib = core
        self.table = self.ffi.from_buffer("uint8_t[]", table)
        self.app = self.ffi.new(f"an_{name} *")
        self.link = self.ffi.new("an_link *")
        self.samples = self.ffi.new("uint16_t []", [2048] * 6)
        self.duties = self.ffi.new("uint16_t []", 6)
        self.single = name == "single"
        getattr(self.lib, f"an_{name}_boot")(self.app, self.table, len(table), rate_hz, 0)
        obey = self.ffi.addressof(self.lib, f"an_{name}_obey")
        self.lib.an_link_init(self.link, obey, self.ffi.cast("void *", self.app))

    def ask(self, data: bytes) -> list[Message]:
        answers = []
        for byte in data:
            self.lib.an_link_feed(self.link, byte)
            if self.link.store_wanted:
                self.lib.an_link_stored(self.link, True)
            if self.link.out_length:
                frame = bytes(self.link.out)[: self.link.out_length]
                assert frame[-1] == 0 and frame.count(0) == 1
                answers.append(decode(frame[:-1]))
                self.link.out_length = 0
        assert None not in answers
        return answers

    def window(self) -> None:
        fast = self.ffi.addressof(self.app, "fast")
        while True:
            if self.single:
                assert 1 <= self.lib.an_fast_tick(fast, 2048) <= 4095
            else:
                self.lib.an_six_tick(fast, self.samples, self.duties)
                assert all(45 <= duty <= 2205 for duty in self.duties)
            if fast.tick == 0:
                break
        (self.lib.an_single_slow if self.single else self.lib.an_six_window_end)(self.app)
        (self.lib.an_single_poll if self.single else self.lib.an_six_poll)(self.app)


def random_payload(random: np.random.Generator) -> bytes:
    words = [
        struct.pack("<f", SPECIAL[random.integers(len(SPECIAL))])
        if random.random() < 0.5
        else struct.pack("<I", int(random.choice([0, 1, 2, 5, 8, 120, 3604, 3605, 2**31, 2**32 - 1])))
        for _ in range(random.integers(0, 4))
    ]
    tail = random.bytes(int(random.integers(0, PAYLOAD_MAX))) if random.random() < 0.3 else b""
    return (b"".join(words) + tail)[:PAYLOAD_MAX]


@pytest.mark.parametrize(("name", "table", "rate_hz"), [("single", SINGLE, 250e3), ("six", SIX, 40e3)])
def test_any_request_in_any_order_is_answered_and_leaves_the_outputs_in_range(core, name, table, rate_hz) -> None:
    random = np.random.default_rng(11)
    linked = Linked(core, name, table, rate_hz)
    for sequence in range(3000):
        kind = int(random.integers(0, 128)) if random.random() < 0.2 else int(random.choice(list(Kind)))
        (answer,) = linked.ask(encode(Message(kind, sequence % 256, random_payload(random))))
        assert answer.kind == kind | 0x80 and answer.sequence == sequence % 256
        assert answer.payload[0] <= 5
        if sequence % 3 == 0:
            linked.window()


def test_log_frames_hold_four_records_and_wait_for_the_line(core) -> None:
    linked = Linked(core, "single", SINGLE, 250e3)
    linked.ask(encode(Message(Kind.LOG, 1, struct.pack("<I", 2))))
    record = core.ffi.new("float []", [0.5, -0.5, 0.25, 0.0, 0.125])
    for window in range(16):
        core.lib.an_link_log(linked.link, window, record)
    frame = decode(bytes(linked.link.out)[: linked.link.out_length - 1])
    assert len(frame.payload) == 4 * 24
    assert [struct.unpack_from("<I", frame.payload, at)[0] for at in range(0, 96, 24)] == [1, 3, 5, 7]
    assert struct.unpack_from("<5f", frame.payload, 4) == (0.5, -0.5, 0.25, 0.0, 0.125)
