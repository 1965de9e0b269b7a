"""Rows between two half-plates without end: what of a wave from the zone is reflected, passed, and turned.

The rows are joined by their dynamic stiffness (never by transfer matrices); each half-plate answers with the waves that
leave: f = F Phi^-1 q. Powers of the propagating waves add up to the incoming one's (mace2005).
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from functools import reduce

import numpy as np

from geometry.elements import ComplexArray, FloatArray
from solvers.errors import SolverError
from solvers.waves.evanescent import RowStiffness, RowWaves


@dataclass(frozen=True)
class Scattering:
    """Shares of the incoming power in each propagating wave of the half-plates, (n,): reflected and transmitted.

    `propagating` holds the indices of those waves among the half-plate's.
    """

    propagating: list[int]
    reflected: FloatArray
    transmitted: FloatArray


def stacked(row: RowStiffness, count: int) -> RowStiffness:
    """Dynamic stiffness of `count` equal rows between the outermost edges, by doubling. SolverError unless count >= 1."""
    if count < 1:
        raise SolverError(f"rows = {count}: must be at least 1")
    total: RowStiffness | None = None
    power = row
    while count:
        if count & 1:
            total = power if total is None else _joined(total, power)
        count >>= 1
        if count:
            power = _joined(power, power)
    assert total is not None
    return total


def chain(rows: Iterable[RowStiffness]) -> RowStiffness:
    """Dynamic stiffness of rows that may differ between the outermost edges, the first one lowest."""
    return reduce(_joined, rows)


def _joined(lower: RowStiffness, upper: RowStiffness) -> RowStiffness:
    """Two stacks sharing an edge, which carries no outer force."""
    middle = lower.tt + upper.bb
    follow = np.linalg.solve(middle, np.hstack([lower.tb, upper.bt]))
    m = len(middle)
    down, up = follow[:, :m], follow[:, m:]
    return RowStiffness(lower.bb - lower.bt @ down, -lower.bt @ up, -upper.tb @ down, upper.tt - upper.tb @ up)


def scatter(rows: RowStiffness, half: RowWaves, sign: FloatArray, incoming: int) -> Scattering:
    """A wave of the lower half-plate, index `incoming`, meets the rows; the same plate goes on above them.

    Degrees of freedom r, t of q_0 = phi + S Phi r and q_N = Phi t: -f_phi + S F r + D_bb q_0 + D_bt q_N = 0,
    D_tb q_0 + D_tt q_N + F t = 0. Raises SolverError when the incoming wave does not propagate.
    """
    if not half.flux[incoming] > 0.0:
        raise SolverError("the incoming wave carries no energy: ask above its cut-off")
    phi, force = half.edge, half.force
    image, image_force = sign[:, None] * phi, sign[:, None] * force
    left = np.block([[image_force + rows.bb @ image, rows.bt @ phi], [rows.tb @ image, rows.tt @ phi + force]])
    right = np.concatenate([force[:, incoming] - rows.bb @ phi[:, incoming], -rows.tb @ phi[:, incoming]])
    size = np.abs(left).max(axis=0)
    answer: ComplexArray = np.linalg.solve(left / size, right) / size
    count = phi.shape[1]
    going = [int(i) for i in np.flatnonzero(half.flux > 0.0)]
    power = half.flux / half.flux[incoming]
    reflected, transmitted = np.abs(answer[:count]) ** 2 * power, np.abs(answer[count:]) ** 2 * power
    return Scattering(going, reflected[going], transmitted[going])
