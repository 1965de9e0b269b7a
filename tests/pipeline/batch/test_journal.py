import errno
import io
import json
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest

from pipeline.batch import runner
from pipeline.batch.runner import Progress
from pipeline.records import store
from tests.helpers import fake_study


def test_a_torn_line_spoils_no_other(tmp_path: Path):
    runner.note(tmp_path, "started", case="a")
    with (tmp_path / runner.JOURNAL).open("ab") as file:
        file.write(b'{"at": "2026-01-01", "event": "fin')
    runner.note(tmp_path, "finished", case="b", seconds=2.5)
    first, torn, last = (tmp_path / runner.JOURNAL).read_text().splitlines()
    assert json.loads(first)["case"] == "a" and torn.endswith("fin")
    assert json.loads(last) | {"at": ""} == {"at": "", "event": "finished", "case": "b", "seconds": 2.5}


@pytest.mark.parametrize("seconds", ["x", None, {}, [2.0], -1, "1e999"])
def test_times_of_other_types_are_passed_over(tmp_path: Path, seconds: object):
    jobs = fake_study.jobs(3)
    for job, value in zip(jobs, (2, seconds), strict=False):
        (tmp_path / job.case_id).mkdir()
        text = json.dumps({"seconds": {"total": value}}).replace('"1e999"', "1e999")
        (tmp_path / job.case_id / store.TIMING).write_text(text)
    assert runner.known_seconds(tmp_path, jobs) == {jobs[0].case_id: 2.0}


def test_a_full_disk_is_said_at_the_end(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    def full(*_: object, **__: object) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(runner, "note", full)
    stream = io.StringIO()
    with ThreadPoolExecutor(1) as here:
        options = runner.Options(executor=here)
        runner.run_study(fake_study.jobs(1), fake_study.compute, tmp_path, options, Progress(stream=stream))
    assert "journal.jsonl: a line could not be written (No space left" in stream.getvalue()
