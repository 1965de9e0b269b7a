import errno
import os
from pathlib import Path

import pytest

from pipeline.batch import runner


def test_lines_come_back_in_order(tmp_path: Path):
    log = runner.Journal(tmp_path)
    log.write("started", case="a")
    log.write("finished", case="a", seconds=2.5)
    entries, read_errors = runner.read(tmp_path)
    assert [entry["event"] for entry in entries] == ["started", "finished"]
    assert read_errors == [] and log.read_error is None
    assert runner.seconds_by_case(entries) == {"a": 2.5}


def test_a_torn_line_is_named_and_spoils_no_other(tmp_path: Path):
    log = runner.Journal(tmp_path)
    log.write("started", case="a")
    with log.path.open("ab") as file:
        file.write(b'{"at": "2026-01-01", "event": "fin')
    log.write("started", case="b")
    entries, read_errors = runner.read(tmp_path)
    assert [entry["case"] for entry in entries] == ["a", "b"]
    assert read_errors == ["journal.jsonl, line 2: torn, passed over"]


@pytest.mark.parametrize(
    "line",
    [
        b'{"event": "finished", "case": "a", "seconds": "x"}',
        b'{"event": "finished", "case": "a", "seconds": null}',
        b'{"event": "finished", "case": "a", "seconds": true}',
        b'{"event": "finished", "case": "a", "seconds": NaN}',
        b'{"event": "finished", "case": "a", "seconds": 1e999}',
        b'{"event": "finished", "case": "a", "seconds": -1}',
        b'{"event": "finished", "case": ["a"], "seconds": 1}',
        b'{"event": 7, "case": "a", "seconds": 1}',
        b'"finished"',
        b"[" * 100_000,
        b"\xff\xfe",
    ],
)
def test_a_line_of_other_types_is_passed_over(tmp_path: Path, line: bytes):
    log = runner.Journal(tmp_path)
    log.write("finished", case="b", seconds=2)
    with log.path.open("ab") as file:
        file.write(line + b"\n")
    entries, read_errors = runner.read(tmp_path)
    assert runner.seconds_by_case(entries) == {"b": 2.0}
    assert len(read_errors) == 1 and read_errors[0].startswith("journal.jsonl, line 2: ")


def test_no_journal_is_an_empty_one(tmp_path: Path):
    assert runner.read(tmp_path) == ([], [])


def test_a_full_disk_is_kept_as_a_complaint(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    log = runner.Journal(tmp_path)

    def full(*_: object) -> int:
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(os, "write", full)
    log.write("started", case="a")
    assert "No space left" in log.read_error
