"""The target mode of a plate: the rule that chooses it among modes, and the search that computes enough of them."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Generic, Literal, Protocol, TypeVar

import numpy as np
from numpy.typing import NDArray

from geometry.elements import FloatArray

# -- rule --------------------------------------------------------------------------------------------------------------
# Which of a plate's modes is the target mode, by one rule for every model: single, split among several, or none.
# A mode's weight is its strength times its zone share times its MAC (`solvers.measures.confinement`): how much of the
# zone's motion in the target shape it carries, how much of its own motion stays there, and how much of that has the
# shape. It must look like the target shape to stand for it at all. Which modes are computed,
# the search below decides.
#
# The constants are argued on the 54 plates of studies/grid.toml, whose table lists status, strength and share of
# each: all plates that hold their mode by 10 dB are single, those whose shape is spread over several modes are split.

MIN_MAC = 0.5  # below this MAC less than half of the zone's motion is the target shape
MIN_MAC_SINGLE = 0.8  # MAC from which one mode may carry the shape alone
LEAD = 1.5  # over the strongest rival: by less, another design or mesh exchanges the two
MAJORITY = 0.5  # of all weights in the window: more than all others together
WINDOW_MARGIN = 0.2  # of the target frequency: margin of the window on both sides of it
RIVAL = 0.25  # of the best weight: others listed as rivals
MAX_RIVALS = 3  # rivals at most

Status = Literal["single", "split", "none"]
BoolArray = NDArray[np.bool_]


@dataclass(frozen=True)
class Verdict:
    """The target mode among others: its index and its rivals', strongest first; None and () where there is none.

    share: of the sum of all weights near it.
    """

    status: Status
    index: int | None
    rivals: tuple[int, ...] = ()
    share: float | None = None


NONE = Verdict("none", None)


def _weight(strength: FloatArray, zone_share: FloatArray, mac: FloatArray) -> FloatArray:
    """Strength times zone share, weighted by the mode's likeness to the target shape, (k,); a plate without passive face has
    all of its motion in the zone, unknown strengths and likenesses count 0.
    """
    share = np.where(np.isfinite(zone_share), zone_share, 1.0)
    return np.asarray(np.nan_to_num(strength) * share * np.nan_to_num(mac))


def verdict(
    strength: FloatArray, zone_share: FloatArray, mac: FloatArray, candidate: BoolArray | None = None,
    near: BoolArray | None = None, missing: float = 0.0,
) -> Verdict:  # fmt: skip
    """Judge which mode of a symmetry class is the target mode.

    It is the candidate of the largest weight among those similar to the target shape. It is single if its MAC is high, it
    leads every other mode, computed or not, by LEAD, and it carries more than all others near it together.

    Parameters
    ----------
    strength, zone_share, mac : ndarray, shape (k,)
        Measures of every known mode.
    candidate, near : ndarray of bool, shape (k,), optional
        Modes that may be the target mode; modes that its share is counted among. All by default.
    missing : float, optional
        Upper bound of the weight of any unknown mode, dimensionless.

    Returns
    -------
    Verdict
        Status, index, rivals and share.
    """
    modal_overlap, weights = np.nan_to_num(mac), _weight(strength, zone_share, mac)
    everything = np.ones(len(weights), dtype=bool)
    candidate, near = (everything if mask is None else mask for mask in (candidate, near))
    candidates = np.where(candidate & (modal_overlap >= MIN_MAC), weights, 0.0)
    if not candidates.any():
        return NONE
    best = int(np.argmax(candidates))
    strongest_other = max(np.delete(weights, best).max(initial=0.0), missing)
    clear = modal_overlap[best] >= MIN_MAC_SINGLE and weights[best] >= LEAD * strongest_other
    share = float(weights[best] / weights[near | (np.arange(len(weights)) == best)].sum())
    rivals = tuple(
        int(i) for i in np.argsort(-weights, kind="stable") if i != best and weights[i] >= RIVAL * weights[best]
    )
    return Verdict("single" if clear and share >= MAJORITY else "split", best, rivals[:MAX_RIVALS], share)


def widened_window(window_hz: tuple[float, float], frequency_hz: float) -> tuple[float, float]:
    """Widen a window until it extends beyond a mode on both sides.

    Parameters
    ----------
    window_hz : tuple of float
        Ends of the window, in Hz.
    frequency_hz : float
        Frequency of the mode.

    Returns
    -------
    tuple of float
        Ends of the widened window, in Hz.
    """
    low, high = (1.0 - WINDOW_MARGIN) * frequency_hz, (1.0 + WINDOW_MARGIN) * frequency_hz
    return min(window_hz[0], low), max(window_hz[1], high)


# -- search ------------------------------------------------------------------------------------------------------------
# Search for the target mode of a plate: one path through the frequencies for every question.
# Candidates lie from the window's lower end upwards. The search begins with the window and widens it until it reaches
# past the mode found on both sides. Over all modes of a symmetry class the strengths sum to 1 at most, and no weight
# exceeds its strength: 1 less the strengths found bounds the weight of any mode that was not computed. Where that
# leaves room for a rival of a mode that would be single, a few solves bound what any one mode may have of it
# (`solvers.fem.missing_mode`). Where they leave room too, modes down to rest are computed, then higher ones, up to a
# limit beyond which nothing is single.

STEP = 1.25  # of the upper end: one step of the search upwards
STEPS = 3  # upwards at most
ROUNDS = 12  # widenings at most


class Measured(Protocol):
    """A mode with its measures (`solvers.measures.confinement`); None or NaN where one is unknown."""

    @property
    def frequency_hz(self) -> float: ...
    @property
    def strength(self) -> float | None: ...
    @property
    def zone_share(self) -> float | None: ...
    @property
    def mac(self) -> float | None: ...


T = TypeVar("T", bound=Measured)
Solve = Callable[[float, float], Sequence[T]]
Interval = tuple[float, float]
Largest = Callable[[Sequence[T], Interval], float]


@dataclass(frozen=True)
class Found(Generic[T]):
    """Outcome of a search.

    Attributes
    ----------
    verdict : Verdict
        Indices into `modes`.
    modes : tuple
        Every mode of the class within `reach_hz`, ascending.
    window_hz : (float, float)
        Interval, Hz, whose modes the target mode's share is counted among.
    reach_hz : (float, float)
        Interval, Hz, in which every mode of the class is known.
    missing : float
        Upper bound of the weight of any mode outside `reach_hz`.
    """

    verdict: Verdict
    modes: tuple[T, ...]
    window_hz: Interval
    reach_hz: Interval
    missing: float

    @property
    def is_open(self) -> bool:
        """Whether a mode that was not computed could rival the target mode."""
        best = self.verdict.index
        return best is not None and leaves_room(self.missing, float(weights(self.modes)[best]))


def search(
    window_hz: Interval, known_hz: Interval, known: Sequence[T], solve: Solve[T], largest: Largest[T] | None = None
) -> Found[T]:
    """Search the target mode from a window outwards.

    Parameters
    ----------
    window_hz : (float, float)
        Where the search begins, Hz; no candidate lies below it.
    known_hz : (float, float)
        Interval, Hz, whose modes `known` holds: they are not computed again.
    known : sequence
        Modes of the class.
    solve : callable
        Returns every mode of the class between two frequencies in Hz.
    largest : callable, optional
        Returns an upper bound of the strength of any one mode outside an interval, from all modes within it.

    Returns
    -------
    Found
        Independent of `known`.
    """
    ends = reach = window_hz
    steps = 0
    for _ in range(ROUNDS):
        known, known_hz = _completed(known, known_hz, reach, solve)
        found = _judged(_within(known, reach), window_hz[0], ends, reach)
        if found.verdict.index is None:
            break
        wider = widened_window(ends, found.modes[found.verdict.index].frequency_hz)
        if wider != ends:
            ends, reach = wider, (min(reach[0], wider[0]), max(reach[1], wider[1]))
            continue
        if not (found.is_open and _judged(found.modes, window_hz[0], ends, reach, 0.0).verdict.status == "single"):
            break
        if largest is not None:
            bound = min(found.missing, largest(found.modes, reach))
            found = _judged(found.modes, window_hz[0], ends, reach, bound)
        if not found.is_open:
            break
        if reach[0] > 0.0:
            reach = 0.0, reach[1]
        elif steps < STEPS:
            steps, reach = steps + 1, (0.0, STEP * reach[1])
        else:
            break
    return found


def leaves_room(missing: float, best: float) -> bool:
    """Test whether an unknown mode may come nearer to the best one than a single mode allows.

    Parameters
    ----------
    missing : float
        Largest weight of an unknown mode, dimensionless.
    best : float
        Weight of the best mode, dimensionless.

    Returns
    -------
    bool
        True if the verdict is open.
    """
    return LEAD * missing > best


def missing_strength(modes: Sequence[Measured]) -> float:
    """Compute the strength of all modes of a class that are not known: 1 less that of the known ones.

    Parameters
    ----------
    modes : sequence of Measured
        The known modes.

    Returns
    -------
    float
        At least 0, dimensionless.
    """
    return max(0.0, 1.0 - float(np.nansum(measures(modes)[0])))


def measures(modes: Sequence[Measured]) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Collect the measures of modes.

    Parameters
    ----------
    modes : sequence of Measured
        The modes.

    Returns
    -------
    strength, zone_share, mac : ndarray, shape (k,)
        NaN where unknown.
    """
    values = np.array([(mode.strength, mode.zone_share, mode.mac) for mode in modes], dtype=float).reshape(-1, 3)
    return values[:, 0], values[:, 1], values[:, 2]


def weights(modes: Sequence[Measured]) -> FloatArray:
    """Part of the target shape that each mode carries.

    Parameters
    ----------
    modes : sequence of Measured
        The modes.

    Returns
    -------
    ndarray, shape (k,)
        Strength times zone share times MAC, 0 to 1.
    """
    return _weight(*measures(modes))


def _judged(
    modes: Sequence[T], low_hz: float, ends: Interval, reach: Interval, missing: float | None = None
) -> Found[T]:
    """The verdict over the modes within reach: candidates from low_hz upwards, shares among those between the ends."""
    tones = np.array([mode.frequency_hz for mode in modes])
    bound = missing_strength(modes) if missing is None else missing
    near = (tones >= ends[0]) & (tones <= ends[1])
    judged = verdict(*measures(modes), tones >= low_hz, near, bound) if len(modes) else NONE
    return Found(judged, tuple(modes), ends, reach, bound)


def _within(modes: Sequence[T], ends: Interval) -> tuple[T, ...]:
    inside = (mode for mode in modes if ends[0] <= mode.frequency_hz <= ends[1])
    return tuple(sorted(inside, key=lambda mode: mode.frequency_hz))


def _completed(modes: Sequence[T], known: Interval, ends: Interval, solve: Solve[T]) -> tuple[tuple[T, ...], Interval]:
    """Every mode over the known interval and the ends together."""
    below = solve(ends[0], known[0]) if ends[0] < known[0] else ()
    above = solve(known[1], ends[1]) if ends[1] > known[1] else ()
    return (*below, *modes, *above), (min(ends[0], known[0]), max(ends[1], known[1]))
