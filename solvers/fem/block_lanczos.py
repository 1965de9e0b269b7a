"""Block Lanczos with full orthogonalisation for (K - sigma M)^-1 M: a factor serves a block for little more than one vector.

A triangular solve reads the whole factor; read once for several right-hand sides instead of once for each, most of the time of
single-vector Lanczos goes away. Nothing is restarted: the basis is kept whole (grimes1994).
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from geometry.elements import FloatArray

BLOCK = 8
SLICE, MAX_SLICE = 120, 300  # eigenpairs per shift at most, if the whole basis is not kept and if it is
MAX_COUNT = 6.0  # vectors of the basis per requested pair: beyond, restarts are better
TOLERANCE = 1e-11  # residual over the inverse's eigenvalue; the errors of eigenvalues go with its square
WIDE = 15  # degrees of freedom per pair at least: below, the basis would be most of the space
MASSLESS = 1e-14  # v'Mv over the largest seen: v'v is 1 for each, and such a direction moves no mass
SHORTENED = 0.5  # length left of a vector of unit length below which what was taken out of it is taken out twice
BYTES = 1e9  # of a basis that is still kept whole; it rarely grows to half of its limit, and takes no memory before
EVERY = 2  # blocks between looks at the residuals

Operator = Callable[[FloatArray], FloatArray]


def block_lanczos(
    inverse: Operator, mass: Operator, size: int, count: int, tolerance: float = TOLERANCE
) -> tuple[FloatArray, FloatArray] | None:
    """Compute eigenpairs of (K - sigma M)^-1 M, the largest in size first.

    Parameters
    ----------
    inverse, mass : callable
        Apply (K - sigma M)^-1 and M to blocks (size, k).
    size : int
        Degrees of freedom.
    count : int
        Number of eigenpairs.
    tolerance : float, optional
        Residual relative to the eigenvalue.

    Returns
    -------
    tuple of ndarray, shapes (count,) and (size, count), or None
        Eigenvalues of the inverse and M-orthonormal vectors; None if the basis would grow too large.
    """
    most = Basis.most(size, count)
    basis = Basis(size, most, mass)
    basis.append(inverse(mass(_start(size))))
    projected = np.zeros((most, most))
    before, first, turn = 0, 0, 0
    while True:
        last, turn = basis.count, turn + 1
        images = inverse(basis.weighted[:, first:last])
        # an image of a block has parts in it and in the one before it alone; `append` takes out what rounding adds
        projected[before:last, first:last] = basis.strip(images, before)
        coupling = basis.append(images)
        full = basis.count == last
        if full or (last >= 1.5 * count and turn % EVERY == 0):
            converged = _converged(projected[:last, :last], first, coupling, count, tolerance)
            if converged is not None or full:
                return converged and (converged[0], basis.vectors[:, :last] @ converged[1])
        before, first = first, last


def _start(size: int) -> FloatArray:
    """A fixed block without the symmetries that modes have."""
    number = np.arange(size, dtype=float)[:, None]
    tone = 1.0 + np.arange(BLOCK) * (np.sqrt(5.0) - 1.0) / 2.0
    return np.cos(number * 1.618 * tone) + 0.5 * np.sin(number * 0.7 * tone)


def _converged(
    projected: FloatArray, first: int, coupling: FloatArray, count: int, tolerance: float
) -> tuple[FloatArray, FloatArray] | None:
    """The `count` largest Ritz values with their mixes of the basis, (m, count), if the residuals let them pass."""
    upper = np.triu(projected)
    values, mix = np.linalg.eigh(upper + np.triu(upper, 1).T)
    order = np.argsort(-np.abs(values), kind="stable")[:count]
    residual = np.linalg.norm(coupling @ mix[first:, order], axis=0)
    if (residual > tolerance * np.abs(values[order])).any():
        return None
    return values[order], mix[:, order]


class Basis:
    """M-orthonormal vectors (size, count) and M times them, filled block by block."""

    @staticmethod
    def most(size: int, count: int) -> int:
        """Vectors that a basis for `count` eigenpairs of `size` degrees of freedom may grow to."""
        return min(size, int(MAX_COUNT * count) + 24 * BLOCK)

    @staticmethod
    def fits(size: int, count: int) -> bool:
        """Whether the whole basis fits into the memory for it."""
        return WIDE * count <= size and 16.0 * size * Basis.most(size, count) <= BYTES

    @staticmethod
    def slice_of(size: int) -> int:
        """The largest number of eigenpairs to compute from one shift.

        As many as a basis that is kept whole holds, since each further shift costs three factorisations, as long as
        orthogonalisation is the smaller part.
        """
        fitting = min((BYTES / (16.0 * size) - 24 * BLOCK) / MAX_COUNT, size / WIDE)
        return int(min(max(fitting / 1.1 - 4, SLICE), MAX_SLICE))

    def __init__(self, size: int, most: int, mass: Operator) -> None:
        self.mass, self.count, self.heaviest = mass, 0, 0.0
        self._vectors, self._weighted = (np.empty((size, most), order="F") for _ in range(2))

    @property
    def vectors(self) -> FloatArray:
        """The basis."""
        return self._vectors[:, : self.count]

    @property
    def weighted(self) -> FloatArray:
        """M times the basis."""
        return self._weighted[:, : self.count]

    def strip(self, block: FloatArray, first: int = 0) -> FloatArray:
        """Take the basis from its vector `first` on out of a block; its coefficients (count - first, k)."""
        part = self.weighted[:, first:].T @ block
        block -= self.vectors[:, first:] @ part
        return np.asarray(part)

    def append(self, block: FloatArray) -> FloatArray:
        """Orthonormalise a stripped block and append it if there is room; its coefficients in the new vectors, (m, k)."""
        block, coupling = np.linalg.qr(block)
        self.strip(block)  # the rounded rest of the basis is no longer small relative to a block of unit length
        if np.linalg.norm(block, axis=0).min() < SHORTENED:
            self.strip(block)
        weighted = self.mass(block)
        gram = block.T @ weighted
        square, turn = np.linalg.eigh((gram + gram.T) / 2.0)
        self.heaviest = max(self.heaviest, float(square[-1]))
        kept = square > MASSLESS * self.heaviest
        length, turn = np.sqrt(square[kept]), turn[:, kept]
        block, weighted = block @ (turn / length), weighted @ (turn / length)
        end = self.count + block.shape[1]
        if end <= self._vectors.shape[1]:
            self._vectors[:, self.count : end], self._weighted[:, self.count : end] = block, weighted
            self.count = end
        return np.asarray((length[:, None] * turn.T) @ coupling)
