"""The modes nearest to a frequency on a coarse mesh: how high they lie, and how many of each symmetry class they are.

They choose the mesh and the number of modes that each class is asked for, before anything is solved on it; what is told is
counted on the finer mesh all the same.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

from geometry.elements import FloatArray
from pipeline.case.model import Case
from pipeline.logs import TerminalLog
from pipeline.models import parts
from pipeline.planning.model_choice import SOLID, ModelChoice, model_choice_of
from pipeline.planning.request import Request
from solvers.errors import CountMismatch, SolverError
from solvers.fem.eigen import modes_near

ORDER, OFF = 2, 0.125  # without layers at the singular edges: frequencies up to so much too high
QUIET = TerminalLog(True)


@dataclass(frozen=True)
class CoarseModes:
    """The highest of the modes nearest to a frequency, Hz, and how many to ask each symmetry class for."""

    highest_hz: float
    counts: dict[str | None, int]


def coarse_modes(case: Case, query: Request, choice: ModelChoice) -> CoarseModes | None:
    """The modes of a request on a coarse mesh; None for a band, for what is reduced or meshed by tetrahedra, and where the
    coarse mesh cannot tell.

    All classes by quadratic elements; the class of the highest mode once more by elements for its frequency, without layers,
    which puts it two per cent or so too high, and further where classes change places.
    """
    near, count, fine = query.near_hz, query.count, choice.hexahedra
    if query.band_hz or near is None or count is None or choice.model != SOLID or choice.part == "plate":
        return None
    if fine is None or choice.edge_m is not None or fine.order <= ORDER:
        return None
    rough = _built(case, choice, ORDER)
    try:
        tones = {
            one: modes_near(rough.pencil(one), near, count).frequency_hz
            for one in ((query.symmetry,) if query.symmetry else rough.symmetries)
        }
        away = sorted(abs(tone - near) for each in tones.values() for tone in each)
        reach = away[min(count, len(away)) - 1]
        inside = {one: int((abs(each - near) <= reach).sum()) for one, each in tones.items()}
        last = max(inside, key=lambda one: float(tones[one][abs(tones[one] - near) <= reach].max(initial=0.0)))
        there = model_choice_of(case, query.part, near + reach)
        better = modes_near(_built(case, there, fine.order).pencil(last), near, inside[last]).frequency_hz
    except (CountMismatch, SolverError):
        return None
    return CoarseModes(
        float(better.max()), {one: _needed_count(each, near, reach, count) for one, each in tones.items()}
    )


def _needed_count(tones: FloatArray, near_hz: float, reach_hz: float, count: int) -> int:
    """How many modes to ask a class for: of the lowest one more than may lie within reach; about a frequency the coarse
    mesh does not tell on which side of it a mode lies.
    """
    return count if near_hz else min(count, int((tones <= (1.0 + OFF) * reach_hz).sum()) + 1)


def _built(case: Case, choice: ModelChoice, order: int) -> parts.PartModel:
    assert choice.hexahedra
    coarse = replace(choice.hexahedra, order=order, layers=0, skipped=0)
    return parts.built(case, replace(choice, hexahedra=coarse, mesh_level=None), QUIET, [])
