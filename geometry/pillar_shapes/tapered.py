"""A square pillar that narrows or widens towards its tip."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any, Self

from geometry.pillar_shapes.base import MM, FloatArray
from geometry.pillar_shapes.square import Square


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
