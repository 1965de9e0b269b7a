"""Timoshenko beams: exact roots against Rayleigh-Ritz, closed forms and the thin limit."""

from __future__ import annotations

from itertools import product
from math import pi, sqrt

import numpy as np
import pytest

from geometry.materials import MATERIALS
from solvers.analytic.beams import VANISHING, Beam, beam_of, exact_omegas, ritz_frequencies_hz, roots
from solvers.errors import SolverError
from tests.helpers.beams import round_beam, square_beam

PAIRS = list(product(VANISHING, VANISHING))
ALUMINIUM = (70e9, 2700.0, 0.34)


def exact_hz(beam: Beam, left: str, right: str, count: int) -> np.ndarray:
    return np.array(exact_omegas(beam, left, right, count)) * beam.unit_rad_s / (2 * pi)


@pytest.mark.parametrize(("left", "right"), PAIRS)
@pytest.mark.parametrize("slenderness", [1.0, 3.15, 50.0, 1e5])
def test_exact_against_ritz(left, right, slenderness):
    """Slenderness 1 puts most of the ten modes above the cut-off, where two families interleave; 1e5 costs no digits."""
    beam = square_beam(slenderness * 2e-3, 2e-3, *ALUMINIUM)
    exact, ritz = exact_hz(beam, left, right, 10), ritz_frequencies_hz(beam, left, right, 10)
    assert ritz == pytest.approx(exact, rel=1e-9)
    assert np.all(np.diff(exact) > 0.0)


def test_pinned_beam_has_both_families_and_pure_shear():
    """Between pins w = sin(n pi s): both roots of the dispersion relation, and one uniform thickness-shear motion."""
    beam = square_beam(3e-3, 2e-3, *ALUMINIUM)
    e, r = beam.flexibility, beam.rotation
    expected = [1.0 / sqrt(e * r)]
    for n in range(1, 12):
        k2 = (n * pi) ** 2
        expected += [sqrt(root) for root in np.roots([e * r, -((e + r) * k2 + 1.0), k2**2])]
    expected = np.sort(expected)[:8] * beam.unit_rad_s / (2 * pi)
    assert exact_hz(beam, "pinned", "pinned", 8) == pytest.approx(expected, rel=1e-9)


@pytest.mark.parametrize(("left", "right"), PAIRS)
def test_thin_limit_is_euler_bernoulli(left, right):
    beam = square_beam(1.0, 1e-4, *ALUMINIUM)
    expected = np.array(roots(left, right, 4)) ** 2 * beam.unit_rad_s / (2 * pi)
    assert exact_hz(beam, left, right, 4) == pytest.approx(expected, rel=1e-6)


def test_a_hundred_modes_of_a_slender_beam_are_found_one_by_one():
    result = exact_hz(square_beam(0.2, 2e-4, *ALUMINIUM), "free", "free", 100)
    assert len(result) == 100 and np.all(np.diff(result) > 0.0)
    assert np.all(
        result < np.array(roots("free", "free", 100)) ** 2 * square_beam(0.2, 2e-4, *ALUMINIUM).unit_rad_s / (2 * pi)
    )


def test_shear_softens_the_printed_pillars():
    """Beam theory with shear and rotation falls 1 to 2 % short of a solid whose foot face is clamped: 39.1, 36.9, 31.2 kHz."""
    for height, solid in ((6.3e-3, 39_115.0), (6.5e-3, 36_882.0), (7.1e-3, 31_205.0)):
        result = exact_hz(square_beam(height, 2e-3, *ALUMINIUM), "clamped", "free", 1)[0]
        assert 0.98 * solid < result < solid


def test_round_section_by_its_own_inertia():
    beam = round_beam(1.0, 2e-3, *ALUMINIUM)
    assert beam.bending_n_m2 == pytest.approx(70e9 * pi * 1e-12 / 4)
    assert beam.mass_kg_m == pytest.approx(2700 * pi * 1e-6)


def test_tapered_beam_against_finite_elements(hermite_omegas):
    ratio = lambda s: 1.0 - 0.5 * s  # noqa: E731
    slender = square_beam(1.0, 1e-2, *ALUMINIUM)
    tapered = Beam(1.0, slender.bending_n_m2, slender.shear_n, slender.mass_kg_m, slender.rotary_kg_m, ratio)
    result = ritz_frequencies_hz(tapered, "clamped", "free", 3, rigid_shear=True)
    expected = hermite_omegas("clamped", "free", 200, ratio)[:3] * slender.unit_rad_s / (2 * pi)
    assert result == pytest.approx(expected, rel=2e-4)  # stepped sections: h^2
    assert np.all(ritz_frequencies_hz(tapered, "clamped", "free", 3) < result)


def test_taper_is_not_ignored_by_the_exact_route():
    with pytest.raises(SolverError, match="tapered"):
        exact_omegas(Beam(1.0, 1.0, 1.0, 1.0, 1.0, lambda s: 1.0 - s), "clamped", "free", 1)


@pytest.mark.parametrize(
    "sizes", [(0.0, 4e-6, 1e-12), (1e-2, -1.0, 1e-12), (1e-2, 4e-6, 0.0), (float("nan"), 4e-6, 1e-12)]
)
def test_refused(sizes):
    with pytest.raises(SolverError, match="must be a finite number above 0"):
        exact_omegas(beam_of(*sizes, 5.0 / 6.0, MATERIALS["aluminium"]), "clamped", "free", 1)
