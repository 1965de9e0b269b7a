"""The strip across the plate: its pillars against the exact foot stiffness, its plate against the exact free beam."""

from __future__ import annotations

from dataclasses import replace
from math import log10, pi, sqrt

import numpy as np
import pytest

from geometry.layout import Design, Pillar
from geometry.materials import MATERIALS
from solvers.analytic.plates import mindlin_wave_hz, thin_plate_hz
from solvers.analytic.predesign import pillar_beam, strip_of
from solvers.measures.confinement import Profile, measure_profile
from solvers.plates import strip as strip_model
from solvers.plates.strip import PER_WIDTH, bending_effective_mass, lifting_effective_mass, strip_modes, strip_zones
from solvers.thesis.pillar_row import pillar_foot

ALUMINIUM = MATERIALS["aluminium"]
PILLAR = Pillar("square", 2e-3, 2e-3, 6.3e-3, ALUMINIUM)
DESIGN = Design(115.5e-3, 20e-3, 2e-3, 8, ALUMINIUM, PILLAR, 4e-3, 4e-3, 3, 25e-3)


@pytest.mark.parametrize("lever_m", [0.0, 1e-3])
@pytest.mark.parametrize("shape", ["square", "round"])
def test_a_standing_pillar_pulls_as_the_exact_beam_does(lever_m: float, shape: str) -> None:
    """K = -w^2 (J + sum L^2 w^2 / (w_j^2 - w^2)) against the exact waves; what two modes leave out is of order w^2/w_3^2."""
    pillar = replace(PILLAR, shape=shape)
    stretch = ALUMINIUM.as_isotropic.young_pa * pillar.form.section.area_m2
    for hertz in (5e3, 25e3, 36e3, 45e3):
        omega = 2.0 * pi * hertz
        exact = pillar_foot(pillar_beam(pillar), omega, stretch, 0.0, lever_m)[0].real
        for effective, value in (
            (bending_effective_mass(pillar, lever_m), exact[1, 1]),
            (lifting_effective_mass(pillar), exact[0, 0]),
        ):
            own = (effective.coupling**2 * omega**2 / (effective.omega**2 - omega**2)).sum()
            assert -(omega**2) * (effective.inertia + own) == pytest.approx(value, rel=3e-3)


def test_a_tapered_pillar_carries_less_and_rings_higher() -> None:
    tapered = Pillar("tapered", 2e-3, 1e-3, 6.3e-3, ALUMINIUM)
    heavy, light = bending_effective_mass(PILLAR, 1e-3), bending_effective_mass(tapered, 1e-3)
    assert light.inertia < heavy.inertia and light.omega[0] > heavy.omega[0]
    volume = 6.3e-3 * (2e-3**2 + 2e-3 * 1e-3 + 1e-3**2) / 3.0
    assert lifting_effective_mass(tapered).inertia == pytest.approx(ALUMINIUM.density_kg_m3 * volume, rel=1e-12)


def test_a_bare_strip_rigid_along_x_is_a_free_beam() -> None:
    """Without rows and with k = 0 the even modes are those of a free-free beam, from above by (beta h)^4/1440 or less."""
    bare = replace(DESIGN, pillar=None, rows=0, extension_m=10e-3, nodal_lines=0)
    strip = strip_of(bare)
    assert strip
    span, element = 2.0 * bare.half_span_m, bare.width_m / PER_WIDTH
    shear = mindlin_wave_hz(strip, pi / bare.width_m) / thin_plate_hz(strip, pi / bare.width_m)
    betas = [kappa / span for kappa in (4.730040745, 10.995607838)]
    exact = [shear * thin_plate_hz(strip, beta) for beta in betas]
    result = strip_modes(bare, 0.5 * exact[0], 1.2 * exact[1]).frequency_hz
    assert len(result) == 2
    for beta, tone, target in zip(betas, result, exact, strict=True):
        assert -1e-7 < tone / target - 1.0 < 1.2 * (beta * element) ** 4 / 1440.0


def test_rows_hold_the_target_mode_better_the_more_there_are() -> None:
    levels = []
    for rows in (1, 2, 3):
        result = strip_modes(replace(DESIGN, rows=rows), 25e3, 45e3)
        levels.append(result.confinement.confinement_db[result.confinement.target.index])
    assert levels[0] < levels[1] < levels[2]


def test_rows_add_what_their_pillars_carry() -> None:
    """Y = 1 with the pillars rigid: 2 T = rho h y + n (m + k^2 J) a row, n pillars per length, J about the plate's middle."""
    kx, rows = 200.0, 2
    design = replace(DESIGN, rows=rows)
    nodes, strip = strip_model._nodes(design), strip_of(design)
    assert strip
    stiffness, mass = strip_model._with_rows(*strip_model._plate(nodes, strip, kx, 1.0), nodes, design, kx, 0.5)
    lift = np.zeros(len(mass))
    lift[0 : 2 * len(nodes) : 2] = 1.0
    weight, height = ALUMINIUM.density_kg_m3 * 4e-6 * 6.3e-3, 6.3e-3
    inertia = weight * (((1e-3 + height) ** 3 - 1e-3**3) / (3.0 * height) + 2e-3**2 / 12.0)
    effective = rows * 29 / design.length_m * (weight + kx**2 * inertia)
    assert lift @ mass @ lift == pytest.approx(2700.0 * 2e-3 * design.half_span_m + effective, rel=1e-12)
    assert lift @ stiffness @ lift == pytest.approx(
        kx**4 * strip.stack.bending_n_m[0, 0] * design.half_span_m, rel=1e-9
    )  # rigid pillars store nothing


def test_measures_of_a_known_profile() -> None:
    """Y = cos(pi y / W) inside; half its rms between the rows, a tenth beyond them; a MAC of 1 whatever the phase."""
    ends, levels = (0.0, 10e-3, 20e-3, 45e-3), (None, 0.5, 0.1)
    design = replace(DESIGN, rows=3, extension_m=25e-3)
    assert design.half_span_m == pytest.approx(ends[-1])
    y, weights, value = [], [], []
    for low, high, level in zip(ends[:-1], ends[1:], levels, strict=True):
        middle = low + (np.arange(2000) + 0.5) * (high - low) / 2000.0
        y.append(middle)
        weights.append(np.full(2000, (high - low) / 2000.0))
        inside = np.cos(pi * middle / design.width_m)
        value.append(inside if level is None else np.full(2000, level / sqrt(2.0)))
    places = np.concatenate(y)
    shape = np.cos(pi * places / design.width_m)
    result = measure_profile(
        Profile(places, np.concatenate(weights), 1j * np.concatenate(value)[:, None], shape, 1.0), design
    )
    passive = (0.5**2 * 10.0 + 0.1**2 * 25.0) / 35.0
    assert result.confinement_db[0] == pytest.approx(-10.0 * log10(passive), abs=1e-4)
    assert result.extension_db[0] == pytest.approx(20.0, abs=1e-4)
    assert result.mac[0] == pytest.approx(1.0, abs=1e-9)
    assert result.zone_share[0] == pytest.approx(10.0 / (10.0 + 35.0 * passive), rel=1e-5)


def test_the_whole_strip_of_three_zones_moves_as_half_a_strip_of_the_same_rows() -> None:
    """About its middle zone the plate of three is one of one zone with two rows as far apart as a zone and a foot: the same
    even modes; nodes on the outer zones' borders refine it by (beta h)^4/1440 or less.
    """
    three = replace(DESIGN, zones=3, shared_rows=1, zone_gap_m=2e-3, rows=1, extension_m=5e-3)
    one = replace(three, zones=1, shared_rows=0, zone_gap_m=0.0, rows=2, pitch_y_m=22e-3)
    assert one.half_span_m == pytest.approx(three.half_span_m)
    assert one.row_centres() == pytest.approx(three.row_places()[2:])
    half = strip_modes(one, 20e3, 45e3).frequency_hz
    whole, profile = strip_model._solved(three, (20e3, 45e3), 0.5)
    turned = np.abs(profile.values / profile.values[::-1] - 1.0).max(axis=0) < 1e-3
    assert len(half) > 4 and whole[turned] == pytest.approx(half, rel=(pi / PER_WIDTH) ** 4 / 1440.0)


def test_zones_of_a_strip_do_to_each_other_what_is_done_to_them() -> None:
    """Two zones, the plate its own mirror image; more rows between them let less pass."""
    near, far = (
        strip_zones(replace(DESIGN, zones=2, shared_rows=rows, zone_gap_m=gap), 30e3, 38e3, 300.0)
        for rows, gap in ((1, 2e-3), (3, 10e-3))
    )
    for driven in (near, far):
        assert driven.level_db[0] == pytest.approx(driven.level_db[1][[1, 0, 2]], abs=1e-6)
        assert driven.peak_hz[0] == pytest.approx(driven.peak_hz[1], rel=1e-9)
    assert 0.0 < near.isolation_db < far.isolation_db
