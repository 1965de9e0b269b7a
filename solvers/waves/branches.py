"""Waves followed along a path through their crossings, by the modal overlap of their shapes.

The modal overlap of two waves is the modal assurance criterion |u^H M v|^2 of their fields on one and the same cell
(allemang2003);
there the phases exp(i k.r) of neighbouring wavevectors differ little, and the global phase drops out. Degenerate waves are
first turned into those that continue to each side: eigenvectors of d lambda / d k along the step within their group.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
import scipy.sparse as sp
from scipy.sparse.csgraph import min_weight_full_bipartite_matching

from geometry.elements import ComplexArray, FloatArray, IntArray
from solvers.superelement.lattice import Lattice, Waves, degenerate

CLEAR = 0.5  # modal overlap from which a wave is followed without looking closer
LOST = 0.1  # below it a wave is another one
DEEPEST = 4  # halvings of a step
EXTRA = 4  # waves followed above those asked for, so that a branch may come down
PARTNERS = 2  # waves solved above these, so that none is followed without its degenerate partner
TIED = 0.01  # of modal overlap: waves as alike as that are equally alike, and go on in their order


class Solved:
    """The waves of a lattice, each wavevector solved once: `count` asked for, some above and their degenerate partners."""

    def __init__(self, lattice: Lattice, count: int) -> None:
        self.lattice, self.count = lattice, min(count, lattice.dof)
        self._known: dict[tuple[float, float], Waves] = {}

    def __call__(self, wavevector: FloatArray) -> Waves:
        """Waves at a wavevector (2,) in rad/m."""
        key = (float(wavevector[0]), float(wavevector[1]))
        if key not in self._known:
            self._known[key] = self.lattice.waves(np.array(key), self.count + EXTRA + PARTNERS)
        return self._known[key]

    def turned(self, wavevector: FloatArray, direction: FloatArray, neighbour: Waves) -> Waves:
        """The waves to follow at a wavevector, degenerate ones turned with all of their partners."""
        waves, kept = turned(self.lattice, self(wavevector), direction, neighbour), self.count + EXTRA
        return replace(
            waves,
            eigenvalue=waves.eigenvalue[:kept],
            frequency_hz=waves.frequency_hz[:kept],
            dofs=waves.dofs[:, :kept],
            by_modes=waves.by_modes[:kept],
        )


@dataclass(frozen=True)
class Branches:
    """Waves at each wavevector, degenerate ones turned, and the number (wavevectors, waves) of each one's branch, from 1."""

    waves: tuple[Waves, ...]
    number: IntArray


def follow(solved: Solved, wavevectors: FloatArray) -> Branches:
    """Number the waves at successive wavevectors (n, 2) so that a branch keeps its number across crossings.

    A branch that leaves the waves computed loses its number, one that enters gets a new one.
    """
    lattice = solved.lattice
    kept: list[Waves] = []
    numbers: list[IntArray] = []
    for here, there in pairwise(wavevectors):
        start = solved.turned(here, there - here, solved(there))
        if not kept:
            kept, numbers = [start], [np.arange(1, len(start.eigenvalue) + 1, dtype=np.int64)]
        leaving = numbers[-1][_through(modal_overlap(lattice, kept[-1], start)).argsort()]
        partner, likely = _step(solved, start, there, DEEPEST)
        new = 1 + max(int(number.max()) for number in numbers)
        arriving = np.empty_like(leaving)
        arriving[partner] = np.where(likely >= LOST, leaving, new + np.arange(len(leaving)))
        kept.append(solved.turned(there, there - here, start))
        numbers.append(arriving)
    return Branches(tuple(kept), _dense(numbers))


def modal_overlap(lattice: Lattice, one: Waves, two: Waves) -> FloatArray:
    """|u_i^H M v_j|^2 on the cell, (n, m)."""
    heavy = lattice.cell.mass @ two.dofs.real + 1j * (lattice.cell.mass @ two.dofs.imag)
    return np.asarray(np.abs(one.dofs.conj().T @ heavy) ** 2)


def groups(lattice: Lattice, eigenvalue: FloatArray) -> list[slice]:
    """Degenerate groups of ascending eigenvalues, those of one wave included."""
    return degenerate(eigenvalue, lattice.rounding)


def one_sided(lattice: Lattice, waves: Waves, direction: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Slopes d lambda / d s of the sorted bands along a direction (2,), beyond the wavevector and before it, (n,) each."""
    slope = np.tensordot(direction, lattice.slopes(waves), axes=1)
    beyond, before = np.empty(len(slope)), np.empty(len(slope))
    for group in groups(lattice, waves.eigenvalue):
        beyond[group] = np.linalg.eigvalsh(slope[group, group])
        before[group] = beyond[group][::-1]
    return beyond, before


def turned(lattice: Lattice, waves: Waves, direction: FloatArray, neighbour: Waves) -> Waves:
    """Degenerate waves turned into those with a slope each along a direction; of equal slopes, towards the neighbour's."""
    several = [group for group in groups(lattice, waves.eigenvalue) if group.stop - group.start > 1]
    if not several:
        return waves
    dofs = waves.dofs.copy()
    slope = np.tensordot(np.asarray(direction) / np.linalg.norm(direction), lattice.slopes(waves), axes=1)
    close = 1e-6 * np.abs(slope).max()
    for group in several:
        values, vectors = np.linalg.eigh(slope[group, group])
        dofs[:, group] = dofs[:, group] @ vectors
        bounds = [0, *(np.flatnonzero(np.diff(values) > close) + 1), len(values)]
        for low, high in pairwise(bounds):
            if high - low > 1:
                part = slice(group.start + low, group.start + high)
                dofs[:, part] = _aligned(lattice, dofs[:, part], neighbour.dofs)
    return replace(waves, dofs=dofs)


def _aligned(lattice: Lattice, waves: ComplexArray, neighbour: ComplexArray) -> ComplexArray:
    """The waves turned among themselves to be likest those of the neighbour's that lie most in their span (Procrustes)."""
    overlap = neighbour.conj().T @ (lattice.cell.mass @ waves)
    nearest = np.sort(np.argsort(-np.linalg.norm(overlap, axis=1), kind="stable")[: waves.shape[1]])
    left, _, right = np.linalg.svd(overlap[nearest])
    return np.asarray(waves @ (right.conj().T @ left.conj().T))


def _partner(like: FloatArray) -> IntArray:
    """For each row the column assigned so that the sum of the likenesses is largest."""
    every = sp.csr_array(
        1.0 + like
    )  # no entry is nought, or it would be no edge; scipy.optimize has the same, slow to import
    _, column = min_weight_full_bipartite_matching(every, maximize=True)
    return np.asarray(column, dtype=np.int64)


def _through(like: FloatArray) -> IntArray:
    """The same at one wavevector, from the waves of the step before to those of the next.

    Where the path turns, degenerate waves may be equally alike: they go on in their order.
    """
    return _partner(like + TIED * np.eye(len(like)))


def _step(solved: Solved, start: Waves, end: FloatArray, halvings: int) -> tuple[IntArray, FloatArray]:
    """For each wave at the start its partner at the end and how like they are, looking closer where that is not clear."""
    lattice, step = solved.lattice, end - start.wavevector
    there = solved.turned(end, step, start)
    like = modal_overlap(lattice, start, there)
    partner = _partner(like)
    matched = like[np.arange(len(partner)), partner]
    if halvings == 0 or matched[: solved.count].min() >= CLEAR:
        return partner, matched
    middle = solved.turned(start.wavevector + step / 2.0, step, start)
    first, near = _step(solved, start, middle.wavevector, halvings - 1)
    second, far = _step(solved, middle, end, halvings - 1)
    return second[first], np.minimum(near, far[first])


def _dense(numbers: Sequence[IntArray]) -> IntArray:
    """Branch numbers without holes, in the order of their first appearance."""
    flat = np.concatenate(numbers)
    seen, first, where = np.unique(flat, return_index=True, return_inverse=True)
    rank = np.empty(len(seen), dtype=np.int64)
    rank[np.argsort(first)] = np.arange(1, len(seen) + 1)
    return np.asarray(rank[where].reshape(len(numbers), -1))
