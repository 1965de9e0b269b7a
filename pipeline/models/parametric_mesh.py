"""What the one mesh of a parametric cell puts its bands off by: measured in the corners of its box, told between them.

How far a band lies too high goes as a product of powers of the sizes, nearly, so its logarithm is taken as multilinear in
theirs, and so much is taken away. What is left of it, and what the plain reductions may be off by themselves, is the bar.
Designs that lie between the corners tell by how much more that must be.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from itertools import product
from typing import Any

import numpy as np

from geometry.elements import FloatArray
from geometry.layout import Design
from pipeline.case.model import Case
from pipeline.logs import WarningLog
from pipeline.models.unit_cell import lattice_model
from pipeline.planning.model_choice import cell_model_choice
from solvers.errors import SolverError
from solvers.parametric.affine import DesignBox, Sizes
from solvers.parametric.bands import FLAT, BandBases, bands
from solvers.parametric.cell import ParametricCell
from solvers.superelement.lattice_error import mesh_error

ACCURACY = 0.002  # of the plain reductions; what they may be off by is added
MIN_ERROR = 1e-5
Map = Callable[[Callable[[Any], FloatArray], Iterable[Any]], Iterable[FloatArray]]


@dataclass(frozen=True)
class MeshTable:
    """Half-widths of the bands' bars by the mesh in the box's corners, (16, bands), and what they are taken times between;
    `high` (16, bands): how far the bands lie too high there, relative.
    """

    box: DesignBox
    corners: FloatArray
    margin: float
    high: FloatArray

    def at(self, sizes: Sizes) -> FloatArray:
        """The half-widths of a design, relative, (bands,)."""
        return self.margin * self._between(self.corners, sizes)

    def overestimate(self, sizes: Sizes) -> FloatArray:
        """How far a design's bands lie too high, relative, (bands,)."""
        return self._between(self.high, sizes)

    def _between(self, corners: FloatArray, sizes: Sizes) -> FloatArray:
        return np.asarray(np.exp(corner_weights(self.box, sizes) @ np.log(corners)))


def corner_weights(box: DesignBox, sizes: Sizes) -> FloatArray:
    """Weights (16,) of the box's corners at a design, in the order of DesignBox.spread."""
    unit = box.unit(sizes)
    return np.array([np.prod(np.where(corner, unit, 1.0 - unit)) for corner in product((0, 1), repeat=4)])


def with_sizes(case: Case, sizes: Sizes, accuracy: float, count: int) -> Case:
    """The case with another cell, so many of its bands to be had within an accuracy."""
    solve = case.solve.but(accuracy=accuracy, model="auto", mesh="auto")
    return replace(case, design=resized(case.design, sizes), solve=solve, bands=case.bands.but(count=count))


def resized(design: Design, sizes: Sizes) -> Design:
    """The design with another cell; the pillar's further widths keep their ratio to the first."""
    assert design.pillar is not None
    t, h, a, p = sizes
    grown = a / design.pillar.base_m
    more = tuple((name, grown * size) for name, size in design.pillar.more_m)
    pillar = replace(design.pillar, base_m=a, tip_m=grown * design.pillar.tip_m, height_m=h, more_m=more)
    return replace(design, thickness_m=t, pillar=pillar, pitch_x_m=p, pitch_y_m=p)


def mesh_table(
    case: Case, cell: ParametricCell, bases: BandBases, between: list[Sizes], apply: Map
) -> MeshTable | None:
    """Compare the bands of corner designs, and of some between them, with plain reductions on meshes of their own.

    None where one of those cannot be had, or nothing tells what it is off by.
    """
    at = [number for number, label in enumerate(bases.labels) if label][:3]
    tasks = [
        (with_sizes(case, sizes, ACCURACY, bases.count), bases.fractions[at] * np.pi / sizes[3], band_hz)
        for sizes in (*cell.box.spread(0), *between)
        for band_hz in [bands(cell, bases, sizes).frequency_hz[at]]
    ]
    high, bar = np.moveaxis(np.array(list(apply(off_by, tasks))), 1, 0)
    if np.isnan(high).all(axis=1).any():
        return None
    table = MeshTable(
        cell.box, np.ones_like(high[: 2**4, 0]), 1.0, np.maximum(np.nanmean(high[: 2**4], axis=1), MIN_ERROR)
    )
    designs = [*cell.box.spread(0), *between]
    expected = np.array([table.overestimate(sizes) for sizes in designs])[:, None]
    left = np.nanmax(np.maximum(np.abs(high - expected) + bar, MIN_ERROR), axis=1)
    table = replace(table, corners=left[: 2**4])
    more = [float((own / table.at(sizes)).max()) for own, sizes in zip(left, designs, strict=True)]
    return replace(table, margin=max([1.0, *more]))


def off_by(task: tuple[Case, FloatArray, FloatArray]) -> FloatArray:
    """How far bands at wavevectors (k, 2) lie above plain reductions, relative, and the bars of these, (2, k, bands).

    NaN at rest, and throughout where there is no such reduction.
    """
    case, wavevectors, band_hz = task
    try:
        model = lattice_model(case, cell_model_choice(case), wavevectors, WarningLog(), [], finer=False)
    except SolverError:
        return np.full((2, *band_hz.shape), np.nan)
    lattice, count = model.lattice, band_hz.shape[1]
    solved = [lattice.waves(k, count) for k in wavevectors]
    out = np.full((2, *band_hz.shape), np.nan)
    for row, (waves, truncated) in enumerate(zip(solved, model.truncation(solved, count), strict=True)):
        moving = waves.frequency_hz > FLAT * waves.frequency_hz[-1]
        bar = mesh_error(lattice.cell, waves).half_width + truncated
        out[0, row, moving] = (band_hz[row] / np.where(moving, waves.frequency_hz, 1.0) - 1.0)[moving]
        out[1, row, moving] = bar[moving]
    return out


def sizes_of(design: Design) -> Sizes:
    """Thickness, height, width of the foot and pitch of a design with a pillar, m."""
    assert design.pillar is not None
    return design.thickness_m, design.pillar.height_m, design.pillar.base_m, design.pitch_x_m
