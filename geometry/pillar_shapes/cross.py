"""A pillar whose section is a cross."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

import numpy as np
from numpy.polynomial.polynomial import polyval

from geometry.pillar_shapes.base import MM, FloatArray, PillarShape

# Saint-Venant's flexure of crosses solved on graded triangles for arms of 0.01 to 1 times the width, as polynomials of that
# ratio; tests/geometry/test_pillar_shapes.py solves it again
P = (2.4001, -2.4543, -4.3225, 14.3765, -9.967, -1.5695, 3.4709, -0.7342)
Q = (2.701, -2.6734, -4.5463, 1.8769, 30.9222, -53.5845, 34.4635, -8.0593)


class Cross(PillarShape):
    """A prism of two crossed bars along x and y: `width_m` overall, arms `arm_m` wide."""

    name = "cross"
    keys = ("side_mm", "arm_mm")

    @classmethod
    def size_violations(cls, given: Mapping[str, float]) -> Iterator[tuple[str, str]]:
        """Arms narrower than the whole; a foot fillet that ends within the notch between two arms."""
        side, arm, fillet = given.get("side_mm"), given.get("arm_mm"), given.get("fillet_mm")
        if side is None or arm is None:
            return
        if arm >= side:
            yield "arm_mm", f"must be smaller than the pillar's overall width, side_mm = {side:g}"
        elif fillet and fillet >= (side - arm) / 2.0:
            notch = f"{(side - arm) / 2.0:g}, the depth of the notch between two arms"
            yield "fillet_mm", f"must be smaller than {notch}, (side_mm - arm_mm)/2"

    @property
    def arm_m(self) -> float:
        """Width of an arm, m."""
        return self.size_m("arm_m")

    def outline(self, grow_m: float = 0.0) -> FloatArray:
        """Its twelve corners."""
        a, b = self.arm_m / 2.0 + grow_m, self.width_m / 2.0 + grow_m
        quarter = np.array([[b, a], [a, a], [a, b]])
        turn = np.array([[0.0, 1.0], [-1.0, 0.0]])  # a quarter turn of rows
        return np.vstack([quarter @ np.linalg.matrix_power(turn, count) for count in range(4)])

    def shear_factor(self, poisson: float) -> float:
        """(1 + nu)/(P + Q nu) with polynomials of arm over width, to 3e-4. Source: cowper1966."""
        ratio = self.arm_m / self.width_m
        return float((1.0 + poisson) / (polyval(ratio, P) + polyval(ratio, Q) * poisson))

    @property
    def rectangles(self) -> FloatArray | None:
        """The bar along x and the bar along y."""
        a, b = self.arm_m / 2.0, self.width_m / 2.0
        return np.array([[-b, b, -a, a], [-a, a, -b, b]])

    @property
    def features(self) -> dict[str, float]:
        """The arms, too."""
        return super().features | {"pillar arm": self.arm_m}

    @property
    def sizes_text(self) -> str:
        """Width and arms."""
        return f"{super().sizes_text} with arms of {self.arm_m / MM:g} mm"
