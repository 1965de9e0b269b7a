"""A finger on a small plate: nothing, rigid and finite against direct solves of the whole model; energy; a map's places."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cache
from typing import Any

import numpy as np
import pytest
import scipy.sparse as sp
import scipy.sparse.linalg as spla
from scipy.special import j1

from geometry.errors import GeometryError
from geometry.fingertips import FINGERTIPS, Fingertip
from geometry.hex.scenes import HexSettings
from geometry.layout import Design
from geometry.materials import MATERIALS, PIEZO_MATERIALS, Stack
from geometry.supports import Support
from solvers.piezo.forced import Drive, ForcedPlate
from solvers.piezo.patch import bonded_patch
from solvers.piezo.patched_plate import CLASSES, PatchedPlate
from solvers.piezo.responses import face_motion
from solvers.plates.assembled import PlateModel, Reductions
from solvers.superelement.bond import Contact, displacement_at
from solvers.superelement.interface import Interface, ReductionSettings
from solvers.superelement.plate import WHOLE
from solvers.touch import effects, touched_plate
from solvers.touch.effects import Places, _known_range, lattice, loaded_mode
from solvers.touch.touched_plate import Finger, TouchedPlate, integration_error, power

ALUMINIUM = MATERIALS["aluminium"]
DESIGN = Design(24e-3, 10e-3, 2e-3, 2, ALUMINIUM, None, float("nan"), float("nan"), 0, 3e-3)
BAND_HZ, QUALITY = (10e3, 30e3), 1e6
PLACE_M, RADIUS_M = (1e-3, -2e-3), 5.5e-3  # on no mirror plane: every symmetry class moves
PATCHES_M = ((-9e-3, -3e-3, -2e-3, 2e-3), (3e-3, 9e-3, -2e-3, 2e-3))
SMALL_M = 2e-3
DEGREE = 2  # of polynomials over the contact
NOTHING, RIGID = Fingertip("nothing"), Fingertip("rigid", stiffness_n_m=1e15)
HEAVY = Fingertip("heavy", stiffness_n_m=2e6, damping_n_s_m=20.0, mass_kg=3e-5)


@cache
def patched(supports: tuple[Support, ...] = ()) -> PatchedPlate:
    reduction = ReductionSettings(Interface(4, 1), 200e3, HexSettings(2, 5e-3, 0, 0.2), 8e-3)
    model = PlateModel(
        replace(DESIGN, supports=supports), Reductions(Stack.of(DESIGN.thickness_m, ALUMINIUM), None, reduction)
    )
    bonded = [bonded_patch(PIEZO_MATERIALS["pz26"], np.array(box), 0.5e-3, True) for box in PATCHES_M]
    classes = CLASSES if None not in model.symmetries else (WHOLE,)
    return PatchedPlate({symmetry: model.assembled(symmetry or None) for symmetry in classes}, bonded, True)


@cache
def free(quality_factor: float = QUALITY, band_hz: tuple[float, float] = BAND_HZ) -> ForcedPlate:
    return ForcedPlate(patched(), DESIGN, Drive((0,), (1,), band_hz, quality_factor))


def touched(tip: Fingertip, place: tuple[float, float] = PLACE_M, quality_factor: float = QUALITY) -> TouchedPlate:
    return TouchedPlate(free(quality_factor), Finger(tip, place, RADIUS_M, DEGREE))


def rings(count: int, around: int) -> tuple[np.ndarray, np.ndarray]:
    """A Gauss rule along the squared radius times even angles on the unit disk: points (p, 2), weights (p,)."""
    nodes, shares = np.polynomial.legendre.leggauss(count)
    radius, angle = np.sqrt((nodes + 1.0) / 2.0), 2.0 * np.pi * np.arange(around) / around
    points = np.stack([np.outer(radius, np.cos(angle)), np.outer(radius, np.sin(angle))], axis=-1).reshape(-1, 2)
    return points, np.repeat(shares / 2.0 / around, around)


def on_disk(groups: Any, at_m: tuple[float, float], radius_m: float) -> sp.csr_array:
    """Roots of shares of the disk times u_z at 4000 points, (points, dof): rows' rows is the mean of u_z^2 over it."""
    points, weights = rings(40, 100)
    moved = sp.hstack([face_motion(group, np.array(at_m) + radius_m * points) for group in groups])
    return sp.csr_array(sp.diags_array(np.sqrt(weights)) @ moved)


def whole(
    plate: ForcedPlate, radius_m: float = RADIUS_M, finger: Finger | None = None
) -> tuple[sp.csc_array, sp.csc_array, np.ndarray, sp.csr_array]:
    """K, M, patch loads and the contact's rows of all classes at once, scaled: on 4000 points, or a finger's own moments."""
    groups = plate.plate.everything
    moments = [sp.csr_array(finger.rows(group)) for group in groups] if finger else []
    rows = sp.csr_array(sp.hstack(moments)) if finger else on_disk(groups, PLACE_M, radius_m)
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
    assert mode and (mode.frequency_hz, mode.added_loss, mode.share) == (free().target_hz(), 0.0, 1.0)


@pytest.mark.parametrize("tip", [RIGID, HEAVY, FINGERTIPS["tissue"]], ids=lambda tip: tip.name)
def test_modes_with_a_finger_meet_a_direct_solve_of_the_whole_model(tip: Fingertip) -> None:
    """Rigid: Lagrange multipliers hold the moments. Direct solves damp all modes, ours those about the band: 1/Q apart."""
    plate = touched(tip)
    stiffness, mass, loads, rows = whole(plate, finger=plate.finger)
    frequency = 0.5 * sum(BAND_HZ)  # of rigid points the two terms for modes beyond the band are exact here
    eigenvalue, unit = plate.plate.scale.eigenvalue(frequency), plate.plate.stiffness_unit
    matrix = stiffness * (1.0 + 1j / QUALITY) - eigenvalue * mass
    answer = plate.volts(eigenvalue)
    right = (loads @ answer[:2]).astype(complex)
    if tip is RIGID:
        matrix = sp.block_array([[matrix, rows.T], [rows, None]], format="csc")
        direct = spla.splu(matrix).solve(np.concatenate([right, np.zeros(rows.shape[0])]))[: len(right)]
    else:
        spring = plate.finger.dynamic_stiffness(frequency) / unit
        direct = spla.splu(sp.csc_array(matrix + spring * (rows.T @ rows))).solve(right)
    parts = [basis.columns @ basis.amplitudes(eigenvalue, answer) for basis in plate.modes]
    assert np.linalg.norm(np.concatenate(parts) - direct) < 20.0 / QUALITY * np.linalg.norm(direct)
    charge = unit * (loads.T @ direct) + plate.plate.capacitance_f * answer[:2]
    assert abs(charge[1]) < 10.0 / QUALITY * abs(
        plate.plate.capacitance_f[1] * answer[1]
    )  # the open sensor carries none
    alone = [basis.columns @ basis.amplitudes(eigenvalue, answer[:2]) for basis in free().all_modes]
    assert np.linalg.norm(np.concatenate(alone) - direct) > 0.1 * np.linalg.norm(direct)  # the finger is felt


SUPPORTS = (
    Support("spring", at_m=(8e-3, 4e-3), radius_m=2e-3, stiffness_n_m=3e6),
    Support("mass", at_m=(-6e-3, 5e-3), radius_m=1.5e-3, mass_kg=1e-4),
)


@pytest.mark.slow
def test_a_finger_on_a_supported_plate_meets_a_direct_solve_of_the_free_one_with_both_added() -> None:
    """Springs and masses as sums over their own points of the four classes; the discs' rules differ by 1e-3 of them."""
    free_plate, design = patched(), replace(DESIGN, supports=SUPPORTS)
    groups, unit = free_plate.everything, free_plate.stiffness_unit
    stiffness, mass, loads, rows = whole(free(), finger=Finger(HEAVY, PLACE_M, RADIUS_M, DEGREE))
    points, weights = rings(10, 40)
    for each in SUPPORTS:
        contact = Contact(np.array(each.at_m) + each.radius_m * points, np.diag(np.sqrt(weights)), back=True)
        moved = [
            sp.csc_array(
                sp.hstack([displacement_at(own, contact)[axis::3] for group in groups for own in group.plates])
            )
            for axis in range(3)
        ]
        stiffness = stiffness + each.stiffness_n_m / unit * moved[2].T @ moved[2]
        mass = mass + each.mass_kg / free_plate.scale.mass_kg * sum(u.T @ u for u in moved)
    held = ForcedPlate(patched(SUPPORTS), design, Drive((0,), (1,), BAND_HZ, QUALITY))
    assert held.plate.everything[0].symmetries == (WHOLE,)
    plate, bare = TouchedPlate(held, Finger(HEAVY, PLACE_M, RADIUS_M, DEGREE)), touched(HEAVY)
    tone = 0.5 * sum(BAND_HZ)  # where residual vectors are exact
    eigenvalue = free_plate.scale.eigenvalue(tone)
    answer = plate.volts(eigenvalue)
    spring = plate.finger.dynamic_stiffness(tone) / unit
    matrix = stiffness * (1.0 + 1j / QUALITY) - eigenvalue * mass + spring * (rows.T @ rows)
    direct = rows @ spla.splu(sp.csc_array(matrix)).solve((loads @ answer[:2]).astype(complex))
    ours = plate.contact_motion(tone)
    assert np.linalg.norm(ours - direct) < 1e-3 * np.linalg.norm(direct)
    assert np.linalg.norm(bare.contact_motion(tone) - direct) > 0.1 * np.linalg.norm(direct)


@pytest.mark.slow
@pytest.mark.parametrize(
    "tip",
    [
        Fingertip("soft", stiffness_n_m=2e6),
        Fingertip("stiff", stiffness_n_m=1e8),
        Fingertip("damper", damping_n_s_m=80.0),
        HEAVY,
    ],
    ids=lambda tip: tip.name,
)
def test_the_loaded_mode_is_a_complex_eigenvalue_of_the_whole_model(tip: Fingertip) -> None:
    """(K (1 + i/Q) + k D + i omega c D - omega^2 (M + m D)) u = 0, D the mean over 4000 points, linearised in omega.

    Of its modes the one most like the free plate's target mode. Polynomials of a lower degree say what the own degree misses.
    """
    quality, degree = 120.0, 6
    stiff, mass, _, rows = whole(free(), SMALL_M)
    scale, unit = free().plate.scale, free().plate.stiffness_unit
    target = spla.eigsh(stiff, k=1, M=mass, sigma=scale.eigenvalue(free().target_hz()))[1][:, 0]
    square, omega = rows.T @ rows / unit, 2.0 * np.pi / np.sqrt(scale.eigenvalue(1.0))  # rad/s of a scaled root of 1
    k0 = stiff * (1.0 + 1j / quality) + tip.stiffness_n_m * square
    c, m = tip.damping_n_s_m * omega * square, mass + tip.mass_kg * omega**2 * square
    own, none = sp.eye_array(len(target), format="csc"), sp.csc_array(k0.shape)
    first = sp.block_array([[none, own], [k0, 1j * c]], format="csc")
    second = sp.block_array([[own, none], [none, m]], format="csc")
    near = np.sqrt(
        scale.eigenvalue(1.7 * free().target_hz() if tip.stiffness_n_m > 1e7 else 1.02 * free().target_hz()) + 0j
    )
    roots, vectors = spla.eigs(first, k=6, M=second, sigma=near)
    held = np.abs(target @ (mass @ vectors[: len(target)])) / np.linalg.norm(vectors[: len(target)], axis=0)
    best = int(np.argmax(held))
    exact, shape = roots[best] ** 2, vectors[: len(target), best]
    share = abs(target @ (mass @ shape)) ** 2 / (shape.conj() @ (mass @ shape)).real
    direct_hz = float(scale.frequency(np.array(exact.real)))
    plate = TouchedPlate(free(quality, (0.6 * direct_hz, 1.4 * direct_hz)), Finger(tip, PLACE_M, SMALL_M, degree))
    mode, lower, rest = loaded_mode(plate), loaded_mode(plate.lesser(degree - 2)), loaded_mode(plate, None, False)
    assert mode and lower and rest and mode.share == pytest.approx(share, rel=1e-2)
    bar = abs(lower.eigenvalue - mode.eigenvalue) + abs(rest.eigenvalue - mode.eigenvalue) + 1e-6 * abs(exact)
    assert abs(mode.eigenvalue - exact) <= bar < 2e-3 * abs(exact)
    assert mode.frequency_hz == scale.frequency(np.array(mode.eigenvalue.real))
    assert mode.quality_factor == pytest.approx(mode.eigenvalue.real / mode.eigenvalue.imag, rel=1e-12)
    if tip.damping_n_s_m:
        assert mode.quality_factor < 0.9 * quality


@pytest.mark.parametrize("mass_kg", [1e-5, 1e-4, 2e-2, 1e3, 1e6])
def test_a_mass_keeps_the_quality_factor(mass_kg: float) -> None:
    """Loss K (1 + i/Q) and a real mass: every eigenvalue of the pencil is one of (K, M) times 1 + i/Q, whatever the mass."""
    mode = loaded_mode(touched(Fingertip("mass", mass_kg=mass_kg), quality_factor=120.0))
    assert mode and mode.quality_factor == pytest.approx(120.0, rel=1e-9)
    assert abs(mode.shift_hz) > 10.0


@pytest.mark.parametrize(
    "tip", [HEAVY, Fingertip("m", mass_kg=1.0), Fingertip("c", damping_n_s_m=1e3)], ids=lambda tip: tip.name
)
def test_a_uniform_motion_is_one_oscillator(tip: Fingertip) -> None:
    """One mode of the plate that moves the contact as a piston: (k0 (1 + i/Q) + k) + i omega c - omega^2 (m0 + m) = 0."""
    plate, scale = touched(tip, quality_factor=50.0), free().plate.scale
    basis = next(each for each in plate.modes if each.group.plates is free().modes[0].group.plates)
    own, size = free(50.0).target_place(), len(basis.frequency_hz)
    assert own is not None and basis.frequency_hz[own[1]] == free(50.0).target_hz()
    gain = np.zeros_like(basis.gain)
    gain[:, len(patched().patches)] = 30.0 * (np.arange(size) == own[1])  # the first polynomial is 1
    none = np.zeros_like(basis.residual_gain[0])
    piston = replace(basis, gain=gain, columns=0.0 * basis.columns, residual_gain=(none, none))
    plate.modes = [piston]
    mode = loaded_mode(plate)
    per, unit = scale.eigenvalue(1.0) / (4.0 * np.pi**2), plate.plate.stiffness_unit  # scaled eigenvalue of 1 rad^2/s^2
    share = unit * 30.0**2
    k = piston.eigenvalue[own[1]] * (1.0 + 1j / 50.0) + share * tip.stiffness_n_m
    c, m = share * tip.damping_n_s_m, per + share * tip.mass_kg
    roots = np.roots([-m, 1j * c, k])
    exact = per * roots[roots.real > 0.0] ** 2
    low, high = _known_range(plate)
    if len(exact) and low < exact[0].real < high:
        assert mode and mode.eigenvalue == pytest.approx(exact[0], rel=1e-9)
    else:
        assert mode is None


WIDE = Design(40e-3, 20e-3, 1e-3, 4, ALUMINIUM, None, float("nan"), float("nan"), 0, 5e-3)


@cache
def wide(band_hz: tuple[float, float], quality_factor: float) -> ForcedPlate:
    """A plate of several wavelengths."""
    reduction = ReductionSettings(Interface(6, 1), 300e3, HexSettings(3, 4e-3, 0, 0.2), 10e-3)
    model = PlateModel(WIDE, Reductions(Stack.of(WIDE.thickness_m, ALUMINIUM), None, reduction))
    bonded = [bonded_patch(PIEZO_MATERIALS["pz26"], np.array(PATCHES_M[0]), 0.3e-3, True)]
    plate = PatchedPlate({symmetry: model.assembled(symmetry) for symmetry in CLASSES}, bonded, True)
    return ForcedPlate(plate, WIDE, Drive((0,), (), band_hz, quality_factor))


@pytest.mark.slow
@pytest.mark.parametrize("waves", [0.25, 0.5, 1.0])
def test_a_disk_is_integrated_up_to_a_radius_of_one_wavelength(waves: float) -> None:
    """Direct solves of the whole model: pressure by a finger's own moments against the mean over 4000 points.

    The motion under a soft and a hard contact lies inside its bar: what a lower degree changes, what the polynomials miss.
    """
    tone, place, quality = 55e3, (1.5e-3, -0.5e-3), 50.0
    forced = wide((45e3, 65e3), quality)
    wavelength = 2.0 * np.pi / Finger(NOTHING, place, 1e-3).wavenumber_per_m(WIDE, tone)
    groups, radius = forced.plate.everything, waves * wavelength
    assert radius < WIDE.half_span_m - 0.5e-3
    fine = on_disk(groups, place, radius)
    for tip in (FINGERTIPS["tissue"], Fingertip("hard", stiffness_n_m=1e8 * waves**2)):
        finger = Finger(tip, place, radius).following(WIDE, tone)
        own = sp.csr_array(sp.hstack([sp.csr_array(finger.rows(group)) for group in groups]))
        exact, ours = (direct_rms(forced, finger, rows, fine, tone) for rows in (fine, own))
        plate = TouchedPlate(forced, finger)
        error = 2.0 * integration_error(plate, tone)
        others = (plate.lesser(finger.degree - 2), plate.stiffer(1.0 + error))
        here, lower, stiffer = (np.linalg.norm(each.contact_motion(tone)) for each in (plate, *others))
        bar = abs(here - lower) + abs(here - stiffer) + error * here
        assert abs(ours - exact) <= bar < 0.05 * exact


def direct_rms(forced: ForcedPlate, finger: Finger, rows: sp.csr_array, fine: sp.csr_array, tone: float) -> float:
    """rms of u_z over the fine points with the finger's impedance on rows of the contact, every mode damped."""
    groups, scale = forced.plate.everything, forced.plate.scale
    stiffness, mass = (
        sp.block_diag([getattr(group.pencil, name) for group in groups], format="csc") for name in ("stiffness", "mass")
    )
    spring = finger.dynamic_stiffness(tone) / forced.plate.stiffness_unit
    matrix = stiffness * (1.0 + 1j * forced.loss_at(tone)) - scale.eigenvalue(tone) * mass + spring * (rows.T @ rows)
    load = np.vstack([group.loads for group in groups])[:, 0].astype(complex)
    return np.linalg.norm(fine @ spla.splu(sp.csc_array(matrix)).solve(load))


@pytest.mark.parametrize("tip", [HEAVY, *FINGERTIPS.values(), RIGID], ids=lambda tip: tip.name)
@pytest.mark.parametrize("quality_factor", [30.0, 1e4])
def test_the_patches_give_what_plate_and_finger_take(tip: Fingertip, quality_factor: float) -> None:
    balance = power(touched(tip, quality_factor=quality_factor), 18e3, 0.01)
    assert balance.patches_w == pytest.approx(balance.plate_w + balance.finger_w, rel=1e-9)
    assert balance.finger_w > 0.0 or tip is RIGID
    assert balance.dielectric_w and balance.drawn_w == balance.patches_w + balance.dielectric_w


@dataclass(frozen=True)
class OnLattice(Finger):
    """A finger on the points of a map's lattice, so many over the radius."""

    steps: int = 2

    def rows(self, group: Any, finer: int = 0) -> np.ndarray:
        """Roots of the weights times u_z at the points."""
        places, weights, spacing = effects._lattice_rule(self.steps)
        moved = face_motion(group, np.array(self.at_m) + spacing * self.radius_m * places)
        return np.asarray(np.sqrt(weights)[:, None] * moved.toarray())


def test_a_place_of_the_map_is_a_finger_there() -> None:
    plate = TouchedPlate(free(), Finger(HEAVY, (0.0, 0.0), SMALL_M))
    grid = Places.of(plate, lattice(DESIGN, plate), 18e3).map()
    i, j = 1, 2  # x and y below 0, in no class's own quarter
    there = OnLattice(HEAVY, (float(grid.x_m[i]), float(grid.y_m[j])), SMALL_M)
    alone = TouchedPlate(free(), there)
    assert grid.x_m[i] < 0.0 and grid.y_m[j] < 0.0
    assert grid.touched_m[i, j] == pytest.approx(np.linalg.norm(alone.motion_by(there.rows, 18e3)), rel=1e-7)
    assert grid.free_m[i, j] == pytest.approx(np.linalg.norm(free().motion_by(there.rows, 18e3)), rel=1e-7)
    assert grid.sensor_v[i, j] == pytest.approx(alone.curve(np.array([18e3])).sensor_v_per_v[0], rel=1e-6)
    assert np.abs(grid.x_m).max() + SMALL_M <= DESIGN.length_m / 2.0
    assert np.abs(grid.y_m).max() + SMALL_M <= DESIGN.half_span_m


def test_many_loads_answer_as_few_with_their_columns_do(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(touched_plate, "BLOCK", 3)
    points_m = np.array([[1e-3, 2e-3], [4e-3, 0.5e-3], [0.0, 3e-3], [7e-3, 1e-3], [2e-3, 2e-3]])
    for basis in free().all_modes:
        loads = sp.csc_array(face_motion(basis.group, points_m).T)
        many, few = touched_plate.with_points(basis, loads), touched_plate.with_loads(basis, loads.toarray())
        for tone in (12e3, 27e3):
            at = patched().scale.eigenvalue(tone)
            theirs = few.receptance(at)
            assert np.abs(many.receptance(at) - theirs).max() < 1e-10 * np.abs(theirs).max()
        assert len(many.columns.T) == len(basis.columns.T) < len(few.columns.T)


def test_folded_loads_are_those_of_the_points_themselves() -> None:
    points_m = 1e-3 * np.array([[1.0, 2.0], [-1.0, 2.0], [-4.0, -1.0], [4.0, 1.0], [0.0, -3.0]])
    plate, tone = touched(NOTHING), 18e3
    at, unit = plate.plate.scale.eigenvalue(tone), plate.plate.stiffness_unit
    every = np.arange(len(PATCHES_M) + len(points_m))
    for folded, basis in zip(effects.folded_loads(plate, points_m, tone), free().all_modes, strict=True):
        own = touched_plate.with_loads(basis, face_motion(basis.group, points_m).T.toarray() / unit)
        theirs = own.receptance(at) * unit
        assert np.abs(folded.among(every, every) - theirs).max() < 1e-10 * np.abs(theirs).max()
        assert np.allclose(folded.gains(every), own.gain, rtol=0.0, atol=1e-10 * np.abs(own.gain).max(initial=1.0))


def test_moments_are_the_means_over_a_disk() -> None:
    """Orthonormal in the mean, and of u = 1 + x^2: mean 5/4, mean square 1 + 2/4 + 1/8."""
    points, weights = touched_plate._disk_means(6)
    assert weights @ touched_plate._zernike(6, points).T == pytest.approx(np.eye(touched_plate._count_of(6)), abs=1e-12)
    moments = weights @ (1.0 + points[:, 0] ** 2)
    assert moments[0] == pytest.approx(1.25, rel=1e-12) and np.linalg.norm(moments) ** 2 == pytest.approx(
        1.625, rel=1e-12
    )


@pytest.mark.parametrize("steps", range(2, 7))
def test_a_lattice_s_rule_integrates_a_disk(steps: int) -> None:
    """Of x^a y^b up to the third degree: 1, 1/4 of x^2 and y^2, 0 of the rest; a Bessel function for a wave across it."""
    places, weights, spacing = effects._lattice_rule(steps)
    x, y = spacing * places.T
    exact = {(0, 0): 1.0, (2, 0): 0.25, (0, 2): 0.25}
    for a in range(4):
        for b in range(4 - a):
            assert weights @ (x**a * y**b) == pytest.approx(exact.get((a, b), 0.0), abs=1e-14)
    assert weights.min() > 0.0 and np.hypot(x, y).max() <= 1.0
    reach = max(k for k in np.linspace(0.1, 3.0, 30) if effects._steps_of(k / 2.0) <= steps)
    assert weights @ np.cos(reach * x) == pytest.approx(2.0 * j1(reach) / reach, abs=effects.RULE_ENOUGH)


def test_impedances_are_their_parts() -> None:
    omega = 2.0 * np.pi * 30e3
    tip = Fingertip("all", 1e6, 2.0, 1e-4, 1e5)
    assert tip.impedance_n_s_m(30e3, 5e-5) == pytest.approx(7.0 + 1j * (omega * 1e-4 - 1e6 / omega), rel=1e-14)
    with pytest.raises(GeometryError, match="0 or more"):
        Fingertip("odd", damping_n_s_m=-1.0)
