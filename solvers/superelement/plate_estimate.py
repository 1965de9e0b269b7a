"""How far a mode of a joined plate lies above that of its meshes, told by what the last degree and the upper modes add.

Without a part d of the eigenvector u, Rayleigh's quotient rises by d'(K - lambda M)d / (u - d)'M(u - d): at most what leaving
the part out would cost, to first order, since the rest is not adjusted. Modes left out are extrapolated as in `estimate`, the
next degrees are bounded by what the last one brought.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import numpy as np
from numpy.typing import NDArray

from geometry.elements import FloatArray, IntArray
from solvers.fem.eigen import SymmetricPencil
from solvers.superelement.cell import Cell
from solvers.superelement.estimate import RATE, SHARES
from solvers.superelement.plate import JoinedPlate


@dataclass(frozen=True)
class ModeErrors:
    """Relative errors of frequencies, (k,) each, from above: by the fixed-interface modes and by the degrees left out."""

    modes: FloatArray
    degrees: FloatArray

    @property
    def total(self) -> FloatArray:
        """Both."""
        return self.modes + self.degrees


def mode_errors(plate: JoinedPlate, pencil: SymmetricPencil, vectors: FloatArray) -> ModeErrors:
    """Estimate for M-orthonormal modes (dof, k) of a mirror class and its pencil."""
    stiff, heavy = pencil.stiffness @ vectors, pencil.mass @ vectors
    value = np.einsum("ik,ik->k", vectors, stiff)

    def rise(part: NDArray[np.bool_]) -> FloatArray:
        """By Rayleigh's quotient of u - d: K and M on the part alone tell what d itself holds."""
        where = np.flatnonzero(part)
        dropped = vectors[where]
        left = [
            np.einsum("ik,ik->k", vectors, image)
            - 2.0 * np.einsum("ik,ik->k", dropped, image[where])
            + np.einsum("ik,ik->k", dropped, matrix[where][:, where] @ dropped)
            for matrix, image in ((pencil.stiffness, stiff), (pencil.mass, heavy))
        ]
        return np.asarray(np.sqrt(np.maximum(left[0] / left[1] / value, 1.0)) - 1.0)

    modes = np.zeros_like(value)
    for share in SHARES:
        upper = _unknowns(plate, partial(_upper_modes, share))
        modes = np.maximum(modes, rise(upper) / ((1.0 - share) ** -RATE - 1.0))
    return ModeErrors(modes, rise(_unknowns(plate, _last_bubbles)))


def _unknowns(plate: JoinedPlate, of_cell: Callable[[Cell], IntArray]) -> NDArray[np.bool_]:
    """Which of the plate's unknowns are those of its cells, (dof,)."""
    found = np.zeros(plate.dof, dtype=bool)
    for placed in plate.placed:
        local = of_cell(placed.cell)
        local = local[placed.coefficient[local] != 0.0]
        found[placed.unknown[local]] = True
    return found


def _upper_modes(share: float, cell: Cell) -> IntArray:
    """The upper share of a cell's fixed-interface modes."""
    order = np.argsort(cell.fixed_hz, kind="stable")
    return np.asarray(cell.interface.count + order[len(order) - int(np.ceil(share * len(order))) :])


def _last_bubbles(cell: Cell) -> IntArray:
    """The bubbles of the highest degree on the four sides."""
    face = cell.interface
    first = face.side_block - 3 * face.layers
    return np.concatenate([face.side(index)[first:] for index in range(4)])
