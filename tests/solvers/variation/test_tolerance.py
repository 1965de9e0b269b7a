"""Plates with unlike pillars in the nominal plate's space, against the same plates assembled whole and solved directly."""

from __future__ import annotations

from dataclasses import dataclass, field, fields, replace
from functools import cache

import numpy as np
import pytest
import scipy.sparse as sp
import scipy.sparse.linalg as spla

from geometry.hex.scenes import HexSettings
from geometry.layout import Design, Pillar
from geometry.materials import MATERIALS, PIEZO_MATERIALS, Stack
from geometry.supports import Support
from geometry.tiling import Panel, Tiling, signature
from solvers.errors import SolverError
from solvers.fem.eigen import PlainPencil, modes_near
from solvers.measures.confinement import measure, target_shape
from solvers.piezo.forced import MARGIN, Drive, ForcedPlate
from solvers.piezo.patch import bonded_patch
from solvers.piezo.patched_plate import CLASSES, PatchedPlate, PressedPlate
from solvers.plates import assembled
from solvers.plates.assembled import PlateModel, Reductions
from solvers.superelement.interface import Interface, ReductionSettings
from solvers.superelement.plate import WHOLE
from solvers.variation.cells import PARAMETERS, STIFFNESS, VariedReductions
from solvers.variation.samples import LEFT, Deviations, VariedPlate, spread

ALUMINIUM = MATERIALS["aluminium"]
PILLAR = Pillar("square", 2e-3, 2e-3, 6.0e-3, ALUMINIUM)
DESIGN = Design(17e-3, 10e-3, 2e-3, 2, ALUMINIUM, PILLAR, 4e-3, 4e-3, 1, 3e-3)
STAGGERED = replace(
    DESIGN, length_m=13e-3, pitch_x_m=8e-3, pitch_y_m=5e-3, rows=2, extension_m=2e-3, stagger=True
)  # panels as wide as those in line
BAND_HZ, QUALITY = (20e3, 50e3), 100.0
TALL_M = 7.5e-3  # a pillar of a plate whose level depends on them
ALIKE_DB = 0.01  # levels nearer than that are alike
MOVED = 0.1  # of the spread: what the space may move a sample by before the tool warns
DEVIATIONS = Deviations(0.06e-3, 0.02e-3, 0.02e-3)
STIFFER = Deviations(0.03e-3, 0.0, 0.0, 0.05)
REDUCTION = ReductionSettings(Interface(3, 2), 450e3, HexSettings(2, 4e-3, 0, 0.25, 4e-3), 6e-3)


def model(design: Design, deviations: Deviations = DEVIATIONS) -> tuple[PlateModel, VariedReductions]:
    reductions = VariedReductions(
        Stack.of(design.thickness_m, ALUMINIUM), design.pillar, REDUCTION, reach=deviations.reach
    )
    return PlateModel(design, reductions), reductions


def pressed(made: PlateModel, design: Design) -> ForcedPlate:
    plate = PressedPlate({symmetry: made.assembled(symmetry) for symmetry in CLASSES}, design, made.name)
    return ForcedPlate(plate, design, Drive((0,), (), BAND_HZ, QUALITY))


@dataclass(frozen=True)
class Stand:
    """The nominal plate in every form that a test needs."""

    design: Design
    made: PlateModel
    reductions: VariedReductions
    forced: ForcedPlate
    varied: VariedPlate


@cache
def stand(height_m: float = PILLAR.height_m, staggered: bool = False) -> Stand:
    own = STAGGERED if staggered else DESIGN
    assert own.pillar
    design = replace(own, pillar=replace(own.pillar, height_m=height_m))
    made, reductions = model(design)
    forced = pressed(made, design)
    return Stand(design, made, reductions, forced, VariedPlate(forced, reductions.families))


@pytest.mark.slow
def test_a_plate_solved_whole_varies_as_by_its_classes():
    """A patch that no mirror leaves alone couples all classes: each pillar counts once, not with its mirror images."""
    design, (made, reductions) = DESIGN, model(DESIGN)
    box = np.array([-3e-3, 5e-3, -2e-3, 3e-3])
    patch = bonded_patch(PIEZO_MATERIALS["pz26"], box, 0.3e-3, False, HexSettings(2, 4e-3, 1, 0.15))
    found, moved = [], []
    for symmetries in (CLASSES, (WHOLE,)):
        plate = PatchedPlate({each: made.assembled(each) for each in symmetries}, [patch], False)
        varied = VariedPlate(ForcedPlate(plate, design, Drive((0,), (), BAND_HZ, QUALITY)), reductions.families)
        assert varied.pillars == pytest.approx(stand().varied.pillars)
        change = DEVIATIONS.draw(len(varied.pillars), 1, 1)[0]
        tones, still = (
            np.sort(plate.scale.frequency(varied.sample(each).eigenvalue)) for each in (change, 0.0 * change)
        )
        found.append(tones[:8])  # the modes: beyond them come answers to the patch
        moved.append(tones[:8] - still[:8])
    assert found[1] == pytest.approx(
        found[0], abs=MOVED * np.abs(moved[0]).max()
    )  # counted four times: three times that
    assert np.abs(moved[1] - moved[0]).max() < MOVED * np.abs(moved[0]).max()


class Whole:
    """Every cell of the plate assembled, no mirror used: each pillar with the cell that its deviations give."""

    def __init__(self, change: np.ndarray, have: Stand) -> None:
        self.have = have
        joined = have.made.assembled("SS")
        self.tiling, self.grid = joined.tiling, joined.grid
        self.scale = joined.placed_cells[0].cell.scale
        rows, columns, stiff, heavy = [], [], [], []
        self.panels = []
        for i in range(self.grid.nx):
            for j in range(self.grid.ny):
                cell, turn, k, m = self._cell(i, j, change)
                dofs = self.grid.dofs(i, j)
                self.panels.append((i, j, cell, turn, dofs))
                rows.append(np.repeat(dofs, len(dofs)))
                columns.append(np.tile(dofs, len(dofs)))
                stiff.append((turn.T @ k @ turn).ravel())
                heavy.append((turn.T @ m @ turn).ravel())
        place = (np.concatenate(rows), np.concatenate(columns))
        shape = (self.grid.count,) * 2
        self.live = np.flatnonzero(~self.grid._idle())
        self.k, self.m = (
            sp.coo_array((np.concatenate(v), place), shape=shape).tocsc()[self.live][:, self.live]
            for v in (stiff, heavy)
        )

    def _cell(self, i: int, j: int, change: np.ndarray) -> tuple:
        """The reduction of the piece's positive image, what turns the piece's degrees of freedom into that one's, and K, M."""
        other = (max(i, self.grid.nx - 1 - i), max(j, self.grid.ny - 1 - j))
        cell = self.grid.cell(i, j)
        turn, signs = np.eye(cell.dof), np.ones(PARAMETERS)
        for axis in (0, 1):
            if (i, j)[axis] != other[axis]:
                where, sign = cell.interface.mirror(axis)
                step = np.eye(cell.dof)
                step[: len(where), : len(where)] = 0.0
                step[np.arange(len(where)), where] = sign
                turn, signs[2 + axis] = step @ turn, -1.0
        foot = self.tiling.feet.get((i, j))
        if foot is None:
            return cell, turn, cell.stiffness, cell.mass
        have = self.have
        number = int(np.argmin(np.abs(have.varied.pillars - np.array(foot)).sum(axis=1)))
        family = have.reductions.families[signature(self.tiling.panel(*other))]
        return cell, turn, *family.at(signs * change[number])

    def nearest_hz(self, frequency_hz: float) -> float:
        """The natural frequency nearest to one, Hz."""
        value = spla.eigsh(self.k, 1, self.m, sigma=self.scale.eigenvalue(frequency_hz), return_eigenvectors=False)
        return float(self.scale.frequency(value)[0])

    def rms(self, frequency_hz: float) -> tuple[float, float]:
        """rms |u_z| on zone and passive face under the pressure in the target shape, m/N."""
        design = self.have.design
        load, size, faces = np.zeros(self.grid.count), 0.0, []
        for i, j, cell, turn, dofs in self.panels:
            middle = np.array(self.tiling.panel(i, j).middle)
            side = np.where(np.array([2 * i < self.grid.nx - 1, 2 * j < self.grid.ny - 1]), -1.0, 1.0)
            touch = cell.touch.rule()
            assert touch.interpolation is not None
            points = touch.points[:, :2] * side + middle
            active = np.abs(points[:, 1]) < design.width_m / 2.0
            rows = touch.interpolation @ touch.normal @ turn
            force = np.where(active, touch.weights * target_shape(design, points), 0.0)
            np.add.at(load, dofs, force @ rows)
            size += np.abs(force).sum()
            faces.append((dofs, rows, touch.weights, active))
        matrix = self.k * (1.0 + 1j / QUALITY) - self.scale.eigenvalue(frequency_hz) * self.m
        unit = self.scale.young_pa * self.scale.length_m
        u = np.zeros(self.grid.count, dtype=complex)
        u[self.live] = spla.splu(sp.csc_array(matrix)).solve((load[self.live] / size / unit).astype(complex))
        clamped = np.zeros(2)
        for dofs, rows, weights, active in faces:
            square = weights * np.abs(rows @ u[dofs]) ** 2
            clamped += [square[active].sum(), square[~active].sum()]
        areas = np.array([design.width_m, 2.0 * design.half_span_m - design.width_m]) * design.length_m
        zone, passive = np.sqrt(clamped / areas)
        return float(zone), float(passive)


@pytest.mark.slow
def test_without_deviations_the_target_mode_is_tracked_to_itself() -> None:
    """In this band the target shape is split: other modes, and what the pressure adds to them, have it too."""
    have = stand()
    still = have.varied.sample(np.zeros((len(have.varied.pillars), PARAMETERS)))
    assert still.tracked_hz == pytest.approx(have.forced.target_hz(), rel=1e-9)
    assert still.target_share.max() == pytest.approx(1.0, abs=1e-9) and still.target_share.sum() == pytest.approx(
        1.0, abs=1e-9
    )


def test_without_deviations_it_is_the_nominal_plate() -> None:
    have = stand()
    tones = np.linspace(*BAND_HZ, 41)
    still = have.varied.sample(np.zeros((len(have.varied.pillars), PARAMETERS))).curve(tones)
    given = have.forced.curve(tones)
    assert still.zone_rms_m_per_v == pytest.approx(given.zone_rms_m_per_v, rel=2.0 / QUALITY)
    assert given.passive_rms_m_per_v is not None
    assert still.passive_rms_m_per_v == pytest.approx(given.passive_rms_m_per_v, rel=2.0 / QUALITY)


def test_pillars_stand_where_the_design_puts_them() -> None:
    centres = DESIGN.pillar_centres()
    mine = stand().varied.pillars
    assert len(mine) == len(centres) == 8
    assert np.abs(mine[:, None] - centres[None]).sum(axis=2).min(axis=1).max() < 1e-9


def check_as_whole(varied: VariedPlate, seed: int, most: float, have: Stand) -> None:
    """Direct solves of all cells, no mirrors, no modes."""
    change = DEVIATIONS.draw(len(varied.pillars), 1, seed)[0]
    whole, tones = Whole(change, have), np.linspace(22e3, 48e3, 7)
    direct = np.array([whole.rms(tone) for tone in tones]).T
    still = faces(varied, np.zeros_like(change), tones)
    assert np.abs(direct / still - 1.0).max() > 0.2  # the deviations do something there
    assert np.abs(faces(varied, change, tones) / direct - 1.0).max() < most


@pytest.mark.parametrize("seed", [1, pytest.param(2, marks=pytest.mark.slow)])
def test_a_plate_of_unlike_pillars_is_the_one_assembled_whole(seed: int) -> None:
    """On a flank 2 Q times the error of a resonance: 3e-4 makes 6 %."""
    check_as_whole(stand().varied, seed, 0.06, stand())


@pytest.mark.slow
def test_pillars_of_staggered_rows_differ_one_by_one_as_those_in_line() -> None:
    have = stand(staggered=True)
    centres = have.design.pillar_centres()
    assert np.abs(have.varied.pillars[:, None] - centres[None]).sum(axis=2).min(axis=1).max() < 1e-9
    assert len(have.varied.pillars) == len(centres) == 6
    check_as_whole(have.varied, 1, 0.06, have)


@pytest.mark.slow
@pytest.mark.parametrize("seed", [1, 2])
def test_in_a_space_of_modes_from_a_third_to_thrice_the_band_half_as_much_is_missed(seed: int) -> None:
    """What is left then is that cells are interpolated."""
    check_as_whole(in_band(stand(), *BAND_HZ, (0.3, 2.5)), seed, 0.03, stand())


def in_band(have: Stand, low: float, high: float, margin: tuple[float, float]) -> VariedPlate:
    """The plate whose samples are held by modes of one band."""
    plate = PressedPlate({symmetry: have.made.assembled(symmetry) for symmetry in CLASSES}, DESIGN, have.made.name)
    return VariedPlate(
        ForcedPlate(plate, DESIGN, Drive((0,), (), (low, high), QUALITY), margin), have.reductions.families
    )


def in_space(varied: VariedPlate, change: np.ndarray) -> tuple[float, float]:
    """Frequency in Hz and confinement in dB of a sample's target mode."""
    sample = varied.sample(change)
    assert sample.tracked_hz is not None
    zone, passive = faces(varied, change, np.array([sample.tracked_hz]))[:, 0]
    return sample.tracked_hz, 20.0 * np.log10(zone / passive)


def as_a_whole(have: Stand, change: np.ndarray, about_hz: float) -> tuple[float, float]:
    """The same of the plate assembled whole."""
    whole = Whole(change, have)
    tone = whole.nearest_hz(about_hz)
    zone, passive = whole.rms(tone)
    return tone, 20.0 * np.log10(zone / passive)


def check_alike(have: Stand, varied: VariedPlate, changes: np.ndarray) -> None:
    """Frequency and level of each sample are the whole plate's but for a tenth of what the samples differ by, and so are their
    spreads.
    """
    ours = np.array([in_space(varied, change) for change in changes])
    theirs = np.array([as_a_whole(have, change, tone) for change, (tone, _) in zip(changes, ours, strict=True)])
    spreads = theirs.std(axis=0, ddof=1)
    unlike = np.maximum(MOVED * spreads, [0.0, ALIKE_DB])
    assert (np.abs(ours - theirs).max(axis=0) < unlike).all()
    assert (np.abs(ours.std(axis=0, ddof=1) - spreads) < MOVED * spreads).all()


@pytest.mark.slow
def test_in_a_band_as_narrow_as_one_mode_samples_are_whole_plates() -> None:
    """Frequencies err in second order, fields in first but for the shapes that the changes bring: of 5e-2 dB little is left."""
    have = stand()
    tone = have.forced.target_hz()
    assert tone is not None
    narrow = in_band(have, 0.97 * tone, 1.03 * tone, (1.0, 1.0))
    check_alike(have, narrow, DEVIATIONS.draw(len(narrow.pillars), 3, 1))


@pytest.mark.slow
@pytest.mark.parametrize("width", [0.05, 0.2])
def test_thirty_samples_are_thirty_whole_plates_whatever_the_band(width: float) -> None:
    """Pillars so high that they ring nearer to the target mode: its level follows them."""
    have = stand(TALL_M)
    tone = have.forced.target_hz()
    assert tone is not None
    varied = in_band(have, (1.0 - width) * tone, (1.0 + width) * tone, MARGIN)
    check_alike(have, varied, DEVIATIONS.draw(len(varied.pillars), 30, 9))


def faces(varied: VariedPlate, change: np.ndarray, tones: np.ndarray) -> np.ndarray:
    """rms on zone and passive face, (2, n)."""
    curve = varied.sample(change).curve(tones)
    assert curve.passive_rms_m_per_v is not None
    return np.array([curve.zone_rms_m_per_v, curve.passive_rms_m_per_v])


def test_the_mirror_image_of_a_plate_answers_alike() -> None:
    varied = stand().varied
    change = DEVIATIONS.draw(len(varied.pillars), 1, 5)[0]
    tones = np.linspace(25e3, 45e3, 9)
    curve = varied.sample(change).curve(tones)
    for axis in (0, 1):
        image = varied.pillars * np.where(np.arange(2) == axis, -1.0, 1.0)
        order = np.array([int(np.abs(varied.pillars - place).sum(axis=1).argmin()) for place in image])
        mirrored = change[order] * np.where(np.arange(PARAMETERS) == 2 + axis, -1.0, 1.0)
        other = varied.sample(mirrored).curve(tones)
        assert other.zone_rms_m_per_v == pytest.approx(curve.zone_rms_m_per_v, rel=1e-6)
        assert other.passive_rms_m_per_v == pytest.approx(curve.passive_rms_m_per_v, rel=1e-6)


def peak_hz(source: object, low: float, high: float) -> float:
    tones = np.linspace(low, high, 2001)
    return float(tones[np.argmax(source.curve(tones).zone_rms_m_per_v)])  # type: ignore[attr-defined]


@pytest.mark.slow
def test_all_pillars_higher_is_the_plate_designed_so() -> None:
    """A plate with higher pillars of its own, meshed and reduced anew: the peak moves by the same."""
    have, more = stand(), 0.15e-3
    change = np.zeros((len(have.varied.pillars), PARAMETERS))
    change[:, 0] = more
    design = replace(DESIGN, pillar=replace(PILLAR, height_m=PILLAR.height_m + more))
    other = pressed(model(design)[0], design)
    nominal, mine, theirs = (peak_hz(one, *BAND_HZ) for one in (have.forced, have.varied.sample(change), other))
    assert abs(theirs / nominal - 1.0) > 2e-3
    assert mine - nominal == pytest.approx(theirs - nominal, rel=0.05, abs=0.02 * nominal / QUALITY)


@pytest.mark.slow
def test_all_pillars_stiffer_is_the_plate_of_that_material() -> None:
    """Three standard deviations: a plate whose pillars have 15 % more of every constant, reduced anew."""
    made, reductions = model(DESIGN, STIFFER)
    forced = pressed(made, DESIGN)
    varied = VariedPlate(forced, reductions.families)
    change = np.zeros((len(varied.pillars), PARAMETERS))
    change[:, STIFFNESS] = 3.0 * STIFFER.stiffness
    design = replace(DESIGN, pillar=replace(PILLAR, material=ALUMINIUM.scaled(1.0 + 3.0 * STIFFER.stiffness)))
    other = pressed(model(design, STIFFER)[0], design)
    nominal, mine, theirs = (peak_hz(one, *BAND_HZ) for one in (forced, varied.sample(change), other))
    assert abs(theirs / nominal - 1.0) > 2e-3
    assert mine - nominal == pytest.approx(theirs - nominal, rel=0.05, abs=0.02 * nominal / QUALITY)


def test_a_smaller_space_answers_about_the_same() -> None:
    varied = stand().varied
    change = DEVIATIONS.draw(len(varied.pillars), 1, 7)[0]
    whole = varied.sample(change)
    narrow = varied.sample(change, (0.9 * BAND_HZ[0], 1.1 * BAND_HZ[1]))
    assert len(narrow.eigenvalue) < len(whole.eigenvalue)
    assert peak_hz(narrow, *BAND_HZ) == pytest.approx(peak_hz(whole, *BAND_HZ), rel=2e-3)


def test_draws_are_seeded_cut_and_of_the_given_size() -> None:
    first, again, other = (DEVIATIONS.draw(500, 8, seed) for seed in (3, 3, 4))
    assert np.array_equal(first, again) and not np.array_equal(first, other)
    assert (np.abs(first) <= np.array(DEVIATIONS.reach) + 1e-15).all()
    # of a normal cut at three: sqrt(1 - 2 3 phi(3)/(1 - 2 Phi(-3))) = 0.98658
    sizes, drawn = DEVIATIONS.sizes[:4], first[..., :4]
    spreads = drawn.std(axis=(0, 1)) / sizes
    assert spreads == pytest.approx(0.98658, abs=5.0 / np.sqrt(2 * 4000))
    assert drawn.mean(axis=(0, 1)) / sizes == pytest.approx(0.0, abs=5.0 / np.sqrt(4000))
    alone, with_stiffness = Deviations(0.0, 1e-5, 0.0).draw(3, 2, 1), Deviations(0.0, 1e-5, 0.0, 0.02).draw(3, 2, 1)
    assert np.array_equal(alone[..., [0, 2, 3, 4]], np.zeros((2, 3, 4)))
    assert np.array_equal(alone[..., :4], with_stiffness[..., :4])  # sizes stay what they were


def test_statistics_of_few_values() -> None:
    result = spread(np.array([1.0, 2.0, 6.0]))
    assert (result.mean, result.lowest, result.highest) == (3.0, 1.0, 6.0)
    assert result.deviation == pytest.approx(np.sqrt(7.0))
    assert spread(np.array([4.0])).deviation is None


def test_deviations_of_the_wrong_shape_are_refused() -> None:
    with pytest.raises(SolverError, match="must be"):
        stand().varied.sample(np.zeros((3, PARAMETERS)))


HELD = (
    Support("clamp", "x-"),
    Support("foam", "y+", bedding_n_m2=2e7),
    Support("spring", at_m=(2e-3, 0.0), radius_m=1.5e-3, stiffness_n_m=2e6),
    Support("mass", at_m=(-5e-3, 1e-3), radius_m=1e-3, mass_kg=3e-5),
)


@cache
def held(deviations: Deviations = DEVIATIONS) -> Stand:
    design = replace(DESIGN, supports=HELD)
    made, reductions = model(design, deviations)
    plate = PressedPlate({WHOLE: made.assembled(None)}, design, made.name)
    tone = ForcedPlate(plate, design, Drive((0,), (), BAND_HZ, QUALITY)).target_hz()
    assert tone is not None
    narrow = Drive((0,), (), (0.97 * tone, 1.03 * tone), QUALITY)
    forced = ForcedPlate(plate, design, narrow, (1.0, 1.0))  # the shapes that changes bring are all that is beyond
    return Stand(design, made, reductions, forced, VariedPlate(forced, reductions.families))


def of_one_pillar(have: Stand, pillar: int, change: np.ndarray) -> tuple[float, float]:
    """Frequency and confinement of the supported plate's target mode, assembled with another pillar in one place."""
    plate = have.made.assembled(None)
    places = plate.grid.representative_cells()
    foot = min(plate.tiling.feet.items(), key=lambda each: float(np.abs(have.varied.pillars[pillar] - each[1]).sum()))[
        0
    ]
    placed, family = (
        plate.placed_cells[places.index(foot)],
        have.reductions.families[signature(plate.tiling.panel(*foot))],
    )
    live = placed.coefficient != 0.0
    turn = sp.csr_array((placed.coefficient[live], (np.flatnonzero(live), placed.dofs[live])), (len(live), plate.dof))
    nominal, changes = plate.pencil(), zip(family.at(change), (placed.cell.stiffness, placed.cell.mass), strict=True)
    stiff, heavy = (sp.csc_array(turn.T @ sp.csr_array(own - before) @ turn) for own, before in changes)
    pencil = PlainPencil(nominal.stiffness + stiff, sp.csc_array(nominal.mass) + heavy, nominal.scale, 0)
    modes = modes_near(pencil, have.forced.target_hz() or 0.0, 1)
    field = plate.touch(modes.vectors)
    active, square = field.is_active(have.design), field.weights * field.values[:, 0] ** 2
    return float(modes.frequency_hz[0]), 10.0 * float(np.log10(square[active].sum() / square[~active].sum()))


def own_level(varied: VariedPlate, change: np.ndarray) -> tuple[float, float]:
    """Frequency and confinement of a sample's tracked mode."""
    sample = varied.sample(change)
    at = sample.tracked.index
    assert at is not None and sample.tracked_hz is not None
    return sample.tracked_hz, 10.0 * float(np.log10(sample.inside[at, at] / sample.outside[at, at]))


@pytest.mark.slow
def test_a_supported_plates_derivatives_are_differences_of_plates_assembled_anew() -> None:
    """By a pillar's height, side, place and stiffness: the space holds the first order of frequencies, and that of shapes but
    for LEFT of the mode where all pillars are off by one deviation, 20 LEFT / ln 10 of a level.
    """
    have = held()
    assert len(have.varied.pillars) == 8 and have.made.assembled(None).rigid_count == 0
    stiff = held(STIFFER)
    given = [(have, axis, size) for axis, size in enumerate(DEVIATIONS.sizes[:STIFFNESS])]
    for have, axis, size in (*given, (stiff, STIFFNESS, STIFFER.stiffness)):
        slopes = []
        for pillar in (0, 3, 6):
            steps = [sign * 0.2 * size * np.eye(PARAMETERS)[axis] for sign in (1.0, -1.0)]
            ours = [own_level(have.varied, np.eye(8)[:, [pillar]] * step) for step in steps]
            theirs = [of_one_pillar(have, pillar, step) for step in steps]
            slopes.append((np.subtract(*ours), np.subtract(*theirs)))
        mine, exact = (np.array(each) for each in zip(*slopes, strict=True))
        off = np.abs(mine - exact).max(axis=0)
        assert off[0] < 1e-3 * np.abs(exact[:, 0]).max() and off[1] < 0.4 * 20.0 * LEFT / np.log(10.0)
        assert axis not in (0, STIFFNESS) or np.abs(exact[:, 1]).max() > 0.05  # dB by heights: a hundred times that


# -- plates larger than their zone -------------------------------------------------------------------------------------

SHORTER = replace(PILLAR, height_m=5.4e-3)
LARGER = Design(
    20e-3, 14e-3, 2e-3, 0, ALUMINIUM, SHORTER, 4e-3, 4e-3, 1, 0.0,
    larger_m=(36e-3, 30e-3), centre_m=(1.5e-3, -1e-3), surround=True,
)  # fmt: skip
EACH = 0.05  # of the largest change of a frequency or level: cells are interpolated, and their meshes moved
REDRAWN_DB = 0.01  # levels by meshes that are drawn anew


@cache
def on_larger(centre_m: tuple[float, float] = LARGER.centre_m) -> Stand:
    design = replace(LARGER, centre_m=centre_m)
    made, reductions = model(design)
    plate = PressedPlate({WHOLE: made.assembled(None)}, design, made.name)
    forced = ForcedPlate(plate, design, Drive((0,), (), (40e3, 65e3), QUALITY))
    return Stand(design, made, reductions, forced, VariedPlate(forced, reductions.families))


@dataclass(frozen=True)
class Unlike(Tiling):
    """A tiling with a pillar of its own in each panel."""

    own: dict[tuple[int, int], Pillar] = field(default_factory=dict)

    def panel(self, i: int, j: int) -> Panel:
        return replace(super().panel(i, j), pillar=self.own.get((i, j)))


def built(have: Stand, change: np.ndarray, monkeypatch: pytest.MonkeyPatch) -> tuple[float, float]:
    """Frequency and confinement of the target mode of a plate whose pillars are each meshed and reduced as they are."""
    nominal, feet, own = have.made.tiling, {}, {}
    for place, foot in nominal.feet.items():
        height, side, x, y, _ = change[int(np.abs(have.varied.pillars - foot).sum(axis=1).argmin())]
        feet[place] = (foot[0] + x, foot[1] + y)
        sides = (PILLAR.base_m + side, PILLAR.tip_m + side)
        own[place] = replace(SHORTER, base_m=sides[0], tip_m=sides[1], height_m=SHORTER.height_m + height)
    given = {each.name: getattr(nominal, each.name) for each in fields(nominal)} | {"feet": feet}
    monkeypatch.setattr(assembled, "tile", lambda *_: Unlike(**given, own=own))
    plate = PlateModel(have.design, Reductions(have.design.stack, SHORTER, REDUCTION)).assembled(None)
    modes = modes_near(plate.pencil(), have.forced.target_hz() or 0.0, 3)
    best = measure(plate.touch(modes.vectors), have.design, None)
    at = int(np.argmax(best.strength))
    return float(modes.frequency_hz[at]), float(best.confinement_db[at])


@pytest.mark.slow
def test_a_larger_plates_samples_are_plates_built_pillar_by_pillar(monkeypatch: pytest.MonkeyPatch) -> None:
    """A zone off the centre of its plate with pillars around it: no mirror, no interpolation, no space of few motions."""
    have = on_larger()
    assert have.made.symmetries == (None,) and len(have.varied.pillars) == len(have.design.pillar_centres()) == 18
    changes = [0.0 * DEVIATIONS.draw(18, 1, 1)[0], *DEVIATIONS.draw(18, 2, 3)]
    ours = np.array([own_level(have.varied, change) for change in changes])
    theirs = np.array([built(have, change, monkeypatch) for change in changes])
    moved = np.abs(theirs - theirs[0]).max(axis=0)
    assert moved[0] > 1e-3 * theirs[0, 0] and moved[1] > 10.0 * REDRAWN_DB
    assert (np.abs((ours - ours[0]) - (theirs - theirs[0])).max(axis=0) < EACH * moved + [0.0, REDRAWN_DB]).all()


@pytest.mark.slow
@pytest.mark.parametrize("axes", [(0,), (1,), (0, 1)])
def test_a_larger_plate_mirrored_or_turned_answers_alike(axes: tuple[int, ...]) -> None:
    """Zone and deviations mirrored in x or y, or turned by half a turn: frequencies, and levels but for LEFT of a shape."""
    flip = np.where(np.isin([0, 1], axes), -1.0, 1.0)
    have, other = on_larger(), on_larger(tuple((flip * LARGER.centre_m).tolist()))
    change = DEVIATIONS.draw(18, 1, 5)[0]
    order = np.abs(have.varied.pillars[None] * flip - other.varied.pillars[:, None]).sum(axis=2).argmin(axis=1)
    image = change[order] * np.array([1.0, 1.0, *flip, 1.0])
    (tone, level), (other_hz, other_db) = own_level(have.varied, change), own_level(other.varied, image)
    assert other_hz == pytest.approx(tone, rel=1e-6) and abs(other_db - level) < 20.0 * LEFT / np.log(10.0)
    assert abs(own_level(other.varied, change)[0] / tone - 1.0) > 1e-5
