"""What the rest of the project asks of a pillar's shape; most answers follow from the outline of its foot."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar, Self

import numpy as np

from geometry.elements import FloatArray
from geometry.lattice import MIRRORS

MM = 1e-3  # m
SAME = 1e-9  # of the width: points closer than this are one


@dataclass(frozen=True)
class Section:
    """A plane section: area (m2) and second moments about the x and the y axis through its centroid (m4)."""

    area_m2: float
    about_x_m4: float
    about_y_m4: float


@dataclass(frozen=True)
class PillarShape:
    """A pillar's shape with its sizes in m: width of the foot, of the tip, further sizes by name, the CAD file if any.

    Centred on the z axis, foot on z = 0. `keys` are those of the case file's [pillar] beside height_mm, all of them
    required, the foot's width first. A shape says its outline and its shear factor; it overrides what does not follow.
    """

    width_m: float
    tip_m: float
    more_m: tuple[tuple[str, float], ...] = ()
    file: str | None = None

    name: ClassVar[str]
    keys: ClassVar[tuple[str, ...]]
    has_height: ClassVar[bool] = True  # given by height_mm; otherwise the shape knows it
    can_have_fillet: ClassVar[bool] = True
    sizing_note: ClassVar[str] = ""  # what beam theory overlooks
    plan: ClassVar[str] = ""  # how hexahedra follow a foot that boxes cannot: geometry/hex/panels.py

    @classmethod
    def from_case(cls, given: Mapping[str, Any], folder: Path) -> Self:
        """The shape from its keys of the case file, lengths in mm; files are looked for from `folder`. GeometryError."""
        more = tuple((f"{key.removesuffix('_mm')}_m", MM * given[key]) for key in cls.keys[1:])
        return cls(MM * given[cls.keys[0]], MM * given[cls.keys[0]], more)

    @classmethod
    def size_violations(cls, given: Mapping[str, float]) -> Iterator[tuple[str, str]]:
        """Sizes in mm (those that are known, fillet_mm too) that do not go together: the key at fault and what is allowed."""
        yield from ()

    def size_m(self, name: str) -> float:
        """A further size by its name, such as arm_m; NaN where it is not known."""
        return dict(self.more_m).get(name, float("nan"))

    def height_m(self, given_m: float) -> float:
        """The height, m: the one that the case gives, for all but shapes that bring their own."""
        return given_m

    def outline(self, grow_m: float = 0.0) -> FloatArray:
        """Corners of the foot anticlockwise, (n, 2) m, every side moved outwards by `grow_m`."""
        raise NotImplementedError

    def shear_factor(self, poisson: float) -> float:
        """Timoshenko's shear factor of the section."""
        raise NotImplementedError

    @property
    def rectangles(self) -> FloatArray | None:
        """Foot of a straight pillar as a union of rectangles x0, x1, y0, y1, (n, 4) m; None where boxes cannot make it."""
        return None

    @property
    def is_square_prism(self) -> bool:
        """True when the pillar is a single box on a square foot of its width."""
        half = self.width_m / 2.0
        return self.rectangles is not None and self.rectangles.tolist() == [[-half, half, -half, half]]

    @property
    def grows(self) -> bool:
        """True when a wider pillar is the same shape with all its widths in proportion, and hexahedra follow it."""
        return self.rectangles is not None or bool(self.plan)

    @property
    def mirrors(self) -> tuple[str, ...]:
        """Mirrors of the pillar: "x" (x -> -x), "y", and "d", which exchanges x and y; told from the outline."""
        corners = self.outline()
        points = np.vstack([corners, (corners + np.roll(corners, 1, axis=0)) / 2.0])
        return tuple(name for name, mirror in MIRRORS.items() if _alike(points, points @ mirror))

    @property
    def section(self) -> Section:
        """The foot's section without fillet, from Green's theorem on its outline."""
        (x, y), (nx, ny) = self.outline().T, np.roll(self.outline(), -1, axis=0).T
        cross = x * ny - nx * y
        about_x, about_y = (float(cross @ (a * a + a * b + b * b)) / 12.0 for a, b in ((y, ny), (x, nx)))
        return Section(float(cross.sum()) / 2.0, about_x, about_y)

    def extent_m(self, fillet_m: float = 0.0) -> tuple[float, float]:
        """How far the foot extends along x and y, fillet included (its flares meet in mitres), m."""
        x, y = np.ptp(self.outline(fillet_m), axis=0)
        return float(x), float(y)

    def reach_m(self, fillet_m: float = 0.0) -> tuple[float, float]:
        """How far the pillar extends along x and y at any height, fillet included, m."""
        (x, y), (foot_x, foot_y) = self.extent_m(), self.extent_m(fillet_m)
        return max(foot_x, self.taper * x), max(foot_y, self.taper * y)

    def footprint_m(self, fillet_m: float) -> float:
        """Largest extent of the foot, fillet included, m."""
        return max(self.extent_m(fillet_m))

    @property
    def features(self) -> dict[str, float]:
        """Lengths in plan that a printer must resolve and a mesh must follow, m."""
        return {"pillar foot": self.width_m} | ({"pillar tip": self.tip_m} if self.tip_m > 0.0 else {})

    @property
    def smallest_m(self) -> float:
        """The smallest of them, m."""
        return min(self.features.values())

    @property
    def sizes_text(self) -> str:
        """Its sizes in plan, for a caption."""
        return f"{self.width_m / MM:g} mm wide"

    @property
    def taper(self) -> float:
        """Width of the section at the tip over that at the foot, changing linearly between."""
        return self.tip_m / self.width_m

    def volume_m3(self, height_m: float) -> float:
        """Volume without fillet, m3."""
        ratio = self.taper
        return self.section.area_m2 * height_m * (1.0 + ratio + ratio**2) / 3.0

    def rim(self) -> FloatArray:
        """The foot's edge as a closed polygon, (n, 2) m: re-entrant where the pillar stands on a plate."""
        return self.outline()

    def solid(self, height_m: float) -> Any:
        """The CAD solid without fillet (cadquery, mm): the outline pulled up. GeometryError where it cannot be built."""
        import cadquery as cq

        corners = [(float(x), float(y)) for x, y in self.outline() / MM]
        return cq.Workplane().polyline(corners).close().extrude(height_m / MM).val()


def _alike(points: FloatArray, images: FloatArray) -> bool:
    """Whether every image falls on a point."""
    gaps = np.abs(points[:, None, :] - images[None, :, :]).max(axis=2).min(axis=0)
    return bool(gaps.max() <= SAME * np.abs(points).max())


# -- square ------------------------------------------------------------------------------------------------------------
# A square pillar.

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
