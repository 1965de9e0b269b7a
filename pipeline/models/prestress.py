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
    bent = bow_share(rest.bow_m / case.design.thickness_m)
    if bent > case.solve.accuracy:
        log.warning("BOW", f"the warm plate bows, which may change frequencies by {percent(bent)} and is left out")


def bow_share(bow: float) -> float:
    """Bound what the bow of a plate changes of the frequency of a mode whose waves are as short.

    A bow w of curvature w k^2 adds E t (w k^2)^2 per area of deflection to D k^4: half of 12 (w/t)^2 of the frequency.

    Parameters
    ----------
    bow : float
        w/t, over the thickness of the plate.

    Returns
    -------
    float
        Relative change.
    """
    return 6.0 * bow**2


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
