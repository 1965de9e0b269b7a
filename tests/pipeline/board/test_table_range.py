"""A plate whose target mode no converter of the board can play: one line, and a study that goes on."""

from __future__ import annotations

from pathlib import Path

import pytest

from firmware.mode_table import Mode, ModeTable
from pipeline.board import export
from pipeline.errors import InputError


@pytest.mark.parametrize(("frequency_hz", "words"), [(120e3, "120000"), (1999.0, "a mode of 1999 Hz")])
def test_a_mode_beyond_the_firmware_is_one_line_and_writes_nothing(
    tmp_path: Path, frequency_hz: float, words: str
) -> None:
    table = ModeTable(250e3, bytes(16), (Mode(frequency_hz, 1e-3),))
    with pytest.raises(InputError, match=f"mode table: .*{words}") as refused:
        export.write(table, tmp_path, "mode_table")
    assert len(refused.value.lines) == 1 and not list(tmp_path.iterdir())
