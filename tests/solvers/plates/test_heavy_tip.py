"""A pillar with a heavy tip as a beam with a rigid block on its end: exact roots, the foot's poles, the foot's own modes."""

from __future__ import annotations

from dataclasses import replace
from math import pi

import numpy as np
import pytest
from scipy.optimize import brentq

from geometry.layout import Pillar, Section
from geometry.materials import MATERIALS
from solvers.analytic.beams import EndBody, exact_omegas, ritz_frequencies_hz
from solvers.analytic.plates import pillar_modes
from solvers.analytic.predesign import pillar_beam, pillar_frequencies_hz, pillar_height_m, upper_body
from solvers.errors import SolverError
from solvers.plates.strip import bending_effective_mass, lifting_effective_mass
from solvers.thesis.scattering import bending_foot, pillar_foot

PLAIN = Pillar("square", 1e-3, 1e-3, 4e-3, MATERIALS["glass"])
HEAVY = replace(PLAIN, upper=(Section.square(2e-3, 1e-3, MATERIALS["steel"]),))


@pytest.mark.parametrize("share", [0.1, 1.0, 20.0])
def test_a_point_mass_on_the_end_has_the_exact_roots(share: float) -> None:
    """1 + cos b cosh b + m b (cos b sinh b - sin b cosh b) = 0 for a clamped Euler-Bernoulli beam with the mass m rho A L."""
    beam = pillar_beam(PLAIN)
    beam = replace(beam, end=EndBody(share * beam.mass_kg_m * beam.length_m, 0.0, 0.0))

    def determinant(b: float) -> float:
        return 1.0 + np.cos(b) * np.cosh(b) + share * b * (np.cos(b) * np.sinh(b) - np.sin(b) * np.cosh(b))

    roots = np.array([brentq(determinant, *ends, xtol=1e-12) for ends in ((0.1, 1.9), (3.5, 4.8))])
    exact = roots**2 * beam.unit_rad_s / (2.0 * pi)
    assert ritz_frequencies_hz(beam, "clamped", "free", 2, rigid_shear=True) == pytest.approx(exact, rel=1e-8)


def test_a_rigid_block_on_a_stiff_stem_turns_about_its_foot() -> None:
    """A stem that is short beside the block is a spring EI/L against its turning."""
    beam = pillar_beam(PLAIN, 1e-5)
    body = upper_body(HEAVY.upper)
    stiff = beam.bending_n_m2 / beam.length_m
    about = (
        body.inertia_kg_m2 + body.mass_kg * body.arm_m**2
    )  # the block turns about the stem's end, which hardly moves
    first = ritz_frequencies_hz(replace(beam, end=body), "clamped", "free", 1, rigid_shear=True)[0]
    assert first == pytest.approx(np.sqrt(stiff / about) / (2.0 * pi), rel=3.0 * beam.length_m / body.arm_m)


@pytest.mark.parametrize("pillar", [PLAIN, HEAVY])
def test_the_foots_stiffness_has_its_poles_at_the_clamped_pillars_modes(pillar: Pillar) -> None:
    beam = pillar_beam(pillar)
    for frequency in ritz_frequencies_hz(beam, "clamped", "free", 2):
        below, above = (bending_foot(beam, 2.0 * pi * frequency * side)[1, 1].real for side in (1 - 1e-5, 1 + 1e-5))
        assert below * above < 0.0, "a pole lies between"


def test_a_slow_foot_feels_all_of_the_mass() -> None:
    foot = pillar_foot(pillar_beam(HEAVY), [1.0], HEAVY.material.as_isotropic.young_pa * 1e-6)[0]
    assert -foot[0, 0].real == pytest.approx(HEAVY.mass_kg, rel=1e-6)
    assert lifting_effective_mass(HEAVY).inertia == pytest.approx(HEAVY.mass_kg, rel=1e-12)
    turning = bending_effective_mass(HEAVY, 0.0)
    assert -foot[1, 1].real == pytest.approx(turning.inertia, rel=1e-6)
    stem, body = pillar_beam(PLAIN), upper_body(HEAVY.upper)
    exact = stem.mass_kg_m * stem.length_m**3 / 3.0 + stem.rotary_kg_m * stem.length_m
    exact += body.inertia_kg_m2 + body.mass_kg * (stem.length_m + body.arm_m) ** 2
    assert turning.inertia == pytest.approx(exact, rel=1e-12)


def test_its_own_modes_on_a_foot_at_rest_are_those_of_the_clamped_beam() -> None:
    own = bending_effective_mass(HEAVY, 0.0).omega[0] / (2.0 * pi)
    assert own == pytest.approx(ritz_frequencies_hz(pillar_beam(HEAVY), "clamped", "free", 1)[0], rel=1e-5)


def test_a_tip_lowers_the_pillar_and_height_follows() -> None:
    tones = [pillar_frequencies_hz(pillar, "timoshenko")[0] for pillar in (PLAIN, HEAVY)]
    assert tones[1] < tones[0] / 3.0
    assert pillar_height_m(HEAVY, tones[1], "timoshenko") == pytest.approx(HEAVY.height_m, rel=1e-6)
    assert pillar_modes(200e3, HEAVY) > pillar_modes(200e3, PLAIN)
    with pytest.raises(SolverError, match="carries a body"):
        exact_omegas(pillar_beam(HEAVY), "clamped", "free", 1)
