"""The host and the board over the serial line, the board emulated."""

from __future__ import annotations

import math
import struct
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from firmware.client.client import BoardError, Client
from firmware.emulate.plant import Plate, Resonance
from firmware.mode_table import MAX_BYTES, VERSION, Mode, ModeTable, Pattern, Shape, hold, seal, to_bytes
from firmware.protocol import PROTOCOL, Kind, Message, decode, encode

TRUE, GAIN = 31437.3, 0.8
TAU = 300.0 / math.pi / TRUE
DROOP = abs(hold(TRUE, 250e3))
PLATE = Plate((Resonance(TRUE, TAU, GAIN),), delay_s=7.3e-6, noise=1e-3)
MEASURED = Mode(TRUE, TAU, -1j * GAIN * DROOP, 9.3e-6, frequency_identified=True)
KNOWN = to_bytes(ModeTable(250e3, bytes(range(16)), (MEASURED,)))
OTHER = to_bytes(ModeTable(250e3, bytes(16), (Mode.from_quality_factor(29000.0, 250.0), Mode(30500.0, 3e-3)), target=1))


@pytest.fixture
def talk(make_image, core):
    pytest.importorskip("unicorn", reason="unicorn is not installed: pip install unicorn")
    from firmware.emulate.images import EmulatedPort, EmulatedSingle

    def make(table: bytes = KNOWN, plate: Plate = PLATE, **options):
        board = EmulatedSingle(make_image(table).elf, plate, **options)
        board.run(1e-3)
        board.app.base.confirmed = True
        return board, Client(EmulatedPort(board))

    return make


def test_identity_and_status(talk) -> None:
    _, client = talk()
    assert client.request(Kind.IDENTITY, parsed=bytes) == bytes([PROTOCOL, 1, VERSION, 1, *range(16)]) + struct.pack(
        "<2f", 1.0, 0.8
    )
    status = client.status()
    assert status.state == "idle" and status.faults == ()
    assert status.frequency_hz == pytest.approx(TRUE, abs=4e-3)
    assert status.gain == pytest.approx(-1j * GAIN * DROOP, abs=1e-6)
    assert status.tau_s == pytest.approx(TAU, rel=1e-6) and status.delay_s == pytest.approx(9.3e-6, rel=1e-6)


def test_start_reference_and_stop(talk) -> None:
    board, client = talk()
    client.start(0.1, 50.0)
    board.run(20e-3)
    status = client.status()
    assert status.state == "run" and status.reference == pytest.approx(0.1)
    assert status.detuning_hz == 50.0
    assert abs(status.measured) == pytest.approx(0.1, rel=0.02)
    client.reference(0.05)
    board.run(20e-3)
    assert abs(client.status().measured) == pytest.approx(0.05, rel=0.03)
    client.stop()
    board.run(1e-3)
    assert client.status().state == "idle" and board.dac.value & 0xFFF == 2048


def test_refusals_say_why(talk) -> None:
    _, client = talk()
    for payload, words in ((struct.pack("<ff", 2.0, 0.0), "out of range"), (b"\0", "out of range")):
        with pytest.raises(BoardError, match=words):
            client.request(Kind.START, payload)
    with pytest.raises(BoardError, match="present state"):
        client.reference(0.1)
    with pytest.raises(BoardError, match="present state"):
        client.clear()
    with pytest.raises(BoardError, match="does not support"):
        client.request(Kind.PATTERN, bytes(8))


def test_a_silent_host_stops_the_drive(talk) -> None:
    """After half a second without a word, most of it skipped here."""
    from tests.helpers.board_probes import hear_earlier

    board, client = talk()
    client.start(0.1)
    board.run(10e-3)
    hear_earlier(board, 0.44, 200e-6)
    board.run(10e-3)
    assert board.state == 2
    client.status()
    hear_earlier(board, 0.44, 200e-6)
    board.run(10e-3)
    assert board.state == 2
    board.run(60e-3)
    assert client.status().faults == ("host silent",)
    client.clear()
    board.run(1e-3)
    assert client.status().state == "idle"


def test_a_low_supply_trips(talk) -> None:
    board, client = talk()
    board.word(0x40007004).value |= 1 << 2
    board.run(1e-3)
    assert client.status().faults == ("supply",)
    client.clear()
    board.run(1e-3)
    assert client.status().faults == ("supply",)
    board.word(0x40007004).value &= ~(1 << 2)
    board.run(1e-3)
    client.clear()
    board.run(1e-3)
    assert client.status().state == "idle"


def test_texture_is_followed_as_far_as_the_loop_is_fast(talk) -> None:
    board, client = talk(plate=replace(PLATE, noise=0.0))
    client.start(0.1)
    client.sine(100.0, 1.0)
    board.run(40e-3)
    board.reports.clear()
    board.run(40e-3)
    size = np.array([abs(measured) for measured, _, _ in board.reports])
    time = np.arange(len(size)) * 200e-6
    swing = 2.0 * abs(np.mean((size - size.mean()) * np.exp(-2j * np.pi * 100.0 * time))) / 0.1
    assert size.mean() == pytest.approx(0.05, rel=0.02)
    assert swing == pytest.approx(0.5 / math.hypot(1.0, 2.0 * math.pi * 100.0 * 0.53e-3), rel=0.1)


def test_streamed_texture(talk) -> None:
    board, client = talk(plate=replace(PLATE, noise=0.0))
    client.start(0.1)
    client.stream(50)
    assert client.samples([1.0, 0.25, 0.75]) == 3
    board.reports.clear()
    board.run(30e-3)
    reference = np.array([reference for _, _, reference in board.reports])
    assert set(np.round(np.unique(reference), 4)) >= {0.025, 0.075}
    assert reference[-1] == pytest.approx(0.075, rel=1e-3)
    assert client.status().underruns >= 1


def test_log_records_what_happened(talk) -> None:
    board, client = talk()
    client.log(10)
    client.start(0.1)
    board.run(50e-3)
    records = client.take_records()
    assert len(records) >= 20
    assert {b.window - a.window for a, b in pairwise(records)} == {10}
    assert records[-1].reference == pytest.approx(0.1)
    assert abs(records[-1].measured) == pytest.approx(0.1, rel=0.05)


def test_a_log_goes_on_while_the_host_asks_for_the_status(talk) -> None:
    """A frame of records that is full while a reply is being sent goes out with one record more."""
    _, client = talk()
    client.log(2)
    client.start(0.1)
    records = []
    for _ in range(30):
        client.status()
        records += client.take_records()
    assert len(records) > 100 and {b.window - a.window for a, b in pairwise(records)} == {2}


def test_a_table_goes_up_and_survives_a_reset(talk) -> None:
    board, client = talk()
    client.upload(OTHER)
    assert bytes(board.sector[: len(OTHER)]) == OTHER
    assert board.resets == 0
    assert set(board.stalls) == {(False, 2048)}
    for _ in range(2):
        status = client.status()
        assert status.frequency_hz == pytest.approx(30500.0, abs=4e-3)
        assert status.state == "idle" and not status.identified
        board.reset()
        board.run(1e-3)
    assert board.clock is not None and board.resets == 0


def test_a_table_is_refused_while_running(talk) -> None:
    board, client = talk()
    client.start(0.1)
    with pytest.raises(BoardError, match="present state"):
        client.upload(OTHER)
    assert bytes(board.sector[: len(KNOWN)]) == KNOWN and client.status().state == "run"


def test_a_table_is_refused_while_the_supply_is_low(talk) -> None:
    """Flash memory that is erased below its voltage may keep anything."""
    board, client = talk()
    board.word(0x40007004).value |= 1 << 2  # PVDO
    board.run(2e-3)
    with pytest.raises(BoardError, match="present state"):
        client.upload(OTHER)
    assert bytes(board.sector[: len(KNOWN)]) == KNOWN and client.status().faults == ("supply",)
    board.word(0x40007004).value &= ~(1 << 2)
    client.clear()
    client.upload(OTHER)
    assert bytes(board.sector[: len(OTHER)]) == OTHER


@pytest.mark.parametrize(
    ("table", "words"),
    [
        (OTHER[:-1] + b"\0", "damaged"),
        (OTHER[:4] + b"\x09" + OTHER[5:], "another version"),
        (seal(OTHER[:52] + struct.pack("<f", -1.0) + OTHER[56:-4]), "out of range"),
        (b"\xff" * 100, "not a mode table"),
        (bytes(4000), "out of range"),
    ],
)
def test_bad_tables_never_reach_the_flash_memory(talk, table: bytes, words: str) -> None:
    board, client = talk()
    with pytest.raises(BoardError, match=words):
        client.upload(table)
    assert bytes(board.sector[: len(KNOWN)]) == KNOWN
    assert client.status().state == "idle"


def test_an_incomplete_upload_is_not_stored(talk) -> None:
    board, client = talk()
    client.request(Kind.UPLOAD_BEGIN, struct.pack("<I", len(OTHER)))
    client.request(Kind.UPLOAD_DATA, struct.pack("<I", 0) + OTHER[:100])
    for offset in (101, len(OTHER), 2**32 - 1):
        with pytest.raises(BoardError, match="out of range"):
            client.request(Kind.UPLOAD_DATA, struct.pack("<I", offset) + b"xyz")
    short = OTHER[:-1]
    for extra in range(100, len(short), 100):
        client.request(Kind.UPLOAD_DATA, struct.pack("<I", extra) + short[extra : extra + 100])
    with pytest.raises(BoardError, match="out of range"):
        client.request(Kind.UPLOAD_DATA, struct.pack("<I", len(OTHER) - 2) + b"xyz")
    with pytest.raises(BoardError, match="out of range"):
        client.request(Kind.UPLOAD_END)
    assert bytes(board.sector[: len(KNOWN)]) == KNOWN


def test_an_upload_larger_than_the_staging_room_is_refused_at_once(talk) -> None:
    _, client = talk()
    client.request(Kind.UPLOAD_BEGIN, struct.pack("<I", MAX_BYTES))
    for length in (0, MAX_BYTES + 1, 2**32 - 1):
        with pytest.raises(BoardError, match="out of range"):
            client.request(Kind.UPLOAD_BEGIN, struct.pack("<I", length))


def test_flash_memory_that_does_not_take_it_is_a_fault(talk) -> None:
    board, client = talk()
    board.flash.broken = True
    with pytest.raises(BoardError, match="could not be stored"):
        client.upload(OTHER)
    assert set(client.status().faults) == {"flash", "table"}
    with pytest.raises(BoardError, match="present state"):
        client.clear()
    board.flash.broken = False
    client.upload(OTHER)
    assert client.status().state == "idle"


def test_noise_on_the_line_changes_nothing(talk) -> None:
    board, client = talk()
    board.send(np.random.default_rng(2).integers(0, 256, 4000, dtype=np.uint8).tobytes() + b"\0")
    board.run(60e-3)
    board.received.clear()
    assert client.status().state == "idle" and bytes(board.sector[: len(KNOWN)]) == KNOWN


def test_a_lost_reply_is_asked_for_again(talk) -> None:
    _, client = talk()
    read, left = client.port.read, client.reads

    def port_read(size: int) -> bytes:
        nonlocal left
        arrived, left = read(size), left - 1
        return b"" if left >= 0 else arrived

    client.port.read = port_read
    assert client.status().state == "idle"


def test_a_board_that_stays_silent_is_reported() -> None:
    class Dead:
        def write(self, data: bytes) -> None: ...

        def read(self, size: int = 1) -> bytes:
            return b""

    with pytest.raises(BoardError, match="no answer to status"):
        Client(Dead()).status()


def test_replies_are_not_taken_for_requests(talk) -> None:
    board, _ = talk()
    board.send(encode(Message(Kind.STOP | 0x80, 1, b"\0")))
    board.run(5e-3)
    assert board.received == b""


@pytest.mark.parametrize("dead", [{"dead_crystal": True}, {"dead_pll": True}])
def test_a_fault_of_the_clock_can_be_read(talk, dead: dict) -> None:
    """From its own oscillator, by the PLL or without, the chip speaks at a rate the host understands."""
    board, client = talk(**dead)
    assert abs(10.0 / board.byte_s / 921600 - 1.0) < 0.025
    assert client.status().faults == ("clock",)


@pytest.mark.parametrize("dead", [{}, {"dead_pll": True}])
def test_the_interrupts_leave_the_main_loop_its_time_by_any_clock(talk, dead: dict) -> None:
    """Longest paths seen, in instructions a cycle; one takes some one and a half cycles, and entry and exit theirs."""
    from tests.helpers.board_probes import count_instructions

    board, _ = talk(**dead)
    counts = count_instructions(board, lambda: board.run(2e-3), "ADC_IRQHandler", "SysTick_Handler")
    fast, look = (max(counts[name]) for name in ("ADC_IRQHandler", "SysTick_Handler"))
    sample_cycles = 360 if dead else 720  # of the core; the timer counts APB1's doubled clock unless that is undivided
    assert fast / sample_cycles + look / (board.systick_s * board.clock.core_hz) < 0.45


def test_an_upload_clears_only_what_it_mends(talk) -> None:
    _, client = talk(dead_crystal=True)
    before = client.status().faults
    assert before == ("clock",)
    client.upload(OTHER)
    assert client.status().faults == before and client.status().state == "fault"
    with pytest.raises(BoardError, match="present state"):
        client.start(0.1)


def test_tables_of_the_other_build_or_rate_are_refused(talk) -> None:
    board, client = talk()
    six = to_bytes(ModeTable(40e3, bytes(16), (), shapes=(Shape(2400.0, 5e-3, (Pattern("all", (1,) * 6),)),)))
    for table in (six, to_bytes(ModeTable(200e3, bytes(16), (Mode(31e3, 3e-3),)))):
        with pytest.raises(BoardError, match="other build"):
            client.upload(table)
    with pytest.raises(BoardError, match="wrong length"):
        client.upload(OTHER + bytes(8))
    assert bytes(board.sector[: len(KNOWN)]) == KNOWN and client.status().state == "idle"


def test_a_request_repeated_by_its_sequence_is_done_once_and_answered_again(talk) -> None:
    board, client = talk()
    frame = encode(Message(Kind.START, 77, struct.pack("<ff", 0.1, 0.0)))
    for _ in range(2):
        board.received.clear()
        board.send(frame)
        board.run(2e-3)
        assert decode(bytes(board.received[:-1])).payload == b"\0"
    client.stream(50)
    pieces = encode(Message(Kind.SAMPLES, 78, struct.pack("<3H", 1, 2, 3)))
    board.send(pieces + pieces)
    board.run(3e-3)
    assert board.app.base.texture.given == 3


def test_identify_measures_again_and_rests(talk) -> None:
    board, client = talk()
    client.request(Kind.IDENTIFY)
    assert client.status().state == "identify"
    client.stop()
    board.run(1e-3)
    assert client.status().state == "idle"


def test_the_button_is_pressed_once_however_it_bounces(talk) -> None:
    """Twice 1 ms of bouncing, and held at power-up; the press that clears a fault does not start."""
    from tests.helpers.board_probes import push_button

    board, _ = talk()
    board.run(22e-3)
    for pressed, seconds in ((True, 1e-3), (False, 1e-3), (True, 22e-3), (False, 1e-3), (True, 1e-3), (False, 22e-3)):
        board.press(pressed)
        board.run(seconds)
    assert board.state == 2
    board.word(0x40007004).value |= 1 << 2
    board.run(1e-3)
    board.word(0x40007004).value &= ~(1 << 2)
    assert board.state == 3
    push_button(board)
    assert board.state == 0
    push_button(board)
    assert board.state == 0


def test_health_tells_where_it_crashed_and_how_much_stack_is_left(talk) -> None:
    board, client = talk()
    board.interrupt_unexpectedly()
    assert board.run_until(lambda: board.resets == 1, 0.05)
    board.run(1e-3)
    health = client.health()
    assert health.watchdog_resets == 1 and health.core_hz == 180_000_000
    assert board.symbol("main") <= health.pc < board.symbol("main") + board.elf.symbols["main"].size
    assert client.status().faults == ("watchdog",)
