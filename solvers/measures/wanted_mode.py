"""Which of a plate's modes is the wanted one, by one rule for every model: single, split among several, or none.

A mode's weight is its strength times its zone share times its MAC (`solvers.measures.confinement`): how much of the zone's
motion in the wanted shape it carries, how much of its own motion stays there, and how much of that has the shape. It must look
like the wanted shape to stand for it at all. Which modes are computed, `solvers.measures.wanted_search` decides.

The constants are argued on the 54 plates of studies/grid.toml, whose table lists status, strength and share of each: all
plates that hold their mode by 10 dB are single, those whose shape is spread over several modes are split.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from geometry.elements import FloatArray

SIMILAR = 0.5  # MAC: below it less than half of the zone's motion is the wanted shape
CLEAR = 0.8  # MAC from which one mode may carry the shape alone
LEAD = 1.5  # over the strongest rival: by less, another design or mesh turns the two over
MAJORITY = 0.5  # of all weights in the window: more than all others together
PAST = 0.2  # of the wanted frequency on both sides: as far as a window has to reach before it can tell
RIVAL = 0.25  # of the best weight: others that are named
NAMED = 3  # rivals at most

Status = Literal["single", "split", "none"]
BoolArray = NDArray[np.bool_]


@dataclass(frozen=True)
class Verdict:
    """The wanted mode among others: its index and its rivals', strongest first; None and () where there is none.

    share: of the sum of all weights near it.
    """

    status: Status
    index: int | None
    rivals: tuple[int, ...] = ()
    share: float | None = None


NONE = Verdict("none", None)


def score(strength: FloatArray, zone_share: FloatArray) -> FloatArray:
    """Strength times zone share, (k,); a plate without passive face has all of its motion in the zone, unknown counts 0."""
    return np.asarray(np.nan_to_num(strength) * np.where(np.isfinite(zone_share), zone_share, 1.0))


def weight(strength: FloatArray, zone_share: FloatArray, mac: FloatArray) -> FloatArray:
    """The score counted by what of a mode looks like the wanted shape, (k,)."""
    return score(strength, zone_share) * np.nan_to_num(mac)


def verdict(
    strength: FloatArray, zone_share: FloatArray, mac: FloatArray, candidate: BoolArray | None = None,
    near: BoolArray | None = None, missing: float = 0.0,
) -> Verdict:  # fmt: skip
    """Judge which mode of a symmetry class is the wanted one.

    The candidate of the largest weight, similar to the wanted shape. It is single where it is clear, leads by LEAD every other
    mode, computed or not, and carries more than all others near it together.

    Parameters
    ----------
    strength, zone_share, mac : ndarray, shape (k,)
        Measures of every mode known.
    candidate, near : ndarray of bool, shape (k,), optional
        Modes that may be the wanted one; modes that its share is counted among. All by default.
    missing : float
        Upper bound of the weight of any mode that is not known.

    Returns
    -------
    Verdict
        Status, index, rivals and share.
    """
    modal_overlap, weights = np.nan_to_num(mac), weight(strength, zone_share, mac)
    everything = np.ones(len(weights), dtype=bool)
    candidate, near = (everything if mask is None else mask for mask in (candidate, near))
    candidates = np.where(candidate & (modal_overlap >= SIMILAR), weights, 0.0)
    if not candidates.any():
        return NONE
    best = int(np.argmax(candidates))
    strongest_other = max(np.delete(weights, best).max(initial=0.0), missing)
    clear = modal_overlap[best] >= CLEAR and weights[best] >= LEAD * strongest_other
    share = float(weights[best] / weights[near | (np.arange(len(weights)) == best)].sum())
    rivals = tuple(
        int(i) for i in np.argsort(-weights, kind="stable") if i != best and weights[i] >= RIVAL * weights[best]
    )
    return Verdict("single" if clear and share >= MAJORITY else "split", best, rivals[:NAMED], share)


def reaching(window_hz: tuple[float, float], frequency_hz: float) -> tuple[float, float]:
    """The window, widened until it reaches past a mode on both sides."""
    low, high = (1.0 - PAST) * frequency_hz, (1.0 + PAST) * frequency_hz
    return min(window_hz[0], low), max(window_hz[1], high)
