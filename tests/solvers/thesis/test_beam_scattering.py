"""Resonators on an infinite beam against closed forms, transfer matrices and a finite-element frame."""

from __future__ import annotations

from dataclasses import replace
from math import inf, pi

import numpy as np
import pytest

from geometry.layout import Design, Pillar
from geometry.materials import MATERIALS
from solvers.analytic.beams import exact_omegas
from solvers.errors import SolverError
from solvers.thesis.scattering import (
    HostBeam,
    bending_foot,
    decay_db_per_row,
    field,
    half_power_band,
    moment_total_reflection_rad_s,
    oscillator_total_reflection_rad_s,
    pillar_filter,
    pillar_foot,
    point_force,
    scatter,
    strengths,
    strip_beam,
    transfer_matrix,
)
from tests.helpers.beams import square_beam

ALUMINIUM = MATERIALS["aluminium"]
HOST = HostBeam(70e9 * 4e-3 * 2e-3**3 / 12, 2700 * 8e-6)
PILLAR = square_beam(6.3e-3, 2e-3, 70e9, 2700.0, 0.34)
THIN = replace(PILLAR, shear_n=inf, rotary_kg_m=0.0)
EA = 70e9 * 4e-6
OMEGA = 2 * pi * np.linspace(5e3, 60e3, 23)
DESIGN = Design(0.1155, 0.02, 2e-3, 8, ALUMINIUM, Pillar("square", 2e-3, 2e-3, 6.3e-3, ALUMINIUM), 4e-3, 4e-3, 3, 0.0)


def spring_of(strength: complex, omega: np.ndarray = OMEGA[:1]) -> np.ndarray:
    feet = np.zeros((len(omega), 2, 2), dtype=complex)
    feet[:, 0, 0] = strength * 4 * HOST.bending_n_m2 * HOST.wavenumber_per_m(omega) ** 3
    return feet


def frame(omega: float, places: list[float], thin: bool = True, lever: float = 0.0) -> tuple[complex, complex]:
    """r and t of pillars made of beam and rod elements on a host of beam elements between semi-infinite ends."""
    ends, per = (min(places) - 3e-3, max(places) + 3e-3), 2.5e-4
    nodes = np.linspace(*ends, round((ends[1] - ends[0]) / per) + 1)
    dynamic = np.zeros((2 * len(nodes),) * 2, dtype=complex)
    for i, length in enumerate(np.diff(nodes)):
        dynamic[2 * i : 2 * i + 4, 2 * i : 2 * i + 4] += hermite(HOST.bending_n_m2, HOST.mass_kg_m, length, omega)
    k = float(HOST.wavenumber_per_m(omega)[0])
    beyond = (
        HOST.bending_n_m2 * np.array([[(-1j * k**3), -(k**3)], [k**2, -(k**2)]]) @ np.linalg.inv([[1, 1], [1j * k, -k]])
    )
    mirror = np.diag([1.0, -1.0])
    dynamic[-2:, -2:] += beyond
    dynamic[:2, :2] += mirror @ beyond @ mirror
    for place in places:
        i = int(np.argmin(np.abs(nodes - place)))
        dynamic[2 * i : 2 * i + 2, 2 * i : 2 * i + 2] += standing(omega, lever)
    start = np.exp(1j * k * nodes[0]) * np.array([1.0, 1j * k])
    load = np.zeros(2 * len(nodes), dtype=complex)
    end_force = HOST.bending_n_m2 * np.exp(1j * k * nodes[0]) * np.array([-1j * k**3, k**2])
    load[:2] = end_force + mirror @ beyond @ mirror @ start
    motion = np.linalg.solve(dynamic, load)
    t = waves(motion[-2:], k, 1)[0] * np.exp(-1j * k * nodes[-1])
    r = waves(motion[:2] - start, k, -1)[0] * np.exp(1j * k * nodes[0])
    return complex(r), complex(t)


def waves(state: np.ndarray, k: float, choice: int) -> np.ndarray:
    return np.linalg.solve(np.array([[1, 1], [choice * 1j * k, -choice * k]]), state)


def hermite(bending: float, mass: float, h: float, omega: float) -> np.ndarray:
    k = np.array([[12, 6 * h, -12, 6 * h], [6 * h, 4 * h * h, -6 * h, 2 * h * h],
                  [-12, -6 * h, 12, -6 * h], [6 * h, 2 * h * h, -6 * h, 4 * h * h]]) / h**3  # fmt: skip
    m = np.array([[156, 22 * h, 54, -13 * h], [22 * h, 4 * h * h, 13 * h, -3 * h * h],
                  [54, 13 * h, 156, -22 * h], [-13 * h, -3 * h * h, -22 * h, 4 * h * h]]) * h / 420  # fmt: skip
    return bending * k - omega**2 * mass * m


def standing(omega: float, lever: float, elements: int = 24) -> np.ndarray:
    """A thin pillar's beam and rod elements condensed onto (w, theta) of its host node."""
    h = PILLAR.length_m / elements
    bend = np.zeros((2 * elements + 2,) * 2)
    rod = np.zeros((elements + 1,) * 2)
    for e in range(elements):
        bend[2 * e : 2 * e + 4, 2 * e : 2 * e + 4] += hermite(THIN.bending_n_m2, THIN.mass_kg_m, h, omega)
        rod[e : e + 2, e : e + 2] += EA / h * np.array(
            [[1, -1], [-1, 1]]
        ) - omega**2 * THIN.mass_kg_m * h / 6 * np.array([[2, 1], [1, 2]])
    foot = bend[:2, :2] - bend[:2, 2:] @ np.linalg.solve(bend[2:, 2:], bend[2:, :2])
    arm = np.array([lever, 1.0])
    return np.diag([rod[0, 0] - rod[0, 1:] @ np.linalg.solve(rod[1:, 1:], rod[1:, 0]), arm @ foot @ arm])


@pytest.mark.parametrize("lever", [0.0, 1e-3])
@pytest.mark.parametrize("places", [[0.0], [-2e-3, 2e-3], [0.0, 4e-3, 9e-3]])
def test_pillars_against_a_finite_element_frame(places, lever):
    omega = OMEGA[::4]
    result = scatter(HOST, pillar_foot(THIN, omega, EA, lever_m=lever), places, omega)
    for i, value in enumerate(omega):
        r, t = frame(float(value), places, lever=lever)
        assert result.reflection[i] == pytest.approx(r, abs=1e-3)  # rods of linear elements: (k h)^2/24 of their mass
        assert result.transmission[i] == pytest.approx(t, abs=1e-3)


@pytest.mark.parametrize("strength", [0.3, 1.0, -2.0, 5.0, -1j, 0.4 - 0.7j])
def test_point_force_closed_form(strength):
    result = scatter(HOST, spring_of(strength), [0.0], OMEGA[:1])
    t = (1 - strength) / (1 - strength + 1j * strength)
    assert result.transmission[0] == pytest.approx(t, abs=1e-12)
    assert result.reflection[0] == pytest.approx(t - 1.0, abs=1e-12)


@pytest.mark.parametrize("strength", [0.3, -1.0, -5.0, 2.0 - 1.0j])
def test_point_moment_closed_form(strength):
    feet = np.zeros((1, 2, 2), dtype=complex)
    feet[:, 1, 1] = strength * 4 * HOST.bending_n_m2 * HOST.wavenumber_per_m(OMEGA[:1])
    result = scatter(HOST, feet, [0.0], OMEGA[:1])
    t = (1 + strength) / (1 + strength + 1j * strength)
    assert result.transmission[0] == pytest.approx(t, abs=1e-12)
    assert result.reflection[0] == pytest.approx(1.0 - t, abs=1e-12)


def test_one_spring_stops_a_wave_without_losing_any_power():
    result = scatter(HOST, spring_of(1.0), [0.0], OMEGA[:1])
    assert abs(result.transmission[0]) < 1e-12 and abs(result.reflection[0]) == pytest.approx(1.0, abs=1e-12)


def test_pinned_point_halves_the_power():
    assert abs(scatter(HOST, spring_of(1e9), [0.0], OMEGA[:1]).transmission[0]) ** 2 == pytest.approx(0.5, abs=1e-8)


def test_the_theses_matched_damper_absorbs_two_fifths():
    """A damper of 4 EI beta^3/omega, the condition of (3.21), neither stops the wave nor reflects it whole."""
    result = scatter(HOST, spring_of(-1j), [0.0], OMEGA[:1])
    powers = abs(result.transmission[0]) ** 2, abs(result.reflection[0]) ** 2, result.absorbed[0]
    assert powers == pytest.approx((0.4, 0.2, 0.4), abs=1e-12)


def test_prescribed_force_of_total_reflection():
    """F = +4 i EI beta^3 W_p with e^{-i omega t}; the point itself then moves by -i W_p."""
    result = scatter(HOST, spring_of(1.0), [0.0], OMEGA[:1])
    beta = HOST.wavenumber_per_m(OMEGA[:1])[0]
    assert result.loads[0, 0, 0] == pytest.approx(4j * HOST.bending_n_m2 * beta**3, rel=1e-12)
    assert field(HOST, result, [0.0], OMEGA[:1], [0.0])[0, 0] == pytest.approx(-1j, abs=1e-12)


def test_energy_is_conserved_without_losses():
    rng = np.random.default_rng(5)
    beta = HOST.wavenumber_per_m(OMEGA)
    for count in (1, 2, 7):
        feet = rng.normal(size=(OMEGA.size, 2, 2))
        feet = feet + feet.transpose(0, 2, 1)
        size = np.stack([np.ones_like(beta), 1.0 / beta], axis=1) * 4 * HOST.bending_n_m2
        feet = (
            feet
            * size[:, :, None]
            * (np.stack([np.ones_like(beta), 1 / beta], axis=1) * beta[:, None] ** 3)[:, None, :]
        )
        places = np.sort(rng.uniform(0.0, 0.05, count))
        assert np.abs(scatter(HOST, feet, places, OMEGA).absorbed).max() < 1e-10


def test_losses_only_absorb():
    result = scatter(HOST, pillar_foot(PILLAR, OMEGA, EA, loss=0.02), [0.0, 4e-3], OMEGA)
    assert np.all(result.absorbed > 0.0) and np.all(result.absorbed < 1.0)


@pytest.mark.parametrize("count", [1, 2, 4])
def test_scattering_against_transfer_matrices(count):
    pitch = 4e-3
    feet = pillar_foot(PILLAR, OMEGA, EA, lever_m=1e-3)
    result = scatter(HOST, feet, [n * pitch for n in range(count)], OMEGA)
    for i, omega in enumerate(OMEGA):
        through = np.linalg.matrix_power(transfer_matrix(HOST, feet[i], pitch, omega), count)
        powers = (
            np.array([1j, -1j, 1.0, -1.0])[None, :] ** np.arange(4)[:, None]
        )  # incident, reflected, growing, decaying
        before = powers[:, [1, 2]]
        after = powers[:, [0, 3]]
        r, _, t, _ = np.linalg.solve(np.hstack([-(through @ before), after]), through @ powers[:, 0])
        beta = HOST.wavenumber_per_m(omega)[0]
        assert result.reflection[i] == pytest.approx(r, abs=1e-9)
        assert result.transmission[i] == pytest.approx(t * np.exp(-1j * beta * count * pitch), abs=1e-9)


def test_decay_of_an_endless_row_is_what_many_rows_show():
    omega = 2 * pi * np.array([34e3, 34.3e3, 34.6e3])
    feet, pitch = pillar_foot(PILLAR, omega, EA), 4e-3
    decay = decay_db_per_row(HOST, feet, pitch, omega)
    assert np.all(decay > 1.0)
    for i, value in enumerate(omega):
        sizes = np.abs(np.linalg.eigvals(transfer_matrix(HOST, feet[i], pitch, value)))
        assert decay[i] == pytest.approx(20 * np.log10(sizes[sizes > 1.0].min()), rel=1e-9)
    t = [np.abs(scatter(HOST, feet, [n * pitch for n in range(count)], omega).transmission) for count in (10, 40)]
    assert 20 * np.log10(t[0] / t[1]) / 30 == pytest.approx(
        decay, abs=0.4
    )  # two waves of one decay beat: +-12 dB in all
    bare = decay_db_per_row(HOST, np.zeros((3, 2, 2), dtype=complex), pitch, omega)
    assert np.abs(bare).max() < 1e-6


def test_vertical_oscillator_stops_above_and_bending_pillar_below_its_resonance():
    mass, resonance = PILLAR.mass_kg_m * PILLAR.length_m, 2 * pi * 38e3
    stopped = oscillator_total_reflection_rad_s(HOST, mass, resonance)
    foot = np.zeros((1, 2, 2), dtype=complex)  # a mass on a spring: K = -m omega^2 k/(k - m omega^2)
    foot[0, 0, 0] = -mass * stopped**2 * resonance**2 / (resonance**2 - stopped**2)
    assert abs(scatter(HOST, foot, [0.0], stopped).transmission[0]) < 1e-9
    assert stopped > 1.05 * resonance
    clamped = exact_omegas(PILLAR, "clamped", "free", 1)[0] * PILLAR.unit_rad_s
    stopped = moment_total_reflection_rad_s(HOST, lambda omega: pillar_foot(PILLAR, omega, EA), clamped)
    assert 0.83 < stopped / clamped < 0.90
    moment_only = pillar_foot(PILLAR, stopped, EA)
    moment_only[:, 0, 0] = 0.0
    assert abs(scatter(HOST, moment_only, [0.0], stopped).transmission[0]) < 1e-9


def test_rows_of_a_design_stand_on_a_strip_of_plate_half_a_thickness_up():
    host = strip_beam(DESIGN)
    assert host.bending_n_m2 == pytest.approx(70e9 * 2e-3**3 / 12 / (1 - 0.34**2) * 4e-3, rel=1e-12)
    assert host.mass_kg_m == pytest.approx(2700 * 8e-6, rel=1e-12)
    result = pillar_filter(DESIGN, OMEGA / (2 * pi), loss=0.01)
    feet = pillar_foot(PILLAR, OMEGA, EA, loss=0.01, lever_m=1e-3)
    for count in (1, 2, 3):
        expected = scatter(host, feet, [n * 4e-3 for n in range(count)], OMEGA)
        assert result.transmitted[count - 1] == pytest.approx(np.abs(expected.transmission) ** 2, rel=1e-9)
        assert result.reflected[count - 1] == pytest.approx(np.abs(expected.reflection) ** 2, rel=1e-9)
    assert (1.0 - result.transmitted - result.reflected).min() > 0.0
    lossless = pillar_filter(DESIGN, OMEGA / (2 * pi))
    assert np.abs(1.0 - lossless.transmitted - lossless.reflected).max() < 1e-10


def test_stop_band_is_where_no_bloch_wave_passes():
    fine = np.linspace(25e3, 45e3, 801)
    result = pillar_filter(DESIGN, fine)
    host, feet = strip_beam(DESIGN), pillar_foot(PILLAR, 2 * pi * fine, EA, lever_m=1e-3)
    passing = [
        np.min(np.abs(np.abs(np.linalg.eigvals(transfer_matrix(host, foot, 4e-3, 2 * pi * f))) - 1.0)) < 1e-4
        for f, foot in zip(fine, feet, strict=True)
    ]
    inside = fine[~np.array(passing)]
    assert result.stop_hz == pytest.approx((inside[0], inside[-1]), abs=2 * 25.0)
    assert pillar_filter(DESIGN, fine, loss=0.01).stop_hz == result.stop_hz
    assert len(result.bands_hz) == 3 and result.bands_hz[0] == result.band_hz
    assert result.stop_hz[0] < result.stopped_hz < result.stop_hz[1]


def test_one_point_on_an_endless_beam():
    """Figure 3.2: the spring of 4 EI beta^3 leaves its near field only; the printed force doubles the wave instead."""
    study = point_force(401)
    powers = {case.name: (case.transmitted, case.reflected, case.absorbed) for case in study.cases}
    assert powers["spring"] == pytest.approx((0.0, 1.0, 0.0), abs=1e-10)
    assert powers["pinned"] == pytest.approx((0.5, 0.5, 0.0), abs=1e-8)
    assert powers["printed damper"] == pytest.approx((0.4, 0.2, 0.4), abs=1e-10)
    assert powers["moment"] == pytest.approx((0.0, 1.0, 0.0), abs=1e-10)
    beyond = study.x_over_wavelength > 0
    spring = study.of("spring").deflection
    assert spring[beyond] == pytest.approx(-1j * np.exp(-2 * pi * study.x_over_wavelength[beyond]), abs=1e-10)
    before = 1j * 2 * np.sin(2 * pi * study.x_over_wavelength[:50])  # far from the point: a standing wave
    assert np.abs(spring[:50] - before).max() == pytest.approx(0.0, abs=1e-3)
    printed = study.of("printed force")
    assert np.abs(printed.deflection[-1]) == pytest.approx(2.0, abs=1e-3) and printed.transmitted == 4.0
    with pytest.raises(SolverError, match="2 or more"):
        point_force(1)
    with pytest.raises(SolverError, match="there are spring"):
        study.of("rope")


def test_thin_pillar_foot_closed_form():
    for omega in OMEGA:
        beta = (omega**2 * THIN.mass_kg_m / THIN.bending_n_m2) ** 0.25
        x = beta * THIN.length_m
        turned = np.sin(x) * np.cosh(x) - np.cos(x) * np.sinh(x)
        expected = -THIN.bending_n_m2 * beta * turned / (1 + np.cos(x) * np.cosh(x))
        foot = bending_foot(THIN, omega)
        assert foot[1, 1] == pytest.approx(expected, rel=1e-9)
        assert foot[0, 1] == pytest.approx(foot[1, 0], rel=1e-9)


def test_sheared_pillar_foot_has_its_exact_zeros_and_poles():
    """A foot that may turn freely feels nothing at pinned-free frequencies; a rigid one everything at clamped-free ones."""
    pinned = exact_omegas(PILLAR, "pinned", "free", 1)[0] * PILLAR.unit_rad_s
    free = exact_omegas(PILLAR, "free", "free", 1)[0] * PILLAR.unit_rad_s
    clamped = exact_omegas(PILLAR, "clamped", "free", 1)[0] * PILLAR.unit_rad_s
    scale = abs(bending_foot(PILLAR, 0.5 * clamped)[1, 1])
    assert abs(bending_foot(PILLAR, pinned)[1, 1]) < 1e-6 * scale
    assert abs(np.linalg.det(bending_foot(PILLAR, free))) < 1e-6 * abs(np.linalg.det(bending_foot(PILLAR, 0.9 * free)))
    assert bending_foot(PILLAR, clamped * (1 - 1e-6))[1, 1].real < -1e4 * scale
    assert bending_foot(PILLAR, clamped * (1 + 1e-6))[1, 1].real > 1e4 * scale


def test_rigid_pillar_at_low_frequency_is_its_mass_and_inertia():
    omega = 2 * pi * 10.0
    foot = pillar_foot(PILLAR, omega, EA, lever_m=1e-3)[0]
    mass, h = PILLAR.mass_kg_m * PILLAR.length_m, PILLAR.length_m
    inertia = mass * ((h / 2 + 1e-3) ** 2 + h**2 / 12) + PILLAR.rotary_kg_m * h
    assert foot[0, 0].real == pytest.approx(-(omega**2) * mass, rel=1e-6)
    assert foot[1, 1].real == pytest.approx(-(omega**2) * inertia, rel=1e-4)


def test_half_power_band_interpolates():
    omega = np.linspace(0.0, 4.0, 5)
    assert half_power_band(np.array([1.0, 0.75, 0.25, 0.0, 1.0]), omega) == pytest.approx((1.5, 3.5))
    assert half_power_band(np.ones(5), omega) is None


def test_strengths_are_dimensionless():
    force, _ = strengths(HOST, spring_of(0.7, OMEGA), OMEGA)
    assert force == pytest.approx(0.7)


@pytest.mark.parametrize(
    ("call", "expected"),
    [
        (lambda: scatter(HOST, spring_of(1.0), [], OMEGA[:1]), "at least one"),
        (lambda: scatter(HOST, spring_of(1.0), [0.0, 0.0], OMEGA[:1]), "all different"),
        (lambda: HOST.wavenumber_per_m(0.0), "above 0"),
        (lambda: pillar_foot(PILLAR, -1.0, EA), "above 0"),
        (lambda: pillar_filter(replace(DESIGN, pillar=None), OMEGA), "needs a pillar"),
        (lambda: pillar_filter(replace(DESIGN, pitch_x_m=float("nan")), OMEGA), "pitch"),
    ],
)
def test_refused(call, expected):
    with pytest.raises(SolverError, match=expected):
        call()
