"""A few hundred damaged inputs, and all that once failed, are read or refused in one line for each fault."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from pipeline.errors import InputError
from tests.fuzz import run as fuzz
from tests.fuzz.files import STUDY, TABLE
from tests.helpers.fake_board import STATUS

KEPT = sorted(path for path in fuzz.CORPUS.rglob("*") if path.is_file())
MOSTLY_REFUSED = ("record", "record_file", "reply", "table", "universal", "study", "solve")


def test_five_hundred_damaged_inputs_are_read_or_refused(tmp_path: Path, capfd: Any) -> None:
    failures: list[str] = []
    result = fuzz.run(tmp_path, 499, 1, tell=failures.append)
    assert failures == []
    assert sum(sum(counts.values()) for counts in result.values()) >= 499
    assert all(counts["refused"] > 0 for name, counts in result.items() if name != "solve"), result
    assert all(counts["read"] > 0 for name, counts in result.items() if name not in MOSTLY_REFUSED), result
    assert "Traceback" not in "".join(capfd.readouterr())


def test_what_is_drawn_whole_is_read(tmp_path: Path) -> None:
    """The readers refuse damage, not everything."""
    table = fuzz.kinds(tmp_path)
    record = (tmp_path / "rows" / "pitch_mm=4,rows=1" / "record.json").read_bytes()
    universal = (tmp_path / "whole.uff").read_bytes()
    whole = {"record_file": record, "record": record, "study": STUDY.encode(), "universal": universal, "table": TABLE}
    whole["reply"] = b"\0\1\0" + STATUS
    for name, data in whole.items():
        assert fuzz.outcome(table[name], data) == "read", name


@pytest.mark.parametrize("path", KEPT, ids=lambda path: f"{path.parent.name}-{path.name}")
def test_what_once_failed_is_read_or_refused(path: Path, tmp_path: Path) -> None:
    assert fuzz.outcome(fuzz.kinds(tmp_path)[path.parent.name], path.read_bytes()) in ("read", "refused")


@pytest.mark.slow
def test_ten_thousand_damaged_inputs(tmp_path: Path) -> None:
    failures: list[str] = []
    result = fuzz.run(tmp_path, 10_000, 1_000_000, tell=failures.append)
    assert failures == []
    assert result["solve"]["read"] > result["solve"]["refused"]


def test_a_reader_that_lets_an_exception_through_is_caught_and_kept(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fails(data: bytes) -> None:
        raise TypeError("unhashable")

    def refuses(data: bytes) -> None:
        raise InputError("one line")

    def says_nothing(data: bytes) -> None:
        raise InputError([])

    table = {"quantity": fuzz.Kind(lambda draw: b"%d" % draw.randrange(9), fails)}
    monkeypatch.setattr(fuzz, "kinds", lambda folder: table)
    monkeypatch.setattr(fuzz, "amounts", lambda count: {"quantity": 1})
    lines: list[str] = []
    assert fuzz.run(tmp_path, 1, 7, tmp_path / "corpus", lines.append)["quantity"] == {"failed": 1}
    (kept,) = (tmp_path / "corpus" / "quantity").iterdir()
    assert kept.read_bytes() == fuzz.drawn("quantity", table["quantity"], 7)
    assert lines == [f"quantity, seed 7: TypeError: unhashable; {kept}"]
    assert fuzz.outcome(fuzz.Kind(table["quantity"].draw, refuses), b"") == "refused"
    with pytest.raises(fuzz.Failure, match="no line"):
        fuzz.outcome(fuzz.Kind(table["quantity"].draw, says_nothing), b"")


def test_a_reader_that_hangs_is_caught(monkeypatch: pytest.MonkeyPatch) -> None:
    def hangs(data: bytes) -> None:
        while True:
            pass

    monkeypatch.setattr(fuzz, "MAX_DURATION_S", 0.1)
    with pytest.raises(fuzz.Failure, match=r"more than 0.1 s"):
        fuzz.outcome(fuzz.Kind(lambda draw: b"", hangs), b"")
