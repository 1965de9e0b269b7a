"""Which of a plate's modes is the wanted one, by one rule for every model: single, split among several, or none.

A mode's score is its strength times its zone share (`solvers.measures.confinement`): how much of the zone's motion in
the wanted shape it carries, and how much of its own motion stays there. Both are of the mode alone, so no window
decides. It must look like the wanted shape (MAC) to stand for it at all.

The constants are argued on the 54 plates of studies/grid.toml, whose table lists status, strength and share of each: all
plates that hold their mode by 10 dB are single, those whose shape is spread over several modes are split.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from geometry.elements import FloatArray

SIMILAR = 0.5  # MAC: below it less than half of the zone's motion is the wanted shape
CLEAR = 0.8  # MAC from which one mode may carry the shape alone
LEAD = 1.5  # over the strongest rival: by less, another design or mesh turns the two over
MAJORITY = 0.5  # of all scores in the window: more than all others together
PAST = 0.2  # of the wanted frequency on both sides: as far as a window has to reach before it can tell
RIVAL = 0.25  # of the best score: others that are named
NAMED = 3  # rivals at most

Status = Literal["single", "split", "none"]


@dataclass(frozen=True)
class Verdict:
    """The wanted mode among others: its index and its rivals', strongest first; None and () where there is none.

    share: of the sum of all scores, each weighted by its MAC.
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


def verdict(strength: FloatArray, zone_share: FloatArray, mac: FloatArray) -> Verdict:
    """The wanted mode by measures (k,) of every mode of its symmetry class within a window.

    The strongest mode of those similar to the wanted shape; single where it is clear, leads its rivals, each counted by what
    of it looks like the wanted shape, and carries more than all of them together.
    """
    scores, modal_overlap = score(strength, zone_share), np.nan_to_num(mac)
    candidates = np.where(modal_overlap >= SIMILAR, scores, 0.0)
    if not candidates.any():
        return NONE
    best = int(np.argmax(candidates))
    weights = weight(strength, zone_share, mac)
    others = np.delete(weights, best)
    clear = modal_overlap[best] >= CLEAR and weights[best] >= LEAD * others.max(initial=0.0)
    share = float(weights[best] / weights.sum())
    rivals = tuple(
        int(i) for i in np.argsort(-weights, kind="stable") if i != best and weights[i] >= RIVAL * weights[best]
    )
    return Verdict("single" if clear and share >= MAJORITY else "split", best, rivals[:NAMED], share)


def reaching(window_hz: tuple[float, float], frequency_hz: float) -> tuple[float, float]:
    """The window, widened until it reaches past a mode on both sides."""
    low, high = (1.0 - PAST) * frequency_hz, (1.0 + PAST) * frequency_hz
    return min(window_hz[0], low), max(window_hz[1], high)
