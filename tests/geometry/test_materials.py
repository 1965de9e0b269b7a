"""Elastic laws: what is derived of them, what they are symmetric about, and what only an isotropic one answers."""

from __future__ import annotations

from math import sqrt

import numpy as np
import pytest

from geometry.errors import GeometryError
from geometry.hex.boxes import Boxes, hex_mesh
from geometry.layout import Design, Pillar, Tip
from geometry.materials import MATERIALS, Material
from solvers.accuracy.singularity import clamped_edge_exponent
from solvers.analytic.plates import lamb_hz
from solvers.fem.assembly import Scale, assemble
from solvers.fem.eigen import modes_near
from solvers.fem.solid import constrain, free_mask
from tests.helpers.laws import SPRUCE, orthotropic

WOOD, STEEL = orthotropic(**SPRUCE), MATERIALS["steel"]
E, NU = 210e9, 0.30
G = E / (2.0 * (1.0 + NU))


def sheared(places: tuple[int, int]) -> Material:
    """Steel with a stiffness that ties two strains."""
    c = np.array(STEEL.stiffness_pa)
    c[places] = c[places[::-1]] = 1e9
    return Material("tied", STEEL.density_kg_m3, tuple(map(tuple, c.tolist())))


def test_an_isotropic_law_has_the_textbooks_stiffnesses() -> None:
    plane = E / (1.0 - NU**2) * np.array([[1.0, NU, 0.0], [NU, 1.0, 0.0], [0.0, 0.0, (1.0 - NU) / 2.0]])
    assert STEEL.plane_stress_pa == pytest.approx(plane, rel=1e-12, abs=1.0)
    assert STEEL.transverse_shear_pa == pytest.approx((G, G), rel=1e-12)
    assert all(STEEL.rod(axis) == pytest.approx((E, NU, G), rel=1e-12) for axis in range(3))
    assert STEEL.shear_m_s == pytest.approx(sqrt(G / 7850.0)) and STEEL.mirrors == ("x", "y", "d")
    assert pytest.approx(STEEL.pressure_m_s**2) == (2.0 * NU * G / (1.0 - 2.0 * NU) + 2.0 * G) / 7850.0


def test_voigts_average_of_an_isotropic_law_is_the_law() -> None:
    unnamed = Material("same", STEEL.density_kg_m3, STEEL.stiffness_pa)
    assert (unnamed.average.young_pa, unnamed.average.poisson) == pytest.approx((E, NU), rel=1e-12)


def test_an_orthotropic_law_gives_back_its_nine_constants() -> None:
    for axis, young in enumerate(SPRUCE["young"]):
        assert WOOD.rod(axis).young_pa == pytest.approx(young, rel=1e-12)
    assert WOOD.rod(0).poisson == pytest.approx((0.37 + 0.42) / 2.0)
    assert WOOD.shear_m_s == pytest.approx(sqrt(0.06e9 / 450.0))
    assert WOOD.rod(2).shear_pa == pytest.approx(2.0 / (1.0 / 0.06e9 + 1.0 / 0.7e9))
    assert [WOOD.tensor_pa[i, j, i, j] for i, j in ((1, 2), (0, 2), (0, 1))] == pytest.approx(SPRUCE["shear"])
    assert WOOD.tensor_pa[0, 0, 2, 2] == WOOD.stiffness_pa[0][2]
    assert WOOD.transverse_shear_pa == pytest.approx((0.7e9, 0.06e9))
    across = 0.37 * 0.9 / 11.0  # nu_yx
    assert WOOD.plane_stress_pa[:2, :2] == pytest.approx(
        np.array([[11e9, 0.37 * 0.9e9], [0.37 * 0.9e9, 0.9e9]]) / (1.0 - 0.37 * across), rel=1e-12
    )
    assert WOOD.plane_stress_pa[2, 2] == pytest.approx(0.75e9)


@pytest.mark.parametrize(
    ("law", "kept"),
    [
        (WOOD, ("x", "y")),
        (sheared((0, 5)), ()),  # xx with xy
        (sheared((0, 3)), ("x",)),  # xx with yz
        (sheared((0, 4)), ("y",)),  # xx with xz
        (sheared((2, 5)), ("d",)),  # zz with xy
    ],
)
def test_mirrors_are_what_a_law_keeps(law: Material, kept: tuple[str, ...]) -> None:
    assert law.mirrors == kept


@pytest.mark.parametrize("place", ["plate", "pillar", "tip"])
def test_a_design_is_as_symmetric_as_its_materials(place: str) -> None:
    def design(law: Material) -> Design:
        laws = dict.fromkeys(("plate", "pillar", "tip"), STEEL) | {place: law}
        pillar = Pillar("square", 2e-3, 2e-3, 6e-3, laws["pillar"], tip=Tip(3e-3, 1e-3, laws["tip"]))
        return Design(0.1, 0.02, 2e-3, 8, laws["plate"], pillar, 4e-3, 4e-3, 2, 5e-3)

    assert design(STEEL).cell_mirrors == ("x", "y", "d") and design(STEEL).is_mirrored
    assert design(WOOD).cell_mirrors == ("x", "y") and design(WOOD).is_mirrored
    assert design(sheared((0, 3))).cell_mirrors == ("x",) and not design(sheared((0, 3))).is_mirrored


@pytest.mark.parametrize("axis", [0, 1])
def test_a_bar_of_an_orthotropic_law_stretches_as_its_rod_does(axis: int) -> None:
    """A thin bar that slides between its ends' planes: f = sqrt(E/rho)/(2 l), lowered by (nu k)^2 I_p/(2 A)."""
    length, side, ends = 0.1, 1e-3, "xy"[axis]
    size = [length if each == axis else side for each in range(3)]
    lines = [np.linspace(0.0, extent, 5 if extent == length else 2) for extent in size]
    mesh = hex_mesh(Boxes(*lines, np.zeros([len(line) - 1 for line in lines], dtype=np.int64), ("body",)), 4)
    other = "yx"[axis]
    held = free_mask(mesh, [(f"{ends}-", ends), (f"{other}-", other), ("touch", "z"), (f"{ends}+", ends)])
    pencil = constrain(assemble(mesh, {"body": WOOD}), held)
    exact = sqrt(SPRUCE["young"][axis] / WOOD.density_kg_m3) / (2.0 * length)
    found = modes_near(pencil, exact, 1).frequency_hz[0]
    assert found == pytest.approx(exact, rel=1e-3)


def test_what_holds_for_isotropic_laws_alone_refuses_any_other() -> None:
    for theory in (lambda: lamb_hz(100.0, 2e-3, WOOD, False), lambda: clamped_edge_exponent(WOOD)):
        with pytest.raises(GeometryError, match="material wood: must be isotropic"):
            theory()


def test_a_law_that_stores_no_energy_is_refused() -> None:
    c = np.array(STEEL.stiffness_pa)
    with pytest.raises(GeometryError, match="energy of any strain, must be above 0"):
        Material("void", 1.0, tuple(map(tuple, (c - 2.0 * np.diag(np.diag(c))).tolist())))


def test_a_scaled_law_keeps_its_form() -> None:
    double = STEEL.scaled(2.0)
    assert double.as_isotropic.young_pa == 2.0 * E and double.as_isotropic.poisson == NU
    assert Material.isotropic("steel", 2.0 * E, 7850.0, NU).tensor_pa == pytest.approx(double.tensor_pa)
    assert Scale.of(1.0, double) == Scale(1.0, 2.0 * E, 7850.0)
