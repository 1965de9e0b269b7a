"""What the client does beyond one request: watching, logging, streaming, the self-test, finding the port, being interrupted."""

from __future__ import annotations

import csv
import signal
import struct
import subprocess
import sys
import types
from argparse import Namespace
from collections import defaultdict
from pathlib import Path

import pytest

from firmware.client import actions, command_line
from firmware.client.client import BoardError, Client, describe, describe_health
from firmware.protocol import FAULT, IDENTIFY, IDLE, PROTOCOL, RUN, Fault, Flag, Kind, Message, Result
from tests.helpers.fake_board import (
    HEALTH,
    SIX_STATUS,
    FakePort,
    log_frame,
    pseudo_terminal,
    single_status,
    write_sound,
)


def kinds(port: FakePort) -> list[Kind]:
    return [Kind(request.kind) for request in port.requests]


def run(monkeypatch: pytest.MonkeyPatch, port: FakePort, *arguments: str) -> int:
    fake = types.ModuleType("serial")
    fake.Serial = lambda *_, **__: port  # type: ignore[attr-defined]
    monkeypatch.setitem(sys.modules, "serial", fake)
    return command_line.main(["COM7", *arguments])


class Interrupted(FakePort):
    """Ctrl-C comes with the third status while running; what is asked then is still answered."""

    def __init__(self) -> None:
        super().__init__(status=single_status(RUN))
        self.looks = 0

    def reply(self, request: Message) -> Message:
        self.looks += request.kind == Kind.STATUS
        if request.kind == Kind.STATUS and self.looks == 3:
            raise KeyboardInterrupt
        return super().reply(request)


@pytest.mark.parametrize("action", [("start", "0.1"), ("identify",), ("pattern", "1")])
def test_ctrl_c_stops_what_was_started_here(monkeypatch: pytest.MonkeyPatch, capsys, action: tuple[str, ...]) -> None:
    port = Interrupted()
    if action[0] in ("pattern", "identify"):
        port.status = SIX_STATUS
        port.looks = 1  # the state before is asked for first
        monkeypatch.setattr(actions, "DRIVING", ("idle", "run"))
    assert run(monkeypatch, port, *action) == 130
    assert kinds(port)[-1] is Kind.STOP
    assert capsys.readouterr().err == "client: interrupted; stopped\n"


def test_ctrl_c_while_watching_leaves_the_board_alone(monkeypatch: pytest.MonkeyPatch, capsys) -> None:
    port = Interrupted()
    assert run(monkeypatch, port, "watch") == 130
    assert Kind.STOP not in kinds(port) and capsys.readouterr().err == "client: interrupted\n"


def test_a_refused_start_stops_nothing(monkeypatch: pytest.MonkeyPatch, capsys) -> None:
    """It runs by its button, maybe under somebody's finger."""
    port = FakePort(lambda reply: refused(reply, Kind.START))
    assert run(monkeypatch, port, "start", "0.1") == 3
    assert kinds(port) == [Kind.START, Kind.STATUS]
    assert capsys.readouterr().err == "client: start: refused in the present state, idle\n"


@pytest.mark.parametrize(
    ("state", "faults", "words"),
    [
        (FAULT, Fault.MISMATCH, ", fault mismatch: `clear` leaves it"),
        (FAULT, Fault.TABLE | Fault.BREAK, ", fault table, break: `clear` cannot leave table"),
        (RUN, Fault(0), ", run: `stop` ends it"),
    ],
)
def test_a_refusal_names_the_state_and_the_way_out(
    monkeypatch: pytest.MonkeyPatch, capsys, state: int, faults: Fault, words: str
) -> None:
    port = FakePort(lambda reply: refused(reply, Kind.START), status=single_status(state, faults))
    assert run(monkeypatch, port, "start", "0.1") == 3
    assert capsys.readouterr().err == f"client: start: refused in the present state{words}\n"


def refused(reply: Message, kind: Kind) -> bytes:
    from firmware.protocol import encode

    return encode(Message(reply.kind, reply.sequence, b"\3") if reply.kind & 0x7F == kind else reply)


def test_a_start_without_an_answer_is_stopped(monkeypatch: pytest.MonkeyPatch, capsys) -> None:
    port = FakePort(lambda reply: b"" if reply.kind & 0x7F == Kind.START else refused(reply, Kind.IDENTITY))
    assert run(monkeypatch, port, "start", "0.1") == 3
    assert kinds(port)[-1] is Kind.STOP and capsys.readouterr().err == "client: no answer to start; stopped\n"


def test_a_board_that_falls_silent_while_driving_is_told(monkeypatch: pytest.MonkeyPatch, capsys) -> None:
    port = FakePort(lambda reply: refused(reply, Kind.IDENTITY) if reply.kind & 0x7F == Kind.START else b"")
    assert run(monkeypatch, port, "start", "0.1") == 3
    assert "stopping failed, but the board stops by itself" in capsys.readouterr().err


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_signal_on_a_real_port_stops_the_board(number: int) -> None:
    pytest.importorskip("serial", reason="pyserial is not installed: pip install pyserial")
    board = FakePort(status=single_status(RUN))
    with pseudo_terminal(board) as name:
        command = [sys.executable, "-m", "firmware.client", name, "start", "0.1"]
        process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
        assert process.stdout is not None and process.stdout.readline().startswith("run")
        process.send_signal(number)
        _, error = process.communicate(timeout=30)
    assert process.returncode == 130 and error == "client: interrupted; stopped\n"
    assert kinds(board)[0] is Kind.START and kinds(board)[-1] is Kind.STOP


@pytest.mark.parametrize("action", ["identify", "start", "stream"])
def test_what_ends_in_a_fault_is_a_failure(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, capsys, action: str
) -> None:
    write_sound(tmp_path / "a.wav", [0, 255], width=1)
    six = bytes([FAULT]) + SIX_STATUS[1:4] + struct.pack("<I", Fault.IDENTIFY) + SIX_STATUS[8:]
    port = FakePort(status=six if action == "identify" else single_status(FAULT, Fault.IDENTIFY))
    assert run(monkeypatch, port, action, *([str(tmp_path / "a.wav")] if action == "stream" else [])) == 3
    assert capsys.readouterr().err.startswith(f"client: {action}: ended with fault identify")


def test_six_channels_are_identified_by_the_board_and_hold_a_pattern(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, capsys
) -> None:
    port, picture = FakePort(status=SIX_STATUS), tmp_path / "a.svg"
    assert run(monkeypatch, port, "identify", "0.1", "--plot", str(picture)) == 0
    assert "actuator" in picture.read_text()
    start = next(request for request in port.requests if request.kind == Kind.START)
    assert Kind.IDENTIFY in kinds(port) and struct.unpack("<If", start.payload) == (0, pytest.approx(0.1))
    assert "misfit 1 %, at up to 0.2 of full scale" in (out := capsys.readouterr().out)
    assert (
        "coherence 0.9990" in out
        and "phase margin" in out
        and "5.9 s of the board's time (least possible 5.6 s)" in out
    )
    metric = SIX_STATUS[:28] + struct.pack("<f", 4e-6) + SIX_STATUS[32:]
    assert run(monkeypatch, FakePort(status=metric), "status") == 0
    assert "up to 0.8 um, misfit" in (out := capsys.readouterr().out) and "um of full scale" not in out
    port = FakePort(status=metric)
    assert run(monkeypatch, port, "identify", "0.4um") == 0
    start = next(request for request in port.requests if request.kind == Kind.START)
    assert struct.unpack("<If", start.payload) == (0, pytest.approx(0.1))
    out = capsys.readouterr().out  # a response of 0.5 (1 + j), 4 um over 1.65 V
    assert "responses up to 1.71 um/V" in out and "at up to 0.8 um" in out and "full scale" not in out


def test_a_pattern_is_no_start_of_one_mode_and_takes_its_reference_along(
    monkeypatch: pytest.MonkeyPatch, capsys
) -> None:
    """To the single build the number of a pattern would be a level."""
    port = FakePort()
    assert run(monkeypatch, port, "pattern", "3", "0.1") == 3 and kinds(port) == [Kind.STATUS]
    assert capsys.readouterr().err == "client: pattern: this board runs the single-mode image\n"
    port = FakePort(status=bytes([RUN]) + SIX_STATUS[1:])
    Client(port).pattern(1, 0.05)
    assert kinds(port) == [Kind.STATUS, Kind.PATTERN, Kind.REFERENCE]


def test_watching_shows_bars_of_both_builds(monkeypatch: pytest.MonkeyPatch, capsys) -> None:
    assert run(monkeypatch, FakePort(status=SIX_STATUS), "watch", "--seconds", "0.01") == 0
    lines = capsys.readouterr().out.splitlines()
    assert (
        lines[0] == "state idle"
        and len(lines) == 8
        and lines[2].split() == ["sensor", "1", actions.bar(0.1 * 2**0.5), "0.1414", "▆"]
    )
    assert run(monkeypatch, FakePort(), "watch", "--seconds", "0.01") == 0
    assert [line.split()[0] for line in capsys.readouterr().out.splitlines()] == [
        "state",
        "reference",
        "measured",
        "drive",
    ]


def test_watching_plots_the_last_looks() -> None:
    """From -60 to 0 dB in eight steps, the newest to the right, no more than fit."""
    traces: dict[str, str] = defaultdict(str)
    for share in (0.0, 1e-3, 10**-1.5, 1.0, float("nan")):
        actions._bars(Client(FakePort(status=single_status(reference=share))).status(), traces)
    assert traces["reference"] == "  ▄█ "
    for _ in range(40):
        actions._bars(Client(FakePort(status=single_status(reference=1.0))).status(), traces)
    assert traces["reference"] == "█" * actions.BAR


@pytest.mark.parametrize(("share", "filled"), [(0.0, 0), (1e-4, 0), (1e-3, 0), (10**-1.5, 15), (1.0, 30), (9.0, 30)])
def test_a_bar_is_empty_at_minus_60_db_and_full_at_0(share: float, filled: int) -> None:
    assert actions.bar(share) == "#" * filled + "." * (30 - filled)
    assert actions.bar(float("nan")).count("#") == 0


def test_the_health_is_told() -> None:
    text = describe_health(Client(FakePort()).health())
    assert "clock 180 MHz" in text and "fast interrupt 210 cycles" in text and "exception 3 at 0x08000123" in text
    assert "exception" not in describe_health(type(Client(FakePort()).health())(*[0] * 11)) and len(HEALTH) == 44


def test_amplitudes_are_in_micrometres_where_the_table_has_metres(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, capsys
) -> None:
    """4 um at full scale: 1 um is a quarter of it, and 5 um are refused before anything is sent."""
    status = single_status(reference=0.25, metres=4e-6)
    port = FakePort(status=status)
    assert run(monkeypatch, port, "reference", "1um") == 0
    out = capsys.readouterr().out
    assert "reference 1 um, measured 0 um" in out and "measured at up to 1.2 um, misfit" in out
    sent = [request.payload for request in port.requests if request.kind == Kind.REFERENCE]
    assert sent == [struct.pack("<f", 0.25)]
    assert run(monkeypatch, FakePort(status=status), "reference", "5µm") == 2
    assert "5 um: must be at most 4 um with the board's table" in capsys.readouterr().err
    assert run(monkeypatch, FakePort(), "start", "1um") == 2
    assert "1 um: the board's table has no metres per volt; give a fraction" in capsys.readouterr().err
    for board in (single_status(), SIX_STATUS):
        port = FakePort(status=board)
        assert run(monkeypatch, port, "identify", "1um") == 2 and kinds(port) == [Kind.STATUS]
        assert capsys.readouterr().err.count("\n") == 1
    assert run(monkeypatch, FakePort(status=status), "watch", "--seconds", "0.01") == 0
    assert "1.0000 um" in capsys.readouterr().out


class Logging(FakePort):
    """Sends records with every status: those of windows 10, 20, 30, 60."""

    def reply(self, request: Message) -> Message:
        if request.kind == Kind.STATUS:
            parts = [struct.pack("<I5f", window, 0.5, -0.25, 0.125, 0.0, 0.5) for window in (10, 20, 30, 60)]
            self.outward += log_frame(b"".join(parts))
        return super().reply(request)


def test_the_log_is_written_and_what_was_lost_is_counted(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, capsys
) -> None:
    port, file = Logging(), tmp_path / "log.csv"
    assert run(monkeypatch, port, "log", str(file), "--every", "10", "--seconds", "0.01") == 0
    rows = list(csv.reader(file.open()))
    assert rows[0] == ["window", "measured_d", "measured_q", "drive_d", "drive_q", "reference"]
    assert rows[1] == ["10", "0.5", "-0.25", "0.125", "0", "0.5"] and [row[0] for row in rows[1:]] == [
        "10",
        "20",
        "30",
        "60",
    ]
    assert "4 records, 2 were lost: try a larger --every" in capsys.readouterr().out
    logs = [request.payload for request in port.requests if request.kind == Kind.LOG]
    assert logs == [struct.pack("<I", 10), struct.pack("<I", 0)]


def test_the_log_ends_on_the_board_when_interrupted(monkeypatch: pytest.MonkeyPatch, tmp_path: Path, capsys) -> None:
    port = Interrupted()
    assert run(monkeypatch, port, "log", str(tmp_path / "log.csv")) == 130
    assert kinds(port)[-1] is Kind.LOG and port.requests[-1].payload == bytes(4)


@pytest.mark.parametrize("action", ["log", "page"])
def test_a_file_that_stands_is_not_written_over(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, capsys, action: str
) -> None:
    file = tmp_path / "file"
    file.write_text("mine")
    assert run(monkeypatch, FakePort(), action, str(file)) == 2
    assert "file already exists" in capsys.readouterr().err and file.read_text() == "mine"
    assert run(monkeypatch, FakePort(), action, str(tmp_path / "none" / "file")) == 2


@pytest.mark.parametrize(
    ("width", "low", "middle", "high"), [(1, 0, 128, 255), (2, -(2**15), 0, 2**15 - 1), (3, -(2**23), 0, 2**23 - 1)]
)
def test_a_sound_becomes_factors(tmp_path: Path, width: int, low: int, middle: int, high: int) -> None:
    write_sound(tmp_path / "a.wav", [low, middle, high], width=width, channels=2)
    assert actions.factors_of(tmp_path / "a.wav", 2500.0) == pytest.approx([0.0, 0.5, 1.0], abs=0.003)


def test_a_sound_is_averaged_down_and_held_up(tmp_path: Path) -> None:
    write_sound(tmp_path / "a.wav", [0, 0, 255, 255, 0, 255], rate_hz=5000, width=1)
    assert actions.factors_of(tmp_path / "a.wav", 2500.0) == pytest.approx([0.0, 1.0, 0.5])
    assert actions.factors_of(tmp_path / "a.wav", 10000.0) == pytest.approx([0, 0, 0, 0, 1, 1, 1, 1, 0, 0, 1, 1])


@pytest.mark.parametrize("content", [b"", b"RIFF", b"nonsense" * 10, b"RIFF\x24\0\0\0WAVEfmt \x10\0\0\0"])
def test_what_is_no_sound_is_refused(monkeypatch: pytest.MonkeyPatch, tmp_path: Path, capsys, content: bytes) -> None:
    (tmp_path / "a.wav").write_bytes(content)
    assert run(monkeypatch, FakePort(), "stream", str(tmp_path / "a.wav")) == 2
    error = capsys.readouterr().err
    assert error.startswith(f"client: {tmp_path / 'a.wav'}: ") and error.count("\n") == 1


def test_a_sound_without_samples_is_refused(tmp_path: Path) -> None:
    write_sound(tmp_path / "a.wav", [])
    with pytest.raises(ValueError, match="no samples"):
        actions.factors_of(tmp_path / "a.wav", 2500.0)


class Full(FakePort):
    """Has room for seven more samples each time it is asked."""

    def __init__(self) -> None:
        super().__init__(status=single_status(RUN))
        self.kept: list[int] = []

    def reply(self, request: Message) -> Message:
        if request.kind != Kind.SAMPLES:
            return super().reply(request)
        codes = struct.unpack(f"<{len(request.payload) // 2}H", request.payload)
        self.kept += codes[:7]
        return Message(request.kind | 0x80, request.sequence, bytes([0, len(codes[:7])]))


def test_a_stream_gives_every_sample_once(monkeypatch: pytest.MonkeyPatch, tmp_path: Path, capsys) -> None:
    write_sound(tmp_path / "a.wav", list(range(200)), width=1)
    now = [0.0]
    monkeypatch.setattr(actions.time, "sleep", lambda seconds: now.append(now[-1] + seconds))
    monkeypatch.setattr(actions.time, "monotonic", lambda: now[-1])
    port = Full()
    assert run(monkeypatch, port, "stream", str(tmp_path / "a.wav"), "0.2") == 0
    assert port.kept == [round(level / 255 * 65535) for level in range(200)]
    assert kinds(port)[0] is Kind.START and Kind.STOP in kinds(port)
    assert next(request.payload for request in port.requests if request.kind == Kind.STREAM) == struct.pack("<I", 2)
    assert "200 samples at 2500 Hz" in capsys.readouterr().out


def port_of(device: str, vid: int | None) -> Namespace:
    return Namespace(device=device, vid=vid)


@pytest.mark.parametrize(
    ("ports", "code", "words"),
    [
        ([], 5, "no board found (other serial ports: none)"),
        ([("/dev/ttyS0", None)], 5, "other serial ports: /dev/ttyS0"),
        (
            [("/dev/ttyACM0", 0x0483), ("/dev/ttyACM1", 0x0483)],
            2,
            "choose one of /dev/ttyACM0, /dev/ttyACM1 with --port",
        ),
    ],
)
def test_no_board_or_several_are_told(
    monkeypatch: pytest.MonkeyPatch, capsys, ports: list, code: int, words: str
) -> None:
    pytest.importorskip("serial", reason="pyserial is not installed: pip install pyserial")
    monkeypatch.setattr("serial.tools.list_ports.comports", lambda: [port_of(*port) for port in ports])
    assert command_line.main(["status"]) == code
    error = capsys.readouterr().err
    assert words in error and error.count("\n") == 1


@pytest.mark.parametrize("before", [[], ["--port", "auto"], ["auto"]])
def test_the_only_board_is_found(monkeypatch: pytest.MonkeyPatch, capsys, before: list[str]) -> None:
    pytest.importorskip("serial", reason="pyserial is not installed: pip install pyserial")
    with pseudo_terminal(FakePort()) as name:
        result = [port_of("/dev/ttyS0", None), port_of(name, 0x0483)]
        monkeypatch.setattr("serial.tools.list_ports.comports", lambda: result)
        assert command_line.main([*before, "status"]) == 0
    assert "state idle" in capsys.readouterr().out


def test_a_port_may_be_named_in_front_or_by_its_option() -> None:
    assert command_line.with_port(["/dev/x", "start", "0.1", "-5"]) == ["/dev/x", "start", "0.1", "-5"]
    assert command_line.with_port(["start", "0.1", "--port", "/dev/x"]) == ["/dev/x", "start", "0.1"]
    assert command_line.with_port(["start", "0.1"]) == ["auto", "start", "0.1"]
    assert command_line.with_port(["--help"]) == ["--help"] and command_line.with_port([]) == []
    assert command_line.with_port(["stat"]) == ["auto", "stat"] and command_line.with_port(["/dev/x"]) == ["/dev/x"]


class Clock:
    """A clock that only sleeping moves."""

    def __init__(self) -> None:
        self.now = 0.0

    def monotonic(self) -> float:
        return self.now

    def sleep(self, seconds: float) -> None:
        self.now += seconds


class Bench(FakePort):
    """A board as bring-up finds it: rests at what is on its pin, sweeps for a while, ends as told."""

    def __init__(self, clock: Clock, **wrong) -> None:
        super().__init__()
        self.clock, self.wrong = clock, wrong
        self.faults, self.sweeping_from = wrong.get("faults", Fault.SENSOR_OFFSET), 0.0
        self.state = FAULT if self.faults else IDLE

    def reply(self, request: Message) -> Message:
        if request.kind == Kind.CLEAR and self.state != FAULT:
            return Message(request.kind | 0x80, request.sequence, bytes([Result.NOT_NOW]))
        if request.kind == Kind.CLEAR and not self.wrong.get("open"):
            self.state, self.faults = IDLE, 0
        if request.kind == Kind.IDENTIFY:
            self.state, self.sweeping_from = IDENTIFY, self.clock.now
        if self.state == IDENTIFY and self.clock.now > self.sweeping_from + self.wrong.get("sweep_s", 2.0):
            self.state, self.faults = self.wrong.get("end", (FAULT, Fault.IDENTIFY))
        if request.kind == Kind.STOP and self.state == IDENTIFY:
            self.state = IDLE
        windows = round(self.clock.now * self.wrong.get("rate", 5000.0))
        self.status = single_status(
            self.state, self.faults, windows, self.wrong.get("cycles", 300), self.wrong.get("offset", 0.004)
        )
        result = super().reply(request)
        if request.kind == Kind.IDENTITY:
            changed = {"protocol": 0, "build": 1, "count": 3}
            payload = bytearray(result.payload)
            for name, at in changed.items():
                payload[1 + at] = self.wrong.get(name, payload[1 + at])
            return Message(result.kind, result.sequence, bytes(payload))
        return result


@pytest.fixture
def bench(monkeypatch: pytest.MonkeyPatch, capsys):
    """Runs the self-test against a board with something wrong; returns exit code and the failed checks."""

    def go(*arguments: str, **wrong) -> tuple[int, list[str]]:
        clock = Clock()
        monkeypatch.setattr(actions, "time", clock)
        code = run(monkeypatch, Bench(clock, **wrong), "selftest", *arguments)
        lines = capsys.readouterr().out.splitlines()
        assert all(line.startswith(("pass  ", "FAIL  ", *actions.STEPS)) for line in lines), lines
        return code, [line.removeprefix("FAIL  ") for line in lines if line.startswith("FAIL")]

    return go


def test_a_sound_bench_passes_every_check(bench) -> None:
    assert bench() == bench(faults=0) == (0, [])


@pytest.mark.parametrize(
    ("wrong", "check"),
    [
        ({"protocol": PROTOCOL + 1}, "line: answers"),
        ({"count": 0}, "line: mode table"),
        ({"faults": Fault.CLOCK}, "line: clock, flash, supply: faults clock"),
        ({"offset": 0.02}, "rest: offset: 0.0200, allowed 0.01"),
        ({"offset": -0.02}, "rest: offset"),
        ({"offset": float("nan")}, "rest: offset: not finite"),
        ({"rate": 4444.0}, "rest: windows: 4444 per second"),
        ({"rate": 5200.0}, "rest: windows"),
        ({"end": (RUN, 0)}, "loopback: no resonance: ended in run"),
        ({"end": (IDLE, 0)}, "loopback: no resonance: ended in idle"),
        (
            {"end": (FAULT, Fault.IDENTIFY | Fault.SENSOR_CLIPPED)},
            "loopback: no resonance: ended in fault, faults sensor clipped, identify",
        ),
        ({"sweep_s": 99.0}, "loopback: no resonance: ended in identify"),
        ({"cycles": 361}, "cycles: fast interrupt: 361 cycles, allowed 360"),
        ({"cycles": 0}, "cycles: fast interrupt"),
    ],
)
def test_each_check_fails_on_what_it_is_for(bench, wrong: dict, check: str) -> None:
    code, failed = bench(**wrong)
    assert code == 4 and len(failed) == 1 and failed[0].startswith(check), failed


def test_one_step_alone_and_the_other_build(bench, capsys) -> None:
    assert bench("cycles", cycles=400) == (4, ["cycles: fast interrupt: 400 cycles, allowed 360 of 720"])
    assert bench("line", build=6) == (0, [])
    assert bench("rest", build=6)[0] == 4


@pytest.mark.parametrize("step", ["break1", "break2"])
def test_a_break_line_without_its_comparator_must_be_a_fault(bench, monkeypatch, step: str) -> None:
    """Clearing does not help while the line is open: the bench asserts it again."""
    assert bench(step, build=6, faults=Fault.BREAK, open=True) == (0, [])
    code, failed = bench(step, build=6, faults=Fault.BREAK)
    assert code == 4 and failed == [f"{step}: break: state idle, faults none"]
    assert bench(step)[0] == 4  # not a step of the one-mode build


def test_held_break_lines_must_let_the_board_rest(bench) -> None:
    assert bench("held", build=6, faults=Fault.BREAK) == (0, [])
    assert bench("held", build=6, faults=Fault.BREAK, open=True) == (4, ["held: held: state fault, faults break"])


def test_a_board_that_does_not_clear_fails_the_rest(monkeypatch: pytest.MonkeyPatch, capsys) -> None:
    monkeypatch.setattr(actions, "time", Clock())
    port = FakePort(lambda reply: refused(reply, Kind.CLEAR), single_status(FAULT, Fault.CLOCK))
    assert run(monkeypatch, port, "selftest", "rest") == 4
    assert "FAIL  rest: fault cleared: clear: refused in the present state" in capsys.readouterr().out


def test_the_wiring_is_asked_for_on_a_terminal(monkeypatch: pytest.MonkeyPatch, capsys) -> None:
    prompts = []
    monkeypatch.setattr("sys.stdin", Namespace(isatty=lambda: True))
    monkeypatch.setattr("builtins.input", lambda text: prompts.append(text))
    assert run(monkeypatch, FakePort(), "selftest", "line") == 0
    assert len(prompts) == 1 and "USB cable only" in capsys.readouterr().out


def test_a_lost_sensor_read_is_an_error_not_a_traceback() -> None:
    with pytest.raises(BoardError, match="no answer to status"):
        actions.keep_running(Client(FakePort(lambda reply: b"")), "start")


def test_a_fault_that_the_board_retries_is_not_the_end(monkeypatch: pytest.MonkeyPatch, capsys) -> None:
    """The client keeps in contact, until a fault stays."""
    monkeypatch.setattr(actions, "time", Clock())
    states = [single_status(RUN), *[single_status(FAULT, Fault.MISMATCH, flags=1 | 16)] * 3, single_status(RUN)]
    states.append(single_status(FAULT, Fault.MISMATCH))

    class Retrying(FakePort):
        def reply(self, request: Message) -> Message:
            self.status = states.pop(0)
            return super().reply(request)

    with pytest.raises(BoardError, match="start: ended with fault mismatch"):
        actions.keep_running(Client(Retrying()), "start")
    assert not states and capsys.readouterr().out.count("fault  ") == 4


def test_a_job_that_the_board_gave_up_is_an_error(monkeypatch: pytest.MonkeyPatch) -> None:
    """At rest and without a fault, but not as asked; the line says why."""
    port = FakePort(status=single_status(IDLE, first=Fault.MISMATCH, flags=1 | Flag.GAVE_UP))
    with pytest.raises(
        BoardError, match=r"^start: gave up, because every retry ended with mismatch: take the hand off"
    ):
        actions.keep_running(Client(port), "start")
    assert "state idle, gave up, because every retry" in describe(Client(port).status())


def test_a_board_that_takes_no_samples_ends_the_stream(monkeypatch: pytest.MonkeyPatch) -> None:
    class Full:
        def samples(self, factors: list[float]) -> int:
            return 0

        def status(self) -> types.SimpleNamespace:
            return types.SimpleNamespace(underruns=0)

    waited: list[float] = []
    monkeypatch.setattr(actions.time, "sleep", waited.append)
    monkeypatch.setattr(actions.time, "monotonic", lambda: sum(waited))
    with pytest.raises(BoardError, match="accepts no samples; 0 of 300 were played"):
        actions._give(Full(), [0.5] * 300, 1e-2)  # type: ignore[arg-type]
    assert sum(waited) >= 3 * actions.STORE * 1e-2
    assert max(waited) <= actions.LOOK_S  # the board takes half a second of silence for a lost line
