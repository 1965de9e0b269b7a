"""One column of cells at the target wavenumber against the assembled plate and against exact waves."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise
from math import pi

import numpy as np
import pytest
import scipy.sparse as sp
from scipy.linalg import eigh

from geometry.hex.scenes import HexSettings
from geometry.layout import Design, Pillar
from geometry.materials import MATERIALS, Material, Stack
from geometry.tiling import Panel, Tiling, signature, tile
from solvers.accuracy.calibration import mixing
from solvers.accuracy.reduction import MARGIN
from solvers.analytic.predesign import free_kx_per_m
from solvers.fem.eigen import modes_in_band
from solvers.measures.confinement import measure
from solvers.measures.target_mode import verdict
from solvers.plates.assembled import PlateModel, Reductions
from solvers.plates.column import Column, column_strips
from solvers.plates.strip import strip_modes
from solvers.superelement.interface import Interface, ReductionSettings
from solvers.superelement.plate import WHOLE, AssembledPlate

ALUMINIUM = MATERIALS["aluminium"]
DESIGN = Design(40e-3, 12e-3, 2e-3, 4, ALUMINIUM, Pillar("square", 2e-3, 2e-3, 6.3e-3, ALUMINIUM), 4e-3, 4e-3, 1, 6e-3)
REDUCTION = ReductionSettings(Interface(4, 3), 250e3, HexSettings(3, 4e-3, 0, 0.25, 3.15e-3))


def reductions(design: Design, reduction: ReductionSettings = REDUCTION) -> Reductions:
    return Reductions(design.stack, design.pillar, reduction)


@pytest.mark.parametrize("extension_m", [0.0, 1e-3, 6e-3])
def test_the_pieces_fill_half_the_plate_and_hold_every_row(extension_m: float) -> None:
    design = replace(DESIGN, rows=2, extension_m=extension_m)
    panels = [panel for (panel,) in column_strips(design, 6e-3)]
    assert panels[0].low[1] == pytest.approx(0.0, abs=1e-12)
    assert panels[-1].high[1] == pytest.approx(design.half_span_m)
    assert all(a.high[1] == b.low[1] for a, b in pairwise(panels))
    feet = [panel.foot[1] for panel in panels if panel.foot]
    assert feet == pytest.approx(design.row_centres().tolist())


def test_at_no_wavenumber_a_bare_column_is_a_free_beam() -> None:
    """k = 0, no pillars: cylindrical bending of a free plate, first even mode within what shear takes (about 1 %)."""
    bare = replace(DESIGN, pillar=None, rows=0)
    span, rigidity = 24e-3, 70e9 * 2e-3**3 / 12.0 / (1.0 - 0.34**2)
    thin = (4.730040745 / span) ** 2 / (2.0 * pi) * np.sqrt(rigidity / (2700.0 * 2e-3))
    result = Column(bare, reductions(bare), 0.0).modes(0.7 * thin, 1.05 * thin)
    flexural = result.frequency_hz[result.confinement.mac > 0.3]
    assert len(flexural) == 1
    shear = (pi / (span / 1.5)) ** 2 * (2e-3) ** 2 / 12.0 * (1.0 + 2.4 / (1.0 - 0.34))  # of k^2 (rotation and shear)
    assert 1.0 - shear < flexural[0] / thin < 1.0


def test_a_thin_bare_column_is_the_strip_of_plate_theory() -> None:
    """The same free strip at the same wavenumber by thin-plate elements: two methods that share no code, 1 % apart beside
    what rotation and shear take, k^2 h^2 / 24 (1 + 2.4 / (1 - nu)), k^2 = omega sqrt(rho h / D).
    """
    bare = replace(DESIGN, pillar=None, rows=0, thickness_m=0.5e-3)
    kx = free_kx_per_m(bare)
    thin = strip_modes(bare, 1e3, 40e3)
    settings = HexSettings(3, 3e-3, 0, 0.25)
    result = Column(
        bare, Reductions(Stack.of(0.5e-3, ALUMINIUM), None, replace(REDUCTION, hexahedra=settings)), kx
    ).modes(1e3, 40e3)
    flexural = [
        float(result.frequency_hz[np.argmin(np.abs(result.frequency_hz / tone - 1.0))]) for tone in thin.frequency_hz
    ]
    assert len(thin.frequency_hz) >= 3
    rigidity = 70e9 * 0.5e-3**3 / 12.0 / (1.0 - 0.34**2)
    square = 2.0 * pi * thin.frequency_hz * np.sqrt(2700.0 * 0.5e-3 / rigidity)
    shear = square * 0.5e-3**2 / 24.0 * (1.0 + 2.4 / (1.0 - 0.34))
    ratio = np.array(flexural) / thin.frequency_hz
    assert (ratio < 1.01).all() and (ratio > 0.99 - shear).all() and shear.max() < 0.02


def test_driven_at_its_target_mode_the_zone_is_confined_as_the_mode() -> None:
    """With hardly any loss the resonance alone is left: neighbours lie 1 % away or more, and are 1e-5 of it."""
    column = Column(DESIGN, reductions(DESIGN), 3.5 * pi / DESIGN.length_m)
    modes = column.modes(28e3, 44e3)
    at = modes.confinement.target.index
    assert at is not None
    driven = column.driven(modes.frequency_hz[at : at + 1], 1e7)
    assert driven.confinement_db[0] == pytest.approx(modes.confinement.confinement_db[at], abs=0.01)
    assert column.driven(0.97 * modes.frequency_hz[at : at + 1], 1e7).confinement_db[0] != pytest.approx(
        driven.confinement_db[0], abs=0.01
    )


@pytest.mark.slow
def test_rows_that_differ_stand_in_the_column_as_in_the_plate() -> None:
    """Equal rows listed one by one are equal rows to the last bit; another height in the second row alone is not."""
    assert DESIGN.pillar
    two, other = replace(DESIGN, rows=2), replace(DESIGN.pillar, height_m=5e-3)
    rough = replace(REDUCTION, interface=Interface(2, 2))
    pencils = {
        name: Column(replace(two, graded=graded), reductions(two, rough), 250.0).pencil()[0]
        for name, graded in (("equal", ()), ("listed", (DESIGN.pillar,) * 2), ("graded", (DESIGN.pillar, other)))
    }
    assert (pencils["equal"] == pencils["listed"]).all()
    assert not np.array_equal(pencils["equal"].shape, pencils["graded"].shape) or (
        np.abs(pencils["equal"] - pencils["graded"]).max() > 0.0
    )
    strips = column_strips(replace(two, graded=(DESIGN.pillar, other)), 6e-3)
    kinds = [panel.pillar for (panel,) in strips if panel.foot]
    assert kinds == [DESIGN.pillar, other]


class Ring(Tiling):
    """One pitch of a plate without end along x: nothing is free there."""

    def free_sides(self, i: int, j: int) -> tuple[str, ...]:
        return tuple(side for side in super().free_sides(i, j) if side[0] == "y")


def ring_hz(design: Design, reductions: Reductions, kx_per_m: float) -> np.ndarray:
    """Every mode of one pitch of staggered rows: a plate two panels wide, whose ends along x are tied by a phase."""
    y, half = tile(design, reductions.reduction.max_edge_m).y, design.pitch_x_m / 2.0
    rows = zip(design.row_places().tolist(), [*range(design.rows)[::-1], *range(design.rows)], strict=True)
    feet = {(n % 2, int(np.searchsorted(y, at)) - 1): ((n % 2 - 0.5) * half, at) for at, n in rows}
    tiling = Ring(np.array([-half, 0.0, half]), y, feet)
    panels = [tiling.panel(i, j) for i, j in tiling.representatives(True)]
    plate = AssembledPlate(tiling, {signature(panel): reductions.cell(panel) for panel in panels}, WHOLE)
    grid, face = plate.grid, plate.grid.interface
    master, phase = np.arange(grid.count), np.ones(grid.count, dtype=complex)
    for j in range(grid.ny):
        first, last = grid.dofs(0, j), grid.dofs(1, j)
        for low, high in (
            (face.vertex(0), face.vertex(1)),
            (face.vertex(2), face.vertex(3)),
            (face.side(0), face.side(1)),
        ):
            master[last[high]], phase[last[high]] = first[low], np.exp(1j * kx_per_m * design.pitch_x_m)
    alive = np.flatnonzero(~grid._idle())
    _, column = np.unique(master[alive], return_inverse=True)
    turn = sp.csr_array((phase[alive], (np.arange(len(alive)), column)))
    pencil = plate.pencil()
    k, m = ((turn.conj().T @ matrix @ turn).toarray() for matrix in (pencil.stiffness, pencil.mass))
    return np.asarray(pencil.scale.frequency(eigh(k, m, eigvals_only=True)))


@pytest.mark.slow
@pytest.mark.parametrize(
    ("rows", "extension_m"),
    [(2, 0.0), pytest.param(3, 0.0, marks=pytest.mark.slow), pytest.param(2, 2e-3, marks=pytest.mark.slow)],
)
def test_a_column_of_staggered_rows_is_a_plate_two_panels_wide_with_its_ends_tied(
    rows: int, extension_m: float
) -> None:
    """Its modes are those even about y = 0, to rounding, also where the last feet are flush with the plate's edge."""
    staggered = replace(DESIGN, pitch_x_m=8e-3, rows=rows, stagger=True, extension_m=extension_m)
    own, kx = reductions(staggered, replace(REDUCTION, interface=Interface(3, 2))), 3.5 * pi / DESIGN.length_m
    column = Column(staggered, own, kx)
    tones, whole = column.solve(10e3, 60e3)[0], ring_hz(staggered, own, kx)
    inside = whole[(whole > 10e3) & (whole < 60e3)]
    assert 5 < len(tones) < len(inside)
    assert np.abs(tones[:, None] / inside - 1.0).min(axis=1).max() < 1e-9
    line = Column(replace(staggered, stagger=False), own, kx).solve(10e3, 60e3)[0]
    assert np.abs(tones[:, None] / line - 1.0).min(axis=1).max() > 1e-3


TONES_HZ = np.linspace(20e3, 36e3, 5)
SHIFT_M = 2e-3  # of each row beyond the one before
ASIDE = replace(DESIGN, width_m=8e-3, pitch_x_m=6e-3, pitch_y_m=6e-3, rows=2, extension_m=5e-3)
OBLIQUE = replace(ASIDE, oblique_m=((6e-3, 0.0), (SHIFT_M, 6e-3)))


@pytest.mark.slow
def test_rows_of_oblique_cells_are_feet_aside_in_rectangles(monkeypatch: pytest.MonkeyPatch) -> None:
    """Two rows, one cell each: parallelograms about their feet, or rectangles with feet on either side of their middles.

    Modes and the levels of the driven zone, within the sums of both bars; rows in line are further away.
    """
    fine = replace(REDUCTION, hexahedra=replace(REDUCTION.hexahedra, layers=1, factor=0.15))

    def aside(design: Design, *more: object) -> list[tuple[Panel, ...]]:
        places = iter((-SHIFT_M / 2.0, SHIFT_M / 2.0))
        strips = column_strips(design, *more)  # type: ignore[arg-type]
        return [
            tuple(replace(p, foot=(next(places), p.foot[1]), halved=(1,)) if p.foot else p for p in strip)
            for strip in strips
        ]

    def driven(design: Design) -> tuple[np.ndarray, ...]:
        column = Column(design, reductions(design, fine), 500.0).driven(TONES_HZ, 300.0)
        errors = column.errors()
        bar = errors.mesh + MARGIN * errors.total
        return column.modes.frequency_hz[:6], bar[:6], column.confinement_db, column.bar_db(bar, mixing() or np.nan)

    tones, bar, level, bar_db = driven(OBLIQUE)
    line = driven(ASIDE)
    monkeypatch.setattr("solvers.plates.column.column_strips", aside)
    other, its_bar, its_level, its_bar_db = driven(ASIDE)
    assert (np.abs(other / tones - 1.0) <= bar + its_bar).all() and (bar + its_bar)[:4].max() < 0.01
    assert (np.abs(level - its_level) <= bar_db + its_bar_db).all()
    assert (np.abs(line[0] / tones - 1.0) > bar + line[1])[:3].all()


@pytest.mark.slow
def test_oblique_cells_of_almost_no_pillars_are_the_same_plate_as_rectangular_ones() -> None:
    """Frequencies within the truncation errors, and the likeness to the target shape, which is counted along x from one line.

    Counted from elsewhere in the first row by half of its shift, 0.35 rad, it would fall by 0.02.
    """
    feather = Material.isotropic("feather", 70e3, 2.7e-3, 0.34)  # a millionth of aluminium, in which waves are as fast
    rows, rough = replace(OBLIQUE, pillar=Pillar("square", 2e-3, 2e-3, 1e-3, feather)), Interface(4, 2)
    tones, likeness, errors = [], [], []
    for design in (rows, replace(rows, oblique_m=None)):
        driven = Column(design, reductions(design, replace(REDUCTION, interface=rough)), 350.0).driven(TONES_HZ, 300.0)
        inside = (driven.modes.frequency_hz > 30e3) & (driven.modes.frequency_hz < 150e3)
        tones.append(driven.modes.frequency_hz[inside])
        likeness.append(driven.modes.confinement.mac[inside])
        errors.append(driven.errors().total[inside])
    assert len(tones[0]) == len(tones[1]) == 3
    assert (np.abs(tones[0] / tones[1] - 1.0) <= sum(errors)).all() and max(map(max, errors)) < 0.03
    assert likeness[0] == pytest.approx(likeness[1], abs=0.005)


@pytest.mark.slow
def test_a_column_finds_the_plates_target_mode_and_ranks_its_heights() -> None:
    """The plate's two ends are left out, nothing else: 2 % in frequency; what is held better there is held better here."""
    levels = []
    for height in (5.8e-3, 6.3e-3):
        assert DESIGN.pillar
        pillar = replace(DESIGN.pillar, height_m=height)
        zone = {"length_m": 80e-3, "nodal_lines": 6, "width_m": 20e-3}
        design = replace(DESIGN, **zone, rows=2, extension_m=8e-3, pillar=pillar)
        column = Column(design, reductions(design), 5.5 * pi / design.length_m).modes(28e3, 44e3)
        at = column.confinement.target.index
        assert at is not None
        around = (0.95 * column.frequency_hz[at], 1.05 * column.frequency_hz[at])
        model = PlateModel(design, reductions(design))
        result = modes_in_band(model.pencil("SS"), *around)
        plate = measure(model.touch("SS", result.vectors), design, "SS")
        best = verdict(plate.strength, plate.zone_share, plate.mac).index
        assert best is not None
        assert column.frequency_hz[at] == pytest.approx(result.frequency_hz[best], rel=0.02)
        assert column.confinement.mac[at] > 0.95
        levels.append((column.confinement.confinement_db[at], plate.confinement_db[best]))
    assert levels[0][0] > levels[1][0] and levels[0][1] > levels[1][1]


@pytest.mark.slow
def test_a_bare_column_of_two_zones_is_the_column_of_one_as_wide() -> None:
    """Borders that nothing marks: every even mode of the halved column is one of the whole column's, which has odd ones too;
    both are polynomials of a bare plate, whose cuts lie elsewhere.
    """
    one = replace(DESIGN, pillar=None, rows=0, extension_m=14e-3)
    two = replace(one, zones=2, zone_gap_m=4e-3, extension_m=6e-3)
    assert one.half_span_m == pytest.approx(two.half_span_m)
    kx = 3.5 * pi / one.length_m
    half, whole = (Column(each, reductions(each), kx).solve(20e3, 60e3)[0] for each in (one, two))
    apart = np.abs(whole[:, None] / half - 1.0).min(axis=0)
    assert len(half) < len(whole) and apart.max() < 2e-3


@pytest.mark.slow
def test_zones_of_a_column_mirror_each_other_up_to_the_edges() -> None:
    """Feet flush with both edges of the plate: what ends at one edge ends at the other."""
    two = replace(DESIGN, zones=2, shared_rows=1, zone_gap_m=2e-3, extension_m=0.0)
    column = Column(two, reductions(two), 3.5 * pi / two.length_m)
    assert [panel.free for (panel,) in column.strips if panel.free] == [("y-",), ("y+",)]
    driven = column.zones(45e3, 75e3, 100.0)
    assert driven.peak_hz[0] == pytest.approx(driven.peak_hz[1], rel=1e-6)
    assert driven.level_db[0] == pytest.approx(driven.level_db[1][[1, 0, 2]], abs=1e-3)


def test_a_zone_driven_alone_is_the_column_driven() -> None:
    """One zone by modes about its peak and by all of them: what the others add is of order 1/Q."""
    column = Column(DESIGN, reductions(DESIGN), 3.5 * pi / DESIGN.length_m)
    driven = column.zones(45e3, 75e3, 300.0)
    (level,) = column.driven(driven.peak_hz, 300.0).confinement_db
    assert driven.confinement_db == pytest.approx(level, abs=20.0 * np.log10(1.0 + 2.0 / 300.0) * 10 ** (level / 20.0))
