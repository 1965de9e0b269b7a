"""A coarse mesh of the unit cell: how high the bands reach that a case asks for.

One element of order 3 through the plate, the pillar a box as wide as its foot. A coarse mesh's frequencies lie above those of
finer ones, so that no band asked for lies above what is found here.
"""

from __future__ import annotations

from dataclasses import replace
from functools import cached_property, lru_cache
from math import ceil, sqrt
from typing import TYPE_CHECKING

from geometry.hex.boxes import cell_boxes, hex_mesh
from geometry.hex.panels import square_of
from geometry.hex.scenes import HexSettings
from geometry.layout import Design, region_materials

if TYPE_CHECKING:
    from solvers.fem.assembly import System
    from solvers.fem.eigen import PlainPencil

ORDER = 3
STEP = 1.2  # factor within which the highest band is found
MANY = 4  # elements of a plate thin compared with its pitch, along the longer pitch
SLENDER = 4.0  # widths of a foot that an element along the pillar is long at least
FEW = 25  # bands that one element of a stub holds
RESOLVED = 1.0 / 16.0  # of the coarse cell's degrees of freedom: more modes are too short for its elements
HALF_WAVES = 3.0  # bands for each half-wave along a pillar: two bending modes, one of torsion or longitudinal


def coarse_settings(design: Design, count: int, through: int = 1) -> HexSettings:
    """Elements of the coarse cell for its lowest bands, each of a slender pillar at most a half-wave long."""
    size_m, pillar, parts = 2.0 * design.thickness_m, design.pillar, ceil(sqrt(count / FEW))
    if pillar is None:
        return HexSettings(ORDER, size_m, 0, through=through)
    size_m = min(size_m, pillar.base_m / parts) if parts > 1 else size_m
    along = min(pillar.height_m / parts, max(SLENDER * pillar.base_m, HALF_WAVES * pillar.height_m / count))
    return HexSettings(ORDER, size_m, 0, pillar_size_m=along, through=through)


@lru_cache(maxsize=64)
def coarse_cell(design: Design, count: int) -> CoarseCell:
    """The coarse cell of a design for its lowest bands."""
    return CoarseCell(design, count)


class CoarseCell:
    """A coarse mesh of a design's unit cell, solved for its `count` lowest bands."""

    def __init__(self, design: Design, count: int) -> None:
        box = square_of(design.pillar) if design.pillar else None
        self.design, self.count = replace(design, pillar=box), count
        self._ends_hz: dict[float, float] = {}
        self._fixed: dict[float, int] = {}

    @cached_property
    def _system(self) -> System:
        from solvers.fem.assembly import assemble  # slow to import, and plans that ask for no bands need none

        settings = coarse_settings(self.design, self.count)
        settings = replace(settings, size_m=max(settings.size_m, max(self.design.lattice.cell_m) / MANY))
        mesh = hex_mesh(cell_boxes(self.design, settings), settings.order)
        return assemble(mesh, region_materials(self.design.stack, self.design.pillar))

    @cached_property
    def _waves(self) -> PlainPencil:
        """K and M at the zone's corner, where all phases are real and every band counts once."""
        from solvers.waves.bloch import BlochCell

        lattice = self.design.lattice
        return BlochCell(self._system, lattice).pencil(lattice.reciprocal_per_m.sum(axis=0) / 2.0)[0]

    def bands_end_hz(self, below_hz: float) -> float:
        """Frequency, Hz, below which the bands asked for end at the zone's corner, within STEP; at most below_hz.

        By bisection of inertia counts, from a guess by a count that goes as the frequency squared.
        """
        if below_hz not in self._ends_hz:
            found = next((end for below, end in self._ends_hz.items() if end < below), None)
            self._ends_hz[below_hz] = self._bisected_hz(below_hz) if found is None else min(found, below_hz)
        return self._ends_hz[below_hz]

    def resolves(self, modes: float) -> bool:
        """Whether the elements follow so many modes."""
        return modes <= RESOLVED * self._system.mesh.dof

    def fixed_modes(self, below_hz: float) -> int:
        """Modes below a frequency, Hz, of the cell with its four sides held."""
        if below_hz not in self._fixed:
            from solvers.fem.eigen import count_below
            from solvers.fem.solid import constrain, free_mask

            sides = free_mask(self._system.mesh, ("x-", "x+", "y-", "y+"), {})
            self._fixed[below_hz] = count_below(constrain(self._system, sides), below_hz)
        return self._fixed[below_hz]

    def _bisected_hz(self, below_hz: float) -> float:
        from solvers.fem.eigen import count_below
        from solvers.fem.factor import Factoriser

        factorise = Factoriser()  # one symbolic analysis for all counts
        low, high, found = 0.0, below_hz, count_below(self._waves, below_hz, factorise)
        while found >= self.count and high > STEP * low:
            middle = sqrt(low * high) if low else high * sqrt(self.count / found) / STEP
            number = count_below(self._waves, middle, factorise)
            if number >= self.count:
                high, found = middle, number
            else:
                low = middle
        return high
