"""Bonded patches and forced response: exact free patch, a conforming solid mesh beside, direct solves, open sensors."""

from __future__ import annotations

from dataclasses import replace
from functools import cache, partial

import numpy as np
import pytest
import scipy.linalg
import scipy.sparse.linalg as spla

from geometry.hex.boxes import Boxes, hex_mesh
from geometry.hex.scenes import HexSettings
from geometry.layout import Design, Pillar
from geometry.materials import MATERIALS, PIEZO_MATERIALS, PiezoMaterial, Stack
from geometry.tiling import tile
from solvers import machine
from solvers.analytic.beams import frequency_hz, roots
from solvers.errors import SolverError, TooLarge
from solvers.fem.eigen import modes_in_band
from solvers.fem.solid import SolidModel
from solvers.piezo import patch as beneath_patches
from solvers.piezo import patch as piezo_patch
from solvers.piezo import patched_plate
from solvers.piezo.forced import Drive, ForcedPlate, group_modes
from solvers.piezo.patch import MESH, StaticCorrection, _mesh, bonded_patch, patch_mesh, pillars_beneath, with_potential
from solvers.piezo.patched_plate import CLASSES, PatchedPlate, _bonds, coupled_classes
from solvers.piezo.responses import face_motion, frequency_errors, height_error
from solvers.plates.assembled import PlateModel, Reductions
from solvers.superelement.bond import Contact, displacement_at
from solvers.superelement.interface import Interface, ReductionSettings
from solvers.superelement.plate import WHOLE, AssembledPlate
from tests.helpers.kept_matrices import KeptMatrices

ALUMINIUM = MATERIALS["aluminium"]
PZ26 = PIEZO_MATERIALS["pz26"]
NU, E = ALUMINIUM.as_isotropic.poisson, ALUMINIUM.as_isotropic.young_pa
# A "ceramic" with aluminium's elasticity: the bonded body is then a plain solid that any mesh can carry.
PLAIN = PiezoMaterial(
    "plain", 2700.0, 1 / E, -NU / E, -NU / E, 1 / E, 2 * (1 + NU) / E, -1e-10, 2e-10, 3e-10, 1e3, 1e3, "invented"
)  # fmt: skip
DESIGN = Design(24e-3, 10e-3, 2e-3, 2, ALUMINIUM, None, float("nan"), float("nan"), 0, 3e-3)
THICK_M, BAND_HZ = 0.5e-3, (10e3, 60e3)
MIDDLE = np.array([[-4e-3, 4e-3, -2e-3, 2e-3]])
LOPSIDED = np.array([[2e-3, 10e-3, -1e-3, 3e-3]])
TWO = np.array([[-9e-3, -3e-3, -2e-3, 2e-3], [3e-3, 9e-3, -2e-3, 2e-3]])


@cache
def model() -> PlateModel:
    reduction = ReductionSettings(Interface(6, 3), 900e3, HexSettings(3, 2e-3, 0, 0.2), 4e-3)
    return PlateModel(DESIGN, Reductions(Stack.of(DESIGN.thickness_m, ALUMINIUM), None, reduction))


COARSE = HexSettings(2, 4e-3, 1, 0.15)  # of a patch


def joined() -> dict:
    return {symmetry: model().assembled(symmetry) for symmetry in CLASSES}


def patched(boxes: np.ndarray, material: PiezoMaterial = PLAIN, back: bool = True) -> PatchedPlate:
    return PatchedPlate(joined(), [bonded_patch(material, box, THICK_M, back) for box in boxes], back)


def conforming(box: np.ndarray) -> np.ndarray:
    """Elastic frequencies of plate and patch meshed as one solid, no mirrors."""
    x = np.unique(np.round([-12e-3, -6e-3, 0.0, 6e-3, 12e-3, *box[:2]], 9))
    y = np.unique(np.round([-8e-3, -4e-3, 0.0, 4e-3, 8e-3, *box[2:]], 9))
    region = np.zeros((len(x) - 1, len(y) - 1, 2), dtype=np.int64)
    inside_x, inside_y = (x[1:] > box[0]) & (x[:-1] < box[1]), (y[1:] > box[2]) & (y[:-1] < box[3])
    region[:, :, 1] = np.where(inside_x[:, None] & inside_y[None], 0, -1)
    mesh = hex_mesh(Boxes(x, y, np.array([0.0, 2e-3, 2e-3 + THICK_M]), region, ("body",)), 3)
    model = SolidModel(mesh, {"body": ALUMINIUM}, (), False)
    return modes_in_band(model.pencil(None), *BAND_HZ).frequency_hz


def test_a_free_patch_strains_by_d31_and_has_the_free_capacitance() -> None:
    mesh = _mesh(np.array([0.0, 12e-3, 0.0, 3e-3]), 0.3e-3, HexSettings(2, 2e-3, 0), True)
    every, heavy, load, clamped = with_potential(mesh, PZ26, 0.3e-3)
    own = slice(3 * len(mesh.nodes))
    stiffness, mass, theta = every[own, own], heavy[own, own], load[own]
    u = np.linalg.lstsq(stiffness.toarray(), theta, rcond=1e-12)[0]
    moved = u.reshape(-1, 3)
    assert np.ptp(moved[:, 0]) / 12e-3 == pytest.approx(-PZ26.d31 / 0.3e-3, rel=1e-9)
    assert np.ptp(moved[:, 2]) / 0.3e-3 == pytest.approx(PZ26.d33 / 0.3e-3, rel=1e-9)
    free = PZ26.permittivity_free_f_m[2, 2] * 36e-6 / 0.3e-3
    assert clamped + theta @ u == pytest.approx(free, rel=1e-9)
    assert mass[::3, ::3].sum() == pytest.approx(7700.0 * 36e-6 * 0.3e-3, rel=1e-12)


def test_condensed_it_weighs_the_same_and_rigid_motions_make_no_charge() -> None:
    patch = bonded_patch(PZ26, MIDDLE[0], THICK_M, True)
    for axis in range(3):
        shift = np.zeros((len(patch.projection), 3))
        shift[:, axis] = 1.0
        assert shift.ravel() @ patch.mass @ shift.ravel() == pytest.approx(7700.0 * 32e-6 * THICK_M, rel=1e-9)
        assert np.abs(patch.stiffness @ shift.ravel()).max() < 1e-9 * np.abs(patch.stiffness).max()
        assert abs(patch.theta @ shift.ravel()) < 1e-9 * np.abs(patch.theta).sum()


@pytest.mark.slow
@pytest.mark.parametrize("box", [MIDDLE[0], LOPSIDED[0]], ids=["middle", "lopsided"])
def test_a_bonded_body_has_the_modes_of_the_same_solid(box: np.ndarray) -> None:
    """Both are conforming subspaces; the patch's edge is singular, which each mesh meets in its own way: 1 %."""
    plate = patched(box[None])
    every = list(plate.groups)
    mine = np.sort(np.concatenate([modes_in_band(g.pencil, *BAND_HZ).frequency_hz for g in every]))
    solid = conforming(box)
    if plate.undriven:  # classes that a middle patch does not drive are not solved here
        solid = solid[[int(np.abs(solid - f).argmin()) for f in mine]]
    assert len(mine) == len(solid) >= 2
    assert np.abs(mine / solid - 1.0).max() < 0.01


@pytest.mark.slow
def test_classes_that_no_patch_drives_are_not_assembled() -> None:
    plate = patched(MIDDLE)
    ForcedPlate(plate, DESIGN, Drive((0,), (), BAND_HZ, 100.0))
    assembled = {group.symmetries[0]: "pencil" in vars(group) for group in plate.everything}
    assert assembled == {symmetry: symmetry not in plate.undriven for symmetry in CLASSES} and plate.undriven


@pytest.mark.slow
def test_patches_on_a_mirror_line_cannot_drive_what_is_antisymmetric_about_it(monkeypatch: pytest.MonkeyPatch) -> None:
    """What is left out is nothing: loads computed all the same are rounding beside those of the classes that are driven."""
    short = patched(TWO)
    monkeypatch.setattr(PatchedPlate, "_cannot_drive", lambda *_: False)
    whole = patched(TWO)
    assert not set(short.motions) & {"SA", "AA"} and set(whole.motions) == set(CLASSES)
    largest = {group.symmetries[0]: float(np.abs(group.loads).max()) for group in whole.everything}
    assert max(largest["SA"], largest["AA"]) < 1e-10 * min(largest["SS"], largest["AS"])
    assert short.undriven == whole.undriven == ["SA", "AA"]
    for one, other in zip(short.groups, whole.groups, strict=True):
        assert np.array_equal(one.loads, other.loads)
    for one, other in zip(short.everything, whole.everything, strict=True):
        assert abs(one.pencil.stiffness - other.pencil.stiffness).max() == 0.0
    aside = TWO + np.array([0.0, 0.0, 1e-3, 1e-3])
    monkeypatch.undo()
    assert patched(aside).undriven == []


@pytest.mark.slow
def test_a_patch_in_the_middle_is_no_load_of_classes_odd_about_it() -> None:
    """Where others drive the class, rounding would stand for its load, and be a direction of the space of `tolerance`."""
    groups = {
        group.symmetries[0]: group
        for group in patched(np.concatenate([TWO[:1], [[-2e-3, 2e-3, -2e-3, 2e-3]], TWO[1:]])).groups
    }
    odd, even = (np.abs(groups[name].loads).max(axis=0) for name in ("AS", "SS"))
    assert odd[1] == 0.0 and min(odd[0], odd[2], even[1]) > 0.1 * even.max()


def test_what_two_classes_share_of_a_patch_is_made_once(monkeypatch: pytest.MonkeyPatch) -> None:
    """Far from x = 0 the motions of SS and AS are the same."""
    clear = np.array([[-11e-3, -9e-3, -1e-3, 1e-3], [9e-3, 11e-3, -1e-3, 1e-3]])  # of the panels in the middle
    plate = patched(clear)
    pencils = {group.symmetries[0]: group.pencil for group in plate.groups}
    assert (
        set(pencils) == {"SS", "AS"} and len(plate._matrices._known) == 2
    )  # K and M of one patch, whose image the other is
    plate._matrices._known.clear()
    monkeypatch.setattr(patched_plate._PatchMatrices, "_projected", lambda _, own, motion: motion.T @ own @ motion)
    for group in plate.groups:
        again = group.join()
        assert abs(again.stiffness - pencils[group.symmetries[0]].stiffness).max() == 0.0
        assert abs(again.mass - pencils[group.symmetries[0]].mass).max() == 0.0


def test_a_middle_patch_keeps_the_classes_apart_and_a_lopsided_one_couples_all() -> None:
    apart = coupled_classes([bonded_patch(PLAIN, MIDDLE[0], THICK_M, True)])
    assert sorted(map(len, apart)) == [1, 1, 1, 1]
    assert [len(c) for c in coupled_classes([bonded_patch(PLAIN, LOPSIDED[0], THICK_M, True)])] == [4]
    pair = [
        bonded_patch(PLAIN, np.array([s * 6e-3 - 1e-3, s * 6e-3 + 1e-3, 0.0, 2e-3]), THICK_M, True) for s in (-1, 1)
    ]
    assert sorted(map(len, coupled_classes(pair))) == [2, 2]


def forced(
    boxes: np.ndarray, drivers: tuple[int, ...], sensors: tuple[int, ...], quality_factor: float = 100.0
) -> ForcedPlate:
    return ForcedPlate(patched(boxes, PZ26), DESIGN, Drive(drivers, sensors, (20e3, 45e3), quality_factor))


@pytest.mark.slow
@pytest.mark.parametrize("frequency", [22e3, 33e3, 44e3])
def test_superposition_meets_direct_solves(frequency: float) -> None:
    """Direct solves damp what lies outside the band too: a difference of the order of 1/Q."""
    plate = forced(TWO, (0,), (1,))
    eigenvalue = plate.plate.scale.eigenvalue(frequency)
    volts = plate.volts(eigenvalue)
    for result in plate.modes:
        pencil = result.group.pencil
        matrix = (pencil.stiffness * (1.0 + 0.01j) - eigenvalue * pencil.mass).tocsc()
        direct = spla.splu(matrix).solve((result.group.loads @ volts).astype(complex))
        summed = result.columns @ result.amplitudes(eigenvalue, volts)
        assert np.linalg.norm(direct - summed) < 0.02 * np.linalg.norm(direct)


@pytest.mark.slow
def test_the_plate_joined_whole_answers_as_its_mirror_classes() -> None:
    """Patches on the negative sides, where the classes fold and the whole plate does not."""
    bonded = [bonded_patch(PZ26, box, THICK_M, True) for box in np.vstack([-LOPSIDED[:, [1, 0, 3, 2]], MIDDLE])]
    whole = AssembledPlate(model().tiling, model().cells, WHOLE)
    forced = [
        ForcedPlate(PatchedPlate(plates, bonded, True), DESIGN, Drive((0,), (1,), BAND_HZ, 100.0))
        for plates in ({WHOLE: whole}, joined())
    ]
    tones = np.linspace(12e3, 55e3, 40)
    (ours, truth), (point, value) = (each.curve(tones) for each in forced), forced[0].shape(30e3)
    assert np.allclose(ours.zone_rms_m_per_v, truth.zone_rms_m_per_v, rtol=1e-6)
    assert np.allclose(ours.sensor_v_per_v, truth.sensor_v_per_v, rtol=1e-6)
    assert forced[0].target_hz() == pytest.approx(forced[1].target_hz(), rel=1e-8)
    points, values = forced[1].shape(30e3)
    there = np.lexsort(np.round(points, 9).T), np.lexsort(np.round(point, 9).T)
    assert np.allclose(value[there[1]], values[there[0]], atol=1e-6 * np.abs(values).max())


@pytest.mark.slow
def test_the_driven_skin_moves_as_the_points_of_the_touch_face_do() -> None:
    """All four classes move: each with its own mirror signs along x, y and z."""
    plate = forced(LOPSIDED, (0,), ())
    skin = plate.skin(33e3)
    on = np.flatnonzero(np.abs(skin.points[:, 2]) < 1e-9)
    largest = np.abs(skin.displacement).max()
    for axis in range(3):
        felt = plate.motion_by(partial(face_motion, points_m=skin.points[on, :2], axis=axis), 33e3)
        assert len({*np.sign(skin.points[on, 0])} & {-1.0, 1.0}) == 2
        assert np.abs(felt - skin.displacement[0, on, axis]).max() < 1e-9 * largest


def test_an_open_sensor_carries_no_charge_and_the_short_one_is_softer() -> None:
    plate = forced(TWO, (0,), (1,))
    eigenvalue = plate.plate.scale.eigenvalue(30e3)
    volts = plate.volts(eigenvalue)
    charge = sum(m.receptance(eigenvalue) for m in plate.modes) * plate.plate.stiffness_unit @ volts
    charge = charge + plate.plate.capacitance_f * volts
    assert abs(charge[1]) < 1e-12 * abs(charge[0])
    assert abs(volts[1]) > 0.0


def test_driver_and_sensor_may_change_places() -> None:
    """Reciprocity: the receptance between two patches is symmetric."""
    plate = forced(TWO, (0,), (1,))
    whole = sum(m.receptance(plate.plate.scale.eigenvalue(31e3)) for m in plate.modes)
    assert whole[0, 1] == pytest.approx(whole[1, 0], rel=1e-9)


def test_a_peak_is_as_wide_as_its_damping() -> None:
    from solvers.control.identification import half_power_quality_factor

    plate = forced(MIDDLE, (0,), (), 400.0)
    tone = float(max(plate.modes, key=lambda m: np.abs(m.gain).max()).frequency_hz[0])
    grid = np.linspace(tone * 0.99, tone * 1.01, 801)
    curve = plate.curve(grid)
    peak = int(np.argmax(curve.zone_rms_m_per_v))
    read = half_power_quality_factor(grid, curve.zone_rms_m_per_v, peak)
    assert read == pytest.approx(400.0, rel=0.03)


def test_a_patch_on_the_touch_face_bends_the_plate_the_other_way_than_one_on_the_back() -> None:
    back, touch = patched(MIDDLE, PZ26), patched(MIDDLE, PZ26, back=False)
    first = next(np.concatenate([m.ravel() for m in (g.loads,)]) for g in back.groups if "SS" in g.symmetries)
    other = next(g.loads.ravel() for g in touch.groups if "SS" in g.symmetries)
    pencil = next(g.pencil for g in back.groups if "SS" in g.symmetries)
    modes = modes_in_band(pencil, *BAND_HZ)
    gains = [modes.vectors[:, 0] @ load for load in (first, other)]
    assert gains[0] * gains[1] < 0.0


@pytest.mark.parametrize(
    ("change", "words"),
    [({"quality_factor": 0.0}, "above 0"), ({"drivers": ()}, "at least one"), ({"band_hz": (40e3, 20e3)}, "ascending")],
)
def test_what_cannot_be_driven_is_refused(change: dict, words: str) -> None:
    given = {"drivers": (0,), "sensors": (), "band_hz": (20e3, 40e3), "quality_factor": 100.0} | change
    with pytest.raises(SolverError, match=words):
        Drive(**given)


def test_no_patches_and_a_patch_beyond_the_plate_are_refused() -> None:
    with pytest.raises(SolverError, match="no patches"):
        PatchedPlate(joined(), [], True)
    far = replace(bonded_patch(PZ26, MIDDLE[0], THICK_M, True))
    far = replace(far, points=far.points + np.array([20e-3, 0.0]))
    with pytest.raises(SolverError, match="outside the plate"):
        PatchedPlate(joined(), [far], True)


@cache
def plate_of(top_hz: float, longest_m: float) -> PlateModel:
    reduction = ReductionSettings(Interface(6, 3), top_hz, HexSettings(3, 2e-3, 0, 0.2), longest_m)
    return PlateModel(DESIGN, Reductions(Stack.of(DESIGN.thickness_m, ALUMINIUM), None, reduction))


@cache
def across_the_mirror() -> PlateModel:
    """Five panels along x: those in the middle lie across a mirror."""
    return plate_of(300e3, 5e-3)


@pytest.mark.slow
def test_a_contact_feels_what_the_faces_nodes_show_on_every_panel() -> None:
    made = across_the_mirror()
    for symmetry in (*CLASSES, WHOLE):
        plate = made.assembled(symmetry)
        motion = np.random.default_rng(1).normal(size=(plate.dof, 1))
        skin = plate.skin(motion)
        on = np.flatnonzero(np.abs(skin.points[:, 2] - DESIGN.thickness_m) < 1e-9)
        contact = Contact(skin.points[on, :2], np.eye(len(on)), True)
        felt = (displacement_at(plate, contact) @ motion).reshape(-1, 3)
        assert np.abs(felt - skin.displacement[0][on]).max() < 1e-9 * np.abs(felt).max()


@pytest.mark.slow
def test_a_patched_plate_has_the_same_modes_by_classes_and_as_a_whole() -> None:
    made = across_the_mirror()
    every = []
    for plates in ({symmetry: made.assembled(symmetry) for symmetry in CLASSES}, {WHOLE: made.assembled(None)}):
        patch = bonded_patch(PZ26, MIDDLE[0], THICK_M, True, HexSettings(2, 4e-3, 1, 0.15))
        plate = PatchedPlate(plates, [patch], True, beneath=StaticCorrection(made.reductions))
        modes = [modes_in_band(group.pencil, *BAND_HZ).frequency_hz for group in plate.everything]
        every.append(np.sort(np.concatenate(modes)))
    assert len(every[0]) == len(every[1]) > 2
    assert np.abs(every[0] / every[1] - 1.0).max() < 1e-8


@pytest.mark.slow
@pytest.mark.parametrize(
    ("thick_m", "size_m"),
    [
        (1e-3, 4e-3),
        pytest.param(1.5e-3, 8e-3, marks=pytest.mark.slow),
        pytest.param(4e-3, 8e-3, marks=pytest.mark.slow),
    ],
    ids=["thick", "thick in classes not driven", "thick on few elements"],
)
def test_a_thick_patch_leaves_stiffness_and_inertia_positive(thick_m: float, size_m: float) -> None:
    """However much two meshes of a patch differ: no share of that is taken from the matrices, which counts by inertia need."""
    made, box = across_the_mirror(), np.array([-8e-3, 8e-3, -3e-3, 3e-3])
    plates = {symmetry: made.assembled(symmetry) for symmetry in CLASSES}
    patch = bonded_patch(PZ26, box, thick_m, True, replace(COARSE, size_m=size_m))
    plate = PatchedPlate(plates, [patch], True, beneath=StaticCorrection(made.reductions), at_hz=30e3)
    for group in plate.everything:
        assert group.coarser is not None
        for pencil in (group.pencil, group.coarser.join()):
            stiffness = np.linalg.eigvalsh(pencil.stiffness.toarray())
            assert np.linalg.eigvalsh(pencil.mass.toarray())[0] > 0.0
            assert stiffness[0] > -1e-9 * stiffness[-1]


@pytest.mark.slow
def test_a_stiff_patch_on_a_soft_plate_has_the_frequencies_of_a_finer_mesh_of_it() -> None:
    """On PMMA, thirty times softer than the ceramic: as on a mesh of one layer more."""
    soft = replace(DESIGN, material=MATERIALS["pmma"], thickness_m=1.5e-3)
    reduction = ReductionSettings(Interface(4, 2), 100e3, HexSettings(2, 4e-3, 0, 0.2), 6e-3)
    made = PlateModel(soft, Reductions(Stack.of(soft.thickness_m, soft.material), None, reduction))
    box = np.array([-4e-3, 4e-3, -3e-3, 3e-3])
    plates = {symmetry: made.assembled(symmetry) for symmetry in CLASSES}
    tones, bars = [], []
    for mesh in (COARSE, replace(COARSE, layers=2)):
        patch = bonded_patch(PZ26, box, 1e-3, True, mesh)
        plate = PatchedPlate(plates, [patch], True, beneath=StaticCorrection(made.reductions), at_hz=10e3)
        group = next(each for each in plate.groups if each.symmetries == ("SS",))
        basis = group_modes(group, (3e3, 25e3), (1.0, 1.0))
        tones.append(basis.frequency_hz)
        bars.append(frequency_errors(basis).bonding)
    (ours, finer), (bar, more) = tones, bars
    assert len(ours) == len(finer) >= 3 and (np.abs(ours / finer - 1.0) < bar + more).all()
    assert bar.max() < 0.01


@pytest.mark.slow
def test_a_patch_felt_from_either_face_of_a_bare_plate_gives_it_the_same_frequencies() -> None:
    made = across_the_mirror()
    plates = {symmetry: made.assembled(symmetry) for symmetry in CLASSES}
    tones = []
    for back in (True, False):
        patch = bonded_patch(PZ26, MIDDLE[0], 1e-3, back, COARSE)
        plate = PatchedPlate(plates, [patch], back, beneath=StaticCorrection(made.reductions), at_hz=30e3)
        tones.append(np.concatenate([group_modes(each, BAND_HZ, (1.0, 1.0)).frequency_hz for each in plate.groups]))
    assert tones[0] == pytest.approx(tones[1], rel=1e-8)


def test_a_bar_bends_at_constant_charge_between_shorted_electrodes() -> None:
    """What bends it is odd about its middle, so D = 0: s11 (1 - k31^2) stands for s11 (ieee176)."""
    long, side, thick = 12e-3, 0.3e-3, 0.15e-3
    mesh = _mesh(np.array([0.0, long, 0.0, side]), thick, HexSettings(3, 3e-3, 0), True)
    stiffness, mass, _, _ = (
        part.toarray() if hasattr(part, "toarray") else part for part in with_potential(mesh, PZ26, thick)
    )
    n = 3 * len(mesh.nodes)
    short, coupling, inertia = stiffness[:n, :n], stiffness[:n, n:], mass[:n, :n]
    whole = short - coupling @ np.linalg.solve(stiffness[n:, n:], coupling.T)
    plain, bent = (
        scipy.linalg.eigh(each, inertia, eigvals_only=True, subset_by_index=[6, 6])[0] for each in (short, whole)
    )
    k31 = PZ26.d31**2 / (PZ26.s11 * PZ26.permittivity_free_f_m[2, 2])
    assert bent / plain == pytest.approx(1.0 / (1.0 - k31), rel=(thick / long) + (side / long))


def test_a_patch_whose_matrices_no_memory_holds_is_refused_before_they_are_made(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(machine, "room_bytes", lambda: 1e6)
    with pytest.raises(TooLarge, match=r"a patch of 8 x 4 mm .* use shorter patches"):
        bonded_patch(PZ26, MIDDLE[0], 0.123e-3, True)


def test_a_high_patch_rings_as_a_clamped_bar() -> None:
    """Euler's bar, stressed along the poling at constant field; a held foot cannot narrow, as if it were up to a fifth of its
    side shorter.
    """
    side, high = 1e-3, 20e-3
    patch = bonded_patch(PZ26, np.array([0.0, side, 0.0, side]), high, True, HexSettings(3, 2.5e-3, 0))
    young, root = 1.0 / float(PZ26.compliance_pa[2, 2]), roots("clamped", "free", 1)[0]
    exact = frequency_hz(root, high, young * side**4 / 12.0, PZ26.density_kg_m3 * side**2)
    assert exact < patch.own_hz < exact * (1.0 - 0.2 * side / high) ** -2


def test_a_patch_over_pillars_is_meshed_as_finely_as_their_feet() -> None:
    """And as the plate between them; one that ends at their panels' border is not over them."""
    pillar = Pillar("square", 1e-3, 1e-3, 3e-3, ALUMINIUM)
    design = replace(DESIGN, pillar=pillar, pitch_x_m=4e-3, pitch_y_m=4e-3, rows=1)
    tiling = tile(design, design.length_m)
    edge = tiling.y
    strip = edge[np.searchsorted(edge, design.row_places()[0]) - 1 :][:2]
    over, beside = (np.array([-4e-3, 4e-3, strip[1] - reach, strip[1] + 1e-3]) for reach in (1e-4, 0.0))
    assert pillars_beneath(tiling, over) and not pillars_beneath(tiling, beside)
    assert patch_mesh(design, tiling, over).size_m < pillar.base_m
    assert patch_mesh(replace(design, thickness_m=0.5e-3), tiling, over).size_m < 0.5e-3
    assert patch_mesh(design, tiling, beside) == replace(MESH, size_m=design.line_spacing_m / beneath_patches.WAVE)


@pytest.mark.slow
def test_over_pillars_shorter_elements_change_a_height_within_its_bar(monkeypatch: pytest.MonkeyPatch) -> None:
    """With elements of 4 mm the height lay 5 % below at a bar of 1.3 %: the patch did not feel how feet shape the plate."""
    pillar = Pillar("square", 2e-3, 2e-3, 6.3e-3, ALUMINIUM)
    design = Design(12e-3, 10e-3, 2e-3, 2, ALUMINIUM, pillar, 4e-3, 4e-3, 1, 5e-3)
    reduction = ReductionSettings(Interface(6, 3), 400e3, HexSettings(3, 2e-3, 1, 0.15, 3e-3), 4e-3)
    model, box = (
        PlateModel(design, Reductions(Stack.of(2e-3, ALUMINIUM), pillar, reduction)),
        np.array([-1e-3, 2e-3, 4e-3, 6e-3]),
    )
    heights = []
    for share in (beneath_patches.FOOT, beneath_patches.FOOT / 1.4):
        monkeypatch.setattr(beneath_patches, "FOOT", share)
        patch = bonded_patch(PZ26, box, 0.3e-3, False, patch_mesh(design, model.tiling, box))
        plates = {symmetry: model.assembled(symmetry) for symmetry in CLASSES}
        plate = PatchedPlate(plates, [patch], False, beneath=StaticCorrection(model.reductions), at_hz=32e3)
        forced = ForcedPlate(plate, design, Drive((0,), (), (25e3, 40e3), 300.0))
        hz = float(forced.resonances_hz[0])
        heights.append((float(forced.curve(np.array([hz])).zone_rms_m_per_v[0]), height_error(forced, hz)))
    (coarse, bar), (fine, _) = heights
    assert bar is not None and abs(coarse / fine - 1.0) < bar


@pytest.mark.slow
def test_a_patchs_image_is_felt_as_if_it_were_bonded_there() -> None:
    """The image's loads and stiffness are turned round; here both are bonded by themselves, the panels seen in mirrors."""
    made, beneath = across_the_mirror(), StaticCorrection(across_the_mirror().reductions)
    plates = {symmetry: made.assembled(symmetry) for symmetry in CLASSES}
    patch = bonded_patch(PZ26, np.array([-9e-3, -3.5e-3, -5e-3, -1.5e-3]), THICK_M, True, COARSE)
    plate = PatchedPlate(plates, [patch], True, beneath=beneath, at_hz=30e3)
    alone = _bonds({"": patch}, plates["SS"], True, plate.eigenvalue, beneath)[""]
    for part, own in zip(plate.bonds[0].parts, alone.parts, strict=True):
        for symmetry in CLASSES:
            image, there = (displacement_at(plates[symmetry], each.contact).T for each in (part, own))
            assert np.allclose(image @ part.load, there @ own.load, atol=1e-9 * np.abs(there @ own.load).max())
            stiff = there @ own.stiffness @ there.T
            assert np.abs(image @ part.stiffness @ image.T - stiff).max() < 1e-9 * np.abs(stiff).max()


@pytest.mark.slow
@pytest.mark.parametrize("mesh", [HexSettings(3, 2e-3, 1, 0.15), COARSE], ids=["fine", "coarse"])
def test_what_panels_lack_beneath_a_patch_is_less_with_more_modes(mesh: HexSettings) -> None:
    """And positive, on finer elements than the panels' own as on coarser ones, which lack more than the panels do."""
    few, many = (plate_of(top_hz, 4e-3) for top_hz in (300e3, 900e3))
    patch = bonded_patch(PZ26, np.array([-2e-3, 2e-3, -1e-3, 1e-3]), THICK_M, True, mesh)
    lacking = [StaticCorrection(each.reductions).flexibility(each.assembled("SS"), patch, True) for each in (few, many)]
    most = [np.linalg.eigvalsh(each) for each in lacking]
    assert all(values[0] > -1e-12 * values[-1] for values in most)
    assert most[1][-1] < most[0][-1]


@pytest.mark.slow
def test_what_a_plate_gives_way_is_kept_between_runs_and_belongs_to_that_plate(monkeypatch: pytest.MonkeyPatch) -> None:
    """A second run computes nothing and has the same digits; another thickness or material is not taken for this one."""
    made, kept = plate_of(300e3, 4e-3), KeptMatrices()
    plate, patch = made.assembled("SS"), bonded_patch(PZ26, MIDDLE[0], THICK_M, True, COARSE)
    first = StaticCorrection(made.reductions, kept).flexibility(plate, patch, True)
    others = [
        {"stack": Stack.of(2.5e-3, ALUMINIUM)},
        {"stack": Stack.of(DESIGN.thickness_m, MATERIALS["steel"])},
        {"pillar": Pillar("square", 1e-3, 1e-3, 2e-3, ALUMINIUM)},
    ]
    for other in others:
        place = beneath_patches._Place.of(plate, patch, made.reductions, True)
        StaticCorrection(replace(made.reductions, **other), kept)._missing_flexibility(plate, place)
    finer = replace(made.reductions.reduction, top_hz=350e3)
    StaticCorrection(replace(made.reductions, reduction=finer), kept)._missing_flexibility(plate, place)
    assert len(kept) == 2 * (1 + len(others)) + 1, (
        "fine mesh and what is lacking; the fine mesh is no matter of reduction"
    )
    monkeypatch.setattr(StaticCorrection, "_static", lambda self, place: pytest.fail("computed again"))
    assert np.array_equal(StaticCorrection(made.reductions, kept).flexibility(plate, patch, True), first)


@pytest.mark.slow
def test_what_is_told_of_a_patch_at_the_plates_free_end_does_not_stand_for_one_inside() -> None:
    """Panels alike, the patch at the same place on them; asked one after another, and each by itself."""
    made = plate_of(300e3, 4e-3)
    plate, lines, beneath = made.assembled("SS"), made.tiling.x, StaticCorrection(made.reductions)
    width, half = lines[-1] - lines[-2], THICK_M
    boxes = [
        np.array([middle - half, middle + half, -1e-3, 1e-3]) for middle in (lines[-1] - width, lines[-1] - 2.0 * width)
    ]
    ours = [beneath.flexibility(plate, bonded_patch(PZ26, box, THICK_M, True, COARSE), True) for box in boxes]
    alone = [
        StaticCorrection(made.reductions).flexibility(plate, bonded_patch(PZ26, box, THICK_M, True, COARSE), True)
        for box in boxes
    ]
    assert all(
        np.allclose(one, other, rtol=1e-9, atol=1e-9 * np.abs(other).max())
        for one, other in zip(ours, alone, strict=True)
    )


@pytest.mark.slow
def test_a_bonded_patch_is_held_as_softly_as_by_the_whole_solid() -> None:
    """The solid's coarse mesh lies 0.2 to 0.4 % above a finer one. Without the panels' own flexibility ours is stiffer in every
    mode, and by that much in those that strain the panel.
    """
    box, made = MIDDLE[0], plate_of(300e3, 4e-3)
    solid, errors = conforming(box), []
    for beneath in (StaticCorrection(made.reductions), None):
        plates = {symmetry: made.assembled(symmetry) for symmetry in CLASSES}
        plate = PatchedPlate(plates, [bonded_patch(PLAIN, box, THICK_M, True)], True, beneath=beneath)
        mine = [modes_in_band(group.pencil, *BAND_HZ).frequency_hz for group in plate.everything]
        errors.append(np.sort(np.concatenate(mine)) / solid - 1.0)
    soft, stiff = errors
    assert soft.min() > -0.006 and soft.max() < 0.0
    assert (stiff > soft).all() and (stiff - soft).max() > 0.002


class _Kept:
    def __init__(self) -> None:
        self.arrays: dict[str, dict] = {}

    def load(self, key: str) -> dict | None:
        flat = self.arrays.get(key)
        return flat and {name: np.asarray(value) for name, value in flat.items()}

    def keep(self, key: str, flat: dict) -> None:
        self.arrays[key] = flat


def test_a_kept_patch_is_the_one_that_was_computed(monkeypatch: pytest.MonkeyPatch) -> None:
    """Another size is another one, and what this process has already is not read."""
    cache, box = _Kept(), np.array([1e-3, 4.5e-3, -1e-3, 1e-3])
    first = bonded_patch(PZ26, box, 0.41e-3, True, COARSE, cache)
    piezo_patch._known.cache_clear()
    monkeypatch.setattr(piezo_patch, "_alike", None)
    again = bonded_patch(PZ26, box, 0.41e-3, True, COARSE, cache)
    for name in ("material", "thickness_m", "mesh", *piezo_patch.KEPT):
        assert np.array_equal(getattr(first, name), getattr(again, name)), name
    assert isinstance(again.own_hz, float) and bonded_patch(PZ26, box, 0.41e-3, True, COARSE).theta is again.theta
    with pytest.raises(TypeError):
        bonded_patch(PZ26, box, 0.42e-3, True, COARSE, cache)


def test_a_patch_by_its_mirror_classes_is_the_whole_one() -> None:
    """Condensed at once, without classes, in dense matrices."""
    patch = bonded_patch(PZ26, np.array([0.0, 3e-3, 0.0, 2e-3]), 0.4e-3, True, COARSE)
    mesh = _mesh(np.array([0.0, 3e-3, 0.0, 2e-3]), 0.4e-3, COARSE, True)
    stiffness, mass, theta, capacitance = with_potential(mesh, PZ26, 0.4e-3)
    bond = np.flatnonzero(np.abs(mesh.nodes[:, 2]) < 1e-12)
    b = (3 * bond[:, None] + np.arange(3)).ravel()
    i = np.setdiff1d(np.arange(stiffness.shape[0]), b)
    k, m = stiffness.toarray(), mass.toarray()
    right = np.hstack([-k[np.ix_(i, b)], theta[i, None], m[np.ix_(i, i)]])
    follow, swell, flexible = np.split(np.linalg.solve(k[np.ix_(i, i)], right), [len(b), len(b) + 1], axis=1)
    swell = swell[:, 0]
    moved = np.zeros((len(k), len(b)))
    moved[b], moved[i] = np.eye(len(b)), follow
    for own, whole in (
        (patch.stiffness, moved.T @ k @ moved),
        (patch.mass, moved.T @ m @ moved),
        (patch.theta, moved.T @ theta),
        (patch.swell, moved.T @ m[:, i] @ swell),
        (np.array([patch.capacitance_f]), np.array([capacitance + theta[i] @ swell])),
    ):
        np.testing.assert_allclose(own, whole, rtol=0.0, atol=1e-9 * np.abs(whole).max())
    largest = spla.eigs(flexible, 1, return_eigenvectors=False).real.max()
    assert patch.own_hz == pytest.approx(1.0 / np.sqrt(largest) / (2.0 * np.pi), rel=1e-5)
