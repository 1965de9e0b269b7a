import time
from pathlib import Path

import pytest

from pipeline import logs
from pipeline.logs import SAME_WARNING_LIMIT, RunLog, TerminalLog, close_abandoned, current_step


def test_it_reads_like_a_message_file_while_it_runs(tmp_path: Path):
    path = tmp_path / "run.mess"
    with RunLog(path) as log:
        log.banner("three-rows", "0.1.0", {"python": "3.11", "numpy": "2.0"})
        log.echo({"name": "c", "zone": {"length_m": 0.1155}})
        log.left_out("patches", "the case has none")
        with log.step("mesh"):
            text = path.read_text()  # not closed: readable already
            assert "zone.length_m = 0.1155" in text and "<I> <LEFT_OUT> patches: left out, the case has none" in text
            assert current_step(path) == "mesh"
        log.warning("MESH_12", "a thin element")
        log.close("WARNING")
    text = path.read_text()
    assert "-- ANTINODE -- VERSION 0.1.0 -- three-rows" in text and "numpy 2.0" in text
    assert "<A> <MESH_12> a thin element" in text and "TOTAL_JOB : cpu" in text
    assert text.endswith("--- DIAGNOSTIC JOB : <A>_ALARM\n")
    assert log.warnings == ["a thin element"] and log.left_out_list == ["patches: the case has none"]
    assert set(log.seconds) == {"mesh"}


@pytest.mark.parametrize(("status", "line"), [("OK", "OK"), ("WARNING", "<A>_ALARM"), ("FAILED", "<F>_ERROR")])
def test_closing_line(tmp_path: Path, status: str, line: str):
    with RunLog(tmp_path / "run.mess") as log:
        log.close(status)
        log.close("OK")  # once only
    assert (tmp_path / "run.mess").read_text().splitlines()[-1] == f"--- DIAGNOSTIC JOB : {line}"
    assert (tmp_path / "run.mess").read_text().count("DIAGNOSTIC") == 1


def test_the_same_alarm_is_not_said_without_end(tmp_path: Path):
    with RunLog(tmp_path / "run.mess") as log:
        for number in range(SAME_WARNING_LIMIT + 7):
            log.warning("EIGEN_3", f"residual of mode {number}")
        log.close("WARNING")
    text = (tmp_path / "run.mess").read_text()
    assert text.count("<A> <EIGEN_3>") == SAME_WARNING_LIMIT
    assert f"warning EIGEN_3 occurred {SAME_WARNING_LIMIT + 7} times in total" in text
    assert len(log.warnings) == SAME_WARNING_LIMIT + 7  # the record keeps all of them


def test_a_step_that_fails_is_timed_and_an_abandoned_log_closed(tmp_path: Path):
    path = tmp_path / "run.mess"
    with RunLog(path) as log, pytest.raises(ValueError), log.step("solve"):
        raise ValueError
    assert "solve" in log.seconds
    close_abandoned(path, "LOST", "the worker process was lost")
    assert path.read_text().endswith("--- DIAGNOSTIC JOB : <F>_ABNORMAL_ABORT\n")


@pytest.mark.parametrize(("seconds", "quiet", "said"), [(0.0, False, 2), (10.0, False, 1), (0.0, True, 0)])
def test_a_long_step_says_that_it_runs_where_no_terminal_shows_it(
    seconds: float, quiet: bool, said: int, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    """Its name before its end, once; none of a short step, and nothing of a quiet log."""
    monkeypatch.setattr(logs, "LONG_S", seconds)
    with TerminalLog(quiet).step("mesh the cell"):
        time.sleep(0.2)
    lines = capfd.readouterr().err.splitlines()
    assert len(lines) == said
    assert said < 2 or (lines[0].endswith("mesh the cell ...") and "mesh the cell: 0." in lines[1])
