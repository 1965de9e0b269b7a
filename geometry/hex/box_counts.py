"""Sizes of a mesh of boxes, told from its breakpoints: nothing is meshed, and a mesh too large to make is counted too."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from itertools import combinations

import numpy as np

from geometry.elements import FloatArray
from geometry.hex.boxes import Foot, Scene
from geometry.hex.grading import Grading, interval_count

SAME = 1e-9  # of a breakpoints' span


@dataclass(frozen=True)
class Block:
    """Boxes alike but for their counts: elements along x and y, one entry a column and a row of them, and along z.

    A union of rectangles is counted by inclusion and exclusion: what several share has the sign -1, +1 in turn. A block that
    `stands` on another shares its lowest nodes.
    """

    x: tuple[int, ...]
    y: tuple[int, ...]
    z: int
    stands: bool = False
    sign: int = 1

    def total(self, along: Callable[[int], int]) -> int:
        """A figure that is a product over the axes, less what the feet share with what they stand on."""
        return self.sign * sum(map(along, self.x)) * sum(map(along, self.y)) * (along(self.z) - self.stands)


@dataclass(frozen=True)
class BoxCounts:
    """Blocks of hexahedra of an order, and what follows: exact."""

    order: int
    blocks: tuple[Block, ...]

    @property
    def elements(self) -> int:
        """Hexahedra."""
        return sum(block.sign * sum(block.x) * sum(block.y) * block.z for block in self.blocks)

    @property
    def nodes(self) -> int:
        """Nodes."""
        return sum(block.total(lambda count: self.order * count + 1) for block in self.blocks)

    @property
    def pairs(self) -> int:
        """Ordered pairs of nodes that share an element: entries of the scalar mass, a ninth of the stiffness's."""
        return sum(block.total(lambda count: count * (self.order + 1) ** 2 - (count - 1)) for block in self.blocks)


def box_counts(scene: Scene, order: int) -> BoxCounts:
    """Sizes of `hex_mesh(boxes_of(scene), order)`."""
    up = interval_count(scene.z, scene.through)
    if scene.body is None:
        whole = (interval_count(scene.x, scene.across),), (interval_count(scene.y, scene.across),)
        blocks = [Block(*whole, up)]
    else:
        blocks = [_block(scene, np.zeros((1, 2)), part, up, False, sign) for sign, part in _union(scene.body)]
    if scene.above is not None and scene.along is not None:
        for foot in scene.feet:
            span = {z: graded for z, graded in scene.above.items() if foot.bottom_m <= z <= foot.top_m}
            up, alone = interval_count(span, scene.along), foot.below is None
            own = [_block(scene, foot.centres, part, up, alone, sign) for sign, part in _union(foot.rectangles)]
            own += [_block(scene, foot.centres, part, 0, False, -sign) for sign, part in _shared(foot)]
            blocks += own * scene.faces
    return BoxCounts(order, tuple(blocks))


def _shared(foot: Foot) -> Iterator[tuple[int, FloatArray]]:
    """Signs and rectangles of the faces that prisms share with others that they stand on."""
    for sign, part in _union(foot.rectangles):
        for other, below in _union(np.empty((0, 4)) if foot.below is None else foot.below):
            x0, y0 = np.maximum(part[::2], below[::2])
            x1, y1 = np.minimum(part[1::2], below[1::2])
            if x0 < x1 and y0 < y1:
                yield sign * other, np.array([x0, x1, y0, y1])


def _union(rectangles: FloatArray) -> Iterator[tuple[int, FloatArray]]:
    """Signs and rectangles whose signed sum covers the union of rectangles (r, 4) once."""
    for count in range(1, len(rectangles) + 1):
        for members in combinations(rectangles, count):
            shared = np.array(members)
            x0, x1, y0, y1 = shared[:, 0].max(), shared[:, 1].min(), shared[:, 2].max(), shared[:, 3].min()
            if x0 <= x1 and y0 <= y1:
                yield (-1) ** (count + 1), np.array([x0, x1, y0, y1])


def _block(scene: Scene, centres: FloatArray, part: FloatArray, up: int, stands: bool, sign: int) -> Block:
    x = _counts(scene.x, centres[:, 0], part[:2], scene.across)
    return Block(x, _counts(scene.y, centres[:, 1], part[2:], scene.across), up, stands, sign)


def _counts(breaks: dict[float, bool], centres: FloatArray, side: FloatArray, grading: Grading) -> tuple[int, ...]:
    """Elements that a side about each column of centres takes along one axis; a mirror or the plate's edge may cut it."""
    low, high = min(breaks), max(breaks)
    slack = SAME * (high - low)
    counts = []
    for centre in sorted(set(centres.tolist())):
        start, end = max(low, centre + side[0]) - slack, min(high, centre + side[1]) + slack
        within = {place: graded for place, graded in breaks.items() if start <= place <= end}
        if within:
            counts.append(interval_count(within, grading))
    return tuple(counts)
