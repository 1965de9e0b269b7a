"""How far a mode's confinement may be off at most where its frequency is: an error mixes its neighbours into it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import log
from typing import Any

import numpy as np

from geometry.elements import FloatArray
from geometry.layout import Design
from solvers.measures.confinement import TouchField

DECIBELS = 20.0 / log(10.0)


@dataclass(frozen=True)
class Overlaps:
    """Products of the u_z of every two modes of a class over the active and the passive touch face, (k, k) each, m2."""

    active: FloatArray
    passive: FloatArray

    @classmethod
    def of(cls, touch: TouchField, design: Design) -> Overlaps | None:
        """Integrate over both parts; None without a passive face."""
        active = np.abs(touch.points[:, 1]) < design.width_m / 2.0
        faces = [(touch.weights[part], touch.values[part]) for part in (active, ~active)]
        return None if active.all() else cls.between(faces)

    @classmethod
    def between(cls, faces: Sequence[tuple[Any, Any]]) -> Overlaps:
        """From weights (q,) and values (q, k) at the points of both parts, the active one first."""
        return cls(*(np.asarray(values.conj().T @ (weights[:, None] * values)) for weights, values in faces))

    def mixing_db(self, frequency_hz: FloatArray, index: int, error: float, ends_hz: tuple[float, ...] = ()) -> float:
        """Bound what neighbours move a mode's confinement by where frequencies may be off by `error`, relative (parlett1998).

        A stiffness too high by d >= 0 with d_jj <= 2 error w_j^2 has |d_ij| <= 2 error w_i w_j, and adds to mode i of its
        neighbours c_j = d_ij / (w_i^2 - w_j^2), one at most. Each moves the level by (20 / ln 10) c_j (A_ij/A_ii - P_ij/P_ii)
        with the overlaps A and P. Neighbours add up by their squares.

        Parameters
        ----------
        frequency_hz : (k,) array
            Of the modes.
        index : int
            The mode whose level it is.
        error : float
            Relative error of the frequencies.
        ends_hz : tuple of float
            Of the interval in which all modes are known; beyond each one more may lie, as unlike as the most unlike of these.

        Returns
        -------
        float
            Decibels.
        """
        own = frequency_hz[index]
        apart = np.abs(frequency_hz**2 - own**2)
        apart[index] = np.inf
        inside, outside = (part[index] / part[index, index] for part in (self.active, self.passive))
        unlike = np.abs(inside - outside)
        tones, apart = np.append(frequency_hz, ends_hz), np.append(apart, np.abs(np.square(ends_hz) - own**2))
        unlike = np.append(unlike, [np.delete(unlike, index).max(initial=0.0)] * len(ends_hz))
        mixed = np.minimum(2.0 * error * own * tones / np.maximum(apart, 1e-300), 1.0)
        return float(DECIBELS * np.linalg.norm(mixed * unlike))


def mixing_db(
    touch: TouchField,
    frequency_hz: FloatArray,
    index: int,
    design: Design,
    error: float,
    ends_hz: tuple[float, ...] = (),
) -> float | None:
    """Bound one mode's level as `Overlaps.mixing_db` does; None without a passive face."""
    overlaps = Overlaps.of(touch, design)
    return None if overlaps is None else overlaps.mixing_db(frequency_hz, index, error, ends_hz)
