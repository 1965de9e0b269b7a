"""Grid lines: breakpoints kept, sizes respected, layers shrinking towards singular edges."""

from __future__ import annotations

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from geometry.hex.scenes import Grading, grid_lines


def test_even_cuts_without_singular_edges() -> None:
    assert np.allclose(grid_lines({0.0: False, 1.0: False}, Grading(0.3, layers=3)), np.linspace(0.0, 1.0, 5))


def test_layers_shrink_by_the_factor_towards_a_singular_edge() -> None:
    lines = grid_lines({0.0: True, 1.0: False}, Grading(0.5, layers=2, factor=0.2))
    assert np.allclose(lines, [0.0, 0.02, 0.1, 0.5, 1.0])


def test_both_ends_singular_are_graded_alike() -> None:
    lines = grid_lines({0.0: True, 1.0: True}, Grading(5.0, layers=2, factor=0.3))
    assert np.allclose(lines, [0.0, 0.045, 0.15, 0.5, 0.85, 0.955, 1.0])
    assert np.allclose(lines + lines[::-1], 1.0)


def test_a_breakpoint_between_is_graded_on_both_sides() -> None:
    lines = grid_lines({-1.0: False, 0.0: True, 1.0: False}, Grading(1.0, layers=1, factor=0.25))
    assert np.allclose(lines, [-1.0, -0.25, 0.0, 0.25, 1.0])


def test_breakpoints_that_differ_by_rounding_are_one_and_stay_singular() -> None:
    lines = grid_lines({0.0: False, 1e-13: True, 1.0: False}, Grading(1.0, layers=1, factor=0.25))
    assert np.allclose(lines, [0.0, 0.25, 1.0])


def test_a_length_that_is_a_whole_number_of_sizes_is_not_cut_once_more() -> None:
    assert len(grid_lines({0.0: False, 0.3: False}, Grading(0.1))) == 4


@settings(max_examples=60, deadline=None)
@given(
    st.dictionaries(st.integers(0, 1000), st.booleans(), min_size=2, max_size=6),
    st.floats(0.5, 300.0),
    st.integers(0, 3),
    st.floats(0.1, 0.6),
)
def test_lines_increase_pass_every_breakpoint_and_never_exceed_the_size(
    raw: dict[int, bool], size: float, layers: int, factor: float
) -> None:
    breaks = {float(k): v for k, v in raw.items()}
    lines = grid_lines(breaks, Grading(size, layers, factor))
    steps = np.diff(lines)
    assert (steps > 0.0).all()
    assert steps.max() <= size * (1.0 + 1e-5)
    assert all(np.abs(lines - value).min() < 1e-9 for value in breaks)
    assert lines[0] == min(breaks) and lines[-1] == max(breaks)
