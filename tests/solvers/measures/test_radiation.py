"""Sound of baffled faces: a piston, a simply supported plate, and the axis before a piston, against their closed forms."""

from __future__ import annotations

from math import pi

import numpy as np
import pytest
from numpy.polynomial.legendre import leggauss
from scipy.special import j1

from solvers.measures.confinement import TouchField
from solvers.measures.radiation import AUDIBLE_PA, Air, air_loss_factors, level_db, pressure_pa, radiated_w

AIR = Air(1.204, 343.2)
RHO_C = AIR.density_kg_m3 * AIR.sound_m_s


def disc(radius: float, count: int = 40) -> TouchField:
    """Gauss points of a disc, even in both axes: the quarter x, y > 0 stands for all of it."""
    nodes, weights = leggauss(count)
    r, turn = radius * (nodes + 1.0) / 2.0, pi / 4.0 * (nodes + 1.0)
    points = np.stack([np.outer(r, np.cos(turn)), np.outer(r, np.sin(turn))], -1).reshape(-1, 2)
    areas = np.outer(radius / 2.0 * weights * r, pi / 4.0 * weights).ravel()
    return TouchField(points, 4.0 * areas, np.ones((len(points), 1)), 1e-3)


def rectangle(length: float, width: float, shape: tuple[int, int], count: int = 60) -> TouchField:
    """A mode of a simply supported plate on all of its face."""
    nodes, weights = leggauss(count)
    x, y = length * nodes / 2.0, width * nodes / 2.0
    points = np.stack(np.meshgrid(x, y, indexing="ij"), -1).reshape(-1, 2)
    areas = np.outer(length / 2.0 * weights, width / 2.0 * weights).ravel()
    sides = [np.sin(n * pi * (at / size + 0.5)) for n, at, size in zip(shape, (x, y), (length, width), strict=True)]
    return TouchField(points, areas, np.outer(*sides).reshape(-1, 1), 1e-3)


@pytest.mark.parametrize("ka", [0.2, 1.0, 5.0, 20.0])
def test_a_piston_radiates_by_bessels_function(ka: float) -> None:
    """P = rho c pi a^2 (1 - J1(2ka)/(ka)) v^2 / 2."""
    radius, field = 0.02, disc(0.02)
    exact = 0.5 * RHO_C * pi * radius**2 * (1.0 - j1(2.0 * ka) / ka)
    assert radiated_w(field, "SS", field.values[:, 0], ka / radius, AIR) == pytest.approx(exact, rel=1e-6)


def test_a_short_plate_radiates_as_wallace_says() -> None:
    """(1, 1) far below its coincidence: 32 ka kb / pi^5 of rho c S v^2 / 8, with the next term of wallace1972."""
    a, b, k = 0.1, 0.08, 3.0
    field = rectangle(a, b, (1, 1))
    next_term = 1.0 - k * k * a * b / 12.0 * ((1.0 - 8.0 / pi**2) * a / b + (1.0 - 8.0 / pi**2) * b / a)
    efficiency = 32.0 * (k * a) * (k * b) / pi**5 * next_term
    exact = efficiency * RHO_C * a * b / 8.0
    assert radiated_w(field, None, field.values[:, 0], k, AIR) == pytest.approx(exact, rel=0.01)


def test_a_plate_far_above_coincidence_radiates_as_its_wave() -> None:
    """Efficiency 1 / sqrt(1 - (k_mn / k)^2) of a wave longer than that in air, edges being few wavelengths apart."""
    a, b, shape = 0.4, 0.3, (4, 3)
    own = np.hypot(shape[0] * pi / a, shape[1] * pi / b)
    k = 4.0 * own
    field = rectangle(a, b, shape, 120)
    exact = RHO_C * a * b / 8.0 / np.sqrt(1.0 - (own / k) ** 2)
    assert radiated_w(field, None, field.values[:, 0], k, AIR) == pytest.approx(exact, rel=0.01)


def test_a_quarter_and_the_whole_face_radiate_alike() -> None:
    """A mode (2, 1): u_z is odd in x and even in y."""
    whole, k = rectangle(0.1, 0.08, (2, 1)), 40.0
    kept = (whole.points > 0.0).all(axis=1)
    quarter = TouchField(whole.points[kept], 4.0 * whole.weights[kept], whole.values[kept], 1e-3)
    ours, theirs = (radiated_w(*each, k, AIR) for each in (
        (quarter, "AS", quarter.values[:, 0]), (whole, None, whole.values[:, 0])
    ))  # fmt: skip
    assert ours == pytest.approx(theirs, rel=1e-9)


def test_a_modes_loss_is_its_power_over_its_energy() -> None:
    """u = 1: P of the velocity w, E = m w^2 / 2; both faces lose twice as much."""
    field, tone = disc(0.02), 8e3
    omega = 2.0 * pi * tone
    power = radiated_w(field, "SS", omega * field.values[:, 0], AIR.wavenumber_per_m(tone), AIR)
    one, both = (air_loss_factors(field, "SS", np.array([tone]), Air(1.204, 343.2, faces))[0] for faces in (1, 2))
    assert one == pytest.approx(power / (omega * 0.5 * field.modal_mass_kg * omega**2), rel=1e-12)
    assert both == pytest.approx(2.0 * one, rel=1e-12)


def test_the_axis_before_a_piston_has_its_closed_form() -> None:
    """|p| = 2 rho c v |sin(k (sqrt(r^2 + a^2) - r) / 2)|."""
    radius, away, tone = 0.05, 0.5, 20e3
    k, field = AIR.wavenumber_per_m(tone), disc(0.05)
    speed = 2.0 * pi * tone * 1e-6
    exact = 2.0 * RHO_C * speed * abs(np.sin(k * (np.hypot(away, radius) - away) / 2.0))
    found = pressure_pa(field, 1e-6 * field.values[:, 0].astype(complex), tone, AIR, away)
    assert abs(found) == pytest.approx(exact, rel=1e-6)


def test_levels_are_those_of_the_rms() -> None:
    assert level_db(complex(np.sqrt(2.0) * AUDIBLE_PA)) == pytest.approx(0.0, abs=1e-9)
    assert level_db(1j * np.sqrt(2.0)) == pytest.approx(93.979, abs=1e-3)
