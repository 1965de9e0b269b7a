"""The benchmark of own cells: both programs have the same bands on one mesh, and the table says which took what."""

from __future__ import annotations

import pytest

from studies.benchmarks import own_cell


@pytest.mark.slow
def test_both_programs_have_one_answer_and_a_cost() -> None:
    pytest.importorskip("skfem")
    found, apart = own_cell.compared(intervals=1, points=1, count=6)
    (ours, own), (theirs, other) = found["Antinode"], found["scikit-fem"]
    assert ours == theirs and apart < 1e-6
    assert min(own.seconds, other.seconds) > 0.0 and min(own.peak_bytes, other.peak_bytes) > 1e7


def test_the_cell_has_its_hole() -> None:
    mesh = own_cell.cell(2, 1)
    assert len(mesh.cells) == (8 * 8 - 4 * 4) * 2
