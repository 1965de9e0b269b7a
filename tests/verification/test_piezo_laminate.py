"""Laminated piezo beams: the published unimorph, a beam-element model with one electrode, and limits in closed form."""

from __future__ import annotations

from dataclasses import replace
from math import pi, sqrt

import numpy as np
import pytest
import scipy.linalg

from geometry.materials import MATERIALS, PIEZO_MATERIALS
from solvers.errors import SolverError
from tests.helpers.piezo_beam import (
    Section,
    cantilever_hz,
    elastic_layer,
    free_even_hz,
    gain_per_volt,
    laminate,
    piezo_layer,
)
from tests.helpers.unimorph import CERAMIC, CERAMIC_M, D31, LENGTH_M, METAL_M, STEEL_LIKE, WIDTH_M, YOUNG_PA, published


@pytest.mark.parametrize(
    ("number", "is_open", "printed"), [(1, False, 47.8), (2, False, 299.6), (1, True, 48.8), (2, True, 301.5)]
)
def test_the_published_unimorph_to_its_printed_digits(number: int, is_open: bool, printed: float) -> None:
    assert cantilever_hz(published(stretch=False), LENGTH_M, number, is_open) == pytest.approx(printed, abs=0.06)


def test_a_voltage_that_may_stretch_the_beam_holds_its_curvature_less() -> None:
    whole, axis_clamped = published(stretch=True), published(stretch=False)
    assert whole.capacitance_f_m > axis_clamped.capacitance_f_m
    assert cantilever_hz(whole, LENGTH_M, 1, True) < cantilever_hz(axis_clamped, LENGTH_M, 1, True)
    assert cantilever_hz(whole, LENGTH_M, 1, False) == cantilever_hz(axis_clamped, LENGTH_M, 1, False)


def test_the_section_is_the_transformed_one() -> None:
    """Neutral axis by moduli, EI about it, tau = -e b times the distance to the ceramic's middle."""
    middle = np.array([METAL_M / 2, METAL_M + CERAMIC_M / 2])
    stiff = np.array([100e9 * METAL_M, YOUNG_PA * CERAMIC_M]) * WIDTH_M
    axis = stiff @ middle / stiff.sum()
    own = np.array([METAL_M, CERAMIC_M]) ** 2 / 12.0
    section = published(stretch=True)
    assert section.bending_n_m2 == pytest.approx(stiff @ (own + (middle - axis) ** 2), rel=1e-12)
    assert section.mass_kg_m == pytest.approx(WIDTH_M * (7165.0 * METAL_M + 7800.0 * CERAMIC_M), rel=1e-12)
    # V > 0 is a field along -z, which lengthens a ceramic with d31 < 0: it lies above the axis, so w'' < 0
    assert section.moment_n_m_v == pytest.approx(YOUNG_PA * D31 * WIDTH_M * (middle[1] - axis), rel=1e-12)


def elements(section: Section, count: int, clamped: bool, is_open: bool) -> np.ndarray:
    """Frequencies of Hermitian beam elements with one electrode over all of them."""
    step, size = LENGTH_M / count, 2 * (count + 1)
    bend = section.bending_n_m2 / step**3 * np.array(
        [[12, 6 * step, -12, 6 * step], [6 * step, 4 * step**2, -6 * step, 2 * step**2],
         [-12, -6 * step, 12, -6 * step], [6 * step, 2 * step**2, -6 * step, 4 * step**2]]
    )  # fmt: skip
    heavy = section.mass_kg_m * step / 420.0 * np.array(
        [[156, 22 * step, 54, -13 * step], [22 * step, 4 * step**2, 13 * step, -3 * step**2],
         [54, 13 * step, 156, -22 * step], [-13 * step, -3 * step**2, -22 * step, 4 * step**2]]
    )  # fmt: skip
    stiffness, mass = np.zeros((size, size)), np.zeros((size, size))
    for first in range(0, size - 2, 2):
        stiffness[first : first + 4, first : first + 4] += bend
        mass[first : first + 4, first : first + 4] += heavy
    if is_open:
        turn = np.zeros(size)
        turn[1], turn[-1] = -1.0, 1.0
        share = section.moment_n_m_v**2 / (section.capacitance_f_m * LENGTH_M)
        stiffness += share * np.outer(turn, turn)
    kept = slice(2, None) if clamped else slice(None)
    values = scipy.linalg.eigh(stiffness[kept, kept], mass[kept, kept], eigvals_only=True)
    return np.sqrt(np.maximum(values, 0.0)) / (2.0 * pi)


@pytest.mark.parametrize("is_open", [False, True])
@pytest.mark.parametrize("number", [1, 2, 3])
def test_beam_elements_with_one_electrode_give_the_same(number: int, is_open: bool) -> None:
    """Cubic elements converge from above as (k/n)^4/1440."""
    section = published(stretch=True)
    clamped = elements(section, 40, True, is_open)[number - 1]
    loose = elements(section, 40, False, is_open)[2:][2 * (number - 1)]
    assert cantilever_hz(section, LENGTH_M, number, is_open) == pytest.approx(clamped, rel=2e-6 * number**4)
    assert free_even_hz(section, LENGTH_M, number, is_open) == pytest.approx(loose, rel=4e-6 * (number + 0.5) ** 4)


def test_the_gain_is_the_slope_that_the_voltage_pushes() -> None:
    section = published(stretch=True)
    kappa = 4.730040744862704
    hz = free_even_hz(section, LENGTH_M, 1, False)
    assert hz == pytest.approx(kappa**2 / (2 * pi * LENGTH_M**2) * sqrt(section.bending_n_m2 / section.mass_kg_m))
    # mean square 1, tips at 2, slope at the tip 2 kappa (sin - sinh ...) about 9.29 for this mode
    x = np.linspace(0.0, 1.0, 20_001)
    ratio = (np.cosh(kappa) - np.cos(kappa)) / (np.sinh(kappa) - np.sin(kappa))
    shape = np.cosh(kappa * x) + np.cos(kappa * x) - ratio * (np.sinh(kappa * x) + np.sin(kappa * x))
    turn = np.gradient(shape, x, edge_order=2)
    expected = section.moment_n_m_v * (turn[-1] - turn[0]) / LENGTH_M / sqrt(section.mass_kg_m * LENGTH_M)
    assert shape[0] > 0.0
    assert gain_per_volt(section, LENGTH_M, 1) == pytest.approx(expected, rel=1e-5)


def test_without_piezo_effect_open_is_short_and_without_piezo_layer_there_is_no_answer() -> None:
    plain = replace(CERAMIC, d31=1e-18)
    layers = [elastic_layer(STEEL_LIKE, 0.0, METAL_M), piezo_layer(plain, METAL_M, METAL_M + CERAMIC_M)]
    section = laminate(layers, WIDTH_M)
    pair = [cantilever_hz(section, LENGTH_M, 1, is_open) for is_open in (False, True)]
    assert pair[1] == pytest.approx(pair[0], rel=1e-9)
    with pytest.raises(SolverError, match="no layer is piezoelectric"):
        laminate(layers[:1], WIDTH_M)


def test_a_bimorph_of_equal_layers_does_not_stretch() -> None:
    """Poled alike under one voltage they only stretch: no moment; a symmetric stack keeps its axis."""
    pzt, brass = PIEZO_MATERIALS["pzt-5h"], MATERIALS["steel"]
    alike = laminate(
        [piezo_layer(pzt, -0.4e-3, -0.1e-3), elastic_layer(brass, -0.1e-3, 0.1e-3), piezo_layer(pzt, 0.1e-3, 0.4e-3)],
        WIDTH_M,
    )
    assert abs(alike.moment_n_m_v) < 1e-12 * WIDTH_M
