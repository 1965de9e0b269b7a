"""The measure board: the case's table on the emulated board, its record and arrays, and what happens when it cannot be."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from firmware import emulate
from firmware.build import BuildError, toolchain
from firmware.mode_table import Mode, ModeTable, from_bytes, to_bytes
from pipeline.batch import case_study
from pipeline.batch.study_file import load_study
from pipeline.board.export import table_of
from pipeline.case.model import load_case
from pipeline.errors import InputError
from pipeline.logs import RunLog
from pipeline.paths import ROOT
from pipeline.questions import board
from pipeline.questions.board import Board, BoardResult
from pipeline.questions.question import Run, Unanswered, ask
from tests.helpers import synthetic
from tests.helpers.recording_log import RecordingLog
from tests.helpers.scenes import three_patches

CASE = three_patches((20.0, 40.0), 0.05)


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    table = ModeTable(250e3, bytes(16), (Mode.from_quality_factor(31e3, 300.0),))
    (tmp_path / board.TABLE).write_bytes(to_bytes(table))
    (tmp_path / "small.toml").write_text(CASE)
    return tmp_path


PLAYED = """
name = "played"
material = "aluminium"
plate = { thickness_mm = 2.0 }
zone = { length_mm = 40.0, width_mm = 20.0, nodal_lines = 3 }
pillar = { side_mm = 2.0, height_mm = 6.3 }
array = { pitch_mm = 4.0, rows = 1, extension_mm = 12.0 }
patches = { material = "pz26", size_mm = [8.0, 3.0, 0.3], sensors = [2] }
solve = { band_kHz = [30.0, 40.0], accuracy = 0.05 }
"""


def study(folder: Path, measure: str, text: str = CASE):
    (folder / "small.toml").write_text(text)
    (folder / "one.toml").write_text(f'[study]\nname = "one"\ncase = "small.toml"\nmeasure = {measure}\n')
    return load_study(folder / "one.toml")


def a_run(overshoot: float = 0.01) -> emulate.BoardRun:
    time = 2e-4 * np.arange(-10, 50)
    size = np.where(time < 0.0, 0.0, 0.1 * (1.0 - np.exp(-time / 5e-4)))
    size[-1] = 0.1 * (1.0 + overshoot)
    columns = {
        "time_s": time,
        "reference": 0.1 * (time >= 0.0),
        "u_d": size,
        "u_q": 0.0 * time,
        "drive": 0.2 + 0.0 * time,
    }
    return emulate.BoardRun(columns, True, 31e3, 3e-3, -0.5j, 2e-6, "zig cc")


def played(folder: Path, log: RecordingLog) -> tuple[BoardResult, dict[str, Any]]:
    """The answer of the board to a case with a target mode, and its arrays."""
    run = Run(log, folder=folder)
    run.found["modes"] = synthetic.modes(synthetic.target(12.0))
    return ask(load_case(str(folder / "small.toml"), []), Board(), run), run.arrays


def test_record_and_arrays(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(emulate, "board_run", lambda table: a_run())
    text = RecordingLog()
    record, arrays = played(folder, text)
    assert record.swept and record.gain == [0.0, -0.5]
    assert record.overshoot == pytest.approx(0.01) and record.reference == 0.1
    # 95 % of 1 - exp(-t/0.5 ms) is passed at 1.498 ms, by the window that begins at 1.6 and stands for 0.108 ms later
    assert record.t95_s == pytest.approx(1.6e-3 + 0.108e-3)
    assert set(arrays) == {f"board_{name}" for name in board.COLUMNS}
    assert "identified" in text.facts[-1] and "1.71 ms" in text.facts[-1]


def test_a_step_that_is_never_reached_says_so(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    run = a_run()
    run.columns["u_d"] *= 0.5
    monkeypatch.setattr(emulate, "board_run", lambda table: run)
    record, _ = played(folder, text := RecordingLog())
    assert record.t95_s is None and "not reached" in text.facts[-1]


def test_what_is_not_installed_is_left_out_and_a_fault_is_told(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def fails(error: Exception):
        def run(table: bytes) -> emulate.BoardRun:
            raise error

        return run

    text = RecordingLog()
    monkeypatch.setattr(emulate, "board_run", fails(BuildError("no compiler", 5)))
    with pytest.raises(Unanswered, match="no compiler"):
        played(folder, text)
    monkeypatch.setattr(emulate, "board_run", fails(emulate.EmulationError("identify")))
    assert played(folder, text) == (BoardResult(fault="identify"), {}) and "BOARD" in text.warnings
    monkeypatch.setattr(emulate, "board_run", fails(BuildError("the compiler refused", 3)))
    with pytest.raises(BuildError):
        played(folder, text)


def test_neighbours_that_the_firmware_cannot_play_are_left_out_of_the_table() -> None:
    """A target mode that it cannot play stays, to be refused by name."""
    case = load_case(ROOT / "examples" / "small.toml")
    table = table_of(case, [10.0, 30e3, 40e3, 99e3, 102e3], [300.0] * 5, 1)
    assert [mode.frequency_hz for mode in table.modes] == [30e3, 40e3, 99e3] and table.target == 0
    assert table_of(case, [30e3, 102e3], [300.0] * 2, 1).modes[1].frequency_hz == 102e3


def test_a_case_without_a_mode_table_is_left_out_by_name(folder: Path) -> None:
    (folder / board.TABLE).unlink()
    with pytest.raises(Unanswered, match="firmware cannot play the target mode"):
        played(folder, RecordingLog())


def test_the_board_needs_the_modes_and_depends_on_the_firmware(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="add modes to measure"):
        case_study.jobs_of(study(tmp_path, '["bands", "board"]'))
    with_board, without = (
        case_study.jobs_of(study(tmp_path, m))[0].payload for m in ('["modes", "board"]', '["modes"]')
    )
    assert with_board["firmware"] == board.sources_hash() and "firmware" not in without


@pytest.mark.slow
def test_a_case_with_patches_is_played_with_its_computed_gain(tmp_path: Path) -> None:
    pytest.importorskip("unicorn", reason="unicorn is not installed: pip install unicorn")
    pytest.importorskip("cffi", reason="cffi is not installed: pip install cffi")
    try:
        toolchain()
    except BuildError as missing:
        pytest.skip(str(missing))
    one = study(tmp_path, '["modes", "response", "board"]', PLAYED)  # its target mode lies at 34 kHz
    job = case_study.jobs_of(one)[0]
    with RunLog(tmp_path / "run.mess") as log:
        record = case_study.compute(str(one.case_path), job.payload, tmp_path, log)
    table = from_bytes((tmp_path / board.TABLE).read_bytes())
    gain = table.modes[table.target].gain
    assert gain is not None
    result = record["board"]
    assert result.swept and result.frequency_hz == pytest.approx(
        1.002 * table.modes[table.target].frequency_hz, abs=0.1
    )
    assert abs(complex(*result.gain)) == pytest.approx(abs(gain), rel=5e-3)
