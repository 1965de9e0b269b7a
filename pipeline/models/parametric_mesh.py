"""What the one mesh of a parametric cell puts its bands off by: measured in the corners of its box, told between them.

How far a band lies too high goes as a product of powers of the sizes, nearly, so its logarithm is taken as multilinear in
theirs, and so much is taken away. What is left of it, and what the plain reductions may be off by themselves, is the bar.
Designs that lie between the corners tell by how much more that must be.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from functools import partial
from itertools import product
from typing import Any

import numpy as np

from geometry.elements import FloatArray
from geometry.hex.boxes import HexSettings
from geometry.layout import Design
from pipeline.case.model import Case
from pipeline.logs import WarningLog
from pipeline.models.unit_cell import LatticeModel, lattice_model, lattice_of_mesh
from pipeline.planning.model_choice import cell_model_choice
from solvers.errors import SolverError
from solvers.fem.coarser import rim_shares
from solvers.parametric.affine import DesignBox, Sizes
from solvers.parametric.bands import FLAT, BandBases, bands
from solvers.parametric.cell import ParametricCell
from solvers.parametric.foot import FixedMesh, foot_of, quarter_mesh
from solvers.superelement.lattice_error import mesh_error

ACCURACY = 0.005  # of the plain reductions; what they may be off by is added
LEAST = 1e-5
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

    def too_high(self, sizes: Sizes) -> FloatArray:
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
    design, (t, h, a, p) = case.design, sizes
    assert design.pillar is not None
    grown = a / design.pillar.base_m
    more = tuple((name, grown * size) for name, size in design.pillar.more_m)
    pillar = replace(design.pillar, base_m=a, tip_m=grown * design.pillar.tip_m, height_m=h, more_m=more)
    design = replace(design, thickness_m=t, pillar=pillar, pitch_x_m=p, pitch_y_m=p)
    solve = replace(case.solve, accuracy=accuracy, model="auto", mesh="auto")
    return replace(case, design=design, solve=solve, bands=replace(case.bands, count=count))


def mesh_table(
    case: Case, cell: ParametricCell, bases: BandBases, between: list[Sizes], mesh: FixedMesh, apply: Map
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
    boxes = case.design.pillar is not None and case.design.pillar.is_made_of_boxes
    compare = off_by if boxes else partial(off_coarser, mesh)
    high, bar = np.moveaxis(np.array(list(apply(compare, tasks))), 1, 0)
    if np.isnan(high).all(axis=1).any():
        return None
    table = MeshTable(cell.box, np.ones_like(high[: 2**4, 0]), 1.0, np.maximum(np.nanmean(high[: 2**4], axis=1), LEAST))
    designs = [*cell.box.spread(0), *between]
    told = np.array([table.too_high(sizes) for sizes in designs])[:, None]
    left = np.nanmax(np.maximum(np.abs(high - told) + bar, LEAST), axis=1)
    table = replace(table, corners=left[: 2**4])
    more = [float((own / table.at(sizes)).max()) for own, sizes in zip(left, designs, strict=True)]
    return replace(table, margin=max([1.0, *more]))


def off_by(task: tuple[Case, FloatArray, FloatArray]) -> FloatArray:
    """How far bands at wavevectors (k, 2) lie above plain reductions, relative, and the bars of these, (2, k, bands).

    NaN at rest, and throughout where there is no such reduction.
    """
    case, wavevectors, found_hz = task
    try:
        model = lattice_model(case, cell_model_choice(case), wavevectors, WarningLog(), [], finer=False)
    except SolverError:
        return np.full((2, *found_hz.shape), np.nan)
    lattice, count = model.lattice, found_hz.shape[1]
    solved = [lattice.waves(k, count) for k in wavevectors]
    out = np.full((2, *found_hz.shape), np.nan)
    for row, (waves, truncated) in enumerate(zip(solved, model.truncation(solved, count), strict=True)):
        moving = waves.frequency_hz > FLAT * waves.frequency_hz[-1]
        bar = mesh_error(lattice.cell, waves).half_width + truncated
        out[0, row, moving] = (found_hz[row] / np.where(moving, waves.frequency_hz, 1.0) - 1.0)[moving]
        out[1, row, moving] = bar[moving]
    return out


def off_coarser(mesh: FixedMesh, task: tuple[Case, FloatArray, FloatArray]) -> FloatArray:
    """The same where no mesh of boxes follows the pillar: from the design's own mesh of this topology and the two nested in it,
    one without the innermost layer, one of an order less.
    """
    case, wavevectors, found_hz = task
    pillar, count = case.design.pillar, found_hz.shape[1]
    assert pillar is not None and mesh.layers
    nested = replace(mesh, layers=mesh.layers - 1), replace(mesh, order=mesh.order - 1)
    try:
        (hz, truncated), *coarser = (_frequencies(case, each, wavevectors, count) for each in (mesh, *nested))
    except SolverError:
        return np.full((2, *found_hz.shape), np.nan)
    moving = hz > FLAT * hz[:, -1:]
    own, layer, order = (
        other / np.where(moving, hz, 1.0) - 1.0 for other in (found_hz, *(each for each, _ in coarser))
    )
    shares = rim_shares(
        case.design.material, pillar.material, HexSettings(mesh.order, layers=mesh.layers, factor=mesh.factor)
    )
    half = shares.half_width(np.abs(layer), np.abs(order)) + truncated
    return np.where(moving, np.array([own + shares.taken * layer, half]), np.nan)


def _frequencies(case: Case, mesh: FixedMesh, wavevectors: FloatArray, count: int) -> tuple[FloatArray, FloatArray]:
    """Bands of a design meshed for itself at wavevectors (k, 2), Hz, and the half-widths of their bars by truncation."""
    model = meshed_alone(case, mesh, wavevectors)
    solved = [model.lattice.waves(k, count) for k in wavevectors]
    return np.array([waves.frequency_hz for waves in solved]), model.truncation(solved, count)


def meshed_alone(case: Case, mesh: FixedMesh, wavevectors: FloatArray) -> LatticeModel:
    """A design's cell on a topology of the parametric cell, reduced for itself so that waves at wavevectors (k, 2) meet the
    accuracy by truncation.
    """
    pillar = case.design.pillar
    foot = foot_of(pillar) if pillar else None
    assert foot is not None
    own, _ = quarter_mesh(foot, sizes_of(case.design), mesh)
    return lattice_of_mesh(case, own, (0, 1), wavevectors, WarningLog())


def sizes_of(design: Design) -> Sizes:
    """Thickness, height, width of the foot and pitch of a design with a pillar, m."""
    assert design.pillar is not None
    return design.thickness_m, design.pillar.height_m, design.pillar.base_m, design.pitch_x_m
