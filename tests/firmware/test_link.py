"""The protocol's end in the firmware, on this machine: any request in any order, and nothing but sound answers."""

from __future__ import annotations

import math
import struct

import numpy as np
import pytest

from firmware.mode_table import Mode, ModeTable, Pattern, Shape, to_bytes
from firmware.protocol import PAYLOAD_MAX, Fault, Health, Kind, Message, decode, encode, parse, parse_captured

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
        self.single, self.stores = name == "single", True
        getattr(self.lib, f"an_{name}_boot")(self.app, self.table, len(table), rate_hz, 0)
        self.app.base.confirmed = True
        self.capture = self.ffi.new("an_capture *")
        self.lib.an_capture_init(self.capture, 1 if self.single else 6)
        self.base, self.build = self.ffi.addressof(self.app, "base"), self.ffi.addressof(self.lib, f"an_{name}_build")
        self.lib.an_link_init(self.link, self.base, self.build, self.capture)

    def ask(self, data: bytes) -> list[Message]:
        answers = []
        for byte in data:
            self.lib.an_link_feed(self.link, byte)
            if self.link.store_target:
                self.lib.an_link_stored(self.link, self.stores)
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
            self.lib.an_capture_take(self.capture, self.samples, self.duties)
            if fast.tick == 0:
                break
        (self.lib.an_single_slow if self.single else self.lib.an_six_window_end)(self.app)
        self.lib.an_application_poll(self.base, self.build)


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


@pytest.mark.parametrize(("name", "table", "rate_hz", "row"), [("single", SINGLE, 250e3, 2), ("six", SIX, 40e3, 12)])
def test_a_capture_fills_its_room_and_stops(core, name, table, rate_hz, row: int) -> None:
    linked = Linked(core, name, table, rate_hz)
    assert answer(linked, Kind.CAPTURE, struct.pack("<I", 3)) == b"\0"
    linked.window()
    some = parse_captured(answer(linked, Kind.CAPTURED, struct.pack("<I", 0))[1:])
    assert (some.used, some.row) == (17 * row, row) and set(some.words[: row // 2]) == {2048}
    for _ in range(70):
        linked.window()
    full = parse_captured(answer(linked, Kind.CAPTURED, struct.pack("<I", 0))[1:])
    assert full.used == full.total == 2048 // row * row and linked.capture.every == 0


@pytest.mark.parametrize("chirp", [False, True])
@pytest.mark.parametrize(("word", "value"), [("used", 2047), ("used", 2**32 - 2), ("row", 4096), ("row", 2**31)])
def test_a_damaged_word_ends_the_capture_and_writes_nowhere(core, word: str, value: int, chirp: bool) -> None:
    capture, row = core.ffi.new("an_capture *"), core.ffi.new("uint16_t []", [7] * 3000)
    core.lib.an_capture_init(capture, 1)
    assert core.lib.an_capture_begin(capture, 1)
    if chirp:
        core.lib.an_capture_begin_chirp(capture, 1)
    setattr(capture, word, value)
    if chirp:
        core.lib.an_capture_take_response(capture, 3, row, row)
    else:
        core.lib.an_capture_take(capture, row, row)
    assert capture.every == capture.begun == 0 and not any(capture.words) and getattr(capture, word) == value


def test_a_capture_slower_than_a_second_is_refused(core) -> None:
    linked = Linked(core, "single", SINGLE, 250e3)
    for every, result in ((0, 2), (250001, 2), (250000, 0)):
        assert answer(linked, Kind.CAPTURE, struct.pack("<I", every)) == bytes([result])


def log(linked: Linked, windows: range) -> list[int]:
    """Log windows; the numbers of those in the frame that waits for the line."""
    for window in windows:
        linked.lib.an_link_log(linked.link, linked.ffi.new("an_record *", {"window": window}))
    frame = decode(bytes(linked.link.out)[: max(linked.link.out_length - 1, 0)])
    return (
        []
        if frame is None
        else [struct.unpack_from("<I", frame.payload, at)[0] for at in range(0, len(frame.payload), 24)]
    )


def test_a_log_that_meets_a_busy_line_keeps_its_oldest_records(core) -> None:
    """Five of them; no log was asked for before, and none is sent."""
    linked = Linked(core, "single", SINGLE, 250e3)
    assert log(linked, range(8)) == []
    linked.ask(encode(Message(Kind.LOG, 1, struct.pack("<I", 1))))
    assert log(linked, range(20)) == [0, 1, 2, 3] and linked.link.log.length == 5 * 24
    linked.link.out_length = 0
    assert log(linked, range(20, 21)) == [4, 5, 6, 7, 8] and linked.link.log.length == 0


def test_log_frames_hold_four_records_and_wait_for_the_line(core) -> None:
    linked = Linked(core, "single", SINGLE, 250e3)
    linked.ask(encode(Message(Kind.LOG, 1, struct.pack("<I", 2))))
    values = {"measured": {"re": 0.5, "im": -0.5}, "drive": {"re": 0.25, "im": 0.0}, "reference": 0.125}
    for window in range(16):
        core.lib.an_link_log(linked.link, core.ffi.new("an_record *", values | {"window": window}))
    frame = decode(bytes(linked.link.out)[: linked.link.out_length - 1])
    assert len(frame.payload) == 4 * 24
    assert [struct.unpack_from("<I", frame.payload, at)[0] for at in range(0, 96, 24)] == [1, 3, 5, 7]
    assert struct.unpack_from("<5f", frame.payload, 4) == (0.5, -0.5, 0.25, 0.0, 0.125)


def answer(linked: Linked, kind: int, payload: bytes = b"", sequence: list[int] = [0]) -> bytes:  # noqa: B006
    sequence[0] = (sequence[0] + 1) % 256
    (reply,) = linked.ask(encode(Message(kind, sequence[0], payload)))
    return reply.payload


def upload(linked: Linked, table: bytes) -> bytes:
    assert answer(linked, Kind.UPLOAD_BEGIN, struct.pack("<I", len(table))) == b"\0"
    for at in range(0, len(table), 100):
        assert answer(linked, Kind.UPLOAD_DATA, struct.pack("<I", at) + table[at : at + 100]) == b"\0"
    return answer(linked, Kind.UPLOAD_END)


BUILDS = [("single", SINGLE, 250e3, SIX), ("six", SIX, 40e3, SINGLE)]


@pytest.mark.parametrize(("name", "table", "rate_hz", "other"), BUILDS)
def test_each_build_stores_its_own_tables_alone(core, name, table, rate_hz, other) -> None:
    linked = Linked(core, name, table, rate_hz)
    assert upload(linked, table) == b"\0"
    assert upload(linked, other) == bytes([4, core.lib.AN_TABLE_OTHER_BUILD])
    assert upload(linked, table + bytes(8)) == bytes([4, core.lib.AN_TABLE_LENGTH])
    slow = to_bytes(ModeTable(250e3, bytes(16), (Mode(1999.0, 3e-3), Mode(31e3, 3e-3))))
    assert upload(linked, slow) == bytes(
        [4, core.lib.AN_TABLE_RANGE if name == "single" else core.lib.AN_TABLE_OTHER_BUILD]
    )
    low = to_bytes(ModeTable(40e3, bytes(16), (), shapes=(Shape(349.0, 5e-3, (Pattern("all", (1,) * 6),)),)))
    assert upload(linked, low) == bytes(
        [4, core.lib.AN_TABLE_RANGE if name == "six" else core.lib.AN_TABLE_OTHER_BUILD]
    )
    assert answer(linked, Kind.UPLOAD_DATA, bytes(3)) == b"\2"
    assert answer(linked, Kind.LOG, b"") == b"\2"


@pytest.mark.parametrize(("name", "table", "rate_hz", "other"), BUILDS)
def test_a_measurement_is_begun_stopped_and_silenced(core, name, table, rate_hz, other) -> None:
    linked = Linked(core, name, table, rate_hz)
    supervisor = linked.app.base.supervisor
    linked.window()
    assert answer(linked, Kind.IDENTIFY) == b"\0" and supervisor.state == 1 and supervisor.measure_only
    assert answer(linked, Kind.IDENTIFY) == b"\3"
    assert answer(linked, Kind.CLEAR) == b"\3"
    assert upload(linked, table) == b"\3"
    for _ in range(3):
        linked.window()
    assert answer(linked, Kind.STOP) == b"\0"
    for _ in range(3):
        linked.window()
    assert supervisor.state == 0
    start = struct.pack("<ff", 0.1, 0.0) if name == "single" else struct.pack("<If", 0, 0.1)
    assert answer(linked, Kind.START, start) == b"\0" and supervisor.state == 1 and not supervisor.measure_only
    linked.app.fast.window.count += 3 * 5000
    linked.app.fast.command.count += 3 * 5000
    for _ in range(4):
        linked.window()
    assert supervisor.state == 3 and supervisor.first == Fault.HOST_SILENT
    assert answer(linked, Kind.CLEAR) == b"\0"
    for _ in range(3):
        linked.window()
    assert supervisor.state == 0


@pytest.mark.parametrize(("name", "table", "rate_hz", "other"), BUILDS)
def test_health_is_told_in_its_order_and_a_repeated_request_is_answered_alike(
    core, name, table, rate_hz, other
) -> None:
    linked = Linked(core, name, table, rate_hz)
    linked.link.health = dict(
        zip((field for field, _ in core.ffi.typeof("an_health").fields), range(1, 12), strict=True)
    )
    health = parse(Health, answer(linked, Kind.HEALTH)[1:])
    assert (health.watchdog_resets, health.core_hz, health.stack_unused) == (1, 6, 10)
    linked.window()
    frame = encode(Message(Kind.IDENTIFY, 200, b""))
    assert [reply.payload for reply in linked.ask(frame + frame)] == [b"\0", b"\0"]
    (reply,) = linked.ask(encode(Message(Kind.IDENTIFY, 201, b"")))
    assert reply.payload == b"\3"


@pytest.mark.parametrize(("name", "table", "rate_hz", "other"), BUILDS)
def test_what_another_session_asks_is_no_repetition(core, name, table, rate_hz, other) -> None:
    """Each run of the client may begin with the numbers of the last one."""
    linked = Linked(core, name, table, rate_hz)
    supervisor = linked.app.base.supervisor
    stop, clear, status = (
        encode(Message(kind, 1 + (kind == Kind.STATUS))) for kind in (Kind.STOP, Kind.CLEAR, Kind.STATUS)
    )
    for _ in range(2):
        linked.window()
        assert core.lib.an_application_identify(linked.base, linked.build)
        linked.window()
        assert [reply.payload for reply in linked.ask(stop)] == [b"\0"]
        linked.window()
        assert supervisor.state == 0
    for result in (b"\3", b"\0", b"\0"):
        assert [reply.payload for reply in linked.ask(clear)] == [result]
        linked.ask(status)
        linked.window()
        linked.app.fast.faults = Fault.BREAK
        linked.window()
        linked.window()
        assert supervisor.state == 3


def test_a_request_is_repeated_in_kind_number_and_content(core) -> None:
    """Whatever else carries the last one's number is another request; an echo of the board's own replies is none."""
    linked = Linked(core, "single", SINGLE, 250e3)
    linked.window()
    sine = [encode(Message(Kind.SINE, 9, struct.pack("<ff", 20.0, depth))) for depth in (0.5, 2.0, 0.25)]
    for frame, result, depth in ((sine[0], 0, 0.5), (sine[1], 2, 0.5), (sine[1], 2, 0.5), (sine[2], 0, 0.25)):
        assert [reply.payload[0] for reply in linked.ask(frame)] == [result]
        assert linked.app.base.texture.depth == depth
    assert [reply.payload for reply in linked.ask(encode(Message(Kind.CLEAR, 9)))] == [b"\3"]
    assert linked.ask(encode(Message(Kind.SINE | 0x80, 10, struct.pack("<ff", 20.0, 0.75)))) == []
    assert linked.app.base.texture.depth == 0.25


def test_pieces_of_a_table_fit_into_what_was_announced(core) -> None:
    linked = Linked(core, "single", SINGLE, 250e3)
    assert answer(linked, Kind.UPLOAD_END) == b"\2"
    for announced, result in ((0, 2), (3681, 2), (60, 0)):
        assert answer(linked, Kind.UPLOAD_BEGIN, struct.pack("<I", announced)) == bytes([result])
    for at, count, result in ((0, 61, 2), (1, 10, 2), (0, 40, 0), (0, 40, 0), (30, 31, 2), (40, 21, 2), (10, 20, 0)):
        assert answer(linked, Kind.UPLOAD_DATA, struct.pack("<I", at) + bytes(count)) == bytes([result]), (at, count)
        assert linked.link.staged_length == (0 if result and at < 2 else 40)
    assert answer(linked, Kind.UPLOAD_END) == b"\2"
    assert answer(linked, Kind.UPLOAD_DATA, struct.pack("<I", 40) + bytes(20)) == b"\0"
    assert answer(linked, Kind.UPLOAD_END) == bytes([4, core.lib.AN_TABLE_MAGIC])


def test_a_table_that_the_flash_memory_did_not_take_is_told(core) -> None:
    linked = Linked(core, "single", SINGLE, 250e3)
    linked.stores = False
    assert upload(linked, SINGLE) == b"\5"
    assert answer(linked, Kind.UPLOAD_END) == b"\2"  # nothing is staged any more
    linked.stores = True
    assert upload(linked, SINGLE) == b"\0"


@pytest.mark.parametrize(("name", "table", "rate_hz", "other"), BUILDS)
@pytest.mark.parametrize("kind", [Kind.HEALTH, Kind.CAPTURED, Kind.UPLOAD_BEGIN])
def test_a_host_that_asks_anything_is_not_silent(core, name, table, rate_hz, other, kind: Kind) -> None:
    linked = Linked(core, name, table, rate_hz)
    linked.window()
    assert answer(linked, Kind.IDENTIFY) == b"\0"
    for _ in range(3):
        elapsed = round(0.4 * linked.build.moment(linked.base).window_hz)
        linked.app.fast.window.count += elapsed
        linked.app.fast.command.count += elapsed
        answer(linked, kind)
        linked.window()
    assert linked.app.base.supervisor.state == 1


@pytest.mark.parametrize(("name", "table", "rate_hz", "other"), BUILDS)
@pytest.mark.parametrize("bit", [7, 12, 20, 31])
def test_a_tick_that_can_never_come_is_found_and_mended(core, name, table, rate_hz, other, bit: int) -> None:
    linked = Linked(core, name, table, rate_hz)
    linked.window()
    check = getattr(core.lib, f"an_{name}_check")
    assert check(linked.app) == 0
    linked.app.fast.tick ^= 1 << bit
    assert check(linked.app) == core.lib.AN_FAULT_MEMORY
    assert check(linked.app) == 0
    if name == "six" and bit > 7:
        linked.app.fast.end ^= 1 << bit
        assert check(linked.app) == core.lib.AN_FAULT_MEMORY and check(linked.app) == 0
    linked.window()


def test_shapes_and_patterns_are_chosen_where_they_may_be(core) -> None:
    patterns = (Pattern("all", (1,) * 6), Pattern("one", (1, 0, 0, 0, 0, 0)))
    rows = tuple(tuple(0.5 * (i == j) for j in range(6)) for i in range(6))
    shapes = (Shape(2400.0, 5e-3, patterns, rows), Shape(500.0, 5e-3, patterns[:1]))
    linked = Linked(core, "six", to_bytes(ModeTable(40e3, bytes(16), (), shapes=shapes)), 40e3)
    linked.window()
    for target, result in ((2, 0), (2, 2)), ((0, 2), (2, 2)), ((0, 1), (0, 3)), ((1, 0), (1, 0)), ((0, 0), (0, 0)):
        assert answer(linked, Kind.PATTERN, struct.pack("<II", *target)) == bytes([result[1]]), target
        linked.window()
        linked.window()
    assert answer(linked, Kind.REFERENCE, struct.pack("<f", 0.1)) == b"\3"
    linked.app.base.confirmed = True
    assert answer(linked, Kind.START, struct.pack("<If", 0, 0.0)) == b"\0"
    linked.window()
    assert linked.app.base.supervisor.state == 2 and linked.app.slow.reference == pytest.approx(
        0.5 * linked.app.reachable
    )
    for level, result in ((0.1, 0), (-0.1, 2), (math.nan, 2)):
        assert answer(linked, Kind.REFERENCE, struct.pack("<f", level)) == bytes([result])
    assert answer(linked, Kind.SINE, struct.pack("<ff", 20.0, 0.5)) == b"\0"
    assert answer(linked, Kind.SINE, struct.pack("<ff", 20.0, 2.0)) == b"\2"
    assert answer(linked, Kind.PATTERN, struct.pack("<II", 0, 1)) == b"\0"
    assert answer(linked, Kind.PATTERN, struct.pack("<II", 1, 0)) == b"\3"
    assert answer(linked, Kind.STATUS)[0] == 0
