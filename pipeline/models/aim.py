"""A design whose target mode has a requested frequency: solved, resized and solved again until it does."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from math import log, sqrt

from pipeline.case.limits import WITHIN
from pipeline.case.model import Case
from pipeline.errors import InputError
from pipeline.logs import Log, WarningLog
from pipeline.models.modes import solve_modes
from pipeline.models.target import ModeRow
from pipeline.planning.model_choice import Request
from pipeline.quantity import MM, figure, frequency, frequency_with_bar, percent
from solvers.errors import SolverError

ACCURACY = 0.02  # of each solve: the first mesh meets it, with bars well below WITHIN
JUMP = 8.0  # relative changes of solved over theoretical frequency: a single mode changes by about as much
SOLVES = 6  # at most; two are usual


@dataclass(frozen=True)
class Aimed:
    """A case sized by theory, and its target mode as solved."""

    case: Case
    row: ModeRow
    theory_hz: float

    def misses(self, target_hz: float) -> float:
        """Return the relative distance of the target mode from a frequency, its error bar included."""
        return abs(self.row.frequency_hz / target_hz - 1.0) + (self.row.error or 0.0)


def aim(sized: Callable[[float], Case], target_hz: float, progress: Log) -> Aimed:
    """Find the sizes for which the solved target mode has a requested frequency.

    Zone and pillars follow the ratio of solved and theoretical frequency together: a zone resized alone needs more solves
    and ends less confined, because its pillars are then off tune. Where the frequency jumps past the requested one, the
    target shape passes from one mode to another, and no size in between helps.

    Parameters
    ----------
    sized : callable
        Returns the case whose zone and pillars theory puts at a frequency in Hz. Raises InputError outside its range.
    target_hz : float
        Frequency that the solved target mode is to have.
    progress : Log
        Receives a line for each solve.

    Returns
    -------
    Aimed
        The first design within WITHIN.

    Raises
    ------
    InputError
        If the first design cannot be built.
    SolverError
        If none of the designs came near enough.
    """
    tried: list[Aimed] = []
    theory_hz: float | None = target_hz
    while theory_hz is not None and len(tried) < SOLVES:
        try:
            case = sized(theory_hz)
        except InputError:
            if not tried:
                raise
            break
        solved = _solved(case, theory_hz, progress)
        if solved is None:
            break
        if solved.misses(target_hz) <= WITHIN:
            return solved
        tried.append(solved)
        theory_hz = _next_hz(tried, target_hz)
    raise SolverError(_missed(tried, target_hz))


def _solved(case: Case, theory_hz: float, progress: Log) -> Aimed | None:
    """The target mode of a design, solved quickly; None without one."""
    quick, pillar = case.but({"solve.accuracy": ACCURACY}), case.design.pillar
    height = f", pillars {figure(pillar.height_m / MM)} mm tall" if pillar else ""
    progress.info(f"solve a zone {figure(case.design.width_m / MM)} mm wide{height}")
    row = solve_modes(quick, Request("plate", symmetry=case.target_symmetry), WarningLog()).target_row
    place = f"zone {figure(case.design.width_m / MM)} mm wide"
    if row is None:
        progress.info(f"{place}: no target mode")
        return None
    progress.info(f"{place}: target mode {frequency_with_bar(row.frequency_hz, row.error)}")
    return Aimed(case, row, theory_hz)


def _next_hz(own: Sequence[Aimed], target_hz: float) -> float | None:
    """Frequency by theory to try next.

    None where the target mode jumps past the requested frequency or stays away from it.
    """
    missed = [abs(log(each.row.frequency_hz / target_hz)) for each in own]
    if len(own) > 2 and min(missed[-2:]) > missed[-3] / 2.0:
        return None
    nearest = own[missed.index(min(missed))]
    guess = nearest.theory_hz * target_hz / nearest.row.frequency_hz
    below = [each for each in own if each.row.frequency_hz < target_hz]
    above = [each for each in own if each.row.frequency_hz > target_hz]
    if not below or not above:
        return guess
    low, high = (pick(side, key=lambda each: each.theory_hz) for pick, side in ((max, below), (min, above)))
    apart = log(high.theory_hz / low.theory_hz)
    if JUMP * apart < log(high.row.frequency_hz / low.row.frequency_hz):
        return None
    return guess if low.theory_hz < guess < high.theory_hz else sqrt(low.theory_hz * high.theory_hz)


def _missed(tried: Sequence[Aimed], target_hz: float) -> str:
    """State that no design had its target mode at the frequency, and how near the nearest came."""
    best = min(tried, key=lambda each: each.misses(target_hz), default=None)
    came = "no design has a target mode"
    if best is not None:
        row = best.row
        tone, size = frequency_with_bar(row.frequency_hz, row.error), best.case.design.width_m / MM
        came = f"nearest of {len(tried)} designs: {tone} with a zone {figure(size)} mm wide"
    return (
        f"no zone brings the target mode within {percent(WITHIN)} of {frequency(target_hz)} ({came}): the rows do not confine "
        "this shape there; try other pillars, another pitch, half-wavelength or thickness, or more rows"
    )
