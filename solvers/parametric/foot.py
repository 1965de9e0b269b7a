"""What of a pillar stays alike while it grows: its section over its width, and the quarter cell's mesh around it.

A round or hexagonal section stands in a square block of the plate that grows with it, so that beyond the block every stretch
is along the axes, as it is for a section made of boxes (rozza2008).
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from geometry.elements import FloatArray, IntArray
from geometry.hex.panels import (
    CORNERS,
    Patch,
    PlanLines,
    beside,
    boxes_of_patch,
    disc,
    hexagon,
    joined,
    leaning,
    straight,
)
from geometry.hex.scenes import Grading, grid_lines
from geometry.layout import Pillar
from geometry.mesh import Mesh

BLOCK = 1.1  # width of a round or hexagonal pillar's block over the pillar's largest
UNDER, BESIDE = 2, 3  # numbers of the stretches of block and clearance: solvers/parametric/affine.py


@dataclass(frozen=True)
class FixedMesh:
    """Order and elements of the one topology: even intervals of each part, layers graded towards the pillar's foot."""

    order: int = 3
    under: int = 1
    beside: int = 2
    through: int = 1
    along: int = 4
    layers: int = 2
    factor: float = 0.2


@dataclass(frozen=True)
class Foot:
    """A section over its width: round, hexagonal, or a square or cross with arms so wide; the width of the tip over that of the
    foot.
    """

    round: bool = False
    arm: float = 1.0
    taper: float = 1.0
    hexagonal: bool = False

    @property
    def is_alike(self) -> bool:
        """Whether the section is its own image with x and y exchanged."""
        return not self.hexagonal

    @property
    def footprint(self) -> float:
        """Largest extent of the foot over its width: a hexagon's is across corners, along x."""
        return float(CORNERS) if self.hexagonal else 1.0

    @property
    def reach(self) -> float:
        """Width of the block that grows with the pillar, over the pillar's."""
        return BLOCK * self.footprint if self.round or self.hexagonal else 1.0

    @property
    def widest(self) -> float:
        """Largest extent at any height over the width of the foot."""
        return max(1.0, self.taper) * self.footprint


SQUARE = Foot()


def foot_of(pillar: Pillar) -> Foot | None:
    """The section of a pillar that grows with its width; None for one that does not."""
    if not pillar.is_plain:
        return None
    known = {
        "square": Foot(),
        "tapered": Foot(taper=pillar.form.taper),
        "cross": Foot(arm=pillar.form.size_m("arm_m") / pillar.base_m),
        "round": Foot(round=True),
        "hexagonal": Foot(hexagonal=True),
    }
    return known.get(pillar.shape)


def quarter_mesh(
    foot: Foot, sizes: tuple[float, float, float, float], mesh: FixedMesh, panel: tuple[float, float] = (1.0, 1.0)
) -> tuple[Mesh, IntArray]:
    """The quarter panel x, y >= 0, z = 0 the touch face, of thickness, height, width and pitch in m, the panel's sides in
    pitches; for each element which stretch acts along x, y and z, (e, 3).
    """
    t, h, _, _ = sizes
    z = np.concatenate(
        [_part(0.0, t, mesh.through, (False, True), mesh), _part(t, t + h, mesh.along, (True, False), mesh)[1:]]
    )
    patches = list(_plan(foot, sizes, panel, mesh))
    own = leaning(joined(patches, z, t, mesh.order).mesh, np.zeros(2), t, h, foot.taper)
    return own, _stretched(patches, z, t)


def _plan(
    foot: Foot, sizes: tuple[float, float, float, float], panel: tuple[float, float], mesh: FixedMesh
) -> Iterator[Patch]:
    _, _, a, p = sizes
    block = foot.reach * a / 2.0
    along, across = (_part(block, side * p / 2.0, mesh.beside, (True, False), mesh) for side in panel)
    if not foot.round and not foot.hexagonal:
        return _bars(foot, a, (along, across), mesh)
    inner = _part(0.0, 1.0, 1 if foot.round else mesh.under, (False, True), mesh)
    fill = _part(0.0, 1.0, 1, (True, False), mesh, less=1)
    lines = PlanLines(np.linspace(0.0, 1.0, mesh.under + 1), inner, fill, (along, across))
    return (disc if foot.round else hexagon)(a / 2.0, (block, block), lines)


def _part(low: float, high: float, count: int, ends: tuple[bool, bool], mesh: FixedMesh, less: int = 0) -> FloatArray:
    layers = max(mesh.layers - less, 0)
    return grid_lines({low: ends[0], high: ends[1]}, Grading((high - low) / count, layers, mesh.factor))


def _bars(foot: Foot, a: float, around: tuple[FloatArray, FloatArray], mesh: FixedMesh) -> Iterator[Patch]:
    """Square or cross of width a: lines along the axes."""
    edges = [0.0, foot.arm * a / 2.0, a / 2.0] if foot.arm < 1.0 else [0.0, a / 2.0]
    inner = [_part(low, high, mesh.under, (low > 0.0, True), mesh) for low, high in pairwise(edges)]
    under = np.concatenate([[0.0], *(one[1:] for one in inner)])
    middle = (under[1:] + under[:-1]) / 2.0 < foot.arm * a / 2.0
    yield Patch(under, under, straight, (middle[:, None] | middle).astype(float))
    yield from beside(under, under, around)


def _stretched(patches: list[Patch], z: FloatArray, thickness: float) -> IntArray:
    """For each element the numbers of the stretches along x, y and z."""
    rows = []
    for patch in patches:
        region = boxes_of_patch(patch, z, thickness).region.transpose(2, 1, 0)  # elements come x fastest
        own = region[region >= 0]
        x, y = (UNDER if block else BESIDE for block in patch.block)
        rows.append(np.column_stack([np.full(len(own), x), np.full(len(own), y), own]))
    return np.concatenate(rows)
