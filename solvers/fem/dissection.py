"""What a nested dissection of a regular grid leads to: entries of the factor and operations, without a matrix (george1973).

A box of elements is cut in halves by a plane of nodes until one element is left. Eliminating m degrees of freedom that b others
surround fills m (m + 1)/2 + m b entries and takes m^3/3 + m^2 b + m b^2 operations.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TypeVar

Ends = tuple[bool, bool]  # whether the planes at the lower and the upper end belong to the box itself
T = TypeVar("T")
Dofs = Callable[[list[int], list[int]], float]


@dataclass(frozen=True)
class Fill:
    """Entries of L, operations (a multiplication with an addition), and the largest front's entries."""

    entries: float = 0.0
    operations: float = 0.0
    front: float = 0.0

    def __add__(self, other: Fill) -> Fill:
        return Fill(self.entries + other.entries, self.operations + other.operations, max(self.front, other.front))

    def times(self, count: int) -> Fill:
        """The same for `count` bodies."""
        return Fill(count * self.entries, count * self.operations, self.front)


def eliminated(inside: float, around: float) -> Fill:
    """One front: `inside` degrees of freedom eliminated, `around` left."""
    m, b = inside, around
    return Fill(m * (m + 1.0) / 2.0 + m * b, m**3 / 3.0 + m * m * b + m * b * b, (m + b) ** 2)


def grid_fill(elements: tuple[int, ...], dofs: Dofs, ends: tuple[Ends, ...] | None = None) -> Fill:
    """The fill of a grid of elements (any number of axes); `ends` tells which end planes are the grid's own (all).

    `dofs(lines, gaps)` counts those of a box from its planes of nodes and from its elements, one number an axis.
    """
    return _Dissection(dofs).fill(elements, ends or ((True, True),) * len(elements))


def nodal(order: int, a_node: int = 3) -> Dofs:
    """Degrees of freedom of hexahedra of an order, `a_node` a node."""

    def dofs(lines: list[int], gaps: list[int]) -> float:
        total = float(a_node)
        for line, gap in zip(lines, gaps, strict=True):
            total *= line + (order - 1) * gap
        return total

    return dofs


def panelled(vertex: int, side: int, inner: float) -> Dofs:
    """Degrees of freedom of reduced panels in a plane: so many a vertex line, a side, and within each."""

    def dofs(lines: list[int], gaps: list[int]) -> float:
        corners, sides = lines[0] * lines[1], lines[0] * gaps[1] + lines[1] * gaps[0]
        return float(vertex * corners + side * sides + inner * gaps[0] * gaps[1])

    return dofs


class _Dissection:
    """The recursion, each kind of box computed once."""

    def __init__(self, dofs: Dofs) -> None:
        self.dofs = dofs
        self.known: dict[tuple[tuple[int, ...], tuple[Ends, ...]], Fill] = {}

    def fill(self, elements: tuple[int, ...], ends: tuple[Ends, ...]) -> Fill:
        key = (elements, ends)
        if key not in self.known:
            self.known[key] = self._fill(elements, ends)
        return self.known[key]

    def _fill(self, elements: tuple[int, ...], ends: tuple[Ends, ...]) -> Fill:
        own = self._own(elements, ends)
        around = self._own(elements, ((True, True),) * len(elements)) - own
        longest = [axis for axis, count in enumerate(elements) if count > 1]
        if not longest:
            return eliminated(own, around)
        planes = {axis: self._plane(elements, ends, axis) for axis in longest}
        axis = min(longest, key=lambda each: planes[each])
        half, (low, high) = elements[axis] // 2, ends[axis]
        lower = self.fill(_put(elements, axis, half), _put(ends, axis, (low, False)))
        upper = self.fill(_put(elements, axis, elements[axis] - half), _put(ends, axis, (False, high)))
        return eliminated(planes[axis], around) + lower + upper

    def _own(self, elements: tuple[int, ...], ends: tuple[Ends, ...]) -> float:
        lines = [count - 1 + low + high for count, (low, high) in zip(elements, ends, strict=True)]
        return self.dofs(lines, list(elements))

    def _plane(self, elements: tuple[int, ...], ends: tuple[Ends, ...], axis: int) -> float:
        lines = [count - 1 + low + high for count, (low, high) in zip(elements, ends, strict=True)]
        gaps = list(elements)
        lines[axis], gaps[axis] = 1, 0
        return self.dofs(lines, gaps)


def _put(values: tuple[T, ...], axis: int, value: T) -> tuple[T, ...]:
    return (*values[:axis], value, *values[axis + 1 :])
