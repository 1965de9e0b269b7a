"""The fill of a dissected grid, against fronts counted by hand and a dense triangle."""

from __future__ import annotations

import pytest

from solvers.fem.cost import Fill, eliminated, grid_fill, nodal, panelled


def test_one_element_is_a_dense_triangle() -> None:
    assert grid_fill((1, 1, 1), nodal(2)).entries == 81 * 82 / 2


def test_two_elements_are_two_insides_and_the_plane_between_them() -> None:
    """Order 1 in a row: four nodes inside each end, four on the plane, three degrees of freedom a node."""
    end, plane = eliminated(12, 12), eliminated(12, 0)
    assert grid_fill((2, 1, 1), nodal(1)) == end + end + plane


def test_a_chain_fills_in_proportion_to_its_length() -> None:
    short, long = (grid_fill((count, 1, 1), nodal(2)).entries for count in (64, 1024))
    assert long / short == pytest.approx(16.0, rel=0.1)


def test_a_square_fills_as_n_log_n_and_a_cube_as_n_to_four_thirds() -> None:
    """george1973: n log2 n in the plane, n^(4/3) in space; between 16 and 64 (8 and 32) elements a side."""
    plane = [grid_fill((side, side), nodal(1, 1)).entries for side in (16, 64)]
    assert 16.0 < plane[1] / plane[0] < 16.0 * 2.0
    cube = [grid_fill((side,) * 3, nodal(1, 1)).entries for side in (16, 64)]
    assert 4.0**3 * 3.0 < cube[1] / cube[0] < 4.0**3 * 6.0


def test_what_a_foot_shares_is_not_eliminated_twice() -> None:
    own = ((True, True), (True, True), (False, True))
    assert grid_fill((1, 1, 1), nodal(1), own) == eliminated(12, 12)


def test_panels_have_their_own_degrees_of_freedom() -> None:
    assert grid_fill((1, 1), panelled(2, 3, 5)).entries == 25 * 26 / 2


def test_many_bodies_add_up_but_their_largest_front_does_not() -> None:
    assert Fill(1.0, 2.0, 3.0).times(4) == Fill(4.0, 8.0, 3.0)
