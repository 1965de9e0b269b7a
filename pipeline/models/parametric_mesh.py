"""What the one mesh of a parametric cell puts its bands off by: measured in the corners of its box, told between them.

The error goes as a product of powers of the sizes, nearly, so its logarithm is taken as multilinear in theirs. Designs that lie
between the corners tell by how much more the bar must be.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from itertools import product
from typing import Any

import numpy as np

from geometry.elements import FloatArray
from pipeline.case.model import Case
from pipeline.logs import TerminalLog
from pipeline.models.unit_cell import lattice_model
from pipeline.planning.model_choice import cell_model_choice
from solvers.errors import SolverError
from solvers.parametric.affine import DesignBox, Sizes
from solvers.parametric.bands import FLAT, BandBases, bands
from solvers.parametric.cell import ParametricCell
from solvers.superelement.lattice_error import mesh_error

ACCURACY = 0.005  # of the plain reductions; what they may be off by is added
LEAST = 1e-5
Map = Callable[[Callable[[Any], FloatArray], Iterable[Any]], Iterable[FloatArray]]


@dataclass(frozen=True)
class MeshTable:
    """Half-widths of the bands' bars by the mesh in the box's corners, (16, bands), and what they are taken times between."""

    box: DesignBox
    corners: FloatArray
    margin: float

    def at(self, sizes: Sizes) -> FloatArray:
        """The half-widths of a design, relative, (bands,)."""
        return np.asarray(self.margin * np.exp(corner_weights(self.box, sizes) @ np.log(self.corners)))


def corner_weights(box: DesignBox, sizes: Sizes) -> FloatArray:
    """Weights (16,) of the box's corners at a design, in the order of DesignBox.spread."""
    unit = box.unit(sizes)
    return np.array([np.prod(np.where(corner, unit, 1.0 - unit)) for corner in product((0, 1), repeat=4)])


def with_sizes(case: Case, sizes: Sizes, accuracy: float, count: int) -> Case:
    """The case with another cell, so many of its bands to be had within an accuracy."""
    design, (t, h, a, p) = case.design, sizes
    assert design.pillar is not None
    pillar = replace(design.pillar, base_m=a, tip_m=a, height_m=h)
    design = replace(design, thickness_m=t, pillar=pillar, pitch_x_m=p, pitch_y_m=p)
    solve = replace(case.solve, accuracy=accuracy, model="auto", mesh="auto")
    return replace(case, design=design, solve=solve, bands=replace(case.bands, count=count))


def mesh_table(
    case: Case, cell: ParametricCell, bases: BandBases, between: list[Sizes], apply: Map
) -> MeshTable | None:
    """Compare the bands of corner designs, and of some between them, with plain reductions on meshes of their own.

    None where one of those cannot be had, or nothing tells what it is off by.
    """
    at = [number for number, label in enumerate(bases.labels) if label][:3]
    tasks = [
        (with_sizes(case, sizes, ACCURACY, bases.count), bases.fractions[at] * np.pi / sizes[3], found)
        for sizes in (*cell.box.spread(0), *between)
        for found in [bands(cell, bases, sizes).frequency_hz[at]]
    ]
    off = np.maximum(np.array(list(apply(off_by, tasks))), LEAST)
    if np.isnan(off).any():
        return None
    table = MeshTable(cell.box, off[: 2**4], 1.0)
    more = [float((each / table.at(sizes)).max()) for each, sizes in zip(off[2**4 :], between, strict=True)]
    return replace(table, margin=max([1.0, *more]))


def off_by(task: tuple[Case, FloatArray, FloatArray]) -> FloatArray:
    """Largest relative differences of bands at wavevectors (k, 2) from plain reductions and the bars of these, (bands,).

    NaN where there is no such reduction.
    """
    case, wavevectors, found_hz = task
    try:
        model = lattice_model(case, cell_model_choice(case), wavevectors, TerminalLog(True), [], finer=False)
    except SolverError:
        return np.full(found_hz.shape[1], np.nan)
    lattice, count = model.lattice, found_hz.shape[1]
    solved = [lattice.waves(k, count) for k in wavevectors]
    worst = np.full(count, LEAST)
    for waves, found, truncated in zip(solved, found_hz, model.truncation(solved, count), strict=True):
        moving = waves.frequency_hz > FLAT * waves.frequency_hz[-1]
        bar = mesh_error(lattice.cell, waves).half_width + truncated
        difference = np.abs(found / np.where(moving, waves.frequency_hz, 1.0) - 1.0) + bar
        worst = np.maximum(worst, np.where(moving, difference, LEAST))
    return worst
