"""Tasks side by side: the same digits from any number of workers, no more of them than memory holds, and none left behind."""

from __future__ import annotations

import _thread
import os
import subprocess
import sys
import threading
import time

import numpy as np
import pytest

from geometry.hex.scenes import HexSettings
from geometry.layout import Design, Pillar
from geometry.materials import MATERIALS, Stack
from pipeline.workers import LocalWorkers
from solvers import machine, threads
from solvers.fem import factor
from solvers.fem.eigen import Modes, modes_in_band
from solvers.plates.assembled import PlateModel, Reductions
from solvers.superelement.interface import Interface, ReductionSettings
from solvers.threads import Cancelled, parallel_map, raise_if_cancelled

STEEL = MATERIALS["steel"]
PILLAR = Pillar("square", 1.8e-3, 1.8e-3, 5e-3, STEEL)
DESIGN = Design(16e-3, 8e-3, 1.5e-3, 2, STEEL, PILLAR, 4e-3, 4e-3, 1, 3e-3)


@pytest.fixture(autouse=True)
def own_pool(monkeypatch: pytest.MonkeyPatch) -> None:
    """Two workers, whatever the machine has."""
    monkeypatch.setenv("ANTINODE_THREADS", "2")
    threads._pool.cache_clear()


def solved() -> tuple[PlateModel, list[Modes]]:
    """Panels reduced and all classes of a small plate solved, each of several."""
    reduction = ReductionSettings(Interface(3, 3), 400e3, HexSettings(3, 2e-3, 0, pillar_size_m=2.5e-3))
    model = PlateModel(DESIGN, Reductions(Stack.of(DESIGN.thickness_m, STEEL), PILLAR, reduction))
    return model, factor.parallel_map(lambda name: modes_in_band(model.pencil(name), 1e3, 150e3), model.symmetries)


@pytest.mark.slow
@pytest.mark.parametrize("backend", machine.factorisations())
def test_one_worker_and_two_give_the_same_digits(backend: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """Cells and modes to the last bit; a task's factorisations and BLAS have one thread in both."""
    monkeypatch.setenv("ANTINODE_FACTOR", backend)
    seen: set[str] = set()
    monkeypatch.setattr(factor, "raise_if_cancelled", lambda: seen.add(threading.current_thread().name))
    two, modes_of_two = solved()
    assert len(seen) == 2 and threading.main_thread().name not in seen
    monkeypatch.setenv("ANTINODE_THREADS", "1")
    one, modes_of_one = solved()
    assert len(two.cells) > 1 and len(modes_of_two) == 4
    for key, cell in one.cells.items():
        assert np.array_equal(cell.stiffness, two.cells[key].stiffness)
        assert np.array_equal(cell.mass, two.cells[key].mass)
    for ours, theirs in zip(modes_of_one, modes_of_two, strict=True):
        assert len(ours.frequency_hz) > 1 and np.array_equal(ours.frequency_hz, theirs.frequency_hz)
        assert np.array_equal(ours.vectors, theirs.vectors)


def test_tasks_take_turns_more_often_and_the_interpreter_s_own_interval_comes_back() -> None:
    before = sys.getswitchinterval()
    assert max(parallel_map(lambda _: sys.getswitchinterval(), range(2))) < before
    assert sys.getswitchinterval() == before


class Load:
    """How many tasks are at work at once, at most."""

    def __init__(self) -> None:
        self.lock, self.now, self.most = threading.Lock(), 0, 0

    def __call__(self, item: int) -> tuple[int, int]:
        with self.lock:
            self.now += 1
            self.most = max(self.most, self.now)
        time.sleep(0.02)
        with self.lock:
            self.now -= 1
        return item, threads.threads()


@pytest.mark.parametrize(("room", "most"), [(float("inf"), 2), (2.5, 2), (1.5, 1), (0.5, 1)])
def test_no_more_at_once_than_memory_holds(room: float, most: int) -> None:
    load = Load()
    assert parallel_map(load, range(6), 1.0, room) == [(item, 1) for item in range(6)]
    assert load.most == most
    assert threads.threads() == 2, "the whole computation has all of them again"


def test_a_task_within_a_task_runs_where_it_is() -> None:
    def outer(_: int) -> tuple[int, list[int]]:
        own = threading.get_ident()
        return own, parallel_map(lambda _: threading.get_ident(), range(3))

    for own, inner in parallel_map(outer, range(4)):
        assert set(inner) == {own}


def test_the_first_fault_is_told_when_all_have_ended() -> None:
    done: list[int] = []

    def task(item: int) -> None:
        if item in (1, 2):
            raise ValueError(item)
        time.sleep(0.05)
        done.append(item)

    with pytest.raises(ValueError, match="1"):
        parallel_map(task, range(4))
    assert sorted(done) == [0, 3]


def test_an_interrupted_command_leaves_no_task_behind() -> None:
    begun: list[int] = []
    ended: list[int] = []

    def task(item: int) -> None:
        begun.append(item)
        if len(begun) == 2:
            _thread.interrupt_main()
        try:
            for _ in range(500):
                raise_if_cancelled()
                time.sleep(0.01)
        except Cancelled:
            ended.append(item)

    with pytest.raises(KeyboardInterrupt):
        parallel_map(task, range(2))
    until = time.monotonic() + 5.0
    while len(ended) < 2 and time.monotonic() < until:
        time.sleep(0.01)
    assert sorted(ended) == sorted(begun) == [0, 1]


def test_a_worker_of_a_batch_has_the_threads_that_it_was_given(monkeypatch: pytest.MonkeyPatch) -> None:
    """Two cases at once on two cores: one thread each, for classes and panels as for BLAS."""
    monkeypatch.delenv("ANTINODE_THREADS")
    with LocalWorkers(1, 1) as workers:
        assert workers.submit(machine.workers).result() == 1


def test_rslabs_heap_is_set_before_it_is_loaded_unless_the_user_has_set_it() -> None:
    """Its allocator reads the environment once, when the library is loaded."""
    code = "import os, sys, solvers.fem.factor; print(os.environ['MIMALLOC_PURGE_DELAY'], 'rslab' in sys.modules)"
    for given, expected in ((None, "1000 False"), ("7", "7 False")):
        own = {key: value for key, value in os.environ.items() if key != "MIMALLOC_PURGE_DELAY"}
        own |= {} if given is None else {"MIMALLOC_PURGE_DELAY": given}
        run = subprocess.run([sys.executable, "-c", code], env=own, capture_output=True, text=True, check=True)
        assert run.stdout.strip() == expected
