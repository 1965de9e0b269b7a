"""Staggered rows: where pillars stand, what no shift leaves alone, and reduced cells against the whole solid mesh."""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
import pytest

from geometry.hex.boxes import boxes_of, cell_boxes, hex_mesh
from geometry.hex.scenes import HexSettings, plate_scene
from geometry.layout import region_materials
from geometry.mesh import cell_volumes
from geometry.tiling import tile
from pipeline.case.model import Case, case_from_dict
from pipeline.errors import InputError
from pipeline.logs import TerminalLog
from pipeline.models.bands import row_cell
from pipeline.models.broadband import broadband
from pipeline.models.modes import solve_modes
from pipeline.planning.mesh_rules import lattice_reduction
from pipeline.planning.model_choice import Request
from pipeline.planning.resource_estimate import pillar_count
from pipeline.questions.broadband import BroadbandResult
from pipeline.records.record import DesignRecord
from pipeline.search.terms import mass_kg
from solvers.accuracy.reduction import MARGIN, waves_of
from solvers.fem.assembly import assemble
from solvers.superelement.interface import Interface
from solvers.superelement.lattice import Periodic
from solvers.waves.bloch import BlochCell
from solvers.waves.complex_bands import Row, chain
from solvers.waves.gaps import complete_gaps, sampled_extreme, zone_gaps
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
        (("pillar.side_mm=2",), "cells half a pitch wide need array.pitch_x_mm above 4"),
        (("zone.length_mm=5",), "a shifted row contains no pillar: zone.length_mm must be at least 5.6"),
        (("tolerance.position_mm=0.07",), "3 side_mm + 6 position_mm must be below the room 0.4 mm"),
    ],
)
def test_what_cannot_be_is_refused_in_one_line(settings: tuple[str, ...], line: str) -> None:
    with pytest.raises(InputError) as caught:
        solve_modes(case_of(*settings), Request("plate", symmetry="SS"), TerminalLog(True))
    assert len(caught.value.lines) == 1 and line in caught.value.lines[0]


@pytest.mark.slow
@pytest.mark.parametrize("rows", [2, 3])
def test_the_rows_of_a_column_take_what_shifted_rows_of_a_lattice_take(rows: int) -> None:
    """The column's rows begin with the one or the other panel; the lattice repeats one row, shifted: within both bars.

    The feet at the plate's edge stand in the second panel of two rows, in the first of three.
    """
    case = case_of("solve.accuracy=0.05", "bands.count=4", "bands.points=1", f"array.rows={rows}")
    column = BroadbandResult(**broadband(case, TerminalLog(True), (90e3, 110e3), 3))
    lattice = solve(case, TerminalLog(True), (90e3, 110e3), None, 3)
    for ours, theirs in zip(column.points, lattice.points, strict=True):
        assert ours.taken_db is not None and theirs.taken_db is not None
        assert ours.taken_error_db is not None and theirs.taken_error_db is not None
        assert abs(ours.taken_db - theirs.taken_db) <= ours.taken_error_db + theirs.taken_error_db
    assert all(np.isfinite(point.confinement_db) for point in column.points)


@pytest.mark.slow
def test_the_bands_of_shifted_rows_are_those_of_the_meshed_cell() -> None:
    """Within both bars, at the corners of the zone; waves at X and at X1, its image in a mirror, are the same."""
    ask = ("bands.count=6", "bands.points=1", "solve.accuracy=0.02")
    ours = solve_bands(case_of(*ask), TerminalLog(True))
    theirs = solve_bands(case_of(*ask, "solve.model=solid"), TerminalLog(True))
    assert ours.path.labels == ("G", "X", "S", "X1", "Y", "G")
    bars = np.array(ours.error[1:-1], dtype=float) + np.array(theirs.error[1:-1], dtype=float)
    assert bars.max() < 0.02
    assert (np.abs(ours.frequencies_hz[1:-1] / theirs.frequencies_hz[1:-1] - 1.0) <= bars).all()
    for bands in (ours, theirs):
        assert bands.frequencies_hz[1] == pytest.approx(bands.frequencies_hz[3], rel=1e-6)
    assert ours.frequencies_hz[0, :3] == pytest.approx(0.0, abs=1e-3) and ours.frequencies_hz[0, 3] > 1e3


@pytest.fixture(scope="module")
def coarse() -> Periodic:
    design = case_of().design
    settings = HexSettings(3, 4e-3, 0, pillar_size_m=5e-3)
    reduction = replace(lattice_reduction(design, 0.02), interface=Interface(4, 2), hexahedra=settings, further=0)
    return row_cell(design, reduction)


@pytest.mark.slow
@pytest.mark.parametrize("along", [4, 5])
def test_bars_hold_what_further_degrees_bring(along: int) -> None:
    """On one mesh, along the sides and through the thickness: feet stand 0.2 mm from the sides of panels 2 mm thick.

    A wave that is even or odd along the sides needs every second degree alone: the fourth brings one wave at X a fifth of
    what the fifth brings.
    """
    design, edge = case_of().design, np.pi / 4e-3 * np.array([1.0, 0.0])
    settings = HexSettings(3, 4e-3, 0, pillar_size_m=5e-3, through=2)
    first = replace(lattice_reduction(design, 0.02), interface=Interface(along, 3), hexahedra=settings)
    own, errors = waves_of(row_cell(design, first), edge, 6)
    finer = row_cell(design, replace(first, interface=Interface(7, 5), further=0)).frequencies(edge, 6)
    left = own * (1.0 - errors.taken) / finer - 1.0
    assert first.further and left.max() > 1e-3
    assert (left <= MARGIN * errors.total).all() and (MARGIN * errors.total <= 12.0 * left).all()


# of the rectangle of two rows, before staggered rows had a cell of their own: frequencies in Hz at shares of (pi/p, pi/2q)
FOLDED = {
    (1.0, 0.0): [36872.89915514, 42817.55590908, 43338.96617184, 43934.55624968, 71818.93021631, 137813.6615222],
    (2.0, 0.0): [42375.15677744, 42375.15677753, 43852.20545099, 43852.205451, 137994.1564429, 137994.1564429],
    (2.0, 1.0): [42322.2731154, 42322.27311554, 43932.97859057, 43932.97859063, 137995.1602338, 137995.1602338],
    (2.0, 2.0): [42275.10383789, 42275.10383794, 44007.66854819, 44007.66854819, 137996.1524526, 137996.1524526],
    (1.0, 2.0): [41041.38340137, 41041.38340143, 43807.66162991, 43807.66162992, 116965.3479081, 116965.3479081],
    (0.0, 2.0): [36876.50707342, 36876.50707346, 43757.76238893, 43757.76238897, 71825.43426514, 71825.43426515],
    (0.0, 1.0): [15083.3950759, 41085.20015506, 42695.69681936, 43887.25577834, 47259.1747854, 93980.72746573],
}


@pytest.mark.parametrize(("shares", "expected"), FOLDED.items())
def test_bands_folded_into_the_rectangle_of_two_rows_are_what_they_were(
    coarse: Periodic, shares: tuple[float, float], expected: list[float]
) -> None:
    """Waves at k and at k + (2 pi / p, 0) are those of the rectangle at k, p the pitch along x."""
    k = np.pi / 8e-3 * np.array(shares) * np.array([1.0, 0.5])
    both = [coarse.frequencies(each, 6) for each in (k, k + np.array([2.0 * np.pi / 4e-3, 0.0]))]
    assert np.sort(np.concatenate(both))[:6] == pytest.approx(expected, rel=1e-9)


@pytest.mark.slow
def test_the_gap_over_the_irreducible_part_is_that_of_meshed_cells_over_all_of_the_zone(coarse: Periodic) -> None:
    """Of the same mesh, assembled whole, at a grid of wavevectors that knows no symmetry; the reduction lies higher."""
    design, settings = case_of().design, HexSettings(3, 4e-3, 0, pillar_size_m=5e-3)
    grid = design.lattice.grid(4, design.cell_mirrors)
    ours = np.array([coarse.frequencies(k, 7) for k in grid])
    (gap,) = zone_gaps(complete_gaps(ours), partial(sampled_extreme, grid, ours))
    system = assemble(hex_mesh(cell_boxes(design, settings), 3), region_materials(design.stack, design.pillar))
    cell = BlochCell(system, design.lattice)
    shares = np.stack(np.meshgrid(np.arange(8), np.arange(8)), axis=-1).reshape(-1, 2) / 8.0
    every = np.array([cell.frequencies(k, 7) for k in shares @ design.lattice.reciprocal_per_m])
    assert (gap.lower_band, gap.upper_band) == (6, 7)
    rise = np.array([gap.lower_hz / every[:, 5].max(), gap.upper_hz / every[:, 6].min()]) - 1.0
    assert (rise > 0.0).all() and rise.max() < 5e-3


@pytest.mark.slow
def test_bands_over_the_irreducible_part_are_those_over_the_whole_zone(coarse: Periodic) -> None:
    """Extremes of every band, from grids of one spacing; the part is a quarter by the two mirrors."""
    lattice = case_of().design.lattice
    shares = np.stack(np.meshgrid(np.arange(12), np.arange(12)), axis=-1).reshape(-1, 2) / 12.0
    part = lattice.grid(6, ("x", "y"))
    every, few = (
        np.array([coarse.frequencies(k, 6) for k in grid]) for grid in (shares @ lattice.reciprocal_per_m, part)
    )
    assert len(part) < len(shares) / 2
    assert few[:, 3:].min(axis=0) == pytest.approx(every[:, 3:].min(axis=0), rel=1e-7)
    assert few.max(axis=0) == pytest.approx(every.max(axis=0), rel=1e-7)


GENERIC = np.array([200.0, 150.0])


@pytest.mark.parametrize("shift", [0, 1])
def test_two_equal_cells_are_a_lattice_of_one_folded_once(coarse: Periodic, shift: int) -> None:
    """Side by side at k and k + (pi / w, 0) of the lattice of one; shifted by one at k and k + (pi / w, pi / h)."""
    (cell, _), turn = coarse.cells, np.pi * np.array([1.0 / 2e-3, shift / 4e-3])
    both = [Periodic([cell]).frequencies(k, 8) for k in (GENERIC, GENERIC + turn)]
    ours = Periodic([cell, cell], shift).frequencies(GENERIC, 8)
    assert ours == pytest.approx(np.sort(np.concatenate(both))[:8], rel=1e-9)


def test_waves_at_their_frequencies_have_their_wavenumbers_across_the_rows(coarse: Periodic) -> None:
    """The lattice closed by a phase at a real wavevector, and the open row at a real frequency; both leave modes out alike."""
    whole = Periodic([replace(cell, dropped=0.0 * cell.dropped) for cell in coarse.cells], shift=1)
    row = Row(whole, GENERIC[0])
    for tone in whole.frequencies(GENERIC, 6):
        ky = row.waves(float(tone)).wavenumber_per_m
        assert np.abs(ky - GENERIC[1]).min() < 1e-5 * GENERIC[1]


def test_two_shifted_rows_are_two_rows_that_begin_with_the_other_panel(coarse: Periodic) -> None:
    pillar, bare = coarse.cells
    two = chain(Row(Periodic(each), 200.0).condensed(35e3)[0] for each in ([pillar, bare], [bare, pillar]))
    one = chain(2 * [Row(coarse, 200.0).condensed(35e3)[0]])
    for name in ("bb", "bt", "tb", "tt"):
        ours, theirs = (np.abs(getattr(each, name)) for each in (one, two))
        assert ours == pytest.approx(theirs, abs=1e-9 * theirs.max())


def test_rows_of_bare_panels_are_the_plate_itself(coarse: Periodic) -> None:
    """Its waves pass undamped, and its flexural wave's wavenumber is that of the same panels in line."""
    bare = coarse.cells[1]
    ours, line = (Row(each, 200.0).waves(35e3) for each in (Periodic([bare, bare], shift=1), bare))
    passing = [each.wavenumber_per_m[each.flux > 0.0] for each in (ours, line)]
    assert len(passing[1]) and passing[0] == pytest.approx(passing[1], rel=1e-6)


def test_motion_within_a_deep_stack_falls_by_the_least_decay(coarse: Periodic) -> None:
    """Of rows driven at one edge and clamped at the other, from row to row, as far as the next wave has died away."""
    row = Row(coarse, 200.0)
    one = row.condensed(10e3)[0]
    size = np.abs(row.waves(10e3).factor)
    driven = np.random.default_rng(1).normal(size=len(one.bb))

    def moved(rows: int, of: int = 14) -> float:
        lower, upper = chain([one] * rows), chain([one] * (of - rows))
        return float(np.linalg.norm(np.linalg.solve(lower.tt + upper.bb, lower.tb @ driven)))

    assert 0.0 < size[0] < 0.99 and size[1] < 0.9 * size[0]
    assert moved(7) / moved(6) == pytest.approx(size[0], rel=5.0 * (size[1] / size[0]) ** 6)


@pytest.mark.slow
def test_the_command_answers_staggered_rows() -> None:
    """With bars, and a wave at the frequency of a band that passes undamped as the bands have it."""
    case = case_of("bands.count=4", "bands.points=1", "solve.accuracy=0.05")
    result = solve(case, TerminalLog(True), (20e3, 36e3), 200.0, 3)
    assert result.reduction_error is not None and 0.0 < result.reduction_error < 0.05
    assert [point.waves[0].polarisation for point in result.points] == ["flexural"] * 3
    assert all(point.db_error is not None and point.transmission for point in result.points)


@pytest.mark.slow
def test_staggered_cells_have_the_modes_of_the_whole_solid_within_both_bars() -> None:
    check_within_both_bars(RAW, (25e3, 60e3))
