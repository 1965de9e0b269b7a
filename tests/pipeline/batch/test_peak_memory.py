"""What a case leaves behind is freed before the next one begins."""

from __future__ import annotations

import gc
import weakref
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from pipeline.batch import job
from solvers import machine
from tests.helpers import fake_study


class Plate:
    """Holds a lot, and itself."""

    def __init__(self) -> None:
        self.matrix = np.ones(2_000_000)
        self.solve = self.matrix_of

    def matrix_of(self) -> np.ndarray:
        return self.matrix


@pytest.fixture
def left_behind() -> Iterator[weakref.ref[Plate]]:
    gc.disable()  # as between two of its own looks
    try:
        yield weakref.ref(Plate())
    finally:
        gc.enable()


def test_what_only_refers_to_itself_is_freed(left_behind: weakref.ref[Plate]) -> None:
    assert left_behind() is not None
    machine.give_back()
    assert left_behind() is None


def test_a_case_leaves_nothing_to_the_next_one(left_behind: weakref.ref[Plate], tmp_path: Path) -> None:
    seen = []
    (case,) = fake_study.jobs(1)
    mark = job.store.current_fingerprint()
    job.run_case(lambda payload, folder, log: seen.append(left_behind() is None) or {}, case, tmp_path, mark)
    assert seen == [False] and left_behind() is None
