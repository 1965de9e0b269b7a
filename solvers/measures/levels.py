"""Levels in dB of one part of a plate over another, and from which on a motion counts as confined."""

from __future__ import annotations

from typing import Any

import numpy as np

from geometry.elements import FloatArray

CONFINED_DB = 10.0  # rms on the active face over rms on the passive one


def ratio_db(inside: Any, outside: Any) -> FloatArray:
    """20 log10 of rms values, inside over outside; infinite where nothing moves outside."""
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.asarray(20.0 * np.log10(np.asarray(inside) / np.asarray(outside)))
