"""What the fixed-interface modes left out of a cell do to it, told by their residual flexibility D (macneal1971).

They take h D from the boundary's dynamic stiffness at an eigenvalue l, and l^2 <= h <= l^2 L / (L - l), L the lowest eigenvalue
left out. A wave of the eigenvalue l and the flexibility d = u^H D u without them has m = l - h(m) d with them.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.linalg import eigh

from geometry.elements import ComplexArray, FloatArray

STEPS = 6  # of Newton: the error is squared each time
CHORD = 1e-6  # relative distance of eigenvalues below which a tangent replaces the chord
KNOWN = 0.5  # of the lowest eigenvalue left out: up to here h is known within a factor of two


@dataclass(frozen=True)
class ResidualModes:
    """The modes left out, none below the scaled eigenvalue `edge`."""

    edge: float

    def growth(self, eigenvalue: FloatArray | float) -> FloatArray:
        """L / (L - l) at eigenvalues l (k,); infinite from L on."""
        values = np.asarray(eigenvalue, dtype=float)
        below = values < self.edge
        return np.where(below, self.edge / np.where(below, self.edge - values, 1.0), np.inf)

    def softening(self, eigenvalue: FloatArray | float) -> FloatArray:
        """h = l^2 (1 + L / (L - l)) / 2 at eigenvalues l (k,), the middle of its bounds; from KNOWN L on, as much as there."""
        values = np.minimum(eigenvalue, KNOWN * self.edge)
        return np.asarray(values**2 * (1.0 + self.growth(values)) / 2.0)

    def slope(self, eigenvalue: FloatArray | float) -> FloatArray:
        """dh/dl at eigenvalues l (k,)."""
        values = np.asarray(eigenvalue, dtype=float)
        below = values <= KNOWN * self.edge
        growth = self.growth(np.where(below, values, 0.0))
        return np.where(below, values * (1.0 + growth) + (values * growth) ** 2 / (2.0 * self.edge), 0.0)

    def coupled(self, eigenvalue: FloatArray, flexibility: ComplexArray) -> tuple[FloatArray, ComplexArray]:
        """Eigenvalues m (n,) of diag(l) - h(m) E, E (n, n) the flexibility, and vectors (n, n) of length 1.

        A chord through h at the eigenvalues of the two waves that an entry couples makes the problem linear in m; from KNOWN L
        on h goes on along its tangent there. The pencil's mass is positive, because the modes left out cannot move more of the
        cell's mass than there is: L E <= 1, and chords of h below KNOWN L take at most half of it.
        """
        known = self._uncoupled(eigenvalue, flexibility.diagonal().real)
        softened, apart = self.softening(known), known[:, None] - known
        alike = np.abs(apart) <= CHORD * np.maximum(*np.abs(np.broadcast_arrays(known[:, None], known)))
        slope = np.where(
            alike,
            (self.slope(known)[:, None] + self.slope(known)) / 2.0,
            (softened[:, None] - softened) / np.where(alike, 1.0, apart),
        )
        start = (softened[:, None] + softened - slope * (known[:, None] + known)) / 2.0
        values, turn = eigh(np.diag(eigenvalue) - start * flexibility, np.eye(len(known)) + slope * flexibility)
        return values, np.asarray(turn / np.linalg.norm(turn, axis=0))

    def _uncoupled(self, eigenvalue: FloatArray, own: FloatArray) -> FloatArray:
        """Roots m (n,) of m + h(m) d = l, at most KNOWN L.

        Newton's steps on a rising convex function approach its root from above and never pass it.
        """
        edge = KNOWN * self.edge
        root = np.minimum(eigenvalue, edge)
        for _ in range(STEPS):
            step = (root + self.softening(root) * own - eigenvalue) / (1.0 + self.slope(root) * own)
            root = np.minimum(root - step, edge)
        return np.asarray(root)

    def bounds(self, eigenvalue: FloatArray, own: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Between which eigenvalues waves of l (k,) and flexibilities d (k,) come to lie, (k,) each."""
        edge, lost = self.edge, np.maximum(own, 0.0)
        root = np.sqrt((edge - eigenvalue) ** 2 + 4.0 * edge**2 * lost * eigenvalue)
        lower = 2.0 * eigenvalue * edge / (edge + eigenvalue + root)
        return np.asarray(lower), np.asarray(2.0 * eigenvalue / (1.0 + np.sqrt(1.0 + 4.0 * lost * eigenvalue)))

    def bar(self, softened: FloatArray, eigenvalue: FloatArray, own: FloatArray) -> FloatArray:
        """Half-widths of frequencies' bars, relative, (k,): what the bounds leave open and the second order of what was taken.

        Waves told at m (k,) whose bounds overlap may change places: the n-th lies between the n-th lower and n-th upper bound.
        """
        lower, upper = (np.sort(bound) for bound in self.bounds(eigenvalue, own))
        size = np.where(softened > 0.0, 2.0 * softened, 1.0)
        rise = np.maximum(eigenvalue - softened, 0.0) / size
        half = np.maximum(upper - softened, softened - lower) / size + rise * rise.max(initial=0.0)
        return np.where(softened > 0.0, np.maximum(half, 0.0), 0.0)
