"""Outlines of plates read from STEP files: sizes, rims, what a polygon stands on, and files that are no plate."""

from __future__ import annotations

from math import pi
from pathlib import Path

import cadquery as cq
import numpy as np
import pytest

from geometry.errors import GeometryError
from geometry.outline import Outline, _inside, _meets, corners_of, read_outline
from tests.helpers.plate_files import disc, drilled, panel, written

MM = 1e-3


def read(shape: cq.Workplane, folder: Path) -> Outline:
    return read_outline(written(shape, folder))


def test_sizes_are_those_of_the_solid(tmp_path: Path) -> None:
    outline = read(drilled(panel(30.0, 20.0, 1.5, 4.0), 5.0, 3.0, 2.0).translate((50.0, -7.0, 0.0)), tmp_path)
    assert outline.thickness_m == pytest.approx(1.5e-3, rel=1e-12)
    assert outline.ends_m == pytest.approx([35e-3, 65e-3, -17e-3, 3e-3], abs=1e-9)
    area = 600.0 - (4.0 - pi) * 16.0 - pi * 4.0
    assert outline.volume_m3 == pytest.approx(1.5 * area * 1e-9, rel=1e-9)


BOXES = {  # on a panel of 30 x 20 mm with corners of 4 mm and a hole of radius 2 mm at (8, 3)
    "": [(-10, 5, -8, 8), (-15, 5.9, -6, 6), (-15, 15, -6, 0.9)],  # also flush with both ends
    "hole": [(-10, 6.1, -8, 8), (7.5, 8.5, 2.5, 3.5), (0, 12, -2, 9)],
    "outline": [(-15.1, 0, -6, 6), (-15, -11, 8, 10), (20, 30, 0, 1), (-20, 20, -15, 15), (-3, 3, 5, 10.001)],
}


@pytest.mark.parametrize(("under", "box"), [(under, box) for under, boxes in BOXES.items() for box in boxes])
def test_a_rectangle_is_told_from_rim_and_hole(under: str, box: tuple[float, ...], tmp_path: Path) -> None:
    outline = read(drilled(panel(), 8.0, 3.0, 2.0), tmp_path)
    assert outline.beneath(tuple(MM * end for end in box)) == under  # type: ignore[arg-type]


def test_a_pocket_of_the_back_is_a_hole_of_that_face_alone(tmp_path: Path) -> None:
    outline = read(drilled(panel(), 8.0, 3.0, 2.0, 0.4), tmp_path)
    foot = corners_of((7e-3, 9e-3, 2e-3, 4e-3))
    assert (outline.touch.beneath(foot), outline.back.beneath(foot)) == ("", "hole")


@pytest.mark.slow
def test_points_on_a_face_are_as_many_as_its_area(tmp_path: Path) -> None:
    """1e5 points drawn evenly: the share on the face is its area's to four standard deviations."""
    outline = read(disc(10.0, 4.0, 1.0), tmp_path)
    points = np.random.default_rng(1).uniform(-10e-3, 10e-3, (100_000, 2))
    share = pi * (100.0 - 16.0) / 400.0
    assert abs(outline.touch.contains(points).mean() - share) < 4.0 * (share * (1.0 - share) / 1e5) ** 0.5


def test_a_plate_goes_on_where_most_of_the_end_has_material_beyond(tmp_path: Path) -> None:
    outline = read(panel(30.0, 20.0, 1.0, 4.0), tmp_path)
    assert not outline.goes_on(15e-3, 1, -5e-3, 5e-3)
    assert outline.goes_on(14e-3, 1, -5e-3, 5e-3)
    assert not outline.goes_on(-15e-3, -1, -5e-3, 5e-3)
    assert outline.goes_on(-14e-3, -1, 0.0, 9e-3)  # part of it ends at the corner
    assert not outline.goes_on(-14e-3, -1, 8e-3, 10e-3)  # most of it does
    assert outline.goes_on(-14e-3, -1, 6e-3, 8e-3)


def test_slanted_sides_hold_what_lies_between_them() -> None:
    """A triangle with corners at (0, 0), (4, 0) and (1, 3), whose slanted sides are y = 3 x and y = 4 - x."""
    corners = np.array([[0.0, 0.0], [4.0, 0.0], [1.0, 3.0]])
    places = np.array([[0.4, 1.1], [0.3, 1.1], [2.4, 1.5], [2.6, 1.5], [1.0, 2.9], [1.0, 3.1], [2.0, 0.1], [2.0, -0.1]])
    assert _inside(places, corners).tolist() == [True, False] * 4
    assert _inside(places + 7.0, corners + 7.0).tolist() == [True, False] * 4


def test_a_segment_meets_a_polygon_where_it_crosses_a_side() -> None:
    corners = np.array([[0.0, 0.0], [4.0, 0.0], [1.0, 3.0]])
    through, from_within, beside, inside = (
        [[-1.0, 1.0], [5.0, 1.5]],
        [[1.0, 1.0], [3.0, 3.0]],
        [[2.0, 3.0], [5.0, 0.0]],
        [[1.0, 1.0], [2.0, 1.0]],
    )
    segments = np.array([through, from_within, beside, inside])
    for shift in (0.0, 7.0, -7.0):
        assert _meets(corners + shift, segments + shift).tolist() == [True, True, False, False]


def test_equal_contents_are_equal_outlines(tmp_path: Path) -> None:
    first = written(panel(), tmp_path)
    copy = tmp_path / "copy.step"
    copy.write_bytes(first.read_bytes())
    assert read_outline(first) == read_outline(copy)
    other = written(panel(31.0), tmp_path, "other.step")
    assert read_outline(first) != read_outline(other)


def test_a_file_that_changes_between_reading_and_meshing_is_refused(tmp_path: Path) -> None:
    outline = read(panel(), tmp_path)
    written(panel(31.0), tmp_path)
    with pytest.raises(GeometryError, match="has changed since it was read"):
        outline.solid()


def dome() -> cq.Workplane:
    """A segment of a circle on z = 0, 1 mm high."""
    return cq.Workplane("XZ").moveTo(-5.0, 0.0).lineTo(5.0, 0.0).threePointArc((0.0, 1.0), (-5.0, 0.0)).close()


SHAPES = {
    "its touch face must lie on z = 0": lambda: panel().translate((0.0, 0.0, 1.0)),
    "reaches from z = -0.5 to 0.5 mm": lambda: panel().translate((0.0, 0.0, -0.5)),
    "no plane face on z = 1 mm": lambda: dome().extrude(4.0),
    "holds 2 solids": lambda: panel().add(panel().translate((40.0, 0.0, 0.0))),
    "has a cavity inside": lambda: panel(thickness=3.0).cut(cq.Workplane().box(2.0, 2.0, 1.0).translate((0, 0, 1.5))),
}  # fmt: skip


@pytest.mark.parametrize("reason", SHAPES)
def test_a_solid_that_is_no_plate_is_refused_with_its_reason(reason: str, tmp_path: Path) -> None:
    with pytest.raises(GeometryError, match=reason.replace(".", r"\.")):
        read(SHAPES[reason](), tmp_path)


def test_a_missing_file_and_one_that_is_no_step_file_are_refused(tmp_path: Path) -> None:
    with pytest.raises(GeometryError, match="no such STEP file"):
        read_outline(tmp_path / "none.step")
    text = tmp_path / "text.step"
    text.write_text("not STEP\n")
    with pytest.raises(GeometryError, match="not a readable STEP file"):
        read_outline(text)


def test_a_boss_on_the_back_is_named(tmp_path: Path) -> None:
    """The rims of its top would count as those of the plate's back."""
    boss = panel(30.0, 20.0, 1.0, 4.0).union(cq.Workplane().box(8.0, 8.0, 3.0, centered=(True, True, False)))
    with pytest.raises(GeometryError, match=r"its highest face, on z = 3 mm, is 11 % of its touch face: the back must"):
        read(boss, tmp_path)
