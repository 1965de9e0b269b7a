"""The outer surface of a plate put together from cells is closed, whatever number of columns it has."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from geometry.decimation import closed_surface
from geometry.elements import FloatArray, IntArray
from geometry.hex.scenes import HexSettings
from geometry.layout import Design, Pillar
from geometry.materials import MATERIALS, Stack
from solvers.plates.assembled import PlateModel, Reductions
from solvers.superelement.interface import Interface, ReductionSettings

ALUMINIUM = MATERIALS["aluminium"]
DESIGN = Design(
    8e-3, 6e-3, 1.5e-3, 2, ALUMINIUM, Pillar("square", 2.4e-3, 2.4e-3, 3e-3, ALUMINIUM), 4e-3, 4e-3, 1, 1.5e-3
)
COARSE = ReductionSettings(Interface(2, 2), 60e3, HexSettings(2, 4e-3, 0, 0.25, 3e-3), 4e-3)


def uses_of_edges(triangles: IntArray) -> IntArray:
    edges = np.sort(np.stack([triangles, np.roll(triangles, -1, axis=1)], axis=-1).reshape(-1, 2), axis=1)
    return np.asarray(np.unique(edges, axis=0, return_counts=True)[1])


def area(points: FloatArray, triangles: IntArray) -> float:
    a, b, c = points[triangles].swapaxes(0, 1)
    return float(np.linalg.norm(np.cross(b - a, c - a), axis=1).sum() / 2.0)


@pytest.mark.parametrize("extension_m", [1.5e-3, 0.0], ids=["edge", "flush"])
@pytest.mark.parametrize("length_m", [8e-3, 12e-3, 6.4e-3, 10.4e-3], ids=["even", "odd", "even flush", "odd flush"])
def test_a_plate_of_any_columns_is_closed(length_m: float, extension_m: float) -> None:
    """Every edge belongs to two triangles; the area is that of plate and pillars."""
    design = replace(DESIGN, length_m=length_m, extension_m=extension_m)
    assert design.pillar
    model = PlateModel(design, Reductions(Stack.of(design.thickness_m, ALUMINIUM), design.pillar, COARSE))
    whole = model.skin("SS", np.ones((model.assembled("SS").dof, 1))).unfolded("SS")
    kept, triangles = closed_surface(whole.points, whole.facets, design.thickness_m)
    assert (uses_of_edges(triangles) == 2).all()
    long, wide = design.length_m, 2.0 * design.half_span_m
    plate = 2.0 * long * wide + 2.0 * (long + wide) * design.thickness_m
    pillars = len(design.pillar_centres()) * 4.0 * design.pillar.base_m * design.pillar.height_m
    assert area(whole.points[kept], triangles) == pytest.approx(plate + pillars, rel=1e-9)
