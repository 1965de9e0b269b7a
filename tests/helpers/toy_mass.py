"""Distribution of the plate's mass along the zone: an example of a question in a module of its own."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from pipeline.questions.question import Question, Run, option
from pipeline.questions.result import Result, figure
from pipeline.records.part import column


class MassResult(Result, axes=("strip",)):
    """Mass of equal strips of the plate beneath the zone."""

    mass_g: list[float] = column("mass of the strip", "g", along="strip")

    @figure("mass beneath the zone", "g")
    def mass_total_g(self) -> float:
        """Mass of all strips."""
        return float(sum(self.mass_g))

    def lines(self) -> Iterator[str]:
        """Yield the total."""
        yield f"{self.mass_total_g:.3f} g beneath the zone"

    def draw(self, ax: Any) -> None:
        """Draw the mass of each strip."""
        ax.bar(range(1, len(self.mass_g) + 1), self.mass_g)


class Mass(Question[MassResult], needs=("plate", "zone"), example="mass examples/small.toml --strips 3", is_quick=True):
    """Divide the mass of the plate beneath the zone into strips."""

    strips: int = option(default=4, at_least=1, at_most=100, help="number of strips")

    def compute(self, case: Any, plan: Any, run: Run) -> MassResult:
        """Return the mass of each strip."""
        d = case.design
        grams = 1e3 * d.material.density_kg_m3 * d.length_m * d.width_m * d.thickness_m
        return MassResult(mass_g=[grams / self.strips] * self.strips)
