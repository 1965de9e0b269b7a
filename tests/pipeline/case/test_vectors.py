"""Lattices by two vectors: those of named lattices are the same design, all others are refused in one line."""

from __future__ import annotations

from math import sqrt
from typing import Any

import pytest

from pipeline.case.model import Case, case_from_dict
from pipeline.errors import InputError

RAW: dict[str, Any] = {
    "name": "vectors",
    "material": "aluminium",
    "plate": {"thickness_mm": 1.0},
    "pillar": {"shape": "round", "diameter_mm": 1.0, "height_mm": 2.0},
}
HIGH = 2.5 * sqrt(3.0)


def case(**array: Any) -> Case:
    return case_from_dict(RAW | {"array": {"rows": 2} | array})


@pytest.mark.parametrize(
    ("vectors", "named"),
    [
        (([5, 0], [0, 5]), {"pitch_mm": 5.0, "lattice": "square"}),
        (([0, -5], [5, 5]), {"pitch_mm": 5.0, "lattice": "square"}),
        (([5, 0], [10, 4]), {"pitch_x_mm": 5.0, "pitch_y_mm": 4.0}),
        (([5.0, 0.0], [2.5, HIGH]), {"pitch_mm": 5.0, "lattice": "triangular"}),
        (([2.5, HIGH], [2.5, -HIGH]), {"pitch_mm": 5.0, "lattice": "triangular"}),
        (([2.5, 4.0], [5.0, 0.0]), {"pitch_x_mm": 5.0, "pitch_y_mm": 4.0, "lattice": "staggered"}),
    ],
)
def test_vectors_of_a_named_lattice_give_its_design(vectors: tuple[Any, Any], named: dict[str, Any]) -> None:
    one, other = case(a1_mm=vectors[0], a2_mm=vectors[1]), case(**named)
    assert one.design.lattice.vectors_m == pytest.approx(other.design.lattice.vectors_m, rel=1e-12, abs=1e-15)
    assert (one.design.lattice.name, one.bands.path) == (other.design.lattice.name, other.bands.path)
    assert one.design.cell_mirrors == other.design.cell_mirrors and "array.pitch_mm" in one.given


@pytest.mark.parametrize(
    ("array", "words"),
    [
        ({"a1_mm": [5, 0], "a2_mm": [10, 0]}, r"array.a2_mm = \[10, 0\]: parallel to a1_mm = \[5, 0\]"),
        ({"a1_mm": [0, 0], "a2_mm": [0, 5]}, "parallel to a1_mm"),
        ({"a1_mm": [5, 0], "a2_mm": [1, 5]}, "must give rows along x that are in line or shifted by half a pitch"),
        ({"a1_mm": [5, 1], "a2_mm": [0.3, 5]}, "must give rows along x"),
        ({"a1_mm": [5, 0]}, "array.a2_mm: missing, must accompany a1_mm"),
        (
            {"a1_mm": [5, 0], "a2_mm": [0, 5], "pitch_mm": 5.0},
            "array.pitch_mm = 5: cannot be combined with a1_mm and a2_mm",
        ),
        ({"a1_mm": [5, 0], "a2_mm": [0, 5], "lattice": "square"}, "array.lattice = .square.: cannot be combined"),
        ({"a1_mm": [5], "a2_mm": [0, 5]}, r"array.a1_mm = \[5\]: must be two numbers \[x, y\], a lattice vector"),
        ({"a1_mm": [0.9, 0], "a2_mm": [0, 5]}, "pillars overlap"),
    ],
)
def test_other_vectors_are_refused_in_one_line(array: dict[str, Any], words: str) -> None:
    with pytest.raises(InputError, match=words) as fault:
        case(**array)
    assert len(fault.value.lines) == 1


def test_a_pitch_replaces_the_vectors() -> None:
    changed = case(a1_mm=[5, 0], a2_mm=[0, 5]).but({"array.pitch_mm": 6.0})
    assert changed.design.pitch_x_m == changed.design.pitch_y_m == pytest.approx(6e-3)
