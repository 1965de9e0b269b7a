"""A hexagonal pillar."""

from __future__ import annotations

import numpy as np

from geometry.pillar_shapes.base import FloatArray, PillarShape

# Saint-Venant's flexure of a regular hexagon solved on triangles; tests/geometry/test_pillar_shapes.py solves it again
P, Q = 1.17367, 1.02248


class Hexagonal(PillarShape):
    """A regular hexagonal prism, `width_m` across flats. Two flats face y (along the zone), two corners lie on the x axis.

    Across corners it is 2/sqrt(3) times as wide. It is its own mirror image in x and in y, but not with x and y exchanged.
    """

    name = "hexagonal"
    keys = ("side_mm",)
    plan = "hexagon"

    def outline(self, grow_m: float = 0.0) -> FloatArray:
        """Its six corners."""
        half = self.width_m / 2.0 + grow_m
        corner = 2.0 * half / np.sqrt(3.0)
        return np.array(
            [[corner, 0.0], [corner / 2.0, half], [-corner / 2.0, half], [-corner, 0.0], [-corner / 2.0, -half],
             [corner / 2.0, -half]]
        )  # fmt: skip

    def shear_factor(self, poisson: float) -> float:
        """(1 + nu)/(P + Q nu), to 1e-5: between a square's and a circle's, alike in every direction. Source: cowper1966."""
        return (1.0 + poisson) / (P + Q * poisson)
