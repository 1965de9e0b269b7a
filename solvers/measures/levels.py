"""Levels in dB of one part of a plate over another, and from which on a motion counts as confined."""

from __future__ import annotations

from typing import Any

import numpy as np

from geometry.elements import FloatArray

LARGEST_DB = 3000.0  # of a bar: ten to a tenth of more is no number
CONFINED_DB = 10.0  # rms on the active face over rms on the passive one


def ratio_db(inside: Any, outside: Any) -> FloatArray:
    """20 log10 of rms values, inside over outside; infinite where nothing moves outside."""
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.asarray(20.0 * np.log10(np.asarray(inside) / np.asarray(outside)))


def share_error(share: float | None, level_error_db: float | None) -> float | None:
    """Half-width of the bar of a part's share of the squares from that of its level; None where one is unknown.

    Of areas given, share / (1 - share) goes with 10^(level/10), so that a level off by e puts the share
    at share g / (1 - share + share g) with g = 10^(+-e/10): the farther of both counts.

    >>> from solvers.measures.levels import share_error
    >>> round(share_error(0.9, 0.1), 4), share_error(1.0, 0.1), share_error(0.9, None)
    (0.0021, 0.0, None)
    """
    if share is None or level_error_db is None:
        return None
    factor = 10.0 ** (min(level_error_db, LARGEST_DB) / 10.0)
    moved = (share * g / (1.0 - share + share * g) for g in (factor, 1.0 / factor))
    return max(abs(each - share) for each in moved)
