"""Confinement and travelling waves: exact waves, brute search, energy flux; modes held; resonators beside patches."""

from __future__ import annotations

from dataclasses import replace
from math import inf, pi

import numpy as np
import pytest
from scipy.linalg import eigh

from solvers.errors import SolverError
from solvers.shaping.modal_table import ModalTable, field_matrix, modal_drive
from solvers.shaping.travelling_wave import (
    best_travelling_drive,
    forward_energy_share,
    free_wavelength_m,
    hold_modes,
    inner_window,
    net_flux_share,
    travelling_pair,
    travelling_wave_ratio,
    two_wave_fit,
    wave_target,
)
from solvers.shaping.voltages import (
    REGIONS,
    attach_oscillators,
    best_contrast,
    confinement,
    contrast,
    region_points,
    region_sensors,
    region_target,
)
from solvers.thesis.shaped_beam import PatchedBeam, beam_table, condense, section

X = np.linspace(0.0, 0.2, 401)
K = 95.0
RANDOM = np.random.default_rng(3)
BEAM = PatchedBeam()


def waves(backward: complex, wavenumber: float = K) -> np.ndarray:
    return np.exp(-1j * wavenumber * X) + backward * np.exp(1j * wavenumber * X)


def test_twr_is_one_minus_the_ratio_of_the_two_waves():
    for size in (0.0, 0.42, 0.9):
        result = travelling_wave_ratio(waves(size * np.exp(0.7j)))
        assert result == pytest.approx(1.0 - size, abs=2e-3)  # the grid misses the extremes by (k dx)^2


def test_shares_of_energy_are_those_of_the_two_fluxes():
    """Time-averaged flux of w on a beam: Re(EI w''' conj(v) - EI w'' conj(v'))/2, v = i omega w."""

    def flux(forward: complex, backward: complex) -> float:
        value = [
            (-1j * K) ** n * forward * np.exp(-1j * K * 0.03) + (1j * K) ** n * backward * np.exp(1j * K * 0.03)
            for n in range(4)
        ]
        return 0.5 * float(np.real(value[3] * np.conj(1j * value[0]) - value[2] * np.conj(1j * value[1])))

    ratio = 0.58
    both, alone, back = flux(1.0, 0.42j), flux(1.0, 0.0), -flux(0.0, 0.42j)
    assert net_flux_share(ratio) == pytest.approx(both / alone)
    assert forward_energy_share(ratio) == pytest.approx(alone / (alone + back))
    assert round(100 * forward_energy_share(ratio)) == 85 and round(100 * net_flux_share(ratio)) == 82


def test_two_wave_fit_finds_both_waves_and_leaves_near_fields_out():
    result = two_wave_fit(X, waves(0.3 - 0.2j), 80.0)
    assert result.wavenumber == pytest.approx(K, rel=1e-6)
    assert (result.forward, result.backward) == (pytest.approx(1.0, abs=1e-5), pytest.approx(0.3 - 0.2j, abs=1e-5))
    assert result.residual < 1e-5 and result.twr == pytest.approx(1 - abs(0.3 - 0.2j), abs=1e-5)
    disturbed = two_wave_fit(X, waves(0.3) + np.exp(-K * X), 80.0)
    assert disturbed.residual > 0.05 and disturbed.twr == pytest.approx(0.7, abs=0.1)


def test_free_wavelength_is_that_of_phase_velocity_and_of_the_beams_equation():
    _, _, bending, mass = section(BEAM, False)
    length = free_wavelength_m(2400.0, bending, mass)
    assert bending * (2 * pi / length) ** 4 == pytest.approx(mass * (2 * pi * 2400.0) ** 2)
    assert free_wavelength_m(4 * 2400.0, bending, mass) == pytest.approx(length / 2)  # dispersive: c grows as sqrt(f)


def test_targets_of_waves_carry_the_phase_of_their_places():
    target = wave_target(np.array([0.0, 0.015, 0.06]), 0.06)
    assert target == pytest.approx([1.0, -1j, 1.0])


def test_best_travelling_drive_beats_least_squares_and_reaches_a_wave_that_can_be_reached():
    columns = np.stack([waves(0.0), waves(0.0).conj(), np.exp(-K * X)], axis=1)
    voltages, ratio = best_travelling_drive(columns, X, 80.0)
    assert ratio > 0.999 and travelling_wave_ratio(columns @ voltages) == pytest.approx(ratio)
    table = beam_table(BEAM)
    inside = inner_window(table.points_m, 0.03, 0.12)
    field, x = field_matrix(table, 2400.0)[inside], table.points_m[inside, 0]
    best = best_travelling_drive(field, x, 100.0)[1]
    fitted = max(
        travelling_wave_ratio(field @ np.linalg.lstsq(field, np.exp(-1j * k * x), rcond=None)[0])
        for k in np.linspace(75.0, 135.0, 61)
    )
    assert best > fitted + 0.01


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: wave_target(X, 0.0), "wavelength in m = 0: must be"),
        (lambda: travelling_wave_ratio(np.zeros(5)), "zero everywhere"),
        (lambda: two_wave_fit(X[:5], waves(0)[:5], K), "needs 8 points"),
        (lambda: inner_window(X, 0.3, 0.4), "no two points"),
        (lambda: free_wavelength_m(0.0, 1.0, 1.0), "must be a finite number above 0"),
    ],
)
def test_waves_that_cannot_be_are_refused(call, message):
    with pytest.raises(SolverError, match=message):
        call()


def test_regions_are_thirds_that_mirror_each_other():
    places, points = np.array(BEAM.centres_m), np.linspace(0.0, 0.15, 301)[:, None]
    left, middle, right = (region_points(region, places, points) for region in REGIONS)
    assert (left == right[::-1]).all() and (middle == middle[::-1]).all() and (left | middle | right).all()
    assert region_target("middle", 6).real.tolist() == [0, 0, 1, 1, 0, 0]
    assert region_target("left", 6, alternate=True).real.tolist() == [1, -1, 0, 0, 0, 0]
    with pytest.raises(SolverError, match="region 'top': must be one of left, middle, right"):
        region_sensors("top", 6)
    with pytest.raises(SolverError, match="need 3 or more"):
        region_sensors("left", 2)


def test_ratios_of_a_field_that_is_known():
    inside = np.array([True, True, False, False])
    result = contrast(np.array([3.0, 4j, 1.0, -1.0]), inside)
    assert result.peak_ratio == 4.0 and result.contrast == pytest.approx(np.sqrt(12.5))
    uneven = contrast(np.array([3.0, 1.0, 2.0, 2.0, 2.0]), np.arange(5) == 0)
    assert uneven.contrast == pytest.approx(np.sqrt(9.0 / 3.25))
    with pytest.raises(SolverError, match="some points must lie inside"):
        contrast(np.ones(4), np.ones(4, bool))
    with pytest.raises(SolverError, match="zero everywhere"):
        contrast(np.zeros(4), inside)


def test_best_contrast_is_the_best_of_a_grid_of_two_voltages():
    field = RANDOM.normal(size=(9, 2)) + 1j * RANDOM.normal(size=(9, 2))
    inside = np.arange(9) < 4
    best = contrast(field @ best_contrast(field, inside), inside).contrast
    grid = [
        contrast(field @ np.array([np.cos(a), np.sin(a) * np.exp(1j * p)]), inside).contrast
        for a in np.linspace(0, pi / 2, 181)
        for p in np.linspace(0, 2 * pi, 181)
    ]
    assert max(grid) <= best * (1 + 1e-12) and max(grid) == pytest.approx(best, rel=1e-3)
    with pytest.raises(SolverError, match="contrast is unbounded"):
        best_contrast(field, np.arange(9) != 0)


def cosines(detuning: float = 0.02, quality_factor: float = 100.0) -> ModalTable:
    """Two close modes, cos and sin of 95 x along a zone, and a third far away that is not target."""
    field = np.stack([np.cos(K * X), np.sin(K * X), np.cosh(10 * X)])
    weights = np.array([[1.0, 0.3, 0.2], [0.2, -1.0, 0.4], [0.3, 0.2, 1.0]])
    frequencies = np.array([1000.0 * (1 - detuning), 1000.0 * (1 + detuning), 1700.0])
    return ModalTable(frequencies, np.full(3, quality_factor), weights, weights, field, X[:, None])


def test_modes_held_are_the_ones_asked_for():
    table = cosines()
    result = hold_modes(table, 1000.0, {0: 2e-6, 1: 1e-6j})
    assert modal_drive(table, 1000.0) @ result.voltages == pytest.approx(np.array([2e-6, 1e-6j, 0.0]), abs=1e-18)
    free = hold_modes(table, 1000.0, {0: 2e-6}, others=0.0)
    got = modal_drive(table, 1000.0) @ free.voltages
    assert got[0] == pytest.approx(2e-6) and np.linalg.norm(free.voltages) < np.linalg.norm(
        hold_modes(table, 1000.0, {0: 2e-6}).voltages
    )


def test_two_modes_a_quarter_period_apart_travel_towards_x():
    pair = travelling_pair(cosines(), (0, 1), X >= 0.0)
    assert pair.frequency_hz == pytest.approx(1000.0, rel=1e-3)
    assert pair.wavenumber == pytest.approx(K, rel=2e-2)
    assert pair.alone > 0.97 and pair.twr == pytest.approx(pair.alone, abs=1e-6)
    turned = replace(cosines(), field=cosines().field * np.array([[1.0], [-1.0], [1.0]]))
    assert travelling_pair(turned, (0, 1), X >= 0.0).wavenumber == pytest.approx(K, rel=2e-2)
    in_step = field_matrix(cosines(), 1000.0) @ hold_modes(cosines(), 1000.0, {0: 1.0, 1: 1.0}).voltages
    assert travelling_wave_ratio(in_step) < 0.05  # without the quarter period it stands


def test_a_travelling_pair_on_the_patched_beam():
    table = beam_table(BEAM)
    inside = inner_window(table.points_m, 0.05, 0.10)
    pair = travelling_pair(table, (1, 2), inside)
    assert pair.twr > 0.7 and pair.wavenumber > 0.0
    one = field_matrix(table, pair.frequency_hz)[:, 2]
    assert travelling_wave_ratio(one[inside]) < 0.2 * pair.twr


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: travelling_pair(cosines(), (1, 1), X >= 0), "two different modes"),
        (lambda: travelling_pair(cosines(), (0, 1), X > 0.199), "8 or more are needed"),
        (lambda: hold_modes(cosines(), 1000.0, {5: 1.0}), "modes 0 to 2"),
        (
            lambda: hold_modes(replace(cosines(), actuators=np.diag([1.0, 0, 1.0])), 1e3, {1: 1.0}),
            "sits on a node of it",
        ),
        (lambda: hold_modes(cosines(), 0.0, {0: 1.0}), "must be a finite number above 0"),
        (lambda: hold_modes(cosines(), 1000.0, {0: 1.0}, others=-1.0), "others = -1"),
    ],
)
def test_modes_that_cannot_be_held_are_refused(call, message):
    with pytest.raises(SolverError, match=message):
        call()


def assembled_matrices(beam: PatchedBeam, at: np.ndarray, mass: float, frequency: float):
    """The finite-element beam with its oscillators, nothing modal about it."""
    body = condense(beam)
    rows = body.rows(at)
    size, hung = len(body.stiffness), len(at)
    spring = mass * (2 * pi * frequency) ** 2
    stretch = np.hstack([rows, -np.eye(hung)])
    stiffness, inertia = np.zeros((size + hung,) * 2), np.diag(np.concatenate([np.zeros(size), np.full(hung, mass)]))
    stiffness[:size, :size], inertia[:size, :size] = body.stiffness, body.mass
    return body, stiffness + spring * stretch.T @ stretch, inertia


def test_oscillators_on_a_modal_table_are_oscillators_on_the_finite_element_beam():
    beam, points = replace(BEAM, quality_factor=inf), np.array([0.045, 0.105, 0.06])
    body, stiffness, inertia = assembled_matrices(beam, points[:2], 5e-4, 2400.0)
    exact = np.sqrt(eigh(stiffness, inertia, eigvals_only=True, subset_by_index=(0, 7))) / (2 * pi)
    errors = []
    for modes in (10, 60):
        joined = attach_oscillators(beam_table(beam, modes, points), np.array([0, 1]), 5e-4, 2400.0, inf)
        errors.append(np.abs(joined.frequencies_hz[:8] / exact - 1.0).max())
    assert errors[1] < 1e-4 and errors[1] < 0.2 * errors[0]  # fewer modes are stiffer
    omega = 2 * pi * 1800.0
    loads = np.vstack([body.forces, np.zeros((2, 6))])
    answer = np.linalg.solve(stiffness - omega**2 * inertia, loads)[: len(body.stiffness)]
    exact_field = body.rows(points) @ answer
    assert field_matrix(joined, 1800.0).real == pytest.approx(exact_field, abs=1e-3 * np.abs(exact_field).max())


def test_losses_of_joined_modes_are_shared_by_strain_energy():
    table = beam_table(replace(BEAM, quality_factor=80.0), 10)
    joined = attach_oscillators(table, np.array([100]), 1e-9, 5000.0, 20.0)
    assert np.sort(joined.quality_factor)[0] == pytest.approx(20.0, rel=1e-3)  # a massless oscillator keeps to itself
    assert np.sort(joined.quality_factor)[1:] == pytest.approx(np.full(10, 80.0), rel=1e-3)
    same = attach_oscillators(table, np.array([100]), 1e-3, 5000.0, 80.0)
    assert same.quality_factor == pytest.approx(np.full(11, 80.0), rel=1e-9)


def test_resonators_and_patches_hold_more_than_either():
    bare = beam_table(BEAM)
    passive = attach_oscillators(bare, np.array([90, 102, 198, 210]), 5e-4, 2400.0, 50.0)
    inside = inner_window(bare.points_m, 0.05, 0.10)
    free, result = (confinement(table, 2400.0, inside, 2) for table in (bare, passive))
    assert free.alone_db < result.alone_db < result.shaped_db
    assert free.alone_db < free.shaped_db < result.shaped_db
    again = contrast(field_matrix(passive, 2400.0) @ result.voltages, inside).contrast_db
    assert again == pytest.approx(result.shaped_db) and np.abs(result.voltages).max() == pytest.approx(1.0)
    with pytest.raises(SolverError, match="driver 6: must be from 0 to 5"):
        confinement(bare, 2400.0, inside, 6)
    with pytest.raises(SolverError, match="points must be from 0 to 300"):
        attach_oscillators(bare, np.array([301]), 1e-3, 2400.0, 50.0)
    with pytest.raises(SolverError, match="mass = 0: must be above 0"):
        attach_oscillators(bare, np.array([3]), 0.0, 2400.0, 50.0)
