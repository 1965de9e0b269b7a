"""One mesh level finer: more fixed-interface modes or a higher degree where the reduction's own estimate exceeds the
accuracy; shorter elements where a lone part's modes lie higher than its mesh was meant for.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from math import inf

from pipeline.case.model import Case
from pipeline.logs import Log
from pipeline.planning import mesh_rules
from pipeline.planning.model_choice import ModelChoice, model_choice_of
from pipeline.planning.simplifications import khz
from solvers.errors import SolverError
from solvers.superelement.interface import Interface, ReductionSettings

MARGIN = 2.0  # an assembled plate's single modes may lie somewhat above their estimate, the worst of a class never did
RATE = 4.5  # the modes' error falls as top_hz^-4.5: N^-1.5, and N goes as top_hz^3
SHORT = (
    0.15  # of the cut-off asked for: cells made for so much less serve; their own estimate tells whether well enough
)
STEP = (1.08, 2.0)  # least and largest factor on top_hz at once


def more_modes(reduction: ReductionSettings, error: float, wanted: float, most: float = inf) -> ReductionSettings:
    """Raise the cut-off of the fixed-interface modes until their error is expected as wanted, at most by the factor
    `most`.
    """
    factor = (error / wanted) ** (1.0 / RATE)
    return replace(reduction, top_hz=reduction.top_hz * min(max(factor, STEP[0]), STEP[1], most))


def higher_degree(reduction: ReductionSettings) -> ReductionSettings:
    """Raise the degree of the boundary functions along the sides by one."""
    face = reduction.interface
    return replace(reduction, interface=Interface(face.along + 1, face.through))


def describe_change(reduction: ReductionSettings, finer: ReductionSettings) -> str:
    """Describe in words what finer reduction settings change."""
    words = []
    if finer.top_hz != reduction.top_hz:
        words.append(
            f"fixed-interface modes up to {finer.top_hz / 1e6:.2f} MHz instead of {reduction.top_hz / 1e6:.2f}"
        )
    if finer.interface != reduction.interface:
        words.append(f"degree {finer.interface.along} along the sides instead of {reduction.interface.along}")
    return ", ".join(words)


@dataclass(frozen=True)
class ErrorEstimate:
    """Relative errors of a plate of reduced cells: the largest overestimate by truncation of any mode; of the wanted one that
    by modes and by degrees left out, and the half-width of its bar by the mesh (NaN where no coarser mesh tells it).
    """

    worst: float
    modes: float
    degrees: float
    mesh: float

    @property
    def total(self) -> float:
        """By both truncations."""
        return self.modes + self.degrees


def refine_reduction(choice: ModelChoice, estimate: ErrorEstimate, case: Case, log: Log) -> ModelChoice | None:
    """Refine the reduction where its estimates for the wanted mode exceed the accuracy; None where they do not."""
    total, accuracy = MARGIN * estimate.total, case.solve.accuracy
    if choice.reduction is None or total <= accuracy:
        return None
    share = accuracy / MARGIN / 2.0
    finer = higher_degree(choice.reduction) if estimate.degrees > share else choice.reduction
    finer = more_modes(finer, estimate.modes, share) if estimate.modes > share else finer
    log.info(
        f"the reduction may put the wanted mode {total:.2%} too high, {accuracy:.2%} wanted: "
        f"{describe_change(choice.reduction, finer)}"
    )
    return replace(choice, reduction=finer)


def refine_plate_mesh(choice: ModelChoice, estimate: ErrorEstimate, case: Case, log: Log) -> ModelChoice | None:
    """Take the next mesh level of a plate's cells where the wanted mode's bar by the mesh exceeds the accuracy; else None."""
    level = mesh_rules.finer_cell_level(choice.mesh_level) if choice.mesh_level else None
    if choice.reduction is None or level is None or not estimate.mesh > case.solve.accuracy:
        return None
    mesh = mesh_rules.cell_mesh(case.design, level)
    log.info(
        f"the wanted mode within {estimate.mesh:.2%} by the mesh, as coarser meshes tell, {case.solve.accuracy:.2%} wanted: "
        f"elements of order {level.order} with {level.layers} layers at the pillars' feet"
    )
    return replace(choice, hexahedra=mesh, mesh_level=level, reduction=replace(choice.reduction, hexahedra=mesh))


def refine_mesh(choice: ModelChoice, highest_hz: float, case: Case, log: Log) -> ModelChoice | None:
    """Refine a lone part's mesh for the highest mode computed, where its elements are expected to miss the accuracy;
    else None.
    """
    if choice.part == "plate" or choice.mesh_level is None or highest_hz <= choice.good_to_hz:
        return None
    error = mesh_rules.expected_error(choice.part, choice.mesh_level, highest_hz / choice.good_to_hz)
    if error is None or error <= case.solve.accuracy:
        return None
    log.info(
        f"modes up to {khz(highest_hz)}: expected error {error:.2%} on elements for {khz(choice.good_to_hz)}: finer ones"
    )
    return model_choice_of(case, choice.part, highest_hz)


def raise_cutoff(choice: ModelChoice, highest_hz: float, log: Log) -> ModelChoice | None:
    """Raise a plate's cut-off for the highest mode computed, where it was made for lower ones; else None."""
    if choice.reduction is None or choice.reduction.top_hz >= mesh_rules.REACH * highest_hz * (1.0 - SHORT):
        return None
    made_for = choice.reduction.top_hz / mesh_rules.REACH
    log.info(f"modes up to {khz(round(highest_hz))}: cells reduced for {khz(round(made_for))}, reduced again")
    return replace(choice, reduction=replace(choice.reduction, top_hz=mesh_rules.REACH * highest_hz))


@contextmanager
def refused(log: Log) -> Iterator[None]:
    """Log that finer reduction settings cannot be solved; what was computed before stays."""
    try:
        yield
    except SolverError as fault:
        log.info(f"no mesh level higher: {fault}")


def warn(error: float, case: Case, log: Log) -> None:
    """Warn where the wanted mode's estimate still exceeds the accuracy."""
    if MARGIN * error > case.solve.accuracy:
        log.warning(
            "REDUCTION",
            f"the reduction may put the wanted mode {MARGIN * error:.2%} too high, solve.accuracy asks for "
            f"{case.solve.accuracy:.2%}: narrow the band, raise solve.accuracy, or take solve.model = 'solid'",
        )
