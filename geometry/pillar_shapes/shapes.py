"""The pillar shapes given by formulas, and the registry of all shapes: a new one is a class and a line there."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from math import pi
from pathlib import Path
from typing import Any, Self

import numpy as np
from numpy.polynomial.polynomial import polyval

from geometry.elements import FloatArray
from geometry.errors import GeometryError
from geometry.pillar_shapes.base import MM, PillarShape, Section, Square
from geometry.pillar_shapes.step import Step

# -- round -------------------------------------------------------------------------------------------------------------

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


# -- hexagonal ---------------------------------------------------------------------------------------------------------

# Saint-Venant's flexure of a regular hexagon solved on triangles; tests/geometry/test_pillar_shapes.py solves it again
HEXAGON_P, HEXAGON_Q = 1.17367, 1.02248


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
        return (1.0 + poisson) / (HEXAGON_P + HEXAGON_Q * poisson)


# -- cross -------------------------------------------------------------------------------------------------------------

# Saint-Venant's flexure of crosses solved on graded triangles for arms of 0.01 to 1 times the width, as polynomials of that
# ratio; tests/geometry/test_pillar_shapes.py solves it again
CROSS_P = (2.4001, -2.4543, -4.3225, 14.3765, -9.967, -1.5695, 3.4709, -0.7342)
CROSS_Q = (2.701, -2.6734, -4.5463, 1.8769, 30.9222, -53.5845, 34.4635, -8.0593)


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
        return float((1.0 + poisson) / (polyval(ratio, CROSS_P) + polyval(ratio, CROSS_Q) * poisson))

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


# -- tapered -----------------------------------------------------------------------------------------------------------


class Tapered(Square):
    """A square frustum: side `width_m` at the foot, `tip_m` at the tip."""

    name = "tapered"
    keys = ("base_mm", "tip_mm")
    plan = "rectangle"

    @classmethod
    def from_case(cls, given: Mapping[str, Any], folder: Path) -> Self:
        """The frustum from both of its sides."""
        return cls(MM * given["base_mm"], MM * given["tip_mm"])

    @property
    def rectangles(self) -> FloatArray | None:
        """None: its sides lean."""
        return None

    def solid(self, height_m: float) -> Any:
        """A ruled loft between the two squares, a box where they are alike."""
        import cadquery as cq

        base, tip = self.width_m / MM, self.tip_m / MM
        if base == tip:
            return super().solid(height_m)
        return cq.Workplane().rect(base, base).workplane(offset=height_m / MM).rect(tip, tip).loft(ruled=True).val()


# -- registry ----------------------------------------------------------------------------------------------------------
# The pillar shapes that there are: a new one is a class above and a name here.

SHAPES: dict[str, type[PillarShape]] = {}


def register(*shapes: type[PillarShape]) -> None:
    """Make shapes known by their names, before a case file is read."""
    SHAPES.update({shape.name: shape for shape in shapes})


register(Square, Round, Tapered, Hexagonal, Cross, Step)


def shape_of(name: str, width_m: float, tip_m: float, more: Any = (), file: str | None = None) -> PillarShape:
    """The shape of a name with its sizes in m. GeometryError for an unknown name."""
    if name not in SHAPES:
        raise GeometryError(f"pillar shape '{name}' is not one of {', '.join(SHAPES)}")
    return SHAPES[name](width_m, tip_m, tuple(more), file)


def stored_shape(record: Mapping[str, Any]) -> PillarShape:
    """The shape of a pillar as records describe it: shape, base_m, tip_m and its further sizes by name."""
    more = tuple((name, size) for name, size in record.items() if isinstance(size, float))
    return shape_of(record["shape"], record["base_m"], record["tip_m"], more)


def in_words(names: Mapping[str, Any] | None = None) -> str:
    """Shapes as a message lists them: square, round or step."""
    *first, last = names or SHAPES
    return f"{', '.join(first)} or {last}" if first else last
