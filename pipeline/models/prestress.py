"""Thermal stress of a plate whose supports hold its expansion, logged, and refused where the plate buckles."""

from __future__ import annotations

from math import isfinite

from geometry.materials import USUAL_C
from pipeline.case.features import STRESS
from pipeline.case.model import Case
from pipeline.errors import InputError
from pipeline.logs import Log
from pipeline.quantity import figure, percent
from solvers.plates.assembled import PlateModel

MPA = 1e6
BENT = (
    6.0  # half of 12 (w k / (t k))^2: what a bow w of a wave as short as the mode's changes of its frequency, at most
)


def load_with_stress(case: Case, model: PlateModel, log: Log) -> None:
    """Load a plate with the stress that its supports cause at the case's temperature.

    Parameters
    ----------
    case : Case
        The case.
    model : PlateModel
        The plate, its cells reduced with their stress fields.
    log : Log
        Receives the stress, and a warning about a bow.

    Raises
    ------
    InputError
        For a plate that buckles.
    """
    warmer = case.solve.temperature_C - USUAL_C
    with log.step("thermal stress"):
        rest, factor = model.prestress()
    limit_c = USUAL_C + factor * warmer
    if factor <= 1.0:
        side = "below" if warmer > 0.0 else "above"
        what = f"must be {side} {figure(limit_c)} C, at which the held plate buckles"
        raise InputError(f"{case.source or case.name}: {STRESS} = {case.solve.temperature_C:g}: {what}")
    along, across = (figure(each / MPA) for each in rest.mean_pa)
    until = f"it buckles at {figure(limit_c)} C" if isfinite(limit_c) else "it never buckles"
    log.info(f"mean thermal stress of the held plate: {along} MPa along x, {across} MPa along y; {until}")
    bent = BENT * (rest.bow_m / case.design.thickness_m) ** 2
    if bent > case.solve.accuracy:
        log.warning("BOW", f"the warm plate bows, which may change frequencies by {percent(bent)} and is left out")


def warn_of_free_cell(log: Log) -> None:
    """Warn that an infinite plate is free to expand where supports hold the case's.

    Parameters
    ----------
    log : Log
        Receives the warning.
    """
    log.warning(
        "FREE_CELL", "an infinite plate is free to expand: the thermal stress that the supports cause is left out"
    )
