"""Keepers: what a library makes is made, used and freed by one thread alone, whoever asks and whoever forgets it."""

from __future__ import annotations

import gc
import threading
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import numpy as np
import pytest
import scipy.sparse as sp

from solvers import machine
from solvers.fem import factor as rslab
from solvers.fem.factor import ThreadBound

Touches = list[tuple[str, int]]


@pytest.fixture(autouse=True)
def two_threads(monkeypatch: pytest.MonkeyPatch) -> None:
    """Whatever the machine has."""
    monkeypatch.setenv("ANTINODE_THREADS", "2")


class Jealous:
    """Tells which thread made, used and freed it, and makes others of its kind."""

    def __init__(self, touches: Touches) -> None:
        self.touches = touches
        touches.append(("made", threading.get_ident()))

    def used(self) -> int:
        self.touches.append(("used", threading.get_ident()))
        return 7

    def fail(self) -> Jealous:
        other = Jealous(self.touches)
        raise RuntimeError("no", other.used())  # the traceback holds `other`

    def __del__(self) -> None:
        self.touches.append(("freed", threading.get_ident()))


def elsewhere(call: Callable[[], Any]) -> Any:
    """The call's result from a thread that ends."""
    with ThreadPoolExecutor(1) as pool:
        return pool.submit(call).result()


def settled() -> None:
    """Whatever finalizers handed over has been done."""
    gc.collect()
    for each in {id(one): one for one in (*rslab._free_owners, rslab._own.lease.owner)}.values():
        each.run(lambda: None)


def alone(touches: Touches) -> bool:
    """One thread, and not this one, touched everything and freed as many as it made."""
    names = [name for name, _ in touches]
    threads = {ident for _, ident in touches}
    return len(threads) == 1 and threading.get_ident() not in threads and names.count("made") == names.count("freed")


def pair(touches: Touches) -> list[Any]:
    """A thing that is kept and another made of it, both used, one by a thread that has ended since."""
    kept = ThreadBound(lambda: Jealous(touches))
    other = kept.make(lambda own: Jealous(own.touches))
    assert kept.use(Jealous.used) == elsewhere(lambda: other.use(Jealous.used)) == 7
    return [kept, other]


def forget(things: list[Any]) -> None:
    things.clear()


def forget_elsewhere(things: list[Any]) -> None:
    elsewhere(things.clear)


def forget_in_a_cycle(things: list[Any]) -> None:
    things.append(things)


def free(things: list[ThreadBound[Jealous]]) -> None:
    touches = things[0].use(lambda own: own.touches)
    elsewhere(lambda: [each.free() for each in things])
    assert [name for name, _ in touches].count("freed") == 2
    with pytest.raises(IndexError):
        things[0].use(Jealous.used)


@pytest.mark.parametrize("end", [forget, forget_elsewhere, forget_in_a_cycle, free])
def test_one_thread_alone_makes_uses_and_frees(end: Callable[[list[Any]], None]) -> None:
    touches: Touches = []
    end(pair(touches))
    settled()
    assert alone(touches)


def test_an_exception_takes_nothing_to_another_thread() -> None:
    touches: Touches = []
    kept = ThreadBound(lambda: Jealous(touches))
    with pytest.raises(RuntimeError, match="no") as caught:
        kept.make(Jealous.fail)
    fault = caught.value
    settled()
    assert [name for name, _ in touches] == ["made", "made", "used", "freed"]
    del kept, fault, caught
    settled()
    assert alone(touches)


def test_a_process_of_one_thread_keeps_to_it(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("ANTINODE_THREADS", "1")
    touches: Touches = []
    kept = ThreadBound(lambda: Jealous(touches))
    other = kept.make(lambda own: Jealous(own.touches))
    assert kept.use(Jealous.used) == 7
    del kept
    other.free()
    assert {ident for _, ident in touches} == {threading.get_ident()}
    assert [name for name, _ in touches] == ["made", "made", "used", "freed", "freed"]


def test_threads_that_end_leave_their_keeper_to_the_next() -> None:
    """One owner thread for as many threads as there ever were at once, not for as many as there ever were."""
    elsewhere(lambda: ThreadBound(object))
    before = threading.active_count()
    for _ in range(20):
        elsewhere(lambda: ThreadBound(object))
    assert threading.active_count() == before


@pytest.mark.skipif("rslab" not in machine.factorisations(), reason="rslab is not installed")
def test_what_rslab_gives_is_memory_of_numpy_s_own() -> None:
    """A solution that rslab's allocator holds would be freed by whichever thread forgets it."""
    matrix = sp.csc_array(sp.diags_array(np.arange(1.0, 40.0), format="csc"))
    factor = rslab.Rslab(matrix)
    for right in (np.ones(39), np.ones((39, 3))):
        assert factor.solve(right).base is None and factor.solve(right).flags.owndata


@pytest.mark.slow
@pytest.mark.skipif("rslab" not in machine.factorisations(), reason="rslab is not installed")
def test_a_thousand_factorisations_by_threads_that_come_and_go() -> None:
    """Analyses used by threads that did not make them, freed by others, threads that end in between."""
    lattice = sp.diags_array([np.full(39, -1.0), np.full(40, 2.5), np.full(39, -1.0)], offsets=[-1, 0, 1])
    matrix = sp.csc_array(sp.kron(lattice, sp.eye_array(40)) + sp.kron(sp.eye_array(40), lattice))
    symbolic: list[Any] = []

    def task(place: int) -> float:
        made = rslab.Rslab(matrix, symbolic[-1] if symbolic and place % 3 else None)
        symbolic.append(made.symbolic)
        del symbolic[: max(0, len(symbolic) - 5)]
        right = np.cos(np.arange(matrix.shape[0]) * (1.0 + place))
        return float(np.abs(matrix @ made.solve(right) - right).max())

    for start in range(0, 1000, 20):
        with ThreadPoolExecutor(4) as pool:
            assert max(pool.map(task, range(start, start + 20))) < 1e-10
