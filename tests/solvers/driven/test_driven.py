"""Shaped patches on a plate's own modes: contrast, the modal table against the forced plate, power flow against beam theory."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from scipy.linalg import eigh

from geometry.hex.scenes import HexSettings
from geometry.layout import Design
from geometry.materials import MATERIALS, PIEZO_MATERIALS, Stack
from solvers.driven.forms import best_volts, contrast_volts, face_grams, forms, unit_volts
from solvers.driven.several_patches import plate_table, power_flow
from solvers.piezo.forced import Drive, ForcedPlate, GroupModes
from solvers.piezo.patch import bonded_patch
from solvers.piezo.patched_plate import CLASSES, PatchedPlate
from solvers.piezo.responses import face_motion
from solvers.plates.assembled import PlateModel, Reductions
from solvers.shaping.modal_table import field_matrix, sensor_matrix
from solvers.shaping.travelling_wave import two_wave_fit
from solvers.superelement.interface import Interface, ReductionSettings

ALUMINIUM = MATERIALS["aluminium"]
QUALITY = 200.0
BAND_HZ = (10e3, 30e3)
PLATE = Design(24e-3, 10e-3, 2e-3, 2, ALUMINIUM, None, float("nan"), float("nan"), 0, 3e-3)
STRIP = Design(120e-3, 6e-3, 1e-3, 8, ALUMINIUM, None, float("nan"), float("nan"), 0, 0.0)
TONE = 8.3e3  # half a wave of the strip is 24 mm, 24 thicknesses


@cache
def patched(design: Design, boxes: tuple[tuple[float, ...], ...], edge_m: float) -> PatchedPlate:
    reduction = ReductionSettings(Interface(4, 1), 200e3, HexSettings(2, 2e-3, 0, 0.2), edge_m)
    model = PlateModel(design, Reductions(Stack.of(design.thickness_m, ALUMINIUM), None, reduction))
    bonded = [bonded_patch(PIEZO_MATERIALS["pz26"], np.array(box), 0.5e-3, True) for box in boxes]
    return PatchedPlate({symmetry: model.assembled(symmetry) for symmetry in CLASSES}, bonded, True)


def small(
    drivers: tuple[int, ...] = (0, 1), sensors: tuple[int, ...] = (), quality_factor: float = QUALITY
) -> ForcedPlate:
    boxes = ((-9e-3, -3e-3, -2e-3, 2e-3), (3e-3, 9e-3, -2e-3, 2e-3), (-2e-3, 1e-3, 3e-3, 6e-3))
    plate = patched(PLATE, boxes[: len(drivers) + len(sensors)], 8e-3)
    return ForcedPlate(plate, PLATE, Drive(drivers, sensors, BAND_HZ, quality_factor))


def level(plate: ForcedPlate, volts: np.ndarray, tone: float) -> float:
    curve = plate.driven_by(volts).curve(np.array([tone]))
    assert curve.passive_rms_m_per_v is not None
    return float(curve.zone_rms_m_per_v[0] / curve.passive_rms_m_per_v[0])


def test_shaped_voltages_confine_better_than_any_other() -> None:
    """Against patches in phase and random voltages; two patches driven, at a frequency between modes."""
    plate = small(quality_factor=100.0)
    best = contrast_volts(plate, 24e3)
    assert best is not None and np.abs(best).max() == pytest.approx(1.0)
    random = np.random.default_rng(1).normal(size=(20, 2, 2)) @ np.array([1.0, 1j])
    assert all(level(plate, best, 24e3) >= level(plate, volts, 24e3) * (1.0 - 1e-9) for volts in [plate.signs, *random])
    assert contrast_volts(small((0,), (1,)), 24e3) is None  # one driver has nothing to shape


def test_voltages_that_move_little_are_left_alone_where_it_is_asked_for() -> None:
    """With alpha the contrast falls and the motion per volt grows, both monotonously."""
    plate = small(quality_factor=100.0)
    inside, outside = forms(plate, face_grams(plate), np.array([13e3])).squares[:, 0]
    shaped = [best_volts(inside, outside, alpha) for alpha in (0.0, 1.0, 100.0)]
    levels = [level(plate, volts, 13e3) for volts in shaped]
    curves = [(plate.driven_by(volts).curve(np.array([13e3])), volts) for volts in shaped]
    moved = [curve.zone_rms_m_per_v[0] / np.linalg.norm(volts) for curve, volts in curves]
    assert np.diff(levels).max() < 1e-9 * levels[0] and np.diff(moved).min() > -1e-9 * moved[0]  # but for rounding
    assert levels[0] > 1.001 * levels[2] and moved[2] > 1.001 * moved[0]


@pytest.mark.slow
@pytest.mark.parametrize("tone", [14e3, 18.3e3, 24e3])
def test_the_modal_table_is_the_forced_plate(tone: float) -> None:
    """Open sensors and fields at points; loss by omega omega_m against omega_m^2, and its coupling, differ by some 1/Q."""
    plate, points = small((0, 1), (2,)), np.array([[3e-3, 2e-3], [-5e-3, 1e-3]])
    table, eigenvalue = plate_table(plate, points, tone), plate.plate.scale.eigenvalue(tone)
    volts = unit_volts(plate, eigenvalue)
    for driver, own in zip(plate.drivers, volts.T, strict=True):
        exact = plate.driven_by(np.eye(3)[driver]).volts(eigenvalue)
        assert own == pytest.approx(exact, rel=1e-9, abs=1e-12)
    moved = sum(
        face_motion(basis.group, points)
        @ basis.columns
        @ np.column_stack([basis.amplitudes(eigenvalue, own) for own in volts.T])
        for basis in plate.modes
    )
    for ours, theirs in ((sensor_matrix(table, tone), volts[2:]), (field_matrix(table, tone), moved)):
        assert np.abs(ours - theirs).max() < 1.0 / QUALITY * np.abs(theirs).max()
    assert table.quality_factor == pytest.approx(QUALITY, rel=0.02)


def test_what_the_patches_give_is_lost_or_flows_on() -> None:
    flow = power_flow(small((0, 1), (2,)).driven_by(np.array([1.0, 1j, 0.0])), 18e3)
    assert flow.patches_w.sum() == pytest.approx(flow.lost_w, rel=1e-9) and flow.lost_w > 0.0
    assert flow.patches_w[2] == pytest.approx(0.0, abs=1e-9 * flow.lost_w)  # an open sensor
    assert flow.flow_w[0] == 0.0 and flow.flow_w[-1] == pytest.approx(0.0, abs=1e-9 * flow.lost_w)


def softer(basis: GroupModes) -> GroupModes:
    """Modes of a stiffness by some percent off that of the mesh, within their span, as extrapolated ones are."""
    count = len(basis.eigenvalue)
    change = np.random.default_rng(2).normal(size=(count, count))
    root = np.sqrt(basis.eigenvalue)
    values, turn = eigh(np.diag(basis.eigenvalue) - 0.02 * np.outer(root, root) * (change + change.T))
    columns = np.hstack([basis.columns[:, :count] @ turn, basis.columns[:, count:]])
    frequency_hz = basis.group.pencil.scale.frequency(values)
    return replace(basis, eigenvalue=values, columns=columns, gain=turn.T @ basis.gain, frequency_hz=frequency_hz)


def test_modes_extrapolated_from_two_meshes_lose_what_their_patches_give() -> None:
    """What panels and patches lose adds up for the modes that are solved, whatever the mesh whose matrices share it out."""
    forced = small((0, 1), (2,)).driven_by(np.array([1.0, 1j, 0.0]))
    assert max(len(basis.eigenvalue) for basis in forced.modes) > 1
    meshed = power_flow(forced, 18e3)
    forced.modes = [softer(basis) for basis in forced.modes]
    flow = power_flow(forced, 18e3)
    assert abs(flow.lost_w - meshed.lost_w) > 1e-3 * meshed.lost_w > 0.0
    assert flow.patches_w.sum() == pytest.approx(flow.lost_w, rel=1e-9)
    assert flow.flow_w[-1] == pytest.approx(0.0, abs=1e-9 * flow.lost_w)


@pytest.mark.slow
def test_the_flow_along_a_strip_is_that_of_its_two_waves() -> None:
    """Euler-Bernoulli: P = omega EI k^3 (|a|^2 - |b|^2); shear and the plate's stiffness across are some percent at this k.

    The loss between two sections is what the flow falls by; the strip is fed at one end and drained at the other.
    """
    boxes = tuple((x, x + 8e-3, -2e-3, 2e-3) for x in (-58e-3, -46e-3, 38e-3, 50e-3))
    plate = patched(STRIP, boxes, 10e-3)
    forced = ForcedPlate(plate, STRIP, Drive((0, 1, 2, 3), (), (5e3, 12e3), 300.0))
    x = np.linspace(-25e-3, 25e-3, 41)
    points = np.column_stack([x, np.zeros_like(x)])
    table = plate_table_free(forced, points)
    k = float((4.0 * np.pi**2 * TONE**2 * 12.0 * 2700.0 / (70e9 * 1e-6)) ** 0.25)
    volts = np.zeros(4, dtype=complex)
    volts[:] = np.linalg.lstsq(table, np.exp(-1j * k * x), rcond=None)[0]
    volts /= np.abs(volts).max()
    fit = two_wave_fit(x, table @ volts, k)
    assert abs(fit.forward) > 3.0 * abs(fit.backward) and fit.residual < 0.05
    beam = 2.0 * np.pi * TONE * 70e9 * 6e-3 * 1e-9 / 12.0 * fit.wavenumber**3
    expected = beam * (abs(fit.forward) ** 2 - abs(fit.backward) ** 2)
    flow = power_flow(forced.driven_by(volts), TONE)
    middle = int(np.argmin(np.abs(flow.x_m)))
    assert flow.flow_w[middle] == pytest.approx(expected, rel=0.06)
    back = power_flow(forced.driven_by(volts[::-1]), TONE)
    assert back.flow_w[middle] == pytest.approx(-flow.flow_w[middle], rel=1e-6)


def plate_table_free(forced: ForcedPlate, points: np.ndarray) -> np.ndarray:
    """u_z at points per volt of each driver, (points, drivers)."""
    eigenvalue = forced.plate.scale.eigenvalue(TONE)
    volts = unit_volts(forced, eigenvalue)
    moved = [
        face_motion(basis.group, points)
        @ basis.columns
        @ np.column_stack([basis.amplitudes(eigenvalue, own) for own in volts.T])
        for basis in forced.modes
    ]
    return np.asarray(np.sum(moved, axis=0))
