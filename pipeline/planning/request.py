"""What to look for in a part: what the command line said, completed by the case, then by pre-design."""

from __future__ import annotations

from dataclasses import dataclass, replace

from pipeline.case.model import Case
from pipeline.planning import mesh_rules
from solvers.measures.confinement import wanted_symmetry

DEFAULT_COUNT = 20
SIGNS = {"SS": "++", "SA": "+-", "AS": "-+", "AA": "--"}  # u_z symmetric or antisymmetric, x then y: as signs
MEASURED = ("plate", "zone")  # parts whose touch face tells which mode is the wanted one


@dataclass(frozen=True)
class Expected:
    """The wanted mode as another model has it: its frequency and its strength in the wanted shape."""

    frequency_hz: float
    strength: float


@dataclass(frozen=True)
class Request:
    """What to solve: a band, or `count` modes near a frequency (0: the lowest); one symmetry class or all.

    search: look for the wanted mode in its own window, beyond what is asked for; else among the modes found alone.
    expected: look for it in the band asked for, which is widened only while it holds no mode as strong as that one.
    """

    part: str = "plate"
    band_hz: tuple[float, float] | None = None
    near_hz: float | None = None
    count: int | None = None
    symmetry: str | None = None
    search: bool = True
    expected: Expected | None = None

    @property
    def highest_hz(self) -> float | None:
        """Up to where a model has to be good, Hz; None where the request does not say."""
        return self.band_hz[1] if self.band_hz else 2.0 * (self.near_hz or 0.0) or None


def with_defaults(case: Case, request: Request) -> Request:
    """Complete a request by the case, then by pre-design."""
    solve, query = case.solve, request
    if query.band_hz is None and query.near_hz is None and query.count is None:
        query = replace(query, band_hz=solve.band_hz, near_hz=solve.near_hz, count=solve.count)
    if query.band_hz is not None:
        return query
    if query.near_hz is not None:
        return replace(query, count=query.count or solve.count or DEFAULT_COUNT)
    if query.count is not None:
        return replace(query, near_hz=0.0)
    if query.part == "pillar":
        return replace(query, near_hz=0.0, count=4)
    wanted = case.symmetry_wanted if query.part == "plate" else wanted_symmetry(case.design.nodal_lines)
    return replace(query, band_hz=mesh_rules.wanted_window_hz(case.design), symmetry=query.symmetry or wanted)


def of_case(case: Case) -> Request:
    """Request of a study for the plate's modes: the case's window and the wanted mode's in one, of the wanted mode's
    class.
    """
    solve = case.solve
    return with_search(case, Request("plate", solve.band_hz, solve.near_hz, solve.count, case.symmetry_wanted))


def wanted_window_hz(case: Case, query: Request) -> tuple[float, float] | None:
    """Window in which the wanted mode is searched first; None for parts and symmetry classes that have none."""
    own = query.part in MEASURED and query.symmetry in (None, wanted_symmetry(case.design.nodal_lines))
    return mesh_rules.search_window_hz(case.design) if own else None


def model_high_hz(case: Case, query: Request) -> float:
    """Highest frequency, Hz, for which the model has to be good: the request's, and the wanted mode's window where
    they meet.
    """
    high = query.highest_hz or mesh_rules.wanted_window_hz(case.design)[1]
    window = wanted_window_hz(case, query) if query.search else None
    meets = window and window[0] <= high and (query.band_hz is None or query.band_hz[0] <= window[1])
    return max(high, window[1]) if window and meets else high


def response_high_hz(case: Case, band_hz: tuple[float, float]) -> float:
    """Highest frequency, Hz, for which the plate of a response has to be good: that of its modes in the same band, so that
    both are assembled from the same reduced panels.
    """
    return model_high_hz(case, Request("plate", band_hz))


def with_search(case: Case, query: Request) -> Request:
    """Widen the request's band by the wanted mode's window where they meet."""
    window = wanted_window_hz(case, query) if query.search else None
    band = query.band_hz
    if not window or not band or band[0] > window[1] or window[0] > band[1]:
        return query
    return replace(query, band_hz=(min(band[0], window[0]), max(band[1], window[1])))


def driven_band_hz(case: Case, band_hz: tuple[float, float] | None) -> tuple[float, float]:
    """Band of a response or an attenuation: the given one, else the case's, else about the wanted mode."""
    return band_hz or case.solve.band_hz or mesh_rules.wanted_window_hz(case.design)
