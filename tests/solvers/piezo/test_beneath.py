"""Flexibility of the panels beneath a patch, by mirror classes."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from geometry.hex.scenes import HexSettings
from geometry.layout import Design, Pillar
from geometry.materials import MATERIALS, PIEZO_MATERIALS, Stack
from solvers.piezo import patch as beneath
from solvers.piezo.patch import StaticCorrection, bonded_patch
from solvers.plates.assembled import PlateModel, Reductions
from solvers.superelement.interface import Interface, ReductionSettings

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
    return PlateModel(design, Reductions(Stack.of(design.thickness_m, ALUMINIUM), pillar, reduction))


@pytest.mark.slow
@pytest.mark.parametrize(
    ("box", "rows", "axes"),
    [
        ((-4e-3, 4e-3, -2e-3, 2e-3), 0, (0, 1)),
        ((1e-3, 8e-3, -2e-3, 2e-3), 0, (1,)),
        ((-4e-3, 4e-3, -1e-3, 3e-3), 0, (0,)),
        ((-1e-3, 1e-3, 5e-3, 6e-3), 1, (0,)),
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
    ours, theirs = (StaticCorrection(model.reductions)._static(each) for each in (place, whole))
    assert np.linalg.eigvalsh(theirs)[0] > 0.0
    assert np.abs(ours - theirs).max() < 1e-11 * np.abs(theirs).max()


def test_a_half_whose_elements_are_not_the_wholes_is_not_taken() -> None:
    """Three elements along a patch have no line in its middle."""
    model = plate_model()
    patch = bonded_patch(PZ26, np.array([-3e-3, 3e-3, -2e-3, 2e-3]), 0.5e-3, True, replace(MESH, layers=0))
    assert beneath._Place.of(model.assembled("SS"), patch, model.reductions, True).mirrors == (1,)
