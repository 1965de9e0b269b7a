"""Patch places and the data-sheet couplings of the ceramics."""

from __future__ import annotations

from math import sqrt

import numpy as np
import pytest

from geometry.layout import antinode_places
from geometry.materials import PIEZO_MATERIALS

# coupling factors printed beside the constants in the same data sheets: k31, k33, kp, kt
SHEETS = {
    "pz26": (0.33, 0.68, 0.57, 0.47),
    "pzt-4": (0.334, 0.70, 0.58, 0.51),
    "pzt-5a": (0.344, 0.705, 0.60, 0.486),
    "pzt-5h": (0.388, 0.752, 0.65, 0.505),
}


@pytest.mark.parametrize("name", SHEETS)
def test_constants_agree_with_the_sheets_own_coupling_factors(name):
    m = PIEZO_MATERIALS[name]
    eps = m.permittivity_free_f_m[2, 2]
    clamped, c33, e33 = m.permittivity_clamped_f_m[2, 2], m.stiffness_pa[2, 2], m.stress_c_m2[2, 2]
    result = (
        -m.d31 / sqrt(m.s11 * eps),
        m.d33 / sqrt(m.s33 * eps),
        -m.d31 * sqrt(2.0 / ((m.s11 + m.s12) * eps)),
        e33 / sqrt(clamped * c33 + e33**2),
    )
    assert result == pytest.approx(SHEETS[name], rel=0.03)  # each is measured and rounded by itself


@pytest.mark.parametrize("name", SHEETS)
def test_energy_is_positive(name):
    m = PIEZO_MATERIALS[name]
    assert np.linalg.eigvalsh(m.stiffness_pa).min() > 0.0
    assert np.diag(m.permittivity_clamped_f_m).min() > 0.0


def test_pz26_stress_form_matches_the_published_one():
    m = PIEZO_MATERIALS["pz26"]
    assert m.stress_c_m2[2, [0, 2]] == pytest.approx([-2.80, 14.7], rel=5e-3)
    assert m.stress_c_m2[0, 4] == pytest.approx(9.86, rel=5e-3)
    assert np.diag(m.stiffness_pa)[[0, 2, 3, 5]] == pytest.approx([1.68e11, 1.23e11, 3.01e10, 2.88e10], rel=5e-3)


def test_end_patches_are_flush_and_keep_away():
    centres, lengths = antinode_places((-0.035, 0.0, 0.035), 0.1, (0.012, 0.003, 0.0003), ends=True)
    assert len(centres) == 5
    assert centres[-1][0] + lengths[-1] / 2 == pytest.approx(0.05)
    assert centres[-1][0] - lengths[-1] / 2 == pytest.approx(0.035 + 0.006 + 0.0003)
    assert lengths[1:4] == (0.012,) * 3
