"""How far a mode's confinement may be off at most where its frequency is: an error mixes its neighbours into it."""

from __future__ import annotations

from math import log

import numpy as np

from geometry.elements import BoolArray, FloatArray
from geometry.layout import Design
from solvers.measures.confinement import TouchField

DECIBELS = 20.0 / log(10.0)


def mixing_db(
    touch: TouchField,
    frequency_hz: FloatArray,
    index: int,
    design: Design,
    error: float,
    ends_hz: tuple[float, ...] = (),
) -> float | None:
    """What may move a mode's confinement at most, dB, where frequencies may be off by `error`, relative (parlett1998).

    A stiffness too high by d >= 0 with d_jj <= 2 error w_j^2 has |d_ij| <= 2 error w_i w_j, and adds to mode i of its
    neighbours c_j = d_ij / (w_i^2 - w_j^2), one at most. Each moves the level by (20 / ln 10) c_j (A_ij / A_ii - P_ij / P_ii),
    where A and P are products of u_z over the active and the passive touch face. Neighbours add up by their squares.

    `touch` holds the modes of one symmetry class, `frequency_hz` (k,) theirs, `index` the mode's; None without a passive face.
    ends_hz: of the interval in which all modes are known; beyond each one more may lie, as unlike as the most unlike of these.
    """
    active = np.abs(touch.points[:, 1]) < design.width_m / 2.0
    if active.all():
        return None
    inside, outside = (_over_own(touch, part, index) for part in (active, ~active))
    own = frequency_hz[index]
    apart = np.abs(frequency_hz**2 - own**2)
    apart[index] = np.inf
    unlike = np.abs(inside - outside)
    tones, apart = np.append(frequency_hz, ends_hz), np.append(apart, np.abs(np.square(ends_hz) - own**2))
    unlike = np.append(unlike, [np.delete(unlike, index).max(initial=0.0)] * len(ends_hz))
    mixed = np.minimum(2.0 * error * own * tones / np.maximum(apart, 1e-300), 1.0)
    return float(DECIBELS * np.linalg.norm(mixed * unlike))


def _over_own(touch: TouchField, part: BoolArray, index: int) -> FloatArray:
    """Products of every mode's u_z with one mode's over a part of the face, over that mode's with itself, (k,)."""
    values = touch.values[part]
    products = (touch.weights[part] * values[:, index]) @ values
    return np.asarray(products / products[index])
