"""A finger on a small plate: nothing, rigid and finite against direct solves of the whole model; energy; a map's places."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest
import scipy.sparse as sp
import scipy.sparse.linalg as spla

from geometry.errors import GeometryError
from geometry.fingertips import FINGERTIPS, Fingertip
from geometry.hex.boxes import HexSettings
from geometry.layout import Design
from geometry.materials import MATERIALS
from geometry.piezo_materials import PIEZO_MATERIALS
from solvers.piezo.forced import Drive, ForcedPlate
from solvers.piezo.patch import bonded_patch
from solvers.piezo.patched_plate import CLASSES, PatchedPlate
from solvers.piezo.point import face_motion
from solvers.superelement.build import PlateModel, Reductions
from solvers.superelement.interface import Interface, ReductionSettings
from solvers.touch.energy import power
from solvers.touch.loaded_mode import loaded_mode
from solvers.touch.touch_map import lattice, touch_map
from solvers.touch.touched_plate import Finger, TouchedPlate, contact_motion, rms

ALUMINIUM = MATERIALS["aluminium"]
DESIGN = Design(24e-3, 10e-3, 2e-3, 2, ALUMINIUM, None, float("nan"), float("nan"), 0, 3e-3)
BAND_HZ, QUALITY = (10e3, 30e3), 1e6
PLACE_M, RADIUS_M = (1e-3, -2e-3), 5.5e-3  # on no mirror plane: every symmetry class moves
PATCHES_M = ((-9e-3, -3e-3, -2e-3, 2e-3), (3e-3, 9e-3, -2e-3, 2e-3))
SMALL_M = 2e-3
NOTHING, RIGID = Fingertip("nothing"), Fingertip("rigid", stiffness_n_m=1e15)
HEAVY = Fingertip("heavy", stiffness_n_m=2e6, damping_n_s_m=20.0, mass_kg=3e-5)


@cache
def patched() -> PatchedPlate:
    reduction = ReductionSettings(Interface(4, 1), 200e3, HexSettings(2, 5e-3, 0, 0.2), 8e-3)
    model = PlateModel(DESIGN, Reductions(DESIGN.thickness_m, ALUMINIUM, None, reduction))
    bonded = [bonded_patch(PIEZO_MATERIALS["pz26"], np.array(box), 0.5e-3, True) for box in PATCHES_M]
    return PatchedPlate({symmetry: model.assembled(symmetry) for symmetry in CLASSES}, bonded, True)


@cache
def free(quality_factor: float = QUALITY, band_hz: tuple[float, float] = BAND_HZ) -> ForcedPlate:
    return ForcedPlate(patched(), DESIGN, Drive((0,), (1,), band_hz, quality_factor))


def touched(tip: Fingertip, place: tuple[float, float] = PLACE_M, quality_factor: float = QUALITY) -> TouchedPlate:
    return TouchedPlate(free(quality_factor), Finger(tip, place, RADIUS_M))


def whole(
    plate: ForcedPlate, radius_m: float = RADIUS_M
) -> tuple[sp.csc_array, sp.csc_array, np.ndarray, sp.csr_array]:
    """K, M, patch loads and the contact's rows of all classes at once, scaled."""
    groups = plate.plate.everything
    rows = sp.hstack([face_motion(group, Finger(NOTHING, PLACE_M, radius_m).points_m) for group in groups]).tocsr()
    stiffness, mass = (
        sp.block_diag([getattr(group.pencil, name) for group in groups], format="csc") for name in ("stiffness", "mass")
    )
    return stiffness, mass, np.vstack([group.loads for group in groups]), rows


def test_no_finger_leaves_the_free_plate_digit_by_digit() -> None:
    tones = np.linspace(*BAND_HZ, 17)
    mine, theirs = touched(NOTHING).curve(tones), free().curve(tones)
    assert np.array_equal(mine.zone_rms_m_per_v, theirs.zone_rms_m_per_v)
    assert mine.passive_rms_m_per_v is not None and theirs.passive_rms_m_per_v is not None
    assert np.array_equal(mine.passive_rms_m_per_v, theirs.passive_rms_m_per_v)
    assert np.array_equal(mine.sensor_v_per_v, theirs.sensor_v_per_v)
    mode = loaded_mode(touched(NOTHING))
    assert mode and (mode.frequency_hz, mode.added_loss, mode.share) == (free().wanted_hz(), 0.0, 1.0)


@pytest.mark.parametrize("tip", [RIGID, HEAVY, FINGERTIPS["tissue"]], ids=lambda tip: tip.name)
def test_modes_with_a_finger_meet_a_direct_solve_of_the_whole_model(tip: Fingertip) -> None:
    """Rigid: Lagrange multipliers hold the points. Direct solves damp all modes, ours those about the band: 1/Q apart."""
    plate = touched(tip)
    stiffness, mass, loads, rows = whole(plate)
    frequency = 0.5 * sum(BAND_HZ)  # of rigid points the two terms for modes beyond the band are exact here
    eigenvalue, unit = plate.plate.scale.eigenvalue(frequency), plate.plate.stiffness_unit
    matrix = stiffness * (1.0 + 1j / QUALITY) - eigenvalue * mass
    answer = plate.volts(eigenvalue)
    right = (loads @ answer[:2]).astype(complex)
    if tip is RIGID:
        matrix = sp.block_array([[matrix, rows.T], [rows, None]], format="csc")
        direct = spla.splu(matrix).solve(np.concatenate([right, np.zeros(rows.shape[0])]))[: len(right)]
    else:
        spring = plate.finger.stiffness_n_m(frequency) / unit
        direct = spla.splu(sp.csc_array(matrix + spring * (rows.T @ rows))).solve(right)
    parts = [basis.columns @ basis.amplitudes(eigenvalue, plate.loss, answer) for basis in plate.modes]
    assert np.linalg.norm(np.concatenate(parts) - direct) < 20.0 / QUALITY * np.linalg.norm(direct)
    charge = unit * (loads.T @ direct) + plate.plate.capacitance_f * answer[:2]
    assert abs(charge[1]) < 10.0 / QUALITY * abs(
        plate.plate.capacitance_f[1] * answer[1]
    )  # the open sensor carries none
    alone = [basis.columns @ basis.amplitudes(eigenvalue, plate.loss, answer[:2]) for basis in free().all_modes]
    assert np.linalg.norm(np.concatenate(alone) - direct) > 0.1 * np.linalg.norm(direct)  # the finger is felt


@pytest.mark.parametrize("stiffness", [2e6, 1e8], ids=["soft", "stiff"])
def test_the_loaded_mode_is_an_eigenvalue_of_the_whole_model(stiffness: float) -> None:
    """Springs under the contact's points, in the matrix: of its modes the one most like the wanted one of the free plate.

    Two terms stand for the modes beyond the band: exact in its middle, where the band is put, with a slope of zero.
    """
    stiff, mass, _, rows = whole(free(), SMALL_M)
    scale, unit = free().plate.scale, free().plate.stiffness_unit
    wanted = spla.eigsh(stiff, k=1, M=mass, sigma=scale.eigenvalue(free().wanted_hz()))[1]
    springs = rows.T @ rows * (stiffness / rows.shape[0] / unit)
    values, vectors = spla.eigsh(stiff + springs, k=8, M=mass, sigma=scale.eigenvalue(15e3))
    best = int(np.argmax(np.abs(vectors.T @ (mass @ wanted))))
    direct = float(scale.frequency(values[best : best + 1])[0])
    near = free(QUALITY, (0.55 * direct, 1.45 * direct))
    finger = Finger(Fingertip("spring", stiffness_n_m=stiffness), PLACE_M, SMALL_M)
    mode = loaded_mode(TouchedPlate(near, finger))
    assert mode and mode.frequency_hz == pytest.approx(direct, rel=1e-6)
    assert mode.share > 0.5 and abs(mode.shift_hz) > 100.0


@pytest.mark.parametrize("tip", [HEAVY, *FINGERTIPS.values(), RIGID], ids=lambda tip: tip.name)
@pytest.mark.parametrize("quality_factor", [30.0, 1e4])
def test_the_patches_give_what_plate_and_finger_take(tip: Fingertip, quality_factor: float) -> None:
    balance = power(touched(tip, quality_factor=quality_factor), 18e3, 0.01)
    assert balance.patches_w == pytest.approx(balance.plate_w + balance.finger_w, rel=1e-9)
    assert balance.finger_w > 0.0 or tip is RIGID
    assert balance.dielectric_w and balance.drawn_w == balance.patches_w + balance.dielectric_w


def test_a_place_of_the_map_is_a_finger_there() -> None:
    plate = TouchedPlate(free(), Finger(HEAVY, (0.0, 0.0), SMALL_M))
    grid = touch_map(plate, lattice(DESIGN, plate), 18e3)
    i, j = 1, 2  # x and y below 0, in no class's own quarter
    there = Finger(HEAVY, (float(grid.x_m[i]), float(grid.y_m[j])), SMALL_M)
    alone = TouchedPlate(free(), there)
    assert grid.x_m[i] < 0.0 and grid.y_m[j] < 0.0
    assert grid.touched_m[i, j] == pytest.approx(rms(contact_motion(alone, there, 18e3)), rel=1e-7)
    assert grid.free_m[i, j] == pytest.approx(rms(contact_motion(free(), there, 18e3)), rel=1e-7)
    assert grid.sensor_v[i, j] == pytest.approx(alone.curve(np.array([18e3])).sensor_v_per_v[0], rel=1e-6)
    assert np.abs(grid.x_m).max() + SMALL_M <= DESIGN.length_m / 2.0
    assert np.abs(grid.y_m).max() + SMALL_M <= DESIGN.half_span_m


def test_the_contacts_points_integrate_a_disk() -> None:
    """Of x^a y^b up to the third degree: 1, R^2/4 of x^2 and y^2, 0 of the rest."""
    x, y = (Finger(NOTHING, (0.0, 0.0), 1.0).points_m).T
    exact = {(0, 0): 1.0, (2, 0): 0.25, (0, 2): 0.25}
    for a in range(4):
        for b in range(4 - a):
            assert np.mean(x**a * y**b) == pytest.approx(exact.get((a, b), 0.0), abs=1e-14)


def test_impedances_are_their_parts() -> None:
    omega = 2.0 * np.pi * 30e3
    tip = Fingertip("all", 1e6, 2.0, 1e-4, 1e5)
    assert tip.impedance_n_s_m(30e3, 5e-5) == pytest.approx(7.0 + 1j * (omega * 1e-4 - 1e6 / omega), rel=1e-14)
    with pytest.raises(GeometryError, match="0 or more"):
        Fingertip("odd", damping_n_s_m=-1.0)
