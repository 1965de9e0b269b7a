"""What the board has measured outlives a reset, for the table it was measured with and no other."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from firmware.emulate.plant import Plate, Resonance
from firmware.mode_table import Mode, ModeTable, Pattern, Shape, hold, to_bytes
from firmware.protocol import IDENTIFY, KEPT, RUN

TRUE, TAU = 31437.3, 300.0 / math.pi / 31437.3
DROOP = abs(hold(TRUE, 250e3))
PLATE = Plate((Resonance(TRUE, TAU, 0.8),), delay_s=7.3e-6, noise=1e-3)
GUESS = Mode.from_quality_factor(31400.0, 260.0, delay_s=2e-6)
UNKNOWN = to_bytes(ModeTable(250e3, bytes(16), (GUESS,)))
OTHER = to_bytes(ModeTable(250e3, bytes(16), (replace(GUESS, drive_limit=0.5),)))
EMPTY, REFUSED, READ, WRITTEN = range(1, 5)


class Backup:
    """Memory that a reset leaves alone, and what the main loop remembers of it."""

    def __init__(self, core) -> None:
        self.memory = core.ffi.new("uint8_t []", core.lib.AN_SLOTS * core.lib.AN_KEEP_BYTES)
        self.fresh = lambda: core.ffi.new("an_keeping *")
        self.keeping = self.fresh()

    def serve(self, board) -> int:
        board.lib.an_application_keep(board.base, board.build, self.memory, self.keeping)
        return int(self.keeping.state)

    def after_reset(self, board) -> int:
        self.keeping, board.app.base.measured = self.fresh(), 0
        return self.serve(board)


@pytest.fixture
def rig(core):
    from tests.helpers.hosted_boards import Rig

    def make(table: bytes):
        made = Rig(table, PLATE)
        made.run(1e-3)
        return made

    return make


def test_what_was_identified_is_used_again_after_a_reset(core, rig) -> None:
    backup, first = Backup(core), rig(UNKNOWN)
    assert backup.serve(first) == EMPTY
    assert first.start()
    first.run_while(IDENTIFY, 4.0)
    assert first.state == RUN and backup.serve(first) == WRITTEN  # though it drives
    second = rig(UNKNOWN)
    assert backup.after_reset(second) == READ
    assert second.app.centre == first.app.centre and second.app.neighbour == first.app.neighbour
    kept, result = (core.ffi.buffer(core.ffi.addressof(one.app, "mode")) for one in (second, first))
    assert bytes(kept) == bytes(result)
    assert second.start() and second.state == RUN
    second.run(50e-3)
    assert second.state == RUN
    assert abs(second.windows(5e-3)["measured"]).mean() == pytest.approx(0.2 * 0.8 * DROOP, rel=0.02)


def test_values_of_another_table_are_refused(core, rig) -> None:
    backup, first = Backup(core), rig(UNKNOWN)
    first.app.base.measured += 1
    assert backup.serve(first) == WRITTEN
    other = rig(OTHER)
    assert backup.after_reset(other) == REFUSED
    assert other.start() and other.state == IDENTIFY
    assert backup.after_reset(rig(UNKNOWN)) == READ  # they are still there


def test_a_board_without_backup_measures_anew(core, rig) -> None:
    board, keeping = rig(UNKNOWN), core.ffi.new("an_keeping *")
    board.app.base.measured += 1
    core.lib.an_application_keep(board.base, board.build, core.ffi.NULL, keeping)
    assert keeping.state == core.lib.AN_KEEP_NONE and "no backup" in KEPT[keeping.state]
    assert board.start() and board.state == IDENTIFY


def test_no_damaged_bit_is_believed(core, rig) -> None:
    backup, board = Backup(core), rig(UNKNOWN)
    board.app.base.measured += 1
    backup.serve(board)
    for bit in range(8 * (core.lib.AN_KEEP_HEADER_BYTES + 24)):
        backup.memory[bit // 8] ^= 1 << bit % 8
        assert backup.after_reset(board) == EMPTY, bit
        backup.memory[bit // 8] ^= 1 << bit % 8
    assert backup.after_reset(board) == READ


def test_each_shape_has_its_own_matrix(core) -> None:
    from firmware.emulate.plant import Beam
    from tests.helpers.hosted_boards import HostedSix

    patterns = (Pattern("all", (1,) * 6),)
    table = to_bytes(ModeTable(40e3, bytes(16), (), shapes=tuple(Shape(f, 5e-3, patterns) for f in (2400.0, 1400.0))))
    backup, matrix = Backup(core), np.eye(6) + 0.2
    board = HostedSix(table, Beam())
    board.run(5e-3)
    for i, value in enumerate(matrix.ravel()):
        board.app.shaping.matrix[i].re = value
    board.app.base.measured += 1
    assert backup.serve(board) == WRITTEN
    again = HostedSix(table, Beam())
    again.run(5e-3)
    assert backup.after_reset(again) == READ and again.app.identified
    inverse = np.array([complex(z.re, z.im) for z in again.app.shaping.inverse]).reshape(6, 6)
    assert np.abs(inverse - np.linalg.inv(matrix)).max() < 1e-5
    assert again.lib.an_six_choose(again.app, 1) and not again.app.identified
    again.run(5e-3)
    assert backup.serve(again) == EMPTY and not again.app.identified
    room = core.lib.AN_KEEP_BYTES
    backup.memory[room : 2 * room] = backup.memory[0:room]
    assert backup.after_reset(again) == REFUSED and not again.app.identified  # they are another shape's
    assert again.lib.an_six_choose(again.app, 0)
    again.run(5e-3)
    assert backup.serve(again) == READ and again.app.identified


def test_the_image_keeps_them_and_says_so(make_image, core) -> None:
    """Values put where an identification would: the next start of the same image has them; an upload ends that."""
    pytest.importorskip("unicorn", reason="unicorn is not installed: pip install unicorn")
    from firmware.client.client import Client, describe_health
    from firmware.emulate.images import EmulatedPort, EmulatedSingle

    for has_backup in (True, False):
        board = EmulatedSingle(make_image(UNKNOWN).elf, PLATE, has_backup=has_backup)
        board.run(1e-3)
        client = Client(EmulatedPort(board))
        assert client.health().kept == (EMPTY if has_backup else 0) and not client.status().identified
        board.app.mode.gain.im, board.app.mode.tau_s = -0.6, 2.5e-3
        board.app.base.measured += 1
        board.run(1e-3)
        assert client.health().kept == (WRITTEN if has_backup else 0)
        board.reset()
        board.run(1e-3)
        status = client.status()
        assert status.identified == has_backup
        if has_backup:
            assert status.gain.imag == pytest.approx(-0.6) and status.tau_s == pytest.approx(2.5e-3)
            assert "in use again" in describe_health(client.health())
            client.upload(OTHER)
            assert client.health().kept == REFUSED and not client.status().identified
        else:
            assert "no backup memory" in describe_health(client.health())


def test_what_belongs_to_no_slot_is_written_nowhere(core, rig) -> None:
    backup, board = Backup(core), rig(UNKNOWN)
    board.app.base.slot, board.app.base.measured = core.lib.AN_SLOTS, 1
    assert backup.serve(board) == 0 and not any(backup.memory)
