"""Lattices: reciprocal vectors, the Brillouin zone and the part of it that a cell's mirrors leave, paths and grids."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest

from geometry.elements import FloatArray
from geometry.lattice import (
    MIRRORS,
    SAME,
    Lattice,
    labels_of,
    place_in_cell,
    row_vectors,
    rows_along_x,
    shortest_vectors,
)

SQUARE, OBLONG = Lattice.of_rows(4e-3, 4e-3), Lattice.of_rows(3e-3, 4e-3)
STAGGERED = [Lattice.of_rows(5e-3, pitch, staggered=True) for pitch in (4e-3, 2.5e-3, 2e-3)]
TRIANGULAR = Lattice.of_rows(4e-3, 2e-3 * np.sqrt(3.0), staggered=True)
ALL = [SQUARE, OBLONG, *STAGGERED, TRIANGULAR]


def area(corners: FloatArray) -> float:
    x, y = (corners - corners[0]).T
    return abs(float(x @ np.roll(y, -1) - y @ np.roll(x, -1))) / 2.0


@pytest.mark.parametrize("lattice", ALL)
def test_reciprocal_vectors_and_the_area_of_the_zone_belong_to_the_lattice(lattice: Lattice) -> None:
    assert lattice.vectors_m @ lattice.reciprocal_per_m.T == pytest.approx(2.0 * np.pi * np.eye(2), abs=1e-12)
    assert area(lattice.zone) * lattice.area_m2 == pytest.approx(4.0 * np.pi**2)
    assert lattice.area_m2 == pytest.approx(np.prod(lattice.cell_m))
    assert lattice.phases(lattice.reciprocal_per_m.sum(axis=0)) == pytest.approx([2.0 * np.pi, 2.0 * np.pi])


@pytest.mark.parametrize("lattice", ALL)
@pytest.mark.parametrize("mirrors", [(), ("x",), ("y",), ("d",), ("x", "y"), ("x", "y", "d"), ("x", "y", "h")])
def test_images_of_the_irreducible_part_fill_the_zone_once(lattice: Lattice, mirrors: tuple[str, ...]) -> None:
    """Every wavevector has an image in the part, and of those inside it none is another's image."""
    part, group = lattice.irreducible(mirrors), lattice.point_group(mirrors)
    assert len(group) * area(part) == pytest.approx(area(lattice.zone))
    images = [part.mean(axis=0) @ each.T for each in group]
    assert len(np.unique(np.round(images, 3), axis=0)) == len(group)
    for each in group:
        assert all(lattice.is_same(each @ b, np.zeros(2)) for b in lattice.reciprocal_per_m)


@pytest.mark.parametrize(
    ("lattice", "mirrors", "order"),
    [
        (SQUARE, "xyd", 8),
        (SQUARE, "d", 4),
        (OBLONG, "xyd", 4),
        (OBLONG, "d", 2),
        (STAGGERED[0], "xyd", 4),
        (SQUARE, "", 2),
    ],
)
def test_the_point_group_is_what_lattice_and_cell_share(lattice: Lattice, mirrors: str, order: int) -> None:
    assert len(lattice.point_group(mirrors)) == order


@pytest.mark.parametrize(
    ("lattice", "path"), zip(ALL, ["GXMG", "GXMYG", "GXSX1YG", "GXSG", "GXY1SYG", "GMKG"], strict=True)
)
def test_the_path_goes_around_the_irreducible_part(lattice: Lattice, path: str) -> None:
    part = lattice.irreducible(MIRRORS)
    assert lattice.default_path == path and lattice.border(("x", "y"))[:2] == ("GM" if lattice.is_triangular else "GX")
    places = lattice.path(path, 1).wavevectors
    assert area(places[:-1]) == pytest.approx(area(part)), "the labelled points are its corners, S lies on a side"
    for corner in part:
        assert np.linalg.norm(places - corner, axis=1).min() < 1e-6
    for start, end in pairwise(places):
        assert not lattice.is_same(start, end)


@pytest.mark.parametrize("lattice", STAGGERED)
def test_equivalent_corners_of_shifted_rows_share_a_letter(lattice: Lattice) -> None:
    points = lattice.high_symmetry
    for label in ("X1", "Y1"):
        if label in points:
            assert any(lattice.is_same(MIRRORS[name] @ points[label[0]], points[label]) for name in ("x", "y"))


@pytest.mark.parametrize(
    ("mirrors", "count", "low"), [("xyd", 15, [0, 0]), ("xy", 25, [0, 0]), ("", 45, [-1, 0]), ("d", 25, [0, -1])]
)
def test_a_grid_covers_the_irreducible_zone_with_its_border(mirrors: str, count: int, low: list[int]) -> None:
    grid = SQUARE.grid(4, mirrors) * 4e-3 / np.pi
    assert len(grid) == len(np.unique(grid.round(9), axis=0)) == count
    assert grid.min(axis=0) == pytest.approx(low) and grid.max(axis=0) == pytest.approx([1, 1])
    assert len(OBLONG.grid(4, "xyd")) == 25 and len(OBLONG.grid(4, "d")) == 45


@pytest.mark.parametrize("lattice", STAGGERED)
def test_a_grid_of_shifted_rows_is_even_and_lies_in_the_zone(lattice: Lattice) -> None:
    """Of so many wavevectors of the whole zone one is nearest to the origin among those equivalent to it."""
    grid, others = lattice.grid(6, ()), lattice.reciprocal_per_m
    assert len(grid) == pytest.approx(0.5 * 12**2, rel=0.3), "borders belong to it"
    for k in grid:
        for i, j in np.ndindex(5, 5):
            assert np.linalg.norm(k) <= np.linalg.norm(k + (i - 2) * others[0] + (j - 2) * others[1]) * (1.0 + 1e-9)


def test_labels_and_translations() -> None:
    assert labels_of("GXSX1YG") == ("G", "X", "S", "X1", "Y", "G")
    with pytest.raises(ValueError, match="at least two of the corners G, X, S, X1, Y"):
        STAGGERED[0].path("GXM", 2)
    moved = STAGGERED[0].translations(2) / 1e-3
    assert moved == pytest.approx(np.array([[-3.75, -2.0], [-1.25, 2.0], [1.25, -2.0], [3.75, 2.0]]))


@pytest.mark.parametrize("turn", [0.0, 0.3, 2.0])
@pytest.mark.parametrize(("one", "two"), [((5.0, 0.0), (1.2, 4.5)), ((5.0, 0.0), (2.3, 3.0)), ((7.0, 1.0), (2.0, 3.0))])
def test_the_labelled_points_of_an_oblique_zone_lie_on_its_border(
    one: tuple[float, float], two: tuple[float, float], turn: float
) -> None:
    """X, C and Y are the middles of three sides, H1 and H the corners between them: w(H) = w(H1)."""
    own = np.array([[np.cos(turn), np.sin(turn)], [-np.sin(turn), np.cos(turn)]])
    lattice = Lattice(*shortest_vectors((np.array(one) @ own).tolist(), (np.array(two) @ own).tolist()))
    points, corners = lattice.high_symmetry, lattice.zone
    assert lattice.name == "oblique" and lattice.default_path == "GXH1CHYG" and len(corners) == 6
    for label in ("X", "C", "Y"):
        assert lattice.is_same(points[label], -points[label])
        middles = (corners + np.roll(corners, 1, axis=0)) / 2.0
        assert np.linalg.norm(middles - points[label], axis=1).min() < 1e-9 * np.abs(corners).max()
    for label in ("H", "H1"):
        assert np.linalg.norm(corners - points[label], axis=1).min() < 1e-9 * np.abs(corners).max()
    assert lattice.is_same(points["H"], -points["H1"])


def test_a_turned_lattice_has_turned_points_and_an_equally_large_part_of_its_zone() -> None:
    turn = np.array([[0.8, 0.6], [-0.6, 0.8]])
    for plain in (Lattice.of_rows(5.0, 5.0), Lattice.of_rows(5.0, 4.0), Lattice.of_rows(5.0, 2.5 * np.sqrt(3.0), True)):
        turned = Lattice(*shortest_vectors(*(plain.vectors_m @ turn).tolist()))
        assert turned.name == plain.name and turned.default_path == plain.default_path
        round_one = ("x", "y", "d", "h")
        own = {4: ("x", "y", "d"), 6: ("x", "y", "h")}.get(len(plain.zone), ())
        own = ("x", "y") if plain == Lattice.of_rows(5.0, 4.0) else own
        assert len(turned.point_group(round_one)) == len(plain.point_group(own))
        assert area(turned.irreducible(round_one)) == pytest.approx(area(plain.irreducible(own)))
        for label, place in plain.high_symmetry.items():  # as far from the middle, though along another of alike axes
            assert np.linalg.norm(turned.high_symmetry[label]) == pytest.approx(np.linalg.norm(place))


@pytest.mark.parametrize(
    ("one", "two", "shift"),
    [
        ((5.0, 0.0), (2.5, 4.0), 2.5),
        ((-2.5, 4.0), (2.5, 4.0), 2.5),
        ((5.0, 0.0), (-11.2, 4.0), -1.2),
        ((3.8, 4.0), (-1.2, 4.0), -1.2),
    ],
)
def test_rows_of_a_lattice_are_the_same_from_any_two_vectors(
    one: tuple[float, float], two: tuple[float, float], shift: float
) -> None:
    vectors = row_vectors(one, two)
    assert vectors is not None and np.ravel(vectors) == pytest.approx([5.0, 0.0, shift, 4.0])
    turns = np.array([one, two]) @ np.linalg.inv(np.array(vectors))
    assert turns == pytest.approx(np.round(turns)) and abs(np.linalg.det(turns)) == pytest.approx(1.0)


@pytest.mark.parametrize("unit", [1e-12, 1.0, 1e12])
def test_vectors_in_any_unit_have_the_same_rows(unit: float) -> None:
    """Sums of many vectors carry their rounding, which is taken for 0 and for half a pitch at any size."""
    a1, a2 = unit * np.array([0.3, 0.0]), unit * np.array([0.15, 0.4])
    for one, two in ((a1, a2), (2.0 * a1 + a2, a1 + a2), (2.0 * a2 - 3.0 * a1, a2 - 2.0 * a1)):
        rows = rows_along_x(one.tolist(), two.tolist())
        assert rows is not None and rows[:2] == pytest.approx((0.3 * unit, 0.4 * unit)) and rows[2]
        vectors = row_vectors(one.tolist(), two.tolist())
        assert vectors is not None and vectors[1][0] == 0.5 * vectors[0][0] and vectors[0][1] == 0.0
    assert rows_along_x(a1.tolist(), (2.0 * a1).tolist()) is None
    square = rows_along_x((0.0, 0.1 * unit), (0.1 * unit, 0.3 * unit))
    assert square is not None and square == (pytest.approx(0.1 * unit), pytest.approx(0.1 * unit), False)


@pytest.mark.parametrize("unit", [1e-12, 1.0, 1e12])
@pytest.mark.parametrize("signs", [(1, 1), (1, -1), (-1, 1), (-1, -1)])
@pytest.mark.parametrize(
    ("one", "two"),
    [((3.0, 0.7), (-0.5, 4.0)), ((0.0, 3.0), (4.0, 0.5)), ((2.0, -2.5), (2.6, 2.4)), ((0.0, -1.0), (1.0, 0.0))],
)
def test_the_shortest_vectors_point_ahead_and_to_the_left(
    one: tuple[float, float], two: tuple[float, float], signs: tuple[int, int], unit: float
) -> None:
    given = unit * np.array([signs[0] * np.array(one), signs[1] * np.array(two) + signs[0] * np.array(one)])
    first, second = np.array(shortest_vectors(*given.tolist()))
    assert first[0] > 1e-9 * unit or (abs(first[0]) <= 1e-9 * unit and first[1] > 0.0)
    turned = np.degrees(np.arctan2(first[0] * second[1] - first[1] * second[0], first @ second))
    assert 60.0 - 1e-6 <= turned <= 90.0 + 1e-6
    counts = given @ np.linalg.inv(np.array([first, second]))
    assert counts == pytest.approx(np.round(counts), abs=1e-9) and abs(np.linalg.det(counts)) == pytest.approx(1.0)


def test_a_disc_beyond_the_middle_of_a_side_belongs_to_the_next_cell() -> None:
    assert place_in_cell(((5.0, 0.0), (0.0, 8.0)), (3.5, -5.0), 1.0) == pytest.approx((-1.5, 3.0))


def test_a_disc_has_one_image_in_the_cell_and_none_across_a_side() -> None:
    """A parallelogram 8 high whose leaning sides are 5 x 8 / |(6, 8)| = 4 apart holds discs up to a radius of 2."""
    vectors = (5.0, 0.0), (6.0, 8.0)
    assert place_in_cell(vectors, (0.3 + 5.0 + 12.0, 0.2 + 16.0), 1.0) == pytest.approx((0.3, 0.2))
    assert place_in_cell(vectors, (0.0, 0.0), 2.0 - SAME) == pytest.approx((0.0, 0.0))
    assert place_in_cell(vectors, (0.0, 0.0), 2.01) is None
    assert place_in_cell(vectors, (1.95, 2.6), 1.5) is None  # the upper side
    assert place_in_cell(vectors, (0.7, 0.0), 1.5) is None  # that to the right is 4 / 5 of a step along x nearer
