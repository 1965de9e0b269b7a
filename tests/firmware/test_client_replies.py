"""What the client makes of replies that no sound board gives: one line and an exit code, for every command."""

from __future__ import annotations

import sys
import types
from pathlib import Path

import pytest

from firmware.client import client, command_line
from firmware.client.client import BoardError, Client, describe
from firmware.mode_table import Mode, ModeTable, to_bytes
from firmware.protocol import FAULT, LOG_RECORDS, REPLY, Chirp, Fault, Kind, Measured, Message, encode
from tests.helpers.fake_board import (
    RECORD,
    SIX_STATUS,
    STATUS,
    FakePort,
    log_frame,
    pseudo_terminal,
    single_status,
    write_sound,
)

TABLE = to_bytes(ModeTable(250e3, bytes(16), (Mode(31250.0, 3e-3),)))
VALUES = {
    "reference": ["0.1"],
    "sine": ["50", "0.5"],
    "upload": ["table.bin"],
    "pattern": ["1"],
    "shape": ["1"],
    "watch": ["--seconds", "0.01"],
    "log": ["log.csv", "--seconds", "0.01"],
    "capture": ["capture.csv"],
    "stream": ["sound.wav"],
    "selftest": ["line"],
}


def with_payload(payload: bytes):
    return lambda reply: encode(Message(reply.kind, reply.sequence, payload))


SPOILED = {
    "empty": (with_payload(b""), "empty reply"),
    "long": (lambda reply: with_payload(reply.payload + b"\1")(reply), "bytes, expected"),
    "refused": (with_payload(b"\3"), "refused in the present state"),
    "refused for no known reason": (with_payload(b"\x63"), "unknown reason 99"),
    "table refused without a reason": (with_payload(b"\4"), "the table was refused"),
    "table refused for no known reason": (with_payload(b"\4\x63"), "unknown reason 99"),
    "record of a wrong length": (lambda reply: log_frame(RECORD[:-1]) + encode(reply), "23 bytes of log"),
    "silence": (lambda reply: b"", "no answer"),
    "another sequence": (lambda reply: encode(Message(reply.kind, reply.sequence ^ 1, reply.payload)), "no answer"),
    "another kind": (lambda reply: encode(Message(reply.kind ^ 1, reply.sequence, reply.payload)), "no answer"),
    "a request as the reply": (
        lambda reply: encode(Message(reply.kind & ~REPLY, reply.sequence, reply.payload)),
        "no answer",
    ),
    "a frame without content": (lambda reply: b"\1\0", "no answer"),
}
FLOODS = {
    "records": log_frame(RECORD * 4),
    "one unending frame": b"\x55",
    "zeros": b"\0",
    "other replies": encode(Message(Kind.STOP | REPLY, 99, b"\0")),
}


@pytest.fixture
def run(monkeypatch: pytest.MonkeyPatch, tmp_path: Path, capsys):
    """Runs an action on a port of bytes; returns exit code, output, and the one line of error."""
    (tmp_path / "table.bin").write_bytes(TABLE)
    write_sound(tmp_path / "sound.wav", [0, 100, -100])
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(client, "BUSY_S", 0.05)

    def go(port: FakePort, action: str) -> tuple[int, str, str]:
        fake = types.ModuleType("serial")
        fake.Serial = lambda *_, **__: port  # type: ignore[attr-defined]
        monkeypatch.setitem(sys.modules, "serial", fake)
        code = command_line.main(["COM7", action, *VALUES.get(action, [])])
        text = capsys.readouterr()
        return code, text.out, text.err

    return go


@pytest.mark.parametrize("action", command_line.ACTIONS)
@pytest.mark.parametrize("status", [STATUS, SIX_STATUS], ids=["single", "six"])
def test_a_sound_board_is_understood(run, action: str, status: bytes) -> None:
    code, out, err = run(FakePort(status=status), action)
    if action == "pattern" and status is STATUS:
        assert code == 3 and "single-mode image" in err
        return
    if action == "identify" and status is STATUS:  # it has no plate that could answer a chirp
        assert code == 3 and "the board records 4 words" in err and err.endswith("; stopped\n")
        return
    assert (code, err) == (0, "") and out
    assert "state idle" in out or action in ("identity", "health", "watch", "log", "capture", "selftest")


@pytest.mark.parametrize("action", command_line.ACTIONS)
@pytest.mark.parametrize("fault", SPOILED)
def test_a_spoiled_reply_is_one_line(run, action: str, fault: str) -> None:
    spoil, words = SPOILED[fault]
    code, _, err = run(FakePort(spoil), action)
    assert code == 3 and err.startswith("client: ") and err.count("\n") == 1 and words in err, err


@pytest.mark.parametrize("action", command_line.ACTIONS)
@pytest.mark.parametrize("flood", FLOODS)
def test_a_line_that_never_rests_is_one_line(run, action: str, flood: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(client, "BUSY_S", 0.005)  # of a processor's time, each attempt
    code, _, err = run(FakePort(lambda reply: b"", flood=FLOODS[flood]), action)
    assert code == 3 and "no answer" in err and err.count("\n") == 1, err


ASKING = {
    Kind.IDENTITY: Client.identity,
    Kind.STATUS: Client.status,
    Kind.START: Client.start,
    Kind.STOP: Client.stop,
    Kind.CLEAR: Client.clear,
    Kind.REFERENCE: lambda talk: talk.reference(0.1),
    Kind.SINE: lambda talk: talk.sine(50.0, 0.5),
    Kind.STREAM: lambda talk: talk.stream(1),
    Kind.SAMPLES: lambda talk: talk.samples([0.5]),
    Kind.LOG: lambda talk: talk.log(1),
    Kind.UPLOAD_BEGIN: lambda talk: talk.upload(TABLE),
    Kind.UPLOAD_DATA: lambda talk: talk.upload(TABLE),
    Kind.UPLOAD_END: lambda talk: talk.upload(TABLE),
    Kind.PATTERN: lambda talk: talk.choose(1),
    Kind.IDENTIFY: Client.identify,
    Kind.HEALTH: Client.health,
    Kind.CAPTURE: lambda talk: talk.capture(1),
    Kind.CAPTURED: lambda talk: talk.captured(0),
    Kind.CHIRP: lambda talk: talk.chirp(Chirp(31e3, 0.1, 0, 1, 512, 1, 512)),
    Kind.COLUMN: lambda talk: talk.column(0),
    Kind.MEASURED: lambda talk: talk.set(Measured(31e3, 3e-3, 0.5j, 9e-6, 0.01, 0.3, 0.001)),
}


@pytest.mark.parametrize("kind", Kind)
@pytest.mark.parametrize("fault", ["empty", "long"])
def test_the_reply_to_each_request_is_checked(kind: Kind, fault: str) -> None:
    """A reply to this kind alone is spoiled: what the next request would show does not count."""

    def spoil(reply: Message) -> bytes:
        return SPOILED[fault][0](reply) if reply.kind == kind | REPLY else encode(reply)

    with pytest.raises(BoardError, match=f"^{kind.name.lower()}: .*{SPOILED[fault][1]}"):
        ASKING[kind](Client(FakePort(spoil)))


@pytest.mark.parametrize("length", [n for n in range(len(SIX_STATUS) + 2) if n not in (len(STATUS), len(SIX_STATUS))])
def test_a_status_of_a_wrong_length_is_refused(length: int) -> None:
    spoil = with_payload(b"\0" + SIX_STATUS.ljust(120, b"\0")[:length])
    with pytest.raises(BoardError, match=f"status: the board sent {length} bytes, expected"):
        Client(FakePort(spoil)).status()


def test_an_unknown_state_is_refused_and_an_unknown_fault_told_by_number() -> None:
    with pytest.raises(BoardError, match="the unknown state 9"):
        Client(FakePort(status=b"\x09" + STATUS[1:])).status()
    status = Client(FakePort(status=single_status(faults=Fault.MISMATCH | 1 << 29, first=1 << 29))).status()
    assert status.faults == ("mismatch", "bit 29") and status.first == ("bit 29",)
    assert "faults: mismatch, bit 29 (first bit 29)" in describe(status)


def test_a_drive_at_its_limit_is_told() -> None:
    assert "drive at its limit" in describe(Client(FakePort(status=single_status(flags=9))).status())
    assert "drive at its limit" not in describe(Client(FakePort()).status())


@pytest.mark.parametrize(
    ("flags", "words"),
    [(1 | 16, "faults: mismatch, tries again"), (1 | 32, "drive limited to half"), (1, "misfit 0.2 %")],
)
def test_a_status_says_what_the_board_does_by_itself(flags: int, words: str) -> None:
    text = describe(Client(FakePort(status=single_status(FAULT, Fault.MISMATCH, flags=flags))).status())
    assert words in text and "measured at up to 0.3 of full scale" in text
    assert ("tries again" in text, "limited to half" in text) == (bool(flags & 16), bool(flags & 32))


def test_samples_without_their_count_are_refused() -> None:
    with pytest.raises(BoardError, match="samples: the board sent 0 bytes, expected 1"):
        Client(FakePort(with_payload(b"\0"))).samples([0.5])


def test_an_identity_is_checked() -> None:
    assert (Client(FakePort()).identity().build, Client(FakePort()).identity().count) == ("single", 3)
    with pytest.raises(BoardError, match="identity: the board sent 3 bytes, expected 28"):
        Client(FakePort(with_payload(b"\0abc"))).identity()
    with pytest.raises(BoardError, match="the unknown build 99"):
        Client(FakePort(with_payload(b"\0\1\x63\1\1" + bytes(24)))).identity()


def test_a_number_that_is_none_is_told_in_words() -> None:
    text = describe(Client(FakePort(status=single_status(offset=float("nan")))).status())
    assert "offset not finite" in text and "nan" not in text.replace("finite", "")


@pytest.mark.parametrize("flood", FLOODS)
def test_taking_records_ends_while_the_board_sends_on(flood: str) -> None:
    port = Client(FakePort(flood=FLOODS[flood]))
    records = port.take_records()
    assert bool(records) == (flood == "records") and all(record.window == 7 for record in records)
    assert len(port.buffer) <= 256


def test_taking_records_takes_all_that_came() -> None:
    port = FakePort()
    port.outward = log_frame(RECORD * 4) * 50
    assert len(Client(port).take_records()) == 200


def test_a_record_of_a_wrong_length_is_refused() -> None:
    port = FakePort()
    port.outward = log_frame(RECORD + b"x")
    with pytest.raises(BoardError, match="log: the board sent 25 bytes of log, expected a multiple of 24"):
        Client(port).take_records()


def test_records_behind_a_reply_are_kept() -> None:
    """The log goes on while a request is answered."""
    talk = Client(FakePort(lambda reply: log_frame() + encode(reply) + log_frame(RECORD * 2)))
    talk.stop()
    assert len(talk.take_records()) == 3


@pytest.mark.parametrize("action", ["status", "start", "upload"])
def test_a_real_port_is_spoken_to(action: str, tmp_path: Path, capsys, monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("serial", reason="pyserial is not installed: pip install pyserial")
    (tmp_path / "table.bin").write_bytes(TABLE)
    monkeypatch.chdir(tmp_path)
    with pseudo_terminal(FakePort()) as name:
        assert command_line.main([name, action, *VALUES.get(action, [])]) == 0
    text = capsys.readouterr()
    assert "mode 31250.000 Hz" in text.out and text.err == ""


@pytest.mark.parametrize(
    ("port", "words"),
    [
        (FakePort(SPOILED["empty"][0]), "empty reply"),
        (FakePort(SPOILED["long"][0]), "bytes, expected"),
        (FakePort(lambda reply: b"", flood=FLOODS["records"]), "no answer to status"),
    ],
    ids=["empty", "long", "endless"],
)
def test_a_real_port_with_a_spoiled_board(port: FakePort, words: str, capsys, monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("serial", reason="pyserial is not installed: pip install pyserial")
    monkeypatch.setattr(client, "BUSY_S", 0.2)
    with pseudo_terminal(port) as name:
        assert command_line.main([name, "status"]) == 3
    err = capsys.readouterr().err
    assert words in err and err.count("\n") == 1


@pytest.mark.parametrize("name", ["/dev/antinode-none", "/dev/null", "table.bin"])
def test_a_port_that_is_none_is_told_with_what_to_look_at(name: str, tmp_path: Path, capsys, monkeypatch) -> None:
    pytest.importorskip("serial", reason="pyserial is not installed: pip install pyserial")
    (tmp_path / "table.bin").write_bytes(TABLE)
    monkeypatch.chdir(tmp_path)
    assert command_line.main([name, "status"]) == 5
    err = capsys.readouterr().err
    assert err.startswith(f"client: {name}: ") and "plugged in" in err and err.count("\n") == 1


def test_a_board_that_is_pulled_out_is_one_line(capsys) -> None:
    """The port's own error while talking, as pyserial's is an OSError."""

    class Pulled(FakePort):
        def read(self, size: int = 1) -> bytes:
            raise OSError("device disconnected")

    with pytest.MonkeyPatch.context() as patched:
        fake = types.ModuleType("serial")
        fake.Serial = lambda *_, **__: Pulled()  # type: ignore[attr-defined]
        patched.setitem(sys.modules, "serial", fake)
        assert command_line.main(["COM7", "status"]) == 3
    assert capsys.readouterr().err == "client: device disconnected\n"


@pytest.mark.parametrize(
    ("values", "words"),
    [
        (["reference", "nan"], "'nan': must be a number from 0 to 1"),
        (["reference", "much"], "'much': must be a number from 0 to 1"),
        (["sine", "50"], "DEPTH"),
        (["sine", "1e300", "0.5"], "must be a number from 0 to 500"),
        (["start", "0.1", "inf"], "must be a number from -500 to 500"),
        (["start", "2000um"], "must be a number from 0 to 1000"),
        (["start", "1mm"], "must be a number from 0 to 1"),
        (["pattern", "-1"], "'-1': must be an integer from 0"),
        (["shape", "1.5"], "must be an integer from 0"),
        (["dance"], "invalid choice"),
    ],
)
def test_a_wrong_value_is_refused_before_the_port_is_opened(values: list[str], words: str, capsys) -> None:
    with pytest.raises(SystemExit) as raised:
        command_line.main(["/dev/antinode-none", *values])
    assert raised.value.code == 2 and words in capsys.readouterr().err


def test_the_kinds_of_frames_are_told_apart() -> None:
    assert LOG_RECORDS & REPLY and LOG_RECORDS not in {kind | REPLY for kind in Kind}
