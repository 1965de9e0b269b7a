"""Active pillars on a free-free beam against modes, finite elements, time stepping and exact limits."""

from __future__ import annotations

from dataclasses import replace
from math import inf, pi

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.optimize import newton

from geometry.materials import MATERIALS
from pipeline.active import thesis
from pipeline.active.thesis import beside
from solvers.errors import SolverError
from solvers.thesis.active_beam import (
    ActiveBeamData,
    FreeBeam,
    Layout,
    active_beam_study,
    antinodes_m,
    characteristic_loci,
    closed_loop_poles,
    confinement,
    delay_margin_s,
    delayed,
    demodulated,
    forced,
    gain_limit_n_s_m,
    growth_per_s,
    instability_gain_n_s_m,
    loop_layouts,
    strip,
)

LENGTH, OMEGA = 0.15, 2 * pi * 3000.0
LOSSLESS = strip(LENGTH, 0.02, 1e-3, MATERIALS["steel"])
BEAM = replace(LOSSLESS, viscosity_s=1.0 / (300.0 * OMEGA))
LAYOUTS = loop_layouts(0.049, 0.012, LENGTH)
PLACES = np.array([0.0, 0.012, 0.0431, 0.075, 0.15])


def hermite(beam: FreeBeam, elements: int) -> tuple[np.ndarray, np.ndarray]:
    """Stiffness and mass of cubic beam elements, both ends free."""
    h, size = beam.length_m / elements, 2 * elements + 2
    k = beam.bending_n_m2 / h**3 * np.array([[12, 6 * h, -12, 6 * h], [6 * h, 4 * h * h, -6 * h, 2 * h * h],
                  [-12, -6 * h, 12, -6 * h], [6 * h, 2 * h * h, -6 * h, 4 * h * h]])  # fmt: skip
    m = beam.mass_kg_m * h / 420 * np.array([[156, 22 * h, 54, -13 * h], [22 * h, 4 * h * h, 13 * h, -3 * h * h],
                  [54, 13 * h, 156, -22 * h], [-13 * h, -3 * h * h, -22 * h, 4 * h * h]])  # fmt: skip
    stiffness, mass = np.zeros((size, size)), np.zeros((size, size))
    for e in range(elements):
        span = slice(2 * e, 2 * e + 4)
        stiffness[span, span] += k
        mass[span, span] += m
    return stiffness, mass


def modal_receptance(beam: FreeBeam, x_m, source_m, s: complex, modes: int) -> np.ndarray:
    """Sum of phi(x) phi(source)/(rho A L (s^2 + omega^2 (1 + s theta))) over the first `modes` shapes."""
    denominator = s**2 + beam.natural_rad_s(modes) ** 2 * (1.0 + beam.viscosity_s * s)
    return (beam.shapes(x_m, modes) / (beam.mass_kg_m * beam.length_m * denominator)) @ beam.shapes(source_m, modes).T


def refined_pole(layout: Layout, damper_n_s_m: float, start: complex) -> complex:
    """The pole near `start` of the whole beam: det(I + c s C G(s) B) = 0, G exact."""
    spread, pick, points = layout.spread, layout.pick, layout.points_m

    def characteristic(s: complex) -> complex:
        law = damper_n_s_m * s * pick @ BEAM.receptance(points, points, s)
        return complex(np.linalg.det(np.eye(len(law)) + law @ spread))

    return complex(newton(characteristic, start, x1=start * (1.0 + 1e-4), tol=1e-9 * abs(start), maxiter=80))


@pytest.mark.parametrize("s", [1j * OMEGA, 2j * pi * 5000.0, -300.0 + 1j * OMEGA, 2000.0 + 9000.0j, 1500.0 + 0.0j])
def test_waves_and_modes_agree_to_the_truncated_tail(s):
    """Left out: sum over m >= N of 4/(rho A L |s^2 + omega_m^2 (1 + s theta)|), no shape exceeding 2."""
    modes = 60
    exact = BEAM.receptance(PLACES, PLACES, s)
    kappas = (2 * np.arange(modes, 100 * modes) - 3) * pi / 2  # of the modes left out
    square = kappas**4 * BEAM.bending_n_m2 / BEAM.mass_kg_m / LENGTH**4
    tail = 4.0 * np.sum(1.0 / np.abs(s**2 + square * (1.0 + BEAM.viscosity_s * s))) / (BEAM.mass_kg_m * LENGTH)
    off = np.abs(modal_receptance(BEAM, PLACES, PLACES, s, modes) - exact).max()
    assert 1e-9 * np.abs(exact).max() < off < tail < 1e-3 * np.abs(exact).max()
    assert exact == pytest.approx(exact.T, rel=1e-10)


def test_waves_over_many_frequencies_are_those_of_each():
    s = 1j * OMEGA * np.array([[0.1, 1.0], [2.0, 40.0]])
    many = BEAM.receptance(PLACES, PLACES[:2], s)
    assert many.shape == (2, 2, 5, 2)
    for index in np.ndindex(2, 2):
        assert many[index] == pytest.approx(BEAM.receptance(PLACES, PLACES[:2], s[index]), rel=1e-12)


def test_waves_against_finite_elements_at_their_order():
    """Cubic elements: errors at the nodes fall with h^4 at least."""
    nodes = np.array([0, 2, 10, 15]) / 30 * LENGTH
    exact = BEAM.receptance(nodes, nodes[1], 1j * OMEGA)[:, 0]
    errors = []
    for elements in (30, 60, 120):
        stiffness, mass = hermite(BEAM, elements)
        load = np.zeros(len(mass))
        at = 2 * np.round(nodes / LENGTH * elements).astype(int)
        load[at[1]] = 1.0
        result = np.linalg.solve(stiffness * (1 + 1j * OMEGA * BEAM.viscosity_s) - OMEGA**2 * mass, load)[at]
        errors.append(np.abs(result - exact).max() / np.abs(exact).max())
    assert errors[-1] < 1e-4
    assert np.all(np.log2(np.array(errors[:-1]) / errors[1:]) > 3.8)


def test_far_from_its_ends_a_lossy_beam_is_endless():
    lossy = FreeBeam(3.0, BEAM.bending_n_m2, BEAM.mass_kg_m, 0.2 / OMEGA)
    beta = complex(lossy.wavenumber_per_m(OMEGA)) * (1 + 0.2j) ** -0.25
    stiff = 4 * lossy.bending_n_m2 * (1 + 0.2j) * beta**3
    d = np.linspace(0.0, 0.2, 9)
    expected = (-1j * np.exp(-1j * beta * d) - np.exp(-beta * d)) / stiff
    assert lossy.receptance(1.5 + d, 1.5, 1j * OMEGA)[:, 0] == pytest.approx(expected, rel=1e-3)


@pytest.mark.parametrize("layout", LAYOUTS, ids=lambda layout: layout.name)
def test_closed_loop_against_finite_elements_with_dampers(layout):
    gain, elements = 3e6, 300  # every place is a node: half millimetres
    stiffness, mass = hermite(BEAM, elements)
    damping = BEAM.viscosity_s * stiffness
    dofs = 2 * np.round(layout.points_m / LENGTH * elements).astype(int)
    damping[np.ix_(dofs, dofs)] += gain / OMEGA * layout.spread @ layout.pick
    load = np.zeros(len(mass))
    load[elements] = 1.0
    motion = np.linalg.solve(stiffness + 1j * OMEGA * damping - OMEGA**2 * mass, load)
    result = forced(BEAM, layout, gain, OMEGA, np.linspace(0.0, LENGTH, elements + 1), LENGTH / 2)
    assert result.deflection == pytest.approx(motion[::2], rel=1e-5, abs=1e-5 * np.abs(motion).max())
    pulled = -1j * gain * layout.spread @ layout.pick @ motion[dofs]
    assert result.forces == pytest.approx(pulled, rel=1e-4, abs=1e-4 * np.abs(pulled).max())


@pytest.mark.parametrize("layout", LAYOUTS[:3], ids=lambda layout: layout.name)
def test_closed_loop_against_time_stepping(layout):
    """Modes under cos(omega t) with f = -c C w' integrated to the steady state."""
    beam, gain, modes = replace(BEAM, viscosity_s=0.05 / OMEGA), 2e6, 9
    shapes, middle = beam.shapes(layout.points_m, modes), beam.shapes(LENGTH / 2, modes)[0]
    square, mass = beam.natural_rad_s(modes) ** 2, beam.mass_kg_m * LENGTH
    feedback = gain / OMEGA * shapes.T @ layout.spread @ layout.pick @ shapes / mass

    def rate(time, state):
        q, speed = state[:modes], state[modes:]
        pushed = middle * np.cos(OMEGA * time) / mass - feedback @ speed
        return np.concatenate([speed, pushed - square * (q + beam.viscosity_s * speed)])

    period = 2 * pi / OMEGA
    times = (240 + np.arange(40) / 40) * period
    path = solve_ivp(rate, (0.0, times[-1]), np.zeros(2 * modes), "DOP853", times, rtol=1e-8, atol=1e-14).y[:modes]
    phasor = 2 * np.mean(shapes @ path * np.exp(-1j * OMEGA * times), axis=1)

    class Truncated(FreeBeam):
        def receptance(self, x_m, source_m, s):
            return modal_receptance(self, x_m, source_m, s, modes)

    same = Truncated(beam.length_m, beam.bending_n_m2, beam.mass_kg_m, beam.viscosity_s)
    points = layout.points_m
    if layout.name == "couple":  # nothing holds its rigid-body modes: take their drift out
        phasor, points = phasor - phasor.mean(), points
    result = forced(same, layout, gain, OMEGA, points, LENGTH / 2).deflection
    result = result - result.mean() if layout.name == "couple" else result
    assert phasor == pytest.approx(result, abs=2e-3 * np.abs(result).max())


def powers_w(layout: Layout, gain: complex) -> tuple[float, float, float]:
    """Mean power given by 1 N peak in the lossless beam's middle, that taken by the loops, and the size of the reactive one."""
    result = forced(LOSSLESS, layout, gain, OMEGA, np.append(layout.points_m, LENGTH / 2), LENGTH / 2)
    power = 0.5 * np.real(np.append(-result.forces, 1.0) * np.conj(1j * OMEGA * result.deflection))
    return power[-1], power[:-1].sum(), 0.5 * OMEGA * abs(result.deflection[-1])


@pytest.mark.parametrize("layout", LAYOUTS, ids=lambda layout: layout.name)
@pytest.mark.parametrize("gain", [1e5, 1e7, 1e9])
def test_power_of_the_excitation_is_what_the_loops_take(layout, gain):
    given, taken, scale = powers_w(layout, gain)
    assert given == pytest.approx(taken, abs=1e-10 * scale)
    if layout.dual:
        assert taken > 0.0


def test_open_lossless_beam_takes_no_power():
    given, _, scale = powers_w(LAYOUTS[0], 0.0)
    assert abs(given) < 1e-10 * scale


def test_endless_gain_pins_the_points():
    """K' -> infinity: the beam on supports, by finite elements; the loops carry their reactions."""
    elements = 150
    stiffness, mass = hermite(BEAM, elements)
    dynamic = stiffness * (1 + 1j * OMEGA * BEAM.viscosity_s) - OMEGA**2 * mass
    for layout in LAYOUTS[:2]:
        clamped = 2 * np.round(layout.points_m / LENGTH * elements).astype(int)
        kept = np.setdiff1d(np.arange(len(mass)), clamped)
        load = (kept == elements).astype(float)
        motion = np.zeros(len(mass), dtype=complex)
        motion[kept] = np.linalg.solve(dynamic[np.ix_(kept, kept)], load)
        reactions = (dynamic @ motion)[clamped]
        result = forced(BEAM, layout, 1e13, OMEGA, np.linspace(0.0, LENGTH, elements + 1), LENGTH / 2)
        assert result.deflection == pytest.approx(motion[::2], abs=1e-4 * np.abs(motion[::2]).max())
        assert result.forces == pytest.approx(reactions, rel=1e-4)


def test_a_late_answer_turns_the_force_back():
    """f(t) = -c w'(t - delay), hence F = -j K' e^{-j omega delay} W; a quarter period late it is a spring of -K'."""
    late = 1e5 * np.exp(-1j * pi / 2)
    result = forced(BEAM, LAYOUTS[0], late, OMEGA, LAYOUTS[0].points_m, LENGTH / 2)
    assert result.forces == pytest.approx(-1e5 * result.deflection, rel=1e-9)
    given, _, scale = powers_w(LAYOUTS[0], late)
    assert abs(given) < 1e-10 * scale


def test_law_in_its_two_components():
    """F_d = K' W_q and F_q = -K' W_d, against the velocity: power is taken out."""
    result = forced(BEAM, LAYOUTS[0], 1e6, OMEGA, LAYOUTS[0].points_m, LENGTH / 2)
    assert result.forces.real == pytest.approx(1e6 * result.deflection.imag, rel=1e-9)
    assert result.forces.imag == pytest.approx(-1e6 * result.deflection.real, rel=1e-9)
    assert result.forces == pytest.approx(-1e6 / OMEGA * 1j * OMEGA * result.deflection, rel=1e-9)


@pytest.mark.parametrize("layout", LAYOUTS[:3], ids=lambda layout: layout.name)
@pytest.mark.parametrize("damper", [1.0, 300.0, 5000.0])
def test_dual_loops_never_make_a_pole_grow(layout, damper):
    assert growth_per_s(BEAM, layout, damper) < 0.0
    assert growth_per_s(LOSSLESS, layout, damper) < 1e-6


def test_opposed_loops_grow_beyond_the_losses():
    limit = instability_gain_n_s_m(BEAM, LAYOUTS[3], 1e4)
    assert growth_per_s(BEAM, LAYOUTS[3], 1.02 * limit) > 0.0 > growth_per_s(BEAM, LAYOUTS[3], 0.98 * limit)
    loci = characteristic_loci(BEAM, LAYOUTS[3], 1e5)
    assert gain_limit_n_s_m(loci, delayed(0.0))[0] == pytest.approx(limit, rel=1e-3)
    assert instability_gain_n_s_m(BEAM, LAYOUTS[0], 1e4) == inf


def elastic(poles: np.ndarray) -> np.ndarray:
    """Oscillating poles above the real axis, slower than a tenth of the first elastic mode left out."""
    return poles[poles.imag > 0.1 * BEAM.natural_rad_s(3)[2]]


@pytest.mark.parametrize("layout", LAYOUTS, ids=lambda layout: layout.name)
def test_poles_of_modes_are_near_those_of_the_whole_beam(layout):
    poles = elastic(closed_loop_poles(BEAM, layout, 50.0))
    for pole in poles[np.argsort(np.abs(poles))][:4]:
        exact = refined_pole(layout, 50.0, complex(pole))
        assert abs(exact - pole) < 1e-3 * abs(pole)
        law = 50.0 * exact * layout.pick @ BEAM.receptance(layout.points_m, layout.points_m, exact)
        assert abs(np.linalg.det(np.eye(len(law)) + law @ layout.spread)) < 1e-5


def test_poles_without_loops_are_the_beams_own():
    poles = closed_loop_poles(BEAM, LAYOUTS[0], 0.0, 12)
    square = BEAM.natural_rad_s(12)[2:] ** 2
    half = BEAM.viscosity_s * square / 2
    expected = -half + 1j * np.sqrt(square - half**2)
    result = elastic(poles)
    assert result[np.argsort(result.imag)] == pytest.approx(expected, rel=1e-6)


def delayed_growth(layout: Layout, damper: float, delay: float, modes: int = 40, nodes: int = 24) -> float:
    """Largest real part of q'' + ... = -c P'BCP q'(t - delay): eigenvalues of the collocated infinitesimal generator."""
    shapes, square = BEAM.shapes(layout.points_m, modes), BEAM.natural_rad_s(modes) ** 2
    mass = BEAM.mass_kg_m * LENGTH
    feedback = damper / mass * shapes.T @ layout.spread @ layout.pick @ shapes
    zero, unit = np.zeros((modes, modes)), np.eye(modes)
    now = np.block([[zero, unit], [-np.diag(square), -np.diag(BEAM.viscosity_s * square)]])
    then = np.block([[zero, zero], [zero, -feedback]])
    t = np.cos(pi * np.arange(nodes + 1) / nodes)
    c = np.ones(nodes + 1)
    c[[0, -1]] = 2.0
    c *= (-1.0) ** np.arange(nodes + 1)
    d = np.outer(c, 1 / c) / (t[:, None] - t[None, :] + np.eye(nodes + 1))
    d -= np.diag(d.sum(axis=1))
    generator = np.kron(d * 2 / delay, np.eye(2 * modes))
    generator[: 2 * modes] = 0.0
    generator[: 2 * modes, : 2 * modes] = now
    generator[: 2 * modes, -2 * modes :] = then
    result = np.linalg.eigvals(generator)
    return float(result[np.abs(result) > 100.0].real.max())


@pytest.mark.parametrize(("layout", "delay"), [(LAYOUTS[0], 1e-4), (LAYOUTS[1], 1e-4), (LAYOUTS[2], 6e-5)])
def test_limits_of_delay_and_gain_against_the_delay_equations_poles(layout, delay):
    loci = characteristic_loci(BEAM, layout, 3e5)
    limit, hz = gain_limit_n_s_m(loci, delayed(delay))
    assert 0.0 < hz < 2e4
    below, above = (delayed_growth(layout, share * limit, delay, 14, 10) for share in (0.95, 1.05))
    assert below < 0.0 < above
    margin = delay_margin_s(loci, limit)
    assert margin < 1.001 * delay  # a shorter delay may do harm that a longer one does not
    before, after = (delayed_growth(layout, limit, share * margin, 14, 10) for share in (0.97, 1.03))
    assert before < 0.0 < after


def test_demodulating_loop_is_its_filter():
    """Mean of 2 w e^{-j carrier t} over a window, put back on the carrier: its answer at another frequency by quadrature."""
    carrier, window, delay, gain = OMEGA, 1.4 / 3000.0, 3e-5, 2.0
    for omega in (0.2 * carrier, 0.9 * carrier, carrier, 2.3 * carrier):
        grid = np.linspace(0.0, 40 * pi / omega, 1601)[:-1]
        fine = (np.arange(1000) + 0.5) / 1000 * window
        past = grid[:, None] - delay - fine[None, :]
        amplitude = np.mean(2 * np.cos(omega * past) * np.exp(-1j * carrier * past), axis=1)
        force = np.real(-1j * gain * amplitude * np.exp(1j * carrier * grid))
        result = 2 * np.mean(force * np.exp(-1j * omega * grid))
        law = -gain / carrier * 1j * omega * demodulated(carrier, window, delay)(np.array([omega]))[0]
        assert result == pytest.approx(law, abs=2e-3 * gain)


def test_loop_that_never_falls_below_one_is_refused():
    with pytest.raises(SolverError, match="widen"):
        delay_margin_s(characteristic_loci(BEAM, LAYOUTS[0], 2e4), 1e4)


def test_antinodes_are_where_the_slope_turns():
    x = np.linspace(0.0, LENGTH, 3001)
    size = np.abs(BEAM.receptance(x, LENGTH / 2, 1j * OMEGA)[:, 0])
    for place in antinodes_m(BEAM, LENGTH / 2, OMEGA):
        near = np.abs(x - place) < 1e-3
        assert size[near].max() == pytest.approx(np.interp(place, x, size), rel=1e-5)


def test_confinement_counts_inside_and_beyond():
    result = confinement(np.linspace(0, 1, 11), np.array([1, 1, 1, 4, 4j, 4, -4, 4, 1, 1, 1.0]), (0.25, 0.75))
    assert (result.inside_max, result.outside_max, result.ratio) == pytest.approx((4.0, 1.0, 4.0))
    with pytest.raises(SolverError, match="must hold some"):
        confinement(np.linspace(0, 1, 11), np.ones(11), (-1.0, 2.0))


@pytest.fixture(scope="module")
def study():
    return active_beam_study()


@pytest.mark.slow
def test_study_has_every_layout_at_every_frequency_and_gain(study):
    assert {case.layout for case in study.cases} == {"point", "pair", "couple", "opposed"}
    assert len(study.cases) == 4 * 2 * 2
    for case in study.cases:
        stiffness = 4 * BEAM.bending_n_m2 * BEAM.wavenumber_per_m(2 * pi * case.frequency_hz) ** 3
        assert case.strength == pytest.approx(case.gain_n_m / stiffness, rel=1e-9)
    assert study.to_dict()["point_stiffness_n_m"][0] == pytest.approx(BEAM.point_stiffness_n_m(OMEGA))
    assert all(entry["agreement"] for entry in beside("beam", thesis.beam(study)))


@pytest.mark.slow
def test_study_holds_what_its_parts_give(study):
    case = study.case("point", 3000.0, 1e8)
    layout = loop_layouts(study.left_m, 0.012, LENGTH)[0]
    result = forced(BEAM, layout, 1e8, OMEGA, study.x_m, LENGTH / 2)
    assert case.after.ratio == confinement(study.x_m, result.deflection, layout.region_m).ratio
    assert case.largest_force_n == np.abs(result.forces).max() and case.outside_reduced_by > 1.0
    opened = np.abs(BEAM.receptance(layout.points_m, LENGTH / 2, 1j * OMEGA)).max()
    assert case.switch_on_force_n == pytest.approx(1e8 * opened, rel=1e-9)
    unstable = {one.layout: max(one.growth_per_s) > 0.0 for one in study.stability}
    assert unstable == {"point": False, "pair": False, "couple": False, "opposed": True}
    assert study.left_m in antinodes_m(BEAM, LENGTH / 2, OMEGA)


@pytest.mark.slow
def test_force_scales_the_answer_not_its_shape(study):
    few = ActiveBeamData(frequencies_hz=(3000.0,), gains_n_m=(1e7,), delays_s=(), force_n=2.0)
    one, two = study.case("pair", 3000.0, 1e7), active_beam_study(few).case("pair", 3000.0, 1e7)
    assert two.largest_force_n == pytest.approx(2 * one.largest_force_n) and two.after.ratio == pytest.approx(
        one.after.ratio
    )
    assert two.after.inside_max == pytest.approx(2 * one.after.inside_max)


@pytest.mark.parametrize(
    ("call", "expected"),
    [
        (lambda: active_beam_study(ActiveBeamData(gains_n_m=(0.0,))), "0 leaves the loops open"),
        (lambda: active_beam_study(ActiveBeamData(gains_n_m=())), "above 0"),
        (lambda: active_beam_study(ActiveBeamData(frequencies_hz=(0.0,))), "above 0"),
        (lambda: active_beam_study(ActiveBeamData(frequencies_hz=(3e3, -1.0))), "above 0"),
        (lambda: active_beam_study(ActiveBeamData(quality_factor=0.0)), "above 0"),
        (lambda: active_beam_study(ActiveBeamData(delays_s=(-1e-6,))), "0 or more"),
        (lambda: active_beam_study(ActiveBeamData(apart_m=0.08)), "no antinode"),
        (lambda: forced(BEAM, LAYOUTS[0], 1e6, 0.0, PLACES, 0.075), "above 0"),
        (lambda: forced(BEAM, LAYOUTS[0], inf, OMEGA, PLACES, 0.075), "must be finite"),
        (lambda: BEAM.receptance(0.2, 0.075, 1j * OMEGA), "lie on the beam"),
        (lambda: BEAM.receptance(0.1, 0.075, 0.0), "other than 0"),
        (lambda: FreeBeam(0.0, 1.0, 1.0), "above 0"),
        (lambda: LOSSLESS.receptance(0.1, 0.075, 1j * LOSSLESS.natural_rad_s(3)[2]), "lossless resonance"),
    ],
)
def test_refused(call, expected):
    with pytest.raises(SolverError, match=expected):
        call()


def test_lossless_resonance_is_refused_by_the_study():
    exact = float(LOSSLESS.natural_rad_s(7)[6]) / (2 * pi)
    with pytest.raises(SolverError, match="lossless resonance"):
        active_beam_study(ActiveBeamData(frequencies_hz=(exact,), quality_factor=inf, left_m=0.049))
