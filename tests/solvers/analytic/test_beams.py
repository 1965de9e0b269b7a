"""Euler-Bernoulli beams against finite elements, the differential equation and published numbers."""

from __future__ import annotations

from itertools import product
from math import pi

import numpy as np
import pytest

from solvers.analytic.beams import VANISHING, antinodes, beam_mode, free_free_mode, frequency_hz, roots
from solvers.errors import SolverError

PAIRS = list(product(VANISHING, VANISHING))


@pytest.mark.parametrize(("left", "right"), PAIRS)
def test_roots_against_finite_elements(left, right, hermite_omegas):
    result = hermite_omegas(left, right)
    rigid = int(np.count_nonzero(result < 1e-2))
    assert result[rigid] > 2.0
    expected = np.array(roots(left, right, 6)) ** 2
    assert result[rigid : rigid + 6] == pytest.approx(expected, rel=2e-4)  # h^4 (beta h)^4/720 for the sixth


@pytest.mark.parametrize(("left", "right"), PAIRS)
@pytest.mark.parametrize("number", [1, 2, 7, 100])
def test_modes_solve_the_equation_and_meet_both_ends(left, right, number):
    mode = beam_mode(left, right, number)
    s = np.linspace(0.0, 1.0, 1001)
    assert np.all(np.isfinite(mode.shape(s)))
    assert mode.shape(s, 4) == pytest.approx(mode.kappa**4 * mode.shape(s), abs=1e-9 * mode.kappa**4)
    for at, end in ((0.0, left), (1.0, right)):
        for n in VANISHING[end]:
            assert abs(float(mode.shape(at, n))) < 1e-8 * mode.kappa**n
    slope = np.gradient(mode.shape(s), s)[1:-1]
    step_error = (mode.kappa / 1000) ** 2 * mode.kappa  # central differences: h^2/6 phi'''
    assert slope == pytest.approx(mode.shape(s, 1)[1:-1], abs=step_error)


@pytest.mark.parametrize("ends", [("free", "free"), ("clamped", "free"), ("clamped", "sliding")])
def test_modes_are_orthonormal_up_to_the_hundredth(ends):
    s, weights = np.polynomial.legendre.leggauss(600)
    shapes = np.stack([beam_mode(*ends, n).shape((s + 1) / 2) for n in range(1, 101)])
    gram = shapes @ (weights[:, None] / 2 * shapes.T)
    assert gram == pytest.approx(np.eye(100), abs=1e-10)


@pytest.mark.parametrize("nodes", [0, 1, 2, 3, 8, 9, 60])
def test_free_free_shape_has_its_nodes_and_antinodes(nodes):
    mode = free_free_mode(nodes)
    values = mode.shape(np.linspace(0.0, 1.0, 5000))
    assert np.count_nonzero(np.diff(np.sign(values))) == nodes
    inner = antinodes(mode)
    assert len(inner) == max(nodes - 1, 0)
    assert np.all(np.abs(mode.shape(np.array(inner), 1)) < 1e-9 * (mode.kappa + 1.0))
    assert values[0] * values[-1] == pytest.approx((-1) ** nodes * values[-1] ** 2, rel=1e-9)


def test_asymptotic_wavenumber_of_the_target_shape():
    assert free_free_mode(8).kappa == pytest.approx(7.5 * pi, abs=1e-8)


def test_pillar_of_7_1_mm_is_32_6_khz_and_falls_with_the_square_of_length():
    kappa = roots("clamped", "free", 1)[0]
    short, long = (frequency_hz(kappa, length, 70e9 * 2e-3**4 / 12, 2700 * 4e-6) for length in (7.1e-3, 14.2e-3))
    assert short == pytest.approx(32_633.0, abs=1.0)
    assert short / long == pytest.approx(4.0, rel=1e-12)


def test_refused():
    with pytest.raises(SolverError, match="'hinged': must be one of"):
        roots("hinged", "free", 1)
    with pytest.raises(SolverError, match="mode number 0"):
        beam_mode("free", "free", 0)
    with pytest.raises(SolverError, match="nodal lines = -1"):
        free_free_mode(-1)
