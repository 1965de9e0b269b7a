"""The board's own code, run on the emulated chip: how much of it some starts, faults and requests reach."""

from __future__ import annotations

import struct

import numpy as np
import pytest

from firmware import build as builder
from firmware.client.client import BoardError, Client
from firmware.emulate.plant import Beam, Plate, Resonance
from firmware.mode_table import Mode, ModeTable, Pattern, Shape, header_text, to_bytes
from firmware.protocol import Kind

FLOOR = 0.75
SINGLE = to_bytes(ModeTable(250e3, bytes(16), (Mode(31437.3, 3e-3, -0.8j, 9.3e-6, frequency_identified=True),)))
ROWS = tuple(tuple(complex(z) for z in row) for row in 0.5 * np.eye(6))
SIX = to_bytes(ModeTable(40e3, bytes(16), (), shapes=(Shape(2400.0, 5e-3, (Pattern("all", (1,) * 6),), ROWS),)))
PLATE = Plate((Resonance(31437.3, 3e-3, 0.8),), delay_s=7.3e-6)


@pytest.fixture
def visit(tmp_path, monkeypatch, core):
    """Boards of a build whose branches are recorded from their first start on; without unrolled loops, whose copies are no
    branches of the source."""
    pytest.importorskip("unicorn", reason="unicorn is not installed: pip install unicorn")
    from firmware.emulate.images import EmulatedPort, EmulatedSingle, EmulatedSix
    from firmware.image import Elf
    from tests.helpers.board_probes import BranchRecorder, routines_of_the_board

    monkeypatch.setattr(builder, "LANGUAGE", (*builder.LANGUAGE, "-fno-unroll-loops"))
    monkeypatch.setattr("firmware.client.client.BUSY_S", 60.0)  # a recorded board is slow, and its log fills the line

    def make(variant: str):
        table = SINGLE if variant == "single" else SIX
        try:
            builder.toolchain()
        except builder.BuildError as missing:
            pytest.skip(str(missing))
        image = builder.build(table, tmp_path, variant).elf
        recorder = BranchRecorder(Elf.read(image), routines_of_the_board(header_text(table), variant))

        def start(**options):
            kind, world = (EmulatedSingle, PLATE) if variant == "single" else (EmulatedSix, Beam())
            board = kind(image, world, **options)
            recorder.watch(board)
            board.reset()
            board.run(1e-3)
            return board, Client(EmulatedPort(board), attempts=1)

        return recorder, start, table

    return make


@pytest.mark.slow
@pytest.mark.parametrize("variant", ["single", "six"])
def test_most_branches_of_the_board_are_taken(visit, variant: str) -> None:
    from tests.helpers.board_probes import lose_stack, overrun, push_button

    recorder, start, table = visit(variant)
    for dead in ({"dead_crystal": True}, {"dead_pll": True}, {"overdrive": 0}, {"overdrive": 1 << 16}):
        start(**dead)
    board, client = start()
    board.run(22e-3)
    push_button(board)
    board.word(board.symbol("count")).value = 24990  # looks of the guard: a second is over soon
    client.health()
    client.request(Kind.LOG, struct.pack("<I", 1))
    board.run(5e-3)
    push_button(board)
    board.word(0x40007004).value |= 1 << 2
    board.run(1e-3)
    board.word(0x40007004).value &= ~(1 << 2)
    push_button(board)
    client.request(Kind.STOP)
    board.send(bytes(300))
    if variant == "six":
        board.pull_break(0x40010400)
        board.run(1e-3)
        overrun(board)
        board.run(1e-3)
    board.word(0x40012000).value |= 1 << 5
    board.run(1e-3)
    client.upload(table)
    board.flash.broken = True
    with pytest.raises(BoardError):
        client.upload(table)
    board.fast_lost = True
    board.run(1e-3)
    board.interrupt_unexpectedly()
    board.run_until(lambda: board.resets == 1, 0.05)
    lose_stack(board)
    assert board.run_until(lambda: board.resets == 2, 0.05)
    assert recorder.share >= FLOOR, sorted(hex(at) for at, _ in recorder.ways - recorder.gone)
