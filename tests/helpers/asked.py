"""Questions asked of a case in a test."""

from __future__ import annotations

from pipeline.case.model import Case
from pipeline.logs import Log
from pipeline.models.bands import SolvedBands
from pipeline.models.bands import solve_bands as solved_bands
from pipeline.planning.plan import Plan
from pipeline.questions.attenuation import Attenuation, AttenuationResult
from pipeline.questions.bands import Bands, BandsResult
from pipeline.questions.crosstalk import Crosstalk, CrosstalkResult
from pipeline.questions.question import Run, announce, ask
from pipeline.questions.touch import Touch, TouchResult
from solvers.piezo.forced import ForcedPlate


def bands_of(case: Case, log: Log, shapes: bool = False, every_gap: bool = True) -> BandsResult:
    """The bands of a case."""
    return ask(case, Bands(), Run(log, detailed=every_gap, shapes=shapes))


def solve_bands(case: Case, log: Log, shapes: bool = False, every_gap: bool = True) -> SolvedBands:
    """The solved bands of a case, with their resource estimate logged as by the question."""
    question = Bands()
    question.check(case)
    (step,) = question.plan(case).steps
    announce(question.plan(case), Run(log))
    assert step.choice
    return solved_bands(case, step.choice, log, shapes=shapes, every_gap=every_gap)


def crosstalk_of(case: Case, log: Log, points: int = 401) -> CrosstalkResult:
    """The crosstalk of a case, computed without its resource estimate."""
    question = Crosstalk(points=points)
    question.check(case)
    return question.compute(case, Plan(case.name, (), ()), Run(log))


def touch_of(case: Case, log: Log, mapped: bool = True, forced: ForcedPlate | None = None) -> TouchResult:
    """A finger on the plate of a case, which may be solved already."""
    run = Run(log)
    run.solved |= {"forced": forced} if forced else {}
    return ask(case, Touch(mapped=mapped), run)


def attenuation_of(
    case: Case, log: Log, band_hz: tuple[float, float] | None = None, kx: float | None = None, points: int = 201
) -> AttenuationResult:
    """The decay per row of a case."""
    band = band_hz and (band_hz[0] / 1e3, band_hz[1] / 1e3)
    return ask(case, Attenuation(band, kx_per_m=kx, points=points), log)
