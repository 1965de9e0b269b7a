"""Lattices by two vectors: those of named lattices are the same design, others are oblique, and faults give one line."""

from __future__ import annotations

from math import sqrt
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from pipeline.case.model import Case, case_from_dict
from pipeline.cli.main import main
from pipeline.errors import InputError
from pipeline.planning.model_choice import by_rows, driven_band_hz

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
        ({"a1_mm": [5, 0]}, "array.a2_mm: missing, must accompany a1_mm"),
        (
            {"a1_mm": [5, 0], "a2_mm": [0, 5], "pitch_mm": 5.0},
            "array.pitch_mm = 5: cannot be combined with a1_mm and a2_mm",
        ),
        ({"a1_mm": [5, 0], "a2_mm": [0, 5], "lattice": "square"}, "array.lattice = .square.: cannot be combined"),
        ({"a1_mm": [5], "a2_mm": [0, 5]}, r"array.a1_mm = \[5\]: must be two numbers \[x, y\], a lattice vector"),
        ({"a1_mm": [0.9, 0], "a2_mm": [0, 5]}, "pillars overlap"),
        (
            {"a1_mm": [0.8, 0.5], "a2_mm": [0, 5]},
            r"array.a2_mm = \[0, 5\]: pillars overlap: neighbours are 0.8 mm apart",
        ),
        ({"a1_mm": [0.8, 0.60005], "a2_mm": [0, 5]}, "pillars almost touch"),
    ],
)
def test_other_vectors_are_refused_in_one_line(array: dict[str, Any], words: str) -> None:
    with pytest.raises(InputError, match=words) as fault:
        case(**array)
    assert len(fault.value.lines) == 1


@pytest.mark.parametrize("vectors", [([5, 0], [1, 5]), ([1, 5], [5, 0]), ([6, 5], [-5, 0]), ([5, 0], [11, 5])])
def test_other_vectors_give_an_oblique_lattice(vectors: tuple[Any, Any]) -> None:
    """In any order, and by vectors longer than need be."""
    design = case(a1_mm=vectors[0], a2_mm=vectors[1]).design
    assert np.sort(design.lattice.vectors_m, axis=0) == pytest.approx(np.sort([[5e-3, 0.0], [1e-3, 5e-3]], axis=0))
    assert design.lattice.area_m2 == pytest.approx(25e-6) and design.lattice.name == "oblique"


def test_a_turned_lattice_has_the_path_of_its_kind() -> None:
    """Round pillars have its mirrors; square ones only a quarter turn, so that no path bounds their part of the zone."""
    turned = case(a1_mm=[4, 3], a2_mm=[-3, 4])
    assert turned.design.lattice.name == "rectangular" and turned.bands.path == "GXMG"
    assert len(turned.design.lattice.point_group(turned.design.body_mirrors)) == 8
    square = case_from_dict(
        RAW | {"pillar": {"side_mm": 1.0, "height_mm": 2.0}, "array": {"a1_mm": [4, 3], "a2_mm": [-3, 4]}}
    )
    assert len(square.design.lattice.point_group(square.design.body_mirrors)) == 4
    assert square.design.lattice.border(square.design.body_mirrors) == ""


def test_squares_whose_corners_pass_each_other_may_stand_closer_than_their_diagonal() -> None:
    pillar = {"side_mm": 1.0, "height_mm": 2.0}

    def near(step: list[float]) -> Case:
        return case_from_dict(RAW | {"pillar": pillar, "array": {"a1_mm": step, "a2_mm": [0.3, 5.0]}})

    assert near([1.1, 0.7]).design.oblique_m
    with pytest.raises(InputError, match="pillars overlap"):
        near([0.9, 0.9])


@pytest.mark.parametrize("command", ["modes", "response", "explore"])
def test_commands_of_rows_refuse_an_oblique_lattice(
    command: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = tmp_path / "case.toml"
    zone = "[zone]\nlength_mm = 60.0\nwidth_mm = 12.0\nnodal_lines = 4\n"
    array = "[array]\na1_mm = [5.0, 0.0]\na2_mm = [1.0, 5.0]\nrows = 2\nextension_mm = 9.0\n"
    pillar = "[pillar]\nshape = 'round'\ndiameter_mm = 1.0\nheight_mm = 2.0\n"
    file.write_text(f"name = 'a'\nmaterial = 'aluminium'\n[plate]\nthickness_mm = 1.0\n{zone}{pillar}{array}")
    assert main([command, str(file), "--quiet"]) == 2
    said = capsys.readouterr().err
    assert "array.a2_mm of an oblique lattice" in said and len(said.strip().splitlines()) == 1


def test_attenuation_refuses_a_lattice_without_rows_along_x() -> None:
    assert by_rows(case(a1_mm=[5.0, 0.0], a2_mm=[1.2, 4.0])).design.oblique_m
    with pytest.raises(InputError, match=r"array.a1_mm: the lattice of .* has no rows along x: turn its"):
        by_rows(case(a1_mm=[5.0, 1.0], a2_mm=[1.23, 4.01]))


def test_a_band_is_requested_of_a_case_without_a_target_mode() -> None:
    assert driven_band_hz(case(pitch_mm=5.0), (1e3, 2e3)) == (1e3, 2e3)
    with pytest.raises(InputError, match=r"vectors: --band: missing"):
        driven_band_hz(case(pitch_mm=5.0), None)


def test_a_band_from_0_is_one_of_modes_alone() -> None:
    whole = case_from_dict(RAW | {"array": {"pitch_mm": 5.0, "rows": 2}, "solve": {"band_kHz": [0.0, 40.0]}})
    with pytest.raises(
        InputError, match=r"solve.band_kHz = \[0, 40\]: must begin above 0 for this command, or give --band"
    ):
        driven_band_hz(whole, None)
    assert driven_band_hz(whole, (1e3, 2e3)) == (1e3, 2e3)


def test_a_pitch_replaces_the_vectors() -> None:
    changed = case(a1_mm=[5, 0], a2_mm=[0, 5]).but({"array.pitch_mm": 6.0})
    assert changed.design.pitch_x_m == changed.design.pitch_y_m == pytest.approx(6e-3)
