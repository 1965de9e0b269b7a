"""A square pillar."""

from __future__ import annotations

from typing import ClassVar

import numpy as np

from geometry.pillar_shapes.base import FloatArray, PillarShape

CORNERS = np.array([[1.0, 1.0], [-1.0, 1.0], [-1.0, -1.0], [1.0, -1.0]])


class Square(PillarShape):
    """A square prism of side `width_m`, its sides along x and y."""

    name = "square"
    keys: ClassVar[tuple[str, ...]] = ("side_mm",)

    def outline(self, grow_m: float = 0.0) -> FloatArray:
        """Its four corners."""
        return CORNERS * (self.width_m / 2.0 + grow_m)

    def shear_factor(self, poisson: float) -> float:
        """10 (1 + nu)/(12 + 11 nu). Source: cowper1966."""
        return 10.0 * (1.0 + poisson) / (12.0 + 11.0 * poisson)

    @property
    def rectangles(self) -> FloatArray | None:
        """The square itself."""
        half = self.width_m / 2.0
        return np.array([[-half, half, -half, half]])
