"""What a laser sees at one point, against the operating shape of the whole face, in every quadrant."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from types import SimpleNamespace
from typing import cast

import numpy as np
import pytest

from geometry.hex.scenes import HexSettings
from geometry.layout import Design
from geometry.materials import MATERIALS, PIEZO_MATERIALS, Stack
from solvers.piezo.forced import Drive, ForcedPlate
from solvers.piezo.patch import bonded_patch
from solvers.piezo.patched_plate import CLASSES, PatchedPlate
from solvers.piezo.responses import loudest_point, point_response
from solvers.plates.assembled import PlateModel, Reductions
from solvers.superelement.interface import Interface, ReductionSettings

ALUMINIUM = MATERIALS["aluminium"]
DESIGN = Design(24e-3, 10e-3, 2e-3, 2, ALUMINIUM, None, float("nan"), float("nan"), 0, 3e-3)
TONE_HZ = 33e3


@cache
def lopsided() -> ForcedPlate:
    """One patch off both axes: it drives all four symmetry classes at once."""
    reduction = ReductionSettings(Interface(4, 2), 600e3, HexSettings(2, 2e-3, 0, 0.2), 4e-3)
    model = PlateModel(DESIGN, Reductions(Stack.of(DESIGN.thickness_m, ALUMINIUM), None, reduction))
    patch = bonded_patch(PIEZO_MATERIALS["pz26"], np.array([2e-3, 10e-3, -1e-3, 3e-3]), 0.3e-3, True)
    plate = PatchedPlate({symmetry: model.assembled(symmetry) for symmetry in CLASSES}, [patch], True)
    return ForcedPlate(plate, DESIGN, Drive((0,), (), (20e3, 45e3), 100.0))


@pytest.mark.slow
@pytest.mark.parametrize("place", [(7e-3, 3e-3), (-7e-3, 3e-3), (7e-3, -3e-3), (-7e-3, -3e-3)])
def test_a_point_moves_as_the_shape_does_there(place: tuple[float, float]) -> None:
    points, values = lopsided().shape(TONE_HZ)
    nearest = int(np.argmin(((points - np.array(place)) ** 2).sum(axis=1)))
    result = point_response(lopsided(), place, np.array([TONE_HZ]))[0]
    assert result == pytest.approx(values[nearest], rel=1e-9)
    mirrored = point_response(lopsided(), (-place[0], -place[1]), np.array([TONE_HZ]))[0]
    assert abs(result - mirrored) > 0.05 * np.abs(values).max()


@pytest.mark.slow
def test_the_loudest_point_of_the_zone_is_the_shapes_largest() -> None:
    points, values = lopsided().shape(TONE_HZ)
    place = loudest_point(lopsided(), TONE_HZ)
    inside = np.abs(points[:, 1]) < DESIGN.width_m / 2
    result = point_response(lopsided(), place, np.array([TONE_HZ]))[0]
    assert abs(result) == pytest.approx(np.abs(values[inside]).max(), rel=1e-6)


def test_the_loudest_point_lies_in_the_zone_wherever_that_is() -> None:
    """Of a zone off the middle of a larger plate: points beyond its ends, or of the plate's middle, do not count."""
    away = replace(DESIGN, larger_m=(80e-3, 60e-3), centre_m=(20e-3, -15e-3))
    points = 1e-3 * np.array([[0.0, 0.0], [20.0, 4.0], [35.0, -15.0], [12.0, -18.0], [28.0, -12.0], [20.0, -15.0]])
    values = np.array([9.0, 8.0, 7.0, -2.0, 2.0, 1.0j])
    plate = SimpleNamespace(design=away, shape=lambda tone: (points, values))
    assert loudest_point(cast(ForcedPlate, plate), TONE_HZ) == pytest.approx((28e-3, -12e-3))
