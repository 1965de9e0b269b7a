"""Triangular lattices: six-fold degeneracies, the rectangular supercell of two pillars, and what a case may say."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from geometry.lattice import Lattice
from pipeline.case.model import Case, case_from_dict
from pipeline.errors import InputError
from pipeline.logs import TerminalLog
from pipeline.questions.bands import BandPoint
from tests.helpers.asked import bands_of

LOG = TerminalLog(True)
ROUND, SQUARE = {"shape": "round", "diameter_mm": 2.0}, {"side_mm": 2.0}


def case(shape: dict[str, Any], array: dict[str, Any] | None = None, *more: str) -> Case:
    raw = {
        "name": "triangular",
        "material": "aluminium",
        "plate": {"thickness_mm": 1.0},
        "pillar": shape | {"height_mm": 3.0},
        "array": {"pitch_mm": 5.0, "rows": 2, "lattice": "triangular"} if array is None else array,
        "bands": {"points": 1, "count": 6},
        "solve": {"accuracy": 0.02},
    }
    return case_from_dict(raw, None, more)


def test_a_triangular_lattice_has_a_hexagonal_zone() -> None:
    lattice = case(ROUND).design.lattice
    assert lattice.name == "triangular" and len(lattice.zone) == 6
    k, m = 4.0 * np.pi / (3.0 * 5e-3), 2.0 * np.pi / (np.sqrt(3.0) * 5e-3)
    radii = {label: np.linalg.norm(place) for label, place in lattice.high_symmetry.items()}
    assert radii == pytest.approx({"G": 0.0, "M": m, "M1": m, "K": k, "K1": k})
    assert len(lattice.point_group("xyh")) == 12 and len(lattice.point_group("xy")) == 4
    assert Lattice.of_rows(5e-3, 4.33e-3, True).name == "staggered"


def test_the_path_follows_the_symmetry_of_the_pillar() -> None:
    """A square pillar leaves two mirrors: M and K have two kinds each."""
    assert case(ROUND).bands.path == "GMKG" and case(ROUND).design.cell_mirrors == ("x", "y", "h")
    assert case({"shape": "hexagonal", "side_mm": 2.0}).bands.path == "GMKG"
    assert case(SQUARE).bands.path == "GM1K1MKG" and case(SQUARE).design.cell_mirrors == ("x", "y")
    assert case(ROUND, None, "bands.path=GKM").bands.path == "GKM"


@pytest.mark.slow
def test_a_round_pillar_moves_alike_in_six_directions() -> None:
    """By a mesh that has two mirrors alone: M is M1, K is K1, and K has pairs; all within the bars."""
    found = {
        point.label: point for point in bands_of(case(ROUND, None, "bands.path=GM1K1MKG"), LOG).points if point.label
    }
    for one, two in (("M", "M1"), ("K", "K1")):
        ours, theirs = found[one], found[two]
        for hz, bar, other, other_bar in zip(
            ours.frequencies_hz, ours.error, theirs.frequencies_hz, theirs.error, strict=True
        ):
            assert bar is not None and other_bar is not None and abs(hz / other - 1.0) <= bar + other_bar
    pair, bars = found["K"].frequencies_hz[:2], found["K"].error[:2]
    assert None not in bars and pair[1] / pair[0] - 1.0 <= sum(bars)  # type: ignore[arg-type]
    assert found["M"].frequencies_hz[1] / found["M"].frequencies_hz[0] > 1.1


@pytest.mark.parametrize(
    ("array", "words"),
    [
        (
            {"pitch_x_mm": 5.0, "pitch_y_mm": 4.0, "rows": 2, "lattice": "triangular"},
            "pitch_x_mm = 5: must be left out",
        ),
        ({"pitch_mm": 5.0, "rows": 1, "pitches_y_mm": [4.0], "lattice": "triangular"}, "pitches_y_mm"),
        ({"pitch_x_mm": 5.0, "pitch_y_mm": 4.0, "rows": 2, "lattice": "square"}, "must equal pitch_x_mm in a square"),
        ({"pitch_mm": 5.0, "rows": 2, "lattice": "rectangular", "stagger": True}, "whose rows are in line"),
        ({"pitch_mm": 5.0, "rows": 2, "lattice": "hexagonal"}, "square, rectangular, staggered or triangular"),
    ],
)
def test_what_contradicts_the_lattice_is_named(array: dict[str, Any], words: str) -> None:
    with pytest.raises(InputError, match=words):
        case(SQUARE, array)


def alike(ours: list[BandPoint], theirs: list[BandPoint]) -> None:
    for one, two in zip(ours, theirs, strict=True):
        for hz, bar, other, its in zip(one.frequencies_hz, one.error, two.frequencies_hz, two.error, strict=True):
            assert bar is not None and its is not None and bar < 0.02
            assert hz < 1.0 or abs(hz / other - 1.0) <= bar + its


@pytest.mark.slow
def test_an_oblique_cell_has_the_bands_of_panels_half_a_pitch_wide(monkeypatch: pytest.MonkeyPatch) -> None:
    """Square pillars, other elements and other sides to join at: within the sum of the bars."""
    path = "bands.path=GM1KG"
    panels = bands_of(case(SQUARE, None, path), LOG)
    monkeypatch.setattr("pipeline.planning.model_choice._is_too_wide", lambda _: True)
    cell = bands_of(case(SQUARE, None, path), LOG)
    assert cell.dof != panels.dof
    alike(cell.points, panels.points)


@pytest.mark.slow
def test_round_pillars_wider_than_half_a_pitch_move_alike_in_six_directions() -> None:
    """In an oblique cell, whose mesh has none of the mirrors: M is M1, K is K1."""
    points = bands_of(case({"shape": "round", "diameter_mm": 3.4}, None, "bands.path=GM1K1MKG"), LOG).points
    alike(points, [points[index] for index in (0, 3, 4, 1, 2, 5)])


def test_pillars_beyond_the_sides_of_the_oblique_cell_are_refused_by_the_lattice() -> None:
    with pytest.raises(InputError, match=r"array.lattice = 'triangular': .* need array.pitch_mm above 6"):
        bands_of(case({"side_mm": 3.2}), LOG)


def test_a_staggered_lattice_is_that_of_shifted_rows() -> None:
    array = {"pitch_x_mm": 5.0, "pitch_y_mm": 4.0, "rows": 2}
    one, other = case(SQUARE, array | {"lattice": "staggered"}), case(SQUARE, array | {"stagger": True})
    assert one.design == other.design and one.design.is_staggered


@pytest.mark.slow
def test_the_reduced_cell_and_the_whole_solid_have_one_answer() -> None:
    """Square pillars, a path that both kinds of M and K bound: within the sum of the bars."""
    models = ("solve.accuracy=0.005",), ("solve.model=solid",)
    ours, whole = (bands_of(case(SQUARE, None, *own), LOG) for own in models)
    for one, two in zip(ours.points, whole.points, strict=True):
        pairs = zip(one.frequencies_hz, one.error, two.frequencies_hz, two.error, strict=True)
        for hz, bar, other, other_bar in pairs:
            assert bar is not None and other_bar is not None
            assert other < 1.0 or abs(hz / other - 1.0) <= bar + other_bar
