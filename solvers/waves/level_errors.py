"""Error bars of levels over frequency: what a level may change by while frequencies lie anywhere within their bars.

A cell whose frequencies err by at most e, relative, has at f the level that the exact one has somewhere from f (1 - e) to
f (1 + e): the bar is the largest change over that interval, which near an edge or a resonance is not the slope times its width.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from geometry.elements import BoolArray, FloatArray

BENT = 0.5  # of the larger of two neighbouring steps: where they differ by more, samples do not tell the curve between them
FLAT_DB = 1e-3
ENDS = (-1.0, 1.0)  # of the interval, where the level is looked up: computed for a curve that bends
Level = Callable[[float], float | None]


def level_bars(frequency_hz: FloatArray, level_db: FloatArray, error: float | None, level: Level) -> list[float | None]:
    """Bound the error of levels by the relative error of frequencies.

    Parameters
    ----------
    frequency_hz, level_db : ndarray, shape (n,)
        The samples, ascending; NaN for no level.
    error : float or None
        Relative half-width of the bars of frequencies; None without an estimate.
    level : callable
        The level in dB at a frequency in Hz; called where the samples do not resolve the curve.

    Returns
    -------
    list of float or None
        Half-widths in dB; None where there is no level or no estimate.
    """
    if error is None or not np.isfinite(error):
        return [None] * len(level_db)
    bent = _bent(level_db)
    return [
        None if np.isnan(own) else _bar(frequency_hz, level_db, index, error, level if bent[index] else None)
        for index, own in enumerate(level_db)
    ]


def _bent(level_db: FloatArray) -> BoolArray:
    """Samples next to which the curve bends, (n,): its steps differ there, or it has no neighbour to tell."""
    if len(level_db) < 3:
        return np.ones(len(level_db), dtype=bool)
    step = np.diff(level_db)
    larger = np.maximum(np.abs(step[1:]), np.abs(step[:-1]))
    there = np.isnan(larger) | ((np.abs(np.diff(step)) > BENT * larger) & (larger > FLAT_DB))
    bent = np.concatenate([[there[0]], there, [there[-1]]])
    return np.asarray(bent | np.append(bent[1:], False) | np.append(False, bent[:-1]))


def _bar(frequency_hz: FloatArray, level_db: FloatArray, index: int, error: float, level: Level | None) -> float | None:
    own, at = float(level_db[index]), float(frequency_hz[index])
    inside = level_db[np.abs(frequency_hz - at) <= error * at]
    ends = [at * (1.0 + end * error) for end in ENDS]
    if level is None:
        others = [_extrapolated(frequency_hz, level_db, end) for end in ends]
    else:
        others = [np.nan if (found := level(end)) is None else found for end in ends]
    changes = np.abs(np.concatenate([inside, others]) - own)
    return None if np.isnan(changes).any() else float(changes.max())


def _extrapolated(frequency_hz: FloatArray, level_db: FloatArray, at_hz: float) -> float:
    """The level between samples, and on the line through the last two beyond them."""
    index = int(np.clip(np.searchsorted(frequency_hz, at_hz) - 1, 0, len(frequency_hz) - 2))
    share = (at_hz - frequency_hz[index]) / (frequency_hz[index + 1] - frequency_hz[index])
    return float(level_db[index] + share * (level_db[index + 1] - level_db[index]))
