"""Waves of plates of several layers and laws against collocation and against the closed forms of one layer."""

from __future__ import annotations

import numpy as np
import pytest

from geometry.materials import MATERIALS, Layer, Stack
from solvers.analytic.layered import layered_waves_hz
from solvers.analytic.plates import lamb_hz
from tests.helpers.laws import SPRUCE, orthotropic
from tests.helpers.layered_plate import collocated_waves_hz

GLASS, ADHESIVE, STEEL = MATERIALS["glass"], MATERIALS["optically-clear-adhesive"], MATERIALS["steel"]
WOOD = orthotropic(**SPRUCE)
STACKS = {
    "display": Stack((Layer(GLASS, 0.7e-3), Layer(ADHESIVE, 0.2e-3), Layer(GLASS, 1.1e-3))),
    "bimetal": Stack((Layer(STEEL, 1e-3), Layer(MATERIALS["aluminium"], 2e-3))),
    "wood": Stack((Layer(WOOD, 3e-3),)),
    "veneer": Stack((Layer(WOOD, 1e-3), Layer(STEEL, 0.5e-3), Layer(MATERIALS["silicon"], 1e-3))),
}


@pytest.mark.parametrize("symmetric", [False, True])
def test_one_isotropic_layer_has_lambs_waves(symmetric: bool) -> None:
    wave = lamb_hz(800.0, 2e-3, STEEL, symmetric)
    found = layered_waves_hz(Stack.of(2e-3, STEEL), 640.0, 480.0, 3)
    assert np.abs(found / wave - 1.0).min() < 1e-9


@pytest.mark.parametrize("name", STACKS)
@pytest.mark.parametrize("direction", [0.0, 30.0, 90.0])
def test_waves_are_those_of_collocation(name: str, direction: float) -> None:
    angle = np.deg2rad(direction)
    wave = 600.0 * np.cos(angle), 600.0 * np.sin(angle)
    found, exact = layered_waves_hz(STACKS[name], *wave, 5), collocated_waves_hz(STACKS[name], *wave)[:5]
    moduli = [layer.material.average.shear_pa for layer in STACKS[name].layers]
    rounding = (
        2e-16 * 20.0**4 * max(moduli) / min(moduli)
    )  # of collocation with 20 points, whose slopes go as their square
    np.testing.assert_allclose(found, exact, rtol=1e-8 + rounding)


def test_turning_axes_and_direction_together_changes_nothing() -> None:
    silicon, turned = (MATERIALS["silicon"].turned((angle, 0.0, 0.0)) for angle in (0.0, 25.0))
    angle = np.deg2rad(25.0)
    one = layered_waves_hz(Stack.of(1e-3, silicon), 700.0, 0.0, 6)
    other = layered_waves_hz(Stack.of(1e-3, turned), 700.0 * np.cos(angle), 700.0 * np.sin(angle), 6)
    np.testing.assert_allclose(one, other, rtol=1e-10)


def test_a_soft_core_holds_the_faces_together_in_long_waves_and_lets_them_bend_alone_in_short_ones() -> None:
    """From the laminate's sqrt(D/m) k^2 to that of the two faces side by side, D_1 + D_2, the shear left out."""
    display = STACKS["display"]
    together = np.sqrt(display.bending_n_m[0, 0] / display.mass_kg_m2) / (2.0 * np.pi)
    sheared = [1.0 - layered_waves_hz(display, wave, 0.0, 1)[0] / (wave**2 * together) for wave in (0.5, 1.0)]
    assert 0.0 < sheared[1] < 0.01 and sheared[1] / sheared[0] == pytest.approx(4.0, rel=0.02)
    middle = 300.0  # short, and below the shear resonance of the core alone
    faces = Stack.of(0.7e-3, GLASS), Stack.of(1.1e-3, GLASS)
    alone = middle**2 * np.sqrt(sum(each.bending_n_m[0, 0] for each in faces) / display.mass_kg_m2) / (2.0 * np.pi)
    both = middle**2 * np.sqrt(display.bending_n_m[0, 0] / display.mass_kg_m2) / (2.0 * np.pi)
    found = layered_waves_hz(display, middle, 0.0, 1)[0]
    assert 0.95 * alone < found < 1.2 * alone and found < 0.6 * both


LONG = {
    "display": STACKS["display"],
    "bimetal": STACKS["bimetal"],
    "coated": Stack((Layer(STEEL, 3e-6), Layer(MATERIALS["pmma"], 3e-3))),
    "glued": Stack((Layer(STEEL, 1e-3), Layer(MATERIALS["pmma"], 1e-3), Layer(MATERIALS["brass"], 1e-3))),
}


@pytest.mark.parametrize("thicknesses", [1e5, 1e6])
@pytest.mark.parametrize("name", LONG)
def test_long_waves_are_those_of_the_laminate(name: str, thicknesses: float) -> None:
    """k^2 sqrt(D / m) with D of a laminate free to stretch along the wave: no digit drowns in the layers' stiffness.

    Shear lowers them by a share that goes as k^2: of the softest, 2.5e-6 at 1e5 thicknesses.
    """
    stack, stretch, coupled, bent, z = LONG[name], 0.0, 0.0, 0.0, 0.0
    for material, thickness in stack.layers:
        stiff, top = material.as_isotropic.young_pa / (1.0 - material.as_isotropic.poisson**2), z + thickness
        stretch, coupled = stretch + stiff * thickness, coupled + stiff * (top**2 - z**2) / 2.0
        bent, z = bent + stiff * (top**3 - z**3) / 3.0, top
    wave = 2.0 * np.pi / (thicknesses * stack.thickness_m)
    laminate = wave**2 * np.sqrt((bent - coupled**2 / stretch) / stack.mass_kg_m2) / (2.0 * np.pi)
    for angle in (0.0, 0.7):
        found = layered_waves_hz(stack, wave * np.cos(angle), wave * np.sin(angle), 1)[0]
        assert -1e-9 < 1.0 - found / laminate < 2.5e4 / thicknesses**2 + 1e-9


def test_the_first_shear_resonance_is_that_of_waves_through_the_plate() -> None:
    one = Stack.of(2e-3, STEEL)
    assert one.shear_cutoff_hz == STEEL.shear_m_s / 4e-3
    cut = Stack((Layer(STEEL, 0.5e-3), Layer(STEEL, 1.5e-3)))
    assert cut.shear_cutoff_hz == pytest.approx(one.shear_cutoff_hz, rel=1e-5)  # (h / wavelength)^4 of its elements
    display = STACKS["display"]
    slow = collocated_waves_hz(display, 1e-3, 0.0)
    assert display.shear_cutoff_hz == pytest.approx(slow[slow > 1e3][0], rel=1e-5)
