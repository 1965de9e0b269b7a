"""Where the piezo patches stand on the plate: boxes only, no CAD."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from geometry.elements import FloatArray
from geometry.piezo_materials import PiezoMaterial

SAME_M = 1e-9  # places that agree to a nanometre are the same


@dataclass(frozen=True)
class Patches:
    """The bonded patches. Lengths in m; centres from the plate's centre; lengths_m along x, one per patch.

    at = "antinodes": numbered along x over the N + 1 antinodes of the shape with N nodal lines, free ends included; the
    two end patches are cut to what is left beyond their neighbours. sensors: the numbers that listen.
    """

    material: PiezoMaterial
    size_m: tuple[float, float, float]
    face: Literal["back", "touch"]
    at: Literal["antinodes", "centres"]
    centres_m: tuple[tuple[float, float], ...]
    lengths_m: tuple[float, ...]
    sensors: tuple[int, ...]
    drive_v: float
    circuit: Literal["short", "open"] = "short"  # of those that drive: a voltage holds them, or a charge

    @property
    def count(self) -> int:
        """Number of patches."""
        return len(self.centres_m)

    @property
    def drivers(self) -> tuple[int, ...]:
        """The numbers of the patches that drive."""
        return tuple(i for i in range(self.count) if i not in self.sensors)

    def boxes_m(self) -> FloatArray:
        """Footprints x0, x1, y0, y1, shape (patches, 4), m."""
        x, y = np.array(self.centres_m).reshape(-1, 2).T
        half_x, half_y = np.array(self.lengths_m) / 2.0, self.size_m[1] / 2.0
        return np.column_stack([x - half_x, x + half_x, y - half_y, y + half_y])

    def z_range_m(self, thickness_m: float) -> tuple[float, float]:
        """The patches' extent along z on a plate of this thickness, m."""
        return (thickness_m, thickness_m + self.size_m[2]) if self.face == "back" else (-self.size_m[2], 0.0)


def mirrored_axes(boxes_m: FloatArray) -> tuple[bool, bool]:
    """Along x and y: whether footprints (n, 4) as boxes_m gives them are together their own mirror image."""
    axes = []
    for axis in (0, 1):
        image = boxes_m.copy()
        image[:, 2 * axis], image[:, 2 * axis + 1] = -boxes_m[:, 2 * axis + 1], -boxes_m[:, 2 * axis]
        apart = np.abs(boxes_m[:, None] - image[None]).max(axis=2)
        axes.append(bool((apart.min(axis=1) < SAME_M).all()))
    return axes[0], axes[1]


def antinode_places(
    inner_m: tuple[float, ...], length_m: float, size_m: tuple[float, float, float], ends: bool
) -> tuple[tuple[tuple[float, float], ...], tuple[float, ...]]:
    """Centres (x, 0) and lengths along x of patches on the antinodes of a strip of this length, m.

    inner_m: the inner antinodes from the strip's centre, ascending. With ends, one patch more at each free end, flush
    with it, at most as long as the others and one patch thickness away from its neighbour.
    """
    size = size_m[0]
    places = [(x, size) for x in inner_m]
    if ends:
        room = length_m / 2.0 - (max(inner_m) + size / 2.0 + size_m[2] if inner_m else 0.0)
        cut = min(size, room)
        end = (length_m - cut) / 2.0
        places = [(-end, cut), *places, (end, cut)]
    return tuple((x, 0.0) for x, _ in places), tuple(length for _, length in places)
