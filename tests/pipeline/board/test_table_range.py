"""A plate whose wanted mode no converter of the board can play: one line, and a study that goes on."""

from __future__ import annotations

from pathlib import Path

import pytest

from pipeline.board import export
from pipeline.board.table_file import Mode, ModeTable
from pipeline.errors import InputError


def test_a_mode_beyond_the_firmware_is_one_line_and_writes_nothing(tmp_path: Path) -> None:
    table = ModeTable(250e3, bytes(16), (Mode(120e3, 1e-3),))
    with pytest.raises(InputError, match=r"mode table: .*120000") as refused:
        export.write(table, tmp_path, "mode_table")
    assert len(refused.value.lines) == 1 and not list(tmp_path.iterdir())
