"""The pillar shapes that there are: a new one is a module beside this one and a line here."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from geometry.errors import GeometryError
from geometry.pillar_shapes.base import PillarShape
from geometry.pillar_shapes.cross import Cross
from geometry.pillar_shapes.hexagonal import Hexagonal
from geometry.pillar_shapes.round import Round
from geometry.pillar_shapes.square import Square
from geometry.pillar_shapes.step import Step
from geometry.pillar_shapes.tapered import Tapered

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
