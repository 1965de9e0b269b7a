"""What the panels beneath a patch tell: their flexibility by mirror classes, and whether they prove the plate's stiffness."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from geometry.hex.boxes import HexSettings
from geometry.layout import Design, Pillar
from geometry.materials import MATERIALS
from geometry.piezo_materials import PIEZO_MATERIALS
from solvers.piezo import beneath, patched_plate
from solvers.piezo.beneath import Beneath
from solvers.piezo.patch import bonded_patch
from solvers.piezo.patched_plate import CLASSES, PatchedPlate
from solvers.superelement.build import PlateModel, Reductions
from solvers.superelement.interface import Interface, ReductionSettings
from tests.helpers.kept_matrices import KeptMatrices

ALUMINIUM, PZ26 = MATERIALS["aluminium"], PIEZO_MATERIALS["pz26"]
MESH = HexSettings(2, 2e-3, 1, 0.2)
FINER, ROUGH = (
    replace(MESH, order=3, size_m=4e-3),
    replace(MESH, size_m=8e-3),
)  # two meshes near to each other, and far apart


@cache
def plate_model(rows: int = 0) -> PlateModel:
    pillar = Pillar("square", 1e-3, 1e-3, 3e-3, ALUMINIUM) if rows else None
    pitch = 4e-3 if rows else float("nan")
    design = Design(24e-3, 10e-3, 2e-3, 2, ALUMINIUM, pillar, pitch, pitch, rows, 3e-3)
    reduction = ReductionSettings(Interface(4, 3), 300e3, HexSettings(3, 2e-3, 1 if rows else 0, 0.2, 2e-3), 4e-3)
    return PlateModel(design, Reductions(design.thickness_m, ALUMINIUM, pillar, reduction))


@pytest.mark.parametrize(
    ("box", "rows", "axes"),
    [
        ((-4e-3, 4e-3, -2e-3, 2e-3), 0, (0, 1)),
        ((1e-3, 8e-3, -2e-3, 2e-3), 0, (1,)),
        ((-4e-3, 4e-3, -1e-3, 3e-3), 0, (0,)),
        pytest.param((-1e-3, 1e-3, 5e-3, 6e-3), 1, (0,), marks=pytest.mark.slow),
        ((1e-3, 8e-3, -1e-3, 3e-3), 0, ()),
    ],
    ids=["both", "y", "x", "over pillars", "none"],
)
def test_a_mirrored_place_gives_way_class_by_class_as_it_does_whole(
    box: tuple[float, ...], rows: int, axes: tuple[int, ...]
) -> None:
    """The same elements and the same forces: the two differ by rounding alone."""
    model = plate_model(rows)
    plate, patch = model.assembled("SS"), bonded_patch(PZ26, np.array(box), 0.5e-3, False, MESH)
    place, whole = (beneath._Place.of(plate, patch, model.reductions, False) for _ in range(2))
    assert place.mirrors == axes
    whole.__dict__["mirrors"] = ()
    ours, theirs = (Beneath(model.reductions)._static(each) for each in (place, whole))
    assert np.linalg.eigvalsh(theirs)[0] > 0.0
    assert np.abs(ours - theirs).max() < 1e-11 * np.abs(theirs).max()


def test_a_half_whose_elements_are_not_the_wholes_is_not_taken() -> None:
    """Three elements along a patch have no line in its middle."""
    model = plate_model()
    patch = bonded_patch(PZ26, np.array([-3e-3, 3e-3, -2e-3, 2e-3]), 0.5e-3, True, replace(MESH, layers=0))
    assert beneath._Place.of(model.assembled("SS"), patch, model.reductions, True).mirrors == (1,)


def joined(thick_m: float, mesh: HexSettings, monkeypatch: pytest.MonkeyPatch) -> tuple[PatchedPlate, int]:
    """A plate with a patch of two meshes, and how many factors of whole classes its positivity took."""
    model, factors = plate_model(), []
    plates = {symmetry: model.assembled(symmetry) for symmetry in CLASSES}
    patch = bonded_patch(PZ26, np.array([-8e-3, 8e-3, -3e-3, 3e-3]), thick_m, True, mesh)
    original = patched_plate._positive
    monkeypatch.setattr(patched_plate, "_positive", lambda *each: factors.append(each) or original(*each))
    plate = PatchedPlate(plates, [patch], True, beneath=Beneath(model.reductions), at_hz=30e3)
    for group in plate.everything:
        values = np.linalg.eigvalsh(group.pencil.stiffness.toarray())
        assert values[0] > -1e-9 * values[-1]
    return plate, len(factors)


@pytest.mark.slow
def test_panels_that_stay_stiff_beneath_a_patch_spare_the_whole_plates_factors(monkeypatch: pytest.MonkeyPatch) -> None:
    plate, factors = joined(0.3e-3, FINER, monkeypatch)
    assert plate.is_stiff and not plate.differs_too_much and not factors


def test_where_the_panels_prove_nothing_the_whole_plate_is_asked(monkeypatch: pytest.MonkeyPatch) -> None:
    """So thick a patch takes more away, between its two meshes, than the plate beneath it holds."""
    plate, factors = joined(4e-3, ROUGH, monkeypatch)
    assert plate.differs_too_much and not plate.is_stiff and factors


def test_a_panel_shared_by_patches_is_not_taken_for_each_of_them_whole() -> None:
    """Two patches on one panel, a third one on its own."""
    model = plate_model()
    line = float(model.tiling.x[len(model.tiling.x) // 2])
    width = float(np.diff(model.tiling.x).min())
    boxes = [
        np.array([line + a * width, line + b * width, -1e-3, 1e-3]) for a, b in ((0.1, 0.4), (0.6, 0.9), (-0.9, -0.1))
    ]
    plate = model.assembled("SS")
    assert beneath.most_on_a_panel(plate, boxes) == 2
    assert beneath.most_on_a_panel(plate, boxes[1:]) == 1


def test_what_is_kept_of_one_patch_does_not_stand_for_a_thicker_one() -> None:
    """Both make the plate give way alike, and each is proven by itself."""
    model, kept, entries = plate_model(), KeptMatrices(), []
    plates = {symmetry: model.assembled(symmetry) for symmetry in CLASSES}
    for thick_m in (0.3e-3, 0.3e-3, 0.5e-3):
        patch = bonded_patch(PZ26, np.array([-4e-3, 4e-3, -2e-3, 2e-3]), thick_m, True, MESH)
        PatchedPlate(plates, [patch], True, beneath=Beneath(model.reductions, kept))
        entries.append(len(kept))
    assert entries == [5, 5, 6]
