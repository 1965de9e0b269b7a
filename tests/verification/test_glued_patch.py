"""Glue under patches: a conforming solid beside it, no glue as its limit, and what it loses."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from geometry.hex.scenes import HexSettings
from geometry.layout import Design
from geometry.materials import MATERIALS, PIEZO_MATERIALS, Layer, Material
from pipeline.case.model import case_from_dict
from pipeline.errors import InputError
from solvers.fem.assembly import Forms
from solvers.fem.eigen import modes_in_band
from solvers.piezo.forced import Drive, ForcedPlate
from solvers.piezo.patch import StaticCorrection, _alike, _mesh, bonded_patch
from solvers.piezo.patched_plate import CLASSES, PatchedPlate
from solvers.plates.assembled import PlateModel, Reductions
from solvers.superelement.interface import Interface, ReductionSettings

ALUMINIUM, EPOXY, PZ26 = MATERIALS["aluminium"], MATERIALS["epoxy"], PIEZO_MATERIALS["pz26"]
DESIGN = Design(24e-3, 10e-3, 2e-3, 2, ALUMINIUM, None, float("nan"), float("nan"), 0, 3e-3)
BOX, THICK_M, MESH = np.array([-4e-3, 4e-3, -2e-3, 2e-3]), 0.5e-3, HexSettings(2, 4e-3, 1, 0.15)
# an elastic "ceramic" without a piezoelectric effect: what it and the glue do is elasticity alone
E, NU = EPOXY.as_isotropic.young_pa, EPOXY.as_isotropic.poisson
DULL = replace(
    PZ26, name="dull", s11=1 / E, s12=-NU / E, s13=-NU / E, s33=1 / E, s44=2 * (1 + NU) / E, d31=0.0, d33=0.0, d15=0.0,
    density_kg_m3=EPOXY.density_kg_m3, loss_factor=EPOXY.loss_factor,
)  # fmt: skip


def plate(glue: Layer | None, above: bool = True, thickness_m: float = THICK_M, material: Any = PZ26) -> PatchedPlate:
    reduction = ReductionSettings(Interface(6, 3), 300e3, HexSettings(3, 2e-3, 0, 0.2), 4e-3)
    model = PlateModel(DESIGN, Reductions(DESIGN.stack, None, reduction, lossy=True))
    patch = bonded_patch(material, BOX, thickness_m, above, MESH, glue=glue)
    plates = {symmetry: model.assembled(symmetry) for symmetry in CLASSES}
    return PatchedPlate(plates, [patch], above, beneath=StaticCorrection(model.reductions), at_hz=30e3)


def forced(*args: Any, quality: float | None = 100.0, **more: Any) -> ForcedPlate:
    return ForcedPlate(plate(*args, **more), DESIGN, Drive((0,), (), (10e3, 60e3), quality))


@pytest.mark.slow
@pytest.mark.parametrize("above", [True, False])
def test_glue_of_the_patchs_own_material_is_a_thicker_patch(above: bool) -> None:
    """Without a piezoelectric effect: stiffness, mass and loss of both, and the resonances of the plate under them."""
    ours = _alike(DULL, 8e-3, 4e-3, 0.3e-3, above, MESH, Layer(EPOXY, 0.2e-3))
    theirs = _alike(DULL, 8e-3, 4e-3, 0.5e-3, above, MESH)
    assert ours.mass.sum() == pytest.approx(theirs.mass.sum(), rel=1e-9)
    assert ours.lost is not None and theirs.lost is not None
    assert ours.lost == pytest.approx(EPOXY.lost * ours.stiffness, rel=1e-9, abs=1e-9 * np.abs(ours.lost).max())
    plates = [plate(glue, above, thick, DULL) for glue, thick in ((Layer(EPOXY, 0.2e-3), 0.3e-3), (None, 0.5e-3))]
    one, two = (modes_in_band(each.everything[0].pencil, 10e3, 80e3).frequency_hz for each in plates)
    assert len(one) > 2
    assert one == pytest.approx(two, rel=1e-3)  # the mesh has a graded line more


@pytest.mark.slow
@pytest.mark.parametrize("above", [True, False])
def test_thin_hard_glue_changes_nothing(above: bool) -> None:
    hard = Layer(MATERIALS["aluminium"], 1e-6)
    glued, bare = forced(hard, above), forced(None, above)
    assert glued.resonances_hz == pytest.approx(bare.resonances_hz, rel=1e-3)
    tones = np.array([15e3, 25e3, 45e3])
    ours, theirs = (each.curve(tones).zone_rms_m_per_v for each in (glued, bare))
    assert ours == pytest.approx(theirs, rel=0.02)


@pytest.mark.slow
def test_soft_glue_takes_load_from_the_patch_by_shear_lag() -> None:
    """The thicker and softer, the less a volt moves the plate (crawley1987): a tenth of the modulus or ten times the height."""
    soft = replace(Material.isotropic("soft", 0.1 * E, EPOXY.density_kg_m3, NU), loss_factor=0.05)
    layers = [None, Layer(EPOXY, 0.02e-3), Layer(EPOXY, 0.2e-3), Layer(soft, 0.2e-3)]
    answers = [forced(glue).curve(np.array([11e3])).zone_rms_m_per_v[0] for glue in layers]
    assert answers == sorted(answers, reverse=True)
    assert answers[-1] < 0.7 * answers[0] < answers[1]


def test_the_clamped_capacitance_is_that_of_the_ceramic() -> None:
    """Glue has no permittivity: soft enough, the patch on a clamped face is free at its underside."""
    hard, soft = (
        _alike(PZ26, 8e-3, 4e-3, THICK_M, True, MESH, Layer(Material.isotropic("glue", e, 1100.0, 0.3), 0.1e-3))
        for e in (300e9, 3e6)
    )
    bare = _alike(PZ26, 8e-3, 4e-3, THICK_M, True, MESH)
    assert hard.capacitance_f == pytest.approx(bare.capacitance_f, rel=0.05)
    free = PZ26.permittivity_free_f_m[2, 2] * 8e-3 * 4e-3 / THICK_M
    assert soft.capacitance_f == pytest.approx(free, rel=0.02)


@pytest.mark.slow
def test_what_the_glue_loses_is_its_loss_factor_times_its_energy() -> None:
    """From patches of which one part alone loses; the sum is that of both."""
    still = replace(PZ26, loss_factor=0.0)
    calm = replace(EPOXY, loss_factor=0.0)
    parts = [
        _alike(ceramic, 8e-3, 4e-3, THICK_M, True, MESH, Layer(glue, 0.1e-3)).lost
        for ceramic, glue in ((PZ26, EPOXY), (PZ26, calm), (still, EPOXY))
    ]
    both, ceramic, glue = (np.asarray(part) for part in parts)
    assert both == pytest.approx(ceramic + glue, rel=1e-9, abs=1e-9 * np.abs(both).max())
    assert np.linalg.eigvalsh(glue)[0] > -1e-9 * np.abs(glue).max()
    losses = [forced(Layer(each, 0.1e-3), quality=None, material=still).losses for each in (EPOXY, calm)]
    assert (losses[0] > losses[1]).all()


def test_the_lowest_layer_is_the_mesh_s_first_region() -> None:
    for above, first in ((True, "glue"), (False, "patch")):
        mesh = _mesh(np.array([0.0, 8e-3, 0.0, 4e-3]), THICK_M, MESH, above, 0.1e-3)
        assert mesh.nodes[mesh.cells[mesh.regions[first]], 2].min() == 0.0
        volumes = Forms(mesh, 1.0).mass(np.ones(len(mesh.cells))).sum()
        assert volumes == pytest.approx(8e-3 * 4e-3 * 0.6e-3, rel=1e-12)


RAW: dict[str, Any] = {
    "material": "aluminium",
    "plate": {"thickness_mm": 2.0},
    "zone": {"length_mm": 40.0, "width_mm": 20.0, "nodal_lines": 4},
    "array": {"rows": 0, "extension_mm": 5.0},
    "patches": {"size_mm": [6.0, 4.0, 0.3], "centres_mm": [[-8.0, 0.0]]},
}


@pytest.mark.parametrize(
    ("glue", "line"),
    [
        ({"material": "epoxy"}, "patches.glue.thickness_mm: missing"),
        ({"thickness_mm": 0.1}, "patches.glue.material: missing"),
        ({"material": "epoxi", "thickness_mm": 0.1}, "did you mean epoxy"),
        ({"material": "epoxy", "thickness_mm": 1e-7}, "patches.glue.thickness_mm = 1e-07: must be a finite number above 0"),
        ({"material": "epoxy", "thickness_mm": 0.5}, "must be from 0.0003 to 0.3"),
        ("epoxy", "patches.glue = \"epoxy\": must be a table"),
        ({"material": "epoxy", "thickness_mm": 0.1, "width_mm": 1.0}, "patches.glue.width_mm"),
    ],
)  # fmt: skip
def test_every_fault_has_its_line(glue: Any, line: str) -> None:
    with pytest.raises(InputError) as caught:
        case_from_dict(RAW | {"patches": RAW["patches"] | {"glue": glue}})
    assert any(line in text for text in caught.value.lines), caught.value.lines


def test_a_case_says_its_glue() -> None:
    own = {"material": "epoxy", "thickness_mm": 0.1}
    case = case_from_dict(RAW | {"patches": RAW["patches"] | {"glue": own}}, None, ["patches.glue.thickness_mm=0.05"])
    assert case.patches and case.patches.glue == Layer(EPOXY, pytest.approx(0.05e-3))
    plain = case_from_dict(RAW).to_dict()["patches"]
    assert plain.get("glue") is None
