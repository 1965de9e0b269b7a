"""Exponents at edges against closed forms and published values, and the share of a mesh's error that follows from them."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise
from math import atan, pi, sqrt, tan

import numpy as np
import pytest
from scipy.optimize import brentq

from geometry.materials import MATERIALS, Material
from solvers.accuracy.singularity import (
    CLAMPED,
    FREE,
    Wedge,
    antiplane_exponent,
    clamped_edge_exponent,
    edge_exponent,
    rim_error,
    rim_wedges,
)


def material(young: float, poisson: float) -> Material:
    return Material.isotropic("any", young, 1000.0, poisson)


STEEL = material(210e9, 0.3)


def free_wedge(angle: float) -> float:
    """Williams' equation of a free wedge, the root below 1: sin(a w) = -a sin w, of the symmetric motion."""
    return float(brentq(lambda a: np.sin(a * angle) + a * np.sin(angle), 0.4, 0.9, xtol=1e-14))


@pytest.mark.parametrize("degrees", [225.0, 270.0, 330.0])
def test_a_free_wedge_has_the_root_of_williams_equation(degrees: float) -> None:
    angle = np.radians(degrees)
    assert edge_exponent((Wedge(STEEL, angle),)) == pytest.approx(free_wedge(angle), abs=1e-10)


def test_a_crack_goes_as_the_square_root_and_a_half_space_is_regular() -> None:
    assert edge_exponent((Wedge(STEEL, 2.0 * pi - 1e-9),)) == pytest.approx(0.5, abs=1e-6)
    assert edge_exponent((Wedge(STEEL, pi - 1e-9),)) == 1.0


@pytest.mark.parametrize("poisson", [0.1, 0.3, 0.45])
def test_a_clamped_quarter_has_the_root_of_its_closed_form(poisson: float) -> None:
    kappa = 3.0 - 4.0 * poisson

    def condition(a: float) -> float:  # sin^2(a w) = ((kappa + 1)^2 - 4 a^2 sin^2 w) / 4 kappa
        return float(np.sin(a * pi / 2.0) ** 2 - ((kappa + 1.0) ** 2 - 4.0 * a**2) / (4.0 * kappa))

    exponent = brentq(condition, 0.5, 0.98, xtol=1e-14)
    assert clamped_edge_exponent(material(1e9, poisson)) == pytest.approx(exponent, abs=1e-10)


def test_two_wedges_of_one_material_are_one_wedge() -> None:
    halves = (Wedge(STEEL, 0.4 * pi), Wedge(STEEL, 1.1 * pi))
    assert edge_exponent(halves) == pytest.approx(edge_exponent((Wedge(STEEL, 1.5 * pi),)), abs=1e-10)


@pytest.mark.parametrize("ratio", [0.01, 1.0, 30.0])
def test_displacements_along_a_foots_rim_have_their_closed_form(ratio: float) -> None:
    """Bonded wedges of pi and pi / 2, free outside: G1 tan(a pi) + G2 tan(a pi / 2) = 0, tan(a pi / 2)^2 = 1 + 2 G1 / G2."""
    plate, pillar = material(1e9, 0.3), material(ratio * 1e9, 0.3)
    exact = 2.0 / pi * atan(sqrt(1.0 + 2.0 / ratio))
    assert tan(exact * pi / 2.0) ** 2 == pytest.approx(1.0 + 2.0 / ratio)
    assert antiplane_exponent(rim_wedges(plate, pillar)) == pytest.approx(exact, abs=1e-9)


def unnamed(law: Material) -> Material:
    """The law without its two constants, as any other law is treated."""
    return replace(law, constants=None)


@pytest.mark.parametrize("ratio", [0.1, 1.0, 3.0])
def test_a_law_without_constants_has_the_exponents_of_its_isotropic_twin(ratio: float) -> None:
    pair = material(70e9, 0.34), material(ratio * 70e9, 0.25)
    own, twin = (edge_exponent(rim_wedges(*each)) for each in (map(unnamed, pair), pair))
    assert own == pytest.approx(twin, abs=1e-6)
    assert clamped_edge_exponent(unnamed(pair[1])) == pytest.approx(clamped_edge_exponent(pair[1]), abs=1e-6)


def test_a_crack_goes_as_the_square_root_in_any_law() -> None:
    turned = MATERIALS["silicon"].turned((20.0, 30.0, 40.0))
    assert edge_exponent((Wedge(turned, 2.0 * pi - 1e-9),)) == pytest.approx(0.5, abs=1e-5)
    assert edge_exponent((Wedge(turned, pi - 1e-9),)) == 1.0


@pytest.mark.slow
def test_a_crack_along_a_bond_goes_as_the_square_root_times_an_oscillation() -> None:
    """Of any two laws: a = 1/2 + i epsilon (and two wedges of one law are one wedge)."""
    turned = MATERIALS["silicon"].turned((20.0, 30.0, 40.0))
    assert edge_exponent((Wedge(turned, pi), Wedge(material(3e9, 0.37), pi - 1e-9))) == pytest.approx(0.5, abs=1e-4)
    halves = (Wedge(turned, 0.4 * pi), Wedge(turned, 1.1 * pi))
    assert edge_exponent(halves) == pytest.approx(edge_exponent((Wedge(turned, 1.5 * pi),)), abs=1e-5)


def test_a_rigid_pillar_is_a_punch_and_a_soft_one_a_clamped_quarter() -> None:
    plate, rigid, soft = material(1e9, 0.3), material(1e15, 0.3), material(1e3, 0.3)
    punch = edge_exponent((Wedge(plate, pi),), (FREE, CLAMPED))  # a mixed half-space: the real part is 1/2
    assert punch == pytest.approx(0.5, abs=1e-9)
    assert edge_exponent(rim_wedges(plate, rigid)) == pytest.approx(punch, abs=1e-5)
    assert edge_exponent(rim_wedges(plate, soft)) == pytest.approx(clamped_edge_exponent(soft), abs=1e-5)


def test_layers_leave_the_power_of_their_factor() -> None:
    exponent, factor = (
        0.5445,
        0.5,
    )  # coarse layers: what the outer elements leave counts for nothing beside the innermost
    errors = [rim_error(exponent, 8, factor, layers) for layers in range(4)]
    for coarse, fine in pairwise(errors):
        assert fine / coarse == pytest.approx(factor ** (2.0 * exponent), rel=1e-3)


def test_the_error_of_an_order_falls_as_babuska_and_suri_say() -> None:
    """The p-version at a singular point converges as p^(-4a) in the energy (babuska1987)."""
    low, high = rim_error(0.6, 8, 0.2, 0), rim_error(0.6, 16, 0.2, 0)
    assert np.log2(low / high) == pytest.approx(4.0 * 0.6, rel=0.05)


@pytest.mark.parametrize(("factor", "layers"), [(0.0, 1), (1.0, 1), (0.2, -1)])
def test_layers_that_are_none_are_refused(factor: float, layers: int) -> None:
    with pytest.raises(ValueError, match="must be"):
        rim_error(0.6, 3, factor, layers)
