"""A plate's layers: one of them is the textbook's plate, two are classical laminate theory's."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from geometry.errors import GeometryError
from geometry.layout import Pillar, region_materials
from geometry.materials import MATERIALS, Layer, Stack
from tests.helpers.laws import SPRUCE, orthotropic

STEEL, ALUMINIUM = MATERIALS["steel"], MATERIALS["aluminium"]
PAIR = Stack((Layer(STEEL, 1e-3), Layer(ALUMINIUM, 2e-3)))


def test_one_layer_is_the_textbooks_plate() -> None:
    plate = Stack.of(2e-3, ALUMINIUM)
    rigidity = 70e9 * 2e-3**3 / (12.0 * (1.0 - 0.34**2))
    expected = rigidity * np.array([[1.0, 0.34, 0.0], [0.34, 1.0, 0.0], [0.0, 0.0, 0.33]])
    assert plate.bending_n_m == pytest.approx(expected, rel=1e-12, abs=1e-12 * rigidity)
    assert plate.shear_n_m == pytest.approx((5.0 / 6.0 * 70e9 / 2.68 * 2e-3,) * 2)
    assert (plate.mass_kg_m2, plate.rotary_kg) == pytest.approx((5.4, 2700.0 * 2e-3**3 / 12.0))
    assert plate.material is plate.back is plate.mean is ALUMINIUM and plate.mirrors == ("x", "y", "d")


def test_a_plate_cut_into_layers_of_one_material_stays_what_it_is() -> None:
    whole, cut = Stack.of(3e-3, STEEL), Stack((Layer(STEEL, 1e-3), Layer(STEEL, 2e-3)))
    assert cut.bending_n_m == pytest.approx(whole.bending_n_m, rel=1e-12, abs=1e-6)
    assert cut.shear_n_m == pytest.approx(whole.shear_n_m)
    assert (cut.mass_kg_m2, cut.rotary_kg, cut.thickness_m) == pytest.approx((23.55, whole.rotary_kg, 3e-3))
    assert cut.mean.as_isotropic.young_pa == pytest.approx(210e9) and cut.mean.density_kg_m3 == pytest.approx(7850.0)


def test_two_layers_bend_about_their_neutral_plane() -> None:
    """Of equal Poisson's ratio the classical bimetal: E I about the centroid weighted by E."""
    other = type(STEEL).isotropic("other", 70e9, 2700.0, 0.30)
    pair = Stack((Layer(STEEL, 1e-3), Layer(other, 2e-3)))
    force, middles = np.array([210e9 * 1e-3, 70e9 * 2e-3]), np.array([0.5e-3, 2e-3])
    neutral = force @ middles / force.sum()
    own = np.array([210e9, 70e9]) @ np.array([1e-3, 2e-3]) ** 3 / 12.0
    bent = (own + force @ (middles - neutral) ** 2) / (1.0 - 0.3**2)
    assert pair.bending_n_m[0, 0] == pytest.approx(bent, rel=1e-12)
    assert pair.bending_n_m[1, 0] == pytest.approx(0.3 * bent, rel=1e-12)
    assert pair.shear_n_m[0] == pytest.approx(5.0 / 6.0 * 9e-6 / (1e-3 * 2.6 / 210e9 + 2e-3 * 2.6 / 70e9))
    density, weight = np.array([7850.0, 2700.0]), np.array([7.85, 5.4])
    about = weight @ (middles - weight @ middles / weight.sum()) ** 2 + density @ np.array([1e-3, 2e-3]) ** 3 / 12.0
    assert pair.rotary_kg == pytest.approx(about)


def test_each_layer_is_a_region_and_pillars_stand_on_the_back() -> None:
    pillar = Pillar("square", 2e-3, 2e-3, 6e-3, STEEL)
    assert PAIR.regions == {"plate": STEEL, "layer2": ALUMINIUM} and PAIR.levels_m == pytest.approx([0.0, 1e-3, 3e-3])
    assert region_materials(PAIR, None)["pillar"] is ALUMINIUM and region_materials(PAIR, pillar)["pillar"] is STEEL


def test_a_stack_is_as_symmetric_as_its_layers_and_one_material_only_where_it_has_one() -> None:
    assert Stack((Layer(STEEL, 1e-3), Layer(orthotropic(**SPRUCE), 1e-3))).mirrors == ("x", "y")
    with pytest.raises(GeometryError, match="a plate of 2 layers: this computation needs a single layer"):
        _ = PAIR.material
    assert PAIR.mean.density_kg_m3 == pytest.approx((7.85 + 5.4) / 3e-3)
    assert PAIR.mean.as_isotropic.shear_pa == pytest.approx((210e9 / 2.6 + 2.0 * 70e9 / 2.68) / 3.0)


def test_a_warm_bimetal_bows_as_timoshenko_has_it_and_its_stresses_balance() -> None:
    """Two layers of one Poisson's ratio: 6 (a2 - a1) (1 + m)^2 / (h (3 (1 + m)^2 + (1 + m n)(m^2 + 1/(m n))))."""
    lower = replace(type(STEEL).isotropic("lower", 210e9, 7850.0, 0.30), expansion_per_k=12e-6)
    upper = replace(type(STEEL).isotropic("upper", 70e9, 2700.0, 0.30), expansion_per_k=23e-6)
    h1, h2 = 1e-3, 2e-3
    warming = Stack((Layer(lower, h1), Layer(upper, h2))).warming
    assert warming is not None
    m, n = h1 / h2, 3.0
    bow = 6.0 * 11e-6 * (1.0 + m) ** 2 / ((h1 + h2) * (3.0 * (1.0 + m) ** 2 + (1.0 + m * n) * (m**2 + 1.0 / (m * n))))
    assert warming.curvature_per_m == pytest.approx([bow, bow, 0.0], rel=1e-12, abs=1e-15)
    means = warming.stress_pa.mean(axis=1)
    assert h1 * means[0] + h2 * means[1] == pytest.approx(np.zeros(3), abs=1e-9 * np.abs(warming.stress_pa).max())


def test_one_layer_expands_without_stress_and_an_unknown_expansion_is_not_none() -> None:
    alone = Stack.of(2e-3, ALUMINIUM).warming
    assert alone is not None and alone.strain == pytest.approx([23e-6, 23e-6, 0.0])
    assert np.abs(alone.stress_pa).max() < 1e-6 * 70e9 * 23e-6
    unknown = replace(ALUMINIUM, expansion_per_k=None)
    assert Stack((Layer(STEEL, 1e-3), Layer(unknown, 2e-3))).warming is None
