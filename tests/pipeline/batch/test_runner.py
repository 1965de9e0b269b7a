from __future__ import annotations

import io
import os
import random
import signal
import subprocess
import sys
import time
from collections import Counter
from collections.abc import Callable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import replace
from functools import partial
from pathlib import Path
from types import SimpleNamespace

import psutil
import pytest

from pipeline import workers
from pipeline.batch import job, runner
from pipeline.batch.job import Forecast
from pipeline.batch.runner import Progress
from pipeline.cli import study_commands
from pipeline.questions import study as asked
from pipeline.records import store
from pipeline.records import study as records_study
from pipeline.workers import LocalWorkers
from tests.helpers import fake_study

ROOT = Path(__file__).resolve().parents[3]


def run(folder: Path, cases: list[runner.Job], **options: object) -> runner.StudyOutcome:
    return runner.run_study(cases, fake_study.compute, folder, runner.Options(**{"jobs": 2, **options}))


@pytest.fixture
def here(monkeypatch: pytest.MonkeyPatch) -> Iterator[ThreadPoolExecutor]:
    """Cases one after the other in this process, for what is not the workers' own."""
    monkeypatch.setenv("OMP_NUM_THREADS", "1")  # told by the cases
    with ThreadPoolExecutor(1) as pool:
        yield pool


def starts(folder: Path) -> Counter[str]:
    path = folder / "starts.txt"
    return Counter(path.read_text().split()) if path.exists() else Counter()


@pytest.mark.slow
def test_every_way_to_end_is_recorded_by_name_and_stops_no_other(tmp_path: Path):
    fates = {1: "raise", 2: "kill", 3: "bug", 4: "memory", 5: "alarm", 6: "full"}
    outcome = run(tmp_path, fake_study.jobs(8, fates=fates))
    study = records_study.read_study(tmp_path)
    text = {case.case_id: (case.record.status, case.record.diagnosis) for case in study.cases}
    assert text["value=0"] == text["value=7"] == ("OK", "done")
    assert text["value=1"] == ("FAILED", "no count by inertia at 31 kHz; try another band")
    assert text["value=2"][0] == "FAILED" and "SIGKILL" in text["value=2"][1]
    assert text["value=3"] == ("FAILED", "KeyError: 'nobody expected this'")
    assert text["value=4"][0] == "FAILED" and "memory ran out" in text["value=4"][1]
    assert text["value=5"] == ("WARNING", "a thin element")
    assert text["value=6"][0] == "MISSING"  # no room for a record: said by the outcome
    assert {end.case_id for end in outcome.failed} == {"value=1", "value=2", "value=3", "value=4", "value=6"}
    assert outcome.exit_code == 3
    lines = {case.case_id: (case.folder / "run.mess").read_text().splitlines()[-1] for case in study.cases}
    assert lines["value=2"].endswith("<F>_ABNORMAL_ABORT") and lines["value=1"].endswith("<F>_ERROR")
    assert "Traceback" in (tmp_path / "value=3/run.mess").read_text()
    assert "Traceback" not in (tmp_path / "value=1/run.mess").read_text()


def test_a_record_holds_what_it_must(tmp_path: Path, here: ThreadPoolExecutor):
    run(tmp_path, fake_study.jobs(1), executor=here)
    record = store.read_record(tmp_path / "value=0")
    assert record["left_out"] == ["patches: the case has none"] and record["warnings"] == []
    assert record["sweep"] == {"value": 0} and record["name"] == "c0" and record["versions"]["numpy"]
    assert "seconds" not in record
    timing = store.read_json(tmp_path / "value=0/timing.json")
    assert set(timing["seconds"]) == {"mesh", "solve", "total"} and timing["peak_memory_bytes"] > 1e6


def test_again_computes_only_what_is_missing_changed_torn_or_forced(tmp_path: Path, here: ThreadPoolExecutor):
    jobs, options = fake_study.jobs(5), runner.Options(executor=here)
    run(tmp_path, jobs, executor=here)
    assert run(tmp_path, jobs).ended == ()
    changed = [*jobs[:4], runner.Job("value=4", {**jobs[4].payload, "seconds": 0.03}, jobs[4].sweep)]
    (tmp_path / "value=1/record.json").write_text("{")
    (tmp_path / "value=2/arrays.npz").write_bytes(b"torn")
    dry = run(tmp_path, changed, dry_run=True)
    why = {item.case_id: item.why for item in dry.plan}
    assert why["value=0"] is None and why["value=3"] is None and why["value=4"] == "its input changed"
    assert "record.json is unreadable" in why["value=1"] and "arrays.npz is unreadable" in why["value=2"]
    assert dry.ended == () and set(starts(tmp_path).values()) == {1}  # a dry run computes nothing
    stream = io.StringIO()
    again = runner.run_study(changed, fake_study.compute, tmp_path, options, Progress(stream=stream))
    assert "value=2: computed again, arrays.npz is unreadable" in stream.getvalue()
    assert "value=4: computed again, its input changed" in stream.getvalue()
    assert {end.case_id for end in again.ended} == {"value=1", "value=2", "value=4"} and again.exit_code == 0
    assert len(run(tmp_path, changed, force=True, executor=here).ended) == 5


def test_a_failed_case_is_tried_again_the_next_time(tmp_path: Path, here: ThreadPoolExecutor):
    run(tmp_path, fake_study.jobs(2, fates={1: "raise"}), executor=here)
    leftover = tmp_path / f".cases{store.TEMPORARY}"
    leftover.touch()  # by a run that was killed as it wrote the list of cases
    again = run(tmp_path, fake_study.jobs(2, fates={1: "raise"}), executor=here)
    assert [(end.case_id, end.status) for end in again.ended] == [("value=1", "FAILED")]
    assert not leftover.exists()


def test_fail_fast_stops_and_says_what_is_undone(tmp_path: Path):
    outcome = run(tmp_path, fake_study.jobs(6, fates={0: "raise"}), jobs=1, fail_fast=True)
    assert [end.case_id for end in outcome.ended] == ["value=0"]
    assert outcome.undone == tuple(f"value={i}" for i in range(1, 6)) and outcome.exit_code == 3


@pytest.mark.slow
def test_any_executor_fits_and_gives_the_same_table(tmp_path: Path, here: ThreadPoolExecutor):
    run(tmp_path / "a", fake_study.jobs(4))
    run(tmp_path / "b", fake_study.jobs(4), executor=here)
    one, two = (asked.write_table(tmp_path / name).read_bytes() for name in "ab")
    assert one == two and one.count(b"\n") == 5


@pytest.mark.slow
def test_threads_share_the_cores(tmp_path: Path):
    cores = workers.default_jobs(10**6)
    run(tmp_path, fake_study.jobs(1), jobs=1)
    assert store.read_record(tmp_path / "value=0")["other"]["threads"] == str(cores)
    run(tmp_path / "two", fake_study.jobs(1), jobs=2 * cores)
    assert store.read_record(tmp_path / "two/value=0")["other"]["threads"] == "1"


@pytest.mark.slow
def test_cases_that_would_not_fit_into_memory_wait(tmp_path: Path):
    huge = 2 * psutil.virtual_memory().total
    jobs = [replace(job, forecaster=lambda: Forecast(huge)) for job in fake_study.jobs(3)]
    assert run(tmp_path, jobs).exit_code == 0
    events = [(entry["event"], entry.get("case")) for entry in fake_study.journal(tmp_path) if "case" in entry]
    assert events == [(event, f"value={i}") for i in range(3) for event in ("started", "finished")]  # one at a time


def test_only_cases_next_in_line_are_forecast(tmp_path: Path):
    huge, asked = 2 * psutil.virtual_memory().total, []

    def forecaster(case_id: str) -> Forecast:
        asked.append(case_id)
        return Forecast(huge)

    jobs = fake_study.jobs(30, seconds=0.3, fates={0: "raise"})
    run(tmp_path, [replace(job, forecaster=partial(forecaster, job.case_id)) for job in jobs], fail_fast=True)
    assert asked and {*asked} <= {f"value={i}" for i in range(1 + runner.LOOK_AHEAD)}


@pytest.mark.slow
def test_cases_of_the_same_parts_are_not_begun_side_by_side(tmp_path: Path):
    cases = fake_study.jobs(6, seconds=0.3)
    run(tmp_path, [replace(case, parts="ab"[i // 3]) for i, case in enumerate(cases)])
    entries = fake_study.journal(tmp_path)
    begun = [entry["case"] for entry in entries if entry["event"] == "started"]
    assert begun[:2] == ["value=0", "value=3"]  # the second of the first parts would have made them once more
    assert sorted(begun) == [f"value={i}" for i in range(6)]


def test_two_cases_of_one_name_are_refused(tmp_path: Path):
    with pytest.raises(ValueError, match="value=0"):
        run(tmp_path, fake_study.jobs(1) * 2)


def test_time_left_is_what_earlier_runs_took(tmp_path: Path):
    progress = Progress(stream=io.StringIO())
    planned = [SimpleNamespace(case_id=f"value={i}", why="new") for i in range(3)]
    progress.begin(tmp_path, planned, {f"value={i}": 20.0 for i in range(3)})
    assert progress.time_left() == "about 60 s left"
    progress.begin(tmp_path, planned, {})
    assert progress.time_left() == "remaining time not yet known"


def test_time_that_a_case_waits_for_a_worker_is_none_of_its_duration(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    clock = SimpleNamespace(now=100.0)
    monkeypatch.setattr("pipeline.batch.runner.time", SimpleNamespace(monotonic=lambda: clock.now))
    progress = Progress(stream=io.StringIO())
    log = tmp_path / "value=0" / store.RUN_LOG
    log.parent.mkdir()
    log.write_text("of an earlier run")
    os.utime(log, ns=(1, 1))
    planned = [SimpleNamespace(case_id=f"value={i}", why="new") for i in range(2)]
    progress.begin(tmp_path, planned, {"value=0": 20.0, "value=1": 20.0})
    for item in planned:
        progress.case_started(item.case_id)

    def later(seconds: float) -> str:
        clock.now += seconds
        progress.tick()
        return progress.time_left()

    assert later(90.0) == "about 40 s left"  # none has begun
    log.write_text("of this run")
    assert later(2.0) == "about 40 s left"
    assert later(5.0) == "about 35 s left"  # one at work, the other waits: not half of it
    progress.case_ended("value=0", "OK", "done", 20.0)
    (tmp_path / "value=1").mkdir()
    (tmp_path / "value=1" / store.RUN_LOG).write_text("")
    assert later(2.0) == "about 20 s left" and later(21.0) == "almost finished"
    assert later(4.0) == "taking longer than earlier cases"


def test_a_long_dry_run_is_never_silent_for_long(monkeypatch: pytest.MonkeyPatch):
    clock = SimpleNamespace(now=100.0)
    monkeypatch.setattr("pipeline.batch.runner.time", SimpleNamespace(monotonic=lambda: clock.now))
    said, quiet = io.StringIO(), io.StringIO()
    for progress in (Progress(stream=said), Progress(quiet=True, stream=quiet)):
        for done in range(1, 201):
            clock.now += 0.25
            progress.planned(done, 200)
    lines = said.getvalue().splitlines()
    assert lines[0] == "13 of 200 cases planned" and len(lines) == 200 // 13 and not quiet.getvalue()


def test_a_case_that_failed_at_once_is_no_measure_of_time(tmp_path: Path):
    progress = Progress(stream=io.StringIO())
    progress.begin(tmp_path, [SimpleNamespace(case_id=f"value={i}", why="new") for i in range(3)], {})
    progress.case_ended("value=0", "FAILED", "lost", 0.0)
    assert progress.time_left() == "remaining time not yet known"
    progress.case_ended("value=1", "OK", "done", 50.0)
    assert progress.time_left() == "about 50 s left"


def test_progress_says_counts_and_can_be_silent(tmp_path: Path, here: ThreadPoolExecutor):
    stream = io.StringIO()
    options, jobs = runner.Options(executor=here), fake_study.jobs(3)
    runner.run_study(jobs, fake_study.compute, tmp_path, options, Progress(stream=stream))
    said = stream.getvalue()
    assert "3 cases, 3 to compute" in said and "[3/3] value=2: OK" in said
    stream = io.StringIO()
    runner.run_study(jobs, fake_study.compute, tmp_path, options, Progress(stream=stream))
    assert "3 already computed, 0 to compute" in stream.getvalue()
    stream = io.StringIO()
    runner.run_study(jobs, fake_study.compute, tmp_path, options, Progress(quiet=True, stream=stream))
    assert stream.getvalue() == ""


def start(folder: Path, *more: str) -> subprocess.Popen[bytes]:
    command = [sys.executable, "-m", "tests.helpers.fake_study", str(folder), *more]
    env = {**os.environ, "PYTHONPATH": str(ROOT)}
    return subprocess.Popen(command, env=env, stderr=subprocess.PIPE, start_new_session=True, preexec_fn=hear_hangups)


def hear_hangups() -> None:
    """Where tests run under nohup, hang-ups are ignored, and so they would be by every process started here."""
    signal.signal(signal.SIGHUP, signal.SIG_DFL)


def living(family: list[psutil.Process]) -> list[psutil.Process]:
    """Those that still run after a while; a zombie is dead, only nobody has read its exit yet.

    A worker that was still importing looks for its parent when it is done, which takes long on a busy machine.
    """
    left = psutil.wait_procs(family, timeout=60)[1]
    return [process for process in left if process.is_running() and process.status() != psutil.STATUS_ZOMBIE]


def kill_at(folder: Path, delay: float) -> None:
    """Kill the main process only; its workers must follow by themselves."""
    process = start(folder)
    time.sleep(delay)
    family = psutil.Process(process.pid).children(recursive=True) if process.poll() is None else []
    process.send_signal(signal.SIGKILL)
    process.wait()  # not communicate(): orphans would hold the pipe open and hide themselves
    assert living(family) == []


def prove_resumption(tmp_path: Path, kills: int, seed: int) -> None:
    calm, rough = tmp_path / "calm", tmp_path / "rough"
    begin = time.monotonic()
    assert start(calm).wait() == 0
    whole = time.monotonic() - begin
    chance = random.Random(seed)
    for _ in range(kills):
        finished = {path.parent.name for path in rough.glob("*/record.json")}
        before = starts(rough)
        kill_at(rough, chance.uniform(0.2, 0.8) * whole)
        assert all(starts(rough)[name] == before[name] for name in finished)
    assert start(rough).wait() == 0
    assert (calm / "table.csv").read_bytes() == (rough / "table.csv").read_bytes()
    assert list(rough.rglob(f"*{store.TEMPORARY}")) == []
    assert set(starts(calm).values()) == {1}


@pytest.mark.slow
def test_killed_at_any_moment_it_goes_on_and_ends_the_same(tmp_path: Path):
    prove_resumption(tmp_path, kills=1, seed=1)


@pytest.mark.slow
def test_killed_at_twenty_moments(tmp_path: Path):
    prove_resumption(tmp_path, kills=20, seed=2)


def wait_for(condition: Callable[[], object], seconds: float = 20.0) -> None:
    deadline = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < deadline
        time.sleep(0.02)


@pytest.mark.parametrize(
    "number",
    [
        signal.SIGINT,
        pytest.param(signal.SIGTERM, marks=pytest.mark.slow),
        pytest.param(signal.SIGHUP, marks=pytest.mark.slow),
    ],
)
def test_an_interruption_ends_within_seconds_and_keeps_what_was_finished(tmp_path: Path, number: signal.Signals):
    process = start(tmp_path, "--cases", "4", "--seconds", "60", "--first", "0.1")
    wait_for(lambda: list(tmp_path.glob("*/record.json")) and len(starts(tmp_path)) == 3)
    for _ in range(1 if number == signal.SIGINT else 2):  # `timeout` sends its signal twice
        os.killpg(process.pid, number)  # as a terminal does: to the workers, too
    errors = process.communicate(timeout=20)[1].decode()  # a third of what one case at work would still take
    assert process.returncode == 130
    assert "Traceback" not in errors
    assert [path.parent.name for path in tmp_path.glob("*/record.json")] == ["value=0"]
    assert fake_study.journal(tmp_path)[-1]["event"] == "interrupted"
    for name in ("value=1", "value=2"):
        assert (tmp_path / name / "run.mess").read_text().endswith("--- DIAGNOSTIC JOB : <S>_INTERRUPTED\n")


@pytest.mark.slow
def test_workers_of_a_killed_run_do_not_go_on(tmp_path: Path):
    process = start(tmp_path, "--cases", "2", "--seconds", "60")
    wait_for(lambda: len(starts(tmp_path)) == 2)
    family = psutil.Process(process.pid).children(recursive=True)
    process.send_signal(signal.SIGKILL)
    process.wait()  # not communicate(): orphans would hold the pipe open and hide themselves
    assert len(family) >= 2 and living(family) == []


def test_workers_leave_ctrl_c_to_the_main_process():
    with LocalWorkers(1, 1) as pool:
        assert {"SIGINT", "SIGTERM", "SIGHUP"} <= set(pool.submit(fake_study.signals_held_back).result(timeout=30))


def test_an_error_that_cannot_be_unpickled_fails_its_task_alone():
    with LocalWorkers(2, 1) as pool:
        neighbour = pool.submit(time.sleep, 0.5)
        lost, later = pool.submit(fake_study.raises_what_cannot_be_loaded), pool.submit(os.getpid)
        with pytest.raises(TypeError, match="missing 1 required"):
            lost.result(timeout=60)
        assert neighbour.result(timeout=60) is None and later.result(timeout=60) > 0


def test_workers_of_an_interrupted_block_are_ended_at_once():
    begin = time.monotonic()
    with pytest.raises(KeyboardInterrupt), LocalWorkers(1, 1) as pool:
        for _ in range(2):
            pool.submit(time.sleep, 60)
        raise KeyboardInterrupt
    assert time.monotonic() - begin < 50


class LosesItsScheduler(ThreadPoolExecutor):
    """Answers the first cases and cancels all others, as a Dask client does whose scheduler is gone."""

    def __init__(self, answered: int) -> None:
        super().__init__(1)
        self.answered = answered

    def submit(self, function, /, *args, **kwargs):
        self.answered -= 1
        if self.answered >= 0:
            return super().submit(function, *args, **kwargs)
        future: Future = Future()
        future.cancel()
        future.set_running_or_notify_cancel()
        return future


def test_a_lost_scheduler_fails_no_case_and_the_next_run_goes_on(tmp_path: Path, here: ThreadPoolExecutor):
    jobs = fake_study.jobs(5)
    with LosesItsScheduler(2) as pool:
        lost = run(tmp_path, jobs, executor=pool)
    assert lost.failed == () and lost.exit_code == 3
    assert set(lost.given_up) <= set(lost.undone) == {"value=2", "value=3", "value=4"} and lost.given_up
    assert {"executor_lost", "end"} <= {entry["event"] for entry in fake_study.journal(tmp_path)}
    statuses = Counter(case.record.status for case in records_study.read_study(tmp_path).cases)
    assert statuses == {"OK": 2, "MISSING": 3}
    again = run(tmp_path, jobs, executor=here)
    assert len(again.reused) == 2 and len(again.ended) == 3 and again.exit_code == 0


def test_a_lost_scheduler_is_told_in_one_line_with_what_to_do():
    planned = tuple(job.Planned(f"c{i}", "new") for i in range(5))
    outcome = runner.StudyOutcome(Path("x"), planned, (), ("c3", "c4"), ("c3",))
    text = study_commands._lost("tcp://host:8786", outcome)
    assert "tcp://host:8786" in text and "1 of 5 were running" in text and "The 3 finished ones are kept" in text
    assert "repeat the command" in text and "CancelledError" not in text


def test_a_worker_with_other_sources_is_refused(tmp_path: Path):
    mark = store.Fingerprint("0" * 64, {})
    end = job.run_case(fake_study.compute, fake_study.jobs(1)[0], tmp_path, mark)
    assert end.status == "FAILED" and "sources of this worker differ" in end.diagnosis and starts(tmp_path) == {}


@pytest.mark.slow
def test_a_second_run_of_the_same_study_is_refused_in_one_line(tmp_path: Path):
    first = start(tmp_path, "--cases", "2", "--seconds", "3")
    wait_for((tmp_path / "journal.jsonl").exists)
    second = start(tmp_path)
    errors = second.communicate(timeout=20)[1].decode().splitlines()
    first.send_signal(signal.SIGKILL)
    first.wait()
    assert second.returncode == 2 and len(errors) == 1 and f"process {first.pid}" in errors[0]


@pytest.mark.slow
def test_one_worker_killed_from_outside_fails_one_case(tmp_path: Path):
    process = start(tmp_path, "--cases", "4", "--seconds", "1")
    wait_for(lambda: len(starts(tmp_path)) >= 2)
    workers = [p for p in psutil.Process(process.pid).children() if "spawn_main" in " ".join(p.cmdline())]
    workers[0].kill()
    process.communicate(timeout=30)
    assert process.returncode == 3
    statuses = Counter(case.record.status for case in records_study.read_study(tmp_path).cases)
    assert statuses == {"OK": 3, "FAILED": 1}


@pytest.mark.slow
def test_a_dask_cluster_of_processes_one_of_them_killed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    distributed = pytest.importorskip(
        "distributed", reason="Dask distributed is an optional extra and not installed here"
    )
    monkeypatch.setenv("PYTHONPATH", f"{ROOT}{os.pathsep}{os.environ.get('PYTHONPATH', '')}")
    run(tmp_path / "local", fake_study.jobs(8))
    with (
        distributed.LocalCluster(n_workers=2, threads_per_worker=1, processes=True, dashboard_address=None) as cluster,
        distributed.Client(cluster.scheduler_address) as client,
        ThreadPoolExecutor(1) as beside,
    ):
        jobs = fake_study.jobs(8, seconds=0.5)
        going = beside.submit(run, tmp_path / "dask", jobs, jobs=None, executor=client.get_executor())
        wait_for(lambda: len(starts(tmp_path / "dask")) >= 3)
        os.kill(next(iter(client.run(os.getpid).values())), signal.SIGKILL)
        outcome = going.result(timeout=120)
    assert outcome.exit_code == 0 and len(outcome.ended) == 8
    assert sum(starts(tmp_path / "dask").values()) > 8  # the lost worker's case went to another one
    local, remote = (asked.write_table(tmp_path / name).read_text() for name in ("local", "dask"))
    assert local == remote


@pytest.mark.slow
def test_a_dask_scheduler_killed_in_the_middle(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    distributed = pytest.importorskip(
        "distributed", reason="Dask distributed is an optional extra and not installed here"
    )
    monkeypatch.setenv("PYTHONPATH", str(ROOT))
    monkeypatch.setenv("OMP_NUM_THREADS", "1")
    text = tmp_path / "scheduler.json"
    common = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL, "cwd": tmp_path}
    dask = [sys.executable, "-m", "distributed.cli.dask_scheduler", "--port", "0", "--no-dashboard"]
    scheduler = subprocess.Popen([*dask, "--scheduler-file", str(text)], **common)
    wait_for(text.exists, 60)
    dask = [sys.executable, "-m", "distributed.cli.dask_worker", "--nthreads", "1", "--no-nanny", "--no-dashboard"]
    worker = subprocess.Popen([*dask, "--death-timeout", "5", "--scheduler-file", str(text)], **common)
    try:
        jobs = fake_study.jobs(4, seconds=0.1)
        for job in jobs[1:]:
            job.payload["seconds"] = 20.0
        with distributed.Client(scheduler_file=str(text)) as client, ThreadPoolExecutor(1) as beside:
            going = beside.submit(run, tmp_path / "study", jobs, jobs=None, executor=client.get_executor())
            wait_for(lambda: len(starts(tmp_path / "study")) == 2, 60)
            scheduler.kill()
            lost = going.result(timeout=60)
    finally:
        worker.kill()
        scheduler.kill()
    assert lost.failed == () and lost.exit_code == 3 and [end.case_id for end in lost.ended] == ["value=0"]
    assert lost.undone == lost.given_up == tuple(f"value={i}" for i in (1, 2, 3))
    assert (tmp_path / "study/value=1/run.mess").read_text().endswith("--- DIAGNOSTIC JOB : <S>_INTERRUPTED\n")
