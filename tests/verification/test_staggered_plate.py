"""Staggered rows: where pillars stand, what no shift leaves alone, and reduced cells against the whole solid mesh."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from geometry.hex.boxes import boxes_of, hex_mesh
from geometry.hex.scenes import HexSettings, plate_scene
from geometry.mesh import cell_volumes
from geometry.tiling import tile
from pipeline.case.model import Case, case_from_dict
from pipeline.errors import InputError
from pipeline.logs import TerminalLog
from pipeline.models.broadband import broadband
from pipeline.models.modes import solve_modes
from pipeline.planning.foresight import pillar_count
from pipeline.planning.mesh_rules import lattice_reduction
from pipeline.planning.model_choice import Request
from pipeline.records.record import DesignRecord
from pipeline.search.limits import mass_kg
from solvers.plates.assembled import Reductions
from solvers.plates.supercell import Supercell, staggered_tiling
from solvers.superelement.interface import Interface
from tests.helpers.asked import attenuation_of as solve
from tests.helpers.asked import solve_bands
from tests.helpers.whole_solid import check_within_both_bars

RAW: dict[str, Any] = {
    "name": "staggered",
    "material": "aluminium",
    "plate": {"thickness_mm": 2.0},
    "zone": {"length_mm": 12.0, "width_mm": 8.0, "nodal_lines": 2},
    "pillar": {"shape": "square", "side_mm": 1.6, "height_mm": 5.0},
    "array": {"pitch_mm": 4.0, "rows": 2, "stagger": True, "extension_mm": 1.0},
    "solve": {"accuracy": 0.01},
}


def case_of(*settings: str) -> Case:
    return case_from_dict(RAW, None, settings)


def test_every_other_row_stands_between_the_pillars_of_its_neighbours() -> None:
    design = case_of("array.rows=3").design
    assert 1e3 * design.column_centres(0) == pytest.approx([-4.0, 0.0, 4.0])
    assert 1e3 * design.column_centres(1) == pytest.approx([-2.0, 2.0]) and len(design.column_centres(2)) == 3
    centres = 1e3 * design.pillar_centres()
    assert len(centres) == pillar_count(design) == 16
    assert centres[:4] == pytest.approx(np.array([[-4.0, -12.8], [0.0, -12.8], [4.0, -12.8], [-2.0, -8.8]]))
    images = {tuple(row) for row in np.round(centres, 9).tolist()}
    assert images == {(-x, y) for x, y in images} == {(x, -y) for x, y in images}, "the plate keeps its mirrors"


def test_masses_meshes_and_records_count_its_pillars() -> None:
    design, line = case_of().design, case_of("array.stagger=false").design
    assert mass_kg(line) - mass_kg(design) == pytest.approx(2.0 * 1.6e-3**2 * 5e-3 * 2700.0)
    mesh = hex_mesh(boxes_of(plate_scene(design, HexSettings(1, 4e-3, 0))), 1)
    assert cell_volumes(mesh)[mesh.regions["pillar"]].sum() == pytest.approx(2.5 * 1.6e-3**2 * 5e-3)
    record = DesignRecord.of_design(design)
    assert record.staggered and len(record.standing) == len(record.pillar_centres_m) == 10


def test_panels_half_a_pitch_wide_carry_a_pillar_in_every_other_one() -> None:
    tiling = tile(case_of().design, 6e-3)
    assert 1e3 * np.diff(tiling.x)[1:-1] == pytest.approx(2.0)
    assert len(tiling.feet) == 10
    for (i, j), (x, y) in tiling.feet.items():
        assert tiling.x[i] < x - 0.8e-3 and x + 0.8e-3 < tiling.x[i + 1] and tiling.y[j] < y < tiling.y[j + 1]
        assert (i + 1, j) not in tiling.feet


@pytest.mark.slow
def test_one_row_has_nothing_to_be_shifted_beside() -> None:
    query = Request("plate", near_hz=30e3, count=2, symmetry="SS", search=False)
    ours, theirs = (
        solve_modes(case_of("array.rows=1", "solve.accuracy=0.05", f"array.stagger={each}"), query, TerminalLog(True))
        for each in ("true", "false")
    )
    assert [row.frequency_hz for row in ours.rows] == [row.frequency_hz for row in theirs.rows]
    assert "stagger" not in case_of("array.stagger=false").to_dict()["design"]


@pytest.mark.parametrize(
    ("settings", "line"),
    [
        (("pillar.side_mm=2",), "cells of half a pitch need array.pitch_x_mm above 4"),
        (("zone.length_mm=5",), "a shifted row holds no pillar: zone.length_mm must be at least 5.6"),
        (("tolerance.height_mm=0.1",), "must be left out beside array.stagger = true"),
    ],
)
def test_what_cannot_be_is_refused_in_one_line(settings: tuple[str, ...], line: str) -> None:
    with pytest.raises(InputError) as caught:
        solve_modes(case_of(*settings), Request("plate", symmetry="SS"), TerminalLog(True))
    assert len(caught.value.lines) == 1 and line in caught.value.lines[0]


def test_one_row_beside_the_other_is_no_part_of_it() -> None:
    for command in (solve, broadband):
        with pytest.raises(InputError, match=r"array\.stagger = true"):
            command(case_of(), TerminalLog(True))  # type: ignore[operator]


@pytest.mark.slow
def test_the_bands_of_two_rows_are_those_of_the_meshed_rectangle() -> None:
    """Within both bars; a glide between the rows makes waves at X equal in pairs."""
    ask = ("bands.count=8", "bands.points=1", "bands.path=GXM", "solve.accuracy=0.02")
    ours = solve_bands(case_of(*ask), TerminalLog(True))
    theirs = solve_bands(case_of(*ask, "solve.model=solid"), TerminalLog(True))
    assert ours.path.wavevectors == pytest.approx(np.pi / 4e-3 * np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 0.5]]))
    bars = np.array(ours.error[1:], dtype=float) + np.array(theirs.error[1:], dtype=float)
    assert bars.max() < 0.02 and (np.abs(ours.frequencies_hz[1:] / theirs.frequencies_hz[1:] - 1.0) <= bars).all()
    assert ours.frequencies_hz[1, ::2] == pytest.approx(ours.frequencies_hz[1, 1::2], rel=1e-6)
    assert ours.frequencies_hz[0, :3] == pytest.approx(0.0, abs=1e-3) and ours.frequencies_hz[0, 3] > 1e3


def test_two_rows_in_line_are_a_lattice_folded_once() -> None:
    """At kx = 0 the rectangle's waves at ky = 0 are the one row's at ky = 0 and pi / pitch together."""
    case = case_of("bands.count=6", "solve.accuracy=0.02")
    design, coarse = case.design, HexSettings(3, 4e-3, 0, pillar_size_m=5e-3)
    reduction = replace(lattice_reduction(design, 0.02), interface=Interface(4, 2), hexahedra=coarse)
    reductions = Reductions(design.thickness_m, design.material, design.pillar, reduction)
    shifted = staggered_tiling(design)
    line = replace(shifted, feet={(0, 0): (0.0, -2e-3), (0, 1): (0.0, 2e-3)})
    folded = Supercell(line, reductions).frequencies(np.zeros(2), 8)
    single = Supercell(replace(line, y=line.y[:2], feet={(0, 0): (0.0, -2e-3)}), reductions)
    both = [single.frequencies(np.array([0.0, ky]), 8) for ky in (0.0, np.pi / 4e-3)]
    assert folded[3:] == pytest.approx(np.sort(np.concatenate(both))[3:8], rel=1e-8)


@pytest.mark.slow
def test_staggered_cells_have_the_modes_of_the_whole_solid_within_both_bars() -> None:
    check_within_both_bars(RAW, (25e3, 60e3))
