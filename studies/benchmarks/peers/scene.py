"""The four parts as every program takes them: bodies, faces held in a symmetry class, and the modes sought."""

from __future__ import annotations

import resource
from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np

from geometry.elements import FloatArray
from geometry.hex.boxes import Boxes, boxes_of
from geometry.hex.scenes import HexSettings, Scene, cell_scene, pillar_scene, plate_scene, zone_scene
from solvers.measures.confinement import target_shape
from studies import ladder

AXES = "xyz"
WAVEVECTORS = 76  # of a path G-X-M-G with 25 points per segment
CORNERS = ((0.0, 0.0), (0.5, 0.0), (0.5, 0.5))  # G, X and M, in periods per pitch
BETWEEN = (0.3, 0.2)  # a wavevector without symmetry, whose time stands for all


@dataclass(frozen=True)
class Part:
    """Modes sought of a part: symmetry classes, number in each, frequency around which they lie, and clamped faces."""

    title: str
    classes: tuple[str, ...]
    count: int
    near_hz: float
    clamped: tuple[str, ...] = ()


PARTS = {
    "zone": Part("Zone between clamped sides, first 14 modes", ("SS", "SA", "AS", "AA"), 8, 0.0, ("y+",)),
    "pillar": Part("Isolated pillar, first three bending modes", ("AS",), 3, 0.0, ("touch",)),
    "cell": Part("Unit cell, ten bands at G, X and M", ("",), 10, 0.0),
    "plate": Part("Plate of one row and 5 mm, target mode", ("SS",), 12, 34.6e3),
}
KEPT = {"zone": 14, "pillar": 3}  # frequencies compared of all classes together


def scene(part: str, settings: HexSettings) -> Scene:
    """The quarter x, y >= 0 of a part; the whole cell."""
    d = ladder.plate_design() if part == "plate" else ladder.design()
    if part == "pillar":
        assert d.pillar
        return pillar_scene(d.pillar, settings)
    return {"zone": zone_scene, "cell": cell_scene, "plate": plate_scene}[part](d, settings)


def boxes(part: str, settings: HexSettings) -> Boxes:
    """A part's boxes, meshed."""
    return boxes_of(scene(part, settings))


@cache
def bodies(part: str) -> list[list[float]]:
    """The boxes a part is made of, each x0, x1, y0, y1, z0, z1 in m, the lowest body first."""
    blocks = scene(part, HexSettings())
    x, y = (min(blocks.x), max(blocks.x)), (min(blocks.y), max(blocks.y))
    boxes = [[*x, *y, min(blocks.z), max(blocks.z)]]
    for foot in blocks.feet:
        for cx, cy in foot.centres.tolist():
            for x0, x1, y0, y1 in foot.rectangles.tolist():
                across = [max(cx + x0, x[0]), min(cx + x1, x[1]), max(cy + y0, y[0]), min(cy + y1, y[1])]
                boxes.append([*across, foot.bottom_m, foot.top_m])
    return boxes


def clamped_axes(part: str, symmetry: str) -> dict[str, list[int]]:
    """Components that vanish, by face: of a class S the normal one on its mirror, of A both others."""
    mirrors = {
        f"{axis}-": [i for i in range(3) if (i == AXES.index(axis)) == (sign == "S")]
        for axis, sign in zip(AXES, symmetry, strict=False)
    }
    return mirrors | {face: [0, 1, 2] for face in PARTS[part].clamped}


def task(part: str, settings: dict[str, Any]) -> dict[str, Any]:
    """Complete description of a part for a program, ready for JSON."""
    given, material = PARTS[part], ladder.design().material
    return {
        "part": part,
        "settings": settings,
        "bodies": bodies(part),
        "classes": [clamped_axes(part, symmetry) for symmetry in given.classes],
        "count": given.count,
        "near_hz": given.near_hz,
        "probe": probe() if part == "plate" else None,
        "young_pa": material.as_isotropic.young_pa,
        "poisson": material.as_isotropic.poisson,
        "density_kg_m3": material.density_kg_m3,
        "pitch_m": ladder.design().pitch_x_m,
        "corners": CORNERS,
        "between": BETWEEN,
        "wavevectors": WAVEVECTORS,
    }


def probe() -> dict[str, list[Any]]:
    """Points of the touch face's active quarter, m, and the target shape there."""
    d = ladder.plate_design()
    middles = [(np.arange(count) + 0.5) / count * half for count, half in ((48, d.length_m / 2), (8, d.width_m / 2))]
    points: FloatArray = np.stack(np.meshgrid(*middles, indexing="ij"), axis=-1).reshape(-1, 2)
    return {"points": points.tolist(), "shape": target_shape(d, points).tolist()}


def seconds() -> float:
    """Processor time of this process and of those it waited for, s."""
    used = (resource.getrusage(who) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN))
    return sum(each.ru_utime + each.ru_stime for each in used)


def merged(classes: list[list[float]], kept: int | None) -> list[float]:
    """The lowest frequencies of all classes, or those of a single class. RuntimeError if a class returned too few."""
    together = sorted(frequency for values in classes for frequency in values)[:kept]
    if len(classes) > 1 and together[-1] >= min(max(values) for values in classes):
        raise RuntimeError("too few modes were requested of a symmetry class")
    return together
