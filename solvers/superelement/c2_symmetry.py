"""Bloch waves made real by a half turn about the cell's middle: a third of the time of a Hermitian pencil's dense solve.

Half a turn takes k to -k, conjugation (time reversal) takes it back, so that both together leave the waves at k among
themselves; degrees of freedom that they leave alone have real K and M (wigner1932).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from geometry.elements import ComplexArray, FloatArray, IntArray
from solvers.superelement.cell import Cell

REAL = 1e-9  # of the pencil's largest entry: an imaginary part that is rounding


@dataclass(frozen=True)
class C2Symmetry:
    """v = D w with real w, D = diag(exp(-i k.c) s): c (dof, 2) in m, s (dof,) of 1 or i.

    The turn takes a side's DOF to the opposite side, times its sign: c is half the step between the two, s makes the
    sign 1.
    """

    middle_m: FloatArray
    factor: ComplexArray

    def diagonal(self, wavevector: FloatArray) -> ComplexArray:
        """D at a wavevector (2,) in rad/m, (dof,)."""
        return np.asarray(np.exp(-1j * self.middle_m @ np.asarray(wavevector, dtype=float)) * self.factor)

    def turned(self, matrix: ComplexArray, wavevector: FloatArray) -> ComplexArray:
        """D^H A D."""
        diagonal = self.diagonal(wavevector)
        return np.asarray(diagonal.conj()[:, None] * matrix * diagonal)

    def is_real(self, matrix: ComplexArray, wavevector: FloatArray) -> bool:
        """Whether D^H A D is real but for rounding."""
        turned = self.turned(matrix, wavevector)
        return bool(np.abs(turned.imag).max() <= REAL * np.abs(turned).max())


def c2_symmetry(cell: Cell, column: IntArray, offset: FloatArray) -> C2Symmetry | None:
    """The turn of a lattice's free degrees of freedom, of which `column` (cell dof,) follow, `offset` (cell dof, 2) pitches on.

    None where a fixed-interface mode's parity is not known.
    """
    parity = cell.fixed_parity.prod(axis=1)
    if not parity.all():
        return None
    face, sign = cell.interface, np.empty(cell.dof)
    (_, one), (where, other) = face.mirror(0), face.mirror(1)
    sign[: face.count], sign[face.count :] = other * one[where], parity
    own, middle = np.empty(column.max() + 1), np.zeros((column.max() + 1, 2))
    first = offset.sum(axis=1) == 0.0
    own[column[first]] = sign[first]
    np.maximum.at(middle, column, offset * np.array(cell.size_m[:2]) / 2.0)
    return C2Symmetry(middle, np.where(own > 0.0, 1.0 + 0.0j, 1.0j))
