"""Elastic laws: what is derived of them, what they are symmetric about, and what only an isotropic one answers."""

from __future__ import annotations

from dataclasses import replace
from math import sqrt

import numpy as np
import pytest

from geometry.errors import GeometryError
from geometry.hex.boxes import Boxes, hex_mesh
from geometry.layout import Design, Pillar, Section
from geometry.materials import MATERIALS, Material
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


@pytest.mark.parametrize("place", ["plate", "pillar", "section2"])
def test_a_design_is_as_symmetric_as_its_materials(place: str) -> None:
    def design(law: Material) -> Design:
        laws = dict.fromkeys(("plate", "pillar", "section2"), STEEL) | {place: law}
        pillar = Pillar(
            "square", 2e-3, 2e-3, 6e-3, laws["pillar"], upper=(Section.square(3e-3, 1e-3, laws["section2"]),)
        )
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
    with pytest.raises(GeometryError, match="material wood: must be isotropic"):
        lamb_hz(100.0, 2e-3, WOOD, False)


def test_a_law_that_stores_no_energy_is_refused() -> None:
    c = np.array(STEEL.stiffness_pa)
    with pytest.raises(GeometryError, match="energy of any strain, must be above 0"):
        Material("void", 1.0, tuple(map(tuple, (c - 2.0 * np.diag(np.diag(c))).tolist())))


def test_a_scaled_law_keeps_its_form() -> None:
    double = STEEL.scaled(2.0)
    assert double.as_isotropic.young_pa == 2.0 * E and double.as_isotropic.poisson == NU
    assert Material.isotropic("steel", 2.0 * E, 7850.0, NU).tensor_pa == pytest.approx(double.tensor_pa)
    assert Scale.of(1.0, double) == Scale(1.0, 2.0 * E, 7850.0)


SILICON = MATERIALS["silicon"]
QUARTZ_GPA = [  # alpha quartz at constant field, trigonal: C14 ties xx and yy with yz, xz with xy
    [86.8, 7.0, 11.9, -18.0, 0.0, 0.0],
    [7.0, 86.8, 11.9, 18.0, 0.0, 0.0],
    [11.9, 11.9, 105.8, 0.0, 0.0, 0.0],
    [-18.0, 18.0, 0.0, 58.2, 0.0, 0.0],
    [0.0, 0.0, 0.0, 0.0, 58.2, -18.0],
    [0.0, 0.0, 0.0, 0.0, -18.0, 39.9],
]


def test_silicon_has_the_published_moduli_along_its_directions() -> None:
    """hopcroft2010: E 130 GPa along <100>, 169 along <110>, 188 along <111>; nu 0.28 and, in (100), 0.064 along <110>."""
    assert SILICON.rod(0).young_pa == pytest.approx(130e9, rel=2e-3)
    along = SILICON.turned((45.0, 0.0, 0.0))
    assert along.rod(0).young_pa == pytest.approx(169e9, rel=2e-3) and along.mirrors == ("x", "y", "d")
    s = np.linalg.inv(np.array(along.stiffness_pa))
    assert -s[0, 1] / s[0, 0] == pytest.approx(0.064, abs=3e-3) and -s[0, 2] / s[0, 0] == pytest.approx(0.36, abs=5e-3)
    diagonal = SILICON.turned((0.0, np.degrees(np.arccos(1.0 / np.sqrt(3.0))), 45.0))  # its z along a body diagonal
    assert diagonal.rod(2).young_pa == pytest.approx(188e9, rel=2e-3)


@pytest.mark.parametrize("axes", [(30.0, 0.0, 0.0), (0.0, 40.0, 0.0), (0.0, 0.0, 70.0), (15.0, -50.0, 200.0)])
def test_a_turned_law_has_its_own_energy_of_turned_strains(axes: tuple[float, float, float]) -> None:
    """e:C':e of any strain is that of the strain in the law's axes, R'e R; the order of the turns is Bunge's."""
    phi, theta, psi = np.deg2rad(axes)

    def z(angle: float) -> np.ndarray:
        return np.array([[np.cos(angle), -np.sin(angle), 0], [np.sin(angle), np.cos(angle), 0], [0, 0, 1]])

    x = np.array([[1, 0, 0], [0, np.cos(theta), -np.sin(theta)], [0, np.sin(theta), np.cos(theta)]])
    turn = z(phi) @ x @ z(psi)
    law, rng = Material.anisotropic("quartz", 1e9 * np.array(QUARTZ_GPA), 2649.0, ""), np.random.default_rng(5)
    turned = law.turned(axes)
    for _ in range(5):
        strain = rng.normal(size=(3, 3))
        strain = strain + strain.T
        own = turn.T @ strain @ turn
        energy, expected = (np.einsum("ij,ijkl,kl", e, m.tensor_pa, e) for e, m in ((strain, turned), (own, law)))
        assert energy == pytest.approx(expected, rel=1e-12)


def test_turns_by_right_angles_leave_a_cubic_law_alone_and_an_isotropic_one_any() -> None:
    assert SILICON.turned((90.0, 180.0, -90.0)).stiffness_pa == SILICON.stiffness_pa
    assert STEEL.turned((12.0, 34.0, 56.0)) is STEEL
    assert SILICON.turned((30.0, 0.0, 0.0)).mirrors == ()


@pytest.mark.parametrize(
    ("law", "words"),
    [
        ({"cubic_GPa": {"C11": 10.0, "C12": 10.0, "C44": 5.0}}, "cubic_GPa: C44 must be above 0, C12 between"),
        ({"cubic_GPa": {"C11": 10.0, "C12": -5.0, "C44": 5.0}}, "cubic_GPa: C44 must be above 0, C12 between"),
        ({"C_GPa": (-np.eye(6)).tolist()}, "C_GPa: must be positive definite"),
        ({"C_GPa": (np.eye(6) + np.eye(6, k=1)).tolist()}, "C_GPa: row 1, column 2 must equal row 2, column 1"),
    ],
)
def test_constants_of_no_solid_are_refused_by_name(law: dict[str, object], words: str) -> None:
    with pytest.raises(GeometryError, match=words):
        Material.of_table("given", {"density_kg_m3": 1000.0, **law})


def test_whole_numbers_are_constants_too() -> None:
    whole, given = ({"C11": kind(166), "C12": kind(64), "C44": kind(80)} for kind in (int, float))
    one, other = (Material.of_table("given", {"density_kg_m3": 2330, "cubic_GPa": each}) for each in (whole, given))
    assert one == other and one.stiffness_pa[0][:2] == (166e9, 64e9)


NINE = {
    "E1_GPa": 11.0, "E2_GPa": 0.9, "E3_GPa": 0.5, "nu12": 0.37, "nu13": 0.42, "nu23": 0.47,
    "G12_GPa": 0.75, "G13_GPa": 0.7, "G23_GPa": 0.06,
}  # fmt: skip


def test_a_table_of_nine_constants_is_the_law_and_its_bounds_are_named() -> None:
    own = Material.of_table("given", {"density_kg_m3": 450.0, "orthotropic": NINE})
    assert np.array(own.stiffness_pa) == pytest.approx(np.array(WOOD.stiffness_pa), rel=1e-12)
    for change, words in (
        ({"nu12": 3.5}, r"orthotropic.nu12: must be below sqrt\(E1/E2\) = 3.496"),
        ({"nu12": 3.4, "nu13": 4.6}, "orthotropic: nu12, nu13 and nu23 together"),
    ):
        with pytest.raises(GeometryError, match=words):
            Material.of_table("given", {"density_kg_m3": 450.0, "orthotropic": NINE | change})


def test_a_warm_material_is_softer_by_its_coefficient_and_none_is_left_of_one_too_hot() -> None:
    warm = STEEL.at(120.0)
    edge = 1.0 + 100.0 * 12e-6  # a larger cube is stiffer, and as heavy
    assert (
        warm.as_isotropic.young_pa == pytest.approx(210e9 * (1.0 - 100.0 * 2.6e-4) * edge) and STEEL.at(20.0) == STEEL
    )
    cold = (1.0 + 100.0 * 6e-5) * (1.0 - 100.0 * 2.6e-6)
    assert SILICON.at(-80.0).rod(0).young_pa / SILICON.rod(0).young_pa == pytest.approx(cold)
    unknown = MATERIALS["pmma"].at(60.0)
    grown = 1.0 + 40.0 * MATERIALS["pmma"].expansion_per_k
    assert unknown.as_isotropic.young_pa == pytest.approx(grown * MATERIALS["pmma"].as_isotropic.young_pa)
    assert unknown.temperature_c == 60.0
    with pytest.raises(GeometryError, match="material steel: no stiffness is left at 5000 C"):
        STEEL.at(5000.0)


def test_every_material_of_the_library_has_a_source_and_a_law_of_its_table() -> None:
    for name, material in MATERIALS.items():
        assert material.name == name and len(material.source) > 10
        assert material.loss_factor is None or 0.0 < material.loss_factor <= 1.0


@pytest.mark.parametrize(
    ("young", "density", "poisson"),
    [(0.0, 1.0, 0.3), (-1.0, 1.0, 0.3), (1.0, 0.0, 0.3), (1.0, -1.0, 0.3), (1.0, 1.0, 0.5), (1.0, 1.0, -1.0)],
)
def test_constants_without_a_stiff_and_heavy_body_are_refused(young: float, density: float, poisson: float) -> None:
    with pytest.raises(GeometryError, match=r"E and density must be above 0, nu between -1 and 0\.5, both excluded"):
        Material.isotropic("odd", young, density, poisson)


def test_a_temperature_that_leaves_no_stiffness_at_all_is_refused() -> None:
    one = replace(STEEL, softening_per_k=-1.0 / 64.0)
    assert one.warm(83.0) == pytest.approx((1.0 - 63.0 / 64.0) * (1.0 + 63.0 * (one.expansion_per_k or 0.0)))
    with pytest.raises(GeometryError, match="no stiffness is left at 84 C"):
        one.warm(84.0)
