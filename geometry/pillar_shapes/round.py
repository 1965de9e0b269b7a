"""A round pillar."""

from __future__ import annotations

from math import pi
from typing import Any

import numpy as np

from geometry.pillar_shapes.base import MM, FloatArray, PillarShape, Section

DRAWN, RIM = 48, 16  # corners of the polygons that stand for the circle in drawings and for the sizing of meshes


class Round(PillarShape):
    """A cylinder of diameter `width_m`."""

    name = "round"
    keys = ("diameter_mm",)
    plan = "disc"

    def outline(self, grow_m: float = 0.0) -> FloatArray:
        """A polygon in the circle, with corners on both axes."""
        return self._polygon(DRAWN, self.width_m / 2.0 + grow_m)

    def rim(self) -> FloatArray:
        """A coarser polygon."""
        return self._polygon(RIM, self.width_m / 2.0)

    def shear_factor(self, poisson: float) -> float:
        """6 (1 + nu)/(7 + 6 nu). Source: cowper1966."""
        return 6.0 * (1.0 + poisson) / (7.0 + 6.0 * poisson)

    @property
    def section(self) -> Section:
        """The circle, not its polygon."""
        about = pi * self.width_m**4 / 64.0
        return Section(pi * self.width_m**2 / 4.0, about, about)

    def solid(self, height_m: float) -> Any:
        """A cylinder."""
        import cadquery as cq

        return cq.Solid.makeCylinder(self.width_m / MM / 2.0, height_m / MM)

    @staticmethod
    def _polygon(count: int, radius_m: float) -> FloatArray:
        angle = 2.0 * pi * np.arange(count) / count
        return radius_m * np.column_stack([np.cos(angle), np.sin(angle)])
