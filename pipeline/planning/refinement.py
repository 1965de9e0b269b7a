"""One mesh level finer: more fixed-interface modes or a higher degree where the reduction's own estimate exceeds the
accuracy; shorter elements where a lone part's modes lie higher than its mesh was meant for; and the error bars that say so.
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
from pipeline.planning import foresight, mesh_rules
from pipeline.planning.model_choice import ModelChoice, model_choice_of
from pipeline.planning.resources import Demand
from pipeline.planning.simplifications import khz
from pipeline.quantity import frequency, percent
from solvers.accuracy.calibration import TET
from solvers.accuracy.plate import MARGIN
from solvers.errors import SolverError
from solvers.superelement.interface import Interface, ReductionSettings

RATE = 4.5  # the modes' error falls as top_hz^-4.5: N^-1.5, and N goes as top_hz^3
# of the cut-off asked for: cells made for so much less serve; their own estimate tells whether well enough
SHORT = 0.15
MAX_REFINEMENTS = 2  # finer meshes for the accuracy, at most
EDGE_RATE = 1.1  # 2 x 0.54, of displacements at a re-entrant right angle; edges too hopeful are taken once more
AIM = 0.8  # of what is left to the mesh: edges for just so much would often miss by a little
SHORTER = (0.5, 0.9)  # least and largest factor on the edges of tetrahedra at once
TRIALS = 12  # of shorter elements, until there are more of them
STEP = (1.08, 2.0)  # least and largest factor on top_hz at once
Built = TypeVar("Built")


def more_modes(reduction: ReductionSettings, error: float, target: float, most: float = inf) -> ReductionSettings:
    """Raise the cut-off of the fixed-interface modes until their error is expected as allowed, at most by the factor
    `most`.
    """
    factor = (error / target) ** (1.0 / RATE)
    return replace(reduction, top_hz=reduction.top_hz * min(max(factor, STEP[0]), STEP[1], most))


def higher_degree(reduction: ReductionSettings) -> ReductionSettings:
    """Raise the degree of the boundary functions along the sides by one."""
    face = reduction.interface
    return replace(reduction, interface=Interface(face.along + 1, face.through))


def higher_through(reduction: ReductionSettings) -> ReductionSettings:
    """Raise the degree of the boundary functions through the thickness by one, with nodes enough for it."""
    face = reduction.interface
    finer = replace(reduction, interface=Interface(face.along, face.through + 1), further=mesh_rules.FURTHER)
    return replace(finer, hexahedra=mesh_rules.with_nodes_for(finer.ample, finer.hexahedra))


def describe_change(reduction: ReductionSettings, finer: ReductionSettings) -> str:
    """Describe in words what finer reduction settings change."""
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
    """Relative errors of a plate of reduced cells: the largest overestimate by truncation of any mode; of the target mode that
    by modes, by degrees along the sides and by those through the thickness left out.
    """

    worst: float
    modes: float
    degrees: float
    through: float = 0.0

    @property
    def total(self) -> float:
        """By all truncations."""
        return self.modes + self.degrees + self.through


def refine_reduction(
    choice: ModelChoice, estimate: ErrorEstimate, case: Case, log: Log, what: str = "the target mode"
) -> ModelChoice | None:
    """Refine the reduction where its estimates for `what` exceed the accuracy; None where they do not."""
    total, accuracy = MARGIN * estimate.total, case.solve.accuracy
    if choice.reduction is None or total <= accuracy:
        return None
    share, finer = accuracy / MARGIN / 2.0, choice.reduction
    if estimate.degrees + estimate.through > share:
        is_thick = estimate.through > estimate.degrees and finer.interface.through < mesh_rules.MAX_THROUGH
        finer = higher_through(finer) if is_thick else higher_degree(finer)
    finer = more_modes(finer, estimate.modes, share) if estimate.modes > share else finer
    log.info(
        f"the reduction may put {what} {percent(total)} too high, {percent(accuracy)} allowed: "
        f"{describe_change(choice.reduction, finer)}"
    )
    return replace(choice, reduction=finer, hexahedra=choice.hexahedra and finer.hexahedra)


def on_finer_meshes(
    first: tuple[ModelChoice, Built],
    bar: Callable[[Built], tuple[float | None, float]],
    build: Callable[[ModelChoice], Built],
    demand: Callable[[ModelChoice], Demand],
    case: Case,
    log: Log,
) -> tuple[ModelChoice, Built]:
    """A model choice and what was built of it, or those of the first finer mesh that meets the accuracy.

    bar: half-widths by the mesh and by truncation; MAX_REFINEMENTS meshes at most, as far as memory holds them and they can
    be solved: what was built before stays.
    """

    def next_choice(choice: ModelChoice, built: Built, _: int) -> ModelChoice | None:
        finer = finer_mesh(choice, *bar(built), case, log)
        return finer if finer and foresight.fits(demand(finer), log) else None

    return step_by_step(first, next_choice, build, MAX_REFINEMENTS, log)


def step_by_step(
    first: tuple[ModelChoice, Built],
    next_choice: Callable[[ModelChoice, Built, int], ModelChoice | None],
    build: Callable[[ModelChoice], Built],
    most: int,
    log: Log,
) -> tuple[ModelChoice, Built]:
    """Take finer choices one after another, so many at most, until there is none or one cannot be built; what was built before
    stays. next_choice: told what was built last, and how many steps were taken.
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
    """Take the next mesh of a part whose bar by the mesh, and by truncation beside it, exceeds the accuracy: the next mesh
    level of hexahedra, shorter edges of tetrahedra; None where it does not, where truncation is most of it, where nothing
    tells it, and after the finest.
    """
    accuracy = case.solve.accuracy
    if error is None or error < truncated or error + truncated <= accuracy:
        return None
    edges, left = choice.edge_m is not None, max(accuracy - truncated, accuracy / 4.0)
    finer = _shorter_edges(choice, error, left) if edges else _finer_boxes(choice, case, error, left)
    if finer:
        by = "its stresses" if edges else "coarser meshes"
        log.info(f"within {percent(error)} by the mesh, as {by} tell, {percent(accuracy)} allowed: {finer.mesh}")
    return finer


def _shorter_edges(choice: ModelChoice, error: float, target: float) -> ModelChoice:
    """Tetrahedra with edges as short as an error asks for that goes as their length to EDGE_RATE."""
    assert choice.edge_m
    factor = min(max((AIM * target / error) ** (1.0 / EDGE_RATE), SHORTER[0]), SHORTER[1])
    return replace(choice, edge_m=factor * choice.edge_m)


def _next_level(choice: ModelChoice, case: Case) -> ModelChoice | None:
    """The next mesh level of a part of hexahedra that has more of them; None after the finest."""
    finer = _on_next_level(choice, case.design)
    if finer is None:
        return None
    of_cells = finer.reduction is not None or finer.part == "cell"
    own, more = (  # sizes round to whole elements, and a foot on either face asks for two through the plate
        foresight.cell_dofs(case.design, each) if of_cells else foresight.whole_mesh(case, each).dofs
        for each in (choice, finer)
    )
    return finer if more > own else _next_level(finer, case)


def _finer_boxes(choice: ModelChoice, case: Case, error: float, target: float) -> ModelChoice | None:
    """The next mesh level of hexahedra; shorter elements of a plate meshed whole after the finest one, or without feet, whose
    rims the levels are about.
    """
    is_bare = choice.part == "plate" and choice.reduction is None and case.design.pillar is None
    return (None if is_bare else _next_level(choice, case)) or _shorter(choice, case, error, target)


def _shorter(choice: ModelChoice, case: Case, error: float, target: float) -> ModelChoice | None:
    """A plate meshed whole, beyond the finest level: elements as short as an error asks for that goes as their length to twice
    their order, or another layer at the rims of feet; None for other parts.
    """
    level, design = choice.mesh_level, case.design
    if choice.part != "plate" or choice.reduction is not None or level is None:
        return None
    factor, own = (AIM * target / error) ** (0.5 / level.order), foresight.whole_mesh(case, choice).dofs
    factor = SHORTER[1] if design.pillar else min(max(factor, SHORTER[0]), SHORTER[1])
    for _ in range(TRIALS):  # sizes round to whole elements
        level = replace(level, share=factor * level.share, layers=level.layers + bool(design.pillar))
        finer = replace(choice, hexahedra=mesh_rules.cell_mesh(design, level), mesh_level=level)
        if foresight.whole_mesh(case, finer).dofs > own:
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
    """Refine a lone part's mesh for the highest mode computed, where its elements are expected to miss the accuracy;
    else None.
    """
    if choice.part == "plate" or choice.mesh_level is None or highest_hz <= choice.good_to_hz:
        return None
    error = mesh_rules.expected_error(choice.part, choice.mesh_level, highest_hz / choice.good_to_hz)
    if error is None or error <= case.solve.accuracy:
        return None
    log.info(
        f"modes up to {khz(highest_hz)}: expected error {percent(error)} on elements for {khz(choice.good_to_hz)}: finer ones"
    )
    return model_choice_of(case, choice.part, highest_hz)


def raise_cutoff(choice: ModelChoice, highest_hz: float, case: Case, log: Log) -> ModelChoice | None:
    """Raise a plate's cut-off for the highest mode computed, where it was made for lower ones; else None."""
    top_hz = mesh_rules.cutoff_to_hz(case.design, case.solve.accuracy, highest_hz)
    if choice.reduction is None or choice.reduction.top_hz >= top_hz * (1.0 - SHORT):
        return None
    made_for = highest_hz * choice.reduction.top_hz / top_hz
    log.info(f"modes up to {khz(round(highest_hz))}: cells reduced for {khz(round(made_for))}, reduced again")
    return replace(choice, reduction=replace(choice.reduction, top_hz=top_hz))


@contextmanager
def refused(log: Log) -> Iterator[None]:
    """Log that finer reduction settings or a finer mesh cannot be had; what was computed before stays."""
    try:
        yield
    except (MeshError, SolverError) as fault:
        log.info(f"no mesh level higher: {fault}")


def warn(error: float, case: Case, log: Log) -> None:
    """Warn where the target mode's estimate still exceeds the accuracy."""
    if MARGIN * error > case.solve.accuracy:
        log.warning(
            "REDUCTION",
            f"the reduction may put the target mode {percent(MARGIN * error)} too high, solve.accuracy asks for "
            f"{percent(case.solve.accuracy)}: narrow the band, raise solve.accuracy, or take solve.model = 'solid'",
        )


# -- error bars --------------------------------------------------------------------------------------------------------
# The error that the mesh of a model choice is expected to make, said in the log and kept with the result.


@dataclass(frozen=True)
class WidestBar:
    """The widest error bar of the frequencies asked for.

    Attributes
    ----------
    error : float or None
        Relative half-width; None where the bar of one of them is unknown.
    of : str
        The frequency that has it, in words.
    parts : dict of str to float
        What the bar is made of, relative: `mesh`, `truncation`.
    """

    error: float | None
    of: str = ""
    parts: Mapping[str, float] | None = None

    @property
    def largest_part(self) -> str | None:
        """Name of the part that contributes most; None without parts."""
        return max(self.parts, key=lambda name: (self.parts or {})[name]) if self.parts else None

    def text(self) -> str:
        """Return the bar, what it is of and its largest part in words."""
        if self.error is None:
            return "error of a frequency: unknown for at least one of them; compare with a finer solve.accuracy"
        parts = sorted((self.parts or {}).items(), key=lambda part: -part[1])
        shares = ", ".join(f"{percent(error)} {name}" for name, error in parts if error > 0.0)
        return f"error of a frequency: {percent(self.error)} at most ({self.of})" + (f": {shares}" if shares else "")

    def warn(self, case: Case, log: Log) -> None:
        """Warn where the bar exceeds the accuracy that the case asks for."""
        if self.error is not None and self.error > case.solve.accuracy:
            log.warning(
                "ACCURACY",
                f"the error bar of {self.of} is {percent(self.error)}, most of it {self.largest_part}; "
                f"solve.accuracy asks for {percent(case.solve.accuracy)}",
            )

    def to_dict(self) -> dict[str, Any]:
        """As results keep it."""
        return {"error": self.error, "of": self.of, "parts": dict(self.parts or {}), "largest_part": self.largest_part}


def log_mesh_error(choice: ModelChoice, case: Case, log: Log, error: float | None) -> float | None:
    """Log the largest half-width of the frequencies' bars by the mesh, and where the case asks for less; returns it.

    None where nothing tells it.
    """
    if error is None:
        log.info(f"nothing tells the error of {choice.name} of the {choice.part}: compare with a finer solve.accuracy")
        return None
    by = "its stresses" if choice.kind == TET else "coarser meshes"
    short = f"; solve.accuracy asks for {percent(case.solve.accuracy)}" if error > case.solve.accuracy else ""
    log.info(f"error of a frequency by the mesh {percent(error)} or less, as {by} tell{short}")
    return error
