"""What the converters saw and were told comes over the line as it was, sample by sample, from both builds."""

from __future__ import annotations

import csv
import struct
from argparse import Namespace
from pathlib import Path

import numpy as np
import pytest

from firmware.client import actions
from firmware.client.client import BoardError, Client
from firmware.emulate.plant import Beam, Plate, Resonance, adc_code, adc_codes
from firmware.mode_table import Mode, ModeTable, Pattern, Shape, to_bytes
from firmware.protocol import Captured
from tests.helpers.fake_board import SIX_STATUS, FakePort, single_status

SINGLE = to_bytes(ModeTable(250e3, bytes(16), (Mode(31250.0, 3e-3, -0.75j, 9.3e-6, frequency_identified=True),)))
ROWS = tuple(tuple(0.5 * (i == j) for j in range(6)) for i in range(6))
SIX = to_bytes(ModeTable(40e3, bytes(16), (), shapes=(Shape(2400.0, 5e-3, (Pattern("all", (1,) * 6),), ROWS),)))
PLATE = Plate((Resonance(31250.0, 3e-3, 0.77),), delay_s=7.3e-6, noise=1e-2)


def taken(client: Client) -> np.ndarray:
    """All rows of a capture."""
    words: list[int] = []
    part = client.captured(0)
    while len(words) < part.total:
        part = client.captured(len(words))
        words += part.words
    return np.array(words).reshape(-1, part.row)


@pytest.fixture
def boards(make_image, core):
    pytest.importorskip("unicorn", reason="unicorn is not installed: pip install unicorn")
    from firmware.emulate.images import EmulatedPort, EmulatedSingle, EmulatedSix

    def make(variant: str):
        kind, table, world = (EmulatedSingle, SINGLE, PLATE) if variant == "single" else (EmulatedSix, SIX, Beam())
        board = kind(make_image(table, variant).elf, world)
        board.run(1e-3)
        board.app.base.confirmed = True
        return board, Client(EmulatedPort(board))

    return make


@pytest.mark.slow
@pytest.mark.parametrize("every", [1, 7])
def test_the_single_build_tells_codes_in_and_out(boards, every: int) -> None:
    board, client = boards("single")
    client.start(0.3)
    board.run(10e-3)
    seen, sense = [], board.sense

    def noted() -> float:
        level = sense()
        seen.append(adc_code(level))
        return level

    board.sense, board.codes = noted, []
    client.capture(every)
    rows = taken(client)
    assert rows.shape == (1024, 2) and len(set(rows[:, 1])) > 50
    inputs, outputs = np.array(seen), np.array([*board.codes[1:], board.dac.value & 0xFFF])
    starts = [at for at in range(every * 1200) if inputs[at] == rows[0, 0] and outputs[at] == rows[0, 1]]
    span = every * np.arange(1024)
    assert any((inputs[at + span] == rows[:, 0]).all() and (outputs[at + span] == rows[:, 1]).all() for at in starts)


def test_the_six_channel_build_tells_all_of_them(boards) -> None:
    board, client = boards("six")
    client.pattern(0, 0.1)
    board.run(50e-3)
    seen, sense = [], board.sense

    def noted() -> np.ndarray:
        levels = sense()
        seen.append(adc_codes(levels))
        return levels

    board.sense, board.history = noted, []
    client.capture(1)
    rows = taken(client)
    assert rows.shape == (170, 12)
    both = np.hstack([np.array(seen)[:-1], np.array(board.history)[1:]])
    assert any((both[at : at + 170] == rows).all() for at in range(len(both) - 170))


def test_a_capture_begun_anew_starts_at_its_beginning_and_times_out_of_range_are_refused(boards) -> None:
    board, client = boards("single")
    for every in (0, 250001, 2**32 - 1):
        with pytest.raises(BoardError, match="out of range"):
            client.capture(every)
    client.capture(250000)
    board.run(1e-3)
    assert client.captured(0).used == 2 and client.captured(2).words == ()
    client.capture(1)
    board.run(5e-3)
    part = client.captured(2000)
    assert (part.used, part.total, len(part.words)) == (2048, 2048, 48)
    assert client.captured(2**32 - 1).words == ()


def test_the_client_writes_them_into_a_file(boards, tmp_path: Path) -> None:
    _, client = boards("single")
    file = tmp_path / "capture.csv"
    said = actions.capture(client, Namespace(file=file, every=2))
    rows = list(csv.reader(file.open()))
    assert rows[0] == ["time_s", "input_1", "output_1"] and len(rows) == 1025
    assert float(rows[-1][0]) == pytest.approx(1023 * 8e-6, rel=1e-9) and {row[2] for row in rows[1:]} == {"2048"}
    assert "1024 rows, one every 8 us" in said


@pytest.mark.parametrize("metres", [0.0, 4e-6])
def test_a_capture_reads_micrometres_and_volts_where_the_table_has_metres(tmp_path: Path, metres: float) -> None:
    """A code of 3072 is half of full scale; the DAC's largest code is 1.65 V above its rest."""
    client, file = Client(FakePort(status=single_status(metres=metres))), tmp_path / "x.csv"
    client.captured = lambda start: Captured(4, 4, 2, (3072, 4095, 2048, 1)[start:])
    actions.capture(client, Namespace(file=file, every=1))
    head, *rows = csv.reader(file.open())
    assert head[3:] == (["input_1_um", "output_1_V"] if metres else [])
    shown = [[2.0, 1.65], [0.0, -1.65]] if metres else [[], []]
    assert [[float(value) for value in row[3:]] for row in rows] == shown
    assert [row[1:3] for row in rows] == [["3072", "4095"], ["2048", "1"]]


def test_six_captured_channels_have_micrometres_for_the_inputs_alone(tmp_path: Path) -> None:
    metric = SIX_STATUS[:28] + struct.pack("<f", 4e-6) + SIX_STATUS[32:]
    client, file = Client(FakePort(status=metric)), tmp_path / "x.csv"
    client.captured = lambda start: Captured(12, 12, 12, (*[1024] * 6, *[1125] * 6)[start:])
    actions.capture(client, Namespace(file=file, every=1))
    head, row = csv.reader(file.open())
    assert head[13:] == [f"input_{i}_um" for i in range(1, 7)] and [float(value) for value in row[13:]] == [-2.0] * 6


def test_a_capture_that_stands_still_is_told(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(actions, "CAPTURE_S", 0.05)
    client = Client(FakePort())
    client.captured = lambda start: Captured(2, 2048, 2, (2048, 2048)[start:])
    with pytest.raises(BoardError, match="stalled at 2 of 2048"):
        actions.capture(client, Namespace(file=tmp_path / "x.csv", every=1))
    assert not (tmp_path / "x.csv").exists()
