"""The mode followed along a sweep, from records alone: the table says where it went and where it was lost."""

from __future__ import annotations

from pathlib import Path

import pytest

from pipeline.questions import study as asked
from pipeline.questions.modes import ShapesResult
from pipeline.records import tables
from pipeline.records.study import StoredCase, StoredStudy
from tests.helpers import synthetic


def case(pitch: float, shapes: list[list[float]], target: int, mac: float, rows: int = 1) -> StoredCase:
    """A record with modes at 30, 31, ... kHz."""
    tones = [30e3 + 1e3 * i for i in range(len(shapes))]
    modes = synthetic.modes(synthetic.target(12.0, tones[target], mac=mac, share=mac))
    stored = ShapesResult(target=target, frequency_hz=tones, share=[0.9] * len(shapes), coefficients=shapes)
    sweep = {"array.pitch_mm": pitch, "array.rows": rows}
    return synthetic.case(f"p{pitch}r{rows}", sweep, modes=modes, shapes=stored)


def study(*cases: StoredCase) -> StoredStudy:
    return StoredStudy(Path("study"), {"name": "study"}, cases)


def table(study: StoredStudy) -> list[str]:
    return tables.table_bytes(study, asked.columns_of(study)).decode().splitlines()


FIRST, SECOND, MIXED = [1.0, 0.0], [0.0, 1.0], [0.7, 0.714]


def test_a_crossing_is_told_and_the_line_starts_where_the_mode_is_plainest() -> None:
    result = tables.along_sweep(
        study(
            case(4, [FIRST, SECOND], 0, 0.98),
            case(5, [SECOND, FIRST], 1, 0.9),
            case(6, [SECOND, [0.95, 0.1]], 0, 0.6),  # looks most like the target shape, yet is another mode
        )
    )
    assert [result[name].tracking for name in ("p4r1", "p5r1", "p6r1")] == ["start", "kept", "crossed"]
    assert result["p6r1"].frequency_hz == 31e3
    assert result["p4r1"].mac is None


def test_beyond_a_mixture_the_identity_stays_lost() -> None:
    mixed = case(5, [MIXED, [-0.714, 0.7]], 0, 0.5)
    result = tables.along_sweep(study(case(4, [FIRST, SECOND], 0, 0.98), mixed, case(6, [FIRST, SECOND], 0, 0.9)))
    assert [result[name].tracking for name in ("p5r1", "p6r1")] == ["lost", "lost"]
    assert result["p5r1"].mac == pytest.approx(0.49, abs=0.02)
    assert result["p6r1"].frequency_hz is None


def test_both_ways_from_the_start_and_line_by_line() -> None:
    shapes = [FIRST, SECOND]
    cases = [case(p, shapes, 0, 0.99 if p == 5 else 0.8, rows) for rows in (1, 2) for p in (4, 5, 6)]
    result = tables.along_sweep(study(*cases))
    assert [result[c.case_id].tracking for c in cases] == ["kept", "start", "kept"] * 2


def test_the_table_carries_it_and_a_single_case_has_no_such_columns() -> None:
    line = study(case(4, [FIRST, SECOND], 0, 0.98), case(5, [FIRST, SECOND], 0, 0.9))
    header, *rows = table(line)
    assert "tracked_hz,tracked_mac,tracking" in header
    assert "30000.0,1.0,kept" in rows[1]
    assert "tracking" not in table(study(line.cases[0]))[0]


def test_the_case_that_is_computed_once_is_no_part_of_the_sweep() -> None:
    base = case(4, [FIRST, SECOND], 0, 0.99)
    once = StoredCase(Path("base"), base.record.model_copy(update={"case_id": "base", "sweep": {}}))
    result = tables.along_sweep(study(once, case(4, [FIRST, SECOND], 0, 0.98), case(5, [FIRST, SECOND], 0, 0.9)))
    assert [result[name].tracking for name in ("p4r1", "p5r1")] == ["start", "kept"]
    assert "base" not in result
