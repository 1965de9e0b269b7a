"""A solid cantilever of square section against Timoshenko's beam."""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache

import numpy as np
import pytest

from geometry.materials import Material
from solvers.analytic.beams import Beam, exact_omegas
from solvers.fem.eigen import modes_in_band
from tests.helpers import bodies
from tests.helpers.beams import square_beam

SIDE_M, YOUNG, DENSITY = 1e-3, 70e9, 2700.0


def exact_hz(of: Beam) -> np.ndarray:
    return np.array(exact_omegas(of, "clamped", "free", 3)) * of.unit_rad_s / (2.0 * np.pi)


def beam(slenderness: float, poisson: float) -> Beam:
    """Timoshenko's."""
    return square_beam(slenderness * SIDE_M, SIDE_M, YOUNG, DENSITY, poisson)


def beam_hz(slenderness: float, poisson: float) -> np.ndarray:
    """Its three lowest modes."""
    return exact_hz(beam(slenderness, poisson))


def correction(slenderness: float, poisson: float) -> np.ndarray:
    """By how much Euler and Bernoulli's beam is too stiff: Timoshenko's correction, of the order of (k h)^2."""
    stiff = beam(slenderness, poisson)
    plain = replace(stiff, shear_n=1e6 * stiff.shear_n, rotary_kg_m=1e-6 * stiff.rotary_kg_m)
    return exact_hz(plain) / beam_hz(slenderness, poisson) - 1.0


@lru_cache
def solid_hz(slenderness: float, poisson: float) -> np.ndarray:
    """The bending modes up to the third, from the quarter of the section; all motion of the clamped end is stopped."""
    length, half = slenderness * SIDE_M, SIDE_M / 2.0
    x, across = np.linspace(0.0, length, 7), np.array([0.0, 0.7 * half, half])
    for _ in range(3):
        x = np.insert(x, 1, 0.3 * x[1])
    mesh = bodies.bricks((x, across, across), 3)
    stops = [(bodies.at(mesh, 0, 0.0), [0, 1, 2]), (bodies.at(mesh, 1, 0.0), [1]), (bodies.at(mesh, 2, 0.0), [0, 1])]
    pencil = bodies.constrained(mesh, Material.isotropic("beam", YOUNG, DENSITY, poisson), stops)
    truth = beam_hz(slenderness, poisson)
    return modes_in_band(pencil, 0.2 * truth[0], 1.1 * truth[2]).frequency_hz


def check_without_poisson() -> None:
    """nu = 0: the clamp disturbs nothing, and what Timoshenko neglects is of second order in his own correction."""
    result = solid_hz(10.0, 0.0)
    assert len(result) == 3
    assert (np.abs(result / beam_hz(10.0, 0.0) - 1.0) < correction(10.0, 0.0) ** 2).all()


def check_with_poisson() -> None:
    """nu = 0.3: the clamp keeps its section from widening, which shortens the beam by a share of its side.

    The same share for every mode and length, to within the neglected terms; at most the plate's stiffening nu^2 over
    half a side at one end: 0 < delta < nu^2 h / 2, f ~ 1 / (L - delta)^2.
    """
    shares = []
    for slenderness in (10.0, 20.0):
        result = solid_hz(slenderness, 0.3)
        assert len(result) == 3
        excess = result / beam_hz(slenderness, 0.3) - 1.0
        shares.append((excess * slenderness / 2.0)[:2])
    shares = np.array(shares)
    assert (shares > 0.0).all() and (shares < 0.3**2 / 2.0).all()
    assert np.ptp(shares) < 0.1 * shares.mean()


@pytest.mark.parametrize("check", [check_without_poisson, check_with_poisson])
def test_the_solid_cantilever_is_timoshenkos_beam(check) -> None:  # type: ignore[no-untyped-def]
    check()
