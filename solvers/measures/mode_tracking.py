"""Modes followed from one plate to the next: their shapes on the active face, compared and assigned one to one.

u_z on the active face is kept as coefficients c of orthonormal Legendre products, so that plates of different meshes, rows and
pitches compare: MAC_ij = |c_i . d_j|^2 / (|c_i|^2 |d_j|^2) (allemang2003). The assignment maximises the sum of MAC times the
geometric mean of the shares inside the zone (Hungarian method, kuhn1955).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.polynomial import legendre

from geometry.elements import FloatArray
from geometry.layout import Design
from solvers.measures.confinement import TouchField

ALONG, ACROSS = 8, 6  # degrees: beyond the nodal lines along the zone; across it
KEPT = 0.5  # least MAC of one and the same mode
RIVAL = 0.8  # of the score: a second mode that comes as near shares the shape; an even mixture of two gives 0.9 to 1


@dataclass(frozen=True)
class Shapes:
    """Modes of one plate: frequency_hz (k,), share of u_z^2 inside the zone (k,), coefficients (k, c) on the active face."""

    frequency_hz: FloatArray
    share: FloatArray
    coefficients: FloatArray


@dataclass(frozen=True)
class Step:
    """Where a mode of the first plate went: its row in the second (None when lost), their MAC, and the best rival's."""

    row: int | None
    mac: float
    rival: float

    @property
    def kept(self) -> bool:
        """Whether the identity holds: alike enough, and no other mode nearly as alike."""
        return self.row is not None and self.mac >= KEPT and self.rival < RIVAL * self.mac


def zone_coefficients(touch: TouchField, design: Design, symmetry: str | None) -> FloatArray:
    """c_ij = int u_z P_i(2x/L) P_j(2y/W) over the active face, P orthonormal there, shape (k, c); 0 for the wrong symmetry."""
    active = touch.is_active(design)
    points, values = touch.points[active], touch.values[active] * touch.weights[active, None]
    along = _orthonormal(points[:, 0], design.length_m, design.nodal_lines + ALONG)
    across = _orthonormal(points[:, 1], design.width_m, ACROSS)
    for basis, sign in zip((along, across), symmetry or (), strict=False):
        basis[:, (1 if sign == "S" else 0) :: 2] = 0.0
    coefficients = np.einsum("qi,qj,qk->kij", along, across, values, optimize=True)
    return np.asarray(coefficients.reshape(values.shape[1], -1))


def _orthonormal(at: FloatArray, edge: float, degree: int) -> FloatArray:
    return np.asarray(legendre.legvander(2.0 * at / edge, degree) * np.sqrt((2.0 * np.arange(degree + 1) + 1.0) / edge))


def mac_matrix(first: FloatArray, second: FloatArray) -> FloatArray:
    """MAC of every pair of coefficient rows (k, c) and (l, c), shape (k, l)."""
    own = np.outer((first**2).sum(axis=1), (second**2).sum(axis=1))
    return np.asarray((first @ second.T) ** 2 / np.maximum(own, 1e-300))


def step(first: Shapes, second: Shapes, row: int) -> Step:
    """Follow one mode of the first plate into the second."""
    from scipy.optimize import linear_sum_assignment  # a third of a second that readers of records need not wait for

    if not len(second.frequency_hz):
        return Step(None, 0.0, 0.0)
    mac = mac_matrix(first.coefficients, second.coefficients)
    score = mac * np.sqrt(np.outer(first.share, second.share))
    rows, columns = linear_sum_assignment(score, maximize=True)
    partner = dict(zip(rows.tolist(), columns.tolist(), strict=True)).get(row)
    if partner is None:
        return Step(None, 0.0, float(score[row].max()))
    others = np.delete(score[row], partner)
    own = score[row, partner]
    # a rival is as much the same mode when its score reaches the assigned one's
    rival = float(mac[row, partner] * others.max(initial=0.0) / own) if own > 0.0 else 1.0
    return Step(partner, float(mac[row, partner]), rival)


def follow(plates: Sequence[Shapes], row: int) -> list[Step]:
    """A mode of the first plate through all others, each compared with the one before; it ends where it is lost."""
    steps: list[Step] = []
    for before, after in pairwise(plates):
        steps.append(step(before, after, row))
        last_row = steps[-1].row
        if last_row is None or not steps[-1].kept:
            break
        row = last_row
    return steps
