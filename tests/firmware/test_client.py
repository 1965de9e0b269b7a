"""The client's command line, its serial port replaced by one that leads to an emulated board."""

from __future__ import annotations

import argparse
import csv
import math
import sys
import types
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import pytest

from firmware.client import actions, client, command_line, identify
from firmware.emulate.images import EmulatedPort
from firmware.emulate.plant import Plate, Resonance
from firmware.mode_table import Mode, ModeTable, to_bytes
from firmware.protocol import PROTOCOL, RUN
from tests.helpers.fake_board import write_sound

MODE = Mode(31250.0, 3e-3, -0.75j, 9.3e-6, frequency_identified=True)
MODE_40K = Mode(3e3, 3e-3)
TABLE = to_bytes(ModeTable(250e3, bytes(16), (MODE,)))
PLATE = Plate((Resonance(31250.0, 3e-3, 0.77),), delay_s=7.3e-6)


def plug(monkeypatch: pytest.MonkeyPatch, image: Path, plate: Plate):
    """An emulated board on the port COM7."""
    pytest.importorskip("unicorn", reason="unicorn is not installed: pip install unicorn")
    from firmware.emulate.images import EmulatedSingle

    made = EmulatedSingle(image, plate)
    made.run(1e-3)

    class Serial(EmulatedPort):
        def __init__(self, port: str, baud: int, timeout: float, write_timeout: float) -> None:
            assert (port, baud) == ("COM7", 921600) and 0.0 < timeout < 0.1 and write_timeout > 0.0
            super().__init__(made)

        @property
        def in_waiting(self) -> int:
            return len(made.received)

        def close(self) -> None: ...

    fake = types.ModuleType("serial")
    fake.Serial, fake.SerialException = Serial, OSError  # type: ignore[attr-defined]
    monkeypatch.setitem(sys.modules, "serial", fake)
    return made


@pytest.fixture
def board(make_image, core, monkeypatch: pytest.MonkeyPatch):
    return plug(monkeypatch, make_image(TABLE).elf, PLATE)


def test_status_is_printed(board, capsys) -> None:
    assert command_line.main(["COM7", "status"]) == 0
    text = capsys.readouterr().out
    assert "state idle" in text and "mode 31250.000 Hz, tau 3 ms, gain 0.75, delay 9.3 us" in text


def test_upload_changes_the_mode(board, capsys, tmp_path: Path) -> None:
    other = to_bytes(ModeTable(250e3, bytes(16), (Mode(30500.0, 3e-3),)))
    (tmp_path / "table.bin").write_bytes(other)
    assert command_line.main(["COM7", "upload", str(tmp_path / "table.bin")]) == 0
    assert "mode 30500.000 Hz" in capsys.readouterr().out
    assert bytes(board.sector[: len(other)]) == other


def test_upload_with_another_drive_limit(board, capsys, tmp_path: Path) -> None:
    (tmp_path / "table.bin").write_bytes(TABLE)
    assert command_line.main(["COM7", "upload", str(tmp_path / "table.bin"), "0.1"]) == 0
    assert math.isclose(board.app.mode.drive_limit, 0.1, rel_tol=1e-6)
    with pytest.raises(SystemExit):
        command_line.main(["COM7", "upload", str(tmp_path / "table.bin"), "1.5"])
    assert "'1.5': must be a number from 0.001 to 1" in capsys.readouterr().err


def test_a_drive_limit_reaches_every_mode_and_shape(tmp_path: Path) -> None:
    from firmware.mode_table import Pattern, Shape, from_bytes

    shape = Shape(2e3, 1e-2, (Pattern("all", (1.0,)),))
    table = ModeTable(40e3, bytes(16), (MODE_40K, MODE_40K), shapes=(shape,))
    (tmp_path / "table.bin").write_bytes(to_bytes(table))
    text = argparse.Namespace(file=tmp_path / "table.bin", drive_limit=0.25, sensor_volts=0.33)
    changed = from_bytes(command_line.table_of(text))
    assert {mode.drive_limit for mode in changed.modes} == {shape.drive_limit for shape in changed.shapes} == {0.25}
    assert changed.sensor_volts == pytest.approx(0.33)
    changed = replace(changed, sensor_volts=table.sensor_volts)
    one = replace(changed, modes=tuple(replace(mode, drive_limit=1.0) for mode in changed.modes))
    whole = replace(one, shapes=tuple(replace(shape, drive_limit=1.0) for shape in one.shapes))
    assert to_bytes(whole) == to_bytes(table)


def test_refusals_are_one_line_and_an_exit_code(board, capsys, tmp_path: Path) -> None:
    assert command_line.main(["COM7", "reference", "0.1"]) == 3
    assert command_line.main(["COM7", "upload", str(tmp_path / "none.bin")]) == 2
    error = capsys.readouterr().err.splitlines()
    assert len(error) == 2 and "refused in the present state" in error[0] and "none.bin" in error[1]


def test_texture_and_stop(board, capsys) -> None:
    assert command_line.main(["COM7", "sine", "50", "0.5"]) == 0
    texture = board.app.base.texture
    assert texture.depth == 0.5 and math.isclose(texture.step / 2**32 * 5000.0, 50.0, rel_tol=1e-6)
    assert command_line.main(["COM7", "stop"]) == 0


def test_the_log_of_a_running_board(board, capsys, tmp_path: Path) -> None:
    """Windows come evenly, and the last ones hold what was asked for."""
    talk = client.Client(EmulatedPort(board))
    talk.start(0.05)
    board.run(0.05)
    file = tmp_path / "log.csv"
    assert command_line.main(["COM7", "log", str(file), "--every", "5", "--seconds", "0.5"]) == 0
    rows = [{name: float(value) for name, value in row.items()} for row in csv.DictReader(file.open())]
    assert len(rows) >= 4 and "lost" not in capsys.readouterr().out
    assert {after["window"] - before["window"] for before, after in pairwise(rows)} == {5.0}
    assert math.hypot(rows[-1]["measured_d"], rows[-1]["measured_q"]) == pytest.approx(0.05, rel=0.02)
    assert rows[-1]["reference"] == pytest.approx(0.05) and talk.status().state == "run"


@pytest.mark.slow
def test_a_sound_reaches_the_board_in_time(board, capsys, tmp_path: Path) -> None:
    write_sound(tmp_path / "a.wav", [64] * 300, width=1)
    assert command_line.main(["COM7", "stream", str(tmp_path / "a.wav"), "0.05"]) == 0
    out = capsys.readouterr().out
    assert "300 samples at 2500 Hz\n" in out
    texture = board.app.base.texture
    assert texture.kind == 0 and texture.given == 300 and set(texture.samples) == {round(64 / 255 * 65535)}


def test_identity_and_health_are_told(board, capsys) -> None:
    assert command_line.main(["COM7", "identity"]) == 0
    assert f"build single, protocol {PROTOCOL}, table version 2: 1 modes" in capsys.readouterr().out
    assert command_line.main(["COM7", "health"]) == 0
    out = capsys.readouterr().out
    assert "clock 180 MHz, consecutive watchdog resets 0" in out and "exception" not in out


@pytest.mark.slow
def test_one_command_takes_a_blank_board_to_a_held_plate(make_image, core, capsys, tmp_path: Path, monkeypatch) -> None:
    """The image itself, with a table 3 % off and without any measured value: chirps, fit, gains, picture, check, hold."""
    plate = Resonance(31437.3, 1000.0 / (math.pi * 31437.3), 0.8)
    blank = to_bytes(ModeTable(250e3, bytes(16), (Mode(31437.3 / 1.03, 3e-3),)))
    board = plug(monkeypatch, make_image(blank).elf, Plate((plate,), delay_s=7.3e-6, noise=1e-3))
    monkeypatch.setattr(actions, "keep_running", lambda talk, action: _hold(board, talk))
    clock = types.SimpleNamespace(monotonic=lambda: board.time_s, sleep=board.run)
    monkeypatch.setattr(identify, "time", clock)
    assert command_line.main(["COM7", "identify", "0.1", "--plot", str(tmp_path / "plate.png")]) == 0
    out = capsys.readouterr().out
    assert "mode 31437.3" in out and "fit of 1 mode" in out and "phase margin 7" in out
    assert (tmp_path / "plate.png").read_bytes()[:4] == b"\x89PNG"
    assert board.state == RUN and board.faults == 0 and board.app.base.measured == 1
    assert abs(board.app.slow.pi.measured.re) == pytest.approx(0.1, rel=0.01)
    assert board.time_s < 10.0


def _hold(board, talk) -> None:
    for _ in range(3):
        board.run(0.1)
        talk.status()


def test_identify_measures_again_until_it_is_stopped(board) -> None:
    talk = client.Client(EmulatedPort(board))
    talk.identify()
    assert talk.drives and talk.status().state == "identify"
    talk.stop()
    board.run(5e-3)
    assert not talk.drives and talk.status().state == "idle"


@pytest.mark.slow
def test_the_selftest_of_an_emulated_bench(board, capsys, monkeypatch: pytest.MonkeyPatch) -> None:
    """The board's own clock stands for the host's; cycles are not counted there."""
    monkeypatch.setattr(actions, "time", types.SimpleNamespace(monotonic=lambda: board.time_s, sleep=board.run))
    monkeypatch.setattr(actions, "RATE_S", 0.04)
    assert command_line.main(["COM7", "selftest", "line"]) == 0
    assert command_line.main(["COM7", "selftest", "rest"]) == 0
    out = capsys.readouterr().out
    assert out.count("pass  line") == 3 and out.count("pass  rest") == 3 and "FAIL" not in out


def test_missing_values_are_named(capsys) -> None:
    with pytest.raises(SystemExit) as raised:
        command_line.main(["COM7", "sine", "50"])
    assert raised.value.code == 2 and "required: DEPTH" in capsys.readouterr().err


def test_without_pyserial_the_way_to_get_it_is_said(capsys, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "serial", None)
    assert command_line.main(["COM7", "status"]) == 5
    assert "pip install pyserial" in capsys.readouterr().err


def test_without_cobs_the_way_to_get_it_is_said(board, capsys, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(client, "find_spec", lambda name: None)
    assert command_line.main(["COM7", "status"]) == 5
    assert "pip install cobs" in capsys.readouterr().err
