"""Plates with pillars that are no boxes, joined from cells of tetrahedra, against the whole plate and against hexahedra."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

from pipeline.case.model import Case, load_case
from pipeline.logs import TerminalLog
from pipeline.models.modes import PartModes, Request, solve_modes

PLATE = """name = "small"
material = "aluminium"
[plate]
thickness_mm = 2.0
[zone]
length_mm = 22.0
width_mm = 10.0
nodal_lines = 2
[pillar]
{pillar}
[array]
pitch_mm = 4.0
rows = 1
extension_mm = 3.0
[solve]
accuracy = 0.01
"""
ROUND = 'shape = "round"\ndiameter_mm = 2.2\nheight_mm = 6.3'
TAPERED = 'shape = "tapered"\nbase_mm = 2.4\ntip_mm = 1.6\nheight_mm = 6.3'
SQUARE = 'shape = "square"\nside_mm = 2.0\nheight_mm = 6.3'
BAND_HZ = (15e3, 32e3)


def case(tmp_path: Path, pillar: str, **solve: object) -> Case:
    path = tmp_path / "small.toml"
    path.write_text(PLATE.format(pillar=pillar))
    read = load_case(path)
    return replace(read, solve=read.solve.but(**solve))  # type: ignore[arg-type]


def solved(of: Case) -> PartModes:
    return solve_modes(of, Request("plate", band_hz=BAND_HZ, symmetry="SS"), TerminalLog(True))


def check_within_both_bars(first: PartModes, second: PartModes) -> None:
    assert len(first.rows) == len(second.rows) >= 2
    for one, other in zip(first.rows, second.rows, strict=True):
        assert one.error is not None and other.error is not None
        assert abs(one.frequency_hz / other.frequency_hz - 1.0) <= one.error + other.error < 0.02


@pytest.mark.slow
@pytest.mark.parametrize("pillar", [ROUND, TAPERED], ids=["round", "tapered"])
def test_the_joined_plate_has_the_modes_of_the_whole_body(tmp_path: Path, pillar: str) -> None:
    """Sorted frequencies within both bars, equal counts."""
    joined, whole = (solved(case(tmp_path, pillar, mesh="tet", model=model)) for model in ("auto", "solid"))
    assert joined.model.name == "superelement tet2" and whole.model.name == "solid tet2"
    check_within_both_bars(joined, whole)


@pytest.mark.slow
def test_cells_of_tetrahedra_and_of_hexahedra_make_the_same_plate(tmp_path: Path) -> None:
    """The same square pillars by both meshes."""
    boxes, cad = solved(case(tmp_path, SQUARE)), solved(case(tmp_path, SQUARE, mesh="tet"))
    assert boxes.model.name.startswith("superelement hex") and cad.model.name == "superelement tet2"
    check_within_both_bars(boxes, cad)
