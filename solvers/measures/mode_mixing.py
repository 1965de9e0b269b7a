"""How far a mode's confinement may be off at most where its frequency is: an error mixes its neighbours into it."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from math import log
from typing import Any

import numpy as np

from geometry.elements import FloatArray, IntArray
from geometry.layout import Design
from solvers.measures.confinement import NEGLIGIBLE, TouchField, is_beyond_rows, shape_at

DECIBELS = 20.0 / log(10.0)


@dataclass(frozen=True)
class Overlaps:
    """Products of the u_z of every two modes of a class over the active and the passive touch face, (k, k) each, m2.

    projection: of each mode on the target shape of unit square, (k,) in m; strength: over its square, 1/m2.
    """

    active: FloatArray
    passive: FloatArray
    projection: FloatArray = field(default_factory=lambda: np.zeros(0))
    strength: float = np.nan

    @classmethod
    def of(cls, touch: TouchField, design: Design, symmetry: str | None = None) -> Overlaps | None:
        """Integrate over both parts; None without a passive face."""
        active = touch.is_active(design)
        if active.all():
            return None
        faces = [(touch.weights[part], touch.values[part]) for part in (active, ~active)]
        heavy = touch.weights * (shape := shape_at(touch, design, symmetry))
        projection = heavy @ touch.values / np.sqrt(max(float(heavy @ shape), 1e-300))
        surface = design.stack.mass_kg_m2
        return replace(cls.between(faces), projection=projection, strength=surface / touch.modal_mass_kg)

    @classmethod
    def between(cls, faces: Sequence[tuple[Any, Any]]) -> Overlaps:
        """From weights (q,) and values (q, k) at the points of both parts, the active one first."""
        active, passive = (np.asarray(values.conj().T @ (weights[:, None] * values)) for weights, values in faces)
        return cls(active, passive)

    @classmethod
    def of_extension(cls, touch: TouchField, design: Design) -> Overlaps | None:
        """The same with the plate beyond the last row in the passive face's place; None without any."""
        active, beyond = touch.is_active(design), is_beyond_rows(touch.points[:, 1], design)
        if not touch.weights[beyond].sum() > NEGLIGIBLE * touch.weights[active].sum():
            return None
        return cls.between([(touch.weights[part], touch.values[part]) for part in (active, beyond)])

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
        inside, outside = (part[index] / part[index, index] for part in (self.active, self.passive))
        unlike = np.abs(inside - outside)
        unlike = np.append(unlike, [np.delete(unlike, index).max(initial=0.0)] * len(ends_hz))
        return float(DECIBELS * np.linalg.norm(mixed_shares(frequency_hz, index, error, ends_hz) * unlike))

    def mixing_shape(
        self, frequency_hz: FloatArray, index: int, error: float, ends_hz: tuple[float, ...] = (), share: float = 1.0
    ) -> tuple[float, float]:
        """Bound what the same neighbours move a mode's MAC and strength by, `share` of each counted.

        With c of mode j mixed in, of either sign, the MAC is (q_i + c q_j)^2 / (A_ii + 2 c A_ij + c^2 A_jj) and the strength
        s (q_i + c q_j)^2 / (1 + c^2), with the projections q on the target shape. Parameters as of `mixing_db`.
        """
        mixed = share * mixed_shares(frequency_hz, index, error, ends_hz)
        others = np.delete(np.arange(len(frequency_hz)), index)
        if not len(others):
            return np.nan, np.nan
        known = self._moved(index, others, mixed[others])
        beyond = [self._moved(index, others, own).max(axis=-1) for own in mixed[len(frequency_hz) :]]
        mac, strength = np.linalg.norm(np.column_stack([known, *beyond]), axis=-1)
        return float(mac), float(strength)

    def _moved(self, index: int, others: IntArray, mixed: FloatArray | float) -> FloatArray:
        """Changes (2, k) of a mode's MAC and strength by a share of each of the others, of the sign that moves them most."""
        own = self.active[index, index]
        signed = np.multiply.outer([1.0, -1.0, 0.0], np.broadcast_to(mixed, len(others)))
        projected = (self.projection[index] + signed * self.projection[others]) ** 2
        inside = own + 2.0 * signed * self.active[index, others] + signed**2 * self.active[others, others]
        both = np.array([projected / np.maximum(inside, 1e-300), self.strength * projected / (1.0 + signed**2)])
        return np.asarray(np.abs(both[:, :2] - both[:, 2:]).max(axis=1))


def mixed_shares(frequency_hz: FloatArray, index: int, error: float, ends_hz: tuple[float, ...] = ()) -> FloatArray:
    """Shares of every mode, then of one at each end, that an error of the stiffness adds to a mode at most, one each.

    Parameters as of `Overlaps.mixing_db`.
    """
    own, tones = frequency_hz[index], np.append(frequency_hz, ends_hz)
    apart = np.abs(tones**2 - own**2)
    apart[index] = np.inf
    return np.minimum(2.0 * error * own * tones / np.maximum(apart, 1e-300), 1.0)


def mixed_energy(
    share_of: Callable[[FloatArray], FloatArray], vectors: FloatArray, index: int, mixed: FloatArray
) -> tuple[float, float]:
    """A mode's share of a part's energy, and what neighbours change of it, each of the worse sign, added by their squares.

    Parameters
    ----------
    share_of : callable
        Gives the share (k,) of M-orthonormal motions (dof, k).
    vectors : ndarray, shape (dof, k)
        Of the modes.
    index : int
        The mode whose share it is.
    mixed : ndarray, shape (k,)
        How much of each of the others is added.
    """
    own, others = vectors[:, [index]], np.delete(np.arange(vectors.shape[1]), index)
    added = [
        (own + sign * mixed[others] * vectors[:, others]) / np.sqrt(1.0 + mixed[others] ** 2) for sign in (1.0, -1.0)
    ]
    shares = share_of(np.hstack([own, *added]))
    moved = np.abs(shares[1:] - shares[0]).reshape(2, -1).max(axis=0, initial=0.0)
    return float(shares[0]), float(np.linalg.norm(moved))
