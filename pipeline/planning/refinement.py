"""Refinement of a mesh or a reduction, and the error bars that require it.

If the estimate of a reduction exceeds the accuracy, it gets more fixed-interface modes or a higher degree. If the modes of
an isolated part lie above the frequencies its mesh was chosen for, it gets shorter elements.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, replace
from math import inf
from typing import Any, TypeVar

from geometry.errors import MeshError
from geometry.layout import Design
from pipeline.case.model import Case
from pipeline.logs import Log
from pipeline.planning import mesh_rules, resource_estimate
from pipeline.planning.model_choice import ModelChoice, model_choice_of
from pipeline.planning.resources import ResourceEstimate
from pipeline.planning.simplifications import khz
from pipeline.quantity import frequency, percent
from solvers.accuracy.calibration import TET
from solvers.accuracy.reduction import MARGIN
from solvers.errors import SolverError
from solvers.superelement.interface import ReductionSettings

RATE = 4.5  # the modes' error falls as top_hz^-4.5: N^-1.5, and N goes as top_hz^3
# of the required cut-off: cells made for a cut-off this much lower still serve; their own estimate checks it
SHORT = 0.15
MAX_REFINEMENTS = 2  # finer meshes for the accuracy, at most
EDGE_RATE = 1.1  # 2 x 0.54, of displacements at a re-entrant right angle; edges that prove too long are shortened again
AIM = 0.8  # of the error allowed to the mesh: aiming at all of it would often just miss
SHORTER = (0.5, 0.9)  # least and largest factor on the edges of tetrahedra in one step
TRIALS = 12  # attempts at shorter elements, until their number rises
STEP = (1.08, 2.0)  # least and largest factor on top_hz in one step
Built = TypeVar("Built")


def more_modes(reduction: ReductionSettings, error: float, target: float, most: float = inf) -> ReductionSettings:
    """Raise the cut-off of the fixed-interface modes, by at most `most`, until their expected error meets the target."""
    factor = (error / target) ** (1.0 / RATE)
    return replace(reduction, top_hz=reduction.top_hz * min(max(factor, STEP[0]), STEP[1], most))


def higher_degree(reduction: ReductionSettings) -> ReductionSettings:
    """Raise the degree of the boundary functions along the sides by one."""
    face = reduction.interface
    return replace(reduction, interface=replace(face, along=face.along + 1))


def higher_through(reduction: ReductionSettings) -> ReductionSettings:
    """Raise the degree of the boundary functions through the thickness by one, and the nodes that it needs."""
    face = reduction.interface
    finer = replace(reduction, interface=replace(face, through=face.through + 1), further=mesh_rules.FURTHER)
    return replace(finer, hexahedra=mesh_rules.with_nodes_for(finer.ample, finer.hexahedra))


def describe_change(reduction: ReductionSettings, finer: ReductionSettings) -> str:
    """Describe the differences between two reduction settings in words."""
    words = []
    if finer.top_hz != reduction.top_hz:
        top, before = (frequency(each) for each in (finer.top_hz, reduction.top_hz))
        words.append(f"fixed-interface modes up to {top} instead of {before}")
    own, face = reduction.interface, finer.interface
    if face.along != own.along:
        words.append(f"degree {face.along} along the sides instead of {own.along}")
    if face.through != own.through:
        words.append(f"degree {face.through} through the thickness instead of {own.through}")
    return ", ".join(words)


@dataclass(frozen=True)
class ErrorEstimate:
    """Relative truncation errors of a plate of reduced cells.

    worst: largest overestimate of any mode; modes, degrees, through: overestimates of the target mode due to discarded
    modes, degrees along the sides and degrees through the thickness.
    """

    worst: float
    modes: float
    degrees: float
    through: float = 0.0

    @property
    def total(self) -> float:
        """Sum of the truncation errors of the target mode."""
        return self.modes + self.degrees + self.through


def refine_reduction(
    choice: ModelChoice, estimate: ErrorEstimate, case: Case, log: Log, what: str = "the target mode"
) -> ModelChoice | None:
    """Refine the reduction if its estimates for `what` exceed the accuracy; None if they do not."""
    total, accuracy = MARGIN * estimate.total, case.solve.accuracy
    if choice.reduction is None or total <= accuracy:
        return None
    share, finer = accuracy / MARGIN / 2.0, replace(choice.reduction, sparing=None)
    if estimate.degrees + estimate.through > share:
        is_thick = estimate.through > estimate.degrees and finer.interface.through < mesh_rules.MAX_THROUGH
        finer = higher_through(finer) if is_thick else higher_degree(finer)
    finer = more_modes(finer, estimate.modes, share) if estimate.modes > share else finer
    log.info(
        f"truncation error of {what}: up to {percent(total)}, {percent(accuracy)} allowed; refining: "
        f"{describe_change(choice.reduction, finer)}"
    )
    return replace(choice, reduction=finer, hexahedra=choice.hexahedra and finer.hexahedra)


def on_finer_meshes(
    first: tuple[ModelChoice, Built],
    bar: Callable[[Built], tuple[float | None, float]],
    build: Callable[[ModelChoice], Built],
    demand: Callable[[ModelChoice], ResourceEstimate],
    case: Case,
    log: Log,
) -> tuple[ModelChoice, Built]:
    """Refine the mesh of a choice until it meets the accuracy; returns the choice and the model built from it.

    bar: relative discretisation and truncation errors of a built model. There are at most MAX_REFINEMENTS finer meshes. The
    last model is kept if the next does not fit into memory or cannot be solved.
    """

    def next_choice(choice: ModelChoice, built: Built, _: int) -> ModelChoice | None:
        finer = finer_mesh(choice, *bar(built), case, log)
        return finer if finer and resource_estimate.fits(demand(finer), log) else None

    return step_by_step(first, next_choice, build, MAX_REFINEMENTS, log)


def step_by_step(
    first: tuple[ModelChoice, Built],
    next_choice: Callable[[ModelChoice, Built, int], ModelChoice | None],
    build: Callable[[ModelChoice], Built],
    most: int,
    log: Log,
) -> tuple[ModelChoice, Built]:
    """Take at most `most` finer choices in turn, until there is none or one cannot be built; the last model built is kept.

    next_choice: called with the last choice, its model and the number of steps so far.
    """
    choice, built = first
    for taken in range(most):
        finer = next_choice(choice, built, taken)
        if finer is None:
            break
        with refused(log):
            choice, built = finer, build(finer)
        if choice is not finer:
            break
    return choice, built


def finer_mesh(choice: ModelChoice, error: float | None, truncated: float, case: Case, log: Log) -> ModelChoice | None:
    """Choose a finer mesh for a part whose discretisation and truncation errors together exceed the accuracy.

    Hexahedra take the next mesh level, tetrahedra shorter edges. None if the errors meet the accuracy, if truncation is the
    larger or the discretisation error unknown, and after the finest level.
    """
    accuracy = case.solve.accuracy
    if error is None or error < truncated or error + truncated <= accuracy:
        return None
    edges, left = choice.edge_m is not None, max(accuracy - truncated, accuracy / 4.0)
    finer = _shorter_edges(choice, error, left) if edges else _finer_boxes(choice, case, error, left)
    if finer:
        source = "stress recovery" if edges else "coarser meshes"
        log.info(
            f"discretisation error: {percent(error)} (from {source}), {percent(accuracy)} allowed; refining: {finer.mesh}"
        )
    return finer


def _shorter_edges(choice: ModelChoice, error: float, target: float) -> ModelChoice:
    """Shorten the edges of tetrahedra for a target error that goes as their length to the power EDGE_RATE."""
    assert choice.edge_m
    factor = min(max((AIM * target / error) ** (1.0 / EDGE_RATE), SHORTER[0]), SHORTER[1])
    return replace(choice, edge_m=factor * choice.edge_m)


def _next_level(choice: ModelChoice, case: Case) -> ModelChoice | None:
    """Next mesh level that has more hexahedra; None after the finest."""
    finer = _on_next_level(choice, case.design)
    if finer is None:
        return None
    of_cells = finer.reduction is not None or finer.part == "cell"
    own, more = (  # sizes round to whole elements, and a foot on either face needs two through the plate
        resource_estimate.cell_dofs(case.design, each) if of_cells else resource_estimate.whole_mesh(case, each).dofs
        for each in (choice, finer)
    )
    return finer if more > own else _next_level(finer, case)


def _finer_boxes(choice: ModelChoice, case: Case, error: float, target: float) -> ModelChoice | None:
    """Next mesh level of hexahedra; for a plate meshed whole, shorter elements after the finest level.

    A plate without feet has no singular edges, which the levels address, and goes straight to shorter elements.
    """
    is_bare = choice.part == "plate" and choice.reduction is None and case.design.pillar is None
    return (None if is_bare else _next_level(choice, case)) or _shorter(choice, case, error, target)


def _shorter(choice: ModelChoice, case: Case, error: float, target: float) -> ModelChoice | None:
    """Refine a plate meshed whole beyond the finest level; None for other parts.

    Elements shrink for a target error that goes as their length to twice their order, or feet get another graded layer.
    """
    level, design = choice.mesh_level, case.design
    if choice.part != "plate" or choice.reduction is not None or level is None:
        return None
    factor, own = (AIM * target / error) ** (0.5 / level.order), resource_estimate.whole_mesh(case, choice).dofs
    factor = SHORTER[1] if design.pillar else min(max(factor, SHORTER[0]), SHORTER[1])
    for _ in range(TRIALS):  # sizes round to whole elements
        level = replace(level, share=factor * level.share, layers=level.layers + bool(design.pillar))
        finer = replace(choice, hexahedra=mesh_rules.cell_mesh(design, level), mesh_level=level)
        if resource_estimate.whole_mesh(case, finer).dofs > own:
            return finer
    return None


def _on_next_level(choice: ModelChoice, design: Design) -> ModelChoice | None:
    if choice.mesh_level is None:
        return None
    if choice.reduction is not None or choice.part == "cell":
        level = mesh_rules.finer_cell_level(choice.mesh_level)
    else:
        level = mesh_rules.finer_level("whole" if choice.part == "plate" else choice.part, choice.mesh_level)
    if level is None:
        return None
    if choice.part in ("zone", "pillar"):
        mesh = mesh_rules.lone_mesh(choice.part, design, level, choice.good_to_hz)
    else:
        mesh = mesh_rules.cell_mesh(design, level)
    reduction = choice.reduction
    if reduction is not None:
        mesh = mesh_rules.with_nodes_for(reduction.ample, mesh)
        reduction = replace(reduction, hexahedra=mesh)
    return replace(choice, hexahedra=mesh, mesh_level=level, reduction=reduction)


def refine_mesh(choice: ModelChoice, highest_hz: float, case: Case, log: Log) -> ModelChoice | None:
    """Refine the mesh of an isolated part whose elements are expected to miss the accuracy at the highest mode; else None."""
    if choice.part == "plate" or choice.mesh_level is None or highest_hz <= choice.good_to_hz:
        return None
    error = mesh_rules.expected_error(choice.part, choice.mesh_level, highest_hz / choice.good_to_hz)
    if error is None or error <= case.solve.accuracy:
        return None
    log.info(
        f"discretisation error of modes up to {khz(highest_hz)}: {percent(error)} (from the calibration; elements chosen for "
        f"{khz(choice.good_to_hz)}); refining"
    )
    return model_choice_of(case, choice.part, highest_hz)


def raise_cutoff(choice: ModelChoice, highest_hz: float, case: Case, log: Log) -> ModelChoice | None:
    """Raise the cut-off of a plate whose reduction was chosen for lower modes than the highest computed; else None."""
    top_hz = mesh_rules.cutoff_to_hz(case.design, case.solve.accuracy, highest_hz)
    if choice.reduction is None or choice.reduction.top_hz >= top_hz * (1.0 - SHORT):
        return None
    made_for = highest_hz * choice.reduction.top_hz / top_hz
    log.info(f"highest mode: {khz(round(highest_hz))}; reducing the cells again, so far for {khz(round(made_for))}")
    return replace(choice, reduction=replace(choice.reduction, top_hz=top_hz))


@contextmanager
def refused(log: Log) -> Iterator[None]:
    """Log that a finer reduction or mesh could not be solved; the previous result is kept."""
    try:
        yield
    except (MeshError, SolverError) as fault:
        log.info(f"refinement stopped: {fault}")


def warn(error: float, case: Case, log: Log) -> None:
    """Warn if the estimate of the target mode still exceeds the accuracy."""
    if MARGIN * error > case.solve.accuracy:
        log.warning(
            "REDUCTION",
            f"truncation may overestimate the target mode by {percent(MARGIN * error)}, more than solve.accuracy = "
            f"{case.solve.accuracy:g}: narrow the band, raise solve.accuracy, or set solve.model = 'solid'",
        )


# -- error bars --------------------------------------------------------------------------------------------------------
# The estimated discretisation error of a model choice, logged and stored with the result.


@dataclass(frozen=True)
class WidestBar:
    """Largest error bar of the requested frequencies.

    Attributes
    ----------
    error : float or None
        Relative error; None if the error of any of them is unknown.
    of : str
        Name of the frequency that has it.
    parts : dict of str to float
        Contributions, relative: `mesh`, `truncation`, and `rounding` and `moduli` where they count.
    """

    error: float | None
    of: str = ""
    parts: Mapping[str, float] | None = None

    @property
    def largest_part(self) -> str | None:
        """Name of the part that contributes most; None without parts."""
        return max(self.parts, key=lambda name: (self.parts or {})[name]) if self.parts else None

    def text(self) -> str:
        """Return the error, the frequency that has it and its parts as a log line."""
        if self.error is None:
            return "error of any frequency: unknown for at least one of them; compare with a finer solve.accuracy"
        parts = sorted((self.parts or {}).items(), key=lambda part: -part[1])
        shares = ", ".join(f"{percent(error)} {name}" for name, error in parts if error > 0.0)
        return f"error of any frequency: at most {percent(self.error)} ({self.of}" + (f": {shares})" if shares else ")")

    def warn(self, case: Case, log: Log) -> None:
        """Warn if the error exceeds the accuracy requested by the case."""
        if self.error is not None and self.error > case.solve.accuracy:
            log.warning(
                "ACCURACY",
                f"the error bar of {self.of} is {percent(self.error)}, mostly {self.largest_part}; "
                f"solve.accuracy requests {percent(case.solve.accuracy)}",
            )

    def to_dict(self) -> dict[str, Any]:
        """Return the error as plain JSON."""
        return {"error": self.error, "of": self.of, "parts": dict(self.parts or {}), "largest_part": self.largest_part}


def log_mesh_error(choice: ModelChoice, case: Case, log: Log, error: float | None) -> float | None:
    """Log the largest discretisation error of any frequency, and whether it exceeds the accuracy; returns it.

    None if there is no estimate.
    """
    if error is None:
        log.info(f"no error estimate for {choice.name} of the {choice.part}: compare with a finer solve.accuracy")
        return None
    source = "stress recovery" if choice.kind == TET else "coarser meshes"
    short = f"; solve.accuracy requests {percent(case.solve.accuracy)}" if error > case.solve.accuracy else ""
    log.info(f"discretisation error of any frequency: at most {percent(error)} (estimated from {source}){short}")
    return error
