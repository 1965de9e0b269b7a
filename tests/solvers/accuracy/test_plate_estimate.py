"""The estimate of an assembled plate's reduction error against a plate reduced much finer from the same meshes."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
import pytest

from geometry.hex.scenes import HexSettings
from geometry.layout import Design, Pillar
from geometry.materials import MATERIALS, Stack
from solvers.accuracy.reduction import mode_errors
from solvers.fem.eigen import modes_near
from solvers.plates.assembled import PlateModel, Reductions
from solvers.superelement.interface import Interface, ReductionSettings

ALUMINIUM = MATERIALS["aluminium"]
PILLAR = Pillar("square", 2e-3, 2e-3, 6.3e-3, ALUMINIUM)
DESIGN = Design(16e-3, 8e-3, 2e-3, 2, ALUMINIUM, PILLAR, 4e-3, 5e-3, 1, 4e-3)
MESH = HexSettings(order=3, size_m=4e-3, layers=0, pillar_size_m=3.15e-3)
COUNT = 12


@lru_cache
def plate(along: int, top_hz: float) -> tuple[np.ndarray, float, float]:
    """Lowest frequencies of a class, and the worst estimates by modes and by degrees."""
    reduction = ReductionSettings(Interface(along, 3), top_hz, MESH)
    joined = PlateModel(DESIGN, Reductions(Stack.of(2e-3, ALUMINIUM), PILLAR, reduction)).assembled("SS")
    modes = modes_near(joined.pencil(), 0.0, COUNT)
    errors = mode_errors(joined, joined.pencil(), modes.vectors[:, :COUNT])
    return modes.frequency_hz[:COUNT], float(errors.modes.max()), float(errors.degrees.max())


@pytest.mark.slow
@pytest.mark.parametrize(("along", "top_hz"), [(2, 900e3), (3, 400e3), (4, 400e3), (4, 800e3)])
def test_the_worst_error_stays_below_the_worst_estimate(along: int, top_hz: float) -> None:
    fine, coarse = plate(7, 1.5e6), plate(along, top_hz)
    actual = (coarse[0] / fine[0] - 1.0).max()
    assert 0.0 < actual <= coarse[1] + coarse[2]


@pytest.mark.slow
def test_each_estimate_answers_to_its_own_cause() -> None:
    assert plate(2, 900e3)[2] > 3.0 * plate(4, 900e3)[2]  # degrees
    assert plate(4, 300e3)[1] > 3.0 * plate(4, 900e3)[1]  # fixed-interface modes
